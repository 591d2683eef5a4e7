"""New contacts: the surface of equal penetration, its forces, and the memory of friction."""

import math
from itertools import pairwise

import numpy as np
import pytest

from dembrick.geometry.rotations import quaternion_product, rotation_matrix
from dembrick.geometry.shapes import box
from dembrick.kernels.dynamics.contact_forces import CROWDED, DEEP, touch
from dembrick.kernels.joint.no_tension import no_tension
from helpers.pairs import BLOCK, K_N, K_S, SETTINGS, Pair, no_joints, quaternion, set_up, turned
from helpers.plain_python import cases


@pytest.mark.parametrize("depth", [1e-7, 1e-5])
@pytest.mark.parametrize("angle", [0.0, 0.3, 1.0])
def test_flat_faces_carry_the_joints_law(depth, angle):
    """kn A g on the shared polygon, as in a joint, but for a rim of width g/4, whose shortest way out is sideways."""
    plate = box((1.0, 1.0, 0.2))
    pair = Pair(plate, BLOCK)
    q = turned(((0, 0, 1), angle))
    wrench = pair.wrench((0.1, -0.05, 0.15 - depth), q)
    area, rim = 0.06, 0.25 * depth * 1.0
    assert wrench[2] == pytest.approx(K_N * depth * (area - rim), rel=1e-7 / depth * 1e-7 + 1e-8)
    np.testing.assert_allclose(wrench[[0, 1]], 0.0, atol=1e-9 * wrench[2])
    np.testing.assert_allclose(wrench[3:], 0.0, atol=1e-8 * wrench[2])
    # half over an edge
    wrench = pair.wrench((0.5, 0.0, 0.15 - depth))
    assert wrench[2] == pytest.approx(0.5 * K_N * depth * area, rel=20 * depth)
    assert wrench[4] == pytest.approx(0.075 * wrench[2], rel=20 * depth)


@pytest.mark.parametrize("tilt", [1e-5, 1e-4])
def test_slightly_tilted_faces_carry_the_joints_integral(tilt):
    """Force and moment are those of kn <g>+ over the face, to the order of g over length."""
    pair = Pair(box((1.0, 1.0, 0.2)), BLOCK)
    wrench = pair.wrench((0.0, 0.0, 0.15 - 5e-6), turned(((0, 1, 0), tilt)))
    x, y = np.array([-0.15, 0.15, 0.15, -0.15]), np.array([-0.1, -0.1, 0.1, 0.1])
    force, about_x, _ = no_tension(x, y, 0, 4, 5e-6 - 0.15 * tilt, 5e-6, tilt, 0.0)
    assert wrench[2] == pytest.approx(K_N * force, rel=3e-4)
    assert wrench[4] == pytest.approx(-K_N * about_x, rel=1e-3)


@pytest.mark.parametrize("name", SETTINGS)
def test_forces_are_those_of_the_pressure_field(name):
    """Against a grid over the common volume that uses the pressures only, no surface and no patches."""
    pair = set_up(name)
    wrench = pair.touch()
    energy, expected = pair.potential()
    assert energy > 0.0
    np.testing.assert_allclose(wrench[:3], expected[:3], atol=2e-3 * np.linalg.norm(expected[:3]))
    np.testing.assert_allclose(wrench[3:], expected[3:], atol=2e-3 * 0.1 * np.linalg.norm(expected[:3]))


