"""The bracket of the limit load, from the forces and the motion of an instant (limit analysis at fixed normal forces).

Upper bound: for any slip twist q with f.q > 0, V <= (D(q) - g0.q) / (f.q). Lower bound: the forces of the joint are
inside its limit set; the out-of-balance reduces the load by its gauge in that set. See ``yield_point``.

`certify` finds from the dead-load equilibrium, before actuators push, whether the bracket of one joint between a fixed
and a free block is strict, and the data to form it: one kernel for a single scene and for those of a batch.
"""

from math import sqrt
from typing import NamedTuple

from numpy import ndarray

from dembrick._jit import entry, jit
from dembrick.kernels.joint.families import FAMILIES, joint_count, joint_of
from dembrick.kernels.math.vectors import cross, put_vector, rows_times
from dembrick.kernels.statics import joint_families as families
from dembrick.kernels.statics.block_forces import unbalanced_ratio

MISSING = 3.0  # further growth of a load that grows as 1 - c/sqrt(u), over its growth in a doubling of the motion
STILL = 0.05  # slope of the load over the elastic stiffness below which it is at its limit
SUDDEN, ROUNDED = 0.1, 1e-9  # parts of the growth over the doubling before, and of V: less shows no decay
MOST_DECAY = 0.95  # greatest ratio of the growths of V over successive doublings of the motion
NEVER = 1e300  # an upper bound that does not bind


class Certificate(NamedTuple):
    """Input of the bracket of the limit load; a strict one alone needs ``joint`` to ``rest``. ``doubling`` and
    ``window`` are those of time loops, and None elsewhere.

    Strict: one joint, whose normal forces do not depend on the load (its axes, moments about O).
    """

    every: int  # steps between two evaluations
    strict: bool
    joint: int
    family: int  # 0 points, 1 areas
    index: int  # in its family
    unit: ndarray  # (3,) V_1, V_2, M_T of the unit load
    dead: ndarray  # (3,) V_1, V_2, M_T of the dead load
    dead_gauge: float  # upper bound of the gauge of the dead load
    centre: ndarray  # (2,) centre of pressure
    radius: float  # m, torsion strength over V_0
    normal: float  # N, before the actuators push
    rest: ndarray  # (c,) N, of the contact points before the actuators push
    tilts: bool  # whether the load moves the pressure: pushed too fast, the block rocks
    tolerance: float
    bracket: ndarray  # (2,) bounds of V, in and out
    elastic: float  # N/m, elastic stiffness of V against the driven displacement
    doubling: ndarray | None  # (6,) driven displacement (m) when it last doubled, extremes of V (N) since; before that
    twist: ndarray  # (3,) m, m, rad: slip that gave the upper bound, where strict
    window: ndarray | None  # (w, 4) lower, upper, V, driven displacement of the last w instants, if not strict


@jit
def upper_bound(certificate, points, areas, q1, q2, q3):
    """(D(q) - g0.q) / (f.q) for the slip twist q, an upper bound of the limit load; `NEVER` if f.q <= 0."""
    f = certificate.unit
    g = certificate.dead
    power = f[0] * q1 + f[1] * q2 + f[2] * q3
    if power <= 0.0:
        return NEVER
    lost = families.dissipation(
        points, areas, certificate.family, certificate.index, certificate.rest, certificate.normal, q1, q2, q3
    )
    return (lost - (g[0] * q1 + g[1] * q2 + g[2] * q3)) / power


@jit
def best_bound(certificate, points, areas, q1, q2, q3):
    """The upper bound for the slip twist q; stores q if the bound is the least so far."""
    upper = upper_bound(certificate, points, areas, q1, q2, q3)
    if upper < certificate.bracket[1]:
        put_vector(certificate.twist, q1, q2, q3)
    return upper


