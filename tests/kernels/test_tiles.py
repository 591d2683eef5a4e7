"""Joints and blocks computed side by side: no result depends on the neighbours in a tile."""

import math
from itertools import pairwise

import numpy as np
import pytest

from dembrick.assembly import build
from dembrick.geometry.rotations import frame_quaternion, rotation_matrix, unit_quaternion
from dembrick.kernels.dynamics.rigid_bodies import fetch_block, turn_block, turn_body, turn_slowly
from dembrick.kernels.dynamics.tiles import FIXED, WORK, W, rows_of_lanes
from dembrick.scenario.controls import DynamicControl
from dembrick.scenario.model import Block
from dembrick.simulation.dynamics.integrator import joint_forces, motion
from dembrick.simulation.dynamics.loads import Driving
from dembrick.simulation.dynamics.memory_order import tiled, without_rounding
from dembrick.simulation.dynamics.state import contact_forces, joint_resultants, with_contact_forces
from helpers import rows
from helpers.resting_blocks import GRAVITY, about, place
from helpers.stone_scenes import law, of_stone
from helpers.walls import wall

LAWS = {  # nine points, an odd number
    "concave": {},
    "corrected-shear": {},
    "convex": {},
    "distributed": {"points": (3, 3)},
}


def drawn(n, formulation):
    """``n`` blocks on as many floors, in their original positions."""
    built = build.assemble(
        of_stone(
            law(formulation, 0.3, **LAWS[formulation]),
            DynamicControl(duration=1.0),
            (
                Block(f"{kind}{i}", "stone", (0.3, 0.2, 0.1), (float(i), 0.0, z), fixed=z < 0.0)
                for i in range(n)
                for kind, z in (("floor", -0.05), ("block", 0.05))
            ),
        )
    )
    return motion(built, 0.1, 0.3)


def pairs(n, formulation):
    """The blocks in equilibrium on their floors, ready to record the forces at their points."""
    moving, driving = drawn(n, formulation), Driving(GRAVITY)
    moving.state.bodies.position[1::2, 2] -= 2000.0 * 9.81 * 0.1 / 1e10
    moving.state = with_contact_forces(moving.state)
    joint_forces(moving, driving)
    return moving, driving


def shake(moving, driving, numbers):
    """Move and rotate each block by an amount that depends on its number: some slip, some open, some lift off; twice,
    so that dashpots act and the energy terms cover a step."""
    moving.energy.open(moving.state)
    for _ in range(2):
        for k, i in enumerate(numbers):
            shift = (1e-8 * i, -3e-9 * i, 2e-8 * (i % 5 - 2) ** 3)
            place(moving, shift, about((0.6, 0.0, 0.8), 3e-7 * (i % 7)), 2 * k + 1)
        joint_forces(moving, driving)


@pytest.mark.parametrize("formulation", LAWS)
def test_a_joint_carries_what_it_would_carry_alone(formulation):
    """Twenty joints fill one tile and a part of another; each has the forces that it has alone."""
    n = W + 4
    moving, driving = pairs(n, formulation)
    shake(moving, driving, range(n))
    found, forces = joint_resultants(moving.state), contact_forces(moving.state, np.ones(n))
    per = len(forces) // n
    energies = rows.energies(moving)
    sums = dict.fromkeys(("elastic", "friction", "dashpots", "released"), 0.0)
    alone, driving_alone = pairs(1, formulation)
    kept = [*alone.state.arrays, *alone.energy.table]
    at_rest = [array.copy() for array in kept]  # the same for all, and computed once
    for i in range(n):
        for array, value in zip(kept, at_rest, strict=True):
            array[...] = value
        viscous = moving.state.links.viscous[[i]]  # the bound of the time step has rounding of its own
        alone.state.links.put("viscous", viscous)
        shake(alone, driving_alone, [i])
        np.testing.assert_allclose(found[i], joint_resultants(alone.state)[0], rtol=1e-6, atol=1e-5)
        np.testing.assert_allclose(
            forces[i * per : (i + 1) * per], contact_forces(alone.state, np.ones(1)), rtol=1e-5, atol=1e-4
        )
        own = rows.energies(alone)
        sums = {name: value + own[name] for name, value in sums.items()}
    assert (found[:, 0] == 0.0).any() and found[:, 0].max() > 200.0 and np.ptp(found[:, 1]) > 10.0
    for name, value in sums.items():
        assert energies[name] == pytest.approx(value, rel=1e-5), name
        assert abs(value) > 1e-12, name


def test_every_joint_has_one_lane_among_its_kind():
    rng = np.random.default_rng(0)
    kind, way = rng.integers(0, 3, 100), rng.integers(0, 2, 100)
    turn = rng.permutation(100)
    lane, used, _ = tiled(kind, way, turn)
    own = lane[np.arange(W) < used[:, None]]
    assert sorted(own) == list(range(100))
    for members, count in zip(lane, used, strict=True):
        assert len(set(kind[members])) == 1
        assert (members[count:] == members[count - 1]).all()
    assert len(lane) == sum(math.ceil((kind == k).sum() / W) for k in range(3))
    order = [way[members[:count]] for members, count in zip(lane, used, strict=True)]
    for k in range(3):  # one direction after the other
        of_kind = np.concatenate([ways for ways, members in zip(order, lane, strict=True) if kind[members[0]] == k])
        assert (np.diff(of_kind) >= 0).all()


