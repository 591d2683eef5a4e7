"""The laws at a joint: Coulomb return, no-tension integral, exact limit surface, its gauge and its proximal map."""

import math

import numpy as np
import pytest
from scipy.integrate import dblquad
from scipy.optimize import minimize

from dembrick import theory
from dembrick.geometry import friction_integrals, polygons
from dembrick.kernels.joint import limit_surface, no_tension, point_law
from dembrick.kernels.math.geometric_median import median_distance
from dembrick.kernels.statics import point_joints
from dembrick.kernels.statics.point_joints import Points
from helpers.compiled import forms, matrix
from helpers.random_polygons import slender_polygon as random_polygon
from helpers.random_polygons import slenderness

A, B = 0.3, 0.2
RECTANGLE = np.array([[-A, -B], [A, -B], [A, B], [-A, B]]) / 2


def surface_arguments(polygon, reach_factor=1.0):
    """What the kernels of the limit surface want of a polygon."""
    x, y = np.ascontiguousarray(polygon[:, 0]), np.ascontiguousarray(polygon[:, 1])
    reach = reach_factor * float(np.hypot(x, y).max())
    return x, y, 0, len(x), polygons.area(polygon), reach, friction_integrals.far_moments(polygon), None, 0


def about(c1, c2, w=1.0):
    """Slip twist that turns about C = (c1, c2)."""
    return c2 * w, -c1 * w, w


# --- Coulomb friction at a point


@pytest.mark.parametrize("coulomb", forms(point_law.coulomb))
def test_coulomb_against_a_naive_return(coulomb):
    rng = np.random.default_rng(1)
    plastic_seen = 0
    for _ in range(2000):
        k, viscous, cap = 10 ** rng.uniform(3, 9), rng.choice([0.0, 0.5, 2.0]), 10 ** rng.uniform(-2, 4)
        before = cap * rng.normal(size=2) * 0.5
        slip = cap / k * rng.normal(size=2) * 10 ** rng.uniform(-2, 2)
        t1, t2, e1, e2, plastic = coulomb(*before, *slip, k, 1.0 + viscous, 1.0 / (1.0 + viscous), cap)
        force, after = np.array([t1, t2]), np.array([e1, e2])
        trial = before + k * (1 + viscous) * slip
        size = np.linalg.norm(trial)
        expected = trial * min(1.0, cap / size)
        np.testing.assert_allclose(force, expected, rtol=1e-13, atol=1e-13 * cap)
        # spring and dashpot in parallel, both behind the slider
        np.testing.assert_allclose(force, after + viscous * (after - before), rtol=1e-11, atol=1e-10 * size)
        assert plastic == pytest.approx(max(0.0, size - cap) / (k * (1 + viscous)), rel=1e-12, abs=1e-13 * size / k)
        assert (plastic > 0.0) == (size > cap)
        plastic_seen += plastic > 0
        # the slip that is no elastic deformation is along the force: friction takes cap times its length
        lost = force @ (slip - (after - before) / k)
        assert lost == pytest.approx(cap * plastic, rel=1e-9, abs=1e-12 * cap * size / k)
        assert lost >= -1e-12 * cap * size / k
        # and the elastic force, which is less with a dashpot beside it, takes its mean times that
        spent = point_law.shear_loss(*before, *after, *slip, k)
        mean = 0.5 * (before + after) @ (slip - (after - before) / k)
        assert spent == pytest.approx(mean, rel=1e-9, abs=1e-12 * cap * size / k)
    assert 300 < plastic_seen < 1700


def test_coulomb_takes_work_on_every_closed_path():
    rng = np.random.default_rng(2)
    k, cap = 1e6, 10.0
    for _ in range(50):
        path = rng.normal(size=(40, 2)) * 3 * cap / k
        path[-1] = -path[:-1].sum(axis=0)
        e, work = np.zeros(2), 0.0
        for slip in path:
            t1, t2, e1, e2, _ = point_law.coulomb(e[0], e[1], slip[0], slip[1], k, 1.5, 1.0 / 1.5, cap)
            work += t1 * slip[0] + t2 * slip[1]
            e = np.array([e1, e2])
            assert math.hypot(t1, t2) <= cap * (1 + 1e-14)
        assert work >= 0.5 * (e @ e) / k


