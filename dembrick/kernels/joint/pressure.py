"""The limit surface of a contact whose pressure is linear: of convex joints whose friction follows the bending, by the
pressures "effective" and "linear", and of new contacts, whose patches have a linear pressure (``contact_friction``).

The pressure p is a share of the normal force per area, linear over a convex polygon; a new contact may have several.
The polygon of a joint is a part of its own, seen from the centre of pressure e = (M_2, -M_1)/N:

- effective: p is uniform over the largest part that is centrally symmetric about e, which is the intersection of the
  polygon with its reflection through e (a rectangle a x b: a x (b - 2e));
- linear: p is the no-tension pressure k_n <g>+ itself over N, on the part where g > 0.

As in ``limit_surface``, D(q) = integral of p |v + w x r| dA = |w| times the integral of p times the distance from the
torsion centre C. With p = p_C + s.(r - C), the triangle between C and an edge (h its distance, n its normal, t along
it, rho the distance from C) and the divergence theorem leave elementary integrals over the edges:

    I = integral of rho ds = (s rho + h^2 L)/2     L = of ds/rho     J = of s ds/rho = rho     K = of s rho ds = rho^3/3
    integral of p rho dA         = sum of h (p_C I/3 + (s_n h I + s_t K)/4)
    integral of p grad(rho) dA   = sum of n (p_C I + s_n h I + s_t K) - s (integral of rho dA)
    integral of p hess(rho) dA   = sum of (integral of p r/rho ds) n - (integral of r/rho dA) s

For torsion centres far from the joint, where these sums lose digits, the integrand is smooth and a Gauss rule is exact
to rounding.
"""

from math import log, pi, sqrt
from typing import NamedTuple

from numpy import ndarray

from dembrick._jit import jit
from dembrick.kernels.math.vectors import put_vector

FULL, EFFECTIVE, LINEAR, PATCHES = 0, 1, 2, 3  # the last is that of new contacts

# Beyond this many half diameters of the pressed part the Gauss rule below is exact to rounding.
FAR = 8.0
# A centre of pressure is limited to this part of the distance to the edge, and the pressed depth to at least THIN half
# diameters of the joint: even near contact along a line every integral remains one over an area.
EDGE = 1.0 - 1e-5
THIN = 1e-4
# Corners outside an edge by no more than this (in half diameters of the joint) count as on it.
_ON_EDGE = 1e-13
# Gauss rules of six and of three points from 0 to 1: nodes, weights. Three give the sums over a distant new contact
# to 1e-6.
SIX = (
    (
        0.03376524289842403, 0.16939530676686776, 0.38069040695840156,
        0.6193095930415985, 0.8306046932331322, 0.9662347571015759,
    ),
    (
        0.08566224618958514, 0.18038078652406936, 0.23395696728634552,
        0.23395696728634552, 0.18038078652406936, 0.08566224618958514,
    ),
)  # fmt: skip
THREE = (0.1127016653792583, 0.5, 0.8872983346207417), (5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0)


class Pressed(NamedTuple):
    """The pressed part of convex joints whose friction follows the bending, one polygon each; or the pieces of one new
    contact, one after the other (`contact_friction`). (u,) is room for the corners."""

    kind: ndarray  # (a,) int64, pressure: 0 full, 1 effective, 2 linear, 3 of a new contact
    pieces: ndarray  # (a,) int64, number of polygons from this one on that belong together
    start: ndarray  # (a,) int64, first corner of each
    count: ndarray  # (a,) int64, corners now
    x: ndarray  # (u,) m, corners about the centre of pressure along t1, counter-clockwise
    y: ndarray  # (u,) m, along t2
    spare_x: ndarray  # (u,) m, scratch for cutting
    spare_y: ndarray  # (u,) m
    centre: ndarray  # (a, 2) m, centre of pressure about O
    density: ndarray  # (a, 3) 1/m2, 1/m3: pressure over N at that centre, its slopes along t1 and t2
    reach: ndarray  # (a,) m, greatest corner distance from the centre of pressure
    radius: ndarray  # (a,) m, no more than the torsion strength over V_0


@jit
def edge_logarithm(h, sa, sb, ra, rb):
    """h L with L = integral of ds/rho along an edge at the distance ``h``, from s = ``sa`` (rho = ``ra``) to ``sb``.

    s + rho cancels for s < 0, where rho - s does not: (rho + s)(rho - s) = h^2. On the line of the edge itself h L ->
    0.
    """
    hh = h * h
    if hh > 1e-300 and ra > 0.0 and rb > 0.0:
        upper = sb + rb if sb > 0.0 else hh / (rb - sb)
        lower = sa + ra if sa > 0.0 else hh / (ra - sa)
        return h * log(upper / lower)
    return 0.0


