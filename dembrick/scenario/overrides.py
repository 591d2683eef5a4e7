"""``--set key.path=value``: changes to a parsed scenario document, made before its checks.

The path follows the file: ``joint.friction``, ``blocks.upper.position`` or ``blocks.1.position``. The entry of a list
is identified by its ``name``, by the ``block`` that it alone acts on, or by its index, counted from 0. The value is
TOML; a bare word is taken as a text, so that ``joint.formulation=concave`` needs no second pair of quotes.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Mapping
from functools import lru_cache
from typing import Any, TypeAlias

from dembrick.errors import ScenarioError
from dembrick.scenario.checks import nearest, show

_BARE_WORD = re.compile(r"""(?:[^\W\d]|[.~]*/)[^\[\]{}"'\n]*""")  # a word, or a path


Overrides: TypeAlias = Iterable[str] | Mapping[str, object]


def apply_overrides(document: dict, overrides: Overrides) -> list[str]:
    """Apply ``key.path=value`` texts to a document, in the given order, or a mapping of key paths to values; return all
    as texts."""
    if isinstance(overrides, str):
        raise ScenarioError(
            f"overrides = {show(overrides)}: give a list, [{show(overrides)}], or a mapping of key paths to values"
        )
    if isinstance(overrides, Mapping):
        changes = {key: value.tolist() if hasattr(value, "tolist") else value for key, value in overrides.items()}
        assign(document, changes)
        return [f"{key}={show(value)}" for key, value in changes.items()]
    assignments = list(overrides)
    for assignment in assignments:
        key, equals, text = assignment.partition("=")
        if not equals or not key.strip():
            raise ScenarioError(f"--set {show(assignment)}: write key.path=value, for instance joint.friction=0.5")
        path = _parse_path(key.strip())
        try:
            _assign(document, path, _parse_value(text.strip()))
        except ScenarioError as error:
            raise ScenarioError(f"--set {show(assignment)}: {error}") from None
    return assignments


def assign(document: dict, changes: Mapping[str, object]) -> None:
    """Set keys of a document, given by their paths, to values that are already parsed. Its tables are not modified;
    those on the path to a key are replaced by copies."""
    for key, value in changes.items():
        try:
            _assign(document, _parse_path(key), value)
        except ScenarioError as error:
            raise ScenarioError(f"{key} = {show(value)}: {error}") from None


def resolved(document: dict, key: str) -> tuple[str | int, ...]:
    """Path of a key of a ``document`` in a unique form: entries of lists are given by their index."""
    node: Any = document
    path: list[str | int] = []
    parts = _parse_path(key)
    for depth, part in enumerate(parts):
        step: Any = _find(node, part, parts[:depth]) if isinstance(node, dict | list) else part
        node = node.get(step) if isinstance(node, dict) else node[step] if isinstance(node, list) else None
        path.append(step)
    return tuple(path)


@lru_cache(maxsize=256)
def _parse_path(key: str) -> list[str]:
    """Split at the dots; as in TOML, quotes protect dots in names."""
    path: list[str] = []
    try:
        node: object = tomllib.loads(f"{key} = 0")
        while isinstance(node, dict) and len(node) == 1:
            (part,) = node
            path.append(part)
            node = node[part]
    except (ValueError, RecursionError):  # a name with blanks, given without quotes
        return key.split(".")
    return path if node == 0 else key.split(".")


def _parse_value(text: str) -> object:
    try:
        document = tomllib.loads(f"value = {text}")
    except (ValueError, RecursionError):
        document = {}
    if list(document) == ["value"]:  # further keys can come from a line break in the text
        return document["value"]
    if _BARE_WORD.fullmatch(text):
        return text
    raise ScenarioError(f"{show(text)} is not a value; write it as TOML does: 0.5, true, [1.0, 2.0, 3.0] or a word")


def _assign(document: dict, path: list[str], value: object) -> None:
    node: dict | list = document
    for depth, part in enumerate(path[:-1]):
        step = _find(node, part, path[:depth])
        if isinstance(node, dict) and step not in node:
            node[step] = {}  # a table that the file omits, such as [solver]; the decoder reports wrong names
        inner = node[step]
        if not isinstance(inner, dict | list):
            raise ScenarioError(f"{'.'.join(path[: depth + 1])} = {show(inner)} has no keys to set")
        node[step] = inner = inner.copy()  # documents may share tables, which stay unchanged
        node = inner
    node[_find(node, path[-1], path[:-1])] = value


def _find(node: dict | list, part: str, path: list[str]):
    """The key or the index that ``part`` stands for in a table or a list."""
    if isinstance(node, dict):
        return part
    for label in ("name", "block"):
        found = [i for i, entry in enumerate(node) if isinstance(entry, dict) and entry.get(label) == part]
        if len(found) == 1:
            return found[0]
        if found:
            raise ScenarioError(f"{len(found)} entries of {'.'.join(path)} have {label} = {show(part)}; use an index")
    index = int(part) if re.fullmatch("[0-9]{1,9}", part) else None
    if index is None:
        labels = (entry.get("name", entry.get("block")) for entry in node if isinstance(entry, dict))
        names = [name for name in labels if isinstance(name, str)]
        raise ScenarioError(f"{'.'.join(path)} has no entry {show(part)}; {nearest(part, names)}")
    if index >= len(node):
        raise ScenarioError(f"{'.'.join(path)} has no entry {index}; its {len(node)} entries are counted from 0")
    return index
