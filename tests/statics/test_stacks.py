"""Limit loads of stacks and of rocking blocks, against statics and the theory of one joint."""

from __future__ import annotations

import re

import numpy as np
import pytest

from dembrick import theory
from dembrick.assembly import build
from dembrick.errors import NotConvergedError
from dembrick.geometry import polygons
from dembrick.scenario.model import Actuator, Block, Load, Material, YieldControl
from dembrick.simulation.statics import limit_load
from dembrick.simulation.statics.paths import path_following
from helpers.stone_scenes import law, of_stone

A, B, H, MU = 0.3, 0.2, 0.1, 0.64
WEIGHT = 1500.0 * A * B * H * 9.81


def tower(count: int, formulation: str, pushed: int, e=0.075, top=400.0, friction=MU, up=0.0, tolerance=1e-3):
    """Limit load of a tower of ``count`` blocks, pushed along y at the foot of block ``pushed`` (``up`` m above it)."""
    blocks = [Block("base", "stone", (A, B, H), (0.0, 0.0, -0.5 * H), fixed=True)]
    blocks += [Block(f"b{i}", "stone", (A, B, H), (0.0, 0.0, (i + 0.5) * H)) for i in range(count)]
    scenario = of_stone(
        law(formulation, friction),
        YieldControl(tolerance),
        blocks,
        materials={"stone": Material(1500.0)},
        loads=(Load(f"b{count - 1}", (0.0, 0.0, -top)),),
        actuators=(Actuator("jack", f"b{pushed}", (e, 0.0, pushed * H + up), (0.0, 1.0, 0.0)),),
    )
    return limit_load.find_limit_load(build.assemble(scenario), tolerance).yield_point


def of_joint(formulation: str, normal: float, e: float = 0.075) -> float:
    return theory.limit_load(theory.formulation_law(formulation, A, B, MU, normal), (0.0, 1.0, e)).V


@pytest.mark.parametrize("formulation", ["concave", "corrected-shear", "convex"])
def test_the_upper_of_two_blocks_slides_alone(formulation):
    point = tower(2, formulation, pushed=1)
    assert point.V == pytest.approx(of_joint(formulation, 400.0 + WEIGHT), rel=1e-3)
    assert point.bracket == "indicator" and point.joint == ("b0", "b1")


@pytest.mark.parametrize("formulation", ["concave", "convex"])
@pytest.mark.parametrize("count", [2, 5])
def test_a_block_pushed_at_its_foot_takes_the_tower_along(formulation, count):
    point = tower(count, formulation, pushed=0)
    assert point.V == pytest.approx(of_joint(formulation, 400.0 + count * WEIGHT), rel=1e-3)
    assert point.joint == ("base", "b0")


def test_a_tower_pushed_high_up_overturns():
    point = tower(5, "concave", pushed=4)
    assert point.V == pytest.approx((400.0 + 5 * WEIGHT) * 0.5 * B / (4 * H), rel=1e-3)
    assert point.mechanism == "rocking"


@pytest.mark.parametrize("formulation", ["concave", "corrected-shear"])
@pytest.mark.parametrize("e", [0.0, 0.05])
def test_a_block_with_much_friction_overturns(formulation, e):
    point = tower(1, formulation, 0, e=e, friction=2.0, up=H)
    assert point.V == pytest.approx((400.0 + WEIGHT) * 0.5 * B / H, rel=1e-3)
    assert point.mechanism == "rocking" and point.torsion_centre is None


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-6])
def test_a_convex_joint_turns_about_the_strip_that_it_presses(tolerance):
    """The strip in contact narrows without end, and V grows with it: the bracket holds the remaining shortfall."""
    rigid = (400.0 + WEIGHT) * 0.5 * B / H
    point = tower(1, "convex", 0, e=0.0, friction=2.0, up=H, tolerance=tolerance)
    assert point.V_lower < rigid < point.V_upper and point.half_width <= tolerance * point.V
    assert point.V == pytest.approx(rigid, rel=tolerance) and point.mechanism == "rocking"


