"""Equilibrium of the free blocks as a sparse matrix: rows are forces and moments on blocks, columns are joint forces.

A structure that is symmetric in a plane, with loads in that plane, has a symmetric limit state: the
mean of any limit state and its mirror image. Then blocks have three equations instead of six, points that lie behind
one another act as one, and Coulomb's cone becomes two half-planes (`plane_of_symmetry`, `Layout`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dembrick.simulation.limit_analysis.solver import Entries
from dembrick.simulation.limit_analysis.strength import Areas, Points

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly

_SAME = 1e-9  # of the length scale: places that differ by less are the same; likewise directions and moments
_ROUNDING = 1e-14  # of the greatest force of a load: a smaller force on a block counts as zero


@dataclass(frozen=True)
class Frame:
    """The equations of the free blocks: their blocks, directions and units.

    ``free`` (f,) block numbers, ``number`` (n,) their place there, -1 if fixed; ``position`` (n, 3) of the
    centroids; ``forces`` (d, 3) and ``moments`` (m, 3): directions in the world of a block's force and moment
    equations, three each in space, two and one in a plane; ``plane`` (3,) the normal of that plane through ``middle``
    (3,), or None; ``length`` (m) and ``unit`` (N) are the units of moments and forces.
    """

    free: np.ndarray
    number: np.ndarray
    position: np.ndarray
    forces: np.ndarray
    moments: np.ndarray
    plane: np.ndarray | None
    middle: np.ndarray
    length: float
    unit: float
    moves: np.ndarray  # (f, e) bool: whether a block may move in the direction of each of its equations

    @property
    def per_block(self) -> int:
        """Equations per block."""
        return len(self.forces) + len(self.moments)

    @property
    def rows(self) -> int:
        """Equations of all blocks."""
        return self.per_block * len(self.free)

    def vector(self, wrench: np.ndarray) -> np.ndarray:
        """Wrenches (n, 6) in N and N m on all blocks as a right-hand side."""
        own = wrench[self.free] / self.unit
        values = np.concatenate([own[:, :3] @ self.forces.T, own[:, 3:] @ self.moments.T / self.length], axis=1)
        return (values * self.moves).ravel()

    def velocities(self, y: np.ndarray) -> np.ndarray:
        """Velocities (n, 6) of all blocks, translation and rotation, from the duals ``y`` of the equations."""
        own, d = y.reshape(len(self.free), -1) * self.moves, len(self.forces)
        moved = np.zeros((len(self.number), 6))
        moved[self.free, :3] = own[:, :d] @ self.forces
        moved[self.free, 3:] = own[:, d:] @ self.moments / self.length
        return moved

    def wrenches(self, ends, place, force, moment, column) -> Entries:
        """Entries of actions: ``force`` (k, 3) at ``place`` (k, 3) and ``moment`` (k, 3) or None on the second block of
        ``ends``, the opposite on the first; ``column`` (k,) of each."""
        parts = []
        for block, sign in zip(ends, (-1.0, 1.0), strict=True):
            row = self.number[block]
            on = row >= 0
            turning = np.cross(place[on] - self.position[block[on]], force[on])
            if moment is not None:
                turning = turning + moment[on]
            values = np.concatenate([force[on] @ self.forces.T, turning @ self.moments.T / self.length], axis=1)
            values = values * self.moves[row[on]]
            at = self.per_block * row[on, None] + np.arange(self.per_block)
            parts.append(
                Entries(
                    at.ravel(), np.broadcast_to(np.asarray(column)[on, None], at.shape).ravel(), sign * values.ravel()
                )
            )
        return Entries.joined(*parts)


def frame_of(assembly: Assembly, loads: list[np.ndarray], plane: np.ndarray | None) -> Frame:
    """The equations of an assembly under ``loads``, wrenches (n, 6), in space or in a ``plane`` of symmetry (3,)."""
    free = np.flatnonzero(~assembly.fixed)
    number = np.full(len(assembly.fixed), -1)
    number[free] = np.arange(len(free))
    forces, moments = np.eye(3), np.eye(3)
    if plane is not None:
        first = np.cross(plane, np.eye(3)[np.argmin(np.abs(plane))])
        first /= np.linalg.norm(first)
        forces, moments = np.array([first, np.cross(plane, first)]), plane[None]
    reach = np.linalg.norm(assembly.joints.corner, axis=1)
    length = float(np.median(reach)) if len(reach) else 1.0
    size = max([float(np.abs(wrench[free, :3]).max(initial=0.0)) for wrench in loads], default=0.0)
    return Frame(
        free=free,
        number=number,
        position=assembly.position,
        forces=forces,
        moments=moments,
        plane=plane,
        middle=assembly.position[free].mean(axis=0),
        length=length,
        unit=size or 1.0,
        moves=~_held_along(assembly.held[free], forces, moments),
    )


def _held_along(held: np.ndarray, forces: np.ndarray, moments: np.ndarray) -> np.ndarray:
    """Whether each of f blocks is ``held`` (f, 6) in the directions ``forces`` (d, 3) and ``moments`` (m, 3):
    (f, d + m). If any block is held, these directions are world axes, up to their sense (`plane_of_symmetry`)."""
    return np.concatenate([held[:, :3] @ (np.abs(forces) > 0.5).T, held[:, 3:] @ (np.abs(moments) > 0.5).T], axis=1)


def plane_of_symmetry(
    assembly: Assembly, points: Points, areas: Areas, loads: list[np.ndarray], along=()
) -> np.ndarray | None:
    """The normal (3,) of a plane in which the structure and its ``loads`` (n, 6) are symmetric, and that contains the
    directions ``along`` (3,) as well; None if there is none.

    Only planes through all centroids of the free blocks that contain all forces are tried, as of a wall or an arch
    under a load along it. Other symmetries are not used. The force and the moment of each load on each block are
    measured by themselves, as a load of 1 N is rounding next to the weight of other blocks.
    """
    free = ~assembly.fixed
    place = assembly.position[free] - assembly.position[free].mean(axis=0)
    size = max(float(np.abs(place).max(initial=0.0)), float(np.abs(assembly.joints.arm_b).max(initial=0.0)))
    forces, moments = (np.concatenate([wrench[free, part] for wrench in loads]) for part in (np.s_[:3], np.s_[3:]))
    own = np.linalg.norm(forces, axis=1).reshape(len(loads), -1)
    least = np.broadcast_to(_ROUNDING * own.max(axis=1, initial=0.0, keepdims=True), own.shape).ravel()
    own = own.ravel()
    pushed = own > least
    if not (pushed.any() and size > 0.0):
        return None
    normals = assembly.joints.axes[:, 2]
    ties = assembly.ties
    ends = ties.ends[:, 0].start(assembly.position) - assembly.position[free].mean(axis=0)
    lines = np.concatenate([ties.direction, ends / size])
    along = np.reshape(along, (-1, 3))
    directions = np.concatenate([place / size, forces[pushed] / own[pushed, None], normals, lines, along])
    _, _, axes = np.linalg.svd(directions.T @ directions)
    plane = axes[2]
    plane = plane * np.sign(plane[np.argmax(np.abs(plane))])
    if float(np.abs(directions @ plane).max()) > _SAME:
        return None
    if len(assembly.guided) and float(np.abs(plane).max()) < 1.0 - _SAME:
        return None  # guides hold along world axes, which are then not those of the plane
    across = moments - np.outer(moments @ plane, plane)
    rounded = _SAME * (size * own + np.linalg.norm(moments, axis=1)) + size * least
    if (np.linalg.norm(across, axis=1) > rounded).any():
        return None
    middle = assembly.position[free].mean(axis=0)
    for merged in (_merged_points(assembly, points, plane, middle), _merged_corners(assembly, areas, plane, middle)):
        if float(np.abs(merged.aside).max(initial=0.0)) > _SAME * size:
            return None
    return plane


@dataclass(frozen=True)
class Merged:
    """Groups of members behind one another across a plane, which act as one: ``group`` (p,) of each member, ``share``
    (p,) of the group's force that it takes, ``first`` (g,): a member of every group; ``aside`` (g,): distance (m) of
    the centre of the shares from the plane, which must be zero."""

    group: np.ndarray
    share: np.ndarray
    first: np.ndarray
    aside: np.ndarray

    def total(self, values: np.ndarray) -> np.ndarray:
        """Sums over the groups (g,)."""
        return np.bincount(self.group, values, minlength=len(self.first))


def _along(assembly: Assembly, joint: np.ndarray, plane: np.ndarray, arm: np.ndarray):
    """Coordinates of arms (p, 2) in their joints along the plane and across it (p,)."""
    axes = assembly.joints.axes[joint]
    tangent = np.cross(plane, axes[:, 2])
    place = np.einsum("pi,pik->pk", arm, axes[:, :2])
    return np.einsum("pk,pk->p", place, tangent), place @ plane


def _merged(keys: np.ndarray, weight: np.ndarray, across: list[np.ndarray]) -> Merged:
    _, first, group = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    group = group.ravel()
    share = weight / np.bincount(group, weight)[group] if len(group) else weight
    aside = [np.bincount(group, share * off, minlength=len(first)) for off in across]
    return Merged(group, share, first, np.concatenate(aside) if len(group) else np.zeros(0))


def _merged_points(assembly: Assembly, points: Points, plane: np.ndarray, middle: np.ndarray) -> Merged:
    off = (assembly.joints.origin - middle) @ plane
    (s, d), (s_shear, d_shear) = (
        _along(assembly, points.joint, plane, arm) for arm in (points.normal_arm, points.shear_arm)
    )
    size = max(float(np.abs(points.normal_arm).max(initial=0.0)), 1e-300)
    keys = np.stack([points.joint, *(np.round(along / (1e-6 * size)) for along in (s, s_shear))], axis=1)
    return _merged(keys, points.area, [d + off[points.joint], d_shear + off[points.joint]])


def _merged_corners(assembly: Assembly, areas: Areas, plane: np.ndarray, middle: np.ndarray) -> Merged:
    joint = areas.joint[areas.owner]
    off = (assembly.joints.origin - middle) @ plane
    s, d = _along(assembly, joint, plane, areas.corner)
    size = max(float(np.abs(areas.corner).max(initial=0.0)), 1e-300)
    keys = np.stack([joint, np.round(s / (1e-6 * size))], axis=1)
    merged = _merged(keys, np.ones(len(s)), [d + off[joint]])
    aside = np.concatenate([merged.aside, off[areas.joint]])
    return Merged(merged.group, merged.share, merged.first, aside)


class Layout:
    """The unknown joint forces of a structure, in units of ``frame.unit``, and their places in the vector of unknowns.

    Points: N and the tangential forces, one after another, ``width`` 3 (or 2 in a plane) per point. Then area joints:
    first the normal forces at all corners, then V_1, V_2 and M_T / gyration (or V in a plane) per joint. Then the
    tension of every tie. Tangential forces without cohesion are in units of the friction coefficient, so that their
    cone is the same for all, and exact for zero friction.
    """

    def __init__(self, assembly: Assembly, frame: Frame, points: Points, areas: Areas):
        self.frame, self.points, self.areas, self._assembly = frame, points, areas, assembly
        self.ties = assembly.ties
        joints, flat = assembly.joints, frame.plane is not None
        self.flat = flat
        if flat:
            self.point_groups = _merged_points(assembly, points, frame.plane, frame.middle)
            self.corner_groups = _merged_corners(assembly, areas, frame.plane, frame.middle)
        else:
            self.point_groups = _each(len(points.joint))
            self.corner_groups = _each(len(areas.corner))
        first = self.point_groups.first
        self.joint = points.joint[first]
        self.friction = points.friction[first]
        self.width, self.n_point = (2 if flat else 3), len(first)
        self.corner_owner = areas.owner[self.corner_groups.first]
        self.n_corner, self.n_shear = len(self.corner_owner), (1 if flat else 3)
        self.corner_start = self.width * self.n_point
        self.shear_start = self.corner_start + self.n_corner
        self.tie_start = self.shear_start + self.n_shear * len(areas)
        self.n = self.tie_start + len(assembly.ties)
        self.tangents = self._tangents(joints.axes)
        self.adhesive = self.point_groups.total(points.adhesion) > 0.0
        self.adhesive_area = areas.adhesion > 0.0
        self.unit_of_shear = np.where(self.adhesive, 1.0, self.friction)
        self.unit_of_area_shear = np.where(self.adhesive_area, 1.0, areas.friction)

    def _tangents(self, axes: np.ndarray) -> np.ndarray:
        """Directions of the tangential forces of every joint (j, 2, 3), or (j, 1, 3) in a plane."""
        if not self.flat:
            return axes[:, :2]
        return np.cross(self.frame.plane, axes[:, 2])[:, None]

    def _place(self, joint: np.ndarray, arm: np.ndarray) -> np.ndarray:
        """Places (k, 3) of arms (k, 2) in the world, projected to the plane of symmetry if there is one."""
        joints = self._assembly.joints
        place = joints.origin[joint] + np.einsum("pi,pik->pk", arm, joints.axes[joint, :2])
        if self.flat:
            place = place - np.outer((place - self.frame.middle) @ self.frame.plane, self.frame.plane)
        return place

    def equilibrium(self, frame: Frame | None = None) -> Entries:
        """Entries (frame.rows, n) of the equilibrium matrix, of the free blocks or of those of another ``frame``."""
        joints, frame = self._assembly.joints, frame or self.frame
        parts: list[Entries] = []
        first, points, areas = self.point_groups.first, self.points, self.areas
        joint, column = self.joint, self.width * np.arange(self.n_point)
        ends = joints.block_a[joint], joints.block_b[joint]
        normal = joints.axes[:, 2]
        parts.append(frame.wrenches(ends, self._place(joint, points.normal_arm[first]), normal[joint], None, column))
        sheared = self._place(joint, points.shear_arm[first])
        for i in range(self.width - 1):
            force = self.unit_of_shear[:, None] * self.tangents[joint, i]
            parts.append(frame.wrenches(ends, sheared, force, None, column + 1 + i))
        at = self.corner_groups.first
        joint = areas.joint[self.corner_owner]
        ends = joints.block_a[joint], joints.block_b[joint]
        place, column = self._place(joint, areas.corner[at]), self.corner_start + np.arange(self.n_corner)
        parts.append(frame.wrenches(ends, place, normal[joint], None, column))
        joint, unit = areas.joint, self.unit_of_area_shear[:, None]
        ends = joints.block_a[joint], joints.block_b[joint]
        place, column = joints.origin[joint], self.shear_start + self.n_shear * np.arange(len(areas))
        for i in range(min(self.n_shear, 2)):
            parts.append(frame.wrenches(ends, place, unit * self.tangents[joint, i], None, column + i))
        if not self.flat:
            turning = unit * areas.gyration[:, None] * normal[joint]
            parts.append(frame.wrenches(ends, place, np.zeros_like(turning), turning, column + 2))
        ties = self._assembly.ties
        place = ties.ends[:, 0].start(self._assembly.position)  # the same line of action at the other end
        ends, column = tuple(ties.ends.block.T), self.tie_start + np.arange(len(ties))
        parts.append(frame.wrenches(ends, place, -ties.direction, None, column))
        return Entries.joined(*parts)

    def of_joints(self, joints: np.ndarray) -> np.ndarray:
        """Whether each unknown (n,) is a force in one of the ``joints``, given as (j,) bool."""
        at_corner, areas = joints[self.areas.joint[self.corner_owner]], joints[self.areas.joint]
        points, ties = np.repeat(joints[self.joint], self.width), np.zeros(self.n - self.tie_start, bool)
        return np.concatenate([points, at_corner, np.repeat(areas, self.n_shear), ties])

    def bond(self, frame: Frame | None = None, within: np.ndarray | None = None) -> np.ndarray:
        """Wrenches (rows,) of the tension f_t A at O from which the corner forces of area joints are measured, of all
        joints or of those ``within`` (j,) bool."""
        frame = frame or self.frame
        areas, joints, vector = self.areas, self._assembly.joints, np.zeros(frame.rows)
        if not areas.tension.any():
            return vector
        ends = joints.block_a[areas.joint], joints.block_b[areas.joint]
        tension = areas.tension / self.frame.unit * (1.0 if within is None else within[areas.joint])
        force = tension[:, None] * joints.axes[areas.joint, 2]
        found = frame.wrenches(ends, joints.origin[areas.joint], force, None, np.zeros(len(areas), np.int64))
        np.add.at(vector, found.row, found.value)
        return vector

    def forces(self, x: np.ndarray) -> JointForces:
        """The joint forces (N) of a vector of unknowns."""
        unit, areas = self.frame.unit, self.areas
        x = unit * x[: self.n]
        group, share = self.point_groups.group, self.point_groups.share
        own = x[: self.corner_start].reshape(self.n_point, self.width)
        normal = share * own[group, 0]
        tangential = share[:, None] * (self.unit_of_shear[:, None] * own[:, 1:])[group]
        if self.flat:
            tangential = tangential * self._in_joint(self.points.joint)
        corner = x[self.corner_start : self.shear_start]
        corner = self.corner_groups.share * corner[self.corner_groups.group]
        shear = self.unit_of_area_shear[:, None] * x[self.shear_start : self.tie_start].reshape(-1, self.n_shear)
        resultant = np.zeros((len(areas), 3))
        if self.flat:
            resultant[:, :2] = shear * self._in_joint(areas.joint)
        else:
            resultant[:] = shear
            resultant[:, 2] *= areas.gyration
        return JointForces(normal, tangential, corner, resultant, x[self.tie_start :])

    def _in_joint(self, joint: np.ndarray) -> np.ndarray:
        """The tangent of the plane in the joints' axes t1, t2 (k, 2)."""
        return np.einsum("jik,jk->ji", self._assembly.joints.axes[joint, :2], self.tangents[joint, 0])


