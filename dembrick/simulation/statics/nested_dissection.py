"""Nested dissection: an order of elimination that keeps the fill of a sparse factor low.

A set of blocks is cut in two halves by a separator, blocks of one half that touch the other; both halves are ordered
first, each by itself in the same way, and the separator last. The factor of a wall of n blocks then has some n log n
entries and takes some n^1.5 operations, in place of n^1.5 and n^2 of a band. George, SIAM J. Numer. Anal. 10 (1973)
345. Blocks know where they stand, so that cuts across one of three axes are tried and the best is taken.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

LEAF = 6  # blocks that are not cut any further
UNEVEN = 0.15  # of a set: how far from its middle a cut may lie


class Piece(NamedTuple):
    """Blocks that are eliminated together, and the piece (its number) that separates them from others, or -1."""

    blocks: np.ndarray
    parent: int


def dissect(position: np.ndarray, first: np.ndarray, second: np.ndarray) -> list[Piece]:
    """Pieces of the blocks at ``position`` (n, 3) m, coupled by the pairs (``first``, ``second``), children first."""
    pieces: list[Piece] = []

    def order(blocks: np.ndarray, a: np.ndarray, b: np.ndarray) -> list[int]:
        """Append the pieces of these blocks, coupled by pairs (a, b) of their numbers; which have no parent yet."""
        side = _cut(position[blocks], a, b) if len(blocks) > LEAF else None
        if side is None:
            pieces.append(Piece(blocks, -1))
            return [len(pieces) - 1]
        tops = []
        for half in (0, 1):
            chosen = side == half
            number = np.cumsum(chosen) - 1
            within = chosen[a] & chosen[b]
            tops += order(blocks[chosen], number[a[within]], number[b[within]])
        separator = blocks[side == 2]
        if not len(separator):
            return tops
        for top in tops:
            pieces[top] = pieces[top]._replace(parent=len(pieces))
        pieces.append(Piece(separator, -1))
        return [len(pieces) - 1]

    order(np.arange(len(position)), first, second)
    return pieces


def _cut(position: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray | None:
    """0 and 1 for the blocks of the halves and 2 for those of the separator (n,); None if no cut leaves halves.

    Sorted along an axis, a block belongs to the separator of a cut if it lies before it and touches one behind, or the
    other way round: how many these are is counted for all cuts at once.
    """
    n = len(position)
    cuts = np.arange(max(1, int((0.5 - UNEVEN) * n)), min(n - 1, int(np.ceil((0.5 + UNEVEN) * n))) + 1)
    best, found = np.inf, None
    for axis in range(3):
        order = np.argsort(position[:, axis], kind="stable")
        rank = np.empty(n, np.int64)
        rank[order] = np.arange(n)
        low, high = np.minimum(rank[a], rank[b]), np.maximum(rank[a], rank[b])
        farthest, nearest = np.arange(n), np.arange(n)
        np.maximum.at(farthest, low, high)
        np.minimum.at(nearest, high, low)
        for begins, ends in ((np.arange(n), farthest), (nearest, np.arange(n))):
            crossed = np.cumsum(np.bincount(begins + 1, minlength=n + 2) - np.bincount(ends + 1, minlength=n + 2))
            cost = crossed[cuts] + 1e-3 * np.abs(cuts / n - 0.5)
            k = int(np.argmin(cost))
            if cost[k] < best:
                cut, best = cuts[k], float(cost[k])
                across = (begins < cut) & (ends >= cut)
                found = np.where(across, 2, np.where(np.arange(n) < cut, 0, 1))[rank]
    if found is None or not ((found == 0).any() and (found == 1).any()):
        return None
    return found
