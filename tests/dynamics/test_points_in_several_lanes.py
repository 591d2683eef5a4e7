"""Joints of a small scene have several lanes of a tile for their points: all results are those of one lane each."""

import numpy as np
import pytest

from dembrick.runs.simulate import simulate
from dembrick.scenario.controls import DynamicControl
from dembrick.scenario.model import Block, Output
from dembrick.simulation.dynamics import memory_order
from dembrick.simulation.dynamics.memory_order import fastest_width, own_lanes, tiled
from helpers.custom_laws import COULOMB
from helpers.stone_scenes import law, of_stone

BONDED = {"cohesion": 4e3, "tensile_strength": 2e3, "residual_friction": 0.2}


def spinning(of_joints, custom, more):
    """Two blocks on a floor; the upper one slides and spins beyond the edge of the lower one, which slides too."""
    floor = Block("floor", "stone", (2.0, 1.0, 0.1), (0.0, 0.0, -0.05), fixed=True)
    lower = Block("lower", "stone", (0.3, 0.24, 0.04), (0.0, 0.0, 0.02), velocity=(0.0, 0.2, 0.0))
    upper = Block(
        "upper", "stone", (0.28, 0.24, 0.04), (0.0, 0.0, 0.06), velocity=(0.4, 0.2, 0.0),
        angular_velocity=(0.0, 0.0, 2.0),
    )  # fmt: skip
    scenario = of_stone(
        law("distributed", 0.3, 1e9, **of_joints), DynamicControl(0.1), (floor, lower, upper),
        output=Output(("joints", "energy", "frames", *more), rows=10, frames=4),
    )  # fmt: skip
    return simulate(scenario, law=custom)


@pytest.mark.parametrize(
    "of_joints, custom, more",
    [({"points": (9, 7)}, None, ("contacts",)), (BONDED, None, ()), ({"points": (5, 5)}, COULOMB, ())],
    ids=["dry", "bonded", "custom"],
)
def test_lanes_do_not_change_the_motion(monkeypatch, of_joints, custom, more):
    found = spinning(of_joints, custom, more)
    corners = found.run.motion.state.corners
    assert (corners.width > 1).all() and len(np.unique(corners.where())) == len(corners.x)
    monkeypatch.setattr(memory_order, "SPREAD_ROWS", 10**6)
    expected = spinning(of_joints, custom, more)
    assert (expected.run.motion.state.corners.width == 1).all()
    for name in ("displacement", "orientation", *(["contact_force"] if more else [])):
        assert np.ptp(expected.frames[name]) > 0.0
        size = np.abs(expected.frames[name]).max()
        np.testing.assert_allclose(found.frames[name], expected.frames[name], rtol=0.0, atol=1e-8 * size)
    for name in expected.rows["energy"]:
        energy = expected.rows["energy"][name]
        np.testing.assert_allclose(found.rows["energy"][name], energy, rtol=1e-6, atol=1e-9)
    assert expected.rows["energy"]["friction"][-1] > 0.1 and expected.rows["energy"]["released"][-1] > 0.0
    np.testing.assert_allclose(corners.slip, expected.run.motion.state.corners.slip, rtol=1e-8)
    assert found.energy.relative_residual < 1e-5


def test_widths_that_cost_least():
    """A joint alone has the whole tile if its points are many; a full tile has one lane for each."""
    assert fastest_width(1, 4) == 1 and fastest_width(1, 240) == 16 and fastest_width(15, 240) == 1
    kind, points = np.zeros(35, np.int64), np.full(35, 240)
    lane, used, width = tiled(kind, kind, np.arange(35), points)
    assert width.tolist() == [1] * 32 + [4] * 3 and used.tolist() == [16, 16, 12]
    assert sorted(lane[own_lanes(lane)]) == list(range(35))
