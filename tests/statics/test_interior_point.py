"""The interior-point method of searches: one step to where a mechanism moves, against closed forms and the laws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dembrick.assembly import build
from dembrick.runs.simulate import simulate
from dembrick.scenario.controls import TiltControl
from dembrick.scenario.generators import Dome, Wall
from dembrick.scenario.model import Block, JointLaw, Material, Scenario
from dembrick.simulation.statics.load_system import Setup
from dembrick.simulation.statics.path_following import PathFollower


def scene(friction=0.64, formulation="concave", axis=(1.0, 0.0, 0.0), **parts) -> Scenario:
    return Scenario(
        title="one step",
        gravity=(0.0, 0.0, -9.81),
        joint=JointLaw(formulation, friction, 1e10, 4e9),
        materials={"stone": Material(2000.0)},
        blocks=parts.pop("blocks", ()),
        control=TiltControl(axis, 1.0, 1e-4, quasi_static=True),
        **parts,
    )


def dome(rings: int, blocks: int) -> Scenario:
    shell = Dome("dome", "stone", radius=2.0, thickness=0.2, rings=rings, blocks=blocks, key=8.0)
    return scene(0.7, axis=(0.0, 1.0, 0.0), domes=(shell,))


def wall(formulation="concave", friction=0.64) -> Scenario:
    return scene(friction, formulation, walls=(Wall("wall", "stone", (0.3, 0.2, 0.1), courses=10, blocks=4, base=0.1),))


def pile(friction: float) -> Scenario:
    """Two cubes on a fixed one."""
    blocks = [Block(f"b{k}", "stone", (0.4, 0.4, 0.4), (0.0, 0.0, 0.4 * k), fixed=k == 0) for k in range(3)]
    return scene(friction, blocks=tuple(blocks))


def follower_of(scenario: Scenario) -> PathFollower:
    setup = Setup(build.assemble(scenario), 1e-3)
    follower = PathFollower(setup.state, setup.load, setup.factor, setup.certificate)
    follower.prepare()
    follower.way = follower._at_start(0.25)
    return follower


def one_step(scenario: Scenario, step: float):
    """The follower, and what the interior-point method finds a driven displacement of ``step`` (m) from rest."""
    follower = follower_of(scenario)
    way = follower.way
    follower.search.attempt(way.motion, way.V)
    return follower, follower.interior.find(way.motion + step * way.direction, 0.0, step)


@pytest.mark.parametrize(
    "scenario, V", [(wall(), 0.2), (wall("corrected-shear"), 0.2), (wall(friction=0.1), 0.1), (pile(0.3), 0.3)]
)
def test_one_step_from_rest_ends_at_the_limit(scenario, V):
    """A wall turns about its toe at thickness over height, or slides on its base, and so does a pile of cubes."""
    follower, (motion, found) = one_step(scenario, 0.01)
    assert found == pytest.approx(V, rel=1e-4)
    assert follower.search.iterations <= 30


def test_what_it_finds_is_an_equilibrium_of_the_laws():
    """A dome far beyond its elastic range, where Newton's method finds nothing: forces in balance by the same laws."""
    follower, (motion, V) = one_step(dome(6, 12), 4e-4)
    search, way = follower.search, follower.way
    search.attempt(motion, V)
    assert search.out_of_balance() < 1e-3 and search.find(motion, V)[0] == pytest.approx(V, rel=1e-4)
    points = search.state.points
    shear = np.hypot(points.elastic_1, points.elastic_2)
    assert (shear <= 0.7 * points.normal * (1.0 + 1e-9)).all() and (shear > 0.699 * points.normal).sum() > 50
    assert 0.3 < V < 0.38
    assert search.find(way.motion + 4e-4 * way.direction, 0.0)[0] is None


def test_domes_take_few_newton_steps():
    """Blocks slide and rock in many places at once: no step is given up there."""
    result = simulate(dome(6, 12), record=False)
    assert result.yield_point.V == pytest.approx(0.363, rel=0.01)
    assert result.run.steps <= 250


@pytest.mark.parametrize("formulation, there", [("concave", True), ("distributed", True), ("convex", False)])
def test_only_points_without_strengths_are_treated_so(formulation, there):
    assert (follower_of(wall(formulation)).interior is not None) == there
    law = JointLaw("concave", 0.64, 1e10, 4e9, cohesion=1e4, tensile_strength=1e4)
    assert follower_of(replace(wall(), joint=law)).interior is None
