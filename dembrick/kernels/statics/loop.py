"""The compiled time loops. Nothing is allocated in them; what a scene does not have is passed as None, and numba then
leaves its code out: a family of joints, the record, the energy terms, and either the scaled or the physical inertia.
"""

from typing import NamedTuple

from numpy import ndarray

from dembrick._jit import entry, jit
from dembrick.kernels.joint.ties import tie_losses
from dembrick.kernels.state import YIELDING
from dembrick.kernels.statics.block_forces import (
    actuator_forces,
    clear_forces,
    hold,
    joint_forces,
    tie_forces,
    unbalanced_power,
    unbalanced_ratio,
)
from dembrick.kernels.statics.divergence import jumped, open_guard, watch
from dembrick.kernels.statics.energy import add_dead_torque_work, balance, begin_energy
from dembrick.kernels.statics.finite_rotation import finite_step
from dembrick.kernels.statics.load_bounds import carried_load, instant_bounds, judge, strict_bounds
from dembrick.kernels.statics.record import write_row
from dembrick.kernels.statics.small_displacement import small_step

TURNING = 1.0 / 16.0  # of the time of a way: in which the head speeds up after a turn, and slows down before the next
RUNNING, CONVERGED, DIVERGED, FULL, RUNAWAY = 0, 1, 2, 3, 4


class Drive(NamedTuple):
    """How the actuators are driven and how contacts are damped; constant during a chunk."""

    rate: float  # m/s of the head
    ramp: float  # s, the head speeds up to that rate over this time
    steady: int  # steps after which the head begins to slow down
    slowing: float  # its rate after each of those steps over that before
    stiffness: float  # N/m, of V against the driven displacement
    dashpot: float  # N s/m, on the difference of head and driven velocity
    viscous_n: float  # dashpot over spring force at a contact for the same increment, normal
    viscous_s: float  # the same, shear
    damping: float  # part of a velocity's fluctuation about its running mean that a step takes away (small motion)
    mean_weight: float  # of the latest step in that mean
    until: ndarray  # (w,) int64, steps at which the ways of a protocol end; none if the head does not turn
    ways: ndarray  # (w,) m, of the head on each


@jit
def part_of_way(x):
    """Part of a way to and fro that the head has gone in the part x of its time: it begins and ends at rest."""
    if x < TURNING:
        return x * x / (2.0 * TURNING * (1.0 - TURNING))
    if x > 1.0 - TURNING:
        return 1.0 - (1.0 - x) * (1.0 - x) / (2.0 * TURNING * (1.0 - TURNING))
    return (x - 0.5 * TURNING) / (1.0 - TURNING)


@jit
def head_rate(drive, step, dt):
    """Rate of the head (m/s) at a step: it speeds up, is steady, and slows down; or that of its way in a protocol."""
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
        return drive.ways[first] * (part_of_way((done + 1) / steps) - part_of_way(done / steps)) / dt
    return drive.rate * min(1.0, (step + 1) * dt / drive.ramp) * drive.slowing ** max(step - drive.steady, 0)


