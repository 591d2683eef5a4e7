"""Elastic stiffness of joints, of blocks with their neighbours held, and of the whole assembly."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

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


class JointStiffness(NamedTuple):
    """Stiffness (j, 6, 6) of every closed joint as block a feels it when it moves alone, as block b does, and what the
    motion of b does to a; about their centroids."""

    of_a: np.ndarray
    of_b: np.ndarray
    between: np.ndarray


def joint_stiffness(state: State, times: np.ndarray | None = None) -> JointStiffness:
    """That of the joints of a state, ``times`` (j,) each."""
    joints, k = state.joints, joint_families.stiffness(state)
    if times is not None:
        k *= times[:, None, None]
    left, right = (to_joint(joints.axes, arm) for arm in (joints.arm_a, joints.arm_b))
    from_a, from_b = left.transpose(0, 2, 1) @ k, right.transpose(0, 2, 1) @ k
    return JointStiffness(from_a @ left, from_b @ right, -(from_a @ right))


def summed(state: State, found: JointStiffness) -> np.ndarray:
    """Stiffness (n, 6, 6) of each block on its joints; zero for fixed blocks."""
    n, joints = len(state.blocks.displacement), state.joints
    stiffness = np.zeros((n, 6, 6))
    for block, seen in ((joints.block_a, found.of_a), (joints.block_b, found.of_b)):
        np.add.at(stiffness, block, seen)
    stiffness[~_free(state)] = 0.0
    return _guided(state, stiffness)


def block_stiffness(state: State, shared: float) -> np.ndarray:
    """Stiffness (n, 6, 6) of each block about its centroid with all its neighbours held; zero for fixed blocks.

    A joint between two free blocks counts ``shared`` times. With 2 the block matrices together bound the stiffness of
    the assembly, because an element stores at most twice the energy of its two one-sided parts.
    """
    return summed(state, joint_stiffness(state, np.where(_both_free(state), shared, 1.0)))


def _free(state: State) -> np.ndarray:
    """Which blocks (n,) are free."""
    free = np.zeros(len(state.blocks.displacement), bool)
    free[state.blocks.free] = True
    return free


def _both_free(state: State) -> np.ndarray:
    """Which joints (j,) lie between free blocks."""
    free = _free(state)
    return free[state.joints.block_a] & free[state.joints.block_b]


def _guided(state: State, stiffness: np.ndarray) -> np.ndarray:
    """The ``stiffness`` (n, 6, 6) of blocks, where those that are held do not answer in the directions of their guides;
    its diagonal stays, so that it may be inverted."""
    for b, held in zip(state.blocks.guided, state.blocks.held, strict=True):
        diagonal = np.diagonal(stiffness[b])[held].copy()
        stiffness[b][held], stiffness[b][:, held] = 0.0, 0.0
        stiffness[b][held, held] = diagonal
    return stiffness


def couplings(state: State, found: JointStiffness | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Off-diagonal stiffness between free blocks: the numbers (c,) of their joints, and blocks K_ab (c, 6, 6)."""
    chosen = np.flatnonzero(_both_free(state))
    if not len(chosen):
        return chosen, np.zeros((0, 6, 6))
    return chosen, (found or joint_stiffness(state)).between[chosen]


def assembled_stiffness(state: State) -> np.ndarray:
    """Dense stiffness (6 f, 6 f) of the f free blocks with all joints closed and none slipping, in their order."""
    free = state.blocks.free
    number = np.full(len(state.blocks.displacement), -1)
    number[free] = np.arange(len(free))
    stiffness = np.zeros((len(free), 6, len(free), 6))
    every, (chosen, beside) = np.arange(len(free)), couplings(state)
    a, b = state.joints.block_a[chosen], state.joints.block_b[chosen]
    stiffness[every, :, every] = block_stiffness(state, shared=1.0)[free]
    np.add.at(stiffness, (number[a], slice(None), number[b]), beside)
    np.add.at(stiffness, (number[b], slice(None), number[a]), beside.transpose(0, 2, 1))
    return stiffness.reshape(6 * len(free), 6 * len(free))
