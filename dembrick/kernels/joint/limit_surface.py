"""The exact torsion-shear limit surface of a polygon under uniform pressure, and the proximal map on it.

For a slip twist q = (v1, v2, w) of the joint the dissipation per unit shear strength V_0 is

    D(q) = 1/A * integral of |v + w x r| dA,

convex and homogeneous of degree one. Its gradient is the point of the limit surface whose normal is q (eq. 5 of the
paper), and everything follows from it: the return mapping of a trial force f minimises q.Kq/2 - f.q + V_0 D(q).

The slip is a rotation about the torsion centre C = (-v2, v1)/w, so D = |w| F(C)/A with F(C) the integral of the
distance from C. By the divergence theorem F and its derivatives are sums over the edges of two integrals,

    E = integral of r ds = (s r + h^2 L)/2,      L = integral of ds/r = ln((s2 + r2)/(s1 + r1)),

with h the distance of the edge from C and s measured along it. For C far from the polygon these sums lose digits and
are replaced by the series about pure translation (`far_field`). Vertices run counter-clockwise about the centroid O.
"""

from math import sqrt
from typing import NamedTuple

from numpy import ndarray

from dembrick._jit import jit
from dembrick.kernels.joint.geometry import Polygon
from dembrick.kernels.joint.pressure import FULL, Pressed, edge_logarithm, pressed_surface

# Beyond this many half diameters the edge sums are less accurate than the series to order eight.
FAR = 25.0
# The proximal map stops when the out-of-balance gradient is this fraction of V_0.
PROXIMAL_TOLERANCE = 1e-13
MAX_NEWTON = 60
# A Newton decrement below this part of the squared gauge changes no digit of it.
LOST = 1e-18
# A Newton decrement below this many tolerances, relative to phi, is lost in the rounding of phi.
RESOLVED = 100.0


class LimitSurface(NamedTuple):
    """Quantities that define the limit surface of a convex joint or of a new contact."""

    polygon: Polygon | None  # None for a new contact, which ``pressed`` defines alone
    far: ndarray | None  # (42,) coefficients of `far_field`, None for a new contact
    reach: float  # m, greatest distance of a corner from O
    radius: float  # m, no more than the torsion strength over V_0
    pressed: Pressed | None  # where friction follows the pressure, else None
    index: int  # of the joint in ``pressed``


@jit
def edge_sums(polygon, c1, c2):
    """Integrals over a `Polygon` of the distance from C = (c1, c2).

    Returns F = integral of r, B = integral of r/|r| (2 values) and T = integral of (I - rr/r^2)/r (3 values: 11,
    12, 22).
    """
    x = polygon.x
    y = polygon.y
    first = polygon.first
    last = polygon.last
    f = b1 = b2 = t11 = t12 = t22 = 0.0
    xa = x[last - 1] - c1
    ya = y[last - 1] - c2
    ra = sqrt(xa * xa + ya * ya)
    for i in range(first, last):
        xb = x[i] - c1
        yb = y[i] - c2
        rb = sqrt(xb * xb + yb * yb)
        dx = xb - xa
        dy = yb - ya
        length = sqrt(dx * dx + dy * dy)
        ex = dx / length
        ey = dy / length
        h = xa * ey - ya * ex
        sa = xa * ex + ya * ey
        sb = sa + length
        hl = edge_logarithm(h, sa, sb, ra, rb)
        e = 0.5 * (sb * rb - sa * ra + h * hl)
        f += h * e
        b1 += ey * e
        b2 -= ex * e
        # integral of r/|r| along the edge, times its outward normal (ey, -ex)
        dr = rb - ra
        u1 = ex * dr + ey * hl
        u2 = ey * dr - ex * hl
        t11 += u1 * ey
        t12 -= u1 * ex
        t22 -= u2 * ex
        xa = xb
        ya = yb
        ra = rb
    return f / 3.0, b1, b2, t11, t12, t22


