"""COMPAS JSON: the blocks of an assembly or a model, with the transformations of its parts applied.

A block is a mesh, a box or a polyhedron. Anything without corners and faces of its own, a sphere or a Brep, is refused.
"""

from __future__ import annotations

import json
from typing import Any, NamedTuple

import numpy as np

from dembrick.errors import ScenarioError

PASSED = ("block", "data", "value", "graph", "node", "geometry", "part")  # keys that do not name a block
BOUNDS = ("aabb", "obb")  # keys of bounding boxes
_HOLDERS = ("block", "geometry", "part")  # keys of parts that must be blocks
_FACELESS = ("Sphere", "Cylinder", "Cone", "Capsule", "Torus", "Brep", "NurbsSurface", "VolMesh", "CellNetwork")  # ends
_BOX = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))


class Block(NamedTuple):
    """A block of the file: its ``name``, corners (n, 3), faces, and whether it is a support."""

    name: str
    points: np.ndarray
    faces: list[tuple[int, ...]]
    fixed: bool


class _Part(NamedTuple):
    """A part of the document still to be visited, with the properties inherited from the parts around it."""

    name: str
    fixed: bool
    placed: np.ndarray  # (4, 4), transformation to the axes of the file
    holder: int  # index of the innermost part around it that must contain a block, -1 if there is none
    content: Any


class _Holder(NamedTuple):
    """A part that must contain a block: its name, its type if stated, and the index of the holder around it."""

    name: str
    kind: str
    around: int


def read(path: str) -> list[Block]:
    """Blocks of a file, by name or key: everything that has ``vertex`` and ``face`` (a mesh), ``vertices`` and
    ``faces`` (a polyhedron), or ``xsize``, ``ysize`` and ``zsize`` (a box). ScenarioError if the file or a block cannot
    be read.

    The ``transformation`` of an element applies to its geometry, which is given in local axes.
    """
    found: list[Block] = []
    holders: list[_Holder] = []
    full: set[int] = set()
    waiting = [_Part("solid", False, np.eye(4), -1, _document(path))]
    while waiting:
        name, fixed, placed, holder, content = waiting.pop()
        if isinstance(content, list):
            parts = [_Part(str(i), fixed, placed, holder, entry) for i, entry in enumerate(content)]
            waiting += reversed(parts)
        if not isinstance(content, dict):
            continue
        kind = _kind(content)
        if kind.endswith(_FACELESS):
            raise ScenarioError(_no_block(path, name, kind))
        fixed = _is_support(path, name, content, fixed)
        if content.get("transformation") is not None:
            placed = placed @ _matrix(path, name, content["transformation"])
        surface = _surface(path, name, content)
        if surface is not None:
            found.append(_block(_own_name(content) or name, fixed, placed, *surface))
            while holder >= 0:
                full.add(holder)
                holder = holders[holder].around
            continue
        for key, entry in reversed(list(content.items())):
            if key == "transformation" or key in BOUNDS:
                continue
            if key == "features" and entry:
                raise ScenarioError(
                    f"{path}: block {name!r} has features that change its shape; save the resulting mesh instead"
                )
            below = holder
            if key in _HOLDERS and isinstance(entry, dict) and entry:
                below = len(holders)
                holders.append(_Holder(name, _kind(entry), holder))
            waiting.append(_Part(name if key in PASSED else str(key), fixed, placed, below, entry))
    for number, part in enumerate(holders):
        if number not in full:
            raise ScenarioError(_no_block(path, part.name, part.kind))
    if not found:
        raise ScenarioError(f"{path}: it contains no block; a COMPAS assembly has blocks with 'vertex' and 'face'")
    return found


def _kind(content: dict[str, Any]) -> str:
    """The type that a part states, without its package."""
    return str(content.get("dtype") or "").rpartition("/")[2][:40]


def _no_block(path: str, name: str, kind: str) -> str:
    """Message about a block without corners and faces."""
    what = f"is of type {kind!r} and" if kind else "is empty: it"
    return (
        f"{path}: block {name!r} {what} has no corners and faces; put its mesh into the assembly instead "
        "(Mesh.from_shape of a shape, the tessellation of a Brep)"
    )


def _is_support(path: str, name: str, content: dict[str, Any], before: bool) -> bool:
    """Whether a part is a support: its own statement, else that of the parts around it, ``before``."""
    given = content.get("is_support")
    if given is None:
        return before
    if not isinstance(given, bool):
        raise ScenarioError(
            f"{path}: is_support of block {name!r} is {str(given)[:40]!r}; it must be true or false, "
            "without quotation marks"
        )
    return given


