"""The overlap of two convex parts: the surface of equal penetration, and the pressure on it.

In each part the penetration of a point is its distance to the nearest face plane, -phi with phi = max_i (n_i.x - d_i),
and the pressure is 2 kn times it. On the contact surface both are equal: phi_A = phi_B < 0. It consists of plane convex
patches, one for each pair of faces (i of A, j of B) that are nearest there,

    (n_i - n_j).x = d_i - d_j,

cut by the half spaces in which i is the nearest face of A, j that of B, and the penetration is positive. For two flat
faces g deep in each other this is the plane half way, with the pressure kn g: the law of a joint. On edges and corners
the patches shrink to nothing with the overlap. The forces, the integral of p n dA over the patches, derive from the
potential integral of min(p_A, p_B) over the common volume: they depend only on the positions of the parts, and do not
jump as one kind of contact turns into another. Faces of both parts in one plane that face the same way, as the sides of
flush blocks do, carry no pressure: they only bound the surface, else rounding would decide which of them is nearer.

(Pressure fields inside rigid bodies: Elandt, Drumwright, Sherman and Ruina, IROS 2019.)
"""

from math import sqrt
from typing import NamedTuple

from numpy import ndarray

from dembrick._jit import jit
from dembrick.kernels.joint.no_tension import extremes, no_tension
from dembrick.kernels.joint.pressure import cut
from dembrick.kernels.math.vectors import columns_times, cross, put_vector, rows_times, tangent

SAME = 1e-12  # |n_i - n_j|^2 below which two faces face the same way and have no plane between them
FLUSH = 1e-9  # of the smaller part's radius: distance up to which faces that face the same way lie in one plane


class Parts(NamedTuple):
    """p convex parts of the blocks, in the body axes of their blocks, from the blocks' centroids. Equal shapes share
    their v vertices and f faces."""

    owner: ndarray  # (p,) int64, block
    vertex_start: ndarray  # (p,) int64
    vertex_count: ndarray  # (p,) int64
    face_start: ndarray  # (p,) int64
    face_count: ndarray  # (p,) int64
    vertex: ndarray  # (v, 3) m
    normal: ndarray  # (f, 3) outward
    offset: ndarray  # (f,) m, distance of the face planes from the centroid of the block
    centre: ndarray  # (p, 3) m, centroid of the part
    radius: ndarray  # (p,) m, greatest distance of a vertex from it
    inner: ndarray  # (p,) m, smallest distance of a face plane from it


class Scratch(NamedTuple):
    """Scratch for the contact surface of one pair of parts; sizes by the greatest numbers of faces F and vertices V."""

    normal: ndarray  # (2 F, 3) face normals, those of A from 0, those of B from F, in the axes of A's block
    offset: ndarray  # (2 F,) m, of their planes from the centre of the smaller part
    face: ndarray  # (2 F,) int64, the faces that may be the nearest somewhere in the overlap, as rows of `normal`
    flush: ndarray  # (2 F,) 1 if a face lies in one plane with one of the other part and faces the same way, else 0
    vertex: ndarray  # (2 V, 3) m, vertices, those of A from 0, those of B from V
    turn: ndarray  # (3, 3) from the axes of B's block to those of A's
    x: ndarray  # (c,) m, corners of all patches in their planes, counter-clockwise about the normal
    y: ndarray  # (c,) m
    spare_x: ndarray  # (c,) m, scratch for cutting
    spare_y: ndarray  # (c,) m
    start: ndarray  # (q + 1,) int64, first corner of each patch
    frame: ndarray  # (q, 3, 4) axes t1, t2, n of each patch as rows, n from A to B; last column: its origin (m)
    depth: ndarray  # (q, 4) penetration at the origin (m), its slopes along t1 and t2; last: |n_i - n_j|/2
    side: ndarray  # (q, 2) int64, the faces i of A and j of B of the patch, as rows of `normal`
    sums: ndarray  # (q, 10) area, integrals of the penetration and of x and y times it; of the penetration along the
    # mean normal, 0 if ignored; integrals of x, y, x^2, x y and y^2


