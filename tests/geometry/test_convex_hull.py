"""Prisms, voussoirs and hulls: closed-form volume, centroid and inertia, faces, and refusals."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dembrick.errors import ScenarioError
from dembrick.geometry.convex_hull import hull, mass_properties, prism, voussoir
from dembrick.geometry.rotations import rotation_matrix, unit_quaternion
from dembrick.geometry.shapes import box

quaternion = st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: sum(c * c for c in q) > 0.1).map(unit_quaternion)
edge = st.floats(0.05, 3.0)


def outward(shape):
    """Assert that every face is plane, and that all vertices lie behind it."""
    heights = shape.vertices @ shape.face_normals.T - shape.face_offsets
    assert heights.max() < 1e-12 * shape.diameter
    for face, normal, offset in zip(shape.faces, shape.face_normals, shape.face_offsets, strict=True):
        assert np.abs(shape.vertices[list(face)] @ normal - offset).max() < 1e-12 * shape.diameter
    edges = {(f[i - 1], f[i]) for f in shape.faces for i in range(len(f))}
    assert all((j, i) in edges for i, j in edges)
    assert len(shape.vertices) - len(edges) // 2 + len(shape.faces) == 2  # Euler
    return (shape.face_areas * shape.face_offsets).sum() / 3.0


# --- hulls ------------------------------------------------------------------------------------------------------------


@given(st.tuples(edge, edge, edge), quaternion, st.tuples(*[st.floats(-5, 5)] * 3))
@settings(max_examples=60, deadline=None)
def test_the_hull_of_the_corners_of_a_turned_box_is_that_box(edges, turn, shift):
    exact, rotation = box(edges), rotation_matrix(turn)
    found = hull(exact.moved(shift, turn))
    assert (len(found.vertices), sorted(map(len, found.faces))) == (8, [4] * 6)
    assert found.volume == pytest.approx(exact.volume, rel=1e-12)
    assert found.centroid == pytest.approx(shift, abs=1e-13 * (10 + exact.diameter))
    scale = exact.inertia.max()
    assert found.inertia == pytest.approx(rotation @ exact.inertia @ rotation.T, abs=1e-12 * scale)
    assert outward(found) == pytest.approx(exact.volume, rel=1e-12)


def test_the_right_tetrahedron():
    """Corners 0, a x, b y, c z: V = abc/6, centroid a quarter, I_xx = V (b^2 + c^2) 3/80, products -V ab (-1/80)."""
    a, b, c = 0.3, 0.5, 0.7
    found = hull([(0, 0, 0), (a, 0, 0), (0, b, 0), (0, 0, c)])
    volume = a * b * c / 6.0
    assert found.volume == pytest.approx(volume, rel=1e-14)
    assert found.centroid == pytest.approx([a / 4, b / 4, c / 4], rel=1e-14)
    second = np.array([[3 * a * a, -a * b, -a * c], [-a * b, 3 * b * b, -b * c], [-a * c, -b * c, 3 * c * c]]) / 80.0
    expected = volume * (np.trace(second) * np.eye(3) - second)
    assert found.inertia == pytest.approx(expected, rel=1e-13)
    assert abs(found.inertia[0, 1]) > 0.05 * found.inertia[0, 0]  # the principal axes are not the coordinate axes


def test_a_regular_octahedron_and_points_on_its_faces_and_edges():
    corners = [(s * (i == 0), s * (i == 1), s * (i == 2)) for i in range(3) for s in (-1.0, 1.0)]
    plain = hull(corners)
    assert plain.volume == pytest.approx(4.0 / 3.0, rel=1e-14)
    assert plain.inertia == pytest.approx(np.eye(3) * 4.0 / 3.0 / 5.0, abs=1e-14)
    assert len(plain.faces) == 8 and outward(plain) == pytest.approx(4.0 / 3.0)
    more = hull([*corners, (0.5, 0.5, 0.0), (0.5, 0.25, 0.25)])
    assert len(more.vertices) == 6 and len(more.faces) == 8 and more.volume == pytest.approx(4.0 / 3.0, rel=1e-14)


@given(st.lists(st.tuples(*[st.floats(-1.0, 1.0)] * 3), min_size=4, max_size=25), st.integers(0, 5))
@settings(max_examples=60, deadline=None)
def test_points_on_a_sphere_give_the_hull_of_an_independent_library(points, seed):
    from scipy.spatial import ConvexHull

    points = np.array(points) + np.random.default_rng(seed).normal(scale=0.5, size=(len(points), 3))
    points /= np.linalg.norm(points, axis=1)[:, None]  # every point is a corner of the hull
    try:
        found = hull(points)
    except ScenarioError as error:
        assert "closer than" in str(error) or "one plane" in str(error)
        return
    expected = ConvexHull(points)
    assert found.volume == pytest.approx(expected.volume, rel=1e-4)
    assert outward_within(found, 1e-5)


def outward_within(shape, tolerance):
    return (shape.vertices @ shape.face_normals.T - shape.face_offsets).max() < tolerance * shape.diameter


def test_hulls_that_are_none():
    square = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    with pytest.raises(ScenarioError, match="one plane"):
        hull(square)
    with pytest.raises(ScenarioError, match="the same"):
        hull([(1, 1, 1)] * 4)
    cube = list(itertools.product((0.0, 2.0), repeat=3))
    with pytest.raises(ScenarioError, match=r"point 8 \(counted from 0\) lies 0.5 m inside"):
        hull([*cube, (1.0, 1.0, 0.5)])


def test_mass_properties_do_not_depend_on_where_the_origin_is():
    shape = hull([(0, 0, 0), (0.3, 0, 0), (0, 0.5, 0), (0, 0, 0.7)])
    far = mass_properties(shape.vertices + (1e3, -2e3, 5e2), shape.faces)
    assert far[0] == pytest.approx(shape.volume, rel=1e-9)
    assert far[1] == pytest.approx([1e3, -2e3, 5e2], abs=1e-11)
    assert far[2] == pytest.approx(shape.inertia, rel=1e-8)


# --- prisms -----------------------------------------------------------------------------------------------------------


def test_the_prism_of_a_rectangle_is_a_box():
    found, exact = prism([(0, 0), (0.3, 0), (0.3, 0.2), (0, 0.2)], 0.1), box((0.3, 0.2, 0.1))
    assert found.volume == pytest.approx(exact.volume, rel=1e-14)
    assert found.centroid == pytest.approx([0.15, 0.1, 0.0], abs=1e-15)
    assert found.inertia == pytest.approx(exact.inertia, abs=1e-13 * exact.inertia.max())


@pytest.mark.parametrize("turn", [1, -1])
def test_the_prism_of_a_triangle(turn):
    """Right triangle with legs a, b: centroid a third, central second moments ab^3/36, a^3 b/36, -a2b2/72."""
    a, b, h = 0.6, 0.4, 0.25
    found = prism([(0, 0), (a, 0), (a / 2, b / 2), (0, b)][::turn], h)  # one corner on the long side
    area = a * b / 2
    assert len(found.vertices) == 6 and found.volume == pytest.approx(area * h, rel=1e-14)
    assert found.centroid == pytest.approx([a / 3, b / 3, 0.0], abs=1e-15)
    xx, yy, xy, zz = a**3 * b / 36 * h, a * b**3 / 36 * h, -(a**2) * b**2 / 72 * h, area * h**3 / 12
    expected = np.array([[yy + zz, -xy, 0], [-xy, xx + zz, 0], [0, 0, xx + yy]])
    assert found.inertia == pytest.approx(expected, abs=1e-15)
    assert outward(found) == pytest.approx(area * h)


def test_polygons_that_make_no_prism():
    with pytest.raises(ScenarioError, match="not convex at corner 3"):
        prism([(0, 0), (2, 0), (2, 1), (1, 0.5), (0, 1)], 1.0)
    with pytest.raises(ScenarioError, match="crosses itself"):
        prism([(0, 0), (1, 1), (1, 0), (0, 1)], 1.0)
    star = [(math.cos(0.8 * math.pi * k), math.sin(0.8 * math.pi * k)) for k in range(5)]
    with pytest.raises(ScenarioError, match="crosses itself"):
        prism(star, 1.0)
    with pytest.raises(ScenarioError, match="on one line"):
        prism([(0, 0), (1, 1), (2, 2)], 1.0)


# --- voussoirs --------------------------------------------------------------------------------------------------------


def sector_by_quadrature(radius, thickness, depth, angle):
    """Volume, height of the centroid and central inertia of a piece of a ring, by Gauss-Legendre in r and angle."""
    nodes, weights = np.polynomial.legendre.leggauss(24)
    r, phi = np.meshgrid(radius + 0.5 * thickness * nodes, 0.5 * angle * nodes, indexing="ij")
    w = np.outer(weights, weights) * r * 0.25 * thickness * angle * depth
    x, z = r * np.sin(phi), r * np.cos(phi)
    volume, height = w.sum(), (w * z).sum() / w.sum()
    xx, zz, yy = (w * x * x).sum(), (w * (z - height) ** 2).sum(), volume * depth**2 / 12.0
    return volume, height, np.diag([yy + zz, xx + zz, xx + yy])


@pytest.mark.parametrize("angle", [0.05, 0.4, 1.5, 3.0])
def test_a_curved_voussoir_is_a_piece_of_a_ring(angle):
    stone = (1.0, 0.15, 0.4, angle)
    found = voussoir(*stone, curved=True)
    volume, height, inertia = sector_by_quadrature(*stone)
    assert found.volume == pytest.approx(volume, rel=1e-12)
    assert found.centroid == pytest.approx([0, 0, height], rel=1e-12)
    assert found.inertia == pytest.approx(inertia, rel=1e-10, abs=1e-12 * inertia.max())
    straight = voussoir(*stone, curved=False)
    assert found.vertices + found.centroid == pytest.approx(straight.vertices + straight.centroid, abs=1e-14)


def test_a_straight_voussoir_is_its_quadrilateral():
    angle, radius, thickness, depth = 0.5, 1.0, 0.2, 0.3
    found = voussoir(radius, thickness, depth, angle, curved=False)
    inner, outer = (2 * r * math.sin(angle / 2) for r in (0.9, 1.1))
    height = thickness * math.cos(angle / 2)
    area = 0.5 * (inner + outer) * height
    assert found.volume == pytest.approx(area * depth, rel=1e-14)
    above = height / 3 * (inner + 2 * outer) / (inner + outer)  # centroid of a trapezium over its short side
    assert found.centroid == pytest.approx([0, 0, 0.9 * math.cos(angle / 2) + above], abs=1e-14)
    assert outward(found) == pytest.approx(found.volume)
    as_hull = hull(found.vertices + found.centroid)
    assert as_hull.inertia == pytest.approx(found.inertia, abs=1e-14)
