"""Measured force-displacement curves out of CSV files, to be laid over simulated ones.

The first line that is no remark (``#``) names two columns with their units:

    displacement [mm],force [N]
    0.00,0
    0.12,85.3

Names: ``displacement``; ``force`` or ``load``. Units: m, mm, um or µm; N or kN. Columns may come in any order, divided
by commas, semicolons or tabs; decimals have a point (between semicolons or tabs a comma will do).
"""

from __future__ import annotations

import csv
import math
import os
import re
from typing import NamedTuple

import numpy as np

from dembrick.errors import ScenarioError

_UNITS = {
    "displacement": {"m": 1.0, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "μm": 1e-6},  # both signs that stand for micro
    "force": {"N": 1.0, "kN": 1e3},
}
_SAME = {"displacement": "displacement", "force": "force", "load": "force"}
_HEADER = re.compile(r"\s*([^\[\]]*?)\s*\[\s*([^\[\]]*?)\s*\]\s*")
_EXAMPLE = 'write a header such as "displacement [mm],force [N]"'
_MOST_BYTES = 100 << 20


class MeasuredCurve(NamedTuple):
    """A curve from the laboratory: its name, ``displacement`` (k,) m, ``load`` (k,) N."""

    name: str
    displacement: np.ndarray
    load: np.ndarray


def read_measured(path: str | os.PathLike, name: str | None = None) -> MeasuredCurve:
    """Read a curve; ``name`` is the file's own without one.

    Raises ScenarioError, with the line, for columns, units or values that are not those of the format.
    """
    path = os.fspath(path)
    try:
        if os.path.getsize(path) > _MOST_BYTES:
            raise ScenarioError(f"{path}: {_MOST_BYTES >> 20} MB is the most that a measured curve may have; thin it")
        with open(path, encoding="utf-8-sig", newline="") as file:
            lines = file.read().splitlines()
    except OSError as error:
        raise ScenarioError(f"{path}: the measured curve cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise ScenarioError(f"{path}: this is no text in UTF-8; save the measured curve as CSV") from error
    numbered = [(i, line) for i, line in enumerate(lines, 1) if line.strip() and not line.lstrip().startswith("#")]
    if not numbered:
        raise ScenarioError(f"{path}: the file is empty; {_EXAMPLE}")
    header = numbered[0][1]
    divider = next((sign for sign in ("\t", ";") if sign in header), ",")
    columns = _columns(path, next(csv.reader([header], delimiter=divider)))
    values: dict[str, list[float]] = {kind: [] for kind in _UNITS}
    for i, line in numbered[1:]:
        try:
            cells = next(csv.reader([line], delimiter=divider))
        except csv.Error as error:
            raise ScenarioError(f"{path}, line {i}: {error}") from error
        if len(cells) != len(columns):
            raise ScenarioError(f"{path}, line {i}: {len(cells)} values for {len(columns)} columns")
        for cell, (kind, factor) in zip(cells, columns, strict=True):
            values[kind].append(factor * _value(path, i, kind, cell if divider == "," else cell.replace(",", ".")))
    if len(numbered) < 3:
        raise ScenarioError(f"{path}: a curve needs at least two points below its header")
    stem = os.path.splitext(os.path.basename(path))[0]
    return MeasuredCurve(name or stem, np.array(values["displacement"]), np.array(values["force"]))


def _columns(path: str, titles: list[str]) -> list[tuple[str, float]]:
    """What each column is, and its unit in SI."""
    columns = []
    for title in titles:
        found = _HEADER.fullmatch(title)
        if not found:
            raise ScenarioError(f"{path}: the column {title.strip()!r} has no unit in brackets; {_EXAMPLE}")
        name, unit = found.groups()
        kind = _SAME.get(name.lower())
        if kind is None:
            raise ScenarioError(f"{path}: the column {name!r} is unknown; use {', '.join(_SAME)}, and leave others out")
        if unit not in _UNITS[kind]:
            known = ", ".join(u for u in _UNITS[kind] if u != "μm")
            raise ScenarioError(f"{path}: the unit {unit!r} of the column {name!r} is unknown; use one of {known}")
        columns.append((kind, _UNITS[kind][unit]))
    kinds = [kind for kind, _ in columns]
    if sorted(kinds) != sorted(_UNITS):
        raise ScenarioError(f"{path}: one column of displacement and one of force are needed; {_EXAMPLE}")
    return columns


def _value(path: str, line: int, kind: str, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ScenarioError(f"{path}, line {line}: the {kind} {cell.strip()!r} is no finite number")
    return value
