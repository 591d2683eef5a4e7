"""From the immutable geometry to the arrays of the kernels, and the stiffness that sets time step and inertia.

Nothing here knows what a yield point is, or what the answer of a test should be.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dembrick import limit_set, polygons
from dembrick.model import PRESSURES
from dembrick.state import Areas, Blocks, Energy, Jacks, Joints, Points, Pressed


class State(NamedTuple):
    """Everything a run changes; ``points`` or ``areas`` is None where no joint is of that family."""

    blocks: Blocks
    joints: Joints
    points: Points | None
    areas: Areas | None
    jacks: Jacks


def initial_state(assembly) -> State:
    """State at the start: nothing displaced, no force in any joint, no force in any jack."""
    n = len(assembly.names)
    blocks = Blocks(
        free=np.flatnonzero(~assembly.fixed).astype(np.int64),
        displacement=np.zeros((n, 3)),
        rotation=np.zeros((n, 3)),
        orientation=np.array(assembly.orientation, float),
        velocity=np.zeros((n, 3)),
        spin=np.zeros((n, 3)),
        mean_velocity=np.zeros((n, 6)),
        momentum=np.zeros((n, 3)),
        force=np.zeros((n, 3)),
        torque=np.zeros((n, 3)),
        dead_force=np.array(assembly.dead_force, float),
        dead_torque=np.array(assembly.dead_torque, float),
    )
    jacks = _jacks(assembly)
    return State(blocks, _joints(assembly), _points(assembly), _areas(assembly), jacks)


def _jacks(assembly) -> Jacks:
    actuators = assembly.actuators
    arm = np.array(actuators.arm, float).reshape(-1, 3)
    rotation = assembly.rotation[actuators.block]
    return Jacks(
        block=np.array(actuators.block, np.int64),
        arm=arm,
        lever=np.einsum("kji,kj->ki", rotation, arm),
        start=arm.copy(),
        direction=np.array(actuators.direction, float).reshape(-1, 3),
        weight=np.array(actuators.weight, float),
        displacement=np.zeros(len(arm)),
        drive=np.zeros(5),
    )


def _joints(assembly) -> Joints:
    joints = assembly.joints
    axes = np.array([joint.axes for joint in joints]).reshape(-1, 3, 3)
    a = np.array([joint.block_a for joint in joints], np.int64)
    b = np.array([joint.block_b for joint in joints], np.int64)
    arm_a = np.array([joint.arm_a for joint in joints]).reshape(-1, 3)
    arm_b = np.array([joint.arm_b for joint in joints]).reshape(-1, 3)
    rotation_a, rotation_b = assembly.rotation[a], assembly.rotation[b]
    return Joints(
        block_a=a,
        block_b=b,
        host=np.array([1.0 if joint.host == joint.block_b else -1.0 for joint in joints]),
        axes=axes,
        arm_a=arm_a,
        arm_b=arm_b,
        axes_a=axes @ rotation_a,
        axes_b=axes @ rotation_b,
        lever_a=np.einsum("jik,ji->jk", rotation_a, arm_a),
        lever_b=np.einsum("jik,ji->jk", rotation_b, arm_b),
        offset=arm_a - arm_b,
        gap=np.array([joint.gap for joint in joints], float),
        relative=np.zeros((len(joints), 6)),
        opening=np.zeros((len(joints), 3)),
        step=np.zeros((len(joints), 3)),
        tilt=np.zeros((len(joints), 2)),
        resultant=np.zeros((len(joints), 7)),
    )


def _points(assembly) -> Points | None:
    chosen = [j for j, points in enumerate(assembly.contact_points) if points is not None]
    if not chosen:
        return None
    sets = [assembly.contact_points[j] for j in chosen]
    laws = [assembly.joints[j].law for j in chosen]
    counts = [len(s.area) for s in sets]
    normal_arm = np.concatenate([s.normal_arm for s in sets])
    shear_arm = np.concatenate([s.shear_arm for s in sets])
    total = sum(counts)
    return Points(
        joint=np.array(chosen, np.int64),
        start=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        friction=np.array([law.friction for law in laws]),
        x_n=normal_arm[:, 0].copy(),
        y_n=normal_arm[:, 1].copy(),
        x_s=shear_arm[:, 0].copy(),
        y_s=shear_arm[:, 1].copy(),
        k_n=np.concatenate([law.normal_stiffness * s.area for law, s in zip(laws, sets, strict=True)]),
        k_s=np.concatenate([law.shear_stiffness * s.area for law, s in zip(laws, sets, strict=True)]),
        normal=np.zeros(total),
        elastic_1=np.zeros(total),
        elastic_2=np.zeros(total),
        slip=np.zeros(total),
    )


def _areas(assembly) -> Areas | None:
    chosen = [j for j, points in enumerate(assembly.contact_points) if points is None]
    if not chosen:
        return None
    joints = [assembly.joints[j] for j in chosen]
    shapes = [np.asarray(joint.polygon, float) for joint in joints]
    corners = np.concatenate(shapes)
    return Areas(
        joint=np.array(chosen, np.int64),
        start=np.concatenate([[0], np.cumsum([len(s) for s in shapes])]).astype(np.int64),
        friction=np.array([joint.law.friction for joint in joints]),
        x=corners[:, 0].copy(),
        y=corners[:, 1].copy(),
        area=np.array([joint.area for joint in joints]),
        second=np.array([polygons.second_moments(s) for s in shapes]),
        reach=np.array([np.sqrt((s**2).sum(axis=1).max()) for s in shapes]),
        radius=np.array([limit_set.area_radius(s) for s in shapes]),
        far=np.array([limit_set.far_moments(s) for s in shapes]),
        k_n=np.array([joint.law.normal_stiffness for joint in joints]),
        k_s=np.array([joint.law.shear_stiffness for joint in joints]),
        elastic=np.zeros((len(joints), 3)),
        twist=np.zeros((len(joints), 3)),
        slip=np.zeros(len(joints)),
        evaluations=np.zeros(len(joints), np.int64),
        pressed=pressed_room([joint.law.pressure for joint in joints], [len(s) for s in shapes]),
    )


def pressed_room(pressures: Sequence[str], corners: Sequence[int]) -> Pressed | None:
    """Room for the pressed parts of convex joints; the first forces fill it."""
    if all(pressure == "full" for pressure in pressures):
        return None
    room = [2 * m + 2 for m in corners]  # every edge of the reflected polygon can add a corner
    a, total = len(room), sum(room)
    return Pressed(
        kind=np.array([PRESSURES.index(pressure) for pressure in pressures], np.int64),
        start=np.cumsum([0, *room[:-1]]).astype(np.int64),
        count=np.zeros(a, np.int64),
        x=np.zeros(total),
        y=np.zeros(total),
        spare_x=np.zeros(total),
        spare_y=np.zeros(total),
        centre=np.zeros((a, 2)),
        density=np.zeros((a, 3)),
        reach=np.zeros(a),
        radius=np.ones(a),
    )


def joint_stiffness(state: State) -> np.ndarray:
    """Elastic stiffness (j, 6, 6) of every closed joint against (d1, d2, dn, r1, r2, rn) of b at O."""
    k = np.zeros((len(state.joints.block_a), 6, 6))
    if state.points is not None:
        p = state.points
        for i, j in enumerate(p.joint):
            s = slice(p.start[i], p.start[i + 1])
            one, zero = np.ones(s.stop - s.start), np.zeros(s.stop - s.start)
            x, y = p.x_s[s], p.y_s[s]
            first = np.stack([one, zero, zero, zero, zero, -y])
            second = np.stack([zero, one, zero, zero, zero, x])
            normal = np.stack([zero, zero, one, p.y_n[s], -p.x_n[s], zero])
            k[j] = (first * p.k_s[s]) @ first.T + (second * p.k_s[s]) @ second.T + (normal * p.k_n[s]) @ normal.T
    if state.areas is not None:
        a = state.areas
        for i, j in enumerate(a.joint):
            yy, xx, xy = a.second[i]
            k[j, 0, 0] = k[j, 1, 1] = a.k_s[i] * a.area[i]
            k[j, 5, 5] = a.k_s[i] * (xx + yy)
            k[j, 2, 2] = a.k_n[i] * a.area[i]
            k[j, 3, 3] = a.k_n[i] * yy
            k[j, 4, 4] = a.k_n[i] * xx
            k[j, 3, 4] = k[j, 4, 3] = -a.k_n[i] * xy
    return k


def _lever(arm: np.ndarray) -> np.ndarray:
    """Matrix of the cross product arm x (.)."""
    x, y, z = arm
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def to_joint(axes: np.ndarray, arm: np.ndarray) -> np.ndarray:
    """Matrix (6, 6) from the motion (u, r) of a block about its centroid to that of O in the joint's axes."""
    matrix = np.zeros((6, 6))
    matrix[:3, :3] = matrix[3:, 3:] = axes
    matrix[:3, 3:] = -axes @ _lever(arm)
    return matrix


