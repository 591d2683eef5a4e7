"""Utilisation of joints that crush: 1 if N stands on an edge strip stressed to the compressive strength."""

import dataclasses

import h5py
import numpy as np
import pytest

from dembrick import history
from dembrick.runs.simulate import simulate
from dembrick.views.motion.bending import reach_of, reach_of_points
from dembrick.views.motion.hinges import hinges
from dembrick.views.motion.joints import JointMotion
from helpers.one_joint import A, B, N, scene

COUPLE = (((0.0, 0.0, 0.1), (0.0, 1.0, 0.0), 1.0), ((0.0, 0.0, 0.0), (0.0, -1.0, 0.0), 1.0))


@pytest.mark.parametrize("formulation, points", [("convex", None), ("distributed", (5, 6))])
def test_a_couple_on_a_joint_of_which_a_third_is_crushed(tmp_path, formulation, points):
    """Utilisation is M over its limit N (b/2 - N / (2 f_c a)) = N b/3 (arm 0.1 m), and at least 1/3, from N alone."""
    given = scene(formulation, jacks=COUPLE, points=points)
    law = dataclasses.replace(given.joint, compressive_strength=3.0 * N / (A * B))
    path, limit = tmp_path / "crushed.h5", N * B / 3.0 / 0.1
    simulate(dataclasses.replace(given, joint=law), path)
    with history.read(path) as found:
        assert found.joints[0]["compressive_strength"] == pytest.approx(3.0 * N / (A * B))
        motion, frames = JointMotion(found), range(found.n_frames)
        V, used = found.load[motion.rows(frames)], motion.at(frames).utilisation[:, 0]
        assert V[-1] == pytest.approx(limit, rel=2e-3)
        np.testing.assert_allclose(used, np.maximum(V / limit, 1.0 / 3.0), atol=1e-6)
        assert hinges(found, motion, found.n_frames - 1) == [0] and hinges(found, motion, 1) == []
    with h5py.File(path, "r+") as file:  # as earlier versions wrote it: nothing crushes
        del file["geometry/joints/compressive_strength"]
    with history.read(path) as found:
        edge = B / 2.0 if formulation == "convex" else found.joints[0]["normal_arms"][:, 1].max()
        used = JointMotion(found).at(frames).utilisation[:, 0]
        np.testing.assert_allclose(used, V / limit * (B / 3.0) / edge, atol=1e-6)


def turned(degrees):
    angle = np.radians(np.atleast_1d(degrees))
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


@pytest.mark.parametrize("share", [1e-3, 0.2, 0.5, 0.9, 1.0])
def test_what_a_line_cuts_off(share):
    """A line cuts a similar triangle off the corner of a triangle, with its centroid at 2/3 of sqrt(share) of the
    height from the corner, and a strip off a rectangle."""
    triangle = np.array([[-0.2, -0.1], [0.2, -0.1], [0.0, 0.2]])
    expected = 0.2 - 2.0 / 3.0 * 0.3 * np.sqrt(share)
    assert reach_of(triangle, turned(90.0), np.array([share * 0.06]))[0] == pytest.approx(expected, abs=1e-12)
    box = 0.5 * np.array([[-A, -B], [A, -B], [A, B], [-A, B]])
    found = reach_of(box, turned([0.0, 90.0, 180.0]), np.full(3, share * A * B))
    np.testing.assert_allclose(found, np.array([A, B, A]) * 0.5 * (1.0 - share), atol=1e-12)


def test_the_middle_of_what_is_cut_off_askew_against_many_points():
    box = 0.5 * np.array([[-A, -B], [A, -B], [A, B], [-A, B]])
    x, y = (size * ((np.arange(400) + 0.5) / 400 - 0.5) for size in (A, B))
    arms = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    areas, towards = np.full(len(arms), A * B / len(arms)), turned([10.0, 33.7, 61.0, 200.0, 290.0])
    pressed = A * B * np.array([0.02, 0.1, 0.4, 0.7, 0.97])
    expected = reach_of_points(arms, areas, towards, pressed)
    np.testing.assert_allclose(reach_of(box, towards, pressed), expected, rtol=2e-4, atol=1e-7)
