"""Surface pressures (constant, or of a fluid or fill below its surface; dead, or driven by the load factor) and fills
on the backs of arches and vaults (weight of the earth above, and its horizontal pressure).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from dembrick.errors import ScenarioError
from dembrick.scenario.blocks import Vector
from dembrick.scenario.checks import check_name, present, real, require, show
from dembrick.scenario.declared import (
    check_keys,
    choice,
    declare,
    naming,
    not_negative,
    number,
    positive,
    truth,
    unit_vector,
)
from dembrick.scenario.stages import stages_of


@dataclass(frozen=True, slots=True)
class Pressure:
    """A pressure on the bare faces of ``block`` (or of a group) whose outward normal is ``direction``.

    The pressure is a constant ``value`` (Pa), or that of a fluid: ``weight`` (N/m3) times the depth below ``surface``
    (m, height along +z). It acts along the face normals, against ``direction``, on the part of a face that no joint
    covers. With small displacements, area, direction and centre of pressure are those of the start: the force moves
    with the block and keeps its direction. In real time and in the deformed geometry it follows the faces.
    ``actuator``: the pressure is the driven load, and V its multiplier. ``stages``: numbers of the stages in which it
    acts, None for all.
    """

    block: str = field(metadata=naming("a block or group", "whose faces are loaded"))
    direction: Vector = field(metadata=unit_vector("outward normal of the loaded faces"))
    value: float | None = field(
        default=None,
        metadata=positive("Pa", "a constant pressure", "it must be greater than 0 Pa; it presses on the face"),
    )
    surface: float | None = field(default=None, metadata=number("m", "or the height of the surface of a fluid or fill"))
    weight: float | None = field(
        default=None,
        metadata=positive(
            "N/m3",
            "its weight per volume; the pressure is weight times depth",
            "it must be greater than 0 N/m3; it presses on the face",
        ),
    )
    actuator: bool = field(default=False, metadata=truth("the pressure is the driven load, with the multiplier V"))
    stages: tuple[int, ...] | None = field(
        default=None, metadata=stages_of("the stages in which it acts; left out, all")
    )

    def __post_init__(self):
        label = f" of the pressure on {show(check_name('block', self.block))}"
        check_keys(self, label)
        if (self.value is None) == (self.surface is None) or (self.surface is None) != (self.weight is None):
            raise ScenarioError(
                f"the pressure on {show(self.block)} needs either value (Pa), or surface (m) and weight (N/m3)"
            )

    @property
    def at_height(self) -> tuple[float, float]:
        """Coefficients (c0 in Pa, c1 in Pa/m) of the pressure p = c0 + c1 z, which acts where it is positive."""
        if self.weight is None:
            return present(self.value), 0.0
        return self.weight * present(self.surface), -self.weight


NONE, AT_REST, ACTIVE, PASSIVE = STATES = ("none", "at-rest", "active", "passive")


def _angle(key: str, value, label: str) -> float:
    found = real(key + label, value)
    require(0.0 <= found < 60.0, key + label, found, "it must lie between 0 and 60 deg")
    return found


@dataclass(frozen=True, slots=True)
class Fill:
    """A fill on all upward bare faces of ``block`` (or of a group): dead loads, which move with the blocks.

    The vertical stress at depth h below the height ``surface`` (m, along +z) is ``weight`` (N/m3) times h, the
    horizontal stress K times that. A face carries the column of fill above it, and K times the vertical stress on its
    area in elevation. ``pressure`` selects K: "none" (0), "at-rest" (1 - sin phi, Jaky 1944), "active" or
    "passive" ((1 - sin phi) / (1 + sin phi) and its inverse, Rankine 1857), with phi = ``friction_angle`` (deg); or
    ``coefficient`` is K. A passive pressure as a dead load presumes that the blocks push into the fill.
    ``stages``: numbers of the stages in which it acts, None for all.
    """

    block: str = field(metadata=naming("a block or group", "whose bare upward faces bear the fill"))
    surface: float = field(metadata=number("m", "height of its surface"))
    weight: float = field(metadata=positive("N/m3", "its weight per volume"))
    pressure: str | None = field(
        default=None, metadata=choice(STATES, "its state, which decides its sideways pressure")
    )
    friction_angle: float | None = field(
        default=None,
        metadata=declare(
            "0 to 60", "friction angle of the fill; needed for at-rest, active and passive", "deg", _angle
        ),
    )
    coefficient: float | None = field(
        default=None, metadata=not_negative("1", "in place of pressure: horizontal over vertical stress")
    )
    stages: tuple[int, ...] | None = field(
        default=None, metadata=stages_of("the stages in which it acts; left out, all")
    )

    def __post_init__(self):
        label = f" of the fill on {show(check_name('block', self.block))}"
        check_keys(self, label)
        if (self.pressure is None) == (self.coefficient is None):
            raise ScenarioError(
                f"the fill on {show(self.block)} needs either pressure ({', '.join(STATES)}), or coefficient, "
                "horizontal over vertical stress"
            )
        earth = self.pressure not in (None, NONE)
        if earth and self.friction_angle is None:
            raise ScenarioError(
                f"the fill on {show(self.block)} with pressure = {show(self.pressure)} needs friction_angle (deg); or "
                "give coefficient in place of pressure"
            )
        if self.friction_angle is not None:
            how = "it belongs to pressure = at-rest, active or passive only"
            require(earth, f"friction_angle{label}", self.friction_angle, how)

    @property
    def ratio(self) -> float:
        """K, ratio of horizontal to vertical stress."""
        if self.coefficient is not None:
            return self.coefficient
        if self.pressure == NONE:
            return 0.0
        sine = math.sin(math.radians(present(self.friction_angle)))
        active = (1.0 - sine) / (1.0 + sine)
        return {AT_REST: 1.0 - sine, ACTIVE: active, PASSIVE: 1.0 / active}[present(self.pressure)]

    @property
    def at_height(self) -> tuple[float, float]:
        """Coefficients (c0 in Pa, c1 in Pa/m) of the vertical stress c0 + c1 z, which acts where it is positive."""
        return self.weight * self.surface, -self.weight
