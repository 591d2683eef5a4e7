"""Shapes: exact mass properties, outward faces, quaternions."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dembrick.geometry.rotations import quaternion_product, rotation_matrix, unit_quaternion
from dembrick.geometry.shapes import box

edge = st.floats(1e-3, 10.0)
quaternion = st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: sum(c * c for c in q) > 0.1).map(unit_quaternion)


def by_quadrature(edges):
    """Volume and inertia of a box by a 2 x 2 x 2 Gauss rule, exact for quadratics."""
    points = np.array(list(itertools.product((-1, 1), repeat=3))) / np.sqrt(3.0) * np.array(edges) / 2.0
    volume = float(np.prod(edges))
    squares = (points**2).sum(axis=1)
    inertia = sum(r2 * np.eye(3) - np.outer(p, p) for r2, p in zip(squares, points, strict=True)) * volume / 8.0
    return volume, inertia


@given(st.tuples(edge, edge, edge))
def test_box_has_its_volume_inertia_and_faces(edges):
    shape = box(edges)
    volume, inertia = by_quadrature(edges)
    assert shape.volume == pytest.approx(volume, rel=1e-14)
    assert shape.inertia == pytest.approx(inertia, rel=1e-13, abs=1e-13 * inertia.max())
    assert shape.vertices.mean(axis=0) == pytest.approx(np.zeros(3), abs=1e-15)
    a, b, c = edges
    expected = {(1, 0, 0): (b * c, a), (0, 1, 0): (a * c, b), (0, 0, 1): (a * b, c)}
    seen = set()
    for normal, offset, face_area in zip(shape.face_normals, shape.face_offsets, shape.face_areas, strict=True):
        axis = tuple(int(round(abs(x))) for x in normal)
        seen.add(tuple(int(round(x)) for x in normal))
        assert face_area == pytest.approx(expected[axis][0], rel=1e-13)
        assert offset == pytest.approx(expected[axis][1] / 2.0, rel=1e-13)
    assert len(seen) == 6
    assert shape.diameter == pytest.approx(np.linalg.norm(edges), rel=1e-14)


def test_directions_of_a_box_are_counted_once():
    shape = box((0.3, 0.2, 0.1))
    for axes in (shape.face_axes, shape.edge_axes):
        assert sorted(map(tuple, np.abs(axes).round(12))) == [(0, 0, 1), (0, 1, 0), (1, 0, 0)]


def test_faces_run_counterclockwise_seen_from_outside():
    shape = box((0.3, 0.2, 0.1))
    for face in shape.faces:
        p = shape.vertices[list(face)]
        assert np.dot(np.cross(p[1] - p[0], p[2] - p[1]), p.mean(axis=0)) > 0.0


def test_equal_boxes_are_one_object():
    assert box((0.3, 0.2, 0.1)) is box([0.3, 0.2, 0.1])
    assert box((0.3, 0.2, 0.1)) is not box((0.2, 0.3, 0.1))


@given(quaternion, quaternion)
@settings(max_examples=50)
def test_rotation_matrices_are_proper_and_compose(p, q):
    first, second = rotation_matrix(p), rotation_matrix(q)
    assert first @ first.T == pytest.approx(np.eye(3), abs=1e-14)
    assert np.linalg.det(first) == pytest.approx(1.0, abs=1e-13)
    assert rotation_matrix(quaternion_product(p, q)) == pytest.approx(first @ second, abs=1e-13)
    assert rotation_matrix(np.stack([p, q]))[1] == pytest.approx(second, abs=0.0)


def test_a_quaternion_turns_body_to_world():
    quarter = (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))  # a quarter turn about z takes x to y
    assert rotation_matrix(quarter) @ [1.0, 0.0, 0.0] == pytest.approx([0.0, 1.0, 0.0], abs=1e-15)
    shape = box((0.3, 0.2, 0.1))
    moved = shape.moved((1.0, 2.0, 3.0), quarter)
    assert np.ptp(moved, axis=0) == pytest.approx([0.2, 0.3, 0.1], abs=1e-15)
    assert moved.mean(axis=0) == pytest.approx([1.0, 2.0, 3.0], abs=1e-15)
    corner = np.argmax(shape.vertices @ (1.0, 0.5, 0.1))  # (+, +, +) in the body: x goes to y, y to -x
    assert moved[corner] == pytest.approx([1.0 - 0.1, 2.0 + 0.15, 3.0 + 0.05], abs=1e-15)


def test_quaternions_are_normalised():
    assert rotation_matrix((2.0, 0.0, 0.0, 0.0)) == pytest.approx(np.eye(3), abs=0.0)
