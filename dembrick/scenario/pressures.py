"""Surface pressures: constant, or of a fluid or a fill below its surface; dead, or driven by the load factor;
and fills on the backs of arches and vaults: the weight of the earth above, and what it presses sideways.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from dembrick.errors import ScenarioError
from dembrick.scenario.blocks import Vector
from dembrick.scenario.checks import (
    assign,
    assign_positive,
    check_name,
    direction,
    one_of,
    present,
    real,
    require,
    require_type,
    show,
)
from dembrick.scenario.stages import stage_numbers


@dataclass(frozen=True, slots=True)
class Pressure:
    """A pressure on the bare faces of ``block`` (or of a group) whose outward normal is ``direction``.

    Either ``value`` (Pa) everywhere, or that of a fluid: ``weight`` (N/m3) times the depth below ``surface`` (m, height
    along +z). It acts along the normals of the faces, against ``direction``, on what of a face no joint covers. Area,
    direction and centre of pressure are those of the start: the force rides with the block and keeps its direction.
    ``actuator``: the pressure is the driven load, and V its multiplier. ``stages``: numbers of the stages in which it
    acts, None for all.
    """

    block: str
    direction: Vector
    value: float | None = None
    surface: float | None = None
    weight: float | None = None
    actuator: bool = False
    stages: tuple[int, ...] | None = None

    def __post_init__(self):
        label = f" of the pressure on {show(check_name('block', self.block))}"
        assign(self, direction=direction("direction", self.direction, label))
        assign(self, stages=stage_numbers(f"stages{label}", self.stages))
        require_type(isinstance(self.actuator, bool), f"actuator{label}", self.actuator, "true or false")
        if (self.value is None) == (self.surface is None) or (self.surface is None) != (self.weight is None):
            raise ScenarioError(
                f"the pressure on {show(self.block)} needs either value (Pa), or surface (m) and weight (N/m3)"
            )
        for key in ("value", "surface", "weight"):
            if getattr(self, key) is not None:
                assign(self, **{key: real(f"{key}{label}", getattr(self, key))})
        strength = present(self.value if self.weight is None else self.weight)
        key, unit = ("value", "Pa") if self.weight is None else ("weight", "N/m3")
        require(strength > 0.0, f"{key}{label}", strength, f"it must be greater than 0 {unit}; it presses on the face")

    @property
    def at_height(self) -> tuple[float, float]:
        """Pressure p = c0 + c1 z as (c0 in Pa, c1 in Pa/m), where it is not negative."""
        if self.weight is None:
            return present(self.value), 0.0
        return self.weight * present(self.surface), -self.weight


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
