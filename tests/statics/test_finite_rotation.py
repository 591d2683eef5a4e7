"""Motion of free blocks in space, and the critical time step of a block on springs."""

import math

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

from dembrick._jit import jit
from dembrick.assembly import build
from dembrick.geometry.rotations import rotation_matrix
from dembrick.kernels.state import Blocks, Inertia
from dembrick.kernels.statics.finite_rotation import finite_step, turn
from dembrick.scenario.model import Block, JointLaw, Material, Scenario, YieldControl
from dembrick.simulation.statics import critical_step, joint_families
from dembrick.simulation.statics.state import initial_state
from dembrick.simulation.statics.stiffness import block_stiffness, to_joint


def free_block(tensor, spin, orientation=(1.0, 0.0, 0.0, 0.0), mass=2.0):
    """One block in space with principal moments ``tensor``, turning at ``spin`` (rad/s, body axes)."""
    rotation = rotation_matrix(np.asarray(orientation, float))
    blocks = Blocks(**{name: np.zeros((1, 3)) for name in Blocks._fields})._replace(
        free=np.zeros(1, np.int64),
        guided=np.zeros(0, np.int64),
        held=np.zeros((0, 6), bool),
        orientation=np.array([orientation], float),
        momentum=(rotation @ (np.array(tensor) * spin))[None].copy(),
    )
    return blocks, Inertia(np.array([mass]), np.diag(tensor)[None].astype(float), np.diag(1 / np.array(tensor))[None])


@jit
def turns(blocks, inertia, dt, n):
    """Turn block 0 n times."""
    for _ in range(n):
        turn(blocks, inertia, 0, dt)


def body_spin(blocks, inertia):
    """I^-1 R^T L (rad/s, body axes)."""
    return inertia.inverse[0] @ rotation_matrix(blocks.orientation[0]).T @ blocks.momentum[0]


def energy(blocks, inertia):
    spin = body_spin(blocks, inertia)
    return 0.5 * spin @ inertia.tensor[0] @ spin


TENSOR = (1.0, 2.0, 3.0)
ORIENTATIONS = [(1.0, 0.0, 0.0, 0.0), (0.5, -0.5, 0.5, 0.5), (0.8, 0.0, 0.36, -0.48)]


@pytest.mark.parametrize("orientation", ORIENTATIONS)
@pytest.mark.parametrize("spin", [(1.0, 0.2, -0.3), (0.01, 2.0, 0.01), (0.1, -0.2, 3.0)])
def test_euler_top_keeps_energy_and_momentum(spin, orientation):
    blocks, inertia = free_block(TENSOR, spin, orientation)
    momentum, start = blocks.momentum.copy(), energy(blocks, inertia)
    errors = []
    for _ in range(50):
        turns(blocks, inertia, 0.01, 400)
        errors.append(energy(blocks, inertia) / start - 1.0)
    np.testing.assert_array_equal(blocks.momentum, momentum)
    assert np.abs(errors).max() < 2e-4  # it swings with dt^2
    assert abs(np.mean(errors[25:]) - np.mean(errors[:25])) < 1e-4  # and does not drift
    finer, _ = free_block(TENSOR, spin, orientation)
    worst = 0.0
    for _ in range(50):
        turns(finer, inertia, 0.005, 800)
        worst = max(worst, abs(energy(finer, inertia) / start - 1.0))
    assert worst < 0.3 * np.abs(errors).max() + 1e-13


def exact_spin(tensor, spin, times):
    """Body spin (n, 3) of the free top by Jacobi's functions; tensor ascending, started with spin[0] > 0, spin[1] = 0.

    With 2 E I_2 > L^2 (it turns mainly about axis 1) component 1 is dn, 2 is sn, 3 is cn, and component 3 starts > 0.
    """
    i1, i2, i3 = tensor
    L2 = sum((i * w) ** 2 for i, w in zip(tensor, spin, strict=True))
    E2 = sum(i * w**2 for i, w in zip(tensor, spin, strict=True))
    assert E2 * i2 > L2 and spin[1] == 0.0 and spin[0] > 0.0 and spin[2] > 0.0
    rate = math.sqrt((i2 - i1) * (E2 * i3 - L2) / (i1 * i2 * i3))
    m = (i3 - i2) * (L2 - E2 * i1) / ((i2 - i1) * (E2 * i3 - L2))
    sn, cn, dn, _ = ellipj(rate * times, m)
    amplitude = math.sqrt((L2 - E2 * i1) / (i2 * (i2 - i1)))
    # I_2 dw_2/dt = (I_3 - I_1) w_3 w_1 > 0 at the start
    return np.column_stack([spin[0] * dn, amplitude * sn, spin[2] * cn]), 4.0 * ellipk(m) / rate