@pytest.mark.parametrize("name", SETTINGS)
def test_action_is_reaction(name):
    """Forces sum to zero, and so do their moments about any point, whichever block comes first."""
    pair = set_up(name, ratio=0.2)
    rng = np.random.default_rng(1)
    pair.bodies.velocity[:], pair.bodies.spin[:] = rng.normal(size=(2, 2, 3))
    on = pair.touch()
    back = pair.bodies.applied[0]
    size = np.linalg.norm(on[:3])
    np.testing.assert_allclose(on[:3] + back[:3], 0.0, atol=1e-13 * size)
    arms = np.cross(pair.bodies.position, pair.bodies.applied[:, :3])
    np.testing.assert_allclose((arms + pair.bodies.applied[:, 3:]).sum(axis=0), 0.0, atol=1e-13 * size)
    twin = Pair(*pair.shapes[::-1], ratio=0.2)
    twin.place(0, pair.bodies.position[1], pair.bodies.orientation[1])
    twin.place(1, (0.0, 0.0, 0.0))
    twin.bodies.velocity[:], twin.bodies.spin[:] = pair.bodies.velocity[::-1], pair.bodies.spin[::-1]
    np.testing.assert_allclose(-twin.touch()[:3], on[:3], atol=1e-9 * size)


def sweep(pair, path, n):
    """Wrenches along a path: s in (0, 1) -> position, orientation."""
    return np.array([pair.wrench(*path(s)) for s in np.linspace(0.0, 1.0, n)])


PATHS = {
    "flat to edge": lambda s: (
        (0.05, 0.013, 0.099 + 0.15 * math.sin(0.03 * s) - 0.05 * (1.0 - math.cos(0.03 * s))),
        turned(((0, 1, 0), 0.03 * s))),
    "edge to corner": lambda s: ((0.03, 0.02, 0.183 + 0.02 * s), turned(((0, 1, 0), 0.8), ((1, 0, 0), 0.3 * s - 0.05))),
    "over the edge": lambda s: ((0.33 * s, 0.05, 0.0985), turned(((0, 0, 1), 0.3), ((0, 1, 0), 0.02))),
    "round the corner": lambda s: (
        set_up("corner at corner").bodies.position[1] + s * np.array([-0.02, 0.03, 0.01]),
        turned(((1, 2, 3), 0.6 + 0.1 * s))),
}  # fmt: skip


@pytest.mark.parametrize("name", PATHS)
def test_nothing_jumps(name):
    """The greatest change of the wrench along a path halves when the path's steps do: it is continuous."""
    pair = Pair(BLOCK, BLOCK)
    steps = []
    for n in cases((500, 1000, 2000), (500, 1000)):
        wrench = sweep(pair, PATHS[name], n + 1)
        assert np.count_nonzero(wrench.any(axis=1)) > n / 4
        steps.append(np.abs(np.diff(wrench, axis=0)).max() / np.abs(wrench).max())
    assert steps[0] < 0.1
    assert all(later < 0.6 * earlier for earlier, later in pairwise(steps))


def test_a_square_loop_gives_nothing_back():
    """The work of the normal forces along a closed path is zero, to the order of the quadrature."""
    pair = Pair(BLOCK, BLOCK, friction=0.0)
    q = turned(((0, 1, 0), 0.7), ((1, 0, 0), 0.5))
    angle = np.linspace(0.0, 2.0 * math.pi, 401)
    path = np.array([0.05, 0.02, 0.215]) + 0.01 * np.column_stack([np.cos(angle), 0 * angle, np.sin(angle)])
    force = np.array([pair.wrench(place, q)[:3] for place in path])
    steps = np.diff(path, axis=0)
    work = (0.5 * (force[1:] + force[:-1]) * steps).sum()
    assert abs(work) < 1e-3 * np.abs((force[:-1] * steps).sum(axis=1)).sum()


def test_apart_means_no_force_and_no_memory():
    pair = Pair(BLOCK, BLOCK)
    pair.contact.elastic[:] = 1.0
    pair.contact.stiffness[:] = 1.0
    assert not pair.wrench((0.0, 0.0, 0.1001)).any()
    assert not pair.contact.elastic.any() and not pair.contact.normal.any()
    assert pair.contact.plane[0] == 1  # the top of the first block separates them, and is tested first from now on
    pair.place(1, (0.0, 0.0, 0.0999))
    assert pair.touch()[2] > 0.0


