"""The state that one quasi-static run left as the start of the next: motion of the blocks, and what joints remember."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dembrick.errors import ScenarioError
from dembrick.geometry.rotations import quaternion_product, rotation_vector
from dembrick.simulation.statics import joint_families, ties
from dembrick.simulation.statics.state import State, initial_state
from dembrick.simulation.statics.stiffness import to_joint

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.scenario.stages import TiesBefore


def starting_state(assembly: Assembly, left: State | None, before: TiesBefore | None = None) -> State:
    """The state at the start of a run: that of the geometry, or what another run of the same blocks has ``left``.

    Displacements and rotation vectors count from the geometry of the start. ``before``: which of its ties stay. Raises
    ScenarioError if the joints of both are not the same.
    """
    state = initial_state(assembly)
    if left is None:
        return state
    blocks = state.blocks
    blocks.displacement[:] = left.blocks.displacement
    blocks.rotation[:] = left.blocks.rotation + turned_since_the_start(assembly, left)
    _remember(state, left)
    ties.go_on(state, left.ties, before)
    joints = state.joints
    motion = np.concatenate([blocks.displacement, blocks.rotation], axis=1)
    joints.relative[:] = np.einsum("jik,jk->ji", to_joint(joints.axes, joints.arm_b), motion[joints.block_b])
    joints.relative[:] -= np.einsum("jik,jk->ji", to_joint(joints.axes, joints.arm_a), motion[joints.block_a])
    return state


def turned_since_the_start(assembly: Assembly, left: State) -> np.ndarray:
    """Rotation vectors (n, 3) of what a run with finite rotations has put into the orientations of its blocks."""
    before, now = assembly.orientation, left.blocks.orientation
    turn = rotation_vector(quaternion_product(now, before * [1.0, -1.0, -1.0, -1.0]))
    return np.where((now == before).all(axis=1, keepdims=True), 0.0, turn)


def _remember(state: State, left: State) -> None:
    """Give the joints of ``state`` the memory of those of ``left``."""
    own, given = joint_families.memory_arrays(state), joint_families.memory_arrays(left)
    if {name: array.shape for name, array in own.items()} != {name: array.shape for name, array in given.items()}:
        raise ScenarioError(
            "the joints or contact points of this stage are not those of the stage before: state joint.points of "
            "distributed joints"
        )
    for name, array in own.items():
        array[...] = given[name]
