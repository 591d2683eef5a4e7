"""Reactions of the supports: what fixed blocks exert on the structure through their joints."""

from __future__ import annotations

import numpy as np

from dembrick.simulation.statics.state import State


def reactions(state: State, names) -> dict[str, list[float]]:
    """Force (N) and moment (N m, about the support's centroid at the start) of every fixed block that has a joint.

    In world axes, [Fx, Fy, Fz, Mx, My, Mz], acting on the structure: a block at rest on a floor is held up.
    """
    joints = state.joints
    fixed = np.ones(len(state.blocks.displacement), bool)
    fixed[state.blocks.free] = False
    n, v1, v2, twist, m1, m2, _ = joints.resultant.T
    on_b = np.einsum("ji,jik->jk", np.stack([-v1, -v2, n], axis=1), joints.axes)
    moment = np.einsum("ji,jik->jk", np.stack([-m1, -m2, -twist], axis=1), joints.axes)
    total = np.zeros((len(fixed), 6))
    for block, arm, sign in ((joints.block_a, joints.arm_a, 1.0), (joints.block_b, joints.arm_b, -1.0)):
        # a gives b the force and moment of the joint; where b is the support, it gives a the opposite
        np.add.at(total, block, sign * np.concatenate([on_b, moment + np.cross(arm, on_b)], axis=1))
    touched = np.zeros(len(fixed), bool)
    touched[joints.block_a] = touched[joints.block_b] = True
    return {names[i]: (total[i] + 0.0).tolist() for i in np.flatnonzero(fixed & touched)}
