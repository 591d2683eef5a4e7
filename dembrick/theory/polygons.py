"""Plane geometry for the theory: moments, clipping, hulls. Polygons are (m, 2) arrays in joint axes, in m."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from dembrick.errors import ScenarioError

_SAME = 1e-12  # of a polygon's size: smaller distances between corners, or corner and edge, are zero


def as_polygon(vertices: ArrayLike) -> np.ndarray:
    """The vertices as a counter-clockwise (m, 2) float array; refuse a polygon without area."""
    polygon = np.array(vertices, dtype=float)
    if polygon.ndim != 2 or polygon.shape[1] != 2 or len(polygon) < 3 or not np.isfinite(polygon).all():
        raise ScenarioError("a polygon needs at least three vertices with two finite coordinates each")
    area = float(moment_matrix(polygon, polygon[0])[0, 0])
    size = np.ptp(polygon, axis=0).max()
    if not abs(area) > 1e-14 * size * size:
        raise ScenarioError(f"a polygon {size!r} m across with an area of {area!r} m2 is a line: give it some width")
    return polygon if area > 0.0 else polygon[::-1].copy()


def as_parts(polygon: ArrayLike | Sequence[ArrayLike]) -> tuple[np.ndarray, ...]:
    """One polygon, or a sequence of polygons that do not overlap, as a tuple of counter-clockwise arrays."""
    try:
        single = np.ndim(polygon[0][0]) == 0
    except (TypeError, IndexError, KeyError):
        raise ScenarioError("a polygon is a sequence of (x, y) pairs, or a sequence of such polygons") from None
    return (as_polygon(polygon),) if single else tuple(as_polygon(part) for part in polygon)


def rectangle(a: float, b: float) -> np.ndarray:
    """Vertices of a rectangle a (along x) by b (along y) about its centroid, counter-clockwise from lower left."""
    return np.array([[-a, -b], [a, -b], [a, b], [-a, b]]) / 2.0


def moment_matrix(polygon: np.ndarray, origin: ArrayLike = (0.0, 0.0)) -> np.ndarray:
    """The integral of phi phi^T over the polygon, phi = (1, x, y) measured from ``origin``: (3, 3), symmetric."""
    x, y = (polygon - np.asarray(origin)).T
    x_1, y_1 = np.roll(x, -1), np.roll(y, -1)
    cross = x * y_1 - x_1 * y
    one = np.sum(cross) / 2.0
    m_x, m_y = np.sum(cross * (x + x_1)) / 6.0, np.sum(cross * (y + y_1)) / 6.0
    m_xx = np.sum(cross * (x * x + x * x_1 + x_1 * x_1)) / 12.0
    m_yy = np.sum(cross * (y * y + y * y_1 + y_1 * y_1)) / 12.0
    m_xy = np.sum(cross * (2.0 * (x * y + x_1 * y_1) + x * y_1 + x_1 * y)) / 24.0
    return np.array([[one, m_x, m_y], [m_x, m_xx, m_xy], [m_y, m_xy, m_yy]])


def centroid(parts: Sequence[np.ndarray]) -> np.ndarray:
    """Centroid (2,) of a union of parts."""
    origin = parts[0][0]
    moments = sum(moment_matrix(part, origin) for part in parts)
    return origin + moments[0, 1:] / moments[0, 0]


def clip(polygon: np.ndarray, normal: ArrayLike, offset: float) -> np.ndarray:
    """The part of the polygon where normal . r + offset >= 0, as a (k, 2) array; k = 0 if there is none.

    For a non-convex polygon the result may have edges that coincide along the line; its integrals are correct.
    """
    level = polygon @ np.asarray(normal, float) + offset
    kept = []
    for i in range(len(polygon)):
        j = (i + 1) % len(polygon)
        if level[i] >= 0.0:
            kept.append(polygon[i])
        if (level[i] < 0.0 < level[j]) or (level[j] < 0.0 < level[i]):
            kept.append(polygon[i] + (polygon[j] - polygon[i]) * (level[i] / (level[i] - level[j])))
    return np.array(kept).reshape(-1, 2)


def is_convex(polygon: np.ndarray) -> bool:
    edges = np.roll(polygon, -1, axis=0) - polygon
    following = np.roll(edges, -1, axis=0)
    cross = edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0]
    return bool(np.all(cross >= -1e-12 * np.max(np.sum(edges**2, axis=1))))


def intersect(polygon: np.ndarray, convex: np.ndarray) -> np.ndarray:
    """Intersection of a polygon with a convex counter-clockwise one, (k, 2)."""
    edges = np.roll(convex, -1, axis=0) - convex
    for start, edge in zip(convex, edges, strict=True):
        if len(polygon) == 0:
            break
        inward = np.array([-edge[1], edge[0]])
        polygon = clip(polygon, inward, -float(inward @ start))
    return polygon


def convex_hull(points: ArrayLike) -> np.ndarray:
    """Convex hull (k, 2), counter-clockwise, without collinear points; k may be 1 or 2."""
    ordered = sorted({(float(x), float(y)) for x, y in np.asarray(points)})
    if len(ordered) < 3:
        return np.array(ordered)
    chains = []
    for sequence in (ordered, ordered[::-1]):
        chain: list[tuple[float, float]] = []
        for p in sequence:
            while len(chain) > 1:
                (x_0, y_0), (x_1, y_1) = chain[-2:]
                if (x_1 - x_0) * (p[1] - y_0) - (y_1 - y_0) * (p[0] - x_0) > 0.0:
                    break
                chain.pop()
            chain.append(p)
        chains.append(chain[:-1])
    return np.array(chains[0] + chains[1])


def distance_to_exit(hull: np.ndarray, start: ArrayLike, direction: ArrayLike) -> float:
    """Multiple of ``direction`` from ``start`` to the boundary of a convex hull: inf if the ray never leaves the hull.

    Negative if ``start`` is outside already. Corners that differ by rounding are merged: no edge lies between them.
    """
    start, direction = np.asarray(start, float), np.asarray(direction, float)
    edges, size = np.roll(hull, -1, axis=0) - hull, float(np.ptp(hull, axis=0).max())
    length = np.hypot(*edges.T)
    there = length > _SAME * size
    outward = np.stack([edges[there, 1], -edges[there, 0]], axis=1) / length[there, None]
    room = np.sum(outward * (hull[there] - start), axis=1)
    if np.any(room < -_SAME * size):
        return -1.0
    speed = outward @ direction
    leaving = speed > 0.0
    return float(np.min(room[leaving] / speed[leaving])) if np.any(leaving) else np.inf
