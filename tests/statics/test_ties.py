"""Ties: springs between two blocks that yield, in limit analysis and in searches."""

from dataclasses import replace

import numpy as np
import pytest

from dembrick.assembly.build import assemble
from dembrick.errors import ScenarioError
from dembrick.runs.limit import limit
from dembrick.runs.simulate import simulate
from dembrick.scenario import toml
from dembrick.scenario.controls import PushoverControl, StaticsControl, TiltControl, YieldControl
from dembrick.scenario.generators import Arch
from dembrick.scenario.model import Actuator, Block, JointLaw, Load, Material, Scenario
from dembrick.scenario.ties import Tie, TieEnd
from helpers.places import tool_module
from helpers.scenario_text import BASE, refused
from helpers.stone_scenes import law, of_stone

drawn = tool_module("drawn_ties")
MU, N = 0.64, 467.0
STEEP = "stiffness = 1e6\n"


def tie(first, second, stiffness=1e8, **more):
    return Tie((TieEnd(*first), TieEnd(*second)), stiffness, **more)


def bed(*ties, formulation="convex", **more):
    """The lab joint under 467 N, pushed in its plane at O."""
    boxes = Block("lower", "tuff", (0.3, 0.2, 0.1), (0.0, 0.0, -0.05), fixed=True)
    return Scenario(
        **({"control": YieldControl(1e-4)} | more),
        title="tied bed",
        gravity=(0.0, 0.0, -9.81),
        joint=JointLaw(formulation, MU, 1e10, 4e9),
        materials={"tuff": Material(1500.0)},
        blocks=(boxes, Block("upper", "tuff", (0.3, 0.2, 0.1), (0.0, 0.0, 0.05))),
        loads=(Load("upper", (0.0, 0.0, -378.71)),),
        actuators=(Actuator("jack", "upper", (0.0, 0.0, 0.0), (0.0, 1.0, 0.0)),),
        ties=ties,
    )


def across(stiffness=1e3, **more):
    return tie(("lower", (0.0, 0.0, -0.1)), ("upper", (0.0, 0.0, 0.1)), stiffness, **more)


def arch(ends=None, strength=None, control=None, **more):
    """A semicircle of 20 stones with t/R = 0.2, pushed along x, its stones k and 21 - k tied at their centroids."""
    given = of_stone(
        law("concave", 0.7, 1e11),
        control or PushoverControl((1.0, 0.0, 0.0)),
        arches=(Arch("arch", "stone", 1.5, 0.3, 0.5, 20, 180.0),),
    )
    if ends is None:
        return given
    built = assemble(given)
    place = dict(zip(built.names, built.position, strict=True))
    names = f"arch.{ends}", f"arch.{21 - ends}"
    return replace(given, ties=(tie(*((name, tuple(place[name])) for name in names), strength=strength, **more),))


ARCH = {  # strength of the tie (N) -> multiplier of the weight, by an independent linear programme
    3: {500.0: 0.3192831, 1000.0: 0.3450906, 2000.0: 0.3749465, None: 0.3938275},
    4: {500.0: 0.3292318, 1000.0: 0.3559986, 2000.0: 0.3892269, None: 0.3938275},
    5: {500.0: 0.3379997, 1000.0: 0.3659029, 2000.0: 0.3938275, None: 0.3938275},
}


def test_the_limit_of_a_tied_arch():
    assert limit(arch()).load_factor == pytest.approx(0.2856458, abs=2e-7)
    for ends, expected in ARCH.items():
        for strength, factor in expected.items():
            found = limit(arch(ends, strength))
            assert found.lower - 2e-7 <= factor <= found.upper + 2e-7
            (one,) = found.as_dict()["ties"]
            assert one["between"] == [f"arch.{ends}", f"arch.{21 - ends}"]
            if factor < 0.3938:
                assert one["tension"] == pytest.approx(strength, rel=1e-5)


def test_a_push_of_a_tied_arch_stays_below_its_limit_analysis_and_above_no_tie():
    """The path of equilibria shows the contribution of a ductile tie that has to stretch."""
    bare = simulate(arch(), record=False).yield_point.V
    tied = simulate(arch(4, 1000.0), record=True)
    assert bare == pytest.approx(0.2856458, rel=2e-3)
    assert bare < tied.yield_point.V <= ARCH[4][1000.0] * (1.0 + 1e-4)
    assert tied.yield_point.V == pytest.approx(ARCH[4][1000.0], rel=1e-3)
    (one,) = tied.as_dict()["ties"]
    assert one["tension"] == pytest.approx(1000.0, rel=1e-9) and one["yielded"] > 0.0
    energy = tied.rows["energy"]
    left = sum(values for name, values in energy.items() if name != "external") - energy["external"]
    assert np.abs(left).max() < 3e-3 * np.abs(energy["external"]).max()
    strong = simulate(arch(4), record=False)
    assert strong.yield_point.V == pytest.approx(0.3938275, rel=1e-3)
    assert strong.as_dict()["ties"][0]["tension"] == pytest.approx(2205.98, rel=1e-3)


