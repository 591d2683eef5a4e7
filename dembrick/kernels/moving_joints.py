"""Joints between blocks that move and turn by any amount: exact geometry, no small angle anywhere.

The contact polygon rides on one block, the *host*; the *other* block offers the plane. In the axes of that plane (u1,
u2 and m = u1 x u2, which turn with the other block) the host's O and its two tangents e1, e2 are nine numbers,
``seen``, and a point (x, y) of the polygon is O + x e1 + y e2: its gap is linear in x and y however far the blocks have
turned. Slip and closing of a step are differences of ``seen``, so they add up to the total motion: nothing drifts, and
a pair that moves as one rigid body sees nothing. Friction acts in the plane, at the foot of the point that it belongs
to: where a block rocks, that point (O of a convex joint) rises from the plane while its toe stays. Shear memory lives
in the plane's axes (of convex joints, in the polygon's) and turns with them. The normal force acts along the other's
normal, and force and reaction at one world point.

A wrench row holds the force on the host (3), its torque about the host's centroid (3) and that of the reaction about
the other's centroid (3), world axes.
"""

from math import sqrt
from typing import NamedTuple

from numpy import ndarray

from dembrick._jit import jit
from dembrick.kernels.books import (
    book_corners,
    book_losses,
    book_pressure,
    book_shear,
    book_slip,
    closed_pressure,
    let_go,
    spring_pressure,
)
from dembrick.kernels.laws import no_tension
from dembrick.kernels.limit_surface import proximal_map
from dembrick.kernels.vec3 import cross, rows_times


class Links(NamedTuple):
    """j joints: which blocks, and where the polygon and the plane sit on them."""

    host: ndarray  # (j,) uint32
    other: ndarray  # (j,) uint32
    sense: ndarray  # (j,) +1 where the other's outward normal is m, -1 where it is -m
    lever: ndarray  # (j, 3) m, from the host's centroid to O, host's body axes
    tangents: ndarray  # (j,) uint32, e1, e2 in the host's body axes: a row of `axes`
    plane: ndarray  # (j,) uint32, u1, u2 in the other's body axes: a row of `axes`
    axes: ndarray  # (k, 2, 3) pairs of directions in body axes, each once: blocks of a wall have few
    offset: ndarray  # (j,) m, distance of the plane from the other's centroid, along m
    viscous: ndarray  # (j, 2) dashpot over spring force for the same increment: normal, shear
    seen: ndarray  # (j, 9) O, e1, e2 of the host in the plane's axes, from the other's centroid, last step
    wrench: ndarray  # (j, 9) N, N m: see above
    kept: ndarray  # (j, 4) O and e1 along u1 and u2, of `seen`, when the polygon was last cut to the other's face
    reach: ndarray  # (j,) float32, m, greatest distance of the polygon from O
    slack: ndarray  # (j,) float32, m, how far the polygon may move along the plane before it must be cut again


class Corners(NamedTuple):
    """Joints whose forces act at contact points."""

    joint: ndarray  # (p,) uint32
    start: ndarray  # (p + 1,) uint32, first contact point of each
    law: ndarray  # (p,) uint32, which of the following
    k_n: ndarray  # (l,) Pa/m
    k_s: ndarray  # (l,) Pa/m
    friction: ndarray  # (l,)
    shear_arm: ndarray  # (l,) friction acts at this times the arm of the normal force
    x: ndarray  # (c,) m, from O along e1
    y: ndarray  # (c,) m, along e2
    area: ndarray  # (c,) m2, tributary
    elastic: ndarray  # (c, 2) N, elastic shear force, in the sense in which the host slips, along u1, u2
    slip: ndarray  # (c,) m, length of the slip path
    force: ndarray | None  # (c, 3) N, world, last force on the host at each point; None where nobody asks for it


