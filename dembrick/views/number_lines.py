"""Key numbers as name, value and remark, how they are declared, and the lines that they make."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from dembrick.views.summary import NO_BAR, plain

_COLUMN = 13  # characters, or more


class KeyNumber(NamedTuple):
    """One line of a summary: what it is, its value with unit and error bar, and what to know about it."""

    name: str
    value: str
    remark: str = ""


def aligned(numbers: Sequence[KeyNumber]) -> list[str]:
    """Key numbers as lines of the command line, names in a column."""
    width = max([_COLUMN, *(len(number.name) for number in numbers)])
    return [plain(f"{name:{width}} {value}{f' ({remark})' if remark else ''}") for name, value, remark in numbers]


class Told(NamedTuple):
    """Value of a key number with unit and error bar, and what to know about it."""

    value: str
    remark: str = ""


class Declared(NamedTuple):
    """Declaration of a key number, of which ``run``, ``info``, pages and notebooks are made: its ``name``, and how
    results tell it, None if they do not (``of``).

    ``only`` and ``unless``: a key that results must have, or must not.
    """

    name: str
    of: Callable[[Mapping], Told | None]
    only: str = ""
    unless: str = ""


def told_by(declared: Sequence[Declared], results: Mapping) -> list[KeyNumber]:
    """Key numbers of results, those of a table that they have."""
    found = []
    for one in declared:
        if (one.only and one.only not in results) or (one.unless and one.unless in results):
            continue
        told = one.of(results)
        if told is not None:
            found.append(KeyNumber(one.name, *told))
    return found


def refuses_refining(results: Mapping) -> bool:
    """Whether ``--refine`` is refused: of runs with stages, and of laws of the user's own."""
    return "stages" in results or "custom_law" in results


def no_bar(results: Mapping) -> str:
    """That a number has no error bar, and what gives it one, if anything does."""
    return NO_BAR.partition(":")[0] if refuses_refining(results) else NO_BAR
