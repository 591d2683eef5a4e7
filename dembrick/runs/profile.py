"""Where the time of a run went: what its history says was measured, and its loop split by calibration.

Start-up, compiling, building, loop and writing are measured in the run itself, and so is what takes long enough to be
timed there: all phases of a search for equilibria, and in real time whatever lies between two chunks of compiled steps
(dead-load equilibrium, contact detection, cutting of polygons, record). Timing the parts of a step there would cost
more than the parts, so steps are split afterwards, on the machine that asks: the scenario is run again to the middle of
its steps, or for a second, and from that state short loops are timed, all with the kernel of the run. Of a replay

    A  as the run was,  B  without looking at the bracket,  C  without taking rows and frames,
    D  without bracket, record and joints: what is left is the motion of the blocks (and the actuator),

each from a copy of the same state, best of several, less the cost of calling the kernel. The bracket then takes A - B,
the record A - C, the motion D and the joint forces what is left; these shares are laid over the time of the run's loop.
In real time the joints take what a loop without them saves, new contacts likewise, and the motion what is left.
"""

from __future__ import annotations

import copy
import dataclasses
import time
from collections.abc import Mapping
from contextlib import suppress

import numpy as np

from dembrick.assembly import build as assemblies
from dembrick.errors import DivergedError, NotConvergedError, ScenarioError
from dembrick.kernels.dynamics.loop import Limits
from dembrick.runs.motion_result import lived_through
from dembrick.scenario.controls import in_real_time
from dembrick.scenario.model import Output, Scenario
from dembrick.simulation.dynamics.checkpoint import Past
from dembrick.simulation.dynamics.integrator import LONGEST_CHUNK, advance
from dembrick.simulation.dynamics.loads import driving_of
from dembrick.simulation.dynamics.run import NO_LIMIT
from dembrick.simulation.session import Session
from dembrick.simulation.statics import constant_rate, limit_load
from dembrick.simulation.statics.stepper import Loop, Stepper

PHASES = ("joint_forces", "block_motion", "bracket", "record")
STEPS = ("joint_forces", "new_contacts", "block_motion")  # of a run in real time
RUN_UP = 1.0  # s, at most, to a state that is worth timing
SAMPLE = 0.02  # s of a timed loop, if the record has room for as many steps
ROUNDS, LEAST = 9, 1.0  # rounds of which the best counts: so many, and more until they took so long (s)
NO_PHASES = "the loop of this run is not split into phases"
TOO_SHORT = "the run is too short to be split into phases"
NEVER = np.int64(1) << 62  # steps


class _Enough(Exception):
    """The run has come to a state that is worth timing."""

    def __init__(self, run):
        self.run = run


