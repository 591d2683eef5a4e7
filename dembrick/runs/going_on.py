"""Continue the run of a history from a given time, with other joint laws, loads and ties.

A history holds the record of its run, not its full state. The run is therefore repeated up to that time, which leads to
the same state, and its rows begin the new history. From there the changed scenario continues as from a checkpoint.
"""

from __future__ import annotations

import math
import operator
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from dembrick.assembly import build as assemblies
from dembrick.errors import HistoryError, ScenarioError
from dembrick.runs import custom_law
from dembrick.runs.drivers import driver_of
from dembrick.runs.reading import WENT_ON
from dembrick.runs.stages import Stages, check_change
from dembrick.scenario import toml as scenarios
from dembrick.scenario.checks import show
from dembrick.scenario.regimes import CONSTANT_RATE, DRIVEN_PATH, LOAD_PATH, REAL_TIME, SETTLEMENT
from dembrick.scenario.stages import TiesBefore, at_stage
from dembrick.simulation.floating_point import faults_raised
from dembrick.simulation.session import Kept, RestartChanges, Session

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.history import History
    from dembrick.runs.record_store import RecordStore
    from dembrick.scenario.model import Scenario
    from dembrick.scenario.ties import Tie

REGIMES = (REAL_TIME, SETTLEMENT, LOAD_PATH, DRIVEN_PATH, CONSTANT_RATE)
AS_IT_WAS = (DRIVEN_PATH, CONSTANT_RATE)  # regimes that continue only unchanged
_SHOWN = ("title", "text", "path", "files")  # fields of a scenario that no run uses
_CHANGING = ("joint", "joints", "loads", "ties", "pressures", "fills", "control")
_SHAKEN = ("duration", "file", "columns", "sine", "pulse", "scale", "quantity", "direction")
_OF_CONTROLS = {"dynamic": ("duration",), "base-motion": _SHAKEN, "tilt": ("displacement",)}
PART_OF_TIES = ("tension", "yielded")  # channels of rows with a column per tie


class _Reached(Exception):
    """Raised when the time is reached; only `repeat` catches it."""


class RunUntil:
    """Follows a run up to its first row at or after the time ``at``, less the slack ``frozen``.

    Passes rows and frames on to ``observe``, and keeps a copy of the ``state`` at the end.
    """

    def __init__(self, at: float, observe: Callable[[Mapping, Mapping], None], frozen: float):
        self.state: Kept | None = None
        self.time, self.where = -math.inf, ""
        self.row: dict[str, float] = {}
        self._at, self._observe, self._new, self._slack = at, observe, False, frozen

    def observe(self, rows: Mapping, frames: Mapping) -> None:
        self._observe(rows, frames)
        if len(rows["time"]):
            self.time, self._new = float(rows["time"][-1]), True
            self.row = {name: float(rows[name][-1]) for name in ("time", "load", "displacement")}

    def keep(self, arrays: Mapping[str, np.ndarray], where: str) -> None:
        """Stop the run if its state is that of a row at or after the time."""
        if self._new and self.time >= self._at - self._slack:
            self.state, self.where = Kept(arrays, path="the state at that time"), where
            raise _Reached
        self._new = False


def check_kind(scenario: Scenario, file: str) -> None:
    """Raise ScenarioError for runs without an intermediate state to continue from."""
    if scenario.control.regime not in REGIMES:
        raise ScenarioError(
            f"{file}: a run of kind {show(scenario.control.kind)} in the geometry of the start has no state on its way "
            "that others can go on from; put what changes into [[stages]], or take large_displacements = true"
        )


