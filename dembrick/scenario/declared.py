"""Keys of a scenario, each declared once in the metadata of its dataclass field: unit, allowed values, meaning.

Classes check their values against these (`check_keys`); the reference and the JSON schema are generated from them
(`keys`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cache, partial
from numbers import Integral
from typing import Any

from dembrick.scenario.checks import (
    assign,
    check_name,
    direction,
    members_of,
    one_of,
    real,
    require,
    require_type,
    vector,
)

Check = Callable[[str, Any, str], Any]
METADATA = "key"


@dataclass(frozen=True, slots=True)
class Key:
    """Declaration of a key: its ``unit`` ("" if it has none), the ``allowed`` values and the ``meaning`` in words; the
    ``choices`` of a text if there are few.

    ``check`` takes a key, its value and a label (naming the owner); it returns the value to store, or raises a
    ScenarioError. It is None if the class checks the key together with others.
    """

    unit: str
    allowed: str
    meaning: str
    check: Check | None = None
    choices: tuple[str, ...] = ()


def declare(allowed: str, meaning: str, unit: str = "", check: Check | None = None) -> dict[str, Key]:
    """Metadata of a field, with an optional check of its own."""
    return {METADATA: Key(unit, allowed, meaning, check)}


def number(unit: str, meaning: str) -> dict[str, Key]:
    """Metadata of any finite number."""
    return declare("a number", meaning, unit, _number)


def positive(unit: str, meaning: str, bound: str = "") -> dict[str, Key]:
    """Metadata of a number above 0; ``bound``: how a message puts it."""
    return declare("> 0", meaning, unit, partial(_above, unit=_named(unit), bound=bound))


def not_negative(unit: str, meaning: str, most: str = "") -> dict[str, Key]:
    """Metadata of a number of at least 0; ``most``: the upper bound that its class sets, in words."""
    return declare(f"0 to {most}" if most else ">= 0", meaning, unit, partial(_least, unit=_named(unit)))


def within(least: float, most: float, unit: str, meaning: str, bound: str) -> dict[str, Key]:
    """Metadata of a number from ``least`` to ``most``; ``bound``: how a message puts it."""
    allowed = " to ".join(f"{end:g}".replace("e-0", "e-") for end in (least, most))
    return declare(allowed, meaning, unit, partial(_within, least=least, most=most, bound=bound))


def count(least: int, meaning: str) -> dict[str, Key]:
    """Metadata of a whole number of at least ``least``."""
    return declare(f"whole number >= {least}", meaning, "1", partial(_count, least=least))


def truth(meaning: str) -> dict[str, Key]:
    """Metadata of a boolean."""
    return declare("true, false", meaning, "", _truth)


def choice(choices: tuple[str, ...], meaning: str) -> dict[str, Key]:
    """Metadata of a text from a list of choices."""
    return {METADATA: Key("", ", ".join(choices), meaning, partial(_choice, choices=choices), choices)}


def naming(allowed: str, meaning: str) -> dict[str, Key]:
    """Metadata of a non-empty text of one line."""
    return declare(allowed, meaning, "", lambda key, value, label: check_name(key + label, value))


def vector_of(unit: str, meaning: str) -> dict[str, Key]:
    """Metadata of three numbers."""
    return declare("3 numbers", meaning, unit, lambda key, value, label: vector(key, value, label=label))


def unit_vector(meaning: str) -> dict[str, Key]:
    """Metadata of three numbers, scaled to length 1."""
    return declare("3 numbers", meaning, "1", direction)


def tables(kind: type, meaning: str) -> dict[str, Key]:
    """Metadata of a list of tables."""
    return declare("tables", meaning, "", lambda key, value, label: members_of(key + label, value, kind))


def table(kind: type, meaning: str) -> dict[str, Key]:
    """Metadata of a table."""
    return declare("table", meaning, "", partial(_table, kind=kind))


def key_of(field: Any) -> Key | None:
    """Declaration of a dataclass field; None if it is not a key."""
    return field.metadata.get(METADATA)


def check_keys(instance: Any, label: str = "") -> None:
    """Check and store the keys of a frozen dataclass, in its ``__post_init__``; ``label`` names the owner, as in " of
    block 'upper'". A None that is the default is kept. Raises ScenarioError."""
    for key, check, optional in _checks(instance.__class__):
        value = getattr(instance, key)
        if value is not None or not optional:
            assign(instance, **{key: check(key, value, label)})


@cache
def _checks(kind: type) -> list[tuple[str, Check, bool]]:
    declared = ((field, key_of(field)) for field in fields(kind))
    return [(field.name, key.check, field.default is None) for field, key in declared if key and key.check]


def _named(unit: str) -> str:
    """A unit as messages write it; empty for a plain number."""
    return "" if unit == "1" else f" {unit}"


def _number(key: str, value: Any, label: str) -> float:
    return real(key + label, value)


def _above(key: str, value: Any, label: str, unit: str, bound: str) -> float:
    found = real(key + label, value)
    require(found > 0.0, key + label, found, bound or f"it must be greater than 0{unit}")
    return found


def _least(key: str, value: Any, label: str, unit: str) -> float:
    found = real(key + label, value)
    require(found >= 0.0, key + label, found, f"it must be at least 0{unit}")
    return found


def _within(key: str, value: Any, label: str, least: float, most: float, bound: str) -> float:
    found = real(key + label, value)
    require(least <= found <= most, key + label, found, bound)
    return found


def _count(key: str, value: Any, label: str, least: int) -> int:
    whole = isinstance(value, Integral) and not isinstance(value, bool)
    require_type(whole, key + label, value, "a whole number")
    require(value >= least, key + label, value, f"it must be at least {least}")
    return int(value)


def _truth(key: str, value: Any, label: str) -> bool:
    require_type(isinstance(value, bool), key + label, value, "true or false")
    return value


def _choice(key: str, value: Any, label: str, choices: tuple[str, ...]) -> str:
    one_of(key + label, value, choices)
    return value


def _table(key: str, value: Any, label: str, kind: type) -> Any:
    require_type(isinstance(value, kind), key + label, value, f"a {kind.__name__}")
    return value
