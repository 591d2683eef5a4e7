"""Ties in moving geometry: runs in real time, settlements and constant-rate tests against closed forms."""

import dataclasses
import math

import numpy as np
import pytest

from dembrick import history
from dembrick.errors import NotConvergedError
from dembrick.runs.simulate import restart, simulate
from dembrick.scenario.blocks import Block
from dembrick.scenario.controls import DisplacementControl, DynamicControl, SettlementControl, StaticsControl
from dembrick.scenario.model import Actuator, Load, Material, Output, Scenario
from dembrick.scenario.ties import Tie, TieEnd
from dembrick.views import export
from dembrick.views.motion.blocks import Poses
from dembrick.views.render.loads import DrawnTies
from helpers.key_lines import words
from helpers.restart_cases import check_same, stop_at_look
from helpers.stone_scenes import law, of_stone

G = 9.81
MASS = 12.0  # kg, of the block
K = 1e5  # N/m
SPEED = 0.5


def tie(first, second, stiffness=K, **more):
    return Tie((TieEnd(*first), TieEnd(*second)), stiffness, **more)


def pulled(duration, *, speed=SPEED, output=("joints", "energy", "frames"), **more) -> Scenario:
    """A block without friction that moves away from the anchor of its tie."""
    blocks = (
        Block("floor", "stone", (3.0, 1.0, 0.1), (0.0, 0.0, -0.05), fixed=True),
        Block("anchor", "stone", (0.1, 0.1, 0.1), (-1.0, 0.0, 0.05), fixed=True),
        Block("block", "stone", (0.3, 0.2, 0.1), (0.0, 0.0, 0.05), velocity=(speed, 0.0, 0.0)),
    )
    bar = tie(("anchor", (-1.0, 0.0, 0.05)), ("block", (0.0, 0.0, 0.05)), **more)
    return of_stone(
        law("concave", 0.0, 1e9),
        DynamicControl(duration),
        blocks,
        ties=(bar,),
        output=Output(output, rows=2000, frames=20),
    )


def test_a_block_swings_once_on_a_slack_cable():
    """Half an oscillation: e = v sqrt(m / k) at most, back at speed v after pi sqrt(m / k); then the cable is slack."""
    period = math.pi * math.sqrt(MASS / K)
    result = simulate(pulled(2.0 * period, output=("joints", "energy", "frames", "velocity")))
    tension, time = result.rows["tension"][:, 0], result.rows["time"]
    assert tension.max() == pytest.approx(SPEED * math.sqrt(MASS * K), rel=1e-4)
    assert time[tension.argmax()] == pytest.approx(0.5 * period, abs=period / 200)
    late = time > 1.01 * period
    assert np.all(tension[late] == 0.0) and np.all(result.rows["yielded"] == 0.0)
    assert result.frames["velocity"][-1, 2, 0] == pytest.approx(-SPEED, rel=1e-4)
    np.testing.assert_allclose(result.rows["reaction"][:, 1, 0], -tension, atol=1e-9)  # of the anchor
    assert result.rows["energy"]["elastic"].max() == pytest.approx(0.5 * MASS * SPEED**2, rel=1e-4)
    assert result.energy.relative_residual < 1e-6


@pytest.mark.parametrize("strength", [300.0, 100.0])
def test_a_tie_yields_and_stays_longer(strength):
    """m v^2 / 2 = T_y^2 / (2 k) + T_y e_p: the plastic elongation dissipates energy and remains."""
    result = simulate(pulled(0.12, strength=strength))
    kept = (0.5 * MASS * SPEED**2 - 0.5 * strength**2 / K) / strength
    assert result.rows["tension"].max() == strength
    assert result.rows["yielded"][-1, 0] == pytest.approx(kept, rel=1e-3)
    assert result.rows["energy"]["yielding"][-1] == pytest.approx(strength * kept, rel=1e-3)
    assert result.energy.relative_residual < 1e-6
    (found,) = result.as_dict()["ties"]
    assert found["between"] == ["anchor", "block"] and found["yielded"] == pytest.approx(kept, rel=1e-3)
    assert found["peak"] == strength
    assert f"tie anchor - block 0 N ({strength:g} N at most, yielded by" in words(result.text())