@jit
def strict_bounds(certificate, state, v):
    """Lower and upper bound of the limit load from the present forces and slip.

    The joint carries t, inside its limit set; the load requires V f + g0 = t + r. The gauge of r is bounded by
    |r_V|/V_0 + |r_M|/M_T0, about the centre of pressure; then V (1 - gamma0)/(1 - gamma0 + gauge(r)) is carried safely.
    """
    joints = state.joints
    points = state.points
    areas = state.areas
    j = certificate.joint
    f = certificate.unit
    g = certificate.dead
    now = joints.resultant[j]
    joint = (points, areas, certificate.family, certificate.index)
    if families.pressure_moved(*joint, certificate.centre, certificate.normal, now):
        return 0.0, NEVER
    mu = families.friction_of(*joint)
    share = families.carried_share(*joint, certificate.rest, certificate.normal, now)
    r1 = v * f[0] + g[0] - share * now[1]
    r2 = v * f[1] + g[1] - share * now[2]
    rm = v * f[2] + g[2] - share * now[3] - (certificate.centre[0] * r2 - certificate.centre[1] * r1)
    lower = 0.0
    if v > 0.0:
        gauge = (sqrt(r1 * r1 + r2 * r2) + abs(rm) / certificate.radius) / (mu * certificate.normal)
        margin = 1.0 - certificate.dead_gauge
        lower = v * margin / (margin + gauge)
    upper = best_bound(certificate, points, areas, *families.bound_twist(*joint, joints))
    return lower, upper


@jit
def shear_power(joints, j):
    """t.q of joint ``j`` for the slip twist of the last step."""
    now = joints.resultant[j]
    q = joints.step[j]
    return now[1] * q[0] + now[2] * q[1] + now[3] * q[2]


@jit
def instant_upper(state, v, moved, dt):
    """Upper bound at the present normal forces, for any number of blocks: an indicator.

    V + (excess dissipation - power of the out-of-balance) / f.q for the motion of the last step, ``moved`` its f.q.
    """
    blocks = state.blocks
    joints = state.joints
    points = state.points
    areas = state.areas
    upper = NEVER
    if moved > 0.0:
        excess = 0.0
        for family in range(FAMILIES):
            for i in range(joint_count(points, areas, family)):
                j = joint_of(points, areas, family, i)
                q = joints.step[j]
                n = joints.resultant[j, 0]
                excess += families.dissipation_now(points, areas, family, i, n, q[0], q[1], q[2])
                excess -= shear_power(joints, j)
        for f in range(blocks.free.size):
            b = blocks.free[f]
            for i in range(3):
                excess -= dt * (blocks.force[b, i] * blocks.velocity[b, i] + blocks.torque[b, i] * blocks.spin[b, i])
        upper = v + excess / moved
    return upper


@jit
def instant_bounds(state, v, moved, dt):
    """`instant_upper`; and as lower bound V / (1 + out-of-balance over joint force), or V times that sum if V is
    negative."""
    upper = instant_upper(state, v, moved, dt)
    most = 1.0 + unbalanced_ratio(state.blocks, state.joints)
    lower = v / most if v > 0.0 else v * most
    return min(lower, upper), max(upper, lower)


@jit
def remaining_growth(growth, before):
    """Further growth or fall of V (N), if it grew by ``growth`` over the last doubling of the motion, and by ``before``
    over the one before that: the sum of all future growths, if they continue as a geometric series."""
    decay = 0.0
    if growth * before > 0.0:
        decay = min(MOST_DECAY, growth / before)
    return max(MISSING, decay / (1.0 - decay)) * growth


@jit
def converges(growth, before, hidden, v):
    """Whether V, which grew by ``growth`` (N) over the last doubling of the motion and by ``before`` over the one
    before, converges: it grows by no more than the error ``hidden`` of its equilibria, or less and less. Growth in
    proportion to the motion, however slow, leads to another mechanism, and so may a slope that has just dropped."""
    return growth <= max(hidden, ROUNDED * abs(v)) or SUDDEN * before <= growth <= before


