"""Key numbers as name, value and remark: tables of them, and their output as lines of text."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, TypeAlias

from dembrick.views.summary import NO_BAR, ValueWithRemark, plain

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


Table: TypeAlias = Mapping[str, Callable[[Mapping], ValueWithRemark | None]]  # name: function that finds it in results


def evaluate(table: Table, results: Mapping) -> list[KeyNumber]:
    """The key numbers of a ``table`` that results contain."""
    found = ((name, of(results)) for name, of in table.items())
    return [KeyNumber(name, *told) for name, told in found if told is not None]


def refuses_refining(results: Mapping) -> bool:
    """Whether ``--refine`` is refused: for runs with stages, and with user-defined joint laws."""
    return "stages" in results or "custom_law" in results


def no_bar(results: Mapping) -> str:
    """Remark that a number has no error bar, and how to get one if that is possible."""
    return NO_BAR.partition(":")[0] if refuses_refining(results) else NO_BAR
