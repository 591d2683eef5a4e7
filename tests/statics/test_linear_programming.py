"""Load factors of assemblies in space against limit analysis by linear programming (static theorem).

With associative (dilatant) sliding, any forces in equilibrium within Coulomb's cones bound the load factor from below,
so the greatest such factor is never less than that of blocks that slide without dilatancy; if blocks only rock, both
agree.
"""

from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.sparse import coo_array

from dembrick.assembly import build
from dembrick.errors import NotConvergedError
from dembrick.runs.outcomes.error_estimate import refinements
from dembrick.runs.simulate import simulate
from dembrick.scenario.controls import PushoverControl
from dembrick.scenario.generators import Arch, Stack, Wall
from dembrick.scenario.generators.walls import Return
from dembrick.scenario.model import JointLaw, Scenario
from helpers.key_lines import key_lines
from helpers.stone_scenes import of_stone

FACETS = 64  # of a cone; they circumscribe it, so that the programme allows 0.12 % more friction


def scene(direction, friction=0.7, stiffness=(1e10, 4e9), **parts) -> Scenario:
    return of_stone(JointLaw("concave", friction, *stiffness), PushoverControl(direction), **parts)


def wall(block, courses, blocks, heading=0.0, returns=()):
    return {"walls": (Wall("wall", "stone", block, courses, blocks, base=0.2, heading=heading, returns=returns),)}


def stack(blocks, height):
    return Stack("pile", "stone", blocks, (0.3, 0.25, height), base=0.2)


