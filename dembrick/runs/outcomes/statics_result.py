"""Result of kind = "statics": stands or falls, by which mechanism, and the reactions of the supports."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

from dembrick.runs.outcomes.result import RunResult, SearchResult
from dembrick.simulation import load_increments
from dembrick.simulation.statics.rest.dead_load import DECIDES, does_not_stand, undecided

if TYPE_CHECKING:
    from dembrick.simulation.statics.rest.dead_load import Standing


class RestResult(RunResult):
    """Whether the blocks stand under their dead loads, in the geometry of the start or in the deformed one."""

    collapse = None
    yield_point = None  # no load was increased

    if TYPE_CHECKING:

        @property
        def statics(self) -> dict[str, Any]: ...  # the object ``statics`` of the JSON output

        @property
        def plain_answer(self) -> str: ...  # the answer in a sentence

    @property
    def status(self) -> str:
        """ "stands" or "falls", which are answers, or "undecided"."""
        return {True: "stands", False: "falls", None: "undecided"}[self.statics["stands"]]

    @property
    def reactions(self) -> dict[str, list[float]] | None:
        """Reactions at the equilibrium; None if there is none."""
        return super().reactions if self.statics["stands"] else None


@dataclasses.dataclass(repr=False)
class StaticsResult(RestResult, SearchResult):
    """Whether the blocks stand in the geometry of the start. ``rows`` and ``frames`` hold the one state in which the
    search ended: an equilibrium, or blocks that keep falling. SI units."""

    run: Standing

    @property
    def statics(self) -> dict[str, Any]:
        """The object ``statics`` of the JSON output."""
        rest = self.run.rest
        return {
            "stands": rest.stands,
            "unbalanced": rest.unbalanced,
            "mechanism": rest.mechanism,
            "blocks": [self.assembly.names[i] for i in rest.blocks],
            **load_increments.described(rest.increments, rest.path_error, rest.force_error),
        }

    @property
    def plain_answer(self) -> str:
        """The answer in a sentence."""
        rest = self.run.rest
        if rest.stands is None:
            return f"{undecided(rest)}. {DECIDES}"
        return "stands under its dead loads" if rest.stands else does_not_stand(rest, self.assembly.names)

    def as_dict(self) -> dict:
        """The JSON object of ``dembrick run --json``."""
        rest = self.run.rest
        unknown = {"error": self.plain_answer} if rest.stands is None else {}
        return self._dict(
            status=self.status,
            answer=self.plain_answer,
            statics=self.statics,
            collapse=None,
            yield_point=None,
            theory=None,
            steps=rest.steps,
            unbalanced=rest.unbalanced,
            control_points=self.control_points,
            **unknown,
        )
