"""The friction of an area joint by its support function: mean slip speed of a polygon, and the gauge of a force.

For a slip twist q = (v1, v2, w) about O the friction of uniform pressure dissipates V_0 D_1(q), where D_1 is the mean
of |v + w x r| over the polygon: the support function of the forces (V_1, V_2, M_T / gyration) / V_0 that it can carry.

D_1 in closed form: each edge spans a signed triangle with the torsion centre C; h is its distance from C, s runs
along it, rho = hypot(h, s). If C is far from the joint these sums cancel, and the series about pure translation is used
instead (`friction_integrals.far_moments`): without it, cuts near pure translation are wrong by more than they cut off.

The normal forces of an area joint that crushes have a support function, too: N, M_1, M_2 of pressures up to f_c.

A pressure between 0 and f_c on a polygon of area A has the resultant f = (N, integral of p r). If the joint closes at
the speed l(r) = q . (1, r), its work is at most f_c A <l>, with <l> the mean of the positive part of l, and f
can be carried if q . f <= f_c A <l> for every q. The set is point-symmetric about f_c A (1, O) / 2, the uniform
pressure of half the strength; relative to it the support function of g = 2 f / (f_c A) - (1, O) is the mean of |l|, a
norm. Without crushing the set is the cone of the corners, which stays in the programme.

Means in closed form, edge by edge: the line l = 0 cuts the polygon, and the pressed part consists of triangles between
a point of that line and the parts of the edges above it. O is the centroid.
"""

from __future__ import annotations

import numpy as np

from dembrick.simulation.limit_analysis.strength import Areas
from dembrick.simulation.limit_analysis.support_function import SupportFunction, by_corners, corners_of

FAR = 50.0  # distance of the torsion centre in gyrations: the series is exact to 1e-14 there, the sums to 1e-12
_TINY = 1e-150


