"""The error bar of `--refine` covers the limit of rigid blocks and grows with the sources of error of a run."""

import math

import pytest

from dembrick import cli
from dembrick.errors import ScenarioError
from dembrick.runs.outcomes.error_estimate import refinements
from dembrick.runs.simulate import simulate
from dembrick.scenario import toml
from dembrick.scenario.blocks import Block
from dembrick.scenario.controls import PushoverControl
from dembrick.views.key_numbers import key_numbers
from helpers.places import SCENARIOS
from helpers.scenario_text import block, header
from helpers.stone_scenes import law, of_stone

PULSE = 9.81 * 0.5 * 0.2**2 * (0.5 - 0.2) * 0.5 / 0.2  # m: Newmark's block, 0.5 g for 0.2 s, friction 0.2


def wall(formulation, *changes):
    given = (f'joint.formulation="{formulation}"', "walls.wall.courses=5", "walls.wall.blocks=2", *changes)
    return toml.load(SCENARIOS / "wall_tilt.toml", list(given))


@pytest.mark.parametrize("formulation, rate", [("concave", 2.0), pytest.param("convex", 1.0, marks=pytest.mark.slow)])
def test_a_bar_holds_the_wall_of_rigid_blocks_tilted_slowly(formulation, rate):
    """t / H = 0.4; soft convex joints fall early and a fast table records it late, and these errors must not cancel."""
    fallen = simulate(
        wall(formulation, "control.displacement=0.01", f"control.rate={rate}"), record=False, refine=True
    ).collapse
    away = abs(fallen["load_factor"] - 0.4)
    assert 1e-3 < away < fallen["error_estimate"] < 0.05


@pytest.mark.parametrize("stiffness", [1e10, pytest.param(1e9, marks=pytest.mark.slow)])
def test_a_bar_holds_the_rigid_block_that_is_pushed_over_a_convex_joint(stiffness):
    """The contact strip at its edge makes the error c k^-1/3 plus lower-order terms: the first term alone is no bar."""
    floor = Block("floor", "stone", (4.0, 4.0, 0.2), (0.0, 0.0, -0.1), fixed=True)
    block = Block("block", "stone", (0.2, 0.4, 0.4), (0.0, 0.0, 0.2))
    control = PushoverControl((1.0, 0.0, 0.0), quasi_static=False, rate=3e-3, displacement=4e-3)
    pushed = simulate(of_stone(law("convex", 0.9, stiffness), control, (floor, block)), record=False, refine=True)
    assert abs(pushed.collapse["load_factor"] - 0.5) < pushed.collapse["error_estimate"] < 0.1


def test_newmarks_block_is_in_the_bar_of_its_displacement():
    loose = "joint.shear_stiffness=2e7"
    bars = []
    for changes in ([], [loose]):
        result = simulate(toml.load(SCENARIOS / "newmark_pulse.toml", changes), record=False, refine=True)
        moved = result.as_dict()["displacement"]
        assert abs(moved - PULSE) < result.displacement_error
        bars.append(result.displacement_error)
    assert bars[0] < 2e-3 * PULSE and bars[1] > 2.0 * bars[0]


def test_every_kind_is_refined_or_refused():
    assert len(refinements(wall("concave"))) == 2
    assert len(refinements(wall("concave", "control.quasi_static=true"))) == 5  # three other ratios, stiffer, finer
    assert len(refinements(toml.load(SCENARIOS / "rocking_block.toml"))) == 2
    for stem in ("set4a", "set4a_curve"):
        with pytest.raises(ScenarioError, match="has the bracket of its limit load"):
            refinements(toml.load(SCENARIOS / f"{stem}.toml"))
    slower, stiffer = wall("concave", "control.rate=0.5"), refinements(wall("concave"))
    assert slower.control == stiffer[1].scenario.control and stiffer[0].scenario.joint.shear_stiffness == 8e9


def test_what_is_printed(folder, capsys):
    assert cli.main(["run", str(SCENARIOS / "newmark_pulse.toml"), "--refine"]) == 0
    said = capsys.readouterr().out
    (words,) = (line.split() for line in said.splitlines() if " +- " in line and line.startswith("residual"))
    moved, error = words[2], words[4]
    assert math.isclose(float(moved), 1e3 * PULSE, rel_tol=1e-3) and 0.0 < float(error) < 1.0 and words[5] == "mm"
    shown = {line.name: line for line in key_numbers({"displacement": 0.147, "displacement_error": 2e-4})}
    assert shown["displacement at the end"].value == "147.00 ± 0.20 mm"
    shown = {line.name: line for line in key_numbers({"displacement": 0.147})}
    assert "--refine" in shown["displacement at the end"].remark


def test_a_shaken_block_is_in_its_bar_though_twice_the_stiffness_changes_little():
    """A block on soft joints: its slip in time against a rigid block integrated here, v' = -a -+ mu (g + a_z)."""
    result = simulate(toml.loads(SHAKEN), record=False, refine=True)
    v = x = 0.0
    dt = 1e-6
    for k in range(940_000):
        a = 4.634260075286905 * math.sin(2.0 * math.pi * 3.2050210238157866 * (k + 0.5) * dt + 3.784411133585804)
        most = 0.264 * (9.81 + 0.25448019189207166 * a)
        along = -0.9670779864801878 * a
        if v == 0.0:
            v = math.copysign(max(0.0, abs(along) - most) * dt, along)
        else:
            now = v + (along - math.copysign(most, v)) * dt
            v = now if now * v > 0.0 else 0.0
        x += v * dt
    found = result.as_dict()["displacement"]
    assert abs(abs(x) - 0.01572) < 1e-5
    assert abs(found - abs(x)) < result.displacement_error < 0.2 * abs(x)


SHAKEN = (
    header("convex", 0.264, 29072616.5, title="shaken")
    + block("base", (0.0, 0.0, -0.1), (6.0, 6.0, 0.2), "fixed = true")
    + block("block", (0.0, 0.0, 0.025), (0.5, 0.5, 0.05))
    + """
[control]
kind = "base-motion"
restitution = 0.33
duration = 0.94
direction = [0.9670779864801878, 0.0, 0.25448019189207166]
sine = { amplitude = 4.634260075286905, frequency = 3.2050210238157866, phase = 3.784411133585804 }
"""
)
