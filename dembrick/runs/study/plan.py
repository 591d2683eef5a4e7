"""Plan of a study: a base scenario and the keys that change from case to case.

A study is a TOML file::

    title = "Scatter of the friction coefficient"
    base  = "set4a.toml"                     # relative to the folder of the study

    [grid]                                   # every combination
    "joint.formulation" = ["concave", "convex"]
    "control.tolerance" = { from = 1e-4, to = 1e-2, count = 3, spacing = "log" }

    [list]                                   # columns of one length: a case per line; or [table] with file = "x.csv"
    "actuators.jack.point" = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]]

    [draws]                                  # random numbers
    count  = 1000
    seed   = 1
    method = "latin-hypercube"               # or "monte-carlo"
    [draws.of]
    "joint.friction" = { distribution = "normal", mean = 0.64, deviation = 0.03, lower = 0.0 }

Keys are paths into the scenario, as for ``--set``. If a study has several of these parts, every combination of them
is a case: all formulations above get the same thousand frictions.

With a ``[search]`` each case is a search for the value of one more key at which a run falls: see `study.search`.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from dembrick.errors import ScenarioError
from dembrick.runs.study import search as searches
from dembrick.runs.study.case import COLUMNS
from dembrick.runs.study.draws import METHODS, Draws, distribution
from dembrick.scenario import overrides, shipped
from dembrick.scenario import toml as scenarios
from dembrick.scenario.checks import nearest, show
from dembrick.scenario.csv_tables import read_table
from dembrick.scenario.files import companions_of, names_of
from dembrick.scenario.support_controls import BaseMotionControl
from dembrick.scenario.text_files import read_text

MOST_CASES = 10_000_000
_DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+(?:[eE][-+]?\d+)?")
_KEYS = ("title", "base", "histories", "grid", "list", "table", "draws", "search")


@dataclass(frozen=True)
class Study:
    """A study: its ``title`` and file (``path``), its ``base`` scenario as text with its file (``base_path``),
    the ``keys`` that change, and its cases by number.

    ``histories``: whether every case keeps its history; ``search``: the search of each case, if there is one.
    ``digest`` identifies the study: it covers the base scenario, the files that it reads and everything
    that defines the cases. ``reads``: all these files.
    """

    title: str
    path: str
    base: str
    base_path: str
    histories: bool
    keys: tuple[str, ...]
    digest: str
    _grid: dict[str, list]
    _lines: list[dict[str, Any]]
    _draws: Draws | None
    search: searches.Search | None = None
    reads: tuple[str, ...] = ()

    @property
    def columns(self) -> tuple[str, ...]:
        """The columns of the table after the case and its keys."""
        return tuple(COLUMNS) if self.search is None else searches.COLUMNS

    @property
    def answer(self) -> str:
        """The column with the answer of a case."""
        return "V" if self.search is None else "value"

    @property
    def quantity(self) -> str:
        """The quantity of the base motion of all cases; empty without one, or if it varies."""
        control = tomllib.loads(self.base).get("control", {})
        if control.get("kind") != BaseMotionControl.kind or {"control.kind", "control.quantity"} & set(self.keys):
            return ""
        return control.get("quantity", "acceleration")

    def __len__(self) -> int:
        return math.prod(map(len, self._grid.values())) * len(self._lines) * (self._draws.count if self._draws else 1)

    def changes(self, number: int) -> dict[str, Any]:
        """The keys of case ``number`` (counted from 0) with their values; the last part of the study varies fastest."""
        if not 0 <= number < len(self):
            raise IndexError(number)
        found: dict[str, Any] = {}
        if self._draws:
            number, index = divmod(number, self._draws.count)
            found = self._draws[index]
        number, index = divmod(number, len(self._lines))
        found = self._lines[index] | found
        for key, values in reversed(self._grid.items()):
            number, index = divmod(number, len(values))
            found = {key: values[index]} | found
        return {key: found[key] for key in self.keys}

    def cell(self, number: int) -> dict[str, Any]:
        """The part of the changes that is not drawn at random: cases that share it are draws of one population."""
        return {
            key: value for key, value in self.changes(number).items() if not (self._draws and key in self._draws.of)
        }


def load(path: str | os.PathLike) -> Study:
    """Read a study file and check it and its first case; ScenarioError says what is wrong."""
    path = os.fsdecode(path)
    if not os.path.exists(path):
        path = os.fspath(shipped.find(path) or path)
    text = read_text(path, "a study (TOML)")
    try:
        document = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise ScenarioError(f"{path}: not valid TOML: {error}") from None
    try:
        return _study(document, path)
    except ScenarioError as error:
        raise ScenarioError(f"{path}: {error}") from None


def _study(document: dict, path: str) -> Study:
    if "base" not in document and not {"grid", "list", "table", "draws"} & document.keys() and "control" in document:
        raise ScenarioError('this is a scenario (dembrick run); a study has base = "SCENARIO.toml" and what changes')
    for key in document:
        if key not in _KEYS:
            raise ScenarioError(f"unknown key {show(key)}; {nearest(key, _KEYS)}")
    base_name = document.get("base")
    if not isinstance(base_name, str):
        raise ScenarioError('a study needs base = "SCENARIO.toml", seen from the folder of the study')
    for key, kind in (("title", str), ("histories", bool)):
        if not isinstance(document.get(key, kind()), kind):
            raise ScenarioError(f"{key} = {show(document[key])} must be a {'text' if kind is str else 'true or false'}")
    base_path = str(Path(path).parent / base_name)
    if not os.path.exists(base_path) and (found := shipped.find(base_name)):
        base_path = str(found)
    base = scenarios.text_of(scenarios.load(base_path, regular=True))
    grid = {key: _grid_values(key, value) for key, value in _flat(document.get("grid", {}), "grid").items()}
    lines = _lines(document, path)
    for changes in (*({key: values} for key, values in grid.items()), *lines):
        _check_values(changes)
    draws = _draws(document["draws"]) if "draws" in document else None
    keys = [*grid, *lines[0], *(draws.of if draws else ())]
    double = next((key for key in keys if keys.count(key) > 1), None)
    if double:
        raise ScenarioError(
            f"two columns set the key {show(double)}; keep it in only one of grid, list, table and draws"
        )
    search = searches.read(document["search"], keys) if "search" in document else None
    _refuse_aliases(tomllib.loads(base), [*keys, *([search.key] if search else ())])
    if not keys and search is None:
        raise ScenarioError(
            "nothing changes from case to case: give a [grid], a [list], a [table], [draws] or a [search]"
        )
    parts = [base, grid, lines, document.get("draws")] + ([document["search"]] if search else [])
    description = json.dumps(parts, sort_keys=True, default=str)
    digest = hashlib.sha256(description.encode()).hexdigest()[:16]
    histories = document.get("histories", False)
    if histories and search:
        raise ScenarioError("histories = true: the runs of a [search] keep no history; run its bracket with --set")
    title = document.get("title", Path(path).stem)
    study = Study(title, path, base, base_path, histories, tuple(keys), digest, grid, lines, draws, search)
    read = _files_read(study)
    if read:
        digest = hashlib.sha256(f"{digest} {_digests(read, base_path)}".encode()).hexdigest()[:16]
    table = [str(Path(path).parent / document["table"]["file"])] if "table" in document else []
    study = replace(study, digest=digest, reads=(path, base_path, *table, *read))
    if len(study) > MOST_CASES:
        raise ScenarioError(f"{len(study)} cases are more than {MOST_CASES}: split the study")
    if search is None:
        scenario_of(study, 0)  # raises for a key that the scenario does not have
    else:
        for value in (search.low, search.high):
            searches.check(scenarios.varied(base, base_path, {**study.changes(0), search.key: value}))
    return study


def _files_read(study: Study) -> list[str]:
    """The files that the first case reads, and those that the others name; files that are missing or cannot
    be read are left to the cases."""
    named = {value for case in (study._grid, *study._lines) for cell in case.values() for value in _texts(cell)}
    paths = {name: os.path.join(os.path.dirname(study.base_path), name) for name in named}
    try:
        changes = study.changes(0) if study.search is None else {**study.changes(0), study.search.key: study.search.low}
        scenario = scenarios.varied(study.base, study.base_path, changes)
        paths |= {name: scenario.path_of(name) for name in names_of(scenario)}
    except ScenarioError:
        pass
    beside = (os.path.join(os.path.dirname(path), own) for path in paths.values() for own in companions_of(path))
    return [path for path in sorted({*paths.values(), *beside}) if os.path.isfile(path)]


def _digests(paths: list[str], base_path: str) -> dict[str, str]:
    """Digests of files, by their paths from the folder of the base scenario."""
    found = {}
    for path in paths:
        with open(path, "rb") as file:
            found[os.path.relpath(path, os.path.dirname(base_path))] = hashlib.file_digest(file, "sha256").hexdigest()
    return found


def _texts(value) -> Iterator[str]:
    """The texts in a value of a study, which may be a nested list."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, list | tuple):
        for part in value:
            yield from _texts(part)


