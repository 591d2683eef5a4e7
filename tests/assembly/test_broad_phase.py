"""Broad phase: pairs that may touch, and the depth of overlap of two bodies."""

import numpy as np
import pytest

from dembrick.assembly import broad_phase
from dembrick.geometry.rotations import quaternion_product, rotation_matrix
from dembrick.geometry.shapes import box
from helpers.lone_joints import LAB, UNTURNED, joints_of


def scattered(rng, n):
    """Boxes of very different sizes and random orientations, some of them crowded."""
    edges = rng.uniform(0.05, 0.4, (n, 3)) * np.where(rng.uniform(size=n) < 0.05, 10.0, 1.0)[:, None]
    shapes = [box(e) for e in edges]
    position = rng.uniform(-1.5, 1.5, (n, 3))
    rotation = rotation_matrix(rng.normal(size=(n, 4)))
    return broad_phase.bodies_of(shapes, position, rotation), shapes


@pytest.mark.parametrize("seed", range(4))
def test_the_search_finds_the_pairs_that_trying_all_pairs_finds(seed):
    bodies, shapes = scattered(np.random.default_rng(seed), 120)
    margin = 0.01 * bodies.table.diameter
    found = broad_phase.close_pairs(bodies, 0.01)
    world = [s.vertices @ r.T + p for s, p, r in zip(shapes, bodies.position, bodies.rotation, strict=True)]
    low = np.array([w.min(axis=0) for w in world]) - margin[:, None]
    high = np.array([w.max(axis=0) for w in world]) + margin[:, None]
    plain = [
        (i, j) for i in range(120) for j in range(i + 1, 120) if (low[i] <= high[j]).all() and (low[j] <= high[i]).all()
    ]
    assert [tuple(pair) for pair in found] == plain


def test_the_search_holds_a_pebble_and_a_kilometre():
    sizes = [(1e-3, 1e-3, 1e-3)] * 3 + [(5e6, 5e6, 5e6)]
    where = [(0, 0, 0.5e-3), (1e-3, 0, 0.5e-3), (3e-3, 0, 0.5e-3), (0, 0, -2.5e6)]
    found = joints_of(*[(e, p, UNTURNED) for e, p in zip(sizes, where, strict=True)], fixed=[3])
    assert {(joint.block_a, joint.block_b) for joint in found} == {(0, 1), (3, 0), (3, 1), (3, 2)}


def test_the_search_does_not_try_all_pairs(monkeypatch):
    """A wall of 900 blocks on one long floor needs some twenty comparisons per block, not 450."""
    tried = []
    plain = broad_phase._cell_pairs
    monkeypatch.setattr(broad_phase, "_cell_pairs", lambda *a: tried.append(plain(*a)) or tried[-1])
    wall = [(LAB, (0.3 * i + 0.15 * (c % 2), 0.0, 0.1 * c + 0.05), UNTURNED) for c in range(30) for i in range(30)]
    found = joints_of(*wall, ((12.0, 1.0, 0.1), (4.5, 0.0, -0.05), UNTURNED), fixed=[900])
    assert len(found) == 30 * 29 + 29 * 59 + 30
    assert 900 < len(tried[0]) < 40 * 900 and not (tried[0] == 900).any()


def test_overlap_of_turned_boxes_agrees_with_points_in_both():
    bodies, shapes = scattered(np.random.default_rng(7), 60)
    position, rotation = bodies.position, bodies.rotation
    pairs = broad_phase.close_pairs(bodies, 0.0)
    depths = broad_phase.overlap_depths(bodies, pairs)
    rng = np.random.default_rng(8)
    agreed = 0
    for pair, depth in zip(pairs, depths, strict=True):
        i, j = sorted(pair, key=lambda k: shapes[k].volume)
        local = rng.uniform(-0.5, 0.5, (5000, 3)) * np.ptp(shapes[i].vertices, axis=0)
        inside_j = (local @ rotation[i].T + position[i] - position[j]) @ rotation[j]
        common = (np.abs(inside_j) <= np.ptp(shapes[j].vertices, axis=0) / 2).all(axis=1).any()
        assert depth > 0.0 or not common
        agreed += int(common == (depth > 0.0))
        # moved apart by less than the depth along any direction, they still overlap
        direction = position[j] - position[i]
        moved = position.copy()
        moved[j] += direction / np.linalg.norm(direction) * 0.99 * max(depth, 0.0)
        still = broad_phase.overlap_depths(bodies._replace(position=moved), np.array([[i, j]]))[0]
        assert depth <= 0.0 or still > 0.0
    assert agreed > 0.9 * len(pairs) > 50


def test_overlap_depths_in_closed_form():
    def between(position, rotations):
        bodies = broad_phase.bodies_of([box((1, 1, 1))] * 2, np.array([(0, 0, 0), position], float), rotations)
        return broad_phase.overlap_depths(bodies, np.array([[0, 1]]))[0]

    def depth(position, orientation):
        return between(position, rotation_matrix(np.array([UNTURNED, orientation])))

    assert depth((0.9, 0.2, 0.0), UNTURNED) == pytest.approx(0.1)
    assert depth((1.0, 0.0, 0.0), UNTURNED) == pytest.approx(0.0, abs=1e-15)
    assert depth((1.3, 0.0, 0.0), UNTURNED) == pytest.approx(-0.3)
    half = np.sqrt(0.5)
    eighth = (np.cos(np.pi / 8), 0, 0, np.sin(np.pi / 8))
    assert depth((1.0, 0.0, 0.0), eighth) == pytest.approx(half - 0.5)
    # Two crossing edges facing along x, the first along z, the second along y: the gap follows from the cross product.
    tipped = quaternion_product((np.cos(np.pi / 8), 0, np.sin(np.pi / 8), 0), UNTURNED)
    first, second = rotation_matrix(eighth), rotation_matrix(tipped)
    assert between((2 * half + 0.01, 0, 0), np.stack([first, second])) == pytest.approx(-0.01)