@jit
def lies_apart(parts, bodies, a, b, face, slack):
    """Whether part ``b`` lies outside the plane of face ``face`` of part ``a``, except for a depth of ``slack`` (m)."""
    i = parts.owner[a]
    j = parts.owner[b]
    f = parts.face_start[a] + face
    normal = parts.normal
    n1, n2, n3 = rows_times(bodies.rotation[i], normal[f, 0], normal[f, 1], normal[f, 2])
    x = bodies.position
    between = n1 * (x[j, 0] - x[i, 0]) + n2 * (x[j, 1] - x[i, 1]) + n3 * (x[j, 2] - x[i, 2])
    n1, n2, n3 = columns_times(bodies.rotation[j], n1, n2, n3)
    gap = between - parts.offset[f] + slack
    first = parts.vertex_start[b]
    for k in range(first, first + parts.vertex_count[b]):
        v = parts.vertex[k]
        if n1 * v[0] + n2 * v[1] + n3 * v[2] + gap <= 0.0:
            return False
    return True


@jit
def shallowest(scratch, first, count, from_vertex, vertices, depth, plane):
    """The least overlap with the vertices of the other part along the normals of the faces ``first`` to ``first + count
    - 1``, at most ``depth``, and its face, else ``plane``. If a face separates the parts, it is returned, with an
    overlap of zero or less."""
    for f in range(first, first + count):
        n = scratch.normal[f]
        least = 1e300
        for k in range(from_vertex, from_vertex + vertices):
            v = scratch.vertex[k]
            least = min(least, n[0] * v[0] + n[1] * v[1] + n[2] * v[2])
        if scratch.offset[f] - least < depth:
            depth = scratch.offset[f] - least
            plane = f
            if depth <= 0.0:
                break
    return depth, plane


@jit
def near_faces(scratch, first, count, from_vertex, vertices, depth):
    """Write the faces to within ``depth`` of which a vertex of the other part comes into `face`, from ``first`` on,
    those with the least overlaps first; returns their number."""
    found = 0
    for f in range(first, first + count):
        n = scratch.normal[f]
        d = scratch.offset[f] - depth
        near = deep = False
        for k in range(from_vertex, from_vertex + vertices):
            v = scratch.vertex[k]
            height = n[0] * v[0] + n[1] * v[1] + n[2] * v[2]
            near = near or height >= d
            deep = deep or height < d - 9.0 * depth
        if near:
            scratch.face[first + found] = f
            if not deep:
                scratch.face[first + found] = scratch.face[first]
                scratch.face[first] = f
            found += 1
    return found


@jit
def place_parts(parts, bodies, a, b, scratch):
    """Planes and vertices of both parts into ``scratch``, in the body axes of A's block, seen from the centre of the
    smaller part; returns that centre, from the centroid of A's block."""
    i = parts.owner[a]
    j = parts.owner[b]
    R = bodies.rotation[i]
    S = bodies.rotation[j]
    x = bodies.position
    a1, a2, a3 = columns_times(R, x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2])
    c = parts.centre
    if parts.radius[a] <= parts.radius[b]:
        o1 = c[a, 0]
        o2 = c[a, 1]
        o3 = c[a, 2]
        w1, w2, w3 = rows_times(R, o1 - a1, o2 - a2, o3 - a3)
        p1, p2, p3 = columns_times(S, w1, w2, w3)
    else:
        p1 = c[b, 0]
        p2 = c[b, 1]
        p3 = c[b, 2]
        w1, w2, w3 = rows_times(S, p1, p2, p3)
        o1, o2, o3 = columns_times(R, w1, w2, w3)
        o1 += a1
        o2 += a2
        o3 += a3
    first = parts.face_start[a]
    for f in range(parts.face_count[a]):
        n = parts.normal[first + f]
        put_vector(scratch.normal[f], n[0], n[1], n[2])
        scratch.offset[f] = parts.offset[first + f] - (n[0] * o1 + n[1] * o2 + n[2] * o3)
    turn = scratch.turn
    for k in range(3):
        turn[0, k], turn[1, k], turn[2, k] = columns_times(R, S[0, k], S[1, k], S[2, k])
    room = scratch.normal.shape[0] // 2
    first = parts.face_start[b]
    for f in range(parts.face_count[b]):
        n = parts.normal[first + f]
        own = scratch.normal[room + f]
        own[0], own[1], own[2] = rows_times(turn, n[0], n[1], n[2])
        scratch.offset[room + f] = parts.offset[first + f] - (n[0] * p1 + n[1] * p2 + n[2] * p3)
    room = scratch.vertex.shape[0] // 2
    first = parts.vertex_start[b]
    for k in range(parts.vertex_count[b]):
        v = parts.vertex[first + k]
        own = scratch.vertex[room + k]
        own[0], own[1], own[2] = rows_times(turn, v[0] - p1, v[1] - p2, v[2] - p3)
    first = parts.vertex_start[a]
    for k in range(parts.vertex_count[a]):
        v = parts.vertex[first + k]
        put_vector(scratch.vertex[k], v[0] - o1, v[1] - o2, v[2] - o3)
    return o1, o2, o3


