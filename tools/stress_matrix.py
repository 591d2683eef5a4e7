"""The cells of the stress matrix, axis by axis."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from stress_judge import (
    BESIDE,
    TRAVEL,
    VALID_STEP,
    Outcome,
    must_fall,
    push_at_rate,
    push_to_limit,
    rest,
    standing,
    undisturbed,
)
from stress_scenes import (
    GRAVITY,
    KN,
    A,
    B,
    H,
    N,
    by_judge,
    couple,
    jack,
    lab_jacks,
    pair,
    rest_scene,
    stack,
    stack_theory,
)

from dembrick.scenario.model import FORMULATIONS

DENSITY = 1500.0


@dataclasses.dataclass(frozen=True)
class Cell:
    """One run: the axis, the value on it, the variant, and the function that runs and judges it."""

    axis: str
    value: float
    variant: str
    run: Callable[[], Outcome]
    step_factor: float = VALID_STEP


def step_cells(short: bool) -> Iterator[Cell]:
    """Time step over the critical one; above VALID_STEP only an error or the right answer is acceptable."""
    factors = (0.1, 0.9, 1.1, 2.5) if short else (0.1, 0.25, 0.5, 0.75, 0.9, 0.99, 1.01, 1.1, 1.25, 1.5, 1.75, 2.0, 2.5)
    for factor, formulation in itertools.product(factors, FORMULATIONS):
        for z, load in itertools.product((0.0, H / 2), lab_jacks()):
            if z and load == "couple":
                continue
            scenario = pair(formulation, lab_jacks(z)[load])
            name = f"{formulation} {load}{' above' if z else ''}"
            yield Cell(
                "step", factor, f"limit {name}", lambda s=scenario, f=factor: push_to_limit(s, by_judge, f), factor
            )
            if z == 0.0:
                yield Cell(
                    "step",
                    factor,
                    f"rate {name}",
                    lambda s=scenario, f=factor: push_at_rate(s, by_judge, 0.003, f),
                    factor,
                )
        densities = (DENSITY,) * 3
        jacks = jack(0.1 * A)
        scenario = stack(formulation, densities, (KN,) * 3, 1, jacks)
        yield from _stack_cells("step", factor, f"{formulation} 3 blocks", scenario, densities, 1, jacks, factor)


def _stack_cells(axis, value, name, scenario, densities, pushed, jacks, factor=VALID_STEP, pace=0.01, kinds="lr"):
    def expected(built):
        return stack_theory(built, densities, pushed, jacks)

    if "l" in kinds:
        yield Cell(axis, value, f"limit {name}", lambda: push_to_limit(scenario, expected, factor), factor)
    if "r" in kinds:
        yield Cell(axis, value, f"rate {name}", lambda: push_at_rate(scenario, expected, pace, factor), factor)


def ratio_cells(axis: str, decades: int, short: bool) -> Iterator[Cell]:
    """Ratio of upper to lower joint stiffness, or of upper to lower block mass, of two free blocks on a base."""
    exponents = (-decades, 0, decades) if short else range(-decades, decades + 1)
    for exponent, formulation, pushed in itertools.product(exponents, FORMULATIONS, (0, 1)):
        half = 10.0 ** (0.5 * exponent)
        stiffness, densities = (KN, KN), (DENSITY, DENSITY)
        if axis == "stiffness":
            stiffness = (KN / half, KN * half)
        else:
            densities = (DENSITY / half, DENSITY * half)
        jacks = jack(0.2 * A)
        scenario = stack(formulation, densities, stiffness, pushed, jacks)
        name = f"{formulation} pushed {'below' if pushed == 0 else 'on top'}"
        kinds = "l" if short and formulation != "concave" else "lr"
        pace = 0.01 / 10.0 ** (0.5 * abs(exponent))  # slow, since the heavy block or the soft joint has a low frequency
        yield from _stack_cells(axis, 10.0**exponent, name, scenario, densities, pushed, jacks, pace=pace, kinds=kinds)


def slenderness_cells(short: bool) -> Iterator[Cell]:
    """Long side over short side, with the length along x or y, and the load centred or eccentric."""
    for ratio, formulation, along in itertools.product(
        (100.0,) if short else (1.0, 3.0, 10.0, 30.0, 100.0), FORMULATIONS, "xy"
    ):
        a, b = (0.02 * ratio, 0.02) if along == "x" else (0.02, 0.02 * ratio)
        for load, jacks in {
            "couple": couple(0.4 * a),
            "eccentric": jack(0.3 * a, 0.1 * b, 1.0),
            "along": jack(0.0, 0.3 * b, 0.0),
        }.items():
            scenario = pair(formulation, jacks, a=a, b=b, height=0.02, normal=10.0 * ratio, points=(8, 8))
            name = f"{formulation} {load} long {along}"
            yield Cell("slenderness", ratio, f"limit {name}", lambda s=scenario: push_to_limit(s, by_judge))
            if not short:
                yield Cell("slenderness", ratio, f"rate {name}", lambda s=scenario: push_at_rate(s, by_judge, 0.003))


def critical_height(kn: float) -> float:
    """Height (m) at which a stack of convex joints buckles under its own weight (Greenhill).

    A column of bending stiffness kn I_1 H: each joint is a rotational spring kn I_1 over a block's height.
    """
    return (7.8373 * kn * (A * B**3 / 12.0) * H / (DENSITY * A * B * GRAVITY)) ** (1.0 / 3.0)


def tower_cells(short: bool) -> Iterator[Cell]:
    """Towers: N of every joint under dead load, and the limit load of the lowest joint by search and at constant rate.

    With the joints of the others the highest tower would buckle in finite motion, so its joints are ten times as stiff;
    a cell of its own checks this buckling.
    """
    for count in (2, 20) if short else (2, 5, 10, 20, 50, 100, 200):
        kn = KN if count * H < 0.9 * critical_height(KN) else 10.0 * KN
        for formulation in ("concave", "convex", "corrected-shear"):
            densities = (DENSITY,) * count
            jacks = jack(0.2 * A)
            scenario = stack(formulation, densities, (kn,) * count, 0, jacks, tolerance=1e-2)
            yield Cell(
                "tower", count, f"rest {formulation}", lambda s=scenario, d=densities: standing(s, d)
            )  # fmt: skip
            # a wave travels up the tower and back in a few steps per block
            pace = 0.01 / count
            kinds = "l" if short and count > 2 else "lr"
            yield from _stack_cells("tower", count, formulation, scenario, densities, 0, jacks, pace=pace, kinds=kinds)
        if kn != KN:
            yield from buckling_cells(count)


def buckling_cells(count: int) -> Iterator[Cell]:
    """A tower that is too high for the stiffness of its joints, pushed at constant rate: it must fall."""
    densities, jacks = (DENSITY,) * count, jack(0.2 * A)
    scenario = stack("convex", densities, (KN,) * count, 0, jacks)

    def run():
        return must_fall(
            scenario, lambda built: stack_theory(built, densities, 0, jacks), 0.01 / count, critical_height(KN)
        )

    yield Cell("tower", count, "buckles convex", run)


def friction_cells(short: bool) -> Iterator[Cell]:
    """Friction coefficient, with the load in the joint plane and above it, where blocks rock if friction is high."""
    for mu, formulation in itertools.product(
        (0.0, 10.0) if short else (0.0, 1e-3, 0.01, 0.1, 0.3, 1.0, 2.0, 3.0, 10.0), FORMULATIONS
    ):
        for z, load in itertools.product((0.0, H / 2) if short else (0.0, H / 2, H), ("couple", "eccentric", "shear")):
            if z and load == "couple":
                continue
            scenario = pair(formulation, lab_jacks(z)[load], friction=mu)
            name = f"{formulation} {load}{' on top' if z == H else ' above' if z else ''}"
            yield Cell("friction", mu, f"limit {name}", lambda s=scenario: push_to_limit(s, by_judge))


def tolerance_cells(short: bool) -> Iterator[Cell]:
    """Tolerance of a limit load; it sets the number of points of `distributed`."""
    for exponent, formulation in itertools.product((2, 6) if short else (2, 3, 4, 5, 6), FORMULATIONS):
        for z, load in itertools.product((0.0, H / 2), ("couple", "eccentric", "shear")):
            if z and load == "couple":
                continue
            scenario = pair(
                formulation, lab_jacks(z)[load], tolerance=10.0**-exponent, points=(12, 12) if short else None
            )
            name = f"{formulation} {load}{' above' if z else ''}"
            yield Cell("tolerance", 10.0**-exponent, f"limit {name}", lambda s=scenario: push_to_limit(s, by_judge))


def rate_cells(short: bool) -> Iterator[Cell]:
    """Load rate, in elastic slips per critical time step."""
    for exponent, formulation in itertools.product((-2, 0) if short else (-5, -4, -3, -2, -1, 0, 1), FORMULATIONS):
        for load, jacks in lab_jacks().items():
            scenario = pair(formulation, jacks, points=(8, 6))
            # at ten slips per step, twenty slips would be only two steps
            travel = TRAVEL * max(1.0, 10.0**exponent)
            yield Cell(
                "rate",
                10.0**exponent,
                f"rate {formulation} {load}",
                lambda s=scenario, p=10.0**exponent, t=travel: push_at_rate(s, by_judge, p, travel=t),
            )


def size_cells(short: bool) -> Iterator[Cell]:
    """Size of the blocks; weights and forces grow with the volume."""
    for exponent, formulation in itertools.product((-3, 3) if short else range(-3, 4), FORMULATIONS):
        size = 10.0**exponent
        for load, jacks in {"couple": couple(0.45 * A * size), "eccentric": jack(0.25 * A * size)}.items():
            scenario = pair(formulation, jacks, A * size, B * size, H * size, normal=N * size**3)
            name = f"{formulation} {load}"
            yield Cell("size", size, f"limit {name}", lambda s=scenario: push_to_limit(s, by_judge))
            if not short:
                yield Cell("size", size, f"rate {name}", lambda s=scenario: push_at_rate(s, by_judge, 0.003))


def rest_cells(steps: int) -> Iterator[Cell]:
    """A dead load at 0.98 of its limit, for a long time."""
    for formulation in FORMULATIONS[:4]:
        yield Cell("rest", BESIDE, f"{formulation} beside a test", partial(undisturbed, formulation))
        for kind in ("middle", "eccentric"):
            yield Cell(
                "rest",
                float(steps),
                f"{formulation} {kind}",
                lambda f=formulation, k=kind: rest(rest_scene(f, k), steps),
            )


def random_cells(count: int, seed: int) -> Iterator[Cell]:
    """Random joints: shape, size, stiffness, friction, load and its height, a dead load, time step and tolerance.

    Every fifth is pushed at constant rate; for the others the limit is searched.
    """
    for i in range(count):
        draw = np.random.default_rng((seed, i))
        u = draw.random(16)
        formulation = FORMULATIONS[int(draw.integers(len(FORMULATIONS)))]
        short = 10.0 ** (3.0 * u[0] - 3.0)
        a, b = (short, short * 10.0 ** u[1]) if u[2] < 0.5 else (short * 10.0 ** u[1], short)
        normal, friction, ratio = 10.0 ** (6.0 * u[3]), 0.05 * 40.0 ** u[4], 10.0 ** (2.0 * u[5] - 2.0)
        height = short * (0.2 + 0.8 * u[6])
        least = normal * max(1.0, friction / ratio) / (a * b * short * 1e-5)
        z = height * u[7] if u[8] < 0.3 else 0.0
        angle, dead_angle = 2.0 * math.pi * u[9], 2.0 * math.pi * u[10]
        dead = 0.6 * friction * normal * u[11] if u[12] < 0.2 else 0.0
        e = ((u[13] - 0.5) * a, (u[14] - 0.5) * b)
        tolerance = 10.0 ** -float(draw.integers(2, 6))
        factor = VALID_STEP if u[15] < 0.5 else 0.1 + 1.6 * (u[15] - 0.5)
        scenario = pair(
            formulation,
            jack(*e, angle, z),
            a=a,
            b=b,
            height=height,
            friction=friction,
            normal=normal,
            ratio=ratio,
            kn=least * 10.0 ** float(draw.uniform(0.0, 5.0)),
            dead=(dead * math.cos(dead_angle), dead * math.sin(dead_angle)),
            tolerance=tolerance,
            points=(6, 5),
        )
        name = f"{formulation}{' above' if z else ''}{' dead' if dead else ''}"
        if i % 5 == 4:
            run = partial(push_at_rate, scenario, by_judge, 0.003, factor)
            yield Cell("random", float(i), f"rate {name}", run, factor)
        else:
            run = partial(push_to_limit, scenario, by_judge, factor)
            yield Cell("random", float(i), f"limit {name} {tolerance:g}", run, factor)


AXES = ("step", "stiffness", "mass", "slenderness", "tower", "friction", "tolerance", "rate", "size", "rest", "random")


def cells(axes=AXES, short=False, rest_steps=1_000_000, random=1000, seed=1) -> Iterator[Cell]:
    """The matrix, or the part of it on ``axes``; ``short`` keeps the ends of every axis."""
    makers = {
        "step": lambda: step_cells(short),
        "stiffness": lambda: ratio_cells("stiffness", 3, short),
        "mass": lambda: ratio_cells("mass", 4, short),
        "slenderness": lambda: slenderness_cells(short),
        "tower": lambda: tower_cells(short),
        "friction": lambda: friction_cells(short),
        "tolerance": lambda: tolerance_cells(short),
        "rate": lambda: rate_cells(short),
        "size": lambda: size_cells(short),
        "rest": lambda: rest_cells(rest_steps),
        "random": lambda: random_cells(random, seed),
    }
    for axis in axes:
        yield from makers[axis]()
