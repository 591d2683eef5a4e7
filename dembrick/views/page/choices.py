"""Choices offered to the reader of a page: the joint of the second diagram, and the record as a table to download."""

from __future__ import annotations

import base64
import os
import re
from typing import TYPE_CHECKING

import numpy as np

from dembrick.views.page import diagrams
from dembrick.views.plot.paths import JointPath, joint_path
from dembrick.views.plot.subject import joint_names

if TYPE_CHECKING:
    from dembrick.history.reader import History

MOST_JOINTS = 40
MOST_ROWS = 300  # of the table, and of the curves of joints that are not shown at first
_CARRIED = {"N": "N", "V_1": "N", "V_2": "N", "M_T": "N m", "slip": "m"}


def record(history: History) -> dict | None:
    """Time, load and displacement as columns in SI units; None if no row was recorded."""
    if not history.n_row:
        return None
    kept, curve = diagrams.thinned(history, MOST_ROWS), history.curve
    columns = [_column("equilibrium" if history.counts_equilibria else "time [s]", history.time[kept])]
    if curve.load is not None:
        columns.append(_column(f"{curve.load} [{'-' if curve.unit == '1' else curve.unit}]", history.load[kept]))
    columns.append(_column(f"{curve.displacement} [m]", history.displacement[kept]))
    name = re.sub(r"[^\w.-]+", "_", os.path.splitext(os.path.basename(history.path))[0]) or "record"
    return {"file": f"{name}.csv", "rows": len(kept), "columns": columns}


def joints(history: History, at: diagrams.Record, path: JointPath | None) -> list[dict]:
    """The joints to choose from, each with its forces and its diagram; the joint of ``path`` has its diagram elsewhere.

    If there are many joints, those that slip most.
    """
    if path is None:
        return []
    slip = history.joint("slip").max(axis=0)
    order = [j for j in np.argsort(-slip, kind="stable").tolist() if j != path.number]
    names, kept, found = joint_names(history), diagrams.thinned(history, MOST_ROWS), []
    series = {name: history.joint(name)[kept] for name in _CARRIED}
    for number in [path.number, *sorted(order[: MOST_JOINTS - 1])]:
        chart = None
        if number != path.number:
            chart = diagrams.yield_domain(history, at, joint_path(history, number), kept)
        columns = [
            _column(f"{name} of {names[number]} [{unit}]", series[name][:, number]) for name, unit in _CARRIED.items()
        ]
        found.append({"name": names[number], "columns": columns, "chart": chart})
    return found


def _column(name: str, values: np.ndarray) -> dict:
    return {"name": name, "values": packed(values, "<f8")}


def packed(values: np.ndarray, kind: str) -> str:
    """The bytes of an array as type ``kind``, little-endian, in base64."""
    return base64.b64encode(np.ascontiguousarray(values, kind).tobytes()).decode()
