"""One case of a study, from the base scenario and its changes to a row of plain values, its only input and output."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from dembrick.errors import DembrickError, UndecidedError
from dembrick.runs.simulate import failure, simulate
from dembrick.runs.study.together import limit_loads
from dembrick.scenario import toml as scenarios
from dembrick.scenario.model import Scenario
from dembrick.views.summary import part, path_dependence_unknown

_YES_OR_NO: dict[Any, str] = {True: "true", False: "false"}
# Column, and path of its value in the JSON object of a run (a dot goes one level down, a number into a list), or a
# function that makes the value from that object.
COLUMNS: dict[str, str | Callable[[dict], Any]] = {
    "status": "status",
    "V": "yield_point.V",
    "V_lower": "yield_point.V_lower",
    "V_upper": "yield_point.V_upper",
    "bracket": "yield_point.bracket",
    "V_peak": "yield_point.V_peak",
    "load_unit": "load_unit",
    "V_1": "yield_point.V_1",
    "V_2": "yield_point.V_2",
    "M_T": "yield_point.M_T",
    "N": "yield_point.N",
    "torsion_centre_1": "yield_point.torsion_centre.0",
    "torsion_centre_2": "yield_point.torsion_centre.1",
    "displacement": "yield_point.displacement",
    "mechanism": "yield_point.mechanism",
    "blocks": lambda result: None if result.get("blocks") is None else " ".join(result["blocks"]),
    "path_dependent": lambda result: _YES_OR_NO.get(result.get("path_dependent")),
    "associative": "associative",
    "digits_open": lambda result: _YES_OR_NO[path_dependence_unknown(part(result, "collapse") or part(result, "path"))],
    "collapse_angle": "collapse.angle",
    "collapse_load_factor": "collapse.load_factor",
    "collapse_displacement": "collapse.displacement",
    "collapse_mechanism": "collapse.mechanism",
    "theory": "theory.V",
    "error_vs_theory": "theory.error",
    "steps": "steps",
    "loop": "wall.loop",
    "history": "history",
    "greatest_displacement": lambda result: max((result.get("greatest_displacement") or {}).values(), default=None),
    "fallen": lambda result: None if result.get("fallen") is None else len(result["fallen"]),
    "error": "error",
}
TEXTS = (
    "status",
    "searched",
    "bracket",
    "load_unit",
    "mechanism",
    "blocks",
    "path_dependent",
    "digits_open",
    "collapse_mechanism",
    "history",
    "remark",
    "error",
)
FAILED = "failed"
UNANSWERED = (FAILED, UndecidedError.status)


def run_cases(base: str, base_path: str, cases: Sequence[tuple[int, Mapping[str, Any], str | None]]) -> list[dict]:
    """The rows of several cases, each given as (number, changes, history): the TOML text ``base`` with its changes.

    A case that fails also gets a row, with the status "failed" or "undecided" and the error.
    """
    scenarios_: list[Scenario | DembrickError] = []
    for _, changes, _ in cases:
        try:
            scenarios_.append(scenarios.varied(base, base_path, changes))
        except DembrickError as error:
            scenarios_.append(error)
    alike = {i: one for i, one in enumerate(scenarios_) if isinstance(one, Scenario) and cases[i][2] is None}
    numbers, together = list(alike), limit_loads(list(alike.values()))
    results = {numbers[i]: result for i, result in together.items()}
    rows = []
    for i, (number, changes, history) in enumerate(cases):
        result = results.get(i) or _alone(scenarios_[i], history)
        rows.append({"case": number, **changes} | {name: _at(result, path) for name, path in COLUMNS.items()})
    return rows


def _alone(scenario: Scenario | DembrickError, history: str | None) -> dict[str, Any]:
    """The JSON object of a run by itself."""
    if not isinstance(scenario, Scenario):
        return {"status": FAILED, "error": str(scenario)}
    try:
        result = simulate(scenario, history, force=True, record=history is not None)
        return result.as_dict() | {"load_unit": None if result.curve.load is None else result.curve.unit}
    except DembrickError as error:
        return failure(scenario, error, history)


def _at(result: Any, path: str | Callable[[dict], Any]) -> Any:
    if not isinstance(path, str):
        return path(result)
    for name in path.split("."):
        if result is None:
            return None
        result = result[int(name)] if isinstance(result, list | tuple) else result.get(name)
    return result
