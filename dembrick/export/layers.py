"""What an export shows: blocks, joints and contact points as cells that move, with their quantities.

| layer | cells | quantities |
|---|---|---|
| blocks | the faces of all blocks | block; displacement, velocity, spin, kinetic_energy; displacement of every vertex |
| joints | the polygons, riding on their hosts | joint, block_a, block_b; N, V_1, V_2, V, M_T, M_1, M_2, slip, utilisation, state, open_share, torsion_centre, torsion_centre_joint; opening at every corner |
| contacts | a vertex a contact point | joint; force on block b, normal_force |

SI units, world axes. ``state``: 0 closed, 1 partly open, 2 open. ``torsion_centre`` is in the world,
``torsion_centre_joint`` along t1 and t2 from O; NaN where there is none. A convex joint has one contact, where its
resultant passes.
"""  # noqa: E501 - a table

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dembrick.block_motion import CarriedPoints, Poses, all_vertices, block_quantities
from dembrick.history import History
from dembrick.joint_motion import CHANNELS, JointMotion, torsion_centre
from dembrick.shapes import rotation_matrix

LAYERS = ("blocks", "joints", "contacts")


@dataclass(frozen=True, slots=True)
class Frames:
    """Some moments: ``points`` (f, n, 3) m, and values by name at points and in cells, (f, n or n_cell, ...)."""

    points: np.ndarray
    at_points: dict[str, np.ndarray]
    cells: dict[str, np.ndarray]


class Layer(Protocol):
    """Cells that keep their corners while the points move; ``fixed``: cell values that never change."""

    kind: str
    cells: list[tuple[int, ...]]
    fixed: dict[str, np.ndarray]

    def frames(self, start: int, stop: int) -> Frames: ...


def layers(
    history: History, report: Callable[[str], None] | None = None, only: Collection[str] = LAYERS
) -> Iterator[tuple[str, Layer]]:
    """The layers ``only`` that a history can fill, with the suffix of its file; ``report`` hears what is missing."""
    report = report or (lambda _: None)
    if "blocks" in only:
        blocks = Blocks(history)
        if not blocks.recorded:
            report('velocities were not recorded: taken from the frames; "velocity" in output.channels records them')
        yield "", blocks
    if not (history.n_joint and {"joints", "contacts"} & set(only)):
        return
    forces = history.has_joints and history.n_row > 0
    if not forces:
        report('the forces of the joints were not recorded; run again with "joints" in output.channels')
    joints = JointMotion(history)
    if "joints" in only:
        yield "_joints", Joints(history, joints, forces)
    recorded = history.frame_values("contact_force", 0, 1) is not None
    if "contacts" in only and (recorded or forces):
        if not recorded and joints.point_start[-1]:
            report('contact forces were not recorded: only normal forces are shown; "contacts" in output.channels '
                   "records them")  # fmt: skip
        yield "_contacts", Contacts(history, joints, forces)


class Blocks:
    """The faces of all blocks."""

    kind = "Polygons"

    def __init__(self, history: History):
        self._history = history
        self.recorded = history.frame_values("velocity", 0, 1) is not None
        body, block, starts = all_vertices(history)
        self.cells, owner = [], []
        for i in range(history.n_block):
            for face in history.block_faces(i):
                self.cells.append(tuple(starts[i] + number for number in face))
                owner.append(i)
        self._owner = np.array(owner, np.int64)
        self.fixed = {"block": self._owner}
        self._motion = CarriedPoints(history, body, block)

    def frames(self, start: int, stop: int) -> Frames:
        """Frames start to stop."""
        history = self._history
        poses = Poses.read(history, start, stop)
        found = block_quantities(history, poses, start, stop)
        cells = {name: values.astype(np.float32).take(self._owner, axis=1) for name, values in found.items()}
        moved = self._motion.moved(poses).astype(np.float32)
        return Frames(self._motion.points(poses), {"displacement": moved}, cells)


