"""Contact polygons of moving joints, cut to the face on which they lie; `simulation.dynamics.joint_polygons` says why.

A face is an array (m, 2) of the corners of a convex polygon, counter-clockwise, in the axes of the plane.
"""

from math import sqrt
from typing import NamedTuple

from numpy import ndarray

from dembrick._jit import entry, jit
from dembrick.kernels.dynamics.point_laws import place_of
from dembrick.kernels.dynamics.tiles import W, glide_of
from dembrick.kernels.joint.custom_law import resize
from dembrick.kernels.joint.pressure import cut

GONE = 1e-9  # part of the polygon's area at the start below which there is no contact
PARALLEL = 1.0 - 1e-4  # cosine from which on a motion counts as parallel to an edge


class Drawn(NamedTuple):
    """A joint at the start, and its state after cutting."""

    face: ndarray  # (m, 2) m, of the other block, in the plane's axes from its centroid
    outline: ndarray  # (k, 2) m, corners along e1 and e2 from O
    arms: ndarray  # (c, 2) m, contact points; none for a convex joint
    areas: ndarray  # (c,) m2
    cells: ndarray  # (c, 4, 2) m, corners of the cell (tributary area) of each point, counter-clockwise, if points fade
    placed: ndarray  # (k, 2) m, scratch: the corners in the plane's axes
    cut: ndarray  # (k, 2) m, scratch: the corners that are left
    x: ndarray  # (4 + m,) m, scratch: a cell, as `joint.pressure.cut` takes it
    y: ndarray  # (4 + m,) m
    spare_x: ndarray  # (4 + m,) m
    spare_y: ndarray  # (4 + m,) m
    shift: ndarray  # (2,) m, shift of O on the host since the start, along e1 and e2
    whole: ndarray  # (1,) bool, whether nothing of the polygon has been cut off
    area: float  # m2
    bound: float  # m, how far the polygon may move before it is checked again
    shrink: float  # distance of the points from O over that of the corners
    margin: float  # m, an edge does not cut points so far inside it: no corner of a cell is farther from its point
    fades: bool  # whether points lose their area one by one, instead of moving with the corners


@jit
def edge_of(face, i):
    """First corner (m), direction and length (m) of edge ``i``."""
    k = i + 1 if i + 1 < face.shape[0] else 0
    x = face[k, 0] - face[i, 0]
    y = face[k, 1] - face[i, 1]
    length = sqrt(x * x + y * y)
    return face[i, 0], face[i, 1], x / length, y / length, length


@jit
def outside(face, x, y):
    """Greatest distance of a point beyond an edge line of a face (m); negative inside."""
    most = -1e300
    for i in range(face.shape[0]):
        a, b, t, s, _ = edge_of(face, i)
        most = max(most, (x - a) * s - (y - b) * t)
    return most


@jit
def nearest(face, x, y):
    """The point of a face nearest to (x, y)."""
    if outside(face, x, y) <= 0.0:
        return x, y
    least = 1e300
    p = x
    q = y
    for i in range(face.shape[0]):
        a, b, t, s, length = edge_of(face, i)
        along = min(max((x - a) * t + (y - b) * s, 0.0), length)
        u = a + along * t
        v = b + along * s
        away = (x - u) * (x - u) + (y - v) * (y - v)
        if away < least:
            least = away
            p = u
            q = v
    return p, q


@jit
def room_along(points, face, t, s, change, margin):
    """Distance (m) that ``points`` (k, 2) can move along a direction (t, s), either way, before the distance of one
    beyond an edge of a face changes by more than ``change`` (m); points farther inside than ``margin`` (m) do not
    count."""
    least = 1e300
    for i in range(face.shape[0]):
        a, b, f, g, _ = edge_of(face, i)
        rate = max(abs(g * t - f * s), 1e-12)
        for k in range(points.shape[0]):
            beyond = (points[k, 0] - a) * g - (points[k, 1] - b) * f + margin
            least = min(least, (max(-beyond, 0.0) + change) / rate)
    return least


