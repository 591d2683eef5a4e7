"""Where the numerics break, and whether the program says so: a declared matrix of runs, each judged by theory.

    python tools/stress.py [--axes step mu ...] [--short] [--long] [--random 1000] [--seed 1] [--csv F] [--plot F]

Every cell is one run with one thing pushed far: the time step (0.1 to 2.5 of the critical one, the guard overridden),
stiffness and mass ratios of neighbours, slender joints, tall towers, friction, tolerance, load rate, size, a million
steps at rest, and random joints drawn from the seed. A cell ends as

right    theory (statics and limit analysis of the undeformed blocks, nothing of the run) is met: within the tolerance,
         and inside the bracket where that is certified
near     an indicator that misses its tolerance by less than a factor of three
stopped  no answer, with an error class as the reason
refused  the scenario is turned away before it runs; not a valid cell
WRONG    an answer, no error, and not the right one

The exit code is 1 if any cell is WRONG. Limit loads are searched for as a batch does, without the energy audit; where
one is wrong the audit is asked afterwards, and what it says is listed. Constant-rate tests are recorded and audited, as
the command line makes them; ``--unaudited`` leaves the audit out.

A constant-rate test has no tolerance. At any rate its certified bracket must hold theory (moving geometry is allowed
for by what the block has slid over its short side, squared); an indicator must hold it within ``AT_RATE``, and is only
near where it is wider than ``WIDE``. Where the rate is ``SLOW`` or less, the mean load over the second half of the
travel must be within ``PLATEAU`` of theory: point springs remember where they started for longer than the test goes on,
which costs a percent or two. Rates are in elastic slips per critical time step.
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import itertools
import math
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from dembrick import assembly as assemblies
from dembrick import judge, replay, theory
from dembrick.audit import audit
from dembrick.equilibrium import inverse_inertia, seat
from dembrick.errors import DembrickError, EnergyAuditError, NotConvergedError, ScenarioError
from dembrick.kernels.advance import RUNNING, Drive, advance
from dembrick.model import (
    FORMULATIONS,
    Actuator,
    Block,
    JointLaw,
    JointOverride,
    Load,
    Material,
    Scenario,
    YieldControl,
)
from dembrick.simulation import assembled_stiffness, block_stiffness, initial_state, load_vectors
from dembrick.stability import block_inertia, critical_time_step, greatest_frequency
from dembrick.state import Inertia

STATUSES = ("right", "near", "stopped", "refused", "WRONG")
VALID_STEP = 0.9  # largest step factor of a valid cell
SLACK = 1e-9  # of V, by which theory may lie outside a certified bracket
AT_RATE = 1e-2  # of V, for what a constant-rate test has no tolerance for
PLATEAU = 3e-2  # of V, for the mean load once a block slides
WIDE = 0.1  # of V, half-width at which the indicator of a constant-rate test says little
SLOW = 0.1  # elastic slips per critical time step: at this rate and below the second half of a test is a plateau
TRAVEL = 20.0  # elastic slips of a constant-rate test
SEATED = 1e-6  # of the weight above: N of a tower against statics
CREEP = 1e-12  # m, at rest
GRAVITY = 9.81
AUDITED = True  # constant-rate tests
A, B, H, N, MU, KN, KS_KN = 0.3, 0.2, 0.1, 467.0, 0.64, 1e10, 0.4


@dataclasses.dataclass
class Outcome:
    """What a cell gave: ``error`` is the relative (at rest: absolute, m) deviation from what is right."""

    status: str
    reason: str = ""
    error: float = math.nan
    overshoot: float = math.nan


@dataclasses.dataclass(frozen=True)
class Cell:
    """One run: the axis, where on it, which variant, and the judged run."""

    axis: str
    value: float
    variant: str
    run: Callable[[], Outcome]
    step_factor: float = VALID_STEP


# --- scenes


def jack(e_x: float, e_y: float = 0.0, angle: float = 0.5 * math.pi, z: float = 0.0):
    """One jack at (e_x, e_y, z) from the joint's centre, pushing at ``angle`` from t1 in its plane."""
    # cos(pi/2) is not 0: rounding must not make a load of its own
    direction = tuple(0.0 if abs(c) < 1e-15 else c for c in (math.cos(angle), math.sin(angle), 0.0))
    return (((e_x, e_y, z), direction, 1.0),)


