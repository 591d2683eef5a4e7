"""Integrals over a joint for its friction: torsion radii and the far-field series."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from dembrick.geometry import polygons

_CHUNK = 256  # polygons per batch, so that their powers fit the cache

# sqrt((1 + e s)^2 + (e t)^2) = 1 + e s + sum over n of e^n times these terms (i, j, c), each c s^i t^j
_SERIES = {
    2: [(0, 2, 1 / 2)],
    3: [(1, 2, -1 / 2)],
    4: [(2, 2, 1 / 2), (0, 4, -1 / 8)],
    5: [(3, 2, -1 / 2), (1, 4, 3 / 8)],
    6: [(4, 2, 1 / 2), (2, 4, -3 / 4), (0, 6, 1 / 16)],
    7: [(5, 2, -1 / 2), (3, 4, 5 / 4), (1, 6, -5 / 16)],
    8: [(6, 2, 1 / 2), (4, 4, -15 / 8), (2, 6, 15 / 16), (0, 8, -5 / 128)],
}


@lru_cache(maxsize=1)
def series_matrices() -> dict[int, np.ndarray]:
    """For each order n the matrix (n + 1, n + 1) from the mean values of x^(n-k) y^k to the coefficients of J_n.

    s = v2 x - v1 y and t = v1 x + v2 y are expanded as polynomials in v2/v1 (rows) and y/x (columns).
    """
    factors = {"s": ((0, 1, -1.0), (1, 0, 1.0)), "t": ((0, 0, 1.0), (1, 1, 1.0))}
    matrices = {}
    for n, terms in _SERIES.items():
        matrix = np.zeros((n + 1, n + 1))
        for i, j, c in terms:
            product = np.zeros((n + 1, n + 1))
            product[0, 0] = c
            for name in "s" * i + "t" * j:
                larger = np.zeros_like(product)
                for row, column, sign in factors[name]:
                    larger[row:, column:] += sign * product[: n + 1 - row, : n + 1 - column]
                product = larger
            matrix += product
        matrices[n] = matrix
    return matrices


@lru_cache(maxsize=1)
def triangle_rule() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Product rule (r, s, weight) on the triangle r (P + s (Q - P)), exact for polynomials up to degree eight."""
    nodes, weights = np.polynomial.legendre.leggauss(5)
    u, w = 0.5 * (nodes + 1.0), 0.5 * weights
    r, s = np.meshgrid(u, u, indexing="ij")
    return r.ravel(), s.ravel(), np.outer(w * u, w).ravel()


def far_moments(polygon: np.ndarray) -> np.ndarray:
    """Coefficients (..., 42) of the forms J_2 ... J_8 in (v1, v2) of the series of the dissipation about pure
    translation, for polygons (..., m, 2).

    With d the unit vector along v, s = d x r and t = d . r, D = |v| times the mean over the polygon of
    sqrt((1 + e s)^2 + (e t)^2), e = w/|v|; term n is w^n J_n(v) |v|^(1 - 2n). The coefficients are exact, since the
    moments of polynomials over a polygon are.
    """
    p = np.asarray(polygon, float)
    if p.ndim == 3 and len(p) > _CHUNK:
        return np.concatenate([far_moments(p[i : i + _CHUNK]) for i in range(0, len(p), _CHUNK)])
    q = np.concatenate([p[..., 1:, :], p[..., :1, :]], axis=-2)
    r, s, weights = triangle_rule()
    share = (p[..., 0] * q[..., 1] - p[..., 1] * q[..., 0])[..., None] * weights
    share /= share.sum(axis=(-2, -1), keepdims=True)
    x = r * (p[..., :1] + s * (q - p)[..., :1])
    y = r * (p[..., 1:] + s * (q - p)[..., 1:])
    powers_x, powers_y = [np.ones_like(x)], [share]
    for _ in range(8):
        powers_x.append(powers_x[-1] * x)
        powers_y.append(powers_y[-1] * y)
    forms = []
    for n, matrix in series_matrices().items():
        means = [(powers_x[n - k] * powers_y[k]).sum(axis=(-2, -1)) for k in range(n + 1)]
        forms.append(np.stack(means, axis=-1) @ matrix.T)
    return np.concatenate(forms, axis=-1)


def area_radius(polygon: np.ndarray) -> np.ndarray:
    """Least mean distance of a polygon's area from any centre: M_T0 / V_0 of a convex joint; for polygons (..., m, 2).

    This is c_T for a centrally symmetric polygon (eq. 2); otherwise the exact integral is minimised over the centre by
    Newton steps with finite differences.
    """
    corners = np.asarray(polygon, float)
    flat = corners.reshape(-1, *corners.shape[-2:])
    symmetric = _symmetric(flat)
    radius = np.empty(len(flat))
    radius[symmetric] = polygons.mean_distance(flat[symmetric])[:, 0]
    for i in np.flatnonzero(~symmetric):
        radius[i] = _least_mean_distance(flat[i])
    return radius.reshape(corners.shape[:-2])[()]


def _symmetric(corners: np.ndarray) -> np.ndarray:
    """Whether each polygon (..., m, 2) is centrally symmetric about O."""
    size = np.abs(corners).max(axis=(-2, -1))
    sums = np.abs(corners[..., :, None, :] + corners[..., None, :, :]).max(axis=-1)
    return sums.min(axis=-1).max(axis=-1) <= 1e-9 * size


def _least_mean_distance(corners: np.ndarray) -> float:
    size = float(np.abs(corners).max())
    centre, h = np.zeros(2), 1e-4 * size
    stencil = h * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1], [1, 1], [-1, -1], [1, -1], [-1, 1]])
    best = math.inf
    for _ in range(50):
        f = polygons.mean_distance(corners, centre + stencil)
        if f[0] >= best:
            break
        best = float(f[0])
        gradient = np.array([f[1] - f[2], f[3] - f[4]]) / (2 * h)
        mixed = (f[5] + f[6] - f[7] - f[8]) / (4 * h * h)
        hessian = np.array([[f[1] - 2 * f[0] + f[2], 0.0], [0.0, f[3] - 2 * f[0] + f[4]]]) / (h * h)
        hessian[0, 1] = hessian[1, 0] = mixed
        centre = centre - np.linalg.solve(hessian, gradient)
    return best
