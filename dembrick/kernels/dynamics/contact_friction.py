"""Friction of new contacts: the exact torsion-shear limit surface of the pressure on their patches.

Friction acts in the plane through the centre of pressure c orthogonal to the mean normal e. Of the pressure on a patch
only the part along e counts, p n.e dA: projected on the plane, a patch is again a polygon with a linear pressure, as
``pressure.pressed_surface`` requires. A flat contact is its own projection. Pressure opposite to e is ignored.

Cohesion that a joint keeps after its bond broke (``residual_cohesion``) adds its part of the area to the strength, over
the same limit surface.

A contact along an edge, or at a corner, has a patch too, however small. A patch narrower than `THIN` times its length
is widened to that, so that integrals over it keep their digits; its strength grows by less than 1e-4.
"""

from math import atan2, cos, sin, sqrt

from dembrick._jit import jit
from dembrick.kernels.dynamics.law_memory import in_search
from dembrick.kernels.joint.area_law import area_friction, stretched
from dembrick.kernels.joint.limit_surface import LimitSurface
from dembrick.kernels.math.vectors import cross, put_vector, three_of, turned_back

RIM = 1e-4  # part of the pressure: patches with less are ignored in friction
THIN = 3e-3  # least width over length
SLENDER = 1e-4  # smallest over greatest second moment, below which the width is checked
LOST = 1e-12  # width over length that is lost in rounding
CLOSE = 1e-8  # tolerance of the return mapping, over the strength
BAND = 0.999  # fluctuations of the stiffness by less than a thousandth do not reduce the memory of a contact


@jit
def share_pressure(scratch, patches, e1, e2, e3, size):
    """Pressure of every patch along e, into `sums`; returns their total and the common centre c (3).

    ``size``: length of the integral of p n dA.
    """
    whole = c1 = c2 = c3 = 0.0
    for p in range(patches):
        F = scratch.frame[p]
        sums = scratch.sums[p]
        along = F[2, 0] * e1 + F[2, 1] * e2 + F[2, 2] * e3
        if not along * sums[1] > RIM * size:
            sums[4] = 0.0
            continue
        sums[4] = along * sums[1]
        whole += along * sums[1]
        c1 += along * (sums[1] * F[0, 3] + sums[2] * F[0, 0] + sums[3] * F[1, 0])
        c2 += along * (sums[1] * F[1, 3] + sums[2] * F[0, 1] + sums[3] * F[1, 1])
        c3 += along * (sums[1] * F[2, 3] + sums[2] * F[0, 2] + sums[3] * F[1, 2])
    return whole, c1 / whole, c2 / whole, c3 / whole


@jit
def second_moments(x, y, first, last, p0, px, py):
    """Integrals of p x^2, p x y and p y^2 over a polygon, p = p0 + px x + py y; by triangles from the origin."""
    xx = xy = yy = 0.0
    xa = x[last - 1]
    ya = y[last - 1]
    pa = p0 + px * xa + py * ya
    for k in range(first, last):
        xb = x[k]
        yb = y[k]
        pb = p0 + px * xb + py * yb
        area = (xa * yb - ya * xb) / 60.0
        a = area * (p0 + 3.0 * pa + pb)
        m = area * (p0 + 2.0 * (pa + pb))
        b = area * (p0 + pa + 3.0 * pb)
        xx += a * xa * xa + m * xa * xb + b * xb * xb
        yy += a * ya * ya + m * ya * yb + b * yb * yb
        xy += a * xa * ya + 0.5 * m * (xa * yb + xb * ya) + b * xb * yb
        xa, ya, pa = xb, yb, pb
    return xx, xy, yy


