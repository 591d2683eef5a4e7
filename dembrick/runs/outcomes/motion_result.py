"""Result of motion, in real time or as supports settle: the counterpart of ``result``.
For a shaken structure also: whether it stood or fell, its drift, its residual displacement.
"""

from __future__ import annotations

import dataclasses
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np

from dembrick.runs import left_out
from dembrick.runs.outcomes.result import RunResult
from dembrick.scenario.regimes import REAL_TIME, SETTLEMENT, SUPPORTS

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.runs.left_out import LeftOut
    from dembrick.simulation.dynamics.run import EquilibriaRun, MotionRun


@dataclasses.dataclass(repr=False)
class MotionResult(RunResult):
    """Result of a run in real time, or of a settlement through equilibria in the deformed geometry: the state it ended
    in, and the collapse if there was one.

    ``displacement`` of the rows is that of the block that has moved furthest; for a push, the driven one. Forces and
    energies are those of a step before the row. All motion is relative to the supports. ``displacement_error``: error
    estimate of the displacements (m), None if it was not asked for; of a settlement ``reaction_error`` (N) is that of
    the reaction along the motion. ``allowed``: least and greatest value (N) of that reaction before the supports move,
    by limit analysis, if that was asked for.
    """

    run: MotionRun
    displacement_error: float | None = None
    reaction_error: float | None = None
    allowed: dict | None = None

    @property
    def status(self) -> str:
        """ "collapse" if the run ended with one, else "completed"."""
        return self.run.status

    @property
    def collapse(self) -> dict | None:
        """Angle (deg), load factor, time (s), displacement (m), mechanism and blocks."""
        return self.run.collapse

    @property
    def displacement(self) -> np.ndarray:
        """How far every centroid has moved since the dead-load equilibrium (n, 3), in the frame of the supports (m)."""
        return self.run.motion.displacement

    @property
    def _furthest(self) -> tuple[float, str | None]:
        """Greatest displacement of a free block at the end (m), and that block; 0 and None without free blocks."""
        free = self.run.motion.state.bodies.free
        if not len(free):
            return 0.0, None
        far = np.linalg.norm(self.displacement[free], axis=1)
        return float(far.max()), self.assembly.names[free[np.argmax(far)]]

    @property
    def greatest_displacement(self) -> dict[str, float]:
        """Greatest displacement (m) of the centroid of every free block, over the rows."""
        free = self.run.motion.state.bodies.free.tolist()
        return {self.assembly.names[i]: float(self.run.furthest[i]) for i in free}

    @property
    def fallen(self) -> list[str]:
        """Blocks that have come down by more than half of their least dimension, or turned over, at the end."""
        return [self.assembly.names[i] for i in np.flatnonzero(self.run.fallen)]

    @property
    def not_standing(self) -> list[str]:
        """Blocks that find no equilibrium under the dead loads, and so fall from the start."""
        return [self.assembly.names[i] for i in np.flatnonzero(self.run.motion.falling)]

    @property
    def settlement(self) -> dict | None:
        """The object ``settlement`` of the JSON output: displacement (m) and reaction along the motion (N) at the last
        equilibrium, before the supports moved (``at_rest``), and where the reaction was least and greatest, the start
        included; None for any other run."""
        if self.scenario.control.regime is not SETTLEMENT:
            return None
        path = cast("EquilibriaRun", self.run).path + 0.0  # turns a negative zero into zero
        least, greatest = path[np.argmin(path[:, 1])], path[np.argmax(path[:, 1])]
        return {
            "displacement": float(path[-1, 0]),
            "reaction": float(path[-1, 1]),
            "reaction_error": self.reaction_error,
            "at_rest": float(path[0, 1]),
            "least": {"reaction": float(least[1]), "displacement": float(least[0])},
            "greatest": {"reaction": float(greatest[1]), "displacement": float(greatest[0])},
            "equilibria": len(path),
            "limit_analysis": self.allowed,
        }

    @cached_property
    def left_out(self) -> list[LeftOut]:
        """Remarks on impacts that the joint laws soften, and on joint laws that new contacts follow only in part; empty
        without any."""
        handed = self.run.motion.contact_detection.left_to_joints() < 1.0
        softened = (
            []
            if self.scenario.control.restitution is None
            else left_out.softened_impacts(self.assembly, self.run.turned)
        )
        return softened + left_out.replaced_joints(self.assembly, handed)

    @property
    def uncertain(self) -> np.ndarray | float:
        """Numbers that an error estimate compares: load factor or settlement (m) of a collapse, else the reaction of a
        settlement (N), else the displacements (n, 3), m."""
        if self.collapse is None:
            return self.displacement if self.settlement is None else self.settlement["reaction"]
        return self.collapse["settlement"] if "settlement" in self.collapse else self.collapse["load_factor"]

    def take_error(self, estimate: float) -> None:
        """Keep the error estimate of what is uncertain; that of a collapse counts its range too."""
        if self.collapse is None and self.settlement is None:
            self.displacement_error = estimate
        elif self.collapse is None:
            self.reaction_error = estimate
        else:
            low, high = self.collapse.get("settlement_range", (0.0, 0.0))
            self.collapse["error_estimate"] = estimate + 0.5 * (high - low)

    def entries(self) -> dict:
        motion, (displacement, furthest) = self.run.motion, self._furthest
        return dict(
            status=self.status,
            collapse=self.collapse,
            yield_point=None,
            theory=None,
            steps=motion.steps,
            time_step=motion.time_step,
            critical_time_step=motion.critical_time_step,
            simulated_time=None if self.scenario.control.regime.counts_equilibria else motion.time,
            displacement=displacement,
            furthest=furthest,
            displacement_error=self.displacement_error,
            unbalanced=self.run.unbalanced,
            greatest_displacement=self.greatest_displacement,
            not_standing=self.not_standing,
            fallen=self.fallen,
            control_points=self.control_points,
            **({"left_out": [one.as_dict() for one in self.left_out]} if self.left_out else {}),
            **({} if self.settlement is None else {"settlement": self.settlement}),
            **self._shaken(),
        )

    def _shaken(self) -> dict:
        """Key numbers of a structure whose supports shake; if supports move, the speed of its blocks at the end; empty
        for any other."""
        control = self.scenario.control
        if not control.shakes:
            moves = control.drives == SUPPORTS and control.regime is REAL_TIME
            return {"speed_at_the_end": self.run.speed} if moves else {}
        found = drift(self.assembly, self.run.furthest)
        return {
            "outcome": outcome(self.fallen, self.not_standing),
            "speed_at_the_end": self.run.speed,
            "drift": None if found is None else found._asdict(),
            "residual_displacement": None if self.run.speed else self._furthest[0],  # none is left while blocks move
        }


STOOD, FELL = "stood", "fell"


class Drift(NamedTuple):
    """The greatest displacement of a centroid at any row over its height above the foot of the free blocks, and its
    ``block``."""

    value: float
    block: str


def outcome(fallen: list[str], not_standing: list[str]) -> str:
    """In one word: it fell if any block has fallen at the end, or found no equilibrium under the dead loads."""
    return FELL if fallen or not_standing else STOOD


def drift(assembly: Assembly, furthest: np.ndarray) -> Drift | None:
    """The drift of a structure, from the greatest displacements ``furthest`` (n,) m of its centroids; None without
    gravity, which defines what is up."""
    weight = float(np.linalg.norm(assembly.gravity))
    free = np.flatnonzero(~np.asarray(assembly.fixed))
    if not (weight > 0.0 and len(free)):
        return None
    up = -np.asarray(assembly.gravity, float) / weight
    height = assembly.position[free] @ up
    corners = [(assembly.shapes[i].vertices @ assembly.rotation[i].T @ up).min() for i in free]
    foot = float((height + np.array(corners)).min())
    found = furthest[free] / (height - foot)
    most = int(np.argmax(found))
    return Drift(float(found[most]), assembly.names[free[most]])
