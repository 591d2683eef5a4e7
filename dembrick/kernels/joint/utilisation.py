"""Utilisation of joints: how much of its limit set a recorded force uses, for many joints in many frames.

The gauge of a tangential force f = (f1, f2, m) is the least g for which f lies in g times the set of forces that the
joint can carry. It is the greatest f.q / D(q) over slip twists q, D the dissipation, so every twist gives a lower
bound. The D of a convex joint is smooth (see `limit_surface.gauge`). Coulomb friction at points has kinks, where the
joint turns about one of its points and that point sticks; whether the optimum is at a kink is checked exactly.
"""

from math import inf, sqrt
from typing import NamedTuple

from numpy import ndarray

from dembrick._jit import jit
from dembrick.kernels.joint.geometry import Polygon
from dembrick.kernels.joint.limit_surface import LimitSurface, gauge
from dembrick.kernels.joint.pressure import follow_pressure
from dembrick.kernels.math.vectors import cross, put_vector, tangent

MAX_NEWTON = 30
# Half the Newton decrement over D at convergence.
TOLERANCE = 1e-13
# Smoothings of the kinks, by 0.1, 0.01 ... of the speed, if the sharp problem is not solved at once: to 1e-10 of D.
LEVELS = 10
# Up to this many points all kinks are checked first, at a cost of the square of their number.
FEW = 8
# Moment about the only point that carries, over force times distance, below which it counts as zero: in normal forces
# computed from recorded motion, the last millionth of the force of a joint may have acted through another point.
NO_MOMENT = 1e-4


class FrictionPoints(NamedTuple):
    """The points ``first`` to ``last`` - 1, whose shear forces are limited by ``weight`` (N)."""

    x: ndarray  # (c,) m
    y: ndarray  # (c,) m
    weight: ndarray  # (c,) N
    first: int
    last: int


class Outlines(NamedTuple):
    """Polygons of convex joints: number i has the vertices ``start[i]:start[i + 1]`` of ``x``, ``y``."""

    x: ndarray  # (v,) m about O, counter-clockwise
    y: ndarray  # (v,) m
    start: ndarray  # (i + 1,) int64
    area: ndarray  # (i,) m2
    reach: ndarray  # (i,) m, greatest vertex distance from O
    far: ndarray  # (i, 42) coefficients of `limit_surface.far_field`


@jit
def point_dissipation(points, v1, v2, w, smoothing):
    """D, its gradient (3) and second derivatives (6: 11, 12, 22, 13, 23, 33) of Coulomb friction at points.

    ``smoothing`` is a speed that rounds off the kinks: sqrt(speed^2 + smoothing^2) replaces the speed.
    """
    d = g1 = g2 = g3 = h11 = h12 = h22 = h13 = h23 = h33 = 0.0
    ss = smoothing * smoothing
    weight = points.weight
    for i in range(points.first, points.last):
        px = points.x[i]
        py = points.y[i]
        u1 = v1 - w * py
        u2 = v2 + w * px
        speed = sqrt(u1 * u1 + u2 * u2 + ss)
        if weight[i] > 0.0 and speed > 0.0:
            slow = weight[i] / speed
            d += weight[i] * speed
            g1 += slow * u1
            g2 += slow * u2
            g3 += slow * (px * u2 - py * u1)
            k = slow / (speed * speed)
            a11 = k * (u2 * u2 + ss)
            a12 = -k * u1 * u2
            a22 = k * (u1 * u1 + ss)
            h11 += a11
            h12 += a12
            h22 += a22
            h13 += px * a12 - py * a11
            h23 += px * a22 - py * a12
            h33 += py * py * a11 - 2.0 * px * py * a12 + px * px * a22
    return d, g1, g2, g3, h11, h12, h22, h13, h23, h33


@jit
def best_kink(points, f1, f2, m):
    """Greatest lower bound of the gauge by turning about one of the points, the point, and whether the bound is the
    gauge."""
    x = points.x
    y = points.y
    weight = points.weight
    first = points.first
    last = points.last
    best = 0.0
    where = first
    for i in range(first, last):
        if weight[i] > 0.0:
            power = m + f1 * y[i] - f2 * x[i]
            d = g1 = g2 = own = 0.0
            for k in range(first, last):
                if weight[k] > 0.0:
                    dx = x[k] - x[i]
                    dy = y[k] - y[i]
                    r = sqrt(dx * dx + dy * dy)
                    if r > 0.0:
                        d += weight[k] * r
                        g1 -= weight[k] * dy / r
                        g2 += weight[k] * dx / r
                    else:
                        own += weight[k]
            force = sqrt(f1 * f1 + f2 * f2)
            if d == 0.0:
                if abs(power) > NO_MOMENT * (force * sqrt(x[i] * x[i] + y[i] * y[i]) + abs(m)):
                    return inf, i, True
                return force / own, i, True
            size = abs(power) / d
            if power < 0.0:
                g1 = -g1
                g2 = -g2
            # the force that the friction of the other points leaves to point i
            r1 = f1 - size * g1
            r2 = f2 - size * g2
            if sqrt(r1 * r1 + r2 * r2) <= size * own * (1.0 + 1e-12):
                return size, i, True
            if size > best:
                best = size
                where = i
    return best, where, False


