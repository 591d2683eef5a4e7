"""The joints of a recorded run in selected frames: motion, forces, utilisation; see `motion.joints`."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from dembrick.geometry.rotations import quaternion_product, rotation_quaternion, rotation_vector, turning
from dembrick.kernels.joint.utilisation import area_gauges, point_gauges
from dembrick.simulation.joint_laws import about_start, pressed_parts
from dembrick.views.motion.bending import crushed_share, eccentricity_utilisation
from dembrick.views.motion.frames import in_collapse
from dembrick.views.motion.relative import RelativeMotion

if TYPE_CHECKING:
    from dembrick.views.motion.joints import JointMotion

CHANNELS = ("N", "V_1", "V_2", "M_T", "M_1", "M_2", "slip")
_ALONG = 0.1  # of a force: with a smaller component normal to a face, its line of action meets the face far away


class JointFrames:
    """The joints of a history in f frames; each quantity is read and computed when first used.

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
        """(f, n, 4): quaternions of the rotations of the blocks since the start."""
        return quaternion_product(self._values("orientation"), self.joints.back)

    # --- positions ---

    @cached_property
    def relative(self) -> RelativeMotion:
        """Motion of b relative to a since the start."""
        joints, a, b = self.joints, self.joints.block_a, self.joints.block_b
        apart = self._displacement[:, b] - self._displacement[:, a]
        if joints.small:  # displacements and rotation vectors are infinitesimal
            turned = rotation_vector(self._turned)
            apart += np.cross(turned[:, b], joints.arm_b) - np.cross(turned[:, a], joints.arm_a)
            shift, vector = joints.along_axes(apart), joints.along_axes(turned[:, b] - turned[:, a])
            plane = np.stack([shift[..., 2], -vector[..., 1], vector[..., 0]], axis=-1)
            return RelativeMotion(joints, shift, rotation_quaternion(vector), plane, vector)
        of_a, of_b = self._turned[:, a], self._turned[:, b]
        apart += turning(of_b, joints.arm_b) - turning(of_a, joints.arm_a)
        back = of_a * [1.0, -1.0, -1.0, -1.0]
        shift, turn = joints.along_axes(apart + turning(back, apart)), quaternion_product(back, of_b)
        turn[..., 1:] = joints.along_axes(turn[..., 1:])
        s_1, s_2, s_3 = np.moveaxis(shift, -1, 0)
        w, x, y, z = np.moveaxis(turn, -1, 0)
        # along the normal of the face to which the polygon is not attached; R turns b, n = (0, 0, 1)
        on_b = [s_3, 2.0 * (x * z - w * y), 2.0 * (y * z + w * x)]  # n . (s + R p)
        n_1, n_2, n_3 = 2.0 * (x * z + w * y), 2.0 * (y * z - w * x), -2.0 * (x * x + y * y)
        on_a = [s_3 + s_1 * n_1 + s_2 * n_2 + s_3 * n_3, -n_1, -n_2]  # (s - p) . R n
        plane = np.where(joints.host == b, on_b, on_a)
        return RelativeMotion(joints, shift, turn, np.ascontiguousarray(np.moveaxis(plane, 0, -1)))

    @cached_property
    def origin(self) -> np.ndarray:
        """(f, j, 3) m: the points O on the blocks a, world coordinates."""
        joints, a = self.joints, self.joints.block_a
        return joints.origin + self._displacement[:, a] + turning(self._turned[:, a], joints.arm_a)

    @cached_property
    def axes(self) -> np.ndarray:
        """(f, j, 3, 3): the joints' axes moving with a, world coordinates, as rows."""
        return self._riding(self.joints.block_a)

    @property
    def seen_axes(self) -> np.ndarray:
        """(f, j, 3, 3): the axes, world coordinates, as rows, along which an observer on a sees motion and forces: the
        `axes`, or in small displacements the initial ones."""
        return self.acting_axes if self.joints.small else self.axes

    def _riding(self, blocks: np.ndarray) -> np.ndarray:
        """(f, j, 3, 3): the joints' axes moving with the given ``blocks`` (j,), world coordinates, as rows."""
        axes = self.joints.axes
        return axes + turning(self._turned[:, blocks, None], axes)

    @cached_property
    def shift(self) -> np.ndarray:
        """(f, j, 2) m: current O relative to the initial O, on the host of the polygon; not zero if part of the polygon
        was cut off because it slid over the edge of the other block's face."""
        found = self._values("joint_shift")
        return np.zeros((len(self._frames), self.joints.n_joint, 2)) if found is None else found

    @cached_property
    def acting_origin(self) -> np.ndarray:
        """(f, j, 3) m: the points O, world coordinates, about which the resultants are taken, on the hosts of the
        polygons."""
        joints, host = self.joints, self.joints.host
        away = np.einsum("fji,jik->fjk", self.shift, joints.axes[:, :2])
        turn = turning(self._turned[:, host], joints.arm_host + away)
        return joints.origin + away + self._displacement[:, host] + turn

    @cached_property
    def acting_axes(self) -> np.ndarray:
        """(f, j, 3, 3): the axes of the resultants, world coordinates, as rows: t1 of the host of the polygon projected
        into the plane of the other block's face, t2, and the normal of that face from a to b. In small displacements
        the initial ones: there the forces do not turn with the blocks."""
        joints, axes = self.joints, self.joints.axes
        if joints.small:
            return np.broadcast_to(axes, (len(self._frames), *axes.shape))
        t = axes[:, 0] + turning(self._turned[:, joints.host], axes[:, 0])
        n = axes[:, 2] + turning(self._turned[:, joints.other], axes[:, 2])
        t -= (t * n).sum(axis=-1, keepdims=True) * n
        t /= np.linalg.norm(t, axis=-1, keepdims=True)
        return np.stack([t, np.cross(n, t), n], axis=-2)

    # --- forces ---

    @cached_property
    def resultants(self) -> np.ndarray:
        """(f, j, 7): N, V_1, V_2, M_T, M_1, M_2 (N, N m; b on a, about the current O) and slip (m), nearest row."""
        rows = self.joints.rows(self._frames) if self._rows is None else self._rows
        first, last = (int(rows.min()), int(rows.max()) + 1) if len(rows) else (0, 0)
        found = np.empty((len(rows), self.joints.n_joint, len(CHANNELS)))
        for i, name in enumerate(CHANNELS):
            found[..., i] = self._history.series(f"joint/{name}", first, last)[
                rows - first, self.joints.column["joint"]
            ]
        if self._rows is None:
            found[in_collapse(self._history, self._frames), :, :6] = 0.0
        return found

    @cached_property
    def about_start(self) -> np.ndarray:
        """(f, j, 7): the `resultants` with moments about the initial O. The recorded moments are about the centroid of
        what is left of a joint that was cut as it slid over an edge, and some laws cut it later than others."""
        return about_start(self.resultants, self.shift)

    @cached_property
    def pressure_centre(self) -> np.ndarray:
        """(f, j, 2) m: the centre of pressure (M_2, -M_1) / N from O; zero if the joint carries no N."""
        N, _, _, _, M_1, M_2, _ = np.moveaxis(self.resultants, -1, 0)
        moments = np.stack([M_2, -M_1], axis=-1)
        return np.divide(moments, N[..., None], out=np.zeros_like(moments), where=N[..., None] > 0.0)

    @cached_property
    def pressed_arm(self) -> np.ndarray:
        """(f, j, 2) m: the point where the line of action of each joint's force meets the face of the host of the
        polygon, from O along that face's own t1 and t2: the toe of a rocking block at any rotation. The
        `pressure_centre` in small displacements, in constant-rate tests, whose joints assume small slopes, and if the
        force is nearly parallel to the face."""
        found = self.pressure_centre.copy()
        if self.joints.small_slopes:
            return found
        N, V_1, V_2 = np.moveaxis(self.resultants[..., :3], -1, 0)
        force = np.stack([-V_1, -V_2, N], axis=-1)
        # the axes of the face in those of the resultants
        face = np.einsum("fjik,fjlk->fjil", self._riding(self.joints.host), self.acting_axes)
        along = (force * face[..., 2, :]).sum(axis=-1)
        meets = (N > 0.0) & (along > _ALONG * np.linalg.norm(force, axis=-1))
        height = (found * face[..., 2, :2]).sum(axis=-1)
        way = np.divide(height, along, out=np.zeros_like(height), where=meets)
        point = np.concatenate([found, np.zeros((*height.shape, 1))], axis=-1) - way[..., None] * force
        return np.where(meets[..., None], np.einsum("fjil,fjl->fji", face[..., :2, :], point), found)

    @cached_property
    def pressure_place(self) -> np.ndarray:
        """(f, j, 3) m: the `pressed_arm` as a point in world coordinates, on the host of the polygon."""
        axes = self._riding(self.joints.host)
        return self.acting_origin + np.einsum("fji,fjik->fjk", self.pressed_arm, axes[:, :, :2])

    @cached_property
    def point_forces(self) -> np.ndarray | None:
        """(f, c, 3) N: force on b at every contact point, world axes; None if the history does not have them, or not
        for the requested rows."""
        if self._rows is not None:
            others = self._rows != self.joints.rows(self._frames)
            if (others | in_collapse(self._history, self._frames)).any():
                return None
        return self._values("contact_force")

    @cached_property
    def normal_forces(self) -> np.ndarray:
        """(f, c) N: normal force of every contact point.

        The recorded ones, if any; else the joint's N, distributed as by the springs: in proportion to tributary area
        times penetration.
        """
        joints = self.joints
        arms, _, areas, owner = joints.points
        if self.point_forces is not None:
            return np.maximum(np.einsum("fci,fci->fc", self.point_forces, self.acting_axes[:, owner, 2]), 0.0)
        share = areas * np.maximum(-self.relative.distance(arms, owner), 0.0)
        share = np.where(joints.sum_of_points(share)[:, owner] > 0.0, share, areas)  # by area if no point is pressed
        return self.resultants[:, owner, 0] * share / joints.sum_of_points(share)[:, owner]

    @property
    def utilisation(self) -> np.ndarray:
        """(f, j): utilisation of the strength of each joint, the greater of friction and bending: 1 if it slides or
        twists, and 1 at a hinge."""
        if self.joints.custom:
            return self.friction_utilisation
        return np.fmax(self.friction_utilisation, self.bending_utilisation)

    @cached_property
    def bending_utilisation(self) -> np.ndarray:
        """(f, j): eccentricity of the `pressed_arm` from O over its limit, the edge of the region that can carry N: the
        polygon of a convex joint, else the hull of the contact points; 1 is a hinge. In a joint that crushes, the limit
        is reduced by the strip that bears N at f_c; N over f_c A if that is greater. For an intact bond, tension over
        tensile strength. 0 if the joint carries nothing; NaN if it was cut as it slid over an edge, see
        `friction_utilisation`, or has lost part of a tensile bond and its contact forces were not recorded."""
        joints, N = self.joints, self.resultants[..., 0]
        found, bonds = eccentricity_utilisation(joints, N, self.pressed_arm), joints.bonds
        if bonds is not None:
            found = np.where(self._held == 1.0, bonds.tension_utilisation(self.resultants), found)
            found = np.fmax(found, crushed_share(joints, N))
            pulls = self._loose & (bonds.tension > 0.0)
            found[pulls] = np.nan if self._points_use is None else self._points_use[0][pulls]
        found[self._cut & self.resultants[..., :6].any(axis=2)] = np.nan
        return found

    @property
    def _loose(self) -> np.ndarray:
        """(f, j): whether part of the bond is lost and part of it holds, as points break one after another."""
        return (self._held > 0.0) & (self._held < 1.0)

    @cached_property
    def _points_use(self) -> tuple[np.ndarray, np.ndarray] | None:
        """(f, j) and (f, j): greatest tension over tensile strength at a contact point of each joint, and greatest
        shear over the strength of a bonded point; None if contact forces were not recorded."""
        if self.point_forces is None:
            return None
        axes = self.acting_axes[:, self.joints.points[3]]
        forces = np.einsum("fcik,fck->fci", axes, self.point_forces)
        return self.joints.bonds.use_of_points(forces, self.joints.points[2] if self._areas is None else self._areas)

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
        """(f, c) m2: areas of the contact points; None if the history, an older one, does not have them."""
        return self._values("contact_area")

    @property
    def held(self) -> np.ndarray | None:
        """(f, j): share of each joint's area whose bond holds; None if no joint has more than friction."""
        return None if self.joints.bonds is None else self._held

    @cached_property
    def point_strength(self) -> np.ndarray | None:
        """(f, c) N: shear strength of every contact point; None if no joint has more than friction."""
        bonds = self.joints.bonds
        if bonds is None:
            return None
        recorded, area = self.point_forces is not None, self.joints.points[2] if self._areas is None else self._areas
        return bonds.point_strength(self.resultants, self._held, self.normal_forces, recorded, area)

    @cached_property
    def _held(self) -> np.ndarray:
        """(f, j): share of each joint's area whose bond holds; zero if it never had one."""
        found = self._values("bond")
        return np.where(self.joints.bonds.bonded, 0.0 if found is None else found, 0.0)

    @cached_property
    def friction_utilisation(self) -> np.ndarray:
        """(f, j): gauge of (V_1, V_2, M_T) in the joint's limit set at its N; 1 is the boundary of the yield domain.

        ``convex``: the exact surface of the polygon under the pressure of its law. Point formulations: the set of all
        forces that Coulomb friction at the points can give, each under its own normal force. Bonds add their cohesion
        as long as they hold. For a joint without friction strength it is 0 if the joint carries nothing, else infinite.
        If contact forces were not recorded, it may exceed 1 for a joint that touches at a corner with almost no force.
        NaN for a joint that was cut as it slid over an edge, unless its contact points were recorded, since its polygon
        is not known, and for joints in contact with a user-defined law. For a joint whose bonds break one after another
        it is 1 when the next one breaks; NaN if its contact forces were not recorded.
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
        if joints.bonds is not None:  # the next bond to break sets the utilisation, not the mean of both strengths
            apart = self._loose & (joints.bonds.brittle | (joints.bonds.tension > 0.0))
            if self._points_use is not None:
                apart &= joints.bonds.brittle
            found[apart] = np.nan if self._points_use is None else self._points_use[1][apart]
        return found

    def _shear_arms(self, k: int, arms: np.ndarray) -> np.ndarray:
        """Points where friction acts (2, c) m, from the current O in the ``k``-th frame: the ``arms`` (c, 2) of the
        points, which are from the initial O, moved to the current O and scaled by the initial ratio of shear arms to
        normal arms."""
        normal, shear, _, owner = self.joints.points
        size = np.zeros((2, self.joints.n_joint))
        for row, points in zip(size, (normal, shear), strict=True):
            np.maximum.at(row, owner, np.abs(points).max(axis=1))
        ratio = np.divide(size[1], size[0], out=np.ones_like(size[0]), where=size[0] > 0.0)
        return np.ascontiguousarray((ratio[owner, None] * (arms - self.shift[k, owner])).T)
