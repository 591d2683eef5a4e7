"""Surface pressures: constant, or of a fluid or a fill below its surface; dead, or driven by the load factor."""

from __future__ import annotations

from dataclasses import dataclass

from dembrick.errors import ScenarioError
from dembrick.scenario.blocks import Vector
from dembrick.scenario.checks import (
    assign,
    check_name,
    direction,
    present,
    real,
    require,
    require_type,
    show,
)
from dembrick.scenario.stages import stage_numbers

PRESSURE = "pressure on "  # begins the name of a driven pressure among the actuators


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