class _RunUp(Session):
    """Ends a run half way, or after ``RUN_UP`` seconds."""

    def __init__(self, output: Output, steps: int):
        super().__init__(self._look, output, longest_chunk=max(1, steps // 4))
        self._half, self._began = steps // 2, None

    def _look(self, _rows, _frames) -> None:
        """Without an observer the loop would have no record."""

    def pause(self, run, within: bool = False) -> None:
        """See `Session.pause`."""
        now = time.perf_counter()
        if self._began is None:  # what compiles is over
            self._began = now
        late = now - self._began > RUN_UP
        if isinstance(run, Stepper) and (run.loop.step >= self._half or late):
            raise _Enough(run)
        if isinstance(run, Past) and (run.moving.steps >= self._half or late):
            raise _Enough(run)


def loop_phases(scenario: Scenario, results: Mapping) -> dict[str, float]:
    """Seconds of the loop by phase; ``results``: what the history of the run says of it.

    Raises ScenarioError where there is nothing to time.
    """
    steps, measured = results["steps"], results["wall"].get("phases")
    if not measured:
        whole, shares = results["wall"]["loop"], loop_shares(scenario, steps)
        return {name: share * whole for name, share in shares.items()}
    phases = dict(measured)
    if in_real_time(scenario.control):
        whole, shares = phases.pop("steps"), step_shares(scenario, steps)
        phases = {name: share * whole for name, share in shares.items()} | phases
    return phases


def loop_shares(scenario: Scenario, steps: int) -> dict[str, float]:
    """Share of the loop that each of ``PHASES`` takes, together 1; ``steps``: how many the run had.

    Raises ScenarioError where the scenario is no replay, or so short that there is nothing to time.
    """
    control, factor = scenario.control, scenario.solver.step_factor
    session = _RunUp(scenario.output, max(steps, 8))
    assembly = assemblies.assemble(scenario)
    try:
        if control.kind == "yield":
            limit_load.find_limit_load(assembly, 0.0, factor, session)  # a tolerance of zero ends no search
        elif control.kind == "displacement":
            constant_rate.push_at_constant_rate(assembly, control.rate, control.travel, factor, session)
        else:
            raise ScenarioError(NO_PHASES)
    except NotConvergedError as error:
        raise ScenarioError(NO_PHASES) from error
    except _Enough as enough:
        return _shares(enough.run.loop, enough.run.recorder)
    raise ScenarioError(TOO_SHORT)


def step_shares(scenario: Scenario, steps: int) -> dict[str, float]:
    """Share of the compiled steps of a run in real time that each of ``STEPS`` takes, together 1.

    Raises ScenarioError where the run is so short that there is nothing to time.
    """
    session, assembly = _RunUp(scenario.output, max(steps, 8)), assemblies.assemble(scenario)
    try:
        lived_through(scenario, assembly, session)
    except (NotConvergedError, DivergedError) as error:
        raise ScenarioError(NO_PHASES) from error
    except _Enough as enough:
        moving = enough.run.moving
        return _step_shares(moving, driving_of(scenario, assembly, moving.time_step))
    raise ScenarioError(TOO_SHORT)


def _step_shares(moving, driving) -> dict[str, float]:
    steps = 8
    while steps < LONGEST_CHUNK and steps * _stepped(moving, driving, steps) < SAMPLE:
        steps *= 2
    best, began, rounds = np.full(3, np.inf), time.perf_counter(), 0
    while rounds < ROUNDS or time.perf_counter() - began < LEAST:
        rounds += 1
        best = np.minimum(best, [_stepped(moving, driving, steps, without) for without in (None, *STEPS[:2])])
    whole, no_joints, no_contacts = best
    found = {"joint_forces": whole - no_joints, "new_contacts": whole - no_contacts}
    if moving.contact_detection.touching is None:
        found["new_contacts"] = 0.0
    found = {name: min(max(0.0, float(seconds)), float(whole)) for name, seconds in found.items()}
    found["block_motion"] = max(0.0, float(whole) - sum(found.values()))
    total = sum(found.values())
    return {name: seconds / total for name, seconds in found.items()}


def _stepped(moving, driving, steps: int, without: str | None = None) -> float:
    """Seconds a compiled step, over ``steps`` from a copy of the motion; joints that are left out keep their forces."""
    own = copy.deepcopy(moving, {id(moving.assembly): moving.assembly})
    if without == "joint_forces":
        families = {name: getattr(own.state, name) for name in ("corners", "faces")}
        apart = {name: part._replace(joint=part.joint[:0]) for name, part in families.items() if part is not None}
        own.state = own.state._replace(**apart)
    touching = own.contact_detection.touching
    if without == "new_contacts" and touching is not None:
        own.contact_detection.touching = touching._replace(first=touching.first[:0])
    own.loop_seconds = 0.0
    with suppress(NotConvergedError, DivergedError):
        advance(own, driving, steps, Limits(displacement=NO_LIMIT, longest=NO_LIMIT))
    return own.loop_seconds / max(1, own.steps - moving.steps)


def _shares(loop: Loop, recorder) -> dict[str, float]:
    record, never = recorder.record, np.array([NEVER, NEVER])
    certificate = loop.certificate._replace(tolerance=0.0)
    guard = None if loop.guard is None else loop.guard._replace(longest=np.inf, mask=int(NEVER) - 1)
    loop = dataclasses.replace(loop, certificate=certificate, guard=guard)
    blind = dataclasses.replace(loop, certificate=certificate._replace(every=int(NEVER)))
    state, none = loop.state, np.zeros(0, np.int64)
    apart = state._replace(
        points=None if state.points is None else state.points._replace(joint=none),
        areas=None if state.areas is None else state.areas._replace(joint=none),
    )
    still, silent = dataclasses.replace(blind, state=apart), record._replace(every=never)
    steps = 8
    while steps < recorder.longest_chunk and _timed(loop, record, steps) < SAMPLE:
        steps = min(2 * steps, recorder.longest_chunk)
    runs = ((loop, record), (blind, record), (loop, silent), (still, silent))
    best, calls = np.full(len(runs), np.inf), np.full(len(runs), np.inf)
    began, rounds = time.perf_counter(), 0
    while rounds < ROUNDS or time.perf_counter() - began < LEAST:
        rounds += 1
        best = np.minimum(best, [_timed(*run, steps) for run in runs])
        calls = np.minimum(calls, [_timed(*run, 0) for run in runs])
    whole, no_bracket, no_record, motion = best - calls
    found = dict(zip(PHASES, (0.0, motion, whole - no_bracket, whole - no_record), strict=True))
    found = {name: max(0.0, float(seconds)) for name, seconds in found.items()}
    found["joint_forces"] = max(0.0, float(whole) - sum(found.values()))
    total = sum(found.values())
    if not total > 0.0:
        raise ScenarioError(TOO_SHORT)
    return {name: seconds / total for name, seconds in found.items()}


def _timed(loop: Loop, record, steps: int) -> float:
    """Seconds of ``steps`` steps from a copy of the loop's state."""
    own = dataclasses.replace(
        loop,
        state=type(loop.state)(*(_copied(part) for part in loop.state)),
        certificate=_copied(loop.certificate),
        energy=_copied(loop.energy),
        guard=_copied(loop.guard),
    )
    record.count[:] = 0
    began = time.perf_counter()
    own.advance(steps, record)
    return time.perf_counter() - began


def _copied(part):
    if part is None:
        return None
    return type(part)(*(value.copy() if isinstance(value, np.ndarray) else value for value in part))