def test_more_prestress_than_needed_is_not_more_strength():
    """A cable so soft that it carries 4000 N whatever the arch does: .3399844, below .3938275."""
    found = simulate(arch(4, prestress=4000.0, stiffness=1.0), record=False)
    assert found.yield_point.V == pytest.approx(0.3399844, rel=1e-3)


@pytest.mark.parametrize("formulation", ["convex", "concave"])
def test_prestress_across_a_bed_adds_to_its_friction(formulation):
    """V = mu (N + T); the tie compresses the joint, and loses k times that displacement."""
    soft = simulate(bed(across(prestress=300.0), formulation=formulation))
    assert soft.yield_point.V == pytest.approx(MU * (N + 300.0), rel=1e-4)
    stiff = simulate(bed(across(1e7, prestress=300.0), formulation=formulation))
    K = 1e10 * 0.06
    shortened = (N + 300.0) / (K + 1e7)
    T = 300.0 - 1e7 * shortened
    (one,) = stiff.as_dict()["ties"]
    assert one["tension"] == pytest.approx(T, rel=1e-6)
    assert stiff.yield_point.V == pytest.approx(MU * (N + T), rel=1e-4)
    assert stiff.as_dict()["reactions"]["lower"][2] == pytest.approx(N, rel=1e-6)  # joint and tie together
    found = limit(bed(across(strength=300.0), formulation=formulation))  # up to its strength
    assert found.load_factor == pytest.approx(MU * (N + 300.0), rel=1e-6)


def test_a_tie_that_would_push_is_slack_and_a_bar_is_not():
    """Under its weight the bed shortens: a tie is slack, a bar carries its share, one that yields its strength."""
    K, k = 1e10 * 0.06, 1e8
    slack, bar, weak = (
        simulate(bed(across(k, **more), control=StaticsControl())).as_dict()["ties"][0]
        for more in ({}, {"tension_only": False}, {"tension_only": False, "strength": 20.0})
    )
    assert slack["tension"] == 0.0 and slack["yielded"] == 0.0
    assert bar["tension"] == pytest.approx(-N * k / (K + k), rel=1e-9)
    assert weak["tension"] == pytest.approx(-20.0, rel=1e-9)
    assert weak["yielded"] == pytest.approx(-(N - 20.0) / K + 20.0 / k, rel=1e-6)


def test_a_tie_holds_a_block_up_a_slope_that_is_too_steep():
    """The tie carries at least T = W (sin a - mu cos a); without it the block slides."""
    steep = replace(bed(), gravity=(0.0, 9.81 * np.sin(0.8), -9.81 * np.cos(0.8)), loads=(), control=StaticsControl(),
                    actuators=())  # fmt: skip
    assert simulate(steep).status == "falls"
    held = tie(("lower", (0.0, -0.1, 0.0)), ("upper", (0.0, 0.1, 0.0)))
    found = simulate(replace(steep, ties=(held,)))
    assert found.status == "stands"
    weight = 1500.0 * 0.006 * 9.81
    assert found.as_dict()["ties"][0]["tension"] >= weight * (np.sin(0.8) - MU * np.cos(0.8)) * (1.0 - 1e-9)


@pytest.mark.parametrize("formulation", ["convex", "concave"])
@pytest.mark.parametrize("stiffness, prestress", [(1e5, 0.0), (1e5, 30.0), (1e7, 30.0)])
def test_no_limit_before_a_tie_that_slip_stretches_yields(formulation, stiffness, prestress):
    """V = mu (N + T sin a) + T cos a with T the strength of the tie, however soft it is."""
    strength = 60.0
    held = tie(("lower", (0.0, -0.1, -0.1)), ("upper", (0.0, 0.1, 0.1)), stiffness, strength=strength,
               prestress=prestress)  # fmt: skip
    found = simulate(bed(held, formulation=formulation), record=False).yield_point
    along = np.array([0.0, 0.2, 0.2]) / np.hypot(0.2, 0.2)
    expected = MU * (N + strength * along[2]) + strength * along[1]
    assert found.V == pytest.approx(expected, rel=1e-4)
    assert found.V_lower - 1e-4 * expected <= expected <= found.V_upper + 1e-4 * expected


