"""The estimated cost of a run, against its actual cost: within a factor of two."""

import json
import re

import pytest

from dembrick.assembly.build import assemble
from dembrick.cli import main
from dembrick.runs.drivers import driver_of
from dembrick.runs.simulate import simulate
from dembrick.scenario import toml
from dembrick.simulation import expected_cost
from dembrick.simulation.expected_cost import duration, motion_seconds, newton_seconds, newton_steps
from helpers import pushed_assemblies
from helpers.places import SCENARIOS
from helpers.scenario_text import block
from helpers.stone_scenes import law


def planned(stem, *changes):
    scenario = toml.load(SCENARIOS / f"{stem}.toml", list(changes))
    return scenario, driver_of(scenario.control).plan(scenario, assemble(scenario))


@pytest.mark.parametrize(
    "stem, changes",
    [
        ("set4a", []),
        ("set4a", ['joint.formulation="concave"', "control.tolerance=1e-6"]),
        ("arch", []),
        ("set2b_curve", ['joint.formulation="concave"', "control.travel=2e-6"]),
        ("arch_tilt", ["control.rate=10.0"]),
        ("set4a_mid", []),
        ("set4b_mid", ["control.tolerance=1e-5"]),
        ("dam", []),
        ("slope_weak_joints", []),
        ("rocking_push", []),
        ("newmark_pulse", []),
    ],
)
def test_steps_are_expected_within_a_factor_of_two(stem, changes):
    scenario, plan = planned(stem, *changes)
    steps = simulate(scenario, record=False).as_dict()["steps"]
    assert 0.5 < plan.steps / steps < 2.0
    assert steps == plan.steps or not plan.exact


@pytest.mark.parametrize("stem", ["verification/ferris_tinloi_4", "verification/goodman_bray", "oppenheim", "arch"])
def test_steps_of_small_searches_are_expected_within_what_is_said(stem):
    """Limit analysis counts the joints that slide."""
    scenario, plan = planned(stem)
    steps = simulate(scenario, record=False).as_dict()["steps"]
    assert plan.within == 4.0
    assert 1.0 / plan.within < plan.steps / steps < plan.within


def test_a_wall_that_slides_takes_what_was_measured():
    """10 x 10 and 14 x 14 blocks pushed along: 346 and 1364 Newton steps, .5 and 3.4 s of a core, measured once."""
    for size, steps, seconds in ((10, 346, 0.5), (14, 1364, 3.4)):
        scenario = pushed_assemblies.wall(law(), size, size, (1.0, 0.0, 0.0))
        plan = driver_of(scenario.control).plan(scenario, assemble(scenario))
        assert 0.25 < plan.steps / steps < 4.0 and 0.25 < plan.seconds / seconds < 4.0


def test_check_says_how_far_off_it_may_be(capsys):
    assert main(["check", str(SCENARIOS / "verification" / "goodman_bray.toml")]) == 0
    assert "steps (usually within a factor of 4)" in capsys.readouterr().out


@pytest.mark.parametrize(  # docs/performance.md: walls out of plane, processor time and Newton steps
    "joints, steps, seconds", [(2655, 8, 0.25), (7425, 7, 0.75), (14595, 7, 1.9), (29850, 12, 6.6)]
)
def test_large_searches_take_what_was_measured(joints, steps, seconds):
    expected = newton_steps(convex=False)
    assert 0.5 < expected / steps < 2.0 and 0.5 < newton_seconds(expected, joints) / seconds < 2.0


LONG_ONES = [
    ("ferris_tinloi_3", 96126, 1.74),
    ("wall_corner", 379577, 10.2),
    ("arch_spread", 1698181, 14.0),
    ("pier_settles", 398895, 6.6),
]


@pytest.mark.parametrize("stem, steps, seconds", LONG_ONES)
def test_long_runs_in_real_time_take_what_was_measured(stem, steps, seconds):
    """Processor time, measured once; a tilt ends at the angle that limit analysis predicts."""
    _, plan = planned(stem)
    assert 0.5 < plan.steps / steps < 2.0 and 0.5 < plan.seconds / seconds < 2.0 and not plan.at_most


@pytest.mark.parametrize("joints, nanoseconds", [(285, 51.0), (2655, 35.0), (29850, 39.0)])
def test_walls_in_real_time_take_what_was_measured(joints, nanoseconds):
    """Per joint and step with energies, from a whole run of the small wall and from the loop of the large ones."""
    assert 0.5 < 1e9 * motion_seconds(1, joints) / joints / nanoseconds < 2.0