@jit
def cut(room, first, count, nx, ny, d, slack):
    """Cut the convex polygon of ``count`` corners from ``first`` in ``room`` (x, y, spare_x, spare_y) to its part with
    nx x + ny y + d >= -slack; return its number of corners then."""
    x = room.x
    y = room.y
    least = d + nx * x[first] + ny * y[first]
    for i in range(first + 1, first + count):
        least = min(least, d + nx * x[i] + ny * y[i])
    if least >= -slack:
        return count
    kept = first
    xa = x[first + count - 1]
    ya = y[first + count - 1]
    da = d + nx * xa + ny * ya
    for i in range(first, first + count):
        xb = x[i]
        yb = y[i]
        db = d + nx * xb + ny * yb
        if (da < -slack) != (db < -slack):
            t = min(max(da / (da - db), 0.0), 1.0)
            room.spare_x[kept] = xa + t * (xb - xa)
            room.spare_y[kept] = ya + t * (yb - ya)
            kept += 1
        if db >= -slack:
            room.spare_x[kept] = xb
            room.spare_y[kept] = yb
            kept += 1
        xa, ya, da = xb, yb, db
    for i in range(first, kept):
        x[i] = room.spare_x[i]
        y[i] = room.spare_y[i]
    return kept - first


@jit
def place(pressed, a, polygon, e1, e2):
    """Copy the polygon, seen from e, to where the pressed part of joint ``a`` is computed; return its first corner
    there."""
    own = pressed.start[a]
    for i in range(polygon.first, polygon.last):
        pressed.x[own + i - polygon.first] = polygon.x[i] - e1
        pressed.y[own + i - polygon.first] = polygon.y[i] - e2
    pressed.centre[a, 0] = e1
    pressed.centre[a, 1] = e2
    return own


@jit
def cut_by_reflection(pressed, a, polygon, e1, e2, slack):
    """The pressed part by "effective": the intersection of the polygon with its reflection through e."""
    x = polygon.x
    y = polygon.y
    first = polygon.first
    last = polygon.last
    xa = x[last - 1]
    ya = y[last - 1]
    most = 0.0
    for i in range(first, last):  # position of e between O (0) and the edge (1)
        h = xa * y[i] - ya * x[i]
        most = max(most, (e1 * (y[i] - ya) - e2 * (x[i] - xa)) / h)
        xa = x[i]
        ya = y[i]
    if most > EDGE:
        e1 *= EDGE / most
        e2 *= EDGE / most
    own = place(pressed, a, polygon, e1, e2)
    count = last - first
    xa = x[last - 1] - e1
    ya = y[last - 1] - e2
    for i in range(first, last):
        xb = x[i] - e1
        yb = y[i] - e2
        ex = xb - xa
        ey = yb - ya
        length = sqrt(ex * ex + ey * ey)
        # inside the reflected edge: (ey, -ex) points out of the edge itself
        count = cut(pressed, own, count, ey / length, -ex / length, (xa * ey - ya * ex) / length, slack)
        xa = xb
        ya = yb
    pressed.count[a] = count
    put_vector(pressed.density[a], 1.0, 0.0, 0.0)


@jit
def cut_by_opening(pressed, a, polygon, e1, e2, depth, slack):
    """The pressed part by "linear": where the penetration ``depth``, g0 + gx x + gy y, is positive, with that as its
    pressure."""
    x = polygon.x
    y = polygon.y
    first = polygon.first
    last = polygon.last
    g0, gx, gy = depth
    size = polygon.reach
    slope = sqrt(gx * gx + gy * gy)
    most = g0 + gx * x[first] + gy * y[first]
    for i in range(first + 1, last):
        most = max(most, g0 + gx * x[i] + gy * y[i])
    if most < THIN * size * slope:
        g0 += THIN * size * slope - most
    own = place(pressed, a, polygon, e1, e2)
    g = g0 + gx * e1 + gy * e2
    count = last - first
    if slope > 0.0:
        count = cut(pressed, own, count, gx / slope, gy / slope, g / slope, slack)
    pressed.count[a] = count
    put_vector(pressed.density[a], g, gx, gy)


