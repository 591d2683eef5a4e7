"""Loads and ties of a recorded run: placement of load arrows outside their blocks; ends and forces of ties."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dembrick.assembly.actuators import BODY_FORCE
from dembrick.geometry.rotations import rotation_matrix
from dembrick.views.motion.blocks import CarriedPoints, Poses
from dembrick.views.motion.frames import nearest

if TYPE_CHECKING:
    from dembrick.history.reader import History


_BEFORE = 0.05  # of a structure's extent: gap between it and the tip of the arrow of the forces on all its blocks
_ON_FACE = 1e-6  # of a block's size: a point this close to a face lies on it
_ALONG = 0.05  # normal component of a unit direction below which it counts as parallel to a face


class Place(NamedTuple):
    """Placement of the arrow of a load: ``shift`` (m) along its direction from the point of application to its tip, or
    to its tail if it ``pulls``."""

    shift: float
    pulls: bool


class Load(NamedTuple):
    """A load on ``block`` at ``arm`` (3,) m from its centroid, in world axes at the start, along the unit vector
    ``way`` (3,). ``size``: the weight of an actuator, or the size of a dead load in N; ``place``: of its arrow."""

    block: int
    arm: np.ndarray
    way: np.ndarray
    size: float
    place: Place


def driven_loads(history: History) -> list[Load]:
    """The actuators and driven pressures, in the order of the history; forces on all blocks as their resultant."""
    actuators = history.actuators
    if all_of(history, BODY_FORCE):
        return _resultant(history)
    return [
        _load(
            history,
            actuator["block"],
            actuator["point"] - history.position0[actuator["block"]],
            actuator["direction"] * actuator["weight"],
        )
        for actuator in actuators
    ]


def _resultant(history: History) -> list[Load]:
    """The resultant of the forces on all blocks as a load attached to a support, whose arrow ends in front of the
    structure; empty if they balance."""
    forces = np.array([actuator["direction"] * actuator["weight"] for actuator in history.actuators])
    size, total = np.linalg.norm(forces, axis=1), forces.sum(axis=0)
    most = float(np.linalg.norm(total))
    if most <= _ALONG * float(size.sum()):
        return []
    block, way = int(np.argmax(history.block_fixed)), total / most
    point = size @ np.array([actuator["point"] for actuator in history.actuators]) / size.sum()
    corners = np.concatenate(
        [
            history.position0[i] + history.block_vertices(i) @ rotation_matrix(history.orientation0[i]).T
            for i in {actuator["block"] for actuator in history.actuators}
        ]
    )
    along = (corners - point) @ way
    shift = float(along.min()) - _BEFORE * float(np.ptp(along))
    return [Load(block, point - history.position0[block], way, most, Place(shift, False))]


def dead_loads(history: History) -> list[Load]:
    """The dead loads other than gravity that are not zero; pressures as one resultant per face."""
    found = []
    for load in history.loads:
        arm = load["point"] - history.position0[load["block"]]
        if np.linalg.norm(load["force"]) > 0.0:
            found.append(_load(history, load["block"], arm, load["force"]))
    return found


def all_of(history: History, kind: str) -> bool:
    """Whether there are actuators and all of them are of one ``kind`` of `assembly.actuators.KINDS`."""
    return {actuator["kind"] for actuator in history.actuators} == {kind}


def _load(history: History, block: int, arm: np.ndarray, force: np.ndarray) -> Load:
    size = float(np.linalg.norm(force))
    way = force / size if size else np.array([0.0, 0.0, 1.0])
    return Load(int(block), arm, way, size, arrow_place(history, block, arm, way))


def arrow_place(history: History, block: int, arm: np.ndarray, way: np.ndarray) -> Place:
    """Placement of the arrow of a force along ``way`` (3,) at ``arm`` (3,) m of a block.

    A force that pushes on the face that contains its point ends there; one that pulls on it begins there. For any
    other, inside the block or parallel to a face, the tip is where the line of action enters the block.
    """
    corners = history.block_vertices(block) @ rotation_matrix(history.orientation0[block]).T
    size, entry = float(np.ptp(corners, axis=0).max()), -np.inf
    for face in history.block_faces(block):
        own = corners[list(face)]
        normal = np.cross(own - own[0], np.roll(own, -1, axis=0) - own[0]).sum(axis=0)
        length = np.linalg.norm(normal)
        if not length > 0.0:
            continue
        across, inside = float(normal @ way) / length, float(normal @ (own[0] - arm)) / length
        if abs(inside) <= _ON_FACE * size and abs(across) > _ALONG:
            return Place(0.0, bool(across > 0.0))
        if across < 0.0:
            entry = max(entry, inside / across)
    return Place(min(entry, 0.0) if np.isfinite(entry) else 0.0, False)


def leaving(history: History, block: int, way: np.ndarray) -> Load:
    """The displacement ``way`` (3,) m of a block as a load whose arrow begins where the line from its centroid leaves
    the block."""
    size, corners = float(np.linalg.norm(way)), history.block_vertices(block)
    along = corners @ rotation_matrix(history.orientation0[block]).T @ way / size
    return Load(block, np.zeros(3), way / size, size, Place(float(along.max(initial=0.0)), True))


class TieMotion:
    """The t ties of a history, moving with their blocks."""

    def __init__(self, history: History):
        self._history, self.count = history, history.n_tie
        block = np.array([tie["blocks"] for tie in history.ties], np.int64).reshape(-1)
        point = np.array([tie["points"] for tie in history.ties], float).reshape(-1, 3)
        turn = rotation_matrix(history.orientation0)[block]
        body = np.einsum("nji,nj->ni", turn, point - history.position0[block])
        self.blocks, self._ends = block.reshape(-1, 2), CarriedPoints(history, body, block)

    def ends(self, poses: Poses, factor: float = 1.0) -> np.ndarray:
        """Ends (f, 2 t, 3) m, one tie after the other, with the motion of the blocks times ``factor``."""
        return self._ends.magnified(poses, factor)

    def series(self, name: str, start: int, stop: int) -> np.ndarray:
        """``tension`` (N) or ``yielded`` (m) in the frames start to stop (f, t)."""
        history = self._history
        if not history.n_row:
            return np.zeros((stop - start, self.count))
        return history.series(name)[nearest(history.time, history.frame_time[start:stop])]
