"""Bonded, crushing and dilating joints on supports that move, against closed forms."""

import math

import pytest

from dembrick.runs.simulate import simulate
from dembrick.scenario.blocks import Block
from dembrick.scenario.controls import SettlementControl
from dembrick.scenario.model import JointLaw, JointOverride, Output, Scenario
from dembrick.scenario.time_functions import Turn
from helpers.stone_scenes import law, of_stone

G = 9.81
W, K = 3000.0, 1e8  # N, N/m


def beam(sinks, formulation, bond=500.0, **law) -> Scenario:
    """A block of 3000 N on three supports of 100 MN/m each, the middle one of which sinks; ``bond``: strength (N)."""
    width, depth = 0.2, 0.5
    area, height = width * depth, W / (2000.0 * G * 2.4 * depth)
    blocks = [Block("beam", "stone", box=(2.4, depth, height), position=(0.0, 0.0, 0.5 * height))]
    for name, x in (("left", -1.0), ("middle", 0.0), ("right", 1.0)):
        blocks.append(Block(name, "stone", box=(width, depth, 0.2), position=(x, 0.0, -0.1), fixed=True))
    own = {"cohesion": bond / area, "tensile_strength": bond / area} if bond else {}
    law = JointLaw(formulation, 0.6, K / area, 0.4 * K / area, **own, **law)
    control = SettlementControl(("middle",), (0.0, 0.0, -sinks), tolerance=1e-3)
    return of_stone(law, control, blocks, output=Output(("frames",)))


@pytest.mark.usefixtures("few")
@pytest.mark.parametrize("formulation", ["convex", "concave"])
def test_a_bonded_beam_hangs_its_middle_support_until_the_bond_breaks(formulation):
    """The middle support carries W / 3 - 2 k s / 3, down to minus the bond strength at s = (W + 3 f_t A) / (2 k); then
    both ends carry W / 2."""
    brink = (W + 3.0 * 500.0) / (2.0 * K)
    result = simulate(beam(1.1 * brink, formulation))
    rows, bonded = result.rows, result.frames["bond"]
    for s, load, (left, middle, right) in zip(
        rows["displacement"], -rows["load"], rows["reaction"][:, :, 2], strict=True
    ):
        held = s < brink
        assert middle == pytest.approx(W / 3.0 - 2.0 * K * s / 3.0 if held else 0.0, abs=1e-4 * W), s
        assert left == pytest.approx(right, abs=1e-4 * W)
        assert abs(load) == pytest.approx(abs(middle), abs=1e-9)
    assert rows["reaction"][:, 1, 2].min() == pytest.approx(-500.0, rel=5e-3)
    assert bonded[0].tolist() == [1.0, 1.0, 1.0] and bonded[-1].tolist() == [1.0, 0.0, 1.0]
    assert result.reactions["left"][2] == pytest.approx(0.5 * W, rel=1e-4)


def tower(formulation, control, friction=0.9, **law) -> Scenario:
    """A block of 0.2 x 0.4 x 1 m on a floor that turns."""
    floor = Block("floor", "stone", (1.0, 1.0, 0.2), (0.0, 0.0, -0.1), fixed=True)
    block = Block("block", "stone", (0.2, 0.4, 1.0), (0.0, 0.0, 0.5))
    law = JointLaw(formulation, friction, 1e10, 4e9, **law)
    return of_stone(law, control, (floor, block), output=Output(()))


def turning(angle):
    return SettlementControl(("floor",), rotation=Turn((0.0, 1.0, 0.0), angle, (0.0, 0.0, 0.0)), tolerance=1e-3)


@pytest.mark.parametrize("formulation, lever", [("convex", 1.0 / 6.0), ("concave", 0.5)])
def test_a_bonded_block_on_a_floor_that_turns(formulation, lever):
    """It overturns as its bond tears: W h sin th = (f_t A + W cos th) b / 6 for a linear stress, b / 2 for corners."""
    f_t, b, h, A = 6e3 if formulation == "concave" else 8e4, 0.2, 0.5, 0.08
    weight = 2000.0 * A * 2.0 * h * G
    law = {"cohesion": 1e6, "tensile_strength": f_t}
    result = simulate(tower(formulation, turning(60.0), friction=1.0, **law))
    low, high = 0.0, 1.5
    for _ in range(60):
        th = 0.5 * (low + high)
        torn = weight * h * math.sin(th) > (f_t * A + weight * math.cos(th)) * lever * b
        low, high = (low, th) if torn else (th, high)
    assert result.status == "collapse"
    assert result.collapse["settlement"] / math.hypot(0.5, 0.2) == pytest.approx(low, rel=3e-3)
    assert low > 1.15 * math.atan(0.2)  # a dry block overturns much earlier


