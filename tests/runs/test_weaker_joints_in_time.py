"""Runs in real time after a stage: they begin at its last equilibrium, in which joints that are too weak give way.

The scene is that of `test_weaker_joints_in_stages`. Joints give way under the loads of the stage before; those of the
run come, and those that end go, at once when time begins.
"""

import os

import numpy as np
import pytest

import dembrick
from dembrick.runs.simulate import restart, simulate
from dembrick.scenario import toml
from helpers.restart_cases import stop_in_stages
from helpers.scenario_text import header
from runs.test_weaker_joints_in_stages import BLOCKS, HELD, LAW, POINTS, PRESSED, PUSHED, WEIGHT, load

FREE = 'kind = "dynamic"\nduration = 0.02\n'
CONTROLS = {
    "free": FREE,
    "shaken": 'kind = "base-motion"\nduration = 0.01\ndirection = [1.0, 0.0, 0.0]\n'
    "sine = { amplitude = 0.1, frequency = 5.0 }\n",
    "tilted": 'kind = "tilt"\naxis = [1.0, 0.0, 0.0]\nrate = 10.0\ndisplacement = 1e-5\n',
    "pushed": 'kind = "pushover"\nquasi_static = false\ndirection = [0.0, -1.0, 0.0]\nrate = 1e-3\n'
    "displacement = 1e-5\n",
}
BOTH = pytest.mark.parametrize("large", [False, True], ids=["as drawn", "deformed"])


def scene(
    formulation,
    large,
    weaker,
    pressed=0.0,
    pushed=0.0,
    tie=HELD,
    bond="",
    control=FREE,
    before=PUSHED,
    more="",
    rows=400,
):
    """A `statics` stage, and a run in time with a ``weaker`` law and so much more (N) that presses and pushes."""
    text = header(formulation, 0.34, 1e10).replace("[joint]\n", f"[joint]\n{bond}{POINTS.get(formulation, '')}")
    text += BLOCKS + tie + load([0.0, 0.0, WEIGHT - PRESSED]) + load([0.0, -before, 0.0], "stages = [1]\n")
    text += load([0.0, -PUSHED - pushed, -pressed], "stages = [2]\n") + f"{LAW}{weaker}\nstages = [2]\n"
    large = "true" if large else "false"
    control = f'[[stages]]\nkind = "statics"\nlarge_displacements = {large}\n[control]\n{control}'
    return toml.loads(f"{text}{control}[output]\nrows = {rows}\nframes = 20\n{more}")


def borne(scenario, path, **how):
    """What the joint and the tie, if there is one, bear against the push in every row (N)."""
    simulate(scenario, path, **how)
    with dembrick.read_history(path) as history:
        return -history.joint("V_2")[:, 0], history.series("tension") if scenario.ties else None


@BOTH
@pytest.mark.parametrize(
    "formulation, pressed",
    [("concave", 0.0), *((one, 950.0) for one in ("concave", "convex", "corrected-shear", "distributed"))],
)
def test_joints_give_way_before_time_begins(formulation, large, pressed, tmp_path):
    """They would swing if they lost the force at once, and keep it if the new pressure came first."""
    joint, tie = borne(scene(formulation, large, "friction = 0.1", pressed), tmp_path / "run.h5")
    assert joint == pytest.approx(0.1 * PRESSED, abs=0.02)
    assert tie[:, 0] == pytest.approx(PUSHED - 0.1 * PRESSED, abs=0.02)


@BOTH
@pytest.mark.parametrize("control", ["shaken", "tilted", "pushed"])
def test_joints_have_given_way_when_what_drives_the_blocks_begins(control, large, tmp_path):
    tie = f"{HELD}strength = 120.0\n"
    joint, _ = borne(scene("concave", large, "friction = 0.1", tie=tie, control=CONTROLS[control]), tmp_path / "run.h5")
    assert joint[0] == pytest.approx(0.1 * PRESSED, abs=0.02)


@BOTH
@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_bonds_that_get_too_weak_break_before_time_begins(formulation, large, tmp_path):
    bond = "cohesion = 5e3\ntensile_strength = 1e3\nresidual_friction = 0.1\n"
    weaker = "friction = 0.1\ncohesion = 100.0\ntensile_strength = 1e3\nresidual_friction = 0.1"
    joint, tie = borne(scene(formulation, large, weaker, 950.0, bond=bond), tmp_path / "run.h5")
    assert joint == pytest.approx(0.1 * PRESSED, abs=0.02)
    assert tie[:, 0] == pytest.approx(PUSHED - 0.1 * PRESSED, abs=0.02)


