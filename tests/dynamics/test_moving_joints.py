"""Joints between moving blocks: objectivity, large rotations, polygons that slide over edges."""

import math

import numpy as np
import pytest

from dembrick.assembly import build
from dembrick.geometry import friction_integrals, polygons
from dembrick.geometry.clipping import clip, simplify
from dembrick.geometry.polygons import distance_outside, nearest_points
from dembrick.geometry.rotations import rotation_matrix
from dembrick.kernels.dynamics.loop import Limits
from dembrick.kernels.joint.area_law import area_pressure
from dembrick.kernels.joint.geometry import Polygon
from dembrick.kernels.joint.no_tension import no_tension
from dembrick.scenario.controls import DynamicControl
from dembrick.scenario.model import Block, JointLaw, Wall
from dembrick.simulation.dynamics.checkpoint import RunHistory
from dembrick.simulation.dynamics.dead_load import find_equilibrium
from dembrick.simulation.dynamics.integrator import Motion, advance, detect_initial_contacts, joint_forces, motion
from dembrick.simulation.dynamics.loads import Driving
from dembrick.simulation.dynamics.state import arms, joint_resultants, seen
from dembrick.simulation.session import Kept
from helpers.resting_blocks import FORMULATIONS, GRAVITY, about, place, resting, two_blocks
from helpers.stone_scenes import law, of_stone

