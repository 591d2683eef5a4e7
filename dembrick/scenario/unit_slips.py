"""Numbers that are possible but look like a slip of units: a remark each, never a refusal."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from dembrick.geometry.shapes import Shape
from dembrick.scenario.checks import show
from dembrick.scenario.model import Scenario

STEEPEST_FRICTION = 1.5
DENSITIES = (500.0, 8000.0)  # kg/m3, of wood and of steel
GRAVITIES = (9.0, 10.0)  # m/s2
LARGEST_BLOCK = 20.0  # m


def unit_slips(scenario: Scenario, shapes: Sequence[Shape]) -> list[str]:
    """A sentence for each number of a scenario that is likely to be meant in another unit; ``shapes`` of its blocks."""
    found = []
    laws = [("joint", scenario.joint), *((f"joint between {show(one.between)}", one.law) for one in scenario.joints)]
    for where, law in laws:
        if law.friction > STEEPEST_FRICTION:
            found.append(
                f"friction of {where} = {law.friction:g} is a coefficient, the tangent of "
                f"{math.degrees(math.atan(law.friction)):.1f} deg; write the tangent of an angle"
            )
    for name, material in scenario.materials.items():
        if not DENSITIES[0] <= material.density <= DENSITIES[1]:
            found.append(
                f"density of material {show(name)} = {material.density:g} kg/m3 is that of no stone (about 2000); "
                "g/cm3 times 1000 give kg/m3"
            )
    size = math.hypot(*scenario.gravity)
    if size > 0.0 and not scenario.gravity[2] <= -0.5 * size:
        found.append(f"gravity = {show(scenario.gravity)} does not point down, which is -z")
    if size > 0.0 and not GRAVITIES[0] <= size <= GRAVITIES[1]:
        found.append(f"gravity = {show(scenario.gravity)} is {size:g} m/s2, and on earth it is 9.81 m/s2")
    large = [
        (block, float(np.ptp(shape.vertices, axis=0).max()))
        for block, shape in zip(scenario.all_blocks, shapes, strict=True)
        if not block.fixed and shape.diameter > LARGEST_BLOCK
    ]
    large = [(block, length) for block, length in large if length > LARGEST_BLOCK]
    if large:
        more = f" (and {len(large) - 1} more)" if len(large) > 1 else ""
        block, length = large[0]
        found.append(
            f"block {show(block.name)}{more} is {length:g} m long: lengths are in metres, and mm times 0.001 give m"
        )
    return found
