"""OBJ: corners and plane faces with the object and group of each; textures, colours and normals are ignored."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from dembrick.errors import ScenarioError

NAMELESS = "solid"  # object and group of faces outside of any
_CURVED = ("surf", "bzp", "bsp", "cdc", "cdp")  # beginnings of statements of free-form surfaces


class ObjFile(NamedTuple):
    """An OBJ file: ``points`` (n, 3), and for each face its corners, its object and its group."""

    points: np.ndarray
    faces: list[tuple[int, ...]]
    objects: list[str]
    groups: list[str]


def read(path: str) -> ObjFile:
    """All faces of a file in order. ScenarioError names a line that cannot be read; free-form surfaces are refused."""
    points: list[list[float]] = []
    found = ObjFile(np.zeros((0, 3)), [], [], [])
    name = group = NAMELESS
    for number, line in _lines(_text(path)):
        word, rest = (*line.split(None, 1), "", "")[:2]
        entries = rest.partition("#")[0].split()
        try:
            if word == "v":
                points.append([float(x) for x in entries[:3]])
                if len(entries) < 3:
                    raise ValueError("a corner has fewer than three coordinates")
            elif word == "o":
                name = rest.strip() or NAMELESS
            elif word == "g":
                group = rest.strip() or NAMELESS
            elif word in ("f", "fo"):
                corners = [int(part.split("/")[0]) for part in entries]
                face = tuple(i - 1 if i > 0 else len(points) + i for i in corners)
                if len(face) < 3 or min(face) < 0 or max(face) >= len(points):
                    raise ValueError("a face has fewer than three corners, or names one that does not exist")
                found.faces.append(face)
                found.objects.append(name)
                found.groups.append(group)
            elif word in _CURVED:
                raise ValueError("it holds a curved surface; export meshes with plane faces")
        except ValueError as error:
            raise ScenarioError(f"{path}: line {number} cannot be read as OBJ: {error}") from None
    return found._replace(points=np.array(points).reshape(-1, 3))


def _text(path: str) -> str:
    try:
        with open(path, encoding="utf-8-sig", errors="replace") as file:
            return file.read()
    except OSError as error:
        raise ScenarioError(f"{path}: it cannot be read ({error.strerror})") from None


def _lines(text: str) -> Iterator[tuple[int, str]]:
    """The lines of a file; lines joined by a backslash are one, with the number of the first."""
    begun, first = "", 0
    for number, line in enumerate(text.split("\n"), 1):
        first = first or number
        begun += line.rstrip()
        if begun.endswith("\\"):
            begun = begun[:-1] + " "
            continue
        yield first, begun
        begun, first = "", 0
    if begun:
        yield first, begun