def test_too_deep_and_too_crowded_are_said():
    pair = Pair(BLOCK, BLOCK)
    pair.place(1, (0.0, 0.0, 0.07))
    assert touch(pair.contact, no_joints(), pair.bodies, 1e-6) == DEEP
    pair.place(1, (0.0, 0.0, 0.0999))
    small = pair.contact.scratch._replace(x=np.zeros(9), y=np.zeros(9))
    assert touch(pair.contact._replace(scratch=small), no_joints(), pair.bodies, 1e-6) == CROWDED


def slide(pair, velocity, spin, steps, dt=1e-6):
    """Move the second block at constant velocity and spin; return the wrenches on it."""
    found = []
    pair.bodies.velocity[1], pair.bodies.spin[1] = velocity, spin
    q = pair.bodies.orientation[1].copy()
    position = pair.bodies.position[1].copy()
    for step in range(1, steps + 1):
        angle = np.linalg.norm(spin) * dt * step
        pair.place(1, position + dt * step * np.asarray(velocity),
                   quaternion_product(quaternion(spin, angle), q) if angle else q)  # fmt: skip
        found.append(pair.touch(dt))
    return np.array(found)


def test_friction_sticks_and_slips():
    """ks A per displacement while it sticks, mu N when it slips, and back; the slip path is the difference."""
    pair = Pair(box((1.0, 1.0, 0.2)), BLOCK)
    pair.place(1, (0.0, 0.0, 0.15 - 1e-6))
    normal = pair.touch()[2]
    forward = slide(pair, (0.03, 0.04, 0.0), (0.0, 0.0, 0.0), 60)
    step = 0.05e-6
    stick = forward[5, :3] / normal
    np.testing.assert_allclose(stick[:2], -K_S * 0.06 * 6 * step / normal * np.array([0.6, 0.8]), rtol=1e-3)
    np.testing.assert_allclose(forward[-1, :2], -0.6 * normal * np.array([0.6, 0.8]), rtol=1e-6)
    elastic = 0.6 * normal / (K_S * 0.06)
    assert pair.contact.slip[0] == pytest.approx(60 * step - elastic, rel=1e-3)
    back = slide(pair, (-0.03, -0.04, 0.0), (0.0, 0.0, 0.0), 3)
    np.testing.assert_allclose(np.hypot(*back[-1, :2]), 0.6 * normal - 3 * K_S * 0.06 * step, rtol=1e-3)


def test_pure_torsion_is_that_of_the_mean_distance():
    """mu N c_T about the centre, paper eq. 1; ks J while it sticks."""
    from dembrick.geometry.polygons import mean_distance

    pair = Pair(box((1.0, 1.0, 0.2)), BLOCK)
    pair.place(1, (0.0, 0.0, 0.15 - 1e-6))
    normal = pair.touch()[2]
    found = slide(pair, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 60)
    polar = 0.3 * 0.2 * (0.3**2 + 0.2**2) / 12.0
    assert found[3, 5] == pytest.approx(-K_S * polar * 4e-6, rel=1e-3)
    radius = mean_distance(np.array([(-0.15, -0.1), (0.15, -0.1), (0.15, 0.1), (-0.15, 0.1)]))[0]
    assert found[-1, 5] == pytest.approx(-0.6 * normal * radius, rel=1e-5)


def test_memory_turns_with_both_blocks():
    """Two blocks that rotate as one rigid body keep the friction between them, in their own axes."""
    pair = Pair(BLOCK, BLOCK)
    pair.place(1, (0.02, 0.0, 0.1 - 1e-6))
    pair.touch()
    slide(pair, (0.02, 0.0, 0.0), (0.0, 0.0, 0.0), 10)
    pair.bodies.velocity[1] = 0.0
    force = pair.touch()[:3]
    assert force[0] < -40.0
    dt, spin = 1e-5, np.array([30.0, 20.0, 50.0])
    start, middle = pair.bodies.position.copy(), np.array([0.5, -0.3, 0.2])
    pair.bodies.spin[:] = spin
    for step in range(1, 2001):
        q = quaternion(spin, np.linalg.norm(spin) * dt * step)
        turn = rotation_matrix(q)
        before = pair.bodies.position.copy()
        for block in (0, 1):
            pair.place(block, middle + turn @ (start[block] - middle), q)
        pair.bodies.velocity[:] = (pair.bodies.position - before) / dt
        last = pair.touch(dt)[:3]
    np.testing.assert_allclose(turn.T @ last, force, atol=1e-5 * np.linalg.norm(force))


