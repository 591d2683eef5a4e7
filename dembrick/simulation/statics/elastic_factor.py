"""The elastic stiffness of a whole assembly, factorised: all joints closed, none slipping.

As an artificial inertia it lets all modes of an assembly swing together, the long ones of a tower as fast as those of
one block, which the stiffness of each block by itself cannot do.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dembrick.errors import ScenarioError
from dembrick.kernels.math.skyline import factorise, solve_in_place
from dembrick.kernels.state import WholeInertia
from dembrick.simulation.statics.state import State
from dembrick.simulation.statics.stiffness import block_stiffness, couplings

MOST_ENTRIES = 30_000_000  # of a factor: 240 MB
ROWS_AT_ONCE = 2000  # that are factorised in one go: a signal waits for some tenths of a second
_SINGULAR = 1e-13  # of a diagonal entry: a pivot below this is rounding


class Factor(NamedTuple):
    """Cholesky factor of the elastic stiffness (see ``kernels.skyline``); ``place`` (f,) first row of a free block."""

    place: np.ndarray
    first: np.ndarray
    start: np.ndarray
    lower: np.ndarray

    def answer(self, load: np.ndarray) -> np.ndarray:
        """Motion (f, 6) of the free blocks under ``load`` (f, 6)."""
        rows = (self.place[:, None] + np.arange(6)).ravel()
        x = np.empty(rows.size)
        x[rows] = load.ravel()
        solve_in_place(self.first, self.start, self.lower, x)
        return x[rows].reshape(-1, 6)


def touches_itself(state: State) -> bool:
    """Whether any free block touches another one."""
    free = np.zeros(len(state.blocks.displacement), bool)
    free[state.blocks.free] = True
    return bool((free[state.joints.block_a] & free[state.joints.block_b]).any())


def elastic_factor(state: State) -> Factor | None:
    """The factor, or None where it would take more than ``MOST_ENTRIES``.

    Raises ScenarioError where the joints, closed and sticking, do not hold every free block.
    """
    free = state.blocks.free
    number = np.full(len(state.blocks.displacement), -1)
    number[free] = np.arange(len(free))
    a, b, blocks = couplings(state)
    a, b = number[a], number[b]
    order = _narrow_order(len(free), a, b)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    later, earlier = np.maximum(rank[a], rank[b]), np.minimum(rank[a], rank[b])
    reach = np.arange(len(free))
    np.minimum.at(reach, later, earlier)
    first = 6 * np.repeat(reach, 6)
    rows = np.arange(6 * len(free))
    start = np.concatenate([[0], np.cumsum(rows - first + 1)]).astype(np.int64)
    if start[-1] > MOST_ENTRIES:
        return None
    lower = np.zeros(start[-1])
    six = np.arange(6)
    for i, own in enumerate(block_stiffness(state, shared=1.0)[free[order]]):
        for k in six:
            row = 6 * i + k
            begin = start[row] + 6 * i - first[row]
            lower[begin : begin + k + 1] = own[k, : k + 1]
    for ends, coupling in zip(np.stack([rank[a], rank[b]], axis=1), blocks, strict=True):
        i, k = ends.max(), ends.min()
        block = coupling if ends[0] == i else coupling.T
        for m in six:
            row = 6 * i + m
            begin = start[row] + 6 * k - first[row]
            lower[begin : begin + 6] += block[m]
    factor = Factor(6 * rank, first.astype(np.int64), start[:-1].copy(), lower)
    failed = _factorised(factor)
    if failed >= 0:
        raise ScenarioError(
            f"the joints do not hold block number {free[order[failed // 6]]} even when they are closed and stick: "
            "give its joints more contact points"
        )
    return factor


def _factorised(factor: Factor) -> int:
    """Put the Cholesky factor in the place of the matrix; returns -1, or the row that fails."""
    rows, failed = len(factor.first), -1
    for begin in range(0, rows, ROWS_AT_ONCE):
        if failed < 0:
            end = min(begin + ROWS_AT_ONCE, rows)
            failed = int(factorise(factor.first, factor.start, factor.lower, _SINGULAR, begin, end))
    return failed


def whole_inertia(factor: Factor) -> WholeInertia:
    """The elastic stiffness as artificial inertia."""
    return WholeInertia(*factor, work=np.zeros(len(factor.first)))


def _narrow_order(count: int, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """An order of ``count`` blocks, joined pairwise by (a, b), that keeps neighbours close together.

    The reverse of Cuthill and McKee's: breadth first from a block at the rim, those with few neighbours first.
    """
    neighbours: list[list[int]] = [[] for _ in range(count)]
    for i, k in {(min(p), max(p)) for p in zip(a.tolist(), b.tolist(), strict=True)}:
        neighbours[i].append(k)
        neighbours[k].append(i)
    degree = [len(n) for n in neighbours]
    for n in neighbours:
        n.sort(key=lambda block: degree[block])
    seen = [False] * count
    order: list[int] = []
    for root in sorted(range(count), key=lambda block: degree[block]):
        if seen[root]:
            continue
        for _ in range(2):  # the block that is reached last lies at the rim
            root = _breadth_first(root, neighbours)[-1]
        wave = _breadth_first(root, neighbours)
        for block in wave:
            seen[block] = True
        order.extend(wave)
    return np.array(order[::-1], np.int64)


def _breadth_first(root: int, neighbours: list[list[int]]) -> list[int]:
    wave, seen = [root], {root}
    for block in wave:
        for other in neighbours[block]:
            if other not in seen:
                seen.add(other)
                wave.append(other)
    return wave
