"""The record of a search or constant-rate test: rows of history and frames of motion, into given arrays.

Channels that are not requested have arrays without entries, and cost neither time nor memory.
"""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from dembrick._jit import entry, jit
from dembrick.kernels.math.vectors import NO_MOMENT, add_wrench, columns_times, turned, turning
from dembrick.kernels.statics.block_forces import unbalanced_ratio
from dembrick.kernels.statics.joint_families import write_bonds, write_contacts

# Numbers of a row: time, V (N), driven displacement (m), out-of-balance ratio, bounds of V (N)
NUMBERS = ("time", "load", "displacement", "unbalanced", "lower", "upper")
ROW = np.dtype((np.record, [(name, float) for name in NUMBERS]))


class Record(NamedTuple):
    """Rows and frames written by the loop."""

    every: ndarray  # (2,) int64, steps between rows, between frames (a multiple)
    count: ndarray  # (2,) int64, rows, frames so far
    row: ndarray  # (r,) records `ROW`
    actuator: ndarray  # (r, k) m
    joint: ndarray  # (r, j or 0, 7)
    support: ndarray  # (n,) int64, number of each block among the fixed ones, -1 if it is free
    reaction: ndarray  # (r, s, 6) N, N m, see `write_reactions`
    tension: ndarray  # (r, t) N, of the ties
    yielded: ndarray  # (r, t) m, their plastic elongation
    energy: ndarray  # (r, 9) J, see `energy.balance`
    watched: ndarray  # (w,) int64, blocks of the control points
    lever: ndarray  # (w, 3) m, from their centroids to the points, body axes
    arm: ndarray  # (w, 3) m, the same at the start, world axes
    way: ndarray  # (r, w, 3) m, displacement of the points
    frame_time: ndarray  # (F,)
    frame_displacement: ndarray  # (F, n, 3) m
    frame_orientation: ndarray  # (F, n, 4)
    frame_velocity: ndarray  # (F, n or 0, 3) m/s
    frame_spin: ndarray  # (F, n or 0, 3) rad/s
    frame_contact: ndarray  # (F, c or 0, 3) N, on block b at each contact point, world
    frame_bond: ndarray  # (F, j or 0) part of the joint's area whose bond holds


@entry
def write_reactions(joints, support, out):
    """Force and moment (s, 6) of fixed blocks on the structure through joints, about their centroids, world axes."""
    for s in range(out.shape[0]):
        for i in range(6):
            out[s, i] = 0.0
    for j in range(joints.block_a.size):
        on_a = support[joints.block_a[j]]
        on_b = support[joints.block_b[j]]
        if on_a < 0 and on_b < 0:
            continue
        r = joints.resultant[j]
        # action of a on b; if b is the support, it acts on a with the opposite
        force = columns_times(joints.axes[j], -r[1], -r[2], r[0])
        moment = columns_times(joints.axes[j], -r[4], -r[5], -r[3])
        for side in range(2):
            s = on_b if side else on_a
            if s >= 0:
                arm = joints.arm_b[j] if side else joints.arm_a[j]
                add_wrench(out[s], -1.0 if side else 1.0, force, moment, arm)


@entry
def write_guides(blocks, support, out):
    """Force and moment of the guides on their blocks, into the rows (s, 6) of these."""
    for g in range(blocks.guided.size):
        for i in range(6):
            out[support[blocks.guided[g]], i] = blocks.guide[g, i]


@jit
def write_ties(record, row, ties):
    """Write tensions of ties into a row, and add their reactions at fixed blocks; ``ties`` may be None."""
    if ties is not None:
        write_pulls(record, row, ties)


@jit
def write_pulls(record, row, ties):
    """`write_ties` where there are ties."""
    for t in range(ties.stiffness.size):
        record.tension[row, t] = ties.now[t].tension
        record.yielded[row, t] = ties.now[t].yielded
        for side in range(2):
            s = record.support[ties.block[t, side]]
            if s >= 0:
                add_wrench(record.reaction[row, s], 2.0 * side - 1.0, ties.force[t], NO_MOMENT, ties.arm[t, side])


@jit
def write_frame(record, time, state, viscous):
    """Add a frame to the record; there must be room. ``viscous`` is the dashpot ratio in shear."""
    blocks = state.blocks
    frame = record.count[1]
    record.frame_time[frame] = time
    for b in range(blocks.displacement.shape[0]):
        q = turned(blocks.orientation, b, blocks.rotation[b, 0], blocks.rotation[b, 1], blocks.rotation[b, 2])
        for i in range(3):
            record.frame_displacement[frame, b, i] = blocks.displacement[b, i]
        for i in range(4):
            record.frame_orientation[frame, b, i] = q[i]
    for b in range(record.frame_velocity.shape[1]):
        for i in range(3):
            record.frame_velocity[frame, b, i] = blocks.velocity[b, i]
            record.frame_spin[frame, b, i] = blocks.spin[b, i]
    if record.frame_contact.shape[1] > 0:
        write_contacts(state.points, state.areas, state.joints, viscous, record.frame_contact[frame])
    if record.frame_bond.shape[1] > 0:
        write_bonds(state.points, state.areas, record.frame_bond[frame])
    record.count[1] = frame + 1


@jit
def write_row(record, step, time, state, load, viscous, bounds, last):
    """Add a row to the record, with a frame if one is due or this is the ``last``; False if there is no room.

    ``load``: V (N); ``bounds`` (2) of it; ``viscous``: dashpot ratio in shear.
    """
    blocks = state.blocks
    joints = state.joints
    actuators = state.actuators
    row = record.count[0]
    framed = record.frame_time.size > 0 and (last or step % record.every[1] == 0)
    if row >= record.row.shape[0] or (framed and record.count[1] >= record.frame_time.size):
        return False
    own = record.row[row]
    own.time = time
    own.load = load
    own.displacement = actuators.driven[0].displacement
    own.unbalanced = unbalanced_ratio(blocks, joints)
    own.lower, own.upper = bounds
    for i in range(actuators.block.size):
        record.actuator[row, i] = actuators.displacement[i]
    for j in range(record.joint.shape[1]):
        for i in range(7):
            record.joint[row, j, i] = joints.resultant[j, i]
    write_reactions(joints, record.support, record.reaction[row])
    write_ties(record, row, state.ties)
    write_guides(blocks, record.support, record.reaction[row])
    for w in range(record.watched.size):
        b = record.watched[w]
        r = blocks.rotation[b]
        q = turned(blocks.orientation, b, r[0], r[1], r[2])
        x, y, z = record.lever[w]
        d1, d2, d3 = turning(*q, x, y, z)
        record.way[row, w, 0] = blocks.displacement[b, 0] + (x + d1 - record.arm[w, 0])
        record.way[row, w, 1] = blocks.displacement[b, 1] + (y + d2 - record.arm[w, 1])
        record.way[row, w, 2] = blocks.displacement[b, 2] + (z + d3 - record.arm[w, 2])
    record.count[0] = row + 1
    if framed:
        write_frame(record, time, state, viscous)
    return True
