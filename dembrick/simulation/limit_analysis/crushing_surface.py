"""The normal forces of an area joint that crushes, by their support function: N, M_1, M_2 of pressures up to f_c.

A pressure between 0 and f_c on a polygon of area A has the resultant f = (N, integral of p r). If the joint closes at
the speed l(r) = q . (1, r), it does at most the work f_c A <l>, the mean of the positive part of l times f_c A, and f
can be carried if q . f <= f_c A <l> for every q. The set is its own mirror image in f_c A (1, O) / 2, the uniform
pressure of half the strength; seen from there the support function of g = 2 f / (f_c A) - (1, O) is the mean of |l|, a
norm. Where nothing crushes it is the cone of the corners, which stays in the programme.

Means in closed form, edge by edge: the line l = 0 cuts the polygon, and triangles between a point of that line and what
the edges have above it make up the pressed part. O is the centroid.
"""

from __future__ import annotations

import numpy as np

from dembrick.simulation.limit_analysis.strength import Areas
from dembrick.simulation.limit_analysis.support_function import SupportFunction, by_corners, corners_of

_DIRECTIONS, _DEPTHS = 8, (-0.8, 0.0, 0.8)  # of the first planes; depths in gyrations


class PressedPolygons(SupportFunction):
    """The means of |l| of some area joints; the ellipsoid is that of the mean square."""

    def __init__(self, corner: np.ndarray):
        self.corner = corner
        following = np.roll(corner, -1, axis=1)
        cross = corner[..., 0] * following[..., 1] - corner[..., 1] * following[..., 0]
        self.area = 0.5 * cross.sum(axis=1)
        second = np.einsum("ke,kei,kej->kij", cross, corner, corner + 0.5 * following) / 12.0
        second += np.einsum("ke,kei,kej->kij", cross, following, following + 0.5 * corner) / 12.0
        self.ellipsoid = np.zeros((len(corner), 3, 3))  # mean of (1, r) (1, r)^T
        self.ellipsoid[:, 0, 0] = 1.0
        self.ellipsoid[:, 1:, 1:] = 0.5 * (second + second.transpose(0, 2, 1)) / self.area[:, None, None]

    @classmethod
    def of_joints(cls, areas: Areas, chosen: np.ndarray) -> PressedPolygons:
        return cls(corners_of(areas, chosen))

    def of(self, at: np.ndarray) -> PressedPolygons:
        some = object.__new__(PressedPolygons)
        some.corner, some.area, some.ellipsoid = self.corner[at], self.area[at], self.ellipsoid[at]
        return some

    def speed(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The mean of |l| (k,), its gradient (k, 3) and its Hessian (k, 3, 3) at planes q (k, 3)."""
        height = q[:, :1] + np.einsum("kei,ki->ke", self.corner, q[:, 1:])
        sign = np.sign(q[:, 0])
        gradient, hessian = np.zeros_like(q), np.zeros((len(q), 3, 3))
        gradient[:, 0] = sign
        cut = np.flatnonzero((height.min(axis=1) < 0.0) & (height.max(axis=1) > 0.0))
        if len(cut):
            gradient[cut], hessian[cut] = self.of(cut)._where_cut(q[cut], height[cut])
        return (gradient * q).sum(axis=1), gradient, hessian

    def _where_cut(self, q: np.ndarray, height: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gradient and Hessian where the line l = 0 crosses the polygon."""
        steep = np.hypot(q[:, 1], q[:, 2])
        up = q[:, 1:] / steep[:, None]
        along = np.stack([-up[:, 1], up[:, 0]], axis=1)
        foot = -(q[:, 0] / steep)[:, None] * up  # of O on the line
        start, end = self.corner - foot[:, None], np.roll(self.corner, -1, axis=1) - foot[:, None]
        low, high = height, np.roll(height, -1, axis=1)
        crosses = (low < 0.0) != (high < 0.0)
        share = np.divide(low, low - high, out=np.zeros_like(low), where=crosses)
        crossing = start + share[..., None] * (end - start)
        a = np.where((low < 0.0)[..., None], crossing, start)
        b = np.where((high < 0.0)[..., None], crossing, end)
        double = np.where((low < 0.0) & (high < 0.0), 0.0, a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
        above = 0.5 * double.sum(axis=1) / self.area
        moment = (double[..., None] * (a + b)).sum(axis=1) / (6.0 * self.area[:, None]) + above[:, None] * foot
        gradient = 2.0 * np.concatenate([above[:, None], moment], axis=1)
        gradient[:, 0] -= 1.0
        # integrals of 1, t, t^2 along the line inside the polygon
        t = np.einsum("kei,ki->ke", crossing, along)
        side = np.where(crosses, np.where(low < 0.0, -1.0, 1.0), 0.0)
        i0, i1, i2 = ((side * t ** (n + 1)).sum(axis=1) / (n + 1) for n in (0, 1, 2))
        at = np.concatenate([np.ones((len(q), 1)), foot], axis=1)
        way = np.concatenate([np.zeros((len(q), 1)), along], axis=1)
        mixed = at[:, :, None] * way[:, None, :]
        hessian = i0[:, None, None] * at[:, :, None] * at[:, None, :]
        hessian += i1[:, None, None] * (mixed + mixed.transpose(0, 2, 1))
        hessian += i2[:, None, None] * way[:, :, None] * way[:, None, :]
        return gradient, 2.0 * hessian / (steep * self.area)[:, None, None]


def first_planes(areas: Areas, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Planes to begin with: places in ``chosen`` (c,), and q (c, 3), scaled to a mean |l| of 1: the whole joint, and
    parts of it on one side of a line."""
    angle = 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    q = [(1.0, 0.0, 0.0)]
    q += [(depth, x, y) for x, y in zip(np.cos(angle), np.sin(angle), strict=True) for depth in _DEPTHS]
    owners, planes = [np.zeros(0, np.int64)], [np.zeros((0, 3))]
    for places, polygons in by_corners(PressedPolygons, areas, chosen):
        for plane in q:
            each = np.tile(np.array(plane), (len(places), 1))
            owners.append(places)
            planes.append(each / polygons.speed(each)[0][:, None])
    return np.concatenate(owners), np.concatenate(planes)
