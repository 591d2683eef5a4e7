"""The two ways to push a test: to its limit load, and at a constant rate as the laboratory does.

**Limit load** (`find_limit_load`). Nobody waits for physical inertia. Where free blocks touch one another their
equilibrium is followed directly (``quasi_static``). Else every block gets an artificial inertia proportional to its
contact stiffness, so that all its modes swing together and the out-of-balance force of a joint never stirs another of
its components; the geometry stays that of the start, where a limit load is defined. The jacks push at about
one elastic slip a step. Damping sits in the contacts, behind the slider, and in the jack, on the difference between
head and block: both vanish when the blocks slide steadily, so that V is then what the joints carry, however fast they
move. What is left to wait for is the memory of the elastic forces, which slip wipes out. The bracket of the limit load
(``kernels.bracket``) is formed at every step, and the replay ends when it is narrow enough.

**Constant rate** (`push_at_constant_rate`). Physical inertia and moving geometry, a jack head at constant speed over a
given travel; the whole curve, past the peak. Dashpots are those of `stability.dashpots`: a part of the critical damping
of each block, whatever the time step. Where the bracket is no certified one, the load that is read off must be steady.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field

import numpy as np

from dembrick.errors import NotConvergedError, ScenarioError
from dembrick.kernels.state import Energy, Inertia
from dembrick.kernels.statics.load_bounds import Certificate
from dembrick.kernels.statics.loop import CONVERGED, RUNNING, Drive
from dembrick.scenario.controls import on_all_blocks
from dembrick.scenario.model import Output
from dembrick.simulation.session import Observer, Plan, Session
from dembrick.simulation.statics.certificate import certificate, frictionless
from dembrick.simulation.statics.critical_step import Dashpots, block_inertia, critical_time_step, dashpots
from dembrick.simulation.statics.dead_load import inverse_inertia, seat
from dembrick.simulation.statics.elastic_factor import elastic_factor, touches_itself
from dembrick.simulation.statics.guards import new_guard, refuse_divergence
from dembrick.simulation.statics.path_following import follow, prepare
from dembrick.simulation.statics.recorder import Recorder
from dembrick.simulation.statics.state import State, initial_state, load_vectors, new_energy
from dembrick.simulation.statics.steady_load import refuse_unsound, steady
from dembrick.simulation.statics.stepper import Loop, Stepper
from dembrick.simulation.statics.stiffness import block_stiffness
from dembrick.simulation.statics.yield_point import YieldPoint, joint_reach, read_off

# Numerical choices; answers do not depend on them beyond the tolerance, and a test says so.
VISCOUS = 0.5  # dashpot force over spring force for the same increment, in contacts and jack, while searching
JACK = 1.0  # stiffness of the jack over that of the joints along the load
SLIP_PER_STEP = 1.0  # elastic slips that the head moves in a step towards a limit load
GENTLY = 0.3  # of that, where the load tilts a block, which a fast head sets rocking as it slides
GUESS = 0.25  # of the weight of all blocks: a first guess of a load on all of them
CALMING = 0.2  # of the swing of a block's velocity that a step takes away, where the load tilts it
MEMORY = 1.0 / 16.0  # weight of the latest step in the mean that it swings about
RAMP = 8  # steps over which the head speeds up
CHUNK_OF_SEARCH = 256  # steps of a search between two looks at it
HALVING = 512  # steps in which a search slows to half its rate, once it has taken 16 times as many
MOST_STEPS = 20_000  # of a search
MOST_STEPS_AT_RATE = 2_000_000_000  # of a constant-rate test
FINEST = 0.25  # of what friction 1 would let the joints give, that the head may move in a step of a constant-rate test
CHUNK = 1 << 16  # steps of a constant-rate test between two looks at the clock


@dataclass
class Replay:
    """A finished replay: the yield point, the state it ended in, what the program chose and how long it took (s)."""

    yield_point: YieldPoint
    state: State
    converged: bool
    steps: int
    time_step: float
    critical_time_step: float
    simulated_time: float
    unbalanced: float
    compile_seconds: float
    loop_seconds: float
    energy: Energy | None = None
    settings: dict = field(default_factory=dict)
    moved: np.ndarray | None = None  # (n, 3) m, since the blocks were seated
    phases: dict | None = None  # s, of the loop, where it was timed by phase


def find_limit_load(
    assembly,
    tolerance: float,
    step_factor: float,
    session: Session | Observer | None = None,
    goal: float | None = None,
    steps: float = 1.0,
) -> Replay:
    """Push until the bracket of V is within ``tolerance`` of it (relative half-width).

    ``step_factor`` is the time step over the critical one; ``session`` gets the record. With a ``goal`` (m) the path is
    followed until a block has moved that far, by ``steps`` times the usual ones at first. Raises NotConvergedError with
    the best bracket where the tolerance is not reached, DivergedError, and NotConvergedError where the dead loads alone
    bring the blocks down.
    """
    session = Session.of(session)
    setup = _Setup(assembly, tolerance, session, whole=goal is not None)
    if setup.factor is None:
        replay = _by_inertia(setup, step_factor, session)
    else:
        replay = _by_equilibria(setup, session, goal or 0.0, steps)
    if not replay.converged:
        point = replay.yield_point
        name, unit, remedies = "V", " N", ["allow a larger control.tolerance"]
        if goal is not None:
            name, unit = "the load factor", ""
            remedies.append("live through the collapse with control.quasi_static = false")
        above = "without an upper bound" if point.V_upper is None else f"at most {point.V_upper:.6g}{unit}"
        if goal is None or point.V_upper is None:
            remedies.insert(0, "check that the load can move the blocks at all")
        remedy = ", or ".join(remedies)
        raise NotConvergedError(
            f"the limit load was not bracketed within {tolerance:g} after {replay.steps} steps: {name} is at least "
            f"{point.V_lower:.6g}{unit}, {above}. {remedy[0].upper()}{remedy[1:]}",
            point,
        )
    return replay


def _by_equilibria(setup: _Setup, session: Session, goal: float, steps: float) -> Replay:
    """The search where free blocks touch one another: equilibrium by equilibrium."""
    state, certificate = setup.state, setup.certificate
    frames_every = 1 if len(setup.assembly.names) <= 100 else 8
    watched = setup.assembly.control_points
    recorder = Recorder(state, session, 1, 1, frames_every, watched) if session.observe else None
    began = time.perf_counter()
    prepare(state, setup.load, setup.factor, certificate, recorder)
    ready = time.perf_counter()
    # a load on all blocks is resisted by some part of their weight, one jack by a few joints
    strength = GUESS * float(np.linalg.norm(state.blocks.dead_force[state.blocks.free], axis=1).sum()) / setup.weight
    strength = min(strength, _rough_strength(state, certificate, setup.load)) or GUESS
    path = follow(state, setup.load, setup.factor, certificate, steps * strength, recorder, goal, session)
    phases = {"seating": setup.loop_seconds, **path.phases}
    return Replay(
        yield_point=read_off(state, certificate, setup.assembly.names),
        state=state,
        converged=path.converged,
        steps=path.iterations,
        time_step=1.0,
        critical_time_step=setup.dashpots().critical_time_step,
        simulated_time=float(path.equilibria),
        unbalanced=setup.unbalanced,
        compile_seconds=setup.compile_seconds + ready - began,
        loop_seconds=sum(phases.values()),
        settings={"equilibria": path.equilibria, "inertia": "none"},
        moved=state.blocks.displacement - setup.seated,
        phases=phases,
    )


def _by_inertia(setup: _Setup, step_factor: float, session: Session) -> Replay:
    """The search where every free block touches fixed ones only: with artificial inertia."""
    assembly = setup.assembly
    state, load = setup.state, setup.load
    # All frequencies of the scaled blocks are eta/dt; jack and dashpots bring the critical eta below 2.
    eta = step_factor * critical_time_step(math.sqrt(1.0 + JACK), VISCOUS)
    critical = setup.dashpots().critical_time_step
    dt = step_factor * critical
    inertia = inverse_inertia(state, setup.stiffness * (dt / eta) ** 2)
    scale = _rough_strength(state, setup.certificate, load) * setup.compliance / setup.weight
    rate = float(SLIP_PER_STEP * scale / dt)
    drive = setup.drive(rate, dt)._replace(steady=16 * HALVING, slowing=0.5 ** (1.0 / HALVING))
    if setup.certificate.tilts:
        rate *= GENTLY
        drive = drive._replace(rate=rate, calming=CALMING)
    frames_every = 1 if len(assembly.names) <= 100 else 8
    watched = assembly.control_points
    recorder = Recorder(state, session, CHUNK_OF_SEARCH, 1, frames_every, watched) if session.observe else None
    status = RUNNING
    if frictionless(state, setup.certificate):
        setup.certificate.bracket[:] = 0.0
        status = CONVERGED
    energy = new_energy(state) if recorder else None
    loop = Loop(dt, state, inertia, None, drive, setup.certificate, energy, new_guard(assembly, state))
    began = time.perf_counter()
    loop.advance(0, recorder.record if recorder else None)  # no step: compiles, or loads the cache
    compiled = time.perf_counter() - began
    if session.resumed:
        loop.restore(session.resumed)
    stepper = Stepper(loop, session, recorder, CHUNK_OF_SEARCH)
    while status == RUNNING and loop.step < MOST_STEPS:
        status = stepper.to(loop.step - loop.step % CHUNK_OF_SEARCH + CHUNK_OF_SEARCH)
    steps = loop.step
    refuse_divergence(status, assembly, state, steps, dt, critical)
    chosen = {"eta": float(eta), "rate": rate, "inertia": "scaled"}
    return setup.replay(status == CONVERGED, loop, critical, compiled, setup.settings(drive) | chosen)


def push_at_constant_rate(
    assembly, rate: float, travel: float, step_factor: float, session: Session | Observer | None = None
) -> Replay:
    """Move the jack head over ``travel`` (m) at ``rate`` (m/s) with physical inertia; returns a Replay.

    The bracket is what the record allows: strict at any rate, as narrow as the rate lets it be. Where it is not strict,
    V is the mean load of the last quarter of the travel. Raises DivergedError, and NotConvergedError where the dead
    loads alone bring the blocks down, where the load of an uncertified test still rises or swings at the end, or where
    that of a slow certified one swings wildly or stays far below its bracket.
    """
    session = Session.of(session)
    setup = _Setup(assembly, tolerance=0.0, session=session)
    state = setup.state
    if state.areas is not None and state.areas.pressed is not None:
        # inertia above the joint moves the pressure, and the friction with it
        setup.certificate = setup.certificate._replace(strict=False)
    damping = setup.dashpots()
    critical = damping.critical_time_step
    dt = setup.time_step(step_factor * critical, rate)
    steps_wanted = _steps(rate, travel, dt)
    drive = setup.drive(rate, dt)._replace(dashpot=damping.jack * setup.jack_stiffness, viscous_n=1.0, viscous_s=1.0)
    state.joints.damping[:] = damping.joints / dt
    inertia = Inertia(
        mass=np.array(assembly.mass, float),
        tensor=np.array(assembly.inertia, float),
        inverse=np.linalg.inv(assembly.inertia),
    )
    _to_finite_motion(state)
    output = session.output
    rows_every = max(1, steps_wanted // output.rows)
    chunk = min(CHUNK, steps_wanted)
    frames_every = max(1, min(steps_wanted, output.rows) // output.frames)
    watched = assembly.control_points
    recorder = Recorder(state, session, chunk, rows_every, frames_every, watched) if session.observe else None
    setup.certificate = setup.certificate._replace(every=rows_every)
    energy = new_energy(state) if recorder else None
    guard = new_guard(assembly, state, steps_wanted)
    loop = Loop(dt, state, None, inertia, drive, setup.certificate, energy, guard)
    began = time.perf_counter()
    loop.advance(0, recorder.record if recorder else None)  # no step: compiles, or loads the cache
    compiled = time.perf_counter() - began
    if session.resumed:
        loop.restore(session.resumed)
    status = Stepper(loop, session, recorder, CHUNK).to(steps_wanted)
    refuse_divergence(status, assembly, state, loop.step, dt, critical)
    chosen = {"rate": rate, "inertia": "physical"}
    replay = setup.replay(True, loop, critical, compiled, setup.settings(drive) | chosen)
    if setup.certificate.strict:
        slip = replay.yield_point.V_lower * setup.compliance / setup.weight
        pace = rate * critical / slip if slip > 0.0 else math.inf
        refuse_unsound(replay.yield_point, guard, pace, float(joint_reach(state).max()))
    else:
        replay.yield_point = steady(replay.yield_point, guard, least=1e-3 * setup.dead_strength())
    return replay


def plan(assembly, control, step_factor: float, output: Output | None = None) -> Plan:
    """The plan of a replay, without running any of it."""
    output = output or Output()
    system = _LoadSystem(assembly)
    critical = system.dashpots().critical_time_step
    dt = step_factor * critical
    if control.kind == "yield" or on_all_blocks(control):
        # seen over the lab tests and random joints: some 25 steps to 1e-3 and ten more a digit, twice that at height
        steps = 25 + int(20.0 * max(0.0, -math.log10(control.tolerance) - 2.0))
        rows = steps
    else:
        dt = system.time_step(dt, control.rate)
        steps = _steps(control.rate, control.travel, dt)
        rows = min(steps, 2 * output.rows)
    n, j = len(assembly.names), len(assembly.joints)
    points = sum(len(p.area) for p in assembly.contact_points if p is not None)
    row_bytes = 8 * (6 + 7 * j + 2 * len(assembly.actuators.block))
    memory = 8 * (60 * n + 90 * j + 36 * n + 12 * points) + rows * row_bytes + min(rows, output.frames) * 56 * n
    return Plan(dt, critical, steps, memory)


class _LoadSystem:
    """The jacks of a scene as one load system: unit load, compliance of the joints against it, jack stiffness."""

    def __init__(self, assembly):
        if not len(assembly.actuators.block):
            raise ScenarioError("no [[actuators]]: a replay needs at least one jack to push with")
        self.assembly = assembly
        self.state = initial_state(assembly)
        self.stiffness = block_stiffness(self.state, shared=2.0)
        self.load = load_vectors(self.state)
        self.weight = float(np.abs(self.state.jacks.weight).sum())
        loaded = sorted(set(self.state.jacks.block.tolist()) & set(self.state.blocks.free.tolist()))
        if not len(loaded):
            raise ScenarioError("every actuator pushes a fixed block: nothing can move; let one push a free block")
        self.compliance = sum(float(self.load[b] @ np.linalg.solve(self.stiffness[b], self.load[b])) for b in loaded)
        if not self.compliance > 0.0:
            raise ScenarioError("the actuators cancel out: together they push and twist no block; check directions")
        self.jack_stiffness = JACK * self.weight / self.compliance
        # the jack as a bound on the stiffness of each loaded block
        self.jack = np.zeros_like(self.stiffness)
        for b in loaded:
            self.jack[b] = len(loaded) * self.jack_stiffness / self.weight * np.outer(self.load[b], self.load[b])

    def dashpots(self) -> Dashpots:
        """Those for physical inertia, with the critical time step that counts them and the jack."""
        return dashpots(self.state, block_inertia(self.assembly), self.jack)

    def dead_strength(self) -> float:
        """V (N) that friction 1 would resist under the dead loads at the joints of the loaded blocks, roughly."""
        joints, assembly = self.state.joints, self.assembly
        normal = np.abs(np.einsum("ji,ji->j", assembly.joint_force, joints.axes[:, 2]))
        at = np.isin(joints.block_a, self.state.jacks.block) | np.isin(joints.block_b, self.state.jacks.block)
        lever = max(float(np.linalg.norm(arm, axis=1).max()) for arm in (joints.arm_a, joints.arm_b))
        unit = np.linalg.norm(self.load[:, :3], axis=1).max() + np.linalg.norm(self.load[:, 3:], axis=1).max() / lever
        return float(normal[at].sum()) / float(unit)

    def time_step(self, most: float, rate: float) -> float:
        """``most`` (s), or less where the head would outrun what the joints give and make the blocks jump."""
        give = self.dead_strength() * self.compliance / self.weight
        return min(most, FINEST * give / rate) if give > 0.0 else most


class _Setup(_LoadSystem):
    """The load system on the seated state, with the certificate of its limit load."""

    def __init__(self, assembly, tolerance: float, session: Session | None = None, whole: bool = False):
        super().__init__(assembly)
        self.factor = elastic_factor(self.state) if whole or touches_itself(self.state) else None
        seated = seat(self.state, self.stiffness, self.factor, session)
        self.unbalanced, self.compile_seconds, self.loop_seconds = seated
        self.seated = self.state.blocks.displacement.copy()
        # the jacks come to blocks that the dead loads have moved already, and do not push them back
        moved = np.concatenate([self.state.blocks.displacement, self.state.blocks.rotation], axis=1)
        self.state.jacks.drive[:2] = float((self.load * moved).sum()) / self.weight
        self.certificate: Certificate = certificate(self.state, self.load, self.jack_stiffness / JACK, tolerance)

    def drive(self, rate: float, dt: float) -> Drive:
        """The load system driven at a steady ``rate`` in steps of ``dt``, with the dashpots of a search."""
        return Drive(
            rate=rate,
            ramp=RAMP * dt,
            steady=MOST_STEPS_AT_RATE,
            slowing=1.0,
            stiffness=self.jack_stiffness,
            dashpot=VISCOUS * self.jack_stiffness * dt,
            viscous_n=VISCOUS,
            viscous_s=VISCOUS,
            calming=0.0,
            memory=MEMORY,
        )

    def replay(self, converged: bool, loop: Loop, critical: float, compiled: float, settings: dict) -> Replay:
        """What came of it; ``compiled``: seconds of compiling after the seating."""
        return Replay(
            yield_point=read_off(loop.state, loop.certificate, self.assembly.names),
            state=loop.state,
            converged=converged,
            steps=loop.step,
            time_step=loop.dt,
            critical_time_step=critical,
            simulated_time=loop.step * loop.dt,
            unbalanced=self.unbalanced,
            compile_seconds=self.compile_seconds + compiled,
            loop_seconds=self.loop_seconds + loop.seconds,
            energy=loop.energy,
            settings=settings,
            moved=loop.state.blocks.displacement - self.seated,
        )

    @staticmethod
    def settings(drive: Drive) -> dict:
        """What the program chose, for the history."""
        return {
            "jack_stiffness": drive.stiffness,
            "jack_dashpot": drive.dashpot,
            "contact_dashpot_ratio": drive.viscous_s,
            "ramp": drive.ramp,
        }


def _steps(rate: float, travel: float, dt: float) -> int:
    """Steps of a constant-rate test."""
    wanted = travel / (rate * dt)
    if wanted > MOST_STEPS_AT_RATE:
        raise ScenarioError(
            f"control.rate = {rate:g} m/s over control.travel = {travel:g} m takes {wanted:.3g} steps of {dt:.3g} s: "
            "use a higher rate or a shorter travel"
        )
    return math.ceil(wanted)


def _rough_strength(state: State, certificate: Certificate, load: np.ndarray) -> float:
    """A scale for V (N), right to a factor of a few: what it takes to slide and twist the loaded blocks' joints."""
    loaded = set(state.jacks.block.tolist())
    capacity = 0.0
    for family in (state.points, state.areas):
        if family is None:
            continue
        for mu, j in zip(family.friction, family.joint, strict=True):
            if state.joints.block_a[j] in loaded or state.joints.block_b[j] in loaded:
                capacity += max(mu, 1e-3) * state.joints.resultant[j, 0]
    unit = certificate.unit
    if np.any(unit):
        return capacity / (float(np.hypot(unit[0], unit[1])) + abs(float(unit[2])) / certificate.radius)
    lever = max(float(np.linalg.norm(arm, axis=1).max()) for arm in (state.joints.arm_a, state.joints.arm_b))
    forces = np.linalg.norm(load[:, :3], axis=1).max() + np.linalg.norm(load[:, 3:], axis=1).max() / lever
    return capacity / float(forces)


def _to_finite_motion(state: State) -> None:
    """Turn the infinitesimal rotations of the seated state into orientations."""
    blocks = state.blocks
    for b in blocks.free:
        half = 0.5 * blocks.rotation[b]
        w, v = 1.0, half
        q = blocks.orientation[b].copy()
        blocks.orientation[b] = [
            w * q[0] - v @ q[1:],
            *(w * q[1:] + q[0] * v + np.cross(v, q[1:])),
        ]
        blocks.orientation[b] /= np.linalg.norm(blocks.orientation[b])
    blocks.rotation[:] = 0.0
