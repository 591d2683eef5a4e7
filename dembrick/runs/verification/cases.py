"""Verification cases: a scenario, the quantity read from its answer, the reference value, and its source."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TypeVar

from dembrick.errors import ScenarioError
from dembrick.scenario import shipped
from dembrick.scenario.checks import nearest

UNITS = {
    "V": "N",
    "load_factor": "1",
    "angle": "deg",
    "displacement": "m",
    "angle_at_displacement": "deg",
    "stands": "1",
    "reaction": "N",
    "settlement": "m",
}
RELATIONS = ("equal", "at most")
T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Case:
    """One verification case.

    ``scenario``: name of a shipped scenario; ``set``: changes of it, as ``--set`` takes them. ``quantity``: a key of
    ``UNITS``. ``reference``: its value by ``source``, known to ``reference_error``. ``tolerance``: accepted
    relative difference.
    ``refine``: run with ``--refine``, for runs in real time, which have no bracket. ``quick``: part of ``--quick``.
    ``remark``: why the reference may lie outside the error bar; without a remark it may not.
    """

    name: str
    title: str
    scenario: str
    quantity: str
    reference: float
    source: str
    set: tuple[str, ...] = ()
    reference_error: float = 0.0
    relation: str = "equal"
    tolerance: float = 1e-3
    refine: bool = False
    quick: bool = False
    remark: str = ""

    @property
    def unit(self) -> str:
        """SI unit of the quantity (angles in deg)."""
        return UNITS[self.quantity]

    @property
    def path(self) -> Path:
        """The scenario file."""
        found = shipped.find(self.scenario)
        if found is None:
            raise ScenarioError(f"verification case {self.name!r}: no shipped scenario is called {self.scenario!r}")
        return found


def all_cases() -> dict[str, Case]:
    """Name -> case, in the order of the file."""
    path = shipped.folder() / shipped.VERIFICATION / "cases.toml"
    document = tomllib.loads(path.read_text(encoding="utf-8"))
    return {entry["name"]: _case(entry, path) for entry in document["case"]}


def chosen(names: list[str], quick: bool = False) -> list[Case]:
    """The cases of these names (a name may be the beginning of several), all if none is named; ``quick``: only those
    marked so. ScenarioError for a name that fits none."""
    return [case for case in of_names(names, all_cases(), "verification") if case.quick or not quick]


def of_names(names: list[str], cases: dict[str, T], kind: str) -> list[T]:
    """The ``cases`` of a ``kind`` with these names or beginnings of names, each once; all if none is named.
    ScenarioError for a name that fits none."""
    if not names:
        return list(cases.values())
    picked: dict[str, T] = {}
    for name in names:
        found = {key: case for key, case in cases.items() if key == name or key.startswith(f"{name}-")}
        if not found:
            raise ScenarioError(f"no {kind} case is called {name!r}; {nearest(name, cases)}")
        picked |= found
    return list(picked.values())


def _case(entry: dict, path: Path) -> Case:
    unknown = set(entry) - {field.name for field in fields(Case)}
    if unknown:
        raise ScenarioError(f"{path}: case {entry.get('name')!r}: unknown key {sorted(unknown)[0]!r}")
    case = Case(**{**entry, "set": tuple(entry.get("set", ()))})
    if case.quantity not in UNITS or case.relation not in RELATIONS:
        raise ScenarioError(f"{path}: case {case.name!r}: unknown quantity or relation")
    return case
