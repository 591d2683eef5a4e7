"""Torsion strength of bent convex joints whose friction follows the linear pressure, in real time."""

import numpy as np
import pytest

from dembrick import theory
from dembrick.runs.simulate import simulate
from dembrick.scenario.controls import DynamicControl
from dembrick.scenario.model import Block, Load, Output
from helpers.stone_scenes import law, of_stone

A, B, HEIGHT, MU, G = 0.3, 0.2, 0.1, 0.64, 9.81
WEIGHT = 2000.0 * A * B * HEIGHT * G
# M_T / M_T0 of a rectangle whose pressure is off centre by e = b / 4, see `theory` and test_pressures
STRENGTH = {"full": 1.0, "effective": 0.8503, "linear": 0.8763}


def turned(pressure, part):
    """Rotation (rad) of a block in 0.05 s under a couple that is ``part`` of the joint's strength; a dead load on one
    edge, as heavy as the block, puts the resultant at b / 4."""
    couple = part * STRENGTH[pressure] * MU * 2.0 * WEIGHT * theory.equations.torsion_parameter(A, B)
    push = couple / B
    scene = of_stone(
        law("convex", MU, 1e9, pressure=pressure),
        DynamicControl(0.05),
        (
            Block("floor", "stone", (1.0, 1.0, 0.1), (0.0, 0.0, -0.05), fixed=True),
            Block("block", "stone", (A, B, HEIGHT), (0.0, 0.0, 0.5 * HEIGHT)),
        ),
        loads=(
            Load("block", (0.0, 0.0, -WEIGHT), (0.0, 0.5 * B, 0.5 * HEIGHT)),
            Load("block", (-push, 0.0, 0.0), (0.0, 0.5 * B, 0.0)),
            Load("block", (push, 0.0, 0.0), (0.0, -0.5 * B, 0.0)),
        ),
        output=Output(rows=20, frames=20),
    )
    q = simulate(scene).frames["orientation"][:, 1]
    return 2.0 * abs(float(np.ptp(np.arctan2(q[[0, -1], 3], q[[0, -1], 0]))))


@pytest.mark.parametrize("pressure", STRENGTH)
def test_a_bent_joint_turns_at_the_strength_of_its_pressure(pressure):
    """One per cent below its torsion strength the joint sticks, one per cent above it the block rotates."""
    assert turned(pressure, 0.99) < 1e-8
    assert turned(pressure, 1.01) > 5e-4