def block_stiffness(state: State, shared: float) -> np.ndarray:
    """Stiffness (n, 6, 6) of each block about its centroid with all its neighbours held; zero for fixed blocks.

    A joint between two free blocks counts ``shared`` times. With 2 the block matrices together bound the stiffness of
    the assembly, because an element stores at most twice the energy of its two one-sided parts.
    """
    joints = state.joints
    n = len(state.blocks.displacement)
    stiffness = np.zeros((n, 6, 6))
    free = np.zeros(n, bool)
    free[state.blocks.free] = True
    for j, k in enumerate(joint_stiffness(state)):
        a, b = joints.block_a[j], joints.block_b[j]
        weight = shared if free[a] and free[b] else 1.0
        for block, arm in ((a, joints.arm_a[j]), (b, joints.arm_b[j])):
            if free[block]:
                t = to_joint(joints.axes[j], arm)
                stiffness[block] += weight * (t.T @ k @ t)
    return stiffness


def couplings(state: State) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Off-diagonal stiffness between free blocks: indices a (c,), b (c,) and blocks K_ab (c, 6, 6), a joint each."""
    joints = state.joints
    free = np.zeros(len(state.blocks.displacement), bool)
    free[state.blocks.free] = True
    chosen = np.flatnonzero(free[joints.block_a] & free[joints.block_b])
    stiffness = joint_stiffness(state)
    blocks = np.zeros((len(chosen), 6, 6))
    for i, j in enumerate(chosen):
        left, right = (to_joint(joints.axes[j], arm[j]) for arm in (joints.arm_a, joints.arm_b))
        blocks[i] = -left.T @ stiffness[j] @ right
    return joints.block_a[chosen], joints.block_b[chosen], blocks


def assembled_stiffness(state: State) -> np.ndarray:
    """Dense stiffness (6 f, 6 f) of the f free blocks with all joints closed and none slipping, in their order."""
    joints, free = state.joints, state.blocks.free
    number = np.full(len(state.blocks.displacement), -1)
    number[free] = np.arange(len(free))
    stiffness = np.zeros((6 * len(free), 6 * len(free)))
    for j, k in enumerate(joint_stiffness(state)):
        ends = [
            (number[block], sign * to_joint(joints.axes[j], arm))
            for block, arm, sign in (
                (joints.block_a[j], joints.arm_a[j], -1.0),
                (joints.block_b[j], joints.arm_b[j], 1.0),
            )
            if number[block] >= 0
        ]
        for m, left in ends:
            for n, right in ends:
                stiffness[6 * m : 6 * m + 6, 6 * n : 6 * n + 6] += left.T @ k @ right
    return stiffness


def load_vectors(state: State) -> np.ndarray:
    """Force and moment about the centroid (n, 6) on every block for V = 1."""
    jacks = state.jacks
    load = np.zeros((len(state.blocks.displacement), 6))
    force = jacks.direction * jacks.weight[:, None]
    np.add.at(load, jacks.block, np.concatenate([force, np.cross(jacks.arm, force)], axis=1))
    return load


def new_energy(state: State) -> Energy:
    """Empty books for a run that starts from ``state``."""
    points = 0 if state.points is None else len(state.points.k_n)
    areas = 0 if state.areas is None else len(state.areas.joint)
    return Energy(
        work=np.zeros(6),
        least=np.zeros(1),
        start=np.zeros(1),
        dash_1=np.zeros(points),
        dash_2=np.zeros(points),
        dash_n=np.zeros(points),
        area_dash=np.zeros((areas, 6)),
        jack=np.zeros(2),
    )
