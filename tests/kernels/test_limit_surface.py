"""The exact limit surface of a joint, its gauge and its proximal map."""

import math

import numpy as np
import pytest
from scipy.integrate import dblquad
from scipy.optimize import minimize

from dembrick import theory
from dembrick.geometry import friction_integrals, polygons
from dembrick.kernels.joint import limit_surface
from dembrick.kernels.joint.geometry import Polygon
from dembrick.kernels.math.geometric_median import median_distance
from helpers.compiled import forms, matrix
from helpers.plain_python import cases
from helpers.random_polygons import slender_polygon as random_polygon
from helpers.random_polygons import slenderness

A, B = 0.3, 0.2
RECTANGLE = np.array([[-A, -B], [A, -B], [A, B], [-A, B]]) / 2


def limit_of(polygon, reach_factor=1.0):
    """`LimitSurface` of a polygon under full pressure."""
    x, y = np.ascontiguousarray(polygon[:, 0]), np.ascontiguousarray(polygon[:, 1])
    reach = reach_factor * float(np.hypot(x, y).max())
    own = Polygon(x, y, 0, len(x), float(polygons.area(polygon)), None, reach)
    radius = float(friction_integrals.area_radius(polygon))
    return limit_surface.LimitSurface(own, friction_integrals.far_moments(polygon), reach, radius, None, 0)


def about(c1, c2, w=1.0):
    """Slip twist of a rotation about C = (c1, c2)."""
    return c2 * w, -c1 * w, w


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
    d, v1, v2, mt = surface(limit_of(RECTANGLE), *about(c1, c2))[:4]
    assert abs(v2) == pytest.approx(v_y, rel=2e-7, abs=1e-15)
    assert abs(v1) == pytest.approx(v_x, rel=2e-7, abs=1e-15)
    assert mt - (c1 * v2 - c2 * v1) == pytest.approx(m_c, rel=2e-7)
    assert d == pytest.approx(m_c, rel=2e-7)


@pytest.mark.parametrize("centre", [(0.02, -0.03), (0.15, 0.1), (0.15, 0.02), (0.25, 0.1), (-0.4, 0.7), (9.0, -7.0)])
@pytest.mark.parametrize("w", [1.0, -2.5])
def test_surface_against_quadrature(centre, w):
    """C inside, on a vertex, on an edge, on the line of an edge, outside, and beyond the switch to the series."""
    c1, c2 = centre
    q = about(c1, c2, w)
    d, v1, v2, mt = limit_surface.surface(limit_of(RECTANGLE), *q)[:4]

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
        limit = limit_of(polygon)
        reach = limit.reach
        direction = rng.normal(size=2)
        direction /= np.linalg.norm(direction)
        distance = 10 ** rng.uniform(lowest, highest)
        # unit twist in (v1, v2, w reach)
        q = np.array([*direction * distance, rng.choice([-1.0, 1.0])]) / math.hypot(distance, 1.0)
        unscale = np.array([1.0, 1.0, 1.0 / reach])
        value = surface(limit, *(q * unscale))
        d, gradient, hessian = value[0], value[1:4] * unscale, matrix(*value[4:]) * np.outer(unscale, unscale)
        width = polygons.width(polygon) / reach
        h = 1e-4 * min(width, math.hypot(q[0], q[1]) if lowest > 0 else 1.0)
        for i in range(3):
            e = np.zeros(3)
            e[i] = h
            plus, minus = (surface(limit, *((q + s * e) * unscale)) for s in (1, -1))
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
        near = np.array(limit_surface.surface(limit_of(polygon, 1.001), *q))
        far = np.array(limit_surface.surface(limit_of(polygon, 0.999), *q))
        assert not np.array_equal(near, far)
        scale = np.array([near[0], 1.0, 1.0, reach])
        worst = max(worst, np.abs((near - far)[:4] / scale).max() / slenderness(polygon))
        units = np.array([1.0, 1.0, reach])
        h_near, h_far = (matrix(*h[4:]) / np.outer(units, units) for h in (near, far))
        np.testing.assert_allclose(h_near, h_far, atol=1e-6 * np.abs(h_far).max())
    assert worst < 2e-11


def test_surface_with_the_centre_on_corners_edges_and_their_lines():
    """There it is finite, equals the independent closed form and is continuous with the values beside."""
    rng = np.random.default_rng(8)
    for polygon in [RECTANGLE, *(random_polygon(rng, 0.3) for _ in range(30))]:
        law = theory.convex(polygon, 1.0, 1.0)
        limit = limit_of(polygon)
        reach = limit.reach
        for p, p_next in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
            for s in (0.0, 0.5, 0.31, 1.7, -2.0):
                c = p + s * (p_next - p)
                q = about(*c)
                value = np.array(limit_surface.surface(limit, *q))
                assert np.isfinite(value).all()
                assert value[0] == pytest.approx(law.dissipation(q), rel=1e-12)
                scale = np.array([1.0, 1.0, reach])
                np.testing.assert_allclose(value[1:4] / scale, law.gradient(q) / scale, atol=1e-12)
                aside = np.array(limit_surface.surface(limit, *about(*(c + 1e-9 * reach))))
                np.testing.assert_allclose(value[1:4] / scale, aside[1:4] / scale, atol=1e-6)