@jit
def flatten(pressed, scratch, patches, whole, centre, e, t):
    """Project the patches on the plane of t and e x t seen from the ``centre``, into ``pressed``, with a total pressure
    of one; returns whether they are wide enough to have a limit surface.

    `radius` is a lower bound of the torsion strength over V_0. About any C, at the distance d from c, the mean distance
    of the pressure is at least its mean square over the greatest one,

        (s^2 + d^2) / (R + d) >= 2 (sqrt(R^2 + s^2) - R),

    with s^2 the mean square about c, R the reach, and the right side the minimum over d.
    """
    c1, c2, c3 = centre
    t1, t2, t3 = t
    s1, s2, s3 = cross(*e, t1, t2, t3)
    x = pressed.x
    y = pressed.y
    pieces = used = 0
    reach2 = xx = xy = yy = 0.0
    for p in range(patches):
        if not scratch.sums[p, 4] > 0.0:
            continue
        F = scratch.frame[p]
        # x = x0 + a u + b v, y = y0 + c u + d v of the point (u, v) of the patch
        a = F[0, 0] * t1 + F[0, 1] * t2 + F[0, 2] * t3
        b = F[1, 0] * t1 + F[1, 1] * t2 + F[1, 2] * t3
        c = F[0, 0] * s1 + F[0, 1] * s2 + F[0, 2] * s3
        d = F[1, 0] * s1 + F[1, 1] * s2 + F[1, 2] * s3
        f1 = F[0, 3] - c1
        f2 = F[1, 3] - c2
        f3 = F[2, 3] - c3
        x0 = f1 * t1 + f2 * t2 + f3 * t3
        y0 = f1 * s1 + f2 * s2 + f3 * s3
        g = scratch.depth[p]
        scale = 1.0 / ((a * d - b * c) * whole)
        px = scale * (g[1] * d - g[2] * c)
        py = scale * (g[2] * a - g[1] * b)
        p0 = g[0] / whole - px * x0 - py * y0
        first = used
        for k in range(scratch.start[p], scratch.start[p + 1]):
            u = scratch.x[k]
            v = scratch.y[k]
            x[used] = x0 + a * u + b * v
            y[used] = y0 + c * u + d * v
            reach2 = max(reach2, x[used] * x[used] + y[used] * y[used])
            used += 1
        xx_, xy_, yy_ = second_moments(x, y, first, used, p0, px, py)
        xx += xx_
        xy += xy_
        yy += yy_
        pressed.start[pieces] = first
        pressed.count[pieces] = used - first
        put_vector(pressed.density[pieces], p0, px, py)
        pieces += 1
    pressed.pieces[0] = pieces
    reach = sqrt(reach2)
    square = xx + yy
    if xx * yy - xy * xy < SLENDER * square * square:
        if not widened(pressed, used, reach, xx, xy, yy):
            return False
        reach *= 1.0 + THIN
    pressed.reach[0] = reach
    pressed.radius[0] = 2.0 * (sqrt(reach * reach + square) - reach)
    return square > 0.0


@jit
def widened(pressed, used, reach, xx, xy, yy):
    """Widen a contact narrower than `THIN` times its length to that width; whether it has any width."""
    angle = 0.5 * atan2(2.0 * xy, xx - yy)
    m1 = -sin(angle)
    m2 = cos(angle)
    x = pressed.x
    y = pressed.y
    width = 0.0
    for k in range(used):
        width = max(width, abs(m1 * x[k] + m2 * y[k]))
    if not width > LOST * reach:
        return False
    if width < THIN * reach:
        spread = THIN * reach / width
        for k in range(used):
            out = (spread - 1.0) * (m1 * x[k] + m2 * y[k])
            x[k] += out * m1
            y[k] += out * m2
        for i in range(pressed.pieces[0]):
            density = pressed.density[i]
            out = (1.0 / spread - 1.0) * (m1 * density[1] + m2 * density[2])
            density[0] /= spread
            density[1] = (density[1] + out * m1) / spread
            density[2] = (density[2] + out * m2) / spread
    return True


@jit
def reset_memory(touching, t, k_t, k_r):
    """Clear the memory, and store the present stiffnesses."""
    for i in range(4):
        touching.elastic[t, i] = 0.0
    touching.stiffness[t, 0] = k_t
    touching.stiffness[t, 1] = k_r


