"""Limits of light blocks in scenes of far greater forces: every block is in balance by its own forces."""

import numpy as np
import pytest

from dembrick.runs.simulate import simulate
from dembrick.scenario.blocks import Block
from dembrick.scenario.controls import DynamicControl, PushoverControl, StaticsControl, TiltControl, YieldControl
from dembrick.scenario.joint_laws import JointOverride
from dembrick.scenario.model import Actuator
from dembrick.scenario.ties import Tie, TieEnd
from helpers.stone_scenes import law, of_stone

B, SLENDER = 0.1, 2.4  # m, width of the light block; its height over that
HEIGHT, WEIGHT = SLENDER * B, 2000.0 * 9.81 * SLENDER * B**3
DRUMS = tuple(Block(f"drum{i}", "stone", (4.0, 4.0, 2.0), (0.0, 0.0, 1.0 + 2.0 * i)) for i in range(4))
HEAVY = (Block("base", "stone", (4.0, 4.0, 0.2), (0.0, 0.0, -0.1), fixed=True), *DRUMS)  # 2.5 MN
AT = {"beside": (10.0, 0.0, 0.0), "on top": (0.0, 0.0, 8.0)}
PUSH = PushoverControl((1.0, 0.0, 0.0))


def pin(place="beside", b=B):
    x, y, z = AT[place]
    own = (Block("floor", "stone", (b, b, 0.2), (x, y, -0.1), fixed=True),) if place == "beside" else ()
    return *HEAVY, *own, Block("pin", "stone", (b, b, SLENDER * b), (x, y, z + 0.5 * SLENDER * b))


def holds(point, V, tolerance=1e-3):
    """V lies in the bracket, which is within the tolerance."""
    assert point.V_lower <= V <= point.V_upper
    assert point.half_width <= tolerance * point.V


def limit_of(control, blocks, formulation, **more):
    joint = law(formulation, 0.65, 1e11)
    return simulate(of_stone(joint, control, blocks, **more), record=False).yield_point


@pytest.mark.parametrize("tolerance, formulation", [(1e-3, "concave"), (1e-5, "concave"), (1e-5, "convex")])
@pytest.mark.parametrize("place", AT)
def test_a_light_block_overturns_beside_and_on_a_heavy_tower(tolerance, place, formulation):
    point = limit_of(PushoverControl((1.0, 0.0, 0.0), tolerance=tolerance), pin(place), formulation)
    holds(point, 1.0 / SLENDER, tolerance)
    assert point.mechanism == "rocking"


@pytest.mark.parametrize("place, b", [("beside", 0.03), ("on top", 0.05)])
def test_no_bracket_leaves_out_the_limit_of_blocks_too_light_for_rounding(place, b):
    """1.3 N and 5.9 N by a tower of 2.5 MN, which overturns at .5 without them."""
    point = limit_of(PushoverControl((1.0, 0.0, 0.0), tolerance=1e-5), pin(place, b), "convex")
    assert point.V_lower <= 1.0 / SLENDER <= point.V_upper


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_a_light_block_overturns_on_a_table_with_a_heavy_tower(formulation):
    point = limit_of(TiltControl((0.0, 1.0, 0.0)), pin(), formulation)
    holds(point, 1.0 / SLENDER)


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_a_jack_overturns_a_light_block_beside_a_heavy_tower(formulation):
    jack = Actuator("jack", "pin", (AT["beside"][0], 0.0, HEIGHT), (1.0, 0.0, 0.0))
    holds(limit_of(YieldControl(), pin(), formulation, actuators=(jack,)), WEIGHT * 0.5 * B / HEIGHT)


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_a_yielding_tie_holds_a_light_block_beside_a_heavy_tower(formulation):
    """The tie pulls with its strength on the axis of the block, as a weight at its foot would."""
    x, _, _ = AT["beside"]
    pull = 0.15 * WEIGHT
    ends = TieEnd("floor", (x, 0.0, -0.1)), TieEnd("pin", (x, 0.0, 0.5 * HEIGHT))
    held = limit_of(PUSH, pin(), formulation, ties=(Tie(ends, 1e6, strength=pull, prestress=pull),))
    holds(held, 1.15 / SLENDER)


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_a_heavy_block_overturns_with_the_light_one_under_it(formulation):
    """About the foot of the light block: its forces are those of the heavy one."""
    wide, thick, mass, own = 0.4, 0.05, 32.0, 0.4 * 0.4 * 0.05
    base = Block("base", "stone", (4.0, 4.0, 0.2), (0.0, 0.0, -0.1), fixed=True)
    under = Block("plate", "stone", (wide, wide, thick), (0.0, 0.0, 0.5 * thick))
    above = Block("above", "stone", (4.0, 4.0, 2.0), (0.0, 0.0, thick + 1.0))
    V = (mass + own) * 0.5 * wide / (mass * (thick + 1.0) + own * 0.5 * thick)
    holds(limit_of(PUSH, (base, under, above), formulation), V)


