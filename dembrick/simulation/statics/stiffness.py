"""Elastic stiffness of joints, of blocks with their neighbours held, and of the whole assembly."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dembrick.simulation.statics import joint_families

if TYPE_CHECKING:
    from dembrick.simulation.statics.state import State


def to_joint(axes: np.ndarray, arm: np.ndarray) -> np.ndarray:
    """Matrices (..., 6, 6) from the motion (u, r) of a block about its centroid to that of O in the joint's axes."""
    matrix = np.zeros((*axes.shape[:-2], 6, 6))
    matrix[..., :3, :3] = matrix[..., 3:, 3:] = axes
    x, y, z = np.moveaxis(arm, -1, 0)
    about = np.zeros_like(axes)  # row t times it is arm x t, and t . (r x arm) = (arm x t) . r
    about[..., 0, 1], about[..., 0, 2], about[..., 1, 2] = z, -y, x
    about[..., 1, 0], about[..., 2, 0], about[..., 2, 1] = -z, y, -x
    matrix[..., :3, 3:] = axes @ about
    return matrix


def _ends(state: State, times: np.ndarray | None = None) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """Stiffness (j, 6, 6) of the joints ``times`` (j,) a factor, and the matrices `to_joint` of their two blocks."""
    joints, k = state.joints, joint_families.stiffness(state)
    if times is not None:
        k *= times[:, None, None]
    return k, (to_joint(joints.axes, joints.arm_a), to_joint(joints.axes, joints.arm_b))


def block_stiffness(state: State, shared: float, times: np.ndarray | None = None) -> np.ndarray:
    """Stiffness (n, 6, 6) of each block about its centroid with all its neighbours held; zero for fixed blocks.

    A joint between two free blocks counts ``shared`` times. With 2 the block matrices together bound the stiffness of
    the assembly, because an element stores at most twice the energy of its two one-sided parts. ``times`` (j,) scales
    the joints.
    """
    joints = state.joints
    n = len(state.blocks.displacement)
    stiffness = np.zeros((n, 6, 6))
    free = np.zeros(n, bool)
    free[state.blocks.free] = True
    k, ends = _ends(state, times)
    k *= np.where(free[joints.block_a] & free[joints.block_b], shared, 1.0)[:, None, None]
    for block, t in zip((joints.block_a, joints.block_b), ends, strict=True):
        np.add.at(stiffness, block, t.transpose(0, 2, 1) @ k @ t)
    stiffness[~free] = 0.0
    return _guided(state, stiffness)


def _guided(state: State, stiffness: np.ndarray) -> np.ndarray:
    """The ``stiffness`` (n, 6, 6) of blocks, where those that are held do not answer in the directions of their guides;
    its diagonal stays, so that it may be inverted."""
    for b, held in zip(state.blocks.guided, state.blocks.held, strict=True):
        diagonal = np.diagonal(stiffness[b])[held].copy()
        stiffness[b][held], stiffness[b][:, held] = 0.0, 0.0
        stiffness[b][held, held] = diagonal
    return stiffness


def couplings(state: State, times: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Off-diagonal stiffness between free blocks: indices a (c,), b (c,) and blocks K_ab (c, 6, 6), a joint each;
    ``times`` (j,) scales the joints."""
    joints = state.joints
    free = np.zeros(len(state.blocks.displacement), bool)
    free[state.blocks.free] = True
    chosen = np.flatnonzero(free[joints.block_a] & free[joints.block_b])
    if not len(chosen):
        return chosen, chosen, np.zeros((0, 6, 6))
    k, (left, right) = _ends(state, times)
    blocks = -left[chosen].transpose(0, 2, 1) @ k[chosen] @ right[chosen]
    return joints.block_a[chosen], joints.block_b[chosen], blocks


def assembled_stiffness(state: State) -> np.ndarray:
    """Dense stiffness (6 f, 6 f) of the f free blocks with all joints closed and none slipping, in their order."""
    free = state.blocks.free
    number = np.full(len(state.blocks.displacement), -1)
    number[free] = np.arange(len(free))
    stiffness = np.zeros((len(free), 6, len(free), 6))
    every, (a, b, beside) = np.arange(len(free)), couplings(state)
    stiffness[every, :, every] = block_stiffness(state, shared=1.0)[free]
    np.add.at(stiffness, (number[a], slice(None), number[b]), beside)
    np.add.at(stiffness, (number[b], slice(None), number[a]), beside.transpose(0, 2, 1))
    return stiffness.reshape(6 * len(free), 6 * len(free))
