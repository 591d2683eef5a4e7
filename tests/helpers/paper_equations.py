"""Equations (1) to (11) of Casapulla and Maione's comparison of convex and concave contact, for a rectangle a x b.

The paper works with unsigned magnitudes and measures the rectangle from the torsion centre C: its lower corner is at
``(x_c, y_c)``, so its centroid O is at ``(x_c + a/2, y_c + b/2)``. All functions accept arrays and broadcast. Lengths
in m, forces in N, torsion in N m. ``a`` runs along x, ``b`` along y, ``shear_strength`` is V_0 = friction * N, or
cohesion * a b + friction * N of a joint that keeps its cohesion.
The signed generalisation to any polygon is in :mod:`dembrick.theory.limit_surface`; it shares no formula with this one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dembrick.theory.equations import half_diagonal, reduced_dimensions, torsion_parameter

__all__ = [
    "concave_interaction",
    "concave_interaction_y",
    "convex_interaction",
    "corrected_interaction_y",
    "half_diagonal",
    "reduced_dimensions",
    "reduced_half_diagonal",
    "torsion_parameter",
    "torsion_strength_concave",
    "torsion_strength_convex",
    "torsion_strength_corrected",
]


def torsion_strength_convex(a: ArrayLike, b: ArrayLike, shear_strength: ArrayLike) -> np.ndarray | float:
    """M_T0 of the convex joint, V_0 c_T (eq. 1)."""
    return shear_strength * torsion_parameter(a, b)


def torsion_strength_concave(a: ArrayLike, b: ArrayLike, shear_strength: ArrayLike) -> np.ndarray | float:
    """M_T0 of the concave joint, V_0 c (eq. 3)."""
    return shear_strength * half_diagonal(a, b)


def reduced_half_diagonal(a: ArrayLike, b: ArrayLike) -> np.ndarray | float:
    """c_1 of the reduced rectangle (eq. 11); equal to c_T."""
    return half_diagonal(*reduced_dimensions(a, b))


def torsion_strength_corrected(a: ArrayLike, b: ArrayLike, shear_strength: ArrayLike) -> np.ndarray | float:
    """M_T0 of the corrected concave joint, V_0 c_1 = V_0 c_T (eq. 10)."""
    return shear_strength * reduced_half_diagonal(a, b)


def _times_asinh(factor: np.ndarray, p: np.ndarray, q: np.ndarray) -> np.ndarray:
    """factor * asinh(p / abs(q)), where factor vanishes with q."""
    zero = q == 0.0
    return np.where(zero, 0.0, factor * np.arcsinh(p / np.where(zero, 1.0, np.abs(q))))


def convex_interaction(
    x_c: ArrayLike, y_c: ArrayLike, a: ArrayLike, b: ArrayLike, shear_strength: ArrayLike = 1.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(V_x, V_y, M_T) of the convex joint slipping about C, M_T about O (eq. 5), by corner sums.

    With r = hypot(x, y) the three integrals over the rectangle have the primitives
    P = (y r + x^2 asinh(y/|x|))/2 for V_y, Q = (x r + y^2 asinh(x/|y|))/2 for V_x and
    F = x y r/3 + x^3 asinh(y/|x|)/6 + y^3 asinh(x/|y|)/6 for the moment about C. They lose digits when C is farther
    than about a hundred half diagonals.
    """
    x_c, y_c, a, b = np.broadcast_arrays(*(np.asarray(value, float) for value in (x_c, y_c, a, b)))
    V_x = V_y = M_C = 0.0
    for x, y, sign in ((x_c + a, y_c + b, 1.0), (x_c, y_c + b, -1.0), (x_c + a, y_c, -1.0), (x_c, y_c, 1.0)):
        r = np.hypot(x, y)
        V_y = V_y + sign * (y * r + _times_asinh(x * x, y, x)) / 2.0
        V_x = V_x + sign * (x * r + _times_asinh(y * y, x, y)) / 2.0
        M_C = M_C + sign * (2.0 * x * y * r + _times_asinh(x**3, y, x) + _times_asinh(y**3, x, y)) / 6.0
    tau = shear_strength / (a * b)
    return tau * V_x, tau * V_y, tau * (M_C - V_x * (y_c + b / 2.0) - V_y * (x_c + a / 2.0))


def concave_interaction(
    x_c: ArrayLike, y_c: ArrayLike, a: ArrayLike, b: ArrayLike, shear_strength: ArrayLike = 1.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(V_x, V_y, M_T) of four vertices with N/4 each, slipping about C, M_T about O (eq. 6).

    Vertices 1 to 4 are top left, bottom left, bottom right, top right; a vertex at C itself carries no force here.
    The paper prints a (sin alpha_1 + sin alpha_4) in the moment; its own (7) and (8) need alpha_3 there, as used here.
    """
    x_c, y_c, a, b = np.broadcast_arrays(*(np.asarray(value, float) for value in (x_c, y_c, a, b)))
    sines, cosines = [], []
    for x, y in ((x_c, y_c + b), (x_c, y_c), (x_c + a, y_c), (x_c + a, y_c + b)):
        d = np.hypot(x, y)
        d = np.where(d == 0.0, 1.0, d)
        sines.append(x / d)
        cosines.append(y / d)
    V_x = shear_strength / 4.0 * sum(cosines)
    V_y = shear_strength / 4.0 * sum(sines)
    M_C = (
        shear_strength
        / 4.0
        * (b * (cosines[0] + cosines[3]) + a * (sines[2] + sines[3]) + x_c * sum(sines) + y_c * sum(cosines))
    )
    return V_x, V_y, M_C - V_x * (y_c + b / 2.0) - V_y * (x_c + a / 2.0)


def concave_distances(x_c: ArrayLike, a: ArrayLike, b: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """(d_1, d_4): distances of the left and the right vertices from a C on the x axis (eq. 7)."""
    x_c, a, b = (np.asarray(value, float) for value in (x_c, a, b))
    return np.hypot(x_c, b / 2.0), np.hypot(a + x_c, b / 2.0)


def concave_interaction_y(
    x_c: ArrayLike, a: ArrayLike, b: ArrayLike, shear_strength: ArrayLike = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """(V, M_T) of the concave joint for a force along y (eq. 8), C on the x axis, left edge at x_c from C."""
    d_1, d_4 = concave_distances(x_c, a, b)
    V = shear_strength / 2.0 * (x_c / d_1 + (a + x_c) / d_4)
    moment = (b**2 * (d_1 + d_4) + 4.0 * d_1 * a * (a + x_c)) / (8.0 * d_1 * d_4)
    return V, moment * shear_strength - a / 2.0 * V


def corrected_interaction_y(
    x_c: ArrayLike, a: ArrayLike, b: ArrayLike, shear_strength: ArrayLike = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """(V, M_T) of the corrected joint for a force along y: (8) with the edges of (9)."""
    a_1, b_1 = reduced_dimensions(a, b)
    return concave_interaction_y(x_c, a_1, b_1, shear_strength)
