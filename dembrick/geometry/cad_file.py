"""Solids from CAD: many of them in one file, with their names. OBJ, STL, glTF, COMPAS JSON, and what meshio reads.

Objects (``o``) of an OBJ file are solids, or its groups (``g``) where it has no objects; so are the named solids of a
text STL file, the nodes of a glTF scene and the blocks of a COMPAS assembly. Within each, and in files that name
nothing, a solid ends where its surface is closed. Every solid is checked as :mod:`dembrick.geometry.mesh_file` says,
and one that is not convex is cut into parts that bear its name.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from typing import NamedTuple, TypeVar

import numpy as np

from dembrick.errors import ScenarioError
from dembrick.geometry import compas_file, gltf_file, mesh_file
from dembrick.geometry.shapes import Polyhedron

ENDINGS = (".obj", ".stl", ".gltf", ".glb", ".json", ".ply", ".msh", ".vtu")
LARGEST_FILE = 64 << 20  # bytes
MOST_SOLIDS = 20_000

Faces = list[tuple[int, ...]]
T = TypeVar("T")


class Solid(NamedTuple):
    """A convex polyhedron of a file, a solid or a part of one: the ``name`` of the solid there, whether the file says
    that it is a support, its ``shape``."""

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
    """The solids of a file in its order, lengths times ``scale`` in metres; equal names get numbers.

    The convex parts of a solid that is not convex follow one another under its name.

    Raises ScenarioError for a file that cannot be read and for a solid that is no block.
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
                f"{path}: solid {solid.name!r} is hollow: a closed part of its surface lies inside another; a block is "
                "full, so cut it into pieces around the hollow and join them by united"
            )
        found += parts
    if not found:
        raise ScenarioError(f"{path}: there is no surface in the file; every block needs one that is closed")
    if len(found) > MOST_SOLIDS:
        raise ScenarioError(f"{path}: it holds {len(found)} solids; at most {MOST_SOLIDS} are taken")
    solids = []
    for name, part in zip(_different([part.name for part in found]), found, strict=True):
        try:
            shapes = mesh_file.checked(part.points * scale, part.faces)
        except ScenarioError as error:
            raise ScenarioError(f"{path}: solid {name!r}: {error}") from None
        solids += [Solid(name, part.fixed, shape) for shape in shapes]
    return solids


def _different(names: list[str]) -> list[str]:
    """The names, with a number at each that is there several times."""
    taken: dict[str, int] = {}
    several = {name for name in names if names.count(name) > 1} if len(set(names)) < len(names) else set()
    found = []
    for name in names:
        taken[name] = taken.get(name, 0) + 1
        found.append(f"{name}.{taken[name]}" if name in several else name)
    return found