@jit
def far_field(moments, v1, v2, w):
    """D, its gradient and second derivatives by the series about pure translation, to eighth order in w r / |v|.

    ``moments`` (42,) holds the coefficients of the forms J_2 ... J_8 (see ``friction_integrals.far_moments``):
    D = |v| + sum over n of w^n J_n(v1, v2) |v|^(1 - 2n), J_n a form of degree n in v.
    Returns D, V1, V2, M, H11, H12, H22, H13, H23, H33.
    """
    vv = v1 * v1 + v2 * v2
    v = sqrt(vv)
    d = v
    g1 = v1 / v
    g2 = v2 / v
    g3 = 0.0
    h11 = v2 * v2 / (v * vv)
    h12 = -v1 * v2 / (v * vv)
    h22 = v1 * v1 / (v * vv)
    h13 = h23 = h33 = 0.0
    k = 0
    for n in range(2, 9):
        # the form J = sum over i of c_i v1^(n-i) v2^i with its derivatives
        j = j1 = j2 = j11 = j12 = j22 = 0.0
        for i in range(n + 1):
            c = moments[k]
            k += 1
            a = n - i
            j += c * v1**a * v2**i
            if a > 0:
                j1 += c * a * v1 ** (a - 1) * v2**i
            if i > 0:
                j2 += c * i * v1**a * v2 ** (i - 1)
            if a > 1:
                j11 += c * a * (a - 1) * v1 ** (a - 2) * v2**i
            if i > 1:
                j22 += c * i * (i - 1) * v1**a * v2 ** (i - 2)
            if a > 0 and i > 0:
                j12 += c * a * i * v1 ** (a - 1) * v2 ** (i - 1)
        p = 1.0 - 2.0 * n
        power = v**p
        w2 = w ** (n - 2) * power
        w1 = w * w2
        w0 = w * w1
        x1 = j1 + p * j * v1 / vv
        x2 = j2 + p * j * v2 / vv
        d += w0 * j
        g1 += w0 * x1
        g2 += w0 * x2
        g3 += n * w1 * j
        h11 += w0 * (j11 + 2.0 * p * j1 * v1 / vv + p * j / vv * (1.0 + (p - 2.0) * v1 * v1 / vv))
        h22 += w0 * (j22 + 2.0 * p * j2 * v2 / vv + p * j / vv * (1.0 + (p - 2.0) * v2 * v2 / vv))
        h12 += w0 * (j12 + p * (j1 * v2 + j2 * v1) / vv + p * (p - 2.0) * j * v1 * v2 / (vv * vv))
        h13 += n * w1 * x1
        h23 += n * w1 * x2
        h33 += n * (n - 1) * w2 * j
    return d, g1, g2, g3, h11, h12, h22, h13, h23, h33


@jit
def even_surface(polygon, far, v1, v2, w):
    """`surface` under uniform pressure over the polygon."""
    area = polygon.area
    if sqrt(v1 * v1 + v2 * v2) > FAR * polygon.reach * abs(w):
        # D is homogeneous: at length one the powers of a slip of 1e-20 m (an unloaded joint) do not overflow
        v = sqrt(v1 * v1 + v2 * v2)
        d, g1, g2, g3, h11, h12, h22, h13, h23, h33 = far_field(far, v1 / v, v2 / v, w / v)
        return d * v, g1, g2, g3, h11 / v, h12 / v, h22 / v, h13 / v, h23 / v, h33 / v
    c1 = -v2 / w
    c2 = v1 / w
    f, b1, b2, t11, t12, t22 = edge_sums(polygon, c1, c2)
    sign = 1.0 if w > 0.0 else -1.0
    g1 = -sign * b2 / area
    g2 = sign * b1 / area
    g3 = sign * (f + c1 * b1 + c2 * b2) / area
    # integral of rr/r^3 = (trace T) I - T; the rest of the Hessian follows from H q = 0
    scale = 1.0 / (abs(w) * area)
    h11 = t22 * scale
    h12 = -t12 * scale
    h22 = t11 * scale
    h13 = h11 * -c2 + h12 * c1
    h23 = h12 * -c2 + h22 * c1
    h33 = h13 * -c2 + h23 * c1
    return abs(w) * f / area, g1, g2, g3, h11, h12, h22, h13, h23, h33


@jit
def surface(limit, q1, q2, q3):
    """D(q), its gradient (the limit force per unit V_0) and second derivatives at q = (v1, v2, w) != 0, of a
    `LimitSurface`. Returns the ten values of `far_field`."""
    return surface_by(limit.pressed, limit.polygon, limit, q1, q2, q3)


@jit
def surface_by(pressed, polygon, limit, q1, q2, q3):
    """`surface` with the pressed part, if friction follows the bending, and the polygon, if there is one."""
    d = g1 = g2 = g3 = h11 = h12 = h22 = h13 = h23 = h33 = 0.0
    if pressed is not None:
        if pressed.kind[limit.index] != FULL:
            return pressed_surface(pressed, limit.index, q1, q2, q3)
    if polygon is not None:
        d, g1, g2, g3, h11, h12, h22, h13, h23, h33 = even_surface(polygon, limit.far, q1, q2, q3)
    return d, g1, g2, g3, h11, h12, h22, h13, h23, h33


