"""Results of equilibria in the deformed geometry: a limit load with its bracket; whether the blocks stand;
and for a settlement, the reaction along the motion over the displacement, and the collapse.
"""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from dembrick.geometry.rotations import rotation_matrix
from dembrick.runs.outcomes.motion_result import MotionResult
from dembrick.runs.outcomes.statics_result import RestResult
from dembrick.scenario.regimes import ACTUATORS, COMPLETED
from dembrick.simulation import load_increments
from dembrick.simulation.statics.yield_point import YieldPoint
from dembrick.views.summary import listed

if TYPE_CHECKING:
    from dembrick.simulation.dynamics.paths.load_path import LoadPathRun
    from dembrick.simulation.dynamics.run import EquilibriaRun


LONG_WAY = 0.05  # of the least width of a block: greatest motion if the geometry of the start still gives the limit


@dataclasses.dataclass(repr=False)
class LoadPathResult(MotionResult):
    """A limit load in the deformed geometry, bracketed by V at the last equilibrium and V at which blocks collapse.

    ``load_error``: error of V, half the bracket plus the estimate of refined runs, if they were asked for.
    """

    run: LoadPathRun
    load_error: float | None = None
    theory = None

    @property
    def load(self) -> np.ndarray:
        """V of every row (N, or the load factor); HistoryError if the run kept no record."""
        return self.series("load")

    @property
    def unlimited(self) -> bool:
        """Whether nothing collapsed up to the greatest load tried."""
        return self.run.bracket[1] == math.inf

    @property
    def status(self) -> str:
        """ "yield" for a limit load, "collapse" for that of all blocks, "completed" where nothing limits the load."""
        return COMPLETED if self.unlimited else self.scenario.control.ends_with

    @property
    def plain_answer(self) -> str | None:
        """Sentence on an unlimited load; None if there is a limit."""
        if not self.unlimited:
            return None
        V, actuators = self.run.bracket[0], self.scenario.control.drives == ACTUATORS
        load = f"V = {V:.3g} N" if actuators else f"a load factor of {V:.3g}"
        return f"unlimited: no blocks fell up to {load}"

    @property
    def yield_point(self) -> YieldPoint:  # type: ignore[override]
        """The limit load, its bracket, and what the joint that moves most carried at the last equilibrium."""
        lower, upper = self.run.bracket
        if self.unlimited:
            return self._point(None, lower, None, "open")
        return self._point(0.5 * (lower + upper), lower, upper, "indicator")

    def _point(self, V: float | None, lower: float, upper: float | None, bracket: str) -> YieldPoint:
        run, joints = self.run, self.assembly.joints
        carried = dict.fromkeys(("N", "V_1", "V_2", "M_T"), 0.0)
        if run.resultant is not None:
            carried = dict(zip(carried, (run.resultant[:4] + 0.0).tolist(), strict=True))
        pair = (joints.block_a[run.joint], joints.block_b[run.joint]) if len(joints) else ()
        peak = run.path[np.argmax(np.abs(run.path[:, 1]))]
        return YieldPoint(
            V=V,
            V_lower=lower,
            V_upper=upper,
            bracket=bracket,
            V_peak=float(peak[1]),
            displacement_at_peak=float(peak[0]),
            actuator_load=float(run.path[-1, 1]),
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
        """Number that an error estimate compares: the limit load, or what was reached without one."""
        return sum(self.run.bracket) / 2.0 if not self.unlimited else self.run.bracket[0]

    def take_error(self, estimate: float) -> None:
        """Keep the error estimate of the limit load, with its bracket."""
        lower, upper = self.run.bracket
        self.load_error = estimate + (0.0 if self.unlimited else 0.5 * (upper - lower))

    def as_dict(self) -> dict:
        own: dict[str, Any] = {"unlimited": self.unlimited, "answer": self.plain_answer}
        own |= {"yield_point": self.yield_point.as_dict()}
        # nothing is proven of other paths in the deformed geometry
        own |= {"path_dependent": True, "no_path_above": False, "associative": None}
        own |= {"equilibria": len(self.run.path), "moved": self.moved}
        if self.run.collapse is not None:
            own |= {key: self.run.collapse[key] for key in ("blocks", "hinges")}
        return super().as_dict() | own | {"error_estimate": self.load_error, "simulated_time": None}

    @property
    def moved(self) -> dict | None:
        """Motion up to the limit of the block that moved furthest, as the limit may be far from that of the undeformed
        geometry: its ``displacement`` (m), and its ``turn`` (rad) if that moves its corners twice as far, else None;
        ``far`` if the geometry of the start gives another limit. After a settlement both count from there."""
        if self.run.collapse is None:
            return None
        shifted, motion = np.linalg.norm(self.displacement, axis=1), self.run.motion
        bodies = motion.state.bodies
        traces = np.einsum("nij,nij->n", bodies.rotation, rotation_matrix(motion.upright))
        turned = np.arccos(np.clip(0.5 * (traces - 1.0), -1.0, 1.0))
        away = np.maximum(shifted, 0.5 * bodies.reach * turned)
        furthest = int(np.argmax(away))
        size = float(np.ptp(self.assembly.shapes[furthest].vertices, axis=0).min())
        return {
            "block": self.assembly.names[furthest],
            "displacement": float(shifted[furthest]),
            "turn": float(turned[furthest]) if shifted[furthest] < away[furthest] else None,
            "far": bool(away[furthest] > LONG_WAY * size and not motion.settled),
        }


@dataclasses.dataclass(repr=False)
class DrivenPathResult(LoadPathResult):
    """A constant-rate test in the deformed geometry: V at the end of the travel, and the largest on the way to it."""

    unlimited = False

    @property
    def status(self) -> str:
        """ "completed", or "collapse" if blocks collapse before the end of the travel."""
        return self.run.status

    @property
    def yield_point(self) -> YieldPoint:  # type: ignore[override]
        """V at the end, in equilibrium there and without an upper bound; ``V_peak`` is the largest on the way."""
        V = float(self.run.path[-1, 1])
        return self._point(V, V, None, "open")

    @property
    def uncertain(self) -> float:
        """Number that an error estimate compares: the size of the largest V, which may be that of either half of a
        cycle."""
        return abs(self.yield_point.V_peak)

    def take_error(self, estimate: float) -> None:
        """Keep the error estimate of the largest V."""
        self.load_error = estimate

    moved = None  # on purpose


@dataclasses.dataclass(repr=False)
class DeformedRestResult(RestResult, MotionResult):
    """Whether the blocks stand under their dead loads in the deformed geometry."""

    run: LoadPathRun

    @property
    def statics(self) -> dict[str, Any]:
        """The object ``statics`` of the JSON output."""
        fallen = self.run.collapse or {"mechanism": None, "blocks": []}
        found = {"stands": self.run.stands, "unbalanced": self.run.unbalanced}
        way = load_increments.described(self.run.increments, self.run.path_error, self.run.force_error)
        return found | {"mechanism": fallen["mechanism"], "blocks": fallen["blocks"]} | way

    @property
    def plain_answer(self) -> str:
        """The answer in a sentence."""
        if self.run.stands:
            return "stands under its dead loads in the deformed geometry"
        found = self.statics
        return f"does not stand under its dead loads: {listed(found['blocks'])} fall by {found['mechanism']}"

    def as_dict(self) -> dict:
        return super().as_dict() | {"answer": self.plain_answer, "statics": self.statics, "simulated_time": None}


@dataclasses.dataclass(repr=False)
class SettlementResult(MotionResult):
    """Result of a quasi-static settlement: equilibria in the deformed geometry, up to the end or to the last before the
    structure collapsed. ``reaction_error`` (N): of the reaction along the motion, from refined runs. ``allowed``: its
    least and greatest value (N) before the supports move, by limit analysis, if that was asked for."""

    run: EquilibriaRun
    reaction_error: float | None = None
    allowed: dict | None = None

    @property
    def settlement(self) -> dict:
        """The object ``settlement`` of the JSON output: displacement (m) and reaction along the motion (N) at the last
        equilibrium, before the supports moved (``at_rest``), and where the reaction was least and greatest, the start
        included."""
        path = self.run.path
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
