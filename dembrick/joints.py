"""Joints: faces of two blocks that face each other, the polygon that they share, and its axes.

All geometry of a pair is taken relative to one of its two blocks, so that a scene far from the origin keeps every
digit that its input has.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dembrick import polygons
from dembrick.model import JointLaw
from dembrick.neighbours import ShapeTable, Stack, close_pairs
from dembrick.point_rules import ContactPoints, contact_points
from dembrick.polygons import second_moments, shrink_factor, tributary_areas
from dembrick.shapes import Polyhedron, rotation_matrix

__all__ = [
    "TOLERANCE",
    "ContactPoints",
    "Joint",
    "contact_points",
    "find_joints",
    "second_moments",
    "shrink_factor",
    "tributary_areas",
]

TOLERANCE = 1e-6  # of the smaller block's diameter for distances, and in radians for angles
_ROUNDING = 1e-9  # of a length: below it, two lengths are the same


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


def find_joints(
    shapes: Sequence[Polyhedron],
    positions,
    orientations,
    fixed,
    law_of: Callable[[int, int], JointLaw],
    tolerance: float = TOLERANCE,
    pairs: np.ndarray | None = None,
) -> list[Joint]:
    """All joints of a scene, in the order of their blocks.

    ``positions`` (n, 3), ``orientations`` (n, 4), ``fixed`` (n,). Faces count as facing when they are antiparallel
    within ``tolerance`` (rad) and apart, or into each other, by at most ``tolerance`` times the diameter of the
    smaller block; their polygon must be wider than that too. Two fixed blocks make no joint. ``pairs`` (p, 2) is
    the result of the search for near blocks where it is known already.
    """
    positions = np.asarray(positions, float).reshape(-1, 3)
    rotations = rotation_matrix(np.asarray(orientations, float).reshape(-1, 4))
    fixed = np.asarray(fixed, bool)
    table = ShapeTable(shapes)
    if pairs is None:
        pairs = close_pairs(table, positions, rotations, tolerance * table.diameter)
    pairs = pairs[~(fixed[pairs[:, 0]] & fixed[pairs[:, 1]])]
    pairs = np.where(fixed[pairs[:, 1]][:, None], pairs[:, ::-1], pairs)
    found: list[Joint] = []
    for chosen, stack_a, rows_a, stack_b, rows_b in table.groups(pairs):
        group = _Facing(table, positions, rotations, pairs[chosen], (stack_a, rows_a), (stack_b, rows_b), tolerance)
        found.extend(group.joints(law_of))
    found.sort(key=lambda joint: sorted((joint.block_a, joint.block_b)))
    return found


class _Facing:
    """Facing faces of the pairs of one group, as arrays (k, ...), seen from the centroid of block a."""

    def __init__(self, table, positions, rotations, pairs, first, second, tolerance):
        (stack_a, rows_a), (stack_b, rows_b) = first, second
        normals_a = stack_a.normals[rows_a] @ rotations[pairs[:, 0]].transpose(0, 2, 1)
        normals_b = stack_b.normals[rows_b] @ rotations[pairs[:, 1]].transpose(0, 2, 1)
        pair, face_a, face_b = np.nonzero(normals_a @ normals_b.transpose(0, 2, 1) < -0.5)
        sums = normals_a[pair, face_a] + normals_b[pair, face_b]
        size = table.diameter[pairs].min(axis=1)
        limit = tolerance * size
        between = positions[pairs[:, 1]] - positions[pairs[:, 0]]
        # Where the faces are tilted against each other the distance varies; it is measured at O later on.
        offsets_a, offsets_b = stack_a.offsets[rows_a[pair], face_a], stack_b.offsets[rows_b[pair], face_b]
        distance = (normals_a[pair, face_a] * between[pair]).sum(axis=1) - offsets_a - offsets_b
        slack = limit + tolerance * table.diameter[pairs].max(axis=1)
        near = ((sums**2).sum(axis=1) <= tolerance**2) & (np.abs(distance) <= slack[pair])
        pair, face_a, face_b = pair[near], face_a[near], face_b[near]
        self.blocks, self.between = pairs[pair], between[pair]
        self.limit, self.rounding = limit[pair], _ROUNDING * size[pair]
        self.position = positions[self.blocks[:, 0]]
        self.normal, self.normal_b = normals_a[pair, face_a], normals_b[pair, face_b]
        self.offset_a, self.offset_b = offsets_a[near], offsets_b[near]
        row_a, row_b = rows_a[pair], rows_b[pair]
        area_a, area_b = stack_a.face_areas[row_a, face_a], stack_b.face_areas[row_b, face_b]
        self.a_hosts = area_a < area_b * (1.0 - _ROUNDING)
        self.t1 = _first_tangents(self.normal, rotations[self.blocks[:, 0]])
        self.t2 = np.cross(self.normal, self.t1)
        corners_a = _face_corners(stack_a, row_a, face_a, rotations[self.blocks[:, 0]])
        corners_b = _face_corners(stack_b, row_b, face_b, rotations[self.blocks[:, 1]]) + self.between[:, None]
        # Plane coordinates start at a corner of the smaller face: short numbers wherever the joint lies on a.
        self.base = np.where(self.a_hosts[:, None], corners_a[:, 0], corners_b[:, 0])
        self.outline_a, self.outline_b = self._in_plane(corners_a), self._in_plane(corners_b)[:, ::-1]

    def _in_plane(self, corners: np.ndarray) -> np.ndarray:
        """Corners (k, m, 3) along t1 and t2 from ``base`` (k, m, 2)."""
        return (corners - self.base[:, None]) @ np.stack([self.t1, self.t2], axis=2)

    def joints(self, law_of) -> list[Joint]:
        """The joints whose polygon is wide enough and whose gap at O is small enough."""
        found: list[Joint] = []
        axes = np.stack([self.t1, self.t2, self.normal], axis=1)
        outlines_a = [[tuple(point) for point in outline] for outline in self.outline_a.tolist()]
        outlines_b = [[tuple(point) for point in outline] for outline in self.outline_b.tolist()]
        for k, limit in enumerate(self.limit.tolist()):
            hosted = (outlines_a[k], outlines_b[k]) if self.a_hosts[k] else (outlines_b[k], outlines_a[k])
            outline = polygons.simplify(polygons.clip(*hosted), self.rounding[k])
            if not outline:
                continue
            area, x, y = polygons.area_and_centroid(outline)
            polygon = np.array(outline) - (x, y)
            edges = polygon - np.concatenate([polygon[1:], polygon[:1]])
            if 2.0 * area <= limit * np.sqrt((edges**2).sum(axis=1)).sum():
                continue
            arm, gap = self._seat(k, self.base[k] + x * self.t1[k] + y * self.t2[k])
            if abs(gap) > limit:
                continue
            a, b = self.blocks[k].tolist()
            host = a if self.a_hosts[k] else b
            first = int(np.argmin(polygon @ (0.8, 0.6)))
            polygon = np.concatenate([polygon[first:], polygon[:first]])
            origin, arm_b = self.position[k] + arm, arm - self.between[k]
            found.append(Joint(a, b, host, origin, axes[k], polygon, area, law_of(a, b), gap, arm, arm_b))
        return found

    def _seat(self, k: int, point: np.ndarray) -> tuple[np.ndarray, float]:
        """O on the host's face, seen from the centroid of a, and the gap there."""
        normal, normal_b = self.normal[k], self.normal_b[k]
        to_a = float(self.offset_a[k] - normal @ point)
        to_b = float((self.offset_b[k] - normal_b @ (point - self.between[k])) / (normal_b @ normal))
        gap = to_b - to_a
        if abs(gap) <= self.rounding[k]:
            gap = 0.0
        return point + (to_a if self.a_hosts[k] else to_b) * normal, gap


def _face_corners(stack: Stack, rows: np.ndarray, faces: np.ndarray, rotations: np.ndarray) -> np.ndarray:
    """Corners (k, m, 3) of one face each, turned into the world but seen from the block's centroid."""
    table = stack.face_table[rows, faces]
    return np.take_along_axis(stack.vertices[rows], table[:, :, None], axis=1) @ rotations.transpose(0, 2, 1)


def _first_tangents(normals: np.ndarray, rotations: np.ndarray) -> np.ndarray:
    """The first body axis of a that is not along n, projected on the joint, unit length (k, 3)."""
    along = np.einsum("kij,ki->kj", rotations, normals)
    tangents = rotations - normals[:, :, None] * along[:, None, :]
    lengths = np.sqrt((tangents**2).sum(axis=1))
    chosen = np.argmax(lengths > TOLERANCE, axis=1)
    rows = np.arange(len(normals))
    return tangents[rows, :, chosen] / lengths[rows, chosen, None]
