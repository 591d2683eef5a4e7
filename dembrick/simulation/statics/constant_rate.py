"""Constant-rate test, as in the laboratory (`push_at_constant_rate`): physical inertia, moving geometry.

The head of the actuators moves at constant speed over a given travel; the record is the whole curve, past the peak.
Dashpots are those of `critical_step.dashpots`: a fraction of the critical damping of each block, whatever the time
step. If the bracket is not certified, the load must be steady to count as the limit load.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np

from dembrick.errors import NotConvergedError, ScenarioError
from dembrick.geometry.rotations import rotation_matrix, turned_by, unit_quaternion
from dembrick.kernels.state import Inertia
from dembrick.kernels.statics.loop import TURNING, Guard
from dembrick.scenario.model import Output
from dembrick.scenario.protocols import Protocol
from dembrick.simulation.session import Observer, Plan, Session
from dembrick.simulation.statics import joint_families, ties
from dembrick.simulation.statics.guards import (
    SLOW,
    Course,
    came_down,
    further,
    in_the_way,
    new_guard,
    other_joints,
    refuse_divergence,
    refuse_unsound,
    slower,
    steady,
    swings,
)
from dembrick.simulation.statics.load_system import (
    MOST_STEPS_AT_RATE,
    LoadSystem,
    Replay,
    Setup,
    steady_drive,
)
from dembrick.simulation.statics.recorder import Recorder
from dembrick.simulation.statics.state import State, new_energy
from dembrick.simulation.statics.stepper import Loop, Stepper
from dembrick.simulation.statics.yield_point import YieldPoint, at_the_end, without_mechanism

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.scenario.controls import DisplacementControl

ENOUGH = 20.0  # elastic slips of a joint: a travel on which most loads become steady
LOOKS = 8  # checks per segment whether the joints are still those of the start
BOUNDS = 1000  # evaluations of the bounds of the load, over some of which these must be constant, whatever the rows
CHUNK = 1 << 16  # steps of a constant-rate test between two checks of the clock


def push_at_constant_rate(
    assembly: Assembly, protocol: Protocol, step_factor: float, session: Session | Observer | None = None
) -> Replay:
    """Move the actuator head by a ``protocol``, one way or back and forth, with physical inertia; returns a Replay.

    The bracket follows from the record: a strict one is valid at any rate, and narrower at lower rates. If it is not
    strict, V is the mean load of the last quarter of the travel; with ties, the load at its end. Raises DivergedError,
    and NotConvergedError if the blocks collapse under the dead loads alone, if no joint has yielded at the end of a
    monotonic test, if the load of an uncertified test without ties still rises or oscillates there, or if that of a
    slow certified one oscillates wildly or stays far below its bracket.
    """
    session = Session.of(session)
    setup = Setup(assembly, tolerance=0.0, session=session)
    state = setup.state
    before, opening = SimpleNamespace(**joint_families.memory(state)), state.joints.opening.copy()
    if joint_families.follows_bending(state):
        # inertia forces above the joint shift the pressure, and with it the friction
        setup.certificate = setup.certificate._replace(strict=False)
    damping = setup.dashpots()
    critical = damping.critical_time_step
    rate = _fastest(protocol)
    dt = setup.time_step(step_factor * critical, rate)
    output = session.output
    rows_every = max(1, _steps(protocol, dt) // output.rows)
    until = _until(protocol, dt, rows_every)
    steps_wanted = int(until[-1]) + protocol.cycles  # a row at the last turning point too
    drive = steady_drive(rate, dt, setup.actuator_stiffness)._replace(
        dashpot=damping.actuator * setup.actuator_stiffness, viscous_n=1.0, viscous_s=1.0
    )
    if protocol.cycles:
        drive = drive._replace(until=until, ways=protocol.ways)
    state.joints.damping[:] = damping.joints / dt
    to_finite_motion(state)
    moving = ties.start_moving(state, assembly)
    chunk = min(CHUNK, steps_wanted)
    frames_every = max(1, min(steps_wanted, output.rows) // output.frames)
    watched = assembly.control_points
    # recorded even if it is not read: that takes a tenth of the time, and only one form of the loop is compiled
    recorder = Recorder(state, session, chunk, rows_every, frames_every, watched)
    setup.certificate = setup.certificate._replace(every=max(1, _steps(protocol, dt) // BOUNDS))
    energy, guard = new_energy(state), new_guard(assembly, state, steps_wanted)
    loop = Loop(
        dt, state, None, physical_inertia(assembly), drive, setup.certificate, energy, guard, moving, recorder.record
    )
    began = time.perf_counter()
    loop.advance(0)  # no step: compiles, or loads the cache
    compiled = time.perf_counter() - began
    if session.resumed:
        loop.restore(session.resumed)
    stepper = Stepper(loop, session, recorder, CHUNK, steps_wanted, rows_every)
    said = None
    for last in _looks(until, steps_wanted):
        status = stepper.to(last)
        refuse_divergence(status, assembly, state, loop.step, dt, critical)
        said = other_joints(assembly, state, abs(float(state.actuators.driven[0].head))) or said
    if said and session.report:
        session.report(said)
    session.ended(stepper)
    ties.stop_moving(state, moving)
    chosen = {"rate": rate, "inertia": "physical"}
    replay = setup.finished(True, loop, critical, compiled, setup.settings(drive) | chosen)
    if any(law.weakens for law in assembly.joints.law):
        replay.broke = bool(joint_families.broke(state, before))
    elastic = replay.yield_point.bracket != "certified" and not (
        joint_families.gave_way(state, before) or joint_families.opened(state, opening)
    )
    if elastic:
        replay.yield_point = without_mechanism(replay.yield_point)
    if protocol.cycles:
        replay.yield_point = _of_cycles(replay.yield_point)
        replay.turns = tuple((until // rows_every).tolist())
        return replay
    travel, ahead = float(protocol.turns.max()), partial(in_the_way, assembly, state)
    calm = SLOW * setup.compliance / setup.weight / critical
    if replay.yield_point.V_upper is None or (elastic and state.ties is not None):  # without ties, V still rises
        point, load = replay.yield_point, float(joint_families.friction(state).max()) * setup.dead_strength()
        factor = ENOUGH * load * setup.compliance / setup.weight / travel
        if factor < 1.0 and rate > calm * load:
            advice = slower(calm * load)
        else:
            advice = further(travel, max(2.0, factor), ahead)
        raise NotConvergedError(
            f"no limit load: the joint has not begun to slip over the travel of {travel:.3g} m, so the {point.V:.6g} "
            f"N of the actuators at its end is not a strength; {advice}",
            replace(point, V=None),
        )
    if setup.certificate.strict:
        slip = replay.yield_point.V_lower * setup.compliance / setup.weight
        pace = rate * critical / slip if slip > 0.0 else math.inf
        refuse_unsound(replay.yield_point, guard, pace, float(joint_families.reach(state).max()))
        if (said := swings(replay.yield_point, guard)) and session.report:
            session.report(said)
    elif state.ties is not None:  # they may stretch for ever: V is the load at the end of the travel
        replay.yield_point = at_the_end(replay.yield_point, setup.certificate)
    else:
        course = Course(travel, rate, calm, 1e-3 * setup.dead_strength())
        replay.yield_point = _steady(replay.yield_point, guard, course, ahead, assembly, state)
    return replay


def _of_cycles(point: YieldPoint) -> YieldPoint:
    """``point`` of a cyclic test: a certified bracket is that of V > 0, else V is that at the end."""
    if point.bracket == "certified":
        return point
    return replace(point, V=point.actuator_load, V_lower=point.actuator_load, V_upper=None, bracket="open")


def _steady(
    point: YieldPoint,
    guard: Guard,
    course: Course,
    ahead: Callable[[float], str | None],
    assembly: Assembly,
    state: State,
) -> YieldPoint:
    """`steady`, with a message on the fall if it refuses because blocks have fallen."""
    try:
        return steady(point, guard, course, ahead)
    except NotConvergedError as error:
        fall = came_down(assembly, state)
        if fall is None:
            raise
        raise NotConvergedError(f"no limit load: {fall}", error.yield_point) from None


def plan(
    assembly: Assembly, control: DisplacementControl, protocol: Protocol, step_factor: float, output: Output
) -> Plan:
    """Plan of a test, without running any of it."""
    system = LoadSystem(assembly)
    dt = system.time_step(step_factor * system.dashpots().critical_time_step, _fastest(protocol))
    steps = _steps(protocol, dt)
    return system.plan(dt, steps, min(steps, 2 * output.rows), control, output, exact=True)


def _fastest(protocol: Protocol) -> float:
    """The greatest rate of the head (m/s)."""
    turning = 1.0 - TURNING if protocol.cycles else 1.0
    return float((np.abs(protocol.ways) / protocol.seconds).max()) / turning


def _steps(protocol: Protocol, dt: float) -> int:
    """Steps of a constant-rate test."""
    wanted = float(protocol.seconds.sum()) / dt
    if wanted > MOST_STEPS_AT_RATE:
        way = float(np.abs(protocol.ways).sum())
        raise ScenarioError(
            f"control.rate = {_fastest(protocol):g} m/s over a travel of {way:g} m takes {wanted:.3g} steps of "
            f"{dt:.3g} s: use a higher rate or a shorter travel"
        )
    return math.ceil(wanted)


def _until(protocol: Protocol, dt: float, rows_every: int) -> np.ndarray:
    """The steps (w,) at which the segments of a protocol end; each of them has a row."""
    if not protocol.cycles:
        return np.array([_steps(protocol, dt)])
    rows = np.maximum(np.round(protocol.seconds / (dt * rows_every)), 1.0)
    return (rows_every * np.cumsum(rows)).astype(np.int64)


def _looks(until: np.ndarray, steps: int) -> list[int]:
    """Steps after which the joints are checked: `LOOKS` on each segment of a protocol, and the last step."""
    begins = np.concatenate([[0], until[:-1]])
    looks = begins[:, None] + (until - begins)[:, None] * np.arange(1, LOOKS + 1) // LOOKS
    return [*looks.ravel().tolist()[:-1], steps]


def physical_inertia(assembly: Assembly) -> Inertia:
    """Mass and inertia of the blocks of an assembly."""
    return Inertia(np.array(assembly.mass, float), np.linalg.inv(assembly.inertia))


def to_finite_motion(state: State) -> None:
    """Convert the infinitesimal rotations of the dead-load equilibrium, and of previous runs, into orientations, and
    set the zero of the actuator displacements accordingly."""
    blocks, actuators = state.blocks, state.actuators
    blocks.orientation[:] = unit_quaternion(turned_by(blocks.rotation, blocks.orientation))
    blocks.rotation[:] = 0.0
    own = actuators.block
    arm = np.einsum("kij,kj->ki", rotation_matrix(blocks.orientation[own]), actuators.lever)
    since_start = ((blocks.displacement[own] + arm - actuators.start) * actuators.direction).sum(axis=1)
    actuators.zero[:] = since_start - actuators.displacement
