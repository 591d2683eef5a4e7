"""Broad phase of contact detection: which blocks are near each other, and whether they overlap.

All pairs of a scene are handled as arrays, grouped by the kind of their shapes (how many corners, faces, axes), so
that ten thousand boxes of any sizes make one group.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from dembrick.geometry.shapes import Polyhedron, Shape, parts_of

_WIDE = 64  # a block that covers more cells than this is compared with all others directly
_CHUNK = 4096  # pairs that the overlap test takes at a time
_PARALLEL = 1e-9  # sine of the angle below which two edges give no axis


def distinct(numbers: np.ndarray) -> np.ndarray:
    """The distinct ones of ``numbers``, integers (k,), sorted. Not `numpy.unique`, which loads masked arrays: a short
    run then takes a twentieth longer to start."""
    ordered = np.sort(numbers)
    return ordered[np.diff(ordered, prepend=ordered[:1] - 1) > 0]


class Stack:
    """Shapes of one kind as arrays with a leading axis over the distinct shapes."""

    def __init__(self, shapes: list[Polyhedron]):
        self.vertices = np.stack([shape.vertices for shape in shapes])
        self.normals = np.stack([shape.face_normals for shape in shapes])
        self.offsets = np.stack([shape.face_offsets for shape in shapes])
        self.face_areas = np.stack([shape.face_areas for shape in shapes])
        self.face_table = np.stack([shape.face_table for shape in shapes])
        self.face_axes = np.stack([shape.face_axes for shape in shapes])
        self.edge_axes = np.stack([shape.edge_axes for shape in shapes])


class ShapeTable:
    """The distinct shapes of a scene, stacked by kind; ``diameter`` (n,) is per block."""

    def __init__(self, shapes: Sequence[Polyhedron]):
        kinds: dict[tuple, list[Polyhedron]] = {}
        where: dict[int, tuple[int, int]] = {}
        numbers: dict[tuple, int] = {}
        for key, shape in {id(shape): shape for shape in shapes}.items():
            sizes = (shape.vertices, shape.face_table, shape.face_axes, shape.edge_axes)
            kind = tuple(array.shape for array in sizes)
            members = kinds.setdefault(kind, [])
            where[key] = (numbers.setdefault(kind, len(numbers)), len(members))
            members.append(shape)
        self.stacks = [Stack(members) for members in kinds.values()]
        places = np.array([where[id(shape)] for shape in shapes], dtype=np.int64).reshape(-1, 2)
        self.kind, self.row = places[:, 0], places[:, 1]
        self.diameter = np.array([shape.diameter for shape in shapes])

    def groups(self, pairs: np.ndarray) -> Iterator[tuple[np.ndarray, Stack, np.ndarray, Stack, np.ndarray]]:
        """For pairs (p, 2): (numbers of the pairs, stack of the first, rows in it, stack of the second, rows)."""
        code = self.kind[pairs[:, 0]] * len(self.stacks) + self.kind[pairs[:, 1]]
        for value in distinct(code).tolist():
            chosen = np.flatnonzero(code == value)
            first, second = divmod(value, len(self.stacks))
            rows = self.row[pairs[chosen]]
            yield chosen, self.stacks[first], rows[:, 0], self.stacks[second], rows[:, 1]


class Bodies(NamedTuple):
    """The convex parts of all blocks, p of them; as many as blocks where every block is convex."""

    owner: np.ndarray  # (p,) the block
    table: ShapeTable
    position: np.ndarray  # (p, 3) m, centroid of the part, world
    rotation: np.ndarray  # (p, 3, 3) body axes to world
    arm: np.ndarray  # (p, 3) m, from the centroid of the block to that of the part, world
    place: np.ndarray  # (p, 3) m, the same in body axes

    def moved(self, positions: np.ndarray, rotations: np.ndarray) -> Bodies:
        """The same parts of blocks that now stand at ``positions`` (n, 3)."""
        turn = rotations[self.owner]
        arm = np.einsum("pij,pj->pi", turn, self.place)
        return self._replace(position=positions[self.owner] + arm, rotation=turn, arm=arm)


def bodies_of(shapes: Sequence[Shape], positions: np.ndarray, rotations: np.ndarray) -> Bodies:
    """The convex parts of blocks whose centroids stand at ``positions`` (n, 3)."""
    known = {id(shape): parts_of(shape) for shape in shapes}
    parts = [known[id(shape)] for shape in shapes]
    owner = np.repeat(np.arange(len(shapes)), [len(own) for own in parts])
    places = np.array([place for own in parts for place, _ in own]).reshape(-1, 3)
    table = ShapeTable([part for own in parts for _, part in own])
    none = np.zeros(0)
    return Bodies(owner, table, none, none, none, places).moved(positions, rotations)


def close_pairs(bodies: Bodies, tolerance: float) -> np.ndarray:
    """Pairs (p, 2) of bodies, first below second, sorted, whose bounding boxes come near each other: within the sum of
    their margins, ``tolerance`` times the diameter each.

    A grid of cells twice as long as the middle one of the bodies; every cell compares the bodies that reach into it.
    """
    table, positions, rotations = bodies.table, bodies.position, bodies.rotation
    margin = tolerance * table.diameter
    n_block = len(positions)
    centred = positions - positions.mean(axis=0) if n_block else positions
    low, high = np.empty((n_block, 3)), np.empty((n_block, 3))
    for kind, stack in enumerate(table.stacks):
        members = np.flatnonzero(table.kind == kind)
        corners = np.einsum("bij,bvj->bvi", rotations[members], stack.vertices[table.row[members]])
        least, most = _ends(corners, 1)
        low[members] = centred[members] + least - margin[members, None]
        high[members] = centred[members] + most + margin[members, None]
    cell = 2.0 * np.sort(high - low, axis=0)[n_block // 2 :][:1]
    first = np.floor(low / cell).astype(np.int64)
    counts = np.floor(high / cell).astype(np.int64) - first + 1
    covered = counts.prod(axis=1, dtype=float)  # integers would overflow on a kilometre of floor under pebbles
    wide = np.flatnonzero(covered > _WIDE)
    small = np.flatnonzero(covered <= _WIDE)
    found = [_cell_pairs(small, first, counts)]
    for block in wide:
        found.append(np.stack([np.full(n_block, block), np.arange(n_block)], axis=1))
    pairs = np.concatenate(found)
    pairs = pairs[((low[pairs[:, 0]] <= high[pairs[:, 1]]) & (low[pairs[:, 1]] <= high[pairs[:, 0]])).all(axis=1)]
    pairs = np.sort(pairs[pairs[:, 0] != pairs[:, 1]], axis=1)
    codes = distinct(pairs[:, 0] * n_block + pairs[:, 1])
    return np.stack(np.divmod(codes, max(n_block, 1)), axis=1)


def _cell_pairs(blocks: np.ndarray, first: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """All pairs of blocks that reach into a common cell (p, 2); a pair may come more than once."""
    covered = counts[blocks].prod(axis=1)
    owner = np.repeat(blocks, covered)
    inside = np.arange(len(owner)) - np.repeat(np.cumsum(covered) - covered, covered)
    cells = first[owner].copy()
    for axis in range(3):
        cells[:, axis] += inside % counts[owner, axis]
        inside //= counts[owner, axis]
    order = np.lexsort(cells.T)
    cells, owner = cells[order], owner[order]
    start = np.flatnonzero(np.concatenate([[True], (cells[1:] != cells[:-1]).any(axis=1)])[: len(owner)])
    size = np.diff(np.concatenate([start, [len(owner)]]))
    rank = np.arange(len(owner)) - np.repeat(start, size)
    # Every entry of a cell meets the entries before it in that cell.
    later = np.repeat(np.arange(len(owner)), rank)
    earlier = np.arange(len(later)) - np.repeat(np.cumsum(rank) - rank, rank) + np.repeat(np.repeat(start, size), rank)
    return np.stack([owner[later], owner[earlier]], axis=1)


def _ends(values: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest along a short axis, which numpy is quick to find along the first only."""
    first = np.ascontiguousarray(np.moveaxis(values, axis, 0))
    return first.min(axis=0), first.max(axis=0)