@entry
def advance(
    first, n_steps, dt, blocks, joints, points, areas, actuators, ties, scaled, inertia, drive, certificate, record,
    energy, guard,
):  # fmt: skip
    """Advance the replay from step ``first`` until ``n_steps`` more are done, or its bracket is within tolerance.

    ``scaled`` inertia moves the blocks by small motion, physical ``inertia`` by finite motion; the other is None.
    ``ties`` is None in small motion, where their forces are among the dead loads.
    Returns the status (RUNNING when all steps are done, CONVERGED, DIVERGED where a block jumped or is no number,
    RUNAWAY where there is more energy than was put in, FULL when the record has no room) and the number of steps done.
    """
    bracket = certificate.bracket
    if first == 0 and n_steps > 0:
        begin_energy(energy, blocks, joints, points, areas, ties)
        open_guard(guard, blocks, joints, points, areas, ties)
    for step in range(first, first + n_steps):
        clear_forces(blocks)
        joint_forces(blocks, joints, points, areas, inertia, dt, drive.viscous_n, drive.viscous_s, energy)
        if ties is not None:
            tie_forces(blocks, ties)
        rate = head_rate(drive, step, dt)
        v, moved = actuator_forces(blocks, actuators, drive, inertia, rate, dt, energy)
        hold(blocks)
        if energy is not None:
            add_dead_torque_work(energy.work, energy.turned, blocks, dt)
            if ties is not None:
                yielded, _ = tie_losses(ties)
                energy.work[YIELDING] += yielded
        done = False
        load = v
        if step % certificate.every == 0:
            if certificate.strict:
                lower, upper = strict_bounds(certificate, joints, points, areas, v)
                if inertia is None:
                    load = carried_load(certificate, joints, lower)
            else:
                lower, upper = instant_bounds(blocks, joints, points, areas, v, moved, dt)
            done = judge(certificate, step // certificate.every, lower, upper, v, actuators.drive[1])
        if load > actuators.drive[3]:
            actuators.drive[3] = load
            actuators.drive[4] = actuators.drive[1]
        if record is not None:
            if step % record.every[0] == 0 or done:
                if energy is not None and record.count[0] < record.row.shape[0]:
                    balance(
                        energy, blocks, joints, points, areas, actuators, ties, drive, scaled, inertia, dt,
                        record.energy[record.count[0]],
                    )  # fmt: skip
                bounds = (bracket[0], bracket[1])
                if not write_row(
                    record,
                    step,
                    step * dt,
                    blocks,
                    joints,
                    points,
                    areas,
                    actuators,
                    ties,
                    load,
                    drive.viscous_s,
                    *bounds,
                    done,
                ):
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


@entry
def settle(first, n_steps, tolerance, blocks, joints, points, areas, scaled, momentum):
    """Relaxation under the dead loads from step ``first`` on, until ``n_steps`` more are done or forces balance.

    Each block moves by its artificial inertia's answer to the out-of-balance.

    For one block on a fixed base a step is a Newton step. ``momentum`` keeps part of the last move, while that goes
    along with the forces. Returns the unbalanced-force ratio reached and the number of steps done.
    """
    ratio = 1.0
    for step in range(first, first + n_steps):
        clear_forces(blocks)
        joint_forces(blocks, joints, points, areas, None, 1.0, 0.0, 0.0, None)
        hold(blocks)
        ratio = unbalanced_ratio(blocks, joints)
        if step > 0 and ratio <= tolerance:
            return ratio, step
        # the first step is the elastic answer, and no start for a swing; what works against the forces has swung over
        keep = momentum if step > 1 and unbalanced_power(blocks) > 0.0 else 0.0
        for f in range(blocks.free.size):
            b = blocks.free[f]
            for i in range(3):
                blocks.velocity[b, i] *= keep
                blocks.spin[b, i] *= keep
        small_step(blocks, scaled, 1.0, 0.0, 0.0, None)
    return ratio, first + n_steps


@entry
def push_on(first, n_steps, dt, blocks, joints, points, areas, actuators, scaled, drive, energy, least, greatest):
    """Push blocks of artificial inertia on from step ``first`` for ``n_steps`` more, in small motion, whatever they do.

    Returns the ``least`` and the ``greatest`` V, given those so far, and the longest move of a block (m) in a step.
    """
    if first == 0:
        begin_energy(energy, blocks, joints, points, areas, None)
    longest = 0.0
    for step in range(first, first + n_steps):
        clear_forces(blocks)
        joint_forces(blocks, joints, points, areas, None, dt, drive.viscous_n, drive.viscous_s, energy)
        v, _ = actuator_forces(blocks, actuators, drive, None, head_rate(drive, step, dt), dt, energy)
        hold(blocks)
        least = min(least, v)
        greatest = max(greatest, v)
        longest = max(longest, small_step(blocks, scaled, dt, 0.0, 0.0, None))
    return least, greatest, longest
