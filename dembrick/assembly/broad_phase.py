"""Broad phase of contact detection, and the overlap test of the pairs that it finds.

All pairs of a scene are processed as arrays, grouped by kind of shape (numbers of corners, faces, axes); ten thousand
boxes of any sizes form one group.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from dembrick.geometry.shapes import Polyhedron, Shape, parts_of

_WIDE = 64  # a block that covers more cells than this is compared directly with all others
_CHUNK = 4096  # pairs per batch of the overlap test
_PARALLEL = 1e-9  # sine of the angle below which two edges are parallel and give no axis


def distinct(numbers: np.ndarray) -> np.ndarray:
    """Sorted distinct values of integers ``numbers`` (k,). `numpy.unique` would load masked arrays, which lengthens
    the start of a short run by a twentieth."""
    ordered = np.sort(numbers)
    return ordered[np.diff(ordered, prepend=ordered[:1] - 1) > 0]


class ShapeBatch:
    """Shapes of one kind as arrays; the leading axis is that of the distinct shapes."""

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
        self.stacks = [ShapeBatch(members) for members in kinds.values()]
        places = np.array([where[id(shape)] for shape in shapes], dtype=np.int64).reshape(-1, 2)
        self.kind, self.row = places[:, 0], places[:, 1]
        self.diameter = np.array([shape.diameter for shape in shapes])

    def groups(self, pairs: np.ndarray) -> Iterator[tuple[np.ndarray, ShapeBatch, np.ndarray, ShapeBatch, np.ndarray]]:
        """Groups of pairs (p, 2) by kind: (indices of pairs, stack and rows of the first, of the second)."""
        code = self.kind[pairs[:, 0]] * len(self.stacks) + self.kind[pairs[:, 1]]
        for value in distinct(code).tolist():
            chosen = np.flatnonzero(code == value)
            first, second = divmod(value, len(self.stacks))
            rows = self.row[pairs[chosen]]
            yield chosen, self.stacks[first], rows[:, 0], self.stacks[second], rows[:, 1]


class Bodies(NamedTuple):
    """The p convex parts of all blocks; one per block if every block is convex."""

    owner: np.ndarray  # (p,) the block
    table: ShapeTable
    position: np.ndarray  # (p, 3) m, centroid of the part, world
    rotation: np.ndarray  # (p, 3, 3) body axes to world
    arm: np.ndarray  # (p, 3) m, from the centroid of the block to that of the part, world
    place: np.ndarray  # (p, 3) m, the same in body axes

    def moved(self, positions: np.ndarray, rotations: np.ndarray) -> Bodies:
        """The same parts after the blocks have moved to ``positions`` (n, 3) and ``rotations``."""
        turn = rotations[self.owner]
        arm = np.einsum("pij,pj->pi", turn, self.place)
        return self._replace(position=positions[self.owner] + arm, rotation=turn, arm=arm)


def bodies_of(shapes: Sequence[Shape], positions: np.ndarray, rotations: np.ndarray) -> Bodies:
    """The convex parts of blocks with centroids at ``positions`` (n, 3)."""
    known = {id(shape): parts_of(shape) for shape in shapes}
    parts = [known[id(shape)] for shape in shapes]
    owner = np.repeat(np.arange(len(shapes)), [len(own) for own in parts])
    places = np.array([place for own in parts for place, _ in own]).reshape(-1, 3)
    table = ShapeTable([part for own in parts for _, part in own])
    none = np.zeros(0)
    return Bodies(owner, table, none, none, none, places).moved(positions, rotations)


def close_pairs(bodies: Bodies, tolerance: float) -> np.ndarray:
    """Pairs (p, 2) of bodies, sorted, lower index first, whose bounding boxes overlap when each is enlarged by a margin
    of ``tolerance`` times the diameter.

    The cells of the grid are twice the median size of the bodies; bodies that share a cell are compared.
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
    covered = counts.prod(axis=1, dtype=float)  # float: a kilometre of floor under pebbles overflows integers
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
    """All pairs of blocks that share a cell (p, 2), possibly repeated."""
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
    # Each entry of a cell is paired with the entries before it in that cell.
    later = np.repeat(np.arange(len(owner)), rank)
    earlier = np.arange(len(later)) - np.repeat(np.cumsum(rank) - rank, rank) + np.repeat(np.repeat(start, size), rank)
    return np.stack([owner[later], owner[earlier]], axis=1)


