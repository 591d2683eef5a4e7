"""Drivers of the regimes of control: a driver plans a run, executes it, and makes its result.

A control names its regime (`scenario.controls`), and `driver_of` returns the driver registered for it here.
Modules for motion in real time are imported only when a run needs them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple, cast

from dembrick.assembly import build
from dembrick.assembly.build import Assembly
from dembrick.errors import NotConvergedError, ScenarioError
from dembrick.runs import theory_check
from dembrick.runs.collapse import collapse_of
from dembrick.runs.outcomes.load_path_result import LoadPathResult
from dembrick.runs.outcomes.motion_result import MotionResult
from dembrick.runs.outcomes.result import Result
from dembrick.runs.outcomes.statics_result import StaticsResult
from dembrick.runs.path_dependence import beside_limit, cut_at_bound, has_paths, other_paths
from dembrick.scenario.checks import present
from dembrick.scenario.controls import Control, DisplacementControl, YieldControl
from dembrick.scenario.model import Scenario
from dembrick.scenario.protocols import protocol_of
from dembrick.scenario.regimes import (
    COLLAPSE,
    CONSTANT_RATE,
    DEAD_LOAD,
    DEFORMED_REST,
    DRIVEN_PATH,
    LIMIT_LOAD,
    LOAD_PATH,
    PATH_FOLLOWING,
    REAL_TIME,
    SETTLEMENT,
)
from dembrick.simulation.expected_cost import LONG, WITHIN, longest_search, newton_seconds, newton_steps
from dembrick.simulation.interrupts import Interrupted
from dembrick.simulation.session import Plan, Session
from dembrick.simulation.statics import constant_rate, custom_limit, limit_load
from dembrick.simulation.statics.handover import moved_before
from dembrick.simulation.statics.load_system import Replay
from dembrick.simulation.statics.rest import dead_load
from dembrick.simulation.statics.state import State
from dembrick.simulation.statics.tilting_table import on_table

if TYPE_CHECKING:
    from dembrick.simulation.dynamics.integrator import Motion
    from dembrick.simulation.dynamics.loads import Driving
    from dembrick.simulation.dynamics.run import EquilibriaRun, MotionRun
    from dembrick.simulation.statics.yield_point import YieldPoint


SECONDS_OF_CHECK = 10.0  # s that limit analysis may take to estimate the cost of a run


class Driver(NamedTuple):
    """Functions that execute a regime.

    ``plan`` estimates the cost of a run without executing it; ``run`` executes it within a session; ``result`` makes
    its result from the fields of a `RunResult`; ``refined`` gives the answer of a refined scenario for an error
    estimate, if an ordinary run does not. ``place`` places the contact points for a run, and returns the seconds that
    took.
    """

    plan: Callable[[Scenario, Assembly], Plan]
    run: Callable[[Scenario, Assembly, Session], Replay | MotionRun | dead_load.Standing]
    result: Callable[..., Result | MotionResult | StaticsResult]
    refined: Callable[..., Any] | None = None
    place: Callable[[Scenario, Assembly], tuple[Assembly, float]] = lambda _, assembly: (assembly, 0.0)


def driver_of(control: Control) -> Driver:
    """The driver registered for the regime of a control."""
    return DRIVERS[control.regime.name]


# --- limit loads and constant-rate tests


def _tolerance(scenario: Scenario) -> float:
    assert isinstance(scenario.control, YieldControl)
    return scenario.control.tolerance


def _place_points(scenario: Scenario, assembly: Assembly) -> tuple[Assembly, float]:
    """Place the points of a lone distributed joint to suit its limit load; with stages they stay the same in all.
    Raises Interrupted."""
    if assembly.custom_law is not None or scenario.stages:
        return assembly, 0.0
    try:
        return limit_load.place_points(assembly, _tolerance(scenario))
    except Interrupted as error:
        raise Interrupted(error.signum, "interrupted while the contact points were placed, before the run") from None


def _limit_load(scenario: Scenario, assembly: Assembly, session: Session | None, steps: float = 1.0) -> Replay:
    if assembly.custom_law is not None:
        return custom_limit.find_peak(assembly, _tolerance(scenario), scenario.solver.step_factor, session)
    return limit_load.find_limit_load(assembly, _tolerance(scenario), session, steps=steps)


def _constant_rate(scenario: Scenario, assembly: Assembly, session: Session) -> Replay:
    control = scenario.control
    assert isinstance(control, DisplacementControl)
    protocol = protocol_of(scenario)
    plan = constant_rate.plan(assembly, control, protocol, scenario.solver.step_factor, scenario.output)
    session.warn_if_long(present(plan.seconds), "raise control.rate or shorten control.travel")
    return constant_rate.push_at_constant_rate(assembly, protocol, scenario.solver.step_factor, session)


def _plan_rate(scenario: Scenario, assembly: Assembly) -> Plan:
    control = scenario.control
    assert isinstance(control, DisplacementControl)
    return constant_rate.plan(assembly, control, protocol_of(scenario), scenario.solver.step_factor, scenario.output)


def _plan_search(scenario: Scenario, assembly: Assembly) -> Plan:
    """Plan of a search by the joints that slide in the mechanism of limit analysis if that takes only seconds."""
    from dembrick.runs import limit

    plan = limit_load.plan(assembly, cast(YieldControl, scenario.control), scenario.output)
    if not has_paths(assembly):
        return plan
    plan = replace(plan, within=WITHIN)
    longest, most = longest_search(len(assembly.names), len(assembly.joints))
    if not limit.cheaper_than(SECONDS_OF_CHECK, assembly):  # not known whether joints slide
        return replace(plan, seconds_snapping=most)
    try:
        sliding = limit.sliding_joints(assembly, scenario.control)
    except (NotConvergedError, ScenarioError):
        return plan
    if not sliding:
        return plan
    steps = newton_steps(_has_convex(assembly), sliding)
    seconds = newton_seconds(steps, len(assembly.joints))
    return replace(plan, steps=min(steps, longest), seconds=min(seconds, most))


def _has_convex(assembly: Assembly) -> bool:
    return any(law.formulation == "convex" for law in assembly.joints.law)


def _search_result(bound: bool = False, **fields) -> Result:
    """Result of a search: the yield point, compared with theory if one holds, the entries beside it, and the collapse
    under a load on every block; ``bound``: with the associative bound, whatever it costs."""
    run, assembly, scenario = fields["run"], fields["assembly"], fields["scenario"]
    control = scenario.control
    unbounded = control.regime is CONSTANT_RATE or assembly.custom_law is not None
    others = None if unbounded else other_paths(run, assembly, control, bound)
    if others is not None:
        run.yield_point = cut_at_bound(run.yield_point, others.bound)
    slid = control.regime is CONSTANT_RATE or bool(scenario.stages or scenario.among)  # perhaps in an earlier stage
    expected = theory_check.theory_of(assembly, slid)
    no_limit = run.yield_point.bracket == "open" and control.cyclic  # V is that at the end
    if expected is not None and run.yield_point.V is not None and not no_limit:
        expected = expected.compared(run.yield_point.V)
    falls = control.ends_with == COLLAPSE and not run.yield_point.unlimited
    fallen, path = collapse_of(run, assembly, control) if falls else None, None
    if others is not None and (falls or has_paths(assembly) or others.path_dependent):
        path = beside_limit(run, assembly, fields["scenario"], others)
    return Result(**fields, theory=expected, fallen=fallen, path=path, others=others)


def _settlement_result(bound: bool = False, **fields) -> MotionResult:
    """Result of a settlement; ``bound``: with the range of reactions at the start by limit analysis."""
    from dembrick.runs import reactions  # imports its solver, only if asked for

    allowed = reactions.range_along(fields["scenario"], fields["assembly"]) if bound else None
    return MotionResult(**fields, allowed=allowed)


# --- the limit of a load on every block, equilibrium by equilibrium


def _refuse_stresses(scenario: Scenario, assembly: Assembly) -> None:
    """Raise ScenarioError for a quasi-static tilt with strengths in Pa or in ties, or with prestress: the load grows
    with the tangent of the angle under constant gravity, so they would have to grow by 1 / cos."""
    if scenario.control.tilt_axis is None:
        return
    laws = {id(law): law for law in assembly.joints.law}.values()
    stresses = any(law.cohesion or law.tensile_strength or law.compressive_strength for law in laws)
    forces = any(tie.strength is not None or tie.prestress for tie in scenario.ties)
    if stresses or forces:
        what = "strengths in Pa" if stresses else "ties that yield or have a prestress"
        raise ScenarioError(
            "a quasi-static tilt pushes the blocks by the tangent of its angle, which holds for friction only: with "
            f'{what} use large_displacements = true, kind = "pushover", a tilt with a rate, or dembrick limit'
        )


def _plan_path(scenario: Scenario, assembly: Assembly) -> Plan:
    _refuse_stresses(scenario, assembly)
    return _plan_search(scenario, assembly)


def _follow_path(scenario: Scenario, assembly: Assembly, session: Session | None, steps: float = 1.0) -> Replay:
    control: Any = scenario.control  # any kind that follows a path: has a tolerance and a displacement
    _refuse_stresses(scenario, assembly)
    if session is not None:
        expected = newton_steps(_has_convex(assembly))
        session.warn_if_long(newton_seconds(expected, len(assembly.joints)), "take fewer blocks")
    goal = control.displacement or 0.0
    if control.pushes_as_tilted:
        session = replace(session or Session(), tilts=True)
        found = limit_load.find_limit_load(assembly, control.tolerance, session, goal, steps)
        return on_table(found, *moved_before(assembly, cast("State | None", session.start)))
    return limit_load.find_limit_load(assembly, control.tolerance, session, goal, steps)


def _other_path(follow: Callable[..., Replay]) -> Callable[..., YieldPoint]:
    """Function that finds the yield point of a scenario by ``follow``, with steps relative to the usual ones;
    optionally of another assembly than its own, or from a given start state."""

    def found(scenario: Scenario, steps: float, assembly: Assembly | None = None, start: State | None = None):
        session = None if start is None else Session(start=start)
        point = follow(scenario, assembly or build.assemble(scenario), session, steps).yield_point
        if point.V is None:
            raise NotConvergedError("another path of the same structure has no limit", point)
        return point

    return found


# --- real time


def _set_up(scenario: Scenario, assembly: Assembly, session: Session | None = None) -> tuple[Motion, Driving]:
    """Blocks that can move, in the start state of ``session``, and what drives them; reads the scenario's files."""
    from dembrick.simulation.dynamics import checkpoint, loads, run

    moving = run.prepare(assembly, scenario.control, scenario.solver.step_factor)
    if session is not None and session.start is not None:
        checkpoint.start_on(moving, session.start, session.ties_before)
        moving.settled |= scenario.control.regime.counts_equilibria  # new loads come in increments
    elif session is not None and scenario.control.regime.counts_equilibria:
        session.force_error = checkpoint.start_at_rest(moving)
    return moving, loads.driving_of(scenario, moving)


