"""Two equal blocks and the joint between them: the laboratory scene with all parameters free."""

import numpy as np

from dembrick.geometry.rotations import rotation_matrix
from dembrick.scenario.model import (
    Actuator,
    Block,
    JointLaw,
    Load,
    Material,
    Scenario,
    Solver,
    YieldControl,
)

A, B, N, MU = 0.3, 0.2, 467.0, 0.64


def scene(
    formulation="convex",
    a=A,
    b=B,
    height=0.1,
    friction=MU,
    normal=N,
    jacks=(((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 1.0),),
    dead=(0.0, 0.0),
    kn=1e10,
    ratio=0.4,
    tolerance=1e-3,
    density=1000.0,
    points=None,
    step_factor=0.9,
    turn=(1.0, 0.0, 0.0, 0.0),
    shift=(0.0, 0.0, 0.0),
):
    """Two equal blocks a x b x height, joint plane z = 0; jacks are (point, direction, weight) from O, before ``turn``.

    ``dead`` is a tangential dead force at O. There is no gravity: N is a dead load, so the density is arbitrary.
    """
    R, shift = rotation_matrix(np.array(turn, float)), np.array(shift, float)
    block = {"material": "stone", "box": (a, b, height), "orientation": tuple(turn)}
    loads = [Load("upper", R @ [0.0, 0.0, -normal], shift + R @ [0.0, 0.0, height / 2])]
    if any(dead):
        loads.append(Load("upper", R @ [*dead, 0.0], shift))
    return Scenario(
        title="two blocks",
        gravity=(0.0, 0.0, 0.0),
        joint=JointLaw(formulation, friction, kn, ratio * kn, points=points),
        materials={"stone": Material(density)},
        blocks=(
            Block("lower", position=shift + R @ [0, 0, -height / 2], fixed=True, **block),
            Block("upper", position=shift + R @ [0, 0, height / 2], **block),
        ),
        loads=tuple(loads),
        actuators=tuple(
            Actuator(f"jack {i}", "upper", shift + R @ point, R @ direction, weight)
            for i, (point, direction, weight) in enumerate(jacks)
        ),
        control=YieldControl(tolerance),
        solver=Solver(step_factor),
    )


def single(e, direction=(0.0, 1.0, 0.0), z=0.0):
    """One jack at the eccentricity e = (e_x, e_y), at z above the joint."""
    return (((*e, z), direction, 1.0),)
