"""Forces of the joints for a given relative motion, whatever the motion of the blocks is.

A joint sees the motion of b against a at O in its own axes: now ``(dn, r1, r2)``, the opening and the tilts that give
the penetration, and over the last step ``(p1, p2, pr)``, the slip twist, with ``(pn, p_r1, p_r2)``, the change of the
opening and the tilts. It returns N and the action on b: V_1, V_2, M_T, M_1, M_2.
"""

from numpy import uint64

from dembrick._jit import jit
from dembrick.kernels.joint.laws import coulomb, no_tension
from dembrick.kernels.joint.limit_surface import proximal_map, surface
from dembrick.kernels.joint.pressure import follow_pressure
from dembrick.kernels.state import BY_LAW, DAMPING, LEAST, SLIDING


@jit
def dashpot_work(dash, v1, v2, mt, n, m1, m2, p1, p2, pr, pn, pr1, pr2):
    """Twice the work of the dashpots of a joint over a step, by the trapezoidal rule; keeps their resultant."""
    work = (dash[0] + v1) * p1 + (dash[1] + v2) * p2 + (dash[2] + mt) * pr
    work += (dash[4] + m1) * pr1 + (dash[5] + m2) * pr2 - (dash[3] + n) * pn
    dash[0] = v1
    dash[1] = v2
    dash[2] = mt
    dash[3] = n
    dash[4] = m1
    dash[5] = m2
    return work


@jit
def point_normals(points, p, dn, r1, r2, pn, pr1, pr2, viscous):
    """Normal forces of the points of joint ``p``; returns their resultant N, M_1, M_2."""
    n = m1 = m2 = 0.0
    for i in range(uint64(points.start[p]), uint64(points.start[p + 1])):
        x = points.x_n[i]
        y = points.y_n[i]
        penetration = -(dn + r1 * y - r2 * x)
        normal = 0.0
        if penetration > 0.0:
            closing = -(pn + pr1 * y - pr2 * x)
            normal = max(points.k_n[i] * (penetration + viscous * closing), 0.0)
        points.normal[i] = normal
        n += normal
        m1 -= y * normal
        m2 += x * normal
    return n, m1, m2


@jit
def spring_resultant(points, p, sums, dn, r1, r2):
    """N, M_1, M_2 of the normal springs of point joint ``p`` without its dashpots; ``sums`` is its `Energy.normal`.

    In closed form as if all were closed; where a point may be open, less what the open ones would pull.
    """
    n = -(sums[0] * dn + sums[2] * r1 - sums[1] * r2)
    m1 = sums[2] * dn + sums[4] * r1 - sums[5] * r2
    m2 = -(sums[1] * dn + sums[5] * r1 - sums[3] * r2)
    if dn + sums[6] * (abs(r1) + abs(r2)) > 0.0:
        for i in range(uint64(points.start[p]), uint64(points.start[p + 1])):
            x = points.x_n[i]
            y = points.y_n[i]
            pull = points.k_n[i] * max(dn + r1 * y - r2 * x, 0.0)
            n += pull
            m1 -= pull * y
            m2 += pull * x
    return n, m1, m2


@jit
def point_shears(points, p, p1, p2, pr, viscous, energy):
    """Shear forces of the points of joint ``p`` under their normal forces; returns V_1, V_2, M_T, the slip and, with
    ``energy``, twice what the springs of points without a normal force lost in letting go."""
    mu = points.friction[p]
    share = 1.0 / (1.0 + viscous)
    v1 = v2 = mt = slip = weight = 0.0
    held = by_law = lost = least = 0.0
    for i in range(uint64(points.start[p]), uint64(points.start[p + 1])):
        x = points.x_s[i]
        y = points.y_s[i]
        k = points.k_s[i]
        cap = mu * points.normal[i]
        slides, t1, t2, e1, e2, plastic, loose, along = coulomb(
            points.elastic_1[i], points.elastic_2[i], p1 - pr * y, p2 + pr * x, k, viscous, cap
        )
        points.elastic_1[i] = e1
        points.elastic_2[i] = e2
        if slides:
            points.slip[i] += plastic
            if energy is not None:
                if min(along, cap) > 0.0:
                    held += loose * along
                    by_law += cap * plastic
                elif cap > 0.0:
                    held += loose * along
                    by_law += cap * plastic
                    least = min(least, (2.0 - share) * loose * along + share * cap * plastic)
                else:
                    lost += loose * along
        v1 += t1
        v2 += t2
        mt += x * t2 - y * t1
        slip += k * points.slip[i]
        weight += k
    if energy is not None:
        # Spring and dashpot stand side by side behind the slider, t = e + viscous (e - old): so the work of friction,
        # (old + e) q / 2 for the plastic increment q, is that of the old spring force and of t = cap q / |q| in parts.
        energy.work[SLIDING] += 0.5 * ((2.0 - share) * held + share * by_law)
        energy.work[BY_LAW] += by_law
        if least < 0.0:
            energy.work[LEAST] = min(energy.work[LEAST], 0.5 * least)
    return v1, v2, mt, slip / weight, (2.0 - share) * lost


