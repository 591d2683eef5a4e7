"""Blocks that strike their joints at time zero, boxes that meet with flush sides, prisms that slide along an edge."""

import math
from dataclasses import replace

import numpy as np
import pytest

from dembrick.kernels.dynamics.polygon_cuts import room_along
from dembrick.runs.simulate import simulate
from dembrick.scenario.controls import DynamicControl
from dembrick.scenario.model import Block, Output
from dembrick.simulation.dynamics.joint_polygons import Polygons
from helpers.stone_scenes import law, of_stone

G = 9.81


def scene(*blocks, control, gravity=(0.0, 0.0, -G), friction=0.5, formulation="convex", **more):
    return of_stone(
        law(formulation, friction, **more), control, blocks, gravity=gravity, output=Output(rows=400, frames=40)
    )


@pytest.mark.parametrize("formulation", ["convex", "concave", "corrected-shear"])
@pytest.mark.parametrize("restitution", [1.0, 0.5])
def test_a_block_that_is_thrown_into_its_joint_rebounds_as_stated(formulation, restitution):
    """A block on its floor that moves down at 1 m/s at time zero leaves it at e times that, at the default step."""
    floor = Block("floor", "stone", (2.0, 2.0, 0.1), (0.0, 0.0, -0.05), fixed=True)
    block = Block("block", "stone", (0.2, 0.2, 0.4), (0.0, 0.0, 0.2), velocity=(0.0, 0.0, -1.0))
    result = simulate(scene(floor, block, control=DynamicControl(0.05, restitution), formulation=formulation))
    z, v = (result.frames[name][:, 1, 2] for name in ("displacement", "velocity"))
    flying = z > 1e-3
    np.testing.assert_allclose(np.sqrt(v[flying] ** 2 + 2.0 * G * z[flying]), restitution, rtol=5e-3)
    assert result.energy.relative_residual < 1e-6


def test_a_block_that_slides_keeps_its_joint():
    """A velocity along the joint is no impact: the block slides v^2 / (2 mu g) and keeps its joint."""
    floor = Block("floor", "stone", (4.0, 2.0, 0.1), (0.0, 0.0, -0.05), fixed=True)
    block = Block("block", "stone", (0.4, 0.4, 0.2), (0.0, 0.0, 0.1), velocity=(0.8, 0.0, 0.0))
    result = simulate(scene(floor, block, control=DynamicControl(0.3)))
    assert not result.run.motion.contact_detection.retired.any()
    assert result.frames["displacement"][-1, 1, 0] == pytest.approx(0.64 / (2.0 * 0.5 * G), rel=2e-3)


def test_boxes_with_flush_sides_meet_straight():
    """Two boxes in a perfectly elastic frictionless impact exchange velocities, and move sideways by rounding only."""
    v = 0.5
    far = Block("far", "stone", (0.1, 0.1, 0.1), (0.0, 3.0, 3.0), fixed=True)
    left = Block("left", "stone", (0.3, 0.2, 0.1), (-0.16, 0.0, 0.0), velocity=(v, 0.0, 0.0))
    right = Block("right", "stone", (0.3, 0.2, 0.1), (0.16, 0.0, 0.0), velocity=(-v, 0.0, 0.0))
    control = DynamicControl(0.06, 1.0)
    result = simulate(scene(far, left, right, control=control, gravity=(0.0, 0.0, 0.0), friction=0.0))
    end, spin = result.frames["velocity"][-1, 1:], result.frames["spin"][-1, 1:]
    np.testing.assert_allclose(end[:, 0], [-v, v], rtol=2e-3)
    assert np.abs(end[:, 1:]).max() < 1e-12 * v and np.abs(spin).max() < 1e-10
    kinetic = (end**2).sum() / (2.0 * v**2)
    assert kinetic == pytest.approx(1.0, abs=1e-2) and end[0, 0] == pytest.approx(-end[1, 0], rel=1e-12)


