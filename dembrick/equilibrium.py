"""Equilibrium under the dead loads, before any jack moves: found directly, not waited for."""

from __future__ import annotations

import time

import numpy as np

from dembrick.errors import NotConvergedError
from dembrick.kernels.advance import settle
from dembrick.simulation import State, assembled_stiffness
from dembrick.state import ScaledInertia

UNBALANCED = 1e-12  # of the joint forces
MOST_STEPS = 20_000
FIRST_STEPS = 30  # without momentum, for blocks on fixed ones
MOST_DENSE = 300  # free blocks up to which the elastic answer is solved for at once
MOMENTUM = 0.9  # of the last move that is kept where blocks stand on free blocks


def inverse_inertia(state: State, inertia: np.ndarray) -> ScaledInertia:
    """Generalised inertia (n, 6, 6), inverted for every free block."""
    inverse = np.zeros_like(inertia)
    free = state.blocks.free
    inverse[free] = np.linalg.inv(inertia[free])
    return ScaledInertia(inverse, np.ascontiguousarray(inertia))


def seat(state: State, stiffness: np.ndarray) -> tuple[float, float, float]:
    """Relax ``state`` until the out-of-balance forces are ``UNBALANCED`` of the joint forces.

    Every block moves by the answer of its own ``stiffness`` (n, 6, 6) to its out-of-balance: one block on a fixed base
    is seated by a single Newton step. Returns the ratio reached and the seconds of compiling and of relaxing. Raises
    NotConvergedError where the dead loads alone bring the blocks down.
    """
    joints, free = state.joints, state.blocks.free
    alone = not np.any(np.isin(joints.block_a, free) & np.isin(joints.block_b, free))
    momentum = 0.0 if alone else MOMENTUM
    if not alone and len(state.blocks.free) <= MOST_DENSE:
        _move_to_elastic_answer(state)
    inertia = inverse_inertia(state, stiffness)
    began = time.perf_counter()
    settle(0, UNBALANCED, *state[:4], inertia, momentum)  # no step: compiles, or loads the cache
    ready = time.perf_counter()
    ratio, steps = settle(FIRST_STEPS if alone else MOST_STEPS, UNBALANCED, *state[:4], inertia, momentum)
    if alone and not ratio <= UNBALANCED:
        # what opened is softer than the closed joint whose answer each step is
        ratio, steps = settle(MOST_STEPS, UNBALANCED, *state[:4], inertia, MOMENTUM)
    done = time.perf_counter()
    if not ratio <= UNBALANCED:
        raise NotConvergedError(
            f"no equilibrium under the dead loads: after {steps} steps the out-of-balance force is still {ratio:.2g} "
            "of the joint forces, so the blocks slide or overturn before any jack moves; check loads, friction and "
            "supports"
        )
    state.blocks.velocity[:] = 0.0
    state.blocks.spin[:] = 0.0
    joints.step[:] = 0.0
    return ratio, ready - began, done - ready


def _move_to_elastic_answer(state: State) -> None:
    """Displace the blocks as their closed, sticking joints would let the dead loads move them."""
    blocks = state.blocks
    load = np.concatenate([blocks.dead_force, blocks.dead_torque], axis=1)[blocks.free]
    answer = np.linalg.solve(assembled_stiffness(state), load.ravel()).reshape(-1, 6)
    blocks.displacement[blocks.free] = answer[:, :3]
    blocks.rotation[blocks.free] = answer[:, 3:]
