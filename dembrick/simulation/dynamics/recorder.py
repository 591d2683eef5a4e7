"""Rows and frames of a run in real time, for the observer of a session, who gets some of them together."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from dembrick.kernels.dynamics.record import unbalanced_ratio, write_resultants
from dembrick.kernels.joint.ties import TENSION, YIELDED
from dembrick.scenario.checks import present
from dembrick.simulation.channels import NO_BOUND
from dembrick.simulation.dynamics import joint_families
from dembrick.simulation.dynamics.integrator import Motion, present_velocities
from dembrick.simulation.dynamics.known_types import KnownTypes
from dembrick.simulation.dynamics.loads import Driving
from dembrick.simulation.dynamics.pushover import PushController
from dembrick.simulation.dynamics.state import contact_arms, contact_forces
from dembrick.simulation.session import Session

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping


NO_ACTUATORS = np.zeros(0)


def _in_frames(pressed: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """New contacts of a frame; ``count`` says how many."""
    return {"count": np.array([len(pressed["area"])]), **pressed}


class Recorder:
    """Hands rows and frames of a run to the observer of a session."""

    def __init__(
        self, moving: Motion, driving: Driving, session: Session, rows_every: int, frames_every: int,
        controller: PushController | None,
    ):  # fmt: skip
        self._moving, self.driving, self._session = moving, driving, session
        self._rows_of_moved = np.searchsorted(np.flatnonzero(moving.assembly.supporting), driving.supports.block)
        self._controller = controller
        self._frames_every, self._rows_every = frames_every, rows_every
        self._origin = moving.assembly.position - moving.state.middle
        self._any_fixed = bool(np.any(moving.assembly.fixed))
        self._waiting = WaitingRows(self._observe)
        self._known = KnownTypes()

    def _observe(self, rows: Mapping, frames: Mapping) -> None:
        if self._session.observe is not None:
            self._session.observe(rows, frames)

    def compile(self) -> None:
        """Compile what rows take, or load it; after the loop, beside which a second process compiles (`_ahead`)."""
        began = time.perf_counter()
        if self._session.observe is not None:
            self._unbalanced(self._gravity())
            self._resultants()
        self._moving.compile_seconds += time.perf_counter() - began

    def take(self, last: bool = False, equilibrium: int | None = None) -> None:
        """A row of the present state, and a frame where one is due; of an ``equilibrium`` with that number."""
        if self._session.observe is None:
            return
        began, moving = time.perf_counter(), self._moving
        compiled = moving.compile_seconds
        rows, frames = self._row(equilibrium), {}
        if self.takes_frames:
            row = moving.steps // self._rows_every if equilibrium is None else equilibrium
            due = last or row % self._frames_every == 0
            frames = self.frame(rows["time"]) if due else {}
        due = self._waiting.add(rows, frames)
        moving.phases["record"] += time.perf_counter() - began - (moving.compile_seconds - compiled)
        if due or last or equilibrium is not None:
            self.pass_on()

    @contextmanager
    def gathering(self) -> Iterator[None]:
        """Whatever ends the run, its observer gets the rows and frames that wait."""
        try:
            yield
        finally:
            self.pass_on()

    def pass_on(self) -> None:
        """Let the observer have the rows and frames that wait for others."""
        self._waiting.pass_on()

    def _row(self, equilibrium: int | None) -> dict:
        """A row of the present state, of an ``equilibrium`` with that number."""
        moving = self._moving
        counts, reaction, gravity = equilibrium is not None, moving.reactions, self._gravity()
        displacement, load = self.curve(reaction, gravity)
        row = {
            "time": float(present(equilibrium)) if counts else moving.time,
            "load": load,
            "displacement": displacement,
            "unbalanced": self._unbalanced(gravity),
            "lower": 0.0,
            "upper": 0.0,
            "actuator_displacement": NO_ACTUATORS,
            "actuator_force": NO_ACTUATORS,
            **self._of_actuators(load),
            "energy": {} if counts else moving.energy.energies(moving.state, moving.time_step),
            "new_contacts": float(moving.contact_detection.carrying),
        }
        if self._any_fixed:
            row["reaction"] = reaction
        watched = moving.assembly.control_points
        if watched.names:
            moved = moving.state.bodies.position - self._origin
            row["control_point"] = watched.displacement(moved, moving.state.bodies.rotation)
        if len(moving.state.ties.stiffness):
            now = moving.state.ties.now
            row["tension"], row["yielded"] = now[:, TENSION], now[:, YIELDED]
        if "joints" in self._session.output.channels:
            row["joint"] = self._resultants()
        return row

    def _of_actuators(self, load: float) -> dict:
        """Displacement and force of every actuator of a load path, and the bounds of its limit: the load itself, and
        none."""
        driven = self.driving.driven
        if driven is None:
            return {}
        return {
            "actuator_displacement": driven.displacements(self._moving.state.bodies),
            "actuator_force": load * driven.weight,
            "lower": load,
            "upper": NO_BOUND,
        }

    def frame(self, time: float) -> dict:
        """A frame of the present state at ``time``, as the observer gets it."""
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
            frames["contact_force"] = contact_forces(moving.state, left)[None]
            frames["new_contacts"] = _in_frames(moving.contact_detection.pressed(moving.state.middle))
        return frames

    def follow_up(self, frames: list[dict]) -> None:
        """Frames after the last equilibrium, of what is none and has no row."""
        if self._session.observe is not None:
            none = no_rows(self._row(0))
            for frame in frames:
                self._session.observe(none, frame)

    @property
    def takes_frames(self) -> bool:
        return self._session.observe is not None and "frames" in self._session.output.channels

    def curve(self, reaction: np.ndarray, gravity: np.ndarray | None = None) -> tuple[float, float]:
        """Displacement and load of now, given the reactions (s, 6) of the supports, and ``gravity`` (3,) if known.

        Of a push the driven displacement and the load factor, of loads that grow the driven displacement and their
        multiplier; of supports that move their displacement, and the reaction along their motion; else the displacement
        of the block that has moved furthest, and what the driving says.
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
        """Loads and supports of the run at present."""
        return self.driving if self._controller is None else self._controller.pushing(self.driving)

    def _gravity(self) -> np.ndarray:
        """Gravity (3,) of now, as the loads of the run have it."""
        moving, driving = self._moving, self._present()
        known = moving.ahead.gravity(driving, moving.steps, moving.time_step)
        return driving.forces(np.array([moving.time]), moving.time_step)[0][0] if known is None else known

    def _unbalanced(self, gravity: np.ndarray) -> float:
        state = self._moving.state
        return self._known.call(state, unbalanced_ratio, state.bodies, state.links, *gravity.tolist())

    def _resultants(self) -> np.ndarray:
        """See `dynamics.state.joint_resultants`."""
        state = self._moving.state
        out = np.empty((len(state.links.host), 7))
        self._known.call(state, write_resultants, state.bodies, state.links, state.corners, state.faces, out)
        return out


