"""Rotations of rigid blocks as in both engines: free tops against their closed forms, and guided tops."""

import math

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

from dembrick._jit import jit
from dembrick.geometry.rotations import rotation_matrix
from dembrick.kernels.math.rigid_turns import SLOW, guided_momentum, spin_of_step, turn
from dembrick.kernels.math.vectors import rotate, three_of
from helpers.plain_python import cases

TENSOR = np.array([1.0, 2.0, 3.0])  # kg m2, principal moments
ORIENTATIONS = [(1.0, 0.0, 0.0, 0.0), (0.5, -0.5, 0.5, 0.5), (0.8, 0.0, 0.36, -0.48)]


class Top:
    """A free block: its orientation q (1, 4), angular momentum L (3,), inverse of its inertia (3, 3)."""

    def __init__(self, spin, orientation=ORIENTATIONS[0]):
        self.q = np.array([orientation], float)
        self.L = rotation_matrix(self.q[0]) @ (TENSOR * spin)
        self.inverse = np.diag(1.0 / TENSOR)

    def turn(self, dt: float, n: int) -> None:
        _turns(self.q, self.inverse, self.L, dt, n)

    @property
    def spin(self) -> np.ndarray:
        """I^-1 R^T L (rad/s, body axes)."""
        return self.inverse @ rotation_matrix(self.q[0]).T @ self.L

    @property
    def energy(self) -> float:
        return 0.5 * float(TENSOR @ self.spin**2)


@jit
def _turns(q, inverse, momentum, dt, n):
    for _ in range(n):
        turn(q, 0, inverse, three_of(momentum), dt)


