"""Springs of a new contact, as its dashpot and the time step need them: their stiffness, their position, and the masses
on which they act.
"""

from dembrick._jit import jit
from dembrick.kernels.math.vectors import columns_times, cross, rows_times

STEEP = 0.3  # least cosine between a face and the mean normal: pressure on steeper faces stores little energy


@jit
def inverse_mass(touching, bodies, b, r1, r2, r3, n1, n2, n3):
    """Velocity along n that a unit impulse along n gives the point of block ``b`` at r from its centroid (1/kg)."""
    R = bodies.rotation[b]
    c1, c2, c3 = cross(r1, r2, r3, n1, n2, n3)
    c1, c2, c3 = columns_times(R, c1, c2, c3)
    d1, d2, d3 = rows_times(bodies.inverse[b], c1, c2, c3)
    return touching.free[b] * (1.0 / bodies.mass[b] + c1 * d1 + c2 * d2 + c3 * d3)


@jit
def stepped_dashpot(polynomial, swing):
    """Dashpot over spring of a contact whose phase angle in a step is ``swing`` (rad): `time_step.stepped_dashpots`."""
    if not swing > 0.0:
        return 0.0
    swing = min(swing, polynomial[8])
    value = polynomial[7]
    for k in range(6, -1, -1):
        value = value * swing + polynomial[k]
    return value / swing


@jit
def facing(scratch, row, e1, e2, e3):
    """Cosine between e and the normal of a face, at least `STEEP`."""
    n = scratch.normal[row]
    return max(STEEP, abs(n[0] * e1 + n[1] * e2 + n[2] * e3))


@jit
def gather_springs(scratch, patches, springs, c, e, t):
    """The springs along e of all patches, per k_n, seen from c in the plane of t and s = e x t, into ``springs``: their
    sum (6), the sums with x and y (7, 8), with x^2, x y and y^2 (9 to 11); the sum of those across e (13).

    Returns the sum with x^2 + y^2 of the area alone, and the stiffness F^2 / (2 E), per k_n, of the linear spring that
    would store the energy E at the force F. This is the mean of two bounds, accurate to 2 % on edges and corners. E is
    at most that of pressures that fall along e from the patches to the nearest faces; and F^2 / (2 E) for F = c g^p is
    k_t (p + 1) / (2 p) with the tangent k_t, which is at most the sum of the springs, and

        (p + 1) / (2 p) = (integral of D)^2 / (area times integral of D^2)

    for flat contacts, edges and corners (p = 1, 2, 3) alike.
    """
    c1, c2, c3 = c
    e1, e2, e3 = e
    t1, t2, t3 = t
    s1, s2, s3 = cross(e1, e2, e3, t1, t2, t3)
    k = kx = ky = kxx = kxy = kyy = across = polar = stored = force = first = second = 0.0
    for p in range(patches):
        F = scratch.frame[p]
        g = scratch.depth[p]
        sums = scratch.sums[p]
        along = F[2, 0] * e1 + F[2, 1] * e2 + F[2, 2] * e3
        f1 = F[0, 3] - c1
        f2 = F[1, 3] - c2
        f3 = F[2, 3] - c3
        # x = x0 + a u + b v, y = y0 + m u + d v of the point (u, v) of the patch
        a = F[0, 0] * t1 + F[0, 1] * t2 + F[0, 2] * t3
        b = F[1, 0] * t1 + F[1, 1] * t2 + F[1, 2] * t3
        m = F[0, 0] * s1 + F[0, 1] * s2 + F[0, 2] * s3
        d = F[1, 0] * s1 + F[1, 1] * s2 + F[1, 2] * s3
        x0 = f1 * t1 + f2 * t2 + f3 * t3
        y0 = f1 * s1 + f2 * s2 + f3 * s3
        area = sums[0]
        x = a * sums[5] + b * sums[6]
        y = m * sums[5] + d * sums[6]
        xx = x0 * (x0 * area + 2.0 * x) + a * a * sums[7] + 2.0 * a * b * sums[8] + b * b * sums[9]
        yy = y0 * (y0 * area + 2.0 * y) + m * m * sums[7] + 2.0 * m * d * sums[8] + d * d * sums[9]
        xy = x0 * (y0 * area + y) + y0 * x + a * m * sums[7] + (a * d + b * m) * sums[8] + b * d * sums[9]
        x += x0 * area
        y += y0 * area
        polar += max(0.0, xx + yy)
        share = g[3] * along * along
        k += share * area
        kx += share * x
        ky += share * y
        kxx += share * xx
        kxy += share * xy
        kyy += share * yy
        across += (g[3] - share) * area
        if sums[4] > 0.0:
            slowness = 1.0 / facing(scratch, scratch.side[p, 0], e1, e2, e3)
            slowness += 1.0 / facing(scratch, scratch.side[p, 1], e1, e2, e3)
            square = g[0] * sums[1] + g[1] * sums[2] + g[2] * sums[3]
            stored += along * square * slowness
            force += along * sums[1]
            first += share * sums[1]
            second += share * square
    springs[6] = k
    springs[7] = kx
    springs[8] = ky
    springs[9] = kxx
    springs[10] = kxy
    springs[11] = kyy
    springs[13] = across
    if not stored > 0.0:
        return polar, k
    return polar, min(k, force * force / stored + 0.5 * first * first / second)


