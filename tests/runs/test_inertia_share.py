"""Rates at which inertia is visible in the load: a remark on standard error, which --quiet suppresses."""

import math

import pytest

from dembrick.assembly.build import assemble
from dembrick.cli import main
from dembrick.runs.outcomes.error_estimate import effective_mass, inertia_remark, inertia_share
from dembrick.runs.simulate import simulate
from dembrick.scenario import toml
from helpers.places import SCENARIOS

CURVE = SCENARIOS / "set2b_curve.toml"
CONCAVE = 'joint.formulation="concave"'


def test_a_slow_test_passes_without_a_word():
    said = []
    result = simulate(toml.load(CURVE, [CONCAVE]), record=False, report=said.append)
    assert said == [] and 0.0 <= inertia_share(result) < 0.003


def test_a_fast_test_is_remarked(capsys, tmp_path):
    """V_peak exceeds the limit by the inertia force, but by less than rate x sqrt(k m) of an undamped start."""
    words = ["run", str(CURVE), "--set", CONCAVE, "--set", "control.rate=1e-3", "--out", str(tmp_path / "fast.h5")]
    assert main(words) == 0
    assert "control.rate = 0.001 m/s is fast: inertia carries about 8.3 % of V" in capsys.readouterr().err
    assert main([*words, "--force", "--quiet"]) == 0
    assert "inertia" not in capsys.readouterr().err


def test_the_end_of_a_cyclic_test_is_no_limit():
    """A test that ends on its way back to zero: its last load is compared neither with inertia nor with theory."""
    changes = [CONCAVE, "actuators.jack.point=[0.075, 0, 0.05]", "control.protocol=[0, 1e-5, -1e-5, -8e-6]"]
    said = []
    result = simulate(toml.load(SCENARIOS / "set4a_cyclic.toml", changes), record=False, report=said.append)
    assert result.yield_point.bracket == "open" and 2.0 * abs(result.yield_point.V) < abs(result.yield_point.V_peak)
    assert inertia_share(result) is None and not any("inertia" in words for words in said)
    assert result.theory.V > 0.0 and result.theory.error is None


@pytest.mark.parametrize("stem, mass", [("shear", 9.0), ("set4a", 1.0 / (1.0 / 9.0 + 0.075**2 / 0.0975))])
def test_the_mass_that_an_actuator_speeds_up(stem, mass):
    """A block of 9 kg, 0.3 x 0.2 m in plan, pushed at the height of its centroid: the mass moves alone, or turns too if
    the push is 75 mm off the centroid."""
    changes = ["blocks.upper.position=[0.0, 0.0, 0.05]"]
    assembly = assemble(toml.load(SCENARIOS / f"{stem}.toml", changes))
    lever = 0.05**2 / (9.0 * (0.2**2 + 0.1**2) / 12.0)  # the joint is 50 mm below the centroid
    assert effective_mass(assembly) == pytest.approx(1.0 / (1.0 / mass + lever), rel=1e-12)


def test_a_fast_table_is_remarked():
    """The angle at which a block has visibly moved exceeds the onset by the tilt added during its fall."""
    changes = [
        'joint.formulation="concave"',
        "walls.wall.courses=4",
        "walls.wall.blocks=2",
        "control.displacement=0.05",
    ]
    said = []
    result = simulate(toml.load(SCENARIOS / "wall_tilt.toml", [*changes, "control.rate=5.0"]), report=said.append)
    onset, angle = (math.tan(math.radians(result.collapse[key])) for key in ("onset", "angle"))
    assert inertia_share(result) == pytest.approx(1.0 - onset / angle)
    assert said[-1] == inertia_remark(result) and said[-1].startswith("control.rate = 5 deg/s is fast")