class Faces(NamedTuple):
    """Convex joints. Equal polygons share their vertices and their series; a joint that was cut has its own."""

    joint: ndarray  # (a,) uint32
    outline: ndarray  # (a,) uint32, which polygon: a row of `count`, `x`, `y` and `far`
    k_n: ndarray  # (a,) Pa/m
    k_s: ndarray  # (a,) Pa/m
    friction: ndarray  # (a,)
    area: ndarray  # (a,) m2
    second: ndarray  # (a, 3) m4, integrals of y^2, x^2, x y about O, the centroid
    negligible: ndarray  # (a,) N, friction strength up to which the limit surface need not be the exact one
    reach: ndarray  # (a,) m, greatest vertex distance from O
    radius: ndarray  # (a,) m, torsion strength over V_0
    elastic: ndarray  # (a, 3) N, N, N m, in the sense in which the host slips, polygon axes
    twist: ndarray  # (a, 3) m, m, rad, last plastic twist
    slip: ndarray  # (a,) m, length of the slip path
    count: ndarray  # (o,) int64, vertices of each polygon
    x: ndarray  # (o, v) m, vertices from O along e1, counter-clockwise about e1 x e2
    y: ndarray  # (o, v) m, along e2
    far: ndarray  # (o, 42) series of the limit surface about pure translation


@jit
def resultant(links, j, a1, a2, a3, b1, b2, b3, c1, c2, c3, twisting, u1, u2, u3, w1, w2, w3, d, r):
    """Write the wrench of joint ``j``.

    a, b, c: sums over the polygon of the force on the host, in the plane's axes, and of x and y times it, of which the
    parts along the plane act in it; ``twisting`` is a couple about m on top. u, w: the plane's axes u1, u2 in the
    world; d, r: O from the centroids of other, host.
    """
    s = links.seen[j]
    m1, m2, m3 = cross(u1, u2, u3, w1, w2, w3)
    f1 = a1 * u1 + a2 * w1 + a3 * m1
    f2 = a1 * u2 + a2 * w2 + a3 * m2
    f3 = a1 * u3 + a2 * w3 + a3 * m3
    height = s[2] - links.offset[j]
    p1 = s[4] * b3 + s[7] * c3 + height * a2
    p2 = -(s[3] * b3 + s[6] * c3 + height * a1)
    p3 = s[3] * b2 - s[4] * b1 + s[6] * c2 - s[7] * c1 + twisting
    t1 = p1 * u1 + p2 * w1 + p3 * m1
    t2 = p1 * u2 + p2 * w2 + p3 * m2
    t3 = p1 * u3 + p2 * w3 + p3 * m3
    h1, h2, h3 = cross(r[0], r[1], r[2], f1, f2, f3)
    o1, o2, o3 = cross(d[0], d[1], d[2], f1, f2, f3)
    out = links.wrench[j]
    out[0] = f1
    out[1] = f2
    out[2] = f3
    out[3] = t1 + h1
    out[4] = t2 + h2
    out[5] = t3 + h3
    out[6] = -t1 - o1
    out[7] = -t2 - o2
    out[8] = -t3 - o3


@jit
def look(links, bodies, j):
    """Where the host is now, in the plane's axes: nine numbers; then u1, u2 (world), and O from both centroids."""
    host = links.host[j]
    other = links.other[j]
    R = bodies.rotation[other]
    u = links.axes[links.plane[j]]
    u1, u2, u3 = rows_times(R, u[0, 0], u[0, 1], u[0, 2])
    w1, w2, w3 = rows_times(R, u[1, 0], u[1, 1], u[1, 2])
    m1, m2, m3 = cross(u1, u2, u3, w1, w2, w3)
    R = bodies.rotation[host]
    lever = links.lever[j]
    r = rows_times(R, lever[0], lever[1], lever[2])
    x = bodies.position
    d = (r[0] + (x[host, 0] - x[other, 0]), r[1] + (x[host, 1] - x[other, 1]), r[2] + (x[host, 2] - x[other, 2]))
    t = links.axes[links.tangents[j]]
    e1, e2, e3 = rows_times(R, t[0, 0], t[0, 1], t[0, 2])
    g1, g2, g3 = rows_times(R, t[1, 0], t[1, 1], t[1, 2])
    return (
        d[0] * u1 + d[1] * u2 + d[2] * u3,
        d[0] * w1 + d[1] * w2 + d[2] * w3,
        d[0] * m1 + d[1] * m2 + d[2] * m3,
        e1 * u1 + e2 * u2 + e3 * u3,
        e1 * w1 + e2 * w2 + e3 * w3,
        e1 * m1 + e2 * m2 + e3 * m3,
        g1 * u1 + g2 * u2 + g3 * u3,
        g1 * w1 + g2 * w2 + g3 * w3,
        g1 * m1 + g2 * m2 + g3 * m3,
        u1, u2, u3, w1, w2, w3, d, r,
    )  # fmt: skip


