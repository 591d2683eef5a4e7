"""kind = "statics": stability, reactions, and which blocks do not stand."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace

import numpy as np
import pytest

from dembrick import history
from dembrick.cli import main
from dembrick.errors import NotConvergedError, ScenarioError, UndecidedError, of_joint_forces
from dembrick.runs.limit import limit
from dembrick.runs.simulate import simulate
from dembrick.runs.study.search import Search
from dembrick.scenario.controls import BaseMotionControl, PushoverControl, StaticsControl, YieldControl
from dembrick.scenario.generators import Arch
from dembrick.scenario.model import Actuator, Block, JointLaw, JointOverride, Load, Material, Scenario
from dembrick.scenario.pressures import Pressure
from dembrick.scenario.time_functions import Sine
from dembrick.scenario.toml import loads, text_of
from helpers.stone_scenes import law, of_stone

G = 9.81


def scene(blocks, friction=0.6, control=None, **parts) -> Scenario:
    return of_stone(law("concave", friction, 1e11), control or StaticsControl(), blocks, **parts)


def overhanging(share: float, control=None) -> Scenario:
    """Three bricks of length 1 on a base; the k-th from the top overhangs by ``share`` / (2 k)."""
    blocks, end = [Block("base", "stone", (1.0, 0.5, 0.2), (0.0, 0.0, -0.1), fixed=True)], 0.0
    for k, name in ((3, "lowest"), (2, "middle"), (1, "top")):
        end += share * 0.5 / k
        blocks.append(Block(name, "stone", (1.0, 0.5, 0.2), (end, 0.0, 0.1 + 0.2 * (3 - k))))
    return scene(tuple(blocks), control=control)


def test_a_stone_that_falls_is_shown_where_its_mechanism_is_seen():
    """It is shown rotated about the edge of its base, however far the search for equilibrium has let it fall."""
    base = Block("base", "stone", (1.0, 0.5, 0.2), (0.0, 0.0, -0.1), fixed=True)
    result = simulate(scene((base, Block("over", "stone", (1.0, 0.5, 0.2), (0.7, 0.0, 0.1)))))
    assert result.status == "falls" and result.as_dict()["statics"]["mechanism"] == "rocking"
    blocks = result.run.state.blocks
    turn, moved = blocks.rotation[1], blocks.displacement[1]
    assert 0.01 < turn[1] < 0.5 and np.linalg.norm(moved) < 0.1
    for y in (-0.25, 0.25):
        np.testing.assert_allclose(moved + np.cross(turn, (-0.2, y, -0.1)), 0.0, atol=1e-3 * np.linalg.norm(moved))
    np.testing.assert_allclose(result.run.state.joints.relative[0, 3:], [0.0, turn[1], 0.0], atol=1e-12)


@pytest.mark.parametrize("share, stands", [(0.999, True), (1.001, False)])
def test_harmonic_stack(share, stands):
    result = simulate(overhanging(share))
    found = result.as_dict()
    assert (found["status"], found["statics"]["stands"]) == ("stands" if stands else "falls", stands)
    if stands:
        weight = 3 * 2000.0 * G * 0.1
        assert found["reactions"]["base"][2] == pytest.approx(weight, rel=1e-9)
        # the weight acts at the centroid of the three bricks
        middle = share * np.mean([1 / 6, 1 / 6 + 1 / 4, 1 / 6 + 1 / 4 + 1 / 2])
        assert found["reactions"]["base"][4] == pytest.approx(-weight * middle, rel=1e-6)
        assert result.plain_answer == "stands under its dead loads"
    else:
        assert found["statics"]["mechanism"] == "rocking" and "top" in found["statics"]["blocks"]
        assert found["reactions"] is None


def test_a_push_on_what_does_not_stand_says_so_in_the_same_words():
    with pytest.raises(NotConvergedError, match="does not stand: .*top.* fall by rocking"):
        simulate(overhanging(1.01, PushoverControl((1.0, 0.0, 0.0))))
    assert simulate(overhanging(1.01)).plain_answer.startswith("does not stand: ")


def test_two_supports_share_the_weight_by_the_lever():
    """R1 = W (x2 - x_G) / (x2 - x1)."""
    ends = [Block(n, "stone", (0.02, 0.2, 0.2), (x, 0.0, -0.1), fixed=True) for n, x in (("a", -0.5), ("b", 0.3))]
    beam = Block("beam", "stone", (1.2, 0.2, 0.2), (0.0, 0.0, 0.1))
    found = simulate(scene((*ends, beam))).reactions
    weight = 2000.0 * G * 1.2 * 0.04
    for name, x, other in (("a", -0.5, 0.3), ("b", 0.3, -0.5)):
        # the small moment of each stiff support is part of its own reaction
        at = x - found[name][4] / found[name][2]
        assert at == pytest.approx(x, abs=0.01)
        share = other / (other - x)
        assert found[name][2] == pytest.approx(weight * share, rel=2e-2)
    assert sum(r[2] for r in found.values()) == pytest.approx(weight, rel=1e-9)
    lever = sum(r[2] * x - r[4] for r, x in ((found["a"], -0.5), (found["b"], 0.3)))
    assert lever == pytest.approx(0.0, abs=1e-6 * weight)


@pytest.mark.parametrize("friction, status", [(0.35, "stands"), (0.27, "falls")])
def test_an_arch_needs_friction(friction, status):
    """Semicircle, t / R = .2, 20 voussoirs: least friction .308877."""
    arch = Arch("arch", "stone", 1.5, 0.3, 0.5, 20)
    result = simulate(scene((), friction, arches=(arch,)))
    assert result.status == status
    if status == "falls":
        assert result.statics["mechanism"] == "sliding"


def test_it_is_read_and_written(tmp_path):
    scenario = loads(text_of(overhanging(0.9)))
    assert scenario.control == StaticsControl()
    result = simulate(scenario, tmp_path / "stack.h5")
    with history.read(tmp_path / "stack.h5") as found:
        assert found.status == "stands" and found.n_row == 1 and found.n_frames == 1
        assert found.results["reactions"] == result.reactions


def test_nothing_to_carry_is_carried():
    """Without gravity and loads there is no force at all: blocks stand, and an actuator would find no friction."""
    floating = replace(overhanging(0.9), gravity=(0.0, 0.0, 0.0))
    result = simulate(floating)
    assert result.status == "stands" and result.run.rest.unbalanced == 0.0
    assert all(force == [0.0] * 6 for force in result.reactions.values())
    actuator = Actuator("push", "top", (0.6, 0.0, 0.5), (1.0, 0.0, 0.0))
    with pytest.raises(ScenarioError, match="gravity is zero and there are no .*nothing presses the joints"):
        simulate(replace(floating, control=YieldControl(), actuators=(actuator,)))


@pytest.mark.parametrize("deformed", [False, True])
def test_what_is_driven_carries_nothing_in_statics_and_that_is_said(deformed, tmp_path):
    """Statics asks for dead loads only: a driven pressure that would slide the stack is left out, with a remark."""
    wet = Pressure("top", (1.0, 0.0, 0.0), value=1e6, actuator=True)
    said: list[str] = []
    stack = overhanging(0.9)
    control = replace(stack.control, large_displacements=deformed)
    result = simulate(replace(stack, control=control, pressures=(wet,)), tmp_path / "stack.h5", report=said.append)
    assert result.status == "stands" and not result.rows["actuator_force"].any()
    (remark,) = [text for text in said if "have no effect" in text]
    assert remark.startswith("[[pressures]] with actuator = true have no effect in a run of kind 'statics'")
    assert simulate(replace(overhanging(0.9), pressures=(replace(wet, actuator=False),))).status == "falls"


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_a_block_between_two_jaws_whose_faces_lean_out(formulation):
    """A squeeze P = 1000 N carries 2 P tan(phi - alpha), friction 0.3 and 10 deg. The right jaw slides on its bed."""
    lean, width, height, depth = math.tan(math.radians(10.0)), 0.1, 0.2, 0.2

    def body(name, *corners, **more):
        vertices = tuple((x, y, z) for y in (-0.5 * depth, 0.5 * depth) for x, z in corners)
        return Block(name, "stone", vertices=vertices, **more)

    top = width - lean * height
    blocks = (
        body("left", (-0.4, 0.0), (-width, 0.0), (-top, height), (-0.4, height), fixed=True),
        body("right", (width, 0.0), (0.4, 0.0), (0.4, height), (top, height)),
        body("wedge", (-width, 0.0), (width, 0.0), (top, height), (-top, height)),
        Block("bed", "stone", (0.25, depth, 0.1), (0.275, 0.0, -0.05), fixed=True),
    )
    scenario = scene(
        blocks,
        0.3,
        YieldControl(),
        loads=(Load("right", force=(-1000.0, 0.0, 0.0), point=(0.4, 0.0, 0.1)),),
        actuators=(Actuator("push", "wedge", (0.0, 0.0, height), (0.0, 0.0, -1.0)),),
    )
    laws = replace(scenario.joint, formulation=formulation)
    slides = JointOverride(("right", "bed"), replace(laws, friction=0.0))
    scenario = replace(scenario, joint=laws, joints=(slides,), materials={"stone": Material(1000.0)})
    weight = 1000.0 * G * (width + top) * height * depth
    carried = 2.0 * 1000.0 * math.tan(math.atan(0.3) - math.radians(10.0))
    assert carried == pytest.approx(234.9193, abs=1e-4)
    found = simulate(scenario, record=False)
    assert weight + found.yield_point.V == pytest.approx(carried, rel=1e-6)
    assert weight + limit(scenario).load_factor == pytest.approx(carried, rel=1e-6)


def voussoirs(count: int, control=None) -> Scenario:
    """A semicircular arch of t/R = 0.15; by limit analysis the least is 0.1075 and the load factor 0.14433."""
    arch = Arch("arch", "stone", 1.0, 0.15, 0.3, count)
    law = JointLaw("concave", 0.7, 1e10, 4e9)
    return replace(scene((), control=control, arches=(arch,)), joint=law)


def test_an_arch_of_400_voussoirs_stands_and_is_pushed_over():
    """Relaxation alone had once found no equilibrium within 20,000 steps."""
    result = simulate(voussoirs(400), record=False)
    assert result.status == "stands" and result.run.rest.unbalanced <= 1e-9
    weight = 2000.0 * G * 0.3 * 0.5 * math.pi * (1.075**2 - 0.925**2)
    assert sum(force[2] for force in result.reactions.values()) == pytest.approx(weight, rel=1e-3)
    pushed = simulate(voussoirs(400, PushoverControl((1.0, 0.0, 0.0))), record=False)
    assert pushed.collapse["load_factor"] == pytest.approx(0.14433, rel=1e-3)


def diamond(rows: int, weights: float, formulation: str, gap: float = 0.0) -> Scenario:
    """Rows of 1, 2 .. ``rows`` .. 2, 1 blocks of length 1, each half on two, frictionless, on a table (Paterson and
    Zwick, Amer. Math. Monthly 116 (2009) 19); its top block carries a central load of ``weights`` times the weight of a
    block. Blocks are shorter by the ``gap`` beside them."""
    long, wide, high = 1.0 - gap, 0.4, 0.25
    counts = [*range(1, rows + 1), *range(rows - 1, 0, -1)]
    blocks = [Block("table", "stone", (3.0, wide, 0.25), (0.0, 0.0, -0.125), fixed=True)]
    for row, count in enumerate(counts):
        blocks += [
            Block(f"b{row}.{i}", "stone", (long, wide, high), (i - 0.5 * (count - 1), 0.0, (row + 0.5) * high))
            for i in range(count)
        ]
    weight = weights * 2000.0 * G * long * wide * high
    load = Load(f"b{len(counts) - 1}.0", (0.0, 0.0, -weight), (0.0, 0.0, (len(counts) - 0.5) * high))
    return replace(scene(tuple(blocks), loads=(load,)), joint=JointLaw(formulation, 0.0, 1e10, 4e9))


@pytest.mark.parametrize("formulation", ["concave", "convex"])
@pytest.mark.parametrize("rows, gap, least", [(5, 0.0, 6.0), (6, 0.0, 27.0), (7, 0.0, 78.0), (7, 0.001, 78.64)])
def test_diamonds_stand_from_a_weight_on_their_top(rows, gap, least, formulation):
    """The least load is 2^m - m^2 - 1 blocks; forces double from row to row, so that equilibrium is hard to find and a
    fall is hard to detect."""
    assert gap or least == 2**rows - rows**2 - 1
    for share, status in ((0.98, "falls"), (1.02, "stands")):
        found = simulate(diamond(rows, share * least, formulation, gap), record=False)
        assert found.status == status
        assert found.run.rest.steps < 1000


def test_blocks_fall_early_whatever_the_stiffness():
    """Stones that overhang too far are found to fall within some hundred steps, with joints of any stiffness."""
    for stiffness in (1e9, 1e11, 1e13):
        heap = replace(overhanging(1.01), joint=JointLaw("concave", 0.6, stiffness, 0.4 * stiffness))
        found = simulate(heap, record=False)
        assert found.status == "falls" and found.run.rest.steps < 1000


def told_in_per_cent(error):
    """Whether a message gives the out-of-balance force in per cent of the joint forces, between 0 and 100."""
    (share,) = re.findall(r" ([-+.e\d]+) % of the joint forces are still out of balance", str(error))
    return 0.0 < float(share) < 100.0


def test_words_for_a_share_of_the_joint_forces_are_in_per_cent():
    assert of_joint_forces(0.0123) == "1.2 % of the joint forces"
    assert of_joint_forces(3.14e-7) == "3.1e-05 % of the joint forces"


def test_what_neither_stands_nor_falls_is_undecided(monkeypatch, tmp_path, capsys):
    """With too few steps no control claims an outcome, and a search over a parameter counts it as neither."""
    monkeypatch.setattr("dembrick.simulation.statics.rest.dead_load.MOST_STEPS", 3)
    monkeypatch.setattr("dembrick.simulation.statics.rest.viscous_rest.MOST_STEPS", 3)
    weak = diamond(5, 6.12, "convex")
    result = simulate(weak, tmp_path / "run.h5")
    told = result.as_dict()
    assert told["status"] == "undecided" and told["statics"]["stands"] is None and told["reactions"] is None
    assert "dembrick limit decides it" in told["error"] and "does not stand" not in result.text()
    with history.read(tmp_path / "run.h5") as found:
        assert found.status == "undecided"
    with pytest.raises(UndecidedError, match="undecided under the dead loads") as raised:
        simulate(replace(weak, control=PushoverControl((1.0, 0.0, 0.0))))
    assert raised.value.answer["status"] == "undecided" and told_in_per_cent(raised.value)
    with pytest.raises(UndecidedError, match="stage 1"):
        simulate(replace(weak, stages=(StaticsControl(),)))
    (tmp_path / "run.toml").write_text(text_of(weak))
    assert main(["run", str(tmp_path / "run.toml"), "--json", "--out", str(tmp_path / "again.h5")]) == 1
    assert json.loads(capsys.readouterr().out)["status"] == "undecided"


def test_shaken_stones_that_cannot_stand_are_refused_early():
    """Three bricks that overhang by 0.2 % too far: statics proves the fall, and the run in real time need not wait
    until a brick has moved by its own length (300,000 steps without a verdict)."""
    shaken = BaseMotionControl(0.05, (1.0, 0.0, 0.0), sine=Sine(0.1, 5.0))
    heap = overhanging(1.002, shaken)
    steps: list[int] = []

    def told(progress) -> None:
        steps.append(progress.done)

    with pytest.raises(NotConvergedError, match="'lowest', 'middle', 'top' slide or overturn") as raised:
        simulate(replace(heap, joint=JointLaw("concave", 0.6, 1e10, 4e9)), record=False, progress=told)
    assert raised.value.status == "failed" and max(steps, default=0) < 150_000


def test_relaxation_in_moving_geometry_that_ends_unbalanced_is_undecided(monkeypatch):
    """After 2,048 steps a convex stack is not in equilibrium yet, and no joint has come apart."""
    monkeypatch.setattr("dembrick.simulation.dynamics.dead_load.MOST_STEPS", 2048)
    monkeypatch.setattr("dembrick.simulation.dynamics.paths.equilibria.ROUNDS", 1)
    leaning = replace(overhanging(0.95), joint=JointLaw("convex", 0.6, 1e10, 4e9))
    shaken = BaseMotionControl(0.05, (1.0, 0.0, 0.0), sine=Sine(0.1, 5.0))
    for control in (shaken, StaticsControl(large_displacements=True)):
        with pytest.raises(UndecidedError, match="undecided") as raised:
            simulate(replace(leaning, control=control), record=False)
        told = raised.value.answer
        assert told["status"] == "undecided" and told_in_per_cent(raised.value)
    assert told["statics"] == {"stands": None, "unbalanced": None, "mechanism": None, "blocks": []}


def test_a_search_looks_beside_what_is_undecided():
    search = Search("joint.friction", 0.0, 1.0, 0.05)
    found = search.bisect(lambda x: None if 0.45 < x < 0.55 else x < 0.3)
    assert found.falls <= 0.3 <= found.stands and found.half_width <= 0.05 * 0.35
    with pytest.raises(UndecidedError, match="it stands at .* and falls at"):
        search.bisect(lambda x: None if 0.2 < x < 0.8 else x < 0.5)
    with pytest.raises(UndecidedError, match="at joint.friction = 0 it is undecided"):
        search.bisect(lambda x: None)


def test_what_still_balances_itself_is_no_fall():
    """Four convex voussoirs with friction .35, for which forces in equilibrium exist (for .345 none do): the
    out-of-balance force keeps falling as the motion grows, and such a motion proves no fall."""
    arch = Arch("arch", "stone", 1.0, 0.15546812583867825, 0.3, 4)
    law = JointLaw("convex", 0.35, 1.673022368709644e9, 4.11681107321e8)
    given = replace(scene((), arches=(arch,)), joint=law)
    assert limit(given).status == "stands" and limit(with_friction(given, 0.345)).status == "falls"
    assert simulate(given, record=False).status != "falls"
    assert simulate(with_friction(given, 0.345), record=False).status == "falls"
    assert simulate(with_friction(given, 0.355), record=False).status == "stands"


def with_friction(scenario: Scenario, friction: float) -> Scenario:
    return replace(scenario, joint=replace(scenario.joint, friction=friction))


@pytest.mark.parametrize("over, falls", [(0.98, False), (1.15, True)])
def test_what_only_a_squeeze_would_hold_up_falls_on_its_path_and_no_more_is_said(over, falls):
    """The corner stone of a wall weighs ``over`` times the crushing strength f_c A of its bed. Limit analysis finds
    forces that hold it by friction 2 on its side, which need a squeeze; so "never balanced" would claim too much."""
    w = 0.125 * 0.1 * 0.4 * 2000.0 * G
    blocks = [Block("floor", "stone", (3.0, 0.1, 0.2), (0.0, 0.0, -0.1), fixed=True)]
    places = {"one": (0.25, -0.125), "two": (0.25, 0.125), "left": (0.125, -0.1875), "middle": (0.25, 0.0)}
    for name, (wide, x) in (places | {"corner": (0.125, 0.1875)}).items():
        blocks.append(Block(name, "stone", (wide, 0.1, 0.4), (x, 0.0, 0.2 if name in ("one", "two") else 0.6)))
    joint = law("convex", 2.0, compressive_strength=9.0 * w / over / (0.125 * 0.1))
    pressed, jack = (
        Load("corner", (0.0, 0.0, -8.0 * w), (0.17, 0.0, 0.8)),
        Actuator("jack", "corner", (0.25, 0.0, 0.6), (-1.0, 0.0, 0.0)),
    )
    wall = of_stone(joint, YieldControl(), blocks, loads=(pressed,), actuators=(jack,))
    assert limit(replace(wall, control=StaticsControl(), actuators=())).status == "stands"
    if not falls:
        assert simulate(wall, record=False).yield_point.V > 0.0
        return
    with pytest.raises(
        NotConvergedError, match="before the test begins: on this path .* only a built-in squeeze"
    ) as refused:
        simulate(wall, record=False)
    assert "never" not in str(refused.value)
