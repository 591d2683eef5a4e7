"""Measured force-displacement curves out of CSV files, to be laid over simulated ones.

The first line that is no remark (``#``) names the columns with their units:

    displacement [mm],force [N]
    0.00,0
    0.12,85.3

Columns may come in any order; others, such as time, are left out. See `scenario.csv_tables`.
"""

from __future__ import annotations

import os
from typing import NamedTuple

import numpy as np

from dembrick.scenario.csv_tables import read_columns


class MeasuredCurve(NamedTuple):
    """A curve from the laboratory: its name, ``displacement`` (k,) m, ``load`` (k,) N."""

    name: str
    displacement: np.ndarray
    load: np.ndarray


def read_measured(path: str | os.PathLike, name: str | None = None) -> MeasuredCurve:
    """Read a curve; ``name`` is the file's own without one.

    Raises ScenarioError, with the line, for columns, units or values that are not those of the format.
    """
    found, _ = read_columns(path, "a measured curve", ("displacement", "force"))
    stem = os.path.splitext(os.path.basename(os.fspath(path)))[0]
    return MeasuredCurve(name or stem, found["displacement"], found["force"])
