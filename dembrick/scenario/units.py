"""Units of tables of numbers, by quantity, with their factors to SI; and checks of magnitudes.

`check_magnitudes` refuses numbers too large for any structure, whose squares and products could overflow. The bounds
are far beyond what anyone builds, and far within the range of a double: a typing error, such as an extra digit in an
exponent, is reported as such instead of causing an overflow later.
`unit_slips` remarks on numbers that are possible but suggest a wrong unit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from dembrick.errors import ScenarioError
from dembrick.scenario.angles import OF_SPRINGING, in_degrees, in_radians
from dembrick.scenario.checks import present, show

if TYPE_CHECKING:
    from dembrick.geometry.shapes import Shape
    from dembrick.scenario.model import Scenario


STANDARD_GRAVITY = 9.80665  # m/s2: the unit "g", independent of the gravity of a scenario

LENGTHS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254, "ft": 0.3048}  # units of drawings, in metres
UNITS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "min": 60.0},
    "displacement": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6},
    "velocity": {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3},
    "acceleration": {"m/s2": 1.0, "cm/s2": 1e-2, "mm/s2": 1e-3, "Gal": 1e-2, "g": STANDARD_GRAVITY},
    "force": {"N": 1.0, "kN": 1e3, "MN": 1e6},
    "factor": {"1": 1.0, "-": 1.0, "%": 1e-2},
}
_SAME = str.maketrans({"²": "2", "μ": "µ", "−": "-", " ": None, "^": None, "*": None})  # noqa: RUF001
_SPELLED = {"sec": "s", "m/s/s": "m/s2", "cm/s/s": "cm/s2", "mm/s/s": "mm/s2", "gal": "Gal", "micron": "µm"}


def size_of(quantity: str, unit: str) -> float | None:
    """Factor from a unit of the quantity to SI; None if it is not a unit of that quantity."""
    unit = unit.translate(_SAME)
    return UNITS[quantity].get(_SPELLED.get(unit, unit))


def known(quantity: str) -> str:
    """The units of a quantity, for a message."""
    return ", ".join(UNITS[quantity])


FARTHEST = 1e12  # m, from the origin
GREATEST = {  # by key
    "gravity": (1e9, "m/s2"),
    "velocity": (1e9, "m/s"),
    "angular_velocity": (1e9, "rad/s"),
    "density": (1e15, "kg/m3"),
    "normal_stiffness": (1e30, "Pa/m"),
    "shear_stiffness": (1e30, "Pa/m"),
    "friction": (1e12, ""),
    "force": (1e30, "N"),
}


def check_magnitudes(scenario: Scenario) -> None:
    """Raise a ScenarioError if a number of the scenario is beyond what can be computed with."""
    _check("gravity", scenario.gravity, "")
    for block in scenario.all_blocks:
        whose = f" of block {show(block.name)}"
        far = max(map(abs, present(block.position)))
        if not far <= FARTHEST:
            raise ScenarioError(
                f"position{whose} = {show(block.position)} is {far:.3g} m from the origin; at most {FARTHEST:g} m is "
                "allowed"
            )
        _check("velocity", block.velocity, whose)
        _check("angular_velocity", block.angular_velocity, whose)
    for name, material in scenario.materials.items():
        _check("density", (material.density,), f" of material {show(name)}")
    laws = [("", scenario.joint), *((f" between {show(entry.between)}", entry.law) for entry in scenario.joints)]
    for whose, law in laws:
        for key in ("normal_stiffness", "shear_stiffness", "friction"):
            _check(key, (getattr(law, key),), whose)
    for number, load in enumerate(scenario.loads, 1):
        _check("force", load.force, f" of load number {number}")


def _check(key: str, values, whose: str) -> None:
    bound, unit = GREATEST[key]
    if not max(map(abs, values)) <= bound:
        given = values[0] if len(values) == 1 else values
        most = f"{bound:g} {unit}".strip()
        raise ScenarioError(f"{key}{whose} = {show(given)} is out of range: at most {most} is allowed")


STEEPEST_FRICTION = 1.5
DENSITIES = (500.0, 8000.0)  # kg/m3, from wood to steel
WEIGHTS = (2500.0, 40000.0)  # N/m3, from expanded clay to slag
GRAVITIES = (9.0, 10.0)  # m/s2
LARGEST_BLOCK = 20.0  # m


SMALLEST_FRICTION_ANGLE = math.pi / 3.0  # deg, of a fill: less is that of no soil, and 60 deg in radians


def _radians(scenario: Scenario) -> list[str]:
    """A sentence for each angle (deg) that is no plausible one, and a plausible one in radians."""
    suspects = [
        (f"angle of {kind} {show(one.name)}", one.angle, OF_SPRINGING)
        for kind, generators in (("arch", scenario.arches), ("dome", scenario.domes))
        for one in generators
    ]
    for kind, generators in (("wall", scenario.walls), ("stack", scenario.stacks), ("arch", scenario.arches)):
        suspects += [(f"heading of {kind} {show(one.name)}", one.heading, math.pi / 4.0) for one in generators]
    found = [(key, angle) for key, angle, least in suspects if in_radians(angle, least)]
    for fill in scenario.fills:
        if fill.friction_angle and fill.friction_angle < SMALLEST_FRICTION_ANGLE:
            found.append((f"friction_angle of the fill on {show(fill.block)}", fill.friction_angle))
    return [f"{key} = {in_degrees(angle)}" for key, angle in found]


def unit_slips(scenario: Scenario, shapes: Sequence[Shape]) -> list[str]:
    """Remarks on numbers of a scenario that are probably in another unit; ``shapes``: shapes of its blocks."""
    found = []
    laws = [("joint", scenario.joint), *((f"joint between {show(one.between)}", one.law) for one in scenario.joints)]
    for where, law in laws:
        if law.friction > STEEPEST_FRICTION:
            found.append(
                f"friction of {where} = {law.friction:g} is a coefficient, the tangent of "
                f"{math.degrees(math.atan(law.friction)):.1f} deg; give the tangent of the friction angle"
            )
    for name, material in scenario.materials.items():
        if not DENSITIES[0] <= material.density <= DENSITIES[1]:
            found.append(
                f"density of material {show(name)} = {material.density:g} kg/m3 fits no stone (about 2000); "
                "multiply g/cm3 by 1000"
            )
    weighed = [("fill", fill.block, fill.weight) for fill in scenario.fills]
    weighed += [("pressure", one.block, one.weight) for one in scenario.pressures if one.weight is not None]
    for kind, loaded, weight in weighed:
        if not WEIGHTS[0] <= weight <= WEIGHTS[1]:
            found.append(
                f"weight of the {kind} on {show(loaded)} = {weight:g} N/m3 fits no earth (about 18000) and no water "
                "(9810); multiply kN/m3 by 1000, kg/m3 by 9.81"
            )
    found += _radians(scenario)
    size = math.hypot(*scenario.gravity)
    if size > 0.0 and not scenario.gravity[2] <= -0.5 * size:
        found.append(f"gravity = {show(scenario.gravity)} does not point down, which is -z")
    if size > 0.0 and not GRAVITIES[0] <= size <= GRAVITIES[1]:
        found.append(f"gravity = {show(scenario.gravity)} is {size:g} m/s2, but on earth it is 9.81 m/s2")
    large = [
        (block, float((shape.vertices.max(axis=0) - shape.vertices.min(axis=0)).max()))
        for block, shape in zip(scenario.all_blocks, shapes, strict=True)
        if not block.fixed and shape.diameter > LARGEST_BLOCK
    ]
    large = [(block, length) for block, length in large if length > LARGEST_BLOCK]
    if large:
        more = f" (and {len(large) - 1} more)" if len(large) > 1 else ""
        block, length = large[0]
        found.append(
            f"block {show(block.name)}{more} is {length:g} m long: lengths are in metres; multiply mm by 0.001"
        )
    return found
