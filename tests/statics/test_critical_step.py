"""The critical time step of assemblies against the true highest frequency, by dense eigenvalues."""

from __future__ import annotations

import math

import numpy as np
import pytest

from dembrick.assembly import build
from dembrick.scenario.model import Block, Material, YieldControl
from dembrick.simulation.statics import critical_step, joint_families
from dembrick.simulation.statics.state import initial_state
from dembrick.simulation.statics.stiffness import assembled_stiffness, block_stiffness, to_joint
from helpers.stone_scenes import law, of_stone


def wall(courses: int, blocks: int, formulation: str, densities=(1500.0,)) -> build.Assembly:
    """Running bond without half blocks: every other course is shifted by half a block, on a base below both."""
    length, width, height = 0.3, 0.2, 0.1
    materials = {f"stone{i}": Material(density) for i, density in enumerate(densities)}
    whole = (length * (blocks + 0.5), width, height)
    stones = [Block("base", "stone0", whole, (0.5 * whole[0], 0.0, -0.5 * height), fixed=True)]
    for row in range(courses):
        for i in range(blocks):
            x = length * (i + 0.5 + 0.5 * (row % 2))
            material = f"stone{(row + i) % len(densities)}"
            stones.append(Block(f"s{row}_{i}", material, (length, width, height), (x, 0.0, (row + 0.5) * height)))
    return build.assemble(of_stone(law(formulation), YieldControl(), stones, materials=materials))


def true_frequency(built) -> float:
    state = initial_state(built)
    K, inertia = assembled_stiffness(state), critical_step.block_inertia(built)[state.blocks.free]
    M = np.zeros_like(K)
    for i, block in enumerate(inertia):
        M[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] = block
    lower = np.linalg.inv(np.linalg.cholesky(M))
    return math.sqrt(np.linalg.eigvalsh(lower @ K @ lower.T)[-1])


@pytest.mark.parametrize("formulation", ["concave", "corrected", "convex"])
@pytest.mark.parametrize("size, least", [((1, 1), 0.9999), ((10, 1), 0.97), ((3, 3), 0.85), ((10, 10), 0.8)])
def test_the_step_is_safe_and_not_wasteful(formulation, size, least):
    built = wall(*size, formulation)
    state = initial_state(built)
    bound = critical_step.greatest_frequency(
        state, critical_step.block_inertia(built), block_stiffness(state, shared=1.0)
    )
    ratio = true_frequency(built) / bound
    assert least <= ratio <= 1.0 + 1e-12


@pytest.mark.parametrize("ratio", [1e-3, 1.0, 1e3])
def test_the_step_is_safe_for_unequal_neighbours(ratio):
    built = wall(6, 2, "concave", densities=(1500.0, 1500.0 * ratio))
    state = initial_state(built)
    bound = critical_step.greatest_frequency(
        state, critical_step.block_inertia(built), block_stiffness(state, shared=1.0)
    )
    assert 0.75 <= true_frequency(built) / bound <= 1.0 + 1e-12


def damped_rates(built, state, jack, found):
    """Spectral radius, as a function of the time step, of the damped scheme of springs, dashpots and jack."""
    free = state.blocks.free
    joints = state.joints
    M = critical_step.block_inertia(built)[free]
    n = len(free)
    number = {b: i for i, b in enumerate(free)}

    def assembled(times, jack_time):
        K = np.zeros((6 * n, 6 * n))
        for j, k in enumerate(joint_families.stiffness(state)):
            T = np.zeros((6, 6 * n))
            for block, arm, sign in (
                (joints.block_a[j], joints.arm_a[j], -1.0),
                (joints.block_b[j], joints.arm_b[j], 1.0),
            ):
                if block in number:
                    i = 6 * number[block]
                    T[:, i : i + 6] = sign * to_joint(joints.axes[j], arm)
            K += times[j] * T.T @ k @ T
        for i, b in enumerate(free):
            K[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] += jack_time * jack[b]
        return np.concatenate([np.linalg.solve(M[i], K[6 * i : 6 * i + 6]) for i in range(n)])

    def radius(dt):
        K, C = assembled(np.ones(len(joints.block_a)), 1.0), assembled(found.joints, found.actuator)
        one = np.eye(6 * n)
        step = np.block([[2.0 * one - dt * dt * K - dt * C, dt * C - one], [one, 0.0 * one]])
        return float(np.abs(np.linalg.eigvals(step)).max())

    return radius


@pytest.mark.parametrize("formulation", ["concave", "convex"])
@pytest.mark.parametrize(
    "size, densities", [((1, 1), (1.0,)), ((3, 2), (1.0,)), ((4, 2), (1.0, 1e3)), ((3, 1), (1e3, 1.0))]
)
def test_the_damped_step_is_safe_and_not_wasteful(formulation, size, densities):
    """Springs, dashpots of all joints and the jack as a linear scheme: stable at the critical step, not far above."""
    built = wall(*size, formulation, densities=tuple(1500.0 * d for d in densities))
    state = initial_state(built)
    pushed = int(state.blocks.free[0])
    state = state._replace(actuators=state.actuators._replace(block=np.array([pushed])))
    push = np.array([0.0, 1.0, 0.0, 0.05, 0.0, 0.07])
    jack = np.zeros((len(built.names), 6, 6))
    jack[pushed] = 1e8 * np.outer(push, push)
    found = critical_step.dashpots(state, critical_step.block_inertia(built), jack)
    radius = damped_rates(built, state, jack, found)
    assert radius(0.999 * found.critical_time_step) <= 1.0 + 1e-9
    assert radius(1.35 * found.critical_time_step) > 1.0


def test_every_block_is_damped_by_its_own_frequency():
    """The dashpot of a soft joint under a block is set for that joint, not for the stiff one that limits the step."""
    built = wall(2, 1, "convex")
    state = initial_state(built)
    jack = np.zeros((len(built.names), 6, 6))
    state = state._replace(actuators=state.actuators._replace(block=np.array([1])))
    upper = [j for j in range(len(built.joints)) if 0 not in (built.joints[j].block_a, built.joints[j].block_b)]
    equal = critical_step.dashpots(state, critical_step.block_inertia(built), jack)
    state.areas.k_n[upper] *= 1e-4
    state.areas.k_s[upper] *= 1e-4
    softer = critical_step.dashpots(state, critical_step.block_inertia(built), jack)
    np.testing.assert_allclose(softer.joints[upper], 100.0 * equal.joints[upper], rtol=1e-9)
    lower = [j for j in range(len(built.joints)) if j not in upper]
    np.testing.assert_allclose(softer.joints[lower], equal.joints[lower], rtol=1e-9)
    assert softer.critical_time_step > equal.critical_time_step