def test_coulomb_without_friction_or_without_motion():
    for coulomb in forms(point_law.coulomb):
        assert coulomb(0.0, 0.0, 0.0, 0.0, 1e6, 1.5, 1.0 / 1.5, 0.0) == (0.0,) * 5
        t1, t2, e1, e2, plastic = coulomb(0.0, 0.0, 3e-6, 4e-6, 1e6, 1.0, 1.0, 0.0)
        assert (t1, t2) == (0.0, 0.0) and plastic == pytest.approx(5e-6, rel=1e-14)
        assert abs(e1) + abs(e2) < 1e-14
        assert coulomb(3.0, 4.0, 0.0, 0.0, 1e6, 1.0, 1.0, 6.0) == (3.0, 4.0, 3.0, 4.0, 0.0)


@pytest.mark.parametrize("point_forces", forms(point_joints.forces))
def test_point_resultants_are_work_conjugate(point_forces):
    """What the resultants do on the joint's twist is what the points' forces do on their own slips and openings."""
    rng = np.random.default_rng(3)
    n = 5
    for _ in range(100):
        arms, shear_arms = rng.normal(size=(2, n, 2))
        points = Points(
            joint=np.zeros(1, np.int64),
            start=np.array([0, n]),
            friction=np.array([0.6]),
            x_n=arms[:, 0].copy(),
            y_n=arms[:, 1].copy(),
            x_s=shear_arms[:, 0].copy(),
            y_s=shear_arms[:, 1].copy(),
            k_n=rng.uniform(1, 2, n),
            k_s=rng.uniform(1, 2, n),
            normal=np.full(n, np.inf),
            elastic_1=np.zeros(n),
            elastic_2=np.zeros(n),
            slip=np.zeros(n),
        )
        dn, r1, r2, pn, pr1, pr2, p1, p2, pr = rng.normal(size=9)
        dn = -abs(dn)
        motion = (dn, r1, r2, pn, pr1, pr2, p1, p2, pr)
        normal, v1, v2, mt, m1, m2, slip = point_forces(points, 0, None, *motion, 0.0, 0.0, None)
        opening = dn + r1 * points.y_n - r2 * points.x_n
        np.testing.assert_allclose(points.normal, points.k_n * np.maximum(-opening, 0.0), rtol=1e-13)
        forces = np.column_stack([points.elastic_1, points.elastic_2])
        slips = np.column_stack([p1 - pr * points.y_s, p2 + pr * points.x_s])
        assert np.all(np.linalg.norm(forces, axis=1) <= 0.6 * points.normal * (1 + 1e-13) + 1e-14)
        assert v1 * p1 + v2 * p2 + mt * pr == pytest.approx((forces * slips).sum(), rel=1e-11, abs=1e-12)
        rate = pn + pr1 * points.y_n - pr2 * points.x_n
        assert normal * pn - m1 * pr1 - m2 * pr2 == pytest.approx(points.normal @ rate, rel=1e-11, abs=1e-12)
        assert slip == pytest.approx(points.k_s @ points.slip / points.k_s.sum(), rel=1e-13)
        lost = point_joints.dissipation(points, 0, points.normal, 0.0, p1, p2, pr)
        assert lost == pytest.approx(0.6 * points.normal @ np.linalg.norm(slips, axis=1), rel=1e-13)
        assert lost >= v1 * p1 + v2 * p2 + mt * pr - 1e-12


# --- the no-tension integral


def positive_part(polygon, g):
    """The polygon clipped at g = 0, g a function of a point."""
    kept = []
    for p, q in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        gp, gq = g(p), g(q)
        if gp >= 0:
            kept.append(p)
        if gp * gq < 0:
            kept.append(p + gp / (gp - gq) * (q - p))
    return kept


