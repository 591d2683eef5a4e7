"""The critical time step of central differences, counted with contacts, jacks and dashpots.

A spring of stiffness k on a mass m with a dashpot that adds beta times the spring force of the same increment is
stable while w^2 dt^2 (1 + 2 beta) <= 4, w^2 = k/m, because the dashpot acts half a step late. Rotation and its
coupling with translation count in full: the stiffness of a block is a 6 x 6 matrix, and for a slender or eccentric
joint rocking governs, not translation.
"""

from __future__ import annotations

import math

import numpy as np

from dembrick.simulation import State


def block_inertia(assembly) -> np.ndarray:
    """Physical inertia (n, 6, 6) of every block about its centroid, world axes at the start."""
    n = len(assembly.names)
    inertia = np.zeros((n, 6, 6))
    inertia[:, [0, 1, 2], [0, 1, 2]] = np.asarray(assembly.mass)[:, None]
    rotation = assembly.rotation
    inertia[:, 3:, 3:] = rotation @ assembly.inertia @ np.swapaxes(rotation, 1, 2)
    return inertia


def greatest_frequency(state: State, inertia: np.ndarray, stiffness: np.ndarray) -> float:
    """Upper bound (rad/s) of the circular frequencies of the assembly with all joints closed and none slipping.

    ``inertia`` and ``stiffness`` (n, 6, 6) of every block alone, the joints between free blocks counted twice: the
    bound is exact for blocks that touch fixed blocks only, and never below the true greatest frequency.
    """
    free = state.blocks.free
    lower = np.linalg.inv(np.linalg.cholesky(inertia[free]))
    scaled = lower @ stiffness[free] @ np.swapaxes(lower, 1, 2)
    return float(np.sqrt(np.linalg.eigvalsh(scaled)[:, -1].max()))


def critical_time_step(frequency: float, viscous: float) -> float:
    """Greatest stable time step (s) for a greatest frequency (rad/s) and a dashpot ratio."""
    return 2.0 / (frequency * math.sqrt(1.0 + 2.0 * viscous))
