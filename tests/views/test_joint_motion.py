"""Motion of joints: openings, torsion centres and forces for known motions of two blocks, in closed form."""

from types import SimpleNamespace

import numpy as np
import pytest

from dembrick import theory
from dembrick.kernels.joint.utilisation import FrictionPoints, best_kink, point_gauge
from dembrick.views.motion.frames import nearest
from dembrick.views.motion.joint_frames import CHANNELS
from dembrick.views.motion.joints import STATES, JointMotion
from dembrick.views.motion.relative import torsion_centre
from helpers import history_cases as cases

A, B = 0.3, 0.2
CORNERS = 0.5 * np.array([[-A, -B], [A, -B], [A, B], [-A, B]])
SKEW = np.array([0.5, 0.1, -0.7, 0.5])  # initial orientation of both blocks
SKEW = SKEW / np.linalg.norm(SKEW)


def matrix(vector):
    """Rotation matrix of a rotation vector (Rodrigues)."""
    angle = np.linalg.norm(vector)
    if angle == 0.0:
        return np.eye(3)
    k = np.asarray(vector) / angle
    cross = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def quaternion(vector):
    angle = np.linalg.norm(vector)
    axis = np.asarray(vector) / angle if angle else np.zeros(3)
    return np.array([np.cos(angle / 2), *(np.sin(angle / 2) * axis)])


def product(p, q):
    return np.array([p[0] * q[0] - p[1:] @ q[1:], *(p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:]))])


def run(
    motions,
    host=1,
    formulation="convex",
    pressure="full",
    polygon=CORNERS,
    shrink=1.0,
    rows=None,
    start=SKEW,
    forces=None,
):
    """Two blocks and a joint with axes oblique to the world axes; ``motions``: for each frame ((shift, rotation vector)
    of a, the same of b), both in the axes of the joint and about its initial O."""
    axes = matrix([0.3, -0.4, 0.9])
    origin, position0 = np.array([2.0, -1.0, 0.5]), np.array([[2.1, -1.2, 0.4], [1.9, -1.1, 0.7]])
    displacement, orientation = np.zeros((len(motions), 2, 3)), np.zeros((len(motions), 2, 4))
    for k, pair in enumerate(motions):
        for i, (shift, vector) in enumerate(pair):
            world = axes.T @ np.asarray(vector, float)
            arm = position0[i] - origin
            displacement[k, i] = axes.T @ np.asarray(shift, float) + matrix(world) @ arm - arm
            orientation[k, i] = product(quaternion(world), start)
    if rows is None:
        rows = np.tile([100.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], (len(motions), 1, 1))
    arms = shrink * polygon if formulation != "convex" else np.zeros((0, 2))
    joint = {"block_a": 0, "block_b": 1, "host": host, "origin": origin, "axes": axes, "polygon": polygon}
    joint |= {
        "area": A * B,
        "friction": 0.64,
        "formulation": formulation,
        "pressure": pressure,
        "normal_arms": arms,
        "shear_arms": arms,
    }
    joint |= {"areas": np.full(len(arms), A * B / 4)}
    times = np.arange(len(motions), dtype=float)
    found = SimpleNamespace(
        counts_equilibria=False,
        n_frames=len(motions),
        joints=[joint],
        position0=position0,
        orientation0=np.tile(start, (2, 1)),
        frame_time=times,
        time=times,
        series=lambda name, a, b: rows[a:b, :, CHANNELS.index(name.removeprefix("joint/"))],
    )
    channels = {"displacement": displacement, "orientation": orientation, "contact_force": forces}
    found.frame_values = lambda name, a, b: None if channels.get(name) is None else channels[name][a:b]
    return found


STILL = ((0, 0, 0), (0, 0, 0))
CARRIED = ((0.4, -0.3, 0.2), (0.5, 1.1, -0.8))  # a large motion of a, which must not affect the joint


def carried(shift, vector):
    """Motion of b if it moves by (shift, vector) relative to a, and a moves by CARRIED."""
    of_a = matrix(CARRIED[1])
    whole = of_a @ matrix(vector)
    angle = np.arccos(np.clip((np.trace(whole) - 1) / 2, -1, 1))
    skew = (whole - whole.T) / (2 * np.sin(angle))
    return np.array(CARRIED[0]) + of_a @ shift, angle * np.array([skew[2, 1], skew[0, 2], skew[1, 0]])


