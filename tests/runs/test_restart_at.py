"""A run continued from a moment of another: bit for bit the same if nothing changes, else against closed forms."""

import hashlib
import itertools
import json
import math
import os

import numpy as np
import pytest

import dembrick
from dembrick.cli import main
from dembrick.errors import HistoryError, OutputError, ScenarioError
from dembrick.simulation import interrupts
from dembrick.simulation.interrupts import Interrupted
from helpers.few_equilibria import few_equilibria
from helpers.restart_cases import content
from helpers.scenario_text import block, header

G, MU, M = 9.81, 0.3, 32.0
SLIDE = (
    header("concave", MU, 1e9)
    + block("floor", (0.0, 0.0, -0.1), (4.0, 1.0, 0.2), "fixed = true")
    + block("block", (0.0, 0.0, 0.05), (0.4, 0.4, 0.1), "velocity = [1.0, 0.0, 0.0]")
)
IN_TIME = SLIDE + '[control]\nkind = "dynamic"\nduration = 0.2\n[output]\nrows = 400\nframes = 40\n'


@pytest.fixture(scope="module")
def slide(tmp_path_factory):
    """A block that slides on a floor for 0.2 s, initially at 1 m/s."""
    path = tmp_path_factory.mktemp("slide") / "slide.h5"
    dembrick.simulate(dembrick.loads(IN_TIME), path, progress=False)
    return path


def go_on(path, at, *changes, name="new.h5"):
    new = path.parent / name
    result = dembrick.restart_at(path, at, new, changes, force=True, progress=False)
    return result, new


def same_rows(one, other):
    """Assert that two histories hold the same numbers, bit for bit."""
    found, there = content(one), content(other)
    for name, value in found.items():
        if isinstance(value, np.ndarray) and value.dtype.kind != "O" and name != "scenario":
            assert value.tobytes() == there[name].tobytes(), name


def at_row(path, at):
    """Time, displacement and index of the first row at or after a time."""
    with dembrick.read_history(path) as history:
        row = int(np.searchsorted(history.time, at * (1.0 - 1e-12)))
        return history.time[row], history.displacement[row], row


@pytest.mark.parametrize("at", [0.0, 0.03217, 0.1, 0.2])
def test_with_nothing_changed_it_is_the_same_run(slide, at):
    before = hashlib.sha256(slide.read_bytes()).hexdigest()
    _, new = go_on(slide, at)
    same_rows(slide, new)
    assert hashlib.sha256(slide.read_bytes()).hexdigest() == before


def test_with_less_friction_it_slides_farther(slide):
    """v = 1 - mu g t up to the row, then deceleration with mu = 0.1; rows before it are unchanged."""
    t, x, row = at_row(slide, 0.1)
    result, new = go_on(slide, 0.1, "joint.friction=0.1")
    v, left = 1.0 - MU * G * t, 0.2 - t
    expected = x + v * left - 0.5 * 0.1 * G * left**2
    with dembrick.read_history(new) as found, dembrick.read_history(slide) as old:
        assert found.displacement[-1] == pytest.approx(expected, rel=2e-4)
        assert np.array_equal(found.displacement[: row + 1], old.displacement[: row + 1])
        assert abs(found.joint("V_1")[-1, 0]) == pytest.approx(0.1 * M * G, rel=1e-3)
    assert result.energy.relative_residual < 1e-9


