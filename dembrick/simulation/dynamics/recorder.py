"""Rows and frames of a run in real time, passed to the observer of a session in batches.

One kernel writes all rows (`kernels.dynamics.record`). Most rows need nothing but steps of the loop between them
(`pass_rows`), in a thirtieth of the time of a row written from Python. Python writes a row if there is more to do:
contact detection, a checkpoint, a progress report, a frame with velocities.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from dembrick.kernels.dynamics.loop import Limits
from dembrick.kernels.dynamics.record import write_row
from dembrick.kernels.dynamics.row_energies import BALANCE
from dembrick.simulation.channels import NO_BOUND
from dembrick.simulation.dynamics import joint_families
from dembrick.simulation.dynamics.chunks import advance_rows, in_one_thread
from dembrick.simulation.dynamics.integrator import (
    Motion,
    advance,
    after_chunk,
    detect_initial_contacts,
    driving_time,
    present_velocities,
)
from dembrick.simulation.dynamics.known_types import KnownTypes
from dembrick.simulation.dynamics.loads import Driving
from dembrick.simulation.dynamics.outcome import Extremes
from dembrick.simulation.dynamics.pace import LONGEST_CHUNK
from dembrick.simulation.dynamics.pushover import PushController
from dembrick.simulation.dynamics.row_arrays import bytes_of_row, record_of, scene_of
from dembrick.simulation.dynamics.state import contact_areas, contact_arms, contact_forces
from dembrick.simulation.session import Session
from dembrick.simulation.statics.tilting_table import cosine

if TYPE_CHECKING:
    from collections.abc import Iterator


TOGETHER = 64  # most rows of a batch
MOST_WAITING = 1 << 20  # most bytes of a batch
HELD = 0.05  # s, longest time for which rows wait to be passed on


def _in_frames(pressed: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """New contacts of a frame, with their ``count``."""
    return {"count": np.array([len(pressed["area"])]), **pressed}


class Recorder:
    """Passes rows and frames of a run to the observer of a session, and updates the ``extremes`` at every row.

    ``rows_every``: steps between rows, ``frames_every``: rows between frames. With ``equilibria`` rows are those of a
    path, which has no energy balance.
    """

    def __init__(
        self, moving: Motion, driving: Driving, session: Session, extremes: Extremes, rows_every: int,
        frames_every: int, controller: PushController | None = None, equilibria: bool = False,
    ):  # fmt: skip
        self._moving, self.driving, self._session, self._extremes = moving, driving, session, extremes.noted
        self._rows_of_moved = np.searchsorted(np.flatnonzero(moving.assembly.supporting), driving.supports.block)
        self._controller, channels = controller, session.output.channels
        self._frames_every, self._rows_every = frames_every, rows_every
        self._origin = moving.assembly.position - moving.state.middle
        self._any_fixed = bool(np.any(moving.assembly.fixed))
        # frames that must be taken from Python: with velocities, contact forces or bonds
        self._slow_frames = bool({"velocity", "contacts"} & set(channels)) or joint_families.has_strengths(moving.state)
        quick_frames = self.takes_frames and not self._slow_frames and not equilibria
        wanted = channels if session.observe is not None else ()
        balanced = moving.energy.wanted and not equilibria and session.observe is not None
        asked = wanted, balanced, quick_frames
        most = min(TOGETHER, MOST_WAITING // bytes_of_row(record_of(moving, 1, *asked)))
        self._room = 1 if equilibria else max(1, most)
        self._record = record_of(moving, self._room, *asked)
        self._record.next[0].every = rows_every
        self._curve: list[tuple[float, float]] = []  # displacement and load of the rows that wait
        self._frames: list[dict] = []
        self._known = KnownTypes()
        self._passed_on = -math.inf
        self._last = -1  # step of the last row
        self._seconds_a_row = HELD

    def compile(self) -> None:
        """Compile or load the row writer; after the loop, which a second process compiles beside (`_ahead`)."""
        began = time.perf_counter()
        self._known.of(self._moving.state, write_row, *self._arguments(self._gravity()))
        self._moving.compile_seconds += time.perf_counter() - began

    def _arguments(self, gravity: np.ndarray) -> tuple:
        """Arguments of `write_row` for a row of the present state."""
        moving = self._moving
        moment = moving.steps, moving.time_step, *gravity.tolist()
        return self._record, scene_of(moving), self._extremes, moment

    def take(self, last: bool = False, equilibrium: int | None = None) -> None:
        """Record a row of the present state, and a frame if one is due; ``equilibrium``: its number on a path."""
        began, moving, record = time.perf_counter(), self._moving, self._record
        compiled, row, gravity = moving.compile_seconds, int(record.count[0]), self._gravity()
        following = record.next[0]
        self._last, following.frames_every, following.fastest, following.quiet = moving.steps, 0, math.inf, math.inf
        self._known.call(moving.state, write_row, *self._arguments(gravity))
        if self._session.observe is None:
            record.count[0] = 0
        else:
            self._curve.append(self.curve(record.reaction[row], gravity))
            if self.takes_frames:
                number = moving.steps // self._rows_every if equilibrium is None else equilibrium
                if last or number % self._frames_every == 0:
                    self._frames.append(self.frame(moving.time if equilibrium is None else float(equilibrium)))
        moving.phases["record"] += time.perf_counter() - began - (moving.compile_seconds - compiled)
        if last or equilibrium is not None or self._is_due():
            self.pass_on(equilibrium)

    @property
    def is_at_row(self) -> bool:
        """Whether a row of the present state is due and not yet written, as the loop may stop just after one."""
        return self._moving.steps % self._rows_every == 0 and self._moving.steps != self._last

    def rows_ahead(self, stride: int, total: int) -> int:
        """Number of rows that `pass_rows` may write next: none if Python must act at every step or soon.
        ``stride``: greatest number of consecutive steps, ``total``: steps of the run.

        None either if the loop has its own order of blocks, which must be restored first, or several threads, whose
        number is chosen at every call.
        """
        moving, every = self._moving, self._rows_every
        own_order = moving.state.order is not None
        if own_order or self._controller is not None or not self.driving.by_time_alone or moving.steps % every:
            return 0
        if not in_one_thread(moving):
            return 0
        rows = min(stride, LONGEST_CHUNK, total - moving.steps - 1) // every - 1
        rows = min(rows, self._room - int(self._record.count[0]) - 1)
        if self._slow_frames and self.takes_frames:
            rows = min(rows, -(moving.steps // every + 1) % self._frames_every)
        soon = min(HELD, self._session.undisturbed())
        return max(0, min(rows, int(soon / self._seconds_a_row)))

    def pass_rows(self, rows: int, limits: Limits) -> int:
        """Advance and write so many ``rows``, or fewer if contacts must be detected. Returns RUNNING or REACHED, and
        raises the errors of `advance`."""
        moving, record, every = self._moving, self._record, self._rows_every
        began, before = time.perf_counter(), int(record.count[0])
        with driving_time(moving):
            detect_initial_contacts(moving)
            first, dt = moving.steps, moving.time_step
            loads = moving.ahead.of(self.driving, first, rows * every + 1, dt)
            gravity = loads.gravity[: rows * every + 1]
            greatest = float(np.abs(gravity).max())
            detection, following = moving.contact_detection, record.next[0]
            if detection.steps_to_go(moving.state, greatest, dt) < every:
                return advance(moving, self.driving, every, limits)
            following.frames_every = self._frames_every if len(record.frame_step) else 0
            following.fastest, following.quiet = detection.calm_for(every, greatest, dt)
            state, scene, extremes = moving.state, scene_of(moving), self._extremes
            moment = first, dt, 0.0, 0.0, 0.0
            code = self._known.of(moving.state, write_row, record, scene, extremes, moment)

            def write(done: int, g: Sequence[float]) -> int:
                nonlocal state, scene
                if moving.state is not state:  # cutting polygons may have replaced arrays
                    state, scene = moving.state, scene_of(moving)
                return code(record, scene, extremes, (first + done, dt, *g))

            every_gravity = gravity[every::every].tolist()
            status, done = advance_rows(moving, self.driving, every, limits, loads, every_gravity, write)
            try:
                status = after_chunk(moving, status, done, dt)
            finally:
                self._take_over(before)
        passed = int(record.count[0]) - before
        self._seconds_a_row = (time.perf_counter() - began) / max(1, passed)
        if self._is_due():
            self.pass_on()
        return status

    def _take_over(self, before: int) -> None:
        """Complete the rows that the loop has written after the first ``before`` ones, and collect their frames."""
        began, moving, record = time.perf_counter(), self._moving, self._record
        rows = slice(before, int(record.count[0]))
        self._last = int(record.step[rows][-1]) if rows.stop > before else self._last
        times, own = (record.step[rows] * moving.time_step).tolist(), record.row[rows]
        for at, furthest, gravity in zip(times, own["furthest"].tolist(), own["gravity"], strict=True):
            self._curve.append((furthest, self.driving.load(at, moving.time_step, gravity)))
        if n := int(record.count[1]):
            frames = {
                "time": record.frame_step[:n] * moving.time_step,
                "displacement": record.frame_position[:n] - self._origin,
                "orientation": record.frame_orientation[:n].copy(),
            }
            if "joints" in self._session.output.channels:
                frames["joint_shift"] = record.frame_shift[:n].copy()
            self._frames.append(frames)
            record.count[1] = 0
        moving.phases["record"] += time.perf_counter() - began

    def _is_due(self) -> bool:
        """Whether it is time to pass on the waiting rows."""
        return int(self._record.count[0]) == self._room or time.monotonic() - self._passed_on >= HELD

    @contextmanager
    def gathering(self) -> Iterator[None]:
        """Context at whose end the observer gets all waiting rows and frames, even after an error."""
        try:
            yield
        finally:
            self.pass_on()

    def pass_on(self, equilibrium: int | None = None) -> None:
        """Pass the waiting rows and frames to the observer; ``equilibrium``: number of the only row, on a path."""
        if int(self._record.count[0]) and self._session.observe is not None:
            rows, frames = self._rows(equilibrium), joined(self._frames)
            self._record.count[0], self._curve, self._frames = 0, [], []
            self._session.observe(rows, frames)
            self._passed_on = time.monotonic()

    def _rows(self, equilibrium: int | None) -> dict[str, Any]:
        """The waiting rows, each channel an array with one entry per row; ``equilibrium``: number of the only one."""
        moving, record = self._moving, self._record
        n, curve = int(record.count[0]), np.array(self._curve).reshape(-1, 2)
        rows = {
            "time": record.step[:n] * moving.time_step if equilibrium is None else np.full(n, float(equilibrium)),
            "load": curve[:, 1],
            "displacement": curve[:, 0],
            "unbalanced": record.row["unbalanced"][:n].copy(),
            "lower": np.zeros(n),
            "upper": np.zeros(n),
            "actuator_displacement": np.zeros((n, len(moving.assembly.actuators.names))),
            "actuator_force": np.zeros((n, len(moving.assembly.actuators.names))),
            **self._of_actuators(curve[:, 1]),
            "energy": {name: record.energy[name][:n].copy() for name in BALANCE.names or () if len(record.energy)},
            "new_contacts": record.row["new_contacts"][:n].copy(),
        }
        if self._any_fixed:
            rows["reaction"] = record.reaction[:n].copy()
        watched = moving.assembly.control_points
        if watched.names:
            moved = record.place[:n] - self._origin[watched.at.block]
            rows["control_point"] = watched.displaced(moved, record.turn[:n])
        if len(moving.state.ties.stiffness):
            rows["tension"], rows["yielded"] = record.tension[:n].copy(), record.yielded[:n].copy()
        if "joints" in self._session.output.channels:
            rows["joint"] = record.joint[:n].copy()
        return rows

    def _of_actuators(self, load: np.ndarray) -> dict:
        """Displacement and force of every actuator on a load path, one row per equilibrium with its ``load``, and the
        bounds of the limit: the load itself as the lower one, and no upper one."""
        driven = self.driving.driven
        if driven is None:
            return {}
        return {
            "actuator_displacement": np.tile(driven.displacements(self._moving.state.bodies), (len(load), 1)),
            "actuator_force": (load * cosine(load) if self._session.tilts else load)[:, None] * driven.weight,
            "lower": load,
            "upper": np.full(len(load), NO_BOUND),
        }

    def frame(self, time: float) -> dict:
        """A frame of the present state at ``time``, in the form for the observer."""
        moving, channels = self._moving, self._session.output.channels
        bodies, shift = moving.state.bodies, moving.polygons.shift
        frames = {
            "time": np.array([time]),
            "displacement": (bodies.position - self._origin)[None],
            "orientation": bodies.orientation[None].copy(),
        }
        if "velocity" in channels:
            velocity, spin = present_velocities(moving, self._present())
            frames["velocity"], frames["spin"] = velocity[None], spin[None]
        if joint_families.has_strengths(moving.state):
            frames["bond"] = joint_families.bonded(moving.state)[None].copy()
        if "joints" in channels:
            frames["joint_shift"] = shift[None].copy()
        if "contacts" in channels:
            left = moving.contact_detection.left_to_joints()
            frames["contact_arm"] = contact_arms(moving.state, shift)[None]
            frames["contact_area"] = contact_areas(moving.state)[None].copy()
            frames["contact_force"] = contact_forces(moving.state, left)[None]
            frames["new_contacts"] = _in_frames(moving.contact_detection.pressed(moving.state.middle))
        return frames

    def follow_up(self, frames: list[dict]) -> None:
        """Pass on ``frames`` after the last equilibrium, which have no rows."""
        if self._session.observe is not None:
            for frame in frames:
                self._session.observe(self._rows(0), frame)

    @property
    def takes_frames(self) -> bool:
        return self._session.observe is not None and "frames" in self._session.output.channels

    def curve(self, reaction: np.ndarray, gravity: np.ndarray | None = None) -> tuple[float, float]:
        """Present displacement and load, given the reactions (s, 6) of the supports, and ``gravity`` (3,) if known.

        For a push the driven displacement and the load factor; for growing loads the driven displacement and their
        multiplier; for moving supports their displacement and the reaction along their motion; else the greatest
        displacement of a block, and the load of the driving.
        """
        moving, driving = self._moving, self.driving
        away = moving.displacement
        if self._controller is not None:
            return self._controller.mean(away), float(self._controller.present[0])
        if len(driving.supports):
            share = float(driving.share(np.array([moving.time]))[0])
            load = driving.supports.resisting(share, reaction[self._rows_of_moved])
            return share * driving.supports.length, load
        if driving.driven is not None:
            return driving.driven.displacement(moving.state.bodies), driving.load(moving.time, moving.time_step)
        furthest = float(np.sqrt((away * away).sum(axis=1)).max())
        return furthest, driving.load(moving.time, moving.time_step, gravity)

    def _present(self) -> Driving:
        """Present loads and supports of the run."""
        return self.driving if self._controller is None else self._controller.pushing(self.driving)

    def _gravity(self) -> np.ndarray:
        """Present gravity (3,) in the loads of the run."""
        moving, driving = self._moving, self._present()
        known = moving.ahead.gravity(driving, moving.steps, moving.time_step)
        return driving.forces(np.array([moving.time]), moving.time_step)[0][0] if known is None else known


def joined(parts: Sequence[Mapping]) -> Mapping:
    """Chunks as one mapping of arrays (or of mappings of arrays)."""
    if len(parts) < 2:
        return parts[0] if parts else {}
    first = parts[0]
    return {
        name: joined([part[name] for part in parts])
        if isinstance(first[name], Mapping)
        else np.concatenate([part[name] for part in parts])
        for name in first
    }