@jit
def follow_pressure(pressed, a, polygon, pressure, depth):
    """Update the pressed part of joint ``a`` for ``pressure``, N and its x and y moments (3), and ``depth``, the
    penetration g0 + gx x + gy y (3). Joints of full pressure and open ones are not changed."""
    n, nx, ny = pressure
    if pressed.kind[a] == FULL or n <= 0.0:
        return
    slack = _ON_EDGE * polygon.reach
    if pressed.kind[a] == EFFECTIVE:
        cut_by_reflection(pressed, a, polygon, nx / n, ny / n, slack)
    else:
        cut_by_opening(pressed, a, polygon, nx / n, ny / n, depth, slack)
    # by a fan of triangles from e: scale the integral of the density to one, and move the origin to the centre of the
    # pressure, which differs from e where the pressed depth was too thin
    own = pressed.start[a]
    end = own + pressed.count[a]
    density = pressed.density[a]
    total = m_x = m_y = greatest = 0.0
    xa = pressed.x[end - 1]
    ya = pressed.y[end - 1]
    pa = density[0] + density[1] * xa + density[2] * ya
    for i in range(own, end):
        xb = pressed.x[i]
        yb = pressed.y[i]
        pb = density[0] + density[1] * xb + density[2] * yb
        double = xa * yb - ya * xb
        mean = density[0] + pa + pb
        total += double * mean / 6.0
        m_x += double * (xa * (mean + pa) + xb * (mean + pb)) / 24.0
        m_y += double * (ya * (mean + pa) + yb * (mean + pb)) / 24.0
        greatest = max(greatest, pb)
        xa, ya, pa = xb, yb, pb
    m_x /= total
    m_y /= total
    pressed.centre[a, 0] += m_x
    pressed.centre[a, 1] += m_y
    density[0] = (density[0] + density[1] * m_x + density[2] * m_y) / total
    density[1] /= total
    density[2] /= total
    reach = 0.0
    for i in range(own, end):
        pressed.x[i] -= m_x
        pressed.y[i] -= m_y
        reach = max(reach, pressed.x[i] ** 2 + pressed.y[i] ** 2)
    pressed.reach[a] = sqrt(reach)
    # no density up to ``greatest`` has a smaller mean distance than a disc with that density
    pressed.radius[a] = 2.0 / 3.0 * sqrt(total / (pi * greatest))


@jit
def weighted_edge_sums(x, y, first, last, p0, px, py, c1, c2):
    """Integrals over a polygon with the weight p = p0 + px x + py y; rho is the distance from C = (c1, c2).

    Returns F = integral of p rho, B of p grad(rho) (2 values) and T of p hess(rho) (3 values: 11, 12, 22).
    """
    pc = p0 + px * c1 + py * c2
    f = whole = b1 = b2 = u1 = u2 = t11 = t12 = t22 = 0.0
    xa = x[last - 1] - c1
    ya = y[last - 1] - c2
    ra = sqrt(xa * xa + ya * ya)
    for i in range(first, last):
        xb = x[i] - c1
        yb = y[i] - c2
        rb = sqrt(xb * xb + yb * yb)
        ex = xb - xa
        ey = yb - ya
        length = sqrt(ex * ex + ey * ey)
        if length > 0.0:
            ex /= length
            ey /= length
            h = xa * ey - ya * ex
            sa = xa * ex + ya * ey
            sb = sa + length
            hl = edge_logarithm(h, sa, sb, ra, rb)
            difference = sb * rb - sa * ra
            e = 0.5 * (difference + h * hl)
            j = rb - ra
            k = (rb * rb * rb - ra * ra * ra) / 3.0
            # along the edge p is pn + pt s
            pn = pc + h * (px * ey - py * ex)
            pt = px * ex + py * ey
            f += h * (pc * e / 3.0 + ((pn - pc) * e + pt * k) / 4.0)
            whole += h * e / 3.0
            pushed = pn * e + pt * k
            b1 += ey * pushed
            b2 -= ex * pushed
            u1 += ey * e
            u2 -= ex * e
            # integral of p r/rho along the edge: its parts along the normal (ey, -ex) and along the edge
            across = pn * hl + pt * h * j
            along = pn * j + pt * 0.5 * (difference - h * hl)
            r1 = ey * across + ex * along
            r2 = ey * along - ex * across
            t11 += r1 * ey
            t12 -= r1 * ex
            t22 -= r2 * ex
        xa, ya, ra = xb, yb, rb
    return f, b1 - px * whole, b2 - py * whole, t11 - u1 * px, t12 - u1 * py, t22 - u2 * py


