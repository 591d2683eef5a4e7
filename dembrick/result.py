"""One scenario run from end to end: simulate(scenario) -> Result, with or without a history file."""

from __future__ import annotations

import dataclasses
import html
import os
import time
from collections.abc import Callable, Mapping

import numpy as np

from dembrick import assembly as assemblies
from dembrick import centred_points, judge, replay
from dembrick import scenario as scenarios
from dembrick.audit import EnergyAudit, audit
from dembrick.errors import DembrickError, NotConvergedError
from dembrick.model import Scenario
from dembrick.session import Session
from dembrick.yield_point import YieldPoint

BRACKET_SLACK = 1e-9  # of V: rounding by which theory may lie outside a certified bracket


@dataclasses.dataclass
class Result:
    """What a run gave: the yield point with its bracket, the record, and what theory says.

    ``rows``: time, load, displacement, unbalanced, lower, upper (T,), actuator_displacement and actuator_force (T, k),
    joint (T, j, 7: N, V_1, V_2, M_T, M_1, M_2, slip). ``frames``: time (F,), displacement (F, n, 3), orientation
    (F, n, 4), velocity and spin (F, n, 3), contact_force (F, c, 3). Only the channels of the scenario's output are
    there. SI units.
    """

    scenario: Scenario
    assembly: assemblies.Assembly
    replay: replay.Replay
    theory: judge.Theory | None
    rows: Mapping[str, np.ndarray]
    frames: Mapping[str, np.ndarray]
    wall: dict
    energy: EnergyAudit | None = None
    history: str | None = None

    @property
    def yield_point(self) -> YieldPoint:
        """Limit load, bracket, torsion centre."""
        return self.replay.yield_point

    @property
    def load(self) -> np.ndarray:
        """V of every row (N)."""
        return self.rows["load"]

    @property
    def displacement(self) -> np.ndarray:
        """Driven displacement of every row (m)."""
        return self.rows["displacement"]

    @property
    def status(self) -> str:
        """ "yield" for a limit load, "completed" for a constant-rate test."""
        return "yield" if self.scenario.control.kind == "yield" else "completed"

    def agrees(self) -> bool:
        """Whether theory lies in the bracket and, for a limit load, V is within the tolerance of it."""
        if self.theory is None:
            return True
        V, point = self.theory.V, self.yield_point
        slack = BRACKET_SLACK * abs(V)
        inside = point.V_lower - slack <= V and (point.V_upper is None or V <= point.V_upper + slack)
        if self.scenario.control.kind != "yield":
            return inside or point.bracket != "certified"
        close = self.theory.error is not None and abs(self.theory.error) <= self.scenario.control.tolerance
        return close and (inside or point.bracket != "certified")

    def as_dict(self) -> dict:
        """The JSON object of ``dembrick run --json``."""
        run = self.replay
        return {
            "scenario": self.scenario.path or "",
            "title": self.scenario.title,
            "formulation": self.scenario.joint.formulation,
            "status": self.status,
            "yield_point": self.yield_point.as_dict(),
            "theory": None if self.theory is None else self.theory.as_dict(),
            "steps": run.steps,
            "time_step": run.time_step,
            "critical_time_step": run.critical_time_step,
            "simulated_time": run.simulated_time,
            "unbalanced": run.unbalanced,
            "energy": None if self.energy is None else self.energy.as_dict(),
            "wall": self.wall,
            "history": self.history,
        }

    @property
    def results(self) -> dict:
        """The same object, under the name that a history file has it by."""
        return self.as_dict()

    def plot(self, ax=None):
        """Force-displacement curve as a matplotlib figure, drawn into ``ax`` if given."""
        from dembrick import plot

        return plot.force_displacement([self], ax=ax)

    def _repr_html_(self) -> str:
        """What a notebook shows: the title, the key numbers with their error bars, the curve."""
        from dembrick import plot
        from dembrick.page import results_table

        heading = f"<strong>{html.escape(self.scenario.title)}</strong>"
        if not len(self.rows.get("load", ())):
            return heading + results_table(self.as_dict())
        return heading + results_table(self.as_dict()) + plot.inline_svg(self.plot())


