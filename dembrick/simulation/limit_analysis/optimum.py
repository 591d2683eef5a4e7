"""The least cost of joint forces in equilibrium within their strengths, bounded from both sides."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from dembrick.errors import NotConvergedError
from dembrick.simulation.limit_analysis import bounds, solver
from dembrick.simulation.limit_analysis.friction_surface import first_planes
from dembrick.simulation.limit_analysis.programme import NO_CUTS, Cuts, Loads, Structure, area_normals, programme_of
from dembrick.simulation.limit_analysis.solver import INFEASIBLE, SOLVED, Programme, Solution

FINE = 3e-7  # of the friction of area joints: reduction of their surface within which the lower bound seeks forces
CRUSHED = 1e-8  # of N: accepted excess over the surface of crushing, which lowers the lower bound
MOST_ROUNDS = 80  # of cutting planes
LITTLE = 1e-3  # of the dead loads: least reference load for the accuracy
APART = 1e-6  # of the bound: bounds further apart are sought again,
MEASURED = 2  # times at most
RAY = 1e-6  # of the forces of a load without a limit: accepted violation of equilibrium and strengths
_FAR_OUT = 1e6  # of the strengths, and of the unit of forces


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
        small = price <= APART * max(abs(reached), LITTLE * structure.weight)
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
