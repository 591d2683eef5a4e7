"""Motions of rigid blocks on Coulomb joints that have a closed form or an ordinary integral, to compare runs with.

SI units, angles in radians. ``gravity`` is its magnitude, ``friction`` the coefficient.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from dembrick.errors import ScenarioError
from dembrick.theory.limit_surface import Law

GRAVITY = 9.81
SMOOTHING = 3e-4  # of the speed of a block: the friction of slower points is smoothed, as if they began to stick


def _rk4(rate: Callable[[np.ndarray], np.ndarray], state: np.ndarray, step: float) -> np.ndarray:
    k_1 = rate(state)
    k_2 = rate(state + 0.5 * step * k_1)
    k_3 = rate(state + 0.5 * step * k_2)
    k_4 = rate(state + step * k_3)
    return state + step / 6.0 * (k_1 + 2.0 * k_2 + 2.0 * k_3 + k_4)


def slope_acceleration(angle: float, friction: float, gravity: float = GRAVITY) -> float:
    """Acceleration down a plane inclined by ``angle``: 0 while tan(angle) < friction."""
    return max(0.0, gravity * (math.sin(angle) - friction * math.cos(angle)))


def slide_to_rest(
    law: Law,
    mass: float,
    inertia: float,
    velocity: tuple[float, float],
    spin: float,
    *,
    tolerance: float = 1e-6,
) -> tuple[float, float, float]:
    """(x, y, theta) where a block stops that starts at 0 sliding and spinning flat, with its pressure unchanged.

    ``law`` is in the block's axes about its centroid, ``inertia`` about the vertical. Friction depends only on the
    direction of the twist, so the motion is integrated over ds = dt / |twist|, in which it decays exponentially; the
    step of the RK4 pairs follows ``tolerance``, relative to the start and per step. A block on points may turn for a
    while about one that sticks: there the friction of points slower than `SMOOTHING` |twist| is rounded off, which
    shifts the final position by about that fraction of the distance slid meanwhile.
    """
    R = law.radius
    rate_scale = law.strength / mass

    def rate(state: np.ndarray) -> np.ndarray:
        theta, v_x, v_y, w = state[2:]
        cos, sin = math.cos(theta), math.sin(theta)
        size = math.sqrt(v_x * v_x + v_y * v_y + (R * w) ** 2)
        slip = np.array([[cos * v_x + sin * v_y, cos * v_y - sin * v_x, w]])
        f_1, f_2, m = law.derivatives(slip, SMOOTHING * size)[1][0].tolist()
        force = np.array([cos * f_1 - sin * f_2, sin * f_1 + cos * f_2])
        return size / rate_scale * np.array([v_x, v_y, w, -force[0] / mass, -force[1] / mass, -m / inertia])

    state = np.array([0.0, 0.0, 0.0, velocity[0], velocity[1], spin])
    scale = np.array([1.0, 1.0, R])
    first = float(np.linalg.norm(state[3:] * scale))
    if first == 0.0:
        return 0.0, 0.0, 0.0
    if not rate_scale > 0.0:
        raise ScenarioError("the block does not come to rest: friction and normal force must be greater than 0")
    weight = np.concatenate([[1.0, 1.0, R] / np.array(R), scale / first])
    step = 0.05
    # the remaining distance is of the order of |twist|^2
    while np.linalg.norm(state[3:] * scale) > 1e-6 * first:
        whole = _rk4(rate, state, step)
        halves = _rk4(rate, _rk4(rate, state, step / 2.0), step / 2.0)
        error = float(np.abs((halves - whole) * weight).max()) / 15.0
        if error <= tolerance or step < 1e-6:
            state = halves + (halves - whole) / 15.0
        step *= min(2.0, max(0.2, 0.9 * (tolerance / max(error, 1e-30)) ** 0.2))
    x, y, theta = state[:3].tolist()
    return x, y, theta


def rocking_frequency(thickness: float, height: float) -> float:
    """p = sqrt(3 g / 4 R) of a rectangular block, R its half diagonal."""
    return math.sqrt(0.75 * GRAVITY / (0.5 * math.hypot(thickness, height)))


def rocking_period(thickness: float, height: float, ratio: float) -> float:
    """Undamped nonlinear period of a rocking block: four times from release at ratio * alpha to the first impact.

    Energy gives theta'^2 = 2 p^2 (cos(alpha - theta) - cos(alpha - theta_0)); with theta = theta_0 (1 - u^2) the
    integrand is smooth and Gauss quadrature exact to rounding.
    """
    alpha = math.atan2(thickness, height)
    theta_0 = ratio * alpha
    if not 0.0 < ratio < 1.0:
        raise ScenarioError(f"ratio = {ratio!r} is out of range: a block rocks back from between 0 and 1 times alpha")
    u, weight = np.polynomial.legendre.leggauss(60)
    u, weight = (u + 1.0) / 2.0, weight / 2.0
    half = theta_0 * u * u / 2.0  # cos(alpha - theta) - cos(alpha - theta_0) as a product, without cancellation
    gain = 2.0 * np.sin(alpha - theta_0 + half) * np.sin(half)
    p = rocking_frequency(thickness, height)
    return float(4.0 * np.sum(weight * 2.0 * theta_0 * u / np.sqrt(2.0 * gain)) / p)


def housner_restitution(thickness: float, height: float) -> float:
    """w+/w- = 1 - 1.5 sin^2 alpha at the impact of a slender rocking block."""
    return 1.0 - 1.5 * math.sin(math.atan2(thickness, height)) ** 2


def toppling_tilt(thickness: float, height: float, rate: float, lever: float, displacement: float) -> float:
    """Tilt at which a rigid wall, tilted at ``rate`` (rad/s), has displaced a point at ``lever`` from its toe.

    For rotation about the toe, theta'' = (3 g / 4 R) sin(psi + theta - alpha), from rest at psi = alpha. The
    ``displacement`` is the arc lever * theta.
    """
    alpha, p_2 = math.atan2(thickness, height), rocking_frequency(thickness, height) ** 2
    goal = displacement / lever

    def motion(state: np.ndarray) -> np.ndarray:
        theta, speed, psi = state
        return np.array([speed, p_2 * math.sin(psi + theta), rate])

    step = 0.002 / math.sqrt(p_2)
    state = np.zeros(3)  # theta, theta', psi - alpha
    before = state
    while state[0] < goal:
        before, state = state, _rk4(motion, state, step)
    low, high = 0.0, step
    for _ in range(50):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _rk4(motion, before, middle)[0] < goal else (low, middle)
    return alpha + before[2] + rate * high
