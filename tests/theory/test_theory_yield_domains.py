"""Yield domains of Fig. 4 and Fig. 5, points of the surface, and the cheap approximations with their errors."""

from functools import cache

import numpy as np
import pytest

from dembrick.errors import ScenarioError
from dembrick.theory import (
    approximate_domain,
    convex,
    formulation_law,
    gauge,
    interaction_curve,
    limit_load,
    surface_along,
)
from dembrick.theory.approximations import APPROXIMATIONS
from dembrick.theory.polygons import rectangle
from helpers import paper_equations as equations

A, B, FRICTION, NORMAL = 0.3, 0.2, 0.64, 467.0
V_0 = FRICTION * NORMAL
EXACT = {0.075: 216.054938, 0.135: 161.902542}


@pytest.mark.parametrize("name", ["convex", "concave", "corrected"])
def test_curve_and_the_papers_parametrisation_are_one(name):
    curve = interaction_curve(name, A, B, FRICTION, NORMAL, count=31)
    x_c = np.linspace(0.0, 2.0, 15)
    if name == "convex":
        V_x, V, M = equations.convex_interaction(x_c - A / 2, -B / 2, A, B, V_0)
        np.testing.assert_allclose(V_x, 0.0, atol=1e-12 * V_0)
    elif name == "concave":
        V, M = equations.concave_interaction_y(x_c - A / 2, A, B, V_0)
    else:
        a_1 = equations.reduced_dimensions(A, B)[0]
        V, M = equations.corrected_interaction_y(x_c - a_1 / 2, A, B, V_0)
    forces, law = np.stack([0 * V, V, M], axis=1), formulation_law(name, A, B, FRICTION, NORMAL)
    about = np.stack([0.0 * x_c, x_c, 1.0 + 0.0 * x_c], axis=1)  # twists about centres on the x axis
    np.testing.assert_allclose(law.gradient(about)[:, 1:], forces[:, 1:], atol=1e-11 * V_0)
    np.testing.assert_allclose(gauge(law, forces), 1.0, rtol=1e-11)
    assert curve.V[0] == pytest.approx(V_0, rel=1e-13)
    assert curve.V[-1] == 0.0
    assert curve.M_T[0] == 0.0
    assert curve.M_T[-1] == pytest.approx(curve.M_T0, rel=1e-14)
    assert np.all(np.diff(curve.V) < 0) and np.all(np.diff(curve.M_T) > 0)


def test_shear_and_torsion_at_infinity_and_at_o():
    V, M = formulation_law("convex", A, B, FRICTION, NORMAL).gradient([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])[:, 1:].T
    np.testing.assert_allclose(V, [0.0, V_0], atol=1e-11 * V_0)
    np.testing.assert_allclose(M, [V_0 * equations.torsion_parameter(A, B), 0.0], atol=1e-12 * V_0)


def test_non_dimensional_curves_nearly_coincide():
    # values read off the paper's Fig. 4; the correction of Fig. 5 scales only the torsion
    convex_v, convex_m = interaction_curve("convex", A, B, FRICTION, NORMAL).normalised
    concave_v, concave_m = interaction_curve("concave", A, B, FRICTION, NORMAL).normalised
    gap = np.hypot(convex_v, convex_m) / np.hypot(concave_v, concave_m) - 1.0
    assert 0.01 < np.abs(gap).max() < 0.06
    corrected = interaction_curve("corrected", A, B, FRICTION, NORMAL)
    np.testing.assert_allclose(corrected.normalised, (concave_v, concave_m), atol=1e-9)


def test_gradients_lie_on_the_surface_with_their_normal():
    law = convex(rectangle(A, B), FRICTION, NORMAL)
    rng = np.random.default_rng(9)
    twist = rng.normal(size=(40, 3)) * [1, 1, 10]
    force = law.gradient(twist)
    np.testing.assert_allclose(gauge(law, force), 1.0, rtol=1e-11)
    np.testing.assert_allclose(surface_along(law, 3.0 * force), force, rtol=1e-10, atol=1e-10 * V_0)
    # outward normal: no other point of the surface has a greater power on the twist
    assert np.all(force @ twist.T <= law.dissipation(twist) * (1 + 1e-12))


