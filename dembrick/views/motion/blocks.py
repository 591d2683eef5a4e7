"""Blocks of a recorded run in its frames: positions of their points, velocities.

Shapes begin with the requested frames: (f, n_block, ...).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dembrick.geometry.rotations import quaternion_product, rotation_matrix, rotation_vector

if TYPE_CHECKING:
    from dembrick.history.reader import History

_MOVES = 0.1  # of the greatest displacement of a corner: a block with less counts as not moving


@dataclass(frozen=True, slots=True)
class Poses:
    """Poses of n blocks in f frames: ``position``, ``displacement`` (f, n, 3) m, ``orientation`` (f, n, 4), and
    ``rotation`` (f, n, 3, 3)."""

    position: np.ndarray
    displacement: np.ndarray
    orientation: np.ndarray
    rotation: np.ndarray

    @classmethod
    def read(cls, history: History, start: int, stop: int) -> Poses:
        orientation = history.frame_values("orientation", start, stop)
        return cls(
            history.frame_values("position", start, stop),
            history.frame_values("displacement", start, stop),
            orientation,
            rotation_matrix(orientation),
        )


class CarriedPoints:
    """Material points of blocks that move with them; ``body`` (n, 3) m in the body axes of ``block`` (n,)."""

    def __init__(self, history: History, body: np.ndarray, block: np.ndarray):
        self._rotation0 = rotation_matrix(history.orientation0)
        self._body, self._block = body, block

    def points(self, poses: Poses) -> np.ndarray:
        """World points (f, n, 3)."""
        return self.carried(poses.rotation, poses.position)

    def moved(self, poses: Poses) -> np.ndarray:
        """Displacement (f, n, 3) m since the start, to more digits than a difference of points has."""
        return self.carried(poses.rotation - self._rotation0, poses.displacement)

    def magnified(self, poses: Poses, factor: float) -> np.ndarray:
        """World points (f, n, 3) with the translation and the rotation angle of each block multiplied by ``factor``."""
        if factor == 1.0:
            return self.points(poses)
        turned = rotation_times(poses.rotation @ self._rotation0.swapaxes(1, 2), factor)
        return self.carried(turned @ self._rotation0, poses.position + (factor - 1.0) * poses.displacement)

    def carried(self, rotation: np.ndarray, shift: np.ndarray) -> np.ndarray:
        """Points (f, n, 3) under rotations (f, n_block, 3, 3) and shifts (f, n_block, 3)."""
        return np.einsum("fnij,nj->fni", rotation[:, self._block], self._body) + shift[:, self._block]


def all_vertices(history: History) -> tuple[np.ndarray, np.ndarray, list[int]]:
    """Vertices (n, 3) m of all blocks in their body axes, the block of each, and the offset of each block's first."""
    vertices = [history.block_vertices(i) for i in range(history.n_block)]
    counts = [len(own) for own in vertices]
    block = np.repeat(np.arange(history.n_block), counts)
    return np.concatenate([np.zeros((0, 3)), *vertices]), block, np.cumsum([0, *counts]).tolist()


def moving_blocks(history: History, frame: int) -> list[int]:
    """Numbers of the blocks that move in a frame, by more than a tenth of the greatest displacement; all blocks if none
    moves."""
    body, block, starts = all_vertices(history)
    way = np.linalg.norm(CarriedPoints(history, body, block).moved(Poses.read(history, frame, frame + 1))[0], axis=1)
    far = [float(way[a:b].max(initial=0.0)) for a, b in zip(starts, starts[1:], strict=False)]
    most = max(far, default=0.0)
    return [i for i, own in enumerate(far) if own > _MOVES * most] if most > 0.0 else list(range(len(far)))


def largest_extent(points: np.ndarray, starts: list[int], blocks: Iterable[int]) -> float:
    """Greatest extent of any of the blocks along an axis (m); block i has the points ``starts[i]:starts[i + 1]``."""
    return max(float(np.ptp(points[starts[i] : starts[i + 1]], axis=0).max()) for i in blocks)


