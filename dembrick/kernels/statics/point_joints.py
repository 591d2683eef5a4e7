"""Joints that act at contact points, in searches and constant-rate tests: the point family.

Its functions have the same names as those of `area_joints`; `joint_families` calls either. The law of one point is
`kernels.joint.point_law`.
"""

from math import inf, sqrt
from typing import NamedTuple

from numpy import ndarray, uint64

from dembrick._jit import entry, jit, jit_sum
from dembrick.kernels.joint import custom_law
from dembrick.kernels.joint.custom_law import Custom
from dembrick.kernels.joint.dashpots import dashpot_work
from dembrick.kernels.joint.geometry import gap_closes
from dembrick.kernels.joint.point_law import Strengths, breaks_at_once, point_law, shear_loss, shear_strength
from dembrick.kernels.joint.utilisation import FrictionPoints, point_gauge
from dembrick.kernels.math.geometric_median import median_distance
from dembrick.kernels.math.vectors import columns_times, put_vector
from dembrick.kernels.statics.point_laws import forces_not_dry, power_taken


class Bonds(NamedTuple):
    """Memory of points with strengths, and the force of their normal springs."""

    area: ndarray  # (c,) m2, tributary
    bonded: ndarray  # (c,) 1 while the bond holds, else 0
    crushed: ndarray  # (c,) m, depth by which the point was crushed
    rise: ndarray  # (c,) m, by dilation
    spring: ndarray  # (c,) N, of the normal spring without its dashpot


ABOVE = 1e-9  # relative error of a gauge after its iteration


class Points(NamedTuple):
    """Joints whose forces act at contact points."""

    joint: ndarray  # (p,) int64, which joint
    start: ndarray  # (p + 1,) int64, first contact point of each
    friction: ndarray  # (p,) friction coefficient
    x_n: ndarray  # (c,) m, along t1, where the normal force acts
    y_n: ndarray  # (c,) m, along t2
    x_s: ndarray  # (c,) m, along t1, where slip is measured and the shear force acts
    y_s: ndarray  # (c,) m, along t2
    k_n: ndarray  # (c,) N/m, normal stiffness times tributary area
    k_s: ndarray  # (c,) N/m, shear stiffness times tributary area
    normal: ndarray  # (c,) N, normal force now, positive in compression
    elastic_1: ndarray  # (c,) N, elastic shear force on b along t1
    elastic_2: ndarray  # (c,) N, along t2
    slip: ndarray  # (c,) m, length of the slip path of each point
    path: ndarray  # (p,) m, that of each joint, averaged over the pressure: see `kernels.joint.point_law`
    strengths: Strengths | None = None  # besides friction; None if no joint has any
    bonds: Bonds | None = None  # None if ``strengths`` is
    custom: Custom | None = None  # arrays of a user-defined law; None if there is none


@jit
def spring_resultant(points, p, sums, depth):
    """N, M_1, M_2 of the normal springs of point joint ``p`` without its dashpots; ``sums`` is its `Energy.normal`.

    In closed form for all points closed; if a point may be open, the tension that open points would add is removed.
    """
    g0, gx, gy = depth
    n = sums[0] * g0 + sums[2] * gy + sums[1] * gx
    m1 = -(sums[2] * g0 + sums[4] * gy + sums[5] * gx)
    m2 = sums[1] * g0 + sums[5] * gy + sums[3] * gx
    if sums[6] * (abs(gy) + abs(gx)) > g0:
        for i in range(uint64(points.start[p]), uint64(points.start[p + 1])):
            x = points.x_n[i]
            y = points.y_n[i]
            pull = points.k_n[i] * max(-(g0 + gy * y + gx * x), 0.0)
            n += pull
            m1 -= pull * y
            m2 += pull * x
    return n, m1, m2


@jit
def forces(points, p, before, motion, viscous, energy):
    """Resultant (N, V_1, V_2, M_T, M_1, M_2, slip) of point joint ``p`` for a `Motion`; updates the memory of its
    contact points.

    ``viscous``: dashpot over spring force, along the normal and in shear. With ``energy`` (not None) the work of the
    step is added to it, by the trapezoidal rule; ``before`` is the resultant of the last step.
    """
    return forces_by(points.strengths, points.bonds, points.custom, points, p, before, motion, viscous, energy)


