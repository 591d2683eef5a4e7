"""Shapes of blocks: convex polyhedra in their own body frame.

A shape has no position and no material. Its centroid is the origin of the body frame, whose axes are those of the
coordinates in which the shape was described; lengths are in metres.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, lru_cache

import numpy as np

from dembrick.geometry.rotations import rotation_matrix

SMALLEST, LARGEST = 1e-9, 1e9  # m, of a block: far beyond what anyone builds, far within the range of a double
_PARALLEL = 1e-9  # sine of the angle below which two directions of a shape are equal


@dataclass(frozen=True, eq=False)
class Polyhedron:
    """A convex polyhedron about its centroid.

    ``vertices`` (nv, 3) in the body frame; ``faces`` tuples of vertex indices, counterclockwise seen from outside;
    ``volume`` (m3); ``inertia`` (3, 3) about the centroid at unit density (m5); ``centroid`` (3,) in the coordinates in
    which the shape was described.
    """

    vertices: np.ndarray
    faces: tuple[tuple[int, ...], ...]
    volume: float
    inertia: np.ndarray
    centroid: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def moved(self, position, orientation) -> np.ndarray:
        """World coordinates (nv, 3) of the vertices, with the centroid at ``position`` and rotated by a quaternion."""
        return np.asarray(position, float) + self.vertices @ rotation_matrix(orientation).T

    @cached_property
    def diameter(self) -> float:
        """Twice the distance of the farthest vertex from the centroid: the reference length of tolerances."""
        return 2.0 * float(np.sqrt((self.vertices**2).sum(axis=1).max()))

    @property
    def longest_face(self) -> int:
        """Number of corners of the face that has most."""
        return max(len(face) for face in self.faces)

    @cached_property
    def face_table(self) -> np.ndarray:
        """Faces as one array (nf, longest face); shorter faces are padded with their last vertex."""
        return np.array([face + face[-1:] * (self.longest_face - len(face)) for face in self.faces])

    @cached_property
    def _face_vectors(self) -> np.ndarray:
        """Outward normals of the faces (nf, 3), with lengths proportional to the areas."""
        corners = self.vertices[self.face_table]
        return 0.5 * np.cross(corners - corners[:, :1], np.roll(corners, -1, axis=1) - corners[:, :1]).sum(axis=1)

    @cached_property
    def face_areas(self) -> np.ndarray:
        """Areas of the faces (nf,)."""
        return np.sqrt((self._face_vectors**2).sum(axis=1))

    @cached_property
    def face_normals(self) -> np.ndarray:
        """Outward unit normals of the faces (nf, 3)."""
        return self._face_vectors / self.face_areas[:, None]

    @cached_property
    def face_offsets(self) -> np.ndarray:
        """Distances of the face planes from the centroid (nf,)."""
        corners = self.vertices[[face[0] for face in self.faces]]
        return (self.face_normals * corners).sum(axis=1)

    @cached_property
    def face_axes(self) -> np.ndarray:
        """Directions of the face normals, opposite ones counted once (k, 3); three for a box."""
        return _distinct_directions(self.face_normals)

    @cached_property
    def edge_axes(self) -> np.ndarray:
        """Directions of the edges, parallel ones counted once (k, 3); three for a box."""
        edges = np.concatenate([self.vertices[list(f)] - self.vertices[list(f[-1:] + f[:-1])] for f in self.faces])
        return _distinct_directions(edges / np.sqrt((edges**2).sum(axis=1))[:, None])


@dataclass(frozen=True, eq=False)
class Compound:
    """Convex parts that form one rigid body, about its centroid.

    ``parts`` are polyhedra in axes parallel to the body's, each about its own centroid, which is at ``places`` (k, 3)
    in the body. ``volume``, ``inertia`` and ``centroid`` as in :class:`Polyhedron`; parts must not overlap.
    """

    parts: tuple[Polyhedron, ...]
    places: np.ndarray
    volume: float
    inertia: np.ndarray
    centroid: np.ndarray

    @property
    def longest_face(self) -> int:
        """Number of corners of the face that has most."""
        return max(part.longest_face for part in self.parts)

    @cached_property
    def diameter(self) -> float:
        """Twice the distance of the farthest vertex from the centroid."""
        return 2.0 * float(np.sqrt((self.vertices**2).sum(axis=1).max()))

    @cached_property
    def vertices(self) -> np.ndarray:
        """Vertices (nv, 3) of all parts."""
        return np.concatenate([place + part.vertices for place, part in zip(self.places, self.parts, strict=True)])

    @cached_property
    def faces(self) -> tuple[tuple[int, ...], ...]:
        """Faces of all parts."""
        found, first = [], 0
        for part in self.parts:
            found += [tuple(first + i for i in face) for face in part.faces]
            first += len(part.vertices)
        return tuple(found)


Shape = Polyhedron | Compound


def parts_of(shape: Shape) -> list[tuple[np.ndarray, Polyhedron]]:
    """The convex parts of a shape and the places of their centroids in the body."""
    if isinstance(shape, Polyhedron):
        return [(np.zeros(3), shape)]
    return list(zip(shape.places, shape.parts, strict=True))


def _distinct_directions(directions: np.ndarray) -> np.ndarray:
    kept, rest = [], directions
    while len(rest):
        kept.append(rest[0])
        rest = rest[np.linalg.norm(np.cross(rest, rest[0]), axis=1) > _PARALLEL]
    return np.array(kept)


_BOX_CORNERS = np.array([[x, y, z] for z in (-0.5, 0.5) for y in (-0.5, 0.5) for x in (-0.5, 0.5)])
_BOX_FACES = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))


@lru_cache(maxsize=4096)
def _box(a: float, b: float, c: float) -> Polyhedron:
    volume = a * b * c
    inertia = np.diag([b * b + c * c, a * a + c * c, a * a + b * b]) * volume / 12.0
    return Polyhedron(_BOX_CORNERS * (a, b, c), _BOX_FACES, volume, inertia)


def box(edges) -> Polyhedron:
    """A box with edge lengths ``edges`` (3,) along its body axes; equal boxes share one object."""
    return _box(*(float(edge) for edge in edges))
