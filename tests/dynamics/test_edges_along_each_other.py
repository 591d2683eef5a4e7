"""Edges that lie along each other from the start, as those of stones in straight rows: they overlap as joints are
compressed, and press only once their force counts."""

import math

import numpy as np
import pytest

from dembrick.geometry.shapes import box
from dembrick.runs.simulate import restart, simulate
from dembrick.scenario.controls import DynamicControl
from dembrick.scenario.model import CHANNELS, Block, Output
from dembrick.simulation.dynamics import contact_detection
from helpers.pairs import K_N, Pair
from helpers.restart_cases import check_same
from helpers.stone_scenes import law, of_stone

CUBE, DEPTH, WIDE = 0.1, 2e-5, 0.2
G = 9.81


def edges(slack, least, deepest=1e-3):
    """Two blocks whose edges, `WIDE` long, are `DEPTH` deep in each other."""
    pair = Pair(box((CUBE, WIDE, CUBE)), box((CUBE, WIDE, CUBE)), friction=0.0)
    pair.contact.slack[:], pair.contact.least[:], pair.contact.deepest[:] = slack, least, deepest
    return pair, (CUBE - DEPTH, 0.0, CUBE - DEPTH)


def force(pair, place):
    return np.linalg.norm(pair.wrench(place)[:3])


def test_edges_press_from_the_force_on_that_counts():
    """Two edges overlap by d: the pressure is 2 kn x, up to x = d/2 half way, on two planes that cross."""
    exact = force(*edges(0.0, 0.0))
    assert exact == pytest.approx(K_N * WIDE * DEPTH**2 / math.sqrt(2.0), rel=1e-6)
    pair, place = edges(0.1 * DEPTH, 0.99 * exact)
    assert force(pair, place) == exact
    assert pair.contact.slack[0] == 0.0
    pair, place = edges(0.1 * DEPTH, 1.01 * exact)
    assert [force(pair, place) for _ in range(5)] == 5 * [0.0]
    assert DEPTH < pair.contact.slack[0] <= 2.0 * DEPTH
    pair, place = edges(0.1 * DEPTH, 1.01 * exact, deepest=0.4 * DEPTH)
    assert force(pair, place) == exact


def test_edges_that_press_go_on_however_little_that_becomes():
    pair, place = edges(0.1 * DEPTH, 0.0)
    force(pair, place)
    for part in (0.5, 0.01):
        at = CUBE - part * DEPTH
        assert force(pair, (at, 0.0, at)) == pytest.approx(part**2 * force(*edges(0.0, 0.0)), rel=1e-6)


def rows_on_a_slope(spin=0.0):
    """Two cubes side by side on two others on a floor inclined by 0.2 rad; ``spin`` (rad/s): of all at the start."""
    places = [(0.1 * i, 0.0, 0.05 + 0.1 * k) for i in range(2) for k in range(2)]
    return of_stone(
        law("concave", 0.6, 1e8),
        DynamicControl(0.1, 0.3),
        (
            Block("floor", "stone", (2.0, 2.0, 0.1), (0.0, 0.0, -0.05), fixed=True),
            *(
                Block(f"cube {n}", "stone", (0.1, 0.1, 0.1), place, angular_velocity=(0.0, spin, 0.0))
                for n, place in enumerate(places)
            ),
            Block("far", "stone", (0.1, 0.1, 0.1), (0.5, 0.5, 0.07), velocity=(0.0, 0.0, 0.0)),
        ),
        gravity=(G * math.sin(0.2), 0.0, -G * math.cos(0.2)),
        output=Output(CHANNELS, rows=400, frames=400),
    )


def test_stones_in_straight_rows_move_as_if_their_edges_pressed(monkeypatch):
    """Ignoring negligible edge forces changes the motion by no more than their tolerance. A stone falls beside the rows
    so that pairs are watched."""
    without, part = simulate(rows_on_a_slope()), contact_detection.NEGLIGIBLE
    monkeypatch.setattr(contact_detection, "NEGLIGIBLE", 0.0)
    with_all = simulate(rows_on_a_slope())
    cubes = slice(1, 5)
    met = [run.frames["new_contacts"] for run in (without, with_all)]
    pressed = [(contacts["blocks"] < 5).all(axis=1) & (contacts["blocks"] > 0).all(axis=1) for contacts in met]
    assert pressed[1].sum() > 100  # their edges do overlap
    assert not pressed[0].any()
    moved = [run.frames["displacement"][-1, cubes] for run in (without, with_all)]
    assert np.abs(moved[0] - moved[1]).max() < 2.0 * part * np.abs(moved[1]).max()


def test_an_edge_carries_its_block():
    """A block that stands on its edge from the start, with no joint, is carried: its edge force is not ignored."""
    side = 0.1
    turn = (math.cos(math.pi / 8.0), 0.0, math.sin(math.pi / 8.0), 0.0)
    scene = of_stone(
        law("concave", 0.6, 1e8),
        DynamicControl(0.1, 0.3),
        (
            Block("floor", "stone", (2.0, 2.0, 0.1), (0.0, 0.0, -0.05), fixed=True),
            Block("cube", "stone", (side, side, side), (0.0, 0.0, side / math.sqrt(2.0)), turn),
        ),
        output=Output(CHANNELS, rows=400, frames=400),
    )
    frames = simulate(scene).frames
    sunk = -frames["displacement"][:, 1, 2]
    rest = math.sqrt(2000.0 * side**3 * G / (1e8 * side))  # weight over kn d^2 times the edge's length
    assert 0.3 * rest < sunk[-1] < 3.0 * rest


def test_a_run_goes_on_with_edges_that_press_nothing_yet(tmp_path, stop_after, monkeypatch):
    """A restarted run is equal bit for bit; the force up to which edges are ignored is known right after the restart,
    not only at the next detection."""
    given, found = rows_on_a_slope(spin=0.1), []
    restore = contact_detection.ContactDetection.restore

    def look_on(detection, *arguments):
        restore(detection, *arguments)
        found.append((detection.touching.slack > 0.0, detection.touching.least > 0.0))

    monkeypatch.setattr(contact_detection.ContactDetection, "restore", look_on)
    simulate(given, tmp_path / "whole.h5")
    with stop_after(20):
        simulate(given, tmp_path / "parts.h5")
    restart(tmp_path / "parts.h5")
    check_same(tmp_path / "whole.h5", tmp_path / "parts.h5")
    lying, counted = found[0]
    assert lying.any() and counted[lying].all()
