"""Search for a limit load (`find_limit_load`): equilibria, and bounds of V at each, until they are narrow enough.

Equilibrium is found directly, by Newton's method, in the geometry of the start, for which a limit load is defined: no
inertia, no dashpots, no time. A lone dry joint has a search of its own (`kernels.statics.lone_search`); its bracket is
certified if its friction does not depend on the load. Assemblies, and lone joints for which that search fails, follow
a path of equilibria (`paths.path_following`).

The contact points of a lone distributed joint are placed during the search for its limit load (`place_points`). They
must be accurate for the torsion centre at the limit load, which is not known beforehand. So the search is repeated in
rounds: points on rays from O give a rough limit load and its centre, points on rays from there a better one, until the
gap between points and continuum is within half the tolerance for all centres as far from the last as that has moved.
Then the final search runs with these points. A joint that does not stay closed gets the lattice of
``quadrature`` instead, as does every joint of an assembly and every test in which the centre wanders.
"""

from __future__ import annotations

import dataclasses
import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from dembrick.assembly import ray_quadrature
from dembrick.assembly.contact_points import PointTable
from dembrick.assembly.quadrature import ContactPoints, contact_points
from dembrick.errors import DembrickError, NotConvergedError
from dembrick.scenario.checks import present
from dembrick.scenario.controls import PATH_FOLLOWING
from dembrick.scenario.model import Output
from dembrick.simulation.expected_cost import EQUILIBRIA, lone_seconds, newton_seconds, newton_steps, search_steps
from dembrick.simulation.session import Observer, Plan, Session
from dembrick.simulation.statics import joint_families
from dembrick.simulation.statics.elastic_factor import equations, touches_itself
from dembrick.simulation.statics.load_system import After, LoadSystem, Replay, Setup, rough_strength
from dembrick.simulation.statics.lone_joint import MOST_EQUILIBRIA, LoneSearch, is_lone
from dembrick.simulation.statics.paths.bounds import carried
from dembrick.simulation.statics.paths.limit_state import NEAR, carrying
from dembrick.simulation.statics.paths.path_following import PathFollower
from dembrick.simulation.statics.paths.path_state import Path, PathState
from dembrick.simulation.statics.recorder import Recorder
from dembrick.simulation.statics.state import State
from dembrick.simulation.statics.yield_point import (
    YieldPoint,
    at_greatest,
    at_peak,
    carried_by,
    mechanism_of,
    moving_blocks,
    read_off,
    without_limit,
)

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.scenario.controls import YieldControl


GUESS = 0.25  # of the weight of all blocks: a first estimate of a load on all of them
MOST_JOINTS_BOUNDED = 1000  # up to so many joints, limit analysis costs little beside the search that failed
ROUNDED = 1e-9  # of a moment: rounding error
BYTES_A_TRIAL = 1400  # per joint: tangent, stiffness, and the matrices of its two ends, 36 numbers each, and others


def find_limit_load(
    assembly: Assembly,
    tolerance: float,
    session: Session | Observer | None = None,
    goal: float | None = None,
    steps: float = 1.0,
) -> Replay:
    """Increase the load until the bracket of V has a relative half-width within ``tolerance``.

    ``session`` gets the record. With a ``goal`` (m) the path is followed until a block has moved that far; ``steps``:
    its initial step over the usual one. Raises NotConvergedError with the best bracket if the tolerance is not reached,
    DivergedError, and NotConvergedError if the blocks collapse under the dead loads alone. A load that nothing limits
    is a result: the yield point says ``unlimited``.
    """
    session = Session.of(session)
    replay = _of_lone_joint(LoadSystem(assembly, session), tolerance, session) if goal is None else None
    if replay is None:
        replay = _by_equilibria(Setup(assembly, tolerance, session, by_equilibria=True), session, goal or 0.0, steps)
    if not replay.converged:
        point = replay.yield_point
        name, unit = ("V", " N") if goal is None else ("the load factor", "")
        remedies = ["Allow a larger control.tolerance", "follow the blocks with control.large_displacements = true"]
        if goal is not None:
            remedies.append("simulate the collapse with control.quasi_static = false")
            remedies.append("take the upper bound of dembrick limit")
        least = point.V_peak if point.bracket == "open" else point.V_lower  # an equilibrium, where nothing is proven
        found = f"{name} is at least {least:.6g}{unit}, {_above(point, assembly, unit)}"
        raise NotConvergedError(
            f"the limit load was not bracketed within {tolerance:g} after {replay.steps} steps: {found}. "
            f"{', or '.join(remedies)}",
            point,
        )
    return replay


