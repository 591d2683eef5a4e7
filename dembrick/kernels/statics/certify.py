"""Whether the bracket of one joint between a fixed and a free block is strict, and what it is formed with.

One kernel for a scene of its own and for the scenes of a batch: it reads the seated state, before the jacks push.
"""

from math import sqrt
from typing import NamedTuple

from numpy import ndarray

from dembrick._jit import entry, jit
from dembrick.kernels.joint.limit_surface import gauge
from dembrick.kernels.math.vec3 import cross, rows_times

NONE = 1e-12  # of the load: a component that is rounding
NEVER_OVER = 1e300  # N, of a block that no load of this direction turns over


class Basis(NamedTuple):
    """What `certify` finds; see ``load_bounds.Certificate``."""

    unit: ndarray  # (3,) V_1, V_2, M_T of the unit load about O
    dead: ndarray  # (3,) likewise of the dead load
    centre: ndarray  # (2,) m, centre of pressure where friction follows the pressure, else O
    rest: ndarray  # (c,) N, of the contact points
    scalars: ndarray  # (5,) strict (1 or 0), gauge of the dead load, torsion radius (m), N, tilts (1 or 0)


@jit
def at_joint(joints, j, w, out):
    """Force and moment w (6,) at the centroid of b, as V_1, V_2, V_n, M_1, M_2, M_T about O in the joint's axes."""
    axes = joints.axes[j]
    arm = joints.arm_b[j]
    out[0], out[1], out[2] = rows_times(axes, w[0], w[1], w[2])
    c1, c2, c3 = cross(arm[0], arm[1], arm[2], w[0], w[1], w[2])
    out[3], out[4], out[5] = rows_times(axes, w[3] - c1, w[4] - c2, w[5] - c3)


@jit
def median_distance(x, y, weights, first, last):
    """Least weighted mean distance of points from any centre: M_T0 / V_0 of a joint that acts at points.

    The geometric median by Weiszfeld's iteration, kept off the points as Vardi and Zhang do it; the value returned
    belongs to a centre, so it is never below the minimum, and above it by rounding only.
    """
    total = c1 = c2 = 0.0
    for i in range(first, last):
        total += weights[i]
        c1 += weights[i] * x[i]
        c2 += weights[i] * y[i]
    c1 /= total
    c2 /= total
    best = 1e300
    for _ in range(10_000):
        value = 0.0
        for i in range(first, last):
            value += weights[i] * sqrt((x[i] - c1) ** 2 + (y[i] - c2) ** 2)
        value /= total
        if value >= best * (1.0 - 1e-15):
            return min(best, value)
        best = value
        pull = m1 = m2 = own = 0.0
        for i in range(first, last):
            distance = sqrt((x[i] - c1) ** 2 + (y[i] - c2) ** 2)
            share = weights[i] / total
            if distance <= 1e-14 * value:
                own += share
            else:
                pull += share / distance
                m1 += share / distance * x[i]
                m2 += share / distance * y[i]
        t1 = m1 / pull - c1
        t2 = m2 / pull - c2
        rest = pull * sqrt(t1 * t1 + t2 * t2)
        if rest <= own:
            return value
        c1 += (1.0 - own / rest) * t1
        c2 += (1.0 - own / rest) * t2
    return best


@jit
def overturning_load(areas, resultant, normal, unit):
    """V at which the centre of pressure of a convex joint reaches the edge of its polygon."""
    e1 = resultant[5] / normal
    e2 = -resultant[4] / normal
    d1 = unit[4] / normal
    d2 = -unit[3] / normal
    least = NEVER_OVER
    last = areas.start[1]
    xa = areas.x[last - 1]
    ya = areas.y[last - 1]
    for i in range(areas.start[0], last):
        out_1 = areas.y[i] - ya
        out_2 = xa - areas.x[i]
        speed = out_1 * d1 + out_2 * d2
        if speed > 0.0:
            least = min(least, ((xa - e1) * out_1 + (ya - e2) * out_2) / speed)
        xa = areas.x[i]
        ya = areas.y[i]
    return least


@jit
def area_gauge(areas, f1, f2, m):
    """Gauge of a tangential force over V_0 in the limit set of the one convex joint, as it is pressed now."""
    return gauge(
        areas.x, areas.y, areas.start[0], areas.start[1], areas.area[0], areas.reach[0], areas.far[0], areas.pressed, 0,
        f1, f2, m, 0.0, 0.0, 0.0, 0.0,
    )[0]  # fmt: skip