def _refuse_aliases(base: dict, keys: list[str]) -> None:
    """Raise ScenarioError if one key sets what another does, under another name or as a part of it: the table would
    state a value that was not run."""
    paths = [overrides.resolved(base, key) for key in keys]
    for i, path in enumerate(paths):
        for j in range(i):
            shorter = min(len(path), len(paths[j]))
            if path[:shorter] == paths[j][:shorter]:
                raise ScenarioError(f"the columns {show(keys[j])} and {show(keys[i])} set the same key: leave one out")


def _check_values(changes: Mapping[str, Any]) -> None:
    """Raise ScenarioError for values that no table can hold: numbers that are not finite, dates and times."""
    for key, value in changes.items():
        try:
            json.dumps(value, allow_nan=False)
        except (TypeError, ValueError):
            raise ScenarioError(
                f"{key} = {show(value)}: values of a case must be finite numbers, texts, or lists of them"
            ) from None


def _rounded(value: float) -> float:
    """A value of a range, without rounding errors."""
    return float(f"{value:.12g}")


def scenario_of(study: Study, number: int):
    """The checked scenario of a case."""
    return scenarios.varied(study.base, study.base_path, study.changes(number))


def _flat(table: Any, place: str) -> dict[str, Any]:
    """A table of keys by their full path: dotted keys without quotes arrive as tables in tables."""
    if not isinstance(table, dict):
        raise ScenarioError(f"{place} must be a table of keys, not {show(table)}")
    flat: dict[str, Any] = {}
    for key, value in table.items():
        if isinstance(value, dict) and not {"from", "distribution"} & value.keys():
            inner = {f"{key}.{name}": item for name, item in _flat(value, f"{place}.{key}").items()}
        else:
            inner = {key: value}
        for name, item in inner.items():
            if name in flat:
                raise ScenarioError(f"two columns of {place} set the key {show(name)}")
            flat[name] = item
    return flat


