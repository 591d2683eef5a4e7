"""From the immutable geometry to the arrays of the kernels: the state that a run starts from.

Nothing here knows what a yield point is, or what the answer of a test should be.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dembrick.assembly.contact_points import PointTable
from dembrick.assembly.joints import JointTable
from dembrick.errors import ScenarioError
from dembrick.geometry import friction_integrals, polygons
from dembrick.geometry.rotations import quaternion_product, rotation_matrix
from dembrick.kernels.state import Actuators, Areas, Blocks, Energy, Joints, Points, Pressed
from dembrick.scenario.model import PRESSURES


class State(NamedTuple):
    """Everything a run changes; ``points`` or ``areas`` is None where no joint is of that family."""

    blocks: Blocks
    joints: Joints
    points: Points | None
    areas: Areas | None
    actuators: Actuators


def initial_state(assembly) -> State:
    """State at the start: nothing displaced, no force in any joint, no force in any actuator."""
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
    actuators = _actuators(assembly)
    return State(blocks, _joints(assembly), point_joints(assembly), area_joints(assembly), actuators)


def rotations(state: State) -> np.ndarray:
    """Matrices (n, 3, 3) from body axes to the world, as the blocks stand now."""
    blocks = state.blocks
    half = 0.5 * np.sqrt((blocks.rotation**2).sum(axis=1))[:, None]
    turn = np.concatenate([np.cos(half), 0.5 * np.sinc(half / np.pi) * blocks.rotation], axis=1)
    return rotation_matrix(quaternion_product(turn, blocks.orientation))


def _actuators(assembly) -> Actuators:
    actuators = assembly.actuators
    arm = np.array(actuators.arm, float).reshape(-1, 3)
    rotation = assembly.rotation[actuators.block]
    return Actuators(
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
    table = JointTable.of(assembly.joints)
    n, a, b = len(table), table.block_a, table.block_b
    rotation_a, rotation_b = assembly.rotation[a], assembly.rotation[b]
    return Joints(
        block_a=a,
        block_b=b,
        host=np.where(table.host == b, 1.0, -1.0),
        axes=table.axes.copy(),
        arm_a=table.arm_a.copy(),
        arm_b=table.arm_b.copy(),
        axes_a=table.axes @ rotation_a,
        axes_b=table.axes @ rotation_b,
        lever_a=np.einsum("jik,ji->jk", rotation_a, table.arm_a),
        lever_b=np.einsum("jik,ji->jk", rotation_b, table.arm_b),
        offset=table.arm_a - table.arm_b,
        gap=table.gap,
        damping=np.ones(n),
        relative=np.zeros((n, 6)),
        opening=np.zeros((n, 3)),
        step=np.zeros((n, 3)),
        tilt=np.zeros((n, 2)),
        resultant=np.zeros((n, 7)),
    )


def point_joints(assembly) -> Points | None:
    """The joints of an assembly that act at points, at rest; None without any."""
    joints, table = JointTable.of(assembly.joints), PointTable.of(assembly.contact_points)
    chosen = np.flatnonzero(~table.resultant)
    if not len(chosen):
        return None
    laws = [joints.law[j] for j in chosen]
    counts = np.diff(table.start)[chosen]
    total = len(table.area)
    x_n, y_n = table.normal_arm.T.copy()
    shared = table.shear_arm is table.normal_arm
    x_s, y_s = (x_n, y_n) if shared else table.shear_arm.T.copy()
    return Points(
        joint=chosen,
        start=np.concatenate([[0], np.cumsum(counts)]),
        friction=np.array([law.friction for law in laws]),
        x_n=x_n,
        y_n=y_n,
        x_s=x_s,
        y_s=y_s,
        k_n=np.repeat([law.normal_stiffness for law in laws], counts) * table.area,
        k_s=np.repeat([law.shear_stiffness for law in laws], counts) * table.area,
        normal=np.zeros(total),
        elastic_1=np.zeros(total),
        elastic_2=np.zeros(total),
        slip=np.zeros(total),
    )


def area_joints(assembly) -> Areas | None:
    """The convex joints of an assembly, at rest; None without any."""
    joints, table = JointTable.of(assembly.joints), PointTable.of(assembly.contact_points)
    chosen = np.flatnonzero(table.resultant)
    if not len(chosen):
        return None
    laws = [joints.law[j] for j in chosen]
    if any(law.pressure == "effective" and j in joints.pieces for j, law in zip(chosen.tolist(), laws, strict=True)):
        raise ScenarioError(
            'pressure = "effective" needs convex joints, and a joint here consists of several pieces: use "linear"'
        )
    counts = np.diff(joints.start)[chosen]
    n, start = len(chosen), np.concatenate([[0], np.cumsum(counts)])
    corners = joints.corner[np.repeat(joints.start[chosen] - start[:-1], counts) + np.arange(start[-1])]
    second, reach, radius, far = np.empty((n, 3)), np.empty(n), np.empty(n), np.empty((n, 42))
    for numbers, shapes in joints.by_corners(chosen):
        some = np.searchsorted(chosen, numbers)
        second[some] = np.stack(polygons.second_moments(shapes), axis=1)
        reach[some] = np.sqrt((shapes**2).sum(axis=2).max(axis=1))
        radius[some] = friction_integrals.area_radius(shapes)
        far[some] = friction_integrals.far_moments(shapes)
    return Areas(
        joint=chosen,
        start=start,
        friction=np.array([law.friction for law in laws]),
        x=corners[:, 0].copy(),
        y=corners[:, 1].copy(),
        area=joints.area[chosen],
        second=second,
        reach=reach,
        radius=radius,
        far=far,
        k_n=np.array([law.normal_stiffness for law in laws]),
        k_s=np.array([law.shear_stiffness for law in laws]),
        elastic=np.zeros((n, 3)),
        twist=np.zeros((n, 3)),
        slip=np.zeros(n),
        evaluations=np.zeros(n, np.int64),
        pressed=pressed_room([law.pressure for law in laws], counts.tolist()),
    )


def pressed_room(pressures: Sequence[str], corners: Sequence[int]) -> Pressed | None:
    """Room for the pressed parts of convex joints; the first forces fill it."""
    if all(pressure == "full" for pressure in pressures):
        return None
    room = [2 * m + 2 for m in corners]  # every edge of the reflected polygon can add a corner
    a, total = len(room), sum(room)
    return Pressed(
        kind=np.array([PRESSURES.index(pressure) for pressure in pressures], np.int64),
        pieces=np.ones(a, np.int64),
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


def load_vectors(state: State) -> np.ndarray:
    """Force and moment about the centroid (n, 6) on every block for V = 1."""
    actuators = state.actuators
    load = np.zeros((len(state.blocks.displacement), 6))
    force = actuators.direction * actuators.weight[:, None]
    np.add.at(load, actuators.block, np.concatenate([force, np.cross(actuators.arm, force)], axis=1))
    return load


def turned_blocks(state: State) -> np.ndarray:
    """The free blocks with a dead torque (t,)."""
    free = state.blocks.free
    return free[np.any(state.blocks.dead_torque[free] != 0.0, axis=1)]


def new_energy(state: State) -> Energy:
    """Energy terms, all zero, of a run that starts from ``state``."""
    normal = np.zeros((0, 7))
    if state.points is not None:
        p, k, x, y = state.points, state.points.k_n, state.points.x_n, state.points.y_n
        terms = np.stack([k, k * x, k * y, k * x**2, k * y**2, k * x * y], axis=1)
        reach = np.maximum.reduceat(np.hypot(x, y), p.start[:-1])
        normal = np.column_stack([np.add.reduceat(terms, p.start[:-1]), reach])
    return Energy(
        work=np.zeros(9),
        turned=turned_blocks(state),
        dash=np.zeros((len(state.joints.block_a) + 1, 6)),
        normal=normal,
    )