@pytest.mark.parametrize("vector", [(0.0, 0.0, 0.0), (1e-9, -2e-9, 3e-9), (0.2, -0.1, 0.4), (0.0, 0.0, 3.0)])
@pytest.mark.parametrize("moving", [False, True])
def test_motion_of_b_as_seen_from_a(vector, moving):
    shift = np.array([1e-3, -2e-3, 5e-4])
    pair = (CARRIED, carried(shift, vector)) if moving else (STILL, (shift, vector))
    found = JointMotion(run([pair])).at([0]).relative[0]
    assert found.components.shape == (1, 6)
    np.testing.assert_allclose(found.components[0, :3], shift, rtol=0, atol=1e-15)
    np.testing.assert_allclose(found.components[0, 3:], vector, rtol=0, atol=2e-15)


def test_small_rotations_keep_their_digits():
    start = np.array([1.0, 0.0, 0.0, 0.0])
    found = JointMotion(run([(STILL, ((0, 0, 0), (1e-9, -2e-9, 3e-9)))], start=start)).at([0]).relative[0]
    np.testing.assert_allclose(found.rotation[0], (1e-9, -2e-9, 3e-9), rtol=1e-14)


@pytest.mark.parametrize("host", [0, 1])
def test_opening_is_the_distance_of_the_faces(host):
    shift, vector = np.array([0.01, -0.02, 0.003]), np.array([0.15, -0.1, 0.3])
    found = JointMotion(run([(STILL, (shift, vector))], host=host)).at([0]).relative[0]
    turn = matrix(vector)
    flat = np.column_stack([CORNERS, np.zeros(4)])
    # corner of b above the plane z = 0 of a, or plane of b above a corner of a
    expected = (shift + flat @ turn.T)[:, 2] if host == 1 else (shift - flat) @ turn[:, 2]
    np.testing.assert_allclose(found.opening[0], expected, rtol=0, atol=1e-15)
    np.testing.assert_allclose(found.distance(np.asarray(CORNERS[::-1], float), 0), expected[::-1], rtol=0, atol=1e-15)


@pytest.mark.parametrize("host", [0, 1])
def test_resultants_act_about_the_point_that_rides_on_the_host(host):
    """O moves with the block to which the polygon is fixed, by the displacement of that block at O."""
    pair = (CARRIED, ((0.01, -0.02, 0.003), (0.15, -0.1, 0.3)))
    given = run([pair], host=host)
    axes, origin = given.joints[0]["axes"], given.joints[0]["origin"]
    found = JointMotion(given).at([0]).acting_origin[0, 0]
    np.testing.assert_allclose(found, origin + axes.T @ pair[host][0], rtol=0, atol=1e-14)


@pytest.mark.parametrize("host", [0, 1])
@pytest.mark.parametrize(
    "dn, r1, r2, state, share",
    [
        (-1e-6, 0.0, 0.0, "closed", 0.0),
        (0.0, 0.0, 0.0, "closed", 0.0),
        (1e-6, 0.0, 0.0, "open", 1.0),
        (0.0, 1e-5, 0.0, "partly open", 0.5),  # opens where y > 0
        (0.0, 0.0, 1e-5, "partly open", 0.5),
        (-0.5e-6, 1e-5, 0.0, "partly open", 0.25),  # y > 0.05
        (0.4e-6, 0.0, 1e-5, "partly open", 0.5 + 0.04 / 0.3),  # x < 0.04
        (0.0, 1.5e-5, 1e-5, "partly open", 0.5),  # along a diagonal
        (-2.5e-6, 1e-5, -1e-5, "partly open", 0.0),  # touches a corner only: x + y > 0.25
        (-2.0e-6, 1e-5, -1e-5, "partly open", 0.5 * 0.05**2 / 0.06),
    ],
)
def test_open_share(host, dn, r1, r2, state, share):
    found = JointMotion(run([(STILL, ((0, 0, dn), (r1, r2, 0)))], host=host)).at([0]).relative[0]
    if share == 0.0 and state != "closed":
        assert found.open_share[0] < 1e-7
    else:
        assert STATES[found.state[0]] == state
        np.testing.assert_allclose(found.open_share[0], share, rtol=0, atol=1e-7)


