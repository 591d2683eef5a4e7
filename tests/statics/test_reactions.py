"""Reactions of supports in searches and constant-rate tests: they balance the weight and every load."""

import csv
import dataclasses
import itertools

import numpy as np
import pytest

from dembrick import history
from dembrick.runs.simulate import simulate
from dembrick.scenario.blocks import Block
from dembrick.scenario.controls import DisplacementControl, StaticsControl
from dembrick.scenario.model import Load
from dembrick.views import export
from helpers import pushed_assemblies as scenes
from helpers.key_lines import key_lines
from helpers.stone_scenes import law

G = 9.81


def pull(result) -> np.ndarray:
    """Force and moment about the origin (6,) of weight and loads on the free blocks in the last row."""
    assembly, V = result.assembly, result.rows["load"][-1]
    free = np.flatnonzero(~assembly.fixed)
    total = np.zeros(6)
    for i in free:
        force = assembly.dead_force[i]
        total += np.concatenate([force, np.cross(assembly.position[i], force) + assembly.dead_torque[i]])
    jacks = assembly.actuators
    for k, i in enumerate(jacks.at.block):
        force = V * jacks.weight[k] * jacks.direction[k]
        total += np.concatenate([force, np.cross(assembly.position[i] + jacks.at.arm[k], force)])
    return total


def push_back(result) -> np.ndarray:
    """Sum of the reactions of a row, with moments about the origin."""
    assembly, reaction = result.assembly, result.rows["reaction"][-1]
    force = reaction[:, :3]
    moment = reaction[:, 3:] + np.cross(assembly.position[assembly.fixed], force)
    return np.concatenate([force, moment], axis=1).sum(axis=0)


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_reactions_balance_weight_and_push(formulation):
    """An arch on two supports, pushed to its limit: forces and moments sum to zero."""
    result = simulate(scenes.arch(law(formulation, 0.7), (1.0, 0.0, 0.0)))
    assert result.rows["reaction"].shape == (len(result.rows["load"]), 2, 6)
    expected, scale = pull(result), np.abs(pull(result)).max()
    np.testing.assert_allclose(push_back(result), -expected, atol=1e-4 * scale)
    factor = result.rows["load"][-1]
    weight = 13811.599
    assert push_back(result)[0] == pytest.approx(-factor * weight, rel=1e-4)
    assert push_back(result)[2] == pytest.approx(weight, rel=1e-6)
    last = dict(zip(("arch.left", "arch.right"), result.rows["reaction"][-1].tolist(), strict=True))
    assert result.reactions == last == result.as_dict()["reactions"]


def test_a_constant_rate_test_pushes_its_support():
    """One jack at an eccentricity: the floor carries V, the weight, and torsion and bending of V about its centroid."""
    blocks = (
        Block("floor", "stone", (0.6, 0.6, 0.2), (0.0, 0.0, -0.1), fixed=True),
        Block("block", "stone", (0.3, 0.2, 0.1), (0.0, 0.0, 0.05)),
    )
    base = scenes.wall_with_actuator(law())
    jack = dataclasses.replace(base.actuators[0], block="block", point=(0.05, 0.0, 0.02))
    scenario = dataclasses.replace(
        base, blocks=blocks, walls=(), actuators=(jack,),
        control=DisplacementControl(1e-4, 4e-6), text=None,
    )  # fmt: skip
    result = simulate(scenario)
    weight = 2000.0 * G * 0.006
    fx, fy, fz, mx, my, mz = result.rows["reaction"][-1, 0]
    V = -fy
    assert V == pytest.approx(result.rows["load"][-1], rel=1e-3) and V > 0.5 * 0.64 * weight
    assert (fx, fz) == (pytest.approx(0.0, abs=1e-3 * weight), pytest.approx(weight, rel=1e-4))
    assert mz == pytest.approx(-0.05 * V, rel=1e-3)
    assert mx == pytest.approx(0.12 * V, rel=1e-3)
    assert my == pytest.approx(0.0, abs=1e-3 * weight)


def test_a_dead_load_that_is_no_weight_is_carried_too():
    blocks = (
        Block("floor", "stone", (1.0, 1.0, 0.2), (0.0, 0.0, -0.1), fixed=True),
        Block("aside", "stone", (0.2, 0.2, 0.2), (5.0, 0.0, 0.0), fixed=True),
        Block("block", "stone", (0.4, 0.4, 0.2), (0.0, 0.0, 0.1)),
    )
    base = scenes.arch(law("convex"), (1.0, 0.0, 0.0))
    scenario = dataclasses.replace(
        base, arches=(), blocks=blocks, loads=(Load("block", (100.0, 20.0, -300.0), (0.1, 0.0, 0.2)),),
        control=StaticsControl(), text=None,
    )  # fmt: skip
    found = simulate(scenario).reactions
    weight = 2000.0 * G * 0.032
    # the arm of the load from the floor's centroid is (.1, 0, .3)
    moment = -np.cross((0.1, 0.0, 0.3), (100.0, 20.0, -300.0))
    np.testing.assert_allclose(found["floor"], [-100.0, -20.0, weight + 300.0, *moment], rtol=1e-6, atol=1e-6 * weight)
    assert found["aside"] == [0.0] * 6  # a support without contact has no reaction


def test_reactions_in_files(tmp_path):
    """A history has the reactions of every row, a CSV a column per component, and the result those of the end."""
    path = tmp_path / "arch.h5"
    result = simulate(scenes.arch(law("convex", 0.7), (1.0, 0.0, 0.0)), path)
    with history.read(path) as found:
        assert tuple(found.support_names) == ("arch.left", "arch.right")
        np.testing.assert_array_equal(found.reaction, result.rows["reaction"])
        assert found.results["reactions"] == result.reactions
        export.to_csv(found, tmp_path / "arch.csv")
    with open(tmp_path / "arch.csv", newline="", encoding="utf-8") as file:
        head, *lines = csv.reader(file)
    names = ("F_x [N]", "F_y [N]", "F_z [N]", "M_x [N m]", "M_y [N m]", "M_z [N m]")
    titles = [f"reaction of {block} {name}" for block, name in itertools.product(("arch.left", "arch.right"), names)]
    columns = [head.index(title) for title in titles]
    assert columns == list(range(columns[0], columns[0] + 12))
    assert [float(lines[-1][i]) for i in columns] == result.rows["reaction"][-1].ravel().tolist()
    assert "reaction of arch.left" in key_lines(result)