def test_free_top_follows_jacobi_functions():
    """Spin over two periods, error falling with the square of the step."""
    spin = (1.0, 0.0, 0.4)
    blocks, inertia = free_block(TENSOR, spin)
    _, period = exact_spin(TENSOR, spin, np.zeros(1))
    worst = []
    for n in (2000, 4000):
        blocks, inertia = free_block(TENSOR, spin, ORIENTATIONS[2])
        error = 0.0
        for k in range(40):
            turns(blocks, inertia, period / n, n // 20)
            expected, _ = exact_spin(TENSOR, spin, np.array([(k + 1) * period / 20]))
            error = max(error, np.abs(body_spin(blocks, inertia) - expected[0]).max())
        worst.append(error)
    assert worst[1] < 1e-5
    assert 3.5 < worst[0] / worst[1] < 4.5


def test_flip_period_of_the_intermediate_axis():
    """A top started near its intermediate axis flips over again and again, at a period known in closed form."""
    small = 1e-3
    # E2 I_2 > L^2 needs the seed on axis 1; from spin[1] = 0 the same motion a quarter period later
    amplitude_1, amplitude_3 = 1.0, math.sqrt(1.0 * (2.0 - 1.0) / (3.0 * (3.0 - 2.0))) * (1 - small)
    spin = (amplitude_1, 0.0, amplitude_3)
    _, period = exact_spin(TENSOR, spin, np.zeros(1))
    n = 20_000
    # the world's spin says nothing of flips, they are seen in the body
    blocks, inertia = free_block(TENSOR, spin)
    second = np.empty(3 * 400)
    for k in range(3 * 400):
        turns(blocks, inertia, period / n, n // 400)
        second[k] = body_spin(blocks, inertia)[1]
    crossings = np.flatnonzero(np.diff(np.sign(second)) != 0)
    times = crossings + second[crossings] / (second[crossings] - second[crossings + 1]) + 1.0
    assert len(times) >= 5
    flips = np.diff(times) / 400  # in periods
    np.testing.assert_allclose(flips, 0.5, rtol=5e-5)
    momentum, energy_2 = 1.0 + 9.0 * amplitude_3**2, 1.0 + 3.0 * amplitude_3**2
    assert np.abs(second).max() == pytest.approx(math.sqrt((momentum - energy_2) / 2.0), rel=1e-4)


def test_quaternion_stays_of_unit_length():
    blocks, inertia = free_block(TENSOR, (1.0, 2.0, 0.5), ORIENTATIONS[1])
    turns(blocks, inertia, 0.003, 1_000_000)
    assert np.linalg.norm(blocks.orientation[0]) == pytest.approx(1.0, abs=1e-14)
    start, _ = free_block(TENSOR, (1.0, 2.0, 0.5), ORIENTATIONS[1])
    assert energy(blocks, inertia) == pytest.approx(energy(start, inertia), rel=1e-4)


def test_turn_as_plain_python():
    compiled, inertia = free_block(TENSOR, (1.0, 2.0, 0.5), ORIENTATIONS[2])
    plain, _ = free_block(TENSOR, (1.0, 2.0, 0.5), ORIENTATIONS[2])
    for _ in range(50):
        turn(compiled, inertia, 0, 0.02)
        getattr(turn, "py_func", turn)(plain, inertia, 0, 0.02)
    np.testing.assert_allclose(compiled.orientation, plain.orientation, rtol=0, atol=1e-14)
    np.testing.assert_allclose(compiled.spin, plain.spin, rtol=0, atol=1e-13)


def test_free_fall_and_steady_torque():
    """Centroid: central differences are exact for a constant force; a sphere under a constant torque about an axis."""
    blocks, inertia = free_block((0.5, 0.5, 0.5), (0.0, 0.0, 0.0))
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
    """One spring with a dashpot that acts on the last increment: bounded just below the critical step, not above."""
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
    """Three blocks on each other: the bound from the blocks alone is not below the assembly's greatest frequency."""
    block = {"material": "stone", "box": (0.3, 0.2, 0.1)}
    built = build.assemble(
        Scenario(
            title="stack",
            gravity=(0.0, 0.0, -9.81),
            joint=JointLaw("concave", 0.64, 1e10, 4e9),
            materials={"stone": Material(2000.0)},
            blocks=tuple(Block(f"b{i}", position=(0.0, 0.0, 0.1 * i), fixed=i == 0, **block) for i in range(4)),
            control=YieldControl(),
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
