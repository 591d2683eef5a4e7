"""State of statics: the arrays of the kernels, made from the immutable geometry of an assembly."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dembrick.assembly.joints import JointTable
from dembrick.geometry.rotations import rotation_matrix, turned_by
from dembrick.kernels.state import DRIVEN, WORK, Actuators, Blocks, Energy, Joints
from dembrick.kernels.statics.area_joints import Areas
from dembrick.kernels.statics.point_joints import Points
from dembrick.kernels.statics.state import State as KernelState
from dembrick.simulation.statics import joint_families, ties

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.kernels.joint.ties import Ties as MovingTies
    from dembrick.simulation.statics.ties import Ties


class State(NamedTuple):
    """Everything a run changes; ``points`` or ``areas`` is None if no joint is of that family."""

    blocks: Blocks
    joints: Joints
    points: Points | None
    areas: Areas | None
    actuators: Actuators
    ties: Ties | None = None


def for_kernels(state: State, moving: MovingTies | None = None) -> KernelState:
    """The state for the kernels, with ties in ``moving`` geometry, if any; the forces of other ties are dead loads."""
    return KernelState(*state[:5], moving)


def initial_state(assembly: Assembly) -> State:
    """State at the start: nothing displaced, no force in any joint, no force in any actuator."""
    dead_force, dead_torque = np.array(assembly.dead_force, float), np.array(assembly.dead_torque, float)
    free = np.flatnonzero(~assembly.fixed).astype(np.int64)
    guided = assembly.guided
    held = guided, np.ascontiguousarray(assembly.held[guided])
    blocks = blocks_at_rest(free, np.array(assembly.orientation, float), dead_force, dead_torque, held)
    actuators = _actuators(assembly)
    return State(blocks, _joints(assembly), *joint_families.at_rest(assembly), actuators, ties.at_rest(assembly))


def blocks_at_rest(
    free: np.ndarray, orientation: np.ndarray, dead_force: np.ndarray, dead_torque: np.ndarray,
    held: tuple[np.ndarray, np.ndarray] | None = None,
) -> Blocks:  # fmt: skip
    """Blocks that have not moved; the arguments are fields of `Blocks`, ``held``: `guided` and `held`."""
    n = len(orientation)
    guided, directions = held or (np.zeros(0, np.int64), np.zeros((0, 6), bool))
    vectors = ("displacement", "rotation", "velocity", "spin", "momentum", "force", "torque")
    return Blocks(
        free=free,
        orientation=orientation,
        mean_velocity=np.zeros((n, 6)),
        dead_force=dead_force,
        dead_torque=dead_torque,
        guided=guided.astype(np.int64),
        held=directions,
        guide=np.zeros((len(guided), 6)),
        **{name: np.zeros((n, 3)) for name in vectors},
    )


def joints_at_rest(**fixed: np.ndarray) -> Joints:
    """Joints without motion and forces; ``fixed``: the fields of `Joints` that never change."""
    n = len(fixed["block_a"])
    return Joints(
        damping=np.ones(n),
        relative=np.zeros((n, 6)),
        opening=np.zeros((n, 3)),
        step=np.zeros((n, 3)),
        tilt=np.zeros((n, 2)),
        resultant=np.zeros((n, 7)),
        **fixed,
    )


def rotations(state: State) -> np.ndarray:
    """Present rotation matrices (n, 3, 3) from body axes to the world."""
    blocks = state.blocks
    return rotation_matrix(turned_by(blocks.rotation, blocks.orientation))


def _actuators(assembly: Assembly) -> Actuators:
    actuators = assembly.actuators
    return Actuators(
        block=actuators.at.block.copy(),
        arm=actuators.at.arm.copy(),
        lever=actuators.at.lever.copy(),
        start=actuators.at.arm.copy(),
        direction=np.array(actuators.direction, float, order="C").reshape(-1, 3),
        weight=np.array(actuators.weight, float),
        zero=np.zeros(len(actuators.at)),
        displacement=np.zeros(len(actuators.at)),
        driven=np.zeros(1, DRIVEN),
    )


def _joints(assembly: Assembly) -> Joints:
    table = JointTable.of(assembly.joints)
    a, b = table.block_a, table.block_b
    rotation_a, rotation_b = assembly.rotation[a], assembly.rotation[b]
    return joints_at_rest(
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
    )


def load_vectors(state: State, guides: bool = True) -> np.ndarray:
    """Force and moment about the centroid (n, 6) on every block for V = 1, without the parts that ``guides`` carry."""
    actuators = state.actuators
    load = np.zeros((len(state.blocks.displacement), 6))
    force = actuators.direction * actuators.weight[:, None]
    np.add.at(load, actuators.block, np.concatenate([force, np.cross(actuators.arm, force)], axis=1))
    if guides:
        load[state.blocks.guided] *= ~state.blocks.held  # loads along held directions act on the guide alone
    return load


def turned_blocks(state: State) -> np.ndarray:
    """The free blocks with a dead torque (t,)."""
    free = state.blocks.free
    return free[np.any(state.blocks.dead_torque[free] != 0.0, axis=1)]


def new_energy(state: State) -> Energy:
    """Energy terms, all zero, of a run that starts from ``state``."""
    return Energy(
        work=np.zeros(1, WORK),
        turned=turned_blocks(state),
        dash=np.zeros((len(state.joints.block_a) + 1, 6)),
        normal=joint_families.normal_sums(state),
    )


def move_actuators(state: State) -> None:
    """Update the displacements of the actuators to the small motion of their blocks."""
    blocks, actuators = state.blocks, state.actuators
    turned = np.cross(blocks.rotation[actuators.block], actuators.arm)
    since_start = ((blocks.displacement[actuators.block] + turned) * actuators.direction).sum(axis=1)
    actuators.displacement[:] = since_start - actuators.zero


def zero_actuators(state: State) -> None:
    """Set the zero of the actuators to the present positions of the blocks, without a force."""
    actuators = state.actuators
    actuators.zero[:] = 0.0
    move_actuators(state)
    actuators.zero[:] = actuators.displacement
    actuators.displacement[:] = actuators.driven["head"] = actuators.driven["displacement"] = 0.0
