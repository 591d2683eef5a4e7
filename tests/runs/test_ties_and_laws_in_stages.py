"""Ties added and removed, and joint laws changed, between stages: closed forms of one block."""

import itertools
import math
import os

import numpy as np
import pytest

from dembrick.errors import ScenarioError
from dembrick.history import read
from dembrick.runs.simulate import restart, simulate
from dembrick.scenario import toml
from helpers.restart_cases import stop_in_stages, told_of_checkpoints
from helpers.scenario_text import BASE, header, jack, refused
from helpers.scenario_text import block as block_text

MU, N, A, B = 0.64, 467.0, 0.3, 0.2
K_S = 4e9 * A * B  # N/m
JOINT = BASE[: BASE.index("[[actuators]]")]
JACK = BASE[BASE.index("[[actuators]]") : BASE.index("[control]")].replace("0.075", "0.0")
STATICS = 'kind = "statics"\n'
YIELD = 'kind = "yield"\ntolerance = 1e-5\n'
TIME = 'kind = "dynamic"\nduration = 0.02\n'


def tie(stages=None, k=1e6, prestress=0.0, more=""):
    """A tie along y between the centres of both blocks, at the height of the joint."""
    ends = '{ block = "lower", point = [0.0, -0.1, 0.0] }, { block = "upper", point = [0.0, 0.1, 0.0] }'
    text = f"[[ties]]\nbetween = [{ends}]\nstiffness = {k!r}\nprestress = {prestress!r}\n{more}"
    return text + ("" if stages is None else f"stages = {stages}\n")


def law(stages=None, **keys):
    text = '[[joints]]\nbetween = ["lower", "upper"]\n' + "".join(f"{key} = {value!r}\n" for key, value in keys.items())
    return text + ("" if stages is None else f"stages = {stages}\n")


def push(force, stages):
    """A horizontal force in the plane of the joint."""
    return f'[[loads]]\nblock = "upper"\npoint = [0.0, 0.0, 0.0]\nforce = [0.0, {force!r}, 0.0]\nstages = {stages}\n'


def scenario(*stages, parts="", formulation="concave", more=""):
    text = JOINT.replace('"convex"', f'"{formulation}"') + parts + JACK
    text += "".join(f"[[stages]]\n{stage}" for stage in stages[:-1]) + f"[control]\n{stages[-1]}{more}"
    return toml.loads(text, "staged.toml")


FAR = 'kind = "displacement"\nrate = 1e-2\ntravel = 2e-3\n'


@pytest.mark.parametrize("formulation", ["concave", "convex"])
@pytest.mark.parametrize("last", [STATICS, TIME], ids=["statics", "real time"])
def test_a_tie_that_comes_after_a_slip_has_its_prestress_and_no_more(formulation, last):
    """A later tie is not stretched by 2 mm of earlier slip, which at k = 1e6 N/m would give 2 kN. Its 100 N shear the
    joint back, a spring in parallel: T = T_0 - k T_0 / (k_s A + k)."""
    k, given = 1e6, 100.0
    result = simulate(scenario(FAR, STATICS, last, parts=tie([3], k, given), formulation=formulation))
    tension = np.asarray(result.rows["tension"])[:, 0]
    assert tension[-1] == pytest.approx(given - k * given / (K_S + k), rel=2e-3 if last == TIME else 1e-6)
    assert "ties" not in result.stages[0] and "ties" not in result.stages[1]
    assert abs(result.reactions["lower"][1]) < 1e-3  # the tie acts only between the two blocks


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_a_tie_that_stays_is_as_long_as_it_was_and_one_that_goes_lets_go(formulation):
    """Pushed beyond friction, the block hangs on its tie, which carries H - mu N. If the push ends, tie and joint are
    springs in parallel; if the tie is removed instead, the block slides under H and falls."""
    H, k = 1.5 * MU * N, 1e6
    held = H - MU * N
    stays = scenario(STATICS, STATICS, parts=tie(None, k) + push(H, [1]), formulation=formulation)
    result = simulate(stays)
    before = result.stages[0]["ties"][0]["tension"]
    assert held * (1.0 - 1e-6) < before < 1.01 * held  # after a swing friction may carry a little less than mu N
    left = before - H * k / (K_S + k)  # elastic: the joint reverses from mu N to less than mu N
    assert float(result.rows["tension"][-1, 0]) == pytest.approx(left, rel=1e-6)
    goes = scenario(STATICS, STATICS, parts=tie([1], k) + push(H, [1, 2]), formulation=formulation)
    assert simulate(goes).as_dict()["status"] == "falls"
    both = scenario(STATICS, STATICS, parts=tie([1], k) + push(H, [1]), formulation=formulation)
    assert "tension" not in simulate(both).rows