def overlap_depths(bodies: Bodies, pairs: np.ndarray, enough: np.ndarray | None = None) -> np.ndarray:
    """How deep each pair of bodies (p, 2) overlaps (p,): the shortest way out (m); negative when they are apart.

    Separating axes of two convex polyhedra: face normals of both, and the products of their edges, which are many. A
    pair that some face lets overlap by no more than ``enough`` (p,) is asked no further: it overlaps by that at most.
    """
    depths = np.empty(len(pairs))
    for chosen, stack_a, rows_a, stack_b, rows_b in bodies.table.groups(pairs):
        for start in range(0, len(chosen), _CHUNK):
            some, row_a, row_b = (of[start : start + _CHUNK] for of in (chosen, rows_a, rows_b))
            depths[some] = _depths(bodies, pairs[some], stack_a, row_a, stack_b, row_b, _face_axes)
            if enough is not None:
                left = depths[some] > enough[some]
                some, row_a, row_b = some[left], row_a[left], row_b[left]
            by_edges = _depths(bodies, pairs[some], stack_a, row_a, stack_b, row_b, _edge_products)
            depths[some] = np.minimum(depths[some], by_edges)
    return depths


def way_out(bodies: Bodies, pair: np.ndarray) -> np.ndarray:
    """Shortest translation (3,) of the second of two bodies (2,) that overlap after which they touch (m).

    Of several equally short ones the one that points up most, then along x, then along y.
    """
    found = []
    for _, stack_a, rows_a, stack_b, rows_b in bodies.table.groups(pair[None]):
        for axes_of in (_face_axes, _edge_products):
            axes, useful, least, most = _reaches(bodies, pair[None], stack_a, rows_a, stack_b, rows_b, axes_of)
            counts = np.broadcast_to(useful, most.shape)[0]
            for length, sign in ((most[0], 1.0), (-least[0], -1.0)):
                found.append(sign * length[counts, None] * axes[0][counts])
    ways = np.concatenate(found)
    lengths = np.sqrt((ways**2).sum(axis=1))
    short = ways[lengths <= lengths.min() * (1.0 + 1e-9) + 1e-12]
    return max(short, key=lambda way: tuple(np.round(way[[2, 0, 1]] / lengths.min(), 6)))


