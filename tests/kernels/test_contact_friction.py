"""The torsion-shear limit surface of new contacts, against quadrature that uses no kernel."""

import math
from functools import cache

import numpy as np
import pytest
from scipy.optimize import minimize

from dembrick.geometry.convex_hull import prism
from dembrick.geometry.shapes import box
from dembrick.kernels.joint.pressure import pressed_surface
from helpers.pairs import BLOCK, K_N, SETTINGS, Pair, set_up, turned

FRICTION = 0.6
FLOOR = box((3.0, 3.0, 0.2))
DEEP = 1e-8  # m: elastic slips of nanometres
FAST = 1.0  # m/s, in steps of 1e-6 s


def rubbed(pair, velocity, spin, about):
    """Force and moment about the point ``about`` on the second block in steady slip at its present place, with this
    velocity (3,) of the point and this spin (3,)."""
    velocity, spin, about = (np.asarray(vector, float) for vector in (velocity, spin, about))
    pair.bodies.spin[1] = spin
    pair.bodies.velocity[1] = velocity + np.cross(spin, pair.bodies.position[1] - about)
    for _ in range(40):
        wrench = pair.touch()
    return wrench[:3], wrench[3:] + np.cross(pair.bodies.position[1] - about, wrench[:3])


@cache
def gauss_rule(n):
    """Nodes and weights on [0, 1]; a large one takes a second."""
    nodes, weights = np.polynomial.legendre.leggauss(n)
    return 0.5 * (nodes + 1.0), 0.5 * weights


def spread_evenly(corners, n=600):
    """Points and weights of a Gauss rule on the triangles of a fan over a polygon."""
    nodes, weights = gauss_rule(n)
    a, b = np.meshgrid(nodes, nodes, indexing="ij")
    own = weights[:, None] * weights * a
    points, shares = [], []
    for p, q in zip(corners[1:-1], corners[2:], strict=True):
        first, edge = p - corners[0], q - p
        points.append((corners[0] + a[..., None] * (first + b[..., None] * edge)).reshape(-1, 2))
        shares.append((own * abs(first[0] * edge[1] - first[1] * edge[0])).ravel())
    return np.concatenate(points), np.concatenate(shares)


def friction_of(points, load, v, w):
    """Force (2,) and moment about (0, 0) of friction 0.6 on loads at points that slip with v + w x r."""
    slip = np.asarray(v) + w * np.column_stack([-points[:, 1], points[:, 0]])
    force = -FRICTION * load[:, None] * slip / np.linalg.norm(slip, axis=1)[:, None]
    return force.sum(axis=0), (points[:, 0] * force[:, 1] - points[:, 1] * force[:, 0]).sum()


FACES = {
    "square": np.array([(-0.1, -0.1), (0.1, -0.1), (0.1, 0.1), (-0.1, 0.1)]),
    "rectangle": np.array([(-0.15, -0.1), (0.15, -0.1), (0.15, 0.1), (-0.15, 0.1)]),
    "triangle": np.array([(-0.1, -0.05), (0.2, -0.08), (-0.05, 0.15)]),
    "plank": np.array([(-0.3, -0.002), (0.3, -0.002), (0.3, 0.002), (-0.3, 0.002)]),
}
CENTRES = {
    "O": (1e-9, 2e-9),
    "inside": (0.03, -0.04),
    "outside": (-0.3, 0.1),
    "far": (1.0, 0.8),
    "farther": (9.0, -4.0),
}


def standing(corners, tilt=(0.0, 0.0), depth=DEEP):
    """A prism on the floor, its foot the polygon; its penetration is ``depth`` at (0, 0), with the slopes ``tilt``."""
    shape = prism([tuple(corner) for corner in corners], 0.1)
    pair = Pair(FLOOR, shape, friction=FRICTION)
    x, y = np.asarray(corners[0]) - shape.vertices[0, :2]  # centroid of the foot
    pair.place(1, (x, y, 0.15 - depth - tilt[0] * x - tilt[1] * y), turned(((0, 1, 0), tilt[0]), ((1, 0, 0), -tilt[1])))
    return pair


def turning_about(c):
    """Velocity of the origin and spin of a rotation about c, at about 1 m/s."""
    w = FAST / (0.1 + np.linalg.norm(c))
    return w * np.array([c[1], -c[0]]), w


