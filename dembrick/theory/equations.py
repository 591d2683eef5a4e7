"""Equations (2), (4) and (9) of Casapulla and Maione's comparison of convex and concave contact, for a rectangle a x b.

All functions accept arrays and broadcast; lengths in m. ``a`` is along x, ``b`` along y.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def torsion_parameter(a: ArrayLike, b: ArrayLike) -> np.ndarray | float:
    """c_T, mean distance of the points of a rectangle from its centroid (eq. 2)."""
    a, b = np.asarray(a, float), np.asarray(b, float)
    d = np.hypot(a, b)
    # ln((b + d)/a) = asinh(b/a)
    return ((a**3 * np.arcsinh(b / a) + b**3 * np.arcsinh(a / b)) / (a * b) + 2.0 * d)[()] / 12.0


def half_diagonal(a: ArrayLike, b: ArrayLike) -> np.ndarray | float:
    """c, distance of the vertices from the centroid (eq. 4)."""
    return np.hypot(np.asarray(a, float) / 2.0, np.asarray(b, float) / 2.0)[()]


def reduced_dimensions(a: ArrayLike, b: ArrayLike) -> tuple[np.ndarray | float, np.ndarray | float]:
    """Edges (a_1, b_1) of the corrected concave joint: those of the rectangle times s = c_T / c (eq. 9)."""
    s = torsion_parameter(a, b) / half_diagonal(a, b)
    return s * np.asarray(a, float)[()], s * np.asarray(b, float)[()]
