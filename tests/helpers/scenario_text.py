"""Scenarios as TOML: a whole one of which tests change a line, parts of others, and a check of refusals."""

import pytest

from dembrick.errors import ScenarioError
from dembrick.scenario import toml
from helpers.stone_scenes import GRAVITY

BASE = """\
title   = "One force at 0.25 a"
gravity = [0.0, 0.0, -9.81]

[joint]
formulation      = "convex"
friction         = 0.64
normal_stiffness = 1.0e10
shear_stiffness  = 4.0e9

[materials.tuff]
density = 1500.0

[[blocks]]
name     = "lower"
material = "tuff"
box      = [0.3, 0.2, 0.1]
position = [0.0, 0.0, -0.05]
fixed    = true

[[blocks]]
name     = "upper"
material = "tuff"
box      = [0.3, 0.2, 0.1]
position = [0.0, 0.0, 0.05]

[[loads]]
block = "upper"
force = [0.0, 0.0, -378.71]

[[actuators]]
name      = "jack"
block     = "upper"
point     = [0.075, 0.0, 0.0]
direction = [0.0, 1.0, 0.0]

[control]
kind      = "yield"
tolerance = 1.0e-3
"""


def header(
    formulation="concave", friction=0.6, normal_stiffness=1e9, *, title="test", gravity=GRAVITY, density=2000.0, keys=""
):
    """Title, gravity, one joint law (ks = 0.4 kn, further ``keys``) and one material, ``stone``; units Pa/m, kg/m3."""
    return f"""
title = "{title}"
gravity = {list(gravity)}
[joint]
formulation = "{formulation}"
friction = {friction}
normal_stiffness = {normal_stiffness}
shear_stiffness = {0.4 * normal_stiffness}
{keys}
[materials.stone]
density = {density}
"""


def block(name, position, box=(0.3, 0.2, 0.1), more=""):
    """One block of ``stone``; ``more`` holds further lines of its table."""
    return f"""
[[blocks]]
name = "{name}"
material = "stone"
box = {list(box)}
position = {list(position)}
{more}
"""


def jack(block, point, direction=(1.0, 0.0, 0.0), more=""):
    """An actuator named ``jack``; ``more`` holds further lines of its table."""
    return f"""
[[actuators]]
name = "jack"
block = "{block}"
point = {list(point)}
direction = {list(direction)}
{more}
"""


def refused(text, *fragments, **options):
    with pytest.raises(ScenarioError) as caught:
        toml.loads(text, "test.toml", **options)
    message = str(caught.value)
    assert message.startswith("test.toml") or "of test.toml" in message or "in test.toml" in message
    assert "\n" not in message
    for fragment in fragments:
        assert fragment in message
    return message
