"""The effects on a collapse that joint laws leave out, in numbers."""

import numpy as np
import pytest

from dembrick import loads
from dembrick.assembly.build import assemble
from dembrick.runs.left_out import left_out
from dembrick.runs.limit import limit
from dembrick.runs.simulate import simulate
from helpers import pushed_assemblies as scenes
from helpers.key_lines import key_lines
from helpers.scenario_text import block, header
from helpers.stone_scenes import law

X, Y = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)


def test_corrected_joints_topple_early():
    """A wall out of its plane rotates about points moved inwards by s; the bound beside it is that of the true edge."""
    found = limit(scenes.wall(law("corrected"), 4, 6, Y))
    (said,) = found.left_out
    assert found.load_factor < 0.6 / 3.0
    assert said.law == "corrected" and said.bound == pytest.approx(1.0 / 3.0, rel=1e-6)
    assert "rock about corrected points" in found.text()
    assert found.as_dict()["left_out"][0]["bound"] == said.bound


def test_distributed_points_stop_short_of_the_edge():
    found = limit(scenes.stack(law("distributed", points=(6, 4)), Y))
    (said,) = found.left_out
    assert said.law == "distributed" and said.bound == pytest.approx(0.4, rel=1e-6)
    assert found.load_factor < said.bound * (1.0 - 0.02)


def test_convex_joints_keep_their_torsion_at_an_edge():
    """An actuator across a wall: joints with the resultant at an edge keep some torsion, 0.6 % above corner points."""
    found = limit(scenes.wall_with_actuator(law("convex")))
    (said,) = found.left_out
    assert said.law == "convex"
    assert said.bound == pytest.approx(202.1894, rel=1e-6)
    assert found.load_factor == pytest.approx(203.4692, rel=1e-6)
    assert "with linear pressure the limit is at most 202.19, -0.63 %" in found.text()


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_there_is_nothing_to_say_of_what_rocks_about_true_edges(formulation):
    assert limit(scenes.arch(law(formulation, 0.7), X)).left_out == []
    assert limit(scenes.wall(law(formulation), 4, 6, Y)).left_out == []


def test_a_search_says_what_its_joints_leave_out():
    """The same wall by a search: it topples early, and the bound for the true edge is reported beside it."""
    found = simulate(scenes.wall(law("corrected"), 4, 6, Y), record=False)
    (said,) = found.collapse["left_out"]
    assert said["law"] == "corrected" and said["bound"] == pytest.approx(1.0 / 3.0, rel=1e-6)
    assert "left out" in key_lines(found)
    assert simulate(scenes.wall(law("concave"), 4, 6, Y), record=False).collapse["left_out"] == []


def test_a_search_says_it_without_a_solver(monkeypatch):
    monkeypatch.setattr("dembrick.simulation.limit_analysis.solver.installed", lambda: False)
    (said,) = simulate(scenes.wall(law("corrected"), 4, 6, Y), record=False).collapse["left_out"]
    assert said["bound"] is None and "dembrick limit gives its bounds" in said["text"]


def test_inner_edges_of_a_joint_of_several_pieces_are_no_edges():
    """Near the place where the leg of an L begins, and near the edge about which a block on this foot would rock."""
    leg = "{box = [0.4, 0.2, 0.5], position = [0.5, 0.1, 0.25]}"
    text = header("convex") + block("floor", (0.0, 0.0, -0.5), (10.0, 10.0, 1.0), "fixed = true")
    text += '[[blocks]]\nname = "foot"\nmaterial = "stone"\n'
    text += f'parts = [{{box = [0.6, 0.4, 0.5], position = [0, 0, 0.25]}}, {leg}]\n[control]\nkind = "statics"\n'
    assembly = assemble(loads(text))
    joint, slides = assembly.joints[0], np.array([[1.0, 0.0, 0.0]])
    inside = [(0.29, 0.05), (0.35, 0.1), (0.6, 0.1), (0.668, 0.1), (-0.1, -0.18)]
    for x, y in [*inside, (0.674, 0.1), (0.1, 0.195), (-0.1, -0.195)]:  # O is at (0.125, 0.025)
        e_1, e_2 = (joint.axes @ ([x, y, 0.0] - joint.origin))[:2]
        carried = np.array([[1e3, 1.0, 0.0, 0.0, -1e3 * e_2, 1e3 * e_1, 0.0]])
        assert bool(left_out(assembly, 0.1, carried, slides, False, bounded=False)) is ((x, y) not in inside), (x, y)
