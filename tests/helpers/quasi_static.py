"""Quasi-static scenes: one law for all joints, gravity, and loads that push or tilt the blocks."""

from __future__ import annotations

from dembrick.scenario.controls import TiltControl
from dembrick.scenario.generators import Wall
from dembrick.scenario.model import Scenario
from helpers.stone_scenes import law, of_stone


def scene(control, formulation="concave", friction=0.7, stiffness=1e10, **parts) -> Scenario:
    return of_stone(law(formulation, friction, stiffness), control, **parts)


def tilt(axis=(1.0, 0.0, 0.0), **options):
    return TiltControl(axis, 1.0, 1e-4, quasi_static=True, **options)


def leaf(formulation, **options) -> Scenario:
    """The single-leaf wall of 10 x 10 blocks 0.3 x 0.2 x 0.1, tilted out of plane."""
    wall = Wall("wall", "stone", (0.3, 0.2, 0.1), courses=10, blocks=10, base=0.1)
    return scene(tilt(), formulation, friction=0.64, walls=(wall,), **options)
