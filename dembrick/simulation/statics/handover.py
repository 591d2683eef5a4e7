"""Initial states of quasi-static runs, above all those that a previous run has left, and states at rest."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from dembrick.errors import ScenarioError
from dembrick.geometry.rotations import quaternion_product, rotation_vector
from dembrick.simulation.checkpoint_arrays import arrays_of
from dembrick.simulation.session import OTHER_JOINTS
from dembrick.simulation.statics import joint_families, ties
from dembrick.simulation.statics.state import State, initial_state
from dembrick.simulation.statics.stiffness import to_joint

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.scenario.stages import TiesBefore

FALLEN = 0.2  # of a joint's reach: displacement of falling blocks in the final state
MOVING = ("displacement", "rotation", "velocity", "spin", "force", "torque", "guide")  # fields of blocks, and of joints
CARRYING = ("relative", "opening", "step", "tilt", "resultant")  # that relaxation changes


def starting_state(assembly: Assembly, left: State | None, before: TiesBefore | None = None) -> State:
    """Initial state of a run: that of the geometry, or the state that another run of the same blocks has ``left``.

    Displacements and rotation vectors are measured from the geometry of the start. ``before``: which of its ties stay.
    Raises ScenarioError if the joints of both differ.
    """
    state = initial_state(assembly)
    if left is None:
        return state
    blocks = state.blocks
    blocks.displacement[:], blocks.rotation[:] = moved_before(assembly, left)
    _remember(state, left)
    ties.go_on(state, left.ties, before)
    joints = state.joints
    motion = np.concatenate([blocks.displacement, blocks.rotation], axis=1)
    joints.relative[:] = np.einsum("jik,jk->ji", to_joint(joints.axes, joints.arm_b), motion[joints.block_b])
    joints.relative[:] -= np.einsum("jik,jk->ji", to_joint(joints.axes, joints.arm_a), motion[joints.block_a])
    return state


def moved_before(assembly: Assembly, left: State | None) -> tuple[np.ndarray, np.ndarray]:
    """Displacements (n, 3; m) and rotation vectors (n, 3) in the state that a run of the same blocks has ``left``;
    zeros if there is none."""
    if left is None:
        none = np.zeros((len(assembly.names), 3))
        return none, none
    return left.blocks.displacement, left.blocks.rotation + turned_since_the_start(assembly, left)


def turned_since_the_start(assembly: Assembly, left: State) -> np.ndarray:
    """Rotation vectors (n, 3) of the finite rotations that a run stores in the orientations of its blocks."""
    before, now = assembly.orientation, left.blocks.orientation
    turn = rotation_vector(quaternion_product(now, before * [1.0, -1.0, -1.0, -1.0]))
    return np.where((now == before).all(axis=1, keepdims=True), 0.0, turn)


def _remember(state: State, left: State) -> None:
    """Copy the history of the joints of ``left`` to those of ``state``."""
    own, given = joint_families.memory_arrays(state), joint_families.memory_arrays(left)
    if {name: array.shape for name, array in own.items()} != {name: array.shape for name, array in given.items()}:
        raise ScenarioError(OTHER_JOINTS)
    for name, array in own.items():
        array[...] = given[name]


def put_back(arrays: list[tuple[np.ndarray, np.ndarray]]) -> None:
    """Write into each array the values that are paired with it."""
    for array, values in arrays:
        array[...] = values


def carried(state: State) -> np.ndarray:
    """Forces (j + t, 3) of the joints, and of the ties as (T, 0, 0), in N."""
    tension = np.zeros(0) if state.ties is None else state.ties.tension
    return np.concatenate([state.joints.resultant[:, :3], tension[:, None] * np.eye(3)[0]])


def depends_on_size(state: State) -> bool:
    """Whether a tie's prestress or strength makes the response not proportional to the loads."""
    found = state.ties
    return found is not None and bool(found.prestress.any() or (np.abs(found.tension) >= found.strength).any())


def come_to_rest(state: State) -> None:
    """Set all velocities to zero in a state in equilibrium, and update the history of its ties."""
    blocks, joints = state.blocks, state.joints
    ties.remember(state)
    for array in (blocks.velocity, blocks.spin, joints.step, joints.tilt):
        array[:] = 0.0


def show_falling(state: State) -> None:
    """Scale the unbounded displacements of falling blocks down to a size that shows their mechanism."""
    blocks, joints = state.blocks, state.joints
    reach = float(joint_families.reach(state).max())
    moved = np.linalg.norm(blocks.displacement, axis=1) + reach * np.linalg.norm(blocks.rotation, axis=1)
    share = FALLEN * reach / max(float(moved.max()), FALLEN * reach)
    for array in (blocks.displacement, blocks.rotation, joints.relative):
        array *= share


def changing(state: State) -> Iterator[np.ndarray]:
    """Arrays of a state that relaxation may change, and that a new start must restore."""
    for part, fields in ((state.blocks, MOVING), (state.joints, CARRYING)):
        for name in fields:
            yield getattr(part, name)
    yield from joint_families.changing(state)
    yield from (state.blocks.dead_force, state.blocks.dead_torque)
    if state.ties is not None:
        yield from arrays_of(state.ties)
