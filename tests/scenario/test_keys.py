"""The reference of keys has exactly the keys of every table, and the JSON schema accepts the shipped scenarios."""

import json
import math
import re
import tomllib
from dataclasses import MISSING

import pytest

from dembrick import cli
from dembrick.errors import ScenarioError
from dembrick.scenario import keys, shipped, toml
from dembrick.scenario.controls import CONTROLS
from dembrick.scenario.declared import key_of
from dembrick.scenario.model import Material, Scenario


@pytest.mark.parametrize("heading, table", keys.tables().items(), ids=lambda value: str(value)[:40])
def test_every_key_of_a_table_is_told_and_no_other(heading, table):
    assert set(keys.keys_of(table)) == {field.name for field in keys.written_fields(table)}, heading
    assert all(key.meaning and key.allowed for key in keys.keys_of(table).values())


def test_every_table_that_a_scenario_can_hold_is_told():
    found, waiting = set(), [Scenario, Material, *CONTROLS.values()]
    while waiting:
        kind = waiting.pop()
        found.add(kind)
        waiting += {inner for inner, _ in toml._inner(kind).values()} - found
    assert set(keys.tables().values()) == found


CHECKED = [
    pytest.param(table, field, id=f"{heading} {field.name}"[-40:])
    for heading, table in keys.tables().items()
    for field in keys.written_fields(table)
    if (key := key_of(field)) and key.check
]


@pytest.mark.parametrize("table, field", CHECKED)
def test_what_a_key_declares_is_what_its_check_holds_to(table, field):
    """Numbers within the declared range are accepted, ones just beyond it refused; defaults are always accepted."""
    key = key_of(field)
    default = keys.default_of(field)
    if default not in (MISSING, None):
        assert key.check(field.name, default, "") == default
    for choice in key.choices:
        assert key.check(field.name, choice, "") == choice
    if key.choices:
        assert key.allowed == ", ".join(key.choices)
    if key.allowed == "true, false":
        assert key.check(field.name, True, "") is True
    ends = re.fullmatch(r"(-?[0-9.e-]+) to ([0-9.e-]+)", key.allowed)
    least = re.fullmatch(r"(?:whole number )?(>=?) ([0-9]+)", key.allowed)
    inside, outside = [], [math.nan, "1", None]
    if ends:
        low, high = map(float, ends.groups())
        inside, outside = [0.5 * (low + high)], [*outside, low - 1e-9, high * (1.0 + 1e-9) + 1e-12]
    elif least:
        low, whole = int(least.group(2)), key.allowed.startswith("whole")
        inside, outside = [low if least.group(1) == ">=" else 1e-300, low + 3], [*outside, low - 1]
        outside += [low + 0.5] if whole else [low - 1e-9]
        outside += [low] if least.group(1) == ">" else []
    elif key.allowed != "a number":
        outside = [math.nan]
    for value in inside:
        assert key.check(field.name, value, "") == value
    for value in outside:
        with pytest.raises(ScenarioError, match=re.escape(field.name)):
            key.check(field.name, value, " of nobody")


def valid(value, schema, where="scenario"):
    """Check a value by the few JSON schema keywords that ours uses; raise AssertionError if it breaks one."""
    if "oneOf" in schema or "anyOf" in schema:
        faults = []
        for option in schema.get("oneOf", schema.get("anyOf")):
            try:
                return valid(value, option, where)
            except AssertionError as fault:
                faults.append(str(fault))
        raise AssertionError(f"{where}: none holds: {faults}")
    if "const" in schema:
        assert value == schema["const"], f"{where} = {value!r}"
        return None
    kinds = {"object": dict, "array": list, "string": str, "boolean": bool, "integer": int, "number": (int, float)}
    assert isinstance(value, kinds[schema["type"]]), f"{where} = {value!r} is no {schema['type']}"
    if "enum" in schema:
        assert value in schema["enum"], f"{where} = {value!r}"
    if schema["type"] == "object":
        properties, further = schema.get("properties", {}), schema.get("additionalProperties", True)
        assert set(schema.get("required", ())) <= set(value), f"{where}: {set(schema['required']) - set(value)} missing"
        for key, entry in value.items():
            if key in properties:
                valid(entry, properties[key], f"{where}.{key}")
            else:
                assert further, f"{where}: unknown key {key}"
                if isinstance(further, dict):
                    valid(entry, further, f"{where}.{key}")
    if schema["type"] == "array":
        assert schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", len(value)), where
        for i, entry in enumerate(value):
            valid(entry, schema["items"], f"{where}[{i}]")
    return None


FILES = sorted(
    path
    for folder in (shipped.folder(), shipped.folder() / shipped.VERIFICATION, shipped.folder() / shipped.TEMPLATES)
    for path in folder.glob("*.toml")
    if path.stem not in ("cases", "study")
)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_shipped_scenarios_hold_to_the_schema(path):
    valid(tomllib.loads(path.read_text()), keys.json_schema())


@pytest.mark.parametrize(
    "key, value",
    [("joint.friktion", 0.5), ("joint.friction", "rough"), ("control.kind", "push"), ("gravity", [0.0, 0.0])],
)
def test_the_schema_refuses_what_is_wrong(key, value):
    document = tomllib.loads((shipped.folder() / "set4a.toml").read_text())
    *tables, last = key.split(".")
    place = document
    for table in tables:
        place = place[table]
    place[last] = value
    with pytest.raises(AssertionError):
        valid(document, keys.json_schema())


def test_the_command_prints_and_writes_the_schema(folder, capsys):
    assert cli.main(["schema"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["properties"]["joint"]["properties"]["friction"]["description"].startswith("coefficient of Coulomb")
    assert cli.main(["schema", "--out", "s.json"]) == 0
    assert json.loads((folder / "s.json").read_text()) == printed
    assert cli.main(["schema", "--out", "s.json"]) == 2


def test_scenarios_name_the_schema_that_ships():
    """The shipped schema is current; `dembrick schema --out scenarios/scenario.schema.json` rewrites it."""
    kept = shipped.folder() / shipped.SCHEMA
    assert json.loads(kept.read_text(encoding="utf-8")) == keys.json_schema()
    for path in shipped.folder().rglob("*.toml"):
        if "control" in tomllib.loads(path.read_text(encoding="utf-8")):
            line = path.read_text(encoding="utf-8").splitlines()[0]
            assert line.startswith("#:schema ") and (path.parent / line.split()[1]).resolve() == kept.resolve(), path
