"""Layers of an export: blocks, joints and contacts as moving cells, with their quantities.

| layer | cells | quantities |
|---|---|---|
| blocks | the faces of all blocks | block; displacement, velocity, spin, kinetic_energy; displacement of every vertex |
| joints | the polygons, moving with their hosts | joint, block_a, block_b; N, V_1, V_2, V, M_T, M_1, M_2, slip, utilisation, state, open_share, torsion_centre, torsion_centre_joint; opening at every corner |
| ties | one line per tie | block_a, block_b; tension, yielded |
| contacts | one vertex per contact point | joint; force on block b, normal_force |
| new_contacts | one vertex per contact formed during the run; their number varies by frame | block_a, block_b; force and torque on block b, normal, normal_force, area, slip |

SI units, world axes. ``state``: 0 closed, 1 partly open, 2 open. ``torsion_centre`` is in world coordinates,
``torsion_centre_joint`` along t1 and t2 from O; NaN if there is none. A convex joint has one contact, where the
line of action of its force meets the face to which the polygon is attached. A joint of several pieces has a polygon for
each, all with the quantities of the whole joint.
"""  # noqa: E501 - a table

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from dembrick.geometry.rotations import rotation_matrix
from dembrick.history import History
from dembrick.views.motion.blocks import CarriedPoints, Poses, all_vertices, block_quantities
from dembrick.views.motion.joint_frames import CHANNELS, JointFrames
from dembrick.views.motion.joints import STATES, JointMotion
from dembrick.views.motion.loads import TieMotion
from dembrick.views.motion.relative import RelativeMotion, torsion_centre

LAYERS = ("blocks", "joints", "contacts", "ties")  # contacts include the new ones of runs that can have any


@dataclass(frozen=True, slots=True)
class Frames:
    """Data of f frames: ``points`` (f, n, 3) m; by name, values ``at_points`` (f, n, ...) and of ``cells``
    (f, n_cell, ...)."""

    points: np.ndarray
    at_points: dict[str, np.ndarray]
    cells: dict[str, np.ndarray]


class Span:
    """Frames start to stop of a history; quantities that several layers use are read and computed once."""

    def __init__(self, history: History, joints: JointMotion | None, start: int, stop: int):
        self._joints, self.history, self.start, self.stop = joints, history, start, stop

    @cached_property
    def poses(self) -> Poses:
        return Poses.read(self.history, self.start, self.stop)

    @cached_property
    def joints(self) -> JointFrames:
        return self._joints.at(range(self.start, self.stop))

    @property
    def before(self) -> RelativeMotion | None:
        """The motion of the joints in the frame before the first."""
        return self._joints.at([self.start - 1]).relative if self.start else None


class Layer(Protocol):
    """Cells with constant connectivity whose points move; ``fixed``: cell values that do not change with time;
    ``frames``: points and values of the frames of a span."""

    kind: str
    cells: list[tuple[int, ...]]
    fixed: dict[str, np.ndarray]
    n_point: int

    def frames(self, span: Span) -> Frames: ...


class Picture:
    """Those layers of ``only`` for which a history has data, by file suffix; ``report`` is called with what is missing.

    ``scattered``: the layers whose cells change from frame to frame.
    """

    def __init__(self, history: History, report: Callable[[str], None] | None = None, only: Collection[str] = LAYERS):
        self._history, self._joints = history, None
        self.layers: dict[str, Layer] = {}
        self.scattered: dict[str, NewContacts] = {}
        report = report or (lambda _: None)
        if "blocks" in only:
            self.layers[""] = blocks = Blocks(history)
            if not (blocks.recorded or history.counts_equilibria):
                report(
                    'velocities were not recorded: taken from the frames; "velocity" in output.channels records them'
                )
        if "ties" in only and history.n_tie:
            self.layers["_ties"] = Ties(history)
        if "contacts" in only and history.has_new_contacts:
            self.scattered["_new_contacts"] = NewContacts(history)
        elif "contacts" in only and history.in_real_time and history.new_contacts.any():
            report('the forces of new contacts were not recorded; "contacts" in output.channels records them')
        if not (history.n_joint and {"joints", "contacts"} & set(only)):
            return
        forces = history.has_joints and history.n_row > 0
        if not forces:
            report('the forces of the joints were not recorded; run again with "joints" in output.channels')
        self._joints = joints = JointMotion(history)
        if "joints" in only:
            self.layers["_joints"] = Joints(history, joints, forces)
        recorded = history.frame_values("contact_force", 0, 1) is not None
        if "contacts" in only and (recorded or forces):
            if not recorded and joints.point_start[-1]:
                report('contact forces were not recorded: only normal forces are shown; "contacts" in output.channels '
                       "records them")  # fmt: skip
            self.layers["_contacts"] = Contacts(history, joints, forces)

    def span(self, start: int, stop: int) -> Span:
        """Frames start to stop."""
        return Span(self._history, self._joints, start, stop)