def _above(point: YieldPoint, assembly: Assembly, unit: str) -> str:
    """Text on the upper bound of a bracket that has not closed: certified, by limit analysis, or else only indicated.

    Limit analysis also covers a tilting table: all strength is friction, so its limit is a push by the tangent.
    """
    from dembrick.simulation.limit_analysis import analysis

    known = "" if point.V_upper is None else f"{point.V_upper:.6g}{unit}"
    if point.bracket == "certified" and known:
        return f"and at most {known}"
    if len(assembly.joints) <= MOST_JOINTS_BOUNDED:
        try:
            found = analysis.limit_load(assembly)
        except DembrickError:
            pass  # report on the search alone
        else:
            return (
                "and limit analysis finds no upper bound" if found.unlimited else f"and at most {found.upper:.6g}{unit}"
            )
    return f"and the current mechanism needs {known}, which proves nothing" if known else "and no upper bound is known"


def _by_equilibria(setup: Setup, session: Session, goal: float, steps: float) -> Replay:
    """Search by path following, for assemblies and all that the search of a lone joint does not cover."""
    state, certificate = setup.state, setup.certificate
    frames_every = 1 if len(setup.assembly.names) <= 100 else 8
    watched = setup.assembly.control_points
    recorder = Recorder(state, session, 1, 1, frames_every, watched) if session.observe else None
    began = time.perf_counter()
    follower = PathFollower(state, setup.load, setup.factor, certificate, recorder, session)
    follower.prepare()
    ready = time.perf_counter()
    # a load on all blocks is resisted by a part of their weight, a single actuator by a few joints
    strength = GUESS * float(np.linalg.norm(state.blocks.dead_force[state.blocks.free], axis=1).sum()) / setup.weight
    if joint_families.has_strengths(state):
        strength += float(joint_families.greatest_strength(state).max()) / setup.weight
    strength = min(strength, rough_strength(state, certificate, setup.load)) or GUESS
    path = follower.run(steps * strength, goal)
    phases = {"dead_load": setup.loop_seconds, **path.phases}
    phases["equations"] += setup.factor.seconds
    at_start = setup.displacement_at_start
    point, limit = _limit_of(path, follower, setup)
    return Replay(
        yield_point=point,
        state=limit,
        left=_handed_on(limit, state),
        reached=follower.limit.reached if path.converged and _rocks_on(point, state, follower.way) else None,
        after=_after(state, limit, at_start, follower.way.limit < path.equilibria),
        # certified bounds must close; others may be reported as open
        converged=(path.converged or path.unlimited or (path.wanders and not certificate.strict))
        and not _lost_its_way(state, point),
        steps=path.iterations,
        time_step=1.0,
        critical_time_step=None,
        simulated_time=None,  # equilibria are numbered; no time passes between them
        unbalanced=setup.unbalanced,
        compile_seconds=setup.compile_seconds + ready - began + follower.relaxation.compile_seconds,
        loop_seconds=sum(phases.values()),
        settings={"equilibria": path.equilibria, "inertia": "none", "gave_way": path.moved, "wanders": path.wanders},
        moved=limit.blocks.displacement - at_start,
        phases=phases,
    )


def _handed_on(limit: State, end: State) -> State:
    """State for the next stage: that at the limit, or the end of the path if bonds broke beyond the limit, as their
    strength was the limit."""
    return end if joint_families.broke(end, limit) else limit


def _rocks_on(point: YieldPoint, state: State, way: PathState) -> bool:
    """Whether convex joints rock at the end of a path at nearly the limit load."""
    rocks = point.mechanism == "rocking" and joint_families.has_areas(state)
    return rocks and way.V * (1.0 + NEAR) >= way.limit_load > 0.0


def _lost_its_way(state: State, point: YieldPoint) -> bool:
    """Whether a lone dry joint shows a peak: it has none in the geometry of the start, so the path was missed."""
    return len(state.joints.block_a) == 1 and not joint_families.has_strengths(state) and point.V_after is not None