@pytest.mark.parametrize("centre", CENTRES)
@pytest.mark.parametrize("name", FACES)
def test_a_flat_contact_follows_its_surface(name, centre):
    """Force and moment of a foot that rotates about C are those of Coulomb friction under uniform pressure."""
    c = CENTRES[centre]
    pair = standing(FACES[name])
    normal = pair.touch()[2]
    points, load = spread_evenly(FACES[name])
    assert normal == pytest.approx(K_N * DEEP * load.sum(), rel=1e-5)
    v, w = turning_about(c)
    force, moment = rubbed(pair, (*v, 0.0), (0.0, 0.0, w), (0.0, 0.0, 0.1))
    expected, about = friction_of(points, load * normal / load.sum(), v, w)
    near = 2e-4 if name == "plank" else 1e-5  # the Gauss rule is less accurate with C on something so slender
    np.testing.assert_allclose(force[:2], expected, atol=near * FRICTION * normal)
    assert moment[2] == pytest.approx(about, abs=near * FRICTION * normal * 0.1)


def pressed_part(corners, depth, tilt):
    """Corners of the part of a convex foot with positive penetration."""
    g = depth + corners @ tilt
    found = []
    for p, q, a, b in zip(np.roll(corners, 1, axis=0), corners, np.roll(g, 1), g, strict=True):
        if (a > 0.0) != (b > 0.0):
            found.append(p + a / (a - b) * (q - p))
        if b > 0.0:
            found.append(q)
    return np.array(found)


@pytest.mark.parametrize("centre", CENTRES)
@pytest.mark.parametrize("name", ["rectangle", "triangle"])
def test_friction_follows_the_linear_pressure(name, centre):
    """A foot that is tilted, and half open: the pressure is kn times the penetration of each point."""
    tilt = 3.0 * DEEP * np.array([4.0, -3.0])
    pair = standing(FACES[name], tilt)
    normal = pair.touch()[2]
    points, weight = spread_evenly(pressed_part(FACES[name], DEEP, tilt))
    load = K_N * weight * (DEEP + points @ tilt)
    assert normal == pytest.approx(load.sum(), rel=1e-5)
    v, w = turning_about(CENTRES[centre])
    force, moment = rubbed(pair, (*v, 0.0), (0.0, 0.0, w), (0.0, 0.0, 0.1))
    expected, about = friction_of(points, load, v, w)
    np.testing.assert_allclose(force[:2], expected, atol=1e-5 * FRICTION * normal)
    assert moment[2] == pytest.approx(about, abs=1e-5 * FRICTION * normal * 0.1)


def test_pure_torsion_of_an_l():
    """Two contacts of one foot, an L, rotate about one point: that of least mean distance, where the force vanishes."""
    legs = [
        np.array([(0.0, 0.0), (0.3, 0.0), (0.3, 0.1), (0.0, 0.1)]),
        np.array([(0.0, 0.1), (0.1, 0.1), (0.1, 0.25), (0.0, 0.25)]),
    ]
    points, weight = (np.concatenate(part) for part in zip(*(spread_evenly(leg, 200) for leg in legs), strict=True))
    load = K_N * DEEP * weight

    def mean_distance(c):
        return (weight * np.linalg.norm(points - c, axis=1)).sum() / weight.sum()

    c = minimize(mean_distance, [0.1, 0.1], method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-14}).x
    middle = weight @ points / weight.sum()
    assert 1.001 * mean_distance(c) < mean_distance(middle)
    v, w = turning_about(c)
    force, moment = np.zeros(3), np.zeros(3)
    for leg in legs:
        one = rubbed(standing(leg), (*v, 0.0), (0.0, 0.0, w), (0.0, 0.0, 0.1))
        force, moment = force + one[0], moment + one[1]
    strength = FRICTION * load.sum()
    np.testing.assert_allclose(force[:2], 0.0, atol=1e-4 * strength)
    assert moment[2] == pytest.approx(-strength * mean_distance(c), rel=1e-5)


@pytest.mark.parametrize("depth", [1e-8, 1e-6])
@pytest.mark.parametrize(
    "c", [(0.0, 1e-9), (0.0, 0.03), (0.05, 0.0), (0.05, 0.02), (0.12, 0.0), (-0.2, 0.3), (4.0, 3.0)]
)
def test_an_edge_rubs_as_a_line(c, depth):
    """A block on an edge of L = 0.2 m along y: about a point at (h, s) from its middle the friction under a uniform
    load is

        V_x = mu q [r],  V_y = mu q h [asinh(s/|h|)],  M = mu q [s r + h^2 asinh(s/|h|)]/2

    between its ends; M = mu N L/4 about the middle.
    """
    turn, long = 0.7, 0.2
    down = 0.15 * math.sin(turn) + 0.05 * math.cos(turn)
    pair = Pair(FLOOR, BLOCK, friction=FRICTION)
    pair.place(1, (0.0, 0.0, 0.1 + down - depth), turned(((0, 1, 0), turn)))
    edge = min((x * math.cos(turn) + z * math.sin(turn) for x in (-0.15, 0.15) for z in (-0.05, 0.05)
                if abs(z * math.cos(turn) - x * math.sin(turn) + down) < 1e-9), default=None)  # fmt: skip
    normal = pair.touch()[2]
    h, s = c
    _, w = turning_about(c)
    force, moment = rubbed(pair, (0.0, 0.0, 0.0), (0.0, 0.0, w), (edge - h, s, 0.1))
    ends = np.array([-0.5 * long - s, 0.5 * long - s])
    r = np.hypot(ends, h)
    ash = np.arcsinh(ends / abs(h)) if h else np.zeros(2)
    q = FRICTION * normal / long
    expected = q * np.array([np.diff(r)[0], -h * np.diff(ash)[0], -0.5 * np.diff(ends * r + h * h * ash)[0]])
    found = np.array([force[0], force[1], moment[2]])
    np.testing.assert_allclose(found, expected, atol=1e-4 * FRICTION * normal * (1.0 + np.hypot(h, s)))
    if c == (0.0, 1e-9):
        assert -found[2] == pytest.approx(FRICTION * normal * long / 4.0, rel=1e-4)


