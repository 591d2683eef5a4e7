"""Scenario files: conversion of TOML to :class:`dembrick.scenario.model.Scenario` and back, with all keys checked.

The tables of a file are the dataclasses of :mod:`dembrick.scenario.model`, with a key for each field. This module
checks that keys exist; the classes themselves check types, bounds and names. Errors name the file, the table, the key,
the value and what is allowed. Reading runs no code, and opens no file but the scenario and its CAD models.
"""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, fields, is_dataclass
from functools import cache, lru_cache, partial
from types import UnionType
from typing import Any, NamedTuple, NoReturn, get_args, get_origin, get_type_hints

from dembrick.errors import ScenarioError
from dembrick.scenario import shipped
from dembrick.scenario.blocks import Mesh
from dembrick.scenario.checks import Faults, nearest, show
from dembrick.scenario.checks import assign as keep
from dembrick.scenario.controls import ACTUATORS, CONTROLS
from dembrick.scenario.generators import GENERATORS
from dembrick.scenario.keys import default_of, tables_with, written_fields
from dembrick.scenario.model import JointLaw, JointOverride, Material, Scenario
from dembrick.scenario.overrides import Overrides, apply_overrides, assign
from dembrick.scenario.references import ScenarioErrors
from dembrick.scenario.stages import controls_of
from dembrick.scenario.text_files import hint_of, line_of, read_text


def _keys_of(kind: type) -> dict[str, bool]:
    """Keys of a table, with whether each is required: the fields that files may contain; required without a default."""
    return {field.name: default_of(field) is MISSING for field in written_fields(kind)}


@cache
def _inner(kind: type) -> dict[str, tuple[type, bool]]:
    """Field -> (dataclass that it holds, whether it is a list of them), for the fields that hold dataclasses."""
    found: dict[str, tuple[type, bool]] = {}
    hints = get_type_hints(kind)
    for name in _keys_of(kind):
        for part in get_args(hints[name]) if isinstance(hints[name], UnionType) else (hints[name],):
            inner: Any = get_args(part)[0] if get_origin(part) is tuple else part
            if isinstance(inner, type) and is_dataclass(inner):
                found[name] = inner, inner is not part
    return found


NAMELESS = "the scenario"  # name, in messages, of a text without a file
TOP = ("title", "gravity", "supports")  # keys outside of all tables
_INSTEAD = {"blocks": f"give blocks, {', '.join(GENERATORS)} or models"}  # remedies for a missing key
_OWN_KEYS = {"points": "distributed", "pressure": "convex"}  # law keys that belong to one formulation


def load(path: str | os.PathLike, overrides: Overrides = (), regular: bool = False) -> Scenario:
    """Read a scenario file, or a shipped scenario by its name if there is no such file.

    ``overrides`` are ``key.path=value`` texts, as for ``--set``, or a mapping of key paths to values. ``regular``:
    refuse pipes, which a user may name but other files must not.
    """
    path = os.fsdecode(path)
    if not os.path.exists(path):
        found = shipped.find(path)
        if found is None and not os.path.dirname(path) and "\0" not in path:
            meant = nearest(path.removesuffix(".toml"), shipped.examples())
            meant = f"{meant} " if meant.startswith("did you mean") else ""
            remedy = "'dembrick examples' lists the shipped scenarios, 'dembrick new' starts one"
            raise ScenarioError(f"{path}: there is no such file; {meant}{remedy}")
        path = os.fspath(found or path)
    return loads(read_text(path, "a scenario file (TOML)", regular), path, overrides)


def loads(
    text: str,
    path: str | os.PathLike | None = None,
    overrides: Overrides = (),
    files: Mapping[str, str] | None = None,
) -> Scenario:
    """Decode the text of a scenario; ``path`` is its file, for messages and for the record; for ``files`` see
    `Scenario`."""
    name = None if path is None else os.fsdecode(path)
    document = _parse(text, name or NAMELESS)
    assignments = apply_overrides(document, overrides)
    if not assignments:
        return _decode(document, _Place(name or NAMELESS, text=text), name, text, files=files)
    notes = "".join(f"# --set {show(assignment)}\n" for assignment in assignments)
    place = _Place(f"{name or 'the scenario'} (with --set)")
    return _decode(document, place, name, f"{notes}{_write(document)}", files=files)


