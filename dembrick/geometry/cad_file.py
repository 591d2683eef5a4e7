"""Solids from CAD: several named solids in one file. OBJ, STL, glTF, COMPAS JSON, and the formats that meshio reads.

Solids are the objects (``o``) of an OBJ file, or its groups (``g``) if it has no objects; the named solids of a text
STL file; the nodes of a glTF scene; and the blocks of a COMPAS assembly. Within each, and in files without names, a
solid ends where its surface is closed. Every solid is checked as described in :mod:`dembrick.geometry.mesh_file`; one
that is not convex is cut into parts that all have its name.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from typing import NamedTuple, TypeVar

import numpy as np

from dembrick.errors import ScenarioError
from dembrick.geometry import compas_file, gltf_file, mesh_file, obj_file, stl_file
from dembrick.geometry.shapes import Polyhedron

ENDINGS = (".obj", ".stl", ".gltf", ".glb", ".json", ".ply", ".msh", ".vtu")
LARGEST_FILE = 64 << 20  # bytes
MOST_SOLIDS = 20_000

Faces = list[tuple[int, ...]]
T = TypeVar("T")


class Solid(NamedTuple):
    """A convex polyhedron of a file, which is a solid or part of one: the ``name`` of the solid, whether the file marks
    it as a support, and its ``shape``."""

    name: str
    fixed: bool
    shape: Polyhedron

    @property
    def corners(self) -> np.ndarray:
        """Corners (nv, 3) m in the coordinates of the file."""
        return self.shape.vertices + self.shape.centroid


class _Named(NamedTuple):
    name: str
    points: np.ndarray
    faces: Faces
    fixed: bool = False


def read(path: str, scale: float) -> list[Solid]:
    """The solids of a file in their order, with lengths times ``scale`` in metres; equal names get numbers.

    The convex parts of a solid that is not convex follow one another under its name.

    Raises ScenarioError for a file that cannot be read and for a solid that cannot be a block.
    """
    ending = os.path.splitext(path)[1].lower()
    mesh_file.check_file(path, ENDINGS, LARGEST_FILE)
    readers = {".obj": _obj, ".stl": _stl, ".gltf": _gltf, ".glb": _gltf, ".json": _compas}
    if ending in readers:
        named = readers[ending](path)
    else:
        named = [_Named("solid", *mesh_file.read_surface(path))]
    found = []
    for solid in named:
        parts = list(_closed_parts(solid))
        if _is_hollow(parts):
            raise ScenarioError(
                f"{path}: solid {solid.name!r} is hollow: a closed part of its surface lies inside another; a block "
                "must be solid, so cut it into pieces around the hollow and join them by united"
            )
        found += parts
    if not found:
        raise ScenarioError(f"{path}: there is no surface in the file; every block needs one that is closed")
    if len(found) > MOST_SOLIDS:
        raise ScenarioError(f"{path}: it holds {len(found)} solids; at most {MOST_SOLIDS} are allowed")
    solids = []
    for name, part in zip(_different([part.name for part in found]), found, strict=True):
        try:
            shapes = mesh_file.checked(part.points * scale, part.faces)
        except ScenarioError as error:
            raise ScenarioError(f"{path}: solid {name!r}: {error}") from None
        solids += [Solid(name, part.fixed, shape) for shape in shapes]
    return solids


def _different(names: list[str]) -> list[str]:
    """The names, made distinct by a number after each repeated one."""
    taken: dict[str, int] = {}
    several = {name for name in names if names.count(name) > 1} if len(set(names)) < len(names) else set()
    found = []
    for name in names:
        taken[name] = taken.get(name, 0) + 1
        found.append(f"{name}.{taken[name]}" if name in several else name)
    return found


def _closed_parts(solid: _Named) -> Iterator[_Named]:
    """Split a solid of a file into its closed surfaces, each with the corners that it uses.

    Surfaces that share no corner are separate, whatever the order of their faces. Of surfaces that touch, as bodies in
    an STL file may, one ends with the face that closes it. One that never closes is returned whole; a later check
    refuses it by name.
    """
    points, number = np.unique(solid.points + 0.0, axis=0, return_inverse=True)
    number = number.reshape(-1)
    faces = [tuple(int(number[i]) for i in face) for face in solid.faces]
    parts: list[Faces] = []
    for together in _connected(faces):
        open_edges: set[tuple[int, int]] = set()
        begun: Faces = []
        for face in together:
            begun.append(face)
            for edge in zip(face, face[1:] + face[:1], strict=True):
                back = edge[::-1]
                open_edges.symmetric_difference_update([back if back in open_edges else edge])
            if not open_edges:
                parts.append(begun)
                begun = []
        if begun and len(begun) < len(together):  # the order of the faces does not separate the solids
            parts = [*parts[: -1 if parts else None], together]
        elif begun:
            parts.append(begun)
    for faces in parts:
        yield _with_its_corners(_Named(solid.name, points, faces, solid.fixed))


def _with_its_corners(solid: _Named) -> _Named:
    """The solid without unused corners."""
    used, local = np.unique(np.concatenate([np.array(face) for face in solid.faces]), return_inverse=True)
    ends = np.cumsum([0, *map(len, solid.faces)])
    own = [tuple(local.reshape(-1)[a:b].tolist()) for a, b in zip(ends[:-1], ends[1:], strict=True)]
    return solid._replace(points=solid.points[used], faces=own)


def _is_hollow(parts: list[_Named]) -> bool:
    """Whether any of the closed surfaces lies inside another."""
    if len(parts) < 2:
        return False
    low, high = (np.array([getattr(part.points, end)(axis=0) for part in parts]) for end in ("min", "max"))
    for outer, part in enumerate(parts):
        for inner in np.flatnonzero((low > low[outer]).all(axis=1) & (high < high[outer]).all(axis=1)):
            if _winds_about(part, parts[inner].points[0]):
                return True
    return False


def _winds_about(part: _Named, point: np.ndarray) -> bool:
    """Whether a closed surface encloses a ``point`` (3,), by the solid angle that it subtends there (van Oosterom and
    Strackee, IEEE Trans. Biomed. Eng. 30 (1983) 125)."""
    corners = np.array([(face[0], *face[i : i + 2]) for face in part.faces for i in range(1, len(face) - 1)])
    a, b, c = np.moveaxis(part.points[corners] - point, 1, 0)
    lengths = [np.linalg.norm(arm, axis=1) for arm in (a, b, c)]
    products = [(p * q).sum(axis=1) * lengths[r] for p, q, r in ((a, b, 2), (b, c, 0), (c, a, 1))]
    angle = 2.0 * np.arctan2((a * np.cross(b, c)).sum(axis=1), np.prod(lengths, axis=0) + sum(products)).sum()
    return abs(angle) > 2.0 * np.pi


def _connected(faces: Faces) -> list[Faces]:
    """Groups of faces connected by corners, in their order."""
    groups = linked((face[0], other) for face in faces for other in face)
    group_of = {corner: number for number, group in enumerate(groups) for corner in group}
    found: dict[int, Faces] = {}
    for face in faces:
        found.setdefault(group_of[face[0]], []).append(face)
    return list(found.values())


def linked(pairs: Iterable[tuple[T, T]]) -> list[list[T]]:
    """Groups of members connected by pairs, in the order in which the pairs name them."""
    root: dict[T, T] = {}

    def find(member: T) -> T:
        while root.setdefault(member, member) != member:
            root[member] = member = root[root[member]]
        return member

    for a, b in pairs:
        root[find(b)] = find(a)
    together: dict[T, list[T]] = {}
    for member in list(root):
        together.setdefault(find(member), []).append(member)
    return list(together.values())


# --- formats ---


def _obj(path: str) -> list[_Named]:
    file = obj_file.read(path)
    objects = set(file.objects)
    return _by_name(file.points, file.faces, file.groups if objects == {obj_file.NAMELESS} else file.objects)


def _stl(path: str) -> list[_Named]:
    file = stl_file.read(path)
    ends = [*(first for _, first in file.solids[1:]), len(file.points)]
    bodies = [(name, file.points[first:end]) for (name, first), end in zip(file.solids, ends, strict=True)]
    return [_Named(name, points, stl_file.triangles_of(points)) for name, points in bodies if len(points)]


def _by_name(points: np.ndarray, faces: Faces, names: list[str]) -> list[_Named]:
    """The faces of each name, with names in order of appearance."""
    found: dict[str, Faces] = {}
    for name, face in zip(names, faces, strict=True):
        found.setdefault(name, []).append(face)
    return [_with_its_corners(_Named(name, points, own)) for name, own in found.items()]


def _gltf(path: str) -> list[_Named]:
    return [
        _Named(name, corners, list(map(tuple, triangles.tolist()))) for name, corners, triangles in gltf_file.read(path)
    ]


def _compas(path: str) -> list[_Named]:
    return [_Named(*block) for block in compas_file.read(path)]
