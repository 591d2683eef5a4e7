"""COMPAS JSON: the blocks of an assembly or a model, which are its meshes, in the places where its parts put them."""

from __future__ import annotations

import json
from typing import Any, NamedTuple

import numpy as np

from dembrick.errors import ScenarioError

PASSED = ("block", "data", "graph", "node", "geometry", "part")  # keys that name no block


class Block(NamedTuple):
    """A block of the file: its ``name``, corners (n, 3), faces, and whether it is a support."""

    name: str
    points: np.ndarray
    faces: list[tuple[int, ...]]
    fixed: bool


class _Part(NamedTuple):
    """A part of the document that is still to be looked at, and what those around it say of it."""

    name: str
    fixed: bool
    placed: np.ndarray  # (4, 4), to the axes of the file
    content: Any


def read(path: str) -> list[Block]:
    """Meshes of a file (all that has ``vertex`` and ``face``), by name or key. ScenarioError if it cannot be read.

    The ``transformation`` of an element moves its geometry, which is described in axes of its own.
    """
    found: list[Block] = []
    waiting = [_Part("solid", False, np.eye(4), _document(path))]
    while waiting:
        name, fixed, placed, content = waiting.pop()
        if isinstance(content, list):
            waiting += [_Part(str(i), fixed, placed, entry) for i, entry in reversed(list(enumerate(content)))]
        if not isinstance(content, dict):
            continue
        if content.get("is_support") is not None:
            fixed = content["is_support"]
            if not isinstance(fixed, bool):
                raise ScenarioError(
                    f"{path}: is_support of block {name!r} is {str(fixed)[:40]!r}; it must be true or false, "
                    "without quotation marks"
                )
        if content.get("transformation") is not None:
            placed = placed @ _matrix(path, name, content["transformation"])
        if isinstance(content.get("vertex"), dict) and isinstance(content.get("face"), dict) and content["face"]:
            found.append(_block(path, name, fixed, placed, content))
            continue
        for key, entry in reversed(list(content.items())):
            if key != "transformation":
                waiting.append(_Part(name if key in PASSED else str(key), fixed, placed, entry))
    if not found:
        raise ScenarioError(f"{path}: no block is in it; a COMPAS assembly has blocks with 'vertex' and 'face'")
    return found


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


def _matrix(path: str, name: str, given: Any) -> np.ndarray:
    """A transformation of the file as a matrix (4, 4)."""
    for key in ("data", "matrix"):
        given = given.get(key, given) if isinstance(given, dict) else given
    try:
        matrix = np.array(given, float)
    except (TypeError, ValueError, OverflowError):
        matrix = np.zeros(0)
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all() or matrix[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
        raise ScenarioError(
            f"{path}: the transformation of block {name!r} is no matrix of 4 x 4 numbers that ends with 0, 0, 0, 1"
        )
    return matrix


def _block(path: str, name: str, fixed: bool, placed: np.ndarray, block: dict[str, Any]) -> Block:
    try:
        number = {str(key): i for i, key in enumerate(block["vertex"])}
        defaults = block.get("default_vertex_attributes") or block.get("dva") or {}
        points = np.array(
            [
                [float(vertex.get(axis, defaults.get(axis, 0.0))) for axis in "xyz"]
                for vertex in block["vertex"].values()
            ]
        )
        faces = [tuple(number[str(i)] for i in face) for face in block["face"].values()]
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError) as error:
        raise ScenarioError(f"{path}: block {name!r} is damaged: {error!r}") from None
    own = (block.get("attributes") or {}).get("name")
    with np.errstate(all="ignore"):  # corners that are not finite are refused with the solid
        points = points @ placed[:3, :3].T + placed[:3, 3]
        if np.linalg.det(placed[:3, :3]) < 0.0:
            faces = [face[::-1] for face in faces]
    return Block(str(own) if own and own not in ("Block", "Mesh") else name, points, faces, fixed)
