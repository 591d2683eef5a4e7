"""Newton's method for the joint between a free block and a fixed one: its tangent, its brackets, its record."""

import dataclasses

import numpy as np
import pytest

from dembrick import theory
from dembrick.assembly import build
from dembrick.kernels.statics import joint_families as families
from dembrick.kernels.statics import lone_joint as kernel
from dembrick.runs.simulate import simulate
from dembrick.scenario.model import FORMULATIONS
from dembrick.simulation.statics import batch, lone_joint
from dembrick.simulation.statics.state import initial_state
from helpers.one_joint import MU, A, B, N, scene, single
from helpers.random_polygons import slender_polygon

RECTANGLE = theory.polygons.rectangle(A, B)


@pytest.mark.parametrize("formulation", FORMULATIONS)
@pytest.mark.parametrize("slides", [False, True])
def test_the_tangent_is_that_of_the_law(formulation, slides):
    """The tangent against differences of the forces: closed, with some points open, sticking and sliding."""
    points = (4, 3) if formulation == "distributed" else None
    state = initial_state(build.assemble(scene(formulation, points=points)))
    lone, room = lone_joint.LoneSearch(state, 1e-3).lone, kernel.new_room()
    family = families.only_family(lone.points, lone.areas)
    pressed, slip = 2e-7, 5e-7 if slides else 1e-9
    for opening in (0.0, 3.0 * pressed / A):
        u = np.array([slip, -0.5 * slip, -pressed, 0.1 * opening, opening, slip / A])
        room.motion[:] = u
        kernel.wrench_at(lone, family, 0, 0, room.motion, room.forces[6])
        kernel.tangent_at(lone, family, 0, 0, room)
        found, (before, after) = room.tangent.copy(), np.zeros((2, 6))
        for i in range(6):
            h = 1e-12 if i < 3 else 1e-11
            for sense, out in ((-1.0, before), (1.0, after)):
                beside = u.copy()
                beside[i] += sense * h
                kernel.wrench_at(lone, family, 0, 0, beside, out)
            expected = (after - before) / (2.0 * h)
            np.testing.assert_allclose(found[:, i], expected, rtol=2e-4, atol=2e-5 * np.abs(expected).max())


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_brackets_of_loads_above_the_joint_hold_what_finer_ones_close_on(formulation):
    """The pressure follows the load, so that brackets are indicators: for 60 random joints that bend, slide and rock,
    each bracket to 1e-3 and 1e-5 holds the answer to 1e-8, if there is one."""
    rng, k = np.random.default_rng(7), 60
    shapes = [slender_polygon(rng, 10 ** rng.uniform(-2, 1)) for _ in range(k)]
    size = np.array([np.abs(p).max() for p in shapes])[:, None]
    arm, direction = rng.normal(size=(2, k, 1, 3))
    arm *= 0.5 * size[:, None]
    arm[..., 2], direction[..., 2] = rng.uniform(0.0, 0.6, (k, 1)) * size, 0.0

    def found(tolerance):
        return batch.find_limit_loads(
            batch.Cases.on(
                shapes, formulation, shape=np.arange(k), friction=rates, normal_force=normal, eccentricity=e,
                actuator_point=arm, actuator_direction=direction, points=points, tolerance=tolerance,
            )
        )  # fmt: skip

    points = (5, 5) if formulation == "distributed" else None
    rates, normal = rng.uniform(0.1, 1.2, k), 10 ** rng.uniform(0, 6, k)
    e = np.array([p[rng.integers(len(p))] * rng.uniform(0, 0.4) for p in shapes])
    exact = found(1e-8)
    for tolerance in (1e-3, 1e-5):
        bracket = found(tolerance)
        known = (bracket.status == "yield") & (exact.status == "yield")
        assert known.sum() >= (40 if formulation == "convex" else k)
        assert (bracket.half_width[known] <= 1.001 * tolerance * bracket.V[known]).all()
        slack = 1e-8 * exact.V[known]
        assert (bracket.V_lower[known] <= exact.V[known] + slack).all()
        assert (bracket.V_upper[known] >= exact.V[known] - slack).all()


@pytest.mark.parametrize("formulation", ["convex", "concave"])
def test_the_fixed_block_may_come_last(formulation):
    """The joint then has the axes of the other block: V is the same, and so is the reaction of the support."""
    jacks = single((0.25 * A, 0.0))
    first = scene(formulation, jacks=jacks, tolerance=1e-6)
    last = dataclasses.replace(first, blocks=first.blocks[::-1])
    one, other = simulate(first, record=False), simulate(last, record=False)
    assert other.yield_point.bracket == "certified"
    assert other.yield_point.V == pytest.approx(one.yield_point.V, rel=1e-6)
    np.testing.assert_allclose(other.run.reactions, one.run.reactions, rtol=1e-6, atol=1e-6 * N)


@pytest.mark.parametrize("formulation", FORMULATIONS)
def test_a_record_changes_no_bit(formulation):
    scenario = scene(formulation, jacks=single((0.2 * A, 0.02)))
    alone, recorded = simulate(scenario, record=False), simulate(scenario)
    assert alone.yield_point == recorded.yield_point
    load, lower, upper = (recorded.rows[name] for name in ("load", "lower", "upper"))
    assert len(load) == recorded.run.settings["equilibria"] + 1 and load[0] == 0.0
    assert (np.diff(lower) >= 0.0).all() and (np.diff(upper) <= 0.0).all()


def test_what_presses_as_fast_as_it_shears_has_no_limit():
    """Friction 0.64 under a force that presses the joint twice as much as it shears it: it locks."""
    found = batch.find_limit_loads(
        batch.Cases.on(
            RECTANGLE, "concave", friction=MU, normal_force=N, actuator_point=[[0.0, 0.0, 0.0]],
            actuator_direction=[[0.0, 1.0, -2.0]],
        )
    )  # fmt: skip
    assert list(found.status) == ["not converged"] and not np.isfinite(found.V[0])
