"""Convex joints side by side, in real time: their arrays, and what goes between them and the rows of a tile."""

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy import ndarray

from dembrick._jit import jit
from dembrick.kernels.dynamics.tiles import (
    CORNERS,
    FIRST,
    FORCE,
    FOUR,
    TWISTING,
    W,
    alike,
    put_three,
    rows_named,
    set_apart,
    where_in,
)
from dembrick.kernels.joint.point_law import Strengths
from dembrick.kernels.joint.pressure import Pressed

# Rows of a tile of `Faces.tiles`, which no step changes: stiffness along the normal and in shear (Pa/m); friction; area
# (m2); integrals of y^2, x^2, x y about O, the centroid (m4); friction strength up to which the limit surface need not
# be the exact one (N); greatest distance of a vertex from O (m); torsion strength over V_0 (m)
K_N, K_S, MU, AREA, SECOND, NEGLIGIBLE, REACH, RADIUS = 0, 1, 2, 3, 4, 7, 8, 9
FACE = 10 * W
ELASTIC = 3 * W  # rows of a tile of `Faces.sheared`


class FaceBonds(NamedTuple):
    """What convex joints with strengths remember."""

    bonded: ndarray  # (a,) 1 while the bond holds, else 0
    rise: ndarray  # (a,) m, by dilation


class Faces(NamedTuple):
    """Convex joints, in the order of their blocks in the loop. Equal polygons share their vertices and their series; a
    joint that was cut has its own."""

    joint: ndarray  # (a,) uint32
    tile: ndarray  # (t,) int64, which tile of `Links` each tile of these joints is
    lane: ndarray  # (t, W) uint32, which of the a joints each lane has; the last one again where there are no more
    used: ndarray  # (t,) int64, lanes that have one of their own
    outline: ndarray  # (a,) uint32, which polygon: a row of `count`, `x`, `y` and `far`
    place: ndarray  # (a,) uint32, its lane: that of its tile, plus W times the tile among those of these joints
    like: ndarray  # (t,) uint32, the tile of ``tiles`` that the loop reads in place of each: see `alike`
    tiles: ndarray  # (t * FACE,) see above
    sheared: ndarray  # (t * ELASTIC,) N, N, N m, elastic shear in the sense in which the host slips, polygon axes
    twist: ndarray  # (a, 3) m, m, rad, last plastic twist
    slip: ndarray  # (a,) m, length of the slip path
    count: ndarray  # (o,) int64, vertices of each polygon
    x: ndarray  # (o, v) m, vertices from O along e1, counter-clockwise about e1 x e2; v is four or more
    y: ndarray  # (o, v) m, along e2
    far: ndarray  # (o, 42) series of the limit surface about pure translation
    pressed: Pressed | None  # None if all pressures are full
    strengths: Strengths | None = None  # beside friction; None if no joint has any
    bonds: FaceBonds | None = None  # None if ``strengths`` is

    def rows(self, first: int, count: int, joints=slice(None)) -> ndarray:
        """A copy (k, count) of rows that stand in tiles; (count,) for a single joint."""
        found = self.tiles[where_in(self.place, FACE, first, count, joints)]
        found.flags.writeable = False  # who writes into it means `put`
        return found

    def put(self, first: int, values, joints=slice(None)) -> None:
        """Write rows: values (k, count); (count,) for a single joint."""
        values = np.asarray(values, float)
        set_apart(self.like, self.place[joints] // W)
        self.tiles[where_in(self.place, FACE, first, values.shape[-1], joints)] = values

    def share(self) -> None:
        """Let tiles that are the same to the last bit take their rows from one of them."""
        self.like[:] = alike(self.tiles.reshape(-1, FACE))

    k_n = rows_named(K_N, 1, "(a,) Pa/m, along the normal")
    k_s = rows_named(K_S, 1, "(a,) Pa/m, in shear")
    area = rows_named(AREA, 1, "(a,) m2")
    second = rows_named(SECOND, 3, "(a, 3) m4, integrals of y^2, x^2, x y about O, the centroid")
    reach = rows_named(REACH, 1, "(a,) m, greatest distance of a vertex from O")
    radius = rows_named(RADIUS, 1, "(a,) m, torsion strength over V_0")

    @property
    def elastic(self) -> ndarray:
        """(a, 3) N, N, N m, in the sense in which the host slips, polygon axes; `put_elastic` writes it."""
        found = self.sheared[where_in(self.place, ELASTIC, 0, 3)]
        found.flags.writeable = False
        return found

    def put_elastic(self, values, joints=slice(None)) -> None:
        """Write `elastic` of joints."""
        self.sheared[where_in(self.place, ELASTIC, 0, 3, joints)] = values


@jit
def fetch_corners(faces, t, work):
    """Bring the first four vertices of the joints in their tile ``t`` into ``work``."""
    for lane in range(W):
        outline = faces.outline[faces.lane[t, lane]]
        x = faces.x[outline]
        y = faces.y[outline]
        for i in range(FOUR):
            work[(CORNERS + i) * W + lane] = x[i]
            work[(CORNERS + FOUR + i) * W + lane] = y[i]


@jit
def put_force(work, lane, cosine, sine, n, nx, ny, t1, t2, tm):
    """Write down what `resultant` makes a wrench of: N and its moments, shear and torsion in the polygon's axes."""
    put_three(work, FORCE, lane, (sine * t2 - cosine * t1, -(sine * t1 + cosine * t2), n))
    put_three(work, FORCE + 3, lane, (0.0, 0.0, nx))
    put_three(work, FORCE + 6, lane, (0.0, 0.0, ny))
    work[TWISTING * W + lane] = -tm


@jit
def in_polygon_axes(seen, lane, p1, p2):
    """A slip in the plane's axes in those of the polygon, and cosine and sine of the angle between them."""
    c1 = seen[FIRST * W + lane]
    c2 = seen[(FIRST + 1) * W + lane]
    scale = 1.0 / sqrt(c1 * c1 + c2 * c2)
    cosine = c1 * scale
    sine = c2 * scale
    return cosine * p1 + sine * p2, cosine * p2 - sine * p1, cosine, sine
