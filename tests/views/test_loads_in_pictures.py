"""Loads in pictures: arrows outside the stone that end at the point of application; names; a view from behind."""

import base64
import json
import re

import numpy as np
import pytest

import dembrick
from dembrick import history
from dembrick.assembly.build import assemble
from dembrick.runs import mechanism_history
from dembrick.views import page
from dembrick.views.motion.blocks import Poses, moving_blocks
from dembrick.views.motion.loads import arrow_place, dead_loads, driven_loads
from dembrick.views.render.loads import DrawnLoads
from dembrick.views.render.look import VIEWS
from helpers.scenario_text import block, header, jack

G = 9.81
PLACE = (0.1, 0.2, 0.3)  # half the edges (m)
TEXT = header(friction=0.6, title="loads all round")
TEXT += block("ground", (0.0, 0.0, -0.1), (1.0, 1.0, 0.2), "fixed = true")
TEXT += block("stone", (0.0, 0.0, 0.3), (0.2, 0.4, 0.6))
TEXT += """
[[loads]]
block = "stone"
point = [0.0, 0.0, 0.6]
force = [0.0, 0.0, -300.0]
[[loads]]
block = "stone"
force = [0.0, -50.0, 0.0]
[[pressures]]
block = "stone"
direction = [1.0, 0.0, 0.0]
surface = 0.6
weight = 981.0
"""
PUSHED = jack("stone", (-0.1, 0.0, 0.4)) + '[control]\nkind = "yield"\n'


def built(text):
    scenario = dembrick.loads(text)
    return mechanism_history.before_a_run(scenario, assemble(scenario))


def test_arrows_end_at_their_points_outside_the_stone():
    """Arrows of a weight on top, a jack on one side, a force at the centroid and a light fluid on the other side, whose
    981 N/m3 over 0.6 m x 0.4 m give 70.632 N at 0.2 m above the foot."""
    with built(TEXT + PUSHED) as run:
        drawn = DrawnLoads(run, 1.0, 0.6, 1.0)
        poses = Poses.read(run, 0, 1)
        points, tails, tips = drawn.dead.ends(poses)
        (jack_point,), (jack_tail,), (jack_tip,) = drawn.driven.ends(poses)
        sizes = [load.size for load in dead_loads(run)]
        assert drawn.words() == ["orange: actuators", "violet: dead loads, the longest 300 N"]
    np.testing.assert_allclose(sizes, [300.0, 50.0, 0.5 * 981 * 0.6**2 * 0.4], rtol=1e-12)
    np.testing.assert_allclose(tips[0], [0.0, 0.0, 0.6], atol=1e-12)
    np.testing.assert_allclose(tips[1], [0.0, 0.2, 0.3], atol=1e-12)  # where the line of action enters the stone
    np.testing.assert_allclose(points[1], [0.0, 0.0, 0.3], atol=1e-12)
    np.testing.assert_allclose(tips[2], [0.1, 0.0, 0.2], atol=1e-12)
    np.testing.assert_allclose((tips - tails)[0], [0.0, 0.0, -0.3], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(tips - tails, axis=1) / 0.3, np.array(sizes) / sizes[0], rtol=1e-12)
    np.testing.assert_allclose(jack_tip, [-0.1, 0.0, 0.4], atol=1e-12)
    assert jack_tip == pytest.approx(jack_point) and jack_tail[0] < -0.1
    for tail in (*tails, jack_tail):  # no arrow starts inside the stone
        assert (np.abs(tail - [0.0, 0.0, 0.3]) > np.array(PLACE)).any()


def test_forces_on_all_blocks_are_one_arrow_before_the_structure():
    """The body forces of a push along x are one arrow at the height of the centroid, 0.3 m, outside the stone."""
    with built(TEXT + '[control]\nkind = "pushover"\ndirection = [1.0, 0.0, 0.0]\n') as run:
        drawn = DrawnLoads(run, 1.0, 0.6, 1.0)
        assert drawn.words()[0] == "orange: resultant of the body forces"
        _, (tail,), (tip,) = drawn.driven.ends(Poses.read(run, 0, 1))
    assert tip[0] < -0.1 and (tip - tail) == pytest.approx([0.15, 0.0, 0.0]) and tip[2] == pytest.approx(0.3)


def test_a_force_that_draws_begins_at_its_face():
    with built(TEXT + PUSHED.replace("[1.0, 0.0, 0.0]", "[-1.0, 0.0, 0.0]")) as run:
        (jack,) = driven_loads(run)
        assert jack.place == (0.0, True)
        assert arrow_place(run, jack.block, jack.arm, -jack.way) == (0.0, False)


def test_slanting_forces_and_faces():
    """A force along a face is treated as inside the stone; an oblique one enters where its ray enters the box."""
    with built(TEXT + PUSHED) as run:
        along = arrow_place(run, 1, np.array([0.0, 0.0, 0.3]), np.array([0.0, 1.0, 0.0]))  # over the top face
        assert along == pytest.approx((-0.2, False))
        way = np.array([0.6, 0.0, -0.8])
        shift, pulls = arrow_place(run, 1, np.array([0.0, 0.0, 0.0]), way)
        assert not pulls and shift == pytest.approx(-min(0.1 / 0.6, 0.3 / 0.8))


def test_a_history_of_a_run_keeps_its_dead_loads(tmp_path):
    dembrick.simulate(dembrick.loads(TEXT + PUSHED), tmp_path / "run.h5")
    with history.read(tmp_path / "run.h5") as run:
        assert [load["force"].tolist() for load in run.loads[:2]] == [[0.0, 0.0, -300.0], [0.0, -50.0, 0.0]]
        text = page.document(run)
    data = json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', text, re.S).group(1))
    jack, dead = data["actuators"], data["loads"]
    assert jack[0]["ends"] == [[0.0, False], [0.0, True]] and jack[0]["size"] == 1.0
    assert [load["ends"][0] for load in dead] == [[0.0, False], [pytest.approx(-0.2), False], [0.0, False]]
    assert "Violet arrows: dead loads." in text and 'data-view="back"' in text
    assert base64.b64decode(data["blocks"]["vertices"])


def test_only_what_moves_is_named(tmp_path):
    """Of two stones side by side only the one that is pushed away is named."""
    text = header(friction=0.3, title="two") + block("ground", (0.0, 0.0, -0.1), (2.0, 1.0, 0.2), "fixed = true")
    text += block("still", (-0.6, 0.0, 0.1), (0.2, 0.2, 0.2)) + block("gone", (0.2, 0.0, 0.1), (0.2, 0.2, 0.2))
    text += '[[loads]]\nblock = "gone"\nforce = [200.0, 0.0, 0.0]\n[control]\nkind = "dynamic"\nduration = 0.1\n'
    dembrick.simulate(dembrick.loads(text), tmp_path / "run.h5")
    with history.read(tmp_path / "run.h5") as run:
        assert [run.block_names[i] for i in moving_blocks(run, run.n_frames - 1)] == ["gone"]
    with built(text) as before:
        assert len(moving_blocks(before, 0)) == 3


def test_the_camera_behind_is_opposite_the_one_in_front():
    assert np.dot(VIEWS["back"][0], VIEWS["front"][0]) == -1.0 and VIEWS["back"][1] == VIEWS["front"][1]
