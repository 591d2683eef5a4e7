"""Limit loads of random single blocks against closed forms: does the bracket contain the true value.

    python tools/drawn_limits.py [--count 400] [--tilts 60] [--sloping 250] [--seed 1]

A block on a floor is pushed by an actuator whose line lies in its middle plane: level or inclined, above the joint, on
its top or side, upwards and downwards. It slides, turns about an edge, or lifts off, whichever needs the least load; if
no load causes any of the three, the limit is infinite. Tilted blocks slide at tan(psi) = mu or overturn at b / h.
Convex joints are pushed at any slope, also by actuators that press or lift, at heights where sliding and rocking need
nearly the same load, and dams by water on a back that leans either way.
Prints counts; exits with 1 if a bracket does not contain the true value.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import replace

import numpy as np

from dembrick.errors import DembrickError
from dembrick.runs.simulate import simulate
from dembrick.scenario.controls import TiltControl, YieldControl
from dembrick.scenario.model import Actuator, Block, JointLaw, Material, Scenario
from dembrick.scenario.pressures import Pressure

G, DENSITY = 9.81, 2000.0
POINTS = ("concave", "convex")


def scene(control, formulation: str, friction: float, size, actuators=()) -> Scenario:
    """A block of edges ``size`` (3,) on a floor."""
    floor = Block("floor", "stone", (40.0, 40.0, 0.5), (0.0, 0.0, -0.25), fixed=True)
    block = Block("block", "stone", tuple(size), (0.0, 0.0, 0.5 * size[2]))
    law = JointLaw(formulation, friction, 1e11, 4e10)
    return Scenario(
        "drawn", (0.0, 0.0, -G), law, {"stone": Material(DENSITY)}, (floor, block), control, actuators=actuators
    )


def truth(friction: float, size, point, direction) -> float:
    """Least V of sliding, overturning and uplift for a force in the middle plane y = 0; infinite if none is possible.

    Friction without dilatancy: at the limit of sliding N = W - V d_z, and the load of the mechanism follows from it.
    """
    b, _, h = size
    weight = DENSITY * G * float(np.prod(size))
    (x, _, z), (along, _, up) = point, direction
    found = []
    grip = abs(along) + friction * up
    if grip > 0.0:
        found.append(friction * weight / grip)
    for edge, sign in ((0.5 * b, 1.0), (-0.5 * b, -1.0)):
        # moment of the load about the edge, positive if it lifts the other side
        moment = sign * (along * z - up * (x - edge))
        if moment > 0.0:
            found.append(weight * 0.5 * b / moment)
    if up > 0.0:
        found.append(weight / up)
    return min(found, default=math.inf)


def pushed(rng, tolerance: float = 1e-3) -> tuple[Scenario, float]:
    """A random push and its limit load."""
    size = rng.uniform(0.1, 1.0, 3)
    friction = float(rng.uniform(0.1, 1.2))
    x = float(rng.uniform(-0.5, 0.5) * size[0])
    z = float(rng.uniform(0.0, 1.0) * size[2])
    face = rng.integers(4)
    if face < 2:
        x = (-0.5, 0.5)[face] * size[0]
    elif face == 2:
        z = size[2]
    angle = float(rng.choice([0.0, math.pi, rng.uniform(0.0, 2.0 * math.pi)]))
    direction = (math.cos(angle), 0.0, math.sin(angle))
    actuator = Actuator("actuator", "block", (x, 0.0, float(z)), direction)
    formulation = str(rng.choice(POINTS))
    scenario = scene(YieldControl(tolerance), formulation, friction, size, (actuator,))
    return scenario, truth(friction, size, actuator.point, actuator.direction)


def sloping(rng, tolerance: float = 1e-3) -> tuple[Scenario, float]:
    """A random dam, or an inclined push, on a convex joint; sliding and rocking need nearly the same load."""
    if rng.random() < 0.4:
        return dammed(rng, tolerance)
    while True:
        size = rng.uniform(0.1, 1.0, 3)
        angle = float(rng.uniform(-1.3, 1.3))
        direction = (math.cos(angle), 0.0, math.sin(angle))
        point = (-0.5 * float(size[0]), 0.0, float(rng.uniform(0.0, 1.0) * size[2]))
        rocking = truth(1e9, size, point, direction)
        normal = DENSITY * G * float(np.prod(size)) - rocking * direction[2]
        if math.isinf(rocking) or normal <= 0.0:
            continue
        # near the friction at which sliding and rocking need the same load
        friction = float(rocking * direction[0] / normal * rng.uniform(0.7, 1.4))
        if 0.05 < friction < 2.0:
            actuator = Actuator("actuator", "block", point, direction)
            scenario = scene(YieldControl(tolerance), "convex", friction, size, (actuator,))
            return scenario, truth(friction, size, point, direction)


def dammed(rng, tolerance: float = 1e-3) -> tuple[Scenario, float]:
    """A random dam with a leaning back under water of a multiplied weight, and the multiplier at its limit."""
    while True:
        base, crest, height, wide = (float(s) for s in rng.uniform([0.8, 0.2, 1.0, 0.3], [2.0, 1.0, 3.0, 1.0]))
        lean = float(rng.uniform(-0.2, 0.4)) * base
        surface, water = float(rng.uniform(0.6, 1.4)) * height, 1e4
        section = ((0.0, 0.0), (base, 0.0), (lean + crest, height), (lean, height))
        area, middle = _area(section)
        weight = DENSITY * G * area * wide
        # pressure on the back: force, and moment about the heel, as integrals of p and p z over the depth
        top = min(surface, height)
        push = water * wide * (surface * top - 0.5 * top**2)
        turn = water * wide * (0.5 * surface * top**2 - top**3 / 3.0)
        slope = lean / height
        down = slope * push
        over = turn - (down * base - slope**2 * turn)
        rocking = weight * (base - middle) / over if over > 0.0 else math.inf
        normal = weight + rocking * down
        if math.isinf(rocking) or not 0.0 < middle < base or normal <= 0.0:
            continue
        friction = rocking * push / normal * float(rng.uniform(0.7, 1.4))
        if 0.05 < friction < 2.0:
            break
    grip = push - friction * down
    expected = min(rocking, friction * weight / grip if grip > 0.0 else math.inf)
    corners = tuple((x, y, z) for x, z in section for y in (-0.5 * wide, 0.5 * wide))
    away = math.hypot(height, lean)
    pressure = Pressure("block", (-height / away, 0.0, lean / away), surface=surface, weight=water, actuator=True)
    drawn = scene(YieldControl(tolerance), "convex", friction, (base, wide, height))
    blocks = (drawn.blocks[0], Block("block", "stone", vertices=corners))
    return replace(drawn, blocks=blocks, pressures=(pressure,)), expected


def _area(section) -> tuple[float, float]:
    """Area (m2) of a polygon (x, z) and the x of its centroid."""
    area = moment = 0.0
    for (x, z), (x_next, z_next) in zip(section, (*section[1:], section[0]), strict=True):
        cross = x * z_next - x_next * z
        area, moment = area + 0.5 * cross, moment + cross * (x + x_next) / 6.0
    return area, moment / area


def tilted(rng) -> tuple[Scenario, float]:
    """A random block that slides on a tilting table, and tan(psi) at sliding."""
    size = rng.uniform(0.1, 1.0, 3)
    friction = float(rng.uniform(0.05, 0.9) * min(size[:2]) / size[2])
    tolerance = float(rng.choice([1e-2, 1e-3, 1e-4]))
    axis = [(1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.6, 0.8, 0.0)][rng.integers(3)]
    control = TiltControl(axis, rate=1.0, displacement=0.01, quasi_static=True, tolerance=tolerance)
    return scene(control, "convex", friction, size), friction


def judged(scenario: Scenario, expected: float) -> tuple[str, str]:
    """Outcome of a run ("inside", "unlimited", "outside", "no answer"), and its numbers."""
    try:
        result = simulate(scenario, record=False)
    except DembrickError as error:
        return "no answer", str(error)
    point = result.yield_point
    if result.unlimited or math.isinf(expected):
        agree = result.unlimited and math.isinf(expected)
        return "unlimited" if agree else "outside", f"{point.V} for {expected}"
    # a joint of finite stiffness is compressed under the weight by about 1e-6 of the block
    slack = 1e-6 * expected
    inside = point.V_lower - slack <= expected <= point.V_upper + slack
    close = abs(point.V / expected - 1.0) <= scenario.control.tolerance
    numbers = f"{point.V:.9g} [{point.V_lower:.9g}, {point.V_upper:.9g}] for {expected:.9g}, {point.mechanism}"
    return "inside" if inside and close and result.agrees() else "outside", numbers


def main() -> int:
    """Draw random cases, run them, count outcomes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=400)
    parser.add_argument("--tilts", type=int, default=60)
    parser.add_argument("--sloping", type=int, default=250)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    bad = 0
    for name, draw, count in (
        ("pushed", pushed, options.count),
        ("tilted", tilted, options.tilts),
        ("sloping", sloping, options.sloping),
    ):
        counts: dict[str, int] = {}
        for i in range(count):
            scenario, expected = draw(np.random.default_rng([options.seed, i]))
            what, numbers = judged(scenario, expected)
            counts[what] = counts.get(what, 0) + 1
            if what in ("outside", "no answer"):
                bad += 1
                print(f"{name} {i}: {scenario.joint.formulation}: {what}: {numbers}")
        print(f"{name}: {counts}")
    return 1 if bad else 0


if __name__ == "__main__":
    raise SystemExit(main())
