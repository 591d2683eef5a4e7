"""Whether a base pulse overturns a lone rigid block that rocks on its edge without sliding.

During the pulse a and after it, the block rotates about its toe by theta'' = -p^2 (sin(alpha - theta) - a/g cos(alpha -
theta)), with p^2 = 3 g / (4 R) (Housner 1963, for a rectangle). It overturns if its energy at the end of the pulse
takes it past theta = alpha. Close to that limit the block stands almost still at a large angle, where any spurious
couple of the joint would keep it.
"""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from dembrick.runs.simulate import simulate
from dembrick.scenario.controls import BaseMotionControl, Pulse
from dembrick.scenario.model import Block, Output
from helpers.stone_scenes import law, of_stone

G = 9.81


def least_pulse(width, height, duration):
    """Least acceleration (m/s2) of a pulse of this duration that overturns the block."""
    alpha, p2 = math.atan(width / height), 3.0 * G / (2.0 * math.hypot(width, height))

    def spare(acceleration):
        def rate(_, y):
            lean = alpha - y[0]
            return y[1], -p2 * (math.sin(lean) - acceleration / G * math.cos(lean))

        angle, speed = solve_ivp(rate, (0.0, duration), (0.0, 0.0), rtol=1e-10, atol=1e-12).y[:, -1]
        return 0.5 * speed**2 - p2 * (1.0 - math.cos(alpha - angle))

    return brentq(spare, 1.001 * G * width / height, 4.0 * G * width / height)


def falls(acceleration, width, height, duration, formulation, heading=0.0):
    """Whether the simulated block overturns."""
    half = 0.5 * heading
    turned = (math.cos(half), 0.0, 0.0, math.sin(half))
    scene = of_stone(
        law(formulation, 3.0, 1e11),
        BaseMotionControl(2.5, (math.cos(heading), math.sin(heading), 0.0), pulse=Pulse(acceleration, duration)),
        (
            Block("floor", "stone", (6.0, 6.0, 0.2), (0.0, 0.0, -0.1), fixed=True),
            Block("block", "stone", (width, 0.4, height), (0.0, 0.0, 0.5 * height), turned),
        ),
        output=Output(rows=100, frames=100),
    )
    moved = np.linalg.norm(simulate(scene).frames["displacement"][:, 1], axis=1)
    return bool(moved.max() > width)


@pytest.mark.parametrize(
    "formulation, early, late", [("concave", 0.995, 1.005), ("corrected-shear", 0.995, 1.005), ("convex", 0.97, 1.005)]
)
@pytest.mark.parametrize("width, height, duration", [(0.2, 1.0, 0.15), (0.3, 0.9, 0.2)])
def test_a_pulse_overturns_a_block(width, height, duration, formulation, early, late):
    """Just above the least acceleration the block overturns, just below it does not. `convex` joints press a strip at
    the toe, so the block rotates a little inside its edge and falls earlier."""
    least = least_pulse(width, height, duration)
    assert not falls(early * least, width, height, duration, formulation)
    assert falls(late * least, width, height, duration, formulation, heading=0.3)
