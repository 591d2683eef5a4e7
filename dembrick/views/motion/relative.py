"""The motion of a joint's block b relative to its block a since the start, as seen by an observer on a."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from dembrick.geometry.rotations import quaternion_product, rotation_vector, turning

STATES = ("closed", "partly open", "open")
TOUCHING = 1e-12  # of a joint's size: a smaller opening is rounding
STILL = 1e-13  # of a joint's size: a smaller increment is rounding
PURE = 1e-7  # of the slip at the joint's edge: a smaller rotational part of an increment counts as zero


@dataclass(frozen=True)
class RelativeMotion:
    """Motion of b relative to a since the start, in the joint's axes moving with a.

    ``shift`` (..., j, 3) m: from point O of a to point O of b; ``turn`` (..., j, 4): quaternion of b; ``plane``
    (..., j, 3): the opening of the joint at O (m) and its slopes along t1 and t2, measured along the normal of the face
    to which the polygon is not attached. ``joints``: the `JointMotion` with their shapes. ``small`` (..., j, 3) rad:
    the rotation vector if rotations are infinitesimal, else None.
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
        """(..., j, 3) rad: rotation vector r1, r2, rn, of at most half a turn."""
        return rotation_vector(self.turn) if self.small is None else self.small

    @property
    def components(self) -> np.ndarray:
        """(..., j, 6) m, rad: d1, d2, dn, r1, r2, rn."""
        return np.concatenate([self.shift, self.rotation], axis=-1)

    @cached_property
    def opening(self) -> np.ndarray:
        """(..., j, m) m: gap between the faces at the corners of the polygon, negative if they penetrate."""
        plane, corners = self.plane[..., None, :], self.joints.polygon
        return plane[..., 0] + plane[..., 1] * corners[..., 0] + plane[..., 2] * corners[..., 1]

    @cached_property
    def _apart(self) -> np.ndarray:
        """(..., j, m): whether the gap at the corners is more than rounding."""
        return self.opening > TOUCHING * self.joints.size[:, None]

    @property
    def state(self) -> np.ndarray:
        """(..., j) int: index into ``STATES``; gaps within rounding count as closed."""
        return self._apart.any(axis=-1).astype(int) + self._apart.all(axis=-1)

    @property
    def open_share(self) -> np.ndarray:
        """(..., j): share of the polygon's area over which the joint is open."""
        partly = np.nonzero(self._apart.any(axis=-1) & ~self._apart.all(axis=-1))
        found, joint = self._apart.all(axis=-1).astype(float), partly[-1]
        height = self.opening[partly] - TOUCHING * self.joints.size[joint, None]
        found[partly] = positive_area(self.joints.polygon[joint], height) / self.joints.area[joint]
        return found

    def distance(self, points: np.ndarray, which) -> np.ndarray:
        """(..., k) m: gap between the faces at points (k, 2), each in the joint given by ``which`` (k,)."""
        plane = self.plane[..., which, :]
        return plane[..., 0] + plane[..., 1] * points[..., 0] + plane[..., 2] * points[..., 1]

    def slip(self, joint: int, points: np.ndarray) -> np.ndarray:
        """(..., k, 2) m: displacement of b over a along t1 and t2 at points (k, 2) of one joint, elastic part included.

        The points may be the shear arms of the contact points or a :meth:`JointMotion.grid`.
        """
        points = np.asarray(points, float)
        flat = np.concatenate([points, np.zeros((len(points), 1))], axis=1)
        if self.small is None:
            turned = turning(self.turn[..., joint, None, :], flat)
        else:
            turned = np.cross(self.small[..., joint, None, :], flat)
        return (self.shift[..., joint, None, :] + turned)[..., :2]


def torsion_centre(first: RelativeMotion, second: RelativeMotion) -> np.ndarray:
    """(..., j, 2) m: centre of the rotation of b from one motion to the other, from O in the joint's axes on a.

    The material point of b that stays in place in the joint's plane, the fixed point of a plane rotation by delta about
    c: c = middle of the shifts + cot(delta / 2) / 2 times the increment turned by a right angle; cot(delta / 2) = w / z
    of the quaternion. NaN if nothing moved, and if the increment is pure shear or mostly a tilt.
    """
    w, x, y, z = np.moveaxis(quaternion_product(second.turn, first.turn * [1.0, -1.0, -1.0, -1.0]), -1, 0)
    size, step = first.joints.size, (second.shift - first.shift)[..., :2]
    turned, tilted = 2.0 * np.abs(z) * size, 2.0 * np.hypot(x, y) * size
    shifted = np.linalg.norm(step, axis=-1)
    turns = (turned > PURE * shifted) & (turned > STILL * size) & (tilted <= np.maximum(turned, shifted))
    half = np.divide(0.5 * w, z, out=np.full_like(w, np.nan), where=turns)[..., None]
    return first.shift[..., :2] + 0.5 * step + half * np.stack([-step[..., 1], step[..., 0]], axis=-1)


def positive_area(corners: np.ndarray, height: np.ndarray) -> np.ndarray:
    """Area (k,) of the part of convex polygons (k, m, 2) where a linear function is positive; ``height`` (k, m): its
    values at the corners, which must not all have the same sign."""
    following, at_following = np.roll(corners, -1, axis=1), np.roll(height, -1, axis=1)
    above, above_following = height > 0.0, at_following > 0.0
    crosses = above != above_following
    way = np.divide(height, height - at_following, out=np.zeros_like(height), where=crosses)
    cut = corners + way[..., None] * (following - corners)
    # taken from a point of the cut, the cut itself spans no area
    base = cut[np.arange(len(cut)), crosses.argmax(axis=1)][:, None]
    (x_1, y_1), (x_2, y_2) = (
        np.moveaxis(np.where(kept[..., None], own, cut) - base, -1, 0)
        for kept, own in ((above, corners), (above_following, following))
    )
    return 0.5 * ((x_1 * y_2 - y_1 * x_2) * (above | above_following)).sum(axis=1)
