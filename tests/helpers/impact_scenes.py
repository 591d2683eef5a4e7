"""Scenes in real time in which blocks separate and collide again."""

from dembrick.scenario.controls import BaseMotionControl, DynamicControl, Pulse
from dembrick.scenario.model import Arch, Block, Output, Wall
from helpers.stone_scenes import law, of_stone

G = 9.81
FLOOR = Block("floor", "stone", (4.0, 4.0, 0.1), (0.0, 0.0, -0.05), fixed=True)
AWAY = Block("floor", "stone", (0.1, 0.1, 0.1), (0.0, 0.0, -5.0), fixed=True)


def scene(control, *blocks, friction=0.64, gravity=(0.0, 0.0, -G), stiffness=1e10, formulation="concave", **more):
    return of_stone(
        law(formulation, friction, stiffness),
        control,
        blocks,
        gravity=gravity,
        **{"output": Output(rows=200, frames=200)} | more,
    )


def collapse(**output):
    """Two columns of blocks overturned by a pulse."""
    return of_stone(
        law("concave", 0.64, 2e8),
        BaseMotionControl(1.1, (0.0, 1.0, 0.0), pulse=Pulse(0.6 * G, 0.3)),
        (FLOOR,),
        walls=(Wall("wall", "stone", (0.3, 0.2, 0.1), courses=6, blocks=1),),
        output=Output(rows=220, frames=110, **output),
    )


def falling_arch(formulation):
    """A semicircle of seven stones whose thickness is 0.08 of the radius; it needs 0.0957 to stand."""
    return of_stone(
        law(formulation, 0.7, 1e9),
        DynamicControl(4.0, 0.3),
        (Block("floor", "stone", (8.0, 3.0, 0.1), (0.0, 0.0, -0.55), fixed=True),),
        arches=(Arch("arch", "stone", 1.0, 0.08, 0.3, 7),),
        output=Output(("frames", "velocity"), rows=250, frames=250),
    )
