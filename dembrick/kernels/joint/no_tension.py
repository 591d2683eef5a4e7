"""The no-tension integral: of the positive part of a linear function over a polygon, exact; and its derivatives."""

from dembrick._jit import jit


@jit
def pressed_part(xa, ya, ga, xb, yb, gb):
    """The part of an edge from a to b where the penetration g, linear along it, is positive: both ends with their g.

    An edge is cut only between ends of opposite signs: a corner that just touches may be negative by rounding.
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
    """Least and greatest g0 + gx x + gy y over the corners ``first`` to ``last`` of a polygon."""
    least = most = g0 + gx * x[first] + gy * y[first]
    for i in range(first + 1, last):
        g = g0 + gx * x[i] + gy * y[i]
        least = min(least, g)
        most = max(most, g)
    return least, most


@jit
def no_tension(x, y, first, last, least, g0, gx, gy):
    """Integrals over a polygon of <g>+, x <g>+ and y <g>+ for the linear penetration g = g0 + gx x + gy y.

    The polygon ``x[first:last], y[first:last]`` runs counter-clockwise; ``least``: the least g at its corners. A fan of
    triangles from the origin if g is nowhere negative, else from a point of the line g = 0, so that the cut itself adds
    nothing.
    """
    x0 = y0 = 0.0
    apex = g0
    if least < 0.0:
        slope = gx * gx + gy * gy
        if slope == 0.0:
            return 0.0, 0.0, 0.0
        x0 = -g0 * gx / slope
        y0 = -g0 * gy / slope
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
            volume += double * total / 6.0
            moment_x += double * (apex * x0 + pg * px + qg * qx + total * (x0 + px + qx)) / 24.0
            moment_y += double * (apex * y0 + pg * py + qg * qy + total * (y0 + py + qy)) / 24.0
        xa, ya, ga = xb, yb, gb
    return volume, moment_x, moment_y


@jit
def pressed_moments(x, y, first, last, g0, gx, gy):
    """Integrals of 1, x, y, y^2, x^2 and x y over the part of a polygon where g = g0 + gx x + gy y is positive.

    They are the derivatives of the integrals of `no_tension` with respect to g0, gx and gy: where g is zero its part
    grows by nothing. For gx, gy that are not both zero; the fan starts on the line g = 0 as there.
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
