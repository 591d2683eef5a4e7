"""The bracket of the limit load, from the forces and the motion of an instant (limit analysis at fixed normal forces).

Upper: for any slip twist q with f.q > 0, V <= (D(q) - g0.q) / (f.q). Lower: the forces of the joint are inside its
limit set; what is out of balance is charged to the load by the gauge of the set. See ``yield_point``.
"""

from math import sqrt
from typing import NamedTuple

from numpy import ndarray

from dembrick._jit import jit
from dembrick.kernels.statics.block_forces import unbalanced_ratio
from dembrick.kernels.statics.joint_forces import area_dissipation, point_dissipation

MISSING = 3.0  # times the growth over a doubling of the motion: what a load that grows as 1 - c/sqrt(u) still lacks
STILL = 0.05  # of the elastic stiffness: a load that grows no faster than that against its motion is at its limit
SAME = 1e-9  # of the normal force and its moment: a pressure that moves no more than that is at rest
NEVER = 1e300  # an upper bound that does not bind


class Certificate(NamedTuple):
    """What the bracket of the limit load needs to know; all but the last eight only of a strict one.

    Strict: one joint, whose normal forces do not depend on the load (its axes, moments about O).
    """

    every: int  # steps between two looks
    strict: bool
    joint: int
    family: int  # 0 points, 1 areas
    index: int  # in its family
    unit: ndarray  # (3,) V_1, V_2, M_T of the unit load
    dead: ndarray  # (3,) V_1, V_2, M_T of the dead load
    dead_gauge: float  # upper bound of the gauge of the dead load
    centre: ndarray  # (2,) centre of pressure
    radius: float  # m, torsion strength over V_0
    normal: float  # N, before the jacks push
    rest: ndarray  # (c,) N, of the contact points before the jacks push
    tilts: bool  # the load moves the pressure: a block that it pushes too fast rocks
    tolerance: float
    bracket: ndarray  # (2,) bounds of V, in and out
    elastic: float  # N/m, elastic stiffness of V against the driven displacement
    doubling: ndarray  # (4,) driven displacement (m) when it had last doubled and least V (N) since; the same before
    twist: ndarray  # (3,) m, m, rad: slip that gave the upper bound, where strict
    window: ndarray  # (w, 4) lower, upper, V, driven displacement of the last w instants, where not strict


@jit
def dissipation(points, areas, family, index, normals, normal, q1, q2, q3):
    """D(q) of one joint with given normal forces: ``normals`` of the contact points, ``normal`` of an area."""
    if points is not None:
        if family == 0:
            return point_dissipation(points, index, normals, q1, q2, q3)
    if areas is not None:
        if family == 1:
            return area_dissipation(areas, index, normal, q1, q2, q3)
    return 0.0


@jit
def upper_bound(certificate, points, areas, q1, q2, q3):
    """(D(q) - g0.q) / (f.q) for the slip twist q: no limit load is greater. Without bound where f.q <= 0."""
    f = certificate.unit
    g = certificate.dead
    power = f[0] * q1 + f[1] * q2 + f[2] * q3
    if power <= 0.0:
        return NEVER
    lost = dissipation(
        points, areas, certificate.family, certificate.index, certificate.rest, certificate.normal, q1, q2, q3
    )
    return (lost - (g[0] * q1 + g[1] * q2 + g[2] * q3)) / power


@jit
def best_bound(certificate, points, areas, q):
    """The upper bound for the slip twist q (3,), which is kept if it is the least so far."""
    upper = upper_bound(certificate, points, areas, q[0], q[1], q[2])
    if upper < certificate.bracket[1]:
        for i in range(3):
            certificate.twist[i] = q[i]
    return upper


@jit
def carried_share(points, p, rest):
    """The part of the forces of now that fits under the normal forces ``rest`` of before the jacks pushed."""
    share = 1.0
    for i in range(points.start[p], points.start[p + 1]):
        if points.normal[i] * share > rest[i]:
            share = rest[i] / points.normal[i]
    return share


@jit
def pressure_moved(pressed, certificate, now, reach):
    """Whether the friction of a convex joint follows a pressure that is not the one before the jacks pushed."""
    if pressed is not None:
        most = SAME * certificate.normal
        return pressed.kind[certificate.index] != 0 and (
            abs(now[0] - certificate.normal) > most
            or abs(now[5] - now[0] * certificate.centre[0]) > most * reach
            or abs(now[4] + now[0] * certificate.centre[1]) > most * reach
        )
    return False