@pytest.mark.parametrize("scale", [1e-3, 0.3, 10.0])
def test_gauge_against_theory(scale):
    rng = np.random.default_rng(9)
    for _ in range(25):
        polygon = random_polygon(rng, scale)
        law = theory.convex(polygon, 1.0, 1.0)
        limit = limit_of(polygon)
        reach = limit.reach
        forces = rng.normal(size=(8, 3)) * [1.0, 1.0, reach] * 10 ** rng.uniform(-2, 2, (8, 1))
        forces[0, 2] = forces[1, 0] = forces[1, 1] = 0.0  # pure shear, pure torsion
        for force, expected in zip(forces, theory.gauge(law, forces), strict=True):
            start = rng.normal(size=3) * [1.0, 1.0, 1.0 / reach] if rng.random() < 0.5 else np.zeros(3)
            value, q = limit_surface.gauge(limit, tuple(force), tuple(start))
            assert value == pytest.approx(expected, rel=1e-10)
            # the twist at which the gauge is attained
            assert force @ q / law.dissipation(q) == pytest.approx(expected, rel=1e-10)
            early = limit_surface.gauge(limit, tuple(force), tuple(start), limit.radius)[0]
            assert (early > 1.0) == (expected > 1.0)
            assert early <= expected * (1 + 1e-12)
    assert limit_surface.gauge(limit, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))[0] == 0.0


# --- the proximal map


def random_returns(seed, count, far=2.0):
    """Random joints under random trial forces: arguments of the map up to the start, with scale and shape."""
    rng = np.random.default_rng(seed)
    polygon = None
    for i in range(count):
        if i % 20 == 0:
            polygon = random_polygon(rng, 10 ** rng.uniform(-3, 1))
            limit = limit_of(polygon)
            radius, reach = limit.radius, limit.reach
            yy, xx, _ = polygons.second_moments(polygon)
            law = theory.convex(polygon, 1.0, 1.0)
        strength, k = 10 ** rng.uniform(-2, 6), 10 ** rng.uniform(5, 12)
        k_t, k_r = k * limit.polygon.area, k * (xx + yy) * 10 ** rng.uniform(-1, 1)
        force = rng.normal(size=3) * [1.0, 1.0, radius] * strength * 10 ** rng.uniform(-0.7, far)
        if rng.random() < 0.1:
            force[rng.choice([2, 0])] = 0.0
        elastic = strength / k_t
        start = rng.normal(size=3) * [1.0, 1.0, 1.0 / reach] * elastic * 10 ** rng.uniform(-6, 6)
        kind = rng.integers(4)
        if kind == 0:
            start[:] = 0.0
        elif kind == 1:  # in the wrong direction
            start = -force / [k_t, k_t, k_r]
        elif kind == 2:  # a pure translation, or nearly
            start[2] *= 10 ** rng.uniform(-12, -3) * rng.integers(2)
        yield polygon, law, limit, reach, strength, k_t, k_r, force, start


@pytest.mark.parametrize(
    "proximal_map, count", list(zip(forms(limit_surface.proximal_map), (cases(3000, 500), 500), strict=True))
)
def test_proximal_map_is_optimal(proximal_map, count):
    """Conditions of optimality: f - K q = t, and t is the point of the limit surface with the normal q.

    The surface is that of `theory`. Trial forces reach from inside to a hundred times outside, starts are random.
    """
    inside, evaluations, balances = [], [], []
    for polygon, law, limit, reach, strength, k_t, k_r, force, start in random_returns(10, count):
        t, q, after, used = proximal_map(limit, strength, (k_t, k_r), tuple(force), tuple(start))
        units = strength * np.array([1.0, 1.0, reach])
        t, q = np.array(t), np.array(q)
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
    # with C some twenty to sixty half diameters away, rounding of the edge sums ends the iteration early
    assert np.quantile(balances, 0.98) < 1e-10 and max(balances) < 1e-6
    assert len(balances) > 0.5 * count and len(inside) > 0.03 * count
    for law, force in inside[:300]:
        assert theory.gauge(law, force) <= 1.0 + 1e-10
    assert np.quantile(evaluations, 0.9) < 25


def test_proximal_map_against_a_naive_minimisation():
    chosen = list(random_returns(11, 200, far=1.0))[::17]
    for _, law, limit, reach, strength, k_t, k_r, force, start in chosen:
        _, q, _, _ = limit_surface.proximal_map(limit, strength, (k_t, k_r), tuple(force), tuple(start))
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
        z = np.array(q) / unit
        size = 1.0 + abs(best.fun)
        assert objective(z) <= best.fun + 1e-11 * size
        assert objective(z) >= best.fun - 1e-6 * size


def test_proximal_map_without_strength_and_at_rest():
    limit, still, springs = limit_of(RECTANGLE), (0.0, 0.0, 0.0), (2.0, 4.0)
    for proximal_map in forms(limit_surface.proximal_map):
        assert proximal_map(limit, 0.0, springs, (1.0, -3.0, 2.0), still)[:2] == (still, (0.5, -1.5, 0.5))
        start = 1.0, 2.0, 3.0
        assert proximal_map(limit, 10.0, springs, still, start) == (still, still, start, 0)
        assert proximal_map(limit, 0.0, springs, still, start)[:2] == (still, still)


@pytest.mark.parametrize("scale", [1e-3, 1.0])
def test_torsion_radius_of_polygons_and_points(scale):
    """M_T0 / V_0 is the least mean distance from any centre: c_T if the joint is symmetric, less if it is not."""
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
