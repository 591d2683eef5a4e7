"""At rest nothing moves, unconnected blocks are not disturbed, and friction opposes slip."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from dembrick.assembly import build
from dembrick.kernels.statics.loop import RUNNING
from dembrick.scenario.blocks import Prism
from dembrick.scenario.model import Actuator, Block, DisplacementControl, Load
from dembrick.simulation.statics import constant_rate, load_system, ties
from dembrick.simulation.statics.guards import new_guard
from dembrick.simulation.statics.state import State, initial_state
from helpers.places import tool_module
from helpers.stone_scenes import law, of_stone


@pytest.mark.parametrize("kind", ["middle", "eccentric"])
@pytest.mark.parametrize("formulation", ["concave", "corrected-shear", "convex"])
def test_no_creep_below_the_limit(formulation, kind):
    """Nothing moves at 0.98 of the limit load for a hundred thousand steps; ``stress.py --long`` runs ten million."""
    scene = tool_module("stress_scenes").rest_scene(formulation, kind)
    outcome = tool_module("stress_judge").rest(scene, 100_000)
    assert outcome.status == "right" and outcome.error < 1e-12, outcome


# --- beside a test

ASIDE = 0.6  # m


def two_pairs(formulation):
    """A pair pushed over its limit with another under a third of it, ASIDE of the first; and the other pair alone."""
    scenes = tool_module("stress_scenes")
    pushed = scenes.pair(formulation, scenes.jack(0.075))
    limit = scenes.by_judge(build.assemble(pushed))
    blocks = tuple(
        dataclasses.replace(b, name=f"other {b.name}", position=(b.position[0] + ASIDE, *b.position[1:]))
        for b in pushed.blocks
    )
    loads = (
        Load("other upper", (0.0, 0.0, -scenes.N), (ASIDE, 0.0, scenes.H / 2)),
        Load("other upper", (0.0, limit / 3.0, 0.0), (ASIDE + 0.075, 0.0, 0.0)),
    )
    both = dataclasses.replace(pushed, blocks=pushed.blocks + blocks, loads=pushed.loads + loads)
    return both, dataclasses.replace(pushed, blocks=blocks, loads=loads, actuators=())


def part_of(state: State, alone: State) -> State:
    """Copy the state of the second pair from the state of both into the arrays of the pair ``alone``."""
    for name in ("blocks", "joints", "points", "areas"):
        whole, own = getattr(state, name), getattr(alone, name)
        if whole is None:
            continue
        for field, value in own._asdict().items():
            if isinstance(value, np.ndarray) and value.dtype.kind == "f":
                value[...] = getattr(whole, field)[-len(value) :]
    return alone


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_a_block_beside_a_test_moves_as_it_does_alone(formulation):
    """Unconnected joints share no arithmetic: at the same time step results are equal bit for bit."""
    together, apart = two_pairs(formulation)
    judge = tool_module("stress_judge")
    setup = load_system.Setup(build.assemble(together), tolerance=0.0)
    built = build.assemble(apart)
    alone = part_of(setup.state, initial_state(built))
    loop = judge.at_rest(setup, 1e-4)
    alone = part_of(loop.state, alone)
    inertia = constant_rate.physical_inertia(built)
    moving = ties.start_moving(alone, built)
    guard = new_guard(built, alone)._replace(mask=1 << 62)  # one that never checks: nothing drives this pair
    other = dataclasses.replace(loop, state=alone, inertia=inertia, guard=guard, ties=moving)
    for one in (loop, other):
        assert one.advance(20_000) == RUNNING
    names = setup.assembly.names
    assert loop.state.blocks.displacement[names.index("upper"), 1] > 5e-6
    for field in ("displacement", "orientation", "velocity", "spin", "momentum", "force", "torque"):
        mine, its = (getattr(one.state.blocks, field)[-1] for one in (loop, other))
        assert mine.tobytes() == its.tobytes(), field
    assert loop.state.joints.resultant[-1].tobytes() == alone.joints.resultant[-1].tobytes()


# --- friction against slip


def pushed_polygon(seed: int):
    """A prism of 3 to 7 random corners on a wide block, pushed at a random point in a random direction."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(3, 8))
    while True:
        angles = np.sort(rng.uniform(0.0, 2.0 * np.pi, count))
        if np.diff(np.append(angles, angles[0] + 2.0 * np.pi)).max() < 2.8:
            break
    corners = rng.uniform(0.05, 0.15) * np.stack([np.cos(angles), rng.uniform(0.5, 1.0) * np.sin(angles)], axis=1)
    direction = rng.uniform(0.0, 2.0 * np.pi)
    point = corners.T @ rng.dirichlet(np.ones(count))
    formulation = ("concave", "corrected", "corrected-shear")[seed % 3]
    scenario = of_stone(
        law(formulation, float(rng.uniform(0.2, 1.0))),
        DisplacementControl(1e-4, 1e-6),
        (
            Block("base", "stone", (0.6, 0.6, 0.1), (0.0, 0.0, -0.05), fixed=True),
            Block("upper", "stone", prism=Prism(tuple(map(tuple, corners)), 0.04), position=(0.0, 0.0, 0.02)),
        ),
        actuators=(Actuator("jack", "upper", (*point, 0.0), (np.cos(direction), np.sin(direction), 0.0)),),
    )
    return build.assemble(scenario)


@pytest.mark.parametrize("seed", range(12))
def test_friction_is_opposite_to_slip(seed):
    """Every plastic increment above 1e-12 m of every corner is parallel to the shear force on the lower block, whose
    size is mu N there: friction opposes slip. The forces are those that the joint passes on to its blocks."""
    built = pushed_polygon(seed)
    setup = load_system.Setup(built, tolerance=0.0)
    loop = tool_module("stress_judge").at_rest(setup, 1e-4)
    points, joints, mu = loop.state.points, loop.state.joints, loop.state.points.friction[0]
    viscous = joints.damping[0]
    seen = 0
    for _ in range(1500):
        before = np.stack([points.elastic_1, points.elastic_2], axis=1)
        assert loop.advance(1) == RUNNING
        after = np.stack([points.elastic_1, points.elastic_2], axis=1)
        p1, p2, turn = joints.step[0]
        slip = np.stack([p1 - turn * points.y_s, p2 + turn * points.x_s], axis=1)
        k = points.k_s[:, None]
        plastic = slip - (after - before) / k
        force = after + viscous * (after - before)  # spring and dashpot, both behind the slider
        arm = np.stack([points.x_s, points.y_s], axis=1)
        resultant = [*force.sum(axis=0), (arm[:, 0] * force[:, 1] - arm[:, 1] * force[:, 0]).sum()]
        np.testing.assert_allclose(
            joints.resultant[0, 1:4], resultant, rtol=1e-9, atol=1e-11 * mu * points.normal.sum()
        )
        size, length = np.linalg.norm(force, axis=1), np.linalg.norm(plastic, axis=1)
        slides = (length > 1e-12) & (points.normal > 0.0)
        seen += int(slides.sum())
        across = plastic[:, 0] * force[:, 1] - plastic[:, 1] * force[:, 0]
        along = (plastic * force).sum(axis=1)
        assert np.all(np.arctan2(np.abs(across), along)[slides] < 1e-9)
        np.testing.assert_allclose(size[slides], mu * points.normal[slides], rtol=1e-9)
    assert seen > 500
