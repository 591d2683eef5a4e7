"""Whether a limit load is the same on all paths: what is proven, and what is reported if nothing is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dembrick import cli, limit, simulate
from dembrick.runs import study as studies
from dembrick.runs.path_dependence import cut_at_bound, ranged
from dembrick.scenario import toml
from dembrick.views.key_numbers import key_numbers
from helpers.key_lines import lines_of
from helpers.places import SCENARIOS
from helpers.scenario_text import block, header, jack
from helpers.studies import read_csv, write_study

DENSITY, G = 2000.0, 9.81

FLOOR = block("floor", (0.0, 0.0, -0.1), (6.0, 4.0, 0.2), "fixed = true")
YIELD = '[control]\nkind = "yield"\n'


def curb(squeeze: float = 0.0, shear: float = 4e9, steps: int = 1):
    """A block of .4 x 1.0 m beside a curb of .1 m, pushed away from it at its top; before that pressed against the curb
    by a force that is applied and removed in ``steps`` steps."""
    text = header(normal_stiffness=1e10) + FLOOR
    text += block("curb", (-0.3, 0.0, 0.05), (0.2, 0.4, 0.1), "fixed = true")
    text += block("block", (0.0, 0.0, 0.5), (0.4, 0.4, 1.0))
    if squeeze:
        for i in range(steps):
            text += f'[[loads]]\nblock = "block"\nforce = [{-squeeze / steps}, 0.0, 0.0]\npoint = [0.2, 0.0, 0.05]\n'
            text += f"stages = {list(range(2 + i, 1 + 2 * steps - i))}\n"
        text += '[[stages]]\nkind = "statics"\n' * (1 + 2 * steps)
    text += jack("block", (-0.2, 0.0, 1.0)) + YIELD
    return toml.loads(text, overrides=[f"joint.shear_stiffness={shear}"])


def slabs(squeeze: float = 0.0):
    """A bar across two slabs between two walls, pushed along; before that the slabs are pressed against the walls."""
    text = header(normal_stiffness=1e10) + FLOOR
    for name, y in (("wl", -0.6), ("wr", 0.6)):
        text += block(name, (0.0, y, 0.2), (4.0, 0.2, 0.4), "fixed = true")
    for name, y in (("sa", -0.25), ("sb", 0.25)):
        text += block(name, (0.0, y, 0.2), (1.2, 0.5, 0.4))
        text += f'[[joints]]\nbetween = ["floor", "{name}"]\nformulation = "concave"\nfriction = 0.05\n'
        text += "normal_stiffness = 1.0e10\nshear_stiffness = 4.0e9\n"
        if squeeze:
            text += f'[[loads]]\nblock = "{name}"\nforce = [0.0, {np.sign(y) * squeeze}, 0.0]\nstages = [2]\n'
    text += block("b", (0.0, 0.0, 0.9), (0.4, 1.0, 1.0))
    if squeeze:
        text += '[[stages]]\nkind = "statics"\n' * 3
    return toml.loads(text + jack("b", (-0.2, 0.0, 1.4)) + YIELD)


def tower(friction: float = 0.6, blocks: int = 3, extra: str = "", height: float = 0.95):
    """A tower of .4 x .4 x .4 m blocks, the top one pushed."""
    text = header(friction=friction, normal_stiffness=1e10, keys=extra) + FLOOR
    for i in range(blocks):
        text += block(f"b{i}", (0.0, 0.0, 0.2 + 0.4 * i), (0.4, 0.4, 0.4))
    return toml.loads(text + jack(f"b{blocks - 1}", (-0.2, 0.0, height)) + YIELD)


def told(scenario, **asked) -> dict:
    return simulate(scenario, record=False, **asked).as_dict()


def test_a_block_that_grazes_a_curb_may_bear_more():
    """W b / 2 h without locked-in forces; friction at the curb may carry up to the associative limit load."""
    scenario = curb()
    answer, bound = told(scenario), limit(scenario)
    weight = DENSITY * G * 0.4 * 0.4 * 1.0
    assert answer["yield_point"]["V"] == pytest.approx(weight * 0.2 / 1.0, rel=1e-6)
    assert answer["path"]["slides"] is False  # no joint that carries a force slides
    assert answer["path_dependent"] is True and answer["no_path_above"] is False
    assert answer["associative"] == pytest.approx(bound.upper, rel=1e-9) and bound.lower > 1.5 * weight * 0.2
    squeezed = told(curb(squeeze=6000.0))
    assert answer["yield_point"]["V"] * 1.2 < squeezed["yield_point"]["V"] < bound.upper
    assert squeezed["path_dependent"] is True and squeezed["no_path_above"] is False
    said = lines_of(key_numbers(answer))
    assert "start without forces locked in: no path bears more than 970.3 N" in said["start"]
    assert "of this path" not in said["limit load V"]  # the stiffness does not change it
    assert not answer["path"]["digits_open"]


def test_no_more_is_claimed_where_limit_analysis_is_not_there(monkeypatch):
    monkeypatch.setattr("dembrick.simulation.limit_analysis.solver.installed", lambda: False)
    answer = told(curb())
    assert answer["associative"] is None and answer["no_path_above"] is False
    assert "another path may bear more" in lines_of(key_numbers(answer))["start"]
    squeezed = told(slabs(squeeze=30000.0))
    assert squeezed["associative"] is None and squeezed["no_path_above"] is True  # proven by the mechanism alone


def test_a_limit_at_the_bound_may_be_missed_from_below():
    as_built, squeezed = told(slabs()), told(slabs(squeeze=30000.0))
    half = 0.5 * DENSITY * G * 0.4 * 1.0 * 1.0
    slab = DENSITY * G * 1.2 * 0.5 * 0.4
    assert as_built["yield_point"]["V"] == pytest.approx(2 * 0.05 * (slab + half), rel=1e-4)
    assert squeezed["yield_point"]["V"] == pytest.approx(2 * half * 0.2 / 1.0, rel=1e-6)  # rocks about its edge
    assert squeezed["no_path_above"] is True and squeezed["path_dependent"] is True
    assert as_built["no_path_above"] is False and as_built["path_dependent"] is True
    said = lines_of(key_numbers(squeezed))["start"]
    assert "with the forces locked in by the stages: no path bears more, another history may bear less" in said


def test_wall_4_of_ferris_and_tin_loi_is_not_called_unique():
    answer = told(toml.load(SCENARIOS / "verification" / "ferris_tinloi_4.toml"))
    assert answer["collapse"]["load_factor"] == pytest.approx(0.263736, abs=1e-6)
    assert answer["associative"] == pytest.approx(0.33195, abs=1e-5)
    assert answer["path_dependent"] is True and answer["no_path_above"] is False


@pytest.mark.parametrize(("friction", "kind"), [(0.8, "rocking"), (0.1, "sliding")])
def test_statics_alone_gives_what_a_tower_carries(friction, kind):
    answer = told(tower(friction))
    weight = DENSITY * G * 0.4**3
    V = {"rocking": 3 * weight * 0.2 / 0.95, "sliding": 0.1 * weight}[kind]
    assert answer["yield_point"]["V"] == pytest.approx(V, rel=1e-3)
    assert answer["path_dependent"] is False and answer["no_path_above"] is True
    assert "start" not in lines_of(key_numbers(answer)) and not answer["path"]["digits_open"]


def test_a_lone_joint_has_one_limit_unless_it_remembers():
    assert told(tower(blocks=1, height=0.3))["path_dependent"] is False
    bonded = told(tower(blocks=1, height=0.3, extra="cohesion = 1.0e4\ntensile_strength = 1.0e4"))
    assert bonded["path_dependent"] is True
    assert "another history may bear less" in lines_of(key_numbers(bonded))["start"]


def test_a_tie_may_have_lost_its_tension():
    """A tie that yields in the mechanism has reached its strength: no path bears more, but one may bear less."""
    tie = """
