"""Assemblies whose limit loads are known to many digits: walls, a corner, an arch, a stack, a cube."""

from dembrick.scenario.blocks import Block
from dembrick.scenario.controls import PushoverControl, YieldControl
from dembrick.scenario.generators import Arch, Stack, Wall
from dembrick.scenario.model import Actuator, JointLaw, Scenario
from helpers.stone_scenes import of_stone


def pushed(joint: JointLaw, direction, blocks=(), **parts) -> Scenario:
    return of_stone(joint, PushoverControl(direction), blocks, **parts)


def wall(joint: JointLaw, blocks: int, courses: int, direction) -> Scenario:
    """Running bond of 0.3 x 0.2 x 0.1 m blocks with halves at the ends, on a fixed slab."""
    return pushed(joint, direction, walls=(_wall(blocks, courses),))


def _wall(blocks: int, courses: int) -> Wall:
    return Wall("wall", "stone", (0.3, 0.2, 0.1), courses, blocks, base=0.2, ends="half")


def wall_with_actuator(joint: JointLaw, block="wall.6.3", x=0.6) -> Scenario:
    """The wall of 4 x 6 blocks with a whole block of the top course pushed along y at its centroid."""
    actuator = Actuator("push", block, (x, 0.0, 0.55), (0.0, 1.0, 0.0))
    return of_stone(joint, YieldControl(), walls=(_wall(4, 6),), actuators=(actuator,))


def arch(joint: JointLaw, direction) -> Scenario:
    """Semicircle of 20 straight voussoirs, mean radius 1.5 m, 0.3 m thick, 0.5 m deep."""
    return pushed(joint, direction, arches=(Arch("arch", "stone", 1.5, 0.3, 0.5, 20),))


def stack(joint: JointLaw, direction, courses=5, block=(0.3, 0.2, 0.1)) -> Scenario:
    return pushed(joint, direction, stacks=(Stack("stack", "stone", courses, block, base=0.2),))


def pressed_cube(joint: JointLaw, push: float, arm: float) -> Scenario:
    """A cube of 0.4 m on a slab, pushed by V along x in the plane of the joint at y = ``arm``, and pressed down at its
    centroid by V over ``push``."""
    blocks = (
        Block("slab", "stone", box=(2.0, 2.0, 0.2), position=(0.0, 0.0, -0.1), fixed=True),
        Block("cube", "stone", box=(0.4, 0.4, 0.4), position=(0.0, 0.0, 0.2)),
    )
    actuators = (
        Actuator("push", "cube", (0.0, arm, 0.0), (1.0, 0.0, 0.0)),
        Actuator("press", "cube", (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 1.0 / push),
    )
    return of_stone(joint, YieldControl(), blocks, actuators=actuators)


def corner(joint: JointLaw, direction) -> Scenario:
    """A bonded L-shaped corner of six courses on a slab."""
    even = ((0.0, 0.4, 0.0, 0.2), (0.4, 0.8, 0.0, 0.2), (0.0, 0.2, 0.2, 0.6))
    odd = ((0.2, 0.6, 0.0, 0.2), (0.6, 0.8, 0.0, 0.2), (0.0, 0.2, 0.0, 0.4), (0.0, 0.2, 0.4, 0.6))
    blocks = [Block("slab", "stone", box=(2.0, 2.0, 0.2), position=(0.4, 0.3, -0.1), fixed=True)]
    for course in range(6):
        for i, (x0, x1, y0, y1) in enumerate(odd if course % 2 else even):
            place = (0.5 * (x0 + x1), 0.5 * (y0 + y1), 0.15 * course + 0.075)
            blocks.append(Block(f"{course}.{i}", "stone", box=(x1 - x0, y1 - y0, 0.15), position=place))
    return pushed(joint, direction, tuple(blocks))