@jit
def plane_step(points, e, reach, z1, z2, b, smoothing):
    """D at the twist e + z1 b1 + z2 b2 (torsion times ``reach``), its gradient (2) and Hessian (3) in z."""
    q1 = e[0] + z1 * b[0] + z2 * b[3]
    q2 = e[1] + z1 * b[1] + z2 * b[4]
    q3 = e[2] + z1 * b[2] + z2 * b[5]
    d, g1, g2, g3, h11, h12, h22, h13, h23, h33 = point_dissipation(points, q1, q2, q3 / reach, smoothing)
    g3 /= reach
    h13 /= reach
    h23 /= reach
    h33 /= reach * reach
    c1 = h11 * b[0] + h12 * b[1] + h13 * b[2]
    c2 = h12 * b[0] + h22 * b[1] + h23 * b[2]
    c3 = h13 * b[0] + h23 * b[1] + h33 * b[2]
    k11 = c1 * b[0] + c2 * b[1] + c3 * b[2]
    k12 = c1 * b[3] + c2 * b[4] + c3 * b[5]
    c1 = h11 * b[3] + h12 * b[4] + h13 * b[5]
    c2 = h12 * b[3] + h22 * b[4] + h23 * b[5]
    c3 = h13 * b[3] + h23 * b[4] + h33 * b[5]
    k22 = c1 * b[3] + c2 * b[4] + c3 * b[5]
    return d, g1 * b[0] + g2 * b[1] + g3 * b[2], g1 * b[3] + g2 * b[4] + g3 * b[5], k11, k12, k22


@jit
def minimum(points, e, reach, z1, z2, b, smoothing, tolerance):
    """Least D on the plane of twists of unit power, by guarded Newton from (z1, z2); z1, z2, D, whether converged.

    It has converged when the Newton decrement, twice the expected gain, is below ``tolerance`` D.
    """
    d, g1, g2, h11, h12, h22 = plane_step(points, e, reach, z1, z2, b, smoothing)
    for _ in range(MAX_NEWTON):
        ridge = 1e-15 * (h11 + h22)
        a = h11 + ridge
        c = h22 + ridge
        det = a * c - h12 * h12
        if not det > 1e-15 * a * c:
            det = 1e-15 * a * c
            if det <= 0.0:
                return z1, z2, d, False
        p1 = -(c * g1 - h12 * g2) / det
        p2 = -(a * g2 - h12 * g1) / det
        decrement = -(p1 * g1 + p2 * g2)
        if decrement <= tolerance * d:
            return z1, z2, d, True
        step = 1.0
        moved = False
        for _ in range(40):
            t, b1, b2, k11, k12, k22 = plane_step(points, e, reach, z1 + step * p1, z2 + step * p2, b, smoothing)
            if t < d - 1e-4 * step * decrement:
                moved = True
                break
            step *= 0.5
        if not moved:
            return z1, z2, d, False
        z1 += step * p1
        z2 += step * p2
        d, g1, g2, h11, h12, h22 = t, b1, b2, k11, k12, k22
    return z1, z2, d, False


