"""A step of finite motion, and the critical time step of a block on springs."""

import math

import numpy as np
import pytest

from dembrick.assembly import build
from dembrick.geometry.rotations import rotation_matrix
from dembrick.kernels.state import Inertia
from dembrick.kernels.statics.finite_rotation import finite_step
from dembrick.scenario.model import Block, JointLaw, Material, Scenario, YieldControl
from dembrick.simulation.statics import critical_step, joint_families
from dembrick.simulation.statics.state import blocks_at_rest, initial_state
from dembrick.simulation.statics.stiffness import block_stiffness, to_joint
from helpers.stone_scenes import law, of_stone


def test_free_fall_and_steady_torque():
    """Central differences are exact for a centroid under a constant force and a sphere under a constant torque."""
    at_rest = np.zeros(1, np.int64), np.array([[1.0, 0.0, 0.0, 0.0]]), np.zeros((1, 3)), np.zeros((1, 3))
    blocks, inertia = blocks_at_rest(*at_rest), Inertia(np.array([2.0]), np.diag([2.0, 2.0, 2.0])[None])
    blocks.force[0] = 2.0 * np.array([1.0, -2.0, -9.81])
    blocks.torque[0] = 0.5 * np.array([0.0, 0.0, 0.3])
    dt, n = 1e-3, 1000
    for k in range(n):
        move = finite_step(blocks, inertia, dt)
        assert move == pytest.approx(9.81 * (k + 1) * dt * dt, rel=1e-9)
    after = n * (n + 1) / 2 * dt * dt
    np.testing.assert_allclose(blocks.displacement[0], after * np.array([1.0, -2.0, -9.81]), rtol=1e-12)
    angle = 2 * math.atan2(blocks.orientation[0, 3], blocks.orientation[0, 0])
    assert angle == pytest.approx(0.3 * after, rel=1e-10)
    np.testing.assert_allclose(blocks.momentum[0], [0.0, 0.0, 0.15], atol=1e-14)


# --- the critical time step

CRITICAL = [  # formulation, ks/kn, dt_cr (s) of a block of 47.604 kg on 0.3 x 0.2 m, kn = 10 GPa/m
    ("concave", 1.0, 3.118e-4),
    ("concave", 0.4, 3.343e-4),
    ("convex", 1.0, 3.983e-4),
    ("convex", 0.4, 5.218e-4),
]


def one_block(formulation, ratio, turn_by=(1.0, 0.0, 0.0, 0.0)):
    R = rotation_matrix(np.array(turn_by))
    block = {"material": "stone", "box": (0.3, 0.2, 0.1), "orientation": turn_by}
    return build.assemble(
        Scenario(
            title="one block on a fixed one",
            gravity=tuple(R @ [0.0, 0.0, -9.81]),
            joint=JointLaw(formulation, 0.64, 1e10, ratio * 1e10),
            materials={"stone": Material(47.604 / 0.006)},
            blocks=(
                Block("lower", position=tuple(R @ [0.0, 0.0, -0.05]), fixed=True, **block),
                Block("upper", position=tuple(R @ [0.0, 0.0, 0.05]), **block),
            ),
            control=YieldControl(),
        )
    )


@pytest.mark.parametrize("turn_by", [(1.0, 0.0, 0.0, 0.0), (0.8, 0.0, 0.36, -0.48)])
@pytest.mark.parametrize("formulation, ratio, expected", CRITICAL)
def test_critical_step_of_one_block(formulation, ratio, expected, turn_by):
    built = one_block(formulation, ratio, turn_by)
    state = initial_state(built)
    frequency = critical_step.greatest_frequency(
        state, critical_step.block_inertia(built), block_stiffness(state, shared=1.0)
    )
    assert critical_step.critical_time_step(frequency, 0.0) == pytest.approx(expected, rel=2e-4)
    # a dashpot in parallel shortens it: w^2 dt^2 (1 + 2 beta) = 4
    damped = critical_step.critical_time_step(frequency, 0.5)
    assert damped == pytest.approx(critical_step.critical_time_step(frequency, 0.0) / math.sqrt(2.0), rel=1e-12)


@pytest.mark.parametrize("viscous", [0.0, 0.5, 1.0])
def test_critical_step_is_where_central_differences_turn_unstable(viscous):
    """A spring with a dashpot that acts on the last increment: bounded just below the critical step, not above it."""
    frequency = 300.0
    for factor, bounded in ((0.999, True), (1.001, False)):
        dt = factor * critical_step.critical_time_step(frequency, viscous)
        x, v, last = 1.0, 0.0, 0.0
        for _ in range(20_000):
            v -= frequency**2 * dt * (x + viscous * last)
            last = dt * v
            x += last
            if abs(x) > 1e6:
                break
        assert (abs(x) < 1e3) == bounded


def test_bound_of_a_stack_against_its_true_frequency():
    """Three stacked blocks: the bound from single blocks is not below the assembly's highest frequency."""
    block = {"material": "stone", "box": (0.3, 0.2, 0.1)}
    built = build.assemble(
        of_stone(
            law(),
            YieldControl(),
            (Block(f"b{i}", position=(0.0, 0.0, 0.1 * i), fixed=i == 0, **block) for i in range(4)),
        )
    )
    state = initial_state(built)
    n = len(built.names)
    K = np.zeros((6 * n, 6 * n))
    for j, k in enumerate(joint_families.stiffness(state)):
        a, b = state.joints.block_a[j], state.joints.block_b[j]
        T = np.zeros((6, 6 * n))
        T[:, 6 * b : 6 * b + 6] = to_joint(state.joints.axes[j], state.joints.arm_b[j])
        T[:, 6 * a : 6 * a + 6] = -to_joint(state.joints.axes[j], state.joints.arm_a[j])
        K += T.T @ k @ T
    inertia = critical_step.block_inertia(built)
    M = np.zeros_like(K)
    for i in range(n):
        M[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] = inertia[i]
    true = math.sqrt(np.linalg.eigvals(np.linalg.solve(M[6:, 6:], K[6:, 6:])).real.max())
    bound = critical_step.greatest_frequency(state, inertia, block_stiffness(state, shared=1.0))
    assert true * (1 - 1e-12) <= bound <= 1.02 * true