@jit
def solve_symmetric(h11, h12, h22, h13, h23, h33, r1, r2, r3):
    """Solution of the positive definite 3 x 3 system by LDL^T."""
    l21 = h12 / h11
    l31 = h13 / h11
    d2 = h22 - l21 * h12
    m32 = h23 - l31 * h12
    l32 = m32 / d2
    d3 = h33 - l31 * h13 - l32 * m32
    y2 = r2 - l21 * r1
    y3 = r3 - l31 * r1 - l32 * y2
    z3 = y3 / d3
    z2 = y2 / d2 - l32 * z3
    z1 = r1 / h11 - l21 * z2 - l31 * z3
    return z1, z2, z3


@jit
def chord(pressed, index, radius, f1, f2, m):
    """|V| + |M|/r >= gauge of the force (f1, f2, m) / V_0 by convexity, cheap to evaluate; M is taken about the centre
    of pressure, through which pure shear acts, and ``radius`` r is at most the torsion strength over V_0."""
    if pressed is not None:
        if pressed.kind[index] != FULL:
            m -= pressed.centre[index, 0] * f2 - pressed.centre[index, 1] * f1
            radius = pressed.radius[index]
    return sqrt(f1 * f1 + f2 * f2) + abs(m) / radius


@jit
def gauge(limit, force, start, radius=0.0):
    """Gauge of the ``force`` (3) over V_0 in the limit set: the least g with force in g times the set.

    Minimises D^2/2 - f.q, smooth and convex, with D(q) = gauge(f) at the minimum; ``start`` (3) is the first q. With a
    ``radius``, at most the torsion strength over V_0, it returns as soon as it is known whether the gauge exceeds one:
    a twist proves that it does, or the part on the surface and the chord of the rest sum to less. Returns the gauge and
    q (3).
    """
    f1, f2, m = force
    q1, q2, q3 = start
    reach = limit.reach
    if f1 == 0.0 and f2 == 0.0 and m == 0.0:
        return 0.0, (q1, q2, q3)
    if f1 * q1 + f2 * q2 + m * q3 <= 0.0:
        q1 = f1 * reach * reach
        q2 = f2 * reach * reach
        q3 = m
    d, g1, g2, g3, h11, h12, h22, h13, h23, h33 = surface(limit, q1, q2, q3)
    power = f1 * q1 + f2 * q2 + m * q3
    s = power / (d * d)
    best = power / d
    q1 *= s
    q2 *= s
    q3 *= s
    d *= s
    h11, h12, h22, h13, h23, h33 = h11 / s, h12 / s, h22 / s, h13 / s, h23 / s, h33 / s
    value = -0.5 * d * d
    for _ in range(MAX_NEWTON):
        r1 = f1 - d * g1
        r2 = f2 - d * g2
        r3 = m - d * g3
        if radius > 0.0 and (best > 1.0 or d + chord(limit.pressed, limit.index, radius, r1, r2, r3) <= 1.0):
            break
        if max(abs(r1), abs(r2), abs(r3) / reach) <= 1e-14 * d:
            break
        p1, p2, p3 = solve_symmetric(
            g1 * g1 + d * h11,
            g1 * g2 + d * h12,
            g2 * g2 + d * h22,
            g1 * g3 + d * h13,
            g2 * g3 + d * h23,
            g3 * g3 + d * h33,
            r1,
            r2,
            r3,
        )
        slope = r1 * p1 + r2 * p2 + r3 * p3
        if slope <= LOST * d * d:
            break
        step = 1.0
        moved = False
        for _ in range(40):
            t1 = q1 + step * p1
            t2 = q2 + step * p2
            t3 = q3 + step * p3
            if t1 != 0.0 or t2 != 0.0 or t3 != 0.0:
                dt, a1, a2, a3, k11, k12, k22, k13, k23, k33 = surface(limit, t1, t2, t3)
                power = f1 * t1 + f2 * t2 + m * t3
                trial = 0.5 * dt * dt - power
                if trial <= value - 1e-4 * step * slope + 1e-15 * abs(value):
                    moved = True
                    break
            step *= 0.5
        if not moved:
            break
        q1, q2, q3, d, value = t1, t2, t3, dt, trial
        g1, g2, g3 = a1, a2, a3
        h11, h12, h22, h13, h23, h33 = k11, k12, k22, k13, k23, k33
        best = max(best, power / d)
    return best, (q1, q2, q3)


