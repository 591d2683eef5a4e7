"""Validation cases: measurements of a laboratory, the scenario of the test, and what was not known of it."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, fields, replace
from pathlib import Path

from dembrick.errors import ScenarioError
from dembrick.runs.verification.cases import of_names
from dembrick.scenario import shipped

UNITS = {"force": "kN", "force_at": "kN", "cycle_peaks": "kN", "threshold": "g", "speed_ratio": "1"}
OF_SERIES = ("title", "source", "inputs", "unknown")


@dataclass(frozen=True, slots=True)
class Case:
    """One test of a laboratory, in the unit of its ``quantity`` (a key of ``UNITS``).

    ``measured``: all values at that load; ``value``: the one that is compared, by default their mean. ``u_D``:
    uncertainty of the measurement, and ``scatter_of`` the case that it was taken from if this one has a single value.
    ``at``: displacement (m) at which V is read. ``key`` and ``between``: the key that is varied, and its two values.
    ``paths``: the error bar includes limits on other load paths. ``finding``: what the comparison shows.
    """

    name: str
    title: str
    source: str
    inputs: str
    unknown: str
    scenario: str
    load: str
    quantity: str
    measured: tuple[float, ...]
    set: tuple[str, ...] = ()
    value: float | None = None
    at: float | None = None
    key: str = ""
    between: tuple[float, ...] = ()
    paths: bool = False
    finding: str = ""
    quick: bool = False
    u_D: float = 0.0
    scatter_of: str = ""

    @property
    def unit(self) -> str:
        """Unit of the quantity."""
        return UNITS[self.quantity]

    @property
    def D(self) -> float:
        """The measured value that is compared."""
        return sum(self.measured) / len(self.measured) if self.value is None else self.value

    @property
    def path(self) -> Path:
        """The scenario file."""
        found = shipped.find(self.scenario)
        if found is None:
            raise ScenarioError(f"validation case {self.name!r}: no shipped scenario is called {self.scenario!r}")
        return found


def all_cases() -> dict[str, Case]:
    """Name -> case, in the order of the file, each with the uncertainty of its measurement."""
    path = shipped.folder() / shipped.VALIDATION / "cases.toml"
    document = tomllib.loads(path.read_text(encoding="utf-8"))
    return with_scatter([_case(entry, document["series"], path) for entry in document["case"]])


def chosen(names: list[str], quick: bool = False) -> list[Case]:
    """The cases of these names or beginnings of names, all if none is named; ``quick``: only those marked so."""
    return [case for case in of_names(names, all_cases(), "validation") if case.quick or not quick]


def with_scatter(cases: list[Case]) -> dict[str, Case]:
    """The cases by name with their ``u_D``: half the range of the measured values, or, for a single value, the largest
    relative one among the cases that have several."""
    own = {case.name: 0.5 * (max(case.measured) - min(case.measured)) for case in cases if len(case.measured) > 1}
    relative = {case.name: own[case.name] / abs(case.D) for case in cases if case.name in own}
    widest = max(relative, key=lambda name: relative[name], default="")
    found = {}
    for case in cases:
        if case.name in own:
            found[case.name] = replace(case, u_D=own[case.name])
        else:
            found[case.name] = replace(case, u_D=relative.get(widest, 0.0) * abs(case.D), scatter_of=widest)
    return found


def _case(entry: dict, series: dict, path: Path) -> Case:
    name = entry.get("name")
    known = {field.name for field in fields(Case)} - {*OF_SERIES, "u_D", "scatter_of"} | {"series", "inputs", "unknown"}
    for unknown in sorted(set(entry) - known):
        raise ScenarioError(f"{path}: case {name!r}: unknown key {unknown!r}")
    shared = {key: series[entry["series"]][key] for key in OF_SERIES}
    if "inputs" in entry:
        shared["inputs"] = entry["inputs"]
    if "unknown" in entry:
        shared["unknown"] += f"; {entry['unknown']}"
    own = {key: tuple(value) if isinstance(value, list) else value for key, value in entry.items() if key != "series"}
    case = Case(**{**own, **shared})
    if case.quantity not in UNITS:
        raise ScenarioError(f"{path}: case {name!r}: unknown quantity {case.quantity!r}")
    return case
