"""A wall under gravity and a sideways load."""

from dembrick.assembly import build
from dembrick.scenario.controls import DynamicControl
from dembrick.scenario.model import Wall
from helpers.stone_scenes import law, of_stone


def wall(formulation, courses=5, blocks=4):
    return build.assemble(
        of_stone(
            law(formulation, 0.6, 1e9),
            DynamicControl(1.0),
            gravity=(0.0, 1.0, -9.81),
            walls=(Wall("wall", "stone", (0.3, 0.2, 0.1), courses, blocks, base=0.1),),
        )
    )