def _document(path: str) -> dict[str, Any]:
    try:
        with open(path, "rb") as file:
            document = json.loads(file.read())
    except (ValueError, RecursionError) as error:
        raise ScenarioError(f"{path}: it cannot be read as COMPAS JSON: {error}") from None
    except OSError as error:
        raise ScenarioError(f"{path}: it cannot be read ({error.strerror})") from None
    if not isinstance(document, dict):
        raise ScenarioError(f"{path}: it cannot be read as COMPAS JSON: it is not a table of keys")
    return document


def _bare(given: Any) -> Any:
    """The data of a part, without the table that states its type."""
    for key in ("data", "value"):
        given = given.get(key, given) if isinstance(given, dict) else given
    return given


def _matrix(path: str, name: str, given: Any) -> np.ndarray:
    """Convert a transformation of the file to a matrix (4, 4)."""
    given = _bare(given)
    try:
        matrix = np.array(given.get("matrix", given) if isinstance(given, dict) else given, float)
    except (TypeError, ValueError, OverflowError):
        matrix = np.zeros(0)
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all() or matrix[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
        raise ScenarioError(
            f"{path}: the transformation of block {name!r} is not a matrix of 4 x 4 numbers that ends with 0, 0, 0, 1"
        )
    return matrix


def _surface(path: str, name: str, content: dict[str, Any]) -> tuple[np.ndarray, list[tuple[int, ...]]] | None:
    """Corners (n, 3) and faces of a part that is a block; None for other parts."""
    if isinstance(content.get("vertex"), dict) and isinstance(content.get("face"), dict) and content["face"]:
        reader = _mesh
    elif isinstance(content.get("vertices"), list) and isinstance(content.get("faces"), list):
        reader = _polyhedron
    elif all(f"{axis}size" in content for axis in "xyz"):
        reader = _box
    else:
        return None
    try:
        points, faces = reader(content)
        if points.shape[1:] != (3,):
            raise ValueError("a corner must have three coordinates")
    except (AttributeError, IndexError, KeyError, TypeError, ValueError, OverflowError) as error:
        raise ScenarioError(f"{path}: block {name!r} is damaged: {error!r}") from None
    return points, faces


def _mesh(block: dict[str, Any]) -> tuple[np.ndarray, list[tuple[int, ...]]]:
    number = {str(key): i for i, key in enumerate(block["vertex"])}
    defaults = block.get("default_vertex_attributes") or block.get("dva") or {}
    points = [
        [float(vertex.get(axis, defaults.get(axis, 0.0))) for axis in "xyz"] for vertex in block["vertex"].values()
    ]
    return np.array(points), [tuple(number[str(i)] for i in face) for face in block["face"].values()]


def _polyhedron(block: dict[str, Any]) -> tuple[np.ndarray, list[tuple[int, ...]]]:
    points = np.array([_bare(vertex) for vertex in block["vertices"]], float)
    number = {i: i for i in range(len(points))}
    return points, [tuple(number[i] for i in face) for face in block["faces"]]


def _box(block: dict[str, Any]) -> tuple[np.ndarray, list[tuple[int, ...]]]:
    """Corners and faces of a box about the origin of its frame, whose second axis need not be exactly orthogonal."""
    half = np.array([0.5 * float(block[f"{axis}size"]) for axis in "xyz"])
    frame = _bare(block.get("frame")) or {"point": (0.0,) * 3, "xaxis": (1.0, 0.0, 0.0), "yaxis": (0.0, 1.0, 0.0)}
    middle, first, near = (np.array(_bare(frame[key]), float) for key in ("point", "xaxis", "yaxis"))
    third = np.cross(first, near)
    axes = np.stack([first, np.cross(third, first), third])
    lengths = np.linalg.norm(axes, axis=1, keepdims=True)
    if not (lengths > 0.0).all():
        raise ValueError("the axes of its frame span no plane")
    signs = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)])
    return middle + (signs * half) @ (axes / lengths), list(_BOX)


def _own_name(block: dict[str, Any]) -> str:
    """The name that a block states; empty if it has none."""
    own = (block.get("attributes") or {}).get("name")
    return str(own) if own and own not in ("Block", "Mesh") else ""


def _block(name: str, fixed: bool, placed: np.ndarray, points: np.ndarray, faces: list[tuple[int, ...]]) -> Block:
    with np.errstate(all="ignore"):  # corners that are not finite are refused when the solid is checked
        points = points @ placed[:3, :3].T + placed[:3, 3]
        if np.linalg.det(placed[:3, :3]) < 0.0:
            faces = [face[::-1] for face in faces]
    return Block(name, points, faces, fixed)