@jit
def mark_flush(scratch, near_a, near_b, room, distance):
    """Mark the near faces of both parts that lie in one plane, within ``distance``, and face the same way."""
    for r in range(near_a):
        scratch.flush[scratch.face[r]] = 0.0
    for s in range(room, room + near_b):
        scratch.flush[scratch.face[s]] = 0.0
    for r in range(near_a):
        i = scratch.face[r]
        n = scratch.normal[i]
        for s in range(room, room + near_b):
            j = scratch.face[s]
            m = scratch.normal[j]
            e1 = n[0] - m[0]
            e2 = n[1] - m[1]
            e3 = n[2] - m[2]
            away = abs(scratch.offset[i] - scratch.offset[j])
            if e1 * e1 + e2 * e2 + e3 * e3 <= SAME and away <= distance:
                scratch.flush[i] = 1.0
                scratch.flush[j] = 1.0


@jit
def contact_surface(parts, bodies, a, b, slack, scratch):
    """The patches between parts ``a`` and ``b`` into ``scratch``, in the body axes of A's block; none up to an overlap
    of ``slack`` (m).

    Returns their number (less than zero: scratch has no room for them); the greatest penetration on them (m); the
    number of a face that separates the parts, those of B counted after those of A, else -1; and the origin (3) of the
    patches, from the centroid of A's block.
    """
    faces_a = parts.face_count[a]
    faces_b = parts.face_count[b]
    vertices_a = parts.vertex_count[a]
    vertices_b = parts.vertex_count[b]
    room = scratch.normal.shape[0] // 2
    vertices = scratch.vertex.shape[0] // 2
    o1, o2, o3 = place_parts(parts, bodies, a, b, scratch)
    # no point of the overlap is deeper than the least overlap along the normal of a face
    depth, plane = shallowest(scratch, 0, faces_a, vertices, vertices_b, 1e300, -1)
    if depth > slack:
        depth, plane = shallowest(scratch, room, faces_b, 0, vertices_a, depth, plane)
    if depth <= slack:
        return 0, 0.0, plane if plane < room else faces_a + plane - room, o1, o2, o3
    near_a = near_faces(scratch, 0, faces_a, vertices, vertices_b, depth)
    near_b = near_faces(scratch, room, faces_b, 0, vertices_a, depth)
    # the overlap lies in the smaller part, whose centre is the origin
    radius = min(parts.radius[a], parts.radius[b])
    mark_flush(scratch, near_a, near_b, room, FLUSH * radius)
    patches = used = 0
    deepest = 0.0
    scratch.start[0] = 0
    for r in range(near_a):
        i = scratch.face[r]
        n = scratch.normal[i]
        for s in range(room, room + near_b):
            j = scratch.face[s]
            m = scratch.normal[j]
            e1 = n[0] - m[0]
            e2 = n[1] - m[1]
            e3 = n[2] - m[2]
            size2 = e1 * e1 + e2 * e2 + e3 * e3
            if size2 <= SAME or scratch.flush[i] + scratch.flush[j] > 0.0:
                continue
            size = sqrt(size2)
            e1 /= size
            e2 /= size
            e3 /= size
            height = (scratch.offset[i] - scratch.offset[j]) / size
            half2 = radius * radius - height * height
            if half2 <= 0.0:
                continue
            half = sqrt(half2)
            u1, u2, u3 = tangent(e1, e2, e3)
            w1, w2, w3 = cross(e1, e2, e3, u1, u2, u3)
            c1 = height * e1
            c2 = height * e2
            c3 = height * e3
            g0 = scratch.offset[i] - (n[0] * c1 + n[1] * c2 + n[2] * c3)
            gx = -(n[0] * u1 + n[1] * u2 + n[2] * u3)
            gy = -(n[0] * w1 + n[1] * w2 + n[2] * w3)
            spread = half * sqrt(gx * gx + gy * gy)
            if g0 + spread <= 0.0 or g0 - spread > depth:
                continue
            if used + 2 * (near_a + near_b) + 8 > scratch.x.size:
                return -1, deepest, -1, o1, o2, o3
            x = scratch.x
            y = scratch.y
            x[used] = -half
            y[used] = -half
            x[used + 1] = half
            y[used + 1] = -half
            x[used + 2] = half
            y[used + 2] = half
            x[used + 3] = -half
            y[used + 3] = half
            count = cut(scratch, used, 4, gx, gy, g0, 0.0)
            for k in range(near_a + near_b):
                if count == 0:
                    break
                if k < near_a:
                    other = scratch.face[k]
                    own = i
                else:
                    other = scratch.face[room + k - near_a]
                    own = j
                if other != own:
                    # the nearest face is nearer than the others; a flush face only bounds the patch
                    f = scratch.normal[other]
                    h = scratch.normal[own]
                    nearest = 1.0 - scratch.flush[other]
                    d1 = nearest * h[0] - f[0]
                    d2 = nearest * h[1] - f[1]
                    d3 = nearest * h[2] - f[2]
                    count = cut(
                        scratch, used, count,
                        d1 * u1 + d2 * u2 + d3 * u3, d1 * w1 + d2 * w2 + d3 * w3,
                        d1 * c1 + d2 * c2 + d3 * c3 - (nearest * scratch.offset[own] - scratch.offset[other]), 0.0,
                    )  # fmt: skip
            if count < 3:
                continue
            # relative to its own first corner a small patch keeps its digits
            x0 = x[used]
            y0 = y[used]
            for k in range(used, used + count):
                deepest = max(deepest, g0 + gx * x[k] + gy * y[k])
                x[k] -= x0
                y[k] -= y0
            frame = scratch.frame[patches]
            put_vector(frame[0], u1, u2, u3)
            put_vector(frame[1], w1, w2, w3)
            put_vector(frame[2], e1, e2, e3)
            frame[0, 3] = c1 + x0 * u1 + y0 * w1
            frame[1, 3] = c2 + x0 * u2 + y0 * w2
            frame[2, 3] = c3 + x0 * u3 + y0 * w3
            scratch.depth[patches, 0] = g0 + gx * x0 + gy * y0
            scratch.depth[patches, 1] = gx
            scratch.depth[patches, 2] = gy
            scratch.depth[patches, 3] = 0.5 * size
            scratch.side[patches, 0] = i
            scratch.side[patches, 1] = j
            patches += 1
            used += count
            scratch.start[patches] = used
    return patches, deepest, -1, o1, o2, o3