def test_curve_of_a_slanted_force():
    law = formulation_law("convex", A, B, FRICTION, NORMAL)
    curve = interaction_curve("convex", A, B, FRICTION, NORMAL, count=9, direction=(3.0, 4.0))
    for V, M in zip(curve.V[1:-1], curve.M_T[1:-1], strict=True):
        assert limit_load(law, (0.6, 0.8, M / V)).V == pytest.approx(V, rel=1e-11)


@pytest.mark.parametrize(("name", "at_4a", "at_4b"), [("ellipse", 0.094, 0.076), ("parabola", -0.052, -0.037)])
def test_errors_at_the_lab_sets(name, at_4a, at_4b):
    domain = approximate_domain(name, A, B, FRICTION, NORMAL)
    for (e, V), error in zip(EXACT.items(), (at_4a, at_4b), strict=True):
        assert domain.limit(e) / V - 1.0 == pytest.approx(error, abs=5.1e-4)
        assert domain.limit(-e) == domain.limit(e)


@cache
def along_rays(a, b, M_T0):
    """Eccentricities (m), and the exact limit of V at each."""
    law = formulation_law("convex", a, b, FRICTION, NORMAL)
    e = np.concatenate([[0.0], np.geomspace(1e-3, 1e3, 200) * M_T0 / V_0])
    return e, np.array([limit_load(law, (0.0, 1.0, value)).V for value in e])


@pytest.mark.parametrize("name", APPROXIMATIONS)
@pytest.mark.parametrize(("a", "b"), [(0.3, 0.2), (1.0, 0.1), (0.1, 1.0)])
def test_labels_hold_the_largest_error_along_rays(name, a, b):
    domain = approximate_domain(name, a, b, FRICTION, NORMAL)
    e, exact = along_rays(a, b, domain.M_T0)
    excess = domain.limit(e) / exact - 1.0
    assert excess.max() <= domain.unsafe + 1e-11
    assert -excess.min() <= domain.safe + 1e-5
    assert max(excess.max(), 0.0) == pytest.approx(domain.unsafe, abs=1e-4)
    assert max(-excess.min(), 0.0) == pytest.approx(domain.safe, abs=1e-4)
    assert domain.limit(np.inf) == 0.0
    if name in ("bi-linear", "three-linear"):
        assert domain.unsafe == 0.0
        assert 0.0 < domain.safe < 0.1
        assert len(domain.breakpoints) == (3 if name == "bi-linear" else 4)
        assert f"safe by {100 * domain.safe:.1f} %" in domain.label


@pytest.mark.parametrize("name", APPROXIMATIONS)
def test_approximate_curves_start_in_shear_and_end_in_torsion(name):
    domain = approximate_domain(name, A, B)
    v, m = domain.curve(41)
    assert (v[0], m[0]) == pytest.approx((1.0, 0.0), abs=1e-12)
    assert (v[-1], m[-1]) == pytest.approx((0.0, 1.0), abs=1e-12)
    inside = v[1:-1] > 1e-9
    e = m[1:-1][inside] / v[1:-1][inside] * domain.M_T0 / domain.V_0
    np.testing.assert_allclose(domain.limit(e), v[1:-1][inside] * domain.V_0, rtol=1e-12)
    if name == "ellipse":
        np.testing.assert_allclose(v**2 + m**2, 1.0, rtol=1e-14)
    if name == "parabola":
        np.testing.assert_allclose(m, 1.0 - v**2, atol=1e-14)


def test_three_pieces_are_closer_than_two():
    two, three = (approximate_domain(name, A, B) for name in ("bi-linear", "three-linear"))
    assert three.safe < 0.7 * two.safe


def test_unknown_or_empty_domains_are_refused():
    with pytest.raises(ScenarioError, match="is unknown"):
        approximate_domain("circle", A, B)
    with pytest.raises(ScenarioError, match="greater than 0"):
        interaction_curve("convex", A, B, 0.0, NORMAL)
    with pytest.raises(ScenarioError, match="direction"):
        interaction_curve("convex", A, B, 0.5, NORMAL, direction=(0, 0))