@jit
def gauss_sums(x, y, first, last, density, twist, rule):
    """D, its gradient and second derivatives about the polygon's origin by a Gauss ``rule`` (nodes, weights) on the fan
    of triangles, under the pressure ``density`` (3) for a ``twist`` (3).

    For torsion centres farther away than ``FAR`` half diameters. Returns D, V1, V2, M, H11, H12, H22, H13, H23, H33.
    """
    p0, px, py = density
    v1, v2, w = twist
    nodes, weights = rule
    d = g1 = g2 = g3 = h11 = h12 = h22 = h13 = h23 = h33 = 0.0
    xa = x[last - 1]
    ya = y[last - 1]
    for k in range(first, last):
        ex = x[k] - xa
        ey = y[k] - ya
        double = xa * ey - ya * ex
        for i in range(len(nodes)):
            r = nodes[i]
            for j in range(len(nodes)):
                rx = r * (xa + nodes[j] * ex)
                ry = r * (ya + nodes[j] * ey)
                weight = double * r * weights[i] * weights[j] * (p0 + px * rx + py * ry)
                s1 = v1 - w * ry
                s2 = v2 + w * rx
                speed = sqrt(s1 * s1 + s2 * s2)
                slow = weight / speed
                cube = slow / (speed * speed)
                k11 = cube * s2 * s2
                k12 = -cube * s1 * s2
                k22 = cube * s1 * s1
                k13 = k12 * rx - k11 * ry
                k23 = k22 * rx - k12 * ry
                d += weight * speed
                g1 += slow * s1
                g2 += slow * s2
                g3 += slow * (rx * s2 - ry * s1)
                h11 += k11
                h12 += k12
                h22 += k22
                h13 += k13
                h23 += k23
                h33 += k23 * rx - k13 * ry
        xa = x[k]
        ya = y[k]
    return d, g1, g2, g3, h11, h12, h22, h13, h23, h33


@jit
def pressed_surface(pressed, a, v1, v2, w):
    """D(q)/V_0 of contact ``a``, its gradient and second derivatives for the twist q = (v1, v2, w) != 0 about O.

    It presses on ``pressed.pieces[a]`` polygons, those from number ``a`` on.
    """
    e1 = pressed.centre[a, 0]
    e2 = pressed.centre[a, 1]
    x = pressed.x
    y = pressed.y
    v1 -= w * e2
    v2 += w * e1
    d = g1 = g2 = g3 = h11 = h12 = h22 = h13 = h23 = h33 = 0.0
    if sqrt(v1 * v1 + v2 * v2) > FAR * pressed.reach[a] * abs(w):
        for i in range(a, a + pressed.pieces[a]):
            first = pressed.start[i]
            p = pressed.density[i]
            last = first + pressed.count[i]
            if pressed.kind[a] == PATCHES:
                d_, g1_, g2_, g3_, h11_, h12_, h22_, h13_, h23_, h33_ = gauss_sums(
                    x, y, first, last, (p[0], p[1], p[2]), (v1, v2, w), THREE
                )
            else:
                d_, g1_, g2_, g3_, h11_, h12_, h22_, h13_, h23_, h33_ = gauss_sums(
                    x, y, first, last, (p[0], p[1], p[2]), (v1, v2, w), SIX
                )
            d += d_
            g1 += g1_
            g2 += g2_
            g3 += g3_
            h11 += h11_
            h12 += h12_
            h22 += h22_
            h13 += h13_
            h23 += h23_
            h33 += h33_
    else:
        c1 = -v2 / w
        c2 = v1 / w
        f = b1 = b2 = t11 = t12 = t22 = 0.0
        for i in range(a, a + pressed.pieces[a]):
            first = pressed.start[i]
            p = pressed.density[i]
            f_, b1_, b2_, t11_, t12_, t22_ = weighted_edge_sums(
                x, y, first, first + pressed.count[i], p[0], p[1], p[2], c1, c2
            )
            f += f_
            b1 += b1_
            b2 += b2_
            t11 += t11_
            t12 += t12_
            t22 += t22_
        sign = 1.0 if w > 0.0 else -1.0
        d = abs(w) * f
        g1 = -sign * b2
        g2 = sign * b1
        g3 = sign * (f + c1 * b1 + c2 * b2)
        # as in `limit_surface.surface`
        h11 = t22 / abs(w)
        h12 = -t12 / abs(w)
        h22 = t11 / abs(w)
        h13 = h11 * -c2 + h12 * c1
        h23 = h12 * -c2 + h22 * c1
        h33 = h13 * -c2 + h23 * c1
    # from e to O
    g3 += e1 * g2 - e2 * g1
    h33 += 2.0 * (e1 * h23 - e2 * h13) + e2 * e2 * h11 - 2.0 * e1 * e2 * h12 + e1 * e1 * h22
    h13 += e1 * h12 - e2 * h11
    h23 += e1 * h22 - e2 * h12
    return d, g1, g2, g3, h11, h12, h22, h13, h23, h33