def _each(n: int) -> Merged:
    return Merged(np.arange(n), np.ones(n), np.arange(n), np.zeros(n))


@dataclass(frozen=True)
class JointForces:
    """Forces on the second block: at points ``normal`` (p,), ``tangential`` (p, 2); of area joints ``corner`` (v,)
    normal forces, measured from -f_t A at O, and ``shear`` (a, 3) V_1, V_2, M_T about O; ``tension`` (t,) of the ties.
    N, N m."""

    normal: np.ndarray
    tangential: np.ndarray
    corner: np.ndarray
    shear: np.ndarray
    tension: np.ndarray

    def resultants(self, points: Points, areas: Areas, n_joint: int) -> np.ndarray:
        """N, V_1, V_2, M_T, M_1, M_2 about O of every joint (j, 6): the action on block b that the joint balances, as
        in a history; the force of the joint on b is N along n less V_1 and V_2."""
        found = np.zeros((n_joint, 6))
        x, y = points.normal_arm.T
        u, v = points.shear_arm.T
        t1, t2 = -self.tangential.T
        each = np.stack([self.normal, t1, t2, u * t2 - v * t1, -y * self.normal, x * self.normal], axis=1)
        np.add.at(found, points.joint, each)
        x, y = areas.corner.T
        zero = np.zeros_like(x)
        each = np.stack([self.corner, zero, zero, zero, -y * self.corner, x * self.corner], axis=1)
        np.add.at(found, areas.joint[areas.owner], each)
        found[areas.joint, 1:4] -= self.shear
        found[areas.joint, 0] -= areas.tension
        return found
