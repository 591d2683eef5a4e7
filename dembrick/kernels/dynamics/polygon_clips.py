"""Contact polygons of convex joints, clipped to the face on which they lie, and their properties for friction.

Elastic shear is a force distributed over the springs of the polygon: those over the part cut off release theirs, the
others keep it (`remaining_shear`).
"""

from math import sqrt
from typing import NamedTuple

from numpy import ndarray

from dembrick._jit import entry, jit
from dembrick.kernels.dynamics.contact_friction import second_moments
from dembrick.kernels.dynamics.polygon_cuts import (
    GONE,
    area_and_centroid,
    edge_of,
    make_independent,
    move_origin,
    must_be_cut,
    set_glide,
    start_of,
    store_position,
    tangents_of,
)
from dembrick.kernels.dynamics.tiles import W, put_three, three
from dembrick.kernels.joint.geometry import Polygon
from dembrick.kernels.joint.limit_surface import edge_sums
from dembrick.kernels.joint.pressure import cut

IDLE = 1e-9  # over the joint's reach: distance within which a corner repeats another or lies between neighbours
ORDER = 8  # of the series about pure translation
CENTRED = 1e-15  # of the mean distance: least gain of a Newton step towards its minimum
MOST = 50  # of such steps


class Clipping(NamedTuple):
    """Scratch, as `joint.pressure.cut` needs it, and the numbers of `geometry.friction_integrals.far_moments`."""

    x: ndarray  # (v,) m
    y: ndarray  # (v,) m
    spare_x: ndarray  # (v,) m
    spare_y: ndarray  # (v,) m
    moments: ndarray  # (9, 9) mean values of x^i y^j
    rule: ndarray  # (3, 25) product rule on a triangle: r, s, weight
    series: ndarray  # (9, 9, 9) order n: from the mean values of x^(n-k) y^k (column k) to coefficients


@jit
def without_idle_corners(room, count, least):
    """Remove corners that repeat the one before, or lie on the line of their neighbours, within ``least`` (m); returns
    the number of corners left, 0 if fewer than three."""
    x = room.x
    y = room.y
    k = 0
    while k < count and count >= 3:
        before = k - 1 if k > 0 else count - 1
        after = k + 1 if k + 1 < count else 0
        cx, cy = x[after] - x[before], y[after] - y[before]
        hx, hy = x[k] - x[before], y[k] - y[before]
        if hx * hx + hy * hy <= least * least or abs(hx * cy - hy * cx) <= least * sqrt(cx * cx + cy * cy):
            for i in range(k, count - 1):
                x[i] = x[i + 1]
                y[i] = y[i + 1]
            count -= 1
            k = 0
        else:
            k += 1
    return count if count >= 3 else 0


@jit
def least_mean_distance(polygon):
    """Least mean distance (m) of the area from a centre, by Newton's method on the exact integral."""
    c1 = c2 = 0.0
    best = 1e300
    for _ in range(MOST):
        f, b1, b2, t11, t12, t22 = edge_sums(polygon, c1, c2)
        if f >= best * (1.0 - CENTRED):
            return min(f, best) / polygon.area
        best = f
        det = t11 * t22 - t12 * t12
        c1 += (t22 * b1 - t12 * b2) / det
        c2 += (t11 * b2 - t12 * b1) / det
    return best / polygon.area


@jit
def write_series(room, count, out):
    """`geometry.friction_integrals.far_moments` of the corners into ``out`` (42,)."""
    moments = room.moments
    moments[:] = 0.0
    for k in range(count):
        after = k + 1 if k + 1 < count else 0
        px, py, qx, qy = room.x[k], room.y[k], room.x[after], room.y[after]
        cross = px * qy - py * qx
        for g in range(room.rule.shape[1]):
            r, s, weight = room.rule[0, g], room.rule[1, g], room.rule[2, g]
            x = r * (px + s * (qx - px))
            y = r * (py + s * (qy - py))
            power = cross * weight
            for i in range(ORDER + 1):
                value = power
                for j in range(ORDER + 1 - i):
                    moments[i, j] += value
                    value *= y
                power *= x
    at = 0
    for n in range(2, ORDER + 1):
        for row in range(n + 1):
            total = 0.0
            for k in range(n + 1):
                total += room.series[n, row, k] * moments[n - k, k]
            out[at] = total / moments[0, 0]
            at += 1


