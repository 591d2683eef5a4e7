"""The short form of the stress matrix: at the ends of every axis, no wrong answer goes without an error."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from dembrick.errors import DivergedError, ScenarioError
from dembrick.simulation.statics.yield_point import YieldPoint
from helpers.places import tool_module


@cache
def stress(name: str = "stress"):
    """The tool, or a module of it."""
    return tool_module(name)


@cache
def results(axis: str):
    """The cells of an axis and their outcomes, but for cells that use up all steps of a search."""
    tool = stress()
    chosen = [c for c in tool.cells([axis], short=True, rest_steps=20_000, random=60, seed=1) if kept(c)]
    return tool.run_all(chosen)


def kept(cell) -> bool:
    """Whether to run a cell. At the end of some axes every cell is the longest search, of a second; two are enough."""
    if cell.axis == "step":
        return "distributed" not in cell.variant and ("3 blocks" not in cell.variant or "concave" in cell.variant)
    if cell.axis in ("stiffness", "mass", "tower", "friction"):
        return cell.variant.split()[1] in ("concave", "convex")
    return True


def listed(cells) -> str:
    return "\n".join(f"{o.status} {c.axis} {c.value:g} {c.variant}: {o.reason}" for c, o in cells)


AXES = ("step", "stiffness", "mass", "slenderness", "tower", "friction", "tolerance", "rate", "size", "rest", "random")


def test_the_matrix_has_these_axes():
    assert stress().AXES == AXES


@pytest.mark.parametrize("axis", AXES)
def test_no_wrong_answer(axis):
    """Every answer is right or is an indicator near the truth; otherwise an error says why there is none."""
    wrong = [(c, o) for c, o in results(axis) if o.status == "WRONG"]
    assert not wrong, listed(wrong)
    for _, outcome in results(axis):
        assert outcome.status == "right" or outcome.reason


@pytest.mark.parametrize("axis", ["slenderness", "tolerance", "rate", "size", "rest"])
def test_all_right(axis):
    """All cells of a single joint on these axes have an answer, and it is right."""
    assert len(results(axis)) >= 10
    rest = [(c, o) for c, o in results(axis) if o.status != "right"]
    assert not rest, listed(rest)


def test_random_joints_are_right():
    """At least 54 of 60: a load above the joint to 1e-5 may end without an answer."""
    good, valid = stress().share_right(results("random"))
    assert valid == 60 and good >= 54, listed([(c, o) for c, o in results("random") if o.status != "right"])


def test_above_the_critical_step_a_test_is_stopped():
    """At 2.5 times the critical step no run is right by the plateau; an error says so."""
    far = [(c, o) for c, o in results("step") if c.value == 2.5 and c.variant.startswith("rate")]
    assert far and all(o.status == "stopped" for _, o in far), listed(far)


def test_overshoot_falls_with_the_rate():
    by_rate = {}
    for cell, outcome in results("rate"):
        by_rate.setdefault(cell.variant, {})[cell.value] = outcome.overshoot
    for variant, overshoot in by_rate.items():
        assert overshoot[0.01] < 0.2 * overshoot[1.0], (variant, overshoot)


# --- the functions that judge outcomes


def point(V, lower, upper, bracket="certified"):
    return YieldPoint(V, lower, upper, bracket, V, 0.0, V, 0.0, V, 0.0, 1.0, 0.0, None, "sliding", ("a", "b"))


class Answer:
    """A replay whose result is ``point``."""

    def __init__(self, *values):
        self.yield_point, self.energy = point(*values), None


@pytest.mark.parametrize(
    "values, expected, status",
    [
        ((100.0, 99.95, 100.05), 100.04, "right"),
        ((100.0, 99.95, 100.05), 100.06, "WRONG"),  # outside its certified bracket
        ((100.0, 99.0, 101.0), 100.2, "WRONG"),  # inside, but farther off than the tolerance
        ((100.0, 99.95, 100.05, "indicator"), 100.06, "right"),
        ((100.0, 99.95, 100.05, "indicator"), 100.2, "near"),
        ((100.0, 99.95, 100.05, "indicator"), 101.0, "WRONG"),
        ((math.nan, 99.95, 100.05), 100.0, "WRONG"),
        ((0.0, 0.0, 0.0), 0.0, "right"),
        ((1e-9, 0.0, 2e-9), 0.0, "WRONG"),
    ],
)
def test_judge(values, expected, status, monkeypatch):
    tool = stress("stress_judge")
    monkeypatch.setattr(tool, "_audited", lambda run: "not asked")
    assert tool.judge_limit(lambda observe: Answer(*values), expected, 1e-3).status == status


@pytest.mark.parametrize(
    "values, plateau, status",
    [
        ((100.0, 99.95, 100.05), 100.0, "right"),
        ((100.0, 101.0, 102.0), 100.0, "WRONG"),  # theory outside a certified bracket
        ((100.0, 90.0, 110.0), 96.0, "WRONG"),  # and a slow test that slides at a different load
        ((100.5, 99.0, 300.0, "open"), 100.0, "right"),
        ((102.0, 99.0, None, "open"), 100.0, "near"),
        ((104.0, 99.0, None, "open"), 104.0, "WRONG"),
        ((100.5, 100.4, 100.6, "indicator"), 100.0, "right"),
        ((101.5, 101.4, 101.6, "indicator"), 101.5, "near"),
    ],
)
def test_judge_of_constant_rates(values, plateau, status):
    def run(observe):
        observe({"load": np.full(10, plateau), "displacement": np.arange(10.0)}, {})
        return Answer(*values)

    outcome = stress("stress_judge").judge_rate(run, 100.0, 1e-9, slow=True, audited=False)
    assert outcome.status == status, outcome


def test_errors_are_reasons():
    tool = stress("stress_judge")

    def diverge(observe):
        raise DivergedError("gone")

    outcome = tool.judge_limit(diverge, 1.0, 1e-3)
    assert (outcome.status, outcome.reason) == ("stopped", "DivergedError: gone")
    scenes = stress("stress_scenes")
    soft = scenes.pair("concave", scenes.jack(0.0), kn=1e5)
    outcome = tool.push_to_limit(soft, tool.by_judge)
    assert outcome.status == "refused" and outcome.reason.startswith(ScenarioError.__name__)


def test_exit_code_table_and_map(tmp_path, monkeypatch, capsys):
    """A wrong cell gives exit code 1; the table lists it, and the CSV file and the map are written."""
    tool = stress()
    assert tool.main(["--axes", "size", "--short"]) == 0
    assert "WRONG: 0" in capsys.readouterr().out

    def lying(*_):
        yield tool.Cell("size", 1.0, "a lie", lambda: tool.Outcome("WRONG", "it is not so"))
        yield tool.Cell("size", 2.0, "a truth", lambda: tool.Outcome("right"))

    monkeypatch.setattr(stress("stress_matrix"), "size_cells", lying)
    table, drawing = tmp_path / "cells.csv", tmp_path / "map.png"
    assert tool.main(["--axes", "size", "--csv", str(table), "--plot", str(drawing)]) == 1
    out = capsys.readouterr().out
    assert "it is not so" in out and "right: 1 of 2" in out and "WRONG: 1" in out
    assert len(table.read_text().splitlines()) == 3 and drawing.stat().st_size > 1000
    again = tmp_path / "again.csv"
    assert tool.main(["--read", str(table), "--csv", str(again)]) == 1
    assert again.read_text() == table.read_text() and capsys.readouterr().out == out


def test_the_seed_makes_the_scenes():

    def drawn(seed):
        return [c.variant for c in stress("stress_matrix").random_cells(30, seed)]

    assert drawn(1) == drawn(1) != drawn(2)
