"""What the laws of joints take: the polygon of a joint, and the motion that it sees."""

from typing import NamedTuple

from numpy import ndarray


class Polygon(NamedTuple):
    """A convex polygon about its centroid O, counter-clockwise."""

    x: ndarray  # (v,) m, along t1, corners of this and maybe other polygons
    y: ndarray  # (v,) m, along t2
    first: int  # corner
    last: int  # corner, and one more
    area: float  # m2
    second: tuple[float, float, float] | None  # m4, integrals of y^2, x^2, x y; None if no pressure is asked for
    reach: float  # m, greatest distance of a corner from O


class Motion(NamedTuple):
    """What a joint sees of the motion of its blocks at O, in its axes; slip is that of b against a (in dynamics, of the
    host against the other)."""

    depth: tuple[float, float, float]  # m, rad, rad: penetration g0 + gx x + gy y at the point (x, y)
    growth: tuple[float, float, float]  # what it grew by in the step
    slip: tuple[float, float, float]  # m, m, rad, of the step
