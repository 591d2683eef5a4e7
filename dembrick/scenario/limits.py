"""Numbers so large or small that no structure has them, and that squares and products of doubles do not hold.

The bounds are far beyond what anyone builds, and far within what a double holds: a slip of the hand, such as a digit
too many in an exponent, is told as such instead of coming out as an overflow somewhere.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from dembrick.errors import ScenarioError
from dembrick.scenario.checks import present, show

if TYPE_CHECKING:
    from dembrick.scenario.model import Scenario

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
    """ScenarioError if a number of the scenario is beyond what can be computed with."""
    _check("gravity", scenario.gravity, "")
    for block in scenario.all_blocks:
        whose = f" of block {show(block.name)}"
        far = max(map(abs, present(block.position)))
        if not far <= FARTHEST:
            raise ScenarioError(
                f"position{whose} = {show(block.position)} is {far:.3g} m from the origin; at most {FARTHEST:g} m are "
                "taken"
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
        raise ScenarioError(f"{key}{whose} = {show(given)} is out of range: at most {most} is taken")