def test_ties_keep_what_they_are_when_another_goes():
    """Two ties share H - mu N by their stiffnesses; when the first is removed, the second takes over its force."""
    H, first, second = 2.0 * MU * N, 1e6, 3e6
    parts = tie([1], first) + tie(None, second) + push(H, [1, 2])
    result = simulate(scenario(STATICS, STATICS, parts=parts))
    one, two = (entry["tension"] for entry in result.stages[0]["ties"])
    assert two == pytest.approx(3.0 * one, rel=1e-9)
    assert 1.0 - 1e-6 < (one + two) / (H - MU * N) < 1.02  # after a swing friction may carry a little less than mu N
    assert 1.0 - 1e-6 < float(result.rows["tension"][-1, 0]) / (H - MU * N) < 1.02


def test_a_yielded_tie_keeps_its_length_beside_one_that_comes():
    """It yields at 50 N over 2 mm; then the other is added with 20 N, the jack is removed, and all spring back."""
    strong = tie(None, 1e6, more="strength = 50.0\n")
    result = simulate(scenario(FAR, STATICS, parts=tie([2], 2e6, 20.0) + strong))
    comes, yielded = np.asarray(result.rows["tension"])[-1]
    back = (MU * N + 50.0 + 20.0) / (K_S + 1e6 + 2e6)  # m
    assert comes == pytest.approx(20.0 - 2e6 * back, rel=1e-3)
    assert yielded == pytest.approx(50.0 - 1e6 * back, rel=1e-2)  # a step of the test is 0.24 um


SPREAD = 0.05  # m


def settled(*stages, formulation="concave", parts="", degrees=None, more=""):
    """A block on a floor that moves 5 cm away from a wall along x, or rotates by ``degrees``, followed by stages."""
    text = header(formulation, 0.5, 1e10) + block_text("floor", (0.0, 0.0, -0.1), (2.0, 1.0, 0.2), "fixed = true")
    text += block_text("block", (0.0, 0.0, 0.05), (0.4, 0.2, 0.1))
    text += block_text("wall", (-1.5, 0.0, 0.5), (0.2, 1.0, 1.0), "fixed = true") + parts
    moves = f"displacement = [{SPREAD!r}, 0.0, 0.0]\n"
    if degrees is not None:
        moves = f"rotation = {{ axis = [0.0, 1.0, 0.0], angle = {degrees}, point = [0.0, 0.0, 0.0] }}\n"
    every = ['kind = "settlement"\nsupports = ["floor"]\n' + moves, *stages]
    text += "".join(f"[[stages]]\n{stage}" for stage in every[:-1]) + f"[control]\n{every[-1]}{more}"
    return toml.loads(text, "settled.toml")


def wall_tie(stages=None, k=1e5, prestress=0.0):
    ends = '{ block = "wall", point = [-1.4, 0.0, 0.0] }, { block = "block", point = [-0.2, 0.0, 0.0] }'
    text = f"[[ties]]\nbetween = [{ends}]\nstiffness = {k!r}\nprestress = {prestress!r}\n"
    return text + ("" if stages is None else f"stages = {stages}\n")


W = 16.0 * 9.81  # N, weight of the block


@pytest.mark.usefixtures("few")
@pytest.mark.parametrize("last", [STATICS, TIME], ids=["statics", "real time"])
def test_a_tie_after_the_support_has_spread_starts_at_the_length_of_that_moment(last):
    """Tied from the start, the block slides in the spread, and the tie carries mu W. A tie added after it has its 10 N,
    less the elastic yield of the joint, and the block stays where the spread left it."""
    tied = simulate(settled(last, parts=wall_tie()))
    assert float(tied.rows["tension"][-1, 0]) == pytest.approx(0.5 * W, rel=1e-3)
    k, k_s = 1e5, 4e9 * 0.4 * 0.2
    later = simulate(settled(last, parts=wall_tie([2], k, 10.0)))
    assert float(later.rows["tension"][-1, 0]) == pytest.approx(10.0 * (1.0 - k / (k_s + k)), rel=1e-3)
    assert later.frames["displacement"][-1, 1, 0] == pytest.approx(SPREAD, abs=1e-6)
    assert later.reactions["wall"][0] == pytest.approx(-10.0, rel=2e-3)
    gone = simulate(settled(last, parts=wall_tie([1])))
    assert "tension" not in gone.rows
    assert gone.stages[0]["ties"][0]["tension"] == pytest.approx(0.5 * W, rel=1e-3)
    assert abs(gone.reactions["wall"][0]) < 1e-9


