"""Polygons: areas, second moments and mean distances, compared with closed forms and plain sums."""

import numpy as np
import pytest

from dembrick.geometry import polygons
from dembrick.geometry.polygons import second_moments, shrink_factor, tributary_areas
from dembrick.geometry.rotations import rotation_matrix
from helpers.lone_joints import rectangle
from helpers.random_polygons import random_polygon


def by_triangles(polygon, function, levels=7):
    """Mean of a function over a polygon, from fan triangles split ``levels`` times with three points each."""
    total = weight = 0.0
    p, q = np.asarray(polygon), np.roll(polygon, -1, axis=0)
    corners = np.stack([np.zeros_like(p), p, q], axis=1)
    for _ in range(levels):
        u, v, w = corners[:, 0], corners[:, 1], corners[:, 2]
        uv, vw, wu = (u + v) / 2, (v + w) / 2, (w + u) / 2
        corners = np.concatenate([np.stack(t, axis=1) for t in ((u, uv, wu), (uv, v, vw), (wu, vw, w), (uv, vw, wu))])
    edge, side = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = 0.5 * (edge[:, 0] * side[:, 1] - edge[:, 1] * side[:, 0])
    for i in range(3):
        middle = 0.5 * (corners[:, i] + corners[:, (i + 1) % 3])
        total += (area * function(middle)).sum() / 3.0
        weight += area.sum() / 3.0
    return total / weight


def test_rectangle_in_closed_form():
    a, b = 0.3, 0.2
    polygon = rectangle(a, b)
    assert tributary_areas(polygon) == pytest.approx(np.full(4, a * b / 4.0), rel=1e-15)
    assert second_moments(polygon) == pytest.approx((a * b**3 / 12.0, b * a**3 / 12.0, 0.0), rel=1e-14, abs=1e-19)
    assert polygons.mean_distance(polygon)[0] == pytest.approx(0.09681061, abs=5e-9)  # c_T, which is M_C at O
    assert shrink_factor(polygon) == pytest.approx(0.09681061 / np.hypot(0.15, 0.1), rel=1e-7)
    assert polygons.width(polygon) == pytest.approx(0.2, rel=1e-15)
    assert polygons.width(polygon @ rotation_matrix((np.cos(0.4), 0, 0, np.sin(0.4)))[:2, :2].T) == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("corner", "moment"), [((-0.05, -0.03), 0.14475335), ((0.10, 0.05), 0.29930206), ((-0.03, 0.20), 0.33380836)]
)
def test_mean_distance_about_other_centres(corner, moment):
    """Tabulated rows of the limit surface: moment about C, for the position of the lower corner relative to C."""
    centre = np.array([-0.15, -0.1]) - corner
    assert polygons.mean_distance(rectangle(0.3, 0.2), [centre])[0] == pytest.approx(moment, abs=5e-9)


def test_mean_distance_is_finite_on_corners_edges_and_their_lines():
    centres = [[0.15, 0.1], [0.15, 0.0], [0.15, 0.3], [-0.15, -0.1]]
    values = polygons.mean_distance(rectangle(0.3, 0.2), centres)
    nearby = polygons.mean_distance(rectangle(0.3, 0.2), np.add(centres, 1e-9))
    assert values == pytest.approx(nearby, rel=1e-7)


@pytest.mark.parametrize("seed", range(6))
def test_general_polygons_against_plain_sums(seed):
    rng = np.random.default_rng(seed)
    polygon = random_polygon(rng, n=int(rng.integers(3, 15)), stretch=rng.uniform(0.3, 3.0))
    area = polygons.area(polygon)
    weights = tributary_areas(polygon)
    assert weights.sum() == pytest.approx(area, rel=1e-14)
    assert weights @ polygon == pytest.approx([0.0, 0.0], abs=1e-13)
    assert (weights > 0.0).all()
    xx = by_triangles(polygon, lambda r: r[:, 0] ** 2, 2) * area
    yy = by_triangles(polygon, lambda r: r[:, 1] ** 2, 2) * area
    xy = by_triangles(polygon, lambda r: r[:, 0] * r[:, 1], 2) * area
    assert second_moments(polygon) == pytest.approx((yy, xx, xy), rel=1e-12, abs=1e-13)
    centre = rng.normal(size=2)
    plain = by_triangles(polygon, lambda r: np.hypot(*(r - centre).T))
    assert polygons.mean_distance(polygon, [centre])[0] == pytest.approx(plain, rel=2e-5)
    spans = [np.ptp(polygon @ (np.cos(t), np.sin(t))) for t in np.linspace(0.0, np.pi, 20001)]
    assert min(spans) * (1.0 - 1e-3) <= polygons.width(polygon) <= min(spans) * (1.0 + 1e-12)