@pytest.mark.parametrize("prestress", [0.0, 50.0])
def test_a_tie_that_comes_pulls_from_the_length_of_that_moment(slide, prestress):
    """x'' = -(T_0 + k x) / m - mu g from the block's position then; the tie's length is the one at that moment."""
    k = 4000.0
    ends = '{block="floor", point=[-1.0,0.0,0.0]},{block="block", point=[-0.2,0.0,0.0]}'
    tie = f"ties=[{{between=[{ends}], stiffness={k}, prestress={prestress}}}]"
    t, x, row = at_row(slide, 0.15)
    result, new = go_on(slide, 0.15, tie)
    v, left, w = 1.0 - MU * G * t, 0.2 - t, math.sqrt(k / M)
    rest = (MU * G + prestress / M) / w**2
    moved = rest * (math.cos(w * left) - 1.0) + v / w * math.sin(w * left)
    with dembrick.read_history(new) as found:
        assert found.displacement[-1] == pytest.approx(x + moved, rel=2e-4)
        assert found.tension[-1, 0] == pytest.approx(prestress + k * moved, rel=3e-3)  # of the step before
        assert not found.tension[: row + 1].any() and found.n_tie == 1
    assert result.energy.relative_residual < 1e-9


def test_a_tie_that_goes_lets_go_and_a_load_comes(tmp_path):
    """On a frictionless floor a tied block oscillates; without the tie it keeps its speed but for an added force."""
    ends = '{ block = "floor", point = [-1.0, 0.0, 0.0] }, { block = "block", point = [-0.2, 0.0, 0.0] }'
    k = 4000.0
    tie = f"[[ties]]\nbetween = [{ends}]\nstiffness = {k}\ntension_only = false\n"
    text = IN_TIME.replace(f"friction = {MU}", "friction = 0.0").replace("[control]", tie + "[control]")
    path = tmp_path / "tied.h5"
    dembrick.simulate(dembrick.loads(text), path, progress=False)
    t, x, _ = at_row(path, 0.1)
    w, left = math.sqrt(k / M), 0.2 - t
    assert x == pytest.approx(math.sin(w * t) / w, rel=1e-3)
    force = 'loads=[{block="block", force=[64.0, 0.0, 0.0]}]'
    result, new = go_on(path, 0.1, "ties=[]", force)
    with dembrick.read_history(new) as found:
        expected = x + math.cos(w * t) * left + 0.5 * 2.0 * left**2
        assert found.displacement[-1] == pytest.approx(expected, rel=1e-3)
        assert found.n_tie == 0
    assert result.energy.relative_residual < 1e-9


def test_a_longer_run_goes_on_behind_its_end(slide):
    """The block stops after v^2 / (2 mu g), wherever the earlier run ended."""
    _, new = go_on(slide, 0.2, "control.duration=0.5")
    with dembrick.read_history(new) as found:
        assert found.time[-1] == pytest.approx(0.5)
        assert found.displacement[-1] == pytest.approx(1.0 / (2.0 * MU * G), rel=2e-4)


W = 16.0 * G
SETTLED = (
    header("concave", 0.5, 1e10)
    + block("floor", (0.0, 0.0, -0.1), (2.0, 1.0, 0.2), "fixed = true")
    + block("block", (0.0, 0.0, 0.05), (0.4, 0.2, 0.1))
    + block("wall", (-1.5, 0.0, 0.5), (0.2, 1.0, 1.0), "fixed = true")
    + '[control]\nkind = "settlement"\nsupports = ["floor"]\ndisplacement = [0.06, 0.0, 0.0]\n'
)
WALL_TIE = (
    'ties=[{between=[{block="wall", point=[-1.4,0.0,0.0]},{block="block", point=[-0.2,0.0,0.0]}], stiffness=1e5, '
    "prestress=10.0}]"
)


@pytest.mark.usefixtures("few")
def test_a_spread_goes_on_with_a_tie_that_came_half_way(tmp_path):
    """Six equilibria of 1 cm; at the third a tie is added with 10 N, which then restrains the block up to mu W."""
    path = tmp_path / "spread.h5"
    dembrick.simulate(dembrick.loads(SETTLED), path, progress=False)
    _, same = go_on(path, 3.0, name="same.h5")
    same_rows(path, same)
    result, new = go_on(path, 3.0, WALL_TIE)
    with dembrick.read_history(new) as found, dembrick.read_history(path) as old:
        assert np.array_equal(found.displacement[:4], old.displacement[:4])
        k, k_s = 1e5, 4e9 * 0.08
        assert found.displacement[4] == found.displacement[3]  # equilibrium with the tie, before the spread continues
        assert found.tension[:5, 0] == pytest.approx([0.0] * 4 + [10.0 * (1.0 - k / (k_s + k))], rel=1e-3, abs=1e-9)
        assert found.tension[-1, 0] == pytest.approx(0.5 * W, rel=1e-3)
        first = np.argmin(np.abs(found.frame_time - 3.0))
        moved = found.frame("displacement", -1)[1, 0] - found.frame("displacement", int(first))[1, 0]
        assert moved == pytest.approx((0.5 * W - 10.0) / k, rel=2e-2)
    assert result.as_dict()["status"] == "completed"