def _grid_values(key: str, value: Any) -> list:
    """The values of one key of the grid: a list, or a range from, to, count."""
    place = f"grid.{key}"
    if isinstance(value, dict):
        known = ("from", "to", "count", "spacing")
        for name in value:
            if name not in known:
                raise ScenarioError(f"{place}: unknown key {show(name)}; {nearest(name, known)}")
        ends: tuple[Any, Any] = value.get("from"), value.get("to")
        (first, last), count = ends, value.get("count")
        spacing = value.get("spacing", "linear")
        numbers = all(isinstance(end, int | float) and not isinstance(end, bool) for end in (first, last))
        if not numbers or not isinstance(count, int) or isinstance(count, bool) or count < 2:
            raise ScenarioError(f"{place}: a range needs numbers 'from' and 'to' and a whole 'count' of at least 2")
        if spacing == "linear":
            return [_rounded(first + (last - first) * i / (count - 1)) for i in range(count)]
        if spacing != "log" or not first > 0.0 or not last > 0.0:
            raise ScenarioError(f'{place}: spacing = {show(spacing)} must be "linear", or "log" with both ends above 0')
        return [_rounded(first * (last / first) ** (i / (count - 1))) for i in range(count)]
    if not isinstance(value, list):
        raise ScenarioError(f"{place} = {show(value)} must be a list of values, or a range with from, to and count")
    if not value:
        raise ScenarioError(f"{place} is empty: a grid needs at least one value per key")
    return value