class Blocks:
    """The faces of all blocks."""

    kind = "Polygons"

    def __init__(self, history: History):
        self.recorded = history.frame_values("velocity", 0, 1) is not None
        body, block, starts = all_vertices(history)
        self.cells, owner = [], []
        for i in range(history.n_block):
            for face in history.block_faces(i):
                self.cells.append(tuple(starts[i] + number for number in face))
                owner.append(i)
        self._owner = np.array(owner, np.int64)
        self.fixed = {"block": self._owner}
        self.n_point = len(block)
        self._motion = CarriedPoints(history, body, block)

    def frames(self, span: Span) -> Frames:
        poses = span.poses
        found = block_quantities(span.history, poses, span.start, span.stop)
        cells = {name: values.astype(np.float32).take(self._owner, axis=1) for name, values in found.items()}
        moved = self._motion.moved(poses).astype(np.float32)
        return Frames(self._motion.points(poses), {"displacement": moved}, cells)


class Joints:
    """The polygons of the joints, one for each convex piece."""

    kind = "Polygons"

    def __init__(self, history: History, joints: JointMotion, forces: bool):
        self._forces = forces
        corners = [own for of_joint in joints.pieces for own in of_joint]
        self._owner = owner = np.repeat(np.arange(joints.n_joint), [len(of_joint) for of_joint in joints.pieces])
        starts = np.cumsum([0, *map(len, corners)]).tolist()
        self.cells = [tuple(range(a, b)) for a, b in zip(starts, starts[1:], strict=False)]
        self.n_point = starts[-1]
        self._corner = own, number = np.repeat(owner, np.diff(starts)), np.concatenate(corners)
        self._motion = CarriedPoints(history, *_on_hosts(history, joints, own, joints.polygon[own, number]))
        self.fixed = {"joint": owner, "block_a": joints.block_a[owner], "block_b": joints.block_b[owner]}

    def frames(self, span: Span) -> Frames:
        joints = span.joints
        now, before = joints.relative, span.before
        centre = np.full((*now.state.shape, 2), np.nan)
        if before is not None:
            centre[:1] = torsion_centre(before, now[:1])
        centre[1:] = torsion_centre(now[:-1], now[1:])
        centre[now.state == STATES.index("open")] = np.nan
        cells = {}
        if self._forces:
            resultants = joints.about_start
            cells = {name: resultants[..., i] for i, name in enumerate(CHANNELS)}
            cells["V"] = np.hypot(cells["V_1"], cells["V_2"])
            cells["utilisation"] = joints.utilisation
        cells["open_share"] = now.open_share
        cells["torsion_centre"] = joints.origin + np.einsum("fji,fjik->fjk", centre, joints.axes[:, :, :2])
        cells["torsion_centre_joint"] = centre
        cells = {name: values.astype(np.float32) for name, values in cells.items()}
        cells["state"] = now.state.astype(np.int32)
        cells = {name: values.take(self._owner, axis=1) for name, values in cells.items()}
        own, number = self._corner
        opening = now.opening.astype(np.float32)[:, own, number]
        return Frames(self._motion.points(span.poses), {"opening": opening}, cells)