def _plan_motion(scenario: Scenario, assembly: Assembly) -> Plan:
    from dembrick.simulation.dynamics import run

    moving, driving = _set_up(scenario, assembly)
    return run.plan(moving, scenario.control, driving, scenario.output, _expected_factor(scenario, assembly))


def _expected_factor(scenario: Scenario, assembly: Assembly) -> float | None:
    """Estimated load factor of a collapse in real time, by limit analysis; None if that takes longer or finds no
    limit."""
    from dembrick.runs import limit
    from dembrick.runs.limit_cases import searched

    if scenario.control.ends_with != COLLAPSE or not limit.cheaper_than(SECONDS_OF_CHECK, assembly):
        return None
    try:
        found = limit.associative_bound(build.assemble(searched(scenario)), scenario.control)
    except (NotConvergedError, ScenarioError):
        return None
    return None if found is None else found["upper"]


def _run_in_real_time(scenario: Scenario, assembly: Assembly, session: Session) -> MotionRun:
    from dembrick.simulation.dynamics import run
    from dembrick.simulation.dynamics.paths import giving_way

    moving, driving = _set_up(scenario, assembly, session)
    plan = run.plan(moving, scenario.control, driving, scenario.output)
    if plan.at_most and present(plan.seconds) > LONG:  # by the longest such run: worth a closer estimate
        factor = _expected_factor(scenario, assembly)
        plan = run.plan(moving, scenario.control, driving, scenario.output, factor)
    most = present(plan.seconds) if plan.seconds_falling is None else plan.seconds_falling
    session.warn_if_long(most, _shorter(scenario.control), plan.at_most or plan.seconds_falling is not None)
    run.ask_for(moving, scenario.output, driving)
    if session.start is not None and session.resumed is None:
        giving_way.begin_at_rest(moving, driving, session, scenario.solver.step_factor)
    return run.run(moving, scenario.control, driving, session)


