"""Joints: faces of two blocks that face each other, the polygon that they share, and its axes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from dembrick.facing import TOLERANCE, Contacts, shared_polygons
from dembrick.model import JointLaw
from dembrick.neighbours import ShapeTable, close_pairs
from dembrick.point_rules import ContactPoints, contact_points
from dembrick.polygons import second_moments, shrink_factor, tributary_areas
from dembrick.shapes import Polyhedron, rotation_matrix

__all__ = [
    "TOLERANCE",
    "ContactPoints",
    "Joint",
    "JointTable",
    "contact_points",
    "find_joints",
    "second_moments",
    "shrink_factor",
    "tributary_areas",
]


@dataclass(frozen=True, eq=False)
class Joint:
    """Two facing faces and their shared polygon.

    ``block_a``, ``block_b``: block numbers; a comes first in the scenario, unless b alone is fixed (then they change
    places). ``host``: the block whose face is smaller (equal: b); the polygon lies on that face and rides with it.
    ``origin`` (3,): centroid O of the polygon, world axes at the start; ``arm_a``, ``arm_b`` (3,): the same seen from
    the centroids of a and b. ``axes`` (3, 3): rows t1, t2, n; n is the outward normal of a's face, t1 the first body
    axis of a that is not along n, projected on the joint. ``polygon`` (m, 2): corners about O along t1 and t2,
    counterclockwise, none on the line of its neighbours. ``area`` (m2). ``gap`` (m): how far the faces are apart at
    O, positive when open; what rounding leaves is stored as 0.
    """

    block_a: int
    block_b: int
    host: int
    origin: np.ndarray
    axes: np.ndarray
    polygon: np.ndarray
    area: float
    law: JointLaw
    gap: float
    arm_a: np.ndarray
    arm_b: np.ndarray


@dataclass(frozen=True, eq=False)
class JointTable(Sequence[Joint]):
    """All joints of a scene as columns (j, ...), named as the fields of :class:`Joint`; a sequence of joints too.

    ``corner`` (v, 2) holds the polygons one after another, from ``start`` (j + 1,) each.
    """

    block_a: np.ndarray
    block_b: np.ndarray
    host: np.ndarray
    origin: np.ndarray
    axes: np.ndarray
    corner: np.ndarray
    start: np.ndarray
    area: np.ndarray
    law: tuple[JointLaw, ...]
    gap: np.ndarray
    arm_a: np.ndarray
    arm_b: np.ndarray

    @staticmethod
    def of(joints: Sequence[Joint]) -> JointTable:
        """The table of a list of joints; a table is taken as it is."""
        if isinstance(joints, JointTable):
            return joints

        def column(name, shape=(), kind=float):
            return np.array([getattr(joint, name) for joint in joints], kind).reshape(-1, *shape)

        shapes = [np.asarray(joint.polygon, float) for joint in joints]
        return JointTable(
            block_a=column("block_a", kind=np.int64),
            block_b=column("block_b", kind=np.int64),
            host=column("host", kind=np.int64),
            origin=column("origin", (3,)),
            axes=column("axes", (3, 3)),
            corner=np.concatenate([*shapes, np.empty((0, 2))]),
            start=np.cumsum([0, *map(len, shapes)]),
            area=column("area"),
            law=tuple(joint.law for joint in joints),
            gap=column("gap"),
            arm_a=column("arm_a", (3,)),
            arm_b=column("arm_b", (3,)),
        )

    def __len__(self) -> int:
        return len(self.block_a)

    def __getitem__(self, index):
        if isinstance(index, slice):
            return tuple(self[i] for i in range(*index.indices(len(self))))
        i = range(len(self))[index]  # negative ones count from the end, IndexError beyond
        return Joint(
            int(self.block_a[i]),
            int(self.block_b[i]),
            int(self.host[i]),
            self.origin[i],
            self.axes[i],
            self.corner[self.start[i] : self.start[i + 1]],
            float(self.area[i]),
            self.law[i],
            float(self.gap[i]),
            self.arm_a[i],
            self.arm_b[i],
        )

    def by_corners(self, chosen=None) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """The joints with equally many corners: their numbers (g,) and polygons (g, m, 2); all, or the ``chosen``."""
        numbers = np.arange(len(self)) if chosen is None else np.asarray(chosen)
        counts = (self.start[1:] - self.start[:-1])[numbers]
        for count in np.unique(counts):
            some = numbers[counts == count]
            yield some, self.corner[self.start[some, None] + np.arange(count)]


def find_joints(
    shapes: Sequence[Polyhedron],
    positions,
    orientations,
    fixed,
    law_of: Callable[[int, int], JointLaw],
    tolerance: float = TOLERANCE,
    pairs: np.ndarray | None = None,
    table: ShapeTable | None = None,
) -> JointTable:
    """All joints of a scene, in the order of their blocks.

    ``positions`` (n, 3), ``orientations`` (n, 4), ``fixed`` (n,). Faces count as facing when they are antiparallel
    within ``tolerance`` (rad) and apart, or into each other, by at most ``tolerance`` times the diameter of the
    smaller block; their polygon must be wider than that too. Two fixed blocks make no joint. ``pairs`` (p, 2) is
    the result of the search for near blocks where it is known already, ``table`` that of ``shapes``.
    """
    positions = np.asarray(positions, float).reshape(-1, 3)
    rotations = rotation_matrix(np.asarray(orientations, float).reshape(-1, 4))
    fixed = np.asarray(fixed, bool)
    table = table or ShapeTable(shapes)
    if pairs is None:
        pairs = close_pairs(table, positions, rotations, tolerance * table.diameter)
    pairs = pairs[~(fixed[pairs[:, 0]] & fixed[pairs[:, 1]])]
    pairs = np.where(fixed[pairs[:, 1]][:, None], pairs[:, ::-1], pairs)
    return _table(shared_polygons(table, positions, rotations, pairs, tolerance), positions, law_of)


def _table(found: list[Contacts], positions: np.ndarray, law_of) -> JointTable:
    """The contacts of all groups as one table, sorted by the blocks."""

    def column(name, *shape, kind=float):
        return np.concatenate([getattr(contacts, name) for contacts in found] or [np.empty((0, *shape), kind)])

    body, count = column("body", 2, kind=np.int64), column("count", kind=np.int64)
    order = np.lexsort((body.max(axis=1), body.min(axis=1)))
    body, count = body[order], count[order]
    a, b = body.T
    arm_a = column("arm_a", 3)[order]
    # polygons one after another, in the order of the joints
    packed = [c.polygon[np.arange(c.polygon.shape[1]) < c.count[:, None]] for c in found]
    corner = np.concatenate([*packed, np.empty((0, 2))])
    old_count = column("count", kind=np.int64)
    old_start = np.cumsum(old_count) - old_count
    start = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    where = np.repeat(old_start[order] - start[:-1], count) + np.arange(len(corner))
    return JointTable(
        block_a=a.copy(),
        block_b=b.copy(),
        host=np.where(column("a_hosts", kind=bool)[order], a, b),
        origin=positions[a] + arm_a,
        axes=column("axes", 3, 3)[order],
        corner=corner[where],
        start=start,
        area=column("area")[order],
        law=tuple(law_of(first, second) for first, second in body.tolist()),
        gap=column("gap")[order],
        arm_a=arm_a,
        arm_b=column("arm_b", 3)[order],
    )
