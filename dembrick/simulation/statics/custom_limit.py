"""Search for the limit load of blocks whose joints follow a user-defined law (`find_peak`).

No theorem bounds the strength of such a law, so nothing is certified: the blocks are pushed with artificial inertia,
step by step, until the load is steady or has fallen to `FALLEN` of its peak, and again at half the rate, until the peak
no longer changes. The errors from inertia, dashpots and step length are all of the order of the rate once the peak is
`RESOLVED` steps away, so twice the change by the last halving is the error bar. When a block begins to move, the load
overshoots, less and less at a lower rate; if it settles within the tolerance below its peak, either may be the limit,
and the error bar includes both.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from dembrick.errors import NotConvergedError, ScenarioError
from dembrick.kernels.state import ScaledInertia
from dembrick.kernels.statics.loop import CONVERGED, RUNNING, Drive
from dembrick.scenario.checks import present
from dembrick.simulation.session import Session
from dembrick.simulation.statics.critical_step import critical_time_step
from dembrick.simulation.statics.elastic_factor import touches_itself
from dembrick.simulation.statics.guards import new_guard, refuse_divergence
from dembrick.simulation.statics.load_system import (
    ACTUATOR_STIFFNESS,
    VISCOUS,
    Replay,
    Setup,
    rough_strength,
    steady_drive,
)
from dembrick.simulation.statics.paths.limit_state import copy_of
from dembrick.simulation.statics.recorder import Recorder
from dembrick.simulation.statics.state import State, new_energy
from dembrick.simulation.statics.stepper import Loop, Stepper
from dembrick.simulation.statics.stiffness import inverse_inertia
from dembrick.simulation.statics.yield_point import YieldPoint, read_off

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly

FALLEN = 0.05  # of the peak: a load that has fallen so far is past its peak
HALVINGS = 15  # of the rate, at most
RESOLVED, FINEST = 50, 100_000  # steps to a peak: with fewer it does not count, with more the rate is not halved again
MOST_STEPS = 200_000  # of a push at the full rate
BAR = 2.0  # times the change by the last halving of the rate
BEHIND = 4.0  # tolerances below the peak: a steady load below that is a residual strength of its own
STEADY = 0.1  # of the tolerance: what a load that counts as steady may still gain; least error bar
RECORDED = 4096  # steps of a chunk of the push that is recorded
SLIP_PER_STEP = 1.0  # elastic slips that the head moves in a step towards a limit load
GENTLY = 0.3  # of that, if the load tilts a block, which a fast head sets rocking as it slides
FLUCTUATION_DAMPING = 0.2  # share of the velocity fluctuations that a step removes, if the load tilts a block


@dataclass
class _Push:
    """One push: V of its peak (N), and the state, step and driven displacement (m) there; the load at its end, its
    steps, and whether it ended by itself."""

    V: float
    state: State
    at: int
    driven: float
    after: float
    steps: int
    over: bool


def find_peak(assembly: Assembly, tolerance: float, step_factor: float, session: Session | None = None) -> Replay:
    """Push until the peak of V is known within ``tolerance`` (relative half-width).

    Raises NotConvergedError if the load neither falls nor becomes steady, or the peak keeps changing; ScenarioError if
    free blocks touch each other, are tied or guided; and the errors of the dead-load equilibrium.
    """
    session = Session.of(session)
    found: list[float] = []
    bars: list[float] = []
    for halvings in range(HALVINGS + 1):
        pace = 0.5**halvings
        push = _push(assembly, tolerance, step_factor, pace)
        if not push.over:
            raise NotConvergedError(
                f"no limit load: after {push.steps} steps V is {push.after:.6g} N, neither steady nor reduced to "
                f'{FALLEN:g} of its peak of {push.V:.6g} N; follow the test with kind = "displacement" and a rate'
            )
        if push.at < RESOLVED:
            continue
        if found:
            bars.append(max(BAR * abs(push.V - found[-1]), STEADY * tolerance * abs(push.V)))
        found.append(push.V)
        if len(bars) < 2:
            continue
        bar = max(bars[-1], 0.5 * bars[-2])
        if push.V - push.after <= tolerance * abs(push.V):
            bar = max(bar, push.V - push.after + STEADY * tolerance * abs(push.V))
        if bar <= tolerance * abs(push.V):
            return _recorded(assembly, tolerance, step_factor, pace, session, push, bar)
        if push.at > FINEST:
            break
    raise NotConvergedError(
        f"the limit load was not found within {tolerance:g}: after the rate was halved {halvings} times the peak of "
        f"{push.V:.6g} N may still change by {bar:.3g} N. Allow a larger control.tolerance"
    )


def _loop(assembly: Assembly, tolerance: float, step_factor: float, pace: float) -> tuple[Setup, Loop, float]:
    """The dead-load equilibrium, the loop that pushes it, and the critical time step (s)."""
    setup = Setup(assembly, tolerance)
    if touches_itself(setup.state):
        raise ScenarioError(
            "a limit load with a custom joint law can be searched only if each block stands on fixed blocks alone, "
            'without ties and guides: use kind = "displacement" with a rate'
        )
    dt, inertia, drive = _inertia_and_drive(setup, step_factor)
    drive = drive._replace(rate=pace * drive.rate)
    state = setup.state
    guard, nobody = new_guard(assembly, state), Session.of(None)
    loop = Loop(dt, state, inertia, None, drive, setup.certificate, new_energy(state), guard)
    # recorded even if it is not read, so that only one form of the loop is compiled
    loop.record = Recorder(state, nobody, 2, rows_every=1 << 40, frames_every=1 << 20).record
    return setup, loop, setup.dashpots().critical_time_step


def _eta(step_factor: float) -> float:
    """Frequency of the scaled blocks times the time step; actuator and dashpots lower its critical value below 2."""
    return float(step_factor * critical_time_step(math.sqrt(1.0 + ACTUATOR_STIFFNESS), VISCOUS))


def _inertia_and_drive(setup: Setup, step_factor: float) -> tuple[float, ScaledInertia, Drive]:
    """The time step of a search with artificial inertia (s), that inertia, and the actuators at their full rate."""
    dt = step_factor * setup.dashpots().critical_time_step
    inertia = inverse_inertia(setup.state, setup.stiffness * (dt / _eta(step_factor)) ** 2)
    scale = rough_strength(setup.state, setup.certificate, setup.load) * setup.compliance / setup.weight
    rate = float(SLIP_PER_STEP * scale / dt)
    drive = steady_drive(rate, dt, setup.actuator_stiffness)
    if setup.certificate.tilts:
        drive = drive._replace(rate=rate * GENTLY, damping=FLUCTUATION_DAMPING)
    return dt, inertia, drive


class _Carried:
    """Load carried by the springs of the joints in the motion of a step, by virtual work: without the inertia and the
    dashpots of the search, which make the V of the actuators overshoot."""

    def __init__(self, setup: Setup):
        self._state, self._load = setup.state, setup.load
        blocks = setup.state.blocks
        self._dead = np.concatenate([blocks.dead_force, blocks.dead_torque], axis=1)
        self._now = self._before = self._motion()

    def load(self) -> float:
        """V (N) after a step; zero if the actuators did not move ahead in it."""
        step, self._before, self._now = self._now - self._before, self._now, self._motion()
        custom = present(present(self._state.points).custom)
        ahead = float((self._load * step).sum())
        if not ahead > 0.0:
            return 0.0
        shear = custom.memory[:, 1:3] * custom.move[:, 2:]
        taken = float((custom.memory[:, 0] * custom.move[:, 1]).sum() + shear.sum())
        return (taken - float((self._dead * step).sum())) / ahead

    def _motion(self) -> np.ndarray:
        return np.concatenate([self._state.blocks.displacement, self._state.blocks.rotation], axis=1)


def _push(assembly: Assembly, tolerance: float, step_factor: float, pace: float) -> _Push:
    setup, loop, critical = _loop(assembly, tolerance, step_factor, pace)
    now, status, most = setup.state.actuators.driven[0], RUNNING, int(MOST_STEPS / pace)
    carried = _Carried(setup)
    peak = _Push(0.0, setup.state, 0, 0.0, 0.0, 0, False)
    rising = False
    while status == RUNNING and loop.step < most:
        status = loop.advance(1)
        V = min(carried.load(), float(now.load))
        if V > peak.V:
            peak.V, peak.at, peak.driven, rising = V, loop.step, float(now.displacement), True
        elif rising:
            peak.state, rising = copy_of(setup.state), False  # one step past the peak, where the motion is the same
        if now.load < FALLEN * peak.V:
            break
    refuse_divergence(status, assembly, setup.state, loop.step, loop.dt, critical)
    if rising:
        peak.state = copy_of(setup.state)
    peak.after, peak.steps, peak.over = float(now.load), loop.step, status == CONVERGED or loop.step < most
    return peak


def _recorded(
    assembly: Assembly, tolerance: float, step_factor: float, pace: float, session: Session, push: _Push, bar: float
) -> Replay:
    """Repeat the last push with its record; return the yield point of its peak."""
    setup, loop, critical = _loop(assembly, tolerance, step_factor, pace)
    state = setup.state
    rows_every = max(1, push.steps // session.output.rows)
    frames_every = max(1, min(push.steps, session.output.rows) // session.output.frames)
    recorder = None
    if session.observe:
        chunk, watched = min(RECORDED, push.steps), assembly.control_points
        recorder = Recorder(state, session, chunk, rows_every, frames_every, watched)
        loop.record = recorder.record
    began = time.perf_counter()
    loop.advance(0)
    compiled = time.perf_counter() - began
    status = Stepper(loop, session, recorder, RECORDED, push.steps, rows_every).to(push.steps)
    refuse_divergence(status, assembly, state, loop.step, loop.dt, critical)
    replay = setup.finished(True, loop, critical, compiled, setup.settings(loop.drive) | {"inertia": "scaled"})
    replay.yield_point, replay.state = _point(push, bar, tolerance, setup, loop.dt), push.state
    return replay


def _point(push: _Push, bar: float, tolerance: float, setup: Setup, dt: float) -> YieldPoint:
    found = read_off(push.state, setup.certificate, setup.assembly.names)
    lower, upper = push.V - bar, push.V + bar
    behind = push.after < lower - BEHIND * tolerance * push.V
    return replace(
        found,
        V=push.V,
        V_lower=lower,
        V_upper=upper,
        bracket="indicator",
        V_peak=push.V,
        displacement=push.driven,
        displacement_at_peak=push.driven,
        actuator_load=push.after,
        V_after=push.after if behind else None,
        limit_at=push.at * dt,
    )