def _shorter(control: Control) -> str:
    """Advice for a message on a run in real time that takes too long."""
    remedy = "raise control.rate" if control.limit is None else control.limit.remedy
    return f"{remedy}, or lower joint.normal_stiffness and joint.shear_stiffness: the time step grows"


# --- paths of equilibria in the deformed geometry: supports that settle, loads that grow, travels, and rest


def _plan_equilibria(scenario: Scenario, assembly: Assembly) -> Plan:
    moving, driving = _set_up(scenario, assembly)
    return _path_of(scenario.control).plan(moving, scenario.control, driving, scenario.output)


def _find_equilibria(scenario: Scenario, assembly: Assembly, session: Session, steps: float = 1.0) -> EquilibriaRun:
    from dembrick.simulation.dynamics import run

    control = scenario.control
    moving, driving = _set_up(scenario, assembly, session)
    run.ask_for(moving, scenario.output, driving)
    plan = _path_of(control).plan(moving, control, driving, scenario.output)
    session.warn_if_long(present(plan.seconds), "lower joint.normal_stiffness and joint.shear_stiffness")
    session = replace(session, tilts=control.tilt_axis is not None)
    kind, more = _path_of(control), {}
    if isinstance(control, DisplacementControl):
        more = {"protocol": protocol_of(scenario)}
    return kind(moving, control, driving, session, steps, **more).found()


