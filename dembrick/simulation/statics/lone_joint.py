"""Limit loads of single joints between a free and a fixed block, by `kernels.statics.lone_search`: of one scene
(`LoneSearch`), or of many in a batch (`simulation.statics.batch`).
"""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dembrick._jit import ready
from dembrick.errors import HistoryError
from dembrick.kernels.statics.energy import elastic_energy
from dembrick.kernels.statics.load_bounds import Basis, Certificate
from dembrick.kernels.statics.lone_joint import CONVERGED, RUNNING, SEARCH, LoneJoints, new_room
from dembrick.kernels.statics.lone_search import MOST_EQUILIBRIA, search_joints
from dembrick.simulation import interrupts
from dembrick.simulation.checkpoint_arrays import flattened, plain, restored, restored_state
from dembrick.simulation.session import Progress, Session, Snapshot
from dembrick.simulation.statics import joint_families
from dembrick.simulation.statics.state import State, for_kernels, load_vectors, move_actuators, zero_actuators

if TYPE_CHECKING:
    from dembrick.kernels.state import Joints
    from dembrick.kernels.statics.area_joints import Areas
    from dembrick.kernels.statics.point_joints import Points
    from dembrick.simulation.statics.recorder import Recorder


class JointsAlone(NamedTuple):
    """Joints without blocks: the part of a `State` that these searches need."""

    joints: Joints
    points: Points | None
    areas: Areas | None


def lone_joints(state: State | JointsAlone, dead: np.ndarray, unit: np.ndarray) -> LoneJoints:
    """The k joints of a ``state`` without history, each between a free and a fixed block.

    ``dead`` and ``unit`` (k, 6): wrench of the dead load, and of the actuators for V = 1, on b about O in the axes of
    the joint.
    """
    k = len(dead)
    memory = joint_families.memory(state)
    points = max(1, joint_families.contact_points(state))
    return LoneJoints(
        joints=state.joints,
        points=state.points,
        areas=state.areas,
        point_memory=memory["points"],
        area_memory=memory["areas"],
        base=np.zeros((k, 6)),
        direction=np.zeros((k, 6)),
        secant=np.zeros((k, 6)),
        dead=np.ascontiguousarray(dead, float),
        unit=np.ascontiguousarray(unit, float),
        reach=joint_families.reach(state),
        stiffness=joint_families.stiffness(state),
        search=np.zeros(k, SEARCH),
        basis=Basis(
            *(np.zeros((k, size)) for size in (3, 3, 2)),
            rest=np.zeros(points),
            scalars=np.zeros((k, 5)),
            twist=np.zeros((k, 3)),
            across=np.zeros((k, 6)),
        ),
        bracket=np.zeros((k, 2)),
        twist=np.zeros((k, 3)),
        seen=np.zeros((k, 3, 4)),
    )


def is_lone(state: State) -> bool:
    """Whether a ``state`` consists of one dry joint between a free and a fixed block, and nothing else."""
    joints, free = state.joints, state.blocks.free
    return (
        len(joints.block_a) == 1
        and len(free) == 1
        and free[0] in (joints.block_a[0], joints.block_b[0])
        and state.ties is None
        and not len(state.blocks.guided)
        and not joint_families.has_strengths(state)
        and not joint_families.is_custom(state)
    )