@pytest.mark.parametrize("orientation", ORIENTATIONS)
@pytest.mark.parametrize("spin", [(1.0, 0.2, -0.3), (0.01, 2.0, 0.01), (0.1, -0.2, 3.0)])
def test_euler_top_keeps_its_energy(spin, orientation):
    top = Top(spin, orientation)
    start, errors = top.energy, []
    rounds = cases(50, 10)
    for _ in range(rounds):
        top.turn(0.01, 400)
        errors.append(top.energy / start - 1.0)
    assert np.abs(errors).max() < 2e-4  # it oscillates with dt^2
    assert abs(np.mean(errors[rounds // 2 :]) - np.mean(errors[: rounds // 2])) < 1e-4  # and does not drift
    finer, worst = Top(spin, orientation), 0.0
    for _ in range(rounds):
        finer.turn(0.005, 800)
        worst = max(worst, abs(finer.energy / start - 1.0))
    assert worst < 0.3 * np.abs(errors).max() + 1e-13


def exact_spin(spin, times):
    """Body spin (n, 3) of the free top by Jacobi's elliptic functions, started with spin[0] > 0, spin[1] = 0.

    With 2 E I_2 > L^2 (rotation mainly about axis 1) component 1 is dn, 2 is sn, 3 is cn, and component 3 starts > 0.
    """
    i1, i2, i3 = TENSOR
    L2 = sum((i * w) ** 2 for i, w in zip(TENSOR, spin, strict=True))
    E2 = sum(i * w**2 for i, w in zip(TENSOR, spin, strict=True))
    assert E2 * i2 > L2 and spin[1] == 0.0 and spin[0] > 0.0 and spin[2] > 0.0
    rate = math.sqrt((i2 - i1) * (E2 * i3 - L2) / (i1 * i2 * i3))
    m = (i3 - i2) * (L2 - E2 * i1) / ((i2 - i1) * (E2 * i3 - L2))
    sn, cn, dn, _ = ellipj(rate * times, m)
    amplitude = math.sqrt((L2 - E2 * i1) / (i2 * (i2 - i1)))
    # I_2 dw_2/dt = (I_3 - I_1) w_3 w_1 > 0 at the start
    return np.column_stack([spin[0] * dn, amplitude * sn, spin[2] * cn]), 4.0 * ellipk(m) / rate


def test_free_top_follows_jacobi_functions():
    """The spin over two periods; its error falls with the square of the step."""
    spin = (1.0, 0.0, 0.4)
    _, period = exact_spin(spin, np.zeros(1))
    worst = []
    for n in (2000, 4000):
        top, error = Top(spin, ORIENTATIONS[2]), 0.0
        for k in range(40):
            top.turn(period / n, n // 20)
            expected, _ = exact_spin(spin, np.array([(k + 1) * period / 20]))
            error = max(error, np.abs(top.spin - expected[0]).max())
        worst.append(error)
    assert worst[1] < 1e-5
    assert 3.5 < worst[0] / worst[1] < 4.5


def test_flip_period_of_the_intermediate_axis():
    """A top started near its intermediate axis flips over periodically, with a period known in closed form."""
    small = 1e-3
    # E2 I_2 > L^2 needs the perturbation on axis 1; from spin[1] = 0 it is the same motion a quarter period later
    amplitude_1, amplitude_3 = 1.0, math.sqrt(1.0 * (2.0 - 1.0) / (3.0 * (3.0 - 2.0))) * (1 - small)
    spin = (amplitude_1, 0.0, amplitude_3)
    _, period = exact_spin(spin, np.zeros(1))
    # flips show in the body's spin, not in the world's
    top, n = Top(spin), 20_000
    second = np.empty(3 * 400)
    for k in range(3 * 400):
        top.turn(period / n, n // 400)
        second[k] = top.spin[1]
    crossings = np.flatnonzero(np.diff(np.sign(second)) != 0)
    times = crossings + second[crossings] / (second[crossings] - second[crossings + 1]) + 1.0
    assert len(times) >= 5
    flips = np.diff(times) / 400  # in periods
    np.testing.assert_allclose(flips, 0.5, rtol=5e-5)
    momentum, energy_2 = 1.0 + 9.0 * amplitude_3**2, 1.0 + 3.0 * amplitude_3**2
    assert np.abs(second).max() == pytest.approx(math.sqrt((momentum - energy_2) / 2.0), rel=1e-4)


def test_quaternion_stays_of_unit_length():
    top = Top((1.0, 2.0, 0.5), ORIENTATIONS[1])
    start = top.energy
    top.turn(0.003, cases(1_000_000, 20_000))
    assert np.linalg.norm(top.q[0]) == pytest.approx(1.0, abs=1e-14)
    assert top.energy == pytest.approx(start, rel=1e-4)


@pytest.mark.parametrize("spin", [(1e-5, 2e-5, -5e-6), (1e-3, 2e-3, -5e-4), (1.0, 2.0, 0.5)])
def test_spin_is_that_of_the_middle_of_the_step(spin):
    """w = R_m I^-1 R_m^T L with R_m half of the step's rotation on: to rounding, or to SLOW^2 / 4."""
    top, dt = Top(spin, ORIENTATIONS[2]), 0.05
    before = rotation_matrix(top.q[0])
    body = np.array(spin_of_step(top.q, 0, top.inverse, tuple(top.L), dt))
    half = rotation_vector_matrix(0.5 * dt * body)
    left = dt * np.abs(body - top.inverse @ half.T @ before.T @ top.L).max()
    angle = dt * float(np.linalg.norm(body))
    assert left < (2e-15 if angle > SLOW else 0.25 * SLOW**2 * angle)
    found, angle2 = turn(top.q, 0, top.inverse, tuple(top.L), dt)
    np.testing.assert_allclose(found, before @ body, rtol=1e-12)
    assert angle2 == pytest.approx(dt * dt * (body @ body), rel=1e-14)
    np.testing.assert_allclose(rotation_matrix(top.q[0]), before @ half @ half, rtol=0.0, atol=1e-15)


def rotation_vector_matrix(r) -> np.ndarray:
    """exp(r) by Rodrigues' formula."""
    angle = np.linalg.norm(r)
    k = np.cross(np.eye(3), r / angle)
    return np.eye(3) + np.sin(angle) * k + (1.0 - np.cos(angle)) * k @ k


@pytest.mark.parametrize("held", [(True, False, False), (False, True, True), (True, True, True)])
@pytest.mark.parametrize("spin", [(1e-3, 2e-3, -5e-4), (1.0, 2.0, 0.5)])
def test_a_guided_top_turns_about_its_free_axes_only(spin, held):
    """The guide changes the momentum about the axes that it holds, and about no other."""
    top, dt, free = Top(spin, ORIENTATIONS[2]), 0.005, ~np.array(held)
    change = np.array(guided_momentum(top.q, 0, top.inverse, np.array(held), tuple(top.L), dt))
    assert (change[free] == 0.0).all() and (change[~free] != 0.0).all()
    body = spin_of_step(top.q, 0, top.inverse, tuple(top.L + change), dt)
    world = np.array(rotate(top.q, 0, *body))
    assert np.abs(world[~free]).max() <= 1e-14 * np.linalg.norm(spin)
    assert free.any() == (np.abs(world).max() > 0.1 * np.linalg.norm(spin))
    assert guided_momentum(top.q, 0, top.inverse, np.zeros(3, bool), tuple(top.L), dt) == (0.0, 0.0, 0.0)


def test_turn_as_plain_python():
    compiled, plain = Top((1.0, 2.0, 0.5), ORIENTATIONS[2]), Top((1.0, 2.0, 0.5), ORIENTATIONS[2])
    for _ in range(50):
        turn(compiled.q, 0, compiled.inverse, tuple(compiled.L), 0.02)
        getattr(turn, "py_func", turn)(plain.q, 0, plain.inverse, tuple(plain.L), 0.02)
    np.testing.assert_allclose(compiled.q, plain.q, rtol=0, atol=1e-14)