@pytest.mark.usefixtures("few")
def test_a_run_with_a_tie_that_came_goes_on_where_it_was_stopped(tmp_path, monkeypatch):
    """Stopped between the settlement and the stage of the tie, and in the last stage."""
    monkeypatch.setattr(os, "fsync", lambda _: None)
    last = 'kind = "dynamic"\nduration = 0.002\n'
    given = settled(STATICS, last, parts=wall_tie([2, 3], prestress=10.0), more="[output]\nrows = 8\nframes = 4\n")
    whole, path, places = tmp_path / "whole.h5", tmp_path / "run.h5", []
    with told_of_checkpoints(lambda where, _: places.append(where)):
        simulate(given, whole)
    for place in (places.index("stage 1 of 3"), len(places) - 1):
        looks = itertools.count()
        stop_in_stages(given, path, lambda *_, looks=looks, place=place: next(looks) == place)
        restart(path)
        with read(path) as one, read(whole) as other:
            np.testing.assert_array_equal(one.tension, other.tension)
            np.testing.assert_array_equal(one.displacement, other.displacement)


# --- laws


@pytest.mark.parametrize("formulation", ["concave", "corrected", "convex"])
def test_a_joint_that_loses_friction_bears_what_is_left_of_it(formulation):
    """mu N before and after; the theory for the last stage also uses that stage's law."""
    result = simulate(scenario(YIELD, YIELD, parts=law([2], friction=0.3), formulation=formulation), record=False)
    assert result.stages[0]["yield_point"]["V"] == pytest.approx(MU * N, rel=2e-5)
    assert result.yield_point.V == pytest.approx(0.3 * N, rel=2e-5)
    assert result.theory is None or result.theory.V == pytest.approx(0.3 * N, rel=1e-9)
    first = simulate(scenario(YIELD, YIELD, parts=law([1], friction=0.3), formulation=formulation), record=False)
    assert first.stages[0]["yield_point"]["V"] == pytest.approx(0.3 * N, rel=2e-5)
    assert first.yield_point.V == pytest.approx(MU * N, rel=2e-5)


@pytest.mark.parametrize(("friction", "stands"), [(0.45, "stands"), (0.35, "falls")])
def test_a_wetted_joint_under_its_load_stands_or_slides(friction, stands):
    """H = 0.4 N stands with mu = 0.64 and slides with mu below 0.4."""
    parts = push(0.4 * N, [1, 2]) + law([2], friction=friction)
    assert simulate(scenario(STATICS, STATICS, parts=parts)).as_dict()["status"] == stands


def test_a_bond_that_weathers_keeps_what_is_left():
    """c A + mu N of an intact bond, with the cohesion of the stage; a broken bond does not heal."""
    bond = law(cohesion=2e3, residual_cohesion=0.0)
    weathered = law([2], cohesion=5e2, residual_cohesion=0.0)
    result = simulate(scenario(STATICS, YIELD, parts=bond + weathered, formulation="convex"), record=False)
    assert result.yield_point.V_peak == pytest.approx(5e2 * A * B + MU * N, rel=1e-3)
    broken = simulate(scenario(YIELD, YIELD, parts=bond + weathered, formulation="convex"), record=False)
    assert broken.yield_point.V_peak == pytest.approx(MU * N, rel=1e-3)


@pytest.mark.usefixtures("few")
@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_friction_that_goes_after_a_floor_has_turned_lets_the_block_slide(formulation):
    """a = g (sin th - mu cos th) from rest on a floor rotated by 10 degrees, with mu = 0.1 from then on."""
    th, t = math.radians(10.0), 0.3
    slide = f'kind = "dynamic"\nduration = {t}\n'
    wet = '[[joints]]\nbetween = ["floor", "block"]\nfriction = 0.1\nstages = [2]\n'
    result = simulate(settled(slide, formulation=formulation, parts=wet, degrees=10.0))
    slip = 0.5 * 9.81 * (math.sin(th) - 0.1 * math.cos(th)) * t * t
    assert result.rows["displacement"][-1] == pytest.approx(slip, rel=5e-3)
    stays = simulate(settled(slide, formulation=formulation, degrees=10.0))
    assert stays.rows["displacement"][-1] < 1e-6


