"""Validation of user input: each check converts a value into its stored form, or raises an error that says what is
wrong.

Checks cover types, lengths and bounds; messages name the key and the value as TOML writes it. This is the lowest module
of the package but for ``errors``.
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
    """Errors of an input, collected while reading continues, so that all are reported at once."""

    MOST = 20  # messages that are reported

    def __init__(self) -> None:
        self.found: list[str] = []

    def add(self, message: str) -> None:
        """Add a message unless it is there already."""
        if message not in self.found:
            self.found.append(message)

    @contextmanager
    def kept(self) -> Iterator[None]:
        """Context in which a ScenarioError is collected; it ends only the body of the context."""
        try:
            yield
        except ScenarioError as error:
            for message in str(error).split("\n"):
                self.add(message)

    def tell(self) -> None:
        """Raise a ScenarioError with all messages, one per line, if there are any."""
        if self.found:
            more = len(self.found) - self.MOST
            raise ScenarioError("\n".join(self.found[: self.MOST] + [f"and {more} more"] * (more > 0)))


def present(value: T | None) -> T:
    """Return a value that the checks of its class have made sure is not None; for the type checker."""
    assert value is not None
    return value


def listed(names: Sequence[str], most: int = 5) -> str:
    """Names in a line, the first few if there are more than ``most``; "none" if there are none."""
    more = len(names) - most
    return f"{', '.join(names[:most]) or 'none'}{f' and {more} more' if more > 0 else ''}"


def show(value: object) -> str:
    """A value as messages show it: as TOML writes it, cut at the length of a line."""
    if isinstance(value, bool):
        return "true" if value else "false"
    try:
        if isinstance(value, dict):
            text = f"{{ {', '.join(f'{key} = {show(own)}' for key, own in value.items())} }}"
        else:
            text = repr(list(value)) if isinstance(value, tuple) else repr(value)
    except (ValueError, RecursionError):  # integers of thousands of digits, recursive lists
        text = f"<{type(value).__name__}>"
    return text if len(text) <= 80 else text[:77] + "..."


def nearest(word: str, known: Iterable[str], elsewhere: Sequence[str] = ()) -> str:
    """End of the message about an unknown ``word``: the probable meaning, else the places ``elsewhere`` where the word
    is known, else all known words."""
    from difflib import get_close_matches

    names = {name.lower(): name for name in known}
    if not names:
        return "there are none"
    if likely := get_close_matches(word.lower(), names, 1):
        return f"did you mean {show(names[likely[0]])}?"
    if elsewhere:
        return f"it is a key of {', '.join(elsewhere[:4])}{', ...' if len(elsewhere) > 4 else ''}"
    nearest = sorted(get_close_matches(word.lower(), names, 20, cutoff=0.0))
    return f"known: {', '.join(show(names[name]) for name in nearest)}{', ...' if len(names) > 20 else ''}"


def require(condition: bool, key: str, value: object, bound: str) -> None:
    """Raise a ScenarioError "... is out of range", or "is missing", unless ``condition`` is true; ``bound`` says what
    is allowed."""
    if not condition and value is None:
        raise ScenarioError(f"{key} is missing: {bound}")
    if not condition:
        raise ScenarioError(f"{key} = {show(value)} is out of range: {bound}")


def require_type(condition: bool, key: str, value: object, wanted: str) -> None:
    """Raise a ScenarioError "... is of the wrong type" unless ``condition`` is true."""
    if not condition:
        raise ScenarioError(f"{key} = {show(value)} is of the wrong type: it must be {wanted}")


def real(key: str, value) -> float:
    """Convert an integer or a float to a finite float; booleans and texts are refused."""
    if type(value) is float and math.isfinite(value):  # fast path: most values, ten or so per block
        return value
    require_type(isinstance(value, Real) and not isinstance(value, bool), key, value, "a number")
    try:
        result = float(value)
    except OverflowError:
        result = math.inf
    require(math.isfinite(result), key, value, "it must be a finite number")
    return result


def vector(key: str, value, length: int = 3, label: str = "") -> tuple[float, ...]:
    """Convert to a tuple of ``length`` finite floats; ``label`` names the owner, as in " of block 'upper'"."""
    of_floats = type(value) is tuple and len(value) == length and {*map(type, value)} == {float}
    if of_floats and all(map(math.isfinite, value)):
        return value
    value = value.tolist() if hasattr(value, "tolist") else value
    require_type(isinstance(value, list | tuple), key + label, value, f"a list of {length} numbers")
    require(len(value) == length, key + label, value, f"it must have {length} numbers, not {len(value)}")
    return tuple(real(f"{key}[{i}]{label}", component) for i, component in enumerate(value))


def unit_vector(vector: tuple[float, ...]) -> tuple[float, ...]:
    """The vector scaled to length 1; a vector of length 1 is returned bit for bit, so that text round-trips exactly."""
    if abs(math.hypot(*vector) - 1.0) <= 1e-15:
        return vector
    largest = max(abs(component) for component in vector)  # scaled first: the square of 1e-200 underflows to 0
    scaled = [component / largest for component in vector]
    length = math.hypot(*scaled)
    return tuple(component / length for component in scaled)


def direction(key: str, value, label: str = "") -> tuple[float, ...]:
    """Three numbers that are not all zero, scaled to length 1."""
    found = vector(key, value, label=label)
    require(any(found), key + label, found, "its length must be greater than 0")
    return unit_vector(found)


def one_line(key: str, value) -> str:
    """Check for a printable text of one line."""
    require_type(isinstance(value, str), key, value, "a text")
    require(value.isprintable(), key, value, "it must be one line of printable characters")
    return value


def check_name(key: str, value) -> str:
    """Check for a name: one line, not empty."""
    require(one_line(key, value) != "", key, value, "a name must not be empty")
    return value


def one_of(key: str, value, choices: tuple[str, ...]) -> None:
    """Raise a ScenarioError unless ``value`` is one of the texts ``choices``."""
    require_type(isinstance(value, str), key, value, f"one of {', '.join(choices)}")
    if value not in choices:
        raise ScenarioError(f"{key} = {show(value)} is not one of {', '.join(choices)}; {nearest(value, choices)}")


def members_of(key: str, value, kind: type) -> tuple:
    """Convert to a tuple of instances of ``kind``."""
    require_type(isinstance(value, list | tuple), key, value, f"a list of {kind.__name__}")
    for i, member in enumerate(value):
        require_type(isinstance(member, kind), f"{key}[{i}]", member, f"a {kind.__name__}")
    return tuple(value)


def assign(instance: object, **values: object) -> None:
    """Set fields of a frozen dataclass, for use in its ``__post_init__``."""
    for key, value in values.items():
        object.__setattr__(instance, key, value)