def test_open_share_of_a_triangle_among_rectangles():
    triangle = np.array([[-0.1, -0.05], [0.2, -0.05], [-0.1, 0.1]])
    history = run([(STILL, ((0, 0, 0.5e-6), (0, 1e-5, 0)))], polygon=triangle)
    history.joints[0]["area"] = 0.5 * 0.3 * 0.15
    other = run([]).joints[0]
    history.joints.append(other)
    found = JointMotion(history).at([0]).relative[0]
    assert found.joints.n_corner.tolist() == [3, 4]
    # open at x < 0.05: the corner at x = 0.2 remains closed, half as wide as the whole
    np.testing.assert_allclose(found.open_share, [0.75, 0.5 + 0.05 / 0.3], rtol=0, atol=1e-7)
    grid = JointMotion(history).grid(0, along=30)
    assert abs(len(grid) * 0.3 * 0.15 / 450 / 0.0225 - 1) < 0.05  # cells of 1 cm over half a rectangle


def about(centre, angle):
    """Shift and rotation vector of a rotation by ``angle`` about a centre in the plane of the joint."""
    c, s = np.cos(angle), np.sin(angle)
    x, y = centre
    return np.array([x - c * x + s * y, y - s * x - c * y, 0.0]), np.array([0.0, 0.0, angle])


@pytest.mark.parametrize("centre", [(-0.121, 0.0), (0.07, -0.04), (3.0, 20.0)])
@pytest.mark.parametrize("angle", [1e-8, 1e-4, -0.5, 2.0])
def test_torsion_centre_of_a_turn(centre, angle):
    history = run([(STILL, STILL), (STILL, about(centre, angle))], start=np.array([1.0, 0.0, 0.0, 0.0]))
    found = JointMotion(history).torsion_centre(1)
    np.testing.assert_allclose(found[0], centre, rtol=0, atol=1e-7 * max(1.0, np.abs(centre).max()))


def test_torsion_centre_of_an_increment():
    """Rotations about one centre and then about another, the second with a large motion of both blocks."""
    first, second = (0.05, 0.02), (-0.1, -0.08)
    shift_1, turn_1 = about(first, 0.1)
    c, s = np.cos(0.2), np.sin(0.2)
    shift_2 = np.array(second) + np.array([[c, -s], [s, c]]) @ (shift_1[:2] - second)
    motions = [(STILL, STILL), (STILL, (shift_1, turn_1)), (CARRIED, carried([*shift_2, 0.0], [0.0, 0.0, 0.3]))]
    joints = JointMotion(run(motions))
    np.testing.assert_allclose(joints.torsion_centre(1)[0], first, rtol=0, atol=1e-13)
    np.testing.assert_allclose(joints.torsion_centre(2)[0], second, rtol=0, atol=1e-13)
    np.testing.assert_allclose(joints.torsion_centre(-1, since=1)[0], second, rtol=0, atol=1e-13)
    assert np.isnan(joints.torsion_centre(0)).all()
    every = joints.at([0, 1, 2]).relative
    np.testing.assert_allclose(torsion_centre(every[0], every[2])[0], joints.torsion_centre(2, since=0)[0])


def test_no_torsion_centre_in_shear_in_rocking_and_apart():
    shear, tilt = ((1e-3, 2e-3, 0), (0, 0, 0)), ((0, 0, 0), (0.01, 0, 1e-3))
    apart = ((0, 0, 1e-3), (0, 0, 0.1))
    joints = JointMotion(run([(STILL, STILL), (STILL, shear), (STILL, STILL), (STILL, tilt), (STILL, apart)]))
    for k in range(5):
        assert np.isnan(joints.torsion_centre(k, since=0 if k == 4 else None)).all()