@jit
def forces_by(strengths, bonds, custom, points, p, before, motion, viscous, energy):
    """`forces` by the law of the points: dry if ``strengths`` and ``custom`` are None."""
    if custom is not None or strengths is not None:
        return forces_not_dry(strengths, bonds, custom, points, p, motion, viscous, energy)
    return dry_forces(points, p, before, motion, viscous, energy)


@jit
def dry_forces(points, p, before, motion, viscous, energy):
    """`forces` of a joint in a scene where no joint has strengths."""
    mu = points.friction[p]
    damped = 1.0 + viscous[1]
    share = 1.0 / damped
    dashpots = viscous[0], damped, share
    g0, gx, gy = motion.depth
    d0, dx, dy = motion.growth
    p1, p2, pr = motion.slip
    n = m1 = m2 = v1 = v2 = mt = rubbed = 0.0
    friction = by_law = released = least = c1 = c2 = cm = 0.0
    for i in range(uint64(points.start[p]), uint64(points.start[p + 1])):
        x = points.x_n[i]
        y = points.y_n[i]
        xs = points.x_s[i]
        ys = points.y_s[i]
        k = points.k_s[i]
        s1 = p1 - pr * ys
        s2 = p2 + pr * xs
        b1 = points.elastic_1[i]
        b2 = points.elastic_2[i]
        normal, t1, t2, e1, e2, slid = point_law(
            g0 + gy * y + gx * x, d0 + dy * y + dx * x, (s1, s2), (b1, b2), (points.k_n[i], k), mu, dashpots
        )
        points.normal[i] = normal
        points.elastic_1[i] = e1
        points.elastic_2[i] = e2
        n += normal
        m1 -= y * normal
        m2 += x * normal
        v1 += t1
        v2 += t2
        mt += xs * t2 - ys * t1
        points.slip[i] += slid
        rubbed += normal * slid
        if energy is not None:
            if slid > 0.0:
                loss = shear_loss((b1, b2), (e1, e2), (s1, s2), k)
                friction += loss
                least = min(least, loss)
                by_law += mu * normal * slid
            elif normal == 0.0 and (b1 != 0.0 or b2 != 0.0):
                released += shear_loss((b1, b2), (e1, e2), (s1, s2), k)
                c1 += b1
                c2 += b2
                cm += xs * b2 - ys * b1
    if rubbed > 0.0:
        points.path[p] += rubbed / n
    if energy is not None:
        energy.work[0].sliding += friction
        energy.work[0].by_law += by_law
        if least < 0.0:
            energy.work[0].least = min(energy.work[0].least, least)
        # The dashpots carry what the springs do not. All points move with one rigid motion, so the work of their
        # resultant is the sum of theirs. At every closed point t = e + d with d = viscous (e - old), hence
        # d = viscous (t - t_old + d_old) / (1 + viscous), likewise for resultants; a point that has opened has no d.
        still_n, still_1, still_2 = spring_resultant(points, p, energy.normal[p], motion.depth)
        dash = energy.dash[points.joint[p]]
        rest = 1.0 - share  # viscous / (1 + viscous), without a division
        shear = (
            rest * (v1 - before[1] + dash[0] + c1),
            rest * (v2 - before[2] + dash[1] + c2),
            rest * (mt - before[3] + dash[2] + cm),
        )
        pressure = n - still_n, m1 - still_1, m2 - still_2
        energy.work[0].damping += released + 0.5 * dashpot_work(dash, shear, pressure, motion)
    return n, v1, v2, mt, m1, m2, points.path[p]


@jit
def strength(strengths, bonds, points, p, i, normal):
    """Shear capacity of point ``i`` of joint ``p`` (N) under the normal force ``normal``."""
    if strengths is not None:
        return shear_strength(strengths, p, bonds.area[i], bonds.bonded[i], points.friction[p], normal)
    return points.friction[p] * normal


@jit
def dissipation(points, p, rest, normal, q1, q2, qr):
    """D(q) of point joint ``p`` with the normal forces ``rest`` of its points (N m for a twist in m, m, rad)."""
    return dissipation_by(points.strengths, points.bonds, points.custom, points, p, rest, q1, q2, qr)