@jit
def stiffness_over_mass(bodies, b, springs, r1, r2, r3, u1, u2, u3):
    """Stiffness of a contact's springs for block ``b``, over all its motions: the trace of M^-1 J^T K J (1/s2).

    ``springs``: of the contact, at r from the block's centroid; u: the second axis in their plane, the first is in
    them.
    """
    R = bodies.rotation[b]
    inverse = bodies.inverse[b]
    t1, t2, t3 = columns_times(R, springs[3], springs[4], springs[5])
    v1, v2, v3 = columns_times(R, u1, u2, u3)
    m1, m2, m3 = cross(t1, t2, t3, v1, v2, v3)
    # inverse inertia and arm in the contact's axes
    i1, i2, i3 = rows_times(inverse, t1, t2, t3)
    tt = i1 * t1 + i2 * t2 + i3 * t3
    tu = i1 * v1 + i2 * v2 + i3 * v3
    tn = i1 * m1 + i2 * m2 + i3 * m3
    i1, i2, i3 = rows_times(inverse, v1, v2, v3)
    uu = i1 * v1 + i2 * v2 + i3 * v3
    un = i1 * m1 + i2 * m2 + i3 * m3
    i1, i2, i3 = rows_times(inverse, m1, m2, m3)
    nn = i1 * m1 + i2 * m2 + i3 * m3
    rt = r1 * springs[3] + r2 * springs[4] + r3 * springs[5]
    ru = r1 * u1 + r2 * u2 + r3 * u3
    rn = r1 * springs[0] + r2 * springs[1] + r3 * springs[2]
    light = 1.0 / bodies.mass[b]
    k = springs[6]
    xx = k * rt * rt + 2.0 * rt * springs[7] + springs[9]
    xy = k * rt * ru + rt * springs[8] + ru * springs[7] + springs[10]
    yy = k * ru * ru + 2.0 * ru * springs[8] + springs[11]
    along = k * light + tt * yy + uu * xx - 2.0 * tu * xy
    across = 2.0 * light + (tt + uu) * rn * rn + nn * (rt * rt + ru * ru) - 2.0 * rn * (un * ru + tn * rt)
    return along + (springs[13] + springs[14]) * across + springs[15] * nn


@jit
def add_stability_load(touching, bodies, a, b, springs, dt, x, y):
    """Add the effect of a contact's springs and dashpots on either block in a step to `load`, and note if that exceeds
    `bearable`; x, y: the contact from the centroids of the blocks.

    With the relative motion J_a x_a - J_b x_b of a contact, x^T K x <= (|J_a|^2 + |J_b|^2) k (|x_a|^2 + |x_b|^2), so
    the greatest eigenvalue of M^-1 (dt^2 K + 2 dt C) is at most the greatest sum over a block's contacts.
    """
    u1, u2, u3 = cross(springs[0], springs[1], springs[2], springs[3], springs[4], springs[5])
    both = touching.free[a] * stiffness_over_mass(bodies, a, springs, *x, u1, u2, u3)
    both += touching.free[b] * stiffness_over_mass(bodies, b, springs, *y, u1, u2, u3)
    both *= dt * dt * (1.0 + 2.0 * springs[12])
    load = touching.load
    load[a] += touching.free[a] * both
    load[b] += touching.free[b] * both
    if load[a] > touching.bearable[a] or load[b] > touching.bearable[b]:
        touching.overloaded[0] = 1
