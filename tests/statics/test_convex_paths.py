"""Convex joints along a path of equilibria: the strip in contact as they rock, and their tangent stiffness."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dembrick.assembly import build
from dembrick.runs.simulate import simulate
from dembrick.scenario.controls import PushoverControl
from dembrick.scenario.model import Block
from dembrick.simulation.statics.load_system import Setup
from dembrick.simulation.statics.paths.bounds import LEFT_OUT, go_on_rocking, limit_bounds
from dembrick.simulation.statics.paths.path_following import PathFollower
from dembrick.simulation.statics.paths.path_state import PathState
from helpers.quasi_static import leaf, scene


def test_convex_joints_that_rock_are_predicted():
    """One tangent per doubling of the motion if tangent and secant of the path predict how the strip in contact
    shrinks; the forces of convex joints are smooth, so that its factors serve the remaining steps."""
    result = simulate(leaf("convex"), record=False)
    assert result.yield_point.V == pytest.approx(0.2, rel=2e-4)
    assert result.run.steps <= 22 and result.run.settings["equilibria"] <= 21


def test_estimates_that_agree_by_chance_are_no_bar():
    """Shortfalls of a pushed arch of five stones, over its limit, at its last equilibria: extrapolations of the limit
    cross there by chance, 4e-4 below it, and must not exclude it."""
    given = (1.8738e-4, 3.84499e-4, 7.794755e-4, 1.56994e-3)
    short = (0.16588780832553784, 0.11605458128964108, 0.08168108387691464, 0.05769413885956054)
    seen = [(0.0, 0.0, 0.0, 1e300, False)]
    seen += [(g, 1.0 - s, 1.0 - s, 1.0 - s, False) for g, s in zip(given, short, strict=True)]
    lower, upper, _ = limit_bounds(seen, 1e3, rocks_on=lambda V: True)
    assert lower < 1.0 < upper and upper - lower < 2e-3


@pytest.mark.parametrize("offset, shown", [(0.0, 1e-12), (0.04, 2e-4)])
def test_the_limit_of_a_rocking_joint_is_read_off_its_shrinking_strip(offset, shown):
    """V = limit - c / sqrt(theta), where the joint had already rotated by an offset before the mechanism formed."""
    limit, short = 5.0, 0.4
    seen = [(0.0, 0.0, 0.0, 1e300, False)]
    for given in (0.25, 0.5, 1.0, 2.0):
        V = limit - short / math.sqrt(given + offset)
        seen.append((given, V, V - 1e-6, V + 2e-6, False))
    lower, upper, is_limit = limit_bounds(seen, 1e3, rocks_on=lambda V: True)
    assert is_limit and lower + 1e-6 <= limit + 1e-12 and limit <= upper - 2e-6 + 1e-12
    assert lower + upper - 1e-6 == pytest.approx(2.0 * limit, rel=shown)
    assert upper - lower - 3e-6 <= max(30.0 * limit * shown, 2.0 * LEFT_OUT * (limit - V) ** 2 / limit)


def test_a_limit_seen_with_its_first_correction_is_exact():
    """Exact for V = limit - c / sqrt(g) - d / g^(3/2) with unknown limit, c and d, at any spacing."""
    given = (0.25, 0.6, 1.1, 2.4)
    seen = [(g, V, V, V, False) for g, V in ((g, 5.0 - 0.4 / g**0.5 - 0.01 / g**1.5) for g in given)]
    lower, upper, _ = limit_bounds([(0.0, 0.0, 0.0, 1e300, False), *seen], 1e3, rocks_on=lambda V: True)
    assert 0.5 * (lower + upper) == pytest.approx(5.0, rel=1e-13) and upper - lower < 0.05


@pytest.mark.parametrize("start, now, ahead", [(1.0, 2.0, 4.0), (1.5, 2.0, 2.1), (0.5, 2.0, 20.0)])
def test_a_strip_that_shrinks_with_the_root_of_the_motion_is_met(start, now, ahead):
    mechanism, closing, limit, short = np.array([2.0, -1.0]), np.array([0.3, 0.7]), 5.0, 0.4

    def motion(given):
        return mechanism * given + closing * math.sqrt(given)

    way = PathState(motion(now), closing, closing)
    way.seen = [(given, limit - short / math.sqrt(given), 0.0, 1.0, False) for given in (start, now)]
    way.V, way.step = way.seen[-1][1], ahead - now
    secant = (motion(now) - motion(start)) / (now - start)
    go_on_rocking(way, mechanism + 0.5 * closing / math.sqrt(now), secant, 0.1)
    assert way.motion + way.step * way.direction == pytest.approx(motion(ahead), rel=1e-12)
    assert way.V + way.step * way.gain == pytest.approx(limit - short / math.sqrt(ahead), rel=1e-12)
    assert way.has_spare and np.array_equal(way.spare, secant) and way.spare_gain == 0.1


STACKED = {  # motion of the upper block (m, rad) beyond that of its weight, friction; keys: state of its joint
    "closed": ((2e-8, -1e-8, -1e-7, 2e-7, 3e-7, 1e-7), 0.6),
    "partly open": ((2e-8, -1e-8, -1e-7, 6e-6, -4e-6, 1e-7), 0.6),
    "sliding": ((3e-6, 2e-6, -2e-7, 3e-7, 2e-7, 2e-5), 0.3),
    "sliding and partly open": ((3e-6, -2e-6, -2e-7, 6e-6, 5e-6, 3e-5), 0.3),
    "sliding without friction": ((3e-6, 2e-6, -2e-7, 6e-6, 2e-7, 2e-5), 0.0),
    "open": ((0.0, 0.0, 1e-4, 1e-6, 0.0, 0.0), 0.6),
}


@pytest.mark.parametrize("state", STACKED)
def test_the_tangent_of_a_convex_joint_is_that_of_its_forces(state):
    """The tangent against central differences of the forces on a block."""
    motion, friction = STACKED[state]
    blocks = (
        Block("table", "stone", (0.3, 0.2, 0.1), (0.0, 0.0, -0.05), fixed=True),
        Block("lower", "stone", (0.3, 0.2, 0.4), (0.0, 0.0, 0.2)),
        Block("upper", "stone", (0.2, 0.3, 0.4), (0.02, -0.01, 0.6)),
    )
    given = scene(PushoverControl((1.0, 0.0, 0.0)), "convex", friction=max(friction, 1e-3), blocks=blocks)
    setup = Setup(build.assemble(given), 1e-3)
    follower = PathFollower(setup.state, setup.load, setup.factor, setup.certificate)
    follower.prepare()
    setup.state.areas.friction[:] = friction
    search, own = follower.search, follower.search.rows[1]
    start = search.motion()
    start[own] += motion

    def forces(change):
        moved = start.copy()
        moved[own] += change
        search.attempt(moved, 0.0)
        return search.trial.residual[own].copy()

    forces(np.zeros(6))
    search.differentiate(0.0)
    from_b = search.trial.seen_b[1]
    found = from_b.T @ search.trial.tangent[1] @ from_b
    step = 1e-10
    expected = -np.transpose([(forces(step * e) - forces(-step * e)) / (2.0 * step) for e in np.eye(6)])
    assert found == pytest.approx(expected, abs=2e-5 * setup.state.areas.k_n[1] * setup.state.areas.area[1] * 0.1)
    assert (np.abs(expected).max() == 0.0) == (state == "open")


@pytest.mark.slow
def test_convex_joints_lose_the_strip_that_they_press():
    """At a given rotation V falls short by w/3 of the half thickness, w = sqrt(2 N/(kn L theta)), unlike its limit."""
    lost = []
    for stiffness in (2.5e9, 1e10, 4e10):
        result = simulate(leaf("convex", stiffness=stiffness))
        assert result.yield_point.V == pytest.approx(0.2, rel=1e-3)
        # the mean displacement of a wall that rotates about its toe: theta H / 2
        assert result.displacement[-1] > 0.005
        short = np.interp(0.005, result.displacement, 0.2 - result.load)
        lost.append(short)
        theta, pressed = 0.01, 2000.0 * 3.0 * 0.2 * 1.0 * 9.81
        width = math.sqrt(2.0 * pressed / (stiffness * 3.0 * theta))
        assert short == pytest.approx(2.0 * width / 3.0, rel=0.15)
    assert lost[1] < 0.04 * 0.2
    assert np.array(lost[:-1]) / np.array(lost[1:]) == pytest.approx(2.0, rel=0.1)