@pytest.mark.parametrize("formulation", ["convex", "concave"])
def test_a_bonded_block_that_would_slide(formulation):
    """The block slides when c A + mu W cos th = W sin th. With corner points the upper pair slips first, by the elastic
    forces: its N is less by W sin th h / b."""
    A, weight = 0.08, 2000.0 * 0.08 * 0.4 * G
    floor = Block("floor", "stone", (1.0, 1.0, 0.2), (0.0, 0.0, -0.1), fixed=True)
    block = Block("block", "stone", (0.4, 0.2, 0.4), (0.0, 0.0, 0.2))
    control = turning(40.0)
    result = simulate(
        of_stone(law(formulation, 0.2, cohesion=1e3, tensile_strength=3e3), control, (floor, block), output=Output(()))
    )
    low, high = 0.0, 1.0
    for _ in range(60):
        th = 0.5 * (low + high)
        less = 0.0 if formulation == "convex" else 2.0 * weight * math.sin(th) * 0.2 / 0.4
        slides = weight * math.sin(th) > 1e3 * A + 0.2 * (weight * math.cos(th) - less)
        low, high = (low, th) if slides else (th, high)
    assert result.status == "collapse" and result.collapse["mechanism"] == "sliding"
    assert result.collapse["settlement"] / math.hypot(0.5, 0.2) == pytest.approx(low, rel=3e-3)


def test_a_toe_that_crushes_under_a_block_on_a_floor_that_turns():
    """Eight rows of points, two at the Gauss points of each quarter, carry at most f_c A / 8 each, filled from the toe
    on: W h sin th equals their moment about O."""
    f_c, rows, b, h, A = 1e5, 8, 0.2, 0.5, 0.08
    weight = 2000.0 * A * 2.0 * h * G
    arms = [middle + off for middle in (0.375, 0.125, -0.125, -0.375) for off in (0.125 / 3**0.5, -0.125 / 3**0.5)]

    def moment(N):
        found, left = 0.0, N
        for arm in arms:
            carried = min(left, f_c * A / rows)
            found, left = found + carried * b * arm, left - carried
        return found

    low, high = 0.0, 1.0
    for _ in range(60):
        th = 0.5 * (low + high)
        low, high = (low, th) if weight * h * math.sin(th) > moment(weight * math.cos(th)) else (th, high)
    result = simulate(tower("distributed", turning(20.0), points=(rows, 2), compressive_strength=f_c))
    assert result.status == "collapse"
    assert result.collapse["settlement"] / math.hypot(0.5, 0.2) == pytest.approx(low, rel=2.5e-3)
    assert low < 0.85 * math.atan(0.2)


@pytest.mark.usefixtures("few")
@pytest.mark.parametrize("formulation", ["concave", "convex", "distributed"])
@pytest.mark.parametrize("dilation", [pytest.param(0.1, marks=pytest.mark.slow), 0.3])
def test_a_block_that_is_pushed_over_a_joint_that_dilates(formulation, dilation):
    """Pushed by a smooth support that moves: V = mu W, and the block rises by tan psi of its slip."""
    floor = Block("floor", "stone", (2.0, 1.0, 0.2), (0.0, 0.0, -0.1), fixed=True)
    pusher = Block("pusher", "stone", (0.1, 0.2, 0.1), (-0.25, 0.0, 0.07), fixed=True)
    block = Block("block", "stone", (0.4, 0.3, 0.1), (0.0, 0.0, 0.05))
    points = {"points": (4, 3)} if formulation == "distributed" else {}
    law, smooth = (JointLaw(formulation, mu, 1e9, 4e8, dilation=d, **points) for mu, d in ((0.4, dilation), (0.0, 0.0)))
    control = SettlementControl(("pusher",), (0.002, 0.0, 0.0))
    own = (JointOverride(("pusher", "block"), smooth),)
    scenario = of_stone(law, control, (floor, pusher, block), joints=own, output=Output(("frames",)))
    result = simulate(scenario)
    weight, area = 2000.0 * 0.4 * 0.3 * 0.1 * G, 0.4 * 0.3
    assert result.status == "completed"
    assert -result.rows["load"][-1] == pytest.approx(0.4 * weight, rel=control.tolerance)
    moved = result.frames["displacement"][-1, -1]
    elastic = 0.4 * weight / (4e8 * area)  # elastic displacement, which lifts nothing
    assert moved[2] == pytest.approx(dilation * (moved[0] - elastic) - weight / (1e9 * area), rel=1e-3)
