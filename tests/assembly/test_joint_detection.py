"""Joints: found wherever faces face each other, with exact polygons and with axes by the documented rules."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dembrick.geometry import polygons
from dembrick.geometry.rotations import quaternion_product, rotation_matrix, unit_quaternion
from dembrick.geometry.shapes import Polyhedron, box
from helpers.lone_joints import LAB, UNTURNED, joints_of, rectangle

QUARTER_Z = (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))
QUARTER_X = (np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0)


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
    """A block turned about two axes against another has a joint of the area and axis of their common face."""
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
    """A triangular prism along y with its base down and its centroid at the origin."""
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
    """Two stacked blocks, arbitrarily shifted and twisted, keep their joints in a rigid motion of the whole scene."""
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
