"""A block in equilibrium on a fixed one in real time, and blocks moved by hand without a time step."""

import math

import numpy as np

from dembrick.assembly import build
from dembrick.geometry.rotations import quaternion_product, rotation_matrix
from dembrick.scenario.controls import DynamicControl
from dembrick.scenario.model import Block, JointLaw, Scenario
from dembrick.simulation.dynamics.dead_load import find_equilibrium
from dembrick.simulation.dynamics.integrator import Motion, motion
from dembrick.simulation.dynamics.loads import Driving
from helpers.stone_scenes import law, of_stone

GRAVITY = np.array([0.0, 0.0, -9.81])
FORMULATIONS = ("concave", "corrected", "corrected-shear", "convex", "distributed")


def block_on_floor(control, loads=(), friction=0.2) -> Scenario:
    """A block of 0.3 x 0.2 x 0.1 m on a wide floor."""
    return of_stone(
        JointLaw("convex", friction, 1e9, 1e9),
        control,
        (
            Block("floor", "stone", (4.0, 4.0, 0.1), (0.0, 0.0, -0.05), fixed=True),
            Block("block", "stone", (0.3, 0.2, 0.1), (0.0, 0.0, 0.05)),
        ),
        loads=loads,
    )


def two_blocks(
    formulation="concave", floor=(0.3, 0.2, 0.1), turn=(1.0, 0.0, 0.0, 0.0), friction=0.64, **block
) -> Motion:
    """A block of 0.3 x 0.2 x 0.1 m on a fixed one; the whole scene with gravity is rotated by a quaternion."""
    R = rotation_matrix(np.array(turn))
    points = {"points": (6, 4)} if formulation == "distributed" else {}
    turned = {key: tuple(R @ value) for key, value in block.items()}
    built = build.assemble(
        of_stone(
            law(formulation, friction, **points),
            DynamicControl(duration=1.0),
            (
                Block("floor", "stone", floor, tuple(R @ [0.0, 0.0, -floor[2] / 2]), turn, fixed=True),
                Block("block", "stone", (0.3, 0.2, 0.1), tuple(R @ [0.0, 0.0, 0.05]), turn, **turned),
            ),
            gravity=tuple(R @ GRAVITY),
        )
    )
    return motion(built, 0.1, 0.3)


def resting(*arguments, **keywords) -> tuple[Motion, Driving]:
    """The same blocks in equilibrium under gravity, and their loads."""
    moving = two_blocks(*arguments, **keywords)
    driving = Driving(moving.assembly.gravity)
    find_equilibrium(moving, driving)
    return moving, driving


def place(moving: Motion, shift, turn, block: int = 1) -> None:
    """Shift a block by ``shift`` (m) and rotate it about its centroid by a quaternion, without a time step."""
    bodies = moving.state.bodies
    bodies.position[block] += shift
    bodies.orientation[block] = quaternion_product(turn, bodies.orientation[block])
    bodies.rotation[block] = rotation_matrix(bodies.orientation[block])


def about(axis, angle):
    """Quaternion of a rotation."""
    return np.concatenate([[math.cos(angle / 2)], math.sin(angle / 2) * np.asarray(axis, float)])
