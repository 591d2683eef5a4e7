"""Exact limit surfaces: the dissipation D(q) of a slip twist q, its gradient and its Hessian.

A slip twist q = (v1, v2, w) is the velocity at the joint's origin O and the spin about the normal. The power dissipated
by the friction stress mu p is

    D(q) = mu * integral of p |v + w x r| dA,

which is convex and homogeneous of degree one. Its gradient is the point (V_1, V_2, M_T) of the limit surface with
normal q (M_T about O, positive counter-clockwise). Laws: :func:`convex` (a polygon under uniform pressure, paper eq.
5), :func:`linear_pressure` (a no-tension pressure that varies linearly) and :func:`points` (Coulomb friction at
points). All functions are vectorised over twists: q has shape (k, 3), or (3,) for a single twist.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from dembrick.errors import ScenarioError
from dembrick.theory.polygons import as_parts, centroid, clip, moment_matrix

#: Beyond this many radii the torsion centre is far: there the velocity field is analytic over the joint and a Gauss
#: rule of 12 x 10 points on each triangle (O, edge) is exact to rounding, while sums over edges would cancel.
FAR = 3.0
#: Twists times points per batch; limits the memory.
CHUNK = 1_000_000


class Law:
    """The exact limit surface of a joint. ``radius`` (m) and ``strength`` = V_0 (N) are its scales, ``rounding`` is the
    expected relative rounding error of ``derivatives``: D, gradient and Hessian of twists (k, 3)."""

    radius: float
    strength: float
    rounding: float
    derivatives: Callable[..., tuple[np.ndarray, np.ndarray, np.ndarray]]

    def dissipation(self, twist: ArrayLike) -> np.ndarray:
        """D(q) in W, shape (...) for a twist of shape (..., 3)."""
        return self._shaped(twist)[0][()]

    def gradient(self, twist: ArrayLike) -> np.ndarray:
        """(V_1, V_2, M_T) in N, N, N m, shape (..., 3): the point of the limit surface with normal ``twist``."""
        return self._shaped(twist)[1]

    def _shaped(self, twist: ArrayLike) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        q = np.asarray(twist, float)
        D, G, H = self.derivatives(q.reshape(-1, 3))
        return D.reshape(q.shape[:-1]), G.reshape(q.shape), H.reshape(*q.shape, 3)


@cache
def _gauss(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Points and weights of the Gauss rule on (0, 1)."""
    x, weight = np.polynomial.legendre.leggauss(count)
    return (x + 1.0) / 2.0, weight / 2.0


