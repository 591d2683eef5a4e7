"""Contact points: corners, shrunk corners, and quadrature rules that meet the tolerance."""

import numpy as np
import pytest

from dembrick.assembly import quadrature
from dembrick.assembly.quadrature import contact_points
from dembrick.geometry import polygons
from dembrick.geometry.polygons import second_moments, shrink_factor
from dembrick.geometry.rotations import rotation_matrix
from helpers.lone_joints import lab_joint, rectangle
from helpers.random_polygons import random_polygon


def test_corner_formulations():
    s = shrink_factor(rectangle(0.3, 0.2))
    corners = lab_joint().polygon
    concave, corrected, shear = (
        contact_points(lab_joint(f), 1e-3) for f in ("concave", "corrected", "corrected-shear")
    )
    assert contact_points(lab_joint("convex"), 1e-3) is None
    for points in (concave, corrected, shear):
        assert points.area == pytest.approx(np.full(4, 0.015), rel=1e-14)
    assert concave.normal_arm == pytest.approx(corners) and concave.shear_arm == pytest.approx(corners)
    assert corrected.normal_arm == pytest.approx(s * corners) and corrected.shear_arm == pytest.approx(s * corners)
    assert shear.normal_arm == pytest.approx(corners) and shear.shear_arm == pytest.approx(s * corners)
    mean = (corrected.area @ np.hypot(*corrected.shear_arm.T)) / 0.06
    assert mean == pytest.approx(0.09681061, abs=5e-9)  # pure torsion of eq. (10)


@pytest.mark.parametrize("count", [*range(1, 14), 30, 61])
def test_points_on_a_line_share_one_weight_and_meet_the_second_moment(count):
    positions, weight = quadrature._line_rule(count)
    assert len(positions) == count and weight == 1.0 / count
    assert positions == pytest.approx(-positions[::-1], abs=1e-15)
    assert (np.diff(positions) > 0.8 / count).all() and abs(positions).max(initial=0.0) < 0.5
    if count > 1:
        assert weight * (positions**2).sum() == pytest.approx(1.0 / 12.0, rel=1e-13)


def moments_met(polygon, arms, areas, rel=1e-12):
    xx, yy, xy = areas @ arms[:, 0] ** 2, areas @ arms[:, 1] ** 2, areas @ (arms[:, 0] * arms[:, 1])
    size = np.abs(polygon).max()
    assert areas.sum() == pytest.approx(polygons.area(polygon), rel=1e-14)
    assert areas @ arms == pytest.approx([0.0, 0.0], abs=rel * areas.sum() * size)
    assert (yy, xx, xy) == pytest.approx(second_moments(polygon), rel=rel, abs=rel * areas.sum() * size**2)
    assert (areas > 0.0).all()


@pytest.mark.parametrize("points", [(2, 2), (8, 8), (9, 6), (5, 3)])
def test_given_points_fill_a_rectangle_with_equal_areas(points):
    rule = contact_points(lab_joint("distributed", points=points), 1e-3)
    assert rule.area == pytest.approx(np.full(points[0] * points[1], 0.06 / (points[0] * points[1])), rel=1e-12)
    assert rule.normal_arm is rule.shear_arm
    assert len(np.unique(rule.normal_arm[:, 0].round(12))) == points[0]  # n along t1
    assert len(np.unique(rule.normal_arm[:, 1].round(12))) == points[1]
    moments_met(rectangle(0.3, 0.2), rule.normal_arm, rule.area)


@pytest.mark.parametrize("points", [None, (5, 3), (1, 1), (4, 16)])
def test_cells_of_points_are_the_polygon(points):
    """Each cell contains its own point, and together they fill the polygon without overlap."""
    draw = np.random.default_rng(3)
    for polygon in [rectangle(0.3, 0.2), *(random_polygon(draw) for _ in range(20))]:
        arms, areas = quadrature.distributed_points(polygon, 1e-2, points)
        cells = quadrature.distributed_cells(polygon, 1e-2, points)
        assert len(cells) == len(arms)
        own = np.array([polygons.area(cell) for cell in cells])
        assert own.min() > 0.0 and own.sum() == pytest.approx(polygons.area(polygon), rel=1e-9)
        size = np.abs(polygon).max()
        assert polygons.distance_outside(cells.reshape(-1, 2), np.asarray(polygon)).max() < 1e-9 * size
        edges = np.roll(cells, -1, axis=1) - cells
        sides = arms[:, None] - cells
        assert (edges[..., 0] * sides[..., 1] - edges[..., 1] * sides[..., 0]).min() > -1e-9 * size**2
        assert np.all(areas > 0.0)


