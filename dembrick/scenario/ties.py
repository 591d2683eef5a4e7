"""Ties: bars, cables or props between two points of two blocks."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from dembrick.errors import ScenarioError
from dembrick.scenario.blocks import Vector
from dembrick.scenario.checks import assign, check_name, require, require_type, show
from dembrick.scenario.declared import check_keys, declare, naming, number, positive, truth, vector_of
from dembrick.scenario.stages import stages_of


@dataclass(frozen=True, slots=True)
class TieEnd:
    """An end of a tie: a material ``point`` (m, world at the start) of a ``block``."""

    block: str = field(metadata=naming("a block", "the block to which this end is fastened"))
    point: Vector = field(metadata=vector_of("m", "where, world position at the start, in the block or on a face"))

    def __post_init__(self):
        label = f" of the end of a tie on block {show(check_name('block', self.block))}"
        check_keys(self, label)


@dataclass(frozen=True, slots=True)
class Tie:
    """A bar between two points of two blocks: ``stiffness`` (N/m) along the line between them, ``prestress`` (N) from
    the start, perfectly plastic at ``strength`` (N; None: elastic). With ``tension_only`` it goes slack instead of
    carrying compression. ``stages``: numbers of the stages in which it is active, None for all; it has its prestress at
    its length on installation.
    """

    between: tuple[TieEnd, TieEnd] = field(metadata=declare("2 tables", "the ends of the tie"))
    stiffness: float = field(metadata=positive("N/m", "force over elongation"))
    strength: float | None = field(
        default=None, metadata=positive("N", "yield force, without limit of elongation; left out, it never yields")
    )
    prestress: float = field(default=0.0, metadata=number("N", "force at the start, or when the tie is added"))
    tension_only: bool = field(default=True, metadata=truth("slack instead of pushing; false for a bar or a spring"))
    stages: tuple[int, ...] | None = field(
        default=None,
        metadata=stages_of("the stages in which the tie acts; left out, all. It is added with its prestress"),
    )

    def __post_init__(self):
        ends: Any = self.between
        pair = isinstance(ends, list | tuple) and all(isinstance(end, TieEnd) for end in ends)
        require_type(pair, "between", ends, "a list of two ends, each with block and point")
        require(len(ends) == 2, "between", len(ends), "a tie has two ends")
        names = [end.block for end in ends]
        label = f" of the tie between {show(names[0])} and {show(names[1])}"
        if names[0] == names[1]:
            raise ScenarioError(
                f"the tie between {show(names[0])} and itself lies inside one block, which is rigid; tie two blocks"
            )
        if ends[0].point == ends[1].point:
            raise ScenarioError(f"both ends{label} are at one point, so the tie has no direction; move one of them")
        assign(self, between=tuple(ends))
        check_keys(self, label)
        if self.strength is not None:
            bound = f"the tie yields at its strength of {self.strength:g} N"
            require(abs(self.prestress) <= self.strength, f"prestress{label}", self.prestress, bound)
        slack = self.prestress >= 0.0 or not self.tension_only
        require(slack, f"prestress{label}", self.prestress, "it must be at least 0 N, as the tie takes tension only")
