"""Two flat blocks on one another on a shaken floor, against a time integration of rigid blocks without springs."""

import math

import numpy as np
import pytest

from dembrick.runs.simulate import simulate
from dembrick.scenario.controls import BaseMotionControl, Sine
from dembrick.scenario.model import Block, JointLaw, JointOverride, Output
from helpers.stone_scenes import of_stone

G = 9.81
LOWER, UPPER = (0.8, 0.6, 0.02), (0.35, 0.4, 0.02)  # m: so flat that nothing rocks


def rigid_blocks(amplitude, frequency, friction, duration):
    """Positions of both blocks on the floor after ``duration``: every joint resists slip by up to mu N."""
    lower, upper = 2000.0 * math.prod(LOWER), 2000.0 * math.prod(UPPER)
    most = friction[0] * (lower + upper) * G, friction[1] * upper * G
    dt = duration / 20_000
    u1 = u2 = v1 = v2 = 0.0
    for i in range(20_000):
        shaken = -amplitude * math.sin(2.0 * math.pi * frequency * (i + 0.5) * dt)
        # the forces that stop each slip within the step, iterated until they agree
        below = above = 0.0
        for _ in range(100):
            rate1, rate2 = v1 / dt + shaken, v2 / dt + shaken
            reduced = lower * upper / (lower + upper)
            new_above = at_most(reduced * (rate1 - rate2 + below / lower), most[1])
            new_below = at_most(-lower * rate1 + new_above, most[0])
            change = abs(new_above - above) + abs(new_below - below)
            below, above = new_below, new_above
            if change < 1e-10 * most[0]:
                break
        v1 += dt * (shaken + (below - above) / lower)
        v2 += dt * (shaken + above / upper)
        u1, u2 = u1 + dt * v1, u2 + dt * v2
    return u1, u2


def at_most(force, most):
    return max(-most, min(most, force))


@pytest.mark.parametrize(
    "formulation, friction, amplitude, frequency, duration",
    [
        ("convex", (0.52, 0.48), 6.8, 1.8, 0.86),  # both slide
        ("concave", (0.22, 0.15), 6.6, 1.5, 0.55),
        ("corrected-shear", (0.39, 0.31), 8.2, 1.6, 1.07),
        ("distributed", (0.21, 0.58), 6.1, 3.1, 0.56),  # as one
    ],
)
def test_two_blocks_on_a_shaken_floor(formulation, friction, amplitude, frequency, duration):
    points = (3, 3) if formulation == "distributed" else None
    below, above = (JointLaw(formulation, mu, 5e10, 2e10, points) for mu in friction)
    heading = math.radians(37.0)
    along = np.array([math.cos(heading), math.sin(heading), 0.0])
    scene = of_stone(
        below,
        BaseMotionControl(duration, tuple(along), sine=Sine(amplitude, frequency)),
        (
            Block("floor", "stone", (4.0, 4.0, 0.2), (0.0, 0.0, -0.1), fixed=True),
            Block("lower", "stone", LOWER, (0.0, 0.0, 0.01)),
            Block("upper", "stone", UPPER, (0.0, 0.0, 0.03)),
        ),
        joints=(JointOverride(("lower", "upper"), above),),
        output=Output(rows=50, frames=5),
    )
    frames = simulate(scene, None).frames
    came = frames["displacement"][-1] - frames["displacement"][0]
    expected = rigid_blocks(amplitude, frequency, friction, float(frames["time"][-1]))
    scale = max(abs(u) for u in expected)
    np.testing.assert_allclose(came[1:] @ along, expected, rtol=0.0, atol=5e-4 * scale)
    assert np.abs(came @ np.array([-along[1], along[0], 0.0])).max() < 1e-7 * scale