def integrals_by_clipping(polygon, plane):
    """Integrals of <g>+ (1, x, y): triangles of the clipped polygon, edge-midpoint rule (exact to second degree)."""
    g = lambda p: plane[0] + plane[1] * p[0] + plane[2] * p[1]  # noqa: E731
    kept, total = positive_part(polygon, g), np.zeros(3)
    for p, q in zip(kept[1:-1], kept[2:], strict=True):
        double = (p[0] - kept[0][0]) * (q[1] - kept[0][1]) - (p[1] - kept[0][1]) * (q[0] - kept[0][0])
        for middle in ((kept[0] + p) / 2, (p + q) / 2, (q + kept[0]) / 2):
            total += double / 6 * g(middle) * np.array([1.0, *middle])
    return total


def open_part(x, y, g0, gx, gy):
    """`no_tension` of a whole polygon."""
    return no_tension.no_tension(x, y, 0, len(x), (g0 + gx * x + gy * y).min(), g0, gx, gy)


@pytest.mark.parametrize("integral", forms(no_tension.no_tension))
def test_no_tension_integral_against_clipping(integral):
    rng = np.random.default_rng(4)
    open_, partly = 0, 0
    for _ in range(1000):
        polygon = random_polygon(rng, 10 ** rng.uniform(-3, 1))
        reach = np.hypot(*polygon.T).max()
        gradient = rng.normal(size=2) * 10 ** rng.uniform(-3, 3)
        plane = np.array([np.linalg.norm(gradient) * reach * rng.uniform(-1.1, 1.2), *gradient])
        level = plane[0] + polygon @ gradient
        got = integral(*polygon.T.copy(), 0, len(polygon), level.min(), *plane)
        if level.max() <= 0.0:
            open_ += 1
            assert got == (0.0, 0.0, 0.0)
            continue
        partly += 1
        expected = integrals_by_clipping(polygon, plane)
        scale = polygons.area(polygon) * np.linalg.norm(gradient) * reach * np.array([1.0, reach, reach])
        np.testing.assert_allclose(got / scale, expected / scale, rtol=1e-9, atol=1e-14)
    assert open_ > 20 and partly > 500


def test_no_tension_integral_against_quadrature_and_on_a_vertex():
    x, y = RECTANGLE.T.copy()
    plane = (0.01, 0.3, -0.2)
    n = 1000
    xs, ys = (np.arange(n) + 0.5) / n * A - A / 2, (np.arange(n) + 0.5) / n * B - B / 2
    X, Y = np.meshgrid(xs, ys)
    g = np.maximum(plane[0] + plane[1] * X + plane[2] * Y, 0.0) * A * B / n**2
    got = open_part(x, y, *plane)
    np.testing.assert_allclose(got, [g.sum(), (g * X).sum(), (g * Y).sum()], rtol=1e-5)
    # the line of zero penetration through two corners: half the rectangle
    gx, gy = 1.0 / A, -1.0 / B
    got = open_part(x, y, 0.0, gx, gy)
    np.testing.assert_allclose(got, [A * B / 6, A * A * B / 24, -A * B * B / 24], rtol=1e-14)
    # along an edge
    got = open_part(x, y, -0.5, 1.0 / A, 0.0)
    np.testing.assert_allclose(got, 0.0, atol=1e-17)
    assert open_part(x, y, -0.1, 0.0, 0.0) == (0.0, 0.0, 0.0)


def test_a_touching_edge_may_be_negative_by_rounding():
    """Corners at zero penetration, whose sign depends on how a product and a sum were rounded, move no force."""
    x, y = np.array([1.0, 2.0, 2.0, 1.0]), np.array([0.0, 0.0, 1.0, 1.0])
    for least in (0.0, -3e-17):
        found = no_tension.no_tension(x, y, 0, 4, least, -1.0 - 2e-16, 1.0, 1e-16)
        np.testing.assert_allclose(found, (0.5, 5.0 / 6.0, 0.25), rtol=1e-12)