class Joints:
    """The polygons of the joints."""

    kind = "Polygons"

    def __init__(self, history: History, joints: JointMotion, forces: bool):
        self._history, self._joints, self._forces = history, joints, forces
        starts = np.cumsum([0, *joints.n_corner]).tolist()
        self.cells = [tuple(range(a, b)) for a, b in zip(starts, starts[1:], strict=False)]
        self._there = np.arange(joints.polygon.shape[1]) < joints.n_corner[:, None]
        own = np.repeat(np.arange(joints.n_joint), joints.n_corner)
        self._motion = CarriedPoints(history, *_on_hosts(history, joints, own, joints.polygon[self._there]))
        self.fixed = {"joint": np.arange(joints.n_joint), "block_a": joints.block_a, "block_b": joints.block_b}

    def frames(self, start: int, stop: int) -> Frames:
        """Frames start to stop."""
        joints, poses = self._joints, Poses.read(self._history, start, stop)
        first = max(start - 1, 0)
        relative = joints.relative(range(first, stop))
        now = relative[start - first :]
        centre = torsion_centre(relative[:-1], relative[1:])
        if first == start:
            centre = np.concatenate([np.full((1, *centre.shape[1:]), np.nan), centre])
        centre[now.state == 2] = np.nan
        cells = {}
        if self._forces:
            resultants = joints.resultants(range(start, stop))
            cells = {name: resultants[..., i] for i, name in enumerate(CHANNELS)}
            cells["V"] = np.hypot(cells["V_1"], cells["V_2"])
            cells["utilisation"] = joints.utilisation(range(start, stop))
        cells["open_share"] = now.open_share
        axes = joints.axes_in(poses.rotation)
        origin = joints.origin_in(poses.position, poses.rotation)
        cells["torsion_centre"] = origin + np.einsum("fji,fjik->fjk", centre, axes[:, :, :2])
        cells["torsion_centre_joint"] = centre
        cells = {name: values.astype(np.float32) for name, values in cells.items()}
        cells["state"] = now.state.astype(np.int32)
        opening = now.opening[:, self._there].astype(np.float32)
        return Frames(self._motion.points(poses), {"opening": opening}, cells)


class Contacts:
    """The contact points, riding on the hosts of their joints, and the point of a convex joint's resultant."""

    kind = "Vertices"

    def __init__(self, history: History, joints: JointMotion, forces: bool):
        self._history, self._joints = history, joints
        self._recorded = history.frame_values("contact_force", 0, 1) is not None
        counts = np.diff(joints.point_start)
        arms = np.concatenate([np.zeros((0, 2)), *(joint["normal_arms"] for joint in history.joints)])
        self._own = np.repeat(np.arange(joints.n_joint), counts)
        self._motion = CarriedPoints(history, *_on_hosts(history, joints, self._own, arms))
        self._convex = np.flatnonzero(counts == 0) if forces else np.zeros(0, np.int64)
        owner = np.concatenate([self._own, self._convex])
        self.cells = [(i,) for i in range(len(owner))]
        self.fixed = {"joint": owner}

    def frames(self, start: int, stop: int) -> Frames:
        """Frames start to stop."""
        history, joints, poses = self._history, self._joints, Poses.read(self._history, start, stop)
        axes = joints.axes_in(poses.rotation)
        data = {}
        if self._recorded:
            data["force"] = history.frame_values("contact_force", start, stop)
            data["normal_force"] = (data["force"] * axes[:, self._own, 2]).sum(axis=2)
        else:
            data["normal_force"] = joints.normal_forces(range(start, stop))
        points = self._motion.points(poses)
        if len(self._convex):
            resultants, axes = joints.resultants(range(start, stop))[:, self._convex], axes[:, self._convex]
            N = resultants[..., 0]
            pressed = N > 0.0
            at = np.stack([resultants[..., 5], -resultants[..., 4]], axis=2)
            at = np.divide(at, N[..., None], out=np.zeros_like(at), where=pressed[..., None])
            origin = joints.origin_in(poses.position, poses.rotation)[:, self._convex]
            points = np.concatenate([points, origin + np.einsum("fji,fjik->fjk", at, axes[:, :, :2])], axis=1)
            # the joint holds b against V_1 and V_2 and carries it with N
            own = np.stack([-resultants[..., 1], -resultants[..., 2], N], axis=2)
            force = np.einsum("fji,fjik->fjk", own, axes)
            if "force" in data or not len(self._own):
                data["force"] = np.concatenate([data.get("force", np.zeros((len(N), 0, 3))), force], axis=1)
            data["normal_force"] = np.concatenate([data["normal_force"], N], axis=1)
        return Frames(points, {name: values.astype(np.float32) for name, values in data.items()}, {})


def _on_hosts(history: History, joints: JointMotion, own: np.ndarray, arms: np.ndarray):
    """Points of joints ``own`` (n,) at ``arms`` (n, 2) in the body axes of the hosts, and the hosts."""
    host = joints.host[own]
    world = joints.origin[own] - history.position0[host] + np.einsum("ni,nik->nk", arms, joints.axes[own, :2])
    return np.einsum("nji,nj->ni", rotation_matrix(history.orientation0)[host], world), host