def changes_between(
    old: Scenario, new: Scenario, one: Assembly, other: Assembly, file: str, replaces_ties: bool = False
) -> RestartChanges:
    """Changes in the scenario that continues; ScenarioError for those that cannot be made during a run.
    ``replaces_ties``: see `_ties`."""
    for key in (field.name for field in fields(old) if field.init and field.name not in _SHOWN):
        if getattr(old, key) != getattr(new, key) and key not in _CHANGING:
            listed = ", ".join(_CHANGING)
            whole = f"dembrick run {file} --set {key}... changes it from the start"
            raise ScenarioError(f"{file}: {key} cannot change on the way; only {listed} can; {whole}")
    if any(pressure.actuator for pressure in (*old.pressures, *new.pressures)) and old.pressures != new.pressures:
        raise ScenarioError(f"{file}: pressures cannot change during a run that one of them drives")
    before, now = old.control, new.control
    if type(before) is not type(now) or before.regime is not now.regime:
        raise ScenarioError(f"{file}: control.kind = {show(before.kind)} cannot change on the way")
    may = _OF_CONTROLS.get(before.kind, ())
    for key in (field.name for field in fields(before)):  # type: ignore[arg-type]
        if key not in may and getattr(before, key) != getattr(now, key):
            what = f"only {', '.join(may)} can" if may else "only loads, ties and joint laws can"
            raise ScenarioError(f"{file}: control.{key} of kind {show(before.kind)} cannot change on the way; {what}")
    check_change(new, one, other, f"on the way of {file}", deformed=True)
    had, has = (at_stage(each, len(each.stages) + 1).ties for each in (old, new))
    ties = _ties(had, has, file, replaces_ties or bool(old.stages))
    if ties is not None and old.stages and ties.of != tuple(range(ties.total)):
        raise ScenarioError(
            f"{file}: of the ties of a run with [[stages]] only the strength can change on the way; give ties stages "
            "instead"
        )
    loads, gone = _loads(one, other, old, new)
    anything = any(getattr(old, key) != getattr(new, key) for key in _CHANGING)
    if anything and before.regime in AS_IT_WAS:  # springs of the actuators would push on blocks that give way
        raise ScenarioError(
            f"{file}: nothing can change on the way of a driven displacement, because the actuators would make "
            "blocks jump; put changes into [[stages]]"
        )
    return RestartChanges(ties, loads, gone, anything)


def _loads(
    one: Assembly, other: Assembly, old: Scenario, new: Scenario
) -> tuple[tuple[int, ...] | None, tuple[tuple[int, int], ...]]:
    """Rows of the work of loads and pressures that are kept, as `RestartChanges` states them, and those that are
    dropped."""
    before, now = _rows_of_loads(one, old), _rows_of_loads(other, new)
    if [key for key, _ in before] == [key for key, _ in now]:
        return None, ()
    of = _matched([key for key, _ in before], [key for key, _ in now], operator.eq)
    return of, tuple((row, block) for row, (_, block) in enumerate(before) if row not in of)


def _rows_of_loads(assembly: Assembly, scenario: Scenario) -> list[tuple[Any, int]]:
    """Load and block of each row of the work of loads: forces, then pressed polygons."""
    loads, pressed = assembly.point_loads, assembly.pressed
    last = at_stage(scenario, len(scenario.stages) + 1)
    given = [(i, int(b)) for i, b in zip(loads.given.tolist(), loads.at.block.tolist(), strict=True) if i >= 0]
    rows: list[tuple[Any, int]] = [(((*last.loads, *last.fills)[i], b), b) for i, b in given]
    return rows + [((last.pressures, q), int(b)) for q, b in enumerate(pressed.block.tolist())]


def _matched(before: Sequence, now: Sequence, *alike: Callable[[Any, Any], bool]) -> tuple[int, ...]:
    """For each entry of ``now`` the first one of ``before`` that is ``alike`` and that no other takes, -1 for none; by
    the first of these relations as far as it goes, then by the next."""
    of = [-1] * len(now)
    for relation in alike:
        for i in (i for i, at in enumerate(of) if at < 0):
            of[i] = next((k for k, other in enumerate(before) if k not in of and relation(now[i], other)), -1)
    return tuple(of)


def _ties(before: tuple[Tie, ...], now: tuple[Tie, ...], file: str, replaces: bool) -> TiesBefore | None:
    """Which ties stay; None if nothing about them changes. A tie that differs in nothing but its strength stays, with
    its length and its history. Any other difference is another tie, which only a new list of all ties (``replaces``)
    puts in place of the old one; ScenarioError without it."""
    for number, (had, has) in enumerate(zip(before, now, strict=False) if not replaces else ()):
        if not _same_tie(had, has):
            a, b = (show(end.block) for end in had.between)
            raise ScenarioError(
                f"{file}: of tie {number} between {a} and {b} only the strength can change on the way, as it has its "
                "length already; to replace it by another one, installed at its length of that time with its "
                "prestress, give all ties: --set 'ties=[...]'"
            )
    return None if before == now else TiesBefore(len(before), _matched(before, now, operator.eq, _same_tie))


def _same_tie(tie: Tie, other: Tie) -> bool:
    """Whether two ties are one but for its strength."""
    return replace(tie, strength=None, stages=None) == replace(other, strength=None, stages=None)


def told_of_ties(changes: RestartChanges) -> str:
    """Remark on ties that are added and removed; empty if there are none."""
    if changes.ties is None:
        return ""
    stay = len(set(changes.ties.of) - {-1})
    added, removed = len(changes.ties.of) - stay, changes.ties.total - stay
    said = f"of the ties {stay} stay, {removed} are removed and {added} are added, installed at their present length"
    return said if added or removed else ""


