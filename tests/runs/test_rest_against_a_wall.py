"""Columns that dead loads lean against a wall drawn at a small distance.

A load F at half the height leans a column on corner points, and the wall exerts R at its top. So the bed carries a
shear V = F - R and a couple k_n A b2 / 4 th at the lean th. The edge of the column penetrates the wall as a wedge, with
R = k_n D s2 / 2 th.
"""

import math

import pytest

from dembrick.errors import NotConvergedError
from dembrick.runs.simulate import simulate
from dembrick.scenario import toml
from helpers.scenario_text import block, header, jack

B, D, HEIGHT, STIFFNESS = 0.1, 0.2, 1.0, 1e8  # m and Pa/m
WEIGHT = 2000.0 * 9.81 * B * D * HEIGHT
PUSH = 0.04 * WEIGHT
STATICS = 'kind = "statics"\nlarge_displacements = true\n'
DRIVEN = 'kind = "displacement"\nlarge_displacements = true\ntravel = 1e-6\n'
IN_TIME = 'kind = "dynamic"\nduration = 0.05\n'


def leaning(control, gap, before="", formulation="concave"):
    points = "points = [3, 2]\n" if formulation == "distributed" else ""
    text = header(formulation, 0.6, STIFFNESS, keys=points)
    text += block("base", (0.0, 0.0, -0.05), (2.0, 1.0, 0.1), "fixed = true")
    text += block("column", (0.0, 0.0, 0.5 * HEIGHT), (B, D, HEIGHT))
    text += block("wall", (B + gap, 0.0, 0.5 * HEIGHT), (B, D, HEIGHT), "fixed = true")
    text += f'[[loads]]\nblock = "column"\nforce = [{PUSH}, 0.0, 0.0]\n'
    if 'displacement"' in control:
        text += jack("column", (0.0, 0.0, 0.1), (-1.0, 0.0, 0.0), more="stages = [2]" if before else "")
    return simulate(toml.loads(f"{text}{before}[control]\n{control}"), record=False)


@pytest.mark.parametrize("gap", [1e-4, 3e-4, 1e-3])
def test_the_wall_takes_what_the_bed_does_not(gap):
    """V is F / 2 or more. The column was once found at rest inside the wall, which carried nothing: V was F."""
    found = leaning(STATICS, gap)
    state = found.run.motion.state
    lean = float(state.bodies.rotation[1, 0, 2])
    couple = (STIFFNESS * B * D * B**2 / 4.0 - 0.5 * WEIGHT * HEIGHT) * lean
    assert found.status == "stands"
    shear = -float(state.links.wrench[0, 0])
    assert shear == pytest.approx(0.5 * PUSH + couple / HEIGHT, rel=0.03)
    sunk = float(found.motion.displacement[1, 0]) + 0.5 * HEIGHT * lean - gap
    assert sunk == pytest.approx(math.sqrt(2.0 * (PUSH - shear) * lean / (STIFFNESS * D)), rel=0.1)


@pytest.mark.parametrize("gap", [1e-4, 1e-3])
def test_points_that_would_let_it_fall_stand_against_the_wall(gap):
    assert leaning(STATICS, gap, formulation="distributed").status == "stands"


@pytest.mark.parametrize("control", [DRIVEN, IN_TIME], ids=["driven", "in time"])
def test_what_begins_without_a_look_is_refused_with_a_remedy(control):
    with pytest.raises(NotConvergedError, match="overlap at equilibrium: put a stage of kind"):
        leaning(control, 1e-4)
    found = leaning(control, 1e-4, f"[[stages]]\n{STATICS}")
    assert float(found.run.motion.state.links.wrench[0, 2]) == pytest.approx(WEIGHT, rel=0.02)