def strengths(place, orientation, depth):
    """Wrench on a block flush on another (moments over 0.1 m), and its shear and torsion strength, found by a step in
    which the elastic forces alone would be several times as large."""
    found = []
    for velocity, spin in (((5e6 * depth, 0.0, 0.0), 0.0), ((0.0, 0.0, 0.0), 5e7 * depth)):
        pair = Pair(BLOCK, BLOCK)
        wrench = pair.wrench(place, orientation)
        pair.bodies.velocity[1], pair.bodies.spin[1, 2] = velocity, spin
        found.append(pair.touch())
    return np.array([*wrench[:3], *(wrench[3:] / 0.1), -found[0][0], -found[1][5] / 0.1])


FLUSH = {  # motions in which side faces become coplanar: range (m or rad), position and orientation
    "turn": (1e-3, lambda s: ((0.0, 0.0, 0.0), turned(((0, 0, 1), s)))),
    "shift along": (1e-3, lambda s: ((s, 0.0, 0.0), turned())),
    "shift across": (1e-3, lambda s: ((0.0, s, 0.0), turned())),
}


@pytest.mark.parametrize("depth", [1e-7, 1e-5, 1e-4])
@pytest.mark.parametrize("name", FLUSH)
def test_flush_side_faces_change_no_strength(name, depth):
    """Side faces that become coplanar change resultant and strength by no more than twice the overlap over the shorter
    edge; doubling a joint's four points would cost 14 % there."""
    far, path = FLUSH[name]
    found = []
    for s in far * np.array([-1.0, -0.1, -1e-3, -1e-6, 0.0, 1e-6, 1e-3, 0.1, 1.0]):
        place, orientation = path(s)
        found.append(strengths(np.array(place) + (0.0, 0.0, 0.1 - depth), orientation, depth))
    found = np.array(found) / (K_N * 0.06 * depth)
    bound = 2.0 * depth / 0.2
    assert found[4, 2] == pytest.approx(1.0, abs=bound)
    assert found[4, 6] == pytest.approx(0.6, abs=bound)
    # the jump from one side of flush to the other; apart from it 2e-3 of motion changes the common area by 1e-5
    assert np.ptp(found[3:6], axis=0).max() < bound + 1e-5
    # 1e-3 further on the common area is smaller by at most 1/200, and its centre has moved by 1/200 of 0.1 m
    assert np.ptp(found, axis=0).max() < bound + 0.01


@pytest.mark.parametrize("depth", [1e-6, 1e-4])
def test_a_seam_between_flush_tops_is_not_felt(depth):
    """Over the seam between two blocks, normal force and shear strength change by no more than overlap over length."""
    half = box((0.5, 1.0, 0.2))
    found = []
    for x in np.concatenate([np.linspace(-0.2, 0.2, 81), 0.15 + depth * np.linspace(-2.0, 2.0, 41)]):
        wrench = np.zeros(6)
        for side in (-0.25, 0.25):
            pair = Pair(half, BLOCK, friction=0.0)
            pair.place(0, (side, 0.0, 0.0))
            pair.place(1, (x, 0.0, 0.15 - depth))
            wrench += pair.touch()
        found.append(wrench)
    found = np.array(found) / (K_N * 0.06 * depth)
    np.testing.assert_allclose(found[:, 2], 1.0, atol=3.0 * depth / 0.2)
    assert np.abs(found[:, :2]).max() < 2.0 * depth / 0.3
    assert np.abs(found[:, 3:]).max() < 2.0 * depth
