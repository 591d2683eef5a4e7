"""The record of a run in real time: its rows, and frames of motion, into given arrays.

Quantities that depend only on the positions and forces at a row are computed here; loads and drives are recorded in
Python. Rows are written between the steps of the loop by one kernel, which is compiled once for all loops.
"""

from math import inf, isnan, nan, sqrt
from typing import NamedTuple

import numpy as np
from numpy import ndarray

from dembrick._jit import entry, jit, jit_rounded
from dembrick.kernels.dynamics import joint_families as families
from dembrick.kernels.dynamics.row_energies import write_energies
from dembrick.kernels.dynamics.tiles import ACTION, W, sense_of, three, wrench_at
from dembrick.kernels.joint.families import FAMILIES, joint_count, joint_of
from dembrick.kernels.math.vectors import cross, put_vector, rows_times

# Steps between rows, and rows between two frames (0: no frames); speed (m/s) of a point, and motion (m) of a block
# since the last contact detection, beyond which contacts must be detected again before a row is written
NEXT = np.dtype((np.record, [("every", np.int64), ("frames_every", np.int64), ("fastest", float), ("quiet", float)]))

# Numbers of a row: out-of-balance ratio, number of loaded new contacts, longest displacement (m), gravity (m/s2)
ROW = np.dtype(
    (np.record, [("unbalanced", float), ("new_contacts", float), ("furthest", float), ("gravity", float, (3,))])
)


class Record(NamedTuple):
    """Rows and frames of a run, one entry per row or frame, and scratch. Channels that are not requested have no
    entries."""

    next: ndarray  # (1,) record `NEXT`
    travel: ndarray  # (2,) m, see `Course`
    count: ndarray  # (2,) int64, rows, frames so far
    step: ndarray  # (r,) int64
    row: ndarray  # (r,) records `ROW`
    joint: ndarray  # (r, j or 0, 7), see `write_resultants`
    support: ndarray  # (n,) int64, number of each block among the supports, -1 if it is none
    reaction: ndarray  # (r, s, 6) N, N m, see `write_reactions`
    middle: ndarray  # (3,) m, origin of positions
    tension: ndarray  # (r, t) N
    yielded: ndarray  # (r, t) m
    watched: ndarray  # (w,) int64, blocks of the control points
    place: ndarray  # (r, w, 3) m, their centroids, from the origin of `Bodies.position`
    turn: ndarray  # (r, w, 3, 3) their rotations
    energy: ndarray  # (r or 0,) records `BALANCE`
    energy_start: ndarray  # (2,) J, kinetic energy and energy in springs at time zero
    frame_step: ndarray  # (F,) int64
    frame_position: ndarray  # (F, n, 3) m
    frame_orientation: ndarray  # (F, n, 4)
    frame_shift: ndarray  # (F, j or 0, 2) m
    shift: ndarray  # (j, 2) m, shift of O of each joint on its host since the start
    held: ndarray  # (a, 3) scratch: see `spring_energies`
    of_joints: ndarray  # (j,) scratch
    pulled: ndarray  # (s, 6) scratch
    halves: ndarray  # scratch, see `sum_in_pairs`


class Extremes(NamedTuple):
    """The greatest values of a run so far, updated at every row."""

    furthest: ndarray  # (n,) m, displacement of each centroid
    quiet: ndarray  # (n,) s, last time when its mean acceleration from row to row was below the threshold
    last: ndarray  # (n + 1, 3) m/s, the velocities of the row before; the first number of the last row: its time (s)
    tension: ndarray  # (t,) N, of each tie
    turned: ndarray  # (n,) cosine of half the greatest turn of each block
    threshold: ndarray  # (1,) m/s2
    upright: ndarray  # (n, 4) orientations from which rotations count


class Pressing(NamedTuple):
    """Forces of t new contacts, as rows need them: the few of the many arrays of `Touching`, since a kernel is compiled
    with all arrays that it is passed."""

    owner: ndarray
    first: ndarray
    second: ndarray
    normal: ndarray
    point: ndarray
    force: ndarray
    torque: ndarray


class Scene(NamedTuple):
    """Arrays from which rows are written; ``energy_terms`` and families of joints are None if there are none."""

    bodies: tuple
    links: tuple
    corners: tuple | None
    faces: tuple | None
    ties: tuple
    pressing: Pressing
    energy_terms: tuple | None


