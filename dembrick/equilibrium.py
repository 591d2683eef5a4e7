"""Equilibrium under the dead loads, before any jack moves: found directly, not waited for."""

from __future__ import annotations

import time

import numpy as np

from dembrick.elastic import Factor, elastic_factor, touches_itself, whole_inertia
from dembrick.errors import NotConvergedError
from dembrick.kernels.advance import settle
from dembrick.simulation import State
from dembrick.state import ScaledInertia

UNBALANCED = 1e-12  # of the joint forces
MOST_STEPS = 20_000
FIRST_STEPS = 30  # without momentum, for blocks on fixed ones
MOMENTUM = 0.9  # of the last move that is kept where blocks stand on free blocks


def inverse_inertia(state: State, inertia: np.ndarray) -> ScaledInertia:
    """Generalised inertia (n, 6, 6), inverted for every free block."""
    inverse = np.zeros_like(inertia)
    free = state.blocks.free
    inverse[free] = np.linalg.inv(inertia[free])
    return ScaledInertia(inverse, np.ascontiguousarray(inertia), None)


def seat(state: State, stiffness: np.ndarray, factor: Factor | None = None) -> tuple[float, float, float]:
    """Relax ``state`` until the out-of-balance forces are ``UNBALANCED`` of the joint forces.

    Where free blocks touch only fixed ones, every block moves by the answer of its own ``stiffness`` (n, 6, 6) to its
    out-of-balance: a single Newton step seats it. Else the whole assembly moves by its elastic answer, ``factor``,
    first in one go and then with momentum, which is dropped whenever it works against the forces. Returns the ratio
    reached and the seconds of compiling and of relaxing. Raises NotConvergedError where the dead loads alone bring the
    blocks down.
    """
    joints = state.joints
    began = time.perf_counter()
    alone, inertia = not touches_itself(state), None
    momentum = 0.0 if alone else MOMENTUM
    if not alone:
        factor = elastic_factor(state) if factor is None else factor
        if factor is not None:
            none = np.zeros((0, 6, 6))
            inertia = ScaledInertia(none, none, whole_inertia(factor))
    if inertia is None:
        inertia = inverse_inertia(state, stiffness)
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