@pytest.mark.parametrize("name", SETTINGS)
def test_what_presses_rubs(name):
    """Whatever parts touch, friction follows from the part of the pressure along the mean normal."""
    pair = set_up(name, friction=FRICTION)
    pair.contact.k_s[:] = 1e20  # at any penetration it slips after 1e-12 m
    pair.contact.scratch.start[:] = -1
    force = pair.touch()[:3]
    normal = np.linalg.norm(force)
    n = force / normal  # the frame of the first block is that of the world
    t = np.cross(n, [1.0, 0.0, 0.0] if abs(n[0]) < 0.8 else [0.0, 1.0, 0.0])
    axes = np.array([t / np.linalg.norm(t), np.cross(n, t / np.linalg.norm(t))])
    place, load = patch_points(pair.contact.scratch, n)
    load *= normal / load.sum()
    # relative to the centre of pressure
    points = (place - load @ place / normal) @ axes.T
    centre = pair.contact.point[0]
    size = np.sqrt((load * (points**2).sum(axis=1)).sum() / normal)
    for c in size * np.array([(0.3, 0.2), (2.0, -1.0), (-20.0, 30.0)]):
        w = 0.1 / max(1.0, np.linalg.norm(c) / size)
        v = w * np.array([c[1], -c[0]])
        pair.contact.elastic[:] = 0.0
        resting = pair.touch()  # without friction: no memory and no motion
        force, moment = rubbed(pair, v @ axes, w * n, centre)
        arm = pair.bodies.position[1] - centre
        rubbing = force - resting[:3]
        twisting = (moment - resting[3:] - np.cross(arm, resting[:3])) @ n
        expected, about = friction_of(points, load, v, w)
        np.testing.assert_allclose(axes @ rubbing, expected, atol=3e-4 * FRICTION * normal)
        assert twisting == pytest.approx(about, abs=3e-4 * FRICTION * normal * size)
        pair.bodies.velocity[:], pair.bodies.spin[:] = 0.0, 0.0


def patch_points(scratch, normal):
    """Points (k, 3) of the patches of the last contact and the pressure along ``normal`` on them (k,)."""
    count = np.count_nonzero(scratch.start >= 0) - 1
    points, loads = [], []
    for p in range(count):
        own = slice(scratch.start[p], scratch.start[p + 1])
        flat, weight = spread_evenly(np.column_stack([scratch.x[own], scratch.y[own]]), 200)
        g, frame = scratch.depth[p], scratch.frame[p]
        points.append(flat @ frame[:2, :3] + frame[:, 3])
        loads.append(weight * (g[0] + flat @ g[1:3]) * max(0.0, frame[2, :3] @ normal))
    return np.concatenate(points), np.concatenate(loads)


FEET = {"square": (0.0, 0.0), "rectangle": (1e-7, 2e-7), "triangle": (0.0, 0.0), "plank": (0.0, 0.0)}  # and tilts


@pytest.mark.parametrize("name", [*SETTINGS, *FEET])
def test_the_bound_within_which_nothing_is_worked_out(name):
    """|V|/V_0 + |M|/(V_0 r) <= 1 lies inside the surface: r is at most the least mean distance from any point, within
    40 % of it on a line and at least a quarter of it anywhere."""
    pair = set_up(name) if name in SETTINGS else standing(FACES[name], FEET[name])
    pair.touch()
    pressed = pair.contact.pressed
    bound, reach = pressed.radius[0], pressed.reach[0]
    least = minimize(
        lambda c: pressed_surface(pressed, 0, c[1] * reach, -c[0] * reach, 1.0)[0] / reach, [0.01, 0.02],
        method="Nelder-Mead", options={"xatol": 1e-6, "fatol": 1e-10},
    )  # fmt: skip
    assert reach * least.fun / 4.0 < bound < reach * least.fun
    if name == "plank":
        assert bound == pytest.approx((math.sqrt(4.0 / 3.0) - 1.0) * 0.6, rel=5e-3)