K_WALL = 2e5
ENDS = '{ block = "wall", point = [-1.4, 0.0, 0.0] }, { block = "block", point = [-0.2, 0.0, 0.0] }'
FIRM = f"[[ties]]\nbetween = [{ENDS}]\nstiffness = {K_WALL}\nprestress = 10.0\nstrength = 1000.0\n"
TIED = SETTLED.replace("[0.06", "[4e-4").replace("[control]", FIRM + "[control]")


@pytest.fixture(scope="module")
def tied(tmp_path_factory):
    """The spread with a tie to the wall that never reaches its strength."""
    path = tmp_path_factory.mktemp("tied") / "spread.h5"
    dembrick.simulate(dembrick.loads(TIED), path, progress=False)
    return path


@pytest.mark.parametrize("strength", [2000.0, 40.0])
def test_an_installed_tie_keeps_its_length_and_its_past_if_its_strength_changes(tied, strength):
    """More strength than it needs changes nothing; with less than it bears it yields to it, and its plastic elongation
    is that of its ends less (S - T_0) / k."""
    with dembrick.read_history(tied) as old:
        row = int(np.argmax(old.tension[:, 0] > 50.0))
        at, tension, end = float(old.time[row]), old.tension[: row + 1, 0], old.frame("displacement", -1)[1, 0]
        borne = float(old.tension[-1, 0])
    assert borne == pytest.approx(0.5 * W, rel=1e-4)
    result, new = go_on(tied, at, f"ties.0.strength={strength}")
    with dembrick.read_history(new) as found:
        assert np.array_equal(found.tension[: row + 1, 0], tension)
        stretched, yielded = found.frame("displacement", -1)[1, 0], found.series("yielded")[-1, 0]
        if strength > borne:
            assert found.tension[row:, 0] == pytest.approx(np.maximum(found.tension[row:, 0], tension[-1]), rel=1e-5)
            assert stretched == pytest.approx(end, rel=1e-6) and yielded == 0.0
        else:
            assert found.tension[row + 1 :, 0] == pytest.approx(strength, rel=1e-9)
            assert yielded == pytest.approx(stretched - (strength - 10.0) / K_WALL, rel=1e-6)
    (tie,) = result.as_dict()["ties"]
    assert tie["tension"] == pytest.approx(min(strength, borne), rel=1e-4)
    assert tie["peak"] == pytest.approx(max(tie["tension"], tension.max()), rel=1e-4)


@pytest.fixture(scope="module")
def tied_stages(tmp_path_factory):
    """The spread twice, of six equilibria each."""
    path = tmp_path_factory.mktemp("stages") / "stages.h5"
    control = TIED[TIED.index("[control]") :]
    text = TIED.replace("[control]", control.replace("[control]", "[[stages]]") + "[control]")
    with pytest.MonkeyPatch.context() as patch:
        few_equilibria(patch)
        dembrick.simulate(dembrick.loads(text), path, progress=False)
    return path


