"""Joints that a stage makes weaker than what they bear: they give way under the loads of before, and then loads come.

A block that may not turn is pushed along y; a tie holds it beside its joint. With the joint at its strength mu N the
tie has the rest. What is pressed on it later changes nothing, and what is pushed later the two share as springs.
"""

from dataclasses import replace

import numpy as np
import pytest

import dembrick
from dembrick.runs.simulate import simulate
from dembrick.scenario import toml
from dembrick.scenario.controls import PushoverControl
from helpers.scenario_text import block, header

AREA, PRESSED, PUSHED, TIE = 0.3 * 0.2, 500.0, 155.0, 2e8  # m2, N, N, N/m
SHEAR = 4e9 * AREA  # N/m
WEIGHT = AREA * 0.1 * 2000.0 * 9.81
BLOCKS = (
    block("lower", (0.0, 0.0, -0.05), (0.3, 0.2, 0.1), "fixed = true")
    + block("upper", (0.0, 0.0, 0.05), (0.3, 0.2, 0.1), 'held = ["rx", "ry", "rz"]')
    + block("anchor", (0.0, 0.45, 0.05), (0.1, 0.1, 0.1), "fixed = true")
)
ENDS = '{ block = "anchor", point = [0.0, 0.4, 0.05] }, { block = "upper", point = [0.0, 0.1, 0.05] }'
HELD = f"[[ties]]\nbetween = [{ENDS}]\nstiffness = {TIE}\n"
LAW = '[[joints]]\nbetween = ["lower", "upper"]\n'
POINTS = {"distributed": "points = [3, 3]\n"}


def load(force, more=""):
    return f'[[loads]]\nblock = "upper"\npoint = [0.0, 0.0, 0.0]\nforce = {force}\n{more}'


def scene(formulation, large, weaker, pressed, pushed=0.0, tie=HELD, bond=""):
    """Two stages: the second with a ``weaker`` law, and so much more (N) that presses and pushes."""
    more = bond + POINTS.get(formulation, "")
    text = header(formulation, 0.34, 1e10).replace("[joint]\n", f"[joint]\n{more}") + BLOCKS + tie
    text += load([0.0, 0.0, WEIGHT - PRESSED]) + load([0.0, -PUSHED, 0.0], "stages = [1]\n")
    text += load([0.0, -PUSHED - pushed, -pressed], "stages = [2]\n") + f"{LAW}{weaker}\nstages = [2]\n"
    how = f'kind = "statics"\nlarge_displacements = {"true" if large else "false"}\n'
    return toml.loads(f"{text}[[stages]]\n{how}[control]\n{how}")


def borne(found):
    """What joint and tie bear against the push (N)."""
    return np.array([found.reactions["lower"][1], found.as_dict()["ties"][0]["tension"]])


@pytest.mark.parametrize("formulation, pressed, pushed, large", [
    (formulation, pressed, pushed, bool((i + k) % 2))  # every pair of two of them at least once
    for i, formulation in enumerate(("concave", "convex", "distributed"))
    for k, (pressed, pushed) in enumerate([(950.0, 0.0), (950.0, 20.0), (200.0, 20.0)])
])  # fmt: skip
def test_joints_give_way_before_loads_come(formulation, large, pressed, pushed):
    found = simulate(scene(formulation, large, "friction = 0.1", pressed, pushed), record=False)
    joint = 0.1 * PRESSED + pushed * SHEAR / (SHEAR + TIE)
    statics = found.as_dict()["statics"]
    assert borne(found) == pytest.approx([joint, PUSHED + pushed - joint], abs=statics["force_error"])
    assert statics["path_error"] < 1e-3


@pytest.mark.parametrize("large", [False, True])
@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_bonds_that_get_too_weak_break_before_loads_come(formulation, large):
    bond = "cohesion = 5e3\ntensile_strength = 1e3\nresidual_friction = 0.1\n"
    weaker = "friction = 0.1\ncohesion = 100.0\ntensile_strength = 1e3\nresidual_friction = 0.1"
    found = simulate(scene(formulation, large, weaker, 950.0, 20.0, bond=bond), record=False)
    joint = 0.1 * PRESSED + 20.0 * SHEAR / (SHEAR + TIE)
    statics = found.as_dict()["statics"]
    assert borne(found) == pytest.approx([joint, PUSHED + 20.0 - joint], abs=statics["force_error"])


@pytest.mark.parametrize("large", [False, True])
def test_no_bar_is_said_where_nothing_holds_the_loads_of_before(large):
    """0.23 x 500 N is less than the push: the block slides until more presses on it, and how far nobody knows."""
    heard = []
    found = simulate(scene("concave", large, "friction = 0.23", 950.0, tie=""), record=False, report=heard.append)
    statics = found.as_dict()["statics"]
    assert statics["stands"] and statics["path_error"] is None and statics["force_error"] is None
    assert any("no equilibrium was found under the loads of the stage before" in remark for remark in heard)


@pytest.mark.parametrize("large", [False, True])
def test_a_search_begins_where_joints_have_given_way_before_its_loads_came(large, tmp_path):
    """The stage before it in either geometry; V grows from nothing, so that its first row has the rest alone."""
    given = scene("concave", large, "friction = 0.1", 950.0, tie=f"{HELD}strength = 300.0\n")
    pushover = PushoverControl(direction=(0.0, -1.0, 0.0), large_displacements=True)
    found = simulate(replace(given, control=pushover, text=None), tmp_path / "search.h5")
    with dembrick.read_history(tmp_path / "search.h5") as history:
        assert history.load[0] == 0.0
        assert -history.joint("V_2")[0, 0] == pytest.approx(0.1 * PRESSED, abs=0.01)
    assert found.yield_point.V == pytest.approx((0.1 * (PRESSED + 950.0) + 300.0 - PUSHED) / WEIGHT, rel=2e-3)


def test_joints_that_get_weaker_on_the_way_give_way_before_loads_come(tmp_path):
    """A jack pushes, and while it does so friction falls and more presses on the block."""
    text = header("concave", 0.34, 1e10) + BLOCKS + HELD + load([0.0, 0.0, WEIGHT - PRESSED])
    text += '[[actuators]]\nname = "jack"\nblock = "upper"\npoint = [0.0, 0.0, 0.05]\ndirection = [0.0, -1.0, 0.0]\n'
    text += '[control]\nkind = "yield"\nlarge_displacements = true\ntolerance = 1e-3\n'
    path, new = tmp_path / "jack.h5", tmp_path / "on.h5"
    simulate(toml.loads(text), path)
    with dembrick.read_history(path) as history:
        row = int(np.searchsorted(history.load, 0.5 * PUSHED))
        at, pushed = float(history.time[row]), float(history.load[row])
    loads = f'loads=[{{ block = "upper", force = [0.0, 0.0, {WEIGHT - PRESSED - 950.0!r}] }}]'
    dembrick.restart_at(path, at, new, ["joint.friction=0.02", loads], progress=False)
    with dembrick.read_history(new) as history:
        assert history.load[row + 1] == pushed > 0.02 * (PRESSED + 950.0)
        assert history.joint("N")[row + 1, 0] == pytest.approx(PRESSED + 950.0, abs=0.01)
        assert -history.joint("V_2")[row + 1, 0] == pytest.approx(0.02 * PRESSED, abs=0.01)
