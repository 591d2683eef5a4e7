"""Plane geometry of joint polygons: clipping, moments, tributary areas, distances from a torsion centre.

A polygon is an array (m, 2) of its corners, counterclockwise, convex. Functions that speak of O expect the corners
to be measured from the centroid.
"""

from __future__ import annotations

import math

import numpy as np

Points = list[tuple[float, float]]

_TINY = 1e-150  # keeps the quotient s/h finite where a torsion centre lies on the line of an edge


def clip(subject: Points, clipper: Points) -> Points:
    """The part of a convex polygon that lies inside another, edge after edge (Sutherland and Hodgman).

    Corners may repeat in either polygon. The result is empty when the polygons are apart, and may be a sliver or
    carry repeated corners when they only touch: see :func:`simplify`.
    """
    x0, y0 = clipper[-1]
    for x1, y1 in clipper:
        ex, ey = x1 - x0, y1 - y0
        sides = [ex * (y - y0) - ey * (x - x0) for x, y in subject]
        if min(sides, default=0.0) < 0.0:
            kept: Points = []
            (px, py), ps = subject[-1], sides[-1]
            for (x, y), side in zip(subject, sides, strict=True):
                if (side < 0.0) != (ps < 0.0):
                    t = ps / (ps - side)
                    kept.append((px + t * (x - px), py + t * (y - py)))
                if side >= 0.0:
                    kept.append((x, y))
                px, py, ps = x, y, side
            subject = kept
        if len(subject) < 3:
            return []
        x0, y0 = x1, y1
    return subject


def simplify(points: Points, tolerance: float) -> Points:
    """The polygon without corners that repeat another, or lie on the line of their neighbours, within ``tolerance``."""
    points = list(points)
    i = 0
    checked = 0  # corners in a row that may stay
    while len(points) >= 3 and checked < len(points):
        i %= len(points)
        (px, py), (x, y), (qx, qy) = points[i - 1], points[i], points[(i + 1) % len(points)]
        chord = math.hypot(qx - px, qy - py)
        ux, uy = x - px, y - py
        double_area = abs(ux * (qy - py) - uy * (qx - px))
        if math.hypot(ux, uy) <= tolerance or double_area <= tolerance * chord:
            del points[i]
            i -= 2
            i %= max(len(points), 1)
            checked = 0
        else:
            i += 1
            checked += 1
    return points if len(points) >= 3 else []


def area_and_centroid(points: Points) -> tuple[float, float, float]:
    """Area and centroid (A, x, y); summed from the first corner, so that a distant origin costs no digits."""
    x0, y0 = points[0]
    double_area = mx = my = 0.0
    for (x1, y1), (x2, y2) in zip(points[1:-1], points[2:], strict=True):
        ux, uy, vx, vy = x1 - x0, y1 - y0, x2 - x0, y2 - y0
        part = ux * vy - uy * vx
        double_area += part
        mx += part * (ux + vx)
        my += part * (uy + vy)
    if double_area == 0.0:
        return 0.0, x0, y0
    return 0.5 * double_area, x0 + mx / (3.0 * double_area), y0 + my / (3.0 * double_area)


def _edges(polygon) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Corners, next corners, and twice the areas of the triangles that the edges make with the origin."""
    p = np.asarray(polygon, float)
    q = np.concatenate([p[1:], p[:1]])
    return p, q, p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]


def area(polygon) -> float:
    """Area of a polygon (m2)."""
    return 0.5 * float(_edges(polygon)[2].sum())


def second_moments(polygon) -> tuple[float, float, float]:
    """Second moments of area (m4) about the origin: the integrals of y^2, x^2 and x y."""
    p, q, cross = _edges(polygon)
    squares = (p * p + p * q + q * q) * cross[:, None] / 12.0
    mixed = (p[:, 0] * (2.0 * p[:, 1] + q[:, 1]) + q[:, 0] * (p[:, 1] + 2.0 * q[:, 1])) * cross / 24.0
    return float(squares[:, 1].sum()), float(squares[:, 0].sum()), float(mixed.sum())


def tributary_areas(polygon) -> np.ndarray:
    """The share of every corner (m,): half of the two triangles that it makes with O and its neighbours.

    The shares add up to the area and their centroid is O; a quarter each for a rectangle.
    """
    _, _, cross = _edges(polygon)
    return 0.25 * (cross + np.concatenate([cross[-1:], cross[:-1]]))


def mean_distance(polygon, centres=((0.0, 0.0),)) -> np.ndarray:
    """Mean distance of the area from each of ``centres`` (k, 2): the friction moment about it over V_0, exact (k,).

    The triangle between the centre and an edge, at distance h with s running along the edge, gives h/3 times the
    integral of hypot(h, s). At O this is c_T (paper eq. 2).
    """
    centres = np.asarray(centres, float)
    p, q, cross = _edges(polygon)
    edge = q - p
    length = np.sqrt((edge**2).sum(axis=1))
    tx, ty = edge.T / length
    ux, uy = p[:, 0] - centres[:, :1], p[:, 1] - centres[:, 1:]
    height = ux * ty - uy * tx
    start = ux * tx + uy * ty
    end = start + length
    lever = np.maximum(np.abs(height), _TINY)

    def integral(s):
        return 0.5 * (s * np.sqrt(height * height + s * s) + height * height * np.arcsinh(s / lever))

    return (height * (integral(end) - integral(start))).sum(axis=1) / (1.5 * cross.sum())


def shrink_factor(polygon) -> float:
    """s = c_T / c (paper eq. 9): mean distance of the area from O over that of the corners, by tributary area."""
    weights = tributary_areas(polygon)
    corners = np.asarray(polygon, float)
    c = float((weights * np.hypot(corners[:, 0], corners[:, 1])).sum() / weights.sum())
    return float(mean_distance(polygon)[0]) / c


def width(polygon) -> float:
    """The short side: the smallest distance of two parallel lines that hold the polygon between them (m)."""
    p, q, _ = _edges(polygon)
    edge = q - p
    inward = np.stack([-edge[:, 1], edge[:, 0]], axis=1) / np.sqrt((edge**2).sum(axis=1))[:, None]
    heights = p @ inward.T - (p * inward).sum(axis=1)
    return float(heights.max(axis=0).min())