@jit
def proximal_map(limit, strength, springs, force, start, tolerance=PROXIMAL_TOLERANCE):
    """Return mapping of the trial ``force`` f = (f1, f2, m) to the limit surface, with its plastic twist.

    Minimises phi(q) = q.Kq/2 - f.q + V_0 D(q) with K = diag(k_t, k_t, k_r), ``springs`` (k_t, k_r) and ``strength``
    V_0; ``start`` (3): the last plastic twist; ``tolerance``: gradient of phi over V_0 at which it stops. Returns the
    joint's force (3), exactly on the surface where plastic, the plastic twist (3), the twist to start from next time
    (3), and the number of evaluations of the surface.
    """
    f1, f2, m = force
    q1, q2, q3 = start
    k_t, k_r = springs
    reach = limit.reach
    still = (0.0, 0.0, 0.0)
    if chord(limit.pressed, limit.index, limit.radius, f1, f2, m) <= strength:
        return force, still, start, 0
    if strength <= 0.0:
        return still, (f1 / k_t, f2 / k_t, m / k_r), still, 0
    evaluations = 0
    # along a twist p the best plastic part is s p with s = (f.p - V_0 D(p)) / (p.Kp), if that is positive
    found = False
    if q1 != 0.0 or q2 != 0.0 or q3 != 0.0:
        d, g1, g2, g3, h11, h12, h22, h13, h23, h33 = surface(limit, q1, q2, q3)
        evaluations += 1
        gain = f1 * q1 + f2 * q2 + m * q3 - strength * d
        found = gain > 0.0
    if not found:
        over = f1 / strength, f2 / strength, m / strength
        size, (q1, q2, q3) = gauge(limit, over, (q1, q2, q3), limit.radius)
        evaluations += 4
        if size <= 1.0:
            return force, still, (q1, q2, q3), evaluations
        d, g1, g2, g3, h11, h12, h22, h13, h23, h33 = surface(limit, q1, q2, q3)
        evaluations += 1
        gain = f1 * q1 + f2 * q2 + m * q3 - strength * d
        if gain <= 0.0:
            return force, still, (q1, q2, q3), evaluations
    s = gain / (k_t * (q1 * q1 + q2 * q2) + k_r * q3 * q3)
    q1 *= s
    q2 *= s
    q3 *= s
    d *= s
    h11, h12, h22, h13, h23, h33 = h11 / s, h12 / s, h22 / s, h13 / s, h23 / s, h33 / s
    value = -0.5 * s * gain
    for _ in range(MAX_NEWTON):
        r1 = f1 - k_t * q1 - strength * g1
        r2 = f2 - k_t * q2 - strength * g2
        r3 = m - k_r * q3 - strength * g3
        if max(abs(r1), abs(r2), abs(r3) / reach) <= tolerance * strength:
            break
        p1, p2, p3 = solve_symmetric(
            k_t + strength * h11,
            strength * h12,
            k_t + strength * h22,
            strength * h13,
            strength * h23,
            k_r + strength * h33,
            r1,
            r2,
            r3,
        )
        slope = r1 * p1 + r2 * p2 + r3 * p3
        step = 1.0
        moved = False
        for _ in range(40):
            t1 = q1 + step * p1
            t2 = q2 + step * p2
            t3 = q3 + step * p3
            if t1 != 0.0 or t2 != 0.0 or t3 != 0.0:
                dt, a1, a2, a3, k11, k12, k22, k13, k23, k33 = surface(limit, t1, t2, t3)
                evaluations += 1
                quadratic = 0.5 * (k_t * (t1 * t1 + t2 * t2) + k_r * t3 * t3)
                trial = quadratic + strength * dt - (f1 * t1 + f2 * t2 + m * t3)
                if slope <= RESOLVED * tolerance * (quadratic + strength * dt):
                    # phi no longer distinguishes the points, its gradient still does
                    size = max(
                        abs(f1 - k_t * t1 - strength * a1),
                        abs(f2 - k_t * t2 - strength * a2),
                        abs(m - k_r * t3 - strength * a3) / reach,
                    )
                    moved = size < 0.9 * max(abs(r1), abs(r2), abs(r3) / reach)
                    break
                if trial <= value - 1e-4 * step * slope:
                    moved = True
                    break
            step *= 0.5
        if not moved:
            break
        q1, q2, q3, d, value = t1, t2, t3, dt, trial
        g1, g2, g3 = a1, a2, a3
        h11, h12, h22, h13, h23, h33 = k11, k12, k22, k13, k23, k33
    return (strength * g1, strength * g2, strength * g3), (q1, q2, q3), (q1, q2, q3), evaluations
