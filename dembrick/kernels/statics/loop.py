"""The compiled time loop of driven relaxation and of constant-rate tests. It allocates nothing. Parts that a scene does
not have are passed as None, and numba omits their code: a family of joints, the record, the energy terms, and either
the scaled or the physical inertia.

Guards watch for divergence: a step that is too long or not a number, energy from nothing, a load that does not settle.

Friction and dashpots only remove energy. So the kinetic energy of the blocks never exceeds the energy of the joints at
the start plus the later work of actuators and dead loads; a motion with TIMES as much creates energy, as a time step
above the critical one does. Of the load only sums are formed here; see ``guards.steady``.
"""

from typing import NamedTuple

from numpy import ndarray

from dembrick._jit import entry, jit
from dembrick.kernels.statics.block_forces import actuator_forces, apply_guides, clear_forces, joint_forces, tie_forces
from dembrick.kernels.statics.energy import (
    balance,
    begin_energy,
    dead_force_work,
    dead_torque_work,
    elastic_energy,
    energy_in_ties,
    kinetic_energy,
    yielded_in_step,
)
from dembrick.kernels.statics.finite_rotation import finite_step
from dembrick.kernels.statics.load_bounds import instant_bounds, strict_bounds, update_bracket
from dembrick.kernels.statics.record import write_row
from dembrick.kernels.statics.small_displacement import small_step

TURNING = 1.0 / 16.0  # part of the time of a stroke in which the head speeds up, and again in which it slows down
RUNNING, CONVERGED, DIVERGED, FULL, RUNAWAY = 0, 1, 2, 3, 4


class Drive(NamedTuple):
    """How the actuators are driven and how contacts are damped; constant during a chunk."""

    rate: float  # m/s, of the head
    ramp: float  # s, the head speeds up to that rate over this time
    steady: int  # steps after which the head begins to slow down
    slowing: float  # its rate after each of those steps over that before
    stiffness: float  # N/m, of the spring between head and driven displacement
    dashpot: float  # N s/m, of the dashpot between head and driven displacement
    viscous_n: float  # dashpot over spring force at a contact for the same increment, normal
    viscous_s: float  # the same, shear
    damping: float  # part of a velocity's fluctuation about its running mean that a step removes (small motion)
    mean_weight: float  # of the latest step in that mean
    until: ndarray  # (w,) int64, steps at which the strokes of a protocol end; none if the head does not reverse
    ways: ndarray  # (w,) m, travel of the head in each


@jit
def note_extremes(driven, load):
    """Update the load of the largest size so far, its displacement, and the greatest and least load in the record
    ``driven``."""
    if abs(load) > abs(driven.peak):
        driven.peak = load
        driven.peak_at = driven.displacement
    driven.greatest = max(driven.greatest, load)
    driven.least = min(driven.least, load)


@jit
def part_of_stroke(x):
    """Part of a stroke that the head has travelled after the part x of its time: it begins and ends at rest."""
    if x < TURNING:
        return x * x / (2.0 * TURNING * (1.0 - TURNING))
    if x > 1.0 - TURNING:
        return 1.0 - (1.0 - x) * (1.0 - x) / (2.0 * TURNING * (1.0 - TURNING))
    return (x - 0.5 * TURNING) / (1.0 - TURNING)


@jit
def head_rate(drive, step, dt):
    """Rate of the head (m/s) at a step: it speeds up, is steady, slows down; or that of its stroke in a protocol."""
    if drive.until.size > 0:
        first, last = 0, drive.until.size - 1
        while first < last:
            middle = (first + last) // 2
            if step < drive.until[middle]:
                last = middle
            else:
                first = middle + 1
        start = drive.until[first - 1] if first > 0 else 0
        steps = drive.until[first] - start
        if step >= drive.until[first]:
            return 0.0  # the protocol is over
        done = step - start
        return drive.ways[first] * (part_of_stroke((done + 1) / steps) - part_of_stroke(done / steps)) / dt
    return drive.rate * min(1.0, (step + 1) * dt / drive.ramp) * drive.slowing ** max(step - drive.steady, 0)


@jit
def bounds_now(certificate, state, v, moved, dt):
    """Bounds of the limit load from the present state."""
    if certificate.strict:
        return strict_bounds(certificate, state, v)
    return instant_bounds(state, v, moved, dt)


