"""Pressure that follows the overturning: loads at height, torsion under bending, tipping."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import optimize

from dembrick.errors import ScenarioError
from dembrick.theory import (
    formulation_law,
    limit_load,
    limit_load_at_height,
    overturning_load,
    point_formulation,
    polygon_formulation,
    rectangle_formulation,
)
from dembrick.theory.equations import torsion_parameter
from dembrick.theory.formulations import effective_polygon, pressure_plane, spring_forces
from dembrick.theory.polygons import moment_matrix, rectangle

A, B, FRICTION, NORMAL = 0.3, 0.2, 0.64, 467.0


def lab(name, **options):
    return rectangle_formulation(name, A, B, FRICTION, **options)


@pytest.mark.parametrize(
    ("name", "options", "plane", "raised", "digits"),
    [
        ("concave", {}, (254.5698, 212.2493), (252.0031, 208.5214), 5.1e-5),
        ("corrected", {}, (209.3379, 154.8252), (195.7532, 146.0687), 5.1e-5),
        ("corrected-shear", {}, (209.3379, 154.8252), (205.5717, 151.9369), 5.1e-5),
        ("convex", {}, (216.0549, 161.9025), (216.0549, 161.9025), 5.1e-5),
        ("convex", {"pressure": "effective"}, (216.0549, 161.9025), (206.927, 155.303), 5.1e-4),
        ("convex", {"pressure": "linear"}, (216.0549, 161.9025), (212.1613, 159.7313), 5.1e-5),
    ],
)
def test_load_height(name, options, plane, raised, digits):
    for height, values in ((0.0, plane), (0.05, raised)):
        for e, V in zip((0.25, 0.45), values, strict=True):
            found = limit_load_at_height(lab(name, **options), NORMAL, (0.0, 1.0, e * A), height=height)
            assert found.mode == "sliding"
            assert found.V == pytest.approx(V, abs=digits)


def test_couples_and_pure_shear_do_not_mind_the_height():
    for name in ("concave", "corrected", "corrected-shear", "convex"):
        for load in ((0, 0, 1.0), (0, 1.0, 0)):
            low = limit_load_at_height(lab(name), NORMAL, load)
            high = limit_load_at_height(lab(name), NORMAL, load, height=0.05)
            assert high.V == pytest.approx(low.V, rel=1e-11)


def test_fine_points_tend_to_the_linear_pressure():
    linear = limit_load_at_height(lab("convex", pressure="linear"), NORMAL, (0, 1, 0.075), height=0.05).V
    gaps = []
    for n in (6, 12, 24):
        points = lab("distributed", cells=(3 * n // 2, n))
        gaps.append(1.0 - limit_load_at_height(points, NORMAL, (0, 1, 0.075), height=0.05).V / linear)
    assert 0 < gaps[2] < 1e-3
    assert gaps[0] / gaps[1] == pytest.approx(4.0, abs=0.6)  # the error of equal cells is of second order
    assert gaps[1] / gaps[2] == pytest.approx(4.0, abs=0.6)


def test_self_consistency_at_height():
    joint = lab("concave")
    found = limit_load_at_height(joint, NORMAL, (0.6, 0.8, 0.03), height=0.05)
    centre = found.V * 0.05 * np.array([0.6, 0.8]) / NORMAL
    assert limit_load(joint.law(NORMAL, centre), (0.6, 0.8, 0.03)).V == pytest.approx(found.V, rel=1e-11)
    same = limit_load_at_height(joint, NORMAL, (0.6, 0.8, 0.03), overturning=(0.03, 0.04))
    assert same.V == pytest.approx(found.V, rel=1e-12)


@pytest.mark.parametrize(
    ("cells", "ratio"),
    [((2, 2), 0.9311), ((4, 4), 0.9797), ((6, 4), 0.9861), ((9, 6), 0.9933), ((12, 8), 0.9964), ((30, 20), 0.9994)],
)
def test_points_of_equal_cells_in_pure_torsion(cells, ratio):
    law = formulation_law("distributed", A, B, 1.0, 1.0, cells=cells)
    assert limit_load(law, (0, 0, 1.0)).V / torsion_parameter(A, B) == pytest.approx(ratio, abs=5.1e-5)


@pytest.mark.parametrize(
    ("name", "options", "ratios"),
    [
        ("convex", {"pressure": "effective"}, (0.9345, 0.8947, 0.8503, 0.8071, 0.7796)),
        ("convex", {"pressure": "linear"}, (0.9751, 0.9340, 0.8763, 0.8190, 0.7815)),
        ("concave", {}, (0.9913, 0.9766, 0.9499, 0.9085, 0.8591)),
        ("convex", {}, (1.0, 1.0, 1.0, 1.0, 1.0)),
    ],
)
def test_torsion_under_bending(name, options, ratios):
    joint = lab(name, **options)
    central = limit_load(joint.law(NORMAL), (0, 0, 1.0)).V
    for e, ratio in zip((0.1, 1 / 6, 0.25, 0.35, 0.45), ratios, strict=True):
        for sign in (1.0, -1.0):
            found = limit_load(joint.law(NORMAL, (0.0, sign * e * B)), (0, 0, 1.0)).V
            assert found / central == pytest.approx(ratio, abs=6e-5)


def test_triangular_pressure_under_bending_against_quadrature():
    # e = b/6: the pressure falls from 2 N/A at one edge to nothing at the other
    def moment(y_c):
        n = 4000
        y = B * ((np.arange(n) + 0.5) / n - 0.5)
        h = y - y_c
        across = A / 2 * np.hypot(A / 2, h) + h**2 * np.arcsinh(A / 2 / np.abs(h))  # of |r - C| along the row
        return np.sum(across * (1.0 + 2.0 * y / B)) / (n * A)

    best = optimize.minimize_scalar(moment, bounds=(0.0, 0.1), method="bounded", options={"xatol": 1e-9}).fun
    law = lab("convex", pressure="linear").law(NORMAL, (0.0, B / 6))
    assert limit_load(law, (0, 0, 1.0)).V == pytest.approx(FRICTION * NORMAL * best, rel=1e-7)


def test_at_the_edge_contact_is_a_line():
    for pressure, accuracy in (("effective", 1e-8), ("linear", 2e-7)):
        law = lab("convex", pressure=pressure).law(NORMAL, (0.0, B / 2))
        assert limit_load(law, (0, 0, 1.0)).V == pytest.approx(FRICTION * NORMAL * A / 4, rel=accuracy)


@pytest.mark.parametrize(
    ("name", "lever"), [("concave", 1.0), ("corrected", None), ("corrected-shear", 1.0), ("convex", 1.0)]
)
def test_tall_blocks_overturn(name, lever):
    lever = torsion_parameter(A, B) / np.hypot(A / 2, B / 2) if lever is None else lever
    found = limit_load_at_height(lab(name), NORMAL, (0.0, 1.0, 0.0), height=0.3)
    assert found.mode == "overturning"
    assert found.V == pytest.approx(NORMAL * lever * B / 2 / 0.3, rel=1e-12)
    assert overturning_load(lab(name), NORMAL, (0.0, 0.3)) == pytest.approx(found.V, rel=1e-12)
    assert overturning_load(lab(name), NORMAL, (0.0, 0.0)) == np.inf


@pytest.mark.parametrize("pressure", ["effective", "linear"])
def test_tall_blocks_overturn_also_where_pressure_follows(pressure):
    found = limit_load_at_height(lab("convex", pressure=pressure), NORMAL, (0.0, 1.0, 0.0), height=0.3)
    assert (found.mode, found.V) == ("overturning", pytest.approx(NORMAL * B / 2 / 0.3, rel=1e-12))


def test_dead_offset_moves_the_tipping_load():
    V = overturning_load(lab("convex"), NORMAL, (0.0, 0.3), centre=(0.0, 0.05))
    assert V == pytest.approx(NORMAL * 0.05 / 0.3, rel=1e-12)
    with pytest.raises(ScenarioError, match="outside the joint"):
        overturning_load(lab("convex"), NORMAL, (0.0, 0.3), centre=(0.0, 0.11))
    with pytest.raises(ScenarioError, match="outside the joint"):
        lab("concave").law(NORMAL, (0.0, 0.11))


@given(st.floats(-0.98, 0.98), st.floats(-0.98, 0.98), st.integers(0, 3))
@settings(max_examples=80, deadline=None)
def test_springs_balance_and_never_pull(t, s, shape):
    arms = [
        rectangle(A, B),
        np.array([[0, 0], [0.3, 0], [0.3, 0.1], [0.1, 0.25], [0, 0.25]]),
        np.stack(np.meshgrid(np.linspace(-1, 1, 5), np.linspace(-2, 1, 4)), axis=-1).reshape(-1, 2),
        np.array([[0.0, 0.0], [0.4, 0.05], [0.1, 0.3]]),
    ][shape]
    areas = 1.0 + np.arange(len(arms)) % 3
    # a point inside: between the mean and a point of the set
    towards = arms[int((t + 1) * 0.49 * len(arms))]
    centre = arms.mean(axis=0) + abs(s) * (towards - arms.mean(axis=0))
    forces = spring_forces(arms, areas, NORMAL, centre)
    assert np.all(forces >= 0.0)
    assert forces.sum() == pytest.approx(NORMAL, rel=1e-9)
    np.testing.assert_allclose(forces @ arms / NORMAL, centre, atol=1e-9 * np.abs(arms).max())
    # compatible: per area, pressed points lie on a plane
    pressed = forces > 0.0
    phi = np.column_stack([np.ones(pressed.sum()), arms[pressed]])
    stress = forces[pressed] / areas[pressed]
    plane = np.linalg.lstsq(phi, stress, rcond=None)[0]
    np.testing.assert_allclose(phi @ plane, stress, atol=1e-7 * stress.max())


@given(st.floats(-0.42, 0.42), st.floats(-0.42, 0.42))
@settings(max_examples=60, deadline=None)
def test_linear_pressure_has_the_wanted_resultant(t, s):
    centre = np.array([t * A, s * B])
    level, slope = pressure_plane(rectangle(A, B), NORMAL, centre)
    n = 200
    x, y = A * ((np.arange(n) + 0.5) / n - 0.5), B * ((np.arange(n) + 0.5) / n - 0.5)
    X, Y = np.meshgrid(x, y, indexing="ij")
    p = np.maximum(0.0, level + slope[0] * (X - centre[0]) + slope[1] * (Y - centre[1])) * A * B / n**2
    assert p.sum() == pytest.approx(NORMAL, rel=1e-3)
    assert (p * X).sum() / NORMAL == pytest.approx(centre[0], abs=1e-3 * A)
    assert (p * Y).sum() / NORMAL == pytest.approx(centre[1], abs=1e-3 * B)


def test_linear_pressure_within_the_kern_and_past_it():
    # trapezium: N/A (1 +- 6 e/b); triangle: length 3 (b/2 - e), peak 2 N / (length a)
    level, slope = pressure_plane(rectangle(A, B), NORMAL, (0.0, 0.02))
    assert level + slope @ (0.0, B / 2 - 0.02) == pytest.approx(NORMAL / (A * B) * 1.6, rel=1e-12)
    level, slope = pressure_plane(rectangle(A, B), NORMAL, (0.0, 0.06))
    assert level + slope @ (0.0, B / 2 - 0.06) == pytest.approx(2 * NORMAL / (0.12 * A), rel=1e-11)
    assert level + slope @ (0.0, B / 2 - 0.12 - 0.06) == pytest.approx(0.0, abs=1e-9 * level)


def test_effective_polygon_of_a_rectangle_and_of_a_hexagon():
    (part,) = effective_polygon(rectangle(A, B), (0.03, -0.02))
    np.testing.assert_allclose(part.min(axis=0), (-0.09, -0.1), atol=1e-15)
    np.testing.assert_allclose(part.max(axis=0), (0.15, 0.06), atol=1e-15)
    angle = np.arange(6) * np.pi / 3
    hexagon = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    (part,) = effective_polygon(hexagon, (0.2, 0.1))
    M = moment_matrix(part, (0.2, 0.1))
    np.testing.assert_allclose(M[0, 1:], 0.0, atol=1e-15)  # centred at the force
    assert 0 < M[0, 0] < moment_matrix(hexagon)[0, 0]
    with pytest.raises(ScenarioError, match="convex"):
        effective_polygon([[0, 0], [3, 0], [3, 1], [1, 1], [1, 2], [0, 2]], (0.5, 0.5))


def test_general_polygon_equals_rectangle():
    square = polygon_formulation(rectangle(A, B), FRICTION, "linear")
    load = (0.3, 1.0, 0.05)
    expected = limit_load_at_height(lab("convex", pressure="linear"), NORMAL, load, height=0.05).V
    assert limit_load_at_height(square, NORMAL, load, height=0.05).V == pytest.approx(expected, rel=1e-14)
    corners = point_formulation(rectangle(A, B), np.full(4, 1.0), FRICTION)
    expected = limit_load_at_height(lab("concave"), NORMAL, load, height=0.05).V
    assert limit_load_at_height(corners, NORMAL, load, height=0.05).V == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: rectangle_formulation("concav", A, B, 0.5), "is unknown"),
        (lambda: rectangle_formulation("convex", A, B, 0.5, pressure="half"), "is unknown"),
        (lambda: rectangle_formulation("convex", A, 0.0, 0.5), "greater than 0"),
        (lambda: rectangle_formulation("distributed", A, B, 0.5), "cells"),
        (lambda: point_formulation([[0, 0], [1, 0]], [1.0], 0.5), "shape"),
        (lambda: point_formulation([[0, 0], [1, 0]], [1.0, 0.0], 0.5), "greater than 0"),
    ],
)
def test_bad_input_is_refused(make, message):
    with pytest.raises(ScenarioError, match=message):
        make()