@jit
def turned(seen, x1, x2, x3, y1, y2, y3):
    """Turn (3) of the host against the plane in a step, in the plane's axes (rad), exact to its cube; x and y: change
    of e1 and e2 since ``seen``. Where nothing changes it is nought, to the last bit."""
    e1 = seen[3] + 0.5 * x1
    e2 = seen[4] + 0.5 * x2
    e3 = seen[5] + 0.5 * x3
    a1, a2, a3 = cross(e1, e2, e3, x1, x2, x3)
    b1, b2, b3 = cross(seen[6], seen[7], seen[8], y1, y2, y3)
    # the first misses the turn about e1, which the second has
    along = e1 * b1 + e2 * b2 + e3 * b3
    return a1 + along * e1, a2 + along * e2, a3 + along * e3


@jit
def met(g, ahead, viscous):
    """What the dashpot adds to the penetration ``g`` where contact began within the last step; ``ahead`` is viscous
    times the whole closing d of that step.

    A force stands for half a step on either side of its moment. Contact has lasted for g / d of the step behind, so the
    dashpot acts on g + d / 2. Without that a bounce depends by a tenth and more on where in a step it begins.
    """
    return viscous * g + 0.5 * ahead


@jit
def write_force(out, i, a1, a2, a3, u1, u2, u3, w1, w2, w3):
    """Write a force of a contact point, given in the plane's axes, in those of the world."""
    m1, m2, m3 = cross(u1, u2, u3, w1, w2, w3)
    out[i, 0] = a1 * u1 + a2 * w1 + a3 * m1
    out[i, 1] = a1 * u2 + a2 * w2 + a3 * m2
    out[i, 2] = a1 * u3 + a2 * w3 + a3 * m3


