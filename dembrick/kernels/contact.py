"""Forces of the joints for a given relative motion, whatever the motion of the blocks is.

A joint sees the motion of b against a at O in its own axes: now ``(dn, r1, r2)``, the opening and the tilts that give
the penetration, and over the last step ``(p1, p2, pr)``, the slip twist, with ``(pn, p_r1, p_r2)``, the change of the
opening and the tilts. It returns N and the action on b: V_1, V_2, M_T, M_1, M_2.
"""

from dembrick._jit import jit
from dembrick.kernels.laws import coulomb, no_tension, squared_penetration
from dembrick.kernels.limit_surface import proximal_map, surface
from dembrick.kernels.pressed import follow_pressure


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
def point_forces(points, p, dn, r1, r2, pn, pr1, pr2, p1, p2, pr, viscous_n, viscous_s, energy):
    """Resultant (N, V_1, V_2, M_T, M_1, M_2, slip) of point joint ``p``; updates the memory of its contact points.

    With ``energy`` (not None) the work of the step goes into the books, by the trapezoidal rule over the increment.
    """
    mu = points.friction[p]
    n_sum = v1 = v2 = mt = m1 = m2 = slip = weight = 0.0
    friction = least = by_law = lost = 0.0
    open_n = open_x = open_y = 0.0
    for i in range(points.start[p], points.start[p + 1]):
        x = points.x_n[i]
        y = points.y_n[i]
        penetration = -(dn + r1 * y - r2 * x)
        closing = -(pn + pr1 * y - pr2 * x)
        normal = 0.0
        if penetration > 0.0:
            normal = max(points.k_n[i] * (penetration + viscous_n * closing), 0.0)
        elif energy is not None:
            pull = points.k_n[i] * penetration
            open_n += pull
            open_x += pull * x
            open_y += pull * y
        points.normal[i] = normal
        xs = points.x_s[i]
        ys = points.y_s[i]
        k = points.k_s[i]
        s1 = p1 - pr * ys
        s2 = p2 + pr * xs
        old_1 = points.elastic_1[i]
        old_2 = points.elastic_2[i]
        cap = mu * normal
        t1, t2, e1, e2, q1, q2, plastic = coulomb(old_1, old_2, s1, s2, k, viscous_s, cap)
        if energy is not None:
            if plastic > 0.0:
                work = (old_1 + e1) * q1 + (old_2 + e2) * q2
                if cap > 0.0:
                    friction += work
                    if work < least:
                        least = work
                    by_law += cap * plastic
                else:
                    # nothing to rub on: the spring lets go of what it holds against its dashpot
                    lost += work
        points.elastic_1[i] = e1
        points.elastic_2[i] = e2
        points.slip[i] += plastic
        n_sum += normal
        v1 += t1
        v2 += t2
        mt += xs * t2 - ys * t1
        m1 -= y * normal
        m2 += x * normal
        slip += k * points.slip[i]
        weight += k
    if energy is not None:
        # The dashpots carry what the springs do not. All points move with one rigid motion, so the work of their
        # resultant is the sum of theirs. Spring and dashpot stand side by side behind the slider, t = e + viscous
        # (e - e_old) at every point, stuck, sliding or open, and so for the resultants; the normal springs of closed
        # points add up in closed form.
        r = energy.normal[p]
        elastic = energy.elastic[p]
        share = 1.0 / (1.0 + viscous_s)
        elastic[0] = share * (v1 + viscous_s * elastic[0])
        elastic[1] = share * (v2 + viscous_s * elastic[1])
        elastic[2] = share * (mt + viscous_s * elastic[2])
        lost += dashpot_work(
            energy.dash[points.joint[p]],
            v1 - elastic[0],
            v2 - elastic[1],
            mt - elastic[2],
            n_sum + r[0] * dn + r[2] * r1 - r[1] * r2 + open_n,
            m1 - (r[2] * dn + r[4] * r1 - r[5] * r2 + open_y),
            m2 + (r[1] * dn + r[5] * r1 - r[3] * r2 + open_x),
            p1, p2, pr, pn, pr1, pr2,
        )  # fmt: skip
        energy.work[2] += 0.5 * friction
        energy.work[3] += 0.5 * lost
        energy.work[5] += by_law
        energy.least[0] = min(energy.least[0], 0.5 * least)
    return n_sum, v1, v2, mt, m1, m2, slip / weight


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
    if energy is not None:
        old = areas.elastic[a]
        e1 = old[0] + k_t * (p1 - q1)
        e2 = old[1] + k_t * (p2 - q2)
        er = old[2] + k_r * (pr - qr)
        friction = 0.5 * ((old[0] + e1) * q1 + (old[1] + e2) * q2 + (old[2] + er) * qr)
        energy.work[2] += friction
        energy.least[0] = min(energy.least[0], friction)
        energy.work[5] += v1 * q1 + v2 * q2 + mt * qr
        still_n, still_1, still_2 = area_normal(areas, a, dn, r1, r2)
        energy.work[3] += 0.5 * dashpot_work(
            energy.dash[areas.joint[a]], v1 - e1, v2 - e2, mt - er, n - still_n, m1 - still_1, m2 - still_2,
            p1, p2, pr, pn, pr1, pr2,
        )  # fmt: skip
    areas.elastic[a, 0] += k_t * (p1 - q1)
    areas.elastic[a, 1] += k_t * (p2 - q2)
    areas.elastic[a, 2] += k_r * (pr - qr)
    areas.twist[a, 0] = w1
    areas.twist[a, 1] = w2
    areas.twist[a, 2] = wr
    strength = areas.friction[a] * n
    if strength > 0.0:
        areas.slip[a] += (v1 * q1 + v2 * q2 + mt * qr) / strength
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


@jit
def area_normal_energy(areas, a, dn, r1, r2):
    """Elastic energy (J) of the normal action of joint ``a``: half the integral of k_n <penetration>+ squared."""
    return 0.5 * areas.k_n[a] * squared_penetration(
        areas.x, areas.y, areas.start[a], areas.start[a + 1], -dn, r2, -r1
    )  # fmt: skip