def _closed_parts(solid: _Named) -> Iterator[_Named]:
    """The closed surfaces that a solid of a file is made of, each with the corners that it uses.

    Parts that share no corner are apart, whatever the order of their faces. Of those that touch, as bodies in an STL
    file do, one ends with the face that closes it. What never closes is handed on whole, to be refused by name.
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
        if begun and len(begun) < len(together):  # the order of the faces tells no solids
            parts = [*parts[: -1 if parts else None], together]
        elif begun:
            parts.append(begun)
    for faces in parts:
        used, local = np.unique(np.concatenate([np.array(face) for face in faces]), return_inverse=True)
        ends = np.cumsum([0, *map(len, faces)])
        own = [tuple(local.reshape(-1)[a:b].tolist()) for a, b in zip(ends[:-1], ends[1:], strict=True)]
        yield _Named(solid.name, points[used], own, solid.fixed)


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
    """Whether a closed surface goes round a ``point`` (3,), by the solid angle under which it is seen from there (van
    Oosterom and Strackee, IEEE Trans. Biomed. Eng. 30 (1983) 125)."""
    corners = np.array([(face[0], *face[i : i + 2]) for face in part.faces for i in range(1, len(face) - 1)])
    a, b, c = np.moveaxis(part.points[corners] - point, 1, 0)
    lengths = [np.linalg.norm(arm, axis=1) for arm in (a, b, c)]
    products = [(p * q).sum(axis=1) * lengths[r] for p, q, r in ((a, b, 2), (b, c, 0), (c, a, 1))]
    angle = 2.0 * np.arctan2((a * np.cross(b, c)).sum(axis=1), np.prod(lengths, axis=0) + sum(products)).sum()
    return abs(angle) > 2.0 * np.pi


def _connected(faces: Faces) -> list[Faces]:
    """Faces that hang together by corners, in their order."""
    groups = linked((face[0], other) for face in faces for other in face)
    group_of = {corner: number for number, group in enumerate(groups) for corner in group}
    found: dict[int, Faces] = {}
    for face in faces:
        found.setdefault(group_of[face[0]], []).append(face)
    return list(found.values())


def linked(pairs: Iterable[tuple[T, T]]) -> list[list[T]]:
    """Groups of members that hang together through pairs, in the order in which the pairs name them."""
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


def _text(path: str) -> str:
    try:
        with open(path, encoding="utf-8", errors="replace") as file:
            return file.read()
    except OSError as error:
        raise ScenarioError(f"{path}: it cannot be read ({error.strerror})") from None


def _obj(path: str) -> list[_Named]:
    points: list[list[float]] = []
    by_object: dict[str, Faces] = {}
    by_group: dict[str, Faces] = {}
    name = group = "solid"
    for number, line in enumerate(_text(path).replace("\\\n", " ").splitlines(), 1):
        word, _, rest = line.strip().partition(" ")
        try:
            if word == "v":
                points.append([float(x) for x in rest.split()[:3]])
            elif word == "o":
                name = rest.strip() or "solid"
            elif word == "g":
                group = rest.strip() or "solid"
            elif word == "f":
                corners = [int(part.split("/")[0]) for part in rest.split()]
                face = tuple(i - 1 if i > 0 else len(points) + i for i in corners)
                if len(face) < 3 or min(face) < 0 or max(face) >= len(points):
                    raise ValueError("a face has fewer than three corners, or names one that is not there")
                by_object.setdefault(name, []).append(face)
                by_group.setdefault(group, []).append(face)
        except ValueError as error:
            raise ScenarioError(f"{path}: line {number} cannot be read as OBJ: {error}") from None
    if any(len(point) != 3 for point in points):
        raise ScenarioError(f"{path}: a corner has fewer than three coordinates")
    found = by_object if len(by_object) > 1 or "solid" not in by_object else by_group
    return [_Named(own, np.array(points), faces) for own, faces in found.items()]


_SOLID = re.compile(r"^[ \t]*solid\b[ \t]*(.*?)[ \t]*$(.*?)^[ \t]*endsolid\b", re.MULTILINE | re.DOTALL)
_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corner", "<f4", (3, 3)), ("attribute", "<u2")])


def _stl(path: str) -> list[_Named]:
    with open(path, "rb") as file:
        data = file.read()
    count = int.from_bytes(data[80:84], "little") if len(data) >= 84 else -1
    if len(data) == 84 + _TRIANGLE.itemsize * count:
        found = [("solid", np.frombuffer(data, _TRIANGLE, offset=84)["corner"].reshape(-1, 3).astype(float))]
    else:
        text = data.decode("utf-8", "replace")
        try:
            found = [(name or "solid", _vertices(body)) for name, body in _SOLID.findall(text)]
        except ValueError:
            raise ScenarioError(f"{path}: a vertex of it has no three numbers, so it cannot be read as STL") from None
        if not found:
            raise ScenarioError(f"{path}: it is neither a binary STL file, whose length would fit, nor one of text")
    solids = []
    for name, corners in found:
        if len(corners) % 3 or corners.shape[1:] != (3,):
            raise ScenarioError(f"{path}: solid {name!r} has a triangle without three corners")
        faces = [(i, i + 1, i + 2) for i in range(0, len(corners), 3)]
        solids.append(_Named(name, corners, faces))
    return solids


def _vertices(text: str) -> np.ndarray:
    """The corners (n, 3) of the triangles in the text of a solid."""
    return np.array([line.split()[1:4] for line in text.splitlines() if "vertex" in line], float)


def _gltf(path: str) -> list[_Named]:
    return [
        _Named(name, corners, list(map(tuple, triangles.tolist()))) for name, corners, triangles in gltf_file.read(path)
    ]


def _compas(path: str) -> list[_Named]:
    return [_Named(*block) for block in compas_file.read(path)]
