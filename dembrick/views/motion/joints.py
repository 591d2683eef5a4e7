"""Joints of a recorded run: motion, opening, slip, torsion centre, forces, utilisation.

The motion of b against a is a finite rotation and a shift, seen by an observer who rides on a: the rotation is that of
b's quaternion against a's, the shift goes from the point O of a to the point O of b. Both are measured from the start
and written in the joint's axes t1, t2, n. Quaternions keep their digits for small rotations, rotation matrices do not.
A run in small displacements, as searches are, keeps the geometry of the start: there shifts and rotation vectors are
differences, and openings and slip are linear in them, as the forces are that were found with them.

Arrays have the shape of the frames asked for in front: (j, ...) for one frame, (f, j, ...) for f of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from dembrick.geometry.friction_integrals import far_moments
from dembrick.geometry.polygons import area, distance_outside
from dembrick.geometry.rotations import quaternion_product, rotation_vector, turned_by, turning
from dembrick.kernels.joint.utilisation import Outlines, area_gauges, point_gauges
from dembrick.simulation.joint_laws import pressed_parts
from dembrick.theory.polygons import convex_hull
from dembrick.views.motion.bonds import Bonds
from dembrick.views.motion.frames import coming_down, nearest
from dembrick.views.motion.relative import STATES, RelativeMotion, torsion_centre

if TYPE_CHECKING:
    from dembrick.history.reader import History

HINGE = 0.99  # of the way from O to the edge: the centre of pressure of a hinge of stiff joints is as far out
CHANNELS = ("N", "V_1", "V_2", "M_T", "M_1", "M_2", "slip")


class JointMotion:
    """The joints of a history (or of anything with the same attributes), or ``only`` the one of that number.

    ``polygon`` (j, m, 2): corners, those of joints with fewer than m repeat the last one; ``n_corner`` (j,);
    ``is_corner`` (j, m): which are none of these; ``size`` (j,) m: greatest distance of a corner from O;
    ``point_start`` (j + 1,) into the list of all contact points.
    """

    def __init__(self, history: History, only: int | None = None):
        self.history = history
        before = [0, *np.cumsum([len(joint["areas"]) for joint in history.joints])]
        own = slice(None) if only is None else slice(only, only + 1)
        self.given = joints = history.joints[own]
        of_points = slice(None) if only is None else slice(before[only], before[only + 1])
        # where these joints and their contact points stand in what a history holds of all
        self.column = {"joint": own, "joint_shift": own, "bond": own}
        self.column |= dict.fromkeys(("contact_force", "contact_arm", "contact_area"), of_points)
        self.n_joint = len(joints)
        self.block_a, self.block_b, self.host = (
            np.array([joint[name] for joint in joints], np.int64) for name in ("block_a", "block_b", "host")
        )
        self.other = self.block_a + self.block_b - self.host
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
        self.is_corner = np.arange(most) < self.n_corner[:, None]
        self.point_start = np.cumsum([0, *(len(joint["areas"]) for joint in joints)])
        self.arm_a = self.origin - history.position0[self.block_a]
        self.arm_b = self.origin - history.position0[self.block_b]
        self.arm_host = np.where((self.host == self.block_a)[:, None], self.arm_a, self.arm_b)
        self.custom = "custom_law" in getattr(history, "settings", {})
        self.small = bool(getattr(history, "small_displacements", False))
        self.back = history.orientation0 * np.array([1.0, -1.0, -1.0, -1.0])

    def at(self, frames, rows: Sequence[int] | None = None) -> JointFrames:
        """The joints in some frames: a range, or a list of numbers; with the forces of these ``rows``, else of those
        nearest in time."""
        return JointFrames(self, frames, rows)

    def torsion_centre(self, frame: int, since: int | None = None) -> np.ndarray:
        """Torsion centre (j, 2) of every joint from O in its axes, for the increment from frame ``since`` (default:
        the one before) to ``frame``; see :func:`torsion_centre`. NaN also in the first frame, and where the joint is
        open."""
        frame = range(self.history.n_frames)[frame]
        since = frame - 1 if since is None else range(self.history.n_frames)[since]
        if since < 0:
            return np.full((self.n_joint, 2), np.nan)
        both = self.at([since, frame]).relative
        first, second = both[0], both[1]
        return np.where((second.state == STATES.index("open"))[:, None], np.nan, torsion_centre(first, second))

    def rows(self, frames) -> np.ndarray:
        """The row nearest in time to each frame."""
        return nearest(self.history.time, self.history.frame_time[frames])

    def along_axes(self, vectors: np.ndarray) -> np.ndarray:
        """Vectors (f, j, 3), one a joint, in the joints' axes."""
        return np.einsum("jik,fjk->fji", self.axes, vectors)

    # --- what does not move ---

    @cached_property
    def points(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Normal arms (c, 2), shear arms (c, 2), tributary areas (c,) and joints (c,) of all contact points."""
        normal, shear = (
            np.concatenate([np.zeros((0, 2)), *(joint[name] for joint in self.given)])
            for name in ("normal_arms", "shear_arms")
        )
        areas = np.concatenate([np.zeros(0), *(joint["areas"] for joint in self.given)])
        return normal, shear, areas, np.repeat(np.arange(self.n_joint), np.diff(self.point_start))

    def sum_of_points(self, values: np.ndarray) -> np.ndarray:
        """(f, j): the sum of what the contact points (f, c) of each joint have; zero without any."""
        found, own = np.zeros((len(values), self.n_joint)), np.flatnonzero(np.diff(self.point_start))
        if len(own):
            found[:, own] = np.add.reduceat(values, self.point_start[own], axis=1)
        return found

    @cached_property
    def bonds(self) -> Bonds | None:
        """Strengths of the joints beside friction; None if they have none."""
        return Bonds(self) if self.given and "cohesion" in self.given[0] else None

    @cached_property
    def edges(self) -> tuple[np.ndarray, np.ndarray]:
        """Outward normals (j, m, 2) of the edges of what can carry the normal force of every joint, and their distances
        (j, m) from O (m); joints with fewer than m edges have normals of no length."""
        normal_arms, found = self.points[0], []
        for j in range(self.n_joint):
            own = normal_arms[self.point_start[j] : self.point_start[j + 1]]
            corners = own if len(own) else self.polygon[j, : self.n_corner[j]]
            hull = convex_hull(corners / self.size[j])
            along = np.roll(hull, -1, axis=0) - hull
            outward = np.stack([along[:, 1], -along[:, 0]], axis=1) / np.hypot(*along.T)[:, None]
            found.append((outward, (hull * outward).sum(axis=1)))
        most = max((len(distance) for _, distance in found), default=0)
        normals, distances = np.zeros((self.n_joint, most, 2)), np.ones((self.n_joint, most))
        for j, (outward, distance) in enumerate(found):
            normals[j, : len(distance)], distances[j, : len(distance)] = outward, self.size[j] * distance
        return normals, distances

    @cached_property
    def twist(self) -> tuple[np.ndarray, np.ndarray]:
        """Slip twists that told the utilisation of convex joints and of those with points, where the next search
        starts: that of a neighbouring frame is found five times as fast from there."""
        with_points = np.diff(self.point_start) > 0
        return np.zeros(((~with_points).sum(), 3)), np.zeros((with_points.sum(), 3))

    @cached_property
    def pressures(self) -> list[str]:
        """Pressure that the law of each convex joint assumes."""
        return [self.given[j]["pressure"] for j in self.surfaces[-1]]

    @cached_property
    def surfaces(self) -> tuple[Outlines, np.ndarray, np.ndarray] | None:
        """Joints without contact points: what `area_gauges` needs of their polygons, and their numbers."""
        joint = np.flatnonzero(np.diff(self.point_start) == 0)
        if not len(joint):
            return None
        x, y = np.ascontiguousarray(self.polygon[joint][self.is_corner[joint]].T)
        start, far = np.cumsum([0, *self.n_corner[joint]]), far_moments(self.polygon[joint])
        outlines = Outlines(x, y, start, area(self.polygon[joint]), self.size[joint], far)
        return outlines, np.arange(len(joint)), joint

    def greatest_of_blocks(self, of_joint: np.ndarray) -> np.ndarray:
        """(f, n_block): the greatest of what the joints (f, j) of each block have; NaN of a joint says nothing."""
        found = np.zeros((self.history.n_block, len(of_joint)))
        for blocks in (self.block_a, self.block_b):
            np.fmax.at(found, blocks, of_joint.T)
        return found.T

    def grid(self, joint: int, along: int = 12) -> np.ndarray:
        """(k, 2) m: points of a square grid over the polygon of a joint, ``along`` of them over its longer side."""
        polygon = self.polygon[joint, : self.n_corner[joint]]
        low, extent = polygon.min(axis=0), np.ptp(polygon, axis=0)
        counts = np.maximum(np.round(along * extent / extent.max()).astype(int), 1)
        lines = [low[i] + extent[i] * (np.arange(counts[i]) + 0.5) / counts[i] for i in (0, 1)]
        points = np.stack(np.meshgrid(*lines), axis=-1).reshape(-1, 2)
        return points[distance_outside(points, polygon) <= 0.0]


class JointFrames:
    """The joints of a history in some frames f, each quantity read and computed when it is first asked for.

    Arrays start with (f, j, ...), those of contact points with (f, c, ...) in the order of ``JointMotion.point_start``.
    """

    def __init__(self, joints: JointMotion, frames, rows: Sequence[int] | None = None):
        self.joints, self._frames, self._history = joints, frames, joints.history
        self._rows = None if rows is None else np.asarray(rows)

    def _values(self, name: str) -> np.ndarray | None:
        frames, read = self._frames, self._history.frame_values
        if isinstance(frames, range) and frames.step == 1 and frames.start >= 0:
            found = [read(name, frames.start, frames.stop)]
        else:
            numbers = [range(self._history.n_frames)[int(k)] for k in frames]
            found = [read(name, k, k + 1) for k in numbers]
        if any(one is None for one in found):
            return None
        return np.concatenate(found)[:, self.joints.column.get(name, slice(None))]

    @cached_property
    def _displacement(self) -> np.ndarray:
        return self._values("displacement")

    @cached_property
    def _turned(self) -> np.ndarray:
        """(f, n, 4): quaternions of the turns of the blocks since the start."""
        return quaternion_product(self._values("orientation"), self.joints.back)

    # --- places ---

    @cached_property
    def relative(self) -> RelativeMotion:
        """Motion of b against a since the start."""
        joints, a, b = self.joints, self.joints.block_a, self.joints.block_b
        apart = self._displacement[:, b] - self._displacement[:, a]
        if joints.small:  # displacements and rotation vectors are infinitesimal
            turned = rotation_vector(self._turned)
            apart += np.cross(turned[:, b], joints.arm_b) - np.cross(turned[:, a], joints.arm_a)
            shift, vector = joints.along_axes(apart), joints.along_axes(turned[:, b] - turned[:, a])
            plane = np.stack([shift[..., 2], -vector[..., 1], vector[..., 0]], axis=-1)
            return RelativeMotion(joints, shift, turned_by(vector, [1.0, 0.0, 0.0, 0.0]), plane, vector)
        of_a, of_b = self._turned[:, a], self._turned[:, b]
        apart += turning(of_b, joints.arm_b) - turning(of_a, joints.arm_a)
        back = of_a * [1.0, -1.0, -1.0, -1.0]
        shift, turn = joints.along_axes(apart + turning(back, apart)), quaternion_product(back, of_b)
        turn[..., 1:] = joints.along_axes(turn[..., 1:])
        s_1, s_2, s_3 = np.moveaxis(shift, -1, 0)
        w, x, y, z = np.moveaxis(turn, -1, 0)
        # along the normal of the face that the polygon does not ride on; R turns b, n = (0, 0, 1)
        on_b = [s_3, 2.0 * (x * z - w * y), 2.0 * (y * z + w * x)]  # n . (s + R p)
        n_1, n_2, n_3 = 2.0 * (x * z + w * y), 2.0 * (y * z - w * x), -2.0 * (x * x + y * y)
        on_a = [s_3 + s_1 * n_1 + s_2 * n_2 + s_3 * n_3, -n_1, -n_2]  # (s - p) . R n
        plane = np.where(joints.host == b, on_b, on_a)
        return RelativeMotion(joints, shift, turn, np.ascontiguousarray(np.moveaxis(plane, 0, -1)))

    @cached_property
    def origin(self) -> np.ndarray:
        """(f, j, 3) m: the points O of the blocks a in the world."""
        joints, a = self.joints, self.joints.block_a
        return joints.origin + self._displacement[:, a] + turning(self._turned[:, a], joints.arm_a)

    @cached_property
    def axes(self) -> np.ndarray:
        """(f, j, 3, 3): the joints' axes riding on a, world, as rows."""
        axes = self.joints.axes
        return axes + turning(self._turned[:, self.joints.block_a, None], axes)

    @cached_property
    def shift(self) -> np.ndarray:
        """(f, j, 2) m: where O is on the block that the polygon rides on, from O of the start: elsewhere where part of
        the polygon was cut off, because it slid over the edge of the other block's face."""
        found = self._values("joint_shift")
        return np.zeros((len(self._frames), self.joints.n_joint, 2)) if found is None else found

    @cached_property
    def acting_origin(self) -> np.ndarray:
        """(f, j, 3) m: the points O in the world about which the resultants are, on the block that the polygon rides
        on."""
        joints, host = self.joints, self.joints.host
        away = np.einsum("fji,jik->fjk", self.shift, joints.axes[:, :2])
        turn = turning(self._turned[:, host], joints.arm_host + away)
        return joints.origin + away + self._displacement[:, host] + turn

    @cached_property
    def acting_axes(self) -> np.ndarray:
        """(f, j, 3, 3): the axes of the resultants, world, as rows: t1 of the block that the polygon rides on, laid
        into the plane of the other's face, t2, and the normal of that face from a to b."""
        joints, axes = self.joints, self.joints.axes
        t = axes[:, 0] + turning(self._turned[:, joints.host], axes[:, 0])
        n = axes[:, 2] + turning(self._turned[:, joints.other], axes[:, 2])
        t -= (t * n).sum(axis=-1, keepdims=True) * n
        t /= np.linalg.norm(t, axis=-1, keepdims=True)
        return np.stack([t, np.cross(n, t), n], axis=-2)

    # --- forces ---

    @cached_property
    def resultants(self) -> np.ndarray:
        """(f, j, 7): N, V_1, V_2, M_T, M_1, M_2 (N, N m; action on b about O) and slip (m), of the nearest row."""
        rows = self.joints.rows(self._frames) if self._rows is None else self._rows
        first, last = (int(rows.min()), int(rows.max()) + 1) if len(rows) else (0, 0)
        found = np.empty((len(rows), self.joints.n_joint, len(CHANNELS)))
        for i, name in enumerate(CHANNELS):
            found[..., i] = self._history.series(f"joint/{name}", first, last)[
                rows - first, self.joints.column["joint"]
            ]
        if self._rows is None:
            found[coming_down(self._history, self._frames), :, :6] = 0.0
        return found

    @cached_property
    def pressure_centre(self) -> np.ndarray:
        """(f, j, 2) m: the centre of pressure (M_2, -M_1) / N from O; O where the joint carries no N."""
        N, _, _, _, M_1, M_2, _ = np.moveaxis(self.resultants, -1, 0)
        moments = np.stack([M_2, -M_1], axis=-1)
        return np.divide(moments, N[..., None], out=np.zeros_like(moments), where=N[..., None] > 0.0)

    @cached_property
    def point_forces(self) -> np.ndarray | None:
        """(f, c, 3) N: force on b at every contact point, world axes; None if the history does not have them, or not
        at the rows asked for."""
        if self._rows is not None:
            others = self._rows != self.joints.rows(self._frames)
            if (others | coming_down(self._history, self._frames)).any():
                return None
        return self._values("contact_force")

    @cached_property
    def normal_forces(self) -> np.ndarray:
        """(f, c) N: normal force of every contact point.

        Recorded ones where the history has them; else the joint's N, shared as the springs share it: by tributary
        area and penetration.
        """
        joints = self.joints
        arms, _, areas, owner = joints.points
        if self.point_forces is not None:
            return np.maximum(np.einsum("fci,fci->fc", self.point_forces, self.acting_axes[:, owner, 2]), 0.0)
        share = areas * np.maximum(-self.relative.distance(arms, owner), 0.0)
        share = np.where(joints.sum_of_points(share)[:, owner] > 0.0, share, areas)  # by area where nothing is pressed
        return self.resultants[:, owner, 0] * share / joints.sum_of_points(share)[:, owner]

    @property
    def utilisation(self) -> np.ndarray:
        """(f, j): how much of its strength each joint uses, in friction or in bending, whichever is more: 1 if it
        slides or twists, and 1 at a hinge."""
        if self.joints.custom:
            return self.friction_utilisation
        return np.fmax(self.friction_utilisation, self.bending_utilisation)

    @cached_property
    def bending_utilisation(self) -> np.ndarray:
        """(f, j): how far the centre of pressure is on its way from O to the edge of what can carry N: the polygon of a
        convex joint, that around the contact points else; 1 is a hinge. Of a bond that holds, tension over strength.
        0 if the joint carries nothing, NaN if it was cut as it slid over an edge, see `friction_utilisation`."""
        normals, distance = self.joints.edges
        found = (np.einsum("jmk,fjk->fjm", normals, self.pressure_centre) / distance).max(axis=-1, initial=0.0)
        bonds = self.joints.bonds
        if bonds is not None:
            found = np.where(self._held > 0.0, bonds.tension_utilisation(self.resultants), found)
        found[self._cut & self.resultants[..., :6].any(axis=2)] = np.nan
        return found

    @cached_property
    def _cut(self) -> np.ndarray:
        """(f, j): whether part of the polygon was cut off."""
        found = self.shift.any(axis=2)
        if self._areas is not None:
            less = (self._areas < (1.0 - 1e-9) * self.joints.points[2]).astype(float)
            found |= self.joints.sum_of_points(less) > 0.0
        return found

    @cached_property
    def _areas(self) -> np.ndarray | None:
        """(f, c) m2: areas of the contact points; None if the history does not have them, as older ones."""
        return self._values("contact_area")

    @property
    def held(self) -> np.ndarray | None:
        """(f, j): the part of every joint's area whose bond holds; None where no joint has more than friction."""
        return None if self.joints.bonds is None else self._held

    @cached_property
    def point_strength(self) -> np.ndarray | None:
        """(f, c) N: the shear that every contact point may carry; None where no joint has more than friction."""
        bonds = self.joints.bonds
        if bonds is None:
            return None
        recorded, area = self.point_forces is not None, self.joints.points[2] if self._areas is None else self._areas
        return bonds.point_strength(self.resultants, self._held, self.normal_forces, recorded, area)

    @cached_property
    def _held(self) -> np.ndarray:
        """(f, j): the part of every joint's area whose bond holds; zero if it never had one."""
        found = self._values("bond")
        return np.where(self.joints.bonds.bonded, 0.0 if found is None else found, 0.0)

    @cached_property
    def friction_utilisation(self) -> np.ndarray:
        """(f, j): gauge of (V_1, V_2, M_T) in the joint's own limit set at its N; 1 is the yield domain's edge.

        ``convex``: the exact surface of the polygon under the pressure of its law. Point formulations: the set of all
        forces that Coulomb friction at the points can give, each under its own normal force. Bonds add their cohesion
        as long as they hold. A joint without friction
        strength is at 0 when it carries nothing, and at infinity else. Where contact forces were not recorded, a joint
        that touches at a corner with next to no force may read above 1. NaN for a joint that was cut where it slid over
        an edge, unless its contact points were recorded: its strength is that of a polygon which is not known; and for
        all that touch by a law of the user's own, which is not known either.
        """
        joints, resultants = self.joints, self.resultants
        found = np.zeros(resultants.shape[:2])
        force = np.ascontiguousarray(resultants[..., 1:4])
        if joints.custom:
            return np.where(resultants[..., 0] != 0.0, np.nan, 0.0)
        if joints.surfaces is not None:
            joint = joints.surfaces[-1]
            pressed = bending = None
            if set(joints.pressures) - {"full"}:
                pressed = pressed_parts(joints.pressures, joints.n_corner[joint].tolist())
                opening = self.relative.components[..., 2:5]
                bending = np.concatenate([resultants[..., [0, 4, 5]], opening], axis=-1)
            strength = joints.friction * resultants[..., 0]
            if joints.bonds is not None:
                closed = 1.0 - self.relative.open_share
                strength = joints.bonds.area_strength(resultants[..., 0], self._held, closed)
            area_gauges(*joints.surfaces, pressed, bending, strength, force, joints.twist[0], found)
        unknown = self._cut & (force != 0.0).any(axis=2)
        if joints.point_start[-1]:
            joint = np.flatnonzero(np.diff(joints.point_start))
            start = np.append(joints.point_start[joint], joints.point_start[-1])
            x, y = np.ascontiguousarray(joints.points[1].T)
            normal = np.ascontiguousarray(self.normal_forces)
            rest = (start, joint, joints.friction)
            if joints.bonds is not None:  # strengths in place of normal forces
                normal = self.point_strength
                rest = (start, joint, np.ones(joints.n_joint))
            point_gauges(x, y, *rest, normal, force, joints.twist[1], np.zeros(6), found)
            arms = self._values("contact_arm")
            if arms is not None:
                needs_area = joints.bonds is not None and self._areas is None
                unknown[:, joint] &= joints.bonds.cohere[joint] if needs_area else False
                for k in np.flatnonzero((arms != joints.points[0]).any(axis=(1, 2))):
                    x, y = self._shear_arms(k, arms[k])
                    one = slice(k, k + 1)
                    point_gauges(x, y, *rest, normal[one], force[one], joints.twist[1], np.zeros(6), found[one])
        found[unknown] = np.nan
        return found

    def _shear_arms(self, k: int, arms: np.ndarray) -> np.ndarray:
        """Where friction acts (2, c) from O of now, in the ``k``-th frame: nearer to it than the ``arms`` (c, 2) of the
        points from O of the start by as much as at the start."""
        normal, shear, _, owner = self.joints.points
        size = np.zeros((2, self.joints.n_joint))
        for row, points in zip(size, (normal, shear), strict=True):
            np.maximum.at(row, owner, np.abs(points).max(axis=1))
        ratio = np.divide(size[1], size[0], out=np.ones_like(size[0]), where=size[0] > 0.0)
        return np.ascontiguousarray((ratio[owner, None] * (arms - self.shift[k, owner])).T)
