"""Files that a scenario reads (meshes, time histories), stored in its history as bytes under their names.

A file may refer to others, as a glTF scene does; these are stored too, under their paths relative to its folder.
"""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dembrick.errors import HistoryError
from dembrick.history import guard
from dembrick.history.layout import Table, texts_of
from dembrick.scenario.files import companions_of, names_of

if TYPE_CHECKING:
    from dembrick.scenario.model import Scenario

_MOST = 10_000  # limit per history


class Input(NamedTuple):
    """One file: ``name`` in the scenario; ``place``, path relative to the folder of the file of that name; ``data``."""

    name: str
    place: str
    data: bytes


def inputs_of(scenario: Scenario) -> list[Input]:
    """The files that a scenario names and those that these refer to, except any that is not a regular file: no run
    reads it."""
    found = []
    for name in names_of(scenario):
        path = scenario.path_of(name)
        own = re.sub(r"[^\w.-]", "_", os.path.basename(path))
        beside = {place: os.path.join(os.path.dirname(path), place) for place in companions_of(path) if _inside(place)}
        for place, there in {own: path, **beside}.items():
            if os.path.isfile(there):
                with open(there, "rb") as file:
                    found.append(Input(name, place, file.read()))
    return found


def tables(inputs: Sequence[Input]) -> list[Table]:
    """The datasets that store the files in a history; none without files."""
    if not inputs:
        return []
    sizes = np.cumsum([0, *(len(one.data) for one in inputs)], dtype=np.int64)
    data = np.frombuffer(b"".join(one.data for one in inputs), np.uint8)
    return [
        Table("files/name", texts_of(one.name for one in inputs), "1", "name of each file, as in the scenario"),
        Table("files/place", texts_of(one.place for one in inputs), "1", "its path from the folder of that file"),
        Table("files/start", sizes.astype("<i8"), "1", "first byte of each file, and end"),
        Table("files/bytes", data, "1", "the files that the scenario reads, one after the other", packed=True),
    ]


def read_inputs(file) -> list[Input]:
    """The files in an open history; HistoryError if they do not match `tables`, or if a path leaves its folder."""
    if not guard.exists(file, "files"):
        return []
    names, places = (guard.texts(guard.dataset(file, f"files/{key}", "text", (None,))) for key in ("name", "place"))
    start = guard.values(guard.dataset(file, "files/start", "integer", (len(names) + 1,)))
    held = guard.dataset(file, "files/bytes", "integer", (None,))
    fits = len(places) == len(names) <= _MOST and held.dtype == np.uint8
    fits = fits and start[0] == 0 and start[-1] == len(held) and bool((np.diff(start) >= 0).all())
    if not fits or not all(_inside(place) for place in places):
        raise HistoryError(f"{file.filename}: the files of its scenario cannot be read; it was not written by dembrick")
    data = guard.values(held).tobytes()
    ends = zip(start[:-1].tolist(), start[1:].tolist(), strict=True)
    return [Input(name, place, data[a:b]) for name, place, (a, b) in zip(names, places, ends, strict=True)]


def unpacked(inputs: Iterable[Input]) -> Mapping[str, str]:
    """Write the files to a temporary folder that exists until this process ends; return their paths by name."""
    inputs = list(inputs)
    if not inputs:
        return {}
    folder = tempfile.TemporaryDirectory(prefix="dembrick-")
    _FOLDERS.append(folder)
    numbers = {name: str(i) for i, name in enumerate(dict.fromkeys(one.name for one in inputs))}
    paths: dict[str, str] = {}
    for one in inputs:
        path = os.path.join(folder.name, numbers[one.name], one.place)
        os.makedirs(os.path.dirname(path), exist_ok=True)
        with open(path, "wb") as file:
            file.write(one.data)
        paths.setdefault(one.name, path)  # the files that it refers to follow it
    return paths


_FOLDERS: list[tempfile.TemporaryDirectory] = []  # removed when the process ends


def _inside(place: str) -> bool:
    """Whether a path stays in its folder, on any system."""
    parts = place.split("/")
    return all(part and part.strip(". ") and not set(part) & set("\\:\0") for part in parts) and len(place) < 1000