class FrictionSurfaces(SupportFunction):
    """The limit surfaces of some area joints, scaled to V_0 = 1; the ellipsoid is that of the mean square speed."""

    def __init__(self, corner: np.ndarray, far: np.ndarray, second: np.ndarray):
        self._corner, self._far, self._second = corner, far, second
        self.ellipsoid = np.tile(np.eye(3), (len(corner), 1, 1))

    @classmethod
    def of_joints(cls, areas: Areas, chosen: np.ndarray) -> FrictionSurfaces:
        gyration = areas.gyration[chosen, None]
        scale = gyration ** -np.repeat(np.arange(2, 9), np.arange(3, 10))
        second = areas.second[chosen] / (areas.area[chosen, None] * gyration**2)
        return cls(corners_of(areas, chosen), areas.far[chosen] * scale, second)

    def of(self, at: np.ndarray) -> FrictionSurfaces:
        return FrictionSurfaces(self._corner[at], self._far[at], self._second[at])

    def speed(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """D_1 (k,), its gradient (k, 3) and its Hessian (k, 3, 3) at twists (k, 3); for far centres only the first term
        of the Hessian."""
        far = np.hypot(q[:, 0], q[:, 1]) > FAR * np.abs(q[:, 2])
        value, gradient, hessian = np.empty(len(q)), np.empty((len(q), 3)), np.empty((len(q), 3, 3))
        for some, evaluate in ((far, self._series), (~far, self._edges)):
            if some.any():
                value[some], gradient[some], hessian[some] = evaluate(q[some], some)
        return value, gradient, hessian

    def _series(self, q: np.ndarray, some: np.ndarray):
        size = np.hypot(q[:, 0], q[:, 1])
        d1, d2 = q[:, 0] / size, q[:, 1] / size
        e = q[:, 2] / size
        total, in_e, in_d, at = np.ones_like(size), np.zeros_like(size), np.zeros((len(q), 2)), 0
        for n in range(2, 9):  # J_n = sum of c_k d1^(n-k) d2^k
            c = self._far[some, at : at + n + 1]
            at += n + 1
            powers = [d1 ** (n - k) * d2**k for k in range(n + 1)]
            form = sum(c[:, k] * powers[k] for k in range(n + 1))
            first = sum((n - k) * c[:, k] * d1 ** (n - k - 1) * d2**k for k in range(n))
            second = sum(k * c[:, k] * d1 ** (n - k) * d2 ** (k - 1) for k in range(1, n + 1))
            total = total + e**n * form
            in_e = in_e + n * e ** (n - 1) * form
            in_d = in_d + (e**n)[:, None] * np.stack([first, second], axis=1)
        # D_1 = |v| F(d, e), e = w / |v|: d changes only across itself
        d = np.stack([d1, d2], axis=1)
        gradient = np.empty((len(q), 3))
        gradient[:, :2] = (total - e * in_e)[:, None] * d + in_d - (in_d * d).sum(axis=1)[:, None] * d
        gradient[:, 2] = in_e
        yy, xx, xy = self._second[some].T
        hessian = np.zeros((len(q), 3, 3))
        across = np.stack([-d2, d1], axis=1)
        hessian[:, :2, :2] = across[:, :, None] * across[:, None, :]
        hessian[:, 2, 2] = d1 * d1 * xx + 2.0 * d1 * d2 * xy + d2 * d2 * yy
        return size * total, gradient, hessian / size[:, None, None]

    def _edges(self, q: np.ndarray, some: np.ndarray):
        start = self._corner[some]
        edge = np.roll(start, -1, axis=1) - start
        length = np.sqrt((edge**2).sum(axis=2))
        t = edge / length[..., None]
        n = np.stack([t[..., 1], -t[..., 0]], axis=2)
        area = 0.5 * (start[..., 0] * edge[..., 1] - start[..., 1] * edge[..., 0]).sum(axis=1)
        w = q[:, 2]
        centre = np.stack([-q[:, 1], q[:, 0]], axis=1) / w[:, None]
        away = start - centre[:, None]
        h, s0 = (away * n).sum(axis=2), (away * t).sum(axis=2)
        s1 = s0 + length
        r0, r1 = np.hypot(h, s0), np.hypot(h, s1)
        on_line = np.abs(h) < _TINY
        lever = np.where(on_line, 1.0, np.abs(h))
        asinh = np.where(on_line, 0.0, np.arcsinh(s1 / lever) - np.arcsinh(s0 / lever))
        i0 = 0.5 * (s1 * r1 - s0 * r0 + h * h * asinh)  # integral of rho along the edge
        moment = (h * i0).sum(axis=1) / (3.0 * area)
        push = (i0[..., None] * n).sum(axis=1) / area[:, None]
        sign = np.sign(w)
        gradient = np.empty((len(q), 3))
        gradient[:, 0], gradient[:, 1] = -sign * push[:, 1], sign * push[:, 0]
        gradient[:, 2] = sign * moment + centre[:, 0] * gradient[:, 1] - centre[:, 1] * gradient[:, 0]
        inverse0 = np.divide(1.0, r0, out=np.zeros_like(r0), where=r0 > _TINY)
        inverse1 = np.divide(1.0, r1, out=np.zeros_like(r1), where=r1 > _TINY)
        cc = s1 * inverse1 - s0 * inverse0  # integrals of h^2 / rho^3, h s / rho^3 and s^2 / rho^3
        cs = -h * (inverse1 - inverse0)
        nn, nt, tt = h * cc, h * cs, h * (asinh - cc)
        block = np.einsum("ke,kei,kej->kij", nn, n, n) + np.einsum("ke,kei,kej->kij", tt, t, t)
        mixed = np.einsum("ke,kei,kej->kij", nt, n, t)
        block += mixed + mixed.transpose(0, 2, 1)
        block /= (np.abs(w) * area)[:, None, None]
        carry = np.zeros((len(q), 2, 3))
        carry[:, 0, 0] = carry[:, 1, 1] = 1.0
        carry[:, 0, 2], carry[:, 1, 2] = -centre[:, 1], centre[:, 0]
        return np.abs(w) * moment, gradient, carry.transpose(0, 2, 1) @ block @ carry


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
    """Initial planes: places in ``chosen`` (c,), and q (c, 3), scaled to a mean |l| of 1: the whole joint, and
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
