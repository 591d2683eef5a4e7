"""Convex joints side by side, in real time: their arrays, and the transfer between them and the rows of a tile."""

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy import ndarray

from dembrick._jit import jit
from dembrick.kernels.dynamics.tiles import (
    FOUR,
    W,
    alike,
    in_lanes,
    of_joints,
    put_in_lanes,
    put_three,
    record,
    set_apart,
)
from dembrick.kernels.joint.point_law import Strengths
from dembrick.kernels.joint.pressure import Pressed

# Constants of a convex joint
FACE = record(
    ("k_n", 1),  # Pa/m, stiffness along the normal
    ("k_s", 1),  # Pa/m, in shear
    ("friction", 1),
    ("area", 1),  # m2
    ("second", 3),  # m4, integrals of y^2, x^2, x y about O, the centroid
    ("negligible", 1),  # N, friction strength up to which the limit surface need not be exact
    ("reach", 1),  # m, greatest distance of a vertex from O
    ("radius", 1),  # m, torsion strength over V_0
)
# N, N, N m, elastic shear in the sense in which the host slips, polygon axes
SHEARED = record(("elastic", 3))


class FaceBonds(NamedTuple):
    """Memory of convex joints with strengths."""

    bonded: ndarray  # (a,) 1 while the bond holds, else 0
    rise: ndarray  # (a,) m, by dilation


class Faces(NamedTuple):
    """Convex joints, in the order of their blocks in the loop. Equal polygons share their vertices and their series; a
    joint that was cut has its own."""

    joint: ndarray  # (a,) uint32
    tile: ndarray  # (t,) int64, the tile of `Links` of each tile of these joints
    lane: ndarray  # (t, W) uint32, which of the a joints each lane has; spare lanes repeat the last one
    used: ndarray  # (t,) int64, lanes that are not spare
    outline: ndarray  # (a,) uint32, which polygon: a row of `count`, `x`, `y` and `far`
    place: ndarray  # (a,) uint32, its lane: that of its tile, plus W times the tile among those of these joints
    like: ndarray  # (t,) uint32, the tile of ``tiles`` that the loop reads in place of each: see `alike`
    tiles: ndarray  # (t,) records `FACE`
    sheared: ndarray  # (t,) records `SHEARED`
    twist: ndarray  # (a, 3) m, m, rad, last plastic twist
    slip: ndarray  # (a,) m, length of the slip path
    count: ndarray  # (o,) int64, vertices of each polygon
    x: ndarray  # (o, v) m, vertices from O along e1, counter-clockwise about e1 x e2; v is four or more
    y: ndarray  # (o, v) m, along e2
    far: ndarray  # (o, 42) series of the limit surface about pure translation
    pressed: Pressed | None  # None if all pressures are full
    strengths: Strengths | None = None  # besides friction; None if no joint has any
    bonds: FaceBonds | None = None  # None if ``strengths`` is

    def field(self, name: str, joints=slice(None)) -> ndarray:
        """A copy of a field of `FACE`, (k, rows) or (k,) if it is one row; of a single joint (rows,) or a number."""
        return in_lanes(self.tiles, name, self.place[joints])

    def put(self, field: str, values, joints=slice(None)) -> None:
        """Write a field of `FACE`: values (k, rows), or (k,) if it is one row."""
        set_apart(self.like, self.place[joints] // W)
        put_in_lanes(self.tiles, field, self.place[joints], np.asarray(values, float))

    def share(self) -> None:
        """Let tiles that are the same to the last bit share the rows of one of them."""
        self.like[:] = alike(self.tiles)

    k_n = of_joints("k_n", "(a,) Pa/m, along the normal")
    k_s = of_joints("k_s", "(a,) Pa/m, in shear")
    friction = of_joints("friction", "(a,)")
    area = of_joints("area", "(a,) m2")
    second = of_joints("second", "(a, 3) m4, integrals of y^2, x^2, x y about O, the centroid")
    reach = of_joints("reach", "(a,) m, greatest distance of a vertex from O")
    radius = of_joints("radius", "(a,) m, torsion strength over V_0")

    @property
    def elastic(self) -> ndarray:
        """(a, 3) N, N, N m, in the sense in which the host slips, polygon axes; `put_elastic` writes it."""
        return in_lanes(self.sheared, "elastic", self.place)

    def put_elastic(self, values, joints=slice(None)) -> None:
        """Write `elastic` of joints."""
        put_in_lanes(self.sheared, "elastic", self.place[joints], values)


@jit
def fetch_corners(faces, t, work):
    """Copy the first four vertices of the joints in their tile ``t`` into ``work``."""
    for lane in range(W):
        outline = faces.outline[faces.lane[t, lane]]
        x = faces.x[outline]
        y = faces.y[outline]
        for i in range(FOUR):
            work.corner_x[i, lane] = x[i]
            work.corner_y[i, lane] = y[i]


@jit
def put_force(work, lane, cosine, sine, pressure, shear):
    """Store the input of `resultant`: N and its moments, shear and torsion in the polygon's axes."""
    n, nx, ny = pressure
    t1, t2, tm = shear
    put_three(work.force, lane, (sine * t2 - cosine * t1, -(sine * t1 + cosine * t2), n))
    put_three(work.x_force, lane, (0.0, 0.0, nx))
    put_three(work.y_force, lane, (0.0, 0.0, ny))
    work.twisting[lane] = -tm


@jit
def in_polygon_axes(seen, lane, p1, p2):
    """A slip in the plane's axes, expressed in the polygon's; and cosine and sine of the angle between them."""
    c1 = seen.first[0, lane]
    c2 = seen.first[1, lane]
    scale = 1.0 / sqrt(c1 * c1 + c2 * c2)
    cosine = c1 * scale
    sine = c2 * scale
    return cosine * p1 + sine * p2, cosine * p2 - sine * p1, cosine, sine
