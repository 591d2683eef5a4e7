"""Laws of points and of the pressure: Coulomb return mapping and no-tension integral."""

import math

import numpy as np
import pytest

from dembrick.geometry import polygons
from dembrick.kernels.joint import area_law, no_tension, point_law
from dembrick.kernels.statics import point_joints
from dembrick.kernels.statics.point_joints import Points
from helpers.compiled import forms
from helpers.joints_of_engines import motion_of, strengths_of
from helpers.random_polygons import slender_polygon as random_polygon

A, B = 0.3, 0.2
RECTANGLE = np.array([[-A, -B], [A, -B], [A, B], [-A, B]]) / 2


# --- Coulomb friction at a point


@pytest.mark.parametrize("coulomb", forms(point_law.coulomb))
def test_coulomb_against_a_naive_return(coulomb):
    rng = np.random.default_rng(1)
    plastic_seen = 0
    for _ in range(2000):
        k, viscous, cap = 10 ** rng.uniform(3, 9), rng.choice([0.0, 0.5, 2.0]), 10 ** rng.uniform(-2, 4)
        before = cap * rng.normal(size=2) * 0.5
        slip = cap / k * rng.normal(size=2) * 10 ** rng.uniform(-2, 2)
        t1, t2, e1, e2, plastic = coulomb(tuple(before), tuple(slip), k, 1.0 + viscous, 1.0 / (1.0 + viscous), cap)
        force, after = np.array([t1, t2]), np.array([e1, e2])
        trial = before + k * (1 + viscous) * slip
        size = np.linalg.norm(trial)
        expected = trial * min(1.0, cap / size)
        np.testing.assert_allclose(force, expected, rtol=1e-13, atol=1e-13 * cap)
        # spring and dashpot in parallel, both in series with the slider
        np.testing.assert_allclose(force, after + viscous * (after - before), rtol=1e-11, atol=1e-10 * size)
        assert plastic == pytest.approx(max(0.0, size - cap) / (k * (1 + viscous)), rel=1e-12, abs=1e-13 * size / k)
        assert (plastic > 0.0) == (size > cap)
        plastic_seen += plastic > 0
        # plastic slip is along the force: friction dissipates cap times its length
        lost = force @ (slip - (after - before) / k)
        assert lost == pytest.approx(cap * plastic, rel=1e-9, abs=1e-12 * cap * size / k)
        assert lost >= -1e-12 * cap * size / k
        # the elastic force, which is less beside a dashpot, dissipates its mean times that slip
        spent = point_law.shear_loss(tuple(before), tuple(after), tuple(slip), k)
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
            t1, t2, e1, e2, _ = point_law.coulomb(tuple(e), tuple(slip), k, 1.5, 1.0 / 1.5, cap)
            work += t1 * slip[0] + t2 * slip[1]
            e = np.array([e1, e2])
            assert math.hypot(t1, t2) <= cap * (1 + 1e-14)
        assert work >= 0.5 * (e @ e) / k


def test_coulomb_without_friction_or_without_motion():
    for coulomb in forms(point_law.coulomb):
        assert coulomb((0.0, 0.0), (0.0, 0.0), 1e6, 1.5, 1.0 / 1.5, 0.0) == (0.0,) * 5
        t1, t2, e1, e2, plastic = coulomb((0.0, 0.0), (3e-6, 4e-6), 1e6, 1.0, 1.0, 0.0)
        assert (t1, t2) == (0.0, 0.0) and plastic == pytest.approx(5e-6, rel=1e-14)
        assert abs(e1) + abs(e2) < 1e-14
        assert coulomb((3.0, 4.0), (0.0, 0.0), 1e6, 1.0, 1.0, 6.0) == (3.0, 4.0, 3.0, 4.0, 0.0)


