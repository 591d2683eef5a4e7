"""Loads of a recorded run as arrows: where each ends on its block, so that it is seen outside the stone."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dembrick.geometry.rotations import rotation_matrix
from dembrick.scenario.pressures import PRESSURE

if TYPE_CHECKING:
    from dembrick.history.reader import History

BODY_FORCE = "load on "  # begins the name of the load of a block that is tilted or pushed as a whole
_ON_FACE = 1e-6  # of a block's size: a point so near to a face lies on it
_ALONG = 0.05  # of a direction: what is less across a face goes along it


class Place(NamedTuple):
    """Where the arrow of a load ends: ``shift`` (m) along its direction from the point of application to its tip, or to
    its tail if it ``pulls``."""

    shift: float
    pulls: bool


class Load(NamedTuple):
    """A load on ``block`` at ``arm`` (3,) m from its centroid, world axes at the start, along ``way`` (3,), of some
    ``size``: the weight of an actuator, N of a dead load."""

    block: int
    arm: np.ndarray
    way: np.ndarray
    size: float
    place: Place


def driven_loads(history: History) -> list[Load]:
    """The actuators and driven pressures, in the order of the history."""
    found = []
    for actuator in history.actuators:
        arm = actuator["point"] - history.position0[actuator["block"]]
        force = actuator["direction"] * actuator["weight"]
        of_body = actuator["name"].startswith(BODY_FORCE)
        found.append(_load(history, actuator["block"], arm, force, of_body))
    return found


def dead_loads(history: History) -> list[Load]:
    """The dead loads besides gravity, pressures as one resultant a face; none of them zero."""
    found = []
    for load in history.loads:
        arm = load["point"] - history.position0[load["block"]]
        if np.linalg.norm(load["force"]) > 0.0:
            found.append(_load(history, load["block"], arm, load["force"], False))
    return found


def is_pressure(name: str) -> bool:
    """Whether an actuator of that name is a driven pressure."""
    return name.startswith(PRESSURE)


def _load(history: History, block: int, arm: np.ndarray, force: np.ndarray, of_body: bool) -> Load:
    size = float(np.linalg.norm(force))
    way = force / size if size else np.array([0.0, 0.0, 1.0])
    place = Place(0.0, True) if of_body else arrow_place(history, block, arm, way)
    return Load(int(block), arm, way, size, place)


def arrow_place(history: History, block: int, arm: np.ndarray, way: np.ndarray) -> Place:
    """Where the arrow of a force along ``way`` (3,) at ``arm`` (3,) m of a block ends.

    One that presses on the face that its point lies on ends there; one that draws at its face begins there. Of any
    other, within the stone or along a face, the tip is where the line of action enters the block.
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
