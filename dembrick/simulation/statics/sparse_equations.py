"""The equations of the free blocks of an assembly as sparse matrices: analysed once, factorised as often as needed.

The analysis (nested dissection, elimination tree, places of each joint in the fronts) depends only on which blocks
touch; the elastic stiffness and all tangents of a search share it.

Nested dissection is an order of elimination that keeps the fill of a sparse factor low.

A set of blocks is cut in two halves by a separator, blocks of one half that touch the other; both halves are ordered
first, each by itself in the same way, and the separator last. The factor of a wall of n blocks then has about n log n
entries and takes about n^1.5 operations, in place of n^1.5 and n^2 of a band. George, SIAM J. Numer. Anal. 10 (1973)
345. As the positions of the blocks are known, cuts across the three axes are tried and the best is taken.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dembrick.errors import ScenarioError
from dembrick.kernels.math.multifrontal import SIX, Fronts, eliminate, energy_norm, substitute_back, substitute_forward
from dembrick.scenario.memory import available

OPERATIONS_AT_ONCE = 2e9  # multiply-adds per call: a signal waits for some tenths of a second


@dataclass(frozen=True)
class Pattern:
    """Symbolic analysis of the equations of f free blocks.

    ``place`` (f,): first row of each free block in the equations. ``fronts``: elimination tree without values;
    ``entries`` of a factor and ``room`` for updates are to be allocated. ``stops``: fronts after which an elimination
    may pause.
    """

    place: np.ndarray
    fronts: Fronts
    entries: int
    room: int
    stops: tuple[int, ...]

    @property
    def rows(self) -> int:
        """Number of equations."""
        return SIX * len(self.place)

    def to_rows(self, values: np.ndarray) -> np.ndarray:
        """Values (f, 6) of the free blocks in the order of the equations (6 f,)."""
        rows = np.empty(self.rows)
        rows[self.place[:, None] + np.arange(SIX)] = values
        return rows

    def to_blocks(self, rows: np.ndarray) -> np.ndarray:
        """Inverse of `to_rows`: values (f, 6) of the free blocks."""
        return rows[self.place[:, None] + np.arange(SIX)]

    def bytes(self, factors: int) -> int:
        """Memory (bytes) of so many ``factors``, with room for updates."""
        return 8 * (factors * (self.entries + self.rows) + self.room)


class Factors:
    """LU factors of one matrix of a `Pattern`; ``room`` may be shared with factors that are made at other times."""

    def __init__(self, pattern: Pattern, room: np.ndarray | None = None):
        self.pattern = pattern
        self.fronts = pattern.fronts._replace(
            entries=np.empty(pattern.entries),
            room=np.empty(pattern.room) if room is None else room,
            exchange=np.empty(pattern.rows, np.int64),
            near=np.empty(SIX * int(np.diff(pattern.fronts.edge).max(initial=0))),
        )

        self.seconds = 0.0  # spent on analysis and factors

    def prepare(self, left_a: np.ndarray, left_b: np.ndarray, middle: np.ndarray) -> None:
        """Compile or load the kernels of `make` and `solve`, without any work."""
        none = np.zeros((0, self.pattern.rows))
        eliminate(self.fronts, left_a, left_b, middle, 0, 0, 0.0, np.zeros(0))
        self.solve(none)

    def make(
        self, left_a: np.ndarray, left_b: np.ndarray, middle: np.ndarray, threshold: float, least: np.ndarray
    ) -> int:
        """Factorise the sum over the joints of left^T middle left (see `kernels.math.multifrontal.eliminate`).

        Returns -1, or the first row of a block at which the matrix is singular.
        """
        began, first, failed = time.perf_counter(), 0, -1
        for stop in self.pattern.stops:
            if failed < 0:
                failed = int(eliminate(self.fronts, left_a, left_b, middle, first, stop, threshold, least))
            first = stop
        self.seconds += time.perf_counter() - began
        return failed

    def solve(self, x: np.ndarray) -> None:
        """Solve for right-hand sides ``x`` (m, 6 f) in the order of the equations, in place."""
        substitute_forward(self.fronts, x)
        substitute_back(self.fronts, x)

    def elastic_motion(self, load: np.ndarray) -> np.ndarray:
        """Motion (f, 6) of the free blocks under ``load`` (f, 6)."""
        x = self.pattern.to_rows(load)
        self.solve(x[None])
        return self.pattern.to_blocks(x)

    def energy(self, load: np.ndarray) -> float:
        """Twice the energy (J) that ``load`` (6 f,) stores in a symmetric matrix made with ``threshold`` zero."""
        return float(energy_norm(self.fronts, load[None].copy()))


def inner(a: np.ndarray, b: np.ndarray) -> float:
    """Inner product of two long vectors, summed in an order that, unlike BLAS, does not depend on the number of
    threads."""
    return float((a * b).sum())


def check_room(pattern: Pattern) -> None:
    """ScenarioError if the two factors of a search, elastic stiffness and tangent, exceed the memory."""
    there, needed = available(), pattern.bytes(factors=2)
    if there is not None and needed > there:
        raise ScenarioError(
            f"the equations of {len(pattern.place)} free blocks would take {needed / 1e9:.2g} GB and "
            f"{there / 1e9:.2g} GB are free here; push a smaller part, use a dynamic kind of control, or take a "
            "machine with more memory"
        )


def analyse(position: np.ndarray, block_a: np.ndarray, block_b: np.ndarray) -> Pattern:
    """Symbolic analysis for free blocks at ``position`` (f, 3) and joints between ``block_a`` and ``block_b`` (j,),
    numbers of free blocks or -1 if a block is fixed."""
    n = len(position)
    both = (block_a >= 0) & (block_b >= 0)
    low, high = np.minimum(block_a, block_b)[both], np.maximum(block_a, block_b)[both]
    low, high = np.divmod(np.unique(low * n + high), n)
    pieces = dissect(position, low, high)
    order = np.concatenate([piece.blocks for piece in pieces])
    rank = np.empty(n, np.int64)
    rank[order] = np.arange(n)
    first = np.concatenate([[0], np.cumsum([len(piece.blocks) for piece in pieces])]).astype(np.int64)
    boundaries = _boundaries(pieces, first, rank[low], rank[high])
    edge = np.concatenate([[0], np.cumsum([len(b) for b in boundaries])]).astype(np.int64)
    boundary = np.concatenate([*boundaries, np.empty(0, np.int64)])
    pivots, around = np.diff(first), np.diff(edge)
    size = SIX * SIX * pivots * (pivots + 2 * around)
    start = np.cumsum(size) - size
    parent = np.array([piece.parent for piece in pieces], np.int64)
    number = _Numbering(first, edge, boundary, n)
    inside = number.inside(np.repeat(parent, around), boundary)
    update, room = _update_places(parent, SIX * SIX * around**2)
    by_parent = np.argsort(parent, kind="stable")
    child = np.searchsorted(parent[by_parent], np.arange(len(pieces) + 1))
    parts = _parts(number, start, np.where(block_a >= 0, rank[block_a], -1), np.where(block_b >= 0, rank[block_b], -1))
    fronts = Fronts(
        first=first,
        edge=edge,
        boundary=boundary,
        inside=inside,
        start=start,
        update=update,
        child=child.astype(np.int64),
        children=by_parent.astype(np.int64),
        **parts,
        entries=np.empty(0),
        room=np.empty(0),
        exchange=np.empty(0, np.int64),
        near=np.empty(0),
    )
    work = 216.0 * (pivots * around * (pivots + around) + pivots**3 / 3.0)
    stops = np.flatnonzero(np.diff(np.floor(np.cumsum(work) / OPERATIONS_AT_ONCE))) + 1
    return Pattern(SIX * rank, fronts, int(size.sum()), room, (*stops.tolist(), len(pieces)))


def _boundaries(pieces: list[Piece], first: np.ndarray, low: np.ndarray, high: np.ndarray) -> list[np.ndarray]:
    """Boundary blocks of every piece, by their place in the order of elimination: later blocks that its own blocks or
    those of its children touch. ``low`` and ``high``: coupled blocks, by their places."""
    low, high = np.minimum(low, high), np.maximum(low, high)
    order = np.argsort(low, kind="stable")
    low, high = low[order], high[order]
    begins = np.searchsorted(low, first)
    given: list[list[np.ndarray]] = [[high[begins[s] : begins[s + 1]]] for s in range(len(pieces))]
    boundaries = []
    for s, piece in enumerate(pieces):
        later = np.unique(np.concatenate(given[s]))
        later = later[np.searchsorted(later, first[s + 1]) :]
        boundaries.append(later)
        given[s] = []
        if piece.parent >= 0:
            given[piece.parent].append(later)
    return boundaries


class _Numbering:
    """Numbers of blocks within fronts: pivot blocks first, then those of the boundary."""

    def __init__(self, first: np.ndarray, edge: np.ndarray, boundary: np.ndarray, count: int):
        self.first, self.edge, self.count = first, edge, count
        self.pivots, self.around = np.diff(first), np.diff(edge)
        self.front = np.repeat(np.arange(len(first) - 1), self.pivots)  # in which each block is eliminated
        self._keys = np.repeat(np.arange(len(first) - 1), self.around) * count + boundary

    def inside(self, front: np.ndarray, block: np.ndarray) -> np.ndarray:
        """Numbers of blocks, given by their places in the order of elimination, in one ``front`` each."""
        own = self.front[block] == front
        key = np.searchsorted(self._keys, front * self.count + block)
        return np.where(own, block - self.first[front], key - self.edge[front] + self.pivots[front])


def _update_places(parent: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, int]:
    """Place of the update of each front in the shared room, and the size of that room.

    An update is formed while those of its children exist, and is freed once its parent has used it; it goes into
    the first gap that is wide enough.
    """
    place, room = np.zeros(len(parent), np.int64), 0
    children: list[list[int]] = [[] for _ in parent]
    gaps: list[tuple[int, int]] = [(0, int(size.sum()))]  # from, to; in order
    for s, (top, wanted) in enumerate(zip(parent.tolist(), size.tolist(), strict=True)):
        if wanted:
            k = next(k for k, (begin, end) in enumerate(gaps) if end - begin >= wanted)
            begin, end = gaps[k]
            place[s], room = begin, max(room, begin + wanted)
            gaps[k : k + 1] = [(begin + wanted, end)] if end - begin > wanted else []
        freed = [(int(place[c]), int(place[c] + size[c])) for c in children[s] if size[c]]
        if freed:
            joined: list[tuple[int, int]] = []
            for begin, end in sorted(gaps + freed):
                if joined and joined[-1][1] == begin:
                    joined[-1] = (joined[-1][0], end)
                else:
                    joined.append((begin, end))
            gaps = joined
        if top >= 0:
            children[top].append(s)
    return place, room


def _parts(number: _Numbering, start: np.ndarray, a: np.ndarray, b: np.ndarray) -> dict[str, np.ndarray]:
    """Places in the fronts of the up to four blocks of every joint; ``a``, ``b``: places of its ends, -1 if fixed."""
    found = []
    for side, (row, column) in enumerate(((a, a), (a, b), (b, a), (b, b))):
        joint = np.flatnonzero((row >= 0) & (column >= 0))
        row, column = row[joint], column[joint]
        front = number.front[np.minimum(row, column)]
        i, k = number.inside(front, row), number.inside(front, column)
        pivots, wide = SIX * number.pivots[front], SIX * (number.pivots + number.around)[front]
        upper = SIX * i < pivots
        stride = np.where(upper, wide, pivots)
        above = np.where(upper, SIX * i * wide, pivots * wide + (SIX * i - pivots) * pivots)
        found.append((front, joint, np.full(len(joint), side), start[front] + above + SIX * k, stride))
    front, joint, side, target, stride = (np.concatenate(column) for column in zip(*found, strict=True))
    order = np.lexsort((side, joint, front))
    part = np.searchsorted(front[order], np.arange(len(start) + 1))
    named = {"part": part, "element": joint, "sides": side, "target": target, "stride": stride}
    return {k: (v if k == "part" else v[order]).astype(np.int64) for k, v in named.items()}


LEAF = 6  # blocks of a set that is not cut any further
UNEVEN = 0.15  # of a set: greatest distance of a cut from its middle


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

    With blocks sorted along an axis, a block belongs to the separator of a cut if it lies before it and touches one
    behind, or the other way round; these are counted for all cuts at once.
    """
    n = len(position)
    cuts = np.arange(max(1, int((0.5 - UNEVEN) * n)), min(n - 1, int(np.ceil((0.5 + UNEVEN) * n))) + 1)
    best, found = np.inf, None
    for axis in np.flatnonzero(np.ptp(position, axis=0) > 0.0).tolist():
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