def varied(text: str, path: str | os.PathLike | None, changes: Mapping[str, Any]) -> Scenario:
    """The scenario of a text with changed keys; the text is parsed only once for many variations.

    ``changes`` maps key paths, as for ``--set``, to values as parsed from TOML.
    """
    name = NAMELESS if path is None else os.fsdecode(path)
    like = _parsed(text, name)
    document = like[0].copy()
    assign(document, changes)
    return _decode(document, _Place(f"{name} (with changes)"), None if path is None else name, None, like)


def dumps(scenario: Scenario) -> str:
    """TOML text that :func:`loads` reads back as an equal scenario, with floats exact to the last bit."""
    document: dict[str, Any] = {"title": scenario.title, "gravity": scenario.gravity}
    document["joint"] = _plain_law(scenario.joint)
    document["joints"] = [
        {**{key: value for key, value in _plain(entry).items() if key != "law"}, **_plain_law(entry.law)}
        for entry in scenario.joints
    ]
    document["materials"] = {name: _plain(material) for name, material in scenario.materials.items()}
    for key, (_, several) in _inner(Scenario).items():
        if several and key != "joints":
            document[key] = [_plain(entry, short=True) for entry in getattr(scenario, key)]
    document["stages"] = [{"kind": stage.kind, **_plain(stage)} for stage in scenario.stages]
    document["control"] = {"kind": scenario.control.kind, **_plain(scenario.control)}
    document["solver"] = _plain(scenario.solver)
    document["output"] = _plain(scenario.output)
    document["supports"] = list(scenario.supports)
    return _write({key: value for key, value in document.items() if value != []})


def text_of(scenario: Scenario) -> str:
    """The scenario as TOML: its source text if nothing has changed since it was read, else :func:`dumps`."""
    text, name, files = scenario.text, scenario.path or NAMELESS, tuple(scenario.files.items())
    if text and (scenario.as_read == scenario.materials or _parsed(text, name, files)[1] == scenario):
        return text
    return dumps(scenario)


# --- reading ---------------------------------------------------------------------------------------------------------


class _Place(NamedTuple):
    """Position in a file, for messages. ``table`` is empty at the top of the file; ``header`` and ``number`` locate it
    in the ``text``, which is None if the document was changed after parsing."""

    file: str
    table: str = ""
    text: str | None = None
    header: str = ""
    number: int = 1

    def inside(self, table: str, header: str | None = None, number: int = 1) -> _Place:
        """Place of a table within this one; without a ``header``, lines are those of this table."""
        if header is None:
            return self._replace(table=table)
        return self._replace(table=table, header=header, number=number)

    def fail(self, message: str) -> NoReturn:
        """Raise a ScenarioError at the line of the key with which the message begins, if it begins with one."""
        named = re.match(r"[a-z_]+", message)
        key = named.group() if named else ""
        raise ScenarioError(f"{self.at(key)}: {self.table}{': ' if self.table else ''}{message}")

    def at(self, key: str = "") -> str:
        """The file, with the line of the key or else of the table, if it is known."""
        line = None if self.text is None else line_of(self.text, self.header, self.number, key)
        if line is None:
            return self.file
        return f"{self.file}, line {line}" if self.file == NAMELESS else f"{self.file}:{line}"

    def of(self, key: str = "") -> str:
        """The table and the file, as messages name them."""
        return f"{self.table} of {self.at(key)}" if self.table else self.at(key)


@lru_cache(maxsize=16)
def _parsed(text: str, file: str, files: tuple[tuple[str, str], ...] = ()) -> tuple[dict[str, Any], Scenario]:
    """A parsed text (shared: callers must not change it) and its scenario."""
    document = _parse(text, file)
    return document, _decode(document, _Place(file, text=text), file, None, files=dict(files))


