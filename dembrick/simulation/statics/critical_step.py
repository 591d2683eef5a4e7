"""The critical time step of central differences, counted with contacts, actuators and dashpots.

A spring of stiffness k on a mass m with a dashpot that adds beta times the spring force of the same increment is
stable while w^2 dt^2 (1 + 2 beta) <= 4, w^2 = k/m, because the dashpot acts half a step late. Rotation and its
coupling with translation count in full: the stiffness of a block is a 6 x 6 matrix, and for a slender or eccentric
joint rocking governs, not translation.

Where the time step is that of the fastest block, a dashpot in proportion to it hardly damps a block a hundred times as
heavy, or on a joint a hundred times as soft, and steady sliding on point springs can then flutter: rocking changes the
friction of the points, which rocks the block. With physical inertia every joint and the actuator therefore get dashpots
for their own frequency.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dembrick.simulation.statics import joint_families, ties
from dembrick.simulation.statics.state import State
from dembrick.simulation.statics.stiffness import block_stiffness, couplings, to_joint

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly

POWER_ITERATIONS = 30
DAMPING_RATIO = math.sqrt(0.125)  # of a block's fastest mode with physical inertia: a dashpot ratio of 1/2 at its step


def block_inertia(assembly: Assembly) -> np.ndarray:
    """Physical inertia (n, 6, 6) of every block about its centroid, world axes at the start."""
    n = len(assembly.names)
    inertia = np.zeros((n, 6, 6))
    inertia[:, [0, 1, 2], [0, 1, 2]] = np.asarray(assembly.mass)[:, None]
    rotation = assembly.rotation
    inertia[:, 3:, 3:] = rotation @ assembly.inertia @ np.swapaxes(rotation, 1, 2)
    return inertia


def greatest_frequency(
    state: State,
    inertia: np.ndarray,
    stiffness: np.ndarray,
    extra: np.ndarray | None = None,
    times: np.ndarray | None = None,
) -> float:
    """Upper bound (rad/s) of the circular frequencies of the assembly with all joints closed and none slipping.

    ``inertia`` and ``stiffness`` (n, 6, 6) are those of every block alone, with its neighbours held; ``extra`` adds
    stiffness to it; ``times`` (j,) scales the joints in what couples the blocks. Exact for blocks that touch fixed
    blocks only. Else the 6 x 6 blocks of the scaled stiffness are replaced by their norms: the spectral radius of that
    smaller, non-negative matrix N is never below the greatest eigenvalue, and for any positive vector x it is itself at
    most max (N x)_i / x_i (Collatz and Wielandt). A few power iterations bring x near its best; the bound is safe after
    each.
    """
    free = state.blocks.free
    lower = np.linalg.inv(np.linalg.cholesky(inertia[free]))
    total = stiffness[free] if extra is None else stiffness[free] + extra[free]
    diagonal = _greatest_eigenvalues(lower, total)
    number = np.full(len(inertia), -1)
    number[free] = np.arange(len(free))
    a, b, blocks = couplings(state, times)
    a, b = number[a], number[b]
    if not len(a):
        return float(np.sqrt(diagonal.max()))
    norms = np.linalg.norm(lower[a] @ blocks @ np.swapaxes(lower[b], 1, 2), ord=2, axis=(1, 2))
    x = np.ones(len(free))
    bound = np.inf
    for _ in range(POWER_ITERATIONS):
        y = diagonal * x
        np.add.at(y, a, norms * x[b])
        np.add.at(y, b, norms * x[a])
        bound = min(bound, float((y / x).max()))
        # the shift keeps x positive and the iteration from swinging between two halves of the graph
        x = y + bound * x
        x /= x.max()
    return float(np.sqrt(bound))


def _greatest_eigenvalues(lower: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
    """Greatest eigenvalue (f,) of each block, ``lower`` being the inverse Cholesky factor of its inertia."""
    return np.linalg.eigvalsh(lower @ stiffness @ np.swapaxes(lower, 1, 2))[:, -1]


@dataclass(frozen=True)
class Dashpots:
    """Dashpots over springs as times (s), force = stiffness x time x velocity, and the critical time step (s)."""

    joints: np.ndarray
    actuator: float
    critical_time_step: float


def dashpots(state: State, inertia: np.ndarray, actuator: np.ndarray) -> Dashpots:
    """Dashpots for physical inertia (n, 6, 6), each for DAMPING_RATIO of the frequency at which it moves its blocks.

    That is the greatest of a block on this joint and the actuator alone; for the actuator, on it and all its joints.
    ``actuator`` (n, 6, 6) is the stiffness that the actuator adds to the loaded blocks. With springs K and dashpots C
    the scheme is stable while dt^2 k + 2 dt c <= 4 for any bounds k, c of the greatest eigenvalues of K and C against
    M.
    """
    joints, free = state.joints, state.blocks.free
    alone = block_stiffness(state, shared=1.0)
    moves = np.zeros(len(inertia), bool)
    moves[free] = True
    lower = np.zeros_like(inertia)
    lower[free] = np.linalg.inv(np.linalg.cholesky(inertia[free]))
    squares = np.zeros(len(joints.block_a))
    stiffness = joint_families.stiffness(state)
    for side, arm in ((joints.block_a, joints.arm_a), (joints.block_b, joints.arm_b)):
        mine = np.flatnonzero(moves[side])
        there = to_joint(joints.axes[mine], arm[mine])
        own = np.swapaxes(there, 1, 2) @ stiffness[mine] @ there + actuator[side[mine]]
        squares[mine] = np.maximum(squares[mine], _greatest_eigenvalues(lower[side[mine]], own))
    times = 2.0 * DAMPING_RATIO / np.sqrt(np.where(squares > 0.0, squares, np.inf))
    loaded = state.actuators.block[moves[state.actuators.block]]
    square = _greatest_eigenvalues(lower[loaded], alone[loaded] + actuator[loaded]).max()
    actuator_time = 2.0 * DAMPING_RATIO / math.sqrt(square)
    k = greatest_frequency(state, inertia, alone, actuator + ties.bound(state)) ** 2
    c = greatest_frequency(state, inertia, block_stiffness(state, 1.0, times), actuator * actuator_time, times) ** 2
    return Dashpots(times, actuator_time, (math.sqrt(c * c + 4.0 * k) - c) / k)


def critical_time_step(frequency: float, viscous: float) -> float:
    """Greatest stable time step (s) for a greatest frequency (rad/s) and a dashpot ratio."""
    return 2.0 / (frequency * math.sqrt(1.0 + 2.0 * viscous))