@jit
def pressure_centre(pressed, areas, basis):
    """Centre of pressure and torsion radius where friction follows the bending; False where it does not."""
    if pressed is not None:
        if pressed.kind[0] != 0:
            basis.centre[0] = pressed.centre[0, 0]
            basis.centre[1] = pressed.centre[0, 1]
            basis.scalars[2] = 1.0 / area_gauge(areas, 0.0, 0.0, 1.0)
            return True
    return False


@entry
def certify(joints, points, areas, unit, dead, basis):
    """Fill ``basis`` for joint 0, the only one of its scene, from the seated state.

    ``unit`` and ``dead`` (6,) are the wrenches of the unit load and of the dead load on b about O (`at_joint`). Strict
    where the friction of the joint does not depend on the load: where it follows the pressure, while the load neither
    presses nor tilts; under the full pressure of a convex joint while it does not press, and slides before it could
    overturn. A load ``tilts`` that moves the pressure, whatever friction makes of it.
    """
    resultant = joints.resultant[0]
    normal = resultant[0]
    basis.centre[0] = 0.0
    basis.centre[1] = 0.0
    mu = reach = 0.0
    follows = False
    if points is not None:
        first = points.start[0]
        last = points.start[1]
        mu = points.friction[0]
        follows = True
        total = 0.0
        for i in range(first, last):
            basis.rest[i] = points.normal[i]
            total += points.normal[i]
            basis.centre[0] += points.normal[i] * points.x_s[i]
            basis.centre[1] += points.normal[i] * points.y_s[i]
            reach = max(reach, points.x_s[i] ** 2 + points.y_s[i] ** 2)
        reach = sqrt(reach)
        basis.centre[0] /= total
        basis.centre[1] /= total
        basis.scalars[2] = median_distance(points.x_s, points.y_s, points.normal, first, last)
    if areas is not None:
        mu = areas.friction[0]
        reach = areas.reach[0]
        basis.scalars[2] = areas.radius[0]
        follows = pressure_centre(areas.pressed, areas, basis)
    size = max(max(abs(unit[0]), abs(unit[1])), abs(unit[5]) / reach)
    strict = abs(unit[2]) <= NONE * size
    tilts = not strict
    if max(abs(unit[3]), abs(unit[4])) > NONE * size * reach:
        tilts = True
        if follows:
            strict = False
        if areas is not None:
            if not follows:
                # translation bounds what friction can carry: strict if the block cannot overturn before that
                most = mu * normal + sqrt(dead[0] * dead[0] + dead[1] * dead[1])
                shear = sqrt(unit[0] * unit[0] + unit[1] * unit[1])
                strict = strict and most <= shear * overturning_load(areas, resultant, normal, unit)
    # rounding of the geometry must not tilt the load
    basis.unit[0] = unit[0] if abs(unit[0]) > NONE * size else 0.0
    basis.unit[1] = unit[1] if abs(unit[1]) > NONE * size else 0.0
    basis.unit[2] = unit[5] if abs(unit[5]) > NONE * size * reach else 0.0
    basis.dead[0] = dead[0]
    basis.dead[1] = dead[1]
    basis.dead[2] = dead[5]
    # gauge of the dead load in the limit set: exact for an area; the largest utilisation of a point bounds it, because
    # the seated forces are one way to carry the load
    taken = 0.0
    if mu > 0.0 and (dead[0] != 0.0 or dead[1] != 0.0 or dead[5] != 0.0):
        if points is not None:
            for i in range(points.start[0], points.start[1]):
                if points.normal[i] > 0.0:
                    force = sqrt(points.elastic_1[i] ** 2 + points.elastic_2[i] ** 2)
                    taken = max(taken, force / (mu * points.normal[i]))
        if areas is not None:
            strength = mu * normal
            taken = area_gauge(areas, dead[0] / strength, dead[1] / strength, dead[5] / strength)
    basis.scalars[0] = 1.0 if strict else 0.0
    basis.scalars[1] = taken
    basis.scalars[3] = normal
    basis.scalars[4] = 1.0 if tilts else 0.0
