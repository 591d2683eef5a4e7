"""Joint detection (narrow phase): facing faces of convex bodies, and their shared polygons.

Bodies are the convex parts of blocks. All pairs of one kind of shapes are processed as arrays. The geometry of a pair
is computed relative to one of its bodies, so that distance from the origin costs no accuracy.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dembrick.assembly.broad_phase import Bodies, ShapeBatch
from dembrick.geometry import clipping, polygons

TOLERANCE = 1e-6  # of the smaller block's diameter for distances, and in radians for angles
_ROUNDING = 1e-9  # of a length: smaller differences are rounding


class Contacts(NamedTuple):
    """Facing faces of k pairs of bodies and their shared polygons."""

    body: np.ndarray  # (k, 2) a and b
    a_hosts: np.ndarray  # (k,) bool, whether the polygon is on the face of a
    axes: np.ndarray  # (k, 3, 3) rows t1, t2, n; n is the outward normal of a's face
    arm_a: np.ndarray  # (k, 3) m, from the centroid of body a to the centroid O of the polygon
    arm_b: np.ndarray  # (k, 3) m, the same for b
    polygon: np.ndarray  # (k, m, 2) m, corners about O along t1, t2; padded with the last corner
    n_corner: np.ndarray  # (k,)
    area: np.ndarray  # (k,) m2
    gap: np.ndarray  # (k,) m, distance of the faces at O, positive if open


def shared_polygons(bodies: Bodies, pairs: np.ndarray, tolerance: float) -> list[Contacts]:
    """Facing faces of ``pairs`` (p, 2) of bodies, in chunks of pairs of one kind."""
    found = []
    for chosen, stack_a, rows_a, stack_b, rows_b in bodies.table.groups(pairs):
        for start in range(0, len(chosen), clipping.CHUNK):
            some = slice(start, start + clipping.CHUNK)
            sides = (stack_a, rows_a[some]), (stack_b, rows_b[some])
            found.append(_Facing(bodies, pairs[chosen[some]], *sides, tolerance).contacts())
    return found


class _Facing:
    """Facing faces of the pairs of one group, as arrays (k, ...), relative to the centroid of body a."""

    def __init__(self, bodies: Bodies, pairs, first, second, tolerance):
        table, positions, rotations = bodies.table, bodies.position, bodies.rotation
        (stack_a, rows_a), (stack_b, rows_b) = first, second
        normals_a = stack_a.normals[rows_a] @ rotations[pairs[:, 0]].transpose(0, 2, 1)
        normals_b = stack_b.normals[rows_b] @ rotations[pairs[:, 1]].transpose(0, 2, 1)
        pair, face_a, face_b = np.nonzero(normals_a @ normals_b.transpose(0, 2, 1) < -0.5)
        sums = normals_a[pair, face_a] + normals_b[pair, face_b]
        size = table.diameter[pairs].min(axis=1)
        limit = tolerance * size
        between = positions[pairs[:, 1]] - positions[pairs[:, 0]]
        # The distance of inclined faces varies; here it is only a first filter, the gap is measured at O later.
        offsets_a, offsets_b = stack_a.offsets[rows_a[pair], face_a], stack_b.offsets[rows_b[pair], face_b]
        distance = (normals_a[pair, face_a] * between[pair]).sum(axis=1) - offsets_a - offsets_b
        slack = limit + tolerance * table.diameter[pairs].max(axis=1)
        near = ((sums**2).sum(axis=1) <= tolerance**2) & (np.abs(distance) <= slack[pair])
        pair, face_a, face_b = pair[near], face_a[near], face_b[near]
        self.bodies, self.between = pairs[pair], between[pair]
        self.limit, self.rounding = limit[pair], _ROUNDING * size[pair]
        self.normal, self.normal_b = normals_a[pair, face_a], normals_b[pair, face_b]
        self.offset_a, self.offset_b = offsets_a[near], offsets_b[near]
        row_a, row_b = rows_a[pair], rows_b[pair]
        area_a, area_b = stack_a.face_areas[row_a, face_a], stack_b.face_areas[row_b, face_b]
        self.a_hosts = area_a < area_b * (1.0 - _ROUNDING)
        self.t1 = _first_tangents(self.normal, rotations[self.bodies[:, 0]])
        self.t2 = np.cross(self.normal, self.t1)
        corners_a = _face_corners(stack_a, row_a, face_a, rotations[self.bodies[:, 0]])
        corners_b = _face_corners(stack_b, row_b, face_b, rotations[self.bodies[:, 1]]) + self.between[:, None]
        # Plane coordinates start at a corner of the smaller face, which keeps them small wherever the joint lies on a.
        self.base = np.where(self.a_hosts[:, None], corners_a[:, 0], corners_b[:, 0])
        self.outline_a, self.outline_b = self._in_plane(corners_a), self._in_plane(corners_b)[:, ::-1]

    def _in_plane(self, corners: np.ndarray) -> np.ndarray:
        """Coordinates (k, m, 2) of corners (k, m, 3) along t1 and t2, from ``base``."""
        return (corners - self.base[:, None]) @ np.stack([self.t1, self.t2], axis=2)

    def contacts(self) -> Contacts:
        """The polygons that are wide enough and have a small enough gap at O."""
        outlines = [self.outline_a, self.outline_b]
        room = max(outline.shape[1] for outline in outlines)
        for i, outline in enumerate(outlines):
            more = np.repeat(outline[:, -1:], room - outline.shape[1], axis=1)
            outlines[i] = np.concatenate([outline, more], axis=1)
        host = self.a_hosts[:, None, None]
        clipped = clipping.clip(np.where(host, *outlines), np.where(host, *outlines[::-1]))
        points, count = clipping.simplify(*clipped, self.rounding)
        count = np.maximum(count, 1)  # nothing left: one corner, zero area
        points = np.take_along_axis(
            points, np.minimum(np.arange(points.shape[1]), count[:, None] - 1)[..., None], axis=1
        )
        area, x, y = polygons.area_and_centroid(points)
        polygon = points - np.stack([x, y], axis=1)[:, None]
        wide = 2.0 * area > self.limit * polygons.perimeter(polygon)
        arm, gap = self._on_host(self.base + x[:, None] * self.t1 + y[:, None] * self.t2)
        kept = np.flatnonzero(wide & (np.abs(gap) <= self.limit))
        polygon, count = polygon[kept], count[kept]
        return Contacts(
            body=self.bodies[kept],
            a_hosts=self.a_hosts[kept],
            axes=np.stack([self.t1, self.t2, self.normal], axis=1)[kept],
            arm_a=arm[kept],
            arm_b=(arm - self.between)[kept],
            polygon=clipping.started_lowest(polygon, count, (0.8, 0.6)),
            n_corner=count,
            area=area[kept],
            gap=gap[kept],
        )

    def _on_host(self, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """O on the host's face, relative to the centroid of a, and the gap there."""
        normal, normal_b = self.normal, self.normal_b
        to_a = self.offset_a - (normal * point).sum(axis=1)
        to_b = self.offset_b - (normal_b * (point - self.between)).sum(axis=1)
        to_b /= (normal_b * normal).sum(axis=1)
        gap = to_b - to_a
        gap[np.abs(gap) <= self.rounding] = 0.0
        return point + np.where(self.a_hosts, to_a, to_b)[:, None] * normal, gap


def _face_corners(stack: ShapeBatch, rows: np.ndarray, faces: np.ndarray, rotations: np.ndarray) -> np.ndarray:
    """Corners (k, m, 3) of one face each, in world axes from the body's centroid."""
    table = stack.face_table[rows, faces]
    return np.take_along_axis(stack.vertices[rows], table[:, :, None], axis=1) @ rotations.transpose(0, 2, 1)


def _first_tangents(normals: np.ndarray, rotations: np.ndarray) -> np.ndarray:
    """Unit vectors t1 (k, 3): the first body axis of a that is not along n, projected onto the joint plane."""
    along = np.einsum("kij,ki->kj", rotations, normals)
    tangents = rotations - normals[:, :, None] * along[:, None, :]
    lengths = np.sqrt((tangents**2).sum(axis=1))
    chosen = np.argmax(lengths > TOLERANCE, axis=1)
    rows = np.arange(len(normals))
    return tangents[rows, :, chosen] / lengths[rows, chosen, None]