def test_a_wall_that_comes_apart_takes_what_was_measured(capsys):
    """Ten by ten blocks thrown over: 85,332 steps, some 115 s of processor time, measured once; 2 s if they stood."""
    _, plan = planned("wall_collapse")
    assert plan.exact and plan.steps == 85332
    assert 0.5 < plan.seconds_falling / 115.0 < 2.0 and 1.0 < plan.seconds < 4.0
    assert main(["check", str(SCENARIOS / "wall_collapse.toml")]) == 0
    assert re.search(r"\([\d.]+ (s|min) if all of it collapses\)", capsys.readouterr().out)  # depends on this machine
    assert planned("arch_tilt")[1].seconds_falling is None


def test_without_limit_analysis_a_tilt_has_a_bound(monkeypatch):
    monkeypatch.setattr("dembrick.simulation.limit_analysis.solver.installed", lambda: False)
    _, plan = planned("arch_tilt")
    assert plan.at_most and plan.steps * plan.time_step == pytest.approx(90.0, rel=1e-3)


def test_the_memory_of_a_large_search(monkeypatch):
    """A wall of 916 blocks took 30 MB beside the program itself, one of 10,051 blocks 560 MB (docs/performance.md).
    Limit analysis, which only counts the joints that slide, is left out."""
    monkeypatch.setattr("dembrick.simulation.limit_analysis.solver.installed", lambda: False)
    changes = ["control.quasi_static=true", "walls.0.courses=30", "walls.0.blocks=30"]
    _, plan = planned("wall_tilt", *changes)
    assert 0.5 < plan.memory / 30e6 < 2.0


def test_a_slower_machine_takes_longer(monkeypatch, capsys):
    """The loop of `slowness` runs at some speed here; its factor multiplies all seconds and no number of steps."""
    assert 0.1 < expected_cost.slowness() < 20.0
    found = []
    for slowness in (1.0, 3.0):
        monkeypatch.setattr(expected_cost, "slowness", lambda slowness=slowness: slowness)
        assert main(["check", str(SCENARIOS / "wall_collapse.toml"), "--json"]) == 0
        found.append(json.loads(capsys.readouterr().out))
    for name in ("expected_seconds", "expected_seconds_falling"):
        assert found[1][name] == pytest.approx(3.0 * found[0][name], rel=1e-12)
    assert found[0]["expected_steps"] == found[1]["expected_steps"]


def test_check_says_it(monkeypatch, capsys):
    monkeypatch.setattr(expected_cost, "slowness", lambda: 1.0)
    assert main(["check", str(SCENARIOS / "set4a_curve.toml")]) == 0
    assert "expected      20026 steps, 0.7 s on one core once compiled, 1 MB besides" in capsys.readouterr().out
    assert main(["check", str(SCENARIOS / "arch.toml"), "--json"]) == 0
    assert 0.7 < json.loads(capsys.readouterr().out)["expected_seconds"] < 0.8


def leaning_blocks(points, kind, keys):
    """Three blocks on one another, each a little aside, pushed at the top in the deformed geometry."""
    joint = '[joint]\nformulation = "distributed"\nfriction = 0.7\n'
    joint += f"normal_stiffness = 8.6e9\nshear_stiffness = 3.4e9\n{keys}"
    text = f"title = 'leaning'\ngravity = [0.0, 0.0, -9.81]\n{joint}{points}\n[materials.stone]\ndensity = 2000.0\n"
    text += block("base", (0.0, 0.0, -0.125), (4.0, 4.0, 0.25), "fixed = true")
    for k, (x, y) in enumerate([(0.0, 0.0), (0.0421, -0.0347), (0.0112, -0.0723)]):
        text += block(f"b{k}", (x, y, 0.076 + 0.152 * k), (0.256, 0.456, 0.152))
    jack = '[[actuators]]\nname = "jack"\nblock = "b2"\npoint = [0.0, -0.005, 0.38]\n'
    jack += "direction = [0.289, -0.957, 0.0]\n"
    if "dynamic" in kind:
        return toml.loads(f"{text}[control]\n{kind}")
    return toml.loads(f"{text}{jack}[control]\n{kind}large_displacements = true\n")


SEARCH, TRAVEL = 'kind = "yield"\n', 'kind = "displacement"\ntravel = 1e-3\n'
CRUSHING = "cohesion = 16384.0\ntensile_strength = 16384.0\ndilation = 0.125\ncompressive_strength = 2e5\n"