@pytest.mark.parametrize("changes", [["ties.0.strength=40.0"], ["ties.0.strength=40.0", "joint.friction=0.3"]])
def test_after_another_stage_too_a_weakened_tie_lets_its_joint_go(tied_stages, few, changes):
    """The block has slid at mu W; then its joint bears the new strength S, which is less than .3 W, and springs forward
    by (mu W - S) / k_s of its shear stiffness. From there the floor carries it along."""
    path, k_s = tied_stages, 4e9 * 0.08
    _, new = go_on(path, 5.0, *changes)
    with dembrick.read_history(new) as found:
        row = int(np.argmin(np.abs(found.time - 5.0)))
        first, last = (found.frame("displacement", k) for k in (np.argmin(np.abs(found.frame_time - 5.0)), -1))
        moved = last - first
        assert found.tension[row, 0] == pytest.approx(0.5 * W, rel=1e-4)
        assert found.tension[row + 1 :, 0] == pytest.approx(40.0, rel=1e-6)
        assert moved[1, 0] - moved[0, 0] == pytest.approx((0.5 * W - 40.0) / k_s, rel=1e-3)
        assert found.series("yielded")[-1, 0] == pytest.approx(last[1, 0] - (40.0 - 10.0) / K_WALL, rel=1e-3)
    with pytest.raises(ScenarioError, match=r"of the ties of a run with \[\[stages\]\] only the strength can change"):
        go_on(path, 5.0, "ties.0.stiffness=3e5")


def test_in_real_time_a_tie_that_is_weakened_yields_from_the_tension_it_had(tmp_path):
    """From x'' = -k x / m - mu g to x'' = -S / m - mu g: it stops after v^2 / (2 (S / m + mu g))."""
    k, S = 4000.0, 100.0
    ends = '{ block = "floor", point = [-1.0, 0.0, 0.0] }, { block = "block", point = [-0.2, 0.0, 0.0] }'
    tie = f"[[ties]]\nbetween = [{ends}]\nstiffness = {k}\nstrength = 1e6\n"
    path = tmp_path / "tied.h5"
    dembrick.simulate(dembrick.loads(IN_TIME.replace("[control]", tie + "[control]")), path, progress=False)
    t, x, row = at_row(path, 0.06)
    w = math.sqrt(k / M)
    v = math.cos(w * t) - MU * G / w * math.sin(w * t)
    _, stronger = go_on(path, 0.06, "ties.0.strength=2e6")
    with dembrick.read_history(stronger) as found, dembrick.read_history(path) as old:
        for name in ("displacement", "tension", "load"):
            assert np.array_equal(getattr(found, name), getattr(old, name)), name
        before = old.tension[: row + 1, 0]
    result, weaker = go_on(path, 0.06, f"ties.0.strength={S}")
    with dembrick.read_history(weaker) as found:
        assert np.array_equal(found.tension[: row + 1, 0], before) and before[-1] > 1.5 * S
        furthest = found.displacement.max()
        assert furthest == pytest.approx(x + 0.5 * v**2 / (S / M + MU * G), rel=1e-3)
        assert found.series("yielded")[-1, 0] == pytest.approx(furthest - S / k, rel=1e-3)
    assert result.as_dict()["ties"][0]["peak"] == pytest.approx(before[-1], rel=1e-9)
    assert result.energy.relative_residual < 1e-9


@pytest.mark.parametrize(
    "change", ["stiffness=3e5", "prestress=20.0", "tension_only=false", "between.1.point=[-0.2, 0.0, 0.01]"]
)
def test_a_tie_that_became_another_is_no_change_of_one_number(tied, change):
    with pytest.raises(ScenarioError, match="only the strength can change on the way.* give all ties") as refusal:
        go_on(tied, 3.0, f"ties.0.{change}")
    assert "of tie 0 between 'wall' and 'block'" in str(refusal.value)


def test_a_list_of_ties_keeps_those_that_stay_and_says_which_come_and_go(tied):
    """Two ties like the first come, of another strength and of another stiffness; the first stays."""
    first = WALL_TIE[len("ties=[") : -1].replace("1e5", "2e5")
    listed = f"ties=[{first.replace('2e5', '3e5')}, {first}, {first.replace('10.0', '10.0, strength=50.0')}]"
    said = []
    new = tied.parent / "listed.h5"
    dembrick.restart_at(tied, 5.0, new, [listed], force=True, report=said.append, progress=False)
    assert any("of the ties 1 stay, 0 are removed and 2 are added" in line for line in said)
    with dembrick.read_history(new) as found, dembrick.read_history(tied) as old:
        row = int(np.argmin(np.abs(old.time - 5.0)))
        before = np.zeros((row + 1, 3))
        before[:, 1] = old.tension[: row + 1, 0]
        assert np.array_equal(found.tension[: row + 1], before)


