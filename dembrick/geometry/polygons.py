"""Plane geometry of joint polygons: moments, tributary areas, distances from a torsion centre.

A polygon is an array (..., m, 2) of its corners, counterclockwise, with any leading axes. Sums over edges are also
valid for polygons that are not convex, and for convex pieces linked by edges traversed in both directions. Functions
that mention O expect the corners to be measured from the centroid.
"""

from __future__ import annotations

import numpy as np

_TINY = 1e-150  # keeps s/h finite if a torsion centre lies on the line of an edge


def area_and_centroid(polygon) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Area and centroid (A, x, y), (...) each; summed relative to the first corner, to keep digits far from the origin.

    Corners may repeat. If the area is zero, the first corner is returned as the centroid.
    """
    p = np.asarray(polygon, float)
    first = p[..., :1, :]
    u, v = p[..., 1:-1, :] - first, p[..., 2:, :] - first
    parts = u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
    double_area = parts.sum(axis=-1)
    moment = (parts[..., None] * (u + v)).sum(axis=-2)
    divisor = np.where(double_area == 0.0, 1.0, 3.0 * double_area)
    x, y = (first[..., 0, i] + moment[..., i] / divisor for i in (0, 1))
    return 0.5 * double_area, x, y


def _edges(polygon) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Corners, next corners, and twice the areas of the triangles that the edges make with the origin."""
    p = np.asarray(polygon, float)
    q = np.concatenate([p[..., 1:, :], p[..., :1, :]], axis=-2)
    return p, q, p[..., 0] * q[..., 1] - p[..., 1] * q[..., 0]


def area(polygon) -> np.ndarray:
    """Area of a polygon (m2)."""
    return 0.5 * _edges(polygon)[2].sum(axis=-1)


def perimeter(polygon) -> np.ndarray:
    """Length of the outline (m)."""
    p, q, _ = _edges(polygon)
    return np.sqrt(((q - p) ** 2).sum(axis=-1)).sum(axis=-1)


def second_moments(polygon) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Second moments of area (m4) about the origin: the integrals of y^2, x^2 and x y."""
    p, q, cross = _edges(polygon)
    squares = ((p * p + p * q + q * q) * cross[..., None] / 12.0).sum(axis=-2)
    mixed = p[..., 0] * (2.0 * p[..., 1] + q[..., 1]) + q[..., 0] * (p[..., 1] + 2.0 * q[..., 1])
    return squares[..., 1][()], squares[..., 0][()], (mixed * cross / 24.0).sum(axis=-1)


def tributary_areas(polygon) -> np.ndarray:
    """The share of each corner in the area (..., m): half of the two triangles that it forms with O and its neighbours.

    The shares of a convex polygon add up to its area and their centroid is O; for a rectangle each is a quarter.
    """
    _, _, cross = _edges(polygon)
    return 0.25 * (cross + np.concatenate([cross[..., -1:], cross[..., :-1]], axis=-1))


def mean_distance(polygon, centres=((0.0, 0.0),)) -> np.ndarray:
    """Mean distance of the area from each of ``centres`` (k, 2): the friction moment about it over V_0, exact (..., k).

    The triangle between the centre and an edge, at distance h with s running along the edge, gives h/3 times the
    integral of hypot(h, s). At O this is c_T (paper eq. 2).
    """
    centres = np.asarray(centres, float)
    p, q, cross = _edges(polygon)
    edge = q - p
    length = np.sqrt((edge**2).sum(axis=-1))
    tx, ty = np.moveaxis(edge / length[..., None], -1, 0)[:, ..., None, :]
    ux, uy = np.moveaxis(p[..., None, :, :] - centres[:, None, :], -1, 0)
    height = ux * ty - uy * tx
    start = ux * tx + uy * ty
    end = start + length[..., None, :]
    lever = np.maximum(np.abs(height), _TINY)

    def integral(s):
        return 0.5 * (s * np.sqrt(height * height + s * s) + height * height * np.arcsinh(s / lever))

    return (height * (integral(end) - integral(start))).sum(axis=-1) / (1.5 * cross.sum(axis=-1))[..., None]


def shrink_factor(polygon) -> np.ndarray:
    """s = c_T / c (paper eq. 9): mean distance of the area from O over that of the corners, by tributary area."""
    weights = tributary_areas(polygon)
    corners = np.asarray(polygon, float)
    c = (weights * np.hypot(corners[..., 0], corners[..., 1])).sum(axis=-1) / weights.sum(axis=-1)
    return mean_distance(polygon)[..., 0] / c


def pieces(polygon) -> list[np.ndarray]:
    """Indices of the corners of each convex piece that a polygon (m, 2) links; all of them if it is a single piece.

    The path of a joint of several pieces goes around the first and back to its first corner (home), then out to each
    further piece, around it and home again: a piece ends when its first corner is reached again.
    """
    corners = np.asarray(polygon, float)
    found, start, step = [], 0, 1  # the first piece ends at home, the others one corner before it
    while start < len(corners):
        again = np.flatnonzero((corners[start + 1 :] == corners[start]).all(axis=1))
        if not len(again):
            return [np.arange(len(corners))]
        end = start + 1 + int(again[0])
        found.append(np.arange(start, end))
        start, step = end + step, 2
    return found


def width(polygon) -> np.ndarray:
    """The short side: the smallest distance of two parallel lines that enclose the convex polygon (m)."""
    p, q, _ = _edges(polygon)
    edge = q - p
    length = np.sqrt((edge**2).sum(axis=-1))
    inward = np.stack([-edge[..., 1], edge[..., 0]], axis=-1) / length[..., None]
    heights = ((p[..., :, None, :] - p[..., None, :, :]) * inward[..., None, :, :]).sum(axis=-1)
    return heights.max(axis=-2).min(axis=-1)


def distance_outside(points: np.ndarray, face: np.ndarray) -> np.ndarray:
    """Greatest distance of each point (k, 2) beyond the edge lines of a convex face (k,); negative inside (m)."""
    edge = np.roll(face, -1, axis=0) - face
    outward = np.stack([edge[:, 1], -edge[:, 0]], axis=1) / np.sqrt((edge**2).sum(axis=1))[:, None]
    return (points @ outward.T - (face * outward).sum(axis=1)).max(axis=1)


def nearest_points(points: np.ndarray, face: np.ndarray) -> np.ndarray:
    """The point of a convex face (m, 2) nearest to each of ``points`` (k, 2)."""
    beyond = distance_outside(points, face) > 0.0
    if not beyond.any():
        return points
    edge = np.roll(face, -1, axis=0) - face
    along = ((points[:, None] - face) * edge).sum(axis=2) / (edge**2).sum(axis=1)
    on_edge = face + np.clip(along, 0.0, 1.0)[:, :, None] * edge
    nearest = np.argmin(((points[:, None] - on_edge) ** 2).sum(axis=2), axis=1)
    return np.where(beyond[:, None], on_edge[np.arange(len(points)), nearest], points)
