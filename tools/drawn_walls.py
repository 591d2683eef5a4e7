"""Limits of random bonded stacks and small walls against the bound of limit analysis.

    python tools/drawn_walls.py [--count 500] [--seed 1]

Joints with cohesion, some with tensile strength, some brittle, of all formulations, pushed by an acceleration or by an
actuator. `limit` proves an upper bound for structures of these strengths, whatever breaks first; no bracket may lie
above it, and no V by more than the tolerance. A limit of ductile bonds that is reported as independent of the path is
also searched with another ratio of the stiffnesses, and the two brackets must overlap. Prints counts; exits with 1 if a
limit lies above the bound or if two brackets do not overlap.
"""

from __future__ import annotations

import argparse
import math

import numpy as np

from dembrick.errors import DembrickError
from dembrick.runs.limit import limit
from dembrick.runs.outcomes.error_estimate import with_ratio
from dembrick.runs.simulate import simulate
from dembrick.scenario.controls import PushoverControl, YieldControl
from dembrick.scenario.generators import Wall
from dembrick.scenario.joint_laws import FORMULATIONS
from dembrick.scenario.model import Actuator, Block, JointLaw, Material, Scenario

GRAVITY, DENSITY = (0.0, 0.0, -9.81), 2000.0
OTHER_RATIO = 0.1  # shear over normal stiffness
ROUNDING = 1e-6  # of a limit: the tolerance of the convex programme


def bonds(rng: np.random.Generator, formulation: str) -> JointLaw:
    """A random law with bonds: ductile or brittle, with or without tensile strength."""
    friction, cohesion = float(rng.uniform(0.2, 0.8)), float(10.0 ** rng.uniform(2.5, 4.5))
    tension = float(rng.choice([0.0, rng.uniform(0.1, 1.0)])) * cohesion / friction
    after = {"residual_cohesion": float(rng.choice([0.0, rng.uniform(0.0, 1.0), 1.0])) * cohesion}
    if rng.random() < 0.3:
        after["residual_friction"] = float(rng.uniform(0.5, 1.0)) * friction
    points = {"points": (3, 3)} if formulation == "distributed" else {}
    return JointLaw(formulation, friction, 1e11, 4e10, cohesion=cohesion, tensile_strength=tension, **points, **after)


def drawn(rng: np.random.Generator, number: int) -> Scenario:
    """The structure of this ``number``: formulations in turn, everything else random."""
    law = bonds(rng, FORMULATIONS[number % len(FORMULATIONS)])
    return wall(rng, law) if rng.random() < 0.3 else stack(rng, law)


def stack(rng: np.random.Generator, law: JointLaw) -> Scenario:
    """Two to five blocks on one another, offset and rotated, pushed by a share of their weight or by an actuator."""
    blocks = [Block("floor", "stone", (6.0, 6.0, 0.2), (0.0, 0.0, -0.1), fixed=True)]
    z = 0.0
    for i in range(int(rng.integers(2, 6))):
        a, b, h = (float(s) for s in rng.uniform([0.25, 0.25, 0.07], [0.55, 0.55, 0.5]))
        x, y = rng.uniform(-0.05, 0.05, 2)
        turn = float(rng.choice([0.0, rng.uniform(0.0, 2.0 * math.pi)]))
        along = np.array([math.cos(turn), math.sin(turn)])
        across = np.array([-along[1], along[0]])
        ring = [(x, y) + 0.5 * (s * a * along + t * b * across) for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        corners = tuple((float(p), float(q), level) for level in (z, z + h) for p, q in ring)
        blocks.append(Block(f"block {i}", "stone", vertices=corners))
        z += h
    direction = rng.normal(size=3) * (1.0, 1.0, 0.15)
    direction = tuple(float(c) for c in direction / np.linalg.norm(direction))
    stone = {"stone": Material(DENSITY)}
    if rng.random() < 0.6:
        return Scenario("bonded stack", GRAVITY, law, stone, tuple(blocks), PushoverControl(direction))
    top = (float(x), float(y), z)
    jack = Actuator("jack", blocks[-1].name, top, direction)
    return Scenario("bonded stack", GRAVITY, law, stone, tuple(blocks), YieldControl(), actuators=(jack,))


def wall(rng: np.random.Generator, law: JointLaw) -> Scenario:
    """A wall of two to four courses in running bond, pushed in a random direction."""
    angle = float(rng.choice([0.0, 0.5 * math.pi, rng.uniform(0.0, math.pi)]))
    size = (float(rng.uniform(0.2, 0.5)), float(rng.uniform(0.1, 0.3)), float(rng.uniform(0.1, 0.3)))
    part = Wall("wall", "stone", size, int(rng.integers(2, 5)), int(rng.integers(1, 3)), base=0.2, ends="half")
    control = PushoverControl((math.cos(angle), math.sin(angle), 0.0))
    return Scenario("bonded wall", GRAVITY, law, {"stone": Material(DENSITY)}, (), control, walls=(part,))


def judged(scenario: Scenario) -> tuple[str, str]:
    """Outcome of a search ("below", "unlimited", "above", "apart", "no answer"), and its numbers."""
    try:
        result = simulate(scenario, record=False)
        bound = limit(scenario)
    except DembrickError as error:
        return "no answer", f"{type(error).__name__}: {error}"
    point, most = result.yield_point, math.inf if bound.upper is None else bound.upper
    if point is None:
        return "no answer", result.plain_answer
    most += ROUNDING * abs(most)
    if point.V is None or point.V_upper is None:
        return ("unlimited" if point.V_lower <= most else "above"), f"at least {point.V_lower:.9g}, at most {most:.9g}"
    numbers = f"{point.V:.9g} [{point.V_lower:.9g}, {point.V_upper:.9g}], at most {most:.9g}, {point.mechanism}"
    if point.V_lower > most or point.V > most + scenario.control.tolerance * abs(most):
        return "above", numbers
    if not point.V_lower <= point.V <= point.V_upper:
        return "apart", numbers
    if result.as_dict().get("path_dependent") is not False or scenario.joint.bonded and brittle(scenario.joint):
        return "below", numbers
    try:
        other = simulate(with_ratio(scenario, OTHER_RATIO), record=False).yield_point
    except DembrickError:
        return "below", numbers
    wide = scenario.control.tolerance * abs(point.V)
    meet = other.V_lower - wide <= point.V_upper and point.V_lower - wide <= other.V_upper
    return ("below" if meet else "apart"), f"{numbers}; other stiffness {other.V:.9g}"


def brittle(law: JointLaw) -> bool:
    """Whether bonds lose strength, so that the order of breaking, and with it the limit, depends on the stiffness."""
    lost = law.cohesion_after < law.cohesion or law.friction_after < law.friction
    return lost or law.tensile_strength > 0.0


def main() -> int:
    """Draw random structures, run them, count outcomes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    counts: dict[str, int] = {}
    for i in range(options.count):
        scenario = drawn(np.random.default_rng([options.seed, i]), i)
        what, numbers = judged(scenario)
        counts[what] = counts.get(what, 0) + 1
        if what not in ("below", "unlimited"):
            print(f"{i} {scenario.title}, {scenario.joint.formulation}: {what}: {numbers}", flush=True)
    print(", ".join(f"{count} {what}" for what, count in sorted(counts.items())))
    return 1 if {"above", "apart"} & set(counts) else 0


if __name__ == "__main__":
    raise SystemExit(main())
