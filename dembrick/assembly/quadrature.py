"""Contact points of the point formulations: their places on a joint, and their tributary areas.

``concave`` and its two corrected forms put one point at every corner. ``distributed`` fills the polygon, by a rule that
did best in a comparison. For slip about a torsion centre C the continuum gives the integral of |r - C|; every set of
points misses the cone of the integrand at C, and so the integral, by about h^3 for points h apart. On 0.3 m x 0.2 m
with 12 x 8 points, the error for the worst centre is 4.4e-3 with points in the middle of equal cells (wrong second
moments), 1.9e-3 with the Gauss-Legendre product rule (too uneven), and 7e-4 with the rule chosen: **pairs of equal
cells in each direction, with the points moved to the Gauss positions of the pair**. On a rectangle all points have the
same area, and moments up to the third are exact.

Over rectangles from 1:1 to 30:1, with 6 to 4000 points, the worst error over all centres was below 0.30 h^3 / (A c_T);
a linear pressure that still closes the whole joint at most doubles it. The spacing for a tolerance follows from that
bound and is verified on the actual polygon. Where bending opens part of the joint, the edge of the pressed part is
resolved to h^2 only, and the error can be larger. For a limit load search on a single closed joint, points on rays from
its torsion centre are far more accurate: see ``ray_quadrature``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from dembrick.geometry import polygons

_CONE = 0.30  # worst error of the rule, uniform pressure, in units of h^3 / (A c_T)
_BENDING = 2.0  # largest factor on that error for a linear pressure on a closed joint
_SAME = 1e-9  # of the polygon's size: corners whose abscissas differ by less are on one line
_MOST_POINTS = 1_000_000
_EDGE_CENTRES = 5  # torsion centres that the check places along every edge
_CHUNK = 1 << 20  # distances per batch


@dataclass(frozen=True, eq=False)
class ContactPoints:
    """Points of one joint, measured from O along t1 and t2 (m).

    ``normal_arm`` (k, 2): points of action of the normal forces; ``shear_arm`` (k, 2): those of friction; ``area``
    (k,): tributary areas (m2).
    """

    normal_arm: np.ndarray
    shear_arm: np.ndarray
    area: np.ndarray


def contact_points(joint, tolerance: float) -> ContactPoints | None:
    """The contact points of a joint by its law; None for ``convex``, which has a resultant instead.

    ``tolerance`` applies to ``distributed`` without ``points``: while the joint is closed, the limit load with points
    then differs from that of the continuum by less than half of it, for any torsion centre.
    """
    law = joint.law
    if law.formulation == "convex":
        return None
    if joint.pieces:
        return _points_of_pieces(joint, tolerance)
    if law.formulation == "distributed":
        arms, areas = distributed_points(joint.polygon, tolerance, law.points)
        return ContactPoints(arms, arms, areas)
    return corner_points(law.formulation, joint.polygon)


def corner_points(formulation: str, corners: np.ndarray) -> ContactPoints:
    """Points at or near the corners of polygons (..., m, 2), for a formulation with one point per corner."""
    areas = polygons.tributary_areas(corners)
    if formulation == "concave":
        return ContactPoints(corners, corners, areas)
    shrunk = polygons.shrink_factor(corners)[..., None, None] * corners
    return ContactPoints(shrunk if formulation == "corrected" else corners, shrunk, areas)


def _points_of_pieces(joint, tolerance: float) -> ContactPoints:
    """The points of every piece by the rule of the law, about the common O.

    The error of ``distributed`` points is within its bound on every piece, hence on the whole.
    """
    arms, areas = [], []
    for piece in joint.pieces:
        _, x, y = polygons.area_and_centroid(piece)
        own = piece - (x, y)
        if joint.law.formulation == "distributed":
            points, shares = distributed_points(own, tolerance, joint.law.points)
        else:
            points, shares = own, polygons.tributary_areas(own)
        arms.append(points + (x, y))
        areas.append(shares)
    normal_arm, area = np.concatenate(arms), np.concatenate(areas)
    if joint.law.formulation in ("distributed", "concave"):
        return ContactPoints(normal_arm, normal_arm, area)
    c = float(area @ np.hypot(*normal_arm.T)) / float(area.sum())
    shrunk = float(polygons.mean_distance(joint.polygon)[0]) / c * normal_arm
    return ContactPoints(shrunk if joint.law.formulation == "corrected" else normal_arm, shrunk, area)


def cells_of(joint, tolerance: float) -> np.ndarray:
    """Corners (k, 4, 2), m, from O, of the cells that points of a ``distributed`` joint represent, in their order."""
    cells = []
    for piece in joint.pieces or [joint.polygon]:
        centre = polygons.area_and_centroid(piece)[1:] if joint.pieces else (0.0, 0.0)
        cells.append(distributed_cells(piece - np.array(centre), tolerance, joint.law.points) + centre)
    return np.concatenate(cells)


def distributed_points(polygon, tolerance: float, points: tuple[int, int] | None = None):
    """Points (k, 2) and areas (k,) that fill a polygon about O, for a tolerance or a given count.

    ``points`` = (n, m): n lines of m points, placed one after another along the edge that is most nearly parallel to
    t1: n x m points on a rectangle; otherwise there are at least two lines between neighbouring corners.
    """
    corners = np.asarray(polygon, float)
    return _fill(corners, *_grid(corners, tolerance, points))


def distributed_cells(polygon, tolerance: float, points: tuple[int, int] | None = None) -> np.ndarray:
    """Corners (k, 4, 2), counter-clockwise, of the cells that `distributed_points` represent, in their order; the cells
    tile the polygon."""
    corners = np.asarray(polygon, float)
    direction, n_line, n_point = _grid(corners, tolerance, points)
    frame = _frame(direction)
    cells = []
    for left, right, bottom, rise, top, fall in _slabs(corners @ frame):
        span = right - left
        lines = np.linspace(-0.5 * span, 0.5 * span, n_line(span, max(abs(rise), abs(fall))) + 1)
        positions, _ = _line_rule(len(lines) - 1)
        for x, *sides in zip(positions * span, lines[:-1], lines[1:], strict=True):
            count = n_point(top + fall * x - bottom - rise * x)
            across = np.linspace(0.0, 1.0, count + 1)
            ends = [
                np.stack(
                    [np.full(count + 1, 0.5 * (left + right) + side), (1.0 - across) * low + across * high], axis=1
                )
                for side in sides
                for low, high in [(bottom + rise * side, top + fall * side)]
            ]
            cells.append(np.stack([ends[0][:-1], ends[1][:-1], ends[1][1:], ends[0][1:]], axis=1))
    return np.concatenate(cells) @ frame.T


def _grid(corners: np.ndarray, tolerance: float, points: tuple[int, int] | None):
    """Direction along which the lines of points are placed; functions for numbers of lines and points: see `_fill`."""
    directions = _directions(corners)
    if points is None:
        size = float(np.sqrt((corners**2).sum(axis=1).max()))
        # Equal joints of a wall differ by rounding only, so the cache key is the rounded, scaled polygon.
        key = tuple(map(tuple, (np.round(corners / size, 10) + 0.0).tolist()))
        spacing, chosen = _layout(key, tolerance)
        return directions[chosen], *_counts(spacing * size)
    nearness = np.abs(directions[::2, 0])
    along = directions[2 * int(np.argmax(nearness > nearness.max() - _SAME))]
    total = float(np.ptp(corners @ along))
    n_along, n_across = points

    def lines(span, _steepness):
        return n_along if span > total * (1.0 - _SAME) else max(2, round(n_along * span / total))

    return along, lines, lambda _length: n_across


def _counts(spacing: float):
    """Functions: lines for the span of a slab with edges of some steepness, and points for the length of a line."""

    def cells(length):
        return max(2, math.ceil(length / spacing * (1.0 - _SAME)))

    # Steep edges shift neighbouring lines; among exponents this one needed the fewest points on random polygons.
    return lambda span, steepness: cells(span * (1.0 + steepness**2) ** 0.25), cells


@lru_cache(maxsize=4096)
def _layout(polygon: tuple, tolerance: float) -> tuple[float, int]:
    """Spacing of the points (in units of the polygon's size) and index of the direction, for a tolerance."""
    corners = np.array(polygon)
    bound = 0.5 * tolerance / _BENDING
    cone = float(polygons.area(corners)) * float(polygons.mean_distance(corners)[0])
    spacing = (bound * cone / _CONE) ** (1.0 / 3.0)
    directions = _directions(corners)
    costs = np.array([_cost(corners, direction, spacing) for direction in directions])
    chosen = int(np.argmax(costs < costs.min() * (1.0 + 1e-6)))
    while True:
        arms, areas = _fill(corners, directions[chosen], *_counts(spacing))
        if len(areas) > _MOST_POINTS or worst_error(corners, arms, areas) <= bound:
            return spacing, chosen
        spacing *= 0.9


def worst_error(polygon, arms, areas) -> float:
    """Largest relative error of the friction moment of points against the continuum, over some 200 torsion centres.

    The centres are O, the points around O, points and midpoints between points all over the joint, and rows along its
    edges, inside and outside. Pure translation has no error, as the areas add up.
    """
    corners = np.asarray(polygon, float)
    near = np.argsort((arms**2).sum(axis=1), kind="stable")[:40]
    spread = np.unique(np.linspace(0, len(arms) - 1, 40).astype(int))
    middles = 0.5 * (arms[near] + arms[near][::-1])
    between = 0.5 * (arms[spread] + arms[np.minimum(spread + 1, len(arms) - 1)])
    steps = (np.arange(_EDGE_CENTRES) + 0.5) / _EDGE_CENTRES
    rim = corners + steps[:, None, None] * (np.concatenate([corners[1:], corners[:1]]) - corners)
    rows = np.concatenate([scale * rim.reshape(-1, 2) for scale in (0.93, 0.985, 1.0, 1.3)])
    centres = np.concatenate([np.zeros((1, 2)), arms[near], middles, arms[spread], between, rows])
    exact = polygons.mean_distance(polygon, centres)
    total = areas.sum()
    worst = 0.0
    step = max(1, _CHUNK // len(arms))
    for first in range(0, len(centres), step):
        some = centres[first : first + step]
        dx, dy = arms[:, 0] - some[:, :1], arms[:, 1] - some[:, 1:]
        gaps = np.sqrt(dx * dx + dy * dy) @ areas / total / exact[first : first + step] - 1.0
        worst = max(worst, float(np.abs(gaps).max()))
    return worst


def _directions(corners: np.ndarray) -> np.ndarray:
    """Unit vectors along every edge and, after each, across it (2 m, 2); those along edges point towards t1."""
    edges = np.concatenate([corners[1:], corners[:1]]) - corners
    edges /= np.sqrt((edges**2).sum(axis=1))[:, None]
    edges[edges[:, 0] < 0.0] *= -1.0
    return np.stack([edges, np.stack([-edges[:, 1], edges[:, 0]], axis=1)], axis=1).reshape(-1, 2)


def _frame(direction) -> np.ndarray:
    """Columns: the direction along which the lines of points are placed, and the direction of the lines."""
    ux, uy = direction
    return np.array([[ux, -uy], [uy, ux]])


def _slabs(turned: np.ndarray):
    """Slabs between neighbouring corners: (left, right, bottom, bottom slope, top, top slope), ordinates mid-slab.

    Corners whose abscissas agree to rounding are on one line. A convex polygon lies above the lines of its lower edges
    and below those of its upper ones.
    """
    x = np.sort(turned[:, 0])
    least = _SAME * (x[-1] - x[0])
    lines = x[np.concatenate([[True], np.diff(x) > least])].tolist()
    lower: list[tuple[float, float, float]] = []
    upper: list[tuple[float, float, float]] = []
    for (x0, y0), (x1, y1) in zip(turned.tolist(), np.roll(turned, -1, axis=0).tolist(), strict=True):
        if abs(x1 - x0) > least:
            slope = (y1 - y0) / (x1 - x0)
            (lower if x1 > x0 else upper).append((x0, y0, slope))
    for left, right in zip(lines[:-1], lines[1:], strict=True):
        middle = 0.5 * (left + right)
        bottom = max((y0 + slope * (middle - x0), slope) for x0, y0, slope in lower)
        top = min((y0 + slope * (middle - x0), slope) for x0, y0, slope in upper)
        yield left, right, *bottom, *top


def _cost(corners: np.ndarray, direction, spacing: float) -> float:
    """Approximate number of points that a direction needs, times the square of the spacing."""
    cost = 0.0
    for left, right, bottom, rise, top, fall in _slabs(corners @ _frame(direction)):
        cost += (top - bottom) * ((right - left) * (1.0 + max(rise * rise, fall * fall)) ** 0.25 + spacing)
    return cost


def _fill(corners: np.ndarray, direction, n_line, n_point):
    """Points and areas, slab by slab: lines of points across each slab, ``n_line(span, steepness)`` of them.

    A line of some length has ``n_point(length)`` points. Both rules integrate cubics exactly, so that area, centroid
    and second moments of the polygon are exact to rounding.
    """
    frame = _frame(direction)
    parts = []
    for left, right, bottom, rise, top, fall in _slabs(corners @ frame):
        positions, cell = _line_rule(n_line(right - left, max(abs(rise), abs(fall))))
        for x in (positions * (right - left)).tolist():
            start = bottom + rise * x
            length = top + fall * x - start
            offsets, share = _line_rule(n_point(length))
            part = np.empty((3, len(offsets)))
            part[0] = 0.5 * (left + right) + x
            part[1] = start + (0.5 + offsets) * length
            part[2] = share * length * cell * (right - left)
            parts.append(part)
    x, y, areas = np.concatenate(parts, axis=1)
    return np.stack([x, y], axis=1) @ frame.T, areas * (polygons.area(corners) / areas.sum())


@lru_cache(maxsize=1024)
def _line_rule(count: int) -> tuple[np.ndarray, float]:
    """Positions of ``count`` points on a line from -1/2 to 1/2, symmetric, and their common weight.

    Equal cells in pairs, with the points of a pair at its Gauss positions. For an odd count the three or five cells in
    the middle form one group (Chebyshev's points of equal weight), which leaves equal numbers of pairs on both sides.
    """
    cell = 1.0 / count
    if count == 1:
        return np.zeros(1), cell
    pair = np.array([-1.0, 1.0]) / math.sqrt(3.0)
    if count % 2 == 0:
        return (np.add.outer(2.0 * np.arange(count // 2) + 1.0, pair).ravel() - 0.5 * count) * cell, cell
    if count % 4 == 3:
        middle = 1.5 * np.array([-1.0, 0.0, 1.0]) / math.sqrt(2.0)
    else:
        inner, outer = (math.sqrt((5.0 + sign * math.sqrt(11.0)) / 12.0) for sign in (-1.0, 1.0))
        middle = 2.5 * np.array([-outer, -inner, 0.0, inner, outer])
    n_side = (count - len(middle)) // 4
    left = np.add.outer(2.0 * np.arange(n_side) + 1.0, pair).ravel() - 0.5 * count
    return np.concatenate([left, middle, -left[::-1]]) * cell, cell
