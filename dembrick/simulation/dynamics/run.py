"""Runs of assemblies in real time: tilts, pushes, shaken supports, free motion."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from dembrick.errors import DivergedError, NotConvergedError, ScenarioError
from dembrick.geometry.rotations import rotation_matrix, turned_by
from dembrick.kernels.dynamics.loop import REACHED, Limits
from dembrick.scenario.checks import present, show
from dembrick.scenario.controls import PushoverControl
from dembrick.scenario.model import Output
from dembrick.scenario.regimes import COLLAPSE, COMPLETED, NOTHING, REAL_TIME, STEEPEST, SUPPORTS, Limit
from dembrick.simulation import interrupts
from dembrick.simulation.channels import bytes_of, recorded
from dembrick.simulation.dynamics import joint_families
from dembrick.simulation.dynamics.checkpoint import RunHistory
from dembrick.simulation.dynamics.dead_load import LOCAL_DAMPING, find_equilibrium, unsupported
from dembrick.simulation.dynamics.energy import MotionEnergy
from dembrick.simulation.dynamics.integrator import (
    MOST_STEPS,
    NO_LIMIT,
    Motion,
    advance,
    detect_initial_contacts,
    joint_forces,
    motion,
    rest_in_each_other,
)
from dembrick.simulation.dynamics.loads import Driving
from dembrick.simulation.dynamics.outcome import CARRIED, collapse_of, collapse_of_settlement, fallen, speed_at_the_end
from dembrick.simulation.dynamics.pushover import STRONGEST, PushController, controller_of
from dembrick.simulation.dynamics.recorder import Recorder
from dembrick.simulation.dynamics.state import out_of_balance, seen, with_contact_forces
from dembrick.simulation.dynamics.support_motion import AT_REST
from dembrick.simulation.dynamics.time_step import damping_of_restitution
from dembrick.simulation.energy_audit import Sums
from dembrick.simulation.expected_cost import fall_seconds, heap_seconds, motion_seconds, row_seconds
from dembrick.simulation.session import Kept, Plan, Session

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.scenario.controls import Control

CONTACT_DAMPING = 0.05  # of critical, on a path of equilibria whose control sets none
IMPACTS = 3.0  # divides the step if blocks may bounce, so that the stated restitution is met within 1 to 3 %
AT_ONCE = 2_000_000  # (blocks + joints) x steps of a chunk: signals wait some tenths of a second
AFTER = 1.0, 10.0  # times sqrt(extent / g): how long a run goes on after the supports have arrived, and how long at the
# most, until a block has fallen
FREELY = 1.2  # times the squared speed of a free fall: a fallen block that is no faster is falling freely
G = 9.81  # m/s2, where there is no gravity
MEETINGS = 6  # new contacts per block in a frame, at the most: two share one, and twelve equal blocks fit around one


@dataclass
class MotionRun:
    """A finished run: its final state, status, settings that the program chose, and computing times (s).

    Greatest values over the rows: ``furthest`` (n,) m, displacement of every centroid; ``peak_tension`` (t,) N, tension
    of every tie; ``turned`` (n,) rad, rotation of every block. ``fallen`` (n,): which blocks have fallen; ``speed``
    (m/s): see `speed_at_the_end`.
    """

    motion: Motion
    status: str
    collapse: dict | None
    unbalanced: float
    furthest: np.ndarray
    peak_tension: np.ndarray
    turned: np.ndarray
    fallen: np.ndarray
    speed: float = 0.0
    settings: dict = field(default_factory=dict)
    energy: Sums | None = None

    @property
    def reactions(self) -> np.ndarray:
        """Reactions of the supports (s, 6) at the end, see `write_reactions`."""
        return self.motion.reactions

    @property
    def ties(self) -> dict[str, np.ndarray]:
        """Tension (t,) N of the ties at the end, their permanent elongation (t,) m, and ``peak_tension``."""
        now = self.motion.state.ties.now
        return {"tension": now["tension"], "yielded": now["yielded"], "peak": self.peak_tension}

    @property
    def pose(self) -> tuple[np.ndarray, np.ndarray]:
        """Displacement (n, 3) m of every centroid from the start, and rotation (n, 3, 3) from body axes, at the end."""
        state = self.motion.state
        return state.bodies.position + state.middle - self.motion.assembly.position, state.bodies.rotation

    @property
    def compile_seconds(self) -> float:
        """Time spent on compiling or loading the loop (s)."""
        return self.motion.compile_seconds

    @property
    def loop_seconds(self) -> float:
        """Time spent in the loop, including the dead-load equilibrium (s)."""
        return sum(self.phases.values())

    @property
    def phases(self) -> dict[str, float]:
        """`loop_seconds` by phase; the compiled steps are one."""
        return {"steps": self.motion.loop_seconds, **self.motion.phases}


@dataclass
class EquilibriaRun(MotionRun):
    """A finished path of equilibria. ``path`` (T, 3): displacement (m), load and out-of-balance over joint forces of
    every equilibrium; ``reaction`` (s, 6): of all supports at the last one, and ``state``: the full state there, for a
    stage that follows. ``bracket``: the parameter at the last equilibrium, and at collapse (infinite: no collapse)."""

    path: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    reaction: np.ndarray = field(default_factory=lambda: np.zeros((0, 6)))
    state: Kept | None = None
    bracket: tuple[float, float] = (0.0, math.inf)

    @classmethod
    def of(cls, past: RunHistory, path: np.ndarray, collapse: dict | None, **last) -> EquilibriaRun:
        """Result of a ``path``; ``last``: fields of its last equilibrium."""
        moving, noted = past.moving, past.extremes.noted
        return cls(
            motion=moving,
            status=COMPLETED if collapse is None else COLLAPSE,
            collapse=collapse,
            unbalanced=float(path[:, 2].max()),
            furthest=noted.furthest,
            peak_tension=noted.tension,
            turned=past.extremes.turn,
            fallen=np.isin(moving.assembly.names, [] if collapse is None else collapse["blocks"]),
            settings={
                "contact_damping": moving.damping,
                "local_damping": LOCAL_DAMPING,
                "dead_load_steps": moving.dead_load_steps,
                "equilibria": len(path),
            },
            path=path,
            **last,
        )

    @property
    def reactions(self) -> np.ndarray:
        """Reactions of the supports (s, 6) at the last equilibrium."""
        return self.reaction


def prepare(assembly: Assembly, control: Control, step_factor: float) -> Motion:
    """The assembly as drawn, with the contact damping of the control; ScenarioError if nothing can move."""
    if control.needs_supports and not np.any(assembly.fixed):
        raise ScenarioError(f"control kind {show(control.kind)} moves supports and no block is fixed: fix one")
    if not len(assembly.fixed) - np.sum(assembly.fixed):
        raise ScenarioError("every block is fixed, so nothing can move; free one")
    may = control.in_deformed_geometry and control.drives != SUPPORTS
    if len(assembly.actuators.at) and not may:
        remedy = "remove them and actuator = true of [[pressures]]"
        raise ScenarioError(f"control kind {show(control.kind)} has no use for [[actuators]]; {remedy}")
    if control.restitution is None:
        impacts = IMPACTS if control.regime is REAL_TIME and control.drives == SUPPORTS else 1.0
        damping = CONTACT_DAMPING if control.damping is None else control.damping
        return motion(assembly, damping, step_factor, impacts)
    damping = damping_of_restitution(control.restitution)
    return motion(assembly, damping, step_factor, IMPACTS, duration=control.duration)


def ask_for(moving: Motion, output: Output, driving: Driving) -> None:
    """Set up what the loop must record for ``output`` under the loads and supports ``driving``."""
    supports = len(driving.supports)
    moving.energy = MotionEnergy(moving.state, driving.n_load, "energy" in output.channels, supports)
    moving.contact_detection.let_move(driving.supports.block)
    if "contacts" in output.channels:
        moving.state = with_contact_forces(moving.state)


def plan(moving: Motion, control: Control, driving: Driving, output: Output, load_factor: float | None = None) -> Plan:
    """Plan with the steps and bytes of the run: of its whole duration, or until a collapse at the ``load_factor``;
    without one, of a tilt to the vertical or of the longest push. The bytes are an upper bound."""
    controller = _controller(moving, control)
    most = steps = most_steps(moving, control, controller, driving)
    falls = control.ends_with == COLLAPSE
    if falls and load_factor is not None:
        steps = min(most, math.ceil(_seconds_to_collapse(moving, control, load_factor) / moving.time_step))
    rows = min(steps, 2 * output.rows)
    frames = min(rows, 2 * output.frames)
    fields = recorded(moving.assembly, output.channels, control)
    copies = 2 if "velocity" in output.channels else 1  # see `present_velocities`
    memory = copies * sum(array.nbytes for array in moving.state.arrays)
    memory += bytes_of(fields, rows, frames, frames * MEETINGS * len(moving.assembly.names))
    points, strengths = joint_families.contact_points(moving.state), joint_families.has_strengths(moving.state)
    seconds = motion_seconds(steps, len(moving.assembly.joints), points, strengths) + row_seconds(rows)
    at_most = falls and load_factor is None
    free = int((~np.asarray(moving.assembly.fixed)).sum())
    falling = None if falls else max(seconds, heap_seconds(steps, free))
    return Plan(moving.time_step, moving.critical_time_step, steps, memory, seconds, not falls, at_most, falling)


def _seconds_to_collapse(moving: Motion, control: Control, load_factor: float) -> float:
    """Time (s) until a tilt or a push at its rate has collapsed a structure whose limit is the ``load_factor``."""
    end, rate = present(control.furthest), present(control.rate)
    if control.push_direction is not None:
        return (1.0 + load_factor) * end / rate
    gravity = float(np.linalg.norm(moving.assembly.gravity))
    return present(control.angle(load_factor)) / rate + fall_seconds(end, rate, gravity)


def _controller(moving: Motion, control: Control) -> PushController | None:
    if not isinstance(control, PushoverControl):
        return None
    return controller_of(control, moving.assembly, moving.assembly.gravity, moving.time_step)


def most_steps(moving: Motion, control: Control, controller: PushController | None, driving: Driving) -> int:
    """Number of steps after which the run ends at the latest."""
    if controller is not None:
        return controller.longest
    limit = control.limit
    if limit is None:
        seconds = _arrival(driving, control) + AFTER[1] * _falling_time(moving)
        limit = Limit(seconds, "rate", "let the supports move faster")
    seconds, key, remedy = limit
    if not seconds < MOST_STEPS * moving.time_step:
        raise ScenarioError(
            f"control.{key} = {getattr(control, key):g} would take {seconds / moving.time_step:.3g} steps of "
            f"{moving.time_step:.3g} s, but at most {MOST_STEPS:g} are allowed; {remedy}"
        )
    return math.ceil(seconds / moving.time_step * (1.0 - 1e-12))


def _arrival(driving: Driving, control: Control) -> float:
    """Time at which the supports of a settlement reach their final positions (s)."""
    return driving.supports.length / present(control.rate)


def _fall_on(moving: Motion, limits: Limits, session: Session) -> bool:
    """Whether all blocks that are too fast for the step fall freely, so that the run may end; reports it if so."""
    bodies, weight = moving.state.bodies, float(np.linalg.norm(moving.assembly.gravity))
    speed = np.linalg.norm(bodies.velocity, axis=1) + np.linalg.norm(bodies.spin, axis=1) * bodies.reach
    fast = math.sqrt(2.0) * speed * moving.time_step > limits.longest
    drop = moving.displacement @ moving.assembly.gravity / max(weight, 1e-300)
    falls = fallen(moving) & (speed**2 <= FREELY * 2.0 * weight * drop)
    if not fast.any() or not falls[fast].all():
        return False
    if session.report is not None:
        name = moving.assembly.names[int(np.argmax(speed))]
        fall = f"block {show(name)} has fallen by {drop.max():.3g} m and has nothing below it"
        session.report(f"the run ends at t = {moving.time:.4g} s: {fall}; enlarge the floor to catch it")
    return True


def _falling_time(moving: Motion) -> float:
    """sqrt(extent / g) (s) of the scene: the time scale in which unbalanced blocks topple."""
    assembly = moving.assembly  # as drawn, so that a restarted run ends when an uninterrupted one would
    extent = float(np.ptp(assembly.position, axis=0).max() + moving.state.bodies.reach.max())
    return math.sqrt(extent / falls_by(moving))


def falls_by(moving: Motion) -> float:
    """Acceleration (m/s2) of what falls: that of gravity, or `G`."""
    return float(np.linalg.norm(moving.assembly.gravity)) or G


def run(moving: Motion, control: Control, driving: Driving, session: Session) -> MotionRun:
    """Find the dead-load equilibrium and integrate the run; the session's observer gets rows and frames.

    Raises NotConvergedError if there is no dead-load equilibrium, if a tilt or a push causes no collapse, and
    if blocks are pressed too deep into each other; DivergedError.
    """
    to_collapse = control.ends_with == COLLAPSE
    controller = _controller(moving, control)
    past = RunHistory(moving, controller)
    if len(driving.supports):
        past.extremes.noted.threshold[:] *= CARRIED
    start(moving, control, driving, past, session)
    detect_initial_contacts(moving)
    if moving.contact_detection.met:
        raise NotConvergedError(rest_in_each_other(moving))
    goal = present(control.furthest) if to_collapse else NO_LIMIT
    steps = past.longest = most_steps(moving, control, controller, driving)
    settled = math.inf if control.limit or controller else _arrival(driving, control) + AFTER[0] * _falling_time(moving)
    past.may_end_early = to_collapse or settled < math.inf
    # enough rows even if the run ends early: a block falls within a second or so
    usual = 20.0 if to_collapse else max(settled, 0.5 * steps * moving.time_step)
    rows = max(1, steps if usual == math.inf else min(steps, math.ceil(usual / moving.time_step)))
    every = max(1, rows // session.output.rows)
    # neither a row nor a checkpoint falls between two updates of V by the controller
    held = 1 if controller is None else controller.steps
    every = held * max(1, round(every / held))
    # chosen by the size of the scene and not by the clock, so that interrupted runs give the same results
    stride = held * max(1, AT_ONCE // (len(moving.assembly.names) + len(moving.assembly.joints)) // held)
    frames_every = max(1, session.output.rows // session.output.frames)
    limits = Limits(displacement=goal, longest=0.1 * float(moving.state.bodies.reach.min()))
    recorder = Recorder(moving, driving, session, past.extremes, every, frames_every, controller)
    recorder.compile()
    past.pass_on = recorder.pass_on
    if not moving.steps:
        recorder.take()
    status = None
    with interrupts.deferred(), recorder.gathering():
        over = moving.steps >= steps
        while not over:
            n = min(stride, every - moving.steps % every, steps - moving.steps)
            rows = recorder.rows_ahead(stride, steps)
            try:
                if controller is not None:
                    status = _push(moving, controller, driving, n, limits)
                elif rows:
                    status = recorder.pass_rows(rows, limits)
                else:
                    status = advance(moving, driving, n, limits)
                over = status == REACHED or moving.steps >= steps
            except DivergedError:
                over = not to_collapse and _fall_on(moving, limits, session)
                if not over:
                    raise
            over = over or (moving.time >= settled and recorder.is_at_row and bool(fallen(moving).any()))
            if over or recorder.is_at_row:
                row = partial(recorder.take, last=over)
                past.extremes.look(moving, row) if settled < math.inf else row()
            if over:
                session.ended(past)
            else:
                session.pause(past)
    if to_collapse and status != REACHED:
        least = (
            f"the table stood at {STEEPEST:g} deg" if controller is None else f"the load factor came near {STRONGEST:g}"
        )
        raise NotConvergedError(f"no block moved by {goal:.6g} m before {least}; ask for a smaller displacement")
    settings = {"contact_damping": moving.damping, "dead_load_steps": moving.dead_load_steps, "inertia": "physical"}
    collapse = None
    if to_collapse:
        collapse = collapse_of(moving, control, controller, past.at_rest, past.extremes)
    elif len(driving.supports) and fallen(moving).any():
        collapse = collapse_of_settlement(moving, driving, past.at_rest, past.extremes)
    return MotionRun(
        motion=moving,
        status=COMPLETED if collapse is None else COLLAPSE,
        collapse=collapse,
        unbalanced=float(past.unbalanced[0]),
        furthest=past.extremes.noted.furthest,
        peak_tension=past.extremes.noted.tension,
        turned=past.extremes.turn,
        fallen=fallen(moving),
        speed=speed_at_the_end(moving),
        settings=settings,
        energy=moving.energy.sums(moving.state, rounding(moving)),
    )


def start(moving: Motion, control: Control, driving: Driving, past: RunHistory, session: Session) -> None:
    """Bring the blocks to rest under the dead loads and set their velocities, or restart from a checkpoint.

    Raises NotConvergedError if there is no equilibrium and the control needs one.
    """
    free = control.drives == NOTHING
    held = replace(driving, support_velocity=(), supports=AT_REST)
    resume = partial(past.restore, session.resumed, session.goes_on) if session.resumed else None
    if resume is not None and past.has_begun(session.resumed):
        resume()
    else:
        past.unbalanced[0] = find_equilibrium(moving, held, free, resume, partial(session.pause, past))
        moving.phases["dead_load"], moving.loop_seconds = moving.loop_seconds, 0.0
        past.at_rest[:] = seen(moving.state.bodies, moving.state.links)
        if free or moving.settled or (unsupported(moving.state) & ~np.asarray(moving.assembly.fixed)).any():
            _set_going(moving, driving if free else held, thrown=free)
        else:
            still = np.zeros_like(moving.state.bodies.velocity)
            share = moving.contact_detection.left_to_joints()
            moving.energy.begin(moving.state, still, still, _turned_inertia(moving), still[0], 0.0, share)
        moving.energy.open(moving.state)


def rounding(moving: Motion) -> float:
    """Upper bound of the energy (J) that rounding of positions can create over all steps."""
    state, assembly = moving.state, moving.assembly
    weight = np.linalg.norm(assembly.gravity) * np.asarray(assembly.mass)[state.bodies.free].sum()
    extent = float((np.abs(state.bodies.position).max(axis=1) + state.bodies.reach).max())
    return float(np.finfo(float).eps * max(1, moving.steps) * weight * extent)


def _push(moving: Motion, controller: PushController, driving: Driving, n_steps: int, limits: Limits) -> int:
    """`advance` with the controller, which updates V from the motion of the blocks every ``controller.steps``."""
    last, status = moving.steps + n_steps, None
    while moving.steps < last and status != REACHED:
        controller.press(moving.steps, moving.displacement, moving.state.bodies.velocity)
        status = advance(moving, controller.pushing(driving), min(controller.steps, last - moving.steps), limits)
    return status


def _set_going(moving: Motion, driving: Driving, thrown: bool) -> None:
    """Set the initial velocities of the blocks (zero unless ``thrown``), shifted back by half a step with the forces of
    time zero, as the leapfrog scheme needs them.

    Joints first take the positions of one step ago as their last, so that friction acts on sliding joints from the
    start. Blocks that did not touch then and do now hit each other: that is an impact like any other.
    """
    assembly, state, dt = moving.assembly, moving.state, moving.time_step
    bodies, free = state.bodies, state.bodies.free
    velocity, spin = np.zeros_like(bodies.velocity), np.zeros_like(bodies.spin)
    if thrown:
        velocity[free], spin[free] = assembly.velocity[free], assembly.angular_velocity[free]
    before = bodies._replace(
        position=bodies.position - dt * velocity,
        rotation=rotation_matrix(turned_by(-dt * spin, bodies.orientation)),
    )
    came_from = seen(before, state.links)
    moving.contact_detection.strike(moving.polygons, _hit(moving, came_from))
    memory = joint_families.memory(state)
    kept = [array.copy() for array in memory]
    state.links.put_seen(came_from)
    joint_forces(moving, driving)
    gravity, _ = driving.forces(np.zeros(1), dt)
    inertia = _turned_inertia(moving)
    moving.energy.begin(state, velocity, spin, inertia, gravity[0], dt, moving.contact_detection.left_to_joints())
    for array, value in zip(memory, kept, strict=True):  # the first step evaluates the joints again
        array[...] = value
    state.links.put_seen(came_from)
    force, torque = out_of_balance(state, gravity[0])
    force[bodies.guided] *= ~bodies.held[:, :3]
    torque[bodies.guided] *= ~bodies.held[:, 3:]
    momentum = np.einsum("nij,nj->ni", inertia, spin)
    bodies.velocity[free] = velocity[free] - 0.5 * dt * force[free] / bodies.mass[free, None]
    bodies.momentum[free] = momentum[free] - 0.5 * dt * torque[free]
    bodies.spin[free] = spin[free]


def _hit(moving: Motion, came_from: np.ndarray) -> np.ndarray:
    """Which joints (j,) are closed now and were wholly open a step ago, when `seen` was ``came_from`` (j, 9)."""
    links, hit = moving.state.links, np.zeros(len(came_from), bool)
    now, sense, offset = links.seen, links.sense[:, None], links.offset[:, None]
    for numbers, outlines in moving.polygons.outlines():
        x, y = outlines[..., 0], outlines[..., 1]
        gap, before = (
            sense[numbers] * (s[numbers, 2, None] - offset[numbers] + x * s[numbers, 5, None] + y * s[numbers, 8, None])
            for s in (now, came_from)
        )
        closed = gap <= 0.0
        hit[numbers] = closed.any(axis=1) & (~closed | (before > 0.0)).all(axis=1)
    return hit


def _turned_inertia(moving: Motion) -> np.ndarray:
    """Current inertia (n, 3, 3) of the blocks about their centroids, in world axes."""
    turn = moving.state.bodies.rotation
    return turn @ moving.assembly.inertia @ np.swapaxes(turn, 1, 2)