def weakest(formulation: str, count: int, top: float, e: float) -> float:
    """Limit load of a tower whose uppermost block is pushed at its foot, by statics.

    Either that block slides, or a joint below overturns: under that bending its torsion strength is still large enough.
    """
    lever = 0.5 * B
    if formulation == "corrected":
        lever *= float(polygons.shrink_factor(np.array([[-A, -B], [A, -B], [A, B], [-A, B]]) / 2))
    overturning = ((top + below * WEIGHT) * lever / ((below - 1) * H) for below in range(2, count + 1))
    return min(of_joint(formulation, top + WEIGHT, e), *overturning)


@pytest.mark.parametrize("formulation", ["concave", "corrected", "corrected-shear", "convex"])
@pytest.mark.parametrize("count, top", [(2, 0.0), *((n, t) for n in (5, 10, 20, 50, 100, 200) for t in (0.0, 2000.0))])
def test_towers_of_any_height(formulation, count, top):
    """The search follows the equilibrium, so that the long elastic displacement of a tower costs nothing."""
    expected = weakest(formulation, count, top, 0.075)
    point = tower(count, formulation, pushed=count - 1, top=top)
    assert point.V == pytest.approx(expected, rel=1e-3)
    assert point.half_width <= 1e-3 * point.V
    assert point.mechanism == ("rocking" if top else "torsion-shear")


@pytest.mark.parametrize("formulation", ["convex", "corrected-shear"])
@pytest.mark.parametrize("count, top, e", [(2, 0.0, 0.075), (20, 0.0, 0.12), (5, 2000.0, 0.0), (20, 2000.0, 0.075)])
def test_towers_meet_their_closed_form(formulation, count, top, e):
    """Torsion with shear by the exact limit surface, and overturning, to 1e-5."""
    expected = weakest(formulation, count, top, e)
    point = tower(count, formulation, pushed=count - 1, top=top, e=e, tolerance=1e-5)
    assert point.V == pytest.approx(expected, rel=3e-6)
    assert point.half_width <= 1e-5 * point.V
    assert point.mechanism == ("rocking" if top else "torsion-shear")


@pytest.mark.parametrize("steps", [0.1, 0.5, 3.0, 100.0])
def test_any_first_step_will_do(steps, monkeypatch):
    """Even one far beyond the limit, or one that falls short of it with joints that have opened."""
    monkeypatch.setattr(path_following, "ELASTIC_STEPS", steps)
    for formulation in ("concave", "convex"):
        for top in (0.0, 2000.0):
            point = tower(30, formulation, pushed=29, top=top)
            assert point.V == pytest.approx(weakest(formulation, 30, top, 0.075), rel=1e-3)


def test_the_lower_of_two_blocks_slides_under_its_bending():
    point = tower(2, "concave", pushed=1, top=2000.0)
    formula = theory.rectangle_formulation("concave", A, B, MU)
    expected = theory.limit_load_at_height(formula, 2000.0 + 2 * WEIGHT, (0.0, 1.0, 0.075), height=H).V
    assert point.V == pytest.approx(expected, rel=5e-4) and point.joint == ("base", "b0")


def test_what_does_not_end_says_so(monkeypatch):
    monkeypatch.setattr(path_following, "MOST_EQUILIBRIA", 10)
    with pytest.raises(NotConvergedError, match="not bracketed within 0.001 after .* steps") as caught:
        tower(5, "concave", pushed=4)
    rocking = (400.0 + 5 * WEIGHT) * 0.5 * B / (4 * H)
    point, said = caught.value.yield_point, str(caught.value)
    least, most = map(float, re.findall(r"at least (.*) N, and at most (.*) N\.", said)[0])
    assert most == pytest.approx(rocking, rel=1e-5)
    assert point.bracket == "open" and 0.1 * rocking < least == pytest.approx(point.V_peak, rel=1e-5)
    assert "large_displacements" in said