[[ties]]
between = [{block = "floor", point = [-0.2, 0.0, 0.0]}, {block = "b1", point = [-0.2, 0.0, 0.8]}]
stiffness = 1.0e9
strength = 500.0
"""
    base = tower(blocks=2, height=0.75)
    scenario = toml.loads(toml.dumps(base) + tie)
    answer, bound = told(scenario), limit(scenario)
    assert answer["yield_point"]["V"] == pytest.approx(bound.load_factor, rel=1e-4)
    assert answer["no_path_above"] is True and answer["path_dependent"] is True


def test_the_bound_is_asked_for(tmp_path, capsys):
    scenario = tower()
    path = tmp_path / "tower.toml"
    path.write_text(toml.dumps(scenario), encoding="utf-8")
    assert told(scenario)["associative"] is None
    assert told(scenario, bound=True)["associative"] == pytest.approx(limit(scenario).upper, rel=1e-9)
    assert cli.main(["run", str(path), "--out", str(tmp_path / "t.h5"), "--bound", "--json"]) == 0
    assert '"associative": ' in capsys.readouterr().out
    statics = replace(scenario, text=None)
    text = toml.dumps(statics).partition("[[actuators]]")[0] + '[control]\nkind = "statics"\n'
    path.write_text(text, encoding="utf-8")
    assert cli.main(["run", str(path), "--out", str(tmp_path / "s.h5"), "--bound"]) == 2
    assert "--bound is for searches" in capsys.readouterr().err


def test_refine_finds_what_a_squeeze_makes_a_block_bear():
    """From the load that overturns it as built to its limit after it was pressed against the curb."""
    answer, squeezed = told(curb(), refine=True), told(curb(squeeze=6000.0, shear=4e10))
    low, high = answer["path"]["path_range"]
    assert low == pytest.approx(627.84, rel=1e-6)
    assert high == pytest.approx(squeezed["yield_point"]["V"], rel=0.01) and high > 880.0
    assert answer["yield_point"]["V_upper"] >= high and answer["associative"] > high
    assert answer["path"]["paths"][0] == answer["path"]["paths"][1]


def test_a_force_that_comes_and_goes_at_once_leaves_what_a_slow_one_does():
    """Slip depends on the path: loads on joints that already carry others are applied in increments."""
    once, slowly = (told(curb(6000.0, 4e10, steps))["yield_point"]["V"] for steps in (1, 10))
    assert once == pytest.approx(slowly, rel=1e-4)


def test_refine_finds_the_slabs_that_are_pressed_to_their_walls():
    answer = told(slabs(), refine=True)
    low, high = answer["path"]["path_range"]
    assert low == pytest.approx(863.28, rel=1e-4) and high == pytest.approx(1569.6, rel=1e-5)
    assert answer["yield_point"]["V_upper"] <= answer["associative"]


def test_a_range_ends_at_the_proven_bound():
    beside = {"associative": {"upper": 0.19}, "error_estimate": None}
    found = [(0.178, 0.18, 0.182), (0.193, 0.194, 0.195)]
    free, further = ranged(beside | {"associative": None}, 0.185, found, 2)
    beside, reach = ranged(beside, 0.185, found, 2)
    assert beside["path_range"] == [0.18, 0.19] and reach == [0.178, 0.19]
    assert free["path_range"] == [0.18, 0.194] and further == [0.178, 0.195]


@pytest.mark.parametrize(("scenario", "depends"), [(curb(), "true"), (tower(), "false")])
def test_a_study_says_what_depends_on_the_path(tmp_path, scenario, depends):
    study = write_study(tmp_path, '[grid]\n"joint.friction" = [0.5, 0.7]\n', toml.dumps(scenario))
    rows = read_csv(studies.sweep(study, tmp_path / "rows").csv)
    assert [row["path_dependent"] for row in rows] == [depends] * 2
    for row in rows:
        assert row["mechanism"] and row["blocks"]
        assert (row["associative"] == "") == (depends == "false")
        assert depends == "false" or float(row["associative"]) > float(row["V"])


def test_a_bracket_ends_at_the_proven_bound():
    point = simulate(curb(), record=False).yield_point
    wide = replace(point, V=1.0, V_lower=0.9, V_upper=1.1, V_peak=1.1)
    cut = cut_at_bound(wide, {"upper": 0.96})
    assert (cut.V_lower, cut.V_upper, cut.V_peak) == (0.9, 0.96, 0.96) and cut.V == pytest.approx(0.93)
    assert cut_at_bound(wide, {"upper": 1.05}).V == 1.0 and cut_at_bound(wide, {"upper": 1.05}).V_upper == 1.05
    assert cut_at_bound(wide, {"upper": 1.2}) == wide and cut_at_bound(wide, None) == wide
    snaps = replace(point, V=0.9, V_lower=0.9, V_upper=3.0, V_peak=0.9, bracket="open")
    cut = cut_at_bound(snaps, {"upper": 0.96})
    assert cut.bracket == "indicator" and cut.V == pytest.approx(0.93) and cut.half_width == pytest.approx(0.03)
    assert cut_at_bound(snaps, {"upper": 2.0}).bracket == "open", "still too wide for a limit"
