"""Limit loads of random single blocks with a tie or a bar, against closed forms and the bound of limit analysis.

    python tools/drawn_ties.py [--count 200] [--seed 1]

A block on a floor is pushed horizontally by an actuator, by a share of its weight (pushover), at a constant rate, or by
a tilting table, for which only `limit` may give an answer, since the search of a tilt supports friction only. One tie
or bar connects it to the floor along a line through the middle of the joint: slack, soft, stiff or prestressed,
stretched or relieved by the push. However soft it is, the block slides on when the tie carries its strength, a cable
that goes slack carries nothing, and a bar in compression its strength: that is `truth`. In the deformed geometry a
yielding tie becomes flatter as the block slides on, and the load grows until the tie is inclined by the angle of
friction: the answer may lie anywhere between. If `limit` gives less, the bracket must not lie above that either. Prints
counts; exits with 1 if a bracket does not contain the true value.
"""

from __future__ import annotations

import argparse
import math
from typing import NamedTuple

import numpy as np

from dembrick.errors import DembrickError, ScenarioError
from dembrick.runs.limit import limit
from dembrick.runs.simulate import simulate
from dembrick.scenario.controls import DisplacementControl, PushoverControl, TiltControl, YieldControl
from dembrick.scenario.joint_laws import FORMULATIONS
from dembrick.scenario.model import Actuator, Block, JointLaw, Load, Material, Scenario
from dembrick.scenario.ties import Tie, TieEnd

G, DENSITY, SIZE = 9.81, 1500.0, (0.4, 0.2, 0.1)
WEIGHT = DENSITY * G * SIZE[0] * SIZE[1] * SIZE[2]
CONTROLS = ("yield", "pushover", "tilt", "displacement", "yield large", "pushover large")
ROUNDING = 1e-5  # of a limit: effect of the compliance of joints
DEFORMED = 1e-3  # of a limit in the deformed geometry or at the end of a travel: effect of the rotation of the tie


class Held(NamedTuple):
    """A random block: its scene, its control, and the limit in closed form."""

    scenario: Scenario
    control: str
    expected: float
    creeps_to: float  # the load as the tie becomes flatter; equal to that expected if it does not


def drawn(rng: np.random.Generator, number: int) -> Held:
    """The block of this ``number``: formulations and controls in turn, everything else random."""
    formulation, control = FORMULATIONS[number % len(FORMULATIONS)], CONTROLS[number % len(CONTROLS)]
    friction, pressed = float(rng.uniform(0.2, 0.7)), float(rng.uniform(0.0, 400.0))
    angle, away = float(rng.choice([0.0, rng.uniform(0.45, 0.9)])), bool(rng.integers(4))  # the push stretches it
    moves = control == "displacement" or control.endswith("large")
    stiffness = float(10.0 ** rng.uniform(6.5 if moves else 3.0, 7.5))
    strength = float(rng.uniform(10.0, 60.0))
    prestress = float(rng.choice([0.0, rng.uniform(0.0, 1.0)]) * strength)
    tension_only = bool(rng.integers(2))
    if not tension_only:
        prestress *= float(rng.choice([-1.0, 1.0]))
    if control in ("tilt", "pushover", "pushover large"):
        pressed = 0.0
    half = 0.5 * SIZE[2]
    sign = 1.0 if away else -1.0
    rise, run = (half, half / math.tan(angle)) if angle else (0.0, 0.1)
    tie = Tie(
        (TieEnd("floor", (-sign * run, 0.0, -rise)), TieEnd("block", (sign * run, 0.0, rise))),
        stiffness, strength, prestress, tension_only,
    )  # fmt: skip
    # if the block moves towards the anchor, a cable goes slack and a bar yields in compression
    force = strength if away else (0.0 if tension_only else -strength)
    scenario = Scenario(
        "held block",
        (0.0, 0.0, -G),
        JointLaw(formulation, friction, 1e10, 4e9),
        {"stone": Material(DENSITY)},
        (
            Block("floor", "stone", (2.0, 1.0, 0.2), (0.0, 0.0, -0.1), fixed=True),
            Block("block", "stone", SIZE, (0.0, 0.0, half)),
        ),
        _control(control, stiffness),
        loads=(Load("block", (0.0, 0.0, -pressed), (0.0, 0.0, half)),) if pressed else (),
        actuators=(Actuator("jack", "block", (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)),) if _pushes(control) else (),
        ties=(tie,),
    )
    line = [(sign * math.cos(angle), math.sin(angle))]
    if control.endswith("large") and force > 0.0 and angle > math.atan(friction):
        line.append((math.cos(math.atan(friction)), math.sin(math.atan(friction))))
    ends = [truth(control, friction, pressed, force, *ahead) for ahead in line]
    return Held(scenario, control, ends[0], ends[-1])


