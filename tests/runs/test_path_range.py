"""--refine of a search: the range of limits on other paths of the same structure, and the bar that covers it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dembrick import cli
from dembrick.errors import ScenarioError
from dembrick.runs.limit import limit
from dembrick.runs.outcomes.error_estimate import RATIOS, refinements, with_ratio
from dembrick.runs.path_dependence import ranged
from dembrick.runs.simulate import simulate
from dembrick.scenario import toml
from dembrick.scenario.controls import PushoverControl, StaticsControl, TiltControl, YieldControl
from dembrick.scenario.generators import Wall
from dembrick.scenario.model import Actuator, Block, JointLaw, Material, Scenario
from dembrick.views.key_numbers import key_numbers
from dembrick.views.summary import known
from helpers.key_lines import key_lines, words
from helpers.stone_scenes import of_stone


def slope(ratio: float) -> Scenario:
    """Adjacent columns of different heights on the steps of a slope of 20 deg; the table tilts further."""
    along, up = (np.array([np.cos(a), np.sin(a)]) for a in np.radians([20.0, 110.0]))

    def block(name, corner, width, height, fixed=False):
        ring = [corner, corner + width * along, corner + width * along + height * up, corner + height * up]
        corners = tuple((float(x), y, float(z)) for y in (-0.5, 0.5) for x, z in ring)
        return Block(name, "stone", vertices=corners, fixed=fixed)

    heights = (1.0, 3.2, 3.6, 1.8)
    blocks = []
    for i, height in enumerate(heights):
        corner = i * (along + 0.1 * up)
        blocks += [
            block(f"column {i}", corner, 1.0, height),
            block(f"step {i}", corner - 0.5 * up, 1.0, 0.5, fixed=True),
        ]
    law = JointLaw("concave", 0.8, 1e9, ratio * 1e9)
    control = TiltControl((0.0, -1.0, 0.0))
    return of_stone(law, control, blocks, materials={"stone": Material(2500.0)})


def wall(ratio: float, friction: float, direction=(1.0, 0.0, 0.0)) -> Scenario:
    law = JointLaw("concave", friction, 1e10, ratio * 1e10)
    parts = Wall("wall", "stone", (0.4, 0.2, 0.2), courses=4, blocks=3, base=0.2)
    return of_stone(law, PushoverControl(direction), walls=(parts,))


def test_bars_of_one_structure_hold_each_others_answers():
    found = [simulate(slope(ratio), record=False, refine=True) for ratio in (0.1, 4.0)]
    spread = [result.collapse["load_factor"] for result in (*found, simulate(slope(0.4), record=False))]
    for result in found:
        point, fallen = result.yield_point, result.collapse
        low, high = fallen["path_range"]
        assert point.V_lower <= low <= fallen["load_factor"] <= high <= point.V_upper
        assert point.half_width >= fallen["error_estimate"] >= 0.0
        for V in spread:
            assert point.V_lower * (1 - 1e-6) <= V <= point.V_upper * (1 + 1e-6)
        assert fallen["paths"][0] == fallen["paths"][1] and "path range" in key_lines(result)


def test_what_only_rocks_depends_on_no_path():
    """A leaf overturns out of plane about its lowest course: t / H."""
    result = simulate(wall(0.4, 0.8, (0.0, 1.0, 0.0)), record=False, refine=True)
    fallen = result.collapse
    assert fallen["mechanism"] == "rocking" and not fallen["slides"]
    assert fallen["path_range"] == pytest.approx([0.25, 0.25], rel=1e-3)
    alone = simulate(wall(0.4, 0.8, (0.0, 1.0, 0.0)), record=False)
    assert alone.collapse["path_range"] is None and "of this path" not in key_lines(alone)["load factor"]


def test_a_wall_that_slides_whole_has_one_limit():
    """The limit mu equals the associative bound, whose mechanism does no work on forces that friction leaves open."""
    result = simulate(wall(0.4, 0.3), record=False)
    fallen = result.collapse
    assert fallen["slides"] and fallen["load_factor"] == pytest.approx(0.3, rel=1e-3)
    assert fallen["associative"]["upper"] == pytest.approx(0.3, rel=1e-6)
    assert fallen["no_path_above"] and "of this path" not in key_lines(result)["load factor"]
    assert "no path bears more, another history may bear less" in key_lines(result)["start"]


def test_a_limit_below_the_bound_says_how_far_it_is_known(tmp_path, capsys):
    """A slope whose columns slide on one another: the bracket of 1e-3 of one path is no error bar."""
    scenario = slope(0.4)
    result = simulate(scenario, record=False)
    fallen, bound = result.collapse, limit(scenario)
    assert fallen["path_dependent"] and fallen["associative"]["upper"] == pytest.approx(bound.upper, rel=1e-9)
    assert fallen["load_factor"] < 0.99 * bound.upper
    path = tmp_path / "slope.toml"
    path.write_text(toml.dumps(scenario), encoding="utf-8")
    assert cli.main(["run", str(path), "--out", str(tmp_path / "s.h5")]) == 0
    said = capsys.readouterr().out
    about = f"{fallen['load_factor']:.2g}"
    told = f"load factor about {about} (of this path, at most {bound.upper:.5g} on any path; --refine gives the range)"
    assert told in words(said) and "\nV  " not in said
    assert "+-" not in said.partition("joint forces")[0] and f"{fallen['load_factor']:.4g}" not in said
    assert cli.main(["info", str(tmp_path / "s.h5")]) == 0
    assert told in words(capsys.readouterr().out)
    lines = {line.name: line for line in key_numbers(result.as_dict())}
    assert lines["load factor"].value == f"about {about}" and "on any" in lines["load factor"].remark


def test_without_a_solver_nothing_is_called_unique(monkeypatch):
    monkeypatch.setattr("dembrick.simulation.limit_analysis.solver.installed", lambda: False)
    result = simulate(wall(0.4, 0.3), record=False)
    assert result.collapse["path_dependent"] and result.collapse["associative"] is None
    assert "--refine gives the range, --bound an upper bound" in key_lines(result)["load factor"]


def pushed_wall() -> Scenario:
    """The last whole block of the second course pushed along the wall by an actuator; the course above restrains it."""
    actuator = Actuator("push", "wall.2.1", (0.0, 0.0, 0.3), (1.0, 0.0, 0.0))
    return replace(wall(0.4, 0.5), control=YieldControl(), actuators=(actuator,))


def test_actuators_have_a_range_as_well():
    result = simulate(pushed_wall(), record=False, refine=True)
    point, path, bound = result.yield_point, result.path, limit(pushed_wall())
    low, high = path["path_range"]
    assert path["slides"] and path["paths"][0] >= 4 and result.collapse is None
    assert point.V_lower <= low <= point.V <= high <= point.V_upper
    assert high <= bound.upper * (1.0 + 1e-3)
    told = result.as_dict()
    assert told["path"]["path_range"] == [low, high] and key_lines(result)["path range"].count(" N") == 1


@pytest.mark.parametrize(
    "value, error, text",
    [
        (0.121345, 0.035, "0.121"),
        (0.121345, None, "0.12"),
        (215.9881, 0.067, "215.988"),
        (301.775, 25.0, "302"),
        (12345.6, None, "12000"),
        (0.0, 1.0, "0"),
        (0.5, 0.0, "0.5"),
    ],
)
def test_no_more_digits_than_are_known(value, error, text):
    assert known(value, error) == text


def test_which_paths_are_followed():
    scenario = wall(0.4, 0.3)
    others = refinements(scenario)
    ratios = [one.scenario.joint.shear_stiffness / one.scenario.joint.normal_stiffness for one in others]
    assert ratios == pytest.approx([0.1, 1.0, 4.0, 0.4, 0.4]) and [one.steps for one in others] == [1, 1, 1, 1, 0.5]
    assert others[3].scenario.joint.normal_stiffness == 2e10
    assert len(refinements(with_ratio(scenario, 0.3))) == len(RATIOS) + 2
    with pytest.raises(ScenarioError, match="nothing to estimate"):
        refinements(replace(scenario, control=StaticsControl()))


def test_the_bar_reaches_as_far_as_the_furthest_bracket_on_either_side():
    """Each path has a bracket of its own, and its limit may be anywhere in that."""
    alone = {"error_estimate": None}
    for found, range_, reach, error in [
        ([(7.9, 8.0, 8.1), (10.4, 10.5, 10.6)], [8.0, 10.5], [7.9, 10.6], 2.1),
        ([(9.7, 9.8, 9.9), (12.0, 13.0, 14.0)], [9.8, 13.0], [9.7, 14.0], 4.0),
    ]:
        beside, ends_ = ranged(alone, 10.0, found, 3)
        assert beside["path_range"] == range_ and ends_ == reach and beside["paths"] == [3, 4]
        assert beside["error_estimate"] == pytest.approx(error)
        assert ranged({"error_estimate": 5.0}, 10.0, found, 3)[0]["error_estimate"] == 5.0


def test_limits_of_one_wall_that_differ_by_the_stiffness_are_within_each_bar():
    """The limits differ by less than the tolerance of a search; the bars are narrower than that."""
    law = JointLaw("concave", 0.36587, 1e10, 4e9)
    parts = Wall("wall", "stone", (0.52217, 0.2, 0.19126), courses=4, blocks=3, base=0.2, ends="half")
    scenario = of_stone(law, PushoverControl((0.94569, 0.32507, 0.0)), walls=(parts,))
    points = [simulate(with_ratio(scenario, ratio), record=False, refine=True).yield_point for ratio in (0.1, 4.0)]
    for point in points:
        for other in points:
            assert point.V_lower * (1.0 - 1e-9) <= other.V <= point.V_upper * (1.0 + 1e-9)