def _path_of(control: Control):
    """Class of the path of equilibria in the deformed geometry that a control follows."""
    from dembrick.simulation.dynamics.paths.driven_path import DrivenPath, ForcePath
    from dembrick.simulation.dynamics.paths.load_path import LoadPath, Settlement

    if isinstance(control, DisplacementControl) and control.force_protocol is not None:
        return ForcePath
    return {SETTLEMENT.name: Settlement, DRIVEN_PATH.name: DrivenPath}.get(control.regime.name, LoadPath)


def _refined_path(scenario: Scenario, steps: float) -> float:
    """Number that an error estimate compares, of a path with ``steps`` times the usual steps: a load, the settlement
    at collapse (m), or the reaction at the end (N)."""
    assembly = build.assemble(scenario)
    run = _find_equilibria(scenario, assembly, Session(), steps)
    result = driver_of(scenario.control).result
    return result(scenario=scenario, assembly=assembly, run=run, rows={}, frames={}, wall={}).uncertain  # type: ignore[return-value,union-attr]


DRIVERS = {
    LIMIT_LOAD.name: Driver(_plan_search, _limit_load, _search_result, _other_path(_limit_load), _place_points),
    CONSTANT_RATE.name: Driver(_plan_rate, _constant_rate, _search_result),
    PATH_FOLLOWING.name: Driver(_plan_path, _follow_path, _search_result, _other_path(_follow_path)),
    DEAD_LOAD.name: Driver(
        lambda _, assembly: dead_load.plan(assembly),
        lambda _, assembly, session: dead_load.find_rest(assembly, session),
        StaticsResult,
    ),
    LOAD_PATH.name: Driver(_plan_equilibria, _find_equilibria, LoadPathResult, _refined_path),
    DRIVEN_PATH.name: Driver(_plan_equilibria, _find_equilibria, LoadPathResult, _refined_path),
    DEFORMED_REST.name: Driver(_plan_equilibria, _find_equilibria, StaticsResult),
    SETTLEMENT.name: Driver(_plan_equilibria, _find_equilibria, _settlement_result, _refined_path),
    REAL_TIME.name: Driver(_plan_motion, _run_in_real_time, MotionResult),
}