@jit
def positive_part(x, y, first, last, p0, px, py):
    """Integrals over a polygon of <p>+, x <p>+ and y <p>+ for p = p0 + px x + py y."""
    least, most = extremes(x, y, first, last, p0, px, py)
    if most <= 0.0:
        return 0.0, 0.0, 0.0
    return no_tension(x, y, first, last, least, p0, px, py)


@jit
def flat_sums(x, y, first, last):
    """Area of a polygon and integrals of x, y, x^2, x y and y^2 over it, about (0, 0), its first corner."""
    area = moment_x = moment_y = xx = xy = yy = 0.0
    for k in range(first + 1, last - 1):
        double = x[k] * y[k + 1] - y[k] * x[k + 1]
        sx = x[k] + x[k + 1]
        sy = y[k] + y[k + 1]
        area += 0.5 * double
        moment_x += double * sx / 6.0
        moment_y += double * sy / 6.0
        xx += double * (sx * sx - x[k] * x[k + 1]) / 12.0
        yy += double * (sy * sy - y[k] * y[k + 1]) / 12.0
        xy += double * (sx * sy + x[k] * y[k] + x[k + 1] * y[k + 1]) / 24.0
    return area, moment_x, moment_y, xx, xy, yy


@jit
def sum_patches(scratch, patches):
    """Area and integrals of the penetration D of every patch into `sums`; returns the totals of the area, of D and of D
    times the normal (3)."""
    area = total = e1 = e2 = e3 = 0.0
    for p in range(patches):
        first = scratch.start[p]
        last = scratch.start[p + 1]
        g = scratch.depth[p]
        sums = scratch.sums[p]
        sums[0], sums[5], sums[6], sums[7], sums[8], sums[9] = flat_sums(scratch.x, scratch.y, first, last)
        sums[1], sums[2], sums[3] = positive_part(scratch.x, scratch.y, first, last, g[0], g[1], g[2])
        F = scratch.frame[p]
        area += sums[0]
        total += sums[1]
        e1 += sums[1] * F[2, 0]
        e2 += sums[1] * F[2, 1]
        e3 += sums[1] * F[2, 2]
    return area, total, e1, e2, e3
