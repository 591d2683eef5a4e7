"""Result of a load that grows in the deformed geometry, from equilibrium to equilibrium."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING

import numpy as np

from dembrick.geometry.rotations import rotation_matrix
from dembrick.runs.outcomes.motion_result import MotionResult
from dembrick.runs.outcomes.result import load_in_words
from dembrick.scenario.regimes import ACTUATORS, COMPLETED, DRIVEN_PATH
from dembrick.simulation.statics.yield_point import YieldPoint

if TYPE_CHECKING:
    from dembrick.simulation.dynamics.paths.load_path import LoadPathRun


LONG_WAY = 0.05  # of the least width of a block: greatest motion if the geometry of the start still gives the limit


@dataclasses.dataclass(repr=False)
class LoadPathResult(MotionResult):
    """A limit load in the deformed geometry, bracketed by V at the last equilibrium and V at which blocks collapse; of
    a test by displacement or force V at its end, and the largest on the way to it.

    ``load_error``: error of V, half the bracket plus the estimate of refined runs, if they were asked for; of such a
    test that of the largest V.
    """

    run: LoadPathRun
    load_error: float | None = None
    theory = None

    @property
    def load(self) -> np.ndarray:
        """V of every row (N, or the load factor); HistoryError if the run kept no record."""
        return self.series("load")

    @property
    def _travels(self) -> bool:
        """Whether the load followed a travel, or a protocol, and no limit was looked for."""
        return self.scenario.control.regime is DRIVEN_PATH

    @property
    def unlimited(self) -> bool:
        """Whether nothing collapsed up to the greatest load tried."""
        return self.run.bracket[1] == math.inf and not self._travels

    @property
    def status(self) -> str:
        """ "yield" for a limit load, "collapse" for that of all blocks, or if blocks collapse before the end of a
        travel; "completed" at that end, and where nothing limits the load."""
        if self._travels:
            return self.run.status
        return COMPLETED if self.unlimited else self.scenario.control.ends_with

    @property
    def plain_answer(self) -> str | None:
        """Sentence on an unlimited load; None if there is a limit."""
        load = load_in_words(self.scenario.control, self.run.bracket[0])
        return f"unlimited: no blocks fell up to {load}" if self.unlimited else None

    @property
    def yield_point(self) -> YieldPoint:
        """The limit load, its bracket, and what the joint that moves most carried at the last equilibrium. At the end
        of a travel V has no upper bound, and ``V_peak`` is the largest on the way."""
        run, joints, (lower, upper) = self.run, self.assembly.joints, self.run.bracket
        end, V, closed = float(run.path[-1, 1]), 0.5 * (lower + upper), not (self.unlimited or self._travels)
        carried = dict.fromkeys(("N", "V_1", "V_2", "M_T"), 0.0)
        if run.resultant is not None:
            carried = dict(zip(carried, (run.resultant[:4] + 0.0).tolist(), strict=True))
        pair = (joints.block_a[run.joint], joints.block_b[run.joint]) if len(joints) else ()
        peak = run.path[np.argmax(np.abs(run.path[:, 1]))]
        return YieldPoint(
            V=end if self._travels else None if self.unlimited else V,
            V_lower=end if self._travels else lower,
            V_upper=upper if closed else None,
            bracket="indicator" if closed else "open",
            V_peak=float(peak[1]),
            displacement_at_peak=float(peak[0]),
            actuator_load=end,
            **carried,
            displacement=float(run.path[-1, 0]),
            torsion_centre=None,
            mechanism=run.mechanism,
            joint=tuple(self.assembly.names[i] for i in pair),
            unlimited=self.unlimited,
        )

    @property
    def collapse(self) -> dict | None:
        """The collapse under a load on every block; None of actuators."""
        fallen, control, point = self.run.collapse, self.scenario.control, self.yield_point
        if fallen is None or point.V is None or control.drives == ACTUATORS:
            return None
        return fallen | {
            "angle": control.angle(point.V),
            "load_factor": point.V,
            "mechanism_load_factor": point.V,
            "displacement": float(np.linalg.norm(self.displacement, axis=1).max()),
            "error_estimate": self.load_error,
        }

    @property
    def uncertain(self) -> float:
        """Number that an error estimate compares: the limit load, or what was reached without one; of a travel the size
        of the largest V, which may be that of either half of a cycle."""
        point = self.yield_point
        return abs(point.V_peak) if self._travels else point.V_lower if point.V is None else point.V

    def take_error(self, estimate: float) -> None:
        """Keep the error estimate of what is uncertain, with the bracket of a limit load."""
        lower, upper = self.run.bracket
        self.load_error = estimate + (0.0 if self.unlimited or self._travels else 0.5 * (upper - lower))

    def entries(self) -> dict:
        fallen = self.run.collapse
        return {
            **super().entries(),
            "unlimited": self.unlimited,
            "answer": self.plain_answer,
            "yield_point": self.yield_point.as_dict(),
            # nothing is proven of other paths in the deformed geometry
            "path_dependent": True,
            "no_path_above": False,
            "associative": None,
            "equilibria": len(self.run.path),
            "moved": self.moved,
            **({} if fallen is None else {key: fallen[key] for key in ("blocks", "hinges")}),
            "error_estimate": self.load_error,
        }

    @property
    def moved(self) -> dict | None:
        """Motion up to the limit of the block that moved furthest, as the limit may be far from that of the undeformed
        geometry: its ``displacement`` (m), and its ``turn`` (rad) if that moves its corners twice as far, else None;
        ``far`` if the geometry of the start gives another limit. After a settlement both count from there. None for a
        travel, or without a limit."""
        if self.run.collapse is None or self._travels:
            return None
        shifted, motion = np.linalg.norm(self.displacement, axis=1), self.run.motion
        bodies = motion.state.bodies
        traces = np.einsum("nij,nij->n", bodies.rotation, rotation_matrix(motion.upright))
        turned = np.arccos(np.clip(0.5 * (traces - 1.0), -1.0, 1.0))
        away = np.maximum(shifted, 0.5 * bodies.reach * turned)
        furthest = int(np.argmax(away))
        size = float(self.assembly.least_size[furthest])
        return {
            "block": self.assembly.names[furthest],
            "displacement": float(shifted[furthest]),
            "turn": float(turned[furthest]) if shifted[furthest] < away[furthest] else None,
            "far": bool(away[furthest] > LONG_WAY * size and not motion.settled),
        }
