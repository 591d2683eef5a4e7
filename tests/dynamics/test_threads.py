"""Threads change no bit of a result, and small scenes compile no parallel code."""

import subprocess
import sys
from dataclasses import replace

import numba
import numpy as np
import pytest

import dembrick
from dembrick.assembly.build import assemble
from dembrick.kernels.dynamics.loop import Limits, advance_bodies
from dembrick.simulation.dynamics import chunks, integrator
from dembrick.simulation.dynamics.energy import MotionEnergy
from dembrick.simulation.dynamics.loads import Driving
from helpers import rows
from helpers.custom_laws import COULOMB
from helpers.places import TESTS
from helpers.walls import wall


@pytest.mark.parametrize("formulation", ["concave", pytest.param("convex", marks=pytest.mark.slow)])
def test_any_number_of_threads_gives_the_same_bits(formulation, monkeypatch):
    built = wall(formulation)
    before = built.rotation.copy()
    ends, found = [], []
    for threads in (None, *range(1, numba.config.NUMBA_NUM_THREADS + 1)):
        monkeypatch.setattr(chunks, "MANY", 0 if threads else 10**9)
        monkeypatch.setattr(integrator.Pace, "choose", lambda _, loops: (loops - 1, 2048))
        if threads:
            numba.set_num_threads(threads)
        moving = integrator.motion(built, 0.1, 0.5)
        driving = Driving(built.gravity)
        moving.energy = MotionEnergy(moving.state)
        moving.energy.open(moving.state)
        integrator.advance(moving, driving, 300, Limits(1.0, 1.0))
        ends.append(moving.state)
        found.append(rows.energies(moving))
    numba.set_num_threads(numba.config.NUMBA_NUM_THREADS)
    for end in ends[1:]:
        np.testing.assert_array_equal(end.bodies.position, ends[0].bodies.position)
        np.testing.assert_array_equal(end.bodies.orientation, ends[0].bodies.orientation)
        np.testing.assert_array_equal(end.links.wrench, ends[0].links.wrench)
    assert np.abs(ends[0].links.wrench).max() > 100.0
    assert found[1:] == found[:1] * len(found[1:]) and found[0]["kinetic"] > 0.0 and found[0]["dashpots"] > 0.0
    np.testing.assert_array_equal(built.rotation, before)  # a run leaves the assembly as it was


@pytest.mark.parametrize("kind", ["concave", "convex", "linear", "custom"])
def test_large_scenes_that_threads_cannot_share_go_without(kind, monkeypatch):
    """Joints with strengths, linear pressure or a user's own law run in one thread: numba cannot parallelise them."""
    law = {"formulation": "convex"} if kind in ("convex", "linear") else {"formulation": "concave"}
    more = {"linear": {"pressure": "linear"}, "custom": {}}.get(kind, {"cohesion": 1e4})
    built = assemble(dembrick.load("wall_tilt", [f"joint.{k}={v}" for k, v in (law | more).items()]))
    built = replace(built, custom_law=COULOMB if kind == "custom" else None)
    monkeypatch.setattr(chunks, "MANY", 0)
    moving = integrator.motion(built, 0.1, 0.5)
    ((loop, _),) = chunks.loops_for(moving, moving.state.bodies)
    assert loop is advance_bodies
    dry = integrator.motion(wall(law["formulation"]), 0.1, 0.5)
    assert len(chunks.loops_for(dry, dry.state.bodies)) == min(numba.get_num_threads(), 2)


def test_a_small_scene_compiles_no_parallel_code():
    code = f"""
import sys
from dembrick.kernels.dynamics import loop
from dembrick.simulation.dynamics import integrator as dynamics
from dembrick.simulation.dynamics.loads import Driving
from dembrick.kernels.dynamics.loop import Limits
sys.path.insert(0, {str(TESTS)!r})
from helpers.walls import wall
built = wall("concave")
moving = dynamics.motion(built, 0.1, 0.5)
dynamics.advance(moving, Driving(built.gravity), 2, Limits(1.0, 1.0))
assert loop.advance_bodies.called.signatures and not loop.advance_bodies_together.called.signatures
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_a_wall_of_point_joints_takes_less_than_two_kilobytes_a_block():
    """Wide walls have three joints a block; joints of equal blocks share their axes."""
    scenario = wall("concave", courses=12, blocks=40)
    moving = integrator.motion(scenario, 0.1, 0.5)
    joints, blocks = len(scenario.joints), len(scenario.names)
    assert joints / blocks > 2.8
    assert len(moving.state.links.axes) == 2
    assert sum(array.nbytes for array in moving.state.arrays) < 2048 * blocks