@entry
def advance(first, n_steps, dt, state, scaled, inertia, drive, certificate, record, energy, guard):
    """Advance a `State` that is driven (``drive``) from step ``first`` until ``n_steps`` more are done, or the bracket
    of the limit load, formed with ``certificate``, is narrow enough.

    ``scaled`` inertia moves the blocks by small motion, physical ``inertia`` by finite motion; the other is None.
    ``certificate``, ``record``, ``energy`` and ``guard`` may be None. Returns the status (RUNNING when all steps are
    done, CONVERGED, DIVERGED if a move is too long or not a number, RUNAWAY if there is more energy than was put in,
    FULL when the record has no room) and the number of steps done.
    """
    blocks = state.blocks
    viscous = drive.viscous_n, drive.viscous_s
    if first == 0 and n_steps > 0:
        begin_energy(energy, state)
        open_guard(guard, state)
    for step in range(first, first + n_steps):
        clear_forces(blocks)
        joint_forces(state, inertia, dt, viscous, energy)
        tie_forces(state.ties, blocks)
        rate = head_rate(drive, step, dt)
        v, moved = actuator_forces(blocks, state.actuators, drive, inertia, rate, dt, energy)
        apply_guides(blocks)
        if energy is not None:
            energy.work[0].torques += dead_torque_work(energy.turned, blocks, dt)
            energy.work[0].yielding += yielded_in_step(state.ties)
        done = False
        driven = state.actuators.driven[0]
        if certificate is not None:
            if step % certificate.every == 0:
                lower, upper = bounds_now(certificate, state, v, moved, dt)
                done = update_bracket(certificate, step // certificate.every, lower, upper, v, driven.displacement)
        note_extremes(driven, v)
        if record is not None:
            if step % record.every[0] == 0 or done:
                if energy is not None and record.count[0] < record.row.shape[0]:
                    now = balance(energy, state, drive, scaled, inertia, dt)
                    for i in range(record.energy.shape[1]):
                        record.energy[record.count[0], i] = now[i]
                bounds = certificate.bracket[0], certificate.bracket[1]
                if not write_row(record, step, step * dt, state, v, viscous[1], bounds, done):
                    return FULL, step
        if done:
            return CONVERGED, step + 1
        if not watch(guard, step, v, rate, blocks, scaled, inertia, dt):
            return RUNAWAY, step + 1
        longest = 0.0
        if inertia is not None:
            longest = finite_step(blocks, inertia, dt)
        if scaled is not None:
            longest = small_step(blocks, scaled, dt, drive.damping, drive.mean_weight, energy)
        if jumped(guard, longest):
            return DIVERGED, step + 1
    return RUNNING, first + n_steps


TIMES = 4.0  # limit of the kinetic energy over the energy put in: twice the greatest possible speed
LEAST = 0.1  # part of the elastic energy of the start that always counts as put in


class Guard(NamedTuple):
    """Quantities that the loop monitors, and their limits."""

    longest: float  # m, a longer move of a block in a step is divergence
    mask: int  # steps between two checks of the energy, less one: a power of two less one
    stretch: int  # steps over which the load is summed, a multiple of that power of two
    weights: float  # sum of |weight| of the actuators
    turned: ndarray  # (t,) int64, free blocks with a dead torque
    start: ndarray  # (2,) J at the start: elastic energy, the same less the work of the dead forces up to then
    work: ndarray  # (2,) since then: sum of V times rate (W), work of the dead torques (J)
    sums: ndarray  # (3,) steps, V (N) and its square since the last check
    load: ndarray  # (s, 3) the same over each stretch


@jit
def open_guard(guard, state):
    """Store the energy at the start, with blocks at rest."""
    if guard is not None:
        guard.start[0] = elastic_energy(state, None) + energy_in_ties(state.ties)
        guard.start[1] = guard.start[0] - dead_force_work(state.blocks)


@jit
def watch(guard, step, v, rate, blocks, scaled, inertia, dt):
    """Add up the energy put in at this step; False if the blocks have far more kinetic energy than there can be."""
    if guard is not None:
        guard.work[0] += v * rate
        guard.work[1] += dead_torque_work(guard.turned, blocks, dt)
        guard.sums[0] += 1.0
        guard.sums[1] += v
        guard.sums[2] += v * v
        if step & guard.mask == guard.mask:
            stretch = min(step // guard.stretch, guard.load.shape[0] - 1)
            for i in range(3):
                guard.load[stretch, i] += guard.sums[i]
                guard.sums[i] = 0.0
            given = guard.work[0] * dt * guard.weights + guard.work[1] + guard.start[1] + dead_force_work(blocks)
            most = TIMES * max(given, LEAST * guard.start[0])
            return kinetic_energy(blocks, scaled, inertia, dt) <= most
    return True


@jit
def jumped(guard, longest):
    """Whether the longest move of a step (m) is too long, or not a number."""
    if guard is not None:
        return not longest <= guard.longest
    return False
