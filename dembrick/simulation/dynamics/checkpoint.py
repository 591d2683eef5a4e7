"""Checkpoints of a run in real time: what is written, and how the run goes on from it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

import numpy as np

from dembrick.errors import HistoryError
from dembrick.simulation.checkpoint_arrays import flattened, restored
from dembrick.simulation.dynamics import joint_families
from dembrick.simulation.dynamics.integrator import Motion
from dembrick.simulation.dynamics.outcome import PEAK_TENSIONS, Extremes
from dembrick.simulation.dynamics.pushover import PushController
from dembrick.simulation.dynamics.tie_handover import take_ties, ties_given, ties_taken
from dembrick.simulation.session import DEAD_LOADS, GoesOn, Progress, Snapshot, step_at

PARTS = ("bodies", "links", "corners", "faces", "ties")  # of the state, that a checkpoint holds
LOAD_WORK = "energy.load"  # of every load, what it did last
COUNTERS = (  # integers among them that change
    "faces.outline", "faces.count", "faces.pressed.count", "links.like", "corners.like", "faces.like",
)  # fmt: skip


def restore_scene(moving: Motion, snapshot: Snapshot, met: bool, parts: Iterable[str] = PARTS) -> None:
    """Blocks, joints, ties and polygons as in a snapshot of the same scene, and new contacts if blocks have ``met``;
    of its state the ``parts``."""
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


class Past:
    """Quantities beside the state of a run that a checkpoint keeps, so that the run can go on."""

    def __init__(self, moving: Motion, controller: PushController | None):
        self.moving, self._controller = moving, controller
        self.unbalanced = np.zeros(1)  # after the dead-load equilibrium
        self.longest, self.may_end_early = 0, False  # steps of the run, and whether a collapse ends it
        self.at_rest = np.zeros((len(moving.state.links.host), 9))  # `seen` then
        self.extremes = Extremes.of(moving)
        self.pass_on: Callable[[], None] = lambda: None  # what of the record waits, before a snapshot

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
        arrays = {"past.unbalanced": self.unbalanced, "past.at_rest": self.at_rest, "motion.travel": moving._travel[:1]}
        arrays |= {"motion.falling": moving.falling, "motion.attempt": moving.attempt}
        if self._controller is not None:
            arrays |= {"controller.present": self._controller.present, "controller.peak": self._controller.peak}
        return arrays | moving.energy.arrays | self.extremes.arrays

    def snapshot(self) -> dict[str, np.ndarray]:
        self.pass_on()
        moving = self.moving
        loop = np.array([moving.steps, moving.time_step, moving.dead_load_steps])
        parts = {name: getattr(moving.state, name) for name in PARTS}
        met = moving.contact_detection.snapshot() if moving.steps else {}  # nobody looks for pairs before time begins
        return {"loop": loop, **met, **self._arrays(), **_polygons(moving), **flattened(parts)}

    def has_begun(self, snapshot: Snapshot) -> bool:
        """Whether the dead-load equilibrium was reached when the ``snapshot`` was taken, and time had begun."""
        return bool(snapshot.array("loop", np.zeros(3))[0] > 0.0)

    def restore(self, snapshot: Snapshot, goes_on: GoesOn | None = None) -> None:
        """Take it from a snapshot of the same scene; HistoryError if it is of another. ``goes_on``: laws, loads and
        ties are those of now."""
        moving = self.moving
        steps, dt, before = snapshot.array("loop", np.zeros(3)).tolist()
        counts = min(steps, before) >= 0.0 < max(steps, before) and steps.is_integer() and before.is_integer()
        if not (counts and 0.0 < dt < math.inf):
            raise HistoryError(f"{snapshot.path}: this checkpoint is of no step of this run")
        moving.steps, moving.time_step, moving.dead_load_steps = int(steps), dt, int(before)
        if goes_on is not None and goes_on.anything:
            self._change(snapshot, goes_on)
            return
        for name, own in self._arrays().items():
            own[...] = snapshot.array(name, own)
        restore_scene(moving, snapshot, met=moving.steps > 0)

    def _change(self, snapshot: Snapshot, goes_on: GoesOn) -> None:
        """Take motion and memory from a snapshot, and keep the laws, loads and ties that there are."""
        moving, laws = self.moving, joint_families.strengths(self.moving.state)
        of_now = ((LOAD_WORK, goes_on.loads), (PEAK_TENSIONS, goes_on.ties))
        changed = {name for name, given in of_now if given is not None}
        for name, own in self._arrays().items():
            if name not in changed:
                own[...] = snapshot.array(name, own)
        parts = PARTS if goes_on.ties is None else [part for part in PARTS if part != "ties"]
        restore_scene(moving, snapshot, moving.steps > 0, parts)
        joint_families.put_strengths(moving.state, laws)
        moving.state.bodies.applied[:] = 0.0  # loads and ties of now put theirs there before they are asked for
        if goes_on.loads is not None and moving.energy.table is not None:
            self._change_loads(snapshot, goes_on)
        if goes_on.ties is not None:
            held = ties_taken(snapshot, goes_on.ties, moving.state.bodies, moving.time_step)
            take_ties(moving.state, snapshot, goes_on.ties)
            self.extremes.go_on_with(snapshot.array(PEAK_TENSIONS, np.zeros(goes_on.ties.total)), goes_on.ties)
            given = ties_given(moving.state, goes_on.ties, moving.time_step)
            moving.energy.start[1] += given - held  # what comes and goes with the ties is no work of the blocks

    def _change_loads(self, snapshot: Snapshot, goes_on: GoesOn) -> None:
        """Loads that stay go on with the work of the step; that of those which are gone ends half a step ago."""
        table, bodies = self.moving.energy.table, self.moving.state.bodies
        assert table is not None and goes_on.loads is not None
        old = snapshot.array(LOAD_WORK, table.load)
        for row, before in enumerate(goes_on.loads):
            table.load[row] = old[before] if before >= 0 else 0.0
        for row, block in goes_on.gone:
            power = old[row, :3] @ bodies.velocity[block] + old[row, 3:] @ bodies.spin[block]
            table.total["loads"] += 0.5 * self.moving.time_step * power
