"""Result of a quasi-static settlement: the reaction along the motion over the displacement, and the collapse."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from dembrick.runs.collapse import collapse_lines
from dembrick.runs.motion_result import MotionResult

if TYPE_CHECKING:
    from dembrick.simulation.dynamics.run import EquilibriaRun


@dataclasses.dataclass(repr=False)
class SettlementResult(MotionResult):
    """Result of a quasi-static settlement: equilibria in the deformed geometry, up to the end or to the last before the
    structure came down. ``reaction_error`` (N): of the reaction along the motion, from refined runs."""

    run: EquilibriaRun
    reaction_error: float | None = None

    @property
    def settlement(self) -> dict:
        """The object ``settlement`` of the JSON output: displacement (m) and reaction along the motion (N) at the last
        equilibrium, before the supports moved (``at_rest``), and where it was least and greatest since."""
        path = self.run.path
        moved = path[1:] if len(path) > 1 else path
        least, greatest = moved[np.argmin(moved[:, 1])], moved[np.argmax(moved[:, 1])]
        return {
            "displacement": float(path[-1, 0]),
            "reaction": float(path[-1, 1]),
            "reaction_error": self.reaction_error,
            "at_rest": float(path[0, 1]),
            "least": {"reaction": float(least[1]), "displacement": float(least[0])},
            "greatest": {"reaction": float(greatest[1]), "displacement": float(greatest[0])},
            "equilibria": len(path),
        }

    @property
    def uncertain(self) -> float:
        """Number that an error estimate compares: the settlement at the collapse (m), else the reaction at the end
        (N)."""
        return self.settlement["reaction"] if self.collapse is None else self.collapse["settlement"]

    def take_error(self, estimate: float) -> None:
        """Keep the error estimate of what is uncertain; that of a collapse counts its range too."""
        if self.collapse is None:
            self.reaction_error = estimate
        else:
            low, high = self.collapse["settlement_range"]
            self.collapse["error_estimate"] = estimate + 0.5 * (high - low)

    def as_dict(self) -> dict:
        return super().as_dict() | {"settlement": self.settlement, "simulated_time": None}

    def text(self) -> str:
        found, motion = self.settlement, self.run.motion
        lines = self.heading_lines
        if self.collapse is not None:
            lines += collapse_lines(self.collapse)
        bar = "no error bar: --refine gives one" if self.reaction_error is None else f"+- {self.reaction_error:.2g} N"
        lines.append(
            f"reaction      {found['reaction']:.6g} N along the motion ({bar}) at {found['displacement']:.6g} m"
        )
        for key in ("least", "greatest"):
            at = found[key]
            lines.append(f"  {key:8}    {at['reaction']:.6g} N at {at['displacement']:.4g} m")
        lines.append(f"  at rest     {found['at_rest']:.6g} N")
        lines += self.force_lines
        lines.append(f"out of balance {self.run.unbalanced:.2g} of the joint forces, at the most")
        lines.append(
            f"equilibria    {found['equilibria']}, by {motion.steps} steps of relaxation, loop "
            f"{self.run.loop_seconds:.3g} s"
        )
        lines.append(f"history       {self.history}")
        return "\n".join(lines)