def _parse(text: str, file: str) -> dict[str, Any]:
    try:
        text.encode()  # a lone surrogate, possible only in a text made in Python, cannot be stored
        return tomllib.loads(text)
    except UnicodeEncodeError:
        raise ScenarioError(f"{file}: the text cannot be written as UTF-8") from None
    except RecursionError:
        raise ScenarioError(f"{file}: not a scenario: lists or tables are nested too deeply") from None
    except ValueError as error:
        raise ScenarioError(f"{file}: not valid TOML: {error}{hint_of(text, str(error))}") from None


def _decode(
    document: dict[str, Any],
    place: _Place,
    path: str | None,
    text: str | None,
    like: tuple[dict[str, Any], Scenario] | None = None,
    files: Mapping[str, str] | None = None,
) -> Scenario:
    """The scenario of a document. Tables that are identical to those of the document ``like`` have been checked already
    and are taken from its scenario."""
    if not document:
        raise ScenarioError(f"{place.file}: this file is empty; 'dembrick new' writes a scenario to start from")
    if isinstance(document.get("base"), str):
        name = path or "STUDY.toml"
        raise ScenarioError(
            f"{place.file}: this is a study of many runs; run it with dembrick sweep {name}; its scenario is "
            f"base = {show(document['base'])}"
        )
    keys = _keys_of(Scenario) | {"control": True}
    keys["blocks"] = not any(key in document for key in (*GENERATORS, "models"))
    faults = Faults()
    values, inner = _known(document, keys, place, faults), _inner(Scenario)

    def each(key: str, decode: Callable[[Any, _Place], Any]) -> list:
        found = []
        for entry, where in _entries(document, key, place):
            with faults.kept():
                found.append(decode(entry, where))
        return found

    def decoded(key: str) -> Any:
        there = place.inside(f"[{key}]", key)
        if key == "joint":
            return _law(_table(document[key], there), there)
        if key == "joints":
            base = values["joint"] if isinstance(values.get("joint"), JointLaw) else None  # whose own error is reported
            return [] if base is None else each(key, lambda entry, where: _joint_override(entry, base, where))
        if key == "materials":
            tables = {name: f"{key}.{_key(name)}" for name in _table(document[key], there)}
            return {
                name: _record(Material, document[key][name], place.inside(f"[{table}]", table))
                for name, table in tables.items()
            }
        if key == "stages":
            return each(key, _control)
        if key == "control":
            return _control(document[key], there)
        kind, several = inner[key]
        if several:
            return each(key, partial(_record, kind))
        return _record(kind, document.get(key, {}), there)

    known, parsed = like or ({}, None)
    for key in (*inner, "materials", "stages", "control"):
        shared = key in known and document.get(key) is known[key]
        if shared and (key != "joints" or document["joint"] is known["joint"]):  # overrides inherit from the joint
            values[key] = getattr(parsed, key)
        elif key in document or key not in keys or not keys[key]:
            with faults.kept():
                values[key] = decoded(key)
    faults.tell()
    scenario = _make(Scenario, {**values, "path": path, "text": text, "files": files or {}}, place)
    driven = scenario.actuators or any(pressure.actuator for pressure in scenario.pressures)
    drives = next((control for control in controls_of(scenario) if control.drives == ACTUATORS), None)
    if not driven and drives is not None:
        place.fail(f"control kind {show(drives.kind)} drives actuators, but there are none; add [[actuators]]")
    keep(scenario, as_read=None if text is None else dict(scenario.materials))
    return scenario


def _law(data: dict[str, Any], place: _Place, base: JointLaw | None = None) -> JointLaw:
    """A joint law; with a ``base``, a copy of that law with the keys in ``data`` changed."""
    keys, faults = _keys_of(JointLaw), Faults()
    data = _known(data, keys if base is None else dict.fromkeys(keys, False), place, faults)
    given = {key: value for key, value in data.items() if (key, value) != ("points", "auto")}
    if base is None:
        return _make(JointLaw, given, place, faults)
    formulation = data.get("formulation", base.formulation)
    inherited = {key: getattr(base, key) for key in keys if key not in data}
    kept = {key: value for key, value in inherited.items() if _OWN_KEYS.get(key, formulation) == formulation}
    return _make(JointLaw, {**kept, **given}, place, faults)