def test_what_stands_in_tiles_is_read_as_a_copy_that_refuses_to_be_written():
    moving = drawn(3, "concave")
    links, corners = moving.state.links, moving.state.corners
    with pytest.raises(ValueError, match="read-only"):
        links.offset[1] = 0.0
    with pytest.raises(ValueError, match="read-only"):
        corners.area[2] = 0.0
    before = links.offset
    links.put("offset", 0.5, 1)
    np.testing.assert_array_equal(links.offset, [before[0], 0.5, before[2]])
    assert corners.where().shape == corners.x.shape and len(np.unique(corners.where())) == 12


def test_tiles_of_a_regular_wall_share_what_no_step_changes():
    """Until the data of one joint change: then those of no other joint do."""
    moving = motion(wall("concave", courses=20, blocks=20), 0.1, 0.5)
    links, corners = moving.state.links, moving.state.corners
    points = [corners.points[a:b] for a, b in pairwise(corners.tile_start.tolist())]

    def read():
        """Data that the loop reads of every tile."""
        return links.tiles[links.like].copy(), [points[t].copy() for t in corners.like]

    assert len(np.unique(links.like)) < 0.6 * len(links.like) and len(np.unique(corners.like)) < 0.3 * len(links.like)
    assert (read()[0] == links.tiles).all()
    for j in (int(corners.joint[corners.lane[np.bincount(corners.like).argmax(), 3]]), 200, 200, 7):
        links_before, points_before = read()
        where, p = int(links.place[j]), int(np.flatnonzero(corners.joint == j)[0])
        links.put("lever", links.lever[j] + 0.01, j)
        corners.put("area", 0.5 * corners.field("area", p), p)
        now, points_now = read()
        assert np.flatnonzero(now != links_before).tolist() == [where // W]
        for name in FIXED.names or ():
            changed = np.argwhere(now[name] != links_before[name])
            assert changed.tolist() == ([[where // W, i, where % W] for i in range(3)] if name == "lever" else [])
        changed = [(a["area"] != b["area"]).sum() for a, b in zip(points_before, points_now, strict=True)]
        assert np.flatnonzero(changed).tolist() == [where // W] and max(changed) == 4
    links.share(), corners.share()
    assert (read()[0] == now).all()


def test_numbers_that_differ_by_rounding_are_the_same():
    rng = np.random.default_rng(4)
    exact = rng.choice([0.3, 1e-9, -2e7, 0.0], (50, 3))
    found = without_rounding(exact * (1.0 + 3e-16 * rng.integers(-2, 3, exact.shape)))
    np.testing.assert_allclose(found, exact, rtol=1e-15)
    assert len(np.unique(found)) == 4
    lengths = exact[:, 0] * 1e-7 + 1e-15 * rng.standard_normal(50)
    assert len(np.unique(without_rounding(lengths, lengths=True))) == len(np.unique(exact[:, 0])) - 1
    np.testing.assert_array_equal(without_rounding(np.array([1.0, 1.0 + 1e-9, -0.0])), [1.0, 1.0 + 1e-9, 0.0])


def test_tiles_begin_with_a_line_of_the_cache():
    for size in (1, 16, 1000):
        assert rows_of_lanes(size).ctypes.data % 64 == 0 and len(rows_of_lanes(size)) == size


def test_quaternion_of_a_frame():
    rng = np.random.default_rng(1)
    turns = [*rng.standard_normal((50, 4)), *np.eye(4), [1e-9, 1.0, 1e-9, 0.0]]
    for q in turns:
        R = rotation_matrix(unit_quaternion(q))
        np.testing.assert_allclose(rotation_matrix(frame_quaternion(R[:, :2].T)), R, rtol=0.0, atol=1e-15)


def test_blocks_turn_side_by_side_as_they_do_alone():
    """Slow blocks by the series, and a fast one by the general step, rotate as each does alone."""
    dt = 1e-4
    one, other = drawn(4, "concave"), drawn(4, "concave")
    rng = np.random.default_rng(2)
    for moving in (one, other):
        bodies = moving.state.bodies
        bodies.orientation[:] = unit_quaternion(np.random.default_rng(3).standard_normal((8, 4)))
        bodies.rotation[:] = rotation_matrix(bodies.orientation)
    spin = rng.standard_normal((8, 3)) * 0.3
    spin[5] = 40.0
    for moving in (one, other):
        moving.state.bodies.momentum[:] = np.linalg.solve(moving.state.bodies.inverse, spin[..., None])[..., 0]
    work, bodies = rows_of_lanes(1, WORK)[0], one.state.bodies
    for b in range(8):
        fetch_block(bodies, b, work, b)
    turn_slowly(work, dt)
    assert (work.angle2[:8] > 1e-8).sum() == 1
    for b in range(8):
        turn_block(bodies, b, work, b, dt)
        turn_body(other.state.bodies, b, dt)
    np.testing.assert_allclose(bodies.orientation, other.state.bodies.orientation, rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(bodies.spin, other.state.bodies.spin, rtol=1e-13)