class LoneSearch:
    """Search for the limit load of a ``state`` that `is_lone`, from the geometry of the start."""

    def __init__(self, state: State, tolerance: float):
        joints, block = state.joints, int(state.blocks.free[0])
        self.state, self.tolerance, self._block = state, tolerance, block
        self._sense = 1.0 if block == joints.block_b[0] else -1.0
        self._arm = (joints.arm_b if self._sense > 0.0 else joints.arm_a)[0]
        self._dead = np.concatenate([state.blocks.dead_force[block], state.blocks.dead_torque[block]])
        wrenches = [self._about_joint(wrench) for wrench in (self._dead, load_vectors(state)[block])]
        self.lone = lone_joints(state, *wrenches)
        self._room = new_room()
        self._search = ready(search_joints, 0, 1, self.lone, 0, tolerance, self._room)
        self._motion_at_rest = np.zeros(6)
        self._taken = np.zeros(3)  # J: work of the loads, friction, and elastic energy under the dead load

    def _about_joint(self, wrench: np.ndarray) -> np.ndarray:
        """A wrench on the free block about its centroid, transformed to b about O in the axes of the joint (1, 6)."""
        force, moment = wrench[:3], wrench[3:] - np.cross(self._arm, wrench[:3])
        return self._sense * (np.stack([force, moment]) @ self.state.joints.axes[0].T).reshape(1, 6)

    @property
    def found(self):
        """The `SEARCH` record of the joint."""
        return self.lone.search[0]

    @property
    def strict(self) -> bool:
        """Whether friction does not depend on the load, so that the bracket is certified."""
        return bool(self.found["strict"] == 1)

    @property
    def converged(self) -> bool:
        """Whether the bracket is within the tolerance."""
        return bool(self.found["status"] == CONVERGED)

    def _follow(self, most: int) -> None:
        """Find the dead-load equilibrium, if that is not done, and at most so many further equilibria."""
        self._search(0, 1, self.lone, most, self.tolerance, self._room)

    def run(self) -> None:
        """Find the equilibrium under the dead load, then the path up to the limit."""
        self._rest()
        self._follow(MOST_EQUILIBRIA)

    def run_to(self, load: float) -> None:
        """`run` until the joint carries a ``load`` (N), and store that equilibrium in the state."""
        self._rest()
        while self.found["status"] == RUNNING and self.found["load"] < load:
            self._follow(1)
            self.show()

    def _rest(self) -> None:
        """Find the equilibrium under the dead load, from which displacements of the actuators are measured."""
        self._follow(0)
        self.show()
        zero_actuators(self.state)
        self._motion_at_rest[:] = self.lone.base[0]

    def record(self, recorder: Recorder, session: Session) -> None:
        """`run`, and record each equilibrium, that of the dead load first; ``session`` keeps checkpoints and may
        restart from one. Raises Interrupted."""
        if session.resumed is not None:
            self._restore(session.resumed)
        else:
            self._rest()
            self._taken[:] = 0.0, 0.0, elastic_energy(for_kernels(self.state), None)
            self._write(recorder)
        session.last_told = time.monotonic()  # so short a search needs no progress report at its start
        with interrupts.deferred():
            while self.found["status"] == RUNNING:
                session.pause(self)
                memory = SimpleNamespace(**joint_families.memory(self.state))
                self._follow(1)
                self.show()
                self._taken[1] += joint_families.friction_work(self.state, memory)
                self._write(recorder)

    def _write(self, recorder: Recorder) -> None:
        external, friction, before = self._taken
        terms, number = {"external": external, "friction": friction}, int(self.found["equilibria"])
        recorder.write_equilibrium(self.state, number, before, self.lone.bracket[0], terms)
        recorder.drain()

    @property
    def where(self) -> str:
        return f"equilibrium {int(self.found['equilibria'])}"

    @property
    def progress(self) -> Progress:
        return Progress("equilibrium", int(self.found["equilibria"]))

    def snapshot(self) -> dict[str, np.ndarray]:
        """Everything as arrays. Between two equilibria the history of the joint is that of the state."""
        return {**flattened({"state": self.state, "basis": self.lone.basis}), **self._path()}

    def _path(self) -> dict[str, np.ndarray]:
        names = ("base", "direction", "secant", "bracket", "twist", "seen", "search")
        path = {f"lone.{name}": plain(getattr(self.lone, name)) for name in names}
        return path | {"lone.motion_at_rest": self._motion_at_rest, "lone.taken": self._taken}

    def _restore(self, snapshot: Snapshot) -> None:
        """Restart from a snapshot of the same scene; HistoryError if it is of another."""
        restored_state(self.state, snapshot)
        restored("basis", self.lone.basis, snapshot)
        for name, own in self._path().items():
            own[...] = snapshot.array(name, own)
        found = self.found
        counts = all(float(found[name]).is_integer() for name in ("equilibria", "iterations"))
        begun = counts and 0.0 <= found["equilibria"] < MOST_EQUILIBRIA and 0.0 < found["step"] < np.inf
        if not (begun and found["status"] == RUNNING):
            raise HistoryError(f"{snapshot.path}: this checkpoint holds no equilibrium of this run")
        memory = SimpleNamespace(points=self.lone.point_memory, areas=self.lone.area_memory)
        given = joint_families.memory_arrays(self.state)
        for name, own in joint_families.memory_arrays(memory).items():
            own[...] = given[name]

    @property
    def moved(self) -> np.ndarray:
        """Displacements (n, 3) m of the blocks since the dead-load equilibrium."""
        moved = np.zeros_like(self.state.blocks.displacement)
        moved[self._block] = self._of_block(self.lone.base[0] - self._motion_at_rest)[0]
        return moved

    def certificate(self) -> Certificate:
        """Certificate of the bracket, in the form of other searches."""
        basis, found = self.lone.basis, self.found
        strict, dead_gauge, radius, normal, tilts = (float(value) for value in basis.scalars[0])
        return Certificate(
            every=1, strict=strict == 1.0, joint=0, family=joint_families.number(self.state), index=0,
            unit=basis.unit[0], dead=basis.dead[0], dead_gauge=dead_gauge, centre=basis.centre[0], radius=radius,
            normal=normal, rest=basis.rest, tilts=tilts == 1.0, tolerance=self.tolerance, bracket=self.lone.bracket[0],
            elastic=1.0 / found["compliance"] if found["compliance"] else 0.0, doubling=None,
            twist=self.lone.twist[0], window=None,
        )  # fmt: skip

    def show(self) -> None:
        """Update the block and the actuators of the state to the present equilibrium, and the velocities to the last
        step; add the work of the loads since the last call."""
        blocks, actuators = self.state.blocks, self.state.actuators
        block, found, before = self._block, self.found, self._motion()
        blocks.displacement[block], blocks.rotation[block] = self._of_block(self.lone.base[0])
        step = float(found["moved"]) * self.lone.direction[0]
        blocks.velocity[block], blocks.spin[block] = self._of_block(step)
        move_actuators(self.state)
        weights = float(np.abs(actuators.weight).sum())
        driven, load = float((actuators.weight * actuators.displacement).sum()) / weights, float(found["load"])
        now = actuators.driven[0]
        self._taken[0] += 0.5 * (float(now.load) + load) * weights * (driven - float(now.displacement))
        self._taken[0] += float(self._dead @ (self._motion() - before))
        now.head, now.displacement, now.load = driven, driven, load
        peak_at = driven + (float(found["peak_at"]) - float(found["driven"])) / weights
        now.peak, now.peak_at = float(found["peak"]), peak_at if found["peak"] else 0.0

    def _of_block(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Displacement and rotation of the free block for a motion ``u`` (6) of the joint."""
        d, r = (self._sense * u.reshape(2, 3)) @ self.state.joints.axes[0]
        return d - np.cross(r, self._arm), r

    def _motion(self) -> np.ndarray:
        blocks = self.state.blocks
        return np.concatenate([blocks.displacement[self._block], blocks.rotation[self._block]])