def rigid_load_factor(scenario: Scenario) -> float:
    """Greatest share of the weights along the direction that forces at the corners of the joints can balance."""
    built = build.assemble(scenario)
    push = np.array(scenario.control.direction) / np.linalg.norm(scenario.control.direction)
    row = np.where(built.fixed, -1, 6 * (np.cumsum(~built.fixed) - 1))
    entries, number = [], 0
    for joint in built.joints:
        for corner in joint.polygon:
            place = joint.origin + corner @ joint.axes[:2]
            for force in (joint.axes[2], joint.axes[0], joint.axes[1]):
                for block, sign in ((joint.block_b, 1.0), (joint.block_a, -1.0)):
                    wrench = sign * np.append(force, np.cross(place - built.position[block], force))
                    if row[block] >= 0:
                        entries += [(row[block] + i, number, value) for i, value in enumerate(wrench)]
                number += 1
    dead = np.zeros(6 * (~built.fixed).sum())
    for block in np.flatnonzero(~built.fixed):
        weight = built.mass[block] * 9.81
        dead[row[block] + 2] = weight
        entries += [(row[block] + i, number, weight * push[i]) for i in range(3)]
    rows, columns, values = map(np.array, zip(*entries, strict=True))
    equations = coo_array((values, (rows, columns)), shape=(len(dead), number + 1))

    angle = 2.0 * np.pi * np.arange(FACETS) / FACETS
    cone = np.stack([np.full(FACETS, -scenario.joint.friction), np.cos(angle), np.sin(angle)], axis=1)
    rows = np.repeat(np.arange(FACETS * number // 3), 3)
    columns = (3 * np.arange(number // 3)[:, None, None] + np.arange(3) + np.zeros((FACETS, 1), int)).ravel()
    cones = coo_array((np.tile(cone.ravel(), number // 3), (rows, columns)), shape=(len(rows) // 3, number + 1))

    worth = np.zeros(number + 1)
    worth[-1] = -1.0
    bounds = [(0, None), (None, None), (None, None)] * (number // 3) + [(0, None)]
    found = linprog(worth, cones, np.zeros(len(rows) // 3), equations, dead, bounds, method="highs")
    assert found.status == 0, found.message
    return float(found.x[-1])


ROCKING = {
    "stack across a corner": scene((0.6, 0.4, 0.0), 1.0, stacks=(stack(3, 0.2),)),
    "stack, pushed up too": scene((0.6, 0.4, 0.2), 1.0, stacks=(stack(2, 0.4),)),
    "arch, askew": scene((0.9, 0.5, 0.0), 3.0, arches=(Arch("arch", "stone", 1.5, 0.3, 0.5, 9, heading=40.0),)),
    "arch, nearly along": scene((0.8, -0.6, 0.0), 1.0, arches=(Arch("arch", "stone", 2.0, 0.3, 0.5, 10),)),
    "wall, out of its plane": scene((-0.06, 1.0, 0.0), 0.64, **wall((0.3, 0.15, 0.1), 4, 4)),
}


@pytest.mark.parametrize("scenario", ROCKING.values(), ids=ROCKING)
def test_blocks_that_only_rock_meet_the_programme(scenario):
    found = simulate(scenario, record=False).collapse
    assert found["mechanism"] == "rocking"
    assert found["load_factor"] == pytest.approx(rigid_load_factor(scenario), rel=1e-3)


@pytest.mark.parametrize(
    ("radius", "thickness", "stones", "angle"),
    [(1.64, 0.37, 11, 119.0), (3.04, 0.8, 10, 122.0), (4.33, 1.19, 11, 123.0), (2.03, 0.52, 20, 120.0)],
)
def test_stiff_convex_arches_meet_the_programme(radius, thickness, stones, angle):
    """A direction that is off by rounding must not grow from equilibrium to equilibrium: these paths once turned back
    at half of their limit."""
    arch = Arch("arch", "stone", radius, thickness, 0.3, stones, angle=angle)
    joint = JointLaw("convex", 1.5, 1e11, 4e10)
    scenario = of_stone(joint, PushoverControl((1.0, 0.0, 0.0)), arches=(arch,))
    point, expected = simulate(scenario, record=False).yield_point, rigid_load_factor(scenario)
    assert point.V_lower <= expected * (1.0 + 1e-6) and expected <= point.V_upper * (1.0 + 1e-5)
    assert point.V == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("seed", range(12))
def test_no_wall_carries_more_than_the_programme(seed):
    rng = np.random.default_rng(seed)
    block = rng.uniform((0.2, 0.1, 0.08), (0.5, 0.3, 0.25))
    angle = rng.uniform(0.0, 2.0 * np.pi)
    parts = wall(tuple(block), int(rng.integers(2, 5)), int(rng.integers(2, 5)), float(rng.choice([0.0, 30.0])))
    scenario = scene((np.cos(angle), np.sin(angle), 0.0), float(rng.choice([0.3, 0.64, 1.0])), **parts)
    bound = rigid_load_factor(scenario)
    found = simulate(scenario, record=False).collapse["load_factor"]
    assert 0.4 * bound < found <= bound * (1.0 + 1e-3)


SLIDING = {
    "along, soft in shear": scene((-1.0, 0.13, 0.0), 0.3, (1e11, 4e9), **wall((0.27, 0.29, 0.19), 5, 4)),
    "along, turned": scene((-1.0, 0.03, 0.0), 0.64, (1e11, 4e9), **wall((0.25, 0.29, 0.13), 5, 4, 30.0)),
    "a corner, pushed up too": scene(
        (-0.56, -0.83, 0.2), 0.3, (1e11, 4e9), **wall((0.4, 0.2, 0.2), 4, 5, 0.0, (Return("right", "front", 3),))
    ),
    "a corner, stiff in shear": scene(
        (-0.93, 0.37, 0.0), 0.3, (1e10, 4e10), **wall((0.34, 0.17, 0.086), 6, 5, 30.0, (Return("left", "back", 2),))
    ),
}


@pytest.mark.parametrize("scenario", SLIDING.values(), ids=SLIDING)
def test_a_wall_slides_as_a_whole_at_the_friction_of_its_bed(scenario):
    """V c = mu (1 - V s) for a push at an angle of sine s upwards; many head joints are about to close."""
    push = np.array(scenario.control.direction)
    along, up = np.hypot(*push[:2]) / np.linalg.norm(push), push[2] / np.linalg.norm(push)
    found = simulate(scenario, record=False)
    mu = scenario.joint.friction
    assert found.collapse["mechanism"] == "sliding"
    assert found.collapse["load_factor"] == pytest.approx(mu / (along + mu * up), rel=1e-4)
    assert found.yield_point.V_lower <= mu / (along + mu * up) * (1.0 + 1e-6) <= found.yield_point.V_upper * (1 + 1e-5)


def test_a_peak_on_the_way_is_told_from_what_the_mechanism_carries():
    """Rough joints lock in forces: the height of the peak depends on the stiffness, the load after it does not."""
    parts = wall((0.31, 0.17, 0.21), 5, 3)
    found = [
        simulate(scene((1.0, 0.07, 0.0), 3.0, stiffness, **parts), record=False)
        for stiffness in ((1e11, 4e9), (1e10, 4e9), (1e10, 4e10))
    ]
    peaks, after = ([one.collapse[name] for one in found] for name in ("load_factor", "mechanism_load_factor"))
    assert max(peaks) > 1.01 * min(peaks)
    assert max(after) < 1.0001 * min(after)
    assert "after a peak" in key_lines(found[0])


def test_refining_shows_what_the_path_leaves_open():
    """A wall whose end overturns along rough head joints: the load path decides how much those still carry."""
    scenario = scene((0.114, 0.993, 0.0), 3.0, **wall((0.24, 0.11, 0.24), 2, 5, 77.0))
    fallen = simulate(scenario, refine=True).collapse
    assert fallen["mechanism"] == "rocking"
    found = []
    for one, *_ in refinements(scenario):
        with suppress(NotConvergedError):  # such a path is counted, but not part of the range
            found.append(simulate(one, record=False).collapse["load_factor"])
    assert fallen["error_estimate"] > 0.01 * fallen["load_factor"]
    low, high = fallen["path_range"]
    assert low <= min(found) < max(found) <= high
    assert fallen["error_estimate"] >= max(abs(factor - fallen["load_factor"]) for factor in (low, *found, high))
    pushed = PushoverControl(scenario.control.direction, displacement=3e-4, quasi_static=False, rate=3e-4)
    slow = simulate(replace(scenario, control=pushed), record=False).collapse["load_factor"]
    assert abs(slow - fallen["load_factor"]) < fallen["error_estimate"]