@jit
def corner_forces(links, corners, bodies, first, last, force_out, books):
    """Forces of the point joints ``first`` to ``last``: Coulomb friction and a no-tension spring at every point.

    ``force_out`` is ``corners.force``, given apart so that its code goes where it is None; ``books``: the energy books.
    """
    booked = books.fallen.size > 0
    for p in range(first, last):
        j = corners.joint[p]
        o1, o2, o3, e1, e2, e3, g1, g2, g3, u1, u2, u3, w1, w2, w3, d, r = look(links, bodies, j)
        seen = links.seen[j]
        p1 = o1 - seen[0]
        p2 = o2 - seen[1]
        p3 = o3 - seen[2]
        x1 = e1 - seen[3]
        x2 = e2 - seen[4]
        x3 = e3 - seen[5]
        y1 = g1 - seen[6]
        y2 = g2 - seen[7]
        y3 = g3 - seen[8]
        turn1, turn2, _ = turned(seen, x1, x2, x3, y1, y2, y3)
        seen[0] = o1
        seen[1] = o2
        seen[2] = o3
        seen[3] = e1
        seen[4] = e2
        seen[5] = e3
        seen[6] = g1
        seen[7] = g2
        seen[8] = g3
        # forces by area: of the penetration, alone and with the dashpot, which sees a fraction of a step ahead, ...
        law = corners.law[p]
        k_n = corners.k_n[law]
        k_s = corners.k_s[law]
        sense = links.sense[j]
        viscous = links.viscous[j, 0]
        pull = -sense * k_n
        g0 = pull * (o3 - links.offset[j])
        gx = pull * e3
        gy = pull * g3
        pull *= viscous
        h0 = g0 + pull * p3
        hx = gx + pull * x3
        hy = gy + pull * y3
        # ... and of the slip of the step, of feet that stand in the plane by its middle
        arm = corners.shear_arm[law]
        height = o3 - 0.5 * p3 - links.offset[j]
        p1 -= height * turn2
        p2 += height * turn1
        height = e3 - 0.5 * x3
        x1 -= height * turn2
        x2 += height * turn1
        height = g3 - 0.5 * y3
        y1 -= height * turn2
        y2 += height * turn1
        p1 *= k_s
        p2 *= k_s
        x1 *= k_s * arm
        x2 *= k_s * arm
        y1 *= k_s * arm
        y2 *= k_s * arm
        damped = 1.0 + links.viscous[j, 1]
        mu = corners.friction[law]
        a1 = a2 = a3 = b1 = b2 = b3 = c1 = c2 = c3 = 0.0
        n = nx = ny = 0.0  # what dashpots add to the normal force
        friction = by_law = released = stepping = least = 0.0
        for i in range(corners.start[p], corners.start[p + 1]):
            x = corners.x[i]
            y = corners.y[i]
            area = corners.area[i]
            g = g0 + x * gx + y * gy
            force = 0.0
            if g > 0.0:
                h = h0 + x * hx + y * hy
                if h >= (1.0 + viscous) * g:  # it was open a step ago
                    if booked:
                        was = g + sense * k_n * (p3 + x * x3 + y * y3)
                        stepping -= 0.5 * area / k_n * g * min(was, 0.0)
                    h = g + met(g, h - g, viscous)
                force = area * h
            elastic = corners.elastic[i]
            if force > 0.0:
                if booked:
                    extra = force - area * g
                    n += extra
                    nx += x * extra
                    ny += y * extra
                before1 = elastic[0]
                before2 = elastic[1]
                s1 = area * (p1 + x * x1 + y * y1)
                s2 = area * (p2 + x * x2 + y * y2)
                t1 = before1 + damped * s1
                t2 = before2 + damped * s2
                size2 = t1 * t1 + t2 * t2
                cap = mu * force
                if size2 <= cap * cap:
                    elastic[0] = before1 + s1
                    elastic[1] = before2 + s2
                else:
                    size = sqrt(size2)
                    plastic = (size - cap) / (size * damped)
                    elastic[0] = before1 + s1 - plastic * t1
                    elastic[1] = before2 + s2 - plastic * t2
                    slid = plastic * size / (k_s * area)
                    if booked:
                        held = slid / size * 0.5 * ((before1 + elastic[0]) * t1 + (before2 + elastic[1]) * t2)
                        friction += held
                        least = min(least, held)
                        by_law += cap * slid
                    corners.slip[i] += slid
                    t1 *= cap / size
                    t2 *= cap / size
                a1 -= t1
                a2 -= t2
                a3 += force
                b1 -= x * t1
                b2 -= x * t2
                b3 += x * force
                c1 -= y * t1
                c2 -= y * t2
                c3 += y * force
                if force_out is not None:
                    write_force(force_out, i, -t1, -t2, sense * force, u1, u2, u3, w1, w2, w3)
            else:
                if booked:
                    if g > 0.0:  # the dashpot takes off what the spring presses
                        extra = -area * g
                        n += extra
                        nx += x * extra
                        ny += y * extra
                    else:
                        was = g + sense * k_n * (p3 + x * x3 + y * y3)
                        stepping += 0.5 * area / k_n * g * max(was, 0.0)
                    if area > 0.0 and (elastic[0] != 0.0 or elastic[1] != 0.0):
                        s1 = area * (p1 + x * x1 + y * y1)
                        s2 = area * (p2 + x * x2 + y * y2)
                        released += let_go(books.joint[j], x, y, elastic[0], elastic[1], s1, s2, k_s * area)
                elastic[0] = 0.0
                elastic[1] = 0.0
                if force_out is not None:
                    write_force(force_out, i, 0.0, 0.0, 0.0, u1, u2, u3, w1, w2, w3)
        resultant(
            links, j, a1, a2, sense * a3, arm * b1, arm * b2, sense * b3, arm * c1, arm * c2, sense * c3, 0.0,
            u1, u2, u3, w1, w2, w3, d, r,
        )  # fmt: skip
        if booked:
            book_corners(
                books.joint[j], sense, damped, k_s, -a1, -a2, -b1, -b2, -c1, -c2, n, nx, ny,
                p1, p2, p3, x1, x2, x3, y1, y2, y3,
            )  # fmt: skip
            if by_law != 0.0 or released != 0.0 or stepping != 0.0:
                book_losses(books, j, friction, by_law, released, stepping, least)


