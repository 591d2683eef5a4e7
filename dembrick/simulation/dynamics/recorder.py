"""Rows and frames of a run in real time, for the observer of a session."""

from __future__ import annotations

import time

import numpy as np

from dembrick.kernels.dynamics.record import unbalanced_ratio
from dembrick.kernels.joint.ties import TENSION, YIELDED
from dembrick.simulation.channels import NO_BOUND
from dembrick.simulation.dynamics import joint_families
from dembrick.simulation.dynamics.integrator import Motion, present_velocities
from dembrick.simulation.dynamics.loads import Driving
from dembrick.simulation.dynamics.pushover import PushController
from dembrick.simulation.dynamics.state import (
    contact_arms,
    contact_forces,
    joint_resultants,
)
from dembrick.simulation.session import Session


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

    def compile(self) -> None:
        """Compile what rows take, or load it; after the loop, beside which a second process compiles (`_ahead`)."""
        began = time.perf_counter()
        if self._session.observe is not None:
            self._unbalanced()
            joint_resultants(self._moving.state)
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
            frames = self.frame(rows["time"][0]) if due else {}
        moving.phases["record"] += time.perf_counter() - began - (moving.compile_seconds - compiled)
        self._session.observe(rows, frames)

    def _row(self, equilibrium: int | None) -> dict:
        """A row of the present state, of an ``equilibrium`` with that number."""
        moving = self._moving
        counts, reaction = equilibrium is not None, moving.reactions
        energy = {} if counts else moving.energy.energies(moving.state, moving.time_step)
        displacement, load = self.curve(reaction)
        row = {
            "time": np.array([float(equilibrium) if counts else moving.time]),
            "load": np.array([load]),
            "displacement": np.array([displacement]),
            "unbalanced": np.array([self._unbalanced()]),
            "lower": np.zeros(1),
            "upper": np.zeros(1),
            "actuator_displacement": np.zeros((1, 0)),
            "actuator_force": np.zeros((1, 0)),
            **self._of_actuators(load),
            "energy": {name: np.array([value]) for name, value in energy.items()},
            "new_contacts": np.array([float(moving.contact_detection.carrying)]),
        }
        if np.any(moving.assembly.fixed):
            row["reaction"] = reaction[None]
        watched = moving.assembly.control_points
        if watched.names:
            moved = moving.state.bodies.position - self._origin
            row["control_point"] = watched.displacement(moved, moving.state.bodies.rotation)[None]
        if len(moving.state.ties.stiffness):
            row["tension"], row["yielded"] = (
                moving.state.ties.now[None, :, [TENSION, YIELDED]].transpose(2, 0, 1).copy()
            )
        if "joints" in self._session.output.channels:
            row["joint"] = joint_resultants(moving.state)[None]
        return row

    def _of_actuators(self, load: float) -> dict:
        """Displacement and force of every actuator of a load path, and the bounds of its limit: the load itself, and
        none."""
        driven = self.driving.driven
        if driven is None:
            return {}
        return {
            "actuator_displacement": driven.displacements(self._moving.state.bodies)[None],
            "actuator_force": load * driven.weight[None],
            "lower": np.array([load]),
            "upper": np.array([NO_BOUND]),
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
            none = {
                name: {key: value[:0] for key, value in of.items()} if isinstance(of, dict) else of[:0]
                for name, of in self._row(0).items()
            }
            for frame in frames:
                self._session.observe(none, frame)

    @property
    def takes_frames(self) -> bool:
        return self._session.observe is not None and "frames" in self._session.output.channels

    def curve(self, reaction: np.ndarray) -> tuple[float, float]:
        """Displacement and load of now, given the reactions (s, 6) of the supports.

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
        return float(np.linalg.norm(away, axis=1).max()), driving.load(moving.time, moving.time_step)

    def _present(self) -> Driving:
        """Loads and supports of the run at present."""
        return self.driving if self._controller is None else self._controller.pushing(self.driving)

    def _unbalanced(self) -> float:
        state = self._moving.state
        gravity, _ = self._present().at(np.array([self._moving.time]), self._moving.time_step)
        return unbalanced_ratio(state.bodies, state.links, *gravity[0].tolist())
