"""A dynamic scenario run from end to end: the twin of ``result`` for tilting, pushing, shaking and free motion."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from dembrick.assembly import build as assemblies
from dembrick.runs.collapse import collapse_lines, listed
from dembrick.scenario.model import Scenario
from dembrick.simulation.dynamics import run as motion_run
from dembrick.simulation.dynamics.loads import driving_of
from dembrick.simulation.energy_audit import EnergyAudit
from dembrick.simulation.session import Session


@dataclasses.dataclass
class MotionResult:
    """What a dynamic run gave: the state it ended in, the record, and the collapse if there was one.

    ``rows``: time, load, displacement (of the block that has moved furthest; of a push the driven one), unbalanced
    (T,), joint (T, j, 7: N, V_1, V_2, M_T, M_1, M_2, slip), energy (name: (T,), of the last forces, a step before).
    ``frames``: time (F,), displacement (F, n, 3), orientation (F, n, 4), velocity and spin (F, n, 3), contact_force
    (F, c, 3; on block b, at the moment of the last forces). Everything is seen from the supports. SI units.
    """

    scenario: Scenario
    assembly: assemblies.Assembly
    run: motion_run.MotionRun
    rows: Mapping[str, np.ndarray]
    frames: Mapping[str, np.ndarray]
    wall: dict
    history: str | None = None
    energy: EnergyAudit | None = None
    displacement_error: float | None = None

    @property
    def status(self) -> str:
        """ "collapse" where the run ended with one, else "completed"."""
        return self.run.status

    @property
    def yield_point(self) -> None:
        """A dynamic run looks for none."""

    @property
    def collapse(self) -> dict | None:
        """Angle (deg), load factor, time (s), displacement (m), mechanism and blocks."""
        return self.run.collapse

    @property
    def displacement(self) -> np.ndarray:
        """How far every centroid has moved since the blocks were seated (n, 3), in the frame of the supports (m)."""
        return self.run.motion.displacement

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

    def agrees(self) -> bool:
        """There is no theory that a run of this kind would be held against."""
        return True

    def as_dict(self) -> dict:
        """The JSON object of ``dembrick run --json``."""
        motion = self.run.motion
        return {
            "scenario": self.scenario.path or "",
            "title": self.scenario.title,
            "formulation": self.scenario.joint.formulation,
            "status": self.status,
            "collapse": self.collapse,
            "yield_point": None,
            "theory": None,
            "steps": motion.steps,
            "time_step": motion.time_step,
            "critical_time_step": motion.critical_time_step,
            "simulated_time": motion.time,
            "displacement": float(np.linalg.norm(self.displacement, axis=1).max()),
            "displacement_error": self.displacement_error,
            "unbalanced": self.run.unbalanced,
            "not_standing": self.not_standing,
            "control_points": self.control_points,
            "energy": None if self.energy is None else self.energy.as_dict(),
            "wall": self.wall,
            "history": self.history,
        }

    @property
    def results(self) -> dict:
        """The same object, under the name that a history file has it by."""
        return self.as_dict()

    def meshes(self, frame: int = -1, *, time: float | None = None, magnification: float = 1.0):
        """The blocks in a frame, or at a ``time`` (s), as a ``pyvista.MultiBlock`` of their names; the motion times
        ``magnification``."""
        from dembrick.runs import in_memory

        return in_memory.meshes(self, frame, time, magnification)

    def plot(self, ax=None):
        """Load factor over displacement, or displacement over time, as a matplotlib figure; into ``ax`` if given."""
        from dembrick.views import plot

        return plot.force_displacement([self], ax=ax)

    def _repr_html_(self) -> str:
        """What a notebook shows: the title, the key numbers, the curve."""
        from dembrick.views import page

        return page.fragment(self)

    def text(self) -> str:
        """What the command line prints."""
        motion = self.run.motion
        lines = [self.scenario.title, f"formulation   {self.scenario.joint.formulation}"]
        if self.collapse is not None:
            lines += collapse_lines(self.collapse)
        furthest = int(np.argmax(np.linalg.norm(self.displacement, axis=1)))
        away = float(np.linalg.norm(self.displacement[furthest]))
        bar = "" if self.displacement_error is None else f" +- {self.displacement_error:.2g}"
        lines.append(f"displacement  {away:.5g}{bar} m, of {self.assembly.names[furthest]}")
        if self.not_standing:
            lines.append(f"not standing  {listed(self.not_standing)}: no equilibrium under the dead loads")
        lines.append(f"simulated     {motion.time:.6g} s")
        lines.append(
            f"time step     {motion.time_step:.3g} s (critical {motion.critical_time_step:.3g} s), "
            f"{motion.steps} steps, loop {self.run.loop_seconds:.3g} s"
        )
        if self.energy is not None:
            lines.append(f"energy        balance off by {self.energy.relative_residual:.1e} of what was put in")
        lines.append(f"history       {self.history}")
        return "\n".join(lines)


def lived_through(scenario: Scenario, assembly, session: Session) -> motion_run.MotionRun:
    """Run a scenario that moves blocks in real time on its assembly; it raises what ``dynamics.run`` does."""
    moving = motion_run.prepare(assembly, scenario.control, scenario.solver.step_factor)
    driving = driving_of(scenario, assembly, moving.time_step)
    motion_run.ask_for(moving, scenario.output, len(driving.block))
    return motion_run.run(moving, scenario.control, driving, session)