def test_no_tension_meets_the_closed_joint():
    """Continuous where the last corner closes, and equal to area x level, second moments x slope there."""
    rng = np.random.default_rng(5)
    for _ in range(50):
        polygon = random_polygon(rng)
        gradient = rng.normal(size=2)
        level = -(polygon @ gradient).min()
        yy, xx, xy = polygons.second_moments(polygon)
        closed = [
            polygons.area(polygon) * level,
            xx * gradient[0] + xy * gradient[1],
            xy * gradient[0] + yy * gradient[1],
        ]
        got = open_part(*polygon.T.copy(), level * (1 - 1e-9), *gradient)
        np.testing.assert_allclose(got, closed, rtol=1e-7, atol=1e-8 * closed[0])


# --- the limit surface

CHECK_ROWS = [
    ((-0.15, -0.10), 0.0, 0.0, 0.09681061),
    ((-0.05, -0.03), 0.56711455, 0.47768715, 0.14475335),
    ((0.10, 0.05), 0.82382706, 0.51700952, 0.29930206),
    ((-0.03, 0.20), 0.3464389, 0.90287367, 0.33380836),
]


@pytest.mark.parametrize("surface", forms(limit_surface.surface))
@pytest.mark.parametrize("corner, v_y, v_x, m_c", CHECK_ROWS)
def test_surface_against_independent_numbers(surface, corner, v_y, v_x, m_c):
    c1, c2 = -A / 2 - corner[0], -B / 2 - corner[1]
    d, v1, v2, mt = surface(*surface_arguments(RECTANGLE), *about(c1, c2))[:4]
    assert abs(v2) == pytest.approx(v_y, rel=2e-7, abs=1e-15)
    assert abs(v1) == pytest.approx(v_x, rel=2e-7, abs=1e-15)
    assert mt - (c1 * v2 - c2 * v1) == pytest.approx(m_c, rel=2e-7)
    assert d == pytest.approx(m_c, rel=2e-7)


@pytest.mark.parametrize("centre", [(0.02, -0.03), (0.15, 0.1), (0.15, 0.02), (0.25, 0.1), (-0.4, 0.7), (9.0, -7.0)])
@pytest.mark.parametrize("w", [1.0, -2.5])
def test_surface_against_quadrature(centre, w):
    """Inside, on a vertex, on an edge, on the line of an edge, outside, and beyond the switch to the series."""
    c1, c2 = centre
    q = about(c1, c2, w)
    d, v1, v2, mt = limit_surface.surface(*surface_arguments(RECTANGLE), *q)[:4]

    def mean(f):
        xs = sorted({-A / 2, A / 2, min(max(c1, -A / 2), A / 2)})
        ys = sorted({-B / 2, B / 2, min(max(c2, -B / 2), B / 2)})
        return sum(
            dblquad(f, y0, y1, x0, x1, epsabs=1e-12, epsrel=1e-9)[0]
            for x0, x1 in zip(xs, xs[1:], strict=False)
            for y0, y1 in zip(ys, ys[1:], strict=False)
        ) / (A * B)

    def speed(x, y):
        return q[0] - w * y, q[1] + w * x, math.hypot(q[0] - w * y, q[1] + w * x)

    assert d == pytest.approx(mean(lambda x, y: speed(x, y)[2]), rel=1e-8)
    assert v1 == pytest.approx(mean(lambda x, y: speed(x, y)[0] / speed(x, y)[2]), rel=1e-7, abs=1e-8)
    assert v2 == pytest.approx(mean(lambda x, y: speed(x, y)[1] / speed(x, y)[2]), rel=1e-7, abs=1e-8)
    torque = mean(lambda x, y: (x * speed(x, y)[1] - y * speed(x, y)[0]) / speed(x, y)[2])
    assert mt == pytest.approx(torque, rel=1e-7, abs=1e-9)