def _sum_over_points(
    q: np.ndarray, arms: np.ndarray, weights: np.ndarray, smoothing: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sum of weights * sqrt(|v + w x r|^2 + smoothing^2), with first and second derivatives.

    A point at rest contributes nothing to the gradient (one of its subgradients) and to the Hessian.
    """
    rows = max(1, CHUNK // max(1, len(arms)))
    if len(q) > rows:
        pieces = [_sum_over_points(q[i : i + rows], arms, weights, smoothing) for i in range(0, len(q), rows)]
        return tuple(np.concatenate(part) for part in zip(*pieces, strict=True))
    x, y = arms[:, 0], arms[:, 1]
    u_1 = q[:, :1] - q[:, 2:] * y
    u_2 = q[:, 1:2] + q[:, 2:] * x
    speed = np.sqrt(u_1 * u_1 + u_2 * u_2 + smoothing * smoothing)
    D = speed @ weights
    moving = speed > 0.0
    slowness = np.divide(weights, speed, out=np.zeros_like(speed), where=moving)
    t_1, t_2 = u_1 * slowness, u_2 * slowness
    G = np.stack([t_1.sum(1), t_2.sum(1), t_2 @ x - t_1 @ y], axis=1)
    cube = np.divide(slowness, speed * speed, out=np.zeros_like(speed), where=moving)
    # slowness (I - u u^T / speed^2), in a form without cancellation for smoothing = 0
    extra = cube * (smoothing * smoothing)
    h_11, h_22, h_12 = cube * u_2 * u_2 + extra, cube * u_1 * u_1 + extra, -cube * u_1 * u_2
    H = np.empty((len(q), 3, 3))
    H[:, 0, 0], H[:, 1, 1] = h_11.sum(1), h_22.sum(1)
    H[:, 0, 1] = H[:, 1, 0] = h_12.sum(1)
    H[:, 0, 2] = H[:, 2, 0] = h_12 @ x - h_11 @ y
    H[:, 1, 2] = H[:, 2, 1] = h_22 @ x - h_12 @ y
    H[:, 2, 2] = h_11 @ (y * y) - 2.0 * (h_12 @ (x * y)) + h_22 @ (x * x)
    return D, G, H


class PointLaw(Law):
    """Coulomb friction at points. ``arms`` (n, 2) about O in m; ``strengths`` (n,) in N, of friction and adhesion."""

    def __init__(self, arms: np.ndarray, strengths: np.ndarray):
        carrying = strengths > 0.0
        self.arms = arms[carrying]
        self.strengths = strengths[carrying]
        self.strength = float(self.strengths.sum())
        self.radius = float(np.hypot(*arms.T).max()) or 1.0
        self.rounding = 1e-16

    def derivatives(self, twist: np.ndarray, smoothing: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """D, gradient and Hessian at twists (k, 3); ``smoothing`` is a speed in m/s that rounds off the kinks."""
        return _sum_over_points(twist, self.arms, self.strengths, smoothing)


class PolygonLaw(Law):
    """A friction stress ``level + slope . (r - about)`` (Pa, Pa/m) over a union of polygons, in closed form.

    With the torsion centre C each edge forms a signed triangle. Let h be the distance of the edge from C, s the
    position along it and rho = hypot(h, s); the integral over the triangle of a function homogeneous of degree k is
    h/(k + 2) times its integral along the edge. D, its gradient and its Hessian thus follow from elementary integrals
    of rho, with no special case for C inside, on an edge or on a vertex.
    """

    def __init__(self, parts: Sequence[np.ndarray], level: float, slope: ArrayLike = (0, 0), about: ArrayLike = (0, 0)):
        start = np.concatenate(parts)
        end = np.concatenate([np.roll(part, -1, axis=0) for part in parts])
        length = np.hypot(*(end - start).T)
        start, end, length = (array[length > 0.0] for array in (start, end, length))
        self.slope = np.asarray(slope, float)
        self.level = float(level)
        self._uniform = not self.slope.any()
        self._start, self._length = start, length
        self._tangent = (end - start) / length[:, None]
        self._normal = np.stack([self._tangent[:, 1], -self._tangent[:, 0]], axis=1)
        self.parts = tuple(parts)
        self.middle = centroid(parts)
        self._about = np.asarray(about, float)
        moments = sum(moment_matrix(part, about) for part in parts)
        self.strength = float(self.level * moments[0, 0] + self.slope @ moments[0, 1:])
        self.radius = float(np.hypot(*(start - self.middle).T).max())
        # edges of a slender polygon nearly cancel, once for its width and again for a pressure that varies across it
        slenderness = self.radius * float(length.sum()) / moments[0, 0]
        self.rounding = 1e-16 * (slenderness if self._uniform else slenderness**2)
        self._arms, self._weights = self._far_rule(start, end)

    def _far_rule(self, start: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points (about O) and signed weights of a Gauss rule on the triangles between the middle and the edges."""
        xi, w_xi, eta, w_eta = *_gauss(12), *_gauss(10)
        p, p_1 = start - self.middle, end - self.middle
        cross = p[:, 0] * p_1[:, 1] - p[:, 1] * p_1[:, 0]
        on_edge = p[:, None] + xi[:, None] * (p_1 - p)[:, None]
        arms = (self.middle + eta[:, None] * on_edge[:, :, None]).reshape(-1, 2)
        weights = (cross[:, None, None] * w_xi[:, None] * (w_eta * eta)).ravel()
        return arms, weights * (self.level + (arms - self._about) @ self.slope)

    def derivatives(self, twist: np.ndarray, smoothing: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """D, gradient and Hessian at twists (k, 3). The surface is smooth; ``smoothing`` has no effect."""
        q = np.asarray(twist, float)
        w = q[:, 2]
        far = np.hypot(q[:, 0] - w * self.middle[1], q[:, 1] + w * self.middle[0]) > FAR * self.radius * np.abs(w)
        near = ~far & (w != 0.0)
        D, G, H = np.zeros(len(q)), np.zeros((len(q), 3)), np.zeros((len(q), 3, 3))
        for chosen, evaluate in ((far, self._far), (near, self._near)):
            if chosen.any():
                D[chosen], G[chosen], H[chosen] = evaluate(q[chosen])
        return D, G, H

    def _far(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return _sum_over_points(q, self._arms, self._weights, 0.0)

    def _near(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        w = q[:, 2]
        C = np.stack([-q[:, 1], q[:, 0]], axis=1) / w[:, None]
        from_C = self._start - C[:, None]
        n, t = self._normal, self._tangent
        h, s_0 = np.sum(from_C * n, axis=2), np.sum(from_C * t, axis=2)
        s_1 = s_0 + self._length
        rho_0, rho_1 = np.hypot(h, s_0), np.hypot(h, s_1)
        # every asinh has a factor h: an edge through C contributes nothing
        tiny = 1e-100 * self.radius
        on_line = np.abs(h) < tiny
        safe = np.where(on_line, 1.0, np.abs(h))
        asinh = np.where(on_line, 0.0, np.arcsinh(s_1 / safe) - np.arcsinh(s_0 / safe))
        i_0 = (s_1 * rho_1 - s_0 * rho_0 + h * h * asinh) / 2.0  # integral of rho
        # a vertex at C: h = s = rho = 0, and all these quotients are multiplied by h
        inverse_0 = np.divide(1.0, rho_0, out=np.zeros_like(rho_0), where=rho_0 > tiny)
        inverse_1 = np.divide(1.0, rho_1, out=np.zeros_like(rho_1), where=rho_1 > tiny)
        l_0 = s_1 * inverse_1 - s_0 * inverse_0  # of h^2 / rho^3
        h_l_1 = -h * (inverse_1 - inverse_0)  # of h s / rho^3
        l_2 = asinh - l_0  # of s^2 / rho^3
        p_C = self.level + (C - self._about) @ self.slope
        M = p_C * np.sum(h * i_0, axis=1) / 3.0
        S = p_C[:, None] * (i_0 @ n)
        nn, nt, tt = (p_C[:, None] * h * term for term in (l_0, h_l_1, l_2))
        if not self._uniform:
            g_n, g_t = n @ self.slope, t @ self.slope
            j_1 = rho_1 - rho_0  # of s / rho
            j_2 = (s_1 * rho_1 - s_0 * rho_0 - h * h * asinh) / 2.0  # of s^2 / rho
            k = (rho_1**3 - rho_0**3) / 3.0  # of s rho
            M = M + np.sum(h * (g_n * h * i_0 + g_t * k), axis=1) / 4.0
            S = S + (h * (g_n * h * h * asinh + g_t * h * j_1)) @ n / 3.0 + (h * (g_n * h * j_1 + g_t * j_2)) @ t / 3.0
            l_3 = j_1 + h * h * (inverse_1 - inverse_0)  # of s^3 / rho^3
            nn = nn + h * h / 2.0 * (g_n * l_0 + g_t * h_l_1)
            nt = nt + h * h / 2.0 * (g_n * h_l_1 + g_t * l_2)
            tt = tt + h / 2.0 * (g_n * h * l_2 + g_t * l_3)
        sign = np.sign(w)
        V = sign[:, None] * np.stack([-S[:, 1], S[:, 0]], axis=1)
        G = np.concatenate([V, (sign * M + C[:, 0] * V[:, 1] - C[:, 1] * V[:, 0])[:, None]], axis=1)
        n_n, t_t, n_t = (np.einsum("ei,ej->eij", *pair) for pair in ((n, n), (t, t), (n, t)))
        block = np.tensordot(nn, n_n, 1) + np.tensordot(tt, t_t, 1) + np.tensordot(nt, n_t + np.swapaxes(n_t, 1, 2), 1)
        block /= np.abs(w)[:, None, None]
        # velocity of the material point at C, as a function of the twist about O
        T = np.zeros((len(q), 2, 3))
        T[:, 0, 0] = T[:, 1, 1] = 1.0
        T[:, 0, 2], T[:, 1, 2] = -C[:, 1], C[:, 0]
        return np.abs(w) * M, G, np.swapaxes(T, 1, 2) @ block @ T


def _checked(friction: float, normal_force: float, cohesion: float = 0.0) -> None:
    for name, value in (("friction", friction), ("normal_force", normal_force), ("cohesion", cohesion)):
        if not (np.isfinite(value) and value >= 0.0):
            raise ScenarioError(f"{name} = {value!r} is out of range: it must be finite and at least 0")


def convex(
    polygon: ArrayLike | Sequence[ArrayLike], friction: float, normal_force: float, cohesion: float = 0.0
) -> PolygonLaw:
    """Uniform pressure N/A over a polygon, or over a union of polygons that do not overlap (paper eq. 1 and 5);
    ``cohesion`` (Pa) scales the same surface: V_0 = c A + mu N."""
    _checked(friction, normal_force, cohesion)
    parts = as_parts(polygon)
    area = sum(moment_matrix(part, part[0])[0, 0] for part in parts)
    return PolygonLaw(parts, cohesion + friction * normal_force / area)


def linear_pressure(
    polygon: ArrayLike | Sequence[ArrayLike], friction: float, level: float, slope: ArrayLike, about: ArrayLike = (0, 0)
) -> PolygonLaw:
    """Exact law for the pressure max(0, level + slope . (r - about)) (Pa, Pa/m) over a polygon or union of polygons."""
    _checked(friction, 0.0)
    slope, about = np.asarray(slope, float), np.asarray(about, float)
    pressed = [clip(part - about, slope, level) + about for part in as_parts(polygon)]
    pressed = [part for part in pressed if len(part) > 2]
    if not pressed:
        raise ScenarioError("the pressure is nowhere positive: the joint is open and carries no friction")
    return PolygonLaw(pressed, friction * level, friction * slope, about)


def points(arms: ArrayLike, normal_forces: ArrayLike, friction: float, adhesion: ArrayLike | None = None) -> PointLaw:
    """Coulomb friction at points ``arms`` (n, 2) about O, each under a normal force (n,) >= 0 in N; points under
    pressure also have an ``adhesion`` (n,) in N."""
    arms, normal_forces = np.array(arms, float), np.array(normal_forces, float)
    if arms.ndim != 2 or arms.shape[1:] != (2,) or normal_forces.shape != arms.shape[:1] or len(arms) == 0:
        raise ScenarioError("points needs arms of shape (n, 2) and normal forces of shape (n,), n at least 1")
    if not (np.isfinite(arms).all() and np.isfinite(normal_forces).all() and np.all(normal_forces >= 0.0)):
        raise ScenarioError("points needs finite arms and finite normal forces that are at least 0")
    _checked(friction, 0.0)
    bonds = 0.0 if adhesion is None else np.where(normal_forces > 0.0, np.asarray(adhesion, float), 0.0)
    return PointLaw(arms, friction * normal_forces + bonds)
