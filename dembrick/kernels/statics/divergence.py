"""Divergence guards of the time loop: a step too far or not a number, energy from nothing, a restless load.

Friction and dashpots only take energy away. So the blocks never have more kinetic energy than the joints held at the
start and actuators and dead loads have put in since; a motion that has RUNAWAY times as much makes its own, as a time
step above the critical one does. What the load did is only summed here, see ``steady_load``.
"""

from typing import NamedTuple

from numpy import ndarray

from dembrick._jit import jit
from dembrick.kernels.statics.energy import (
    add_dead_torque_work,
    dead_force_work,
    elastic_energy,
    held_by_ties,
    kinetic_energy,
)

RUNAWAY = 4.0  # times the energy put in: twice the speed that it could give
LEAST = 0.1  # of the elastic energy of the start, which is always allowed


class Guard(NamedTuple):
    """What the loop watches, and what it may reach."""

    longest: float  # m, a step that moves a block further than this has diverged
    mask: int  # steps between two looks at the energy, less one: a power of two less one
    stretch: int  # steps over which the load is summed, a multiple of that power of two
    weights: float  # sum of |weight| of the actuators
    turned: ndarray  # (t,) int64, free blocks with a dead torque
    start: ndarray  # (2,) J at the start: elastic energy, the same less the work of the dead forces up to then
    work: ndarray  # (2,) since then: sum of V times rate (W), work of the dead torques (J)
    sums: ndarray  # (3,) steps, V (N) and its square since the last look
    load: ndarray  # (s, 3) the same over each stretch


@jit
def open_guard(guard, state):
    """Note what energy there is at the start; blocks at rest."""
    if guard is not None:
        guard.start[0] = elastic_energy(state, None) + held_by_ties(state.ties)
        guard.start[1] = guard.start[0] - dead_force_work(state.blocks)


@jit
def watch(guard, step, v, rate, blocks, scaled, inertia, dt):
    """Add up what is put in at this step; False if the blocks have far more of it than there can be."""
    if guard is not None:
        guard.work[0] += v * rate
        add_dead_torque_work(guard.work, guard.turned, blocks, dt)
        guard.sums[0] += 1.0
        guard.sums[1] += v
        guard.sums[2] += v * v
        if step & guard.mask == guard.mask:
            stretch = min(step // guard.stretch, guard.load.shape[0] - 1)
            for i in range(3):
                guard.load[stretch, i] += guard.sums[i]
                guard.sums[i] = 0.0
            given = guard.work[0] * dt * guard.weights + guard.work[1] + guard.start[1] + dead_force_work(blocks)
            most = RUNAWAY * max(given, LEAST * guard.start[0])
            return kinetic_energy(blocks, scaled, inertia, dt) <= most
    return True


@jit
def jumped(guard, longest):
    """Whether the longest move of a step (m) is more than a block can make, or no number."""
    if guard is not None:
        return not longest <= guard.longest
    return False