def test_slip_at_points_and_on_a_grid():
    shift, vector = about((0.05, -0.02), 0.3)
    joints = JointMotion(run([(STILL, (shift, vector))], formulation="concave"))
    points = joints.grid(0, along=6)
    assert points.shape == (24, 2)
    np.testing.assert_allclose(points.mean(axis=0), 0.0, atol=1e-16)
    arm = points - (0.05, -0.02)
    expected = np.array([0.05, -0.02]) + arm @ matrix(vector)[:2, :2].T - points
    np.testing.assert_allclose(joints.at([0]).relative[0].slip(0, points), expected, rtol=0, atol=1e-16)
    assert joints.at([0, 0, 0]).relative.slip(0, points).shape == (3, 24, 2)


def test_utilisation_of_a_convex_joint():
    """Utilisation is 1 at the limit loads of sets 4a and 4b on the exact surface."""
    N, limit = 467.0, {0.075: 216.054938, 0.135: 161.9025}
    forces = [[N, 0, V, V * e, 0, 0, 0] for e, V in limit.items()]
    forces += [[2 * N, 0, V, V * e, 0, 0, 0] for e, V in limit.items()]
    forces += [[N, 0.5 * 0.64 * N, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0, 0], [N, 0, 0, 0, 0, 0, 0]]
    history = run([(STILL, STILL)] * 8, rows=np.array(forces)[:, None, :])
    found = JointMotion(history).at(range(8)).utilisation[:, 0]
    np.testing.assert_allclose(found[:2], 1.0, rtol=3e-7)
    np.testing.assert_allclose(found[2:4], 0.5, rtol=3e-7)
    np.testing.assert_allclose(found[4:], [0.5, 0.0, np.inf, 0.0], rtol=1e-12)


@pytest.mark.parametrize("pressure", ["full", "effective", "linear"])
def test_utilisation_of_a_convex_joint_whose_friction_follows_the_bending(pressure):
    """Torsion under an eccentric N, e_y = 0.35 b, on 0.3 x 0.2: utilisation is 1 at the tabulated strengths."""
    N, e = 100.0, 0.35 * B
    strength = 0.64 * N * 0.09681061 * {"full": 1.0, "effective": 0.8071, "linear": 0.8190}[pressure]
    # N at y = e: M_1 = -e N; the no-tension wedge over 3 (b/2 - e), zero penetration at its end
    deep, r1 = 0.1 - 3 * (0.1 - e), -1e-5
    rows = np.array([[[N, 0, 0, strength, -e * N, 0, 0]]])
    history = run([(STILL, ((0, 0, -r1 * deep), (r1, 0, 0)))], pressure=pressure, rows=rows)
    np.testing.assert_allclose(JointMotion(history).at([0]).utilisation[0], 1.0, rtol=1e-4)


def test_utilisation_at_points_under_their_own_normal_forces():
    """If only two points are pressed, the strengths are mu N for V along x and mu N times half their distance."""
    N = 100.0
    axes = matrix([0.3, -0.4, 0.9])
    normals = np.array([[25.0, 25, 25, 25], [50.0, 50, 0, 0]])
    forces = normals[:, :, None] * axes[2] + 3.0 * axes[0]
    arm = np.hypot(A, B) / 2
    rows = np.array([[N, 0, 0, 0.64 * N * arm, 0, 0, 0], [N, 0, 0, 0.32 * N * A, 0, 0, 0]])[:, None, :]
    rows[1, 0, 1] = 0.64 * N * 0.3  # with no torsion about the middle of the two points
    rows[1, 0, 3] = 0.64 * N * 0.3 * B / 2
    history = run([(STILL, STILL)] * 2, formulation="concave", rows=rows, forces=forces)
    joints = JointMotion(history)
    np.testing.assert_allclose(joints.at([1]).normal_forces[0], normals[1], atol=1e-12)
    np.testing.assert_allclose(joints.at([0, 1]).utilisation[:, 0], [1.0, 0.3], rtol=1e-10)


