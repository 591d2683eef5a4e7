"""Result of kind = "statics": stands or falls, by which mechanism, and the reactions of the supports."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

from dembrick.runs.outcomes.motion_result import MotionResult
from dembrick.runs.outcomes.result import RunResult
from dembrick.scenario.checks import present
from dembrick.scenario.regimes import DEFORMED_REST
from dembrick.simulation import load_increments
from dembrick.simulation.statics.rest.dead_load import DECIDES, does_not_stand, undecided

if TYPE_CHECKING:
    from dembrick.simulation.dynamics.paths.load_path import LoadPathRun
    from dembrick.simulation.statics.rest.dead_load import Rest, Standing


@dataclasses.dataclass(repr=False)
class StaticsResult(RunResult):
    """Whether the blocks stand under their dead loads, in the geometry of the start or in the deformed one. ``rows``
    and ``frames`` hold the one state in which the search ended: an equilibrium, or blocks that keep falling. SI units.
    """

    run: Standing | LoadPathRun

    @property
    def motion(self) -> MotionResult | None:
        """Displacements of the blocks in the deformed geometry, as of a run in motion; None in the geometry of the
        start."""
        if self.scenario.control.regime is not DEFORMED_REST:
            return None
        return MotionResult(**{one.name: getattr(self, one.name) for one in dataclasses.fields(self)})

    @property
    def _rest(self) -> Rest:
        return present(self.run.rest)

    @property
    def status(self) -> str:
        """ "stands" or "falls", which are answers, or "undecided"."""
        return {True: "stands", False: "falls", None: "undecided"}[self._rest.stands]

    @property
    def statics(self) -> dict[str, Any]:
        """The object ``statics`` of the JSON output."""
        rest = self._rest
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
        rest = self._rest
        if rest.stands is None:
            return f"{undecided(rest)}. {DECIDES}"
        told = "stands under its dead loads" if rest.stands else does_not_stand(rest, self.assembly.names)
        return told if self.motion is None else f"{told} in the deformed geometry"

    @property
    def reactions(self) -> dict[str, list[float]] | None:
        """Reactions at the equilibrium; None if there is none."""
        return super().reactions if self._rest.stands else None

    def entries(self) -> dict:
        rest, motion = self._rest, self.motion
        return {
            **({} if motion is None else motion.entries()),
            "status": self.status,
            "answer": self.plain_answer,
            "statics": self.statics,
            "collapse": None,
            "yield_point": None,
            "theory": None,
            "steps": rest.steps,
            "unbalanced": rest.unbalanced,
            "control_points": self.control_points,
            **({"error": self.plain_answer} if rest.stands is None else {}),
        }
