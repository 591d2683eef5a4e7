"""Random convex polygons about their centroids."""

import numpy as np

from dembrick.geometry import polygons


def random_polygon(rng, n=12, stretch=1.0):
    """Convex hull of random points, about its centroid, counterclockwise."""
    points = sorted(map(tuple, rng.normal(size=(n, 2)) * [stretch, 1.0]))

    def chain(points):
        kept = []
        for p in points:
            while len(kept) > 1 and np.linalg.det([np.subtract(kept[-1], kept[-2]), np.subtract(p, kept[-2])]) <= 0:
                kept.pop()
            kept.append(p)
        return kept[:-1]

    hull = np.array(chain(points) + chain(points[::-1]))
    return hull - polygons.area_and_centroid([tuple(p) for p in hull])[1:]


def slender_polygon(rng, size=1.0):
    """A convex polygon of three to nine corners about its centroid, up to about 30 times as long as wide."""
    n = rng.integers(3, 10)
    angle = np.sort((np.arange(n) + rng.uniform(0.15, 0.85, n)) * 2 * np.pi / n)
    corners = np.column_stack([np.cos(angle), np.sin(angle)]) * [1.0, 10 ** rng.uniform(-1.5, 0)]
    turn = rng.uniform(0, 2 * np.pi)
    corners = size * corners @ [[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]
    return corners - polygons.area_and_centroid([tuple(c) for c in corners])[1:]


def slenderness(polygon):
    """Cancellation factor of edge sums over a polygon: 2.8 for a square, length over width for a slender joint."""
    length = np.linalg.norm(np.roll(polygon, -1, axis=0) - polygon, axis=1).sum()
    return length * np.hypot(*polygon.T).max() / polygons.area(polygon)
