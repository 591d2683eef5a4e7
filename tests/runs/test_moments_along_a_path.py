"""Unbalanced moments and blocks that rotate in place: equilibria in the deformed geometry and real time.

By hand: a flat block under a couple turns at M_T0 (concave: mu N times the half diagonal; convex: the integral over its
rectangle), is lifted off at its weight, and is crushed at its strength times its area.
"""

import math

import numpy as np
import pytest

from dembrick.runs.simulate import simulate
from dembrick.scenario import toml
from helpers.key_lines import words
from helpers.paper_equations import torsion_strength_convex
from helpers.scenario_text import block, header

MU, A, B, H = 0.5, 0.4, 0.2, 0.1
WEIGHT = A * B * H * 2000.0 * 9.81


def actuated(point, direction):
    return f'[[actuators]]\nname = "jack"\nblock = "block"\npoint = {point}\ndirection = {direction}\n'


def couple():
    """Two jacks whose multiplier V is the moment (N m)."""
    return "".join(
        actuated([x, 0.0, 0.5 * H], [0.0, math.copysign(1.0, x), 0.0]).replace("jack", name) + "weight = 5.0\n"
        for name, x in (("one", 0.1), ("two", -0.1))
    )


def scenario(control, loads, formulation="convex", own="", law=""):
    floor = block("floor", (0.0, 0.0, -0.1), (2.0, 2.0, 0.2), "fixed = true")
    text = header(formulation, MU, 1e9, keys=law) + floor + block("block", (0.0, 0.0, 0.5 * H), (A, B, H), own)
    return toml.loads(f"{text}{loads}[control]\n{control}", "couple.toml")


def search(*arguments, large=True, **options):
    large = str(large).lower()
    return simulate(scenario(f'kind = "yield"\nlarge_displacements = {large}\n', *arguments, **options))


STRENGTH = {"concave": MU * WEIGHT * 0.5 * math.hypot(A, B), "convex": torsion_strength_convex(A, B, MU * WEIGHT)}


@pytest.mark.parametrize("held", ["", 'held = ["x", "y"]\n'])
@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_a_couple_turns_a_block_at_its_torsion_strength(formulation, held):
    """Beyond it the arms of the jacks shorten, V = M_T0 / cos th, and the block reaches another equilibrium. A rotation
    over 1.3 deg, at which a corner has moved by a twentieth of the height, counts as a jump, and it may have turned as
    much before. The centroid stays."""
    result = search(couple(), formulation, held)
    point = result.yield_point
    assert point.V_lower * math.cos(math.radians(2.6)) <= STRENGTH[formulation] <= point.V_upper
    assert point.V_upper - point.V_lower < 3e-3 * point.V
    assert point.mechanism == "torsion" and result.collapse is None
    assert result.run.collapse["blocks"] == ["block"]
    assert "moved block by " in words(result.text()) and " deg (up to the limit" in result.text()


@pytest.mark.parametrize("large", [False, True])
@pytest.mark.parametrize(
    "direction, law, load, mechanism",
    [(1.0, "", WEIGHT, "uplift"), (-1.0, "compressive_strength = 1e5\n", 1e5 * A * B - WEIGHT, "crushing")],
)
def test_what_is_pulled_up_and_what_is_pressed_down(direction, law, load, mechanism, large):
    jack = actuated([0.0, 0.0, H], [0.0, 0.0, direction])
    point = search(jack, "distributed", law=law + "points = [4, 4]\n", large=large).yield_point
    assert point.V == pytest.approx(load, rel=2e-3) and point.mechanism == mechanism


@pytest.mark.parametrize("part", [0.5, 2.0])
def test_the_out_of_balance_of_a_row_counts_moments(part):
    """For a couple on a block: the part that friction does not balance, as a force at the reach of the block."""
    moment = part * STRENGTH["concave"]
    loads = "".join(
        f'[[loads]]\nblock = "block"\npoint = [{x}, 0.0, {0.5 * H}]\nforce = [0.0, {force}, 0.0]\n'
        for x, force in ((0.1, 5.0 * moment), (-0.1, -5.0 * moment))
    )
    ratio = simulate(scenario('kind = "dynamic"\nduration = 5e-3\n', loads, "concave")).rows["unbalanced"][-1]
    reach = 0.5 * np.linalg.norm([A, B, H])
    turning = max(0.0, moment - STRENGTH["concave"]) / reach
    assert ratio == pytest.approx(turning / WEIGHT, rel=2e-3, abs=1e-3)
