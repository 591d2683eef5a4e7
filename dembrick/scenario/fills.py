"""Fills on the backs of arches and vaults: the weight of the earth above, and what it presses sideways."""

from __future__ import annotations

import math
from dataclasses import dataclass

from dembrick.errors import ScenarioError
from dembrick.scenario.checks import assign, assign_positive, check_name, one_of, present, real, require, show
from dembrick.scenario.stages import stage_numbers

NONE, AT_REST, ACTIVE, PASSIVE = STATES = ("none", "at-rest", "active", "passive")


@dataclass(frozen=True, slots=True)
class Fill:
    """A fill on all bare faces of ``block`` (or of a group) that look up: dead loads, which ride with the blocks.

    The vertical stress at depth h below the height ``surface`` (m, along +z) is ``weight`` (N/m3) times h, and the
    horizontal one K times that. A face bears the column of fill above it, and K times the stress on what it shows of
    itself from the side. ``pressure`` says which K: "none" (0), "at-rest" (1 - sin phi, Jaky 1944), "active" or
    "passive" ((1 - sin phi) / (1 + sin phi) and its inverse, Rankine 1857), with phi = ``friction_angle`` (deg); or
    ``coefficient`` is K. A passive pressure as a dead load takes for granted that the blocks push into the fill.
    ``stages``: numbers of the stages in which it acts, None for all.
    """

    block: str
    surface: float
    weight: float
    pressure: str | None = None
    friction_angle: float | None = None
    coefficient: float | None = None
    stages: tuple[int, ...] | None = None

    def __post_init__(self):
        label = f" of the fill on {show(check_name('block', self.block))}"
        assign(self, surface=real(f"surface{label}", self.surface), stages=stage_numbers(f"stages{label}", self.stages))
        assign_positive(self, "weight", "N/m3", label)
        if (self.pressure is None) == (self.coefficient is None):
            raise ScenarioError(
                f"the fill on {show(self.block)} needs either pressure ({', '.join(STATES)}), or coefficient, "
                "horizontal over vertical stress"
            )
        if self.coefficient is not None:
            coefficient = real(f"coefficient{label}", self.coefficient)
            require(coefficient >= 0.0, f"coefficient{label}", coefficient, "it must be at least 0")
            assign(self, coefficient=coefficient)
        else:
            one_of(f"pressure{label}", present(self.pressure), STATES)
        earth = self.pressure not in (None, NONE)
        if earth and self.friction_angle is None:
            raise ScenarioError(
                f"the fill on {show(self.block)} presses {show(self.pressure)} and needs friction_angle (deg), or give "
                "coefficient in place of pressure"
            )
        if self.friction_angle is not None:
            angle = real(f"friction_angle{label}", self.friction_angle)
            how = "it goes with pressure = at-rest, active or passive only"
            require(earth, f"friction_angle{label}", angle, how)
            require(0.0 <= angle < 60.0, f"friction_angle{label}", angle, "it lies between 0 and 60 deg")
            assign(self, friction_angle=angle)

    @property
    def ratio(self) -> float:
        """K, horizontal over vertical stress."""
        if self.coefficient is not None:
            return self.coefficient
        if self.pressure == NONE:
            return 0.0
        sine = math.sin(math.radians(present(self.friction_angle)))
        active = (1.0 - sine) / (1.0 + sine)
        return {AT_REST: 1.0 - sine, ACTIVE: active, PASSIVE: 1.0 / active}[present(self.pressure)]

    @property
    def at_height(self) -> tuple[float, float]:
        """Vertical stress c0 + c1 z as (c0 in Pa, c1 in Pa/m), where it is not negative."""
        return self.weight * self.surface, -self.weight
