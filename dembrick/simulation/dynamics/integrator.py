"""Time integration of assemblies: true mass, contact damping with a stated restitution, no other damping.

A run has two parts. First the blocks are relaxed to rest under their dead loads (`dead_load`), in pseudo-time. Then
time starts: loads and moving supports (`driving`) act in chunks of compiled steps. Between two chunks joint polygons
are cut again if blocks have slid over an edge, and blocks that meet without a joint between them are found
(`contact_detection`).
"""

from __future__ import annotations

import math
import time
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from dembrick._jit import compute_fingerprint
from dembrick.errors import DivergedError, NotConvergedError
from dembrick.kernels.dynamics.contact_forces import CROWDED, DEEP, DEEPEST
from dembrick.kernels.dynamics.law_memory import MOVING, RESTED
from dembrick.kernels.dynamics.loop import (
    DIVERGED,
    MEETING,
    OVERLOADED,
    REACHED,
    RUNNING,
    Limits,
    advance_bodies,
    shares,
)
from dembrick.kernels.dynamics.rigid_bodies import Bodies
from dembrick.kernels.dynamics.tiles import rows_of_lanes
from dembrick.scenario.model import show
from dembrick.simulation.dynamics.chunks import advance_chunk, call_loop, compiled
from dembrick.simulation.dynamics.contact_detection import STABLE, ContactDetection
from dembrick.simulation.dynamics.energy import MotionEnergy
from dembrick.simulation.dynamics.joint_polygons import Polygons
from dembrick.simulation.dynamics.loads import Driving, LoadsAhead
from dembrick.simulation.dynamics.memory_order import without_rounding
from dembrick.simulation.dynamics.pace import LONGEST_CHUNK, Pace
from dembrick.simulation.dynamics.row_arrays import reactions
from dembrick.simulation.dynamics.state import MovingState, moving_state
from dembrick.simulation.dynamics.time_step import (
    contact_time_step,
    critical_time_step,
    pair_frequencies,
    stepped_dashpots,
    time_constants,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from dembrick.assembly.build import Assembly
    from dembrick.kernels.dynamics.contact_forces import Touching

Found = TypeVar("Found")
LONGEST_MOVE = 0.1  # of the smallest block's reach: a step that moves a block further has diverged
MOST_STEPS = 1e12  # of a run: a year for a single block
NO_LIMIT = 1e150  # m
IN_LANES = ("tiles", "seen_tiles", "wrenches", "points", "sheared", "dashpots", "ledger", "face")  # in tiles
SHORTEN = 0.7  # factor on the time step if blocks oscillate too fast for it,
SHORTER = 6  # applied so many times at the most
BETWEEN = ("dead_load", "contact_search", "geometry", "record", "driving")  # phases of a run other than its steps


class StepTooLong(DivergedError):
    """A block oscillates on its contacts faster than the time step can follow."""


class PressedTooDeep(NotConvergedError):
    """Blocks overlap too deeply for a contact to be meaningful."""


@dataclass
class Motion:
    """An assembly in motion or relaxation, with its state, time step (s) and computing times (s).

    ``settled``: it starts from the equilibrium that a stage left, including its new contacts. ``loop_seconds`` went
    into compiled steps, ``phases`` into the work between them. ``falling`` (n,): blocks without an equilibrium under
    the dead loads; ``attempt`` (2,): of the search for it, the step at which the present attempt began, and the number
    of steps until the first block was seen to fall (-1: none yet). ``upright`` (n, 4): orientations at the start of the
    stage, from which rotations are measured.
    """

    assembly: Assembly
    polygons: Polygons
    time_step: float
    critical_time_step: float
    damping: float
    compile_seconds: float = 0.0
    loop_seconds: float = 0.0
    phases: dict[str, float] = field(default_factory=lambda: dict.fromkeys(BETWEEN, 0.0))
    steps: int = 0
    dead_load_steps: int = 0
    settled: bool = False
    laws: int = MOVING  # mode in which joint laws keep their history: `kernels.dynamics.law_memory`
    contact_detection: ContactDetection = field(init=False)
    energy: MotionEnergy = field(init=False)
    falling: np.ndarray = field(init=False)
    upright: np.ndarray = field(init=False)
    attempt: np.ndarray = field(default_factory=lambda: np.array([0.0, -1.0]))
    travel: np.ndarray = field(default_factory=lambda: np.zeros(2))  # m, see `Course`
    pace: Pace = field(default_factory=Pace)
    forms: dict = field(default_factory=dict)
    _typed: tuple = ()
    _types: object = None
    shares: dict = field(default_factory=dict)  # see `loops_for`
    ahead: LoadsAhead = field(default_factory=LoadsAhead)
    _ahead: tuple = (None,) * 7  # buffers of `present_velocities`, reused as every frame needs them

    def __post_init__(self):
        self.contact_detection = ContactDetection(self.assembly, self.damping)
        self.energy = MotionEnergy(self.state)
        self.falling = np.zeros(len(self.assembly.names), bool)
        self.upright = np.array(self.assembly.orientation, float)

    @property
    def state(self) -> MovingState:
        """Blocks and joints now."""
        return self.polygons.state

    @state.setter
    def state(self, state: MovingState) -> None:
        self.polygons.state = state

    @cached_property
    def no_contacts(self) -> Touching:
        """Empty contact arrays, passed to the loop while there are no new contacts."""
        return self.contact_detection.blank(self.polygons)

    def types_of(self, *arguments) -> object:
        """Fingerprint of the argument types, cached for the last arguments, as arrays keep their types."""
        if len(arguments) != len(self._typed) or any(a is not b for a, b in zip(arguments, self._typed, strict=True)):
            self._typed, self._types = arguments, compute_fingerprint(arguments)
        return self._types

    @property
    def time(self) -> float:
        """Seconds since the dead-load equilibrium."""
        return self.steps * self.time_step

    @property
    def seconds(self) -> float:
        """All computing time measured so far (s)."""
        return self.loop_seconds + self.compile_seconds + sum(self.phases.values())

    @property
    def smallest(self) -> float:
        """Shortest edge of the bounding boxes of all blocks (m)."""
        return float(self.assembly.least_size.min())

    @property
    def displacement(self) -> np.ndarray:
        """Displacement of every centroid since the dead-load equilibrium (n, 3), in the frame of the supports (m)."""
        return self.state.bodies.position - self.state.bodies.start

    @property
    def reactions(self) -> np.ndarray:
        """Reactions of the supports (s, 6), see `write_reactions`."""
        return reactions(self)


def motion(
    assembly: Assembly, damping: float, step_factor: float, impacts: float = 1.0, duration: float | None = None
) -> Motion:
    """An assembly at rest whose contacts have the ``damping`` ratio; ``step_factor``: time step over the critical one.

    ``impacts`` divides the time step that the joints allow, if impacts are expected. The step is never longer than new
    contacts on any face of the blocks allow, and divides a ``duration`` (s) into a whole number of steps.
    """
    state = moving_state(assembly)
    frequency, of_faces = pair_frequencies(state), contact_time_step(assembly, damping)
    of_joints = critical_time_step(state, time_constants(frequency, damping))
    critical = min(of_joints, impacts * of_faces) if math.isfinite(of_joints) else of_faces
    dt = step_factor / impacts * critical
    if duration is not None and duration < MOST_STEPS * dt:
        dt = duration / math.ceil(duration / dt * (1.0 - 1e-12))
    state.links.put("viscous", without_rounding(stepped_dashpots(frequency * dt, damping)))
    state.links.share()
    moving = Motion(assembly, Polygons(assembly, state), dt, critical, damping)
    moving.contact_detection.bearable -= STABLE * dt / of_joints  # at most: springs alone take its square
    return moving


@contextmanager
def driving_time(motion: Motion) -> Iterator[None]:
    """Context whose computing time, unless booked elsewhere, counts for the phase ``driving``."""
    began, before = time.perf_counter(), motion.seconds
    yield
    motion.phases["driving"] += time.perf_counter() - began - (motion.seconds - before)


def in_shorter_steps(motion: Motion, attempt: Callable[[], Found], go_back: Callable[[], None]) -> Found:
    """Result of an ``attempt``. If blocks oscillate too fast, as new contacts add to the stiffness of their joints, go
    back and repeat it with a shorter time step. Raises StepTooLong if no step is short enough."""
    for _ in range(SHORTER):
        try:
            return attempt()
        except StepTooLong:
            motion.time_step *= SHORTEN
            detection = motion.contact_detection
            detection.bearable = STABLE - SHORTEN * (STABLE - detection.bearable)  # joints use less of a shorter step
            go_back()
    return attempt()


def advance(
    motion: Motion, driving: Driving, n_steps: int, limits: Limits, damping: float = 0.0, step: float = 1.0
) -> int:
    """Advance by up to ``n_steps``; returns REACHED once a centroid has moved as far as ``limits`` says, else RUNNING.

    ``damping``: local damping of quasi-static phases; ``step``: their step over the time step of the run.
    Raises DivergedError, and NotConvergedError if blocks press too deep into each other.
    """
    with driving_time(motion):
        return _advance(motion, driving, n_steps, limits, damping, step)


def _advance(motion: Motion, driving: Driving, n_steps: int, limits: Limits, damping: float, step: float) -> int:
    """`advance` without the timing."""
    last = motion.steps + n_steps
    detection, dt = motion.contact_detection, step * motion.time_step
    detect_initial_contacts(motion)
    while motion.steps < last:
        most = min(LONGEST_CHUNK, last - motion.steps)
        loads = motion.ahead.of(driving, motion.steps, most, dt) if driving.is_slight(most) else None
        most = most if loads is None else min(most, len(loads.gravity))
        times = (motion.steps + np.arange(most)) * dt
        supports = driving.prescribed(times, dt) if loads is None else None
        gravity = driving.forces(times[[0, -1]], dt)[0] if loads is None else loads.gravity[[0, most - 1]]
        moved = (supports or loads).moved[:most]
        fastest = float(np.sqrt(moved.max(initial=0.0))) / dt
        # relaxing blocks are rarely as fast as gravity could make them: there the loop tracks how far they move
        room, n = detection.room if damping > 0.0 else math.inf, most
        if room == math.inf:
            n = int(min(most, detection.steps_to_go(motion.state, float(np.abs(gravity).max()), dt, fastest)))
        status, done = advance_chunk(
            motion, motion.state.bodies, driving, times[:n], limits, damping, dt, detection.touching, supports, loads,
            room,
        )  # fmt: skip
        if after_chunk(motion, status, done, dt) == REACHED:
            return REACHED
    return RUNNING


def detect_initial_contacts(motion: Motion) -> None:
    """Look for new contacts before the first step: blocks may be thrown into each other."""
    if motion.contact_detection.looked is None:
        _follow(motion, called=True)


def after_chunk(motion: Motion, status: int, done: int, dt: float) -> int:
    """Count the steps ``done`` and handle the ``status`` of a chunk; returns REACHED or RUNNING.

    Raises DivergedError and NotConvergedError.
    """
    motion.steps += done
    if status == DIVERGED:
        worst = motion.assembly.names[int(np.argmax(np.abs(motion.state.bodies.velocity).max(axis=1)))]
        raise DivergedError(
            f"the motion diverged at t = {motion.time:.6g} s (block {show(worst)} moves by more than "
            f"{LONGEST_MOVE:g} of a block in a step of {dt:.3g} s): lower solver.step_factor"
        )
    if status in (DEEP, CROWDED):
        raise (PressedTooDeep if status == DEEP else NotConvergedError)(_trouble(motion, status))
    if status == OVERLOADED:
        _examine(motion)
    _follow(motion, called=status == MEETING and motion.contact_detection.touching is not None)
    return REACHED if status == REACHED else RUNNING


def _follow(motion: Motion, called: bool) -> None:
    """Look for new contacts if that is due, or if the loop has ``called`` for it."""
    began = time.perf_counter()
    motion.contact_detection.follow(motion.state, motion.polygons, called, motion.travel[1:])
    motion.phases["contact_search"] += time.perf_counter() - began


def _examine(motion: Motion) -> None:
    """Raise StepTooLong if a block oscillates on its contacts faster than the time step can follow."""
    began, detection = time.perf_counter(), motion.contact_detection
    block = detection.examine(motion.state, motion.time_step)
    motion.phases["contact_search"] += time.perf_counter() - began
    if block is not None:
        raise StepTooLong(
            f"at t = {motion.time:.6g} s block {show(motion.assembly.names[block])} oscillates on its contacts "
            f"faster than steps of {motion.time_step:.3g} s can follow, which would create energy: lower "
            "solver.step_factor"
        )


def _trouble(motion: Motion, status: int) -> str:
    """Message about the contact that ended the run."""
    touching = motion.contact_detection.touching
    pair = int(touching.trouble[0])
    blocks = touching.parts.owner[[touching.first[pair], touching.second[pair]]]
    first, second = (show(motion.assembly.names[i]) for i in blocks)
    where = f"at t = {motion.time:.6g} s blocks {first} and {second}"
    if status == CROWDED:
        return f"{where} have more faces than a contact can store; describe them by simpler shapes"
    return (
        f"{where} overlap by more than {2.0 * DEEPEST:g} of the thinner one's inner radius, too much for a contact "
        "to be meaningful; raise normal_stiffness of the joints, or lower the speed of impact"
    )


def rest_in_each_other(motion: Motion) -> str:
    """Message about blocks that dead loads have pressed into each other before new contacts were detected."""
    first, second = (show(motion.assembly.names[i]) for i in motion.contact_detection.met[0])
    return (
        f"under the dead loads blocks {first} and {second}, which are drawn apart, overlap at equilibrium: put a "
        'stage of kind = "statics" with large_displacements = true before the run, to press them together first'
    )


def joint_forces(motion: Motion, driving: Driving) -> None:
    """Evaluate the forces of joints and new contacts at the present positions, without moving any block."""
    held = motion.state.bodies._replace(free=np.zeros(0, np.uint32))
    touching = motion.contact_detection.touching
    advance_chunk(motion, held, driving, np.zeros(1), Limits(1.0, 1.0), 0.0, motion.time_step, touching)


def stop(bodies: Bodies) -> None:
    """Set the velocities of blocks at an equilibrium to zero. Local damping acts by the sense of a motion, however
    slow, so the next swing would depend on rounding."""
    bodies.velocity[:], bodies.momentum[:], bodies.spin[:] = 0.0, 0.0, 0.0


def update_history_at_rest(motion: Motion, driving: Driving) -> None:
    """Update the history of the joint laws to the equilibrium reached; it was frozen while blocks swung."""
    laws, motion.laws = motion.laws, RESTED
    joint_forces(motion, driving)
    motion.laws = laws


def present_velocities(motion: Motion, driving: Driving) -> tuple[np.ndarray, np.ndarray]:
    """Velocities (n, 3) and spins (n, 3; rad/s, world) of the blocks at the instant of their positions: the mean of
    those half a step before and half a step after, which a copy of the state is advanced to find."""
    motion.energy.fit(driving.n_load, len(driving.supports))
    state, touching, shared = motion.state, motion.contact_detection.touching, {}
    if touching is not None:
        shared = {name: getattr(touching, name) for name in ("parts", "scratch", "pressed")}
        touching = touching._replace(**dict.fromkeys(shared))
    parts = (*state[:5], motion.energy.table, touching)
    motion._ahead = tuple(_copied(part, into) for part, into in zip(parts, motion._ahead, strict=True))
    bodies, links, corners, faces, ties, table, touching = motion._ahead
    if touching is not None:
        touching = touching._replace(**shared)
        touching.room[:], touching.overloaded[:] = np.inf, 0
    loads = driving.loads(np.array([motion.time]), motion.time_step)
    limits = Limits(NO_LIMIT, NO_LIMIT)
    ahead = state._replace(bodies=bodies, links=links, corners=corners, faces=faces, ties=ties)
    own = shares(corners, faces, bodies, 1)
    dt, fixed = motion.time_step, (limits, 0.0, np.array([np.inf, 0.0]), touching, table)
    form = compiled(motion, advance_bodies, own, dt, ahead, bodies, loads, *fixed)
    call_loop(motion, form, 1, dt, ahead, bodies, loads, *fixed, own)
    now = state.bodies
    velocity, momentum = 0.5 * (now.velocity + bodies.velocity), 0.5 * (now.momentum + bodies.momentum)
    in_body = np.einsum("nji,nj->ni", now.rotation, momentum)
    spin = np.einsum("nij,njk,nk->ni", now.rotation, now.inverse, in_body)
    velocity[now.guided] *= ~now.held[:, :3]
    spin[now.guided] *= ~now.held[:, 3:]
    return velocity, spin


def _copied(part, into=None):
    """Deep copy of a named tuple of arrays with the same cache-line alignment; None stays None. Arrays of an earlier
    copy, ``into``, are overwritten if they fit."""
    if part is None:
        return None
    copies = []
    for name, array, old in zip(part._fields, part, into or (None,) * len(part), strict=True):
        if isinstance(array, tuple):
            copies.append(_copied(array, old))
            continue
        if array is not None and (old is None or old.shape != array.shape):
            old = rows_of_lanes(len(array), array.dtype) if name in IN_LANES else np.empty_like(array)
        if array is not None:
            old[...] = array
        copies.append(old if array is not None else None)
    return part._make(copies)