@jit
def write_resultants(bodies, links, corners, faces, out):
    """N, V_1, V_2, M_T, M_1, M_2 (action on b about O) and slip of every joint into ``out`` (j, 7), of the last forces.

    The axes are t1, that of the host projected on the plane, t2 and the normal from a to b; slip is the length of its
    path (m).
    """
    for j in range(links.host.size):
        u = links.axes[links.plane[j]]
        R = bodies.rotation[links.other[j]]
        u1, u2, u3 = rows_times(R, u[0, 0], u[0, 1], u[0, 2])
        w1, w2, w3 = rows_times(R, u[1, 0], u[1, 1], u[1, 2])
        n1, n2, n3 = cross(u1, u2, u3, w1, w2, w3)
        R = bodies.rotation[links.host[j]]
        t = links.axes[links.tangents[j]]
        x1, x2, x3 = rows_times(R, t[0, 0], t[0, 1], t[0, 2])
        y1, y2, y3 = rows_times(R, t[1, 0], t[1, 1], t[1, 2])
        z1, z2, z3 = cross(x1, x2, x3, y1, y2, y3)
        l1, l2, l3 = three(links.tiles[links.place[j] // W].lever, links.place[j] % W)
        r1 = l1 * x1 + l2 * y1 + l3 * z1
        r2 = l1 * x2 + l2 * y2 + l3 * z2
        r3 = l1 * x3 + l2 * y3 + l3 * z3
        along = x1 * n1 + x2 * n2 + x3 * n3
        x1 -= along * n1
        x2 -= along * n2
        x3 -= along * n3
        size = sqrt(x1 * x1 + x2 * x2 + x3 * x3)
        x1 /= size
        x2 /= size
        x3 /= size
        y1, y2, y3 = cross(n1, n2, n3, x1, x2, x3)
        wrench = links.wrenches[wrench_at(links, j)]
        c1, c2, c3 = cross(r1, r2, r3, wrench[0], wrench[1], wrench[2])
        # the wrench acts on the host, which is b where sense is +1; it is opposite to V and M on b
        sense = sense_of(links, j)
        f1 = sense * wrench[0]
        f2 = sense * wrench[1]
        f3 = sense * wrench[2]
        m1 = sense * (wrench[3] - c1)
        m2 = sense * (wrench[4] - c2)
        m3 = sense * (wrench[5] - c3)
        out[j, 0] = n1 * f1 + n2 * f2 + n3 * f3
        out[j, 1] = -(x1 * f1 + x2 * f2 + x3 * f3)
        out[j, 2] = -(y1 * f1 + y2 * f2 + y3 * f3)
        out[j, 3] = -(n1 * m1 + n2 * m2 + n3 * m3)
        out[j, 4] = -(x1 * m1 + x2 * m2 + x3 * m3)
        out[j, 5] = -(y1 * m1 + y2 * m2 + y3 * m3)
    for family in range(FAMILIES):
        for i in range(joint_count(corners, faces, family)):
            out[joint_of(corners, faces, family, i), 6] = families.mean_slip(corners, faces, family, i)


@jit
def unbalanced_ratio(bodies, links, g1, g2, g3):
    """Greatest out-of-balance force or moment on a free block under gravity g, over the greatest joint force; 1 without
    any.

    A moment counts as the force that makes it at the block's reach. NaN if any force is NaN, which a maximum would
    hide.
    """
    worst = largest = total = 0.0
    wrenches = links.wrenches
    for f in range(bodies.free.size):
        b = bodies.free[f]
        f1 = bodies.mass[b] * g1 + bodies.applied[b, 0]
        f2 = bodies.mass[b] * g2 + bodies.applied[b, 1]
        f3 = bodies.mass[b] * g3 + bodies.applied[b, 2]
        m1, m2, m3 = bodies.applied[b, 3], bodies.applied[b, 4], bodies.applied[b, 5]
        for k in range(bodies.side_start[b], bodies.side_start[b + 1]):
            w = (bodies.side[k] >> 1) * ACTION
            is_host = bodies.side[k] & 1
            sign = 1.0 if is_host else -1.0
            f1 += sign * wrenches[w]
            f2 += sign * wrenches[w + 1]
            f3 += sign * wrenches[w + 2]
            own = w + 3 if is_host else w + 6
            m1 += wrenches[own]
            m2 += wrenches[own + 1]
            m3 += wrenches[own + 2]
        out = f1 * f1 + f2 * f2 + f3 * f3
        turning = (m1 * m1 + m2 * m2 + m3 * m3) / bodies.reach[b] ** 2
        worst, total = max(worst, out, turning), total + out + turning
    for j in range(links.host.size):
        w = links.place[j] * ACTION
        largest = max(largest, wrenches[w] ** 2 + wrenches[w + 1] ** 2 + wrenches[w + 2] ** 2)
    if isnan(total):
        return nan
    return sqrt(worst / largest) if largest > 0.0 else 1.0


@jit_rounded
def add_six(out, sense, a, b):
    """Add ``sense`` times a (3) and b (3) to a row of six numbers."""
    for i in range(3):
        out[i] += sense * a[i]
        out[3 + i] += sense * b[i]


@jit_rounded
def plain_cross(a, b):
    """a x b, with each product rounded separately."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@jit_rounded
def add_contacts(bodies, pressing, support, middle, out):
    """Add the forces of supports through new contacts: see `write_reactions`."""
    for side in range(2):
        parts = pressing.second if side else pressing.first
        sense = -1.0 if side else 1.0
        for t in range(parts.size):
            b = pressing.owner[parts[t]]
            if pressing.normal[t] > 0.0 and support[b] >= 0:
                x = bodies.position[b]
                c = pressing.point[t]
                f = pressing.force[t]
                m = pressing.torque[t]
                # as computed from the point in a history, whose origin is that of the world
                a1 = c[0] + middle[0] - middle[0] - x[0]
                a2 = c[1] + middle[1] - middle[1] - x[1]
                a3 = c[2] + middle[2] - middle[2] - x[2]
                r = plain_cross((a1, a2, a3), f)
                add_six(out[support[b]], sense, f, (m[0] + r[0], m[1] + r[1], m[2] + r[2]))


@jit_rounded
def take_pulls(ties, support, pulled, out):
    """Subtract the forces of ties on the supports; ``pulled`` (s, 6) is scratch."""
    pulled[:] = 0.0
    for side in range(2):
        for t in range(ties.stiffness.size):
            s = support[ties.block[t, side]]
            if s >= 0:
                f = ties.force[t]
                add_six(pulled[s], 1.0 - 2.0 * side, f, plain_cross(ties.arm[t, side], f))
    for s in range(out.shape[0]):
        for i in range(6):
            out[s, i] -= pulled[s, i]


@jit
def write_reactions(record, bodies, links, ties, pressing, out):
    """Force (N) and moment (N m, about its centroid at the start) of each support on the structure, into ``out``
    (s, 6): through its joints, ties and new contacts, of the last forces, world axes. For a guided block: force and
    moment of its guides, about its centroid."""
    support = record.support
    out[:] = 0.0
    for j in range(links.host.size):
        s = support[links.host[j]]
        if s >= 0:
            w = links.wrenches[wrench_at(links, j)]
            add_six(out[s], -1.0, w[:3], w[3:6])
    for j in range(links.other.size):
        s = support[links.other[j]]
        if s >= 0:
            w = links.wrenches[wrench_at(links, j)]
            add_six(out[s], 1.0, w[:3], (-w[6], -w[7], -w[8]))
    add_contacts(bodies, pressing, support, record.middle, out)
    if ties.stiffness.size > 0:
        take_pulls(ties, support, record.pulled, out)
    for b in range(support.size):
        s = support[b]
        if s >= 0:
            add_carried(bodies, b, out[s])
    for g in range(bodies.guided.size):
        for i in range(6):
            out[support[bodies.guided[g]], i] = bodies.guide[g, i]


@jit_rounded
def add_carried(bodies, b, out):
    """Transfer moments from the present centroid of block ``b`` to that at the start."""
    x = bodies.position[b]
    x0 = bodies.start[b]
    m = plain_cross((x[0] - x0[0], x[1] - x0[1], x[2] - x0[2]), out)
    for i in range(3):
        out[3 + i] += m[i]


@jit_rounded
def length_of(a1, a2, a3):
    """|a|."""
    return sqrt(a1 * a1 + a2 * a2 + a3 * a3)


@jit_rounded
def away(bodies, b):
    """Distance (m) of the centroid of block ``b`` from its start."""
    x = bodies.position[b]
    x0 = bodies.start[b]
    return length_of(x[0] - x0[0], x[1] - x0[1], x[2] - x0[2])


@jit_rounded
def update_extremes(extremes, bodies, ties, time):
    """Update the ``extremes`` by the present state; at time zero, when nothing has moved, only those of the ties."""
    for t in range(extremes.tension.size):
        extremes.tension[t] = max(extremes.tension[t], ties.now[t].tension)
    if time <= 0.0:
        return
    n = extremes.furthest.size
    passed = time - extremes.last[n, 0]
    for b in range(n):
        extremes.furthest[b] = max(extremes.furthest[b], away(bodies, b))
        q = bodies.orientation[b]
        p = extremes.upright[b]
        half = abs((q[0] * p[0] + q[2] * p[2]) + (q[1] * p[1] + q[3] * p[3]))
        extremes.turned[b] = min(extremes.turned[b], half)
        v = bodies.velocity[b]
        u = extremes.last[b]
        if passed > 0.0 and length_of(v[0] - u[0], v[1] - u[1], v[2] - u[2]) / passed <= extremes.threshold[0]:
            extremes.quiet[b] = time
        for i in range(3):
            u[i] = v[i]
    extremes.last[n, 0] = time


@jit
def write_frame(record, step, bodies):
    """Add a frame to the record."""
    frame = record.count[1]
    record.frame_step[frame] = step
    for b in range(record.frame_position.shape[1]):
        for i in range(3):
            record.frame_position[frame, b, i] = bodies.position[b, i]
        for i in range(4):
            record.frame_orientation[frame, b, i] = bodies.orientation[b, i]
    for j in range(record.frame_shift.shape[1]):
        record.frame_shift[frame, j, 0] = record.shift[j, 0]
        record.frame_shift[frame, j, 1] = record.shift[j, 1]
    record.count[1] = frame + 1


@jit
def fill_row(record, bodies, links, corners, faces, ties, pressing, energy_terms, row, moment):
    """Fill a row with the present state; ``moment``: time step (s), gravity (3; m/s2)."""
    dt, g1, g2, g3 = moment
    own = record.row[row]
    own.unbalanced = unbalanced_ratio(bodies, links, g1, g2, g3)
    carrying = 0
    for t in range(pressing.normal.size):
        carrying += pressing.normal[t] > 0.0
    own.new_contacts = carrying
    furthest = 0.0
    for b in range(bodies.mass.size):
        furthest = max(furthest, away(bodies, b))
    own.furthest = furthest
    put_vector(own.gravity, g1, g2, g3)
    if record.joint.shape[1] > 0:
        write_resultants(bodies, links, corners, faces, record.joint[row])
    write_reactions(record, bodies, links, ties, pressing, record.reaction[row])
    for t in range(ties.stiffness.size):
        record.tension[row, t] = ties.now[t].tension
        record.yielded[row, t] = ties.now[t].yielded
    for w in range(record.watched.size):
        b = record.watched[w]
        for i in range(3):
            record.place[row, w, i] = bodies.position[b, i]
            for k in range(3):
                record.turn[row, w, i, k] = bodies.rotation[b, i, k]
    if energy_terms is not None:
        if record.energy.size > 0:
            write_energies(record, bodies, links, corners, faces, ties, energy_terms, dt, record.energy[row])


@entry
def write_row(record, scene, extremes, moment):
    """Add a row of the present state of a `Scene` to the record, and a frame if one is due; there must be room.

    ``moment``: step, time step (s), gravity (3; m/s2). The rotation matrices must be up to date. Returns 1; or 0,
    without writing, if contacts must be detected first (`detection_can_wait`).
    """
    bodies, links, corners, faces, ties, pressing, energy_terms = scene
    step, dt, g1, g2, g3 = moment
    if not detection_can_wait(record, bodies):
        return 0
    row = record.count[0]
    every = record.next[0].frames_every
    update_extremes(extremes, bodies, ties, step * dt)
    record.step[row] = step
    fill_row(record, bodies, links, corners, faces, ties, pressing, energy_terms, row, (dt, g1, g2, g3))
    record.count[0] = row + 1
    if every > 0 and step // record.next[0].every % every == 0:
        write_frame(record, step, bodies)
    return 1


@jit
def detection_can_wait(record, bodies):
    """Whether no contact detection is needed before the next row, by the speed and the motion of the blocks."""
    following = record.next[0]
    if not record.travel[1] < following.quiet:
        return False
    if following.fastest == inf:
        return True
    for b in range(bodies.mass.size):
        v = bodies.velocity[b]
        w = bodies.spin[b]
        speed = sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2) + bodies.reach[b] * sqrt(w[0] ** 2 + w[1] ** 2 + w[2] ** 2)
        if not speed <= following.fastest:
            return False
    return True
