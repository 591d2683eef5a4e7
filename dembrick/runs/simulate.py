"""Run one scenario from end to end: simulate(scenario) -> Result, restart(history) -> Result."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable
from contextlib import ExitStack, closing
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias, TypedDict, Unpack, overload

from dembrick.assembly import build as assemblies
from dembrick.errors import DembrickError, HistoryError, NotConvergedError, UndecidedError, WriteError
from dembrick.runs import custom_law
from dembrick.runs.drivers import driver_of
from dembrick.runs.logger import LOGGER, heard_by
from dembrick.runs.notebook import notebook_bar
from dembrick.runs.outcomes.error_estimate import Refinement, error_of, inertia_remark, refinements, spring_remark
from dembrick.runs.outcomes.result import Result, heading
from dembrick.runs.outcomes.statics_result import StaticsResult
from dembrick.runs.path_dependence import UnstableHistory, cut_at_bound, ends, has_paths, histories, ranged
from dembrick.runs.reading import WENT_ON, came_from, load, require_repeatable
from dembrick.runs.record_store import Memory, RecordStore
from dembrick.runs.stages import Stages
from dembrick.scenario import toml as scenarios
from dembrick.scenario.checks import present
from dembrick.scenario.controls import StaticsControl
from dembrick.scenario.joint_laws import CustomLaw
from dembrick.scenario.model import Scenario
from dembrick.scenario.stages import at_stage
from dembrick.scenario.units import unit_slips
from dembrick.simulation import interrupts
from dembrick.simulation.dynamics.time_histories import records_of
from dembrick.simulation.floating_point import faults_raised
from dembrick.simulation.interrupts import Interrupted
from dembrick.simulation.session import Progress, Session

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.runs.outcomes.load_path_result import LoadPathResult
    from dembrick.runs.outcomes.motion_result import MotionResult  # and its kernels: for runs in real time only
    from dembrick.scenario.controls import (
        BaseMotionControl,
        DisplacementControl,
        DynamicControl,
        PushoverControl,
        SettlementControl,
        StaticsControl,
        TiltControl,
        YieldControl,
    )
    from dembrick.simulation.statics.yield_point import YieldPoint

AnyResult: TypeAlias = "Result | MotionResult | StaticsResult"
Path: TypeAlias = str | os.PathLike


class Options(TypedDict, total=False):
    """Keywords of `simulate`."""

    force: bool | str
    record: bool
    refine: bool
    bound: bool
    law: CustomLaw | Callable | None
    report: Callable[[str], None] | None
    progress: Callable[[Progress], None] | bool | None


class Extras(NamedTuple):
    """Additions to the answer of a run: an error estimate (``refine``), and a bound of limit analysis (``bound``)."""

    refine: bool = False
    bound: bool = False

    def check(self, scenario: Scenario, assembly: Assembly) -> None:
        """Raise ScenarioError or MissingDependency for what a scenario does not allow, before anything runs."""
        if self.refine:
            refinements(scenario, has_paths(assembly))
        if self.bound:
            from dembrick.runs.limit_cases import check_bound

            check_bound(scenario)


NO_EXTRAS = Extras()


@overload
def simulate(
    scenario: Scenario[YieldControl | DisplacementControl], history: Path | None = None, **options: Unpack[Options]
) -> Result | LoadPathResult: ...
@overload
def simulate(
    scenario: Scenario[TiltControl | PushoverControl], history: Path | None = None, **options: Unpack[Options]
) -> Result | MotionResult: ...
@overload
def simulate(
    scenario: Scenario[StaticsControl], history: Path | None = None, **options: Unpack[Options]
) -> StaticsResult: ...
@overload
def simulate(
    scenario: Scenario[SettlementControl | DynamicControl | BaseMotionControl],
    history: Path | None = None,
    **options: Unpack[Options],
) -> MotionResult: ...
@overload
def simulate(scenario: Scenario | Path, history: Path | None = None, **options: Unpack[Options]) -> AnyResult: ...
def simulate(
    scenario: Scenario | Path,
    history: Path | None = None,
    *,
    force: bool | str = False,
    record: bool = True,
    refine: bool = False,
    bound: bool = False,
    law: CustomLaw | Callable | None = None,
    report: Callable[[str], None] | None = None,
    progress: Callable[[Progress], None] | bool | None = None,
) -> AnyResult:
    """Run a scenario (or its TOML file, or a history of it) and return its Result, or its MotionResult if blocks
    move in time.

    ``history`` is the HDF5 file to write; ``force`` allows it to replace any file, or with "own" a finished history of
    the same scenario. Without ``record`` and ``history`` only the yield point is kept, which suits a batch. ``refine``
    runs the scenario a few more times, for the range of limits on other paths, or for an error estimate of a collapse
    in real time or of displacements, see `error_estimate`. ``bound`` adds the associative bound of a search, whatever
    limit analysis costs, or the range of reactions at the start of a settlement. ``law`` is a joint law of your own,
    see `joint_law`. ``report`` receives warnings, which otherwise go to the logger ``dembrick``; ``progress`` is called
    ten times a second with the progress of the run (see `simulation.session.Progress`). None shows a bar in a notebook,
    False nothing.

    Raises ScenarioError for input that is not a test, OutputError for a path that cannot be used, NotConvergedError
    and DivergedError if there is no answer; the history is then kept with the status "failed". Interrupted, which
    is a KeyboardInterrupt, leaves the status "interrupted", from which `restart` continues.
    """
    began, start_up, report = time.perf_counter(), _start_up(), heard_by(report)
    if not isinstance(scenario, Scenario):
        scenario = load(scenario)
    assembly = custom_law.with_law(_built(scenario, report), scenario, law, refine, bound)
    asked = Extras(refine, bound)
    asked.check(scenario, assembly)
    if history is None:
        memory = Memory(scenario, assembly) if record else None
        return _run(scenario, assembly, memory, (began, start_up), asked, progress, report)
    from dembrick.history import claimed  # imports h5py, for runs with a file only

    with claimed(history):
        settings = {"scenario": scenario.path or "", **custom_law.settings_of(assembly)}
        store = RecordStore(history, scenario, scenarios.text_of(scenario), assembly, settings, force)
        return _run(scenario, assembly, store, (began, start_up), asked, progress, report)


def restart_at(
    history: Path,
    at: float,
    out: Path,
    changes: Iterable[str] = (),
    *,
    force: bool | str = False,
    report: Callable[[str], None] | None = None,
    progress: Callable[[Progress], None] | bool | None = None,
) -> AnyResult:
    """Continue the run of a history, which may have ended, from the time ``at`` (s, or the number of an equilibrium).

    ``changes`` are ``key.path=value`` texts, as for ``--set``: joint laws, loads, ties and their strengths. The new
    history ``out`` holds the whole run, before and after ``at``; the old one stays as it is. The old run is repeated up
    to its first row at or after ``at``. Raises ScenarioError for keys that cannot change during a run.
    """
    from dembrick.history import claimed, read, refuse_inputs
    from dembrick.runs import going_on
    from dembrick.scenario.files import inputs_of

    began, start_up, report = time.perf_counter(), _start_up(), heard_by(report)
    file = os.fspath(history)
    with claimed(out), closing(read(history)) as left:
        old, new, one, other, goes_on = going_on.prepared(left, at, tuple(changes), file)
        refuse_inputs(out, os.path.realpath(out), [file, *inputs_of(old)])
        settings = {"scenario": new.path or "", WENT_ON: {"file": file, "at": at}}
        store = RecordStore(out, new, scenarios.text_of(new), other, settings, force)
        try:
            moment = going_on.repeat(old, one, left, at, store, goes_on, Session(report=report))
        except BaseException as error:
            if not store.abandon():
                store.finish("failed", {"status": "failed", "error": str(error)})
            raise
        remark = going_on.check_repeated(moment, left)
    if report:
        for line in filter(None, (remark or f"continuing from {moment.where}", going_on.told_of_ties(goes_on))):
            report(line)
    store.checkpoint, store.goes_on = moment.state, goes_on
    return _run(new, other, store, (began, start_up), progress=progress, report=report)


def restart(
    history: str | os.PathLike,
    *,
    report: Callable[[str], None] | None = None,
    progress: Callable[[Progress], None] | bool | None = None,
) -> AnyResult:
    """Continue a run that was killed or interrupted from its last good checkpoint; return the Result of the whole run.

    Records after the checkpoint are dropped and computed again; rows, frames and result are bit for bit those of an
    uninterrupted run. Without a checkpoint the run starts from the beginning. Raises HistoryError if the file is not a
    history, its run has ended, or its checkpoints do not fit it.
    """
    from dembrick.history import claimed, read

    began, start_up, report = time.perf_counter(), _start_up(), heard_by(report)
    with claimed(history), closing(read(history)) as left:
        if left.status not in ("running", "interrupted"):
            raise HistoryError(
                f"{left.path}: this run has ended (status {left.status}); to repeat it: dembrick run {left.path}"
            )
        custom_law.require_repeatable(left)
        named = left.settings.get("scenario")
        scenario = left.scenario(named if isinstance(named, str) and named else None)
        assembly = _built(scenario, report)
        settings = {"scenario": scenario.path or "", **came_from(left.settings)}
        store = RecordStore(history, scenario, left.scenario_text, assembly, settings, left=left)
        if store.checkpoint is None:
            require_repeatable(left)
        if report:
            left_at = store.checkpoint and store.where
            report(
                f"continuing from {left_at}" if left_at else "no checkpoint was written: starting from the beginning"
            )
        return _run(scenario, assembly, store, (began, start_up), progress=progress, report=report)


class _Process:
    ran = False


def _start_up() -> float:
    """Processor time (s) of this process before its first run: interpreter and imports; zero for later runs."""
    first, _Process.ran = not _Process.ran, True
    return time.process_time() if first else 0.0


def _built(scenario: Scenario, report: Callable[[str], None] | None):
    """Build the assembly and report its warnings."""
    LOGGER.info("%s: %r", scenario.path or "a scenario of Python", scenario)
    assembly = assemblies.assemble(scenario)
    if report:
        strong = (record.warning for record in records_of(scenario) if record.warning)
        for warning in (*unit_slips(scenario, assembly.shapes), *strong, *assembly.warnings):
            report(warning)
    return assembly


def _run(
    scenario: Scenario,
    assembly: Assembly,
    store: RecordStore | Memory | None,
    times: tuple[float, float],
    asked: Extras = NO_EXTRAS,
    progress: Callable[[Progress], None] | bool | None = None,
    report: Callable[[str], None] | None = None,
) -> AnyResult:
    """Run, audit the energy and make the result. ``times``: when work began, and the processor time (s) before."""
    began, start_up = times
    path, driver = store.path if isinstance(store, RecordStore) else None, driver_of(scenario.control)
    with ExitStack() as until_written:
        try:
            with faults_raised():
                assembly, placing = driver.place(scenario, assembly)
                if store:
                    store.place(assembly)
                session, custom = store.session(scenario.output) if store else Session(), bool(assembly.custom_law)
                shown = notebook_bar() if progress is None else progress
                session.tell, session.report = shown if callable(shown) else None, report
                stages = Stages(scenario)
                if scenario.stages:
                    session = stages.run(session)
                run = driver.run(at_stage(scenario, len(scenario.stages) + 1), assembly, session)
            audit = store.auditor.result(run.energy, custom) if store and run.energy is not None else None
            until_written.enter_context(interrupts.deferred())  # a signal must not lose the answer
        except WriteError as error:  # what is on the disk stays there
            kept = isinstance(store, RecordStore) and store.has_checkpoint
            remedy = f"; after freeing space: dembrick restart {path}" if kept else ""
            failed = WriteError(f"{error}{remedy}")
            failed.answer = failure(scenario, failed, path)
            raise failed from error
        except HistoryError:
            raise  # the checkpoint does not fit; nothing was written
        except DembrickError as error:
            # an input that cannot be run leaves no file that its corrected version would have to replace
            file = store if isinstance(store, RecordStore) else None
            if file is not None and error.exit_code != 1 and file.abandon():
                file = None
            error.answer = failure(scenario, error, None if file is None else path)
            if file is not None:
                file.finish(error.status, error.answer)
            raise
        except BaseException as error:
            if isinstance(store, RecordStore):
                store.finish("interrupted", {"scenario": scenario.path or "", "status": "interrupted"})
            error = interrupts.caused(error)
            if path and isinstance(error, Interrupted):
                raise Interrupted(error.signum, f"{error}; continue with: dembrick restart {path}") from None
            raise
        spent = {"start_up": start_up, "placing": placing, "began": began, "stages": stages.results}
        result = _finished(scenario, assembly, run, audit, store, spent, asked)
    LOGGER.info("%r", result)
    if report:
        for remark in filter(None, (inertia_remark(result), spring_remark(result))):
            report(remark)
    return result


def _finished(scenario: Scenario, assembly: Assembly, run, audit, store, times, asked: Extras) -> AnyResult:
    """The result of a finished run, compared with theory and written to its history."""
    began, placing, done = times["began"], times["placing"], time.perf_counter()
    path = store.path if isinstance(store, RecordStore) else None
    write = store.write_seconds if store else 0.0
    if path and scenario.control.cyclic:
        store.flush()  # its cycles are read from the record
    wall = {
        "start_up": times["start_up"],
        "build": max(0.0, done - began - placing - run.loop_seconds - run.compile_seconds - write),
        "compile": run.compile_seconds,
        "loop": run.loop_seconds + placing,
        "write": write,
    }
    try:
        result = driver_of(scenario.control).result(
            scenario=scenario,
            assembly=assembly,
            run=run,
            rows=store.rows if store else {},
            frames=store.frames if store else {},
            wall=wall,
            history=path,
            energy=audit,
            stages=times["stages"],
            **({"bound": True} if asked.bound else {}),
        )
    except DembrickError as error:  # the answer contradicts itself
        error.answer = failure(scenario, error, path)
        if path:
            store.finish("failed", error.answer)
        raise
    finishing = time.perf_counter()
    wall["total"] = finishing - began
    if run.phases is not None:
        wall["phases"] = run.phases
    missing = None if not asked.refine or isinstance(result, StaticsResult) else _estimate_error(result)
    if path:
        store.finish(result.status, result.as_dict(), run.settings)
        result.wall["write"] += time.perf_counter() - finishing
        result.wall["total"] = time.perf_counter() - began
    if missing is not None:
        raise missing
    return result


def _estimate_error(result: Result | MotionResult) -> BaseException | None:
    """Add the error estimate to a result; return the error that prevented it, which leaves the result itself valid."""
    scenario, fallen = result.scenario, result.collapse
    try:
        if isinstance(result, Result):
            _range_paths(result)
            return None
        result.take_error(error_of(scenario, result.uncertain, [_refined(one) for one in refinements(scenario)]))
    except (DembrickError, Interrupted) as error:
        factor = None if fallen is None else fallen["load_factor"]
        answer = "" if factor is None else f" (load factor {factor:.6g})"
        kept = f"the run itself{answer} is complete" + (f" in {result.history}" if result.history else "")
        if isinstance(error, Interrupted):
            return Interrupted(error.signum, f"interrupted while the error was estimated; {kept}")
        failed = type(error)(f"no error estimate: {error}; {kept}")
        failed.answer = failure(scenario, failed, result.history)
        return failed
    return None


def _range_paths(result: Result) -> None:
    """Add to a search the range of load factors on other paths of the same structure: with other stiffness, steps and
    locked-in forces, run in parallel on free cores. The bracket is widened to hold the brackets of them all.

    Paths without a limit are counted as well. Raises NotConvergedError if no other path found a limit, and
    Interrupted.
    """
    from concurrent.futures import ThreadPoolExecutor

    scenario, point = result.scenario, result.yield_point
    if result.path is None:
        return  # nothing limits the load
    search = present(driver_of(scenario.control).refined)
    variants: list[Callable[[], YieldPoint]] = [
        partial(search, one.scenario, one.steps) for one in refinements(scenario, several=True)
    ]
    variants += histories(result.run, scenario, search)

    def found(one: Callable[[], YieldPoint]) -> list[tuple[float, float, float] | None]:
        try:
            return [ends(one())]
        except UnstableHistory:
            return []
        except NotConvergedError:
            return [None]

    with ThreadPoolExecutor(min(len(variants), os.cpu_count() or 1)) as pool:
        tried = [path for each in pool.map(found, variants) for path in each]
    others = [path for path in tried if path is not None]
    if not others:
        raise NotConvergedError("no other load path of the same structure led to a limit", point)
    result.path, (low, high) = ranged(result.path, present(point.V), others, len(tried))
    upper = None if point.V_upper is None else max(point.V_upper, high)
    wider = replace(point, V_lower=min(point.V_lower, low), V_upper=upper)
    result.run.yield_point = cut_at_bound(wider, result.path["associative"])


def _refined(one: Refinement) -> Any:
    """Run a refined scenario; return the number that the error estimate compares."""
    refined = driver_of(one.scenario.control).refined
    if refined is not None:
        return refined(one.scenario, one.steps)
    result: Any = simulate(one.scenario, record=False)
    return result.uncertain


def failure(scenario: Scenario, error: DembrickError, history=None) -> dict:
    """The JSON object of a run that gave no answer, with the best bracket found."""
    point = error.yield_point if isinstance(error, NotConvergedError) else None
    unknown: dict = {"stands": None, "unbalanced": None, "mechanism": None, "blocks": []}
    asked = isinstance(scenario.control, StaticsControl) and isinstance(error, UndecidedError)
    return {
        **heading(scenario),
        "status": error.status,
        "error": str(error),
        "yield_point": None if point is None else point.as_dict(),
        "history": None if history is None else os.fspath(history),
        **({"statics": unknown} if asked else {}),
    }
