"""What kind = "statics" gave: stands or falls, by which mechanism, and the reactions of the supports."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

from dembrick.runs.result import RunResult
from dembrick.simulation.statics.dead_load import does_not_stand
from dembrick.simulation.statics.state import rotations

if TYPE_CHECKING:
    from dembrick.simulation.statics.standing import Standing


@dataclasses.dataclass(repr=False)
class StaticsResult(RunResult):
    """Whether the blocks stand under their dead loads. ``rows`` and ``frames`` hold the one state in which the search
    ended: of rest, or of blocks that go on falling. SI units."""

    run: Standing
    collapse = None

    @property
    def status(self) -> str:
        """ "stands" or "falls"; both are answers."""
        return "stands" if self.run.rest.stands else "falls"

    @property
    def yield_point(self) -> None:
        """No load was increased."""

    @property
    def statics(self) -> dict:
        """The object ``statics`` of the JSON output."""
        rest = self.run.rest
        return {
            "stands": rest.stands,
            "unbalanced": rest.unbalanced,
            "mechanism": rest.mechanism,
            "blocks": [self.assembly.names[i] for i in rest.blocks],
        }

    @property
    def reactions(self) -> dict[str, list[float]] | None:
        """Those of the blocks at rest; None if blocks fall."""
        return super().reactions if self.run.rest.stands else None

    @property
    def plain_answer(self) -> str:
        """The answer in a sentence."""
        rest = self.run.rest
        return "stands under its dead loads" if rest.stands else does_not_stand(rest, self.assembly.names)

    @property
    def control_points(self) -> dict[str, list[float]]:
        """Displacement (3) of every control point from the start (m)."""
        watched, state = self.assembly.control_points, self.run.state
        if not watched.names:
            return {}
        way = watched.displacement(state.blocks.displacement, rotations(state))
        return dict(zip(watched.names, way.tolist(), strict=True))

    def agrees(self) -> bool:
        """There is no theory that this would be held against."""
        return True

    def as_dict(self) -> dict:
        """The JSON object of ``dembrick run --json``."""
        rest = self.run.rest
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
        )

    def text(self) -> str:
        """What the command line prints."""
        rest = self.run.rest
        lines = [self.scenario.title, f"formulation   {self.scenario.joint.formulation}", *self.stage_lines]
        lines.append(f"answer        {self.plain_answer}")
        lines += self.force_lines
        lines.append(f"out of balance {rest.unbalanced:.2g} of the joint forces after {rest.steps} steps")
        lines.append(f"history       {self.history}")
        return "\n".join(lines)