@pytest.mark.parametrize("formulation", ["convex", "concave"])
def test_no_limit_before_a_cable_that_slip_lets_go_is_slack(formulation):
    """Pulled towards its anchor by 30 N, the block begins to slide at mu N - 30 and then slides at mu N."""
    held = tie(("lower", (0.0, 0.1, 0.0)), ("upper", (0.0, -0.1, 0.0)), 1e4, prestress=30.0)
    found = simulate(bed(held, formulation=formulation), record=False).yield_point
    assert found.V == pytest.approx(MU * N, rel=1e-4)


def test_a_tilt_by_search_refuses_ties_that_know_a_scale_of_force():
    """W sin a = mu W cos a + T; divided by the cosine, T would grow with the angle."""
    weight = 1500.0 * 0.006 * 9.81
    table = bed(control=TiltControl((-1.0, 0.0, 0.0)))
    table = replace(table, gravity=(0.0, 0.0, -9.81), loads=(), actuators=())
    held = tie(("lower", (0.0, -0.1, 0.0)), ("upper", (0.0, 0.1, 0.0)), strength=20.0)
    with pytest.raises(ScenarioError, match="tilt.*ties that yield"):
        simulate(replace(table, ties=(held,)), record=False)
    found = limit(replace(table, ties=(held,)))
    angle = np.arctan(MU) + np.arcsin(20.0 / weight / np.hypot(1.0, MU))
    assert found.load_factor == pytest.approx(np.tan(angle), rel=1e-5)


def test_drawn_ties_lie_in_their_brackets():
    for number in (n for n in range(20) if not drawn.CONTROLS[n % 6].endswith("large")):  # those take seconds each
        what, numbers = drawn.judged(drawn.drawn(np.random.default_rng([5, number]), number))
        assert what in ("inside", "refused"), (number, numbers)


TIE = '[[ties]]\nbetween = [{ block = "lower", point = [0, 0, -0.1] }, { block = "upper", point = [0, 0, 0.1] }]\n'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (TIE.replace("upper", "lower") + STEEP, ["lies inside one block"]),
        (TIE + STEEP + "strength = -1.0\n", ["strength", "greater than 0 N"]),
        (TIE + "stiffness = 0.0\n", ["stiffness", "greater than 0 N/m"]),
        (TIE, ["missing key 'stiffness'"]),
        (TIE + STEEP + "prestress = -5.0\n", ["prestress", "takes tension only"]),
        (TIE + STEEP + "prestress = 5.0\nstrength = 4.0\n", ["prestress", "yields at its strength of 4 N"]),
        (TIE.replace("upper", "uper") + STEEP, ["block of tie number 1", "'uper'", "upper"]),
        (TIE.replace("0.1] }]", "-0.1] }]") + STEEP, ["at one point"]),
        ('[[ties]]\nbetween = [{ block = "lower", point = [0, 0, -0.1] }]\n' + STEEP, ["a tie has two ends"]),
        (TIE + STEEP + "tension = true\n", ["unknown key 'tension'"]),
    ],
)
def test_ties_that_cannot_be_are_refused(text, words):
    refused(BASE + text, *words)


def test_a_tie_outside_its_block_is_refused():
    with pytest.raises(ScenarioError, match="tie number 1.*outside block 'upper'"):
        assemble(toml.loads(BASE + TIE.replace("0.1] }]", "0.3] }]") + STEEP))
    with pytest.raises(
        ScenarioError, match=r"outside block 'upper', in 'lower'; .* whose centroid is at \(0, 0, 0\.05\)"
    ):
        assemble(toml.loads(BASE + TIE.replace("0.1] }]", "-0.02] }]") + STEEP))


def test_ties_are_written_as_they_are_read():
    text = BASE + TIE + STEEP + "strength = 100.0\nprestress = 20.0\ntension_only = false\n"
    given = toml.loads(text)
    assert toml.loads(toml.dumps(given)).ties == given.ties
    assert given.ties[0].strength == 100.0 and not given.ties[0].tension_only


@pytest.mark.parametrize("part", [1.0, 0.5])
def test_a_tie_may_carry_the_whole_weight(part):
    """A block whose weight the pre-stress carries stands, and its joint carries the rest of the weight: nothing."""
    weight = 0.3 * 0.2 * 0.1 * 1500.0 * 9.81
    held = tie(("upper", (0.0, 0.0, 0.1)), ("beam", (0.0, 0.0, 0.5)), 1.0, prestress=part * weight)
    beam = Block("beam", "tuff", (0.3, 0.2, 0.1), (0.0, 0.0, 0.55), fixed=True)
    scenario = replace(bed(formulation="concave", control=StaticsControl()), loads=(), actuators=())
    found = simulate(replace(scenario, blocks=(*scenario.blocks, beam), ties=(held,)))
    assert found.run.rest.stands
    pressing = np.linalg.norm(found.run.state.joints.resultant[0, :3])
    assert pressing == pytest.approx((1.0 - part) * weight, abs=1e-6 * weight)
