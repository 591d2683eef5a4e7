"""Target of a study of causes: which joints of a structure are seen to be open, read from the table [target]."""

from __future__ import annotations

import os
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dembrick.errors import ScenarioError
from dembrick.scenario import shipped
from dembrick.scenario import toml as scenarios
from dembrick.scenario.checks import nearest, real, show
from dembrick.scenario.text_files import read_text

if TYPE_CHECKING:
    from dembrick.scenario.model import Scenario

TARGET = "target"
DOUBT = 0.05
_KEYS = ("title", "base", TARGET)
_TARGET_KEYS = ("open", "closed", "supports", "displacement", "doubt", "paths")


@dataclass(frozen=True)
class Target:
    """A study of causes: its scenario, and what was observed. ``open``, ``closed``: joints as pairs of blocks, None
    for all others; ``supports`` that may have moved, empty for all; ``seen``: a block and its displacement (3,) m,
    or None; ``doubt``: probability that a joint is observed wrongly; ``paths``: whether each motion is followed through
    equilibria in the deformed geometry."""

    title: str
    scenario: Scenario
    open: tuple[tuple[str, str], ...]
    closed: tuple[tuple[str, str], ...] | None = None
    supports: tuple[str, ...] = ()
    seen: tuple[str, np.ndarray] | None = None
    doubt: float = DOUBT
    paths: bool = False


def asks_for_causes(path: str | os.PathLike) -> bool:
    """Whether the file is a study with a [target]; False also for invalid TOML, which is reported elsewhere."""
    try:
        return TARGET in tomllib.loads(read_text(_found(path), "a study (TOML)"))
    except (ValueError, RecursionError, ScenarioError):
        return False


def read(path: str | os.PathLike) -> Target:
    """Read a study with a [target]; ScenarioError says what is wrong."""
    path = _found(path)
    try:
        document = tomllib.loads(read_text(path, "a study (TOML)"))
        return _target(document, path)
    except ScenarioError as error:
        raise ScenarioError(f"{path}: {error}") from None


def _found(path: str | os.PathLike) -> str:
    path = os.fsdecode(path)
    return path if os.path.exists(path) else os.fspath(shipped.find(path) or path)


def _target(document: dict, path: str) -> Target:
    for key in document:
        if key not in _KEYS:
            raise ScenarioError(f"a study with a [target] has no key {show(key)}; {nearest(key, _KEYS)}")
    base, table = document.get("base"), document[TARGET]
    if not isinstance(base, str):
        raise ScenarioError('a study needs base = "SCENARIO.toml", seen from the folder of the study')
    if not isinstance(table, dict):
        raise ScenarioError(f"target = {show(table)} must be a table with the joints that are open")
    for key in table:
        if key not in _TARGET_KEYS:
            raise ScenarioError(f"[target] has no key {show(key)}; {nearest(key, _TARGET_KEYS)}")
    base_path = Path(path).parent / base
    scenario = scenarios.load(base_path if base_path.exists() else (shipped.find(base) or base_path))
    doubt = real("target.doubt", table.get("doubt", DOUBT))
    if not 0.0 < doubt < 0.5:
        raise ScenarioError(f"target.doubt = {doubt:g} is out of range: a chance above 0 and below 0.5")
    opened = _pairs(table, "open")
    if not opened:
        raise ScenarioError('[target] needs open = [["block", "block"], ...]: the joints that are seen to be open')
    return Target(
        title=str(document.get("title", Path(path).stem)),
        scenario=scenario,
        open=opened,
        closed=_pairs(table, "closed") if "closed" in table else None,
        supports=_names(table.get("supports", []), "target.supports"),
        seen=_seen(table.get("displacement")),
        doubt=doubt,
        paths=_truth(table.get("paths", False)),
    )


def _truth(value: Any) -> bool:
    if not isinstance(value, bool):
        raise ScenarioError(f"target.paths = {show(value)} must be true or false")
    return value


def _names(value: Any, place: str) -> tuple[str, ...]:
    if not isinstance(value, list) or not all(isinstance(name, str) for name in value):
        raise ScenarioError(f"{place} = {show(value)} must be a list of names of blocks")
    return tuple(value)


def _pairs(table: dict, key: str) -> tuple[tuple[str, str], ...]:
    pairs = table.get(key, [])
    if not isinstance(pairs, list):
        raise ScenarioError(f"target.{key} = {show(pairs)} must be a list of pairs of blocks")
    found = [_names(pair, f"target.{key}") for pair in pairs]
    for pair in found:
        if len(pair) != 2:
            raise ScenarioError(
                f"target.{key}: {show(list(pair))} must be two blocks, those that the joint lies between"
            )
    return tuple((one, other) for one, other in found)


def _seen(entry: Any) -> tuple[str, np.ndarray] | None:
    if entry is None:
        return None
    if not isinstance(entry, dict) or set(entry) != {"block", "value"} or not isinstance(entry["block"], str):
        raise ScenarioError('target.displacement must be { block = "name", value = [x, y, z] }, in m')
    value = entry["value"]
    if not isinstance(value, list) or len(value) != 3:
        raise ScenarioError(f"target.displacement.value = {show(value)} must be three numbers, in m")
    moved = np.array([real("target.displacement.value", x) for x in value])
    if not moved.any():
        raise ScenarioError("target.displacement.value is zero, which does not tell how far a support moved")
    return entry["block"], moved
