"""Dead-load equilibrium before a dynamic run: stable blocks start at rest, others are let fall, with a message."""

from dataclasses import replace

import numpy as np
import pytest

from dembrick.errors import NotConvergedError
from dembrick.runs.simulate import simulate
from dembrick.scenario.controls import BaseMotionControl, DynamicControl, Sine
from dembrick.scenario.model import Block, Solver
from dembrick.simulation.dynamics.dead_load import MOST_STEPS
from helpers.key_lines import words
from helpers.stone_scenes import law, of_stone

AT_REST = 1e-9  # m


def scene(blocks, stiffness=1e10, control=None):
    return of_stone(
        law("concave", 0.6, stiffness),
        control or DynamicControl(0.05),
        (Block("floor", "stone", (8.0, 3.0, 0.2), (0.0, 0.0, -0.1), fixed=True), *blocks),
    )


def pile(count, height):
    return [
        Block(f"pile.{i + 1}", "stone", (0.5, 0.5, height), (0.0, 0.0, (i + 0.5) * height)) for i in range(count)
    ]  # fmt: skip


def moved(result, start):
    """Greatest displacement (m) in all frames among blocks whose name begins with ``start``."""
    numbers = [i for i, name in enumerate(result.assembly.names) if name.startswith(start)]
    ways = result.frames["displacement"][:, numbers]
    return float(np.linalg.norm(ways - ways[0], axis=2).max())


def test_one_block_that_topples_leaves_the_others_at_rest():
    """A pile of five beside a ledge from which a block falls: each of its joints carries the weight above it."""
    ledge = Block("ledge", "stone", (0.5, 0.5, 0.5), (2.0, 0.0, 0.25))
    loose = Block("loose", "stone", (0.5, 0.5, 0.1), (2.28, 0.0, 0.55))
    result = simulate(scene([*pile(5, 0.2), ledge, loose]))
    assert moved(result, "pile") < AT_REST
    assert moved(result, "loose") > 1e-4
    weight = 2000.0 * 9.81 * 0.05
    names = result.assembly.names
    of_pile = [i for i, joint in enumerate(result.assembly.joints) if names[joint.block_b].startswith("pile")]
    N = result.rows["joint"][:, of_pile, 0]
    expected = np.array([5, 4, 3, 2, 1]) * weight
    np.testing.assert_allclose(np.sort(N, axis=1), np.tile(np.sort(expected), (len(N), 1)), rtol=1e-6)
    assert result.as_dict()["not_standing"] == ["loose"]
    assert "not standing loose" in words(result.text())


def test_the_settlements_of_a_tall_tower_add_up():
    """Forty blocks sink by more than a hundredth of a block height in total, and no joint comes apart."""
    result = simulate(scene(pile(40, 0.1), stiffness=1e9))
    bodies, middle = result.run.motion.state.bodies, result.run.motion.state.middle
    settled = result.assembly.position[-1, 2] - (middle + bodies.start[-1])[2]
    assert settled > 0.01 * 0.1
    assert moved(result, "pile") < AT_REST
    assert result.as_dict()["not_standing"] == []


def test_a_chip_elsewhere_does_not_matter():
    chip = Block("chip", "stone", (0.005, 0.005, 0.005), (1.0, 0.0, 0.0025))
    result = simulate(scene([*pile(10, 0.1), chip], stiffness=1e9))
    assert moved(result, "pile") < AT_REST and moved(result, "chip") < AT_REST
    assert result.as_dict()["not_standing"] == []


def test_what_lies_on_a_falling_block_falls_with_it():
    """Two blocks on a ledge, whose common centre lies beyond it, fall together; the lower one alone would stand."""
    ledge = Block("ledge", "stone", (0.5, 0.5, 0.5), (2.0, 0.0, 0.25))
    lower = Block("lower", "stone", (0.5, 0.5, 0.1), (2.2, 0.0, 0.55))
    upper = Block("upper", "stone", (0.5, 0.5, 0.1), (2.4, 0.0, 0.65))
    result = simulate(scene([*pile(2, 0.2), ledge, lower, upper]))
    assert result.as_dict()["not_standing"] == ["lower", "upper"]
    assert moved(result, "pile") < AT_REST
    alone = simulate(scene([*pile(2, 0.2), ledge, lower]))
    assert alone.as_dict()["not_standing"] == []
    assert moved(alone, "lower") < AT_REST


def test_supports_that_shake_want_all_blocks_to_stand_and_name_those_that_do_not():
    ledge = Block("ledge", "stone", (0.5, 0.5, 0.5), (2.0, 0.0, 0.25))
    loose = Block("loose", "stone", (0.5, 0.5, 0.1), (2.28, 0.0, 0.55))
    shaken = BaseMotionControl(0.05, (1.0, 0.0, 0.0), sine=Sine(0.1, 5.0))
    with pytest.raises(NotConvergedError, match="no equilibrium under the dead loads: 'loose' slide or overturn"):
        simulate(scene([*pile(2, 0.2), ledge, loose], 1e8, shaken))


def test_small_steps_are_more_of_them_until_blocks_rest():
    """With steps a six hundredth of the usual one a pile needs some hundreds of times as many, and gets them."""
    control = BaseMotionControl(duration=1e-4, direction=(1.0, 0.0, 0.0), sine=Sine(0.1, 2.0))
    given = scene(pile(2, 0.5), control=control)
    steps = []
    for factor in (0.9, 0.0015):
        result = simulate(replace(given, solver=Solver(step_factor=factor)))
        assert result.run.unbalanced <= 1e-9
        steps.append(result.run.motion.dead_load_steps)
    assert steps[1] > max(MOST_STEPS, 100 * steps[0])
