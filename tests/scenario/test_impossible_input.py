"""Meaningless assemblies and loads: each is refused in one sentence that says what is wrong, where, and what to do."""

import numpy as np
import pytest

from dembrick.cli import main
from dembrick.errors import ScenarioError
from dembrick.runs.simulate import simulate
from dembrick.scenario import toml
from helpers.scenario_text import block, header

BASE = header(normal_stiffness=2e8)
BASE += block("floor", (0.0, 0.0, -0.05), (2.0, 2.0, 0.1), "fixed = true") + block("block", (0.0, 0.0, 0.05))
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
        "load number 1: sine.frequency = 30000 Hz has a period of 3.33e-05 s, too short for the time step of "
        "0.000227 s; lower",
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
        r"control.axis = \[0.0, 0.0, -1.0\] is out of range: it is parallel to gravity, which a tilt has to turn",
    ),
    "a table without gravity": (BASE.replace("-9.81", "0.0") + TILT, "control.axis.* it is parallel to gravity"),
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
        simulate(toml.loads(text))
    assert "\n" not in str(caught.value)


SLAB = WALL.replace("0.7, 0.0]", "0.7, 0.1]").replace("courses", "base = 0.1\ncourses")


@pytest.mark.parametrize("text", [DYNAMIC + load("block", SINE), SLAB + DYNAMIC + load("wall")])
def test_what_can_be_meant_is_not(text):
    """Valid input is not refused: a varying load in a dynamic run, and a load on a whole wall with a fixed slab."""
    simulate(toml.loads(BASE + text))


@pytest.mark.parametrize("factor", [1e200, 1e-12])
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
    assert "tall.obj: there is no surface in the file" in capsys.readouterr().err


def test_a_flat_mesh(tmp_path, capsys):
    """A box flattened onto a plane is refused: its surface is closed but encloses no volume."""
    meshio = pytest.importorskip("meshio")
    corners = np.array([[x, y, 0.0] for _ in range(2) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]) @ np.array(
        [[0.6, 0.0, 0.8], [0.0, 1.0, 0.0], [-0.8, 0.0, 0.6]]
    )
    faces = [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
    meshio.write_points_cells(tmp_path / "flat.obj", corners, [("quad", np.array(faces))])
    mesh = '[[blocks]]\nname = "mesh"\nmaterial = "stone"\nmesh = "flat.obj"\nposition = [0.0, 0.0, 1.0]\n'
    (tmp_path / "scene.toml").write_text(BASE + mesh + DYNAMIC)
    assert main(["check", str(tmp_path / "scene.toml")]) == 2
    error = capsys.readouterr().err
    assert "flat.obj: the surface is flat: all its corners lie in a plane; a block needs a volume" in error


ABSURD = {
    "a box too large": (
        "box = [0.3, 0.2, 0.1]",
        "box = [1e200, 1.0, 1.0]",
        "block 'block': it.* m across; it must be from 1e-09",
    ),
    "a box too small": (
        "box = [0.3, 0.2, 0.1]",
        "box = [1e-99, 1e-99, 1e-99]",
        "block 'block': it.* m across; it must be from",
    ),
    "a block far away": (
        "position = [0.0, 0.0, 0.05]",
        "position = [0.0, 0.0, 1e300]",
        "position of block 'block'.*from the",
    ),
    "a stiffness": ("= 200000000.0", "= 2.0e80", "normal_stiffness = 2e.80 is out of range: at most 1e.30 Pa/m"),
    "a density": ("= 2000.0", "= 2e200", "density of material 'stone' = 2e.200 is out of range"),
    "a gravity": ("-9.81", "-9.81e300", "gravity = .* is out of range: at most 1e.09 m/s2"),
    "a friction": ("friction = 0.6", "friction = 6e100", "friction = 6e.100 is out of range: at most 1e.12 is allowed"),
}


@pytest.mark.parametrize("old, new, match", ABSURD.values(), ids=ABSURD)
@pytest.mark.filterwarnings("error")
def test_numbers_that_cannot_be_computed_with(old, new, match):
    assert BASE.count(old) == 1
    with pytest.raises(ScenarioError, match=match):
        simulate(toml.loads(BASE.replace(old, new) + DYNAMIC))


@pytest.mark.parametrize(
    "more, match",
    [
        ("velocity = [1e300, 0.0, 0.0]\n" + DYNAMIC, "velocity of block 'block' = .* at most 1e.09 m/s"),
        (
            "angular_velocity = [0.0, 1e300, 0.0]\n" + DYNAMIC,
            "angular_velocity of block 'block' = .* at most 1e.09 rad/s",
        ),
        (DYNAMIC + load("block").replace("1.0", "1e300"), "force of load number 1 = .* at most 1e.30 N is allowed"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_speeds_and_forces_that_cannot_be_computed_with(more, match):
    with pytest.raises(ScenarioError, match=match):
        simulate(toml.loads(BASE + more))