@pytest.mark.parametrize("surface", forms(limit_surface.surface))
@pytest.mark.parametrize("lowest, highest", [(-2.0, 1.5), (2.0, 6.0)], ids=["near", "far"])
def test_surface_derivatives_against_differences(surface, lowest, highest):
    """Gradient from D, Hessian from the gradient; C at 10^lowest to 10^highest half diameters (the switch is at 60)."""
    rng = np.random.default_rng(6)
    for _ in range(100):
        size = 10 ** rng.uniform(-3, 1)
        polygon = random_polygon(rng, size)
        arguments = surface_arguments(polygon)
        reach = arguments[5]
        direction = rng.normal(size=2)
        direction /= np.linalg.norm(direction)
        distance = 10 ** rng.uniform(lowest, highest)
        # unit twist in (v1, v2, w reach)
        q = np.array([*direction * distance, rng.choice([-1.0, 1.0])]) / math.hypot(distance, 1.0)
        unscale = np.array([1.0, 1.0, 1.0 / reach])
        value = surface(*arguments, *(q * unscale))
        d, gradient, hessian = value[0], value[1:4] * unscale, matrix(*value[4:]) * np.outer(unscale, unscale)
        width = polygons.width(polygon) / reach
        h = 1e-4 * min(width, math.hypot(q[0], q[1]) if lowest > 0 else 1.0)
        for i in range(3):
            e = np.zeros(3)
            e[i] = h
            plus, minus = (surface(*arguments, *((q + s * e) * unscale)) for s in (1, -1))
            assert (plus[0] - minus[0]) / (2 * h) == pytest.approx(gradient[i], abs=2e-6)
            slope = (np.array(plus[1:4]) - minus[1:4]) * unscale / (2 * h)
            np.testing.assert_allclose(slope, hessian[i], atol=2e-4 * np.abs(hessian).max())
        # homogeneous of degree one
        assert gradient @ q == pytest.approx(d, rel=1e-10)
        np.testing.assert_allclose(hessian @ q, 0.0, atol=1e-9 * np.abs(hessian).max())
        assert np.linalg.eigvalsh(hessian).min() > -1e-9 * np.abs(hessian).max()


def test_series_meets_the_closed_form_at_the_switch():
    rng = np.random.default_rng(7)
    worst = 0.0
    for _ in range(300):
        polygon = random_polygon(rng)
        reach = np.hypot(*polygon.T).max()
        direction = rng.normal(size=2)
        v = direction / np.linalg.norm(direction) * limit_surface.FAR * reach
        q = (*v, rng.choice([-1.0, 1.0]))
        near = np.array(limit_surface.surface(*surface_arguments(polygon, 1.001), *q))
        far = np.array(limit_surface.surface(*surface_arguments(polygon, 0.999), *q))
        assert not np.array_equal(near, far)
        scale = np.array([near[0], 1.0, 1.0, reach])
        worst = max(worst, np.abs((near - far)[:4] / scale).max() / slenderness(polygon))
        units = np.array([1.0, 1.0, reach])
        h_near, h_far = (matrix(*h[4:]) / np.outer(units, units) for h in (near, far))
        np.testing.assert_allclose(h_near, h_far, atol=1e-6 * np.abs(h_far).max())
    assert worst < 2e-11


def test_surface_with_the_centre_on_corners_edges_and_their_lines():
    """Finite there, equal to the independent closed form, and continuous with the values beside."""
    rng = np.random.default_rng(8)
    for polygon in [RECTANGLE, *(random_polygon(rng, 0.3) for _ in range(30))]:
        law = theory.convex(polygon, 1.0, 1.0)
        arguments = surface_arguments(polygon)
        reach = arguments[5]
        for p, p_next in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
            for s in (0.0, 0.5, 0.31, 1.7, -2.0):
                c = p + s * (p_next - p)
                q = about(*c)
                value = np.array(limit_surface.surface(*arguments, *q))
                assert np.isfinite(value).all()
                assert value[0] == pytest.approx(law.dissipation(q), rel=1e-12)
                scale = np.array([1.0, 1.0, reach])
                np.testing.assert_allclose(value[1:4] / scale, law.gradient(q) / scale, atol=1e-12)
                aside = np.array(limit_surface.surface(*arguments, *about(*(c + 1e-9 * reach))))
                np.testing.assert_allclose(value[1:4] / scale, aside[1:4] / scale, atol=1e-6)