TOGETHER = 64  # rows, at the most
MOST_WAITING = 1 << 20  # bytes of them
HELD = 0.05  # s, for which rows wait at the most while others come


class WaitingRows:
    """Gathers rows and frames for ``observe``, each call of which takes longer than the steps to a row of one block.

    ``rows`` are by name, each a number or an array, or a mapping of these; what the observer gets has one entry a row
    in each. Whoever keeps a checkpoint, or ends the run, passes on what waits before.
    """

    def __init__(self, observe: Callable[[Mapping, Mapping], None]):
        self._observe = observe
        self._rows: dict[str, Any] = {}
        self._frames: list[dict] = []
        self._count, self._room, self._passed_on = 0, 0, -math.inf

    def add(self, row: Mapping[str, Any], frames: dict) -> bool:
        """Take a row, and the frames that are due with it; returns whether it is time to pass them on."""
        if not self._rows:
            self._room = max(1, min(TOGETHER, MOST_WAITING // _bytes(row)))
            self._rows = _room_for(row, self._room)
        _put(self._rows, self._count, row)
        self._count += 1
        if frames:
            self._frames.append(frames)
        return self._count == self._room or time.monotonic() - self._passed_on >= HELD

    def pass_on(self) -> None:
        """Let the observer have all that waits."""
        if not self._count:
            return
        rows, frames = _first(self._rows, self._count), joined(self._frames)
        self._rows, self._frames, self._count = {}, [], 0
        self._observe(rows, frames)
        self._passed_on = time.monotonic()


def _bytes(row: Mapping[str, Any]) -> int:
    return sum(_bytes(value) if isinstance(value, Mapping) else 8 * np.size(value) for value in row.values())


def _room_for(row: Mapping[str, Any], count: int) -> dict[str, Any]:
    """Arrays for so many rows like that one."""
    return {
        name: _room_for(value, count) if isinstance(value, Mapping) else np.empty((count, *np.shape(value)))
        for name, value in row.items()
    }


def _put(rows: Mapping[str, Any], place: int, row: Mapping[str, Any]) -> None:
    for name, value in row.items():
        if isinstance(value, dict):
            _put(rows[name], place, value)
        else:
            rows[name][place] = value


def _first(rows: Mapping[str, Any], count: int) -> dict[str, Any]:
    """The first so many of the rows."""
    return {name: _first(value, count) if isinstance(value, Mapping) else value[:count] for name, value in rows.items()}


def no_rows(row: Mapping[str, Any]) -> dict[str, Any]:
    """None of the rows like that one."""
    return _first(_room_for(row, 1), 0)


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
