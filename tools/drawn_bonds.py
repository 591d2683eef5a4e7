"""Limit loads of random single blocks on a bonded bed, against closed forms: does the bracket contain the true value.

    python tools/drawn_bonds.py [--count 200] [--seed 1]

A block on a floor, with cohesion and tensile strength in the bed joint, is pushed in the plane of the joint at any
eccentricity, or pulled off along its normal. The limit of a ductile bed is that of the convex programme of limit
analysis, at the normal forces of its points. A brittle bed breaks at its first slip, under the elastic forces, if the
residual strength is less than that; a convex joint, which has a single bond, breaks as a whole. Under tension the peak
is reached when the first point or corner exceeds the tensile strength, or it is the strength without the bond. Prints
counts; exits with 1 if a bracket does not contain the true value.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from dembrick import theory
from dembrick.assembly import build
from dembrick.errors import DembrickError
from dembrick.runs.simulate import simulate
from dembrick.scenario.controls import YieldControl
from dembrick.scenario.model import Actuator, Block, JointLaw, Load, Material, Scenario

FORMULATIONS = ("concave", "corrected", "corrected-shear", "distributed", "convex")
OUTSIDE = 1e-9  # of the limit load: rounding


def scene(law: JointLaw, size, normal: float, point, direction, tolerance: float = 1e-3) -> Scenario:
    """A block of edges ``size`` (3,) on a fixed one of the same size, their joint at the origin, under N = ``normal``;
    an actuator at ``point``."""
    half = (0.0, 0.0, 0.5 * size[2])
    return Scenario(
        "bonded",
        (0.0, 0.0, 0.0),
        law,
        {"stone": Material(2000.0)},
        (
            Block("floor", "stone", tuple(size), (0.0, 0.0, -half[2]), fixed=True),
            Block("block", "stone", tuple(size), half),
        ),
        YieldControl(tolerance),
        loads=(Load("block", (0.0, 0.0, -normal)),),
        actuators=(Actuator("jack", "block", tuple(point), tuple(direction)),),
    )


def law_of(scenario: Scenario, cohesion: float, friction: float) -> theory.Law:
    """The limit surface of the joint of a scene at its normal forces, with one cohesion and friction throughout."""
    assembly = build.assemble(scenario)
    joint, points = assembly.joints[0], assembly.contact_points[0]
    normal = -float(assembly.dead_force[joint.block_b, 2])
    area = float(joint.area)
    if points is None:
        return theory.convex(joint.polygon, 1.0, cohesion * area + friction * normal)
    return theory.points(points.shear_arm, (cohesion + friction * normal / area) * points.area, 1.0)


def pushed_limit(scenario: Scenario, load) -> float:
    """The greatest V of a load (f1, f2, m) in the plane of the joint."""
    law = scenario.joint
    strong = float(theory.limit_loads(law_of(scenario, law.cohesion, law.friction), load).V[0])
    if law.formulation == "convex" or (law.cohesion_after == law.cohesion and law.friction_after == law.friction):
        return strong
    assembly = build.assemble(scenario)
    points, area = assembly.contact_points[0], float(assembly.joints[0].area)
    normal = -float(assembly.dead_force[assembly.joints[0].block_b, 2])
    arm, share = points.shear_arm, points.area / area
    centre = share @ arm
    turning = load[2] - (centre[0] * load[1] - centre[1] * load[0])
    away = arm - centre
    polar = share @ (away**2).sum(axis=1)
    each = share[:, None] * (np.array(load[:2]) + turning / polar * np.stack([-away[:, 1], away[:, 0]], axis=1))
    strength = (law.cohesion * area + law.friction * normal) * share
    with np.errstate(divide="ignore"):
        slips = strength / np.hypot(*each.T)
    first = float(slips.min())
    # after the first points have slipped: their residual strength and the full strength of all others
    residual = (law.cohesion_after * area + law.friction_after * normal) * share
    left = np.where(slips <= first * (1.0 + 1e-6), residual, strength)
    if float(theory.limit_loads(theory.points(arm, left, 1.0), load).V[0]) > first:
        raise ValueError("what is left carries more than the first slip")
    return first


def pulled_limit(scenario: Scenario, size, e: float) -> float:
    """The greatest V of a tension along the normal, at the distance ``e`` (m) along y from the middle of the joint."""
    law, assembly = scenario.joint, build.assemble(scenario)
    joint, points = assembly.joints[0], assembly.contact_points[0]
    normal = -float(assembly.dead_force[joint.block_b, 2])
    area = float(joint.area)
    if points is None:
        first = (law.tensile_strength * area + normal) / (1.0 + 6.0 * e / size[1])
        return max(first, normal * 0.5 * size[1] / (0.5 * size[1] + e))
    share, y = points.area / area, points.normal_arm[:, 1]
    pull = 1.0 + e * y / (share @ (y * y))
    crack = float(((law.tensile_strength * area + normal) / pull[pull > 0.0]).min())
    return max(crack, normal * y.max() / (y.max() + e))


def pushed(rng: np.random.Generator) -> tuple[Scenario, float]:
    """A random push in the plane of the joint, and its limit load."""
    while True:
        formulation = str(rng.choice(FORMULATIONS))
        size = rng.uniform([0.2, 0.15, 0.08], [0.5, 0.4, 0.2])
        friction, cohesion = float(rng.uniform(0.2, 0.8)), float(10.0 ** rng.uniform(3.0, 4.7))
        normal = float(10.0 ** rng.uniform(2.0, 3.5))
        after = {} if rng.random() < 0.5 else {"residual_cohesion": cohesion}
        if not after and rng.random() < 0.5:
            after = {"residual_friction": float(rng.uniform(0.5, 1.0)) * friction}
        points = {"points": (3, 2)} if formulation == "distributed" else {}
        law = JointLaw(formulation, friction, 1e10, 4e9, cohesion=cohesion, **points, **after)
        law = replace(law, tensile_strength=float(rng.uniform(0.0, 0.9)) * cohesion / friction)
        angle, (x, y) = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(-0.45, 0.45, 2) * size[:2]
        f1, f2 = float(np.cos(angle)), float(np.sin(angle))
        scenario = scene(law, size, normal, (x, y, 0.0), (f1, f2, 0.0))
        try:
            return scenario, pushed_limit(scenario, (f1, f2, x * f2 - y * f1))
        except ValueError:
            continue


def pulled(rng: np.random.Generator) -> tuple[Scenario, float]:
    """A random tension along the normal, and its limit load."""
    formulation = str(rng.choice(["concave", "corrected", "corrected-shear", "convex"]))
    size = rng.uniform([0.2, 0.15, 0.08], [0.5, 0.4, 0.2])
    tension, friction = float(10.0 ** rng.uniform(3.0, 4.7)), float(rng.uniform(0.2, 0.8))
    cohesion = float(rng.uniform(1.0, 3.0)) * friction * tension
    law = JointLaw(formulation, friction, 1e10, 4e9, cohesion=cohesion, tensile_strength=tension)
    e = float(rng.uniform(0.0, 0.45)) * size[1]
    scenario = scene(law, size, float(10.0 ** rng.uniform(1.0, 3.0)), (0.0, e, 0.0), (0.0, 0.0, 1.0))
    return scenario, pulled_limit(scenario, size, e)


def judged(scenario: Scenario, expected: float) -> tuple[str, str]:
    """``inside`` or ``outside``, with the numbers; or the error that ended the search."""
    try:
        point = simulate(scenario, record=False).yield_point
    except DembrickError as error:
        return type(error).__name__, str(error)
    numbers = f"{scenario.joint.formulation}: {expected:.8g} in [{point.V_lower:.8g}, {point.V_upper:.8g}]"
    slack = OUTSIDE * expected
    inside = point.V_lower - slack <= expected <= point.V_upper + slack
    return ("inside" if inside else "outside"), numbers


def main() -> int:
    """Draw, judge and count."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--count", type=int, default=200)
    options.add_argument("--seed", type=int, default=1)
    given = options.parse_args()
    counts: dict[str, int] = {}
    for i in range(given.count):
        draw = pulled if i % 3 == 0 else pushed
        what, numbers = judged(*draw(np.random.default_rng([given.seed, i])))
        counts[what] = counts.get(what, 0) + 1
        if what != "inside":
            print(f"{i} {draw.__name__}: {what}: {numbers}")
    print(", ".join(f"{count} {what}" for what, count in sorted(counts.items())))
    return 0 if set(counts) == {"inside"} else 1


if __name__ == "__main__":
    raise SystemExit(main())