JACK = '[[actuators]]\nname = "jack"\nblock = "block"\npoint = [-0.2, 0.0, 0.0]\ndirection = [1.0, 0.0, 0.0]\n'
ON_FLOOR = SETTLED[: SETTLED.index("[control]")] + JACK


@pytest.mark.parametrize("formulation", [pytest.param("concave", marks=pytest.mark.slow), "convex"])
def test_a_search_in_the_deformed_geometry_goes_on_on_a_wetted_joint(tmp_path, formulation):
    """V = mu W: half of the weight at first, and a fifth of it for a joint wetted below that load."""
    search = '[control]\nkind = "yield"\nlarge_displacements = true\ntolerance = 4e-3\n'
    path = tmp_path / "searched.h5"
    dembrick.simulate(dembrick.loads(ON_FLOOR.replace('"concave"', f'"{formulation}"') + search), path, progress=False)
    with dembrick.read_history(path) as old:
        assert old.results["yield_point"]["V"] == pytest.approx(0.5 * W, rel=4e-3)
        low = float(old.time[np.flatnonzero(old.load < 0.15 * W)[-1]])
    _, same = go_on(path, low, name="same.h5")
    same_rows(path, same)
    result, _ = go_on(path, low, "joint.friction=0.2")
    assert result.yield_point.V == pytest.approx(0.2 * W, rel=4e-3)


