"""STL: triangles, in binary or text form; the text form also names the solid of each."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dembrick.errors import ScenarioError

NAMELESS = "solid"  # name of the solid of triangles outside of any named one
TRIANGLE = np.dtype([("normal", "<f4", 3), ("corner", "<f4", (3, 3)), ("attribute", "<u2")])
_HEADER = 84  # bytes: 80 arbitrary ones, then the number of triangles
_PADDING = b"\0 \t\r\n"  # allowed after the triangles


class StlFile(NamedTuple):
    """An STL file: ``points`` (3 n, 3), three per triangle; ``solids``, names with the index of their first point."""

    points: np.ndarray
    solids: list[tuple[str, int]]


def read(path: str) -> StlFile:
    """All triangles of a file. It is binary if its length agrees with its number of triangles, whatever its first bytes
    are. Raises ScenarioError for a file that is neither binary nor complete text."""
    try:
        with open(path, "rb") as file:
            data = file.read()
    except OSError as error:
        raise ScenarioError(f"{path}: it cannot be read ({error.strerror})") from None
    count = int.from_bytes(data[80:_HEADER], "little") if len(data) >= _HEADER else -1
    end = _HEADER + TRIANGLE.itemsize * count
    if count >= 0 and len(data) >= end and not data[end:].strip(_PADDING):
        triangles = np.frombuffer(data, TRIANGLE, count, _HEADER)
        return StlFile(triangles["corner"].reshape(-1, 3).astype(float), [(NAMELESS, 0)])
    return _of_text(path, data.decode("utf-8-sig", "replace"))


def _of_text(path: str, text: str) -> StlFile:
    """Parse the text form; keywords may be in capitals, and line ends of any kind."""
    points: list[list[float]] = []
    solids: list[tuple[str, int]] = []
    triangles, name = 0, None  # complete triangles, and the current solid
    for number, line in enumerate(text.replace("\r\n", "\n").replace("\r", "\n").split("\n"), 1):
        word, rest = (*line.split(None, 1), "", "")[:2]
        word = word.lower()
        if word == "solid":
            name = rest.strip() or NAMELESS
            solids.append((name, len(points)))
        elif name is None:
            continue
        elif word == "vertex":
            points.append(_vertex(path, number, rest))
        elif word in ("endfacet", "endsolid"):
            triangles += word == "endfacet"
            if len(points) != 3 * triangles:
                raise ScenarioError(f"{path}: solid {name!r} has a triangle without three corners above line {number}")
            name = None if word == "endsolid" else name
    if not points:
        raise ScenarioError(f"{path}: it is neither a binary STL file (its length does not fit) nor a text one")
    if name is not None:
        raise ScenarioError(f"{path}: it ends within solid {name!r}, so it is incomplete; export it again")
    return StlFile(np.array(points), solids)


def _vertex(path: str, number: int, rest: str) -> list[float]:
    """The corner in a line of text."""
    try:
        found = [float(x) for x in rest.split()[:3]]
    except ValueError:
        found = []
    if len(found) != 3:
        raise ScenarioError(
            f"{path}: the vertex in line {number} does not have three numbers, so it cannot be read as STL"
        )
    return found


def triangles_of(points: np.ndarray) -> list[tuple[int, ...]]:
    """Triangles as triples of indices, for points listed three per triangle."""
    return [(i, i + 1, i + 2) for i in range(0, len(points), 3)]