def rocks_at():
    """Greatest load factor of the convex block in the deformed geometry: it presses on a strip of width l at its toe,
    by a triangle, so it has turned by 2 W / (k b l^2)."""
    strip = np.linspace(0.01 * B, B, 100_000)
    turned = 2.0 * WEIGHT / (1e11 * B * strip**2)
    factor = (0.5 * B - strip / 3.0 - 0.5 * HEIGHT * turned) / (0.5 * HEIGHT + 0.5 * B * turned)
    return float(factor.max())


@pytest.mark.parametrize("formulation", ["concave", "convex"])
@pytest.mark.parametrize("place", AT)
def test_a_light_block_overturns_in_the_deformed_geometry_too(place, formulation):
    point = limit_of(PushoverControl((1.0, 0.0, 0.0), large_displacements=True), pin(place), formulation)
    expected = rocks_at() if formulation == "convex" else 1.0 / SLENDER
    assert point.V_lower <= expected * (1.0 + 1e-4) and expected * (1.0 - 1e-4) <= point.V_upper
    assert point.half_width <= 1e-3 * point.V and point.mechanism == "rocking"


@pytest.mark.parametrize("formulation", ["concave", "convex"])
def test_a_light_block_on_a_soft_bed_starts_at_rest_beside_a_heavy_tower(formulation):
    """In real time, under gravity that is not vertical, its joint has the forces in equilibrium from the start on; the
    moment of its weight grows as it leans."""
    k = 1e9
    soft = JointOverride(("floor", "pin"), law(formulation, 0.65, k))
    leaning = of_stone(
        law(formulation, 0.65, 1e12), DynamicControl(1e-3), pin(), gravity=(0.5, 0.0, -9.81), joints=(soft,)
    )
    N, V, _, _, _, M, _ = np.abs(simulate(leaning).rows["joint"][:, -1]).T
    sideways, tilts = WEIGHT * 0.5 / 9.81, k * B**4 / (4.0 if formulation == "concave" else 12.0)  # N; N m
    np.testing.assert_allclose(N, WEIGHT, rtol=1e-5)
    np.testing.assert_allclose(V, sideways, rtol=1e-5)
    np.testing.assert_allclose(M, 0.5 * HEIGHT * sideways / (1.0 - 0.5 * HEIGHT * WEIGHT / tilts), rtol=1e-5)


@pytest.mark.parametrize("formulation", ["concave", "convex"])
@pytest.mark.parametrize("over, stands", [(0.98, True), (1.02, False)])
def test_a_light_block_falls_over_an_edge_beside_a_heavy_tower(over, stands, formulation):
    """It was said to rest once its joint was open: rounding was then that of the tower's joints."""
    floor = Block("floor", "stone", (0.02, 0.02, 0.2), (50.0, 0.0, -0.1), fixed=True)
    light = Block("light", "stone", (0.02, 0.02, 0.02), (50.0 + 0.01 * over, 0.0, 0.01))
    scene = of_stone(law(formulation, 0.65, 1e12), StaticsControl(large_displacements=True), (*HEAVY, floor, light))
    assert simulate(scene, record=False).run.rest.stands is stands