@jit
def dissipation_by(strengths, bonds, custom, points, p, rest, q1, q2, qr):
    """`dissipation` by the law of the points: dry if ``strengths`` and ``custom`` are None. The dissipation of a
    user-defined law under other normal forces is unknown: its present one is taken."""
    if custom is not None:
        return power_taken(custom, points, p, q1, q2, qr)
    total = 0.0
    for i in range(points.start[p], points.start[p + 1]):
        s1 = q1 - qr * points.y_s[i]
        s2 = q2 + qr * points.x_s[i]
        carried = rest[i]
        if strengths is not None:
            carried = strength(strengths, bonds, points, p, i, rest[i])
        total += carried * (s1 * s1 + s2 * s2) ** 0.5
    if strengths is None:
        total *= points.friction[p]
    return total


@jit
def shear_energy(points, p):
    """Energy (J) in the shear springs of point joint ``p``, plus the energy in crushed or lifted normal springs beyond
    half their force times the penetration."""
    return shear_energy_by(points.custom, points, p)


@jit_sum
def shear_energy_by(custom, points, p):
    """`shear_energy` by the law of the points."""
    twice = 0.0
    if custom is not None:
        for i in range(points.start[p], points.start[p + 1]):
            twice += custom_law.shear_held(custom, i)
        return twice
    for i in range(uint64(points.start[p]), uint64(points.start[p + 1])):
        twice += (points.elastic_1[i] * points.elastic_1[i] + points.elastic_2[i] * points.elastic_2[i]) / points.k_s[i]
    return 0.5 * (twice + beyond_penetration(points.bonds, points.start[p], points.start[p + 1]))


@jit
def beyond_penetration(bonds, first, last):
    """Twice the energy (J) in normal springs beyond half their force times the penetration, of crushed or lifted
    points."""
    twice = 0.0
    if bonds is not None:
        for i in range(first, last):
            twice += bonds.spring[i] * (bonds.rise[i] - bonds.crushed[i])
    return twice


@jit
def copy_bonds(bonds, memory, first, last):
    """Copy the memory of the bonds of the points ``first`` to ``last`` - 1."""
    if bonds is not None:
        for i in range(first, last):
            memory.bonded[i] = bonds.bonded[i]
            memory.crushed[i] = bonds.crushed[i]
            memory.rise[i] = bonds.rise[i]


@jit
def remember(points, memory, p):
    """Copy the memory of the points of joint ``p`` into ``memory``, another `Points`."""
    for i in range(points.start[p], points.start[p + 1]):
        memory.elastic_1[i] = points.elastic_1[i]
        memory.elastic_2[i] = points.elastic_2[i]
        memory.slip[i] = points.slip[i]
    memory.path[p] = points.path[p]
    copy_bonds(points.bonds, memory.bonds, points.start[p], points.start[p + 1])
    custom_law.remember(points.custom, memory.custom, points.start[p], points.start[p + 1])


@jit
def write_contacts(points, p, joints, viscous, out):
    """Force (N, world) on block b at every contact point of joint ``p`` into ``out`` (c, 3).

    The shear force is the elastic part and a dashpot on all of the slip, limited to the strength: this reproduces
    `coulomb`, which returns along the trial force. Where a bond has just broken, the elastic part alone may exceed the
    remaining strength until the next step.
    """
    j = points.joint[p]
    axes = joints.axes[j]
    slip = joints.step[j]
    for i in range(points.start[p], points.start[p + 1]):
        k = viscous * joints.damping[j] * points.k_s[i] if points.custom is None else 0.0
        t1 = points.elastic_1[i] + k * (slip[0] - slip[2] * points.y_s[i])
        t2 = points.elastic_2[i] + k * (slip[1] + slip[2] * points.x_s[i])
        size = sqrt(t1 * t1 + t2 * t2)
        kept = sqrt(points.elastic_1[i] * points.elastic_1[i] + points.elastic_2[i] * points.elastic_2[i])
        cap = max(strength(points.strengths, points.bonds, points, p, i, points.normal[i]), kept)
        if size > cap and points.custom is None:
            t1 *= cap / size
            t2 *= cap / size
        force = columns_times(axes, -t1, -t2, points.normal[i])
        for k in range(3):
            out[i, k] = force[k]