def _reaches(bodies: Bodies, pairs, stack_a: Stack, row_a, stack_b: Stack, row_b, axes_of) -> tuple:
    """Some axes of pairs of bodies (p, n, 3), which of them count, and the least and the greatest part of their common
    reach (p, n): by ``most`` along an axis, or -``least`` against it, the second has to move until they touch (m)."""
    a, b = pairs.T
    turn_a, turn_b = bodies.rotation[a].transpose(0, 2, 1), bodies.rotation[b].transpose(0, 2, 1)
    axes, useful = axes_of(stack_a, row_a, turn_a, stack_b, row_b, turn_b)
    reach_a = axes @ (stack_a.vertices[row_a] @ turn_a).transpose(0, 2, 1)
    reach_b = axes @ (stack_b.vertices[row_b] @ turn_b).transpose(0, 2, 1)
    between = (axes @ (bodies.position[b] - bodies.position[a])[:, :, None])[:, :, 0]
    (least_a, most_a), (least_b, most_b) = _ends(reach_a, 2), _ends(reach_b, 2)
    return axes, useful, least_a - most_b - between, most_a - least_b - between


def _depths(bodies: Bodies, pairs, stack_a: Stack, row_a, stack_b: Stack, row_b, axes_of) -> np.ndarray:
    """How deep pairs of bodies of two kinds overlap (p,) along the best of some axes (m)."""
    _, useful, least, most = _reaches(bodies, pairs, stack_a, row_a, stack_b, row_b, axes_of)
    depth = np.minimum(most, -least)
    return _ends(np.where(useful, depth, np.inf), 1)[0]


def _face_axes(stack_a: Stack, row_a, turn_a, stack_b: Stack, row_b, turn_b) -> tuple[np.ndarray, bool]:
    """Face normals (p, f, 3) of both bodies, and that all count."""
    return np.concatenate([stack_a.face_axes[row_a] @ turn_a, stack_b.face_axes[row_b] @ turn_b], axis=1), True


def _edge_products(stack_a: Stack, row_a, turn_a, stack_b: Stack, row_b, turn_b) -> tuple[np.ndarray, np.ndarray]:
    """Directions (p, e, 3) that are normal to an edge of either body, and whether the two are not parallel (p, e)."""
    edges_a, edges_b = stack_a.edge_axes[row_a] @ turn_a, stack_b.edge_axes[row_b] @ turn_b
    crossed = np.cross(edges_a[:, :, None], edges_b[:, None])
    crossed = crossed.reshape(len(crossed), crossed.shape[1] * crossed.shape[2], 3)
    length = np.sqrt((crossed**2).sum(axis=2))
    useful = length > _PARALLEL
    crossed /= np.where(useful, length, 1.0)[:, :, None]
    return crossed, useful
