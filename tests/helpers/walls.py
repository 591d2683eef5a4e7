"""A wall under gravity and a sideways load."""

from dembrick.assembly import build
from dembrick.scenario.controls import DynamicControl
from dembrick.scenario.model import JointLaw, Material, Scenario, Wall


def wall(formulation, courses=5, blocks=4):
    return build.assemble(
        Scenario(
            title="wall",
            gravity=(0.0, 1.0, -9.81),
            joint=JointLaw(formulation, 0.6, 1e9, 4e8),
            materials={"stone": Material(2000.0)},
            walls=(Wall("wall", "stone", (0.3, 0.2, 0.1), courses, blocks, base=0.1),),
            control=DynamicControl(1.0),
        )
    )
