"""Limit analysis of an assembly: the limit of its load, and whether it stands under its dead loads."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from dembrick.errors import NotConvergedError, ScenarioError
from dembrick.scenario.checks import listed
from dembrick.simulation.floating_point import not_nan
from dembrick.simulation.limit_analysis import bounds, solver
from dembrick.simulation.limit_analysis.equilibrium import JointForces
from dembrick.simulation.limit_analysis.friction_surface import first_planes
from dembrick.simulation.limit_analysis.mechanism import Mechanism, mechanism_of, names_of
from dembrick.simulation.limit_analysis.programme import (
    NO_CUTS,
    Cuts,
    Loads,
    Structure,
    area_normals,
    programme_of,
    structure_of,
)
from dembrick.simulation.limit_analysis.solver import INFEASIBLE, SOLVED, UNBOUNDED, Entries, Programme, Solution
from dembrick.simulation.limit_analysis.strength import (
    Material,
    area_strengths,
    bounded_by_corners,
    corner_points,
    point_strengths,
)

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly

FINE = 3e-7  # of the friction of area joints: reduction of their surface within which the lower bound seeks forces
CRUSHED = 1e-8  # of N: accepted excess over the surface of crushing, which lowers the lower bound
MOST_ROUNDS = 80  # of cutting planes
GAP = 1e-4  # of the load factor: a wider gap between the bounds is an error
LITTLE = 1e-3  # of the dead loads: least reference load for the accuracy
APART = 1e-6  # of the bound: bounds further apart are sought again,
MEASURED = 2  # times at most
_STANDS = 1e-7  # of the dead loads: out-of-balance force that counts as zero
RAY = 1e-6  # of the forces of a load without a limit: accepted violation of equilibrium and strengths
_FAR_OUT = 1e6  # of the strengths, and of the unit of forces
_NOTHING = 1e-12  # of its forces: a smaller resultant of a load on each block counts as zero
_TILT_ROUNDS, _TILT_SETTLED = 40, 1e-10
_STEEPEST = 1e6  # tangent of an angle that is 90 deg


@dataclass(frozen=True)
class Optimum:
    """The least cost of a programme: ``status``; ``reached``: cost of feasible forces that balance the loads; and
    ``bound``: lower bound of the cost of all such forces; the unknowns ``x``, the duals ``y`` of equilibrium, and the
    ``cuts`` that bounded the area joints."""

    status: str
    reached: float
    bound: float
    x: np.ndarray
    y: np.ndarray
    rounds: int
    cuts: Cuts


@dataclass(frozen=True)
class Limit:
    """The limit of a load: its multiplier with bounds, or ``unlimited`` (then all three are infinite).

    ``lower``: balanced by ``resultants`` (j, 6) N, V_1, V_2, M_T, M_1, M_2 on the second blocks, in N and N m about O.
    ``upper``: that of the ``mechanism``.
    """

    load_factor: float
    lower: float
    upper: float
    unlimited: bool
    resultants: np.ndarray
    forces: JointForces | None
    mechanism: Mechanism | None
    rounds: int
    seconds: float

    @property
    def gap(self) -> float:
        """Width of the bounds over the load factor."""
        return 0.0 if self.unlimited else (self.upper - self.lower) / max(abs(self.load_factor), 1e-12)


@dataclass(frozen=True)
class Standing:
    """Whether an assembly stands under its dead loads: ``unbalanced``: the least sum of out-of-balance forces over that
    of the dead loads; the unknowns ``x`` of a state well inside the strengths; else the mechanism of the fall."""

    stands: bool
    unbalanced: float
    x: np.ndarray | None
    mechanism: Mechanism | None


def dead_wrench(assembly: Assembly) -> np.ndarray:
    """Dead force and moment about the centroid of every block (n, 6)."""
    return np.concatenate([assembly.dead_force, assembly.dead_torque], axis=1)


def live_wrench(assembly: Assembly) -> np.ndarray:
    """Force and moment (n, 6) of the actuators on every block at V = 1.

    ScenarioError if there are none, or if they cancel on every block in the directions that its guide leaves free.
    """
    actuators = assembly.actuators
    if not len(actuators.at):
        raise ScenarioError(
            "the scenario has no load to multiply: limit analysis needs [[actuators]], or a control of kind tilt or "
            "pushover"
        )
    wrench, size = actuators.at.on_blocks(actuators.force, len(assembly.names)), np.zeros((len(assembly.names), 6))
    np.add.at(size, actuators.at.block, np.abs(actuators.at.wrenches(actuators.force)))
    free = ~assembly.fixed
    moves = (np.abs(wrench) > _NOTHING * size[free].max(initial=0.0)) & free[:, None]
    if not moves.any():
        raise ScenarioError(
            "the loads cancel on every block, so there is nothing to multiply: remove or turn one of them"
        )
    if not (moves & ~assembly.held).any():
        raise ScenarioError(
            "the loads push every block only against its guide, so nothing limits them: turn a load, or free a guide"
        )
    return wrench


def prepared(
    assembly: Assembly,
    live: Sequence[np.ndarray] = (),
    material: Material | None = None,
    corners: bool = False,
    along=(),
) -> Structure:
    """An assembly as a `Structure` under its dead loads and ``live`` wrenches.

    ``material``: the strengths, by default those of the joints' laws. With ``corners`` every joint acts at
    points at its true corners; without, only those whose own set of forces is not convex. ``along``: directions (3,)
    that a plane of symmetry must contain too.
    """
    if not (~assembly.fixed).any():
        raise ScenarioError("nothing can move: all blocks are fixed, so there is no limit to find")
    joints, table = assembly.joints, assembly.contact_points
    chosen = np.ones(len(joints), bool) if corners else bounded_by_corners(joints)
    joints, table = corner_points(joints, chosen, table)
    material = Material.of(joints) if material is None else material
    points, areas = point_strengths(table, material), area_strengths(joints, table, material)
    return structure_of(assembly, points, areas, dead_wrench(assembly), list(live), along)


def limit_load(
    assembly: Assembly, material: Material | None = None, corners: bool = False, tilt: bool = False
) -> Limit:
    """The limit of the actuators' load V of an assembly, by the static theorem; flow is associative.

    ``tilt``: V is the tangent of the angle of a table, so strengths other than friction are scaled by 1 / cos. Raises
    ScenarioError without a load, NotConvergedError if the dead loads alone cannot be carried or the solver fails.
    """
    began = time.perf_counter()
    live = live_wrench(assembly)
    material = Material.of(assembly.joints) if material is None else material
    if tilt and not (material.dry and not np.isfinite(assembly.ties.strength).any()):
        found = _tilted(assembly, live, material, corners)
    else:
        found = _limit(assembly, live, material, corners)
    return replace(found, seconds=time.perf_counter() - began)


def _tilted(assembly: Assembly, live: np.ndarray, material: Material, corners: bool) -> Limit:
    """The tangent V of the angle of a table at which V = F(V), F being the limit with strengths scaled by 1 / cos.

    F grows with V. So if F(V) >= V the structure stands up to F(V) at least, and if F(V) <= V it falls at F(V) at the
    latest. False position narrows this bracket, each round from the side that is further from the root.
    Raises NotConvergedError if it does not become narrow enough.
    """

    def at(V: float) -> Limit:
        steeper = math.hypot(1.0, V)
        ties = replace(assembly.ties, strength=steeper * assembly.ties.strength)
        return _limit(replace(assembly, ties=ties), live, material.scaled(steeper), corners)

    stands, safe, falls_at, unsafe = 0.0, at(0.0), math.inf, None
    gain, slope, rounds = safe.load_factor, -1.0, safe.rounds
    V = gain + _TILT_SETTLED
    for _ in range(_TILT_ROUNDS):
        if safe.unlimited or stands > _STEEPEST:
            return replace(safe, load_factor=math.inf, lower=math.inf, upper=math.inf, unlimited=True, mechanism=None)
        found = at(V)
        rounds += found.rounds
        if found.lower >= V > stands:
            slope = (found.load_factor - V - gain) / (V - stands)
            stands, safe, gain = V, found, found.load_factor - V
        elif found.upper <= V < falls_at:
            falls_at, unsafe = V, found
        if unsafe is None:
            V = 1.01 * (stands - gain / slope) + _TILT_SETTLED if slope < 0.0 else 8.0 * stands + 1.0
            continue
        slope = (unsafe.load_factor - falls_at - gain) / (falls_at - stands) or -1.0
        root, width = stands - gain / slope, max(safe.upper - safe.lower, unsafe.upper - unsafe.lower)
        if unsafe.upper - safe.lower <= _TILT_SETTLED * max(1.0, root) - 8.0 * width / slope:
            middle = 0.5 * (safe.lower + unsafe.upper)
            ends = {"load_factor": middle, "lower": safe.lower, "upper": unsafe.upper}
            return replace(safe, **ends, mechanism=unsafe.mechanism, rounds=rounds)
        off = 1e-3 * (falls_at - stands) - 2.0 * width / slope
        V = root - off if root - safe.lower > unsafe.upper - root else root + off
    raise NotConvergedError(
        f"limit analysis: the blocks stand at tan = {safe.lower:.6g}, but the tilt at collapse was not found in "
        f"{_TILT_ROUNDS} rounds, because strengths other than friction carry nearly all of the load; lower them, or "
        "give a pushover"
    )


def _limit(assembly: Assembly, live: np.ndarray, material: Material, corners: bool) -> Limit:
    structure = prepared(assembly, [live], material, corners)
    inner = standing(structure)
    if not inner.stands:
        raise falls(assembly, inner)
    return greatest(structure, live, inner)


def statics(assembly: Assembly, found: Standing) -> dict:
    """The object ``statics`` of the JSON output."""
    kind = None if found.mechanism is None else found.mechanism.kind
    blocks = names_of(assembly, found.mechanism)
    return {"stands": found.stands, "unbalanced": found.unbalanced, "mechanism": kind, "blocks": blocks}


def falls(assembly: Assembly, found: Standing) -> NotConvergedError:
    """The error of a structure that does not stand under its dead loads."""
    names = names_of(assembly, found.mechanism)
    error = NotConvergedError(
        f"it does not stand under its dead loads: {found.mechanism.kind} of {listed(names)}; the joints cannot balance "
        f"{100.0 * found.unbalanced:.3g} % of the dead loads; check loads, friction and supports"
    )
    error.answer = {"status": "falls", "error": str(error), "statics": statics(assembly, found)}
    return error


def greatest(structure: Structure, live: np.ndarray, inner: Standing) -> Limit:
    """The greatest multiplier of the wrenches ``live`` (n, 6) on a structure that stands without."""
    n = structure.layout.n
    vector = structure.frame.vector(live)
    size = float(np.abs(vector).sum())
    cost = np.zeros(n + 1)
    cost[n] = -1.0
    found = optimum(structure, Loads(structure.dead, vector / size), cost, np.append(inner.x, 0.0))
    nothing = np.full((len(structure.assembly.joints), 6), np.nan)
    if found.status == UNBOUNDED:
        return Limit(math.inf, math.inf, math.inf, True, nothing, None, None, found.rounds, 0.0)
    # the multiplier is not negative, as the structure stands without the load
    reached = not_nan(found.reached, "the load of limit analysis")
    bound = not_nan(found.bound, "the bound of limit analysis")
    lower, upper = max(0.0, -reached) / size, max(0.0, -bound) / size
    forces, resultants = structure.carried(found.x)
    limit = Limit(
        load_factor=0.5 * (lower + upper),
        lower=lower,
        upper=upper,
        unlimited=False,
        resultants=resultants,
        forces=forces,
        mechanism=mechanism_of(structure, found.y / (size * structure.frame.unit), resultants),
        rounds=found.rounds,
        seconds=0.0,
    )
    heavy = float(np.abs(structure.dead).sum()) / size  # the multiplier that makes the load as great as the dead loads
    refuse_gap(lower, upper, heavy, "the load factor")
    return limit


def refuse_gap(lower: float, upper: float, heavy: float, what: str) -> None:
    """Raise NotConvergedError if two bounds are too far apart; ``heavy``: the value that equals the dead loads."""
    if not upper - lower <= GAP * max(abs(lower), abs(upper), LITTLE * heavy):
        raise NotConvergedError(
            f"limit analysis: the bounds {lower:.6g} and {upper:.6g} of {what} are further apart than {GAP:g} of it, "
            "so there is no answer; the usual cause is joints or blocks of very different sizes"
        )


def standing(structure: Structure) -> Standing:
    """Whether any forces within the strengths balance the dead loads."""
    layout = structure.layout
    found = optimum(structure, Loads(structure.dead, None), np.zeros(layout.n))
    if found.status == SOLVED and found.reached == 0.0:
        return Standing(True, 0.0, found.x, None)
    missing, y = _least_missing(structure, found.cuts)
    unbalanced = missing / max(float(np.abs(structure.dead).sum()), 1e-300)
    if unbalanced <= _STANDS:
        return Standing(True, unbalanced, found.x if found.status == SOLVED else np.zeros(layout.n), None)
    forces = np.ones((len(structure.assembly.joints), 6))  # without equilibrium every joint counts as closed
    return Standing(False, unbalanced, None, mechanism_of(structure, y, forces))


def _least_missing(structure: Structure, cuts: Cuts) -> tuple[float, np.ndarray]:
    """The least sum of out-of-balance forces on free blocks, and the dual velocities: those of the fall, of length one
    at most for each block. ``cuts`` bound the area joints."""
    n, rows, per = structure.layout.n, structure.frame.rows, structure.frame.per_block
    blocks = rows // per
    plain = programme_of(structure, Loads(structure.dead, None), np.zeros(n), cuts)
    number = np.arange(rows)
    size = (per + 1) * np.arange(blocks)
    extra = Entries.joined(
        Entries(size, n + rows + np.arange(blocks), np.full(blocks, -1.0)),
        Entries(np.repeat(size, per) + 1 + number % per, n + number, np.full(rows, -1.0)),
    ).moved(rows=len(plain.limits))
    programme = Programme(
        cost=np.concatenate([np.zeros(n + rows), np.ones(blocks)]),
        equations=Entries.joined(plain.equations, Entries(number, n + number, np.ones(rows))),
        right_hand=plain.right_hand,
        rows=Entries.joined(plain.rows, extra),
        limits=np.concatenate([plain.limits, np.zeros((per + 1) * blocks)]),
        linear=plain.linear,
        quadratic=np.concatenate([plain.quadratic, np.full(blocks, per + 1)]),
    )
    found = solver.solve(programme)
    missing = not_nan(float(programme.cost @ found.x), "what limit analysis leaves out of balance")
    little = missing <= LITTLE * float(np.abs(structure.dead).sum())
    if found.status != SOLVED or (little and found.said != solver.TO_TOLERANCE):
        raise NotConvergedError(
            f"limit analysis: the solver ended with the status {found.said} while it balanced the dead loads"
        )
    return max(0.0, missing), found.equation_dual


def optimum(structure: Structure, loads: Loads, cost: np.ndarray, inner: np.ndarray | None = None) -> Optimum:
    """The least cost . x of joint forces that balance ``loads`` within the strengths, bounded from both sides.

    ``inner``: unknowns that balance them well inside. If the bounds are apart, as the solver takes the forces of light
    blocks for rounding next to those of heavy ones, each force is measured by the scale of its joint.
    """
    found = _optimum(structure, loads, cost, inner)
    for _ in range(MEASURED):
        if found.status != SOLVED or found.reached - found.bound <= APART * abs(found.bound):
            break
        try:
            again = _optimum(structure, loads, cost, inner, bounds.sizes(structure, found.x))
        except NotConvergedError:
            break
        if again.status != SOLVED:
            break
        best = min(found, again, key=lambda one: one.reached - one.bound)  # only good duals price what is not balanced
        found = replace(best, bound=max(found.bound, again.bound), rounds=found.rounds + again.rounds)
    return found


def _optimum(
    structure: Structure,
    loads: Loads,
    cost: np.ndarray,
    inner: np.ndarray | None,
    sizes: np.ndarray | None = None,
) -> Optimum:
    """`optimum` by unknowns of given ``sizes``. Area joints are bounded by cutting planes: each round adds, for
    every joint beyond its surface of friction or of crushing, the plane that cuts off its forces, until, with slightly
    reduced strengths, no joint is beyond its exact surface.
    """
    crushes = structure.areas.crushes
    surfaces = len(structure.areas) > 0 and not (structure.layout.flat and not len(crushes))
    reduced, rounds = (1.0 / (1.0 + FINE) if surfaces else 1.0), 0
    places, closing = first_planes(structure.areas, crushes)
    cuts = NO_CUTS._replace(crushed=crushes[places], closing=closing)
    while True:
        programme = programme_of(structure, loads, cost, cuts, reduced)
        found = solver.solve(programme, sizes)
        rounds += 1
        if found.status == INFEASIBLE:
            break
        x = found.x if found.status == SOLVED else _far(programme, found)
        further = _cuts_off(structure, x) if surfaces else None
        if further is None:
            break
        if rounds == MOST_ROUNDS:
            if found.status == SOLVED:
                break  # the bounds show how accurate it is
            raise NotConvergedError(
                f"limit analysis: after {MOST_ROUNDS} rounds no limit was found, because forces still exceed the "
                "limit surfaces of convex joints; use a formulation with contact points"
            )
        cuts = cuts.more(*further)
    if found.status != SOLVED:
        return Optimum(found.status, math.nan, math.nan, found.x, found.equation_dual, rounds, cuts)
    plain, outer = programme, found
    if surfaces:
        plain = programme_of(structure, loads, cost, cuts)
        outer = solver.solve(plain, sizes)
        if outer.status != SOLVED:
            return Optimum(outer.status, math.nan, math.nan, outer.x, outer.equation_dual, rounds, cuts)
    bound, duals = bounds.least_cost(structure, plain, outer)
    x, reached = _within(structure, plain, found, inner)
    if cost.any():
        price = bounds.price_of_excess(plain, x, duals)
        small = price <= APART * max(abs(reached), LITTLE * float(np.abs(structure.dead).sum()))
        reached = reached + price if small else math.inf  # forces that far from equilibrium prove nothing
    return Optimum(SOLVED, reached, bound, x, outer.equation_dual, rounds, cuts)


def _far(programme: Programme, ray: Solution) -> np.ndarray:
    """Forces far along the ray of an unbounded programme, where strengths other than friction are negligible.

    NotConvergedError if it is no ray: if its forces violate strengths or equilibrium, or the cost does not fall.
    """
    if programme.cost @ ray.x >= 0.0 or bounds.ray_excess(programme, ray.x) > RAY:
        raise NotConvergedError(
            f"limit analysis: the solver Clarabel ended with the status {ray.said}, but its forces cannot grow "
            "without limit, so there is no answer; the usual cause is joints or blocks of very different sizes"
        )
    most = max(1.0, float(np.abs(programme.limits).max(initial=0.0)))
    return ray.x * (_FAR_OUT * most / float(np.abs(ray.x).max()))


def _cuts_off(structure: Structure, x: np.ndarray) -> Cuts | None:
    """The planes that cut off the forces of a solution, for all area joints beyond a surface; None if there are
    none."""
    most = float(np.abs(x).max(initial=0.0))
    over, twist = bounds.surface_excess(structure, x)
    crushed, closing = bounds.crushing_excess(structure, x)
    normal = area_normals(structure.layout, x)[structure.areas.crushes, 0]
    if not (
        (over > bounds.ROUNDING * most).any() or (crushed > np.maximum(CRUSHED * normal, bounds.ROUNDING * most)).any()
    ):
        return None
    cut = np.flatnonzero((over > 0.0) & np.any(twist != 0.0, axis=1))
    pressed = np.flatnonzero((crushed > 0.0) & np.any(closing != 0.0, axis=1))
    return Cuts(cut, twist[cut], structure.areas.crushes[pressed], closing[pressed])


def _within(structure: Structure, programme: Programme, found: Solution, inner: np.ndarray | None):
    """Unknowns that balance exactly and lie within the strengths, and their cost; infinite if there are none."""
    x = bounds.balanced(structure, programme, found)
    parts = bounds.excess(structure, programme, x)
    over, allowed = np.concatenate(parts), bounds.allowed(structure, x, parts)
    if not (over > allowed).any():
        return x, float(programme.cost @ x)
    if inner is None:
        return x, math.inf
    share = bounds.share_of_inner(over, np.concatenate(bounds.excess(structure, programme, inner)), allowed)
    x = (1.0 - share) * x + share * inner
    return x, float(programme.cost @ x)