def test_normal_forces_follow_the_penetration_where_they_are_not_recorded():
    """At dn = -1 um a tilt that opens y > 0.05 unloads the points at y = 0.1; one about t2 follows the springs."""
    motions = [(STILL, STILL), (STILL, ((0, 0, -1e-6), (0, 0, 0))), (STILL, ((0, 0, -1e-6), (0, 4e-6, 0)))]
    motions.append((STILL, ((0, 0, -1e-6), (2e-5, 0, 0))))
    joints = JointMotion(run(motions, formulation="concave"))
    np.testing.assert_allclose(joints.at([0]).normal_forces[0], 25.0)
    np.testing.assert_allclose(joints.at([1]).normal_forces[0], 25.0)
    # penetration 1 um + r2 x: 0.4 at x = -0.15, 1.6 at x = 0.15
    np.testing.assert_allclose(joints.at([2]).normal_forces[0], [10.0, 40.0, 40.0, 10.0], rtol=1e-9)
    np.testing.assert_allclose(joints.at([3]).normal_forces[0], [50.0, 50.0, 0.0, 0.0], rtol=1e-9)
    law = theory.points(0.5 * np.array([[-A, -B], [A, -B]]), np.array([50.0, 50.0]), 0.64)
    assert theory.gauge(law, np.array([32.0, 0.0, 3.2])) == pytest.approx(0.5)


def test_rows_next_to_frames():
    found = nearest(np.array([0.0, 1.0, 2.0, 4.0]), np.array([-1.0, 0.0, 0.4, 0.6, 1.0, 2.9, 3.1, 9.0]))
    assert found.tolist() == [0, 0, 0, 1, 1, 2, 3, 3]
    assert nearest(np.array([5.0]), np.array([0.0, 7.0])).tolist() == [0, 0]


def test_resultants_of_one_frame_and_of_several():
    rows = np.arange(28.0).reshape(4, 1, 7)
    joints = JointMotion(run([(STILL, STILL)] * 4, rows=rows))
    np.testing.assert_array_equal(joints.at([2]).resultants[0], rows[2])
    np.testing.assert_array_equal(joints.at([3, 1]).resultants, rows[[3, 1]])


def test_moments_about_the_start_of_a_joint_that_was_cut():
    """With F = (V_1, V_2, -N) on a at r, recorded moments are (r - s) x F, and those about the initial O r x F."""
    F, r, s = np.array([30.0, -20.0, -100.0]), np.array([0.04, 0.03, 0.0]), np.array([-0.02, 0.01, 0.0])
    (m_1, m_2, m_t), expected = np.cross(r - s, F), np.cross(r, F)
    given = run([(STILL, STILL)], rows=np.array([[[100.0, 30.0, -20.0, m_t, m_1, m_2, 0.0]]]))
    recorded = given.frame_values
    given.frame_values = lambda name, a, b: s[None, None, :2] if name == "joint_shift" else recorded(name, a, b)
    found = JointMotion(given).at([0])
    np.testing.assert_allclose(found.about_start[0, 0], [100, 30, -20, expected[2], *expected[:2], 0], atol=1e-12)
    np.testing.assert_allclose(found.shift[0, 0] + found.pressure_centre[0, 0], r[:2], atol=1e-15)


def test_gauge_of_points_against_theory():
    """Random loads on 1, 2, 4 and 12 points agree with theory, also if the mechanism turns about a sticking point."""
    random = np.random.default_rng(3)
    worst, kinks = 0.0, 0
    for n in (2, 4, 4, 4, 12):
        arms = random.uniform(-0.2, 0.2, (n, 2)) if n != 4 else CORNERS
        for _ in range(40):
            weight = random.uniform(0.0, 50.0, n) * (random.random(n) < 0.8)
            weight[0] = 20.0
            force = random.standard_normal(3) * (30.0, 30.0, 4.0)
            law = theory.points(arms, weight, 1.0)
            if n == 2 and weight[1] == 0.0:
                continue
            expected = float(theory.gauge(law, force))
            points = FrictionPoints(*np.ascontiguousarray(arms.T), weight, 0, n)
            found = point_gauge(points, *force, np.zeros(3), np.zeros(6))
            worst = max(worst, abs(found / expected - 1.0))
            kinks += best_kink(points, *force)[2]
    assert worst < 1e-9 and 20 < kinks < 180