@jit
def point_gauge(points, f1, f2, m, q, basis):
    """Gauge of (f1, f2, m) in the limit set of `FrictionPoints`.

    Minimises D over the twists of unit power, a convex problem in two unknowns. If a kink proves to be the optimum,
    that is the result; else Newton's method starts from the twist ``q`` (3,), which is replaced; if it fails, close to
    a kink, it is repeated with a smoothed D. ``basis`` (6,) is scratch.
    """
    if f1 == 0.0 and f2 == 0.0 and m == 0.0:
        return 0.0
    best = 0.0
    x = points.x
    y = points.y
    few = points.last - points.first <= FEW
    if few:
        best, i, optimal = best_kink(points, f1, f2, m)
        if optimal:
            return best
    reach = 0.0
    for i in range(points.first, points.last):
        reach = max(reach, x[i] * x[i] + y[i] * y[i])
    reach = sqrt(reach)
    size = sqrt(f1 * f1 + f2 * f2 + m * m / (reach * reach))
    e1 = f1 / size
    e2 = f2 / size
    e3 = m / (reach * size)
    e = (e1, e2, e3)
    b1, b2, b3 = tangent(e1, e2, e3)  # two directions across the load
    put_vector(basis, b1, b2, b3)
    put_vector(basis[3:], *cross(e1, e2, e3, b1, b2, b3))
    z1 = z2 = 0.0
    power = e1 * q[0] + e2 * q[1] + e3 * q[2] * reach
    if power > 1e-3 * sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] * reach * reach):
        z1 = (basis[0] * q[0] + basis[1] * q[1] + basis[2] * q[2] * reach) / power
        z2 = (basis[3] * q[0] + basis[4] * q[1] + basis[5] * q[2] * reach) / power
    z1, z2, d, converged = minimum(points, e, reach, z1, z2, basis, 0.0, TOLERANCE)
    best = max(best, size / d)
    if not converged:
        if not few:
            kink, i, optimal = best_kink(points, f1, f2, m)
            if optimal:
                return kink
            best = max(best, kink)
        z1 = z2 = 0.0
        smoothing = 1.0
        for _ in range(LEVELS):
            smoothing *= 0.1
            z1, z2, d, converged = minimum(points, e, reach, z1, z2, basis, smoothing, TOLERANCE)
            sharp = plane_step(points, e, reach, z1, z2, basis, 0.0)[0]
            best = max(best, size / sharp)
    q[0] = e1 + z1 * basis[0] + z2 * basis[3]
    q[1] = e2 + z1 * basis[1] + z2 * basis[4]
    q[2] = (e3 + z1 * basis[2] + z2 * basis[5]) / reach
    return best


@jit
def point_gauges(x, y, start, joint, friction, normal, force, twist, basis, gauge_out):
    """Utilisation of the joints ``joint`` (p,) in every frame; joint p has the points from ``start[p]`` on, ``start``
    (p + 1,).

    ``normal`` (f, c) N, ``force`` (f, j, 3), ``twist`` (p, 3) memory from frame to frame, ``basis`` (6,) scratch,
    ``gauge_out`` (f, j).
    """
    for k in range(force.shape[0]):
        for p in range(joint.size):
            j = joint[p]
            mu = friction[j]
            f1 = force[k, j, 0]
            f2 = force[k, j, 1]
            m = force[k, j, 2]
            total = 0.0
            for i in range(start[p], start[p + 1]):
                total += normal[k, i]
            if f1 == 0.0 and f2 == 0.0 and m == 0.0:
                gauge_out[k, j] = 0.0
            elif mu <= 0.0 or total <= 0.0:
                gauge_out[k, j] = inf
            else:
                points = FrictionPoints(x, y, normal[k], start[p], start[p + 1])
                gauge_out[k, j] = point_gauge(points, f1 / mu, f2 / mu, m / mu, twist[p], basis)


@jit
def area_gauges(outlines, shape, joint, pressed, bending, strength, force, twist, gauge_out):
    """Utilisation of the convex joints ``joint`` (a,), of the polygons ``shape`` (a,) of `Outlines`, in every frame.

    ``strength`` (f, j) N is V_0, ``force`` (f, j, 3), ``twist`` (a, 3) memory, ``gauge_out`` (f, j). If friction
    follows the bending, ``pressed`` (else None) is room for the pressed parts, and ``bending`` (f, j, 6) holds N, M_1,
    M_2 and the opening dn, r1, r2.
    """
    for k in range(force.shape[0]):
        for a in range(joint.size):
            j = joint[a]
            i = shape[a]
            strong = strength[k, j]
            if force[k, j, 0] == 0.0 and force[k, j, 1] == 0.0 and force[k, j, 2] == 0.0:
                gauge_out[k, j] = 0.0
            elif strong <= 0.0:
                gauge_out[k, j] = inf
            else:
                start = outlines.start
                reach = outlines.reach[i]
                polygon = Polygon(outlines.x, outlines.y, start[i], start[i + 1], outlines.area[i], None, reach)
                if pressed is not None:
                    b = bending[k, j]
                    follow_pressure(pressed, a, polygon, (b[0], b[2], -b[1]), (-b[3], b[5], -b[4]))
                limit = LimitSurface(polygon, outlines.far[i], reach, 0.0, pressed, a)
                f = force[k, j]
                q = twist[a]
                g, (q1, q2, q3) = gauge(limit, (f[0] / strong, f[1] / strong, f[2] / strong), (q[0], q[1], q[2]))
                gauge_out[k, j] = g
                put_vector(twist[a], q1, q2, q3)
