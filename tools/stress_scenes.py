"""The scenes of the stress matrix: a block on a block, stacks, and their theoretical limit loads."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from dembrick import theory
from dembrick.assembly import build as assemblies
from dembrick.runs import theory_check
from dembrick.scenario.model import Actuator, Block, JointLaw, JointOverride, Load, Material, Scenario, YieldControl
from dembrick.simulation.statics.state import initial_state, load_vectors
from dembrick.simulation.statics.stiffness import assembled_stiffness

GRAVITY = 9.81
A, B, H, N, MU, KN, KS_KN = 0.3, 0.2, 0.1, 467.0, 0.64, 1e10, 0.4


def jack(e_x: float, e_y: float = 0.0, angle: float = 0.5 * math.pi, z: float = 0.0):
    """One jack at (e_x, e_y, z) from the joint's centre, pushing at ``angle`` from t1 in its plane."""
    # cos(pi/2) is not exactly 0: rounding must not add a load component
    direction = tuple(0.0 if abs(c) < 1e-15 else c for c in (math.cos(angle), math.sin(angle), 0.0))
    return (((e_x, e_y, z), direction, 1.0),)


def couple(arm: float):
    """Two jacks that apply pure torsion to the block."""
    return (((arm, 0.0, 0.0), (0.0, 1.0, 0.0), 1.0), ((-arm, 0.0, 0.0), (0.0, 1.0, 0.0), -1.0))


def pair(
    formulation,
    jacks,
    a=A,
    b=B,
    height=H,
    friction=MU,
    normal=N,
    kn=KN,
    ratio=KS_KN,
    density=1500.0,
    dead=(0.0, 0.0),
    tolerance=1e-3,
    points=None,
):
    """A free block on a fixed one, joint a x b in z = 0 under ``normal`` as a dead load, no gravity."""
    loads = [Load("upper", (0.0, 0.0, -normal), (0.0, 0.0, height / 2))]
    if any(dead):
        loads.append(Load("upper", (*dead, 0.0), (0.0, 0.0, 0.0)))
    return Scenario(
        title="pair",
        gravity=(0.0, 0.0, 0.0),
        joint=JointLaw(formulation, friction, kn, ratio * kn, points=points if formulation == "distributed" else None),
        materials={"stone": Material(density)},
        blocks=(
            Block("lower", "stone", (a, b, height), (0.0, 0.0, -height / 2), fixed=True),
            Block("upper", "stone", (a, b, height), (0.0, 0.0, height / 2)),
        ),
        loads=tuple(loads),
        actuators=tuple(Actuator(f"jack {i}", "upper", p, d, w) for i, (p, d, w) in enumerate(jacks)),
        control=YieldControl(tolerance),
    )


def stack(formulation, densities, stiffness, pushed: int, jacks, tolerance=1e-3):
    """Free blocks on one another on a fixed base, under their weight; jacks in the bottom joint of block ``pushed``.

    ``stiffness`` (Pa/m): of the joint below each block.
    """
    count = len(densities)
    names = ["base"] + [f"b{i}" for i in range(count)]
    materials = {f"m{i}": Material(d) for i, d in enumerate(densities)} | {"base": Material(1500.0)}
    blocks = [Block("base", "base", (A, B, H), (0.0, 0.0, -H / 2), fixed=True)]
    blocks += [Block(names[i + 1], f"m{i}", (A, B, H), (0.0, 0.0, (i + 0.5) * H)) for i in range(count)]
    overrides = [
        JointOverride((names[i], names[i + 1]), JointLaw(formulation, MU, k, KS_KN * k))
        for i, k in enumerate(stiffness)
        if k != KN
    ]
    plane = pushed * H
    return Scenario(
        title="stack",
        gravity=(0.0, 0.0, -GRAVITY),
        joint=JointLaw(formulation, MU, KN, KS_KN * KN),
        materials=materials,
        blocks=tuple(blocks),
        joints=tuple(overrides),
        actuators=tuple(
            Actuator(f"jack {i}", names[pushed + 1], (p[0], p[1], p[2] + plane), d, w)
            for i, (p, d, w) in enumerate(jacks)
        ),
        control=YieldControl(tolerance),
    )


def stack_theory(built, densities, pushed: int, jacks) -> float:
    """Limit load of a stack: that of the weakest joint below the load, each under the weight above it."""
    force = sum(w * np.array(d) for _, d, w in jacks)
    moment = sum(w * (p[0] * d[1] - p[1] * d[0]) for p, d, w in jacks)
    weights = np.array(densities) * A * B * H * GRAVITY
    answers = []
    for i in range(pushed + 1):
        number, joint = next((n, j) for n, j in enumerate(built.joints) if {j.block_a, j.block_b} == {i, i + 1})
        points = built.contact_points[number]
        if joint.law.formulation == "distributed":
            law = theory.point_formulation(points.normal_arm, points.area, MU)
        else:
            law = theory.rectangle_formulation(joint.law.formulation, A, B, MU)
        normal, height = float(weights[i:].sum()), (pushed - i) * H
        load = (float(force[0]), float(force[1]), float(moment))
        answers.append(theory.limit_load_at_height(law, normal, load, height=height).V)
    return min(answers)


def elastic_give(built) -> float:
    """Driven displacement (m) for V = 1 as long as all joints are closed and nothing slips."""
    state = initial_state(built)
    load = load_vectors(state)[state.blocks.free].ravel()
    return float(load @ np.linalg.solve(assembled_stiffness(state), load) / np.abs(state.actuators.weight).sum())


def by_judge(built) -> float:
    """Limit load of a single joint by theory."""
    return theory_check.theory_of(built).V


def lab_jacks(z: float = 0.0) -> dict:
    """The jacks that most axes use, by name."""
    return {"couple": couple(0.45 * A), "eccentric": jack(0.25 * A, z=z), "shear": jack(0.0, z=z)}


def rest_scene(formulation: str, kind: str) -> Scenario:
    """Tangential dead load of 0.98 of its limit, in the middle of the joint or at a quarter of its length."""
    jacks = jack(0.25 * A if kind == "eccentric" else 0.0)
    limit = by_judge(assemblies.assemble(pair(formulation, jacks)))
    scenario = pair(formulation, jacks)
    point, direction, _ = jacks[0]
    load = Load("upper", tuple(0.98 * limit * d for d in direction), point)
    return dataclasses.replace(scenario, loads=(*scenario.loads, load))
