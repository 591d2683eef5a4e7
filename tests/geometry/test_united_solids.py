"""Several solids of a CAD file as one rigid block."""

import numpy as np
import pytest

import dembrick
from dembrick.assembly.build import assemble
from dembrick.errors import ScenarioError
from dembrick.scenario import toml
from helpers import cad_files
from helpers.scenario_text import header

# an L standing on its foot, drawn as two boxes, and a floor (m)
BOXES = {
    "floor": ((-2.0, -1.0, -0.2), (2.0, 1.0, 0.0)),
    "foot": ((0.0, -0.2, 0.0), (0.8, 0.2, 0.2)),
    "arm": ((0.0, -0.2, 0.2), (0.2, 0.2, 1.0)),
}
SCENE = (
    'supports = ["cad.floor"]'
    + header(friction=0.9, normal_stiffness=1e10)
    + """
[[models]]
name = "cad"
file = "l.obj"
unit = "m"
material = "stone"
united = {united}
[control]
kind = "pushover"
direction = [-1.0, 0.0, 0.0]
"""
)


def scene(folder, united='[["foot", "arm"]]'):
    cad_files.obj(folder / "l.obj", BOXES)
    return toml.loads(SCENE.format(united=united), folder / "scene.toml")


def test_two_solids_are_one_block(tmp_path):
    scenario = scene(tmp_path)
    found = assemble(scenario)
    assert found.names == ("cad.floor", "cad.foot") and len(found.joints) == 1
    foot, arm = 0.8 * 0.4 * 0.2, 0.2 * 0.4 * 0.8
    x, z = (0.4 * foot + 0.1 * arm) / (foot + arm), (0.1 * foot + 0.6 * arm) / (foot + arm)
    assert found.mass[1] == pytest.approx(2000.0 * (foot + arm), rel=1e-9)
    assert found.position[1] == pytest.approx((x, 0.0, z), abs=1e-9)
    # pushed towards -x it turns about the edge at x = 0
    assert dembrick.simulate(scenario, record=False).yield_point.V == pytest.approx(x / z, rel=1e-3)
    assert dembrick.limit(scenario).load_factor == pytest.approx(x / z, rel=1e-6)
    assert np.isclose(found.joints[0].area, 0.8 * 0.4)


def test_a_text_is_read_back(tmp_path):
    scenario = scene(tmp_path)
    (tmp_path / "again.toml").write_text(toml.dumps(scenario))
    assert toml.load(tmp_path / "again.toml").models == scenario.models


@pytest.mark.parametrize(
    ("united", "words"),
    [
        ('[["foot", "am"]]', "united = 'am' is not the name of a solid; did you mean 'arm'?"),
        ('[["foot"]]', "a united block needs at least 2 solids"),
        ('[["foot", "arm"], ["arm", "floor"]]', "a solid can be named only once"),
        ('["foot", "arm"]', "lists of names of solids"),
    ],
)
def test_what_is_wrong_is_said(tmp_path, united, words):
    with pytest.raises(ScenarioError) as error:
        scene(tmp_path, united)
    assert words in str(error.value)