@jit
def point_forces(points, p, before, dn, r1, r2, pn, pr1, pr2, p1, p2, pr, viscous_n, viscous_s, energy):
    """Resultant (N, V_1, V_2, M_T, M_1, M_2, slip) of point joint ``p``; updates the memory of its contact points.

    With ``energy`` (not None) the work of the step goes into the books, by the trapezoidal rule over the increment;
    ``before`` is the resultant of the last step.
    """
    n, m1, m2 = point_normals(points, p, dn, r1, r2, pn, pr1, pr2, viscous_n)
    v1, v2, mt, slip, lost = point_shears(points, p, p1, p2, pr, viscous_s, energy)
    if energy is not None:
        # The dashpots carry what the springs do not. All points move with one rigid motion, so the work of their
        # resultant is the sum of theirs. At every point, stuck, sliding or open, t = e + d with d = viscous (e - old),
        # so that d = viscous (t - t_old + d_old) / (1 + viscous), and with it the resultants.
        still_n, still_1, still_2 = spring_resultant(points, p, energy.normal[p], dn, r1, r2)
        dash = energy.dash[points.joint[p]]
        share = 1.0 - 1.0 / (1.0 + viscous_s)  # the quotient is there already
        energy.work[DAMPING] += 0.5 * lost + 0.5 * dashpot_work(
            dash,
            share * (v1 - before[1] + dash[0]),
            share * (v2 - before[2] + dash[1]),
            share * (mt - before[3] + dash[2]),
            n - still_n,
            m1 - still_1,
            m2 - still_2,
            p1, p2, pr, pn, pr1, pr2,
        )  # fmt: skip
    return n, v1, v2, mt, m1, m2, slip


@jit
def point_dissipation(points, p, normals, q1, q2, qr):
    """D(q) of point joint ``p`` with the normal forces ``normals`` of its points (N m for a twist in m, m, rad)."""
    total = 0.0
    for i in range(points.start[p], points.start[p + 1]):
        s1 = q1 - qr * points.y_s[i]
        s2 = q2 + qr * points.x_s[i]
        total += normals[i] * (s1 * s1 + s2 * s2) ** 0.5
    return points.friction[p] * total


@jit
def area_normal(areas, a, dn, r1, r2):
    """N, M_1, M_2 of convex joint ``a``: the exact integral of k_n <penetration>+ over the polygon."""
    g0 = -dn
    gx = r2
    gy = -r1
    first = areas.start[a]
    last = areas.start[a + 1]
    least = g0 + gx * areas.x[first] + gy * areas.y[first]
    for i in range(first + 1, last):
        least = min(least, g0 + gx * areas.x[i] + gy * areas.y[i])
    if least >= 0.0:
        volume = areas.area[a] * g0
        moment_x = areas.second[a, 1] * gx + areas.second[a, 2] * gy
        moment_y = areas.second[a, 2] * gx + areas.second[a, 0] * gy
    else:
        volume, moment_x, moment_y = no_tension(areas.x, areas.y, first, last, g0, gx, gy)
    k = areas.k_n[a]
    return k * volume, -k * moment_y, k * moment_x