def _limit_of(path: Path, follower: PathFollower, setup: Setup) -> tuple[YieldPoint, State]:
    """The yield point of a path and the state at its limit; the state at the end of the path if nothing limits the
    load or only the range in which it rises and falls is known."""
    certificate, names, within = setup.certificate, setup.assembly.names, 2.0 * setup.certificate.tolerance
    wide = path.wanders and read_off(setup.state, certificate, names).bracket == "open"

    def read(state: State) -> YieldPoint:
        point = read_off(state, certificate, names)
        if wide:
            return at_greatest(point, carried(follower.way))
        return point if certificate.strict else at_peak(point, path.peak, within * abs(present(point.V)))

    end = read(setup.state)
    if path.unlimited:
        return without_limit(end), setup.state
    if not wide and (end.bracket == "open" or (path.wanders and end.V_after is None)):
        return replace(end, limit_at=float(path.equilibria)), setup.state
    found = read(follower.limit.state)
    limit = carrying(follower.limit.state, present(found.V))
    at = float(follower.way.limit)
    return replace(carried_by(found, limit), actuator_load=end.actuator_load, limit_at=at), limit


def _after(end: State, limit: State, start: np.ndarray, goes_on: bool) -> After | None:
    """Motion at the ``end`` of a path that ``goes_on`` beyond its limit; None if the same blocks move as at the
    limit."""
    moving = moving_blocks(end)
    if not goes_on or set(moving) == set(moving_blocks(limit)):
        return None
    moved = float(np.linalg.norm(end.blocks.displacement - start, axis=1).max())
    return After(moving, mechanism_of(end), moved, float(end.actuators.driven[0].load))


def _of_lone_joint(system: LoadSystem, tolerance: float, session: Session) -> Replay | None:
    """Search for the limit of one dry joint between a free and a fixed block, by `kernels.statics.lone_search`. None
    for any other scene, and if it finds no limit."""
    assembly, state = system.assembly, system.state
    if session.start is not None or not is_lone(state):
        return None
    began = time.perf_counter()
    search = LoneSearch(state, tolerance)
    compiled = time.perf_counter()
    search.run()
    seconds = time.perf_counter() - compiled
    if not search.converged:
        return None
    if session.observe:  # once more with a record, now that it is known to converge
        state = LoadSystem(assembly, session).state
        search = LoneSearch(state, tolerance)
        search.record(Recorder(state, session, MOST_EQUILIBRIA, 1, 1, assembly.control_points), session)
    search.show()
    point = read_off(state, search.certificate(), assembly.names)
    limit = carrying(state, present(point.V))
    equilibria = int(search.found["equilibria"])
    return Replay(
        yield_point=replace(carried_by(point, limit), limit_at=float(equilibria), actuator_load=point.V),
        state=limit,
        left=state,
        reached=_reached_alone(assembly, tolerance, session, point) if session.hands_on else None,
        converged=True,
        steps=int(search.found["iterations"]),
        time_step=1.0,
        critical_time_step=None,
        simulated_time=None,
        unbalanced=float(search.found["unbalanced"]),
        compile_seconds=compiled - began,
        loop_seconds=seconds,
        settings={"equilibria": equilibria, "inertia": "none"},
        moved=search.moved,
    )


def _reached_alone(assembly: Assembly, tolerance: float, session: Session, point: YieldPoint) -> State | None:
    """The first equilibrium of a lone convex joint that carries nearly V of its ``point``; None unless it rocks."""
    state = LoadSystem(assembly, session).state
    if point.mechanism != "rocking" or not joint_families.has_areas(state):
        return None
    LoneSearch(state, tolerance).run_to(present(point.V) / (1.0 + NEAR))
    return state


def plan(assembly: Assembly, control: YieldControl, output: Output) -> Plan:
    """Plan of a search, without running any of it."""
    system, joints = LoadSystem(assembly), len(assembly.joints)
    dt, whole = system.dashpots().critical_time_step, touches_itself(system.state)
    if is_lone(system.state) and control.regime is not PATH_FOLLOWING:
        steps = search_steps(control.tolerance, _friction_follows(assembly, system.load))
        planned = system.plan(dt, steps, EQUILIBRIA, control, output)
        return replace(planned, seconds=lone_seconds(steps, len(assembly.contact_points.area)))
    convex = any(law.formulation == "convex" for law in assembly.joints.law)
    steps = newton_steps(convex)
    planned = system.plan(dt, steps, EQUILIBRIA, control, output)
    solving = BYTES_A_TRIAL * joints
    if whole:
        solving += equations(system.state, assembly.position).bytes(factors=2)
    return replace(planned, memory=planned.memory + solving, seconds=newton_seconds(steps, joints))


