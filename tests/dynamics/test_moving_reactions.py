"""Reactions of supports in real time: at rest, under a sliding block, and through contacts that form during the run."""

import numpy as np
import pytest

from dembrick.runs.simulate import simulate
from dembrick.scenario.controls import BaseMotionControl, DynamicControl, Pulse
from dembrick.scenario.model import Block, Output
from helpers.stone_scenes import law, of_stone

G, MU = 9.81, 0.3
FLOOR = Block("floor", "stone", (4.0, 4.0, 0.2), (0.0, 0.0, -0.1), fixed=True)


def scene(*blocks, control, formulation="concave"):
    output = Output(("joints", "energy"), rows=200, frames=1)
    return of_stone(law(formulation, MU), control, blocks, output=output)


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_a_sliding_block_drags_its_floor(formulation):
    """The reaction of a floor that jumps aside carries the weight and the drag mu N, at the height of the joint."""
    block = Block("block", "stone", (0.4, 0.4, 0.1), (0.5, 0.0, 0.05))
    control = BaseMotionControl(0.2, (1.0, 0.0, 0.0), pulse=Pulse(0.5 * G, 0.2))
    rows = simulate(scene(FLOOR, block, control=control, formulation=formulation)).rows
    weight, last = 2000.0 * G * 0.016, rows["reaction"][100:150, 0].mean(axis=0)
    x = rows["displacement"][100:150].mean()  # the block lags behind
    assert last[:3] == pytest.approx([MU * weight, 0.0, weight], rel=1e-3, abs=1e-4 * weight)
    # friction acts 0.1 m above the floor's centroid; the weight's line of action has moved with the block, and the
    # block's inertia shifts the pressure
    assert last[4] == pytest.approx(0.1 * MU * weight - (0.5 - x) * weight + 0.05 * MU * weight, rel=2e-3)
    first = rows["reaction"][0, 0]
    assert first[:3] == pytest.approx([0.0, 0.0, weight], abs=1e-5 * weight)


def test_a_block_that_has_dropped_is_carried_by_a_new_contact():
    """A block a centimetre above its floor, without a joint, comes to rest on it, carried by a new contact."""
    block = Block("block", "stone", (0.4, 0.4, 0.4), (0.5, 0.25, 0.21))
    rows = simulate(scene(FLOOR, block, control=DynamicControl(0.3, 0.15))).rows
    weight = 2000.0 * G * 0.064
    assert not rows["reaction"][0].any()
    rest = rows["reaction"][-20:, 0].mean(axis=0)
    assert rest == pytest.approx([0.0, 0.0, weight, 0.25 * weight, -0.5 * weight, 0.0], rel=2e-3, abs=2e-3 * weight)
    # the impulse that stops the fall and meanwhile carries the weight
    impulse = np.trapezoid(rows["reaction"][:, 0, 2], rows["time"])
    assert impulse == pytest.approx(weight * 0.3, rel=0.2)


def test_without_a_support_there_is_no_reaction():
    block = Block("block", "stone", (0.4, 0.4, 0.4), (0.0, 0.0, 0.0))
    result = simulate(scene(block, control=DynamicControl(0.01)))
    assert result.reactions == {} and "reaction" not in result.rows