@jit
def follow_bending(pressed, areas, a, n, m1, m2, dn, r1, r2):
    """Where the friction of some convex joint follows the bending (``pressed`` not None), let that of ``a`` do so."""
    if pressed is not None:
        follow_pressure(
            pressed, a, areas.x, areas.y, areas.start[a], areas.start[a + 1], areas.reach[a], n, m1, m2, -dn, r2, -r1
        )


@jit
def area_forces(areas, a, dn, r1, r2, pn, pr1, pr2, p1, p2, pr, viscous_n, viscous_s, energy):
    """Resultant (N, V_1, V_2, M_T, M_1, M_2, slip) of convex joint ``a``; updates its memory and the books."""
    # the dashpot of the normal action sees the penetration a fraction of a step ahead
    n, m1, m2 = area_normal(areas, a, dn + viscous_n * pn, r1 + viscous_n * pr1, r2 + viscous_n * pr2)
    follow_bending(areas.pressed, areas, a, n, m1, m2, dn + viscous_n * pn, r1 + viscous_n * pr1, r2 + viscous_n * pr2)
    area = areas.area[a]
    k_t = areas.k_s[a] * area
    k_r = areas.k_s[a] * (areas.second[a, 0] + areas.second[a, 1])
    full = 1.0 + viscous_s
    v1, v2, mt, q1, q2, qr, w1, w2, wr, evaluations = proximal_map(
        areas.x,
        areas.y,
        areas.start[a],
        areas.start[a + 1],
        area,
        areas.reach[a],
        areas.far[a],
        areas.pressed,
        a,
        areas.radius[a],
        areas.friction[a] * n,
        full * k_t,
        full * k_r,
        areas.elastic[a, 0] + full * k_t * p1,
        areas.elastic[a, 1] + full * k_t * p2,
        areas.elastic[a, 2] + full * k_r * pr,
        areas.twist[a, 0],
        areas.twist[a, 1],
        areas.twist[a, 2],
    )
    elastic = areas.elastic[a]
    old_1 = elastic[0]
    old_2 = elastic[1]
    old_r = elastic[2]
    e1 = old_1 + k_t * (p1 - q1)
    e2 = old_2 + k_t * (p2 - q2)
    er = old_r + k_r * (pr - qr)
    elastic[0] = e1
    elastic[1] = e2
    elastic[2] = er
    areas.twist[a, 0] = w1
    areas.twist[a, 1] = w2
    areas.twist[a, 2] = wr
    by_law = v1 * q1 + v2 * q2 + mt * qr
    strength = areas.friction[a] * n
    if strength > 0.0:
        areas.slip[a] += by_law / strength
    if energy is not None:
        friction = 0.5 * ((old_1 + e1) * q1 + (old_2 + e2) * q2 + (old_r + er) * qr)
        energy.work[SLIDING] += friction
        energy.work[BY_LAW] += by_law
        if friction < 0.0:
            energy.work[LEAST] = min(energy.work[LEAST], friction)
        still_n, still_1, still_2 = area_normal(areas, a, dn, r1, r2)
        energy.work[DAMPING] += 0.5 * dashpot_work(
            energy.dash[areas.joint[a]], v1 - e1, v2 - e2, mt - er, n - still_n, m1 - still_1, m2 - still_2,
            p1, p2, pr, pn, pr1, pr2,
        )  # fmt: skip
    areas.evaluations[a] += evaluations
    return n, v1, v2, mt, m1, m2, areas.slip[a]


@jit
def area_dissipation(areas, a, normal, q1, q2, qr):
    """D(q) of convex joint ``a`` under the normal force ``normal``."""
    # D is of degree one: near the unit twist nothing overflows
    size = max(abs(q1), abs(q2), abs(qr) * areas.reach[a])
    if size == 0.0:
        return 0.0
    d = surface(
        areas.x,
        areas.y,
        areas.start[a],
        areas.start[a + 1],
        areas.area[a],
        areas.reach[a],
        areas.far[a],
        areas.pressed,
        a,
        q1 / size,
        q2 / size,
        qr / size,
    )[0]
    return areas.friction[a] * normal * size * d
