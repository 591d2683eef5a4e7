"""Joints: found wherever faces face each other, with exact polygons, axes by the rules, and contact points."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dembrick import joints as joints_module
from dembrick import neighbours, point_rules, polygons
from dembrick.joints import contact_points, find_joints, second_moments, shrink_factor, tributary_areas
from dembrick.model import JointLaw
from dembrick.shapes import Polyhedron, box, quaternion_product, rotation_matrix, unit_quaternion

UNTURNED = (1.0, 0.0, 0.0, 0.0)
LAB = (0.3, 0.2, 0.1)
QUARTER_Z = (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))
QUARTER_X = (np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0)


def law(formulation="concave", **other):
    return JointLaw(formulation, 0.64, 1e10, 4e9, **other)


def joints_of(*blocks, fixed=(), tolerance=joints_module.TOLERANCE, formulation="concave"):
    """``blocks``: (edges or shape, position, orientation)."""
    shapes = [edges if isinstance(edges, Polyhedron) else box(edges) for edges, _, _ in blocks]
    where = [position for _, position, _ in blocks]
    turned = [orientation for _, _, orientation in blocks]
    held = [i in fixed for i in range(len(blocks))]
    return find_joints(shapes, where, turned, held, lambda a, b: law(formulation), tolerance)


def lab_joint(formulation="concave", a=0.3, b=0.2, **other):
    joint = joints_of(((a, b, 0.1), (0, 0, -0.05), UNTURNED), ((a, b, 0.1), (0, 0, 0.05), UNTURNED), fixed=[0])[0]
    return joints_module.Joint(**{**vars(joint), "law": law(formulation, **other)})


def rectangle(a, b):
    return np.array([[-a, -b], [a, -b], [a, b], [-a, b]]) / 2.0


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


def by_triangles(polygon, function, levels=7):
    """Mean of a function over a polygon: fan triangles split ``levels`` times, three points each. Slow and plain."""
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


# --- polygons ---------------------------------------------------------------------------------------------------------


def test_rectangle_in_closed_form():
    a, b = 0.3, 0.2
    polygon = rectangle(a, b)
    assert tributary_areas(polygon) == pytest.approx(np.full(4, a * b / 4.0), rel=1e-15)
    assert second_moments(polygon) == pytest.approx((a * b**3 / 12.0, b * a**3 / 12.0, 0.0), rel=1e-14, abs=1e-19)
    assert polygons.mean_distance(polygon)[0] == pytest.approx(0.09681061, abs=5e-9)  # c_T of physics, M_C at O
    assert shrink_factor(polygon) == pytest.approx(0.09681061 / np.hypot(0.15, 0.1), rel=1e-7)
    assert polygons.width(polygon) == pytest.approx(0.2, rel=1e-15)
    assert polygons.width(polygon @ rotation_matrix((np.cos(0.4), 0, 0, np.sin(0.4)))[:2, :2].T) == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("corner", "moment"), [((-0.05, -0.03), 0.14475335), ((0.10, 0.05), 0.29930206), ((-0.03, 0.20), 0.33380836)]
)
def test_mean_distance_about_other_centres(corner, moment):
    """Check rows of the limit surface: the moment about C, with the lower corner of the rectangle seen from C."""
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


# --- contact points ---------------------------------------------------------------------------------------------------


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
    positions, weight = point_rules._line_rule(count)
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


def test_the_rule_beats_equal_cells_and_the_gauss_product_rule():
    """12 x 8 points on 0.3 x 0.2: the numbers that the choice rests on."""
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
    """Worst relative gap over many centres, next to points and all around; ``pressure``: slope vector of it."""
    reach = np.abs(polygon).max(axis=0)
    centres = np.concatenate([rng.uniform(-1, 1, (600, 2)) * reach, rng.normal(size=(200, 2)) * reach, [[0.0, 0.0]]])
    near = arms[np.argsort((arms**2).sum(axis=1))[:150]]
    centres = np.concatenate([centres, near, arms[rng.integers(0, len(arms), 150)]])
    if pressure is None:
        exact, weights = polygons.mean_distance(polygon, centres), areas
    else:
        fine, fine_areas = point_rules.distributed_points(polygon, 1e-3, (160, 160))
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
    arms, areas = point_rules.distributed_points(polygon, tolerance)
    moments_met(polygon, arms, areas)
    gap = dense_gap(polygon, arms, areas, rng)
    assert gap <= 1.05 * 0.25 * tolerance
    assert tolerance == 0.1 or gap > 0.1 * tolerance  # and no more points than that needs
    counts = [len(np.unique(arms[:, i].round(12))) for i in (0, 1)]
    assert counts[0] * counts[1] == len(arms)
    if tolerance <= 1e-3 and 0.3 <= aspect <= 1.5:
        assert counts[0] / counts[1] == pytest.approx(aspect, rel=0.1)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3])
@pytest.mark.parametrize("slope", [(2.0 / 0.3, 0.0), (0.0, 2.0 / 0.2), (-1.0 / 0.3, 1.0 / 0.2)])
def test_bending_that_still_closes_the_joint_keeps_the_gap_below_half_the_tolerance(slope, tolerance):
    polygon = rectangle(0.3, 0.2)
    arms, areas = point_rules.distributed_points(polygon, tolerance)
    assert dense_gap(polygon, arms, areas, np.random.default_rng(2), np.array(slope)) <= 0.5 * tolerance


@pytest.mark.parametrize("seed", range(8))
def test_points_fill_general_polygons(seed):
    rng = np.random.default_rng(seed)
    polygon = 0.2 * random_polygon(rng, n=int(rng.integers(3, 15)), stretch=rng.uniform(0.3, 3.0))
    for tolerance in (1e-2, 1e-3):
        arms, areas = point_rules.distributed_points(polygon, tolerance)
        moments_met(polygon, arms, areas)
        assert dense_gap(polygon, arms, areas, rng) <= 0.5 * tolerance
    moments_met(polygon, *point_rules.distributed_points(polygon, 1e-3, (7, 5)))


def test_counts_stay_sensible_to_a_millionth():
    counts = [len(point_rules.distributed_points(rectangle(0.3, 0.2), 10.0**-k)[1]) for k in range(2, 7)]
    assert counts == sorted(counts) and 40 <= counts[0] <= 70 and 800 <= counts[2] <= 1200 and counts[4] < 25_000
    turned = rectangle(0.3, 0.2) @ rotation_matrix((np.cos(0.3), 0, 0, np.sin(0.3)))[:2, :2].T
    assert len(point_rules.distributed_points(turned, 1e-3)[1]) == counts[1]  # no slivers where corners share a line


# --- joints -----------------------------------------------------------------------------------------------------------


def test_the_lab_joint():
    (joint,) = joints_of((LAB, (0, 0, -0.05), UNTURNED), (LAB, (0, 0, 0.05), UNTURNED), fixed=[0])
    assert (joint.block_a, joint.block_b, joint.host) == (0, 1, 1)
    assert joint.origin == pytest.approx([0, 0, 0], abs=1e-16) and joint.axes == pytest.approx(np.eye(3), abs=0.0)
    assert joint.polygon == pytest.approx(rectangle(0.3, 0.2), abs=1e-16)
    assert joint.area == pytest.approx(0.06, rel=1e-15) and joint.gap == 0.0
    assert joint.arm_a == pytest.approx([0, 0, 0.05], abs=1e-16) and joint.arm_b == pytest.approx(
        [0, 0, -0.05], abs=1e-16
    )


def test_the_first_block_is_a_unless_the_second_alone_is_fixed():
    upper, lower = (LAB, (0, 0, 0.05), UNTURNED), (LAB, (0, 0, -0.05), UNTURNED)
    (joint,) = joints_of(upper, lower, fixed=[1])
    assert (joint.block_a, joint.block_b) == (1, 0) and joint.axes[2] == pytest.approx([0, 0, 1], abs=0.0)
    (joint,) = joints_of(upper, lower, fixed=[0])
    assert (joint.block_a, joint.block_b) == (0, 1) and joint.axes[2] == pytest.approx([0, 0, -1], abs=0.0)
    (joint,) = joints_of(upper, lower)
    assert (joint.block_a, joint.block_b) == (0, 1)
    assert joint.axes[0] == pytest.approx([1, 0, 0], abs=0.0) and joint.axes[1] == pytest.approx([0, -1, 0], abs=0.0)
    assert not len(joints_of(upper, lower, fixed=[0, 1]))


def test_t1_is_the_first_body_axis_of_a_off_the_normal():
    (head,) = joints_of((LAB, (0, 0, 0), UNTURNED), (LAB, (0.3, 0, 0), UNTURNED))
    assert head.axes == pytest.approx(np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]]), abs=0.0)
    assert head.polygon == pytest.approx(rectangle(0.2, 0.1), abs=1e-16)
    (turned,) = joints_of((LAB, (0, 0, 0), QUARTER_Z), (LAB, (0, 0, 0.1), UNTURNED))
    assert turned.axes[0] == pytest.approx([0, 1, 0], abs=1e-15)
    assert turned.polygon == pytest.approx(rectangle(0.2, 0.2), abs=1e-15)


def test_the_smaller_face_hosts_the_polygon_and_carries_its_centroid():
    gap = 2e-8
    for fixed in ([0], [1]):
        small_above = joints_of(
            ((1, 1, 0.1), (0, 0, -0.05), UNTURNED), (LAB, (0.2, 0, 0.05 + gap), UNTURNED), fixed=fixed
        )[0]
        assert small_above.host == 1 and small_above.gap == pytest.approx(gap, rel=1e-6)
        assert small_above.origin == pytest.approx([0.2, 0, gap], abs=1e-15)
    small_below = joints_of((LAB, (0, 0, -0.05), UNTURNED), ((1, 1, 0.1), (0, 0, 0.05 + gap), UNTURNED), fixed=[0])[0]
    assert small_below.host == 0 and small_below.origin == pytest.approx([0, 0, 0], abs=1e-16)


def test_running_bond_and_t_contacts():
    course = [(LAB, (0.3 * i, 0.0, 0.05), UNTURNED) for i in range(3)]
    above = [(LAB, (0.15 + 0.3 * i, 0.0, 0.15), UNTURNED) for i in range(2)]
    floor = ((2.0, 1.0, 0.1), (0.3, 0.0, -0.05), UNTURNED)
    found = joints_of(*course, *above, floor, fixed=[5])
    pairs = {(joint.block_a, joint.block_b): joint for joint in found}
    beds = {(0, 3), (1, 3), (1, 4), (2, 4)}
    assert set(pairs) == beds | {(0, 1), (1, 2), (3, 4)} | {(5, 0), (5, 1), (5, 2)}
    for pair in beds:
        assert pairs[pair].area == pytest.approx(0.15 * 0.2, rel=1e-12)
    assert pairs[1, 3].origin == pytest.approx([0.225, 0, 0.1], abs=1e-15)
    for pair in ((5, 0), (5, 1), (5, 2)):
        assert pairs[pair].area == pytest.approx(0.06, rel=1e-12) and pairs[pair].host == pair[1]


def test_perpendicular_blocks_meet_face_to_face():
    """A block lying on its side against another, and a third standing on both at a step of equal height."""
    upright = (LAB, (0.15 + 0.05, 0.0, 0.1), quaternion_product(QUARTER_Z, QUARTER_X))
    edges = np.ptp(box(LAB).moved(upright[1], upright[2]), axis=0)
    assert edges == pytest.approx([0.1, 0.3, 0.2], abs=1e-15)
    (joint,) = joints_of((LAB, (0, 0, 0.05), UNTURNED), upright)
    assert joint.axes[2] == pytest.approx([1, 0, 0], abs=1e-15)
    assert joint.area == pytest.approx(0.2 * 0.1, rel=1e-12) and joint.origin == pytest.approx(
        [0.15, 0, 0.05], abs=1e-15
    )


def test_edges_corners_and_distant_faces_make_no_joint():
    base = (LAB, (0, 0, 0), UNTURNED)
    for position in ((0.3, 0.2, 0), (0.3, 0, 0.1), (0.3, 0.2, 0.1), (0, 0, 0.1 + 1e-5), (0.31, 0, 0)):
        assert not len(joints_of(base, (LAB, position, UNTURNED)))
    tilt = 1e-5
    assert not len(joints_of(base, (LAB, (0, 0, 0.1), (np.cos(tilt / 2), np.sin(tilt / 2), 0, 0))))
    tilt = 1e-7
    assert len(joints_of(base, (LAB, (0, 0, 0.1), (np.cos(tilt / 2), np.sin(tilt / 2), 0, 0)))) == 1


@pytest.mark.parametrize("small", [(0, 1), (1, 0), (0, 0)])
def test_the_tolerance_is_a_millionth_of_the_smaller_diameter(small):
    sizes = [(1.0, 0.1)[i] if small != (0, 0) else 0.1 for i in small]
    edges = [tuple(size * e for e in LAB) for size in sizes]
    diameter = 0.1 * np.linalg.norm(LAB)
    for factor, count in ((0.9, 1), (1.1, 0), (-0.9, 1), (-1.1, 0)):
        rise = 0.5 * (edges[0][2] + edges[1][2]) + factor * 1e-6 * diameter
        assert len(joints_of((edges[0], (0, 0, 0), UNTURNED), (edges[1], (0, 0, rise), UNTURNED))) == count


def test_an_overlap_narrower_than_the_tolerance_is_no_joint():
    for shared, count in ((1e-8, 0), (1e-5, 1)):
        found = joints_of((LAB, (0, 0, 0), UNTURNED), (LAB, (0.3 - shared, 0, 0.1), UNTURNED))
        assert [joint.area for joint in found] == pytest.approx([shared * 0.2] * count, rel=1e-9)


def test_a_gap_is_kept_and_rounding_is_not():
    def gap(shift):
        return joints_of((LAB, (0, 0, 0), UNTURNED), (LAB, (0, 0, 0.1 + shift), UNTURNED))[0].gap

    assert gap(1e-7) == pytest.approx(1e-7, rel=1e-6)
    assert gap(-1e-7) == pytest.approx(-1e-7, rel=1e-6)
    assert gap(1e-11) == 0.0


def wedge(width, height, length):
    """A triangular prism lying along y, its base down, its centroid at the origin."""
    x = np.array([-0.5, 0.5, 0.0]) * width
    z = np.array([-1.0, -1.0, 2.0]) * height / 3.0
    vertices = np.array([[x[i], y, z[i]] for y in (-length / 2, length / 2) for i in range(3)])
    faces = ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0))
    return Polyhedron(vertices, faces, 0.5 * width * height * length, np.eye(3))


def test_polyhedra_with_other_faces_than_a_box():
    prism = wedge(0.2, 0.1, 0.3)
    assert prism.face_axes.shape == (4, 3) and prism.edge_axes.shape == (4, 3)
    assert prism.face_normals[0] == pytest.approx([0, -1, 0]) and prism.face_normals[2] == pytest.approx([0, 0, -1])
    base = ((1.0, 1.0, 0.1), (0, 0, -0.05), UNTURNED)
    end_to_end = (prism, (0, 0.3, 0.1 / 3.0), UNTURNED)
    found = joints_of(base, (prism, (0, 0, 0.1 / 3.0), UNTURNED), end_to_end, fixed=[0])
    assert [joint.area for joint in found] == pytest.approx([0.06, 0.06, 0.01], rel=1e-12)
    assert len(found[2].polygon) == 3 and found[2].origin == pytest.approx([0, 0.15, 0.1 / 3.0], abs=1e-15)


def test_a_turned_block_gives_an_octagon():
    angle = np.pi / 4
    cube = (0.2, 0.2, 0.2)
    turned = (cube, (0, 0, 0.2), (np.cos(angle / 2), 0, 0, np.sin(angle / 2)))
    (joint,) = joints_of((cube, (0, 0, 0), UNTURNED), turned)
    assert len(joint.polygon) == 8
    assert joint.area == pytest.approx(8.0 * 0.1**2 * np.tan(np.pi / 8), rel=1e-12)
    assert polygons.area_and_centroid([tuple(p) for p in joint.polygon])[1:] == pytest.approx((0.0, 0.0), abs=1e-16)


unit = st.floats(-1.0, 1.0)
turn = st.tuples(unit, unit, unit, unit).filter(lambda q: sum(c * c for c in q) > 0.05).map(unit_quaternion)


@given(turn, st.tuples(unit, unit, unit), st.tuples(unit, unit, st.floats(0.0, 3.1)), st.integers(0, 1))
@settings(max_examples=60, deadline=None)
def test_a_scene_turned_and_moved_has_the_same_joints(q, shift, pose, held):
    """Two blocks one on the other, anyhow displaced and twisted; then the scene as a whole turned and moved."""
    dx, dy, angle = 0.1 * pose[0], 0.1 * pose[1], pose[2]
    low = (LAB, np.zeros(3), np.array(UNTURNED))
    high = ((0.25, 0.18, 0.1), np.array([dx, dy, 0.1]), np.array([np.cos(angle / 2), 0, 0, np.sin(angle / 2)]))
    (still,) = joints_of(low, high, fixed=[held])
    rotation = rotation_matrix(q)
    moved = [(e, rotation @ p + shift, quaternion_product(q, o)) for e, p, o in (low, high)]
    (joint,) = joints_of(*moved, fixed=[held])
    assert (joint.block_a, joint.block_b, joint.host) == (still.block_a, still.block_b, still.host)
    assert joint.axes == pytest.approx(still.axes @ rotation.T, abs=1e-12)
    assert joint.polygon == pytest.approx(still.polygon, abs=1e-12)
    assert joint.origin == pytest.approx(rotation @ still.origin + shift, abs=1e-12)
    assert joint.area == pytest.approx(still.area, rel=1e-12)
    assert joint.gap == still.gap == 0.0
    assert joint.axes @ joint.axes.T == pytest.approx(np.eye(3), abs=1e-14)
    assert np.cross(joint.axes[0], joint.axes[1]) == pytest.approx(joint.axes[2], abs=1e-14)


def test_a_kilometre_away_only_the_rounding_of_the_input_is_lost():
    far = np.array([1000.0, -2000.0, 500.0])
    near = joints_of((LAB, (0, 0, -0.05), UNTURNED), (LAB, (0.0625, 0.03125, 0.05), UNTURNED), fixed=[0])[0]
    away = joints_of((LAB, far - [0, 0, 0.05], UNTURNED), (LAB, far + [0.0625, 0.03125, 0.05], UNTURNED), fixed=[0])[0]
    assert away.polygon == pytest.approx(near.polygon, abs=2e-13)
    assert away.arm_a == pytest.approx(near.arm_a, abs=2e-13) and away.arm_b == pytest.approx(near.arm_b, abs=2e-13)
    assert away.gap == 0.0


# --- neighbours -------------------------------------------------------------------------------------------------------


def scattered(rng, n):
    """Boxes of very different sizes, anyhow turned, some of them crowded."""
    edges = rng.uniform(0.05, 0.4, (n, 3)) * np.where(rng.uniform(size=n) < 0.05, 10.0, 1.0)[:, None]
    shapes = [box(e) for e in edges]
    position = rng.uniform(-1.5, 1.5, (n, 3))
    rotation = rotation_matrix(rng.normal(size=(n, 4)))
    return neighbours.bodies_of(shapes, position, rotation), shapes


@pytest.mark.parametrize("seed", range(4))
def test_the_search_finds_the_pairs_that_trying_all_pairs_finds(seed):
    bodies, shapes = scattered(np.random.default_rng(seed), 120)
    margin = 0.01 * bodies.table.diameter
    found = neighbours.close_pairs(bodies, 0.01)
    world = [s.vertices @ r.T + p for s, p, r in zip(shapes, bodies.position, bodies.rotation, strict=True)]
    low = np.array([w.min(axis=0) for w in world]) - margin[:, None]
    high = np.array([w.max(axis=0) for w in world]) + margin[:, None]
    plain = [
        (i, j) for i in range(120) for j in range(i + 1, 120) if (low[i] <= high[j]).all() and (low[j] <= high[i]).all()
    ]
    assert [tuple(pair) for pair in found] == plain


def test_the_search_holds_a_pebble_and_a_kilometre():
    sizes = [(1e-3, 1e-3, 1e-3)] * 3 + [(5e6, 5e6, 5e6)]
    where = [(0, 0, 0.5e-3), (1e-3, 0, 0.5e-3), (3e-3, 0, 0.5e-3), (0, 0, -2.5e6)]
    found = joints_of(*[(e, p, UNTURNED) for e, p in zip(sizes, where, strict=True)], fixed=[3])
    assert {(joint.block_a, joint.block_b) for joint in found} == {(0, 1), (3, 0), (3, 1), (3, 2)}


def test_the_search_does_not_try_all_pairs(monkeypatch):
    """A wall of 900 blocks on one long floor: some twenty comparisons a block, not 450."""
    tried = []
    plain = neighbours._cell_pairs
    monkeypatch.setattr(neighbours, "_cell_pairs", lambda *a: tried.append(plain(*a)) or tried[-1])
    wall = [(LAB, (0.3 * i + 0.15 * (c % 2), 0.0, 0.1 * c + 0.05), UNTURNED) for c in range(30) for i in range(30)]
    found = joints_of(*wall, ((12.0, 1.0, 0.1), (4.5, 0.0, -0.05), UNTURNED), fixed=[900])
    assert len(found) == 30 * 29 + 29 * 59 + 30
    assert 900 < len(tried[0]) < 40 * 900 and not (tried[0] == 900).any()


def test_overlap_of_turned_boxes_agrees_with_points_in_both():
    bodies, shapes = scattered(np.random.default_rng(7), 60)
    position, rotation = bodies.position, bodies.rotation
    pairs = neighbours.close_pairs(bodies, 0.0)
    depths = neighbours.overlap_depths(bodies, pairs)
    rng = np.random.default_rng(8)
    agreed = 0
    for pair, depth in zip(pairs, depths, strict=True):
        i, j = sorted(pair, key=lambda k: shapes[k].volume)
        local = rng.uniform(-0.5, 0.5, (5000, 3)) * np.ptp(shapes[i].vertices, axis=0)
        inside_j = (local @ rotation[i].T + position[i] - position[j]) @ rotation[j]
        common = (np.abs(inside_j) <= np.ptp(shapes[j].vertices, axis=0) / 2).all(axis=1).any()
        assert depth > 0.0 or not common
        agreed += int(common == (depth > 0.0))
        # moved apart along any direction by less than the depth, they still overlap
        direction = position[j] - position[i]
        moved = position.copy()
        moved[j] += direction / np.linalg.norm(direction) * 0.99 * max(depth, 0.0)
        still = neighbours.overlap_depths(bodies._replace(position=moved), np.array([[i, j]]))[0]
        assert depth <= 0.0 or still > 0.0
    assert agreed > 0.9 * len(pairs) > 50


def test_overlap_depths_in_closed_form():
    def between(position, rotations):
        bodies = neighbours.bodies_of([box((1, 1, 1))] * 2, np.array([(0, 0, 0), position], float), rotations)
        return neighbours.overlap_depths(bodies, np.array([[0, 1]]))[0]

    def depth(position, orientation):
        return between(position, rotation_matrix(np.array([UNTURNED, orientation])))

    assert depth((0.9, 0.2, 0.0), UNTURNED) == pytest.approx(0.1)
    assert depth((1.0, 0.0, 0.0), UNTURNED) == pytest.approx(0.0, abs=1e-15)
    assert depth((1.3, 0.0, 0.0), UNTURNED) == pytest.approx(-0.3)
    half = np.sqrt(0.5)
    eighth = (np.cos(np.pi / 8), 0, 0, np.sin(np.pi / 8))
    assert depth((1.0, 0.0, 0.0), eighth) == pytest.approx(half - 0.5)
    # Two edges that cross: along x the first's edge runs along z, the second's along y, gap by the cross product.
    tipped = quaternion_product((np.cos(np.pi / 8), 0, np.sin(np.pi / 8), 0), UNTURNED)
    first, second = rotation_matrix(eighth), rotation_matrix(tipped)
    assert between((2 * half + 0.01, 0, 0), np.stack([first, second])) == pytest.approx(-0.01)
