"""Closed-form motions against their published or recomputed values."""

import math

import pytest

from dembrick.errors import ScenarioError
from dembrick.theory import formulation_law
from helpers import motions as motion


def test_slope_sticks_and_slides():
    angle, friction = math.radians(40), math.tan(math.radians(20))
    assert motion.slope_acceleration(angle, friction, 10.0) == pytest.approx(3.63970, abs=5.1e-6)
    assert motion.slope_acceleration(math.radians(19.9), friction) == 0.0
    assert motion.slope_acceleration(math.radians(20.1), friction) > 0.0


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
    distance = 1.0 / (2.0 * 0.64 * motion.GRAVITY)
    assert (x, y, theta) == pytest.approx((0.6 * distance, 0.8 * distance, 0.0), abs=1e-8)
    *_, theta = motion.slide_to_rest(law, 1.0, 0.13 / 12.0, (0.0, 0.0), 10.0, tolerance=1e-9)
    slowing = 12.0 * 0.64 * motion.GRAVITY * 0.09681061 / (0.3**2 + 0.2**2)  # from the torque mu N c_T
    assert theta == pytest.approx(10.0**2 / (2.0 * slowing), rel=1e-7)
    assert motion.slide_to_rest(law, 1.0, 1.0, (0.0, 0.0), 0.0) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(("ratio", "period", "linear"), [(0.3, 0.94481, 0.94308), (0.5, 1.38837, 1.38679)])
def test_rocking_period(ratio, period, linear):
    assert motion.rocking_period(0.2, 1.0, ratio) == pytest.approx(period, abs=5.1e-6)
    p = motion.rocking_frequency(0.2, 1.0)
    assert 4.0 / p * math.acosh(1.0 / (1.0 - ratio)) == pytest.approx(linear, abs=5.1e-6)


def test_rocking_needs_an_angle_it_can_return_from():
    with pytest.raises(ScenarioError, match="ratio"):
        motion.rocking_period(0.2, 1.0, 1.0)


def test_restitution():
    assert motion.housner_restitution(0.2, 1.0) == pytest.approx(0.94231, abs=5.1e-6)


@pytest.mark.parametrize(("height", "angles"), [(1.0, (11.539, 11.667, 12.015)), (3.0, (4.041, 4.173, 4.560))])
def test_toppling_while_tilted(height, angles):
    lever = math.hypot(0.1, height - 0.05)  # centroid of a top course 0.1 m high
    for displacement, angle in zip((0.0005, 0.002, 0.02), angles, strict=True):
        found = motion.toppling_tilt(0.2, height, math.radians(1.0), lever, displacement)
        assert math.degrees(found) == pytest.approx(angle, abs=5.1e-4)