def couple(arm: float):
    """Two jacks that twist the block and push it nowhere."""
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
    """Free blocks upon each other on a fixed base under their weight; jacks in the bottom joint of block ``pushed``.

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
    """Limit load of a stack: the weakest of the joints that hand the load down, each under the weight above it."""
    force = sum(w * np.array(d) for _, d, w in jacks)
    moment = sum(w * (p[0] * d[1] - p[1] * d[0]) for p, d, w in jacks)
    weights = np.array(densities) * A * B * H * GRAVITY
    answers = []
    for i in range(pushed + 1):
        joint = next(j for j in built.joints if {j.block_a, j.block_b} == {i, i + 1})
        points = built.contact_points[built.joints.index(joint)]
        if joint.law.formulation == "distributed":
            law = theory.point_formulation(points.normal_arm, points.area, MU)
        else:
            law = theory.rectangle_formulation(joint.law.formulation, A, B, MU)
        normal, height = float(weights[i:].sum()), (pushed - i) * H
        load = (float(force[0]), float(force[1]), float(moment))
        answers.append(theory.limit_load_at_height(law, normal, load, height=height).V)
    return min(answers)


# --- running and judging


def _named(error: DembrickError) -> str:
    return f"{type(error).__name__}: {error}"


def _audited(run: Callable) -> str:
    """What the energy audit says of a run that gave a wrong answer."""
    chunks, books = [], None
    try:
        books = run(lambda rows, frames: chunks.append(rows["energy"])).energy
    except NotConvergedError:
        return "not converged when recorded"
    except DembrickError as error:
        return f"recorded: {type(error).__name__}"
    try:
        audit({key: np.concatenate([chunk[key] for chunk in chunks]) for key in chunks[0]}, books)
    except EnergyAuditError:
        return "the audit would stop it"
    return "the audit passes it"


def _upper(point) -> float:
    """The upper bound, infinite where there is none."""
    return np.inf if point.V_upper is None else point.V_upper


def _wrong_by(point, expected: float, slack: float) -> float:
    """How far theory lies outside the bracket, relative to it; below ``slack`` it counts as inside."""
    outside = max(point.V_lower / expected - 1.0, 1.0 - _upper(point) / expected)
    return outside if outside > slack else 0.0


def _told(point, expected: float) -> str:
    return (
        f"{point.bracket}: V = {point.V:.9g} in [{point.V_lower:.9g}, {_upper(point):.9g}] N, theory {expected:.9g} N"
    )


def _judge_limit(run: Callable, expected: float, tolerance: float) -> Outcome:
    try:
        point = run(None).yield_point
    except DembrickError as error:
        return Outcome("stopped", _named(error))
    if expected == 0.0:
        status = "right" if point.V == point.V_upper == 0.0 else "WRONG"
        return Outcome(status, _told(point, expected), abs(point.V))
    error, certified = point.V / expected - 1.0, point.bracket == "certified"
    outside = _wrong_by(point, expected, SLACK) if certified else 0.0
    if abs(error) <= tolerance * (1.0 + 1e-9) and outside == 0.0:
        status = "right"
    elif abs(error) <= 3.0 * tolerance and not certified:
        status = "near"
    else:
        status = "WRONG"
    reason = f"{_told(point, expected)}; off by {abs(error):.2g}, {tolerance:g} allowed, outside by {outside:.2g}"
    return Outcome(status, f"{reason}; {_audited(run)}" if status == "WRONG" else reason, error)


def _judge_rate(run: Callable, expected: float, slack: float, slow: bool) -> Outcome:
    chunks = []
    try:
        result = run(lambda rows, frames: chunks.append(rows))
        if AUDITED:
            audit({k: np.concatenate([c["energy"][k] for c in chunks]) for k in chunks[0]["energy"]}, result.energy)
    except DembrickError as error:
        return Outcome("stopped", _named(error))
    point = result.yield_point
    certified = point.bracket == "certified"
    load = np.concatenate([chunk["load"] for chunk in chunks])
    driven = np.concatenate([chunk["displacement"] for chunk in chunks])
    plateau = float(load[driven >= 0.5 * driven[-1]].mean()) / expected - 1.0
    outside = _wrong_by(point, expected, slack if certified else AT_RATE)
    status, reason = "right", f"{_told(point, expected)}; outside by {outside:.2g}, plateau off by {plateau:.2g}"
    if not certified and point.half_width > WIDE * expected:
        status = "near"
    if not (outside == 0.0 if certified else outside <= 3.0 * AT_RATE):
        status = "WRONG"
    if not _upper(point) < 1e6 * expected:  # no bound at all: V is its middle
        status = "WRONG"
    if slow and not abs(plateau) <= PLATEAU:
        status = "WRONG"
    return Outcome(status, reason, plateau, point.V_peak / expected - 1.0)


def push_to_limit(scenario: Scenario, expected: float | Callable, step_factor: float = VALID_STEP) -> Outcome:
    """A limit load, judged within its tolerance; ``expected`` may be found from the assembly."""
    try:
        built = assemblies.build(scenario)
    except ScenarioError as error:
        return Outcome("refused", _named(error))
    tolerance = scenario.control.tolerance
    value = expected(built) if callable(expected) else expected
    return _judge_limit(
        lambda observe: replay.find_limit_load(built, tolerance, step_factor, observe), value, tolerance
    )


def push_at_rate(
    scenario: Scenario, expected: Callable, pace: float, step_factor: float = VALID_STEP, travel: float = TRAVEL
) -> Outcome:
    """A constant-rate test at ``pace`` elastic slips per critical time step over ``travel`` elastic slips."""
    try:
        built = assemblies.build(scenario)
        value = expected(built)
        slip = value * elastic_give(built)
        critical = replay.plan(built, scenario.control, 1.0).critical_time_step
    except ScenarioError as error:
        return Outcome("refused", _named(error))
    short = min(scenario.blocks[-1].box[:2])
    slack = SLACK + (travel * slip / short) ** 2
    return _judge_rate(
        lambda observe: replay.push_at_constant_rate(
            built, pace * slip / critical, travel * slip, step_factor, observe
        ),
        value,
        slack,
        pace <= SLOW,
    )


def elastic_give(built) -> float:
    """Driven displacement (m) for V = 1 while all joints are closed and nothing slips."""
    state = initial_state(built)
    load = load_vectors(state)[state.blocks.free].ravel()
    return float(load @ np.linalg.solve(assembled_stiffness(state), load) / np.abs(state.jacks.weight).sum())


def by_judge(built) -> float:
    """Theory of a single joint."""
    return judge.theory_of(built).V


# --- at rest


def rest(scenario: Scenario, steps: int, physical: bool) -> Outcome:
    """Creep under the dead loads alone: displacement after ``steps`` against that after the first thousand."""
    try:
        built = assemblies.build(scenario)
        state = initial_state(built)
        stiffness = block_stiffness(state, shared=2.0)
        seat(state, stiffness)
    except DembrickError as error:
        return Outcome("stopped", _named(error))
    viscous = replay.VISCOUS
    if physical:
        alone = block_stiffness(state, shared=1.0)
        dt = VALID_STEP * critical_time_step(greatest_frequency(state, block_inertia(built), alone), viscous)
        replay._to_finite_motion(state)
        scaled = None
        inertia = Inertia(np.array(built.mass, float), np.array(built.inertia, float), np.linalg.inv(built.inertia))
    else:
        dt, inertia = 1.0, None
        scaled = inverse_inertia(state, stiffness / (VALID_STEP * critical_time_step(1.0, viscous)) ** 2)
    certificate = replay.certificate(state, np.zeros((len(built.names), 6)) + 1.0, 1.0, 0.0)
    certificate = certificate._replace(every=1 << 40, strict=False)
    # no jack: head and springs at nought, only the contacts' dashpots are there
    still = dict.fromkeys(Drive._fields, 0.0) | {"ramp": dt, "steady": 0, "longest": replay.LONGEST_MOVE * H}
    drive = Drive(**still | {"viscous_n": viscous, "viscous_s": viscous})
    done = 0
    start, worst = None, 0.0
    while done < steps:
        n = 1000 if done == 0 else min(100_000, steps - done)
        status, done = advance(done, n, dt, *state, scaled, inertia, drive, certificate, None, None)
        if status != RUNNING:
            return Outcome("stopped", f"DivergedError: a block at rest moved away at step {done}")
        now = state.blocks.displacement.copy()
        start = now if start is None else start
        worst = max(worst, float(np.abs(now - start).max()))
    if not worst < CREEP:
        return Outcome("WRONG", f"crept by {worst:.2g} m in {steps} steps", worst)
    return Outcome("right", "", worst)


def undisturbed(formulation: str) -> Outcome:
    """A block held at a third of its limit beside one that is pushed over its own: how far the first one moves."""
    jacks, aside = jack(0.25 * A), 2.0 * A
    scenario = pair(formulation, jacks)
    limit = by_judge(assemblies.build(scenario))
    others = tuple(
        dataclasses.replace(b, name=f"other {b.name}", position=(b.position[0] + aside, *b.position[1:]))
        for b in scenario.blocks
    )
    held = (
        Load("other upper", (0.0, 0.0, -N), (aside, 0.0, H / 2)),
        Load("other upper", (0.0, limit / 3.0, 0.0), (aside + 0.25 * A, 0.0, 0.0)),
    )
    scenario = dataclasses.replace(scenario, blocks=scenario.blocks + others, loads=scenario.loads + held)
    try:
        built = assemblies.build(scenario)
        state = initial_state(built)
        seat(state, block_stiffness(state, shared=2.0))
        end = replay.push_at_constant_rate(built, 1e-4, 1e-4, VALID_STEP).state
    except DembrickError as error:
        return Outcome("stopped", _named(error))
    b = built.names.index("other upper")
    moved = float(np.abs(end.blocks.displacement[b] - state.blocks.displacement[b]).max())
    pushed = float(end.blocks.displacement[built.names.index("upper")].max())
    right = moved < CREEP and pushed > 1e-5
    return Outcome("right" if right else "WRONG", f"moved by {moved:.2g} m, its neighbour by {pushed:.2g} m", moved)


def rest_scene(formulation: str, kind: str) -> Scenario:
    """Dead tangential load at 0.98 of its limit: in the middle of the joint, or at a quarter of its length."""
    jacks = jack(0.25 * A if kind == "eccentric" else 0.0)
    limit = by_judge(assemblies.build(pair(formulation, jacks)))
    scenario = pair(formulation, jacks)
    point, direction, _ = jacks[0]
    load = Load("upper", tuple(0.98 * limit * d for d in direction), point)
    return dataclasses.replace(scenario, loads=(*scenario.loads, load))


def seated(scenario: Scenario, densities) -> Outcome:
    """N of every joint of a tower after seating against the weight above it."""
    try:
        built = assemblies.build(scenario)
        state = initial_state(built)
        seat(state, block_stiffness(state, shared=2.0))
    except ScenarioError as error:
        return Outcome("refused", _named(error))
    except DembrickError as error:
        return Outcome("stopped", _named(error))
    weights = np.array(densities) * A * B * H * GRAVITY
    above = np.array([weights[max(j.block_a, j.block_b) - 1 :].sum() for j in built.joints])
    error = float(np.abs(state.joints.resultant[:, 0] / above - 1.0).max())
    shear = float(np.abs(state.joints.resultant[:, 1:3]).max() / above.max())
    worst = max(error, shear)
    return Outcome("right" if worst <= SEATED else "WRONG", f"N off by {error:.2g}, V by {shear:.2g}", worst)


# --- the matrix


def lab_jacks(z: float = 0.0) -> dict:
    """The loads that most axes use."""
    return {"couple": couple(0.45 * A), "eccentric": jack(0.25 * A, z=z), "shear": jack(0.0, z=z)}


def step_cells(short: bool) -> Iterator[Cell]:
    """Time step over the critical one; above VALID_STEP only an error or the right answer will do."""
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
        densities = (1500.0,) * 3
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
    """Upper over lower: stiffness of the joints, or mass of the blocks, of two free blocks on a base."""
    exponents = (-decades, 0, decades) if short else range(-decades, decades + 1)
    for exponent, formulation, pushed in itertools.product(exponents, FORMULATIONS, (0, 1)):
        half = 10.0 ** (0.5 * exponent)
        stiffness, densities = (KN, KN), (1500.0, 1500.0)
        if axis == "stiffness":
            stiffness = (KN / half, KN * half)
        else:
            densities = (1500.0 / half, 1500.0 * half)
        jacks = jack(0.2 * A)
        scenario = stack(formulation, densities, stiffness, pushed, jacks)
        name = f"{formulation} pushed {'below' if pushed == 0 else 'on top'}"
        kinds = "l" if short and formulation != "concave" else "lr"
        pace = 0.01 / 10.0 ** (0.5 * abs(exponent))  # slow for the slow swing of the heavy block or the soft joint
        yield from _stack_cells(axis, 10.0**exponent, name, scenario, densities, pushed, jacks, pace=pace, kinds=kinds)


def slenderness_cells(short: bool) -> Iterator[Cell]:
    """Long side over short side, the length along x or along y, the load in and out of the middle."""
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


def tower_cells(short: bool) -> Iterator[Cell]:
    """Towers: N of every joint by seating, the limit load of the lowest joint by search and at constant rate."""
    for count in (2, 20) if short else (2, 5, 10, 20, 50, 100, 200):
        for formulation in ("concave", "convex", "corrected-shear"):
            densities = (1500.0,) * count
            jacks = jack(0.2 * A)
            scenario = stack(formulation, densities, (KN,) * count, 0, jacks, tolerance=1e-2)
            yield Cell(
                "tower", count, f"seat {formulation}", lambda s=scenario, d=densities: seated(s, d)
            )  # fmt: skip
            # a wave goes up the tower and back within a few times as many steps as there are blocks
            pace = 0.01 / count
            kinds = "l" if short and count > 2 else "lr"
            yield from _stack_cells("tower", count, formulation, scenario, densities, 0, jacks, pace=pace, kinds=kinds)


def friction_cells(short: bool) -> Iterator[Cell]:
    """Friction coefficient, the load in the joint plane and above it, where high friction makes blocks rock."""
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
    """Tolerance of a limit load; the points of `distributed` follow it."""
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
            # at ten slips a step twenty slips would be two steps
            travel = TRAVEL * max(1.0, 10.0**exponent)
            yield Cell(
                "rate",
                10.0**exponent,
                f"rate {formulation} {load}",
                lambda s=scenario, p=10.0**exponent, t=travel: push_at_rate(s, by_judge, p, travel=t),
            )


def size_cells(short: bool) -> Iterator[Cell]:
    """Size of the blocks, weights and forces growing with the volume."""
    for exponent, formulation in itertools.product((-3, 3) if short else range(-3, 4), FORMULATIONS):
        size = 10.0**exponent
        for load, jacks in {"couple": couple(0.45 * A * size), "eccentric": jack(0.25 * A * size)}.items():
            scenario = pair(formulation, jacks, A * size, B * size, H * size, normal=N * size**3)
            name = f"{formulation} {load}"
            yield Cell("size", size, f"limit {name}", lambda s=scenario: push_to_limit(s, by_judge))
            if not short:
                yield Cell("size", size, f"rate {name}", lambda s=scenario: push_at_rate(s, by_judge, 0.003))


def rest_cells(steps: int, short: bool) -> Iterator[Cell]:
    """A dead load at 0.98 of its limit, for a long time."""
    for formulation in ("concave", "convex") if short else FORMULATIONS[:4]:
        yield Cell("rest", 1.0, f"{formulation} beside a test", lambda f=formulation: undisturbed(f))
        for kind, physical in itertools.product(("middle", "eccentric"), (True, False)):
            yield Cell(
                "rest",
                float(steps),
                f"{formulation} {kind} {'finite motion' if physical else 'small motion'}",
                lambda f=formulation, k=kind, p=physical: rest(rest_scene(f, k), steps, p),
            )


def random_cells(count: int, seed: int) -> Iterator[Cell]:
    """Joints drawn at random: shape, size, stiffness, friction, load, its height, a dead load, step and tolerance."""
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
        name = f"{formulation}{' above' if z else ''}{' dead' if dead else ''} {tolerance:g}"
        yield Cell(
            "random", float(i), f"limit {name}", lambda s=scenario, f=factor: push_to_limit(s, by_judge, f), factor
        )


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
        "rest": lambda: rest_cells(rest_steps, short),
        "random": lambda: random_cells(random, seed),
    }
    for axis in axes:
        yield from makers[axis]()


# --- tables and map


def run_all(chosen, progress: Callable[[str], None] | None = None) -> list[tuple[Cell, Outcome]]:
    """Run the cells one after the other."""
    results, axis, began = [], None, 0.0
    for cell in chosen:
        if progress and cell.axis != axis:
            if axis is not None:
                progress(f"{axis}: {time.perf_counter() - began:.1f} s")
            axis, began = cell.axis, time.perf_counter()
        results.append((cell, cell.run()))
    if progress and axis is not None:
        progress(f"{axis}: {time.perf_counter() - began:.1f} s")
    return results


def share_right(results) -> tuple[int, int]:
    """Right cells and all of the valid ones with a step factor up to VALID_STEP."""
    valid = [o for c, o in results if c.step_factor <= VALID_STEP and o.status != "refused"]
    return sum(o.status == "right" for o in valid), len(valid)


def report(results) -> str:
    """Counts by axis, overshoot by rate, and every cell that is not right with its reason."""
    lines = [f"{'axis':<12}" + "".join(f"{s:>9}" for s in STATUSES)]
    for axis in [*dict.fromkeys(c.axis for c, _ in results), "all"]:
        count = Counter(o.status for c, o in results if axis in (c.axis, "all"))
        lines.append(f"{axis:<12}" + "".join(f"{count[s]:>9}" for s in STATUSES))
    rates = sorted({c.value for c, _ in results if c.axis == "rate"})
    if rates:
        lines += ["", "overshoot of V_peak by rate (elastic slips per critical time step), least and most:"]
    for rate in rates:
        seen = [o.overshoot for c, o in results if c.axis == "rate" and c.value == rate and math.isfinite(o.overshoot)]
        lines.append(f"  {rate:<8g}" + (f"{min(seen):>12.3g}{max(seen):>12.3g}" if seen else "  no answer"))
    lines.append("")
    for cell, outcome in results:
        if outcome.status != "right":
            lines.append(f"{outcome.status:<8} {cell.axis} {cell.value:g} (step {cell.step_factor:.3g}) {cell.variant}")
            lines.append(f"         {outcome.reason}")
    good, valid = share_right(results)
    if valid:
        lines.append(f"right: {good} of {valid} valid cells with a step factor up to {VALID_STEP} ({good / valid:.2%})")
    lines.append(f"WRONG: {sum(o.status == 'WRONG' for _, o in results)}")
    return "\n".join(lines)


def write_csv(path: Path, results) -> None:
    """One line a cell."""
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["axis", "value", "step_factor", "variant", "status", "error", "overshoot", "reason"])
        for c, o in results:
            writer.writerow([c.axis, c.value, c.step_factor, c.variant, o.status, o.error, o.overshoot, o.reason])


def draw_map(path: Path, results) -> None:
    """A row of stacked bars an axis: how the cells at each value ended."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    colours = dict(zip(STATUSES, ("#4c9f70", "#e3c567", "#7a8ca5", "#d0d0d0", "#c0392b"), strict=True))
    axes = list(dict.fromkeys(c.axis for c, _ in results))
    figure, plots = plt.subplots(len(axes), 1, figsize=(9.0, 1.3 * len(axes)), layout="constrained", squeeze=False)
    for axis, plot in zip(axes, plots[:, 0], strict=True):
        mine = [(c, o) for c, o in results if c.axis == axis]
        # random scenes have no order: one bar by formulation
        keys = [c.variant.split()[1] if axis == "random" else f"{c.value:g}" for c, _ in mine]
        labels = list(dict.fromkeys(keys))
        left = np.zeros(len(labels))
        for status in STATUSES:
            count = Counter(k for k, (_, o) in zip(keys, mine, strict=True) if o.status == status)
            height = np.array([count[k] for k in labels], float)
            plot.bar(labels, height, bottom=left, color=colours[status], width=0.9, label=status)
            left += height
        plot.set_ylabel(axis, rotation=0, ha="right", va="center")
        plot.set_yticks([])
        plot.tick_params(axis="x", labelsize=7)
        for side in ("top", "right", "left"):
            plot.spines[side].set_visible(False)
    figure.legend(*plots[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=len(STATUSES))
    figure.savefig(path, dpi=150)
    plt.close(figure)


def main(arguments=None) -> int:
    """Run the matrix from the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--axes", nargs="+", choices=AXES, default=AXES)
    parser.add_argument("--short", action="store_true", help="only the ends of every axis")
    parser.add_argument("--long", action="store_true", help="ten million steps at rest in place of a million")
    parser.add_argument("--unaudited", action="store_true", help="constant-rate tests without the energy audit")
    parser.add_argument("--random", type=int, default=1000, help="number of random scenes")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--csv", type=Path)
    parser.add_argument("--plot", type=Path)
    options = parser.parse_args(arguments)
    global AUDITED
    AUDITED = not options.unaudited
    rest_steps = 10_000_000 if options.long else 20_000 if options.short else 1_000_000
    chosen = cells(options.axes, options.short, rest_steps, options.random, options.seed)
    results = run_all(chosen, progress=lambda line: print(line, file=sys.stderr, flush=True))
    print(report(results))
    if options.csv:
        write_csv(options.csv, results)
    if options.plot:
        draw_map(options.plot, results)
    return 1 if any(o.status == "WRONG" for _, o in results) else 0


if __name__ == "__main__":
    sys.exit(main())
