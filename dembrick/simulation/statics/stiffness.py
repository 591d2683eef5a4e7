"""Elastic stiffness of joints, of blocks with their neighbours fixed, and of the whole assembly."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from dembrick.errors import ScenarioError
from dembrick.kernels.state import ScaledInertia
from dembrick.scenario.checks import show
from dembrick.simulation.statics import joint_families

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.simulation.statics.state import State

FREELY = 1e-14  # of the greatest stiffness of a block: a smaller one is rounding
AT_ONCE = 1024  # joints whose matrices are made together: some 300 kB per array


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


def pieces(numbers: np.ndarray) -> Iterator[np.ndarray]:
    """Split numbers of joints into groups whose matrices fit into the cache."""
    for begin in range(0, len(numbers), AT_ONCE):
        yield numbers[begin : begin + AT_ONCE]


def felt(state: State, times: np.ndarray | None = None) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Iterate over groups of joints: their numbers (k,), those of their blocks, and the stiffness (k, 6, 6) of each
    joint, scaled by ``times`` (j,), against motion of that block alone about its centroid: first the blocks a of all
    joints, then the blocks b."""
    joints, k = state.joints, joint_families.stiffness(state)
    if times is not None:
        k *= times[:, None, None]
    for block, arm in ((joints.block_a, joints.arm_a), (joints.block_b, joints.arm_b)):
        for some in pieces(np.arange(len(k))):
            t = to_joint(joints.axes[some], arm[some])
            yield some, block[some], t.transpose(0, 2, 1) @ k[some] @ t


def summed(state: State, times: np.ndarray | None = None) -> np.ndarray:
    """Stiffness (n, 6, 6) of each block on its joints, scaled by ``times`` (j,); zero for fixed blocks."""
    stiffness = np.zeros((len(state.blocks.displacement), 6, 6))
    for _, block, own in felt(state, times):
        np.add.at(stiffness, block, own)
    stiffness[~_free(state)] = 0.0
    return _guided(state, stiffness)


def block_stiffness(state: State, shared: float) -> np.ndarray:
    """Stiffness (n, 6, 6) of each block about its centroid with all its neighbours fixed; zero for fixed blocks.

    A joint between two free blocks is multiplied by ``shared``. With 2 the block matrices together bound the stiffness
    of the assembly, because an element stores at most twice the energy of its two one-sided parts.
    """
    return summed(state, np.where(_both_free(state), shared, 1.0))


def held_stiffness(assembly: Assembly, state: State) -> np.ndarray:
    """`block_stiffness` with joints between free blocks counted twice; ScenarioError for a block that can turn freely
    about a line through all of its contact points."""
    stiffness, free = block_stiffness(state, shared=2.0), state.blocks.free
    if not any(law.points is not None and min(law.points) < 2 for law in assembly.joints.law):
        return stiffness  # no joint has its points in one line
    unit = np.ones((len(free), 6))  # of a metre, and of a turn
    unit[:, 3:] /= np.array([assembly.shapes[block].diameter for block in free])[:, None]
    values = np.linalg.eigvalsh(unit[:, :, None] * stiffness[free] * unit[:, None])
    loose = free[(values[:, -1] > 0.0) & (values[:, 0] < FREELY * values[:, -1])]
    if len(loose):
        raise ScenarioError(
            f"block {show(assembly.names[loose[0]])} turns freely about the line on which all its contact points "
            "lie; give joint.points at least two each way"
        )
    return stiffness


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
    """The ``stiffness`` (n, 6, 6) of blocks, decoupled in the directions in which guides hold them; its diagonal stays,
    so that it can be inverted."""
    for b, held in zip(state.blocks.guided, state.blocks.held, strict=True):
        diagonal = np.diagonal(stiffness[b])[held].copy()
        stiffness[b][held], stiffness[b][:, held] = 0.0, 0.0
        stiffness[b][held, held] = diagonal
    return stiffness


def couplings(state: State) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Off-diagonal stiffness between free blocks, in groups of joints: their numbers (k,), and blocks K_ab
    (k, 6, 6)."""
    joints, k = state.joints, joint_families.stiffness(state)
    for some in pieces(np.flatnonzero(_both_free(state))):
        left, right = (to_joint(joints.axes[some], arm[some]) for arm in (joints.arm_a, joints.arm_b))
        yield some, -left.transpose(0, 2, 1) @ k[some] @ right


def assembled_stiffness(state: State) -> np.ndarray:
    """Dense stiffness (6 f, 6 f) of the f free blocks with all joints closed and none slipping, in their order."""
    free = state.blocks.free
    number = np.full(len(state.blocks.displacement), -1)
    number[free] = np.arange(len(free))
    stiffness = np.zeros((len(free), 6, len(free), 6))
    every = np.arange(len(free))
    stiffness[every, :, every] = block_stiffness(state, shared=1.0)[free]
    for some, beside in couplings(state):
        a, b = state.joints.block_a[some], state.joints.block_b[some]
        np.add.at(stiffness, (number[a], slice(None), number[b]), beside)
        np.add.at(stiffness, (number[b], slice(None), number[a]), beside.transpose(0, 2, 1))
    return stiffness.reshape(6 * len(free), 6 * len(free))


def inverse_inertia(state: State, inertia: np.ndarray) -> ScaledInertia:
    """Generalised inertia (n, 6, 6), inverted for every free block."""
    inverse = np.zeros_like(inertia)
    free = state.blocks.free
    inverse[free] = np.linalg.inv(inertia[free])
    return ScaledInertia(inverse, np.ascontiguousarray(inertia), None)


def elastic_motion_alone(state: State, stiffness: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """Function from loads (f, 6) on free blocks that touch only fixed ones to their elastic motion (f, 6)."""
    inverse = np.linalg.inv(stiffness[state.blocks.free])
    return lambda load: np.einsum("fij,fj->fi", inverse, load)
