"""What the joints of a recorded run do: motion, opening, slip, torsion centre, forces, utilisation.

The motion of b against a is a finite rotation and a shift, seen by an observer who rides on a: the rotation is that of
b's quaternion against a's, the shift goes from the point O of a to the point O of b. Both are measured from the start
and written in the joint's axes t1, t2, n. Quaternions keep their digits for small rotations, rotation matrices do not.

Arrays have the shape of the frames asked for in front: (j, ...) for one frame, (f, j, ...) for f of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dembrick.kernels.gauge import area_gauges, point_gauges
from dembrick.limit_set import far_moments
from dembrick.polygons import area
from dembrick.shapes import quaternion_product, rotation_matrix
from dembrick.simulation import pressed_room

CHANNELS = ("N", "V_1", "V_2", "M_T", "M_1", "M_2", "slip")
STATES = ("closed", "partly open", "open")

_TOUCHING = 1e-12  # of a joint's size: an opening below it is rounding
_STILL = 1e-13  # of a joint's size: an increment below it is rounding
_PURE = 1e-7  # of the slip at the joint's rim: a part of an increment that is not there
_SAME = 1e-9  # of a joint's size: corners nearer than this are the same


class JointMotion:
    """The joints of a history (or of anything with the same attributes).

    ``polygon`` (j, m, 2): corners, those of joints with fewer than m repeat the last one; ``n_corner`` (j,);
    ``size`` (j,) m: greatest distance of a corner from O; ``point_start`` (j + 1,) into the list of all contact points.
    """

    def __init__(self, history):
        self._history = history
        joints = history.joints
        self.n_joint = len(joints)
        self.block_a, self.block_b, self.host = (
            np.array([joint[name] for joint in joints], np.int64) for name in ("block_a", "block_b", "host")
        )
        self.origin = np.array([joint["origin"] for joint in joints], float).reshape(-1, 3)
        self.axes = np.array([joint["axes"] for joint in joints], float).reshape(-1, 3, 3)
        self.area = np.array([joint["area"] for joint in joints], float)
        self.friction = np.array([joint["friction"] for joint in joints], float)
        self.n_corner = np.array([len(joint["polygon"]) for joint in joints], np.int64)
        most = int(self.n_corner.max(initial=0))
        self.polygon = np.empty((self.n_joint, most, 2))
        for own, joint in zip(self.polygon, joints, strict=True):
            own[:] = joint["polygon"][-1]
            own[: len(joint["polygon"])] = joint["polygon"]
        self.size = np.hypot(self.polygon[..., 0], self.polygon[..., 1]).max(axis=1, initial=0.0)
        self.point_start = np.cumsum([0, *(len(joint["areas"]) for joint in joints)])
        self._arm_a = self.origin - history.position0[self.block_a]
        self._arm_b = self.origin - history.position0[self.block_b]
        self._rotation0 = rotation_matrix(history.orientation0)
        self._back = history.orientation0 * np.array([1.0, -1.0, -1.0, -1.0])

    # --- motion ---

    def relative(self, frames) -> RelativeMotion:
        """Motion of b against a in a frame, or in each of several, since the start."""
        displacement, orientation = self._poses(frames)
        turned = quaternion_product(orientation, self._back)  # of every block since the start, world axes
        of_a, of_b = turned[..., self.block_a, :], turned[..., self.block_b, :]
        to_a = of_a * np.array([1.0, -1.0, -1.0, -1.0])
        shift = displacement[..., self.block_b, :] - displacement[..., self.block_a, :]
        shift = shift + _turning(of_b, self._arm_b) - _turning(of_a, self._arm_a)
        shift = shift + _turning(to_a, shift)
        turn = quaternion_product(to_a, of_b)
        turn[..., 1:] = self._in_axes(turn[..., 1:])
        return RelativeMotion(self, self._in_axes(shift), turn)

    def _in_axes(self, vectors: np.ndarray) -> np.ndarray:
        return np.einsum("jik,...jk->...ji", self.axes, vectors)

    def _poses(self, frames) -> tuple[np.ndarray, np.ndarray]:
        if isinstance(frames, range) and frames.step == 1 and frames.start >= 0:
            read = self._history.frame_values
            return tuple(read(name, frames.start, frames.stop) for name in ("displacement", "orientation"))
        read = (self._history.frame_displacement, self._history.frame_orientation)
        if np.ndim(frames) == 0:
            return read[0](int(frames)), read[1](int(frames))
        return tuple(np.stack([one(int(k)) for k in frames]) for one in read)

    def torsion_centre(self, frame: int, since: int | None = None) -> np.ndarray:
        """Torsion centre (j, 2) of every joint from O in its axes, for the increment from frame ``since`` (default:
        the one before) to ``frame``; see :func:`torsion_centre`. NaN also in the first frame, and where the joint is
        open."""
        frame = range(self._history.n_frames)[frame]
        since = frame - 1 if since is None else range(self._history.n_frames)[since]
        if since < 0:
            return np.full((self.n_joint, 2), np.nan)
        both = self.relative([since, frame])
        first, second = both[0], both[1]
        return np.where((second.state == STATES.index("open"))[:, None], np.nan, torsion_centre(first, second))

    # --- forces ---

    def rows(self, frames) -> np.ndarray:
        """The row nearest in time to each frame."""
        return nearest(self._history.time, self._history.frame_time[frames])

    def resultants(self, frames) -> np.ndarray:
        """(j, 7): N, V_1, V_2, M_T, M_1, M_2 (N, N m; action on b about O) and slip (m), of the nearest row."""
        rows = np.atleast_1d(self.rows(frames))
        first, last = (int(rows.min()), int(rows.max()) + 1) if len(rows) else (0, 0)
        channels = [self._history.series(f"joint/{name}", first, last)[rows - first] for name in CHANNELS]
        found = np.stack(channels, axis=-1)
        return found if np.ndim(frames) else found[0]

    def normal_forces(self, frames) -> np.ndarray:
        """(c,) N: normal force of every contact point, in the order of ``point_start``.

        Recorded ones where the history has them; else the joint's N, shared as the springs share it: by tributary
        area and penetration.
        """
        if not np.ndim(frames):
            return self.normal_forces(_one(frames, self._history.n_frames))[0]
        arms, _, areas, owner = self._points
        if not len(owner):
            return np.zeros((len(frames), 0))
        forces = self.point_forces(frames)
        if forces is not None:
            normal = self.axes_in(rotation_matrix(self._poses(frames)[1]))[..., 2, :]
            return np.maximum((forces * normal[..., owner, :]).sum(axis=-1), 0.0)
        opening = self.relative(frames).distance(arms[:, None], owner)[..., 0]
        share = np.maximum(-opening, 0.0) * areas
        pressed = self._sums(share)[..., owner]
        share = np.where(pressed > 0.0, share, areas) / np.where(pressed > 0.0, pressed, self._sums(areas)[owner])
        return self.resultants(frames)[..., 0][..., owner] * share

    @cached_property
    def _points(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Normal arms (c, 2), shear arms (c, 2), tributary areas (c,) and joints (c,) of all contact points."""
        joints = self._history.joints
        normal, shear = (
            np.concatenate([np.zeros((0, 2)), *(joint[name] for joint in joints)])
            for name in ("normal_arms", "shear_arms")
        )
        areas = np.concatenate([np.zeros(0), *(joint["areas"] for joint in joints)])
        return normal, shear, areas, np.repeat(np.arange(self.n_joint), np.diff(self.point_start))

    def _sums(self, values: np.ndarray) -> np.ndarray:
        """Sums (..., j) of values (..., c) over the points of each joint."""
        total = np.concatenate([np.zeros((*values.shape[:-1], 1)), np.cumsum(values, axis=-1)], axis=-1)
        return total[..., self.point_start[1:]] - total[..., self.point_start[:-1]]

    def point_forces(self, frames) -> np.ndarray | None:
        """(c, 3) N: force on b at every contact point, world axes; None where the history does not have them."""
        if isinstance(frames, range):
            return self._history.frame_values("contact_force", frames.start, frames.stop)
        if not np.ndim(frames):
            return self._history.frame_contact_force(int(frames))
        found = [self._history.frame_contact_force(int(k)) for k in frames]
        return None if found[0] is None else np.stack(found)

    def utilisation(self, frames) -> np.ndarray:
        """(j,): gauge of (V_1, V_2, M_T) in the joint's own limit set at its N; 1 is the yield domain's edge.

        ``convex``: the exact surface of the polygon under the pressure of its law. Point formulations: the set of all
        forces that Coulomb friction at the points can give, each under its own normal force. A joint without friction
        strength is at 0 when it carries nothing, and at infinity else. Where contact forces were not recorded, a joint
        that touches at a corner with next to no force may read above 1.
        """
        if not np.ndim(frames):
            return self.utilisation(_one(frames, self._history.n_frames))[0]
        resultants = self.resultants(frames)
        found = np.zeros(resultants.shape[:2])
        force = np.ascontiguousarray(resultants[..., 1:4])
        if self._areas is not None:
            joint = self._areas[-1]
            pressed = bending = None
            if set(self._pressures) - {"full"}:
                pressed = pressed_room(self._pressures, self.n_corner[joint].tolist())
                opening = self.relative(frames).components[..., 2:5]
                bending = np.concatenate([resultants[..., [0, 4, 5]], opening], axis=-1)
            strength = self.friction * resultants[..., 0]
            area_gauges(*self._areas, pressed, bending, strength, force, np.zeros((len(joint), 3)), found)
        if self.point_start[-1]:
            joint = np.flatnonzero(np.diff(self.point_start))
            start = np.append(self.point_start[joint], self.point_start[-1])
            x, y = np.ascontiguousarray(self._points[1].T)
            normal = np.ascontiguousarray(self.normal_forces(frames))
            twist = np.zeros((len(joint), 3))
            point_gauges(x, y, start, joint, self.friction, normal, force, twist, np.zeros(6), found)
        return found

    @cached_property
    def _pressures(self) -> list[str]:
        """Pressure that the law of each convex joint assumes."""
        return [self._history.joints[j]["pressure"] for j in self._areas[-1]]

    @cached_property
    def _areas(self) -> tuple[np.ndarray, ...] | None:
        """The different polygons of joints without contact points, what `area_gauges` needs of them, and the joints."""
        shapes: dict[tuple, int] = {}
        polygons, which = [], []
        joint = np.flatnonzero(np.diff(self.point_start) == 0)
        for j in joint:
            scaled = np.round(self.polygon[j] / self.size[j], 9) + 0.0
            key = (int(self.n_corner[j]), f"{self.size[j]:.9e}", *scaled.ravel().tolist())
            if key not in shapes:
                shapes[key] = len(polygons)
                polygons.append(self.polygon[j, : self.n_corner[j]])
            which.append(shapes[key])
        if not polygons:
            return None
        x, y = np.ascontiguousarray(np.concatenate(polygons).T)
        return (
            x,
            y,
            np.cumsum([0, *map(len, polygons)]),
            np.array([area(polygon) for polygon in polygons]),
            np.array([np.hypot(*polygon.T).max() for polygon in polygons]),
            np.array([far_moments(polygon) for polygon in polygons]),
            np.array(which),
            joint,
        )

    # --- places ---

    def axes_in(self, rotation: np.ndarray) -> np.ndarray:
        """(..., j, 3, 3): the joints' axes riding on a, world, as rows; ``rotation`` (..., n, 3, 3): of the blocks."""
        turned = rotation @ self._rotation0.swapaxes(1, 2)
        return self.axes @ turned[..., self.block_a, :, :].swapaxes(-1, -2)

    def origin_in(self, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
        """(..., j, 3) m: the points O of the blocks a in the world, for ``position`` and ``rotation`` of all blocks."""
        turned = rotation @ self._rotation0.swapaxes(1, 2)
        return position[..., self.block_a, :] + (turned[..., self.block_a, :, :] @ self._arm_a[:, :, None])[..., 0]

    def frame_axes(self, frame: int) -> np.ndarray:
        """(j, 3, 3): the joints' axes in a frame."""
        return self.axes_in(rotation_matrix(self._history.frame_orientation(frame)))

    def grid(self, joint: int, along: int = 12) -> np.ndarray:
        """(k, 2) m: points of a square grid over the polygon of a joint, ``along`` of them over its longer side."""
        polygon = self.polygon[joint, : self.n_corner[joint]]
        low, extent = polygon.min(axis=0), np.ptp(polygon, axis=0)
        counts = np.maximum(np.round(along * extent / extent.max()).astype(int), 1)
        lines = [low[i] + extent[i] * (np.arange(counts[i]) + 0.5) / counts[i] for i in (0, 1)]
        points = np.stack(np.meshgrid(*lines), axis=-1).reshape(-1, 2)
        edge = np.roll(polygon, -1, axis=0) - polygon
        from_corner = points[:, None] - polygon
        inside = (edge[:, 0] * from_corner[..., 1] - edge[:, 1] * from_corner[..., 0] >= 0.0).all(axis=1)
        return points[inside]


@dataclass(frozen=True)
class RelativeMotion:
    """Motion of b against a since the start, in the joint's axes riding on a.

    ``shift`` (..., j, 3) m: from the point O of a to the point O of b; ``turn`` (..., j, 4): quaternion of b.
    """

    joints: JointMotion
    shift: np.ndarray
    turn: np.ndarray

    def __getitem__(self, frame) -> RelativeMotion:
        """One of several frames."""
        return RelativeMotion(self.joints, self.shift[frame], self.turn[frame])

    @property
    def rotation(self) -> np.ndarray:
        """(..., j, 3) rad: rotation vector r1, r2, rn, its length at most half a turn."""
        w, v = self.turn[..., 0], self.turn[..., 1:]
        sine = np.sqrt((v * v).sum(axis=-1))
        half = np.arctan2(np.where(w < 0.0, -sine, sine), np.abs(w))
        scale = np.divide(2.0 * half, sine, out=np.full_like(sine, 2.0), where=sine > 0.0)
        return scale[..., None] * v

    @property
    def components(self) -> np.ndarray:
        """(..., j, 6) m, rad: d1, d2, dn, r1, r2, rn."""
        return np.concatenate([self.shift, self.rotation], axis=-1)

    @cached_property
    def opening(self) -> np.ndarray:
        """(..., j, m) m: distance of the faces at the corners of the polygon, negative where they press."""
        return self.distance(self.joints.polygon, slice(None))

    def opening_at(self, joint: int, points: np.ndarray) -> np.ndarray:
        """(..., k) m: distance of the faces of one joint at points (k, 2) of it."""
        return self.distance(np.asarray(points, float), joint)

    def distance(self, points: np.ndarray, which) -> np.ndarray:
        """(..., m) m: how far points (..., m, 2) of the host's face are from the other face, along that one's normal.

        One row of points for each of the joints ``which``. With R the rotation of b, s the shift and n = (0, 0, 1):
        n . (s + R p) where the points p ride on b, and (s - p) . R n where they ride on a.
        """
        shift, turn = self.shift[..., which, :], self.turn[..., which, :]
        on_b = (self.joints.host == self.joints.block_b)[which]
        w, x, y, z = (turn[..., i] for i in range(4))
        n_1, n_2, drop = 2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 2.0 * (x * x + y * y)
        middle = shift[..., 2] + np.where(on_b, 0.0, shift[..., 0] * n_1 + shift[..., 1] * n_2 - shift[..., 2] * drop)
        slope_1 = np.where(on_b, 2.0 * (x * z - w * y), -n_1)
        slope_2 = np.where(on_b, 2.0 * (y * z + w * x), -n_2)
        return middle[..., None] + slope_1[..., None] * points[..., 0] + slope_2[..., None] * points[..., 1]

    @cached_property
    def _apart(self) -> np.ndarray:
        """(..., j, m): whether the faces are apart at a corner, by more than rounding."""
        return self.opening > _TOUCHING * self.joints.size[:, None]

    @cached_property
    def state(self) -> np.ndarray:
        """(..., j) int: index into ``STATES``."""
        return self._apart.all(axis=-1).astype(np.int64) + self._apart.any(axis=-1)

    @property
    def open_share(self) -> np.ndarray:
        """(..., j): the part of the polygon's area over which the faces are apart."""
        found = (self.state == STATES.index("open")).astype(float)
        partly = self.state == STATES.index("partly open")
        joint = np.nonzero(partly)[-1]
        apart = self.opening[partly] - _TOUCHING * self.joints.size[joint, None]
        found[partly] = _positive_area(self.joints.polygon[joint], apart) / self.joints.area[joint]
        return found

    def slip(self, joint: int, points: np.ndarray) -> np.ndarray:
        """(..., k, 2) m: movement of b over a along t1 and t2 at points (k, 2) of one joint, elastic part included.

        The shear arms of the contact points, or a :meth:`JointMotion.grid`.
        """
        points = np.asarray(points, float)
        flat = np.concatenate([points, np.zeros((len(points), 1))], axis=1)
        moved = self.shift[..., joint, None, :] + _turning(self.turn[..., joint, None, :], flat)
        return moved[..., :2]


def _positive_area(polygon: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Area (k,) of the part of polygons (k, m, 2) where a linear function is positive; ``values`` (k, m)."""
    p, q = polygon, np.roll(polygon, -1, axis=1)
    at_p, at_q = values, np.roll(values, -1, axis=1)
    crossing = (at_p > 0.0) != (at_q > 0.0)
    t = np.divide(at_p, at_p - at_q, out=np.zeros_like(at_p), where=crossing)[..., None]
    cut = p + t * (q - p)
    # seen from a point of the cut, the cut itself spans no area
    base = np.where(crossing[..., None], cut, 0.0).sum(axis=1) / np.maximum(crossing.sum(axis=1), 1)[:, None]
    start = np.where((at_p > 0.0)[..., None], p, cut) - base[:, None]
    end = np.where((at_q > 0.0)[..., None], q, cut) - base[:, None]
    spanned = start[..., 0] * end[..., 1] - start[..., 1] * end[..., 0]
    return 0.5 * np.where((at_p > 0.0) | (at_q > 0.0), spanned, 0.0).sum(axis=1)


def torsion_centre(first: RelativeMotion, second: RelativeMotion) -> np.ndarray:
    """(..., j, 2) m: where b turned about from one motion to the other, from O in the joint's axes riding on a.

    The material point of b that comes back to its place in the joint's plane. NaN where nothing moved, where the
    increment is pure shear, and where it is mostly a tilt.
    """
    size = first.joints.size
    step = second.shift[..., :2] - first.shift[..., :2]
    # of b from the first to the second motion, seen from a
    between = quaternion_product(second.turn, first.turn * np.array([1.0, -1.0, -1.0, -1.0]))
    w, x, y, z = (between[..., i] for i in range(4))
    turned, shifted, tilted = 2.0 * np.abs(z) * size, np.hypot(step[..., 0], step[..., 1]), 2.0 * np.hypot(x, y) * size
    turning = (turned > _PURE * shifted) & (turned > _STILL * size) & (tilted <= np.maximum(turned, shifted))
    # the fixed point of a plane rotation by delta with cot(delta / 2) = w / z
    cotangent = np.divide(w, z, out=np.zeros_like(z), where=turning)
    across = np.stack([-step[..., 1], step[..., 0]], axis=-1)
    centre = first.shift[..., :2] + 0.5 * step + 0.5 * cotangent[..., None] * across
    return np.where(turning[..., None], centre, np.nan)


def nearest(times: np.ndarray, wanted) -> np.ndarray:
    """Index of the entry of ``times`` (ascending) next to each wanted time; halfway, the earlier one."""
    return np.searchsorted(0.5 * (times[1:] + times[:-1]), wanted)


def _one(frame: int, n_frames: int) -> range:
    """A single frame, counted from the end where negative, as a range."""
    k = range(n_frames)[frame]
    return range(k, k + 1)


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
