"""The paper's formulas with cohesion: V_0 = c A + mu N. Joint 0.3 x 0.2 m, N = 467 N, friction 0.64, c = 10 kPa."""

import numpy as np
import pytest

from dembrick import theory
from dembrick.errors import ScenarioError
from helpers import paper_equations as equations

A, B, MU, N, C = 0.3, 0.2, 0.64, 467.0, 1e4
TORSION, SHEAR = (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)
FORCE_A, FORCE_B = (0.0, 1.0, 0.25 * A), (0.0, 1.0, 0.45 * A)


@pytest.mark.parametrize(
    "name, load, expected",
    [
        ("convex", SHEAR, 898.88),
        ("concave", SHEAR, 898.88),
        ("corrected", SHEAR, 898.88),
        ("convex", TORSION, 87.021121),
        ("concave", TORSION, 162.047897),
        ("corrected", TORSION, 87.021121),
        ("convex", FORCE_A, 649.7841),
        ("convex", FORCE_B, 486.9210),
        ("concave", FORCE_A, 765.6174),
        ("concave", FORCE_B, 638.3386),
        ("corrected", FORCE_A, 629.5826),
        ("corrected-shear", FORCE_B, 465.6358),
    ],
)
def test_ductile_joints(name, load, expected):
    law = theory.formulation_law(name, A, B, MU, N, C)
    assert theory.limit_load(law, load).V == pytest.approx(expected, rel=2e-7)


@pytest.mark.parametrize("e, expected", [(0.25, 757.8980), (0.45, 627.1268)])
def test_the_load_at_mid_height(e, expected):
    joint = theory.rectangle_formulation("concave", A, B, MU, C)
    found = theory.limit_load_at_height(joint, N, (0.0, 1.0, e * A), height=0.05)
    assert found.V == pytest.approx(expected, rel=2e-7)
    assert theory.closed_until(joint, N, (0.0, 0.0), (0.0, 0.05)) > expected  # no corner opens below that load


def test_the_surface_of_a_convex_joint_is_scaled():
    """By (c A + mu N) / (mu N) = 3.007495; equations (1) to (8) are scaled likewise with that V_0."""
    dry, bonded = (theory.interaction_curve("convex", A, B, MU, N, c, count=9) for c in (0.0, C))
    factor = (C * A * B + MU * N) / (MU * N)
    assert factor == pytest.approx(3.007495, rel=1e-6)
    np.testing.assert_allclose(bonded.V, factor * dry.V, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(bonded.M_T, factor * dry.M_T, rtol=1e-12)
    V_0 = C * A * B + MU * N
    assert equations.torsion_strength_convex(A, B, V_0) == pytest.approx(bonded.M_T0, rel=1e-12)


def test_what_has_no_theory_is_refused():
    with pytest.raises(ScenarioError, match="do not scale"):
        theory.polygon_formulation([[0, 0], [1, 0], [0, 1]], MU, "linear", C)
    with pytest.raises(ScenarioError, match="cohesion = -1.0"):
        theory.rectangle_formulation("convex", A, B, MU, -1.0)