@jit
def write_bonds(bonds, points, out):
    """Part of the area of every joint whose bond holds, into ``out`` (j,); ``bonds`` is ``points.bonds``."""
    if bonds is not None:
        for p in range(points.joint.size):
            held = area = 0.0
            for i in range(points.start[p], points.start[p + 1]):
                held += bonds.area[i] * bonds.bonded[i]
                area += bonds.area[i]
            out[points.joint[p]] = held / area


# --- limit-analysis bounds


@jit
def carried_share(points, p, rest, normal, now):
    """The part of the present forces that fits under ``rest``, the normal forces before the actuators pushed."""
    share = 1.0
    for i in range(points.start[p], points.start[p + 1]):
        if points.normal[i] * share > rest[i]:
            share = rest[i] / points.normal[i]
    return share


@jit
def pressure_moved(points, p, centre, normal, now):
    """Whether friction follows a pressure that differs from that before the actuators pushed; points need no such
    check, since `carried_share` allows for it."""
    return False


@jit
def bound_twist(points, p, joints):
    """Slip twist (3) that gives the least upper bound: that of the last step."""
    q = joints.step[points.joint[p]]
    return q[0], q[1], q[2]


@jit
def at_rest(points, p, basis):
    """Fill ``basis`` with the dead-load state of joint ``p``; returns the reach of its shear forces (m), and whether
    friction follows the pressure."""
    first = points.start[p]
    last = points.start[p + 1]
    reach = total = 0.0
    for i in range(first, last):
        basis.rest[i] = points.normal[i]
        total += points.normal[i]
        basis.centre[0] += points.normal[i] * points.x_s[i]
        basis.centre[1] += points.normal[i] * points.y_s[i]
        reach = max(reach, points.x_s[i] ** 2 + points.y_s[i] ** 2)
    basis.centre[0] /= total
    basis.centre[1] /= total
    basis.scalars[2] = median_distance(points.x_s, points.y_s, points.normal, first, last)
    return sqrt(reach), True


@jit
def overturning_load(points, p, resultant, normal, unit):
    """V at which the joint overturns before it slides: not needed where friction follows the pressure."""
    return 0.0


@jit
def closes_gap(points, p, gap, base, u):
    """Whether a gap of point joint ``p`` closes further between the motions ``base`` (6) and ``u`` (6)."""
    return gap_closes(points.x_n, points.y_n, points.start[p], points.start[p + 1], gap, base, u)


@jit
def dead_gauge(points, p, normal, dead, basis):
    """Upper bound of the gauge of the dead load in the limit set: the largest utilisation of a point, since the
    dead-load forces are one way to carry the load; or, if less, the gauge itself, as points of a joint at rest may
    slide."""
    taken = 0.0
    mu = points.friction[p]
    first, last = points.start[p], points.start[p + 1]
    for i in range(first, last):
        if points.normal[i] > 0.0:
            force = sqrt(points.elastic_1[i] ** 2 + points.elastic_2[i] ** 2)
            taken = max(taken, force / (mu * points.normal[i]))
    put_vector(basis.twist, 0.0, 0.0, 0.0)
    load = dead[0] / mu, dead[1] / mu, dead[5] / mu
    carrying = FrictionPoints(points.x_s, points.y_s, points.normal, first, last)
    exact = point_gauge(carrying, *load, basis.twist, basis.across)
    return min(taken, (1.0 + ABOVE) * exact)


# --- bonds


@entry
def reserves(points, out):
    """Reserve of bonds (c, 2), in N: in tension; and in shear, if breaking would release force, else infinite. Both are
    infinite if there is no bond."""
    for p in range(points.joint.size):
        for i in range(points.start[p], points.start[p + 1]):
            out[i, 0] = out[i, 1] = inf
            strengths = points.strengths
            bonds = points.bonds
            if bonds.bonded[i] > 0.0:
                out[i, 0] = strengths.tension[p] * bonds.area[i] + bonds.spring[i]
                if bonds.spring[i] <= 0.0 or breaks_at_once(strengths, p):
                    cap = strength(strengths, bonds, points, p, i, points.normal[i])
                    out[i, 1] = cap - sqrt(points.elastic_1[i] ** 2 + points.elastic_2[i] ** 2)