def trough(tilt, end):
    """A prism in a V trough of planes at 30 and 60 deg that slopes down along y by ``tilt`` and ends at ``end``."""
    wedge = [(-0.2 * math.sqrt(3.0), 0.2), (0.0, 0.0), (0.2 / math.sqrt(3.0), 0.2)]
    blocks = [Block("prism", "stone", vertices=_prism(wedge, -0.25, 0.25))]
    for name, angle in (("left", math.radians(150.0)), ("right", math.radians(60.0))):
        along = np.array([math.cos(angle), math.sin(angle)])
        under = np.array([along[1], -along[0]]) * (0.2 if name == "right" else -0.2)
        face = [np.zeros(2), 0.6 * along, 0.6 * along + under, under]
        blocks.append(Block(name, "stone", vertices=_prism(face, -1.0, end), fixed=True))
    gravity = (0.0, G * math.sin(tilt), -G * math.cos(tilt))
    return blocks, gravity


def _prism(section, back, front):
    return tuple((float(x), y, float(z)) for y in (back, front) for x, z in section)


def test_a_prism_slides_down_a_trough_without_being_cut_again_and_again(monkeypatch):
    """Closed form of the wedge: a = g sin t - mu g cos t (sin a + sin b) / sin(a + b), here with a + b = 90 deg."""
    tilt, mu = math.radians(35.0), 0.3
    cuts = []
    own = Polygons._cut
    monkeypatch.setattr(Polygons, "_cut", lambda self, j, corners: (cuts.append(j), own(self, j, corners)))
    blocks, gravity = trough(tilt, 6.0)
    result = simulate(scene(*blocks, control=DynamicControl(0.4), gravity=gravity, friction=mu))
    wedged = math.sin(math.radians(30.0)) + math.sin(math.radians(60.0))
    acceleration = G * (math.sin(tilt) - mu * math.cos(tilt) * wedged)
    assert result.frames["displacement"][-1, 0, 1] == pytest.approx(0.5 * acceleration * 0.4**2, rel=1e-3)
    assert 0 < len(cuts) < 100


@pytest.mark.parametrize("formulation", ["convex", "concave", "distributed"])
def test_what_glides_along_an_edge_is_cut_at_its_end(monkeypatch, formulation):
    """A block as wide as its slab slides off the end: it moves the same as if its polygon were cut in every check."""
    points = {"points": (6, 4)} if formulation == "distributed" else {}
    slab = Block("slab", "stone", (1.0, 0.2, 0.1), (-0.3, 0.0, -0.05), fixed=True)
    block = Block("block", "stone", (0.3, 0.2, 0.1), (0.0, 0.0, 0.05), velocity=(3.0, 0.0, 0.0))
    given = scene(slab, block, control=DynamicControl(0.1), formulation=formulation, friction=0.2, **points)
    given = replace(given, joint=replace(given.joint, normal_stiffness=1e8, shear_stiffness=4e7))
    glided = simulate(given)
    own = Polygons._cut

    def cut_and_stop(self, j, corners):
        own(self, j, corners)
        self.state.links.glide[j] = 1.0, 0.0, 1.0

    monkeypatch.setattr(Polygons, "_cut", cut_and_stop)
    cut = simulate(given)
    ways = [run.frames["displacement"][-1, 1] for run in (glided, cut)]
    assert ways[0][0] > 0.25
    np.testing.assert_allclose(ways[0], ways[1], rtol=0, atol=1e-9)


def test_room_along_an_edge():
    """A rectangle flush with two sides of a face, 0.5 m from the nearer end: along them it may move 0.5 m plus the
    change, across them only the change."""
    face = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 0.5], [0.0, 0.5]])
    points = np.array([[0.5, 0.0], [1.0, 0.0], [1.0, 0.5], [0.5, 0.5]])
    assert room_along(points, face, 1.0, 0.0, 1e-3, 0.0) == pytest.approx(0.5 + 1e-3)
    assert room_along(points, face, 0.0, 1.0, 1e-3, 0.0) == pytest.approx(1e-3)
    assert room_along(points, face, 1.0, 0.0, 1e-3, 0.2) == pytest.approx(0.3 + 1e-3)