@jit
def pressed(faces, a, viscous, g0, gx, gy, d0, dx, dy):
    """Integrals over the polygon of <h>+, x <h>+ and y <h>+ (x, y from O): h is the penetration g = g0 + gx x + gy y
    and ``viscous`` times what it grew by in the step, d = d0 + dx x + dy y. All nought where g is nowhere positive."""
    h0 = g0 + viscous * d0
    hx = gx + viscous * dx
    hy = gy + viscous * dy
    # h and g positive on the circle around the polygon, and contact at O a step ago: no vertex needs to be looked at
    reach = faces.reach[a]
    if min(h0 - reach * sqrt(hx * hx + hy * hy), g0, g0 - d0) <= 0.0:
        outline = faces.outline[a]
        count = faces.count[outline]
        x = faces.x[outline]
        y = faces.y[outline]
        least, most, before = 1e300, -1e300, -1e300
        for i in range(count):
            g = g0 + gx * x[i] + gy * y[i]
            d = d0 + dx * x[i] + dy * y[i]
            least = min(least, g + viscous * d)
            most = max(most, g)
            before = max(before, g - d)
        if most <= 0.0:
            return 0.0, 0.0, 0.0
        if before <= 0.0:
            h0 = g0 + met(g0, viscous * d0, viscous)
            hx = gx + met(gx, viscous * dx, viscous)
            hy = gy + met(gy, viscous * dy, viscous)
            least = 1e300
            for i in range(count):
                least = min(least, h0 + hx * x[i] + hy * y[i])
        if least < 0.0:
            return no_tension(x, y, 0, count, h0, hx, hy)
    second = faces.second[a]
    return faces.area[a] * h0, second[1] * hx + second[2] * hy, second[2] * hx + second[0] * hy