def _joint_override(entry: Any, default: JointLaw, place: _Place) -> JointOverride:
    data, faults, law = dict(_table(entry, place)), Faults(), _keys_of(JointLaw)
    own = {key: required for key, required in _keys_of(JointOverride).items() if key != "law"}
    data = _known(data, {**own, **dict.fromkeys(law, False)}, place, faults)
    with faults.kept():
        values = {key: value for key, value in data.items() if key in own}
        values["law"] = _law({key: value for key, value in data.items() if key in law}, place, default)
    faults.tell()
    return _make(JointOverride, values, place)


def _control(data: Any, place: _Place) -> Any:
    given = dict(_table(data, place))
    if "kind" not in given:
        raise ScenarioError(f"missing key 'kind' in {place.of()}; use one of {', '.join(CONTROLS)}")
    kind = given.pop("kind")
    if isinstance(kind, str) and kind in CONTROLS:
        faults, keys = Faults(), _keys_of(CONTROLS[kind])
        for key in [key for key in given if key not in keys]:
            others = ", ".join(show(name) for name, other in CONTROLS.items() if key in _keys_of(other))
            if others:
                del given[key]
                own = f"{place.at(key)}: {place.table}: kind {show(kind)} has no {show(key)}"
                faults.add(f"{own}, which is a key of {others}; its own keys: {', '.join(keys) or 'none'}")
        return _record(CONTROLS[kind], given, place, faults, "kind")
    existing = ", ".join(show(name) for name in CONTROLS)
    from difflib import get_close_matches

    likely = 0.7 if len(str(kind)) < 8 else 0.8  # fraction of equal letters: short words are alike by chance
    close = get_close_matches(kind, CONTROLS, 1, likely) if isinstance(kind, str) else []
    hint = f"; did you mean {show(close[0])}?" if close else ""
    place.fail(f"kind = {show(kind)} is not a kind of control; the kinds are {existing}{hint}")


def _record(kind: type, data: Any, place: _Place, faults: Faults | None = None, *more: str) -> Any:
    """Make an instance of a dataclass, with those nested in it; ``faults`` are errors already found in the table,
    ``more`` its keys that the caller has handled."""
    faults = faults or Faults()
    table = _known(_table(data, place), _keys_of(kind), place, faults, *more)
    for key, (inner, several) in _inner(kind).items():
        value, there = table.get(key), place.inside(f"{key} in {place.table}")
        if key not in table:
            continue
        if inner is Mesh and isinstance(value, str):
            table[key] = _make(Mesh, {"file": value}, there)
        elif not several:
            table[key] = _record(inner, value, there)
        elif isinstance(value, list):
            each = (place.inside(f"{key}[{i}] in {place.table}") for i in range(len(value)))
            table[key] = [_record(inner, entry, where) for entry, where in zip(value, each, strict=True)]
        else:
            place.fail(f"{key} must be a list of tables, not {show(value)}")
    return _make(kind, table, place, faults)


def _known(
    data: dict[str, Any], known: Mapping[str, bool], place: _Place, faults: Faults, *more: str
) -> dict[str, Any]:
    """The known keys of a table; errors for unknown and for missing keys are added to the ``faults``."""
    meant = ""
    for key in data:
        if key not in known:
            above = f"{key} must stand above the first table of the file" if place.table and key in TOP else ""
            meant += (likely := above or nearest(key, [*known, *more], tables_with(key)))
            faults.add(f"unknown key {show(key)} in {place.of(key)}; {likely}")
    for key, required in known.items():
        if required and key not in data and f"did you mean {show(key)}" not in meant:
            plural = isinstance(data.get(f"{key}s"), dict)
            wrote = f"; you wrote [{key}s], but the default law is [{key}]" if plural else ""
            instead = _INSTEAD.get(key, "it has no default")
            faults.add(f"missing key {show(key)} in {place.of()}; {instead}{wrote}")
    return {key: value for key, value in data.items() if key in known}


