"""Key numbers as name, value and remark: their declarations, and their output as lines of text."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from dembrick.views.summary import NO_BAR, plain

_COLUMN = 13  # least width of the column of names, characters


class KeyNumber(NamedTuple):
    """One line of a summary: its name, its value with unit and error bar, and a remark."""

    name: str
    value: str
    remark: str = ""


def aligned(numbers: Sequence[KeyNumber]) -> list[str]:
    """Key numbers as lines for the terminal, names in a column."""
    width = max([_COLUMN, *(len(number.name) for number in numbers)])
    return [plain(f"{name:{width}} {value}{f' ({remark})' if remark else ''}") for name, value, remark in numbers]


class ValueWithRemark(NamedTuple):
    """Value of a key number with unit and error bar, and a remark."""

    value: str
    remark: str = ""


class KeyNumberSpec(NamedTuple):
    """Declaration of a key number shown by ``run``, ``info``, pages and notebooks: its ``name``, and the function
    ``of`` that finds it in results, or returns None.

    ``only`` and ``unless``: a key that the results must have, or must not have.
    """

    name: str
    of: Callable[[Mapping], ValueWithRemark | None]
    only: str = ""
    unless: str = ""


def evaluate(declared: Sequence[KeyNumberSpec], results: Mapping) -> list[KeyNumber]:
    """The key numbers of a table of declarations that results contain."""
    found = []
    for one in declared:
        if (one.only and one.only not in results) or (one.unless and one.unless in results):
            continue
        told = one.of(results)
        if told is not None:
            found.append(KeyNumber(one.name, *told))
    return found


def refuses_refining(results: Mapping) -> bool:
    """Whether ``--refine`` is refused: for runs with stages, and with user-defined joint laws."""
    return "stages" in results or "custom_law" in results


def no_bar(results: Mapping) -> str:
    """Remark that a number has no error bar, and how to get one if that is possible."""
    return NO_BAR.partition(":")[0] if refuses_refining(results) else NO_BAR
