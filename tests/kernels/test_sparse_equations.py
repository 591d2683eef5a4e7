"""Sparse equations of an assembly: multifrontal LU factors in nested-dissection order, against dense algebra."""

from __future__ import annotations

import numpy as np
import pytest

from dembrick.simulation.statics import sparse_equations
from dembrick.simulation.statics.sparse_equations import Factors, analyse, dissect


def grid(*sizes):
    """Positions of the cells of a grid, and all pairs that share a face or an edge in a plane, as bonded blocks do."""
    cells = np.indices(sizes).reshape(len(sizes), -1).T
    number = {tuple(cell): i for i, cell in enumerate(cells.tolist())}
    steps = {1: [(1,)], 2: [(1, 0), (0, 1), (1, 1)], 3: [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0)]}[len(sizes)]
    pairs = []
    for cell, i in number.items():
        for step in steps:
            other = number.get(tuple(c + s for c, s in zip(cell, step, strict=True)))
            if other is not None:
                pairs.append((i, other))
    position = np.zeros((len(cells), 3))
    position[:, : len(sizes)] = cells
    return position, np.array(pairs, int).reshape(-1, 2)


def scene(sizes, seed=0):
    """Positions, numbers of the free blocks of each joint (-1: a fixed one), and matrices of the joints."""
    rng = np.random.default_rng(seed)
    position, pairs = grid(*sizes)
    n = len(position)
    held = rng.choice(n, size=max(1, n // 4), replace=False)
    a = np.concatenate([pairs[:, 0], held, np.full(2, -1)])
    b = np.concatenate([pairs[:, 1], np.full(len(held), -1), held[:1].repeat(2)])
    swap = rng.random(len(a)) < 0.5
    a, b = np.where(swap, b, a), np.where(swap, a, b)
    order = rng.permutation(n)  # numbers are unrelated to positions
    a, b = np.where(a >= 0, order[a], -1), np.where(b >= 0, order[b], -1)
    placed = np.empty_like(position)
    placed[order] = position
    left_a, left_b = np.eye(6) + 0.1 * rng.normal(size=(2, len(a), 6, 6))
    return placed, a, b, left_a, left_b, np.eye(6) + 0.2 * rng.normal(size=(len(a), 6, 6))


def dense(n, a, b, left_a, left_b, middle):
    """The sum over the joints of left^T middle left as one matrix (6 n, 6 n), in the order of the blocks."""
    matrix = np.zeros((6 * n, 6 * n))
    for j in range(len(a)):
        left = np.zeros((6, 6 * n))
        if a[j] >= 0:
            left[:, 6 * a[j] : 6 * a[j] + 6] -= left_a[j]
        if b[j] >= 0:
            left[:, 6 * b[j] : 6 * b[j] + 6] += left_b[j]
        matrix += left.T @ middle[j] @ left
    return matrix


SIZES = [(1,), (2,), (30,), (4, 5), (9, 11), (4, 4, 4)]


@pytest.mark.parametrize("sizes", SIZES)
@pytest.mark.parametrize("threshold", [0.0, 0.1, 1.0])
def test_answers_are_those_of_the_dense_matrix(sizes, threshold):
    position, a, b, *matrices = scene(sizes)
    factors = Factors(analyse(position, a, b))
    rows = factors.pattern.rows
    assert factors.make(*matrices, threshold, np.zeros(rows)) == -1
    loads = np.random.default_rng(1).normal(size=(2, len(position), 6))
    expected = np.linalg.solve(dense(len(position), a, b, *matrices), loads.reshape(2, -1).T).T.reshape(loads.shape)
    x = np.stack([factors.pattern.to_rows(load) for load in loads])
    factors.solve(x)
    found = np.stack([factors.pattern.to_blocks(row) for row in x])
    assert found == pytest.approx(expected, rel=1e-7, abs=1e-8 * np.abs(expected).max())
    assert factors.elastic_motion(loads[0]) == pytest.approx(found[0], rel=1e-12)


def test_rows_are_exchanged_where_the_diagonal_is_zero():
    position, a, b, left_a, left_b, _ = scene((1,))
    left_a[:], left_b[:] = np.eye(6), np.eye(6)
    middle = np.zeros((len(a), 6, 6))
    middle[0] = np.eye(6)[::-1]
    factors = Factors(analyse(position, a, b))
    assert factors.make(left_a, left_b, middle, 0.1, np.zeros(6)) == -1
    assert factors.elastic_motion(np.arange(6.0)[None])[0].tolist() == [5.0, 4.0, 3.0, 2.0, 1.0, 0.0]
    assert factors.make(left_a, left_b, middle, 0.0, np.zeros(6)) == 0  # with no free motion a pivot is zero


@pytest.mark.parametrize("sizes", SIZES)
def test_the_energy_of_a_load_is_that_of_the_dense_matrix(sizes):
    position, a, b, left_a, left_b, middle = scene(sizes, seed=2)
    middle = middle @ middle.transpose(0, 2, 1)
    factors = Factors(analyse(position, a, b))
    factors.make(left_a, left_b, middle, 0.0, np.zeros(factors.pattern.rows))
    load = np.random.default_rng(3).normal(size=(len(position), 6))
    matrix = dense(len(position), a, b, left_a, left_b, middle)
    expected = load.ravel() @ np.linalg.solve(matrix, load.ravel())
    rows = factors.pattern.to_rows(load)
    kept = rows.copy()
    assert factors.energy(rows) == pytest.approx(expected, rel=1e-9)
    assert (rows == kept).all()


def test_the_block_that_nothing_holds_is_told():
    position, a, b, *matrices = scene((5, 5), seed=4)
    matrices[2] = matrices[2] @ matrices[2].transpose(0, 2, 1)
    loose = 7
    matrices[2][(a == loose) | (b == loose)] = 0.0
    factors = Factors(analyse(position, a, b))
    assert factors.make(*matrices, 0.0, np.zeros(factors.pattern.rows)) == factors.pattern.place[loose]


def test_parts_of_an_elimination_add_up_to_the_whole(monkeypatch):
    position, a, b, *matrices = scene((9, 11), seed=5)
    ends = []
    for at_once in (1e30, 1.0, 1e5):
        monkeypatch.setattr(sparse_equations, "OPERATIONS_AT_ONCE", at_once)
        factors = Factors(analyse(position, a, b))
        factors.make(*matrices, 0.1, np.zeros(factors.pattern.rows))
        ends.append((factors.fronts.entries.copy(), len(factors.pattern.stops)))
    assert ends[0][1] == 1 < ends[2][1] < ends[1][1]
    assert all((end == ends[0][0]).all() for end, _ in ends[1:])


@pytest.mark.parametrize("sizes", [(40,), (12, 15), (5, 5, 5)])
def test_pieces_that_touch_stand_one_above_the_other(sizes):
    """Separated pieces form an elimination tree: no entry fills in between two branches."""
    position, pairs = grid(*sizes)
    pieces = dissect(position, *pairs.T)
    owner = np.empty(len(position), int)
    for number, piece in enumerate(pieces):
        owner[piece.blocks] = number
        assert piece.parent == -1 or piece.parent > number
    assert sorted(np.concatenate([piece.blocks for piece in pieces])) == list(range(len(position)))
    for low, high in np.sort(owner[pairs], axis=1):
        while low < high:
            low = pieces[low].parent
        assert low == high


def test_fill_grows_as_n_log_n():
    """A square of n bonded blocks has n log n entries; a band's n^1.5 would grow by 8 as n grows by 4."""
    sides = (16, 32, 64)
    entries = [analyse(position, *pairs.T).entries for position, pairs in (grid(s, s) for s in sides)]
    assert entries[1] / entries[0] < 6.0 and entries[2] / entries[1] < 5.5
    for side, count in zip(sides, entries, strict=True):
        assert count < 2 * 36 * 31 / 4 * side**2 * np.log2(side)  # George's count for L, twice: L and U


def test_blocks_in_one_place_are_ordered_too():
    """Rings about a column have the same centroid as the column."""
    n = 20
    pairs = np.array([(i, k) for i in range(n) for k in range(i)])
    pieces = dissect(np.zeros((n, 3)), *pairs.T)
    assert sorted(np.concatenate([piece.blocks for piece in pieces])) == list(range(n))


def test_equations_that_exceed_the_memory_are_refused(monkeypatch):
    position, pairs = grid(9, 9)
    pattern = analyse(position, *pairs.T)
    monkeypatch.setattr(sparse_equations, "available", lambda: pattern.bytes(2) - 1)
    with pytest.raises(sparse_equations.ScenarioError, match="equations of 81 free blocks would take"):
        sparse_equations.check_room(pattern)
    monkeypatch.setattr(sparse_equations, "available", lambda: pattern.bytes(2))
    sparse_equations.check_room(pattern)
