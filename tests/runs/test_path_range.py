"""--refine of a search: the range that other paths of the same structure lead to, and the bar that holds it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dembrick.errors import ScenarioError
from dembrick.runs.collapse import collapse_lines
from dembrick.runs.error_estimate import RATIOS, refinements, with_ratio
from dembrick.runs.simulate import simulate
from dembrick.scenario.controls import PushoverControl, StaticsControl, TiltControl
from dembrick.scenario.generators import Wall
from dembrick.scenario.model import Block, JointLaw, Material, Scenario


def slope(ratio: float, friction: float = 0.8, columns: int = 4) -> Scenario:
    """Columns of growing height on the steps of a slope of 20 deg, each against the next; the table tilts on."""
    along, up = (np.array([np.cos(a), np.sin(a)]) for a in np.radians([20.0, 110.0]))

    def block(name, corner, width, height, fixed=False):
        ring = [corner, corner + width * along, corner + width * along + height * up, corner + height * up]
        corners = tuple((float(x), y, float(z)) for y in (-0.5, 0.5) for x, z in ring)
        return Block(name, "stone", vertices=corners, fixed=fixed)

    heights = (1.0, 3.2, 3.6, 1.8)[:columns]
    blocks = []
    for i, height in enumerate(heights):
        corner = i * (along + 0.1 * up)
        blocks += [
            block(f"column {i}", corner, 1.0, height),
            block(f"step {i}", corner - 0.5 * up, 1.0, 0.5, fixed=True),
        ]
    law = JointLaw("concave", friction, 1e9, ratio * 1e9)
    control = TiltControl((0.0, -1.0, 0.0))
    return Scenario("slope", (0.0, 0.0, -9.81), law, {"stone": Material(2500.0)}, tuple(blocks), control)


def wall(ratio: float, friction: float, direction=(1.0, 0.0, 0.0)) -> Scenario:
    law = JointLaw("concave", friction, 1e10, ratio * 1e10)
    parts = Wall("wall", "stone", (0.4, 0.2, 0.2), courses=4, blocks=3, base=0.2)
    return Scenario(
        "wall", (0.0, 0.0, -9.81), law, {"stone": Material(2000.0)}, (), PushoverControl(direction), walls=(parts,)
    )


def test_bars_of_one_structure_hold_each_others_answers():
    found = [simulate(slope(ratio), record=False, refine=True) for ratio in (0.1, 0.4, 4.0)]
    spread = [result.collapse["load_factor"] for result in found]
    for result in found:
        point, fallen = result.yield_point, result.collapse
        low, high = fallen["path_range"]
        assert point.V_lower <= low <= fallen["load_factor"] <= high <= point.V_upper
        assert point.half_width >= fallen["error_estimate"] >= 0.0
        for V in spread:
            assert point.V_lower * (1 - 1e-6) <= V <= point.V_upper * (1 + 1e-6)
        assert fallen["paths"][0] == fallen["paths"][1] and "path range" in "".join(collapse_lines(fallen))


def test_what_only_rocks_depends_on_no_path():
    """Out of plane a leaf turns over its lowest course: t / H."""
    result = simulate(wall(0.4, 0.8, (0.0, 1.0, 0.0)), record=False, refine=True)
    fallen = result.collapse
    assert fallen["mechanism"] == "rocking" and not fallen["slides"]
    assert fallen["path_range"] == pytest.approx([0.25, 0.25], rel=1e-3)
    alone = simulate(wall(0.4, 0.8, (0.0, 1.0, 0.0)), record=False).collapse
    assert alone["path_range"] is None and "depends on the path" not in "".join(collapse_lines(alone))


def test_a_sliding_mechanism_says_that_it_depends_on_the_path():
    fallen = simulate(wall(0.4, 0.3), record=False).collapse
    assert fallen["slides"] and fallen["load_factor"] == pytest.approx(0.3, rel=1e-3)
    assert "depends on the path: --refine gives the range" in "".join(collapse_lines(fallen))


def test_which_paths_are_followed():
    scenario = wall(0.4, 0.3)
    others = refinements(scenario)
    ratios = [one.scenario.joint.shear_stiffness / one.scenario.joint.normal_stiffness for one in others]
    assert ratios == pytest.approx([0.1, 1.0, 4.0, 0.4, 0.4]) and [one.steps for one in others] == [1, 1, 1, 1, 0.5]
    assert others[3].scenario.joint.normal_stiffness == 2e10
    assert len(refinements(with_ratio(scenario, 0.3))) == len(RATIOS) + 2
    with pytest.raises(ScenarioError, match="nothing to estimate"):
        refinements(replace(scenario, control=StaticsControl()))
