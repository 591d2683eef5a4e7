"""Distributed points lie inside the edge, so a block that rocks on them topples early; the program must report this."""

import numpy as np
import pytest

from dembrick import cli
from dembrick.assembly import build
from dembrick.assembly.contact_points import edge_shortfall
from dembrick.errors import ScenarioError
from dembrick.runs.simulate import simulate
from dembrick.scenario import toml
from dembrick.scenario.controls import DynamicControl, TiltControl, YieldControl
from dembrick.scenario.model import Actuator, JointLaw, Stack
from helpers.scenario_text import block, header, jack
from helpers.stone_scenes import of_stone

WIDE, HIGH, STONES = 0.3, 0.2, 4  # m: a pile that rocks at psi = atan(WIDE / (STONES * HIGH))


def pile(formulation, points=None, control=None, **more):
    return of_stone(
        JointLaw(formulation, 0.7, 1e11, 4e10, points),
        control or TiltControl((1.0, 0.0, 0.0), displacement=0.02, quasi_static=True),
        stacks=(Stack("pile", "stone", STONES, box=(0.5, WIDE, HIGH), base=0.1),),
        **more,
    )


@pytest.mark.parametrize("points", [None, (5, 4), (8, 20)])
def test_the_rim_is_what_is_missing(points):
    """The load factor is that of a pile narrowed by the gap; a shortfall is given only for points chosen by default."""
    given = pile("distributed", points)
    result = simulate(given, record=False)
    built = build.assemble(given)
    across = [built.contact_points[j].normal_arm @ built.joints[j].axes[:2, 1] for j in range(len(built.joints))]
    reached = min(np.abs(arm).max() for arm in across)
    assert result.collapse["mechanism"] == "rocking"
    assert result.collapse["load_factor"] == pytest.approx(2.0 * reached / (STONES * HIGH), rel=2e-3)
    assert len(built.warnings) == 1 and "inside the edge" in built.warnings[0]
    if points is None:
        assert result.points_miss == pytest.approx(2.0 * reached / WIDE - 1.0, abs=0.02) and not result.agrees()
    else:
        assert result.points_miss is None and result.agrees()


def test_nothing_is_missing_elsewhere():
    for formulation in ("concave", "convex"):
        given = pile(formulation)
        assert build.assemble(given).warnings == ()
    result = simulate(pile("concave"), record=False)
    assert result.points_miss is None
    assert result.collapse["load_factor"] == pytest.approx(WIDE / (STONES * HIGH), rel=1e-3)


def test_a_pile_pushed_at_its_top_and_one_that_slides():
    """The shortfall is reported if a jack overturns the pile, and not if the pile only slides."""

    def pushed(point):
        jack = Actuator("jack", "pile.4", point, (0.0, 1.0, 0.0))
        return simulate(pile("distributed", control=YieldControl(1e-3), actuators=(jack,)), record=False)

    high, low = pushed((0.0, 0.0, 0.8)), pushed((0.0, 0.0, 0.605))
    assert high.yield_point.mechanism == "rocking" and high.points_miss < -0.01 and not high.agrees()
    assert low.yield_point.mechanism == "sliding" and low.points_miss is None and low.agrees()


def test_it_is_said_in_motion_too():
    assert "inside the edge" in build.assemble(pile("distributed", control=DynamicControl(0.1))).warnings[0]


def test_gap_of_four_points():
    """Four points lie at the Gauss positions in both directions, 1 - 1/sqrt(3) of the half width inside the edge."""
    given = pile("distributed", (2, 2))
    built = build.assemble(given)
    gap = edge_shortfall(built.joints, built.contact_points, np.arange(len(built.joints)))
    np.testing.assert_allclose(gap, 1.0 - 1.0 / np.sqrt(3.0), rtol=1e-9)


def test_the_command_line_ends_with_three(folder, capsys):
    (folder / "pile.toml").write_text(
        header("distributed", 0.7, 1e11)
        + '[[stacks]]\nname = "pile"\nmaterial = "stone"\nblocks = 4\nbox = [0.5, 0.3, 0.2]\nbase = 0.1\n[control]\n'
        'kind = "tilt"\ndisplacement = 0.02\naxis = [1, 0, 0]\nquasi_static = true\n'
    )
    assert cli.main(["run", "pile.toml"]) == 3
    said = capsys.readouterr().err
    assert "half width inside the edge" in said and "deviate from the continuum by -" in said and "joint.points" in said


@pytest.mark.parametrize("points", ["[1, 1]", "[1, 3]", "[2, 1]"])
@pytest.mark.parametrize("control", ["statics", "yield"])
def test_points_in_one_line_hold_no_block(points, control):
    text = header("distributed", keys=f"points = {points}") + block("floor", (0.0, 0.0, -0.05), more="fixed = true")
    text += block("stone", (0.0, 0.0, 0.05)) + (jack("stone", (0.0, 0.0, 0.05)) if control == "yield" else "")
    with pytest.raises(
        ScenarioError, match="block 'stone' turns freely about the line .* give joint.points at least two"
    ):
        simulate(toml.loads(f'{text}[control]\nkind = "{control}"\n'), record=False)
