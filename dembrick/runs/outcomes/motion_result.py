"""Result of a run in real time: the counterpart of ``result`` for tilting, pushing, shaking and free motion.
For a shaken structure also: whether it stood or fell, its drift, its residual displacement.
"""

from __future__ import annotations

import dataclasses
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dembrick.runs import left_out
from dembrick.runs.outcomes.result import RunResult
from dembrick.scenario.regimes import REAL_TIME, SUPPORTS

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.runs.left_out import LeftOut
    from dembrick.simulation.dynamics.run import MotionRun


@dataclasses.dataclass(repr=False)
class MotionResult(RunResult):
    """Result of a run in real time: the state it ended in, and the collapse if there was one.

    ``displacement`` of the rows is that of the block that has moved furthest; for a push, the driven one. Forces and
    energies are those of a step before the row. All motion is relative to the supports. ``displacement_error``: error
    estimate of the displacements (m), None if it was not asked for.
    """

    run: MotionRun
    displacement_error: float | None = None
    yield_point = None  # a dynamic run searches for none

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
    def control_points(self) -> dict[str, list[float]]:
        """Displacement (3) of every control point from the start (m), at the end."""
        watched, state = self.assembly.control_points, self.run.motion.state
        moved = state.bodies.position + state.middle - self.assembly.position
        return dict(zip(watched.names, watched.displacement(moved, state.bodies.rotation).tolist(), strict=True))

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
        """Numbers that an error estimate compares: load factor or settlement of a collapse, else the displacements (n,
        3), m."""
        if self.collapse is None:
            return self.displacement
        return self.collapse["settlement"] if "settlement" in self.collapse else self.collapse["load_factor"]

    def take_error(self, estimate: float) -> None:
        """Keep the error estimate of what is uncertain."""
        if self.collapse is None:
            self.displacement_error = estimate
        else:
            low, high = self.collapse.get("settlement_range", (0.0, 0.0))
            self.collapse["error_estimate"] = estimate + 0.5 * (high - low)

    def as_dict(self) -> dict:
        """The JSON object of ``dembrick run --json``."""
        motion, (displacement, furthest) = self.run.motion, self._furthest
        return self._dict(
            status=self.status,
            collapse=self.collapse,
            yield_point=None,
            theory=None,
            steps=motion.steps,
            time_step=motion.time_step,
            critical_time_step=motion.critical_time_step,
            simulated_time=motion.time,
            displacement=displacement,
            furthest=furthest,
            displacement_error=self.displacement_error,
            unbalanced=self.run.unbalanced,
            greatest_displacement=self.greatest_displacement,
            not_standing=self.not_standing,
            fallen=self.fallen,
            control_points=self.control_points,
            **({"left_out": [one.as_dict() for one in self.left_out]} if self.left_out else {}),
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

    def _tied(self) -> list[dict]:
        """The ties with their peak tensions (N) over the rows."""
        peaks = self.run.peak_tension.tolist()
        return [tie | {"peak": peak} for tie, peak in zip(super()._tied(), peaks, strict=True)]


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