@BOTH
@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_blocks_that_nothing_holds_any_more_move_from_the_last_equilibrium(formulation, large, tmp_path):
    """They slide by (F - mu N) / m t^2 / 2 from rest, and the run says why."""
    heard = []
    given = scene(formulation, large, "friction = 0.23", tie="")
    joint, _ = borne(given, tmp_path / "run.h5", report=heard.append)
    assert any("no equilibrium was found under the loads of the stage before" in remark for remark in heard)
    assert joint == pytest.approx(0.23 * PRESSED, abs=0.05)
    with dembrick.read_history(tmp_path / "run.h5") as history:
        slid = 0.5 * (PUSHED - 0.23 * PRESSED) / (WEIGHT / 9.81) * history.time**2
        assert history.displacement == pytest.approx(slid, abs=1e-4 * slid[-1])


@BOTH
@pytest.mark.parametrize("before, pushed", [(PUSHED, -60.0), (PUSHED, 20.0), (0.0, 0.0)], ids=["less", "more", "new"])
def test_loads_that_come_or_go_with_time_do_so_at_once(before, pushed, large, tmp_path):
    """Without losses the block swings as far beyond its new equilibrium as it began before it."""
    control = f"{FREE}restitution = 1.0\n"
    given = scene("convex", large, "friction = 0.9", 0.0, pushed, tie="", control=control, before=before)
    after = PUSHED + pushed
    joint, _ = borne(given, tmp_path / "run.h5")
    assert joint[0] == pytest.approx(before, abs=0.01)
    reached = joint.min() if after < before else joint.max()
    assert reached == pytest.approx(2.0 * after - before, abs=0.01 * abs(after - before) + 0.01)


@BOTH
def test_a_run_stopped_in_time_goes_on_from_where_joints_have_given_way(large, tmp_path, monkeypatch):
    monkeypatch.setattr(os, "fsync", lambda _: None)
    given = scene("concave", large, "friction = 0.1", 950.0, rows=20)
    whole, _ = borne(given, tmp_path / "whole.h5")
    stop_in_stages(given, tmp_path / "run.h5", lambda where, _: "(t = " in where)
    restart(tmp_path / "run.h5")
    with dembrick.read_history(tmp_path / "run.h5") as history:
        np.testing.assert_array_equal(-history.joint("V_2")[:, 0], whole)


@BOTH
def test_a_change_at_a_moment_of_a_run_in_time_is_sudden(large, tmp_path):
    """Nothing rests there: the joint has the new strength in the next row, and the block swings on its tie."""
    given = scene("convex", large, "friction = 0.34", control=f"{FREE}restitution = 1.0\n")
    before, _ = borne(given, tmp_path / "run.h5")
    weaker = 'joints=[{ between = ["lower", "upper"], friction = 0.1, stages = [2] }]'
    dembrick.restart_at(tmp_path / "run.h5", 0.01, tmp_path / "on.h5", [weaker], progress=False)
    with dembrick.read_history(tmp_path / "on.h5") as history:
        now, tie = history.time > 0.0101, history.series("tension")[:, 0]
        assert before[-1] > 84.0 and (-history.joint("V_2")[now, 0]).max() <= 0.1 * PRESSED + 0.02
        assert tie[now].max() == pytest.approx(2.0 * (PUSHED - 0.1 * PRESSED) - (PUSHED - before[-1]), rel=0.01)


@BOTH
def test_a_load_that_begins_at_zero_moves_nothing_before(large, tmp_path):
    """A sine acts in full in statics and grows from zero in time; dashpots lag by 0.03 N."""
    wave = load([0.0, -20.0, 0.0], "stages = [2]\nsine = { amplitude = 1.0, frequency = 1.0 }\n")
    given = scene("convex", large, "friction = 0.34", tie="", more=wave)
    joint, _ = borne(given, tmp_path / "run.h5")
    with dembrick.read_history(tmp_path / "run.h5") as history:
        assert joint == pytest.approx(PUSHED + 20.0 * np.sin(2.0 * np.pi * history.time), abs=0.05)
