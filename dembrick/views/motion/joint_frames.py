"""The joints of a recorded run in some of its frames: motion, forces, utilisation; see `motion.joints`."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from dembrick.geometry.rotations import quaternion_product, rotation_vector, turned_by, turning
from dembrick.kernels.joint.utilisation import area_gauges, point_gauges
from dembrick.simulation.joint_laws import pressed_parts
from dembrick.views.motion.bending import crushed_share, way_to_edge
from dembrick.views.motion.frames import coming_down
from dembrick.views.motion.relative import RelativeMotion

if TYPE_CHECKING:
    from dembrick.views.motion.joints import JointMotion

CHANNELS = ("N", "V_1", "V_2", "M_T", "M_1", "M_2", "slip")
_ALONG = 0.1  # of a force: with less of it across a face its line of action meets that far away


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
        return self._riding(self.joints.block_a)

    @property
    def seen_axes(self) -> np.ndarray:
        """(f, j, 3, 3): the axes, world, as rows, along which an observer on a sees motion and forces: the `axes`; in
        the geometry of the start those of the start."""
        return self.acting_axes if self.joints.small else self.axes

    def _riding(self, blocks: np.ndarray) -> np.ndarray:
        """(f, j, 3, 3): the joints' axes riding on one of the blocks (j,) of each, world, as rows."""
        axes = self.joints.axes
        return axes + turning(self._turned[:, blocks, None], axes)

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
        into the plane of the other's face, t2, and the normal of that face from a to b. In the geometry of the start
        those of the start: forces do not turn with the blocks there."""
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
        """(f, j, 7): N, V_1, V_2, M_T, M_1, M_2 (N, N m; b on a, about O of now) and slip (m), of the nearest row."""
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
    def about_start(self) -> np.ndarray:
        """(f, j, 7): the `resultants`, their moments about O of the start. They are recorded about the centroid of what
        is left of a joint that was cut as it slid over an edge, and one law cuts it later than another."""
        found, (s_1, s_2) = self.resultants.copy(), np.moveaxis(self.shift, -1, 0)
        N, V_1, V_2 = np.moveaxis(self.resultants[..., :3], -1, 0)
        found[..., 3] += s_1 * V_2 - s_2 * V_1
        found[..., 4] -= s_2 * N
        found[..., 5] += s_1 * N
        return found

    @cached_property
    def pressure_centre(self) -> np.ndarray:
        """(f, j, 2) m: the centre of pressure (M_2, -M_1) / N from O; O where the joint carries no N."""
        N, _, _, _, M_1, M_2, _ = np.moveaxis(self.resultants, -1, 0)
        moments = np.stack([M_2, -M_1], axis=-1)
        return np.divide(moments, N[..., None], out=np.zeros_like(moments), where=N[..., None] > 0.0)

    @cached_property
    def pressed_arm(self) -> np.ndarray:
        """(f, j, 2) m: where the line of action of each joint's force meets the face that the polygon rides on, from O
        along that face's own t1 and t2: the toe of a block that rocks, however far. In the geometry of the start, in
        tests at a constant rate, whose joints take slopes for small, and where the force runs along the face, the
        `pressure_centre`."""
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
        """(f, j, 3) m: the `pressed_arm` in the world, on the block that the polygon rides on."""
        axes = self._riding(self.joints.host)
        return self.acting_origin + np.einsum("fji,fjik->fjk", self.pressed_arm, axes[:, :, :2])

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
        """(f, j): how far the `pressed_arm` is on its way from O to the edge of what can carry N: the polygon of a
        convex joint, that around the contact points else; 1 is a hinge. A joint that crushes ends nearer to O, by as
        much as N presses at f_c; N over f_c A if that is more. Of a bond that holds, tension over strength.
        0 if the joint carries nothing, NaN if it was cut as it slid over an edge, see `friction_utilisation`, and if it
        has lost part of a bond that pulls and its contact forces were not recorded."""
        joints, N = self.joints, self.resultants[..., 0]
        found, bonds = way_to_edge(joints, N, self.pressed_arm), joints.bonds
        if bonds is not None:
            found = np.where(self._held == 1.0, bonds.tension_utilisation(self.resultants), found)
            found = np.fmax(found, crushed_share(joints, N))
            pulls = self._loose & (bonds.tension > 0.0)
            found[pulls] = np.nan if self._points_use is None else self._points_use[0][pulls]
        found[self._cut & self.resultants[..., :6].any(axis=2)] = np.nan
        return found

    @property
    def _loose(self) -> np.ndarray:
        """(f, j): whether part of the bond is lost and part of it holds; only points break one after another."""
        return (self._held > 0.0) & (self._held < 1.0)

    @cached_property
    def _points_use(self) -> tuple[np.ndarray, np.ndarray] | None:
        """(f, j) and (f, j): the greatest pull over tensile strength at a contact point of each joint, and the greatest
        shear over what a bonded point bears; None if contact forces were not recorded."""
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
        all that touch by a law of the user's own, which is not known either. A joint whose bonds break one after
        another is at 1 where the next one does; NaN if its contact forces were not recorded.
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
        if joints.bonds is not None:  # the next bond to give way says how much is used, not the mean of both strengths
            apart = self._loose & (joints.bonds.brittle | (joints.bonds.tension > 0.0))
            if self._points_use is not None:
                apart &= joints.bonds.brittle
            found[apart] = np.nan if self._points_use is None else self._points_use[1][apart]
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