def block_quantities(history: History, poses: Poses, start: int, stop: int) -> dict[str, np.ndarray]:
    """``displacement``, ``velocity``, ``spin`` (f, n_block, 3) and ``kinetic_energy`` (f, n_block); SI units.

    Velocities that were not recorded are means between the previous and the next frame. Quantities that the history
    cannot give are left out. A sequence of equilibria has no time, and so no velocities.
    """
    found = {"displacement": poses.displacement}
    if history.counts_equilibria:
        return found
    velocity = history.frame_values("velocity", start, stop)
    if velocity is not None:
        found["velocity"], found["spin"] = velocity, history.frame_values("spin", start, stop)
    elif history.n_frames > 1:
        found["velocity"], found["spin"] = mean_velocities(history, start, stop)
    mass, inertia = history.block_mass, history.block_inertia
    if mass is not None and inertia is not None and "velocity" in found:
        velocity, spin = found["velocity"], np.einsum("fnji,fnj->fni", poses.rotation, found["spin"])
        turning = np.einsum("fni,nij,fnj->fn", spin, inertia, spin, optimize=True)
        found["kinetic_energy"] = 0.5 * (mass * (velocity * velocity).sum(axis=2) + turning)
    return found


def rotation_times(rotation: np.ndarray, factor: float) -> np.ndarray:
    """Rotations (..., 3, 3) about the same axes by ``factor`` times the angles, at most half a turn."""
    skew = 0.5 * (rotation - rotation.swapaxes(-1, -2))
    sine = np.sqrt(skew[..., 2, 1] ** 2 + skew[..., 0, 2] ** 2 + skew[..., 1, 0] ** 2)
    angle = np.arctan2(sine, 0.5 * (np.trace(rotation, axis1=-2, axis2=-1) - 1.0))
    turning = sine > 1e-15
    cross = skew / np.where(turning, sine, 1.0)[..., None, None]
    angle = np.where(turning, np.minimum(angle * factor, np.pi), 0.0)[..., None, None]
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def mean_velocities(history: History, start: int, stop: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean velocity (m/s) and spin (rad/s) of the blocks (f, n, 3) between the previous and the next frame.

    Orientations in frames do not count full turns. A block is assumed to turn by less than half a turn from one frame
    to the next, hence by less than a full turn between the previous and the next.
    """
    last = history.n_frames - 1
    k = np.arange(start, stop)
    before, after = np.maximum(k - 1, 0), np.minimum(k + 1, last)
    first = before[0]
    displacement = history.frame_values("displacement", first, after[-1] + 1)
    orientation = history.frame_values("orientation", first, after[-1] + 1)
    time = history.frame_time
    duration = (time[after] - time[before])[:, None, None]
    duration[duration <= 0.0] = np.inf
    velocity = (displacement[after - first] - displacement[before - first]) / duration
    before, now, after = (orientation[number - first] for number in (before, k, after))
    turned, by_steps = _turn(before, after), _turn(before, now) + _turn(now, after)
    # of all rotations with the same final orientation, the nearest to the sum of the two steps
    axis = np.where(turned.any(axis=2, keepdims=True), turned, by_steps)
    size = np.linalg.norm(axis, axis=2, keepdims=True)
    axis = np.divide(axis, size, out=np.zeros_like(axis), where=size > 0.0)
    missed = ((by_steps - turned) * axis).sum(axis=2, keepdims=True)
    return velocity, (turned + 2.0 * np.pi * np.round(missed / (2.0 * np.pi)) * axis) / duration


def _turn(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Rotation vectors (..., 3) rad, of at most half a turn, from quaternions ``start`` to ``end`` (..., 4)."""
    return rotation_vector(quaternion_product(end, start * np.array([1, -1, -1, -1])))
