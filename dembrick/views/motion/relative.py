"""The motion of a joint's block b against its block a since the start, as an observer on a sees it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from dembrick.geometry.rotations import rotation_vector
from dembrick.kernels.recorded_motion import openings, torsion_centres

STATES = ("closed", "partly open", "open")


@dataclass(frozen=True)
class RelativeMotion:
    """Motion of b against a since the start, in the joint's axes riding on a.

    ``shift`` (..., j, 3) m: from the point O of a to the point O of b; ``turn`` (..., j, 4): quaternion of b;
    ``plane`` (..., j, 3): the opening of the joint at O (m) and its slopes along t1 and t2, measured along the normal
    of the face that the polygon does not ride on. ``joints``: what a `JointMotion` says of their shapes. ``small``
    (..., j, 3) rad: the rotation vector where rotations are infinitesimal, else None.
    """

    joints: Any
    shift: np.ndarray
    turn: np.ndarray
    plane: np.ndarray
    small: np.ndarray | None = None

    def __getitem__(self, frame) -> RelativeMotion:
        """One of several frames."""
        small = None if self.small is None else self.small[frame]
        return RelativeMotion(self.joints, self.shift[frame], self.turn[frame], self.plane[frame], small)

    @property
    def rotation(self) -> np.ndarray:
        """(..., j, 3) rad: rotation vector r1, r2, rn, its length at most half a turn."""
        return rotation_vector(self.turn) if self.small is None else self.small

    @property
    def components(self) -> np.ndarray:
        """(..., j, 6) m, rad: d1, d2, dn, r1, r2, rn."""
        return np.concatenate([self.shift, self.rotation], axis=-1)

    @property
    def opening(self) -> np.ndarray:
        """(..., j, m) m: distance of the faces at the corners of the polygon, negative if they press."""
        return self._openings[0]

    @property
    def state(self) -> np.ndarray:
        """(..., j) int: index into ``STATES``; faces are apart where it is by more than rounding."""
        return self._openings[1]

    @property
    def open_share(self) -> np.ndarray:
        """(..., j): the part of the polygon's area over which the faces are apart."""
        return self._openings[2]

    @cached_property
    def _openings(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        joints, (plane,) = self.joints, _frames_first(self.plane)
        shape, corners = plane.shape[:2], joints.polygon.shape[1]
        opening, state, share = np.empty((*shape, corners)), np.empty(shape, np.int64), np.empty(shape)
        openings(plane, joints.polygon, joints.size, joints.area, opening, state, share)
        shape = self.plane.shape[:-1]
        return opening.reshape(*shape, corners), state.reshape(shape), share.reshape(shape)

    def distance(self, points: np.ndarray, which) -> np.ndarray:
        """(..., m) m: distance of the faces at points (..., m, 2), one row of points a joint of ``which``."""
        plane = self.plane[..., which, :, None]
        return plane[..., 0, :] + plane[..., 1, :] * points[..., 0] + plane[..., 2, :] * points[..., 1]

    def slip(self, joint: int, points: np.ndarray) -> np.ndarray:
        """(..., k, 2) m: movement of b over a along t1 and t2 at points (k, 2) of one joint, elastic part included.

        The shear arms of the contact points, or a :meth:`JointMotion.grid`.
        """
        points = np.asarray(points, float)
        flat = np.concatenate([points, np.zeros((len(points), 1))], axis=1)
        if self.small is None:
            turning = _turning(self.turn[..., joint, None, :], flat)
        else:
            turning = np.cross(self.small[..., joint, None, :], flat)
        return (self.shift[..., joint, None, :] + turning)[..., :2]


def torsion_centre(first: RelativeMotion, second: RelativeMotion) -> np.ndarray:
    """(..., j, 2) m: where b turned about from one motion to the other, from O in the joint's axes riding on a.

    The material point of b that comes back to its place in the joint's plane. NaN if nothing moved, where the
    increment is pure shear, and where it is mostly a tilt.
    """
    found = np.empty((*first.shift.shape[:-1], 2))
    both = _frames_first(first.shift, first.turn, second.shift, second.turn)
    torsion_centres(*both, first.joints.size, *_frames_first(found))
    return found


def _frames_first(*arrays: np.ndarray) -> list[np.ndarray]:
    """Views (f, j, n) of arrays (..., j, n)."""
    return [array.reshape(-1, *array.shape[-2:]) for array in arrays]


def _turning(quaternion: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """R v - v, without the loss of digits of small rotations: 2 w (u x v) + 2 u x (u x v)."""
    w, x, y, z = (quaternion[..., i] for i in range(4))
    a, b, c = (vectors[..., i] for i in range(3))
    p, q, r = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    found = np.empty((*p.shape, 3))
    found[..., 0] = w * p + y * r - z * q
    found[..., 1] = w * q + z * p - x * r
    found[..., 2] = w * r + x * q - y * p
    return found
