"""Blocks on plates that are not in line: a search passes one mechanism after another, each with a small stiffness.

Past a bend V grows in proportion to the displacement by some kN/m, which its growth before does not predict; the next
mechanism is further on. The references are limit analysis and plane statics.
"""

import numpy as np
import pytest

from dembrick.errors import NotConvergedError
from dembrick.runs.limit import limit
from dembrick.runs.simulate import simulate
from dembrick.scenario.blocks import Block
from dembrick.scenario.controls import YieldControl
from dembrick.scenario.model import Actuator
from helpers.stone_scenes import law, of_stone


def on_plates(plates, block, jack, way, stiffness):
    """``plates``: half width and centre of each; ``block``: its size and position."""
    blocks = [
        Block(f"plate {i}", "stone", box=(2.0 * half, 2.0 * half, 0.1), position=(x, y, -0.05), fixed=True)
        for i, (half, x, y) in enumerate(plates)
    ]
    blocks.append(Block("block", "stone", box=block[0], position=block[1]))
    actuator = Actuator("jack", "block", jack, way, 1.0)
    return of_stone(law(friction=1.5, stiffness=stiffness), YieldControl(1e-3), blocks, actuators=(actuator,))


def test_plates_whose_outer_edges_are_not_in_line():
    """The block tips over the line x = 0, on which the edges of the two outer plates lie."""
    plates = ((0.05, -0.05, -0.25), (0.05, -0.053, 0.0), (0.05, -0.05, 0.25))
    size = (0.5, 0.9, 0.6)
    given = on_plates(plates, (size, (-0.1, 0.0, 0.3)), (-0.1, 0.0, 0.6), (1.0, 0.05, 0.0), 1e11)
    exact = 2000.0 * 9.81 * np.prod(size) * 0.1 / 0.6 * np.hypot(1.0, 0.05)
    point = simulate(given, record=False).yield_point
    assert point.V_lower * (1.0 - 1e-6) <= exact <= point.V_upper
    assert point.V == pytest.approx(exact, rel=1e-3)


@pytest.mark.parametrize("seed", range(20, 44))
def test_drawn_plates(seed):
    draw = np.random.default_rng(seed)
    size, count = draw.uniform(0.4, 1.0, 3), int(draw.integers(3, 5))
    while True:
        places = draw.uniform(-0.35, 0.35, (count, 2)) * size[:2]
        apart = np.abs(places[:, None] - places[None]).max(axis=2) + np.eye(count)
        if apart.min() > 0.22 * size[:2].max():
            break
    plates = [(draw.uniform(0.02, 0.05) * size[:2].min(), *place) for place in places]
    angle = draw.uniform(0.0, 2.0 * np.pi)
    jack = (0.0, 0.0, draw.uniform(0.5, 1.0) * size[2])
    given = on_plates(plates, (tuple(size), (0.0, 0.0, 0.5 * size[2])), jack, (np.cos(angle), np.sin(angle), 0.0), 1e12)
    try:
        point = simulate(given, record=False).yield_point
    except NotConvergedError as error:  # its weight may act beside the plates
        assert "does not stand" in str(error)
        return
    bound = limit(given)
    assert point.V_lower <= (1.0 + 1e-5) * bound.upper and bound.lower <= (1.0 + 1e-5) * point.V_upper