@pytest.mark.parametrize("scale", [1e-3, 0.3, 10.0])
def test_gauge_against_theory(scale):
    rng = np.random.default_rng(9)
    for _ in range(25):
        polygon = random_polygon(rng, scale)
        law = theory.convex(polygon, 1.0, 1.0)
        arguments = surface_arguments(polygon)
        reach = arguments[5]
        forces = rng.normal(size=(8, 3)) * [1.0, 1.0, reach] * 10 ** rng.uniform(-2, 2, (8, 1))
        forces[0, 2] = forces[1, 0] = forces[1, 1] = 0.0  # pure shear, pure torsion
        for force, expected in zip(forces, theory.gauge(law, forces), strict=True):
            start = rng.normal(size=3) * [1.0, 1.0, 1.0 / reach] if rng.random() < 0.5 else np.zeros(3)
            value, *q = limit_surface.gauge(*arguments, *force, *start, 0.0)
            assert value == pytest.approx(expected, rel=1e-10)
            # the twist that shows it
            assert force @ q / law.dissipation(q) == pytest.approx(expected, rel=1e-10)
            early = limit_surface.gauge(*arguments, *force, *start, friction_integrals.area_radius(polygon))[0]
            assert (early > 1.0) == (expected > 1.0)
            assert early <= expected * (1 + 1e-12)
    assert limit_surface.gauge(*arguments, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)[0] == 0.0


# --- the proximal map


def random_returns(seed, count, far=2.0):
    """Random joints under random trial forces: arguments of the map up to the start, with scale and shape."""
    rng = np.random.default_rng(seed)
    polygon = None
    for i in range(count):
        if i % 20 == 0:
            polygon = random_polygon(rng, 10 ** rng.uniform(-3, 1))
            arguments = surface_arguments(polygon)
            radius, reach = friction_integrals.area_radius(polygon), arguments[5]
            yy, xx, _ = polygons.second_moments(polygon)
            law = theory.convex(polygon, 1.0, 1.0)
        strength, k = 10 ** rng.uniform(-2, 6), 10 ** rng.uniform(5, 12)
        k_t, k_r = k * arguments[4], k * (xx + yy) * 10 ** rng.uniform(-1, 1)
        force = rng.normal(size=3) * [1.0, 1.0, radius] * strength * 10 ** rng.uniform(-0.7, far)
        if rng.random() < 0.1:
            force[rng.choice([2, 0])] = 0.0
        elastic = strength / k_t
        start = rng.normal(size=3) * [1.0, 1.0, 1.0 / reach] * elastic * 10 ** rng.uniform(-6, 6)
        kind = rng.integers(4)
        if kind == 0:
            start[:] = 0.0
        elif kind == 1:  # the wrong way round
            start = -force / [k_t, k_t, k_r]
        elif kind == 2:  # a pure translation, or nearly
            start[2] *= 10 ** rng.uniform(-12, -3) * rng.integers(2)
        yield polygon, law, arguments, radius, reach, strength, k_t, k_r, force, start


@pytest.mark.parametrize("proximal_map, count", list(zip(forms(limit_surface.proximal_map), (6000, 1000), strict=True)))
def test_proximal_map_is_optimal(proximal_map, count):
    """Conditions of optimality: f - K q = t, and t is the point of the limit surface whose normal is q.

    The surface is that of the theory. Trial forces from inside to a hundred times outside, starts at random.
    """
    inside, evaluations, balances = [], [], []
    for polygon, law, arguments, radius, reach, strength, k_t, k_r, force, start in random_returns(10, count):
        t1, t2, tm, q1, q2, q3, *after, used = proximal_map(*arguments, radius, strength, k_t, k_r, *force, *start)
        units = strength * np.array([1.0, 1.0, reach])
        t, q = np.array([t1, t2, tm]), np.array([q1, q2, q3])
        evaluations.append(used)
        if not q.any():
            np.testing.assert_array_equal(t, force)
            inside.append((law, force / strength))
            continue
        balance = (force - np.array([k_t, k_t, k_r]) * q - t) / units
        size = max(1.0, np.abs(force / units).max())
        balances.append(np.abs(balance).max() / size)
        normal = (law.gradient(q) * strength - t) / units
        assert np.abs(normal).max() < 3e-11 * slenderness(polygon), (polygon, force, start)
        assert t @ q > 0.0
        np.testing.assert_array_equal(after, q)
    # where C is some twenty to sixty half diameters away, rounding of the edge sums stops the iteration early
    assert np.quantile(balances, 0.98) < 1e-10 and max(balances) < 1e-6
    assert len(balances) > 0.5 * count and len(inside) > 0.03 * count
    for law, force in inside[:300]:
        assert theory.gauge(law, force) <= 1.0 + 1e-10
    assert np.quantile(evaluations, 0.9) < 25


