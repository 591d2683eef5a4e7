"""The no-tension integral: exact integral of the positive part of a linear function over a polygon; its derivatives."""

from dembrick._jit import jit

SIXTH = 1.0 / 6.0  # a division takes as long as ten sums
QUARTER_SIXTH = 0.25 * SIXTH


@jit
def pressed_part(xa, ya, ga, xb, yb, gb):
    """The part of the edge from a to b where the penetration g, linear along it, is positive: both its ends with their
    g.

    An edge is cut only between ends of opposite signs: at a corner that just touches, g may be negative by rounding.
    """
    if ga < 0.0 < gb:
        s = ga / (ga - gb)
        return xa + s * (xb - xa), ya + s * (yb - ya), 0.0, xb, yb, gb
    if gb < 0.0 < ga:
        s = ga / (ga - gb)
        return xa, ya, ga, xa + s * (xb - xa), ya + s * (yb - ya), 0.0
    return xa, ya, ga, xb, yb, gb


@jit
def extremes(x, y, first, last, g0, gx, gy):
    """Least and greatest g0 + gx x + gy y over the corners ``first`` to ``last`` - 1 of a polygon."""
    least = most = g0 + gx * x[first] + gy * y[first]
    for i in range(first + 1, last):
        g = g0 + gx * x[i] + gy * y[i]
        least = min(least, g)
        most = max(most, g)
    return least, most


@jit
def no_tension(x, y, first, last, least, g0, gx, gy):
    """Integrals over a polygon of <g>+, x <g>+ and y <g>+ for the linear penetration g = g0 + gx x + gy y.

    The polygon ``x[first:last], y[first:last]`` runs counter-clockwise; ``least``: the least g at its corners. Sum over
    a fan of triangles from the origin if g is nowhere negative, else from a point of the line g = 0, so that the cut
    itself contributes nothing.
    """
    x0 = y0 = 0.0
    apex = g0
    if least < 0.0:
        slope = gx * gx + gy * gy
        if slope == 0.0:
            return 0.0, 0.0, 0.0
        away = -g0 / slope
        x0 = away * gx
        y0 = away * gy
        apex = 0.0
    volume = moment_x = moment_y = 0.0
    xa = x[last - 1]
    ya = y[last - 1]
    ga = g0 + gx * xa + gy * ya
    for i in range(first, last):
        xb = x[i]
        yb = y[i]
        gb = g0 + gx * xb + gy * yb
        if ga > 0.0 or gb > 0.0 or least >= 0.0:
            px, py, pg, qx, qy, qg = pressed_part(xa, ya, ga, xb, yb, gb)
            double = (px - x0) * (qy - y0) - (py - y0) * (qx - x0)
            total = apex + pg + qg
            volume += double * total
            moment_x += double * (apex * x0 + pg * px + qg * qx + total * (x0 + px + qx))
            moment_y += double * (apex * y0 + pg * py + qg * qy + total * (y0 + py + qy))
        xa, ya, ga = xb, yb, gb
    return SIXTH * volume, QUARTER_SIXTH * moment_x, QUARTER_SIXTH * moment_y


@jit
def fan_of_edge(ax, ay, ga, bx, by, gb):
    """Six times the integral of g, and 24 times those of x g and y g, over the triangle between a point of the line
    g = 0, the origin of a and b, and the part of the edge from a to b where g is positive."""
    opens = (gb < 0.0) & (ga > 0.0)
    closes = (ga < 0.0) & (gb > 0.0)
    s = ga / (ga - gb if opens | closes else 1.0)
    low = s if closes else 0.0
    high = s if opens else 1.0
    double = (high - low) * (ax * by - ay * bx)
    p = double * max(ga, 0.0)
    q = double * max(gb, 0.0)
    ex = bx - ax
    ey = by - ay
    px = ax + low * ex
    py = ay + low * ey
    qx = ax + high * ex
    qy = ay + high * ey
    return p + q, p * (2.0 * px + qx) + q * (px + 2.0 * qx), p * (2.0 * py + qy) + q * (py + 2.0 * qy)


@jit
def no_tension_of_four(x, y, g, g0, gx, gy):
    """`no_tension` of a polygon of four corners ``x``, ``y``, at which the penetration is ``g``, somewhere negative.

    Without a branch, so that many are evaluated side by side.
    """
    slope = gx * gx + gy * gy
    away = -g0 / (slope if slope > 0.0 else 1.0)
    x0 = away * gx
    y0 = away * gy
    ax = x[0] - x0
    ay = y[0] - y0
    bx = x[1] - x0
    by = y[1] - y0
    cx = x[2] - x0
    cy = y[2] - y0
    dx = x[3] - x0
    dy = y[3] - y0
    v0, mx0, my0 = fan_of_edge(ax, ay, g[0], bx, by, g[1])
    v1, mx1, my1 = fan_of_edge(bx, by, g[1], cx, cy, g[2])
    v2, mx2, my2 = fan_of_edge(cx, cy, g[2], dx, dy, g[3])
    v3, mx3, my3 = fan_of_edge(dx, dy, g[3], ax, ay, g[0])
    volume = SIXTH * ((v0 + v1) + (v2 + v3))
    moment_x = QUARTER_SIXTH * ((mx0 + mx1) + (mx2 + mx3)) + x0 * volume
    moment_y = QUARTER_SIXTH * ((my0 + my1) + (my2 + my3)) + y0 * volume
    return volume, moment_x, moment_y


@jit
def pressed_moments(x, y, first, last, g0, gx, gy):
    """Integrals of 1, x, y, y^2, x^2 and x y over the part of a polygon where g = g0 + gx x + gy y is positive.

    They are the derivatives of the integrals of `no_tension` with respect to g0, gx and gy: motion of the line g = 0
    adds nothing, as g is zero there. gx and gy must not both be zero; the fan starts on the line g = 0 as in
    `no_tension`.
    """
    slope = gx * gx + gy * gy
    x0 = -g0 * gx / slope
    y0 = -g0 * gy / slope
    area = mx = my = myy = mxx = mxy = 0.0
    xa = x[last - 1]
    ya = y[last - 1]
    ga = g0 + gx * xa + gy * ya
    for i in range(first, last):
        xb = x[i]
        yb = y[i]
        gb = g0 + gx * xb + gy * yb
        if ga > 0.0 or gb > 0.0:
            px, py, _, qx, qy, _ = pressed_part(xa, ya, ga, xb, yb, gb)
            double = (px - x0) * (qy - y0) - (py - y0) * (qx - x0)
            sx = x0 + px + qx
            sy = y0 + py + qy
            area += double / 2.0
            mx += double * sx / 6.0
            my += double * sy / 6.0
            myy += double * (sy * sy + y0 * y0 + py * py + qy * qy) / 24.0
            mxx += double * (sx * sx + x0 * x0 + px * px + qx * qx) / 24.0
            mxy += double * (sx * sy + x0 * y0 + px * py + qx * qy) / 24.0
        xa, ya, ga = xb, yb, gb
    return area, mx, my, myy, mxx, mxy