@pytest.mark.parametrize(
    "points, kind, keys, steps, seconds",
    [
        ("", SEARCH, CRUSHING, 514431, 27.7),
        ("points = [8, 8]", SEARCH, CRUSHING, 273072, 6.8),
        ("points = [4, 4]", SEARCH, CRUSHING, 94007, 0.8),
        ("points = [8, 8]", f"{SEARCH}tolerance = 1e-2\n", CRUSHING, 149863, 3.8),
        ("", SEARCH, "", 52992, 2.6),
        ("points = [4, 4]", TRAVEL, CRUSHING, 301290, 1.8),
        ("points = [8, 8]", TRAVEL, CRUSHING, 934757, 15.1),
    ],
)
def test_paths_on_which_bonds_break_take_what_was_measured(points, kind, keys, steps, seconds):
    """Steps that are kept, and processor time of all that are tried, measured once, within a factor of three: their
    number grows with the bonds, and the cost of a step with the points and their laws."""
    scenario = leaning_blocks(points, kind, keys)
    plan = driver_of(scenario.control).plan(scenario, assemble(scenario))
    assert 1 / 3 < plan.steps / steps < 3.0 and 1 / 3 < plan.seconds / seconds < 3.0
    assert plan.within == (3.0 if keys else 2.0)


def test_a_path_on_which_bonds_break_takes_what_is_expected():
    scenario = leaning_blocks("points = [4, 4]", SEARCH, CRUSHING)
    plan = driver_of(scenario.control).plan(scenario, assemble(scenario))
    assert 1 / 3 < plan.steps / simulate(scenario, record=False).as_dict()["steps"] < 3.0


@pytest.mark.parametrize("keys, seconds", [(CRUSHING, 0.8), ("", 0.3)])
def test_points_of_distributed_joints_cost_their_time_in_motion_too(keys, seconds):
    """42,735 steps with 660 points, measured once: few, among blocks that meet nothing, take less than expected."""
    scenario = leaning_blocks("", 'kind = "dynamic"\nduration = 2.0\n', keys)
    plan = driver_of(scenario.control).plan(scenario, assemble(scenario))
    assert 1 / 3 < plan.seconds / seconds < 3.0


class Started(Exception):
    pass


@pytest.mark.parametrize(
    "stem, module",
    [("set4a_curve", "simulation.statics.constant_rate"), ("arch_tilt", "simulation.dynamics.run"),
     ("arch", "simulation.statics.limit_load")],
)  # fmt: skip
def test_a_run_of_over_an_hour_says_so_before_it_starts(stem, module, monkeypatch):
    def start(*_, **__):
        raise Started

    name = {"constant_rate": "push_at_constant_rate", "run": "run", "limit_load": "find_limit_load"}
    monkeypatch.setattr(f"dembrick.{module}.{name[module.rpartition('.')[2]]}", start)
    monkeypatch.setattr(expected_cost, "LONG", 1e-3)
    monkeypatch.setattr("dembrick.runs.drivers.LONG", 1e-3)
    said = []
    with pytest.raises(Started):
        simulate(toml.load(SCENARIOS / f"{stem}.toml"), record=False, report=said.append)
    (line,) = (line for line in said if line.startswith("this run will take about"))
    assert "of computing on one core; to shorten it, " in line


def test_durations():
    assert [duration(s) for s in (0.0123, 3.4, 90.0, 5400.0, 2e5)] == ["0.01 s", "3 s", "1.5 min", "1.5 h", "2.3 days"]


def test_what_a_large_search_takes_if_its_blocks_snap(monkeypatch, capsys):
    """A dome of 5,101 blocks took 37 s of a core; at that size limit analysis does not count the sliding joints."""
    monkeypatch.setattr(expected_cost, "slowness", lambda: 1.0)
    changes = ["control.quasi_static=true", "domes.0.rings=50", "domes.0.blocks=100"]
    given = [part for change in changes for part in ("--set", change)]
    assert main(["check", str(SCENARIOS / "dome.toml"), *given]) == 0
    told = re.search(
        r" ([\d.]+) s on one core .*\(up to ([\d.]+) s if blocks slide and snap\)", capsys.readouterr().out
    )
    seconds, snapping = (float(number) for number in told.groups())
    assert seconds < 10.0 and 0.5 < snapping / 37.0 < 3.0