def _lines(document: dict, path: str) -> list[dict[str, Any]]:
    """The cases of a [list] or [table]; a single one without changes if there is neither."""
    if "list" in document and "table" in document:
        raise ScenarioError("a study has a [list] or a [table], not both")
    if "list" in document:
        columns = _flat(document["list"], "list")
        for key, column in columns.items():
            if not isinstance(column, list) or not column:
                raise ScenarioError(f"list.{key} = {show(column)} must be a list with at least one value")
        if len({len(column) for column in columns.values()}) != 1:
            lengths = ", ".join(f"{key} {len(column)}" for key, column in columns.items()) or "none"
            raise ScenarioError(f"the columns of [list] must have one length: {lengths}")
        return [dict(zip(columns, line, strict=True)) for line in zip(*columns.values(), strict=True)]
    if "table" in document:
        table = document["table"]
        name = table.get("file") if isinstance(table, dict) and set(table) == {"file"} else None
        if not isinstance(name, str):
            raise ScenarioError('[table] needs file = "CASES.csv" and nothing else')
        return _read_csv(Path(path).parent / name)
    return [{}]


def _read_csv(path: Path) -> list[dict[str, Any]]:
    """Cases from a CSV file: the header names the keys, every value is TOML or a bare word."""
    table = read_table(path, "a table of cases")
    if not table.lines:
        raise ScenarioError(f"{path}: a table needs a header line of keys and at least one case below it")
    header = [key.strip() for key in table.titles]
    double = next((key for key in header if header.count(key) > 1), None)
    if double is not None:
        raise ScenarioError(f"{path}: two columns set the key {show(double)}")
    point = _DECIMAL_COMMA if table.decimal_comma else None
    return [{key: _value(text.strip(), point) for key, text in zip(header, row, strict=True)} for _, row in table.lines]


def _value(text: str, decimal_comma: re.Pattern | None = None) -> Any:
    if decimal_comma is not None and decimal_comma.fullmatch(text):
        text = text.replace(",", ".")
    try:
        document = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        return text
    return document["value"] if list(document) == ["value"] else text


def _draws(table: Any) -> Draws:
    known = ("count", "seed", "method", "of")
    if not isinstance(table, dict):
        raise ScenarioError(f"draws must be a table, not {show(table)}")
    for name in table:
        if name not in known:
            raise ScenarioError(f"draws: unknown key {show(name)}; {nearest(name, known)}")
    whole: dict[str, Any] = {name: table.get(name) for name in ("count", "seed")}
    method = table.get("method", "monte-carlo")
    for (name, value), least in zip(whole.items(), (1, 0), strict=True):
        if not isinstance(value, int) or isinstance(value, bool) or not least <= value < 2**63:
            raise ScenarioError(f"draws.{name} = {show(value)} must be a whole number of at least {least}")
    if method not in METHODS:
        raise ScenarioError(f"draws.method = {show(method)} is unknown; {nearest(str(method), METHODS)}")
    of = {}
    for key, entry in _flat(table.get("of", {}), "draws.of").items():
        if not isinstance(entry, dict):
            raise ScenarioError(f"draws.of.{key} = {show(entry)} must state a distribution")
        of[key] = distribution(key, entry)
    if not of:
        raise ScenarioError("draws: no key has a distribution; state one in [draws.of]")
    return Draws(of, whole["count"], whole["seed"], method)


def shard(cases: int, text: str | None) -> tuple[Sequence[int], str]:
    """The case numbers of shard ``i/n`` (counted from 1) and its label; all of them without one."""
    if text is None:
        return range(cases), "1/1"
    try:
        part, of = (int(word) for word in text.split("/"))
    except ValueError:
        raise ScenarioError(f"--shard {show(text)}: write i/n, for instance 3/16") from None
    if not 1 <= part <= of:
        raise ScenarioError(f"--shard {show(text)}: i goes from 1 to n")
    return range(part - 1, cases, of), f"{part}/{of}"
