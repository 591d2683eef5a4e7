"""The scalar laws: Coulomb friction at a contact point and the no-tension integral over a polygon.

Sign of all shear quantities: the action on block b, which is also the direction in which b slips. The joint pushes
back on b with the opposite.
"""

from math import sqrt

from dembrick._jit import jit


@jit
def coulomb(elastic_1, elastic_2, slip_1, slip_2, k, viscous, cap):
    """Radial return of one contact point; spring and dashpot in parallel, both behind the slider.

    ``slip_*``: increment of the relative displacement (m); ``k`` N/m; ``viscous``: dashpot force over spring force for
    the same increment; ``cap`` = mu N (N). Returns whether the point slides, the shear force (2), the elastic part of
    it that stays (2) and the length of the plastic increment (m), which points along the force. For the books also what
    that increment was per unit of the trial force (m/N) and the trial force times the elastic force before (N2): their
    product is the work of the latter on the increment.
    """
    t1 = elastic_1 + k * (1.0 + viscous) * slip_1
    t2 = elastic_2 + k * (1.0 + viscous) * slip_2
    size = sqrt(t1 * t1 + t2 * t2)
    share = 1.0 / (1.0 + viscous)
    plastic = loose = along = 0.0
    slides = size > cap
    if slides:
        inverse = 1.0 / (k * size)  # divisions are what takes time here
        kept = cap * k * inverse
        loose = (size - cap) * share * inverse
        along = elastic_1 * t1 + elastic_2 * t2
        plastic = loose * size
        t1 *= kept
        t2 *= kept
    e1 = elastic_1 + share * (t1 - elastic_1)
    e2 = elastic_2 + share * (t2 - elastic_2)
    return slides, t1, t2, e1, e2, plastic, loose, along


@jit
def pressed_part(xa, ya, ga, xb, yb, gb):
    """The part of an edge from a to b where the penetration g, linear along it, is positive: both ends with their g."""
    if ga < 0.0:
        s = ga / (ga - gb)
        return xa + s * (xb - xa), ya + s * (yb - ya), 0.0, xb, yb, gb
    if gb < 0.0:
        s = ga / (ga - gb)
        return xa, ya, ga, xa + s * (xb - xa), ya + s * (yb - ya), 0.0
    return xa, ya, ga, xb, yb, gb


@jit
def no_tension(x, y, first, last, g0, gx, gy):
    """Integrals over a polygon of <g>+, x <g>+ and y <g>+ for the linear penetration g = g0 + gx x + gy y.

    Exact: a fan of triangles from a point of the line g = 0, so that the cut itself adds nothing. The polygon
    ``x[first:last], y[first:last]`` runs counter-clockwise and must not be closed everywhere.
    """
    slope = gx * gx + gy * gy
    if slope == 0.0:
        return 0.0, 0.0, 0.0
    x0 = -g0 * gx / slope
    y0 = -g0 * gy / slope
    volume = moment_x = moment_y = 0.0
    xa = x[last - 1]
    ya = y[last - 1]
    ga = g0 + gx * xa + gy * ya
    for i in range(first, last):
        xb = x[i]
        yb = y[i]
        gb = g0 + gx * xb + gy * yb
        if ga > 0.0 or gb > 0.0:
            px, py, pg, qx, qy, qg = pressed_part(xa, ya, ga, xb, yb, gb)
            double = (px - x0) * (qy - y0) - (py - y0) * (qx - x0)
            volume += double * (pg + qg) / 6.0
            total = pg + qg
            moment_x += double * (pg * px + qg * qx + total * (x0 + px + qx)) / 24.0
            moment_y += double * (pg * py + qg * qy + total * (y0 + py + qy)) / 24.0
        xa, ya, ga = xb, yb, gb
    return volume, moment_x, moment_y


@jit
def met(g, ahead, viscous):
    """What the dashpot adds to the penetration ``g`` where contact began within the last step; ``ahead`` is viscous
    times the whole closing d of that step.

    A force stands for half a step on either side of its moment. Contact has lasted for g / d of the step behind, so the
    dashpot acts on g + d / 2. Without that a bounce depends by a tenth and more on where in a step it begins.
    """
    return viscous * g + 0.5 * ahead
