"""Names of the motion of a joint at its limit."""

import math

import pytest

from dembrick.runs.simulate import simulate
from dembrick.scenario.blocks import Block
from dembrick.scenario.controls import PushoverControl, YieldControl
from dembrick.scenario.model import Actuator
from dembrick.simulation.mechanism import joint_mechanism
from helpers.stone_scenes import law, of_stone


@pytest.mark.parametrize(
    ("twist", "centre", "name"),
    [
        ((1.0, 0.0, 1e-5), None, "sliding"),  # 3e-6 at the edge: rounding of a search, no centre 100 km away
        ((1.0, 0.0, 1e-3), (0.0, 1e3), "torsion-shear"),
        ((0.0, 0.3, 1.0), (-0.3, 0.0), "torsion-shear"),
        ((0.0, 3e-7, 1.0), (-3e-7, 0.0), "torsion"),
    ],
)
def test_a_motion_has_its_name_at_the_rim(twist, centre, name):
    assert joint_mechanism(twist, (0.0, 0.0), 0.3) == (None if centre is None else pytest.approx(centre), name)


def test_a_joint_that_tilts_more_than_it_slips_rocks():
    assert joint_mechanism((1e-3, 0.0, 0.0), (0.0, 1.0), 0.3) == (None, "rocking")


STEM = (0.29, 0.28, 0.49)  # m: breadth, depth, height
PUSH = (0.88, -0.47, 0.0)


@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_a_block_that_never_slips_rocks_in_every_stage_at_every_size(scale):
    """Its bond breaks in tension, by a jack and then by its own weight; no slip of before is taken for one of now."""
    b, a, h = (scale * size for size in STEM)
    bond = {"cohesion": 3000.0 * scale, "tensile_strength": 800.0 * scale, "residual_friction": 0.68}
    pushover = PushoverControl(direction=PUSH)
    jack = Actuator("jack", "stem", point=(0.5 * b, 0.25 * a, 0.7 * h), direction=(-0.9, 0.3, 0.1))
    blocks = (
        Block("floor", "stone", box=(1.5 * scale, 1.5 * scale, 0.2), position=(0.0, 0.0, -0.1), fixed=True),
        Block("stem", "stone", box=(b, a, h), position=(0.0, 0.0, 0.5 * h)),
    )
    given = of_stone(law("convex", 0.85, **bond), pushover, blocks, stages=(YieldControl(),), actuators=(jack,))
    found = simulate(given, record=False)
    assert found.stages[0]["yield_point"]["mechanism"] == "rocking"
    assert found.yield_point.mechanism == found.collapse["mechanism"] == "rocking"
    assert found.yield_point.V == pytest.approx(b / (h * PUSH[0] / math.hypot(*PUSH)), rel=1e-3)
