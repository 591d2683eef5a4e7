"""Assemblies and loads that cannot be meant: one sentence each, which says what is wrong, where, and what to do."""

import numpy as np
import pytest

from dembrick import scenario
from dembrick.cli import main
from dembrick.errors import ScenarioError
from dembrick.result import simulate

BASE = """
title = "bad"
gravity = [0.0, 0.0, -9.81]

[joint]
formulation = "concave"
friction = 0.6
normal_stiffness = 2.0e8
shear_stiffness = 8.0e7

[materials.stone]
density = 2000.0

[[blocks]]
name = "floor"
material = "stone"
box = [2.0, 2.0, 0.1]
position = [0.0, 0.0, -0.05]
fixed = true

[[blocks]]
name = "block"
material = "stone"
box = [0.3, 0.2, 0.1]
position = [0.0, 0.0, 0.05]
"""
WALL = '[[walls]]\nname = "wall"\nmaterial = "stone"\nblock = [0.3, 0.2, 0.1]\ncourses = 1\nblocks = 2\n'
WALL += "position = [0.0, 0.7, 0.0]\n"
DYNAMIC = '[control]\nkind = "dynamic"\nduration = 0.01\n'
TILT = '[control]\nkind = "tilt"\naxis = [1.0, 0.0, 0.0]\nrate = 10.0\ndisplacement = 0.001\n'
SINE = "sine = { amplitude = 0.5, frequency = 3.0 }\n"


def load(block, more=""):
    return f'[[loads]]\nblock = "{block}"\nforce = [1.0, 0.0, 0.0]\n{more}'


YIELD = '[[actuators]]\nname = "jack"\nblock = "block"\npoint = [0.0, 0.0, 0.0]\ndirection = [1.0, 0.0, 0.0]\n'
YIELD += '[control]\nkind = "yield"\ntolerance = 1.0e-3\n'
BAD = {
    "a load on a fixed block": (
        DYNAMIC + load("floor"),
        "load number 1 acts on 'floor', which is fixed.*remove the load",
    ),
    "a load on a group that is fixed": (
        'supports = ["wall"]\n' + BASE + WALL + DYNAMIC + load("block") + load("wall"),
        "load number 2 acts on 'wall', which is fixed",
    ),
    "a load that varies in a search": (
        YIELD + load("block", SINE),
        "load number 1 on 'block' varies.*'yield'.*its sine",
    ),
    "a load that varies on a table": (TILT + load("block", SINE), "load number 1 on 'block' varies.*'tilt'.*its sine"),
    "a history in a push": (
        '[control]\nkind = "pushover"\ndirection = [1.0, 0.0, 0.0]\n' + load("block", 'history = "a.csv"\n'),
        "varies with time.*'pushover'.*its history",
    ),
    "a load faster than the time step": (
        DYNAMIC + load("block", SINE.replace("3.0", "3.0e4")),
        "load number 1: sine.frequency = 30000 Hz swings in 3.33e-05 s, and the time step is 0.000231 s; lower",
    ),
    "a fixed block with a velocity": (
        BASE.replace("fixed = true", "fixed = true\nvelocity = [0.0, 1.0, 0.0]") + DYNAMIC,
        "block 'floor' is fixed and has a velocity; remove one of the two.*base-motion",
    ),
    "a fixed block that spins": (
        'supports = ["block"]\n' + BASE + "angular_velocity = [0.0, 0.0, 1.0]\n" + WALL + DYNAMIC,
        "block 'block' is fixed and has a velocity",
    ),
    "a table that turns about gravity": (
        TILT.replace("1.0, 0.0, 0.0", "0.0, 0.0, -2.0"),
        r"control.axis = \[0.0, 0.0, -1.0\] is out of range: it lies along gravity, which a tilt has to turn",
    ),
    "a table without gravity": (BASE.replace("-9.81", "0.0") + TILT, "control.axis.* it lies along gravity"),
    "a run without end": (
        DYNAMIC.replace("0.01", "1.0e300"),
        "control.duration = 1e.300 would take 4.33e.303 steps.*shorten it",
    ),
    "a table that hardly turns": (
        TILT.replace("10.0", "1.0e-9"),
        "control.rate = 1e-09 would take .* steps.*tilt faster",
    ),
}


@pytest.mark.parametrize("text, match", BAD.values(), ids=BAD)
def test_what_cannot_be_meant_is_refused(text, match):
    text = text if text.startswith(("supports", "\ntitle")) else BASE + text
    with pytest.raises(ScenarioError, match=match) as caught:
        simulate(scenario.loads(text))
    assert "\n" not in str(caught.value)


SLAB = WALL.replace("0.7, 0.0]", "0.7, 0.1]").replace("courses", "base = 0.1\ncourses")


@pytest.mark.parametrize("text", [DYNAMIC + load("block", SINE), SLAB + DYNAMIC + load("wall")])
def test_what_can_be_meant_is_not(text):
    """A load that varies while time passes; one on a whole wall, the slab under which is fixed."""
    simulate(scenario.loads(BASE + text))


@pytest.mark.parametrize("factor", [1e200, 1e-9])
def test_a_mesh_in_another_unit(tmp_path, capsys, factor):
    meshio = pytest.importorskip("meshio")
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    meshio.write_points_cells(tmp_path / "tall.obj", factor * corners, [("triangle", faces)])
    mesh = '[[blocks]]\nname = "mesh"\nmaterial = "stone"\nmesh = "tall.obj"\nposition = [0.0, 0.0, 1.0]\n'
    (tmp_path / "scene.toml").write_text(BASE + mesh + DYNAMIC)
    assert main(["check", str(tmp_path / "scene.toml")]) == 2
    error = capsys.readouterr().err
    assert f"tall.obj: the surface is {factor:.3g} m across" in error and "scale" in error and error.count("\n") == 1
    (tmp_path / "tall.obj").write_text("")
    assert main(["check", str(tmp_path / "scene.toml")]) == 2
    assert "tall.obj: there is no surface in it" in capsys.readouterr().err