FAR = Limits(displacement=1e6, longest=1.0)
TURNED = (0.8, 0.0, 0.36, -0.48)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_a_pair_that_turns_as_one_feels_nothing(formulation):
    """Forces rotate with a pair that rotates as one, to the last digits, also in a large turn of a hundred steps."""
    moving, driving = resting(formulation)
    state = moving.state
    place(moving, (2e-8, 1e-8, 0.0), about((0, 0, 1), 1e-7))  # some shear and torsion in memory, no slip
    for _ in range(2):  # until the dashpots are at rest again
        joint_forces(moving, driving)
    before = joint_resultants(state)
    assert abs(before[0, 1]) > 1.0 and abs(before[0, 3]) > 0.01
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    centre = state.bodies.position.mean(axis=0) + 0.3
    force = state.links.wrench[0, :3].copy()
    for _ in range(100):
        turn = about(axis, 2.0 * math.pi / 300)
        for b in range(2):
            arm = state.bodies.position[b] - centre
            place(moving, rotation_matrix(turn) @ arm - arm, turn, b)
        joint_forces(moving, driving)
    np.testing.assert_allclose(joint_resultants(state), before, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(
        state.links.wrench[0, :3], rotation_matrix(about(axis, 2.0 * math.pi / 3)) @ force, rtol=1e-6, atol=1e-5
    )


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_action_and_reaction_at_one_point(formulation):
    """The wrench on the other is minus that on the host: forces, and torques about any one point."""
    moving, driving = resting(formulation)
    place(moving, (1e-7, 2e-7, -1e-6), about((0.6, 0.8, 0.0), 2e-5))
    joint_forces(moving, driving)
    bodies, links = moving.state.bodies, moving.state.links
    force, on_host, on_other = links.wrench[0].reshape(3, 3)
    arm = bodies.position[links.host[0]] - bodies.position[links.other[0]]
    np.testing.assert_allclose(on_other, -(on_host + np.cross(arm, force)), rtol=1e-9, atol=1e-9)
    assert np.linalg.norm(force) > 100.0


@pytest.mark.parametrize("formulation", ["concave", "convex", "distributed"])
def test_the_same_in_any_frame(formulation):
    """A block that slides, spins and rocks moves the same whatever the orientation of the world's axes."""
    start = {"velocity": (0.3, 0.2, 0.0), "angular_velocity": (0.0, 0.0, 2.0)}
    ends = []
    for turn in ((1.0, 0.0, 0.0, 0.0), TURNED):
        moving, driving = resting(formulation, turn=turn, floor=(2.0, 2.0, 0.1))
        R = rotation_matrix(np.array(turn))
        moving.time_step = 2e-5  # the bound of the time step has rounding of its own
        moving.state.links.put("viscous", [[0.1, 0.1]])
        moving.state.bodies.velocity[1] = R @ start["velocity"]
        moving.state.bodies.momentum[1] = (R @ moving.assembly.inertia[1]) @ start["angular_velocity"]
        advance(moving, driving, 400, FAR)
        ends.append(R.T @ moving.displacement[1])
    np.testing.assert_allclose(ends[1], ends[0], rtol=1e-6, atol=1e-8)
    assert np.linalg.norm(ends[0]) > 1e-3


@pytest.mark.parametrize("angle", [1e-3, 1e-2, 0.1, 0.5, 1.2])
def test_gap_is_exact_for_large_turns(angle):
    """A block rotated on its toe by any angle: corners at the toe touch, the others are as high as by geometry."""
    moving, driving = resting()
    bodies, links = moving.state.bodies, moving.state.links
    toe = bodies.position[1] + (0.15, 0.0, -0.05)
    turn = about((0, 1, 0), angle)
    place(moving, rotation_matrix(turn) @ (bodies.position[1] - toe) - (bodies.position[1] - toe), turn)
    corners = moving.state.corners
    now = seen(bodies, links)[0]
    gap = links.sense[0] * (now[2] - links.offset[0] + corners.x * now[5] + corners.y * now[8])
    expected = np.where(corners.x > 0, 0.0, 0.3 * math.sin(angle))
    sunk = 2000.0 * 0.006 * 9.81 / (1e10 * 0.06)
    np.testing.assert_allclose(gap, expected - sunk, atol=1e-12)


@pytest.mark.parametrize("angle", [1e-4, 1e-2, 0.1])
def test_strip_of_a_rocking_convex_joint(angle):
    """Rotated on its edge, a convex joint presses on a strip w = sqrt(2 N / (kn L tan)), with the resultant at w/3."""
    moving, driving = resting("convex", friction=0.0)
    bodies = moving.state.bodies
    toe = bodies.position[1] + (0.15, 0.0, -0.05)
    turn = about((0, 1, 0), angle)
    place(moving, rotation_matrix(turn) @ (bodies.position[1] - toe) - (bodies.position[1] - toe), turn)
    for _ in range(2):
        joint_forces(moving, driving)
    r = joint_resultants(moving.state)[0]
    w = math.sqrt(2.0 * r[0] / (1e10 * 0.2 * math.sin(angle)))
    # the penetration of the corner gives the length of the strip along the rotated face
    assert w == pytest.approx(2000.0 * 0.006 * 9.81 / (1e10 * 0.06) / math.sin(angle), rel=1e-6)
    assert abs(r[5]) / r[0] == pytest.approx((0.15 - w / 3.0) * math.cos(angle), rel=1e-4)


def test_tilting_is_no_torsion():
    """A convex joint that tilts about an oblique line of its plane through O neither slips nor twists, though the edges
    of its polygon, seen along the normal, rotate by angle^2 / 4."""
    moving, driving = resting("convex")
    bodies, links, faces = moving.state.bodies, moving.state.links, moving.state.faces
    foot = bodies.position[1] + arms(bodies, links)[0][0]
    foot[2] -= links.seen[0, 2] - links.offset[0]  # O, projected onto the plane
    turn = about((math.sqrt(0.5), math.sqrt(0.5), 0.0), 0.05 / 200)
    for _ in range(200):
        arm = bodies.position[1] - foot
        place(moving, rotation_matrix(turn) @ arm - arm, turn)
        joint_forces(moving, driving)
    strength = 0.64 * joint_resultants(moving.state)[0, 0]
    assert np.abs(faces.elastic[0, :2]).max() < 1e-5 * strength
    assert abs(faces.elastic[0, 2]) < 1e-5 * strength * faces.radius[0]


def cut(moving: Motion, driving: Driving) -> int:
    """Cut the polygons of blocks that were placed; return the number of polygons cut."""
    joint_forces(moving, driving)
    return moving.polygons.cut_stale()


def torsion_strength(moving: Motion, driving: Driving) -> float:
    """Torque of a joint that is twisted well into slip, divided by mu N (m)."""
    for _ in range(200):
        place(moving, (0.0, 0.0, 0.0), about((0, 0, 1), 1e-7))
        joint_forces(moving, driving)
    r = joint_resultants(moving.state)[0]
    return r[3] / (0.64 * r[0])


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_a_small_turn_changes_no_strength(formulation):
    """Two equal blocks: a rotation by a thousandth of a radian leaves the torsion strength within 0.15 %."""
    moving, driving = resting(formulation)
    before = torsion_strength(moving, driving)
    moving, driving = resting(formulation)
    place(moving, (0.0, 0.0, 0.0), about((0, 0, 1), 1e-3))
    cut(moving, driving)
    after = torsion_strength(moving, driving)
    assert after == pytest.approx(before, rel=1.5e-3)
    assert before > 0.09


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_sliding_off_the_edge(formulation):
    """Half over the edge, the joint is the common area of both faces, and carries the weight at its centre."""
    moving, driving = resting(formulation)
    last = None
    for _ in range(300):
        place(moving, (5e-4, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
        cut(moving, driving)
        joint_forces(moving, driving)
        normal = joint_resultants(moving.state)[0, 0]
        assert last is None or abs(normal - last) < 0.02 * 117.72 * (4 if formulation == "distributed" else 1)
        last = normal
    family = moving.state.faces or moving.state.corners
    assert family.area.sum() == pytest.approx(0.03, rel=0.01)
    assert normal == pytest.approx(0.5 * 117.72, rel=0.01)  # the penetration stayed the same
    if formulation != "distributed":
        assert moving.polygons.shift[0, 0] == pytest.approx(-0.075, rel=0.01)


def test_pressed_polygon_with_and_without_a_look_at_its_vertices():
    """The closed form for closed joints holds wherever it is used: full contact, nearly full, and with an edge open."""
    moving = two_blocks("convex")
    faces = moving.state.faces
    x, y = faces.x[0, :4], faces.y[0, :4]
    rng = np.random.default_rng(0)
    closed = short = 0
    for _ in range(4000):
        g0, gx, gy = 1e-6 * rng.normal(1.0, 0.3), *(1e-5 * rng.standard_normal(2))
        d0, dx, dy = 1e-7 * rng.standard_normal(3)
        viscous = 0.3
        h0, hx, hy = g0 + viscous * d0, gx + viscous * dx, gy + viscous * dy
        own = Polygon(x, y, 0, 4, faces.area[0], tuple(faces.second[0]), faces.reach[0])
        found, _ = area_pressure(own, viscous, (g0, gx, gy), (d0, dx, dy))
        everywhere = (h0 + hx * x + hy * y).min() > 0.0
        closed += everywhere
        short += h0 > math.hypot(0.15, 0.1) * math.hypot(hx, hy)
        # general integral for comparison, not the closed form
        expected = no_tension(x, y, 0, 4, -1.0, h0, hx, hy)
        scale = abs(expected[0])
        np.testing.assert_allclose(found[0], expected[0], rtol=1e-9)
        np.testing.assert_allclose(found[1:], expected[1:], rtol=0.0, atol=1e-9 * scale)
    assert 500 < short < closed < 3500


def test_equal_polygons_are_kept_once_until_they_are_cut():
    """Twelve blocks on twelve floors: each that slides over its edge gets its own polygon and carries the same as a
    lone block; the others keep theirs. After a return to an earlier snapshot the memory is as small as at that time."""
    n, out = 12, 10
    stones = [
        Block(f"{kind}{i}", "stone", (0.3, 0.2, 0.1), (float(i), 0.0, z), fixed=z < 0.0)
        for i in range(n)
        for kind, z in (("floor", -0.05), ("block", 0.05))
    ]
    built = build.assemble(of_stone(law("convex"), DynamicControl(duration=1.0), stones))
    moving, driving = motion(built, 0.1, 0.3), Driving(GRAVITY)
    find_equilibrium(moving, driving)
    faces = moving.state.faces
    assert len(faces.count) == 1 and not faces.outline.any()
    past = RunHistory(moving, None)
    before = Kept(past.snapshot())
    far = faces.far[0].copy()
    for step in range(2):
        for i in range(out):
            place(moving, (0.01 * (i + 1), 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), 2 * i + 1)
        assert cut(moving, driving) == out
        assert sorted(moving.state.faces.outline) == [0, 0, *range(1, out + 1)], step
    joint_forces(moving, driving)
    faces, found = moving.state.faces, joint_resultants(moving.state)
    np.testing.assert_array_equal(faces.far[0], far)
    for i in range(n):
        alone, driving_alone = resting("convex")
        alone.state.links.put("viscous", moving.state.links.viscous[[i]])
        for _ in range(2 if i < out else 0):
            place(alone, (0.01 * (i + 1), 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
            cut(alone, driving_alone)
        joint_forces(alone, driving_alone)
        own = alone.state.faces
        np.testing.assert_allclose(found[i], joint_resultants(alone.state)[0], rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(faces.far[faces.outline[i]], own.far[own.outline[0]], rtol=1e-9, atol=1e-12)
        assert faces.area[i] == pytest.approx(0.2 * (0.3 - (0.02 * (i + 1) if i < out else 0.0)), rel=1e-9)
    past.restore(before)
    faces = moving.state.faces
    assert len(faces.count) == 1 and not faces.outline.any()
    for name, array in past.snapshot().items():
        np.testing.assert_array_equal(array, before.arrays[name], err_msg=name)


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_a_wall_takes_less_than_2_kb_a_block(formulation):
    joint = JointLaw(formulation, 0.64, 1e10, 4e9)
    wall = Wall("wall", "stone", (0.3, 0.2, 0.1), 20, 20, base=0.1)
    built = build.assemble(of_stone(joint, DynamicControl(duration=1.0), walls=(wall,)))
    moving = motion(built, 0.05, 0.9)
    assert sum(array.nbytes for array in moving.state.arrays) < 2000 * len(built.names)
    if formulation == "convex":
        assert len(moving.state.faces.count) <= 4  # a head joint, bed joints of half and a whole block, the last bed


def shared_areas(some, face):
    """Areas that polygons (k, m, 2) share with a face."""
    points, count = clip(some, np.broadcast_to(face, (len(some), *face.shape)))
    return np.array([polygons.area(p[:n]) if n else 0.0 for p, n in zip(points, count, strict=True)])


@pytest.mark.parametrize("formulation", ["concave", "corrected", "distributed"])
def test_polygons_are_cut_as_plane_geometry_says(formulation):
    """Blocks that slid and twisted to random places on a floor of their own size, over one edge, two or three, keep the
    area of plane geometry."""
    draw = np.random.default_rng(4)
    for _ in range(20):
        moving, driving = resting(formulation)
        start, corners = moving.polygons._points[0], moving.state.corners
        drawn = moving.polygons._joints[0].polygon
        for _ in range(3):
            place(moving, (*draw.uniform(-0.05, 0.05, 2), 0.0), about((0, 0, 1), draw.uniform(-0.4, 0.4)))
            assert cut(moving, driving) == 1
        now, shift = moving.state.links.seen[0], moving.polygons.shift[0]
        tangents = now[[[3, 4], [6, 7]]]
        origin = now[:2] - shift @ tangents
        face = np.array([[-0.15, -0.1], [0.15, -0.1], [0.15, 0.1], [-0.15, 0.1]])
        if formulation == "distributed":
            low, size = drawn.min(axis=0), np.ptp(drawn, axis=0)
            edge = np.where(size > size.min(), size / 6.0, size / 4.0)  # of 6 x 4 equal cells
            first = low + edge * np.floor((start.normal_arm - low) / edge)
            cells = first[:, None] + edge * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
            np.testing.assert_allclose(corners.area, shared_areas(origin + cells @ tangents, face), atol=1e-15)
            (shared,) = shared_areas((origin + drawn @ tangents)[None], face)
            assert corners.area.sum() == pytest.approx(shared, rel=1e-9)
            continue
        outline = (nearest_points(origin + drawn @ tangents, face) - origin) @ np.linalg.inv(tangents)
        _, x, y = polygons.area_and_centroid(outline)
        outline -= (x, y)
        np.testing.assert_allclose(shift, (x, y), rtol=0, atol=1e-15)
        np.testing.assert_allclose(corners.area, np.maximum(polygons.tributary_areas(outline), 0.0), atol=1e-16)
        shrink = np.abs(start.normal_arm).max() / np.abs(drawn).max()
        np.testing.assert_allclose(np.column_stack([corners.x, corners.y]), shrink * outline, rtol=0, atol=1e-15)
        assert moving.state.links.reach[0] == pytest.approx(np.hypot(*outline.T).max(), rel=1e-7)
        # O on the host has moved along
        np.testing.assert_allclose(seen(moving.state.bodies, moving.state.links)[0], now, rtol=0, atol=1e-14)


def test_convex_polygons_are_clipped_as_plane_geometry_says():
    """The same for the integrals of a convex joint: corners, moments, the series and the torsion radius equal those of
    the functions for many polygons at once."""
    draw, counts = np.random.default_rng(5), set()
    face = np.array([[-0.15, -0.1], [0.15, -0.1], [0.15, 0.1], [-0.15, 0.1]])
    for _ in range(40):
        moving, driving = resting("convex")
        drawn = moving.polygons._joints[0].polygon
        for _ in range(2):
            place(moving, (*draw.uniform(-0.07, 0.07, 2), 0.0), about((0, 0, 1), draw.uniform(-0.4, 0.4)))
            assert cut(moving, driving) == 1
        now, shift, faces = moving.state.links.seen[0], moving.polygons.shift[0], moving.state.faces
        tangents = now[[[3, 4], [6, 7]]]
        origin = now[:2] - shift @ tangents
        shared, count = simplify(*clip((origin + drawn @ tangents)[None], face[None]), np.array([1e-9]))
        outline = (shared[0, : count[0]] - origin) @ np.linalg.inv(tangents)
        area, x, y = polygons.area_and_centroid(outline)
        outline -= (x, y)
        counts.add(int(count[0]))
        row = int(faces.outline[0])
        np.testing.assert_allclose(shift, (x, y), rtol=0, atol=1e-15)
        corners = np.column_stack([faces.x[row, : count[0]], faces.y[row, : count[0]]])
        assert faces.count[row] == count[0]
        start = int(np.argmin(np.hypot(*(corners - outline[0]).T)))
        np.testing.assert_allclose(np.roll(corners, -start, axis=0), outline, rtol=0, atol=1e-15)
        assert faces.area[0] == pytest.approx(area, rel=1e-13)
        np.testing.assert_allclose(faces.second[0], polygons.second_moments(outline), rtol=1e-12, atol=1e-17)
        reach = np.hypot(*outline.T).max()
        assert faces.reach[0] == pytest.approx(reach, rel=1e-14)
        assert moving.state.links.reach[0] == pytest.approx(reach, rel=1e-7)
        scale = np.repeat(reach ** np.arange(2.0, 9.0), np.arange(3, 10))
        np.testing.assert_allclose(faces.far[row] / scale, friction_integrals.far_moments(outline) / scale, atol=1e-14)
        assert faces.radius[0] == pytest.approx(friction_integrals.area_radius(outline), rel=1e-11)
    assert counts >= {4, 5, 6}


@pytest.mark.parametrize("formulation", ["concave", "corrected", "distributed"])
def test_points_let_go_of_the_shear_of_what_they_lose(formulation):
    """A point that keeps half its area keeps half its shear; area that is regained starts without shear."""
    moving, driving = resting(formulation)
    corners = moving.state.corners
    for to, turn, loses in (((0.06, 0.03), 0.1, True), ((-0.04, -0.03), -0.1, False), ((0.2, 0.3), 0.0, True)):
        place(moving, (*to, 0.0), about((0, 0, 1), turn))
        joint_forces(moving, driving)
        corners.put("elastic", np.arange(1.0, 1.0 + 2 * len(corners.area)).reshape(-1, 2))
        before, area = corners.elastic, corners.area
        assert moving.polygons.cut_stale() == 1
        share = np.ones(len(area))
        share[area > 0.0] = np.minimum(corners.area[area > 0.0] / area[area > 0.0], 1.0)
        assert (share < 0.999).any() == loses
        np.testing.assert_allclose(corners.elastic, before * share[:, None], rtol=1e-12, atol=0.0)
    assert not corners.area.any() and not corners.elastic[area > 0.0].any()


def test_a_convex_joint_lets_go_of_the_shear_of_what_it_loses():
    """The remaining shear is that of a fine grid of springs over the remaining area; none is added on the way back."""
    moving, driving = resting("convex")
    faces, polygons_ = moving.state.faces, moving.polygons
    force = np.array([30.0, -20.0, 4.0])
    place(moving, (0.06, 0.03, 0.0), about((0, 0, 1), 0.1))
    joint_forces(moving, driving)
    faces.put_elastic(force, 0)
    area, polar = faces.field("area", 0), faces.field("second", 0)[:2].sum()
    assert polygons_.cut_stale() == 1
    faces = moving.state.faces
    x, y = np.stack(np.meshgrid(*((np.arange(2000) + 0.5) * (side / 2000) - side / 2 for side in (0.3, 0.2))))
    now, shift = moving.state.links.seen[0], polygons_.shift[0].copy()
    there = now[:2, None, None] + (x - shift[0]) * now[3:5, None, None] + (y - shift[1]) * now[6:8, None, None]
    on = (np.abs(there[0]) < 0.15) & (np.abs(there[1]) < 0.1)
    x, y, part = x[on], y[on], 0.3 * 0.2 / on.size
    shear = force[0] / area - force[2] / polar * y, force[1] / area + force[2] / polar * x
    held = [part * own.sum() for own in shear]
    held.append(part * ((x - shift[0]) * shear[1] - (y - shift[1]) * shear[0]).sum())
    assert part * on.sum() < 0.75 * area
    np.testing.assert_allclose(faces.elastic[0], held, rtol=1e-3)
    place(moving, (-0.04, -0.03, 0.0), about((0, 0, 1), -0.1))
    joint_forces(moving, driving)
    faces.put_elastic(force, 0)
    assert polygons_.cut_stale() == 1
    moved = polygons_.shift[0] - shift
    moment = force[2] - (moved[0] * force[1] - moved[1] * force[0])
    np.testing.assert_allclose(moving.state.faces.elastic[0], [*force[:2], moment], rtol=1e-12)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_a_block_that_fell_past_an_edge_and_comes_back_below_is_not_thrown_out(formulation):
    """Far below the face of the other, the joint would have a large penetration if it were still active."""
    moving, driving = resting(formulation)
    place(moving, (0.5, 0.0, -0.4), about((0, 1, 0), 0.8))
    cut(moving, driving)
    joint_forces(moving, driving)
    assert not moving.state.links.wrench.any()
    detect_initial_contacts(moving)
    assert moving.contact_detection.retired.all()
    place(moving, (-0.5, 0.0, 0.0), about((0, 1, 0), 0.0))
    cut(moving, driving)
    joint_forces(moving, driving)
    assert not moving.state.links.wrench.any()


def test_polygons_inside_the_face_are_left_alone():
    """On a floor larger than the path of the block its polygon is checked when it nears the edge, and never cut."""
    moving, driving = resting(floor=(2.0, 2.0, 0.1))
    area, x = moving.state.corners.area.copy(), moving.state.corners.x.copy()
    for _ in range(10):
        place(moving, (0.05, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
        cut(moving, driving)
    np.testing.assert_array_equal(moving.state.corners.area, area)
    np.testing.assert_array_equal(moving.state.corners.x, x)
    assert moving.polygons.whole[0] and moving.state.links.slack[0] > 0.3


def test_nearest_point_of_a_face():
    face = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0)])
    points = np.array([(1.0, 0.5), (3.0, 0.5), (3.0, 2.0), (1.0, -0.25), (0.0, 0.0)])
    np.testing.assert_allclose(distance_outside(points, face), [-0.5, 1.0, 1.0, 0.25, 0.0])
    np.testing.assert_allclose(
        nearest_points(points, face), [(1.0, 0.5), (2.0, 0.5), (2.0, 1.0), (1.0, 0.0), (0.0, 0.0)]
    )