@jit
def strict_bounds(certificate, joints, points, areas, v):
    """Lower and upper bound of the limit load from the forces and the slip of this instant.

    The joint carries t, inside its limit set; the load asks for V f + g0 = t + r. The gauge of r is bounded by
    |r_V|/V_0 + |r_M|/M_T0, about the centre of pressure; then V (1 - gamma0)/(1 - gamma0 + gauge(r)) is carried
    safely.
    """
    j = certificate.joint
    f = certificate.unit
    g = certificate.dead
    now = joints.resultant[j]
    if areas is not None:
        if certificate.family == 1:
            if pressure_moved(areas.pressed, certificate, now, areas.reach[certificate.index]):
                return 0.0, NEVER
    mu = 0.0
    if points is not None:
        if certificate.family == 0:
            mu = points.friction[certificate.index]
    if areas is not None:
        if certificate.family == 1:
            mu = areas.friction[certificate.index]
    # a block that bounces carries more for a moment: what it may carry at rest is a part of that
    share = certificate.normal / now[0] if now[0] > certificate.normal else 1.0
    if points is not None:
        if certificate.family == 0:
            share = carried_share(points, certificate.index, certificate.rest)
    r1 = v * f[0] + g[0] - share * now[1]
    r2 = v * f[1] + g[1] - share * now[2]
    rm = v * f[2] + g[2] - share * now[3] - (certificate.centre[0] * r2 - certificate.centre[1] * r1)
    lower = 0.0
    if v > 0.0:
        gauge = (sqrt(r1 * r1 + r2 * r2) + abs(rm) / certificate.radius) / (mu * certificate.normal)
        margin = 1.0 - certificate.dead_gauge
        lower = v * margin / (margin + gauge)
    upper = NEVER
    if points is not None:
        if certificate.family == 0:
            upper = best_bound(certificate, points, areas, joints.step[j])
    if areas is not None:
        if certificate.family == 1:
            # the plastic part of the twist: its bound closes to rounding
            upper = best_bound(certificate, points, areas, areas.twist[certificate.index])
    return lower, upper


@jit
def shear_power(joints, j):
    """t.q of joint ``j`` for the slip twist of the last step."""
    now = joints.resultant[j]
    q = joints.step[j]
    return now[1] * q[0] + now[2] * q[1] + now[3] * q[2]


@jit
def instant_bounds(blocks, joints, points, areas, v, moved, dt):
    """The same two bounds with the normal forces of this instant, for any number of blocks: an indicator.

    Upper: V + (excess dissipation - power of the out-of-balance) / f.q for the motion of the last step, ``moved`` the
    f.q of it. Lower: V / (1 + out-of-balance over joint forces).
    """
    upper = NEVER
    if moved > 0.0:
        excess = 0.0
        if points is not None:
            for p in range(points.joint.size):
                j = points.joint[p]
                q = joints.step[j]
                excess += point_dissipation(points, p, points.normal, q[0], q[1], q[2]) - shear_power(joints, j)
        if areas is not None:
            for a in range(areas.joint.size):
                j = areas.joint[a]
                q = joints.step[j]
                n = joints.resultant[j, 0]
                excess += area_dissipation(areas, a, n, q[0], q[1], q[2]) - shear_power(joints, j)
        for f in range(blocks.free.size):
            b = blocks.free[f]
            for i in range(3):
                excess -= dt * (blocks.force[b, i] * blocks.velocity[b, i] + blocks.torque[b, i] * blocks.spin[b, i])
        upper = v + excess / moved
    lower = v / (1.0 + unbalanced_ratio(blocks, joints))
    return min(lower, upper), max(upper, lower)


@jit
def judge(certificate, step, lower, upper, v, driven):
    """Fold the bounds of this instant into the bracket; True when it and the jacks' V are within tolerance.

    An indicator must hold still over its window while the load moves on: a load that still stores energy, however
    slowly it grows, has reached no limit. What it gained since the motion had half its length, at least, tells how much
    is still missing where a contact shrinks for ever (a convex joint that rocks); the upper bound is raised by that.
    """
    bracket = certificate.bracket
    limit = True
    if certificate.strict:
        bracket[0] = max(bracket[0], lower)
        bracket[1] = min(bracket[1], upper)
    else:
        window = certificate.window
        n = window.shape[0]
        now = step % n
        moved = driven - window[now, 3]
        limit = moved > 0.0 and v - window[now, 2] <= STILL * certificate.elastic * moved
        window[now, 0] = lower
        window[now, 1] = upper
        window[now, 2] = v
        window[now, 3] = driven
        bracket[0] = window[0, 0]
        bracket[1] = window[0, 1]
        for i in range(1, n):
            bracket[0] = min(bracket[0], window[i, 0])
            bracket[1] = max(bracket[1], window[i, 1])
        mark = certificate.doubling
        if driven >= 2.0 * mark[0] and driven > 0.0:
            mark[2] = mark[0]
            mark[3] = mark[1]
            mark[0] = driven
            mark[1] = v
        mark[1] = min(mark[1], v)
        bracket[1] += MISSING * max(v - mark[3], 0.0)
    width = 2.0 * certificate.tolerance * bracket[0]
    close = bracket[1] - bracket[0] <= width and abs(2.0 * v - bracket[0] - bracket[1]) <= width
    return limit and close and width > 0.0