def test_gauge_of_a_single_point():
    points = FrictionPoints(np.array([0.1, 0.2]), np.array([0.05, 0.0]), np.array([10.0, 0.0]), 0, 2)
    through = (3.0, 4.0, 0.1 * 4.0 - 0.05 * 3.0)
    assert point_gauge(points, *through, np.zeros(3), np.zeros(6)) == pytest.approx(0.5, rel=1e-12)
    nearly = (3.0, 4.0, through[2] * (1 + 1e-5))
    assert point_gauge(points, *nearly, np.zeros(3), np.zeros(6)) == pytest.approx(0.5, rel=1e-12)
    assert point_gauge(points, 3.0, 4.0, 0.0, np.zeros(3), np.zeros(6)) == np.inf


def test_a_hinge_in_small_displacements_opens_linearly():
    """Block b turns by 0.02 about the edge y = -B/2: that edge stays closed and the other opens by exactly 0.02 B.

    With exact rotations an arm of 0.3 m would add 60 um, and the whole joint would appear open.
    """
    vector = np.array([0.02, 0.0, 0.0])
    history = run([(STILL, STILL)], formulation="concave")
    a, b = history.position0
    arm = b - history.joints[0]["origin"]
    axes = history.joints[0]["axes"]
    pivot = axes.T @ np.array([0.0, -B / 2, 0.0])
    world = axes.T @ vector
    displacement, orientation = np.zeros((1, 2, 3)), np.tile(SKEW, (1, 2, 1))
    displacement[0, 1] = np.cross(world, arm - pivot)
    orientation[0, 1] = product(quaternion(world), SKEW)
    history.frame_values = lambda name, start, stop: {"displacement": displacement, "orientation": orientation}.get(
        name
    )
    history.small_displacements = True
    found = JointMotion(history).at([0]).relative[0]
    np.testing.assert_allclose(np.sort(found.opening[0]), [0.0, 0.0, 0.02 * B, 0.02 * B], atol=1e-15)
    assert STATES[found.state[0]] == "partly open"
    np.testing.assert_allclose(found.slip(0, CORNERS), 0.0, atol=1e-15)
    history.small_displacements = False
    assert STATES[JointMotion(history).at([0]).relative[0].state[0]] != "partly open" or arm @ axes[2] == 0.0


@pytest.mark.parametrize("formulation, shrink", [("convex", 1.0), ("concave", 1.0), ("corrected", 0.8)])
def test_a_hinge_uses_all_of_its_joint(formulation, shrink):
    """Utilisation is 1 with the centre of pressure on an edge, 0.5 half way to it, or that of friction if greater."""
    N = 100.0
    edge = shrink * B / 2
    rows = np.array([[N, 0, 0, 0, -edge * N, 0, 0], [N, 0, 0, 0, 0, 0.5 * shrink * A / 2 * N, 0],
                     [N, 0.64 * 0.7 * N, 0, 0, -0.3 * edge * N, 0, 0], [0, 0, 0, 0, 0, 0, 0]])[:, None, :]  # fmt: skip
    joints = JointMotion(run([(STILL, STILL)] * 4, formulation=formulation, shrink=shrink, rows=rows))
    frames = joints.at(range(4))
    np.testing.assert_allclose(frames.bending_utilisation[:, 0], [1.0, 0.5, 0.3, 0.0], rtol=1e-12)
    np.testing.assert_allclose(frames.utilisation[[0, 1, 3], 0], [1.0, 0.5, 0.0], rtol=1e-12)
    assert frames.utilisation[2, 0] >= 0.7 - 1e-12


def test_one_joint_alone_is_as_among_all(tmp_path):
    """Reading only the second of two joints, with its contact points, gives the values from reading all joints."""
    poses, blocks = cases.frames(0, 4, 3), cases.mixed_assembly()
    with cases.written(tmp_path / "run.h5", cases.record(0, 31, 2, 0), poses, blocks) as three:
        alone, among = JointMotion(three, 1), JointMotion(three)
        start = among.point_start[1]
        for name in ("resultants", "utilisation", "origin", "normal_forces"):
            found, expected = getattr(alone.at(range(4)), name), getattr(among.at(range(4)), name)
            np.testing.assert_allclose(found, expected[:, start:] if name == "normal_forces" else expected[:, 1:])
        np.testing.assert_array_equal(alone.torsion_centre(3), among.torsion_centre(3)[1:])
