"""Bounds of limit analysis for light blocks in heavy scenes: they hold the closed form, however small the block is."""

import re

import numpy as np
import pytest

from dembrick.errors import NotConvergedError
from dembrick.runs.limit import limit
from dembrick.runs.reactions import reaction
from dembrick.scenario import toml
from helpers.scenario_text import block, header, jack

PUSHOVER = '[control]\nkind = "pushover"\ndirection = [{:.17g}, {:.17g}, 0.0]\n'


def on_tower(formulation, friction, towers, pins, side, height, direction, apart, more=""):
    """A tower of blocks 9 by 9 by 2 m, and a pinnacle of ``pins`` blocks on it, or ``apart`` on a floor."""
    text = header(formulation, friction, 1e11) + block("ground", (0.0, 0.0, -0.1), (9.0, 9.0, 0.2), "fixed = true")
    text += block("floor", (20.0, 0.0, -0.1), (2.0, 2.0, 0.2), "fixed = true") if apart else ""
    for i in range(towers):
        text += block(f"tower{i}", (0.0, 0.0, 2.0 * i + 1.0), (9.0, 9.0, 2.0))
    x, z = (20.0, 0.0) if apart else (0.0, 2.0 * towers)
    for i in range(pins):
        text += block(f"pin{i}", (x, 0.0, z + height * (i + 0.5)), (side, side, height))
    return toml.loads(text + more + PUSHOVER.format(*direction))


def printed(found):
    """The two bounds as they are printed."""
    return map(float, re.search(r"proven between (\S+) and (\S+)", found.text()).groups())


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_bounds_hold_the_closed_form_for_light_blocks(formulation):
    """A pinnacle of size 5 mm to .3 m beside 1,300 t or on it slides at mu, or rocks where the resultant leaves its
    square. Excesses of 1e-11 of the tower's forces are 1e-4 of those of the lightest pinnacle."""
    rng = np.random.default_rng(53)
    for _ in range(25):
        friction, towers, pins = rng.uniform(0.3, 0.9), int(rng.integers(1, 5)), int(rng.integers(1, 4))
        scale, angle = 10.0 ** rng.uniform(-2.3, -0.5), rng.choice([0.0, 0.25, 0.5]) * np.pi
        side, height = scale * rng.uniform(0.5, 1.5), scale * rng.uniform(0.5, 2.0)
        direction = np.round([np.cos(angle), np.sin(angle)], 15)
        given = on_tower(formulation, friction, towers, pins, side, height, direction, rng.random() < 0.5)
        truth = min(friction, side / (pins * height) / np.abs(direction).max(), 4.5 / towers / np.abs(direction).max())
        found = limit(given)
        low, high = printed(found)
        assert low <= found.lower <= truth * (1.0 + 1e-14) and truth * (1.0 - 1e-14) <= found.upper <= high
        assert found.limit.gap < 1e-5


@pytest.mark.parametrize("side, height, apart, truth", [(0.3, 0.72, True, 5.0 / 12.0), (0.2, 0.5, False, 0.4)])
def test_a_pinnacle_that_rocks(side, height, apart, truth):
    """The lower bound lay above the truth and above the upper bound."""
    found = limit(on_tower("concave", 0.65, 4, 1, side, height, (1.0, 0.0), apart))
    low, high = printed(found)
    assert low <= truth <= high and low <= float(re.search(r"load factor (\S+),", found.text())[1]) <= high


def test_a_light_block_falls_beside_heavy_ones():
    """A cube of 2 cm, its centroid .2 mm beyond its support, lacks nothing next to the weight of a tower, but the same
    part of its own as alone: d / sqrt(l^2 + a^2) for small d, if friction may act too, at the arm a. It was said to
    stand up to a load factor of zero."""
    cube = block("support", (30.0, 0.0, -0.1), (0.02, 0.02, 0.2), "fixed = true")
    cube += block("cube", (30.0102, 0.0, 0.01), (0.02, 0.02, 0.02))
    cube += block("rest", (40.0, 0.0, -0.1), (0.2, 0.2, 0.2), "fixed = true")
    cube += block("held", (40.0, 0.0, 0.1), (0.2, 0.2, 0.2), 'held = ["z"]')
    lacks = []
    for towers in (0, 1, 4):
        with pytest.raises(NotConvergedError, match="does not stand under its dead loads: rocking of cube;") as caught:
            limit(on_tower("concave", 0.65, towers, 0, 0.0, 0.0, (1.0, 0.0), False, cube))
        lacks.append(caught.value.answer["statics"]["unbalanced"])
    unit, lever = np.hypot(0.0049, 0.01), 0.01  # m: of moments, that of the corners; of friction at the edge
    assert lacks == pytest.approx([np.sin(np.arctan(2e-4 / np.hypot(unit, lever)))] * 3, rel=1e-5)


@pytest.mark.parametrize("arm", [0.01, 1e-4])
def test_a_couple_turns_a_light_block(arm):
    """At M_T0 = .3826 mu N a, under uniform pressure. Its moment at V = 1 is rounding next to the weight of the tower
    times its distance, so the structure was taken for one without moments out of its plane."""
    given = header("convex", 0.65, 1e11) + block("ground", (-20.0, 0.0, -0.1), (9.0, 9.0, 0.2), "fixed = true")
    given += block("tower", (-20.0, 0.0, 4.0), (9.0, 9.0, 8.0))
    given += block("floor", (0.0, 0.0, -0.1), (1.0, 1.0, 0.2), "fixed = true")
    given += block("pin", (0.0, 0.0, 0.15), (0.2, 0.2, 0.3)) + jack("pin", (0.5 * arm, 0.0, 0.1), (0.0, 1.0, 0.0))
    given += jack("pin", (-0.5 * arm, 0.0, 0.1), (0.0, -1.0, 0.0)).replace("jack", "other")
    found = limit(toml.loads(given + '[control]\nkind = "yield"\n'))
    assert found.lower <= 0.3825978582 * 0.65 * 0.012 * 2000.0 * 9.81 * 0.2 / arm <= found.upper


def test_the_thrust_of_a_light_lintel_is_not_zero():
    """Its posts bear mu times half its weight, which was told as zero beside a tower of 13 MN."""
    given = header("concave", 0.6, 1e10) + block("ground", (-50.0, 0.0, -0.1), (9.0, 9.0, 0.2), "fixed = true")
    given += block("tower", (-50.0, 0.0, 4.0), (9.0, 9.0, 8.0))
    for name, x in (("left", 0.0), ("right", 0.09)):
        given += block(name, (x, 0.0, -0.01), (0.03, 0.03, 0.02), "fixed = true")
        given += block(f"on_{name}", (x, 0.0, 0.015), (0.015, 0.015, 0.03))
    given += block("lintel", (0.045, 0.0, 0.034), (0.105, 0.015, 0.008)) + '[control]\nkind = "statics"\n'
    found = reaction(toml.loads(given), "right", (1.0, 0.0, 0.0))
    thrust = 0.6 * 0.5 * 0.105 * 0.015 * 0.008 * 2000.0 * 9.81
    assert found.least.bound <= -thrust <= found.least.reached < 0.0 < found.greatest.reached <= thrust
    assert thrust <= found.greatest.bound < 1.1 * thrust
