"""Runs of the stress matrix and their outcomes: right, near, stopped, refused or WRONG (see ``stress``).

A limit load is right if it is within its tolerance and, for a certified bracket, theory lies inside the bracket; an
indicator that misses by less than a factor of three is near.

A constant-rate test has no tolerance. Its certified bracket must contain theory at any rate (with an allowance for
moving geometry: the sliding distance over the short side of the block, squared). Without a bracket the result is the
steady load, which is right within ``AT_RATE`` of theory and near within ``PLATEAU``. At the rate ``SLOW`` and below,
the mean load over the second half of the travel must also be within ``PLATEAU`` of theory. Rates are in elastic slips
per critical time step.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
from stress_scenes import GRAVITY, A, B, H, N, by_judge, elastic_give, jack, pair

from dembrick.assembly import build as assemblies
from dembrick.errors import DembrickError, EnergyAuditError, NotConvergedError, ScenarioError
from dembrick.scenario.model import Load, Scenario
from dembrick.scenario.protocols import Protocol
from dembrick.simulation.energy_audit import Auditor
from dembrick.simulation.session import Session
from dembrick.simulation.statics import constant_rate, limit_load, load_system, ties
from dembrick.simulation.statics.elastic_factor import elastic_factor, touches_itself
from dembrick.simulation.statics.guards import new_guard, refuse_divergence
from dembrick.simulation.statics.recorder import Recorder
from dembrick.simulation.statics.rest.dead_load import dead_load_equilibrium
from dembrick.simulation.statics.state import initial_state, new_energy
from dembrick.simulation.statics.stepper import Loop
from dembrick.simulation.statics.stiffness import block_stiffness

STATUSES = ("right", "near", "stopped", "refused", "WRONG")
VALID_STEP = 0.9  # largest step factor of a valid cell
SLACK = 1e-9  # of V, by which theory may lie outside a certified bracket
AT_RATE = 1e-2  # of V, for the steady load of a constant-rate test
PLATEAU = 3e-2  # of V, for the mean load once a block slides
SLOW = 0.1  # elastic slips per critical time step: up to this rate the second half of a test is a plateau
TRAVEL = 20.0  # elastic slips of a constant-rate test
LEVEL = 1e-6  # of the weight above: N of a tower against statics
CREEP = 1e-12  # m, at rest


@dataclasses.dataclass
class Outcome:
    """Outcome of a cell; ``error``: relative deviation from the right result (at rest: absolute, m)."""

    status: str
    reason: str = ""
    error: float = math.nan
    overshoot: float = math.nan


def _named(error: DembrickError) -> str:
    return f"{type(error).__name__}: {error}"


def _audited(run: Callable) -> str:
    """Result of the energy audit of a run that gave a wrong answer."""
    chunks, terms = [], None
    try:
        terms = run(lambda rows, frames: chunks.append(rows["energy"])).energy
    except NotConvergedError:
        return "not converged when recorded"
    except DembrickError as error:
        return f"recorded: {type(error).__name__}"
    try:
        Auditor().add({key: np.concatenate([chunk[key] for chunk in chunks]) for key in chunks[0]}).result(terms)
    except EnergyAuditError:
        return "the audit would stop it"
    return "the audit passes it"


def _upper(point) -> float:
    """The upper bound, infinite if there is none."""
    return np.inf if point.V_upper is None else point.V_upper


def _wrong_by(point, expected: float, slack: float) -> float:
    """Distance of theory outside the bracket, relative to theory; below ``slack`` it counts as inside."""
    outside = max(point.V_lower / expected - 1.0, 1.0 - _upper(point) / expected)
    return outside if outside > slack else 0.0


def _told(point, expected: float) -> str:
    return (
        f"{point.bracket}: V = {point.V:.9g} in [{point.V_lower:.9g}, {_upper(point):.9g}] N, theory {expected:.9g} N"
    )


def judge_limit(run: Callable, expected: float, tolerance: float) -> Outcome:
    """Outcome of a limit load; ``run(observe)`` searches for it."""
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


def judge_rate(run: Callable, expected: float, slack: float, slow: bool, audited: bool = True) -> Outcome:
    """Outcome of a constant-rate test, recorded and ``audited`` as by the command line."""
    chunks = []
    try:
        result = run(lambda rows, frames: chunks.append(rows))
        if audited:
            energies = {k: np.concatenate([c["energy"][k] for c in chunks]) for k in chunks[0]["energy"]}
            Auditor().add(energies).result(result.energy)
    except DembrickError as error:
        return Outcome("stopped", _named(error))
    point = result.yield_point
    load = np.concatenate([chunk["load"] for chunk in chunks])
    driven = np.concatenate([chunk["displacement"] for chunk in chunks])
    plateau = float(load[driven >= 0.5 * driven[-1]].mean()) / expected - 1.0
    if point.bracket == "certified":
        error, outside = plateau, _wrong_by(point, expected, slack)
        status = "right" if outside == 0.0 and _upper(point) < 1e6 * expected else "WRONG"
    else:
        error = point.V / expected - 1.0
        outside = _wrong_by(point, expected, AT_RATE) if point.bracket == "indicator" else 0.0
        status = "right" if abs(error) <= AT_RATE else "near" if abs(error) <= PLATEAU else "WRONG"
        status = status if outside == 0.0 else "near" if outside <= PLATEAU and status != "WRONG" else "WRONG"
    if slow and not abs(plateau) <= PLATEAU:
        status = "WRONG"
    reason = f"{_told(point, expected)}; outside by {outside:.2g}, plateau off by {plateau:.2g}"
    return Outcome(status, reason, error, point.V_peak / expected - 1.0)


def push_to_limit(scenario: Scenario, expected: float | Callable, step_factor: float = VALID_STEP) -> Outcome:
    """Outcome of a search for a limit load; ``expected`` may be a function of the assembly."""
    try:
        built = assemblies.assemble(scenario)
    except ScenarioError as error:
        return Outcome("refused", _named(error))
    tolerance = scenario.control.tolerance
    value = expected(built) if callable(expected) else expected
    return judge_limit(lambda observe: limit_load.find_limit_load(built, tolerance, observe), value, tolerance)


def push_at_rate(
    scenario: Scenario, expected: Callable, pace: float, step_factor: float = VALID_STEP, travel: float = TRAVEL
) -> Outcome:
    """Outcome of a constant-rate test at ``pace`` elastic slips per critical time step; ``travel`` in elastic slips."""
    try:
        built = assemblies.assemble(scenario)
        value = expected(built)
        slip = value * elastic_give(built)
        critical = limit_load.plan(built, scenario.control, scenario.output).critical_time_step
    except ScenarioError as error:
        return Outcome("refused", _named(error))
    short = min(scenario.blocks[-1].box[:2])
    slack = SLACK + (travel * slip / short) ** 2
    return judge_rate(
        lambda observe: constant_rate.push_at_constant_rate(
            built, Protocol.one_way(travel * slip, pace * slip / critical), step_factor, observe
        ),
        value,
        slack,
        pace <= SLOW,
    )


def must_fall(scenario: Scenario, expected: Callable, pace: float, height: float) -> Outcome:
    """Outcome of pushing a stack higher than the critical ``height`` (m) of buckling: it must not give a load."""
    outcome = push_at_rate(scenario, expected, pace)
    if outcome.status == "stopped":
        return Outcome("right", outcome.reason)
    return Outcome("WRONG", f"it cannot stand higher than {height:.3g} m, and yet: {outcome.reason}")


# --- at rest


def at_rest(setup: load_system.Setup, rate: float = 0.0) -> Loop:
    """The time loop from the dead-load equilibrium, of a constant-rate test, or without jack if ``rate`` is zero."""
    built, state = setup.assembly, setup.state
    damping = setup.dashpots()
    dt = VALID_STEP * damping.critical_time_step
    drive = load_system.steady_drive(rate, dt, setup.actuator_stiffness)
    if rate == 0.0:
        drive = drive._replace(stiffness=0.0, dashpot=0.0)
    certificate = setup.certificate._replace(every=1 << 40, strict=False)
    state.joints.damping[:] = damping.joints / dt
    constant_rate.to_finite_motion(state)
    # with energy and record, to use the same kernel as a run
    moving, session = ties.start_moving(state, built), Session.of(None)
    record = Recorder(state, session, 2, rows_every=1 << 40, frames_every=1 << 20).record
    return Loop(
        dt, state, None, constant_rate.physical_inertia(built), drive._replace(viscous_n=1.0, viscous_s=1.0),
        certificate, new_energy(state), new_guard(built, state), moving, record,
    )  # fmt: skip


def rest(scenario: Scenario, steps: int) -> Outcome:
    """Outcome of creep under the dead loads alone: displacement between the first thousand steps and all ``steps``."""
    try:
        setup = load_system.Setup(assemblies.assemble(scenario), tolerance=0.0)
        loop = at_rest(setup)
        start, worst = None, 0.0
        while loop.step < steps:
            status = loop.advance(1000 if loop.step == 0 else min(100_000, steps - loop.step))
            refuse_divergence(status, setup.assembly, loop.state, loop.step, loop.dt, loop.dt / VALID_STEP)
            now = loop.state.blocks.displacement.copy()
            start = now if start is None else start
            worst = max(worst, float(np.abs(now - start).max()))
    except DembrickError as error:
        return Outcome("stopped", _named(error))
    if not worst < CREEP:
        return Outcome("WRONG", f"crept by {worst:.2g} m in {steps} steps", worst)
    return Outcome("right", f"crept by {worst:.2g} m", worst)


BESIDE = 50_000  # steps of the test of `undisturbed`


def undisturbed(formulation: str, steps: int = BESIDE) -> Outcome:
    """Whether a block loaded to a third of its limit stays bitwise the same when a block beside it is pushed beyond its
    own limit."""
    jacks, aside = jack(0.25 * A), 2.0 * A
    scenario = pair(formulation, jacks)
    limit = by_judge(assemblies.assemble(scenario))
    others = tuple(
        dataclasses.replace(b, name=f"other {b.name}", position=(b.position[0] + aside, *b.position[1:]))
        for b in scenario.blocks
    )
    held = (
        Load("other upper", (0.0, 0.0, -N), (aside, 0.0, H / 2)),
        Load("other upper", (0.0, limit / 3.0, 0.0), (aside + 0.25 * A, 0.0, 0.0)),
    )
    scenario = dataclasses.replace(scenario, blocks=scenario.blocks + others, loads=scenario.loads + held)
    ends = []
    try:
        for rate in (0.0, 1e-4):
            setup = load_system.Setup(assemblies.assemble(scenario), tolerance=0.0)
            loop = at_rest(setup, rate)
            status = loop.advance(steps)
            refuse_divergence(status, setup.assembly, loop.state, loop.step, loop.dt, loop.dt / VALID_STEP)
            ends.append(loop.state.blocks)
    except DembrickError as error:
        return Outcome("stopped", _named(error))
    b, pushed = (setup.assembly.names.index(name) for name in ("other upper", "upper"))
    moved = float(ends[1].displacement[pushed].max())
    same = all(
        getattr(ends[0], f)[b].tobytes() == getattr(ends[1], f)[b].tobytes()
        for f in ("displacement", "orientation", "velocity", "momentum", "force", "torque")
    )
    apart = float(np.abs(ends[1].displacement[b] - ends[0].displacement[b]).max())
    right = same and moved > 1e-5
    return Outcome("right" if right else "WRONG", f"moved by {apart:.2g} m, its neighbour by {moved:.2g} m", apart)


def standing(scenario: Scenario, densities) -> Outcome:
    """Outcome of a tower in dead-load equilibrium: N of every joint against the weight above it."""
    try:
        built = assemblies.assemble(scenario)
        state = initial_state(built)
        factor = elastic_factor(state, built.position) if touches_itself(state) else None
        dead_load_equilibrium(state, block_stiffness(state, shared=2.0), built, factor)
    except ScenarioError as error:
        return Outcome("refused", _named(error))
    except DembrickError as error:
        return Outcome("stopped", _named(error))
    weights = np.array(densities) * A * B * H * GRAVITY
    above = np.array([weights[max(j.block_a, j.block_b) - 1 :].sum() for j in built.joints])
    error = float(np.abs(state.joints.resultant[:, 0] / above - 1.0).max())
    shear = float(np.abs(state.joints.resultant[:, 1:3]).max() / above.max())
    worst = max(error, shear)
    return Outcome("right" if worst <= LEVEL else "WRONG", f"N off by {error:.2g}, V by {shear:.2g}", worst)
