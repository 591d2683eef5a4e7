"""Closed-form motions against their published or recomputed values, and against plain time stepping."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dembrick.errors import ScenarioError
from dembrick.theory import formulation_law
from helpers import motions as motion


def test_slope_sticks_and_slides():
    angle, friction = math.radians(40), math.tan(math.radians(20))
    assert motion.slope_acceleration(angle, friction, 10.0) == pytest.approx(3.63970, abs=5.1e-6)
    assert motion.slope_acceleration(math.radians(19.9), friction) == 0.0
    assert motion.slope_acceleration(math.radians(20.1), friction) > 0.0


def test_pulse_and_stop():
    assert motion.pulse_slip(0.5 * 9.81, 0.2, 0.2) == pytest.approx(0.14715, rel=1e-12)
    assert motion.pulse_slip(0.1 * 9.81, 0.2, 0.2) == 0.0
    assert motion.pulse_slip(1.0, 0.2, 0.0) == math.inf
    assert motion.stopping(1.0, 0.64) == pytest.approx((0.07964, 0.15928), abs=5.1e-6)
    assert motion.stopping(1.0, 0.0) == (math.inf, math.inf)


def test_harmonic_push():
    x = motion.harmonic_push([2.0, 5.0, 8.0], 1.0, 0.8, 8.0, start=3.0)
    np.testing.assert_allclose(x, [3.004349, 2.991303, 3.004349], atol=5.1e-7)
    # mirrored push, mirrored motion; too weak a push, none
    mirrored = motion.harmonic_push([2.0, 5.0, 8.0], 1.0, 0.8, -8.0, start=-3.0)
    np.testing.assert_allclose(mirrored, -x, rtol=1e-14)
    np.testing.assert_array_equal(motion.harmonic_push([0.0, 9.0], 1.0, 0.8, 7.8, start=3.0), [3.0, 3.0])


def test_harmonic_push_against_time_stepping():
    # a stiff smooth friction of the same size, stepped
    mass, friction, amplitude, omega = 2.0, 0.3, 20.0, 3.0

    def rate(t, y):
        return [y[1], (amplitude * math.cos(omega * t)) / mass - friction * 9.81 * math.tanh(y[1] / 1e-5)]

    times = np.linspace(0.1, 3.0, 12)
    stepped = solve_ivp(rate, (0, 3.0), (0.0, 0.0), t_eval=times, method="Radau", rtol=1e-8, atol=1e-10).y[0]
    np.testing.assert_allclose(motion.harmonic_push(times, mass, friction, amplitude, omega), stepped, atol=2e-5)


@pytest.mark.parametrize(("arm", "rate", "angle"), [(0.09681061, 56.106, 0.8912), (0.1802776, 104.479, 0.4786)])
def test_spin_down(arm, rate, angle):
    assert motion.spin_down(0.3, 0.2, 0.64, arm, 10.0) == pytest.approx((rate, angle), rel=1e-4)


@pytest.mark.parametrize(
    ("name", "spin", "rest", "digits"),
    [
        ("convex", 5.0, (-0.00126, 0.09238, 0.58576), (5.1e-6, 5.1e-6, 5.1e-6)),
        ("concave", 5.0, (0.00023, 0.0923, 0.3441), (5.1e-6, 5.1e-5, 5.1e-5)),
        ("corrected", 5.0, (0.00018, 0.0926, 0.6452), (5.1e-6, 5.1e-5, 5.1e-5)),
        ("convex", 10.0, (-0.00500, 0.12630, 1.28769), (5.1e-6, 5.1e-6, 5.1e-6)),
        ("concave", 10.0, (0.0, 0.12556, 0.7517), (5.1e-5, 5.1e-6, 5.1e-5)),
        ("corrected", 10.0, (-0.01278, 0.13012, 1.3879), (5.1e-6, 5.1e-6, 5.1e-5)),
    ],
)
def test_sliding_and_spinning_to_rest(name, spin, rest, digits):
    law = formulation_law(name, 0.3, 0.2, 0.64, 9.81)
    found = motion.slide_to_rest(law, 1.0, 0.13 / 12.0, (0.0, 1.0), spin)
    for value, expected, bound in zip(found, rest, digits, strict=True):
        assert value == pytest.approx(expected, abs=bound)


def test_pure_slide_and_pure_spin_are_the_elementary_ones():
    law = formulation_law("convex", 0.3, 0.2, 0.64, 9.81)
    x, y, theta = motion.slide_to_rest(law, 1.0, 0.13 / 12.0, (0.6, 0.8), 0.0, tolerance=1e-9)
    distance, _ = motion.stopping(1.0, 0.64)
    assert (x, y, theta) == pytest.approx((0.6 * distance, 0.8 * distance, 0.0), abs=1e-8)
    *_, theta = motion.slide_to_rest(law, 1.0, 0.13 / 12.0, (0.0, 0.0), 10.0, tolerance=1e-9)
    assert theta == pytest.approx(motion.spin_down(0.3, 0.2, 0.64, 0.09681061, 10.0)[1], rel=1e-7)
    assert motion.slide_to_rest(law, 1.0, 1.0, (0.0, 0.0), 0.0) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(("ratio", "period", "linear"), [(0.3, 0.94481, 0.94308), (0.5, 1.38837, 1.38679)])
def test_rocking_period(ratio, period, linear):
    assert motion.rocking_period(0.2, 1.0, ratio) == pytest.approx(period, abs=5.1e-6)
    p = motion.rocking_frequency(0.2, 1.0)
    assert 4.0 / p * math.acosh(1.0 / (1.0 - ratio)) == pytest.approx(linear, abs=5.1e-6)


def test_rocking_needs_an_angle_it_can_return_from():
    with pytest.raises(ScenarioError, match="ratio"):
        motion.rocking_period(0.2, 1.0, 1.0)


def test_restitution_and_tilt():
    assert motion.housner_restitution(0.2, 1.0) == pytest.approx(0.94231, abs=5.1e-6)
    angle, mode = motion.wall_tilt_limit(0.2, 1.0, 0.6)
    assert (math.degrees(angle), mode) == (pytest.approx(11.310, abs=5.1e-4), "overturning")
    assert motion.wall_tilt_limit(0.2, 1.0, 0.1) == (math.atan(0.1), "sliding")


@pytest.mark.parametrize(("height", "angles"), [(1.0, (11.539, 11.667, 12.015)), (3.0, (4.041, 4.173, 4.560))])
def test_toppling_while_tilted(height, angles):
    lever = math.hypot(0.1, height - 0.05)  # centroid of a top course 0.1 m high
    for displacement, angle in zip((0.0005, 0.002, 0.02), angles, strict=True):
        found = motion.toppling_tilt(0.2, height, math.radians(1.0), lever, displacement)
        assert math.degrees(found) == pytest.approx(angle, abs=5.1e-4)