@pytest.mark.usefixtures("few")
def test_in_the_middle_of_a_cycle_it_goes_on_bit_for_bit(tmp_path):
    """Cycles of 0.2 mm in the deformed geometry, restarted on the return; a change is refused, as V would jump."""
    cycle = 'kind = "displacement"\nlarge_displacements = true\nrate = 1e-3\nprotocol = [2e-4, -2e-4, 2e-4, 0.0]\n'
    path = tmp_path / "cycle.h5"
    dembrick.simulate(dembrick.loads(f"{ON_FLOOR}[control]\n{cycle}"), path, progress=False)
    with dembrick.read_history(path) as old:
        back = float(old.time[int(np.argmin(old.displacement)) - 2])
    result, same = go_on(path, back, name="same.h5")
    same_rows(path, same)
    with dembrick.read_history(path) as old:
        assert result.as_dict()["cycles"] == old.results["cycles"]
    with pytest.raises(ScenarioError, match="nothing can change on the way of a driven displacement"):
        go_on(path, back, "joint.friction=0.2")


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_a_lone_joint_goes_on_in_the_middle_of_a_cycle(tmp_path, formulation):
    """Cycles of the shipped test at constant rate, restarted at its first row, at one in between and at its last."""
    path, changes = tmp_path / "cyclic.h5", [f"joint.formulation={formulation}", "output.rows=200", "output.frames=20"]
    changes += ["control.protocol=[0.0, 2e-5, -2e-5, 2e-5]"]
    dembrick.simulate(dembrick.load("set4a_cyclic", changes), path, progress=False)
    with dembrick.read_history(path) as old:
        times = [float(old.time[row]) for row in (0, old.n_row // 3, old.n_row - 1)]
    for at in times if formulation == "concave" else times[1:2]:
        result, same = go_on(path, at, name="same.h5")
        same_rows(path, same)
    with dembrick.read_history(path) as old:
        assert json.loads(json.dumps(result.as_dict()["cycles"])) == old.results["cycles"]
    with pytest.raises(ScenarioError, match="nothing can change on the way of a driven displacement"):
        go_on(path, times[1], "joint.friction=0.2")


# --- the command, and requests that are refused


def test_the_command_prints_what_run_prints(slide, tmp_path, capsys):
    new = tmp_path / "wet.h5"
    asked = ["restart", str(slide), "--at", "0.1", "--set", "joint.friction=0.1", "--out", str(new), "--json"]
    assert main(asked) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["status"] == "completed" and said["history"] == str(new)
    assert set(said) == set(json.loads(json.dumps(dembrick.read_history(slide).results)))
    assert main(asked) == 2  # a finished history is in the way
    assert "finished history" in json.loads(capsys.readouterr().out)["error"]
    assert main(["run", str(new), "--json"]) == 2  # its scenario alone does not reproduce it
    assert "this run continued" in json.loads(capsys.readouterr().out)["error"]
    with pytest.raises(HistoryError, match="this run continued another one"):
        dembrick.restart_at(new, 0.15, tmp_path / "third.h5")


def test_a_run_that_went_on_and_was_stopped_goes_on(slide, tmp_path, monkeypatch):
    monkeypatch.setattr(os, "fsync", lambda _: None)
    whole, new, looks = tmp_path / "whole.h5", tmp_path / "new.h5", itertools.count()
    dembrick.restart_at(slide, 0.1, whole, ["joint.friction=0.1"], progress=False)
    monkeypatch.setattr(interrupts, "requested", lambda: 0 if next(looks) < 300 else 2)
    with pytest.raises(Interrupted):
        dembrick.restart_at(slide, 0.1, new, ["joint.friction=0.1"], progress=False)
    monkeypatch.setattr(interrupts, "requested", lambda: 0)
    with dembrick.read_history(new) as left:
        assert left.status == "interrupted" and left.time[-1] > 0.1
    dembrick.restart(new, progress=False)
    same_rows(whole, new)
    with pytest.raises(HistoryError, match="this run continued"):
        dembrick.load(new)


REFUSED = [
    (0.3, [], "its last row is at 0.2, before --at 0.3"),
    (-1.0, [], "the time of a row, 0 or more"),
    (math.nan, [], "the time of a row, 0 or more"),
    (0.1, ["materials.stone.density=1000.0"], "materials cannot change on the way"),
    (0.1, ["blocks.block.position=[0.0, 0.0, 0.06]"], "blocks cannot change on the way"),
    (
        0.1,
        ["joint.normal_stiffness=2e9"],
        "normal_stiffness of the joint between .* cannot change on the way of .*slide.h5; only friction",
    ),
    (0.1, ["joint.cohesion=1e3"], "break only by stress, and cannot form on the way"),
    (0.1, ["control.restitution=0.4"], "control.restitution of kind 'dynamic' cannot change on the way"),
    (0.1, ["solver.step_factor=0.5"], "solver cannot change on the way"),
    (0.1, [WALL_TIE.replace("wall", "floor").replace("-1.4", "-1.0").replace("1e5", "1e12")], "time step of"),
]


@pytest.mark.parametrize(("at", "changes", "words"), REFUSED)
def test_what_cannot_change_is_one_sentence(slide, tmp_path, at, changes, words):
    new = tmp_path / "new.h5"
    with pytest.raises(ScenarioError, match=words) as refusal:
        dembrick.restart_at(slide, at, new, changes, progress=False)
    assert "\n" not in str(refusal.value) and not new.exists()


def test_a_search_has_no_state_on_its_way_and_a_history_is_not_written_over(slide, tmp_path):
    path = tmp_path / "set4a.h5"
    dembrick.simulate("set4a", path, progress=False)
    with pytest.raises(ScenarioError, match="has no state on its way that others can go on from"):
        dembrick.restart_at(path, 0.0, tmp_path / "new.h5")
    with pytest.raises(OutputError, match="an input of the command"):
        dembrick.restart_at(slide, 0.1, slide, force=True)
    assert main(["restart", str(slide), "--set", "joint.friction=0.1"]) == 2
    assert main(["restart", str(slide), "--at", "0.1"]) == 2