def test_the_rule_beats_equal_cells_and_the_gauss_product_rule():
    """Gaps of three rules of 12 x 8 points on 0.3 x 0.2, the numbers behind the choice of rule."""
    polygon = rectangle(0.3, 0.2)
    rng = np.random.default_rng(0)

    def worst(arms, areas):
        centres = np.concatenate([rng.uniform(-0.6, 0.6, (2000, 2)) * [0.3, 0.2], arms])
        r = np.hypot(arms[:, 0] - centres[:, :1], arms[:, 1] - centres[:, 1:])
        return np.abs(r @ areas / areas.sum() / polygons.mean_distance(polygon, centres) - 1.0).max()

    def product(x, wx, y, wy):
        return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2), np.outer(wx, wy).ravel()

    cells = product((np.arange(12) - 5.5) * 0.025, np.ones(12), (np.arange(8) - 3.5) * 0.025, np.ones(8))
    (x, wx), (y, wy) = np.polynomial.legendre.leggauss(12), np.polynomial.legendre.leggauss(8)
    chosen = contact_points(lab_joint("distributed", points=(12, 8)), 1e-3)
    assert worst(*cells) == pytest.approx(4.3e-3, abs=1e-4)
    assert worst(*product(0.15 * x, wx, 0.1 * y, wy)) == pytest.approx(1.9e-3, abs=1e-4)
    assert worst(chosen.shear_arm, chosen.area) == pytest.approx(7.0e-4, abs=2e-5)
    torsion = cells[1] @ np.hypot(*cells[0].T) / 96 / 0.0968106
    assert torsion == pytest.approx(0.9964, abs=5e-5)  # the published figure for equal cells


def dense_gap(polygon, arms, areas, rng, pressure=None):
    """Worst relative gap over many centres, near points and elsewhere; ``pressure``: slope vector of the pressure."""
    reach = np.abs(polygon).max(axis=0)
    centres = np.concatenate([rng.uniform(-1, 1, (600, 2)) * reach, rng.normal(size=(200, 2)) * reach, [[0.0, 0.0]]])
    near = arms[np.argsort((arms**2).sum(axis=1))[:150]]
    centres = np.concatenate([centres, near, arms[rng.integers(0, len(arms), 150)]])
    if pressure is None:
        exact, weights = polygons.mean_distance(polygon, centres), areas
    else:
        fine, fine_areas = quadrature.distributed_points(polygon, 1e-3, (160, 160))
        fine_areas = fine_areas * (1.0 + fine @ pressure)
        exact = np.array([np.hypot(*(fine - c).T) @ fine_areas for c in centres]) / fine_areas.sum()
        weights = areas * (1.0 + arms @ pressure)
    gaps = [np.hypot(*(arms - c).T) @ weights for c in centres] / weights.sum() / exact - 1.0
    return np.abs(gaps).max()


@pytest.mark.parametrize("tolerance", [0.1, 1e-2, 1e-3, 1e-4])
@pytest.mark.parametrize("aspect", [0.1, 0.3, 1.0, 1.5, 10.0])
def test_points_follow_from_the_tolerance(aspect, tolerance):
    rng = np.random.default_rng(1)
    polygon = rectangle(0.2 * aspect, 0.2)
    arms, areas = quadrature.distributed_points(polygon, tolerance)
    moments_met(polygon, arms, areas)
    gap = dense_gap(polygon, arms, areas, rng)
    assert gap <= 1.05 * 0.25 * tolerance
    assert tolerance == 0.1 or gap > 0.1 * tolerance  # no more points than needed
    counts = [len(np.unique(arms[:, i].round(12))) for i in (0, 1)]
    assert counts[0] * counts[1] == len(arms)
    if tolerance <= 1e-3 and 0.3 <= aspect <= 1.5:
        assert counts[0] / counts[1] == pytest.approx(aspect, rel=0.1)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3])
@pytest.mark.parametrize("slope", [(2.0 / 0.3, 0.0), (0.0, 2.0 / 0.2), (-1.0 / 0.3, 1.0 / 0.2)])
def test_bending_that_still_closes_the_joint_keeps_the_gap_below_half_the_tolerance(slope, tolerance):
    polygon = rectangle(0.3, 0.2)
    arms, areas = quadrature.distributed_points(polygon, tolerance)
    assert dense_gap(polygon, arms, areas, np.random.default_rng(2), np.array(slope)) <= 0.5 * tolerance


@pytest.mark.parametrize("seed", range(8))
def test_points_fill_general_polygons(seed):
    rng = np.random.default_rng(seed)
    polygon = 0.2 * random_polygon(rng, n=int(rng.integers(3, 15)), stretch=rng.uniform(0.3, 3.0))
    for tolerance in (1e-2, 1e-3):
        arms, areas = quadrature.distributed_points(polygon, tolerance)
        moments_met(polygon, arms, areas)
        assert dense_gap(polygon, arms, areas, rng) <= 0.5 * tolerance
    moments_met(polygon, *quadrature.distributed_points(polygon, 1e-3, (7, 5)))


def test_counts_stay_sensible_to_a_millionth():
    counts = [len(quadrature.distributed_points(rectangle(0.3, 0.2), 10.0**-k)[1]) for k in range(2, 7)]
    assert counts == sorted(counts) and 40 <= counts[0] <= 70 and 800 <= counts[2] <= 1200 and counts[4] < 25_000
    turned = rectangle(0.3, 0.2) @ rotation_matrix((np.cos(0.3), 0, 0, np.sin(0.3)))[:2, :2].T
    assert len(quadrature.distributed_points(turned, 1e-3)[1]) == counts[1]  # no slivers if corners are collinear