@jit
def remaining_shear(elastic, before, step, after):
    """Elastic shear resultants (N, N, N m) about the new centroid, ``step`` (m) from the old one, of a polygon whose
    area and polar moment (m2, m4) were ``before`` and are ``after``.

    The springs under (e_1, e_2, e_m) carry e / A + e_m / J (-y, x) each. Those over lost area release their force;
    those over gained area start without force.
    """
    e1, e2, em = elastic
    area, polar = before
    now, now_polar = after
    if now >= area:
        return e1, e2, em - (step[0] * e2 - step[1] * e1)
    turn = em / polar
    return now * (e1 / area - turn * step[1]), now * (e2 / area + turn * step[0]), turn * now_polar


@jit
def common_part(links, j, drawn, room):
    """Intersection of the polygon, placed in ``drawn.placed``, and the face, into ``room``, from O of the start along
    e1 and e2; returns its number of corners."""
    o, e, g = tangents_of(links, j)
    count = drawn.placed.shape[0]
    for k in range(count):
        room.x[k] = drawn.placed[k, 0]
        room.y[k] = drawn.placed[k, 1]
    for i in range(drawn.face.shape[0]):
        a, b, t, s, _ = edge_of(drawn.face, i)
        count = cut(room, 0, count, -s, t, s * a - t * b, 0.0)
        if count < 3:
            return 0
    count = without_idle_corners(room, count, IDLE * links.reach[j])
    a, b = start_of(drawn, o, e, g)
    det = e[0] * g[1] - e[1] * g[0]
    for k in range(count):
        x, y = room.x[k] - a, room.y[k] - b
        room.x[k] = (x * g[1] - y * g[0]) / det
        room.y[k] = (e[0] * y - e[1] * x) / det
    return count


@entry
def must_clip(links, j, drawn):
    """Whether the polygon of convex joint ``j`` must be clipped; places its corners in ``drawn.placed``. Its motion
    counts from here."""
    o, e, g = tangents_of(links, j)
    clipped = must_be_cut(links, j, drawn, o, e, g)
    set_glide(links, j, drawn, o)
    store_position(links, j)
    return clipped


@entry
def clip_area(links, faces, a, j, drawn, stiffness, room):
    """Clip the polygon of joint ``j``, number ``a`` of the convex ones, which does not share it, to the face on which
    it lies. If nothing is left it carries nothing, else it has ``stiffness`` (Pa/m) along the normal."""
    t = faces.place[a] // W
    lane = faces.place[a] % W
    make_independent(faces.like, t)
    face = faces.tiles[t]
    count = common_part(links, j, drawn, room)
    area, x, y = area_and_centroid(room.x, room.y, count) if count else (0.0, 0.0, 0.0)
    if not area > GONE * drawn.area:
        face.k_n[lane] = 0.0
        return
    step = x - drawn.shift[0], y - drawn.shift[1]
    move_origin(links, j, drawn, x, y)
    outline = faces.outline[a]
    far = 0.0
    for k in range(count):
        room.x[k] -= x
        room.y[k] -= y
        faces.x[outline, k] = room.x[k]
        faces.y[outline, k] = room.y[k]
        far = max(far, room.x[k] * room.x[k] + room.y[k] * room.y[k])
    faces.count[outline] = count
    write_series(room, count, faces.far[outline])
    xx, xy, yy = second_moments(room.x, room.y, 0, count, 1.0, 0.0, 0.0)
    by, bx, _ = three(face.second, lane)
    before, after = (face.area[lane], by + bx), (area, yy + xx)
    elastic = faces.sheared[t].elastic
    put_three(elastic, lane, remaining_shear(three(elastic, lane), before, step, after))
    face.k_n[lane] = stiffness
    face.area[lane] = area
    put_three(face.second, lane, (yy, xx, xy))
    face.reach[lane] = sqrt(far)
    face.radius[lane] = least_mean_distance(Polygon(room.x, room.y, 0, count, area, None, sqrt(far)))
    links.reach[j] = face.reach[lane]
    store_position(links, j)  # O may have moved
