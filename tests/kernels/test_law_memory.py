"""Laws remember the state at an equilibrium, and nothing of the swings towards it.

A joint of moving blocks swings and comes to rest; a joint of the searches reaches the same place in one implicit step
without dashpots. Both must have the same forces and the same memory.
"""

import numpy as np
import pytest

from dembrick.assembly.build import assemble
from dembrick.kernels.dynamics.law_memory import RESTED, SEARCHING
from dembrick.kernels.joint.ties import stretch
from dembrick.scenario.controls import StaticsControl
from dembrick.scenario.model import Block, JointLaw
from dembrick.scenario.ties import Tie, TieEnd
from dembrick.simulation.moving_ties import moving_ties
from tests.helpers import joints_of_engines as engines
from tests.helpers.custom_laws import COULOMB
from tests.helpers.plain_python import cases
from tests.helpers.stone_scenes import of_stone
from tests.kernels.test_custom_law import MovingCustom, StaticCustom

PRESSED = np.array([-2e-4, 0.0, 0.0])  # opening and tilts under which no corner opens in what follows
LAWS = {
    "dry": None,
    "cohesion": {"cohesion": 2e4, "residual_cohesion": 2e4},
    "crushing": {"crushing": 2.2e4},
    "dilation": {"dilation": 0.2},
}
MOVING = {"points": engines.MovingPoints, "area": engines.MovingArea, "custom": MovingCustom}
STATIC = {"points": engines.StaticPoints, "area": engines.StaticArea, "custom": StaticCustom}
CASES = [("custom", None), *((family, law) for family in ("points", "area") for law in LAWS)]
CASES.remove(("area", "crushing"))  # has no memory


def made(kinds, family, law):
    if family == "custom":
        return kinds[family](COULOMB)
    return kinds[family](law=LAWS[law])


def answer_as(joint, laws):
    """Switch the joint to the laws of swinging or of resting blocks."""
    joint.work.undamped[:] = float(laws == RESTED)
    joint.work.searching[:] = joint.work.keeping[:] = float(laws == SEARCHING)


def deformed(joint):
    """Crushed depth and rise, without the bond, which may break in a swing: its residual strength here is the same."""
    return joint.bonds[:, 1:] if len(joint.bonds) == 4 else joint.bonds[1:]


@pytest.mark.parametrize("family, law", CASES)
def test_a_joint_that_swings_keeps_what_it_would_without(family, law, monkeypatch):
    monkeypatch.setattr(engines, "VISCOUS", 0.0)  # dashpots of the searches; the moving joint's must not show
    rng, slid = np.random.default_rng(11), 0
    for _ in range(cases(12, 4)):
        still = made(STATIC, family, law)
        monkeypatch.setattr(engines, "VISCOUS", 0.3)
        moving = made(MOVING, family, law)
        monkeypatch.setattr(engines, "VISCOUS", 0.0)
        answer_as(moving, RESTED)
        for joint in (moving, still):
            joint.step(np.zeros(3), PRESSED, np.zeros(3))
        rests = PRESSED
        for _ in range(3):  # one equilibrium after another
            goal = PRESSED * (1.0 + rng.uniform(-0.15, 0.15)) + rng.uniform(-1.0, 1.0, 3) * (0.0, 1e-4, 1e-4)
            slip = rng.uniform(-1.0, 1.0, 3) * (6e-4, 6e-4, 4e-3)
            answer_as(moving, SEARCHING)
            place, gone = rests, np.zeros(3)
            for share in (0.6, 1.5, 0.5, 1.2, 1.0):
                next_place, next_gone = rests + share * (goal - rests), share * slip
                moving.step(place, next_place - place, next_gone - gone)
                place, gone = next_place, next_gone
            answer_as(moving, RESTED)
            found = moving.step(place, np.zeros(3), np.zeros(3))
            force = still.step(rests, goal - rests, slip)
            rests = goal
            np.testing.assert_allclose(found, force, rtol=1e-8, atol=1e-8 * np.abs(force).max())
            np.testing.assert_allclose(moving.memory, still.memory, rtol=1e-8, atol=1e-8 * np.abs(force).max())
            np.testing.assert_allclose(moving.slip, still.slip, rtol=1e-8, atol=1e-14)
            if LAWS.get(law):
                np.testing.assert_allclose(deformed(moving), deformed(still), rtol=1e-8, atol=1e-14)
        slid += np.max(still.slip) > 0.0
    assert slid > cases(9, 2)


@pytest.mark.parametrize("most", [0.0, 1.0])
def test_a_tie_that_swings_yields_by_no_more_than_it_rests_beyond(most):
    """It swings to twice the elongation at yield, and rests ``most`` times half of that beyond it."""
    ends = TieEnd("lower", (0.05, 0.0, -0.1)), TieEnd("upper", (0.05, 0.0, 0.1))
    scene = of_stone(
        JointLaw("concave", 0.6, 1e9, 4e8), StaticsControl(), (
            Block("lower", "stone", (0.3, 0.2, 0.1), (0.0, 0.0, -0.05), fixed=True),
            Block("upper", "stone", (0.3, 0.2, 0.1), (0.0, 0.0, 0.05)),
        ), ties=(Tie(ends, 1e5, strength=100.0),),
    )  # fmt: skip
    assembly = assemble(scene)
    ties, limit = moving_ties(assembly.ties, assembly.position, assembly.rotation), 100.0 / 1e5
    rests = limit * (1.0 + 0.5 * most)
    for elongation in (0.5 * limit, 2.0 * limit, 0.8 * limit, rests):
        stretch(ties, 0, True, 0.0, 0.0, 0.2 + elongation)
        assert ties.now[0].yielded == 0.0 and ties.now[0].tension == pytest.approx(min(1e5 * elongation, 100.0))
    stretch(ties, 0, False, 0.0, 0.0, 0.2 + rests)
    assert ties.now[0].yielded == pytest.approx(rests - limit, abs=1e-15) and ties.now[0].tension == pytest.approx(
        100.0
    )
