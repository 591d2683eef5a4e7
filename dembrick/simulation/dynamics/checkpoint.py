"""State from which a run in real time starts: a checkpoint of its own, or the final state of a previous stage.

It consists of positions, the history of joints, and ties, which may be kept, added or removed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

import numpy as np

from dembrick.errors import DembrickError, HistoryError, ScenarioError
from dembrick.geometry.rotations import rotation_matrix, turned_by, unit_quaternion
from dembrick.kernels.joint.ties import TIE
from dembrick.scenario.stages import TiesBefore
from dembrick.simulation.checkpoint_arrays import flattened, plain, restored
from dembrick.simulation.dynamics import joint_families
from dembrick.simulation.dynamics.dead_load import keep, put_back
from dembrick.simulation.dynamics.integrator import Motion, detect_initial_contacts, stop
from dembrick.simulation.dynamics.outcome import PEAK_TENSIONS, Extremes
from dembrick.simulation.dynamics.pushover import PushController
from dembrick.simulation.dynamics.state import seen
from dembrick.simulation.session import (
    DEAD_LOADS,
    OTHER_JOINTS,
    Kept,
    Progress,
    RestartChanges,
    Session,
    Snapshot,
    step_at,
)

if TYPE_CHECKING:
    from dembrick.kernels.dynamics.rigid_bodies import Bodies
    from dembrick.simulation.dynamics.state import MovingState
    from dembrick.simulation.statics.state import State


PARTS = ("bodies", "links", "corners", "faces", "ties")  # of the state, in a checkpoint
LOAD_WORK = "energy.load"  # last wrench of every load, for its work
COUNTERS = (  # integers among them that change
    "faces.outline", "faces.count", "faces.pressed.count", "links.like", "corners.like", "faces.like",
)  # fmt: skip


def restore_scene(moving: Motion, snapshot: Snapshot, met: bool, parts: Iterable[str] = PARTS) -> None:
    """Restore blocks, joints, ties and polygons from a snapshot of the same scene, and new contacts if blocks have
    ``met``; ``parts``: those of the state to restore."""
    polygons = moving.polygons
    for name, own in _polygons(moving).items():
        own[...] = snapshot.array(name, own)
    polygons.take_room(joint_families.rooms(moving.state, snapshot))
    found = {name: restored(name, getattr(moving.state, name), snapshot, COUNTERS) for name in parts}
    moving.state = moving.state._replace(**found)
    moving.state.links.share()
    joint_families.check_restored(moving.state, snapshot.path)
    if met:
        moving.contact_detection.restore(moving.state, polygons, snapshot)


def _polygons(moving: Motion) -> dict[str, np.ndarray]:
    return {"polygons.shift": moving.polygons.shift, "polygons.whole": moving.polygons.whole}


class RunHistory:
    """Quantities of a run other than its state that a checkpoint needs for a restart."""

    def __init__(self, moving: Motion, controller: PushController | None):
        self.moving, self._controller = moving, controller
        self.unbalanced = np.zeros(1)  # after the dead-load equilibrium
        self.longest, self.may_end_early = 0, False  # steps of the run, and whether a collapse ends it
        self.at_rest = np.zeros((len(moving.state.links.host), 9))  # `seen` then
        self.extremes = Extremes.of(moving)
        self.pass_on: Callable[[], None] = lambda: None  # called before a snapshot, to pass on waiting rows

    @property
    def where(self) -> str:
        if not self.moving.steps:
            return f"step {self.moving.dead_load_steps} of the dead-load equilibrium"
        return step_at(self.moving.steps, self.moving.time_step)

    @property
    def progress(self) -> Progress:
        moving = self.moving
        if not moving.steps:
            return Progress(DEAD_LOADS, moving.dead_load_steps)
        return Progress("step", moving.steps, self.longest, moving.time, self.may_end_early)

    def _arrays(self) -> dict[str, np.ndarray]:
        moving = self.moving
        arrays = {"past.unbalanced": self.unbalanced, "past.at_rest": self.at_rest, "motion.travel": moving.travel[:1]}
        arrays |= {"motion.falling": moving.falling, "motion.attempt": moving.attempt}
        if self._controller is not None:
            arrays |= {"controller.present": self._controller.present, "controller.peak": self._controller.peak}
        return arrays | moving.energy.arrays | self.extremes.arrays

    def snapshot(self) -> dict[str, np.ndarray]:
        self.pass_on()
        moving = self.moving
        loop = np.array([moving.steps, moving.time_step, moving.dead_load_steps])
        parts = {name: getattr(moving.state, name) for name in PARTS}
        met = moving.contact_detection.snapshot() if moving.steps else {}  # there is no detection before time begins
        return {"loop": loop, **met, **self._arrays(), **_polygons(moving), **flattened(parts)}

    def has_begun(self, snapshot: Snapshot) -> bool:
        """Whether time had begun when the ``snapshot`` was taken, after the dead-load equilibrium."""
        return bool(snapshot.array("loop", np.zeros(3))[0] > 0.0)

    def restore(self, snapshot: Snapshot, goes_on: RestartChanges | None = None) -> None:
        """Restart from a snapshot of the same scene; HistoryError if it is of another. ``goes_on``: changes of laws,
        loads and ties since then."""
        moving = self.moving
        steps, dt, before = snapshot.array("loop", np.zeros(3)).tolist()
        counts = min(steps, before) >= 0.0 < max(steps, before) and steps.is_integer() and before.is_integer()
        if not (counts and 0.0 < dt < math.inf):
            raise HistoryError(f"{snapshot.path}: this checkpoint holds no step of this run")
        moving.steps, moving.time_step, moving.dead_load_steps = int(steps), dt, int(before)
        if goes_on is not None and goes_on.anything:
            self._change(snapshot, goes_on)
            return
        self.go_back(snapshot, met=moving.steps > 0)

    def go_back(self, snapshot: Snapshot, met: bool = True) -> None:
        """Restore all but the steps from a snapshot of this scene, and new contacts if blocks have ``met``."""
        for name, own in self._arrays().items():
            own[...] = snapshot.array(name, own)
        restore_scene(self.moving, snapshot, met)

    def _change(self, snapshot: Snapshot, goes_on: RestartChanges) -> None:
        """Restore motion and history from a snapshot, but keep the present laws, loads and ties."""
        moving, laws = self.moving, joint_families.strengths(self.moving.state)
        of_now = ((LOAD_WORK, goes_on.loads), (PEAK_TENSIONS, goes_on.ties))
        changed = {name for name, given in of_now if given is not None}
        for name, own in self._arrays().items():
            if name not in changed:
                own[...] = snapshot.array(name, own)
        parts = PARTS if goes_on.ties is None else [part for part in PARTS if part != "ties"]
        restore_scene(moving, snapshot, moving.steps > 0, parts)
        joint_families.put_strengths(moving.state, laws)
        moving.state.bodies.applied[:] = 0.0  # present loads and ties are added before these are used
        if goes_on.loads is not None and moving.energy.table is not None:
            self._change_loads(snapshot, goes_on)
        if goes_on.ties is not None:
            held = ties_taken(snapshot, goes_on.ties, moving.state.bodies, moving.time_step)
            take_ties(moving.state, snapshot, goes_on.ties)
            self.extremes.go_on_with(snapshot.array(PEAK_TENSIONS, np.zeros(goes_on.ties.total)), goes_on.ties)
            given = ties_given(moving.state, goes_on.ties, moving.time_step)
            moving.energy.start[1] += given - held  # energy of added and removed ties is no work on the blocks

    def _change_loads(self, snapshot: Snapshot, goes_on: RestartChanges) -> None:
        """Continue the work of loads that are kept; that of removed loads ends half a step ago."""
        table, bodies = self.moving.energy.table, self.moving.state.bodies
        assert table is not None and goes_on.loads is not None
        old = snapshot.array(LOAD_WORK, table.load)
        for row, before in enumerate(goes_on.loads):
            table.load[row] = old[before] if before >= 0 else 0.0
        for row, block in goes_on.gone:
            power = old[row, :3] @ bodies.velocity[block] + old[row, 3:] @ bodies.spin[block]
            table.total["loads"] += 0.5 * self.moving.time_step * power


def start_on(moving: Motion, left: State | Kept, before: TiesBefore | None = None) -> None:
    """Start at rest from the positions and joint history of the state ``left`` by a previous stage.

    A search or a quasi-static test leaves a `State`, a settlement the snapshot of its last equilibrium. ``before``:
    which of its ties are kept. Raises ScenarioError if the joints of both differ.
    """
    if isinstance(left, Kept):
        _go_on_from(moving, left, before)
    else:
        _take(moving, left, before)


def start_at_rest(moving: Motion) -> float:
    """Start from the equilibrium of statics in the geometry of the start, with its joint history; return the error (N)
    of its forces.

    Relaxation from the geometry as drawn would let blocks fall onto one another, and joints that open on the swing lose
    their shear. The blocks stay as drawn if there is no such equilibrium, if they overlap in it, as statics detects no
    new contacts, or if the joints differ, as those of blocks made of parts do.
    """
    from dembrick.simulation.statics.rest.dead_load import find_rest  # imported here for its kernels

    bodies, drawn = moving.state.bodies, keep(moving)
    place = bodies.position.copy()
    try:
        found = find_rest(moving.assembly, Session())
        if not found.rest.stands:
            return 0.0
        _take(moving, found.state, None)
    except DembrickError:
        return 0.0
    detect_initial_contacts(moving)
    if moving.contact_detection.met:
        put_back(moving, drawn)
        moving.contact_detection.forget()
        moving.upright[:] = moving.assembly.orientation
        return 0.0
    bodies.start[:], moving.upright[:] = place, moving.assembly.orientation
    return found.rest.force_error


def _go_on_from(moving: Motion, left: Kept, before: TiesBefore | None) -> None:
    dashpots = moving.state.links.viscous  # of this run's time step and damping
    laws = joint_families.strengths(moving.state)
    try:
        restore_scene(moving, left, True, [part for part in PARTS if part != "ties"])
    except HistoryError as error:  # the blocks are the same, so their joints differ
        raise ScenarioError(OTHER_JOINTS) from error
    joint_families.put_strengths(moving.state, laws)
    total = len(moving.state.ties.length)
    take_ties(moving.state, left, TiesBefore(total, tuple(range(total))) if before is None else before)
    moving.state.links.put("viscous", dashpots)
    bodies = moving.state.bodies
    stop(bodies)
    bodies.applied[:] = 0.0  # the loads of this stage are added at its first step
    bodies.start[:], moving.upright[:] = bodies.position, bodies.orientation
    moving.settled = True


def _take(moving: Motion, left: State, before: TiesBefore | None) -> None:
    state = moving.state
    bodies, links = state.bodies, state.links
    same = len(left.joints.block_a) == len(links.host)
    same = same and joint_families.contact_points(state) == (0 if left.points is None else len(left.points.slip))
    if not same:
        raise ScenarioError(OTHER_JOINTS)
    bodies.position[:] += left.blocks.displacement
    bodies.orientation[:] = unit_quaternion(turned_by(left.blocks.rotation, left.blocks.orientation))
    bodies.rotation[:] = rotation_matrix(bodies.orientation)
    bodies.start[:], moving.upright[:] = bodies.position, bodies.orientation
    joint_families.take_memory(state, left)
    yielded, rest = (np.zeros(0), np.zeros(0)) if left.ties is None else (left.ties.yielded, left.ties.rest)
    whole = TiesBefore(len(yielded), tuple(range(len(yielded)))) if before is None else before
    drawn = np.zeros(len(yielded))
    kept = [k >= 0 for k in whole.of]
    drawn[[k for k in whole.of if k >= 0]] = state.ties.length[kept]
    tie(state, yielded, drawn + rest, whole)
    links.put_seen(seen(bodies, links))
    links.kept[:] = links.seen[:, [0, 1, 3, 4]]


def take_ties(state: MovingState, left: Snapshot, before: TiesBefore) -> None:
    """Copy the ties from a snapshot of the previous run to those of a state whose blocks are in place."""
    m = before.total
    tie(state, _ties(left, "now", m)["yielded"], left.array("ties.length", np.zeros(m)), before)
    old = np.array(before.of, np.int64)
    kept = old >= 0
    ties = state.ties
    # as at the last evaluation of forces, which may be a step behind
    for name, array in (("now", ties.now), ("before", ties.before)):
        array[kept] = _ties(left, name, m)[old[kept]]
    for name, array in (("force", ties.force), ("arm", ties.arm)):
        array[kept] = left.array(f"ties.{name}", np.zeros((m, *array.shape[1:])))[old[kept]]


def _ties(left: Snapshot, name: str, total: int) -> np.ndarray:
    """`TIE` records of a snapshot with ``total`` ties; ``name``: "now" or "before"."""
    return left.array(f"ties.{name}", plain(np.zeros(total, TIE))).view(TIE)


def tie(state: MovingState, yielded: np.ndarray, length: np.ndarray, before: TiesBefore) -> None:
    """Set the ties of a state that are kept to the permanent elongation ``yielded`` (m) and natural ``length`` (m) of
    those before; others are added now, at their present length."""
    ties, bodies = state.ties, state.bodies
    if not len(ties.length):
        return
    old = np.array(before.of, np.int64)
    kept = old >= 0
    ties.arm[:] = np.einsum("teij,tej->tei", bodies.rotation[ties.block], ties.lever)
    line = bodies.position[ties.block[:, 1]] - bodies.position[ties.block[:, 0]] + ties.arm[:, 1] - ties.arm[:, 0]
    now = np.linalg.norm(line, axis=1)
    ties.length[:] = now
    ties.length[kept], ties.now["yielded"][kept] = length[old[kept]], yielded[old[kept]]
    tension = ties.prestress + ties.stiffness * (now - ties.length - ties.now["yielded"])
    ties.now["length"], ties.now["tension"] = now, np.clip(tension, ties.least, ties.strength)
    ties.before[:] = ties.now
    ties.force[:] = (ties.now["tension"] / now)[:, None] * line


def ties_taken(left: Snapshot, before: TiesBefore, bodies: Bodies, dt: float) -> float:
    """Energy (J) of the ties of a snapshot that are removed: their elastic energy, and half of their work over
    the last step ``dt`` (s), which is that of the forces before and after it."""
    m = before.total
    gone = np.setdiff1d(np.arange(m), before.of)
    tension, force = _ties(left, "now", m)["tension"][gone], left.array("ties.force", np.zeros((m, 3)))[gone]
    stiffness = left.array("ties.stiffness", np.zeros(m))[gone]
    block, arm = left.array("ties.block", np.zeros((m, 2), np.int64)), left.array("ties.arm", np.zeros((m, 2, 3)))
    stretched = _stretched(bodies, block[gone], arm[gone], dt)
    return float((0.5 * tension**2 / stiffness).sum() + 0.5 * (force * stretched).sum())


def ties_given(state: MovingState, before: TiesBefore, dt: float) -> float:
    """Energy (J) of the ties of a state that are added: their elastic energy, less half of their work over
    the last step ``dt`` (s)."""
    ties, new = state.ties, np.array(before.of, np.int64) < 0
    held = 0.5 * ties.now["tension"][new] ** 2 / ties.stiffness[new]
    return float(
        held.sum() - 0.5 * (ties.force[new] * _stretched(state.bodies, ties.block[new], ties.arm[new], dt)).sum()
    )


def _stretched(bodies: Bodies, block: np.ndarray, arm: np.ndarray, dt: float) -> np.ndarray:
    """Change of the vectors (t, 3) between the ends of ties in a step ``dt`` (m)."""
    end = bodies.velocity[block] + np.cross(bodies.spin[block], arm)
    return dt * (end[:, 1] - end[:, 0])