@jit
def update_bracket(certificate, step, lower, upper, v, driven):
    """Update the bracket by the present bounds; True when it and the actuators' V are within tolerance.

    An indicator must be steady over its window while the load moves on: a load that still stores energy, however slowly
    it grows, has reached no limit. Where a contact shrinks for ever (a convex joint that rocks), the growth of V since
    the displacement was at most half the present one tells how much is missing; the upper bound is raised by that.
    Where the normal forces follow the load, V also falls towards its limit, as they drift and slip wipes out the memory
    of the elastic forces; the lower bound is reduced by that fall, which exceeds the rest of such a decay.
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
            for i in range(3):
                mark[3 + i] = mark[i]
            mark[0] = driven
            mark[1] = v
            mark[2] = v
        mark[1] = min(mark[1], v)
        mark[2] = max(mark[2], v)
        bracket[1] += MISSING * max(v - mark[4], 0.0)
        bracket[0] = max(min(0.0, v), bracket[0] - max(mark[5] - v, 0.0))
    width = 2.0 * certificate.tolerance * bracket[0]
    close = bracket[1] - bracket[0] <= width and abs(2.0 * v - bracket[0] - bracket[1]) <= width
    return limit and close and width > 0.0


NONE = 1e-12  # part of the load below which a component is rounding


class Basis(NamedTuple):
    """Result of `certify`; see ``load_bounds.Certificate``."""

    unit: ndarray  # (3,) V_1, V_2, M_T of the unit load about O
    dead: ndarray  # (3,) likewise of the dead load
    centre: ndarray  # (2,) m, centre of pressure where friction follows the pressure, else O
    rest: ndarray  # (c,) N, of the contact points
    scalars: ndarray  # (5,) strict (1 or 0), gauge of the dead load, torsion radius (m), N, tilts (1 or 0)
    twist: ndarray  # (3,) scratch
    across: ndarray  # (6,) scratch


@jit
def at_joint(joints, j, w, out):
    """Force and moment w (6,) at the centroid of b, as V_1, V_2, V_n, M_1, M_2, M_T about O in the joint's axes."""
    axes = joints.axes[j]
    arm = joints.arm_b[j]
    out[0], out[1], out[2] = rows_times(axes, w[0], w[1], w[2])
    c1, c2, c3 = cross(arm[0], arm[1], arm[2], w[0], w[1], w[2])
    out[3], out[4], out[5] = rows_times(axes, w[3] - c1, w[4] - c2, w[5] - c3)


@entry
def certify(joints, points, areas, place, unit, dead, basis):
    """Fill ``basis`` from the dead-load equilibrium for the joint at ``place`` (family, index, number), which lies
    between a free block and a fixed one.

    ``unit`` and ``dead`` (6,) are the wrenches of the unit load and of the dead load on b about O (`at_joint`). The
    bracket is strict if the friction of the joint does not depend on the load: where it follows the pressure, if the
    load neither presses nor tilts; under the full pressure of a convex joint, if it does not press, and the block
    slides before it could overturn. A load ``tilts`` if it moves the pressure, whatever its effect on friction.
    """
    family, index, j = place
    resultant = joints.resultant[j]
    normal = resultant[0]
    basis.centre[0] = 0.0
    basis.centre[1] = 0.0
    mu = families.friction_of(points, areas, family, index)
    reach, follows = families.at_rest(points, areas, family, index, basis)
    size = max(max(abs(unit[0]), abs(unit[1])), abs(unit[5]) / reach)
    strict = abs(unit[2]) <= NONE * size
    tilts = not strict
    if max(abs(unit[3]), abs(unit[4])) > NONE * size * reach:
        tilts = True
        if follows:
            strict = False
        else:
            # translation bounds the load that friction can carry: strict if the block cannot overturn before that
            most = mu * normal + sqrt(dead[0] * dead[0] + dead[1] * dead[1])
            shear = sqrt(unit[0] * unit[0] + unit[1] * unit[1])
            overturning = families.overturning_load(points, areas, family, index, resultant, normal, unit)
            strict = strict and most <= shear * overturning
    # rounding of the geometry must not tilt the load
    basis.unit[0] = unit[0] if abs(unit[0]) > NONE * size else 0.0
    basis.unit[1] = unit[1] if abs(unit[1]) > NONE * size else 0.0
    basis.unit[2] = unit[5] if abs(unit[5]) > NONE * size * reach else 0.0
    put_vector(basis.dead, dead[0], dead[1], dead[5])
    taken = 0.0
    if mu > 0.0 and (dead[0] != 0.0 or dead[1] != 0.0 or dead[5] != 0.0):
        taken = families.dead_gauge(points, areas, family, index, normal, dead, basis)
    basis.scalars[0] = 1.0 if strict else 0.0
    basis.scalars[1] = taken
    basis.scalars[3] = normal
    basis.scalars[4] = 1.0 if tilts else 0.0
