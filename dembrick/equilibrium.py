"""Equilibrium under the dead loads, before any jack moves: found directly, not waited for."""

from __future__ import annotations

import numpy as np

from dembrick.errors import NotConvergedError
from dembrick.kernels.advance import settle
from dembrick.simulation import State, block_stiffness
from dembrick.state import ScaledInertia

UNBALANCED = 1e-12
MOST_STEPS = 20_000


def seat(state: State, stiffness: np.ndarray | None = None, factor: np.ndarray | None = None) -> float:
    """Relax ``state`` until the out-of-balance forces are ``UNBALANCED`` of the joint forces; returns the ratio.

    Every block moves by its own stiffness's answer to its out-of-balance: one block on a fixed base is seated by a
    single Newton step. Raises NotConvergedError where the dead loads alone bring the blocks down.
    """
    if stiffness is None:
        stiffness, factor = block_stiffness(state)
    inertia = ScaledInertia(scaled_inverse(state, stiffness * factor[:, None, None]))
    momentum = 0.0 if factor.max() == 1.0 else 0.9
    ratio, steps = settle(
        MOST_STEPS, UNBALANCED, *state[:4], inertia, momentum
    )
    if not ratio <= UNBALANCED:
        raise NotConvergedError(
            f"no equilibrium under the dead loads: after {steps} steps the out-of-balance force is still {ratio:.2g} "
            "of the joint forces; the blocks slide or overturn before any jack moves. Check loads, friction and supports"
        )
    state.blocks.velocity[:] = 0.0
    state.blocks.spin[:] = 0.0
    return ratio


def scaled_inverse(state: State, inertia: np.ndarray) -> np.ndarray:
    """Inverse (n, 6, 6) of the generalised inertia of every free block, zero for the fixed ones."""
    inverse = np.zeros_like(inertia)
    free = state.blocks.free
    inverse[free] = np.linalg.inv(inertia[free])
    return inverse
