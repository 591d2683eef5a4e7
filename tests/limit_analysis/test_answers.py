"""Answers of limit analysis other than a plain number: one sentence each, and the right exit code."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from dembrick import cli
from dembrick.errors import MissingDependency, NotConvergedError, ScenarioError
from dembrick.runs.limit import associative_bound, cheaper_than, limit
from dembrick.runs.limit_cases import searched
from dembrick.scenario import toml
from dembrick.scenario.blocks import Block
from dembrick.scenario.controls import DynamicControl, PushoverControl, StaticsControl, TiltControl, YieldControl
from dembrick.scenario.model import Actuator, Load, Scenario
from dembrick.scenario.ties import Tie, TieEnd
from dembrick.simulation.limit_analysis import bounds, solver
from helpers import pushed_assemblies as scenes
from helpers.stone_scenes import GRAVITY, law, of_stone


def one_block(actuators=(), control=None, friction=0.64, gravity=GRAVITY, more=()) -> Scenario:
    blocks = (
        Block("floor", "stone", box=(2.0, 2.0, 0.2), position=(0.0, 0.0, -0.1), fixed=True),
        Block("stone", "stone", box=(0.4, 0.4, 0.4), position=(0.0, 0.0, 0.2)),
        *more,
    )
    control = control or YieldControl()
    joint = law(friction=friction)
    return of_stone(joint, control, blocks, gravity=gravity, actuators=actuators)


def push(direction, point=(0.0, 0.0, 0.2), name="push"):
    return Actuator(name, "stone", point, direction)


def saved(tmp_path, scenario: Scenario) -> str:
    path = tmp_path / "scenario.toml"
    path.write_text(toml.dumps(scenario), encoding="utf-8")
    return str(path)


def test_pressing_down_is_unlimited(tmp_path, capsys):
    scenario = one_block((push((0.0, 0.0, -1.0)),))
    found = limit(scenario)
    assert found.status == "unlimited" and math.isinf(found.load_factor) and found.blocks == []
    assert associative_bound(found.assembly, scenario.control) is None
    assert cli.main(["limit", saved(tmp_path, scenario)]) == 0
    assert "unlimited: no mechanism exists along the load" in capsys.readouterr().out
    assert cli.main(["limit", saved(tmp_path, scenario), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["unlimited"] and told["load_factor"] is None and told["status"] == "unlimited"


def test_lifting_off():
    scenario = one_block((push((0.0, 0.0, 1.0)),))
    weight = 2000.0 * 9.81 * 0.4**3
    found = limit(scenario)
    assert found.load_factor == pytest.approx(weight, rel=1e-7)
    assert found.mechanism == "uplift" and found.blocks == ["stone"]


def test_a_dead_load_off_the_centroid_has_its_moment():
    """A push at the top of a cube overturns it: V h = W b / 2 + P (b / 2 + e), the load P at e behind the middle."""
    pushed = one_block((push((1.0, 0.0, 0.0), (0.0, 0.0, 0.4)),))
    weight = 2000.0 * 9.81 * 0.4**3
    for e in (-0.1, 0.1):
        found = limit(replace(pushed, loads=(Load("stone", (0.0, 0.0, -1000.0), (-e, 0.0, 0.4)),)))
        assert found.load_factor == pytest.approx((weight * 0.2 + 1000.0 * (0.2 + e)) / 0.4, rel=1e-7)


def test_a_tilt_knows_that_the_strength_of_a_tie_does_not_turn():
    """W sin = mu W cos + S for a block on a table, with S the strength of a tie along the table."""
    weight, strength = 2000.0 * 9.81 * 0.4**3, 200.0
    post = Block("post", "stone", box=(0.2, 0.2, 0.4), position=(0.8, 0.0, 0.2), fixed=True)
    tie = Tie((TieEnd("post", (0.7, 0.0, 0.2)), TieEnd("stone", (0.2, 0.0, 0.2))), 1e8, strength=strength)
    tilt = TiltControl((0.0, -1.0, 0.0), 1.0, 0.02, quasi_static=True)
    found = limit(replace(one_block(control=tilt, friction=0.3, more=(post,)), ties=(tie,)))
    angle = math.atan(found.load_factor)
    assert weight * math.sin(angle) == pytest.approx(0.3 * weight * math.cos(angle) + strength, rel=1e-7)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.8, 0.9, 0.98])
@pytest.mark.parametrize("formulation", ["convex", "concave"])
def test_a_tilt_knows_that_cohesion_does_not_turn(share, formulation):
    """W sin = mu W cos + S: the greater the share S of the weight, the slower the rounds V = F(V) converge."""
    found = limit(bonded_tile(share, formulation))
    phi = math.atan(0.3)
    truth = math.tan(phi + math.asin(share * math.cos(phi)))
    assert found.limit.lower <= truth <= found.limit.upper
    assert found.limit.upper - found.limit.lower < 1e-6 * truth


def test_a_tile_whose_bond_carries_its_weight_stands_at_any_tilt():
    assert limit(bonded_tile(1.05, "convex")).angle == 90.0


def bonded_tile(share, formulation):
    """A tile on a table whose bond carries this ``share`` of its weight in shear, and more than that in tension."""
    cohesion = share * 2000.0 * 9.81 * 0.01
    joint = law(formulation, 0.3, cohesion=cohesion, residual_cohesion=cohesion, tensile_strength=cohesion / 0.3)
    blocks = (
        Block("table", "stone", box=(2.0, 2.0, 0.2), position=(0.0, 0.0, -0.1), fixed=True),
        Block("tile", "stone", box=(0.4, 0.4, 0.01), position=(0.0, 0.0, 0.005)),
    )
    return of_stone(joint, TiltControl((0.0, 1.0, 0.0), 1.0, 0.02, quasi_static=True), blocks)


def test_a_rough_table_stands_at_any_tilt():
    walls = (
        Block("left", "stone", box=(0.2, 1.0, 0.4), position=(-0.3, 0.0, 0.2), fixed=True),
        Block("right", "stone", box=(0.2, 1.0, 0.4), position=(0.3, 0.0, 0.2), fixed=True),
    )
    table = TiltControl((0.0, 1.0, 0.0), 1.0, 0.02, quasi_static=True)
    found = limit(one_block(control=table, more=walls))
    assert found.limit.unlimited and found.angle == 90.0
    assert "stands at any tilt up to 90 deg" in found.text()


def test_no_friction_carries_no_push():
    found = limit(one_block((push((1.0, 0.0, 0.0)),), friction=0.0))
    assert found.lower == pytest.approx(0.0, abs=1e-9) and found.upper < 1e-5  # relative to a weight of 1256 N
    assert found.mechanism == "sliding"


def test_it_does_not_stand_under_its_dead_loads(tmp_path, capsys):
    """A block on a slope steeper than its friction: the answer names it and gives the out-of-balance share."""
    steep = (9.81 * math.sin(0.7), 0.0, -9.81 * math.cos(0.7))
    scenario = one_block((push((1.0, 0.0, 0.0)),), gravity=steep)
    with pytest.raises(NotConvergedError, match="does not stand under its dead loads: sliding of stone") as raised:
        limit(scenario)
    assert raised.value.answer["statics"] | {"unbalanced": 0} == {
        "stands": False,
        "unbalanced": 0,
        "mechanism": "sliding",
        "blocks": ["stone"],
    }
    assert cli.main(["limit", saved(tmp_path, scenario), "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["status"] == "falls"


@pytest.mark.parametrize("overhang, stands", [(0.999, True), (1.001, False)])
def test_the_harmonic_stack(overhang, stands):
    """Four blocks, the k-th from the top overhanging by ``overhang`` times l/(2k), stand below 1 and fall above it."""
    x, blocks = 0.0, [Block("s.4", "stone", box=(1.0, 0.5, 0.2), position=(0.0, 0.0, -0.1), fixed=True)]
    for k, level in ((4, 0), (3, 1), (2, 2), (1, 3)):
        x += overhang * 0.5 / k
        blocks.append(Block(f"b.{k}", "stone", box=(1.0, 0.5, 0.2), position=(x, 0.0, 0.1 + 0.2 * level)))
    scenario = of_stone(law(), PushoverControl((0.0, 0.0, -1.0)), blocks)
    pushed = replace(scenario, control=PushoverControl((1.0, 0.0, 0.0)))
    if stands:
        assert limit(pushed).load_factor > 0.0
        return
    with pytest.raises(NotConvergedError, match="does not stand under its dead loads: rocking of"):
        limit(pushed)


@pytest.mark.parametrize("friction, status", [(0.31, "stands"), (0.30, "falls")])
def test_statics_by_limit_analysis(friction, status, tmp_path, capsys):
    """A semicircular arch of 20 voussoirs needs mu = .308877."""
    arch = replace(scenes.arch(law(friction=friction), (1.0, 0.0, 0.0)), control=StaticsControl())
    found = limit(arch)
    assert found.status == status and found.as_dict()["statics"]["stands"] == (status == "stands")
    with pytest.raises(ScenarioError, match="belongs to a load"):
        limit(arch, heuristic=True)
    assert cli.main(["limit", saved(tmp_path, arch), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["status"] == status and told["statics"]["stands"] == (status == "stands")
    assert told["statics"]["mechanism"] == (None if status == "stands" else "sliding")
    assert bool(told["statics"]["blocks"]) == (status == "falls")
    assert cli.main(["limit", saved(tmp_path, arch)]) == 0
    said = capsys.readouterr().out
    assert ("squeeze" in said) if status == "stands" else ("does not stand under its dead loads" in said)
    assert cli.main(["limit", saved(tmp_path, arch), "--heuristic"]) == 2
    assert "belong to a load" in capsys.readouterr().err


def test_loads_that_cancel():
    scenario = one_block((push((1.0, 0.0, 0.0)), push((-1.0, 0.0, 0.0), name="pull")))
    with pytest.raises(ScenarioError, match="cancel on every block"):
        limit(scenario)


def test_a_scenario_without_a_load(tmp_path, capsys):
    assert cli.main(["limit", saved(tmp_path, one_block(control=DynamicControl(1.0)))]) == 2
    assert "no load to multiply" in capsys.readouterr().err
    assert cli.main(["limit", "arch_spread"]) == 2
    assert "--reaction SUPPORT --direction X,Y,Z" in capsys.readouterr().err


def test_a_mixture_with_an_inner_state_is_inside_every_strength():
    """The lower bound moves towards an inner state only as far as the strength that is exceeded worst requires."""
    over, inner = np.array([0.1, 0.3, -1.0]), np.array([-1.0, -0.1, -5.0])
    share = bounds.share_of_inner(over, inner, 0.0)
    mixture = (1.0 - share) * over + share * inner
    assert mixture.max() == pytest.approx(0.0, abs=1e-15)
    assert bounds.share_of_inner(over, np.array([-1.0, 0.1, -5.0]), 0.0) == 1.0


def test_a_solver_that_fails_tells_its_status(monkeypatch):
    monkeypatch.setattr(solver, "MOST_ITERATIONS", 2)
    with pytest.raises(NotConvergedError, match="MaxIterations"):
        limit(one_block((push((1.0, 0.0, 0.0)),)))


@pytest.mark.parametrize("package", ["clarabel", "scipy"])
def test_a_missing_package_is_named(monkeypatch, package, tmp_path, capsys):
    monkeypatch.setitem(__import__("sys").modules, package, None)
    with pytest.raises(MissingDependency, match=f"needs the package {package}"):
        limit(one_block((push((1.0, 0.0, 0.0)),)))
    assert cli.main(["limit", saved(tmp_path, one_block((push((1.0, 0.0, 0.0)),)))]) == 4
    assert "pip install 'dembrick[limit]'" in capsys.readouterr().err


@pytest.mark.parametrize(
    "options, message",
    [
        (["--reaction", "floor"], "belong together"),
        (["--reaction", "floor", "--direction", "1,0"], "three numbers"),
        (["--reaction", "floor", "--direction", "0,0,0"], "not all of them 0"),
        (["--reaction", "floor", "--direction", "a,b,c"], "three numbers"),
        (["--reaction", "flor", "--direction", "0,0,1"], "did you mean 'floor'"),
        (["--reaction", "stone", "--direction", "0,0,1"], "is not fixed"),
    ],
)
def test_options_that_do_not_fit(tmp_path, capsys, options, message):
    assert cli.main(["limit", saved(tmp_path, one_block((push((1.0, 0.0, 0.0)),))), *options]) == 2
    assert message in capsys.readouterr().err


def test_a_push_in_real_time_has_the_limit_of_the_quasi_static_one():
    slow = PushoverControl((1.0, 0.0, 0.0), displacement=1e-3, quasi_static=False, rate=1e-3)
    table = TiltControl((0.0, 1.0, 0.0), 1.0, 0.02)
    assert limit(one_block(control=slow)).load_factor == pytest.approx(0.64, rel=1e-7)
    assert limit(one_block(control=table)).angle == pytest.approx(math.degrees(math.atan(0.64)), rel=1e-7)
    assert searched(one_block((push((1.0, 0.0, 0.0)),))).control.kind == "yield"


def test_linear_pressure_is_bounded_by_the_corners():
    joint = law("convex", pressure="linear")
    found = limit(scenes.corner(joint, (1.0, 0.0, 0.0)))
    assert found.load_factor == pytest.approx(0.6328315, rel=1e-6)  # of concave joints
    assert "points at their corners bound them" in found.text()


def trough() -> Scenario:
    """A prism in a V trough with faces at 45 deg, on a table that tilts about x."""
    c = 0.15 * math.sqrt(2.0)
    ends = lambda points, length: [(x, y, z) for y in (-length, length) for x, z in points]  # noqa: E731
    blocks = [Block("wedge", "stone", vertices=ends([(-0.5, 0.5), (0.0, 0.0), (0.5, 0.5)], 1.0))]
    for name, s in (("left", -1.0), ("right", 1.0)):
        face = [(0.0, 0.0), (0.65 * s, 0.65), ((0.65 + c) * s, 0.65 - c), (c * s, -c)]
        blocks.append(Block(name, "stone", vertices=ends(face, 3.0), fixed=True))
    table = TiltControl((1.0, 0.0, 0.0), 1.0, 0.02, quasi_static=True)
    return of_stone(law(friction=0.3), table, blocks)


def test_the_second_opinion_slides_without_dilatancy():
    """A wedge failure: tan(angle) = mu / sin 45 deg in closed form; normality lifts the prism and gives 4.8 % more."""
    found = limit(trough(), heuristic=True)
    exact = 0.3 * math.sqrt(2.0)
    assert found.load_factor == pytest.approx(0.4447495, rel=1e-6)
    assert found.second_opinion.settled
    assert found.second_opinion.load_factor == pytest.approx(exact, rel=2e-3)
    assert "no bound" in found.text() and found.as_dict()["second_opinion"]["settled"]


def test_a_second_opinion_that_does_not_settle_says_so(monkeypatch):
    monkeypatch.setattr("dembrick.simulation.limit_analysis.non_associative.MOST_PROGRAMMES", 3)
    found = limit(trough(), heuristic=True).second_opinion
    assert not found.settled and "did not settle within 3 programmes" in found.ended
    assert found.low <= found.load_factor <= found.high


def test_whether_it_costs_less_than_a_search():
    assembly = limit(one_block((push((1.0, 0.0, 0.0)),))).assembly
    assert cheaper_than(60.0, assembly) and not cheaper_than(0.01, assembly)


def test_the_mechanism_is_drawn_and_written(tmp_path, monkeypatch):
    from dembrick import history
    from dembrick.views.render import scene

    words, told = scene.Scene._words, []
    monkeypatch.setattr(scene.Scene, "_words", lambda *given: told.append(words(*given)) or told[-1])

    found = limit(scenes.arch(law("convex", 0.7), (1.0, 0.0, 0.0)))
    path = found.write(tmp_path / "mechanism.h5")
    with history.read(path) as file:
        assert file.status == "limit" and file.n_frames == 2
    picture = found.picture(tmp_path / "mechanism.png")
    assert told and all("mechanism of limit analysis: velocities, not to scale" in one for one in told)
    assert (tmp_path / "mechanism.png").stat().st_size > 10_000 and picture.endswith("mechanism.png")
    assert not list(tmp_path.glob("*.part"))
