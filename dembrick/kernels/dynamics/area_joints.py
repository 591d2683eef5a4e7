"""Convex joints: the exact no-tension integral over the polygon, and friction on the exact limit surface.

Shear memory lives in the polygon's axes and turns with them. The normal force acts along the other's normal.
"""

from math import sqrt
from typing import NamedTuple

from numpy import ndarray

from dembrick._jit import jit
from dembrick.kernels.dynamics.energy import book_pressure, book_shear, book_slip, closed_pressure, spring_pressure
from dembrick.kernels.dynamics.tiles import (
    DEPTH,
    FORCE,
    GROWTH,
    MOVED,
    SEEN,
    TILE,
    TURN,
    TWISTING,
    VISCOUS,
    W,
    deliver,
    fetch,
    look,
    put_three,
    resultant,
    three,
)
from dembrick.kernels.joint.laws import met, no_tension
from dembrick.kernels.joint.limit_surface import proximal_map


class Faces(NamedTuple):
    """Convex joints. Equal polygons share their vertices and their series; a joint that was cut has its own."""

    joint: ndarray  # (a,) uint32
    tile: ndarray  # (t,) int64, which tile of `Links` each tile of these joints is
    lane: ndarray  # (t, W) uint32, which of the a joints each lane has; the last one again where there are no more
    used: ndarray  # (t,) int64, lanes that have one of their own
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
def pressed(faces, a, viscous, g0, gx, gy, d0, dx, dy):
    """Integrals over the polygon of <h>+, x <h>+ and y <h>+ (x, y from O): h is the penetration g = g0 + gx x + gy y
    and ``viscous`` times what it grew by in the step, d = d0 + dx x + dy y. All zero where g is nowhere positive."""
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
def face_force(faces, a, tile, lane, work, books):
    """Force of convex joint ``a``, in that lane of the tile: what `resultant` makes wrenches of."""
    viscous = tile[VISCOUS * W + lane]
    h0, hx, hy = three(work, DEPTH, lane)
    d0, dx, dy = three(work, GROWTH, lane)
    n, nx, ny = pressed(faces, a, viscous, h0, hx, hy, d0, dx, dy)
    k_n = faces.k_n[a]
    n *= k_n
    nx *= k_n
    ny *= k_n
    # slip of the step at the foot of O in the plane's axes, and what turns them into the polygon's
    p1, p2, _ = three(work, MOVED, lane)
    turn = work[TURN * W + lane]
    e1 = tile[(SEEN + 3) * W + lane]
    e2 = tile[(SEEN + 4) * W + lane]
    scale = 1.0 / sqrt(e1 * e1 + e2 * e2)
    cosine = e1 * scale
    sine = e2 * scale
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
        damped = 1.0 + tile[(VISCOUS + 1) * W + lane]
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
    else:
        n = nx = ny = 0.0
        elastic[0] = 0.0
        elastic[1] = 0.0
        elastic[2] = 0.0
    put_three(work, FORCE, lane, (sine * t2 - cosine * t1, -(sine * t1 + cosine * t2), n))
    put_three(work, FORCE + 3, lane, (0.0, 0.0, nx))
    put_three(work, FORCE + 6, lane, (0.0, 0.0, ny))
    work[TWISTING * W + lane] = -tm
    if books is not None:
        row = books.face[a]
        if h0 >= faces.reach[a] * sqrt(hx * hx + hy * hy):
            q0, qx, qy = closed_pressure(faces, a, h0, hx, hy)
        else:
            q0, qx, qy = spring_pressure(faces, a, h0, hx, hy)
        book_pressure(row, q0, qx, qy, n, nx, ny, h0, hx, hy, d0, dx, dy)
        book_shear(row, elastic, s1, s2, turn, t1, t2, tm)
        if slides:
            book_slip(books, faces, a, n, s1, s2, turn, t1, t2, tm, b1, b2, bm)


@jit
def face_forces(links, faces, bodies, first, last, books, work):
    """Forces of the convex joints in their tiles ``first`` to ``last``; ``work`` (WORK,) is scratch. ``books`` are the
    energy books, or None."""
    for t in range(first, last):
        begin = faces.tile[t] * TILE
        tile = links.tiles[begin : begin + TILE]
        fetch(faces.joint, faces.lane[t], links, bodies, work)
        look(tile, work)
        for lane in range(faces.used[t]):
            face_force(faces, faces.lane[t, lane], tile, lane, work, books)
        resultant(tile, work)
        deliver(faces.joint, faces.lane[t], faces.used[t], work, links.wrench)