def _make(kind: type, values: Mapping[str, Any], place: _Place, faults: Faults | None = None) -> Any:
    """Make an instance of a dataclass. If an optional value is wrong, try again without it to find further errors;
    ``faults`` are errors already found in the table."""
    faults, left, keys = faults or Faults(), dict(values), _keys_of(kind)
    made, again = None, all(key in left for key, required in keys.items() if required)
    while again:
        again = False
        try:
            made = kind(**left)
        except ScenarioErrors as errors:  # of a whole scenario, each with its table
            for fault in errors.faults:
                with faults.kept():
                    place.inside("", fault.table, fault.number).fail(fault.message)
        except ScenarioError as error:
            words = re.findall(r"[a-z_]+", str(error))
            key = words[0] if words else ""
            missed = len(left) < len(values) and (key not in left or (values.keys() - left.keys()) & set(words))
            if not missed:  # else the error is due to the value left out
                with faults.kept():
                    place.fail(str(error))
            again = kind is not Scenario and key in left and not keys[key]
            left.pop(key, None)
    faults.tell()
    return made


def _table(data: Any, place: _Place) -> dict[str, Any]:
    if not isinstance(data, dict):
        hint = "; write it with one pair of brackets" if isinstance(data, list) else ""
        place.fail(f"this must be a table, not {show(data)}{hint}")
    return data


def _entries(document: dict[str, Any], key: str, place: _Place) -> Iterable[tuple[Any, _Place]]:
    entries = document.get(key, [])
    if not isinstance(entries, list):
        hint = f"; write [[{key}]] before each" if isinstance(entries, dict) else ""
        place.inside("", key).fail(f"{key} must be a list of tables, not {show(entries)}{hint}")
    for i, entry in enumerate(entries, 1):
        yield entry, place.inside(f"[[{key}]] number {i}", key, i)


# --- writing ---------------------------------------------------------------------------------------------------------


def _plain(instance: Any, short: bool = False) -> dict[str, Any]:
    """The fields of a dataclass that have a value; ``short`` omits those at their default."""
    pairs = ((f, getattr(instance, f.name)) for f in fields(instance))
    return {f.name: value for f, value in pairs if value is not None and not (short and value == f.default)}


def _plain_law(law: JointLaw) -> dict[str, Any]:
    """The law with the keys that apply to its formulation; ``auto`` overrides a number of points in the default law."""
    plain = {"points": "auto", **_plain(law)}
    return {key: value for key, value in plain.items() if _OWN_KEYS.get(key, law.formulation) == law.formulation}


def _write(document: dict[str, Any]) -> str:
    lines: list[str] = []
    for key, value in document.items():
        if not isinstance(value, dict) and not _is_table_list(value):
            lines.append(f"{_key(key)} = {_format(value)}")
    for key, value in document.items():
        if isinstance(value, dict) and value and all(isinstance(inner, dict) for inner in value.values()):
            for name, inner in value.items():
                lines += ["", f"[{_key(key)}.{_key(name)}]", *_pairs(inner)]
        elif isinstance(value, dict):
            lines += ["", f"[{_key(key)}]", *_pairs(value)]
        elif _is_table_list(value):
            for entry in value:
                lines += ["", f"[[{_key(key)}]]", *_pairs(entry)]
    return "\n".join(lines) + "\n"


def _is_table_list(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(entry, dict) for entry in value)


def _pairs(table: dict[str, Any]) -> list[str]:
    return [f"{_key(key)} = {_format(value)}" for key, value in table.items()]


def _key(key: str) -> str:
    return key if re.fullmatch("[A-Za-z0-9_-]+", key) else _format(key)


def _format(value: Any) -> str:
    """One value of a checked scenario as TOML; ``repr`` gives the shortest text that reads back as the same float."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    if isinstance(value, list | tuple):
        return f"[{', '.join(_format(item) for item in value)}]"
    if is_dataclass(value):
        pairs = _plain(value, short=True).items()
        return f"{{ {', '.join(f'{_key(key)} = {_format(item)}' for key, item in pairs)} }}"
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{_key(key)} = {_format(item)}' for key, item in value.items())} }}"
    return repr(value)
