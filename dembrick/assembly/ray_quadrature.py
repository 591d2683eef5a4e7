"""Contact points of a distributed joint on rays from its torsion centre.

The friction moment of a slip about C is the integral of p |r - C|: smooth except for a cone at C. Points on a regular
lattice miss the cone, and so the integral, by about the cube of their distance, wherever they are. On rays from C the
cone does no harm: along a ray the integrand is a polynomial (of third degree with a linear pressure), across the rays
it is analytic, and Gauss points converge exponentially. On 0.3 m x 0.2 m the error is 4e-5 with 48 points and 1e-7 with
96, where a lattice needs 216 and some 20,000.

Such points are accurate for one torsion centre only. They suit the search for a limit load, which finds the centre as
it proceeds, but no test in which the centre moves.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from dembrick.geometry import polygons

_SLIVER = 1e-12  # of the polygon's size squared: a thinner triangle gets no points
_GROWTH = 3.0  # growth ratio of the pieces of a ray or an edge, away from where the integrand varies most
_LAST = 0.7  # a piece that would begin beyond this part of the length is merged with the one before


def rays(polygon, centre, across: int, along: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (k, 2) and areas (k,) on rays from the torsion centre (2,) over a convex polygon (m, 2) about O.

    Every edge spans a triangle with the centre, or with the nearest point of the polygon; ``across`` rays fan out over
    each piece of an edge, with ``along`` points on each piece of a ray, all at Gauss positions. Where the centre lies
    near an edge, inside or outside, the pieces get shorter towards it.
    """
    corners = np.asarray(polygon, float)
    centre = np.asarray(centre, float)
    size = float(np.abs(corners).max())
    apex = polygons.nearest_points(centre[None], corners)[0]
    distance = float(np.hypot(*(centre - apex)))
    arms, areas = [], []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        edge, out = b - a, a - apex
        double_area = float(out[0] * edge[1] - out[1] * edge[0])
        if double_area <= _SLIVER * size * size:
            continue
        length = float(np.hypot(*edge))
        height = double_area / length
        foot = min(1.0, max(0.0, -float(out @ edge) / length**2))
        t, share = _both_ways(foot, height / length, across)
        s, part = _graded(distance / float(np.hypot(*(out + 0.5 * edge))) if distance else 1.0, along)
        ends = out + t[:, None] * edge
        arms.append((apex + s[:, None, None] * ends).reshape(-1, 2))
        areas.append(((part * s)[:, None] * share * double_area).ravel())
    return np.concatenate(arms), np.concatenate(areas)


def rays_over(pieces, centre, across: int, along: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (k, 2) and areas (k,) of `rays` over all convex ``pieces`` of a joint, about one torsion centre."""
    arms, areas = zip(*(rays(piece, centre, across, along) for piece in pieces), strict=True)
    return np.concatenate(arms), np.concatenate(areas)


def _both_ways(foot: float, scale: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss positions and weights on (0, 1), finest near ``foot``; there the integrand varies over a ``scale``."""
    parts = []
    for end in (0.0, 1.0):
        span = abs(end - foot)
        if span > _SLIVER:
            x, weight = _graded(scale / span, count)
            parts.append((foot + (end - foot) * x, span * weight))
    positions, weights = zip(*parts, strict=True)
    return np.concatenate(positions), np.concatenate(weights)


def _graded(scale: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss positions and weights on (0, 1), in pieces that grow from a first one of length ``scale``."""
    cuts = [0.0]
    while scale < _LAST:
        cuts.append(scale)
        scale *= _GROWTH
    cuts.append(1.0)
    x, weight = _gauss(count)
    widths = np.diff(cuts)[:, None]
    return (np.array(cuts[:-1])[:, None] + widths * x).ravel(), (widths * weight).ravel()


@lru_cache(maxsize=64)
def _gauss(count: int) -> tuple[np.ndarray, np.ndarray]:
    """The Gauss-Legendre rule of ``count`` points on (0, 1)."""
    x, weight = np.polynomial.legendre.leggauss(count)
    return 0.5 * (x + 1.0), 0.5 * weight


def fine_rays(pieces, centre) -> tuple[np.ndarray, np.ndarray]:
    """Points that represent the continuum of convex ``pieces``: over 1,000 centres the error of the friction moment of
    a rectangle was at most 2e-11."""
    return rays_over(pieces, centre, 10, 8)


def friction_moment(arms, areas, centre, pressure) -> float:
    """Sum of pressure |r - centre| over points; ``pressure`` = (level, slope_1, slope_2) is linear about O."""
    pressed = areas * (pressure[0] + arms @ np.asarray(pressure[1:]))
    x, y = (arms - np.asarray(centre)).T
    return float(np.sqrt(x * x + y * y) @ pressed)