def test_a_prop_pushes_and_yields_both_ways():
    """Thrown at its anchor: a bar carries the same force in compression."""
    result = simulate(pulled(0.12, speed=-SPEED, strength=300.0, tension_only=False))
    kept = (0.5 * MASS * SPEED**2 - 0.5 * 300.0**2 / K) / 300.0
    assert result.rows["tension"].min() == -300.0
    assert result.rows["yielded"].min() == pytest.approx(-kept, rel=1e-3)
    assert result.energy.relative_residual < 1e-6


def test_a_block_circles_on_a_tie():
    """With the pre-stress T = m v^2 / L the tie keeps its length, and the block is back after 2 pi L / v unspun."""
    L, v = 1.0, 2.0
    blocks = (
        Block("pivot", "stone", (0.1, 0.1, 0.1), (0.0, 0.0, 0.0), fixed=True),
        Block("block", "stone", (0.3, 0.2, 0.1), (L, 0.0, 0.0), velocity=(0.0, v, 0.0)),
    )
    bar = tie(("pivot", (0.0, 0.0, 0.0)), ("block", (L, 0.0, 0.0)), 1e6, prestress=MASS * v * v / L)
    given = of_stone(
        law("concave", 0.5, 1e8),
        DynamicControl(2.0 * math.pi * L / v),
        blocks,
        gravity=(0.0, 0.0, 0.0),
        ties=(bar,),
        output=Output(("energy", "frames"), rows=500, frames=8),
    )
    result = simulate(given)
    np.testing.assert_allclose(result.rows["tension"], MASS * v * v / L, rtol=1e-3)
    middle = result.frames["displacement"][len(result.frames["time"]) // 2, 1]
    assert np.linalg.norm(middle + [L, 0.0, 0.0]) == pytest.approx(L, rel=1e-3)
    assert np.abs(result.frames["displacement"][-1, 1]).max() < 1e-3
    assert result.energy.relative_residual < 1e-6


def hung(control, **more) -> Scenario:
    """A block on a support and on a tie from above."""
    blocks = (
        Block("support", "stone", (0.3, 0.2, 0.1), (0.0, 0.0, -0.05), fixed=True),
        Block("beam", "stone", (0.3, 0.2, 0.1), (0.0, 0.0, 1.05), fixed=True),
        Block("block", "stone", (0.3, 0.2, 0.1), (0.0, 0.0, 0.05)),
    )
    bar = tie(("beam", (0.0, 0.0, 1.0)), ("block", (0.0, 0.0, 0.1)), 1e7, **more)
    return of_stone(law("convex", 0.6, 1e9), control, blocks, ties=(bar,), output=Output(()))


@pytest.mark.parametrize("sinks", [2e-6, 4e-5])
def test_a_support_sinks_from_under_a_block_on_a_tie(sinks):
    """The tie stretches by d = (W + K s) / (K + k) while the block rests on both, and by W / k once it hangs."""
    W, joint, k = MASS * G, 1e9 * 0.06, 1e7
    result = simulate(hung(SettlementControl(("support",), (0.0, 0.0, -sinks))))
    d = min((W + joint * sinks) / (joint + k), W / k)
    (found,) = result.as_dict()["ties"]
    assert found["tension"] == pytest.approx(k * d, rel=1e-5)
    assert result.reactions["support"][2] == pytest.approx(W - k * d, abs=1e-5 * W)
    assert result.reactions["beam"][2] == pytest.approx(k * d, rel=1e-5)
    standing = simulate(hung(StaticsControl())).as_dict()["ties"][0]["tension"]
    assert result.rows["tension"][0, 0] == pytest.approx(standing, rel=1e-5)


def test_a_tied_block_slides_at_constant_rate():
    """V = mu (N + T cos b) + T sin b after 5 mm; T = T_0 + k (l - l_0) of a tie 0.3 m long across the bed."""
    blocks = (
        Block("lower", "tuff", (0.3, 0.2, 0.15), (0.0, 0.0, -0.075), fixed=True),
        Block("upper", "tuff", (0.3, 0.2, 0.15), (0.0, 0.0, 0.075)),
    )
    weight = 1500.0 * 0.009 * G
    given = of_stone(
        law("convex", 0.64, 1e11),
        DisplacementControl(rate=0.01, travel=5e-3),
        blocks,
        materials={"tuff": Material(1500.0)},
        loads=(Load("upper", (0.0, 0.0, weight - 467.0)),),
        actuators=(Actuator("jack", "upper", (0.0, 0.0, 0.0), (0.0, 1.0, 0.0)),),
        ties=(tie(("lower", (0.0, 0.0, -0.15)), ("upper", (0.0, 0.0, 0.15)), 1e6, prestress=300.0),),
        output=Output(("joints", "energy"), rows=500),
    )
    result = simulate(given)
    rows = result.rows
    soon = (rows["displacement"] > 1e-4) & (rows["displacement"] < 3e-4)
    assert rows["load"][soon].mean() == pytest.approx(490.88, rel=2e-3)  # the first slip: mu (N + T_0)
    assert rows["tension"][-1, 0] == pytest.approx(341.6638, rel=1e-3)  # the joint shortens it by 0.13 N
    assert result.yield_point.V == pytest.approx(523.2081, rel=1e-3)
    assert result.reactions["lower"][2] == pytest.approx(467.0, rel=1e-3)  # joint and tie together
    assert abs(result.energy.relative_residual) < 1e-5


def pushed_with_a_spring(height, **control):
    """A stone with mu N = 1.6 W on a joint that gives k_s A = 7.2e6 N/m, tied to a roof by a spring of 1e5 N/m."""
    blocks = (
        Block("lower", "stone", (0.3, 0.2, 0.15), (0.0, 0.0, -0.075), fixed=True),
        Block("upper", "stone", (0.3, 0.2, 0.15), (0.0, 0.0, 0.075)),
        Block("roof", "stone", (0.3, 0.2, 0.1), (0.0, 0.0, 0.5), fixed=True),
    )
    return of_stone(
        law("convex", 1.6, 3e8),
        DisplacementControl(rate=1e-3, **control),
        blocks,
        actuators=(Actuator("jack", "upper", (0.0, 0.0, height), (1.0, 0.0, 0.0)),),
        ties=(tie(("upper", (0.0, 0.0, 0.15)), ("roof", (0.0, 0.0, 0.45)), tension_only=False),),
        output=Output(("joints",)),
    )


def test_no_limit_load_is_said_of_a_tied_block_that_has_not_slipped():
    """Earlier versions reported sliding at a fraction of mu N, since an elastic tie may stretch without limit."""
    with pytest.raises(NotConvergedError, match="the joint has not begun to slip") as refused:
        simulate(pushed_with_a_spring(0.0, travel=2e-5))
    point = refused.value.yield_point
    assert point.actuator_load < 0.5 * 1.6 * point.N and point.mechanism == "none" and point.V is None
    cycles = simulate(pushed_with_a_spring(0.0, protocol=(2e-5, -2e-5, 2e-5)))
    assert cycles.yield_point.mechanism == "none" and not cycles.rows["joint"][:, 0, 6].any()


@pytest.mark.parametrize("height, travel, how", [(0.0, 2e-5, "none"), (0.0, 1e-4, "sliding"), (0.075, 2e-4, "rocking")])
def test_what_moves_elastically_in_the_deformed_geometry_moves_by_no_mechanism(height, travel, how):
    """The slip is the displacement less mu N / k_s A = 3.9e-5 m; pushed at its top the block rocks before it slips."""
    point = simulate(pushed_with_a_spring(height, travel=travel, large_displacements=True)).yield_point
    assert point.mechanism == how and (how != "none" or point.V < 0.6 * 1.6 * point.N)


def test_a_tied_block_moves_by_a_mechanism_only_where_its_joint_lets_it_go():
    """It slides at mu N. Pushed at its top it rocks at no less than N b / 2 h = N, without a mechanism before that."""
    slides = simulate(pushed_with_a_spring(0.0, travel=2e-3)).yield_point
    assert slides.mechanism == "sliding" and slides.V == pytest.approx(1.6 * slides.N, rel=1e-3)
    opens = simulate(pushed_with_a_spring(0.075, travel=5e-5)).yield_point
    assert opens.V < opens.N and opens.mechanism == "none"
    rocks = simulate(pushed_with_a_spring(0.075, travel=1e-4)).yield_point
    assert rocks.V > rocks.N and rocks.mechanism == "rocking"


def test_ties_are_kept_shown_and_restarted(tmp_path):
    """A restarted run keeps the plastic elongation of its ties; files hold ends, tension and plastic elongation."""
    given = pulled(0.12, strength=300.0)
    given = dataclasses.replace(given, output=dataclasses.replace(given.output, checkpoint=0.0, rows=60))
    whole, stopped = tmp_path / "whole.h5", tmp_path / "stopped.h5"
    simulate(given, whole)
    stop_at_look(given, stopped, 20)
    restart(stopped)
    check_same(whole, stopped)
    with history.read(whole) as found:
        (one,) = found.ties
        assert one["name"] == "tie anchor - block" and one["blocks"].tolist() == [1, 2]
        np.testing.assert_allclose(one["points"], [[-1.0, 0.0, 0.05], [0.0, 0.0, 0.05]], atol=1e-15)
        assert found.tension.max() == 300.0
        drawn, last = DrawnTies(found, 1.0), found.n_frames - 1
        assert drawn.words(last) == [f"magenta: tie, {found.tension[-1, 0]:.4g} N"]
        away = found.frame("displacement", last)[2]
        np.testing.assert_allclose(
            drawn.ends(Poses.read(found, last, last + 1)), [[-1.0, 0.0, 0.05], away + [0.0, 0.0, 0.05]], atol=1e-12
        )
        export.export(found, tmp_path / "table.csv")
        files = export.export(found, tmp_path / "moved.vtkhdf")
        assert str(tmp_path / "moved_ties.vtkhdf") in files
    head = (tmp_path / "table.csv").read_text().splitlines()[0]
    assert "tension of tie anchor - block [N]" in head and "yielded of tie anchor - block [m]" in head


@pytest.mark.parametrize("stiffness", [2e7, 1e8])
def test_a_block_on_a_bar_alone_swings_in_time(stiffness):
    """Without a joint the bar sets the time step: amplitude v sqrt(m / k), frequency sqrt(k / m)."""
    blocks = (
        Block("anchor", "stone", (0.1, 0.1, 0.1), (-1.0, 0.0, 0.05), fixed=True),
        Block("block", "stone", (0.3, 0.2, 0.1), (0.0, 0.0, 0.05), velocity=(SPEED, 0.0, 0.0)),
    )
    bar = tie(("anchor", (-1.0, 0.0, 0.05)), ("block", (0.0, 0.0, 0.05)), stiffness, tension_only=False)
    period = 2.0 * math.pi * math.sqrt(MASS / stiffness)
    scenario = of_stone(law("concave", 0.0, 1e8), DynamicControl(8.0 * period), blocks, ties=(bar,))
    result = simulate(dataclasses.replace(scenario, gravity=(0.0, 0.0, 0.0), output=Output(("joints",), rows=4000)))
    tension = result.rows["tension"][:, 0]
    assert np.abs(tension).max() == pytest.approx(SPEED * math.sqrt(MASS * stiffness), rel=0.08)
    assert np.count_nonzero(np.diff(np.sign(tension[np.abs(tension) > 0.0])) != 0) in (15, 16)