def _ends(values: np.ndarray, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Minimum and maximum along a short axis; moved to the front, where numpy reduces fastest."""
    first = np.ascontiguousarray(np.moveaxis(values, axis, 0))
    return first.min(axis=0), first.max(axis=0)


def overlap_depths(bodies: Bodies, pairs: np.ndarray, enough: np.ndarray | None = None) -> np.ndarray:
    """Penetration of each pair (p, 2) of bodies (p,): the shortest separating translation (m); negative if apart.

    Test of the separating axes of two convex polyhedra: face normals of both, and cross products of their edges, which
    are many. If some face normal bounds the penetration of a pair by ``enough`` (p,), that bound is returned.
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


def separating_translation(bodies: Bodies, pair: np.ndarray) -> np.ndarray:
    """Shortest translation (3,) of the second of two overlapping bodies (2,) that separates them (m).

    Among several of equal length, the one that points up most is chosen, then along x, then along y.
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


def _reaches(bodies: Bodies, pairs, stack_a: ShapeBatch, row_a, stack_b: ShapeBatch, row_b, axes_of) -> tuple:
    """Some axes of pairs of bodies (p, n, 3), which of them are valid, and the projected overlaps (p, n): the second
    body must move by ``most`` along an axis, or by -``least`` against it, until the two touch (m)."""
    a, b = pairs.T
    turn_a, turn_b = bodies.rotation[a].transpose(0, 2, 1), bodies.rotation[b].transpose(0, 2, 1)
    axes, useful = axes_of(stack_a, row_a, turn_a, stack_b, row_b, turn_b)
    reach_a = axes @ (stack_a.vertices[row_a] @ turn_a).transpose(0, 2, 1)
    reach_b = axes @ (stack_b.vertices[row_b] @ turn_b).transpose(0, 2, 1)
    between = (axes @ (bodies.position[b] - bodies.position[a])[:, :, None])[:, :, 0]
    (least_a, most_a), (least_b, most_b) = _ends(reach_a, 2), _ends(reach_b, 2)
    return axes, useful, least_a - most_b - between, most_a - least_b - between


def _depths(bodies: Bodies, pairs, stack_a: ShapeBatch, row_a, stack_b: ShapeBatch, row_b, axes_of) -> np.ndarray:
    """Penetration of pairs of bodies (p,), the least over some axes (m)."""
    _, useful, least, most = _reaches(bodies, pairs, stack_a, row_a, stack_b, row_b, axes_of)
    depth = np.minimum(most, -least)
    return _ends(np.where(useful, depth, np.inf), 1)[0]


def _face_axes(stack_a: ShapeBatch, row_a, turn_a, stack_b: ShapeBatch, row_b, turn_b) -> tuple[np.ndarray, bool]:
    """Face normals (p, f, 3) of both bodies; all are valid."""
    return np.concatenate([stack_a.face_axes[row_a] @ turn_a, stack_b.face_axes[row_b] @ turn_b], axis=1), True


def _edge_products(
    stack_a: ShapeBatch, row_a, turn_a, stack_b: ShapeBatch, row_b, turn_b
) -> tuple[np.ndarray, np.ndarray]:
    """Cross products of edges of both bodies (p, e, 3), unit length, and whether the edges are not parallel (p, e)."""
    edges_a, edges_b = stack_a.edge_axes[row_a] @ turn_a, stack_b.edge_axes[row_b] @ turn_b
    crossed = np.cross(edges_a[:, :, None], edges_b[:, None])
    crossed = crossed.reshape(len(crossed), crossed.shape[1] * crossed.shape[2], 3)
    length = np.sqrt((crossed**2).sum(axis=2))
    useful = length > _PARALLEL
    crossed /= np.where(useful, length, 1.0)[:, :, None]
    return crossed, useful
