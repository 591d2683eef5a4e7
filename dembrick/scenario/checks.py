"""Checks of what a user writes: each turns a value into what the model stores, or says what is wrong with it.

Types, lengths and bounds; the messages name the key and the value as TOML writes it. No module stands lower but
``errors``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from numbers import Real
from typing import TypeVar

from dembrick.errors import ScenarioError

T = TypeVar("T")


class Faults:
    """The errors of an input, gathered while it is read on, so that all of them are told at once."""

    MOST = 20  # that are told

    def __init__(self) -> None:
        self.found: list[str] = []

    def add(self, message: str) -> None:
        """One more; the same again is left out."""
        if message not in self.found:
            self.found.append(message)

    @contextmanager
    def kept(self) -> Iterator[None]:
        """Within, a ScenarioError is kept and ends no more than what is within."""
        try:
            yield
        except ScenarioError as error:
            for message in str(error).split("\n"):
                self.add(message)

    def tell(self) -> None:
        """ScenarioError with all of them, a line each, if there are any."""
        if self.found:
            more = len(self.found) - self.MOST
            raise ScenarioError("\n".join(self.found[: self.MOST] + [f"and {more} more"] * (more > 0)))


def present(value: T | None) -> T:
    """A value that the checks of its class left in place: never None by now. For the type checker."""
    assert value is not None
    return value


def show(value: object) -> str:
    """A value as it stands in a message: as TOML writes it where that is short, never longer than a line."""
    if isinstance(value, bool):
        return "true" if value else "false"
    try:
        if isinstance(value, dict):
            text = f"{{ {', '.join(f'{key} = {show(own)}' for key, own in value.items())} }}"
        else:
            text = repr(list(value)) if isinstance(value, tuple) else repr(value)
    except (ValueError, RecursionError):  # integers of thousands of digits, lists in lists without end
        text = f"<{type(value).__name__}>"
    return text if len(text) <= 80 else text[:77] + "..."


def nearest(word: str, known: Iterable[str], elsewhere: Sequence[str] = ()) -> str:
    """The end of a message about an unknown ``word``: what was probably meant, else the places ``elsewhere`` that have
    it, else all that is known."""
    from difflib import get_close_matches

    names = {name.lower(): name for name in known}
    if not names:
        return "there is none"
    if likely := get_close_matches(word.lower(), names, 1):
        return f"did you mean {show(names[likely[0]])}?"
    if elsewhere:
        return f"it is a key of {', '.join(elsewhere[:4])}{', ...' if len(elsewhere) > 4 else ''}"
    nearest = sorted(get_close_matches(word.lower(), names, 20, cutoff=0.0))
    return f"known: {', '.join(show(names[name]) for name in nearest)}{', ...' if len(names) > 20 else ''}"


def require(condition: bool, key: str, value: object, bound: str) -> None:
    """ScenarioError "... is out of range", or "is missing", unless ``condition`` holds; ``bound`` says what would be
    right."""
    if not condition and value is None:
        raise ScenarioError(f"{key} is missing: {bound}")
    if not condition:
        raise ScenarioError(f"{key} = {show(value)} is out of range: {bound}")


def require_type(condition: bool, key: str, value: object, wanted: str) -> None:
    """ScenarioError "... is of the wrong type" unless ``condition`` holds."""
    if not condition:
        raise ScenarioError(f"{key} = {show(value)} is of the wrong type: it must be {wanted}")


def real(key: str, value) -> float:
    """A finite float out of an integer or a float; a truth value or a text is neither."""
    if type(value) is float and math.isfinite(value):  # nearly always, and a wall has some ten numbers a block
        return value
    require_type(isinstance(value, Real) and not isinstance(value, bool), key, value, "a number")
    try:
        result = float(value)
    except OverflowError:
        result = math.inf
    require(math.isfinite(result), key, value, "it must be a finite number")
    return result


def vector(key: str, value, length: int = 3, label: str = "") -> tuple[float, ...]:
    """A tuple of ``length`` finite floats; ``label`` says whose, " of block 'upper'"."""
    of_floats = type(value) is tuple and len(value) == length and {*map(type, value)} == {float}
    if of_floats and all(map(math.isfinite, value)):
        return value
    value = value.tolist() if hasattr(value, "tolist") else value
    require_type(isinstance(value, list | tuple), key + label, value, f"a list of {length} numbers")
    require(len(value) == length, key + label, value, f"it must have {length} numbers, not {len(value)}")
    return tuple(real(f"{key}[{i}]{label}", component) for i, component in enumerate(value))


def unit_vector(vector: tuple[float, ...]) -> tuple[float, ...]:
    """The vector at length 1; one that has it already is left alone to the last bit (so text round trips exactly)."""
    if abs(math.hypot(*vector) - 1.0) <= 1e-15:
        return vector
    largest = max(abs(component) for component in vector)  # scaled first: the square of 1e-200 is nothing
    scaled = [component / largest for component in vector]
    length = math.hypot(*scaled)
    return tuple(component / length for component in scaled)


def direction(key: str, value, label: str = "") -> tuple[float, ...]:
    """Three numbers that are not all zero, at length 1."""
    found = vector(key, value, label=label)
    require(any(found), key + label, found, "its length must be greater than 0")
    return unit_vector(found)


def one_line(key: str, value) -> str:
    """A text of one line, printable."""
    require_type(isinstance(value, str), key, value, "a text")
    require(value.isprintable(), key, value, "it must be one line of printable characters")
    return value


def check_name(key: str, value) -> str:
    """A name: one line, not empty."""
    require(one_line(key, value) != "", key, value, "a name must not be empty")
    return value


def one_of(key: str, value, choices: tuple[str, ...]) -> None:
    """ScenarioError unless ``value`` is one of the texts ``choices``."""
    require_type(isinstance(value, str), key, value, f"one of {', '.join(choices)}")
    if value not in choices:
        raise ScenarioError(f"{key} = {show(value)} is not one of {', '.join(choices)}; {nearest(value, choices)}")


def members_of(key: str, value, kind: type) -> tuple:
    """A tuple of instances of ``kind``."""
    require_type(isinstance(value, list | tuple), key, value, f"a list of {kind.__name__}")
    for i, member in enumerate(value):
        require_type(isinstance(member, kind), f"{key}[{i}]", member, f"a {kind.__name__}")
    return tuple(value)


def assign(instance: object, **values: object) -> None:
    """Store fields of a frozen dataclass, for use in its ``__post_init__``."""
    for key, value in values.items():
        object.__setattr__(instance, key, value)