@jit
def point_displacement(bodies, b, dt, r1, r2, r3):
    """Motion of the point of block ``b`` at r from its centroid in the last step."""
    v = bodies.velocity[b]
    w = bodies.spin[b]
    p1, p2, p3 = turned_back(dt * w[0], dt * w[1], dt * w[2], r1, r2, r3)
    return dt * v[0] + (r1 - p1), dt * v[1] + (r2 - p2), dt * v[2] + (r3 - p3)


@jit
def friction_wrench(touching, bodies, t, blocks, dt, normal, springs, damped, axes, arms):
    """Friction on A (3) and torsion on A about the normal n (world) of pair ``t``, whose pressure is in
    ``touching.pressed``. ``blocks``: those of A and B; ``springs``: k_t (N/m) and k_r (N m); ``axes``: n and the first
    axis t of the pressure (world); ``arms``: c from the centroids of A and B.

    B slips against A by the difference of the motions of their points at c; the friction on A points that way.
    """
    a, b = blocks
    k_t, k_r = springs
    (n1, n2, n3), (t1, t2, t3) = axes
    friction = touching.friction[t]
    cohesion = touching.cohesion[t]
    if cohesion > 0.0 and normal > 0.0:  # over the whole area; the weight of the contact is in k_t
        friction += cohesion * k_t / (touching.k_s[t] * normal)
    if not (friction * normal > 0.0 and k_t > 0.0 and k_r > 0.0):
        reset_memory(touching, t, k_t, k_r)
        return 0.0, 0.0, 0.0, 0.0
    elastic = touching.elastic[t]
    stiffness = touching.stiffness[t]
    wa = bodies.spin[a]
    wb = bodies.spin[b]
    half = -0.5 * dt
    e1, e2, e3 = turned_back(
        half * (wa[0] + wb[0]), half * (wa[1] + wb[1]), half * (wa[2] + wb[2]), elastic[0], elastic[1], elastic[2]
    )
    # in the plane, on t and u = n x t
    u1, u2, u3 = cross(n1, n2, n3, t1, t2, t3)
    loss = min(1.0, k_t / (BAND * stiffness[0])) if stiffness[0] > 0.0 else 1.0
    e_t = loss * (e1 * t1 + e2 * t2 + e3 * t3)
    e_u = loss * (e1 * u1 + e2 * u2 + e3 * u3)
    e_m = elastic[3] * (min(1.0, k_r / (BAND * stiffness[1])) if stiffness[1] > 0.0 else 1.0)
    stiffness[0] = min(max(stiffness[0], k_t), k_t / BAND)
    stiffness[1] = min(max(stiffness[1], k_r), k_r / BAND)
    s1, s2, s3 = point_displacement(bodies, b, dt, *arms[1])
    p1, p2, p3 = point_displacement(bodies, a, dt, *arms[0])
    s1 -= p1
    s2 -= p2
    s3 -= p3
    s_t = s1 * t1 + s2 * t2 + s3 * t3
    s_u = s1 * u1 + s2 * u2 + s3 * u3
    turn = dt * ((wb[0] - wa[0]) * n1 + (wb[1] - wa[1]) * n2 + (wb[2] - wa[2]) * n3)
    pressed = touching.pressed
    twist = touching.twist[t]
    limit = LimitSurface(None, None, pressed.reach[0], pressed.radius[0], pressed, 0)
    slip = s_t, s_u, turn
    before = e_t, e_u, e_m
    (f_t, f_u, f_m), (e_t, e_u, e_m), _, start, slid, _ = area_friction(
        limit, normal, friction, 0.0, springs, damped, slip, before, three_of(twist), CLOSE
    )
    if in_search(touching.laws[0]):
        e_t, e_u, e_m = stretched(springs, slip, before)
        slid = 0.0
    put_vector(twist, *start)
    touching.slip[t] += slid
    elastic[0] = e_t * t1 + e_u * u1
    elastic[1] = e_t * t2 + e_u * u2
    elastic[2] = e_t * t3 + e_u * u3
    elastic[3] = e_m
    return f_t * t1 + f_u * u1, f_t * t2 + f_u * u2, f_t * t3 + f_u * u3, f_m