@pytest.mark.usefixtures("few")
def test_laws_that_part_in_a_deformed_geometry_are_refused_for_joints_with_points():
    """With convex joints one block can get less friction, a closed form, and the other keeps its own and stays."""
    more = block_text("other", (0.6, 0.0, 0.05), (0.4, 0.2, 0.1))
    wet = '[[joints]]\nbetween = ["floor", "block"]\nfriction = 0.1\nstages = [2]\n'
    with pytest.raises(ScenarioError, match="laws of joints that were one before are told apart in stage 2"):
        simulate(settled(TIME, parts=more + wet, degrees=10.0))
    slide = 'kind = "dynamic"\nduration = 0.1\n'
    result = simulate(settled(slide, parts=more + wet, degrees=10.0, formulation="convex"))
    moved = np.linalg.norm(np.diff(result.frames["displacement"][[0, -1]], axis=0)[0], axis=1)
    th = math.radians(10.0)
    named = dict(zip(result.assembly.names, moved, strict=True))
    assert named["block"] == pytest.approx(0.5 * 9.81 * (math.sin(th) - 0.1 * math.cos(th)) * 0.01, rel=1e-2)
    assert named["other"] < 1e-6


CHANGES = [
    (law([2], shear_stiffness=1e9), "shear_stiffness .* cannot change in stage 2; only friction"),
    (law([2], formulation="corrected"), "formulation .* cannot change"),
    (law([2], dilation=0.1), "dilation .* cannot change"),
    (law([2], cohesion=1e3), "cannot form in stage 2: give the joint a weak bond from the start"),
    (law([1], cohesion=1e3), "cannot vanish in stage 2: leave the joint a weak bond"),
]


@pytest.mark.parametrize(("parts", "words"), CHANGES)
def test_a_law_that_its_joint_cannot_go_on_with_is_one_sentence(parts, words):
    with pytest.raises(ScenarioError, match=words) as refusal:
        simulate(scenario(STATICS, YIELD, parts=parts), record=False)
    assert " of the joint between 'lower' and 'upper' " in str(refusal.value)


@pytest.mark.parametrize("part", [tie([3]), law([3], friction=0.3)])
def test_a_stage_that_there_is_not_is_refused(part):
    refused(JOINT + JACK + part + f"[[stages]]\n{STATICS}[control]\n{YIELD}", "there is no stage 3, only 2")


def test_stages_of_ties_and_joints_are_written_and_read_back():
    given = scenario(STATICS, YIELD, parts=tie([2]) + law([1], friction=0.3))
    assert toml.loads(toml.dumps(given)) == given
    assert (given.ties[0].stages, given.joints[0].stages) == ((2,), (1,))


def test_a_search_hands_on_the_state_at_its_limit():
    """A block slackens a bar tie as it turns, so V falls after its peak. A second search starts from the state at the
    first limit and finds it again; when it started from the end of the path, it was 2 % lower."""
    text = header("convex", 0.8, 1e11, keys="cohesion = 2000.0\ntensile_strength = 700.0\n")
    text += block_text("low", (0.0, 0.0, -0.15), (2.0, 2.0, 0.3), "fixed = true")
    text += block_text("up", (0.0, 0.0, 0.125), (0.6, 0.4, 0.25)) + jack("up", (0.0, -0.1, 0.1), (1.0, 0.2, 0.0))
    ends = '{ block = "low", point = [0.0, -0.8, 0.0] }, { block = "up", point = [0.0, 0.0, 0.25] }'
    text += f"[[ties]]\nbetween = [{ends}]\nstiffness = 1e7\nstrength = 400.0\nprestress = 300.0\n"
    text += "tension_only = false\n"
    once = simulate(toml.loads(text + "[control]\n" + YIELD), record=False).yield_point
    twice = simulate(toml.loads(text + "[[stages]]\n" + YIELD + "[control]\n" + YIELD), record=False)
    assert once.V_after < 0.99 * once.V == pytest.approx(0.99 * twice.stages[0]["yield_point"]["V"], rel=1e-9)
    assert twice.yield_point.V == pytest.approx(once.V, rel=1e-4)
