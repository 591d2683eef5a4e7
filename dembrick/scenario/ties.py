"""Ties: bars, cables or props between two points of two blocks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from dembrick.errors import ScenarioError
from dembrick.scenario.blocks import Vector
from dembrick.scenario.checks import assign, assign_positive, check_name, real, require, require_type, show, vector
from dembrick.scenario.stages import stage_numbers


@dataclass(frozen=True, slots=True)
class TieEnd:
    """An end of a tie: a material ``point`` (m, world at the start) of a ``block``."""

    block: str
    point: Vector

    def __post_init__(self):
        label = f" of the end of a tie on block {show(check_name('block', self.block))}"
        assign(self, point=vector("point", self.point, label=label))


@dataclass(frozen=True, slots=True)
class Tie:
    """A bar between two points of two blocks: ``stiffness`` (N/m) along the line between them, ``prestress`` (N) from
    the start, yielding without end at ``strength`` (N; None: it never yields). With ``tension_only`` it is slack where
    it would push. ``stages``: numbers of the stages in which it is there, None for all; it has its prestress at the
    length with which it comes.
    """

    between: tuple[TieEnd, TieEnd]
    stiffness: float
    strength: float | None = None
    prestress: float = 0.0
    tension_only: bool = True
    stages: tuple[int, ...] | None = None

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
            raise ScenarioError(f"both ends{label} are at one point, so that it has no direction; move one of them")
        assign(self, between=tuple(ends), prestress=real(f"prestress{label}", self.prestress))
        assign_positive(self, "stiffness", "N/m", label)
        require_type(isinstance(self.tension_only, bool), f"tension_only{label}", self.tension_only, "true or false")
        assign(self, stages=stage_numbers(f"stages{label}", self.stages))
        if self.strength is not None:
            assign_positive(self, "strength", "N", label)
            bound = f"the tie yields at its strength of {self.strength:g} N"
            require(abs(self.prestress) <= self.strength, f"prestress{label}", self.prestress, bound)
        slack = self.prestress >= 0.0 or not self.tension_only
        require(slack, f"prestress{label}", self.prestress, "a tie that takes tension only has none below 0 N")
