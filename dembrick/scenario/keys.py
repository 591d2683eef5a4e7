"""Keys of a scenario, table by table, as the reference pages and the JSON schema list them.

Everything is derived from the dataclasses: types, defaults and the declarations of the fields (`declared`).
"""

from __future__ import annotations

import types
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from typing import Any, Union, get_args, get_origin, get_type_hints

from dembrick.scenario.blocks import Block, Mesh, Part, Prism, Voussoir
from dembrick.scenario.cad_models import CadModel
from dembrick.scenario.controls import CONTROLS, Control
from dembrick.scenario.declared import Key, key_of
from dembrick.scenario.generators import Arch, Dome, Opening, Return, Stack, Wall
from dembrick.scenario.model import (
    Actuator,
    ControlPoint,
    JointLaw,
    JointOverride,
    Load,
    Material,
    Output,
    Scenario,
    Solver,
)
from dembrick.scenario.pressures import Fill, Pressure
from dembrick.scenario.ties import Tie, TieEnd
from dembrick.scenario.time_functions import Pulse, Sine, SupportPath, Turn

NOT_KEYS = {"text", "path", "files", "among"}  # fields of dataclasses that files cannot contain


@cache
def keys_of(table: type) -> dict[str, Key]:
    """Name -> declaration of each key of a dataclass of the scenario."""
    return {field.name: key for field in fields(table) if (key := key_of(field)) is not None}


def tables() -> dict[str, type]:
    """Heading in a TOML file -> dataclass, in the order of the reference."""
    found: dict[str, type] = {"": Scenario, "[joint]": JointLaw, "[[joints]]": JointOverride}
    found |= {"[materials.NAME]": Material, "[[blocks]]": Block}
    found |= {"prism = {}": Prism, "voussoir = {}": Voussoir, "mesh = {}": Mesh, "parts = [{}]": Part}
    found |= {"[[walls]]": Wall, "openings = [{}]": Opening, "returns = [{}]": Return}
    found |= {"[[stacks]]": Stack, "[[arches]]": Arch, "[[domes]]": Dome, "[[models]]": CadModel}
    found |= {"[[loads]]": Load, "[[actuators]]": Actuator, "[[pressures]]": Pressure, "[[fills]]": Fill}
    found |= {"[[ties]]": Tie, "between = [{}] of [[ties]]": TieEnd}
    found |= {"sine = {}": Sine, "pulse = {}": Pulse, "[[control_points]]": ControlPoint}
    found |= {"rotation = {}": Turn, "motions = [{}]": SupportPath}
    found |= {f'[control] kind = "{kind}"': control for kind, control in CONTROLS.items()}
    return found | {"[solver]": Solver, "[output]": Output}


def tables_with(key: str) -> list[str]:
    """Headings of the tables that have a key of this name; all kinds of control count as one."""
    having = (heading for heading, table in tables().items() if heading and key in keys_of(table))
    return list(dict.fromkeys(heading.partition(" kind")[0] for heading in having))


def default_of(field) -> Any:
    """Default of a dataclass field; MISSING if it has none."""
    if field.default is not MISSING:
        return field.default
    return field.default_factory() if field.default_factory is not MISSING else MISSING


def written_fields(table: type) -> list:
    """The fields of a table that a file may contain."""
    return [field for field in fields(table) if field.init and field.name not in NOT_KEYS]


# --- JSON schema -----------------------------------------------------------------------------------------------------


def json_schema() -> dict:
    """JSON schema (draft 2020-12) of a scenario file, for completion and checks in editors."""
    schema = _object(Scenario)
    control = {"oneOf": [_object(control) for control in CONTROLS.values()]}
    schema["properties"] |= {"control": control, "stages": {"type": "array", "items": control}}
    schema["properties"]["joints"] = {"type": "array", "items": _override()}
    schema["properties"]["materials"] = {"type": "object", "additionalProperties": _object(Material)}
    schema["required"] = [*(key for key in schema["required"] if key != "blocks"), "control"]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "dembrick scenario",
        **schema,
    }


def _override() -> dict:
    law = _object(JointLaw)
    between = {"type": "array", "items": {"type": "string"}, "minItems": 2, "maxItems": 2}
    stages = _object(JointOverride)["properties"]["stages"]
    return {**law, "properties": {"between": between, "stages": stages, **law["properties"]}, "required": ["between"]}


def _object(kind: Any) -> dict:
    hints, told = get_type_hints(kind), keys_of(kind)
    properties, required = {}, []
    for field in written_fields(kind):
        key = told[field.name]
        meaning = f"{key.meaning} [{key.unit}]" if key.unit not in ("", "1") else key.meaning
        properties[field.name] = {"description": meaning, **_type(hints[field.name])}
        default = default_of(field)
        if default is MISSING:
            required.append(field.name)
        elif isinstance(default, bool | int | float | str):
            properties[field.name]["default"] = default
        if key.choices:
            properties[field.name]["enum"] = list(key.choices)
    if issubclass(kind, Control):
        properties = {"kind": {"const": kind.kind}, **properties}
        required.insert(0, "kind")
    if kind is JointLaw:  # a file may have this instead of two numbers
        properties["points"] = {"anyOf": [properties["points"], {"const": "auto"}]}
    return {"type": "object", "properties": properties, "required": required, "additionalProperties": False}


def _type(hint: Any) -> dict:
    origin = get_origin(hint)
    if origin in (Union, types.UnionType):
        kinds = [_type(part) for part in get_args(hint) if part is not type(None)]
        return kinds[0] if len(kinds) == 1 else {"anyOf": kinds}
    if origin is tuple:
        parts = get_args(hint)
        if parts[-1] is Ellipsis:
            return {"type": "array", "items": _type(parts[0])}
        return {"type": "array", "items": _type(parts[0]), "minItems": len(parts), "maxItems": len(parts)}
    if is_dataclass(hint):
        return _object(hint)
    return {"type": {bool: "boolean", int: "integer", float: "number", str: "string"}.get(hint, "object")}
