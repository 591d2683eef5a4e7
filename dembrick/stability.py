"""The critical time step of central differences, counted with contacts, jacks and dashpots.

A spring of stiffness k on a mass m with a dashpot that adds beta times the spring force of the same increment is
stable while w^2 dt^2 (1 + 2 beta) <= 4, w^2 = k/m, because the dashpot acts half a step late. Rotation and its
coupling with translation count in full: the stiffness of a block is a 6 x 6 matrix, and for a slender or eccentric
joint rocking governs, not translation.
"""

from __future__ import annotations

import math

import numpy as np

from dembrick.simulation import State, couplings

POWER_ITERATIONS = 30


def block_inertia(assembly) -> np.ndarray:
    """Physical inertia (n, 6, 6) of every block about its centroid, world axes at the start."""
    n = len(assembly.names)
    inertia = np.zeros((n, 6, 6))
    inertia[:, [0, 1, 2], [0, 1, 2]] = np.asarray(assembly.mass)[:, None]
    rotation = assembly.rotation
    inertia[:, 3:, 3:] = rotation @ assembly.inertia @ np.swapaxes(rotation, 1, 2)
    return inertia


def greatest_frequency(
    state: State, inertia: np.ndarray, stiffness: np.ndarray, extra: np.ndarray | None = None
) -> float:
    """Upper bound (rad/s) of the circular frequencies of the assembly with all joints closed and none slipping.

    ``inertia`` and ``stiffness`` (n, 6, 6) are those of every block alone, with its neighbours held; ``extra`` adds
    stiffness to it. Exact for blocks that touch fixed blocks only. Else the 6 x 6 blocks of the scaled stiffness are
    replaced by their norms: the spectral radius of that smaller, non-negative matrix N is never below the greatest
    eigenvalue, and for any positive vector x it is itself at most max (N x)_i / x_i (Collatz and Wielandt). A few power
    iterations bring x near its best; the bound is safe after each.
    """
    free = state.blocks.free
    lower = np.linalg.inv(np.linalg.cholesky(inertia[free]))
    total = stiffness[free] if extra is None else stiffness[free] + extra[free]
    diagonal = np.linalg.eigvalsh(lower @ total @ np.swapaxes(lower, 1, 2))[:, -1]
    number = np.full(len(inertia), -1)
    number[free] = np.arange(len(free))
    a, b, blocks = couplings(state)
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


def critical_time_step(frequency: float, viscous: float) -> float:
    """Greatest stable time step (s) for a greatest frequency (rad/s) and a dashpot ratio."""
    return 2.0 / (frequency * math.sqrt(1.0 + 2.0 * viscous))
