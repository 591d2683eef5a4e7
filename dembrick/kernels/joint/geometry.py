"""Arguments of the laws of joints: the polygon of a joint, and the relative motion of its blocks."""

from typing import NamedTuple

from numpy import ndarray

from dembrick._jit import jit

CLOSED = 1e-3  # part of the fastest relative motion of a step below which gaps and their closing count as zero


class Polygon(NamedTuple):
    """A convex polygon about its centroid O, counter-clockwise."""

    x: ndarray  # (v,) m, along t1, corners of this and maybe other polygons
    y: ndarray  # (v,) m, along t2
    first: int  # corner
    last: int  # corner, and one more
    area: float  # m2
    second: tuple[float, float, float] | None  # m4, integrals of y^2, x^2, x y; None if no pressure is needed
    reach: float  # m, greatest distance of a corner from O


class Motion(NamedTuple):
    """Relative motion of the blocks of a joint at O, in its axes; slip is that of b against a (in dynamics, of the
    host against the other)."""

    depth: tuple[float, float, float]  # m, rad, rad: penetration g0 + gx x + gy y at the point (x, y)
    growth: tuple[float, float, float]  # its growth in the step
    slip: tuple[float, float, float]  # m, m, rad, of the step


@jit
def gap_closes(x, y, first, last, gap, base, u):
    """Whether a joint that is open at any of its points or corners ``first`` to ``last`` - 1 closes further there,
    between the motions ``base`` and ``u`` = (d1, d2, dn, r1, r2, rn); ``gap`` (m): between the faces at the start."""
    dn = u[2] - base[2]
    r1 = u[3] - base[3]
    r2 = u[4] - base[4]
    fastest = max(abs(u[0] - base[0]), abs(u[1] - base[1]))
    for i in range(first, last):
        fastest = max(fastest, abs(dn + r1 * y[i] - r2 * x[i]))
    for i in range(first, last):
        opening = u[2] + gap + u[3] * y[i] - u[4] * x[i]
        if opening > CLOSED * fastest and dn + r1 * y[i] - r2 * x[i] < -CLOSED * fastest:
            return True
    return False