@jit
def face_forces(links, faces, bodies, first, last, books):
    """Forces of the convex joints ``first`` to ``last``: exact no-tension integral, exact limit surface."""
    booked = books.fallen.size > 0
    for a in range(first, last):
        j = faces.joint[a]
        o1, o2, o3, e1, e2, e3, g1, g2, g3, u1, u2, u3, w1, w2, w3, d, r = look(links, bodies, j)
        seen = links.seen[j]
        sense = links.sense[j]
        viscous = links.viscous[j, 0]
        # penetration, and what it grew by in the step
        h0 = -sense * (o3 - links.offset[j])
        hx = -sense * e3
        hy = -sense * g3
        d0 = -sense * (o3 - seen[2])
        dx = -sense * (e3 - seen[5])
        dy = -sense * (g3 - seen[8])
        n, nx, ny = pressed(faces, a, viscous, h0, hx, hy, d0, dx, dy)
        k_n = faces.k_n[a]
        n *= k_n
        nx *= k_n
        ny *= k_n
        # slip of the step at the foot of O in the plane's axes, and what turns them into the polygon's
        turn1, turn2, turn = turned(
            seen, e1 - seen[3], e2 - seen[4], e3 - seen[5], g1 - seen[6], g2 - seen[7], g3 - seen[8]
        )
        height = 0.5 * (o3 + seen[2]) - links.offset[j]
        p1 = o1 - seen[0] - height * turn2
        p2 = o2 - seen[1] + height * turn1
        scale = 1.0 / sqrt(e1 * e1 + e2 * e2)
        cosine = e1 * scale
        sine = e2 * scale
        seen[0] = o1
        seen[1] = o2
        seen[2] = o3
        seen[3] = e1
        seen[4] = e2
        seen[5] = e3
        seen[6] = g1
        seen[7] = g2
        seen[8] = g3
        elastic = faces.elastic[a]
        b1 = elastic[0]
        b2 = elastic[1]
        bm = elastic[2]
        s1 = cosine * p1 + sine * p2
        s2 = cosine * p2 - sine * p1
        t1 = t2 = tm = 0.0
        slides = True
        if n > 0.0:
            area = faces.area[a]
            k_t = faces.k_s[a] * area
            k_r = faces.k_s[a] * (faces.second[a, 0] + faces.second[a, 1])
            damped = 1.0 + links.viscous[j, 1]
            t1 = elastic[0] + damped * k_t * s1
            t2 = elastic[1] + damped * k_t * s2
            tm = elastic[2] + damped * k_r * turn
            strength = faces.friction[a] * n
            # inside the set by convexity, and most joints are most of the time
            room = strength - abs(tm) / faces.radius[a]
            if room >= 0.0 and t1 * t1 + t2 * t2 <= room * room:
                elastic[0] += k_t * s1
                elastic[1] += k_t * s2
                elastic[2] += k_r * turn
                slides = False
            elif strength <= faces.negligible[a]:
                # the safe chord |V|/V_0 + |M|/M_T0 = 1 of the limit surface is good enough for next to nothing
                scale = strength / (sqrt(t1 * t1 + t2 * t2) + abs(tm) / faces.radius[a])
                t1 *= scale
                t2 *= scale
                tm *= scale
                elastic[0] = t1
                elastic[1] = t2
                elastic[2] = tm
            else:
                outline = faces.outline[a]
                twist = faces.twist[a]
                t1, t2, tm, q1, q2, qr, twist[0], twist[1], twist[2], _ = proximal_map(
                    faces.x[outline], faces.y[outline], 0, faces.count[outline], area, faces.reach[a],
                    faces.far[outline], None, a, faces.radius[a], strength, damped * k_t, damped * k_r, t1, t2, tm,
                    twist[0], twist[1], twist[2],
                )  # fmt: skip
                elastic[0] += k_t * (s1 - q1)
                elastic[1] += k_t * (s2 - q2)
                elastic[2] += k_r * (turn - qr)
                faces.slip[a] += (t1 * q1 + t2 * q2 + tm * qr) / strength
            f1 = -(cosine * t1 - sine * t2)
            f2 = -(sine * t1 + cosine * t2)
            resultant(
                links, j, f1, f2, sense * n, 0.0, 0.0, sense * nx, 0.0, 0.0, sense * ny, -tm,
                u1, u2, u3, w1, w2, w3, d, r,
            )  # fmt: skip
        else:
            elastic[0] = 0.0
            elastic[1] = 0.0
            elastic[2] = 0.0
            links.wrench[j, :] = 0.0
        if booked:
            row = books.joint[j]
            if h0 >= faces.reach[a] * sqrt(hx * hx + hy * hy):
                q0, qx, qy = closed_pressure(faces, a, h0, hx, hy)
            else:
                q0, qx, qy = spring_pressure(faces, a, h0, hx, hy)
            book_pressure(row, q0, qx, qy, n, nx, ny, h0, hx, hy, d0, dx, dy)
            book_shear(row, elastic, s1, s2, turn, t1, t2, tm)
            if slides:
                book_slip(books, faces, a, n, s1, s2, turn, t1, t2, tm, b1, b2, bm)


@jit
def least_slack(links):
    """How much farther a polygon may move along its plane before one must be cut again (m); nought or less: now."""
    least = 1e300
    for j in range(links.host.size):
        seen = links.seen[j]
        kept = links.kept[j]
        p1 = seen[0] - kept[0]
        p2 = seen[1] - kept[1]
        e1 = seen[3] - kept[2]
        e2 = seen[4] - kept[3]
        moved = sqrt(p1 * p1 + p2 * p2) + links.reach[j] * sqrt(e1 * e1 + e2 * e2)
        least = min(least, links.slack[j] - moved)
    return least