def _friction_follows(assembly: Assembly, load: np.ndarray) -> bool:
    """Whether the friction of the one joint depends on the unit ``load`` (n, 6): it presses or bends the joint, and the
    law is not convex with full pressure."""
    if assembly.joints[0].law.formulation == "convex" and assembly.joints[0].law.pressure == "full":
        return False
    joint = assembly.joints[0]
    force, moment = load[joint.block_b, :3], load[joint.block_b, 3:]
    about = joint.axes @ (moment - np.cross(joint.arm_b, force))
    reach = float(np.abs(joint.polygon).max())
    whole = reach * float(np.linalg.norm(force)) + float(np.linalg.norm(about))
    pressed = reach * abs(float(joint.axes[2] @ force))
    return max(pressed, float(np.abs(about[:2]).max())) > ROUNDED * whole


COUNTS = ((2, 2), (3, 2), (3, 3), (4, 3), (4, 4), (5, 5))  # rays per piece of an edge, points per piece of a ray
_FEW = 3  # of them are tried while another round may still find a better centre
_ROUGH = (1e-2, 1e-3, 1e-4, 1e-5, 0.0)  # tolerances of the rounds, while they are coarser than the one asked for
_SETTLED = 3e-3  # of the polygon's size: with a centre known so well, all counts of points are tried
_AROUND = 4  # directions around the centre in which the gap is checked


def place_points(assembly: Assembly, tolerance: float):
    """The assembly with its contact points placed for a limit load to ``tolerance``, and the loop seconds it took.

    Anything but a single ``distributed`` joint without ``points`` of its own is returned unchanged.
    """
    if len(assembly.joints) != 1:
        return assembly, 0.0
    joint = assembly.joints[0]
    if joint.law.formulation != "distributed" or joint.law.points is not None:
        return assembly, 0.0
    pieces = joint.pieces or (joint.polygon,)
    centre, seconds = np.zeros(2), 0.0
    points = ray_quadrature.rays_over(pieces, centre, *COUNTS[0])
    for rough in _ROUGH:
        try:
            run = find_limit_load(_with(assembly, *points), max(rough, tolerance))
        except NotConvergedError:
            break
        seconds += run.loop_seconds
        if not (run.state.points.normal > 0.0).all():
            break
        if run.yield_point.torsion_centre is None:  # pure shear: only the sum of areas counts, not where points are
            return _with(assembly, *points), seconds
        last, centre = centre, np.array(run.yield_point.torsion_centre)
        opening, tilt_1, tilt_2 = run.state.joints.opening[0]
        pressure = (-opening, tilt_2, -tilt_1)
        moved = float(np.hypot(*(centre - last)))
        # V is stationary in the centre: the error of the centre goes with the square root of the relative error of V
        size = float(np.abs(joint.polygon).max())
        unsure = min(moved, float(np.sqrt(max(rough, tolerance))) * size)
        exact = _moments(pieces, centre, unsure, pressure)
        settled = rough <= tolerance or unsure <= _SETTLED * size
        for counts in COUNTS if settled else COUNTS[:_FEW]:
            points = ray_quadrature.rays_over(pieces, centre, *counts)
            if _worst_gap(points, pressure, exact) <= 0.5 * tolerance:
                return _with(assembly, *points), seconds
    lattice = contact_points(joint, tolerance)
    return dataclasses.replace(assembly, contact_points=PointTable.of((lattice,))), seconds


def _with(assembly: Assembly, arms, areas):
    """The assembly with these contact points."""
    return dataclasses.replace(assembly, contact_points=PointTable.of((ContactPoints(arms, arms, areas),)))


def _moments(pieces, centre, radius: float, pressure) -> list[tuple[np.ndarray, float]]:
    """Friction moments of the continuum under a linear pressure, about the centre and ``radius`` around it."""
    angle = 2.0 * np.pi * np.arange(_AROUND) / _AROUND
    ring = centre + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return [
        (c, ray_quadrature.friction_moment(*ray_quadrature.fine_rays(pieces, c), centre=c, pressure=pressure))
        for c in np.concatenate([centre[None], ring])
    ]


def _worst_gap(points, pressure, exact) -> float:
    """Largest relative gap between the points' friction moments and the ``exact`` ones of the continuum."""
    arms, areas = points
    return max(abs(ray_quadrature.friction_moment(arms, areas, c, pressure) / moment - 1.0) for c, moment in exact)
