"""One case of a study, from the base scenario and its changes to a row of plain values: nothing else goes in or out."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from typing import Any

from dembrick import scenario as scenarios
from dembrick.errors import DembrickError
from dembrick.result import failure, simulate

# Column, and where its value stands in the JSON object of a run; a dot goes one level down, a number into a list.
COLUMNS = {
    "status": "status",
    "V": "yield_point.V",
    "V_lower": "yield_point.V_lower",
    "V_upper": "yield_point.V_upper",
    "bracket": "yield_point.bracket",
    "V_peak": "yield_point.V_peak",
    "V_1": "yield_point.V_1",
    "V_2": "yield_point.V_2",
    "M_T": "yield_point.M_T",
    "N": "yield_point.N",
    "torsion_centre_1": "yield_point.torsion_centre.0",
    "torsion_centre_2": "yield_point.torsion_centre.1",
    "displacement": "yield_point.displacement",
    "mechanism": "yield_point.mechanism",
    "collapse_angle": "collapse.angle",
    "collapse_load_factor": "collapse.load_factor",
    "collapse_displacement": "collapse.displacement",
    "collapse_mechanism": "collapse.mechanism",
    "theory": "theory.V",
    "error_vs_theory": "theory.error",
    "steps": "steps",
    "loop": "wall.loop",
    "history": "history",
    "error": "error",
}
TEXTS = ("status", "bracket", "mechanism", "collapse_mechanism", "history", "error")
FAILED = "failed"


def run_case(base: str, base_path: str, number: int, changes: Mapping[str, Any], history: str | None = None) -> dict:
    """Run case ``number`` of a study: the TOML text ``base`` with ``changes``; returns its row.

    A case that fails is a row too, with the status "failed" and the error.
    """
    row: dict[str, Any] = {"case": number, **changes}
    try:
        scenario = scenarios.varied(base, base_path, changes)
    except DembrickError as error:
        return row | _columns({"status": FAILED, "error": str(error)})
    try:
        result = simulate(scenario, history, force=True, record=history is not None).as_dict()
    except DembrickError as error:
        result = failure(scenario, error, history)
    return row | _columns(result)


def run_cases(base: str, base_path: str, cases: Iterable[tuple[int, Mapping[str, Any], str | None]]) -> list[dict]:
    """The rows of several cases, each given as (number, changes, history)."""
    os.environ.setdefault("NUMBA_NUM_THREADS", "1")  # workers share the cores among them, not each with all others
    return [run_case(base, base_path, *case) for case in cases]


def _columns(result: Mapping) -> dict[str, Any]:
    return {name: _at(result, path) for name, path in COLUMNS.items()}


def _at(result: Any, path: str) -> Any:
    for part in path.split("."):
        if result is None:
            return None
        result = result[int(part)] if isinstance(result, list | tuple) else result.get(part)
    return result
