"""Points attached to blocks: their positions, and the forces and moments on the blocks from forces at the points."""

from types import SimpleNamespace

import numpy as np
import pytest

from dembrick.assembly.actuators import NOWHERE, Attached
from dembrick.geometry.rotations import rotation_matrix, turned_by

RNG = np.random.default_rng(7)
TURNS = rotation_matrix(turned_by(RNG.normal(size=(3, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (3, 1))))
POSITION, BLOCK, POINT = RNG.normal(size=(3, 3)), np.array([2, 0, 2, 1]), RNG.normal(size=(4, 3))
ATTACHED = Attached.to(SimpleNamespace(rotation=TURNS), BLOCK, POINT - POSITION[BLOCK])


def test_points_stay_where_they_are_on_a_body_that_moves():
    turn, shift = TURNS[1], np.array([0.3, -2.0, 1.0])  # rigid motion of the whole scene
    moved = np.array([turn @ p + shift for p in POSITION])
    now = moved[BLOCK] + ATTACHED.arms(np.array([turn @ own for own in TURNS]))
    assert now == pytest.approx(POINT @ turn.T + shift, abs=1e-14)
    assert ATTACHED.start(POSITION) == pytest.approx(POINT, abs=1e-15)


def test_forces_at_the_points_do_the_work_that_their_blocks_feel():
    """The virtual work in a rigid motion v + w x r of each block equals the sum over the points."""
    force, v, w = RNG.normal(size=(4, 3)), RNG.normal(size=(3, 3)), RNG.normal(size=(3, 3))
    work = sum(f @ (v[b] + np.cross(w[b], x - POSITION[b])) for f, b, x in zip(force, BLOCK, POINT, strict=True))
    wrench = ATTACHED.on_blocks(force, 3)
    assert (wrench[:, :3] * v).sum() + (wrench[:, 3:] * w).sum() == pytest.approx(work, rel=1e-13)


def test_sets_of_points_are_cut_and_joined():
    both = ATTACHED[:1].and_then(NOWHERE).and_then(ATTACHED[1:])
    assert len(both) == 4 and (both.block == BLOCK).all() and (both.lever == ATTACHED.lever).all()
    ends = Attached.to(SimpleNamespace(rotation=TURNS), BLOCK.reshape(2, 2), (POINT - POSITION[BLOCK]).reshape(2, 2, 3))
    assert (ends.lever.reshape(4, 3) == ATTACHED.lever).all() and len(ends) == 2