def test_proximal_map_against_a_naive_minimisation():
    chosen = list(random_returns(11, 200, far=1.0))[::17]
    for _, law, arguments, radius, reach, strength, k_t, k_r, force, start in chosen:
        t1, t2, tm, *q = limit_surface.proximal_map(*arguments, radius, strength, k_t, k_r, *force, *start)[:6]
        # lengths in V_0/k_t, so that all numbers are of order one
        unit = strength / k_t * np.array([1.0, 1.0, 1.0 / reach])
        stiffness = np.array([1.0, 1.0, k_r / (k_t * reach * reach)])
        scaled_force = force / strength * [1.0, 1.0, 1.0 / reach]

        def objective(z, law=law, reach=reach, stiffness=stiffness, scaled_force=scaled_force):
            twist = z * [1.0, 1.0, 1.0 / reach]
            D = float(law.dissipation(twist)) if z.any() else 0.0
            return 0.5 * z @ (stiffness * z) - scaled_force @ z + D

        best = min(
            (
                minimize(objective, z0, method="Nelder-Mead", options={"xatol": 1e-8, "fatol": 1e-12, "maxiter": 1000})
                for z0 in (scaled_force / stiffness, 0.1 * scaled_force)
            ),
            key=lambda found: found.fun,
        )
        z = np.array(q[:3]) / unit
        size = 1.0 + abs(best.fun)
        assert objective(z) <= best.fun + 1e-11 * size
        assert objective(z) >= best.fun - 1e-6 * size


def test_proximal_map_without_strength_and_at_rest():
    arguments = surface_arguments(RECTANGLE)
    radius = friction_integrals.area_radius(RECTANGLE)
    for proximal_map in forms(limit_surface.proximal_map):
        out = proximal_map(*arguments, radius, 0.0, 2.0, 4.0, 1.0, -3.0, 2.0, 0.0, 0.0, 0.0)
        assert out[:6] == (0.0, 0.0, 0.0, 0.5, -1.5, 0.5)
        out = proximal_map(*arguments, radius, 10.0, 2.0, 4.0, 0.0, 0.0, 0.0, 1.0, 2.0, 3.0)
        assert out == (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 2.0, 3.0, 0)
        assert proximal_map(*arguments, radius, 0.0, 2.0, 4.0, 0.0, 0.0, 0.0, 1.0, 2.0, 3.0)[:6] == (0.0,) * 6


@pytest.mark.parametrize("scale", [1e-3, 1.0])
def test_torsion_radius_of_polygons_and_points(scale):
    """M_T0 / V_0 is the least mean distance from any centre: c_T where the joint is symmetric, less where it is not."""
    assert friction_integrals.area_radius(scale * RECTANGLE) == pytest.approx(scale * 0.09681061, rel=1e-7)
    rng = np.random.default_rng(12)
    for _ in range(20):
        polygon = random_polygon(rng, scale)
        law = theory.convex(polygon, 1.0, 1.0)
        assert friction_integrals.area_radius(polygon) == pytest.approx(theory.torsion_strength(law), rel=1e-9)
        weights = rng.uniform(0.1, 1.0, len(polygon))
        law = theory.points(polygon, weights / weights.sum(), 1.0)
        radius = median_distance(*polygon.T.copy(), weights, 0, len(weights))
        # in torsion without shear the centre is free: V = 0 in the limit of a pure moment
        assert radius == pytest.approx(theory.torsion_strength(law), rel=1e-8)
