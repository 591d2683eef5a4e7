"""Where the time of a run went: what its history says was measured, and its loop split by calibration.

Start-up, compiling, building, loop and writing are measured in the run itself. Timing the parts of a step there would
cost more than the parts, so the loop is split afterwards, on the machine that asks: the scenario is run again to the
middle of its steps, or for a second, and from that state short loops are timed, all with the kernel of the run,

    A  as the run was,  B  without looking at the bracket,  C  without taking rows and frames,
    D  without bracket, record and joints: what is left is the motion of the blocks (and the jack),

each from a copy of the same state, best of several, less the cost of calling the kernel. The bracket then takes A - B,
the record A - C, the motion D and the joint forces what is left; these shares are laid over the time of the run's loop.
"""

from __future__ import annotations

import dataclasses
import time

import numpy as np

from dembrick import assembly as assemblies
from dembrick import replay
from dembrick.errors import NotConvergedError, ScenarioError
from dembrick.model import Output, Scenario
from dembrick.session import Session
from dembrick.stepping import Loop, Stepper

PHASES = ("joint_forces", "block_motion", "bracket", "record")
RUN_UP = 1.0  # s, at most, to a state that is worth timing
SAMPLE = 0.02  # s of a timed loop, if the record has room for as many steps
ROUNDS, LEAST = 9, 1.0  # rounds of which the best counts: so many, and more until they took so long (s)
NO_PHASES = "the loop of this run is not split into phases"
NEVER = np.int64(1) << 62  # steps


class _Enough(Exception):
    """The run has come to a state that is worth timing."""

    def __init__(self, run):
        self.run = run


class _RunUp(Session):
    """Ends a run half way, or after ``RUN_UP`` seconds."""

    def __init__(self, output: Output, steps: int):
        super().__init__(self._look, output, longest_chunk=max(1, steps // 4))
        self._half, self._began = steps // 2, time.perf_counter()

    def _look(self, _rows, _frames) -> None:
        if time.perf_counter() - self._began > 5.0 * RUN_UP:  # no time loop that pauses
            raise ScenarioError(NO_PHASES)

    def pause(self, run, within: bool = False) -> None:
        """See `Session.pause`."""
        late = time.perf_counter() - self._began > RUN_UP
        if isinstance(run, Stepper) and (run.loop.step >= self._half or late):
            raise _Enough(run)


def loop_shares(scenario: Scenario, steps: int) -> dict[str, float]:
    """Share of the loop that each of ``PHASES`` takes, together 1; ``steps``: how many the run had.

    Raises ScenarioError where the scenario is no replay, or so short that there is nothing to time.
    """
    control, factor = scenario.control, scenario.solver.step_factor
    session = _RunUp(scenario.output, max(steps, 8))
    assembly = assemblies.build(scenario)
    try:
        if control.kind == "yield":
            replay.find_limit_load(assembly, 0.0, factor, session)  # a tolerance of nought ends no search
        elif control.kind == "displacement":
            replay.push_at_constant_rate(assembly, control.rate, control.travel, factor, session)
        else:
            raise ScenarioError(NO_PHASES)
    except NotConvergedError as error:
        raise ScenarioError(NO_PHASES) from error
    except _Enough as enough:
        return _shares(enough.run.loop, enough.run.recorder)
    raise ScenarioError("the run is too short to be split into phases")


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
        raise ScenarioError("the run is too short to be split into phases")
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