@pytest.mark.parametrize("point_forces", forms(point_joints.forces))
def test_point_resultants_are_work_conjugate(point_forces):
    """The resultants do the same work on the joint's twist as the points' forces on their own slips and openings."""
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
            path=np.zeros(1),
        )
        dn, r1, r2, pn, pr1, pr2, p1, p2, pr = rng.normal(size=9)
        dn = -abs(dn)
        motion = motion_of((dn, r1, r2), (pn, pr1, pr2), (p1, p2, pr))
        normal, v1, v2, mt, m1, m2, slip = point_forces(points, 0, None, motion, (0.0, 0.0), None)
        opening = dn + r1 * points.y_n - r2 * points.x_n
        np.testing.assert_allclose(points.normal, points.k_n * np.maximum(-opening, 0.0), rtol=1e-13)
        forces = np.column_stack([points.elastic_1, points.elastic_2])
        slips = np.column_stack([p1 - pr * points.y_s, p2 + pr * points.x_s])
        assert np.all(np.linalg.norm(forces, axis=1) <= 0.6 * points.normal * (1 + 1e-13) + 1e-14)
        assert v1 * p1 + v2 * p2 + mt * pr == pytest.approx((forces * slips).sum(), rel=1e-11, abs=1e-12)
        rate = pn + pr1 * points.y_n - pr2 * points.x_n
        assert normal * pn - m1 * pr1 - m2 * pr2 == pytest.approx(points.normal @ rate, rel=1e-11, abs=1e-12)
        assert slip * points.normal.sum() == pytest.approx(points.normal @ points.slip, rel=1e-13)
        lost = point_joints.dissipation(points, 0, points.normal, 0.0, p1, p2, pr)
        assert lost == pytest.approx(0.6 * points.normal @ np.linalg.norm(slips, axis=1), rel=1e-13)
        assert lost >= v1 * p1 + v2 * p2 + mt * pr - 1e-12


# --- the no-tension integral


def positive_part(polygon, g):
    """The polygon clipped to g >= 0, g a function of a point."""
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


@pytest.mark.parametrize("integral", forms(area_law.pressure_of_four))
def test_four_corners_without_a_branch(integral):
    """Also for triangles, whose last corner is repeated; open, closed, and level."""
    rng = np.random.default_rng(6)
    seen = set()
    for i in range(600):
        polygon = random_polygon(rng, 10 ** rng.uniform(-3, 1))
        polygon = polygon[np.sort(rng.permutation(len(polygon))[: 3 + i % 2])]
        polygon -= polygons.area_and_centroid(polygon)[1:]
        x, y = map(tuple, np.append(polygon, polygon[-1:], axis=0)[:4].T.tolist())
        reach, area = np.hypot(*polygon.T).max(), polygons.area(polygon)
        gradient = rng.normal(size=2) * 10 ** rng.uniform(-3, 3) * (i % 7 > 0)
        plane = np.array([(np.linalg.norm(gradient) + (i % 7 == 0)) * reach * rng.uniform(-1.1, 1.2), *gradient])
        level = plane[0] + polygon @ gradient
        got = integral(x, y, area, polygons.second_moments(polygon), level.max() > 0.0, *plane.tolist())
        expected = integrals_by_clipping(polygon, plane) if level.max() > 0.0 else np.zeros(3)
        scale = area * max(np.abs(level).max(), 1e-300) * np.array([1.0, reach, reach])
        np.testing.assert_allclose(got / scale, expected / scale, rtol=1e-9, atol=1e-13)
        seen.add((level.max() > 0.0, level.min() > 0.0, bool(gradient.any())))
    assert len(seen) == 5


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
    """Corners at zero penetration, whose sign depends on rounding, do not change the force."""
    x, y = np.array([1.0, 2.0, 2.0, 1.0]), np.array([0.0, 0.0, 1.0, 1.0])
    for least in (0.0, -3e-17):
        found = no_tension.no_tension(x, y, 0, 4, least, -1.0 - 2e-16, 1.0, 1e-16)
        np.testing.assert_allclose(found, (0.5, 5.0 / 6.0, 0.25), rtol=1e-12)


def test_no_tension_meets_the_closed_joint():
    """Continuous where the last corner closes, and equal there to area x level and second moments x slope."""
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


@pytest.mark.parametrize("bonded_law", forms(point_law.bonded_law))
@pytest.mark.parametrize("residual", [1.0, 0.6])
def test_a_dilatant_point_slips_by_what_its_spring_does_not_take(bonded_law, residual):
    """Slip and lift of a step are solved together: k_s (s - slid) is the strength under N = k_n (g + psi slid)."""
    g, s, k_n, k_s, friction, dilation = 1e-5, 3e-5, 1e8, 5e7, 0.5, 0.2
    law = strengths_of({"dilation": dilation, "residual": residual})
    bond = point_law.Bond((0.0, 0.0), 0.0, 0.0, 0.0)
    found = bonded_law(g, 0.0, (s, 0.0), (k_n, k_s), friction, (0.0, 1.0, 1.0), law, 0, 0.01, bond)
    normal, _, (shear, _), slid, (_, _, _, rise) = found
    mu = residual * friction
    assert slid == pytest.approx((k_s * s - mu * k_n * g) / (k_s + mu * k_n * dilation), rel=1e-12)
    assert rise == pytest.approx(dilation * slid, rel=1e-12)
    assert normal == pytest.approx(k_n * (g + rise), rel=1e-12)
    assert [shear, shear] == pytest.approx([mu * normal, k_s * (s - slid)], rel=1e-12)