def _pushes(control: str) -> bool:
    return control in ("yield", "yield large", "displacement")


def _control(control: str, stiffness: float):
    large = control.endswith("large")
    if control.startswith("yield"):
        return YieldControl(1e-3, large_displacements=large)
    if control.startswith("pushover"):
        return PushoverControl((1.0, 0.0, 0.0), large_displacements=large)
    if control == "tilt":
        return TiltControl((0.0, 1.0, 0.0))
    return DisplacementControl(1e-3, 4.0 * 100.0 / stiffness)


def truth(control: str, friction: float, pressed: float, force: float, along: float, down: float) -> float:
    """V (N), load factor or angle (degrees) at which the block slides along x against a tie that carries ``force``.

    The direction of the tie has the components ``along`` against x and ``down`` downwards; the friction is
    mu (N + T down).
    """
    held = force * (along + friction * down)
    if control == "tilt":  # W sin a = mu (W cos a + T down) + T along
        ratio = held / (WEIGHT * math.hypot(1.0, friction))
        if abs(ratio) > 1.0:
            return math.inf
        return math.degrees(math.atan(friction) + math.asin(ratio))
    found = friction * (WEIGHT + pressed) + held
    return found / WEIGHT if control.startswith("pushover") else found


def judged(held: Held) -> tuple[str, str]:
    """Outcome of a run ("inside", "outside", "refused", "no answer"), and its numbers."""
    if held.control == "tilt":
        return _tilted(held)
    try:
        result = simulate(held.scenario, record=False)
    except DembrickError as error:
        return "no answer", str(error)
    point, expected = result.yield_point, held.expected
    if point is None or point.V is None:
        return "no answer", result.plain_answer
    found = (point.V_lower, point.V, point.V_upper)
    moves = held.control == "displacement" or held.control.endswith("large")
    slack = (DEFORMED if moves else ROUNDING) * expected
    lower, V, upper = found
    nearest = min(max(V, expected), held.creeps_to)
    inside = lower - slack <= nearest <= upper + slack and abs(V - nearest) <= 1e-3 * expected + slack
    if held.control in ("yield", "pushover"):
        inside = inside and lower <= limit(held.scenario).upper * (1.0 + ROUNDING)
    return "inside" if inside else "outside", f"{V:.9g} [{lower:.9g}, {upper:.9g}] for {expected:.9g}"


def _tilted(held: Held) -> tuple[str, str]:
    """Outcome of a tilting table: the search must refuse, and `limit` give the angle."""
    try:
        simulate(held.scenario, record=False)
    except ScenarioError:
        found = limit(held.scenario)
        angle = 90.0 if found.upper is None else math.degrees(math.atan(found.upper))
        good = abs(angle - min(held.expected, 90.0)) <= 1e-3
        return "refused" if good else "outside", f"limit: {angle:.9g} for {held.expected:.9g}"
    return "outside", "the search of a tilt answered with a tie"


def main() -> int:
    """Draw random cases, run them, count outcomes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    counts: dict[str, int] = {}
    for i in range(options.count):
        held = drawn(np.random.default_rng([options.seed, i]), i)
        what, numbers = judged(held)
        counts[what] = counts.get(what, 0) + 1
        if what not in ("inside", "refused"):
            tie = held.scenario.ties[0]
            print(f"{i}: {held.scenario.joint.formulation}, {held.control}: {what}: {numbers}; {tie}", flush=True)
    print(counts)
    return 0 if set(counts) <= {"inside", "refused"} else 1


if __name__ == "__main__":
    raise SystemExit(main())