def repeat(
    scenario: Scenario,
    assembly: Assembly,
    history: History,
    at: float,
    store: RecordStore,
    goes_on: RestartChanges,
    session,
) -> RunUntil:
    """Repeat the run of a history up to the time ``at``, recorded in ``store``. ScenarioError if it ends before."""
    last = float(history.time[-1]) if history.n_row else 0.0

    def observe(rows: Mapping, frames: Mapping) -> None:
        store.observe(_with_ties(rows, goes_on.ties), frames)

    moment = RunUntil(at, observe, 1e-12 * max(abs(at), last))
    output = replace(scenario.output, checkpoint=0.0)
    watched = Session(
        moment.observe, output, moment.keep, keep_last=moment.keep, tell=session.tell, report=session.report
    )
    began = time.perf_counter()
    try:
        with faults_raised():
            if scenario.stages:
                stages = Stages(scenario)
                watched = stages.run(watched)
                watched = replace(watched, keep_last=watched.keep)
            driver_of(scenario.control).run(at_stage(scenario, len(scenario.stages) + 1), assembly, watched)
    except _Reached:
        store.write_seconds = max(0.0, store.write_seconds)
    if moment.state is None:
        took = f"after {time.perf_counter() - began:.3g} s"
        raise ScenarioError(f"{history.path}: the repeated run ended at {moment.time:.6g}, {took}, before --at {at:g}")
    return moment


def _with_ties(rows: Mapping, before: TiesBefore | None) -> Mapping:
    """Rows with a column for every tie of the new run, zero for ties that the old run lacks."""
    if before is None:
        return rows
    of = np.array(before.of, np.int64)
    found = {name: value for name, value in rows.items() if name not in PART_OF_TIES}
    for name in PART_OF_TIES if len(of) else ():
        old = rows.get(name, np.zeros((len(rows["time"]), before.total)))
        found[name] = np.where(of >= 0, old[:, of], 0.0) if before.total else np.zeros((len(old), len(of)))
    return found


def check_repeated(moment: RunUntil, history: History) -> str:
    """Remark if the repeated run differs from the history in any bit; empty if not."""
    row = int(np.argmin(np.abs(history.time - moment.time)))
    told = {name: float(getattr(history, name)[row]) for name in moment.row}
    if told == moment.row:
        return ""
    name = next(name for name in told if told[name] != moment.row[name])
    return (
        f"{history.path} was made by another version or machine: its {name} at {moment.time:.6g} is {told[name]:.9g}, "
        f"and {moment.row[name]:.9g} in the run that was repeated"
    )


def prepared(
    history: History, at: float, overrides: tuple[str, ...], file: str
) -> tuple[Scenario, Scenario, Assembly, Assembly, RestartChanges]:
    """The scenario of a history and the one that continues it, their assemblies, and the changes between them."""
    if not (math.isfinite(at) and at >= 0.0):
        raise ScenarioError(f"--at {at:g}: the time of a row, 0 or more")
    custom_law.require_repeatable(history)
    if history.settings.get(WENT_ON):
        raise HistoryError(f"{file}: this run continued another one; continue that one, or run this one to its end")
    if not history.n_row or at > float(history.time[-1]) * (1.0 + 1e-12):
        last = float(history.time[-1]) if history.n_row else 0.0
        raise ScenarioError(f"{file}: its last row is at {last:.6g}, before --at {at:g}")
    named = history.settings.get("scenario")
    path = named if isinstance(named, str) and named else None
    old = history.scenario(path)
    check_kind(old, file)
    new = scenarios.loads(history.scenario_text, path, overrides, old.files)
    one, other = assemblies.assemble(old), assemblies.assemble(new)
    replaces_ties = any(change.partition("=")[0].strip() == "ties" for change in overrides)
    goes_on = changes_between(old, new, one, other, file, replaces_ties)
    if goes_on.ties is not None:
        _check_time_step(old, one, new, other, file)
    return old, new, one, other, goes_on


def _check_time_step(old: Scenario, one: Assembly, new: Scenario, other: Assembly, file: str) -> None:
    """Raise ScenarioError if the time step of the run is too long with the new ties."""
    from dembrick.simulation.dynamics import run

    step = run.prepare(one, old.control, old.solver.step_factor).time_step
    critical = run.prepare(other, new.control, new.solver.step_factor).critical_time_step
    if step > critical:
        raise ScenarioError(
            f"{file}: its time step of {step:.3g} s is longer than the {critical:.3g} s that the new stiffness "
            "allows; run it again with a lower solver.step_factor, or use softer ties"
        )