class _Collector:
    """Keeps the record in memory, and passes it to a history writer if there is one."""

    def __init__(self, writer):
        self.writer, self.rows, self.frames, self.write_seconds = writer, [], [], 0.0

    def __call__(self, rows: Mapping, frames: Mapping) -> None:
        self.rows.append(rows)
        self.frames.append(frames)
        if self.writer is not None:
            began = time.perf_counter()
            self.writer.append(rows)
            if frames:
                self.writer.append_frames(**frames)
            self.write_seconds += time.perf_counter() - began

    @staticmethod
    def joined(parts: list) -> dict:
        """The chunks as one mapping of arrays (or of mappings of arrays)."""
        if not parts:
            return {}
        first = parts[0]
        return {
            name: _Collector.joined([part[name] for part in parts])
            if isinstance(first[name], Mapping)
            else np.concatenate([part[name] for part in parts])
            for name in first
        }


def simulate(
    scenario: Scenario | str | os.PathLike,
    history: str | os.PathLike | None = None,
    *,
    force: bool = False,
    record: bool = True,
    report: Callable[[str], None] | None = None,
) -> Result:
    """Run a scenario (or the TOML file of one) and return its Result.

    ``history`` is the HDF5 file to write; ``force`` lets it replace a finished one. Without ``record`` (and without a
    history) only the yield point is kept, which is what a batch wants. ``report`` gets warnings.

    Raises ScenarioError for input that is not a test, OutputError for a path that cannot be used, NotConvergedError
    and DivergedError where there is no answer; the history then is kept, with the status "failed".
    """
    began = time.perf_counter()
    if not isinstance(scenario, Scenario):
        scenario = scenarios.load(scenario)
    assembly = assemblies.build(scenario)
    for warning in assembly.warnings if report else ():
        report(warning)
    placing = 0.0
    if scenario.control.kind == "yield":
        assembly, placing = centred_points.place_points(
            assembly, scenario.control.tolerance, scenario.solver.step_factor
        )
    built = time.perf_counter()
    writer = None
    if history is not None:
        from dembrick.history import HistoryWriter

        writer = HistoryWriter(history, scenarios.text_of(scenario), assembly, {}, force, scenario.output.channels)
    collector = _Collector(writer) if record or writer else None
    opened = time.perf_counter()
    try:
        run = _replayed(scenario, assembly, Session(collector, scenario.output))
        rows = collector.joined(collector.rows) if collector else {}
        books = audit(rows["energy"], run.energy) if rows else None
    except DembrickError as error:
        if writer is not None:
            writer.finish("failed", failure(scenario, error, history))
        raise
    except BaseException:
        if writer is not None:
            writer.finish("interrupted", {"scenario": scenario.path or "", "status": "interrupted"})
        raise
    done = time.perf_counter()
    expected = judge.theory_of(assembly)
    if expected is not None:
        expected = expected.compared(run.yield_point.V)
    result = Result(
        scenario=scenario,
        assembly=assembly,
        replay=run,
        theory=expected,
        rows=rows,
        frames=collector.joined(collector.frames) if collector else {},
        wall={},
        energy=books,
        history=None if history is None else os.fspath(history),
    )
    write = (opened - built) + (collector.write_seconds if collector else 0.0)
    finishing = time.perf_counter()
    result.wall = {
        "build": built - began - placing + max(0.0, done - opened - run.loop_seconds - run.compile_seconds),
        "compile": run.compile_seconds,
        "loop": run.loop_seconds + placing,
        "write": write,
        "total": finishing - began,
    }
    if writer is not None:
        writer.finish(result.status, result.as_dict(), run.settings)
        result.wall["write"] += time.perf_counter() - finishing
        result.wall["total"] = time.perf_counter() - began
    return result


def _replayed(scenario: Scenario, assembly, session: Session) -> replay.Replay:
    control, factor = scenario.control, scenario.solver.step_factor
    if control.kind == "yield":
        return replay.find_limit_load(assembly, control.tolerance, factor, session)
    return replay.push_at_constant_rate(assembly, control.rate, control.travel, factor, session)


def failure(scenario: Scenario, error: DembrickError, history=None) -> dict:
    """The JSON object of a run that gave no answer, with the best bracket found."""
    point = error.yield_point if isinstance(error, NotConvergedError) else None
    return {
        "scenario": scenario.path or "",
        "title": scenario.title,
        "formulation": scenario.joint.formulation,
        "status": "failed",
        "error": str(error),
        "yield_point": None if point is None else point.as_dict(),
        "history": None if history is None else os.fspath(history),
    }