@jit
def tangents_of(links, j):
    """O (m), e1 and e2 of a polygon along the plane's axes."""
    seen = links.seen_tiles[links.place[j] // W]
    lane = links.place[j] % W
    return (
        (seen.origin[0, lane], seen.origin[1, lane]),
        (seen.first[0, lane], seen.first[1, lane]),
        (seen.second[0, lane], seen.second[1, lane]),
    )


@jit
def start_of(drawn, o, e, g):
    """Present position of O of the start (m), in the plane's axes."""
    x, y = drawn.shift[0], drawn.shift[1]
    return o[0] - x * e[0] - y * g[0], o[1] - x * e[1] - y * g[1]


@jit
def must_be_cut(links, j, drawn, o, e, g):
    """Place the corners; whether the polygon must be cut, else it is whole and inside the face. Sets `Links.slack`, how
    far it may move until the next check."""
    a, b = start_of(drawn, o, e, g)
    most = -1e300
    for k in range(drawn.outline.shape[0]):
        x = drawn.outline[k, 0]
        y = drawn.outline[k, 1]
        drawn.placed[k, 0] = a + x * e[0] + y * g[0]
        drawn.placed[k, 1] = b + x * e[1] + y * g[1]
        most = max(most, outside(drawn.face, drawn.placed[k, 0], drawn.placed[k, 1]))
    if drawn.whole[0] and most <= 0.0:
        links.slack[j] = drawn.bound - most
        return False
    drawn.whole[0] = most <= 0.0
    links.slack[j] = drawn.bound
    return True


@jit
def set_glide(links, j, drawn, o):
    """After `must_be_cut`, set `Links.glide` of a polygon, the direction in which motion counts less, from its motion
    to O = ``o`` since it was last cut."""
    glide = links.glide[j]
    glide[0] = 1.0
    glide[1] = 0.0
    glide[2] = 1.0
    t = o[0] - links.kept[j, 0]
    s = o[1] - links.kept[j, 1]
    length = sqrt(t * t + s * s)
    if not length > 0.0:
        return
    t /= length
    s /= length
    nearly = PARALLEL
    p, q = t, s
    for i in range(drawn.face.shape[0]):
        _, _, f, g, _ = edge_of(drawn.face, i)
        if abs(f * t + g * s) > nearly:
            nearly = abs(f * t + g * s)
            p, q = f, g
    slack = float(links.slack[j])
    far = room_along(drawn.placed, drawn.face, p, q, 0.5 * drawn.bound, drawn.margin)
    if far > slack and slack > 0.0:
        glide[0] = p
        glide[1] = q
        glide[2] = slack / far


@jit
def store_position(links, j):
    """Store the position of a polygon that has been cut."""
    o, e, _ = tangents_of(links, j)
    kept = links.kept[j]
    kept[0], kept[1] = o
    kept[2], kept[3] = e


@jit
def make_independent(like, t):
    """Make tile ``t`` independent in ``like``: it represents no other tile, and none represents it; as
    `tiles.set_apart`."""
    heir = -1
    for k in range(like.size):
        if k != t and like[k] == t:
            if heir < 0:
                heir = k
            like[k] = heir
    like[t] = t


@jit
def move_origin(links, j, drawn, x, y):
    """Move O of a joint to (x, y), from O of the start (m, along e1 and e2)."""
    dx = x - drawn.shift[0]
    dy = y - drawn.shift[1]
    t = links.place[j] // W
    lane = links.place[j] % W
    make_independent(links.like, t)
    lever = links.tiles[t].lever
    lever[0, lane] += dx
    lever[1, lane] += dy
    seen = links.seen_tiles[t]
    for i in range(3):
        seen.origin[i, lane] += dx * seen.first[i, lane] + dy * seen.second[i, lane]
    drawn.shift[0] = x
    drawn.shift[1] = y


@jit
def area_and_centroid(x, y, count):
    """Area (m2) and centroid (m) of a polygon, relative to its first corner, so that a distant one costs no digits; the
    corner itself if there is no area."""
    double = cx = cy = 0.0
    for k in range(1, count - 1):
        ux, uy = x[k] - x[0], y[k] - y[0]
        vx, vy = x[k + 1] - x[0], y[k + 1] - y[0]
        part = ux * vy - uy * vx
        double += part
        cx += part * (ux + vx)
        cy += part * (uy + vy)
    if not double > 0.0:
        return 0.0, x[0], y[0]
    return 0.5 * double, x[0] + cx / (3.0 * double), y[0] + cy / (3.0 * double)


@jit
def put_area(corners, p, i, area):
    """Give contact point ``i`` of joint ``p`` another area (m2). Springs over lost area release their force: the shear
    force decreases in proportion; those over gained area start without force."""
    place = place_of(corners, p, i)
    law = corners.law[p]
    resize(corners.custom, place, area, corners.k_n[law], corners.k_s[law])
    point = corners.points[place // W]
    lane = place % W
    before = point.area[lane]
    if area < before:
        elastic = corners.sheared[place // W].elastic
        elastic[0, lane] *= area / before
        elastic[1, lane] *= area / before
    point.area[lane] = area


@jit
def project(links, corners, p, j, drawn, o, e, g):
    """Move corners beyond the edge to the nearest point of the face, and the contact points with them."""
    a, b = start_of(drawn, o, e, g)
    det = e[0] * g[1] - e[1] * g[0]
    n = drawn.outline.shape[0]
    for k in range(n):
        x, y = nearest(drawn.face, drawn.placed[k, 0], drawn.placed[k, 1])
        x -= a
        y -= b
        drawn.cut[k, 0] = (x * g[1] - y * g[0]) / det
        drawn.cut[k, 1] = (e[0] * y - e[1] * x) / det
    area, cx, cy = area_and_centroid(drawn.cut[:, 0], drawn.cut[:, 1], n)
    make_independent(corners.like, links.place[j] // W)  # tiles of point joints come first
    if not area > GONE * drawn.area:
        for k in range(n):
            put_area(corners, p, k, 0.0)
        return
    move_origin(links, j, drawn, cx, cy)
    far = 0.0
    for k in range(n):
        drawn.cut[k, 0] -= cx
        drawn.cut[k, 1] -= cy
        far = max(far, drawn.cut[k, 0] * drawn.cut[k, 0] + drawn.cut[k, 1] * drawn.cut[k, 1])
    links.reach[j] = sqrt(far)
    for k in range(n):
        last = k - 1 if k > 0 else n - 1
        after = k + 1 if k + 1 < n else 0
        x, y = drawn.cut[k, 0], drawn.cut[k, 1]
        sides = x * drawn.cut[after, 1] - y * drawn.cut[after, 0] + drawn.cut[last, 0] * y - drawn.cut[last, 1] * x
        put_area(corners, p, k, max(0.25 * sides, 0.0))
        place = place_of(corners, p, k)
        point = corners.points[place // W]
        point.x[place % W] = drawn.shrink * x
        point.y[place % W] = drawn.shrink * y


@jit
def left_of_cell(drawn, k, a, b, e, g):
    """The part of the cell of point ``k`` that lies on the face; O of the start is at (a, b) in the plane's axes."""
    x, y = drawn.arms[k, 0], drawn.arms[k, 1]
    if outside(drawn.face, a + x * e[0] + y * g[0], b + x * e[1] + y * g[1]) <= -drawn.margin:
        return 1.0
    count = 4
    for i in range(count):
        x, y = drawn.cells[k, i, 0], drawn.cells[k, i, 1]
        drawn.x[i] = a + x * e[0] + y * g[0]
        drawn.y[i] = b + x * e[1] + y * g[1]
    whole, _, _ = area_and_centroid(drawn.x, drawn.y, count)
    for i in range(drawn.face.shape[0]):
        u, v, t, s, _ = edge_of(drawn.face, i)
        count = cut(drawn, 0, count, -s, t, s * u - t * v, 0.0)
        if count < 3:
            return 0.0
    area, _, _ = area_and_centroid(drawn.x, drawn.y, count)
    return area / whole


@jit
def reduce_areas(links, corners, p, j, drawn, o, e, g):
    """Reduce the area of each point to the part of its cell that lies on the face."""
    a, b = start_of(drawn, o, e, g)
    make_independent(corners.like, links.place[j] // W)
    for k in range(drawn.areas.size):
        put_area(corners, p, k, drawn.areas[k] * left_of_cell(drawn, k, a, b, e, g))


@entry
def cut_points(links, corners, p, j, drawn):
    """Cut the polygon of joint ``j``, number ``p`` of those that act at points, to the face on which it lies."""
    o, e, g = tangents_of(links, j)
    if must_be_cut(links, j, drawn, o, e, g):
        if drawn.fades:
            reduce_areas(links, corners, p, j, drawn, o, e, g)
        else:
            project(links, corners, p, j, drawn, o, e, g)
    set_glide(links, j, drawn, o)
    store_position(links, j)


@entry
def find_stale(links, found):
    """Write the joints whose polygons have moved too far into ``found`` (j,); returns their number."""
    count = 0
    for j in range(links.host.size):
        # a little earlier than the loop does, whose square roots may round the other way
        if glide_of(links, j) >= float(links.slack[j]) * (1.0 - 1e-9):
            found[count] = j
            count += 1
    return count