class Contacts:
    """The contact points, moving with the hosts of their joints, and the point of a convex joint's resultant."""

    kind = "Vertices"

    def __init__(self, history: History, joints: JointMotion, forces: bool):
        counts = np.diff(joints.point_start)
        arms, _, _, own = joints.points
        body, self._host = _on_hosts(history, joints, own, arms)
        self._motion, self._arms = CarriedPoints(history, body, self._host), arms
        turn = rotation_matrix(history.orientation0)[self._host]
        self._tangents = np.einsum("nji,nkj->nki", turn, joints.axes[own, :2])  # body axes of the hosts
        self._convex = np.flatnonzero(counts == 0) if forces else np.zeros(0, np.int64)
        owner = np.concatenate([own, self._convex])
        self.n_point = len(owner)
        self.cells = [(i,) for i in range(len(owner))]
        self.fixed = {"joint": owner}

    def frames(self, span: Span) -> Frames:
        joints, points = span.joints, self._places(span)
        force, normal = joints.point_forces, joints.normal_forces
        if len(self._convex):
            resultants = joints.resultants[:, self._convex]
            N, V_1, V_2 = np.moveaxis(resultants[..., :3], -1, 0)
            axes, at = joints.acting_axes[:, self._convex], joints.pressure_place[:, self._convex]
            own = np.einsum("fji,fjik->fjk", np.stack([-V_1, -V_2, N], axis=-1), axes)
            if not points.size:
                force = own
            elif force is not None:
                force = np.concatenate([force, own], axis=1)
            points = np.concatenate([points, at], axis=1)
            normal = np.concatenate([normal, resultants[..., 0]], axis=1)
        data = {"normal_force": normal} if force is None else {"force": force, "normal_force": normal}
        return Frames(points, {name: values.astype(np.float32) for name, values in data.items()}, {})

    def _places(self, span: Span) -> np.ndarray:
        """Positions of the points (f, c, 3) m; in a polygon that was cut they have moved on their host."""
        points = self._motion.points(span.poses)
        arms = span.history.frame_values("contact_arm", span.start, span.stop)
        if arms is None:
            return points
        moved = np.flatnonzero((arms != self._arms).any(axis=(0, 2)))
        if len(moved):
            away = np.einsum("fci,cik->fck", arms[:, moved] - self._arms[moved], self._tangents[moved])
            points[:, moved] += np.einsum("fcik,fck->fci", span.poses.rotation[:, self._host[moved]], away)
        return points


class Ties:
    """The ties as lines between their ends."""

    kind = "Lines"

    def __init__(self, history: History):
        self._motion = TieMotion(history)
        self.n_point = 2 * self._motion.count
        self.cells = [(i, i + 1) for i in range(0, self.n_point, 2)]
        blocks = self._motion.blocks
        self.fixed = {"block_a": blocks[:, 0], "block_b": blocks[:, 1]}

    def frames(self, span: Span) -> Frames:
        found = {name: self._motion.series(name, span.start, span.stop) for name in ("tension", "yielded")}
        cells = {name: values.astype(np.float32) for name, values in found.items()}
        return Frames(self._motion.ends(span.poses), {}, cells)


class NewContacts:
    """The contacts that formed during the run and carry a force: a vertex at the centre of pressure of each."""

    def __init__(self, history: History):
        self._history = history

    def frames(self, start: int, stop: int) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
        """Frames start to stop: offsets of the vertices of each frame (f + 1,), all points (c, 3) m, and values by
        name (c, ...)."""
        starts, found = self._history.frame_new_contacts(start, stop)
        blocks, normal, force = (found[name] for name in ("blocks", "normal", "force"))
        values = {"force": force, "normal_force": (force * normal).sum(axis=1), "normal": normal}
        values |= {name: found[name] for name in ("torque", "area", "slip")}
        values = {name: value.astype(np.float32) for name, value in values.items()}
        return starts, found["point"], {**values, "block_a": blocks[:, 0], "block_b": blocks[:, 1]}


def _on_hosts(history: History, joints: JointMotion, own: np.ndarray, arms: np.ndarray):
    """Points at ``arms`` (n, 2) m in joints ``own`` (n,): in the body axes of the hosts (n, 3) m, and the hosts."""
    host = joints.host[own]
    world = joints.origin[own] - history.position0[host] + np.einsum("ni,nik->nk", arms, joints.axes[own, :2])
    return np.einsum("nji,nj->ni", rotation_matrix(history.orientation0)[host], world), host
