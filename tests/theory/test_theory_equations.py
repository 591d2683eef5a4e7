"""Equations (1) to (11): the paper's tables, independent quadrature, and the numbers of the joint in the laboratory."""

import numpy as np
import pytest
from scipy import integrate

from helpers import paper_equations as equations

A, B, FRICTION, NORMAL = 0.3, 0.2, 0.64, 467.0
V_0 = FRICTION * NORMAL


@pytest.mark.parametrize(
    ("ratio", "convex", "concave", "difference"),
    [
        (0.25, 55.69, 108.23, 94.34),
        (0.5, 62.29, 117.39, 88.46),
        (1.0, 80.35, 148.49, 84.82),
        (1.5, 101.65, 189.29, 86.22),
        (2.0, 124.58, 234.79, 88.46),
    ],
)
def test_table_1(ratio, convex, concave, difference):
    a, b, shear = ratio * 0.3, 0.3, 0.7 * 1000.0
    M_convex, M_concave = (
        f(a, b, shear) for f in (equations.torsion_strength_convex, equations.torsion_strength_concave)
    )
    assert M_convex == pytest.approx(convex, abs=0.00501)
    assert M_concave == pytest.approx(concave, abs=0.00501)
    assert 100.0 * (M_concave / M_convex - 1.0) == pytest.approx(difference, abs=0.00501)


def test_mean_distance_against_quadrature():
    for a, b in ((0.3, 0.2), (1.0, 0.1), (0.01, 0.013)):
        mean, _ = integrate.dblquad(lambda y, x: np.hypot(x, y), 0.0, a / 2, 0.0, b / 2, epsabs=0, epsrel=1e-11)
        assert equations.torsion_parameter(a, b) == pytest.approx(4.0 * mean / (a * b), rel=1e-10)


def test_torsion_parameter_is_vectorised_and_symmetric():
    a, b = np.array([0.1, 0.2, 3.0]), np.array([0.4, 0.2, 0.01])
    values = equations.torsion_parameter(a, b)
    assert values.shape == (3,)
    np.testing.assert_allclose(values, equations.torsion_parameter(b, a), rtol=1e-15)
    np.testing.assert_allclose(values[1], 0.2 * (np.sqrt(2.0) + np.arcsinh(1.0)) / 6.0, rtol=1e-15)


@pytest.mark.parametrize(
    ("x_c", "y_c", "V_y", "V_x", "M_C"),
    [
        (-0.15, -0.10, 0.0, 0.0, 0.09681061),
        (-0.05, -0.03, 0.56711455, 0.47768715, 0.14475335),
        (0.10, 0.05, 0.82382706, 0.51700952, 0.29930206),
        (-0.03, 0.20, 0.3464389, 0.90287367, 0.33380836),
    ],
)
def test_equation_5_rows(x_c, y_c, V_y, V_x, M_C):
    found_x, found_y, found_m = equations.convex_interaction(x_c, y_c, A, B)
    assert found_y == pytest.approx(V_y, abs=5.1e-9)
    assert found_x == pytest.approx(V_x, abs=5.1e-9)
    assert found_m + found_x * (y_c + B / 2) + found_y * (x_c + A / 2) == pytest.approx(M_C, abs=5.1e-9)


@pytest.mark.parametrize("corner", [(0.02, 0.03), (0.0, 0.1), (0.0, 0.0), (-0.1, 0.0)])
def test_equation_5_against_quadrature_also_with_the_centre_on_edge_and_vertex(corner):
    x_c, y_c = corner

    def mean(function):
        # split where the integrand has its kink
        xs = sorted({x_c, x_c + A, min(max(0.0, x_c), x_c + A)})
        total = 0.0
        for lower, upper in zip(xs[:-1], xs[1:], strict=True):
            total += integrate.dblquad(function, lower, upper, y_c, y_c + B, epsabs=1e-12, epsrel=1e-10)[0]
        return total / (A * B)

    V_x, V_y, M_T = equations.convex_interaction(x_c, y_c, A, B)
    assert V_x == pytest.approx(mean(lambda y, x: y / max(np.hypot(x, y), 1e-300)), abs=1e-8)
    assert V_y == pytest.approx(mean(lambda y, x: x / max(np.hypot(x, y), 1e-300)), abs=1e-8)
    M_C = mean(lambda y, x: np.hypot(x, y))
    assert M_T == pytest.approx(M_C - V_x * (y_c + B / 2) - V_y * (x_c + A / 2), abs=1e-8)


def test_equation_6_against_the_plain_sum_and_8():
    rng = np.random.default_rng(3)
    x_c, y_c = rng.uniform(-0.5, 0.5, (2, 50))
    V_x, V_y, M_T = equations.concave_interaction(x_c, y_c, A, B, V_0)
    expected = np.zeros((3, 50))
    for dx in (0.0, A):
        for dy in (0.0, B):
            x, y = x_c + dx, y_c + dy
            d = np.hypot(x, y)
            expected += V_0 / 4 * np.array([y / d, x / d, d])
    expected[2] -= expected[0] * (y_c + B / 2) + expected[1] * (x_c + A / 2)
    np.testing.assert_allclose([V_x, V_y, M_T], expected, rtol=0, atol=1e-12 * V_0)
    V, M = equations.concave_interaction_y(x_c, A, B, V_0)
    on_axis = equations.concave_interaction(x_c, -B / 2, A, B, V_0)
    np.testing.assert_allclose(on_axis, [np.zeros(50), V, M], atol=1e-12 * V_0)


def test_reduced_rectangle_keeps_the_torsion_strength():
    a_1, b_1 = equations.reduced_dimensions(A, B)
    assert a_1 / b_1 == pytest.approx(A / B, rel=1e-15)
    assert a_1 / A == pytest.approx(0.537, abs=5e-4)
    assert equations.reduced_half_diagonal(A, B) == pytest.approx(equations.torsion_parameter(A, B), rel=1e-15)
    assert equations.torsion_strength_corrected(A, B, V_0) == pytest.approx(
        equations.torsion_strength_convex(A, B, V_0), rel=1e-15
    )


@pytest.mark.parametrize(("arm", "convex", "concave"), [(0.9, 107.165760, 199.560586), (0.5, 192.898367, 359.209055)])
def test_couples_of_table_3(arm, convex, concave):
    assert equations.torsion_strength_convex(A, B, V_0) / (arm * A) == pytest.approx(convex, abs=5e-7)
    assert equations.torsion_strength_concave(A, B, V_0) / (arm * A) == pytest.approx(concave, abs=5.1e-7)
    assert equations.torsion_strength_corrected(A, B, V_0) / (arm * A) == pytest.approx(convex, abs=5e-7)
