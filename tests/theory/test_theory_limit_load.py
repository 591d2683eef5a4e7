"""The inverse problem (limit load by theory): laboratory numbers, brute force, certificates, kinks, dead loads."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import optimize

from dembrick.errors import ScenarioError
from dembrick.theory import convex, formulation_law, gauge, limit_load, limit_loads, points, torsion_strength
from dembrick.theory.formulations import pressure_plane, rectangle_formulation, spring_forces
from dembrick.theory.limit_load import _kinks, _minimise, _Problem
from dembrick.theory.overturning import closed_until
from dembrick.theory.polygons import centroid, convex_hull, distance_to_exit, rectangle
from helpers import paper_equations as equations

A, B, FRICTION, NORMAL = 0.3, 0.2, 0.64, 467.0
LAB = {name: formulation_law(name, A, B, FRICTION, NORMAL) for name in ("concave", "corrected", "convex")}
L_SHAPE = np.array([[0, 0], [0.3, 0], [0.3, 0.1], [0.1, 0.1], [0.1, 0.25], [0, 0.25]])


@pytest.mark.parametrize(
    ("name", "load", "V"),
    [
        ("convex", (0, 0, 0.9 * A), 107.165760),
        ("convex", (0, 0, 0.5 * A), 192.898367),
        ("convex", (0, 1, 0.25 * A), 216.054938),
        ("convex", (0, 1, 0.45 * A), 161.902542),
        ("concave", (0, 0, 0.9 * A), 199.560586),
        ("concave", (0, 0, 0.5 * A), 359.209055),
        ("concave", (0, 1, 0.25 * A), 254.569822),
        ("concave", (0, 1, 0.45 * A), 212.249302),
        ("corrected", (0, 0, 0.9 * A), 107.165760),
        ("corrected", (0, 0, 0.5 * A), 192.898367),
        ("corrected", (0, 1, 0.25 * A), 209.337902),
        ("corrected", (0, 1, 0.45 * A), 154.825155),
    ],
)
def test_lab_sets(name, load, V):
    assert limit_load(LAB[name], load).V == pytest.approx(V, abs=6e-7)


def test_printed_table_3_within_its_rounding():
    # the paper prints whole newtons; with the inferred friction all eight agree within 0.6 N
    printed = {"convex": (107, 193, 216, 162), "concave": (200, 359, 254, 212)}
    loads = [(0, 0, 0.9 * A), (0, 0, 0.5 * A), (0, 1, 0.25 * A), (0, 1, 0.45 * A)]
    for name, values in printed.items():
        np.testing.assert_allclose(limit_loads(LAB[name], loads).V, values, rtol=0, atol=0.6)


@pytest.mark.parametrize(("name", "V"), [("concave", 284.1072), ("convex", 260.3445), ("corrected", 257.4170)])
def test_force_along_x_with_its_sign(name, V):
    found = limit_load(LAB[name], (1.0, 0.0, -0.05))
    assert found.V == pytest.approx(V, abs=5.1e-5)
    assert limit_load(LAB[name], (1.0, 0.0, 0.05)).V == pytest.approx(found.V, rel=1e-12)
    # the block rotates clockwise about a centre below the force
    assert found.twist[2] < 0.0
    assert found.torsion_centre[1] < 0.0


@pytest.mark.parametrize(("dead", "V"), [(60.0, 178.17), (-60.0, 252.18)])
def test_tangential_dead_load(dead, V):
    found = limit_load(LAB["convex"], (0, 1, 0.25 * A), (0.0, dead, 0.0))
    assert found.V == pytest.approx(V, abs=5e-3)
    # the sum of dead and driven load is on the surface
    total = found.V * np.array([0, 1, 0.25 * A]) + (0.0, dead, 0.0)
    assert gauge(LAB["convex"], total) == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(LAB["convex"].gradient(found.twist), total, atol=1e-6 * NORMAL)


def test_dead_load_beyond_the_limit_is_refused():
    with pytest.raises(ScenarioError, match="times what the joint can carry"):
        limit_load(LAB["convex"], (0, 1, 0), (300.0, 0.0, 0.0))


def test_pure_shear_has_no_centre_and_a_couple_turns_about_o():
    for law in LAB.values():
        shear = limit_load(law, (0.6, -0.8, 0.0))
        assert shear.V == pytest.approx(FRICTION * NORMAL, rel=1e-13)
        assert shear.torsion_centre is None
        couple = limit_load(law, (0.0, 0.0, -2.0))
        assert couple.torsion_centre == pytest.approx((0.0, 0.0), abs=1e-9)
        assert couple.twist[2] == pytest.approx(-0.5)


@given(
    st.floats(0.1, 10.0),
    st.floats(-3.0, 0.5),
    st.floats(0.0, 6.0),
    st.floats(0.05, 2.0),
    st.floats(0.0, 6.3),
    st.floats(-2.0, 2.0),
    st.sampled_from(["convex", "concave", "corrected"]),
)
@settings(max_examples=60, deadline=None)
def test_any_joint_the_bound_is_tight_and_scales(ratio, size, force, friction, angle, eccentricity, name):
    b = 10.0**size
    a, N = ratio * b, 10.0**force
    f = np.array([np.cos(angle), np.sin(angle), eccentricity * a])
    law = formulation_law(name, a, b, friction, N)
    found = limit_load(law, f)
    q = np.array(found.twist)
    assert q @ f == pytest.approx(1.0, rel=1e-12)
    assert law.dissipation(q) == pytest.approx(found.V, rel=1e-11)
    # lower bound: the force at that twist plus the strength of a point at the centre equals the load
    rest = found.V * f - law.gradient(q)
    if name == "convex":
        assert np.linalg.norm(rest / [1, 1, law.radius]) < 1e-6 * law.strength
    else:
        u = np.hypot(q[0] - q[2] * law.arms[:, 1], q[1] + q[2] * law.arms[:, 0])
        stuck = u < 1e-10 * np.linalg.norm(q * [1, 1, law.radius])
        if stuck.any():
            others = points(law.arms[~stuck], law.strengths[~stuck], 1.0)
            rest = found.V * f - others.gradient(q)
            assert np.hypot(*rest[:2]) <= law.strengths[stuck].sum() * (1 + 1e-9)
        elif u.min() > 1e-4 * u.max():
            assert np.linalg.norm(rest / [1, 1, law.radius]) < 1e-6 * law.strength
    unit = formulation_law(name, ratio, 1.0, 1.0, 1.0)
    scaled = limit_load(unit, (f[0], f[1], f[2] / b)).V * friction * N
    assert found.V == pytest.approx(scaled, rel=1e-11)


@pytest.mark.parametrize("name", ["convex", "concave", "L"])
def test_against_brute_force_minimisation(name):
    law = convex(L_SHAPE - centroid([L_SHAPE]), 0.5, 100.0) if name == "L" else LAB[name]
    rng = np.random.default_rng(11)
    for f in rng.normal(size=(6, 3)) * [1, 1, 0.15]:

        def ratio(x, f=f):
            q = np.array([np.cos(x[0]) * np.cos(x[1]), np.sin(x[0]) * np.cos(x[1]), np.sin(x[1]) / 0.2])
            power = f @ q
            return law.dissipation(q) / power if power > 0 else 1e9

        best = min(
            optimize.minimize(ratio, start, method="Nelder-Mead", options={"xatol": 1e-10, "fatol": 1e-11}).fun
            for start in ((np.arctan2(f[1], f[0]), s * np.sign(f[2])) for s in (0.3, 1.2))
        )
        found = limit_load(law, f).V
        assert found <= best * (1 + 1e-12)
        assert found == pytest.approx(best, rel=1e-8)


def test_kinks_random_points_cannot_be_bettered():
    rng = np.random.default_rng(4)
    kinks = 0
    for _ in range(40):
        n = int(rng.integers(2, 9))
        arms, forces = rng.normal(size=(n, 2)), 10.0 ** rng.uniform(-3, 0, n)
        law, f = points(arms, forces, 1.0), rng.normal(size=(5, 3))
        found = limit_loads(law, f)
        distance = np.hypot(*(found.torsion_centre[:, None] - arms).T)
        kinks += np.count_nonzero(distance.min(axis=0) < 1e-9)
        for load, V, q in zip(f, found.V, found.twist, strict=True):
            for reach in 10.0 ** -np.arange(0.0, 12.0):
                near = q + reach * np.linalg.norm(q) * rng.normal(size=(40, 3))
                power = near @ load
                bounds = law.dissipation(near[power > 0]) / power[power > 0]
                assert np.all(bounds >= V * (1 - 1e-11))
    assert kinks > 30  # the case occurs often enough to be tested


@pytest.mark.parametrize("share", [0.5, 0.999, 1.005, 1.5])
def test_a_point_holds_the_centre_just_as_long_as_it_can_bear_it(share):
    arms = np.array([[1.0, 0.5], [-1.0, 0.6], [-0.9, -0.5], [1.1, -0.4]])
    law = points(arms, [1.0, 2.0, 1.5, 0.5], 1.0)
    x, y = arms[0]
    q = np.array([y, -x, 1.0])
    t = share * np.array([0.6, -0.8])  # of the strength of 1 N of point 0
    f = points(arms[1:], [2.0, 1.5, 0.5], 1.0).gradient(q) + (t[0], t[1], x * t[1] - y * t[0])
    found = limit_load(law, f)
    distance = np.hypot(found.torsion_centre[0] - x, found.torsion_centre[1] - y)
    problem = _Problem(law, f[None] * [1, 1, 1 / law.radius] / np.linalg.norm(f / [1, 1, law.radius]), np.zeros((1, 3)))
    smoothed, _ = _minimise(problem, np.zeros((1, 2)), np.arange(1), 1e-3)
    certified = _kinks(problem, law, smoothed, np.arange(1))[2]
    if share < 1.0:
        assert found.V == pytest.approx(1.0, rel=1e-14)
        assert distance < 1e-14
        assert certified.all()
    else:
        assert found.V < 1.0
        assert distance > 1e-4
        assert not certified.any()
        np.testing.assert_allclose(found.V * f, law.gradient(found.twist), atol=1e-7)


def test_centre_on_a_point_by_hand():
    # two collinear points: a force beyond one of them rotates the joint about the other
    law = points([[-1.0, 0.0], [1.0, 0.0]], [1.0, 1.0], 0.5)
    found = limit_load(law, (0.0, 1.0, 3.0))
    assert found.V == pytest.approx(2 * 0.5 / 4.0, rel=1e-14)  # lever 2 against 3 + 1 about the left point
    assert found.torsion_centre == pytest.approx((-1.0, 0.0), abs=1e-14)


@pytest.mark.parametrize("polygon", [L_SHAPE, np.array([[0.0, 0.0], [0.4, 0.05], [0.1, 0.3]])])
def test_polygons_without_central_symmetry_turn_about_their_geometric_median(polygon):
    polygon = polygon - centroid([polygon])
    law = convex(polygon, 1.0, 1.0)

    def mean_distance(C):
        total = area = 0.0
        t, w = np.polynomial.legendre.leggauss(100)
        for p, q in zip(polygon - C, np.roll(polygon, -1, axis=0) - C, strict=True):
            cross = p[0] * q[1] - p[1] * q[0]
            s = (t[:, None] + 1) / 2
            total += cross / 3 * np.sum(w / 2 * np.hypot(*(p + s * (q - p)).T))
            area += cross / 2
        return total / area

    best = optimize.minimize(mean_distance, (0.0, 0.0), method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-14})
    found = limit_load(law, (0.0, 0.0, 1.0))
    assert found.V == pytest.approx(best.fun, rel=1e-9)
    assert found.torsion_centre == pytest.approx(tuple(best.x), abs=1e-6)
    assert torsion_strength(law) == found.V
    assert 2e-4 < 1.0 - found.V / mean_distance(np.zeros(2)) < 0.013


def test_a_couple_gives_the_paper_torsion_strengths():
    for a, b in ((0.3, 0.2), (1.0, 0.1)):
        pairs = {
            "convex": equations.torsion_strength_convex,
            "concave": equations.torsion_strength_concave,
            "corrected": equations.torsion_strength_corrected,
        }
        for name, strength in pairs.items():
            law = formulation_law(name, a, b, 0.7, 1000.0)
            assert torsion_strength(law) == pytest.approx(strength(a, b, 700.0), rel=1e-12)


def test_many_loads_are_the_single_ones():
    angle = np.linspace(0.0, 2.0 * np.pi, 25)
    loads = np.stack([np.cos(angle), np.sin(angle), 0.1 * np.sin(3 * angle)], axis=1)
    for law in (*LAB.values(), formulation_law("distributed", A, B, FRICTION, NORMAL, cells=(5, 4))):
        many = limit_loads(law, loads)
        single = [limit_load(law, load) for load in loads]
        np.testing.assert_allclose(many.V, [one.V for one in single], rtol=1e-12)


def test_no_friction_no_load():
    law = convex(rectangle(A, B), 0.0, NORMAL)
    assert limit_load(law, (0, 1, 0.1)).V == 0.0
    with pytest.raises(ScenarioError, match="no friction"):
        limit_load(law, (0, 1, 0.1), (1.0, 0.0, 0.0))
    with pytest.raises(ScenarioError, match="load of zero"):
        limit_load(LAB["convex"], (0, 0, 0))
    with pytest.raises(ScenarioError, match="finite components"):
        limit_load(LAB["convex"], (0, np.nan, 0))


@pytest.mark.parametrize("name", ["concave", "distributed", "convex"])
def test_a_joint_is_closed_as_far_as_a_linear_pressure_presses_all_of_it(name):
    """Up to that load the limit is concave in the load, and its first crossing needs no search."""
    joint = rectangle_formulation(name, 0.3, 0.2, 0.64, pressure="linear" if name == "convex" else "full", cells=(6, 4))
    lever, start = np.array([0.02, 0.05]), np.array([0.01, -0.005])
    V = closed_until(joint, 467.0, start, lever)
    for share, closed in ((0.999, True), (1.001, False)):
        centre = start + share * V / 467.0 * lever
        if joint.parts is None:
            pressed = spring_forces(joint.normal_arms, joint.areas, 467.0, centre)
        else:
            level, slope = pressure_plane(joint.parts, 467.0, centre)
            pressed = np.maximum(level + (joint.parts[0] - centre) @ slope, 0.0)
        assert bool((pressed > 0.0).all()) == closed
    assert closed_until(joint, 467.0, np.array([0.14, 0.09]), lever) == 0.0


def test_corners_that_differ_by_rounding_are_one():
    """Parts of a cut block have such corners: an edge of 1e-17 m points anywhere, and once made a block tip over."""
    square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, -1.0 + 2e-16], [1.0, 1.0], [-1.0 + 1e-16, 1.0], [-1.0, 1.0]])
    hull = convex_hull(square)
    for way, times in (((1.0, 0.0), 1.0), ((0.0, -2.0), 0.5), ((-1.0, 1.0), 1.0)):
        assert distance_to_exit(hull, (0.0, 0.0), way) == pytest.approx(times, rel=1e-12)
    assert distance_to_exit(hull, (1.0, 0.0), (0.0, 1.0)) == pytest.approx(1.0)
    assert distance_to_exit(hull, (1.1, 0.0), (0.0, 1.0)) == -1.0
