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
from dembrick.simulation.limit_analysis import solver
from dembrick.simulation.limit_analysis.equilibrium import JointForces
from dembrick.simulation.limit_analysis.mechanism import Mechanism, mechanism_of, names_of
from dembrick.simulation.limit_analysis.optimum import LITTLE, optimum
from dembrick.simulation.limit_analysis.programme import (
    Cuts,
    Loads,
    Structure,
    programme_of,
    structure_of,
)
from dembrick.simulation.limit_analysis.solver import SOLVED, UNBOUNDED, Entries, Programme
from dembrick.simulation.limit_analysis.strength import (
    Material,
    area_strengths,
    bounded_by_corners,
    corner_points,
    point_strengths,
)

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly

GAP = 1e-4  # of the load factor: a wider gap between the bounds is an error
_STANDS = 1e-7  # of the dead loads: out-of-balance force that counts as zero
_NOTHING = 1e-12  # of its forces: a smaller resultant of a load on each block counts as zero
_TILT_ROUNDS, _TILT_SETTLED = 40, 1e-10
_STEEPEST = 1e6  # tangent of an angle that is 90 deg


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
    heavy = structure.weight / size  # the multiplier that makes the load as great as the dead loads
    refuse_gap(lower, upper, heavy, "the load factor")
    return limit


def refuse_gap(lower: float, upper: float, heavy: float, what: str) -> None:
    """Raise NotConvergedError if two bounds are too far apart; ``heavy``: the value that equals the dead loads."""
    gap = upper - lower
    if not (math.isfinite(gap) and gap <= GAP * max(abs(lower), abs(upper), LITTLE * heavy)):
        raise NotConvergedError(
            f"limit analysis: the bounds {lower:.6g} and {upper:.6g} of {what} are further apart than {GAP:g} of it, "
            "so there is no answer; the usual cause is joints or blocks of very different sizes"
        )


def standing(structure: Structure) -> Standing:
    """Whether any forces within the strengths balance the dead loads.

    Blocks between which only supports lie are judged by their own dead loads: a light one may fall beside heavy ones.
    """
    layout = structure.layout
    found = optimum(structure, Loads(structure.dead, None), np.zeros(layout.n))
    if found.status == SOLVED and found.reached == 0.0:
        return Standing(True, 0.0, found.x, None)
    group = _groups(structure)
    missing, y = _least_missing(structure, found.cuts, _lengths(structure, group)[group])
    least = max(_NOTHING * structure.weight, 1e-300)  # of blocks without dead loads
    lacking = np.bincount(group, missing) / np.maximum(np.bincount(group, structure.weights), least)
    unbalanced = float(lacking.max())
    if unbalanced <= _STANDS:
        return Standing(True, unbalanced, found.x if found.status == SOLVED else np.zeros(layout.n), None)
    falling = np.repeat(lacking[group] > _STANDS, structure.frame.per_block)
    forces = np.ones((len(structure.assembly.joints), 6))  # without equilibrium every joint counts as closed
    return Standing(False, unbalanced, None, mechanism_of(structure, np.where(falling, y, 0.0), forces))


def _groups(structure: Structure) -> np.ndarray:
    """Number (f,) of the group of each free block: those that joints and ties connect without a support between."""
    assembly, number = structure.assembly, structure.frame.number
    of_joints = np.column_stack([assembly.joints.block_a, assembly.joints.block_b])
    first, second = number[np.concatenate([of_joints, assembly.ties.ends.block])].T
    both = (first >= 0) & (second >= 0)
    return solver.connected(first[both], second[both], len(structure.frame.free))


def _lengths(structure: Structure, group: np.ndarray) -> np.ndarray:
    """Unit of moments (m) of each group of blocks, as that of the `Frame` of all: ``group`` (f,) of each block."""
    joints, number = structure.assembly.joints, structure.frame.number
    own = np.repeat(group[np.maximum(number[joints.block_a], number[joints.block_b])], np.diff(joints.start))
    reach, found = np.linalg.norm(joints.corner, axis=1), np.full(int(group.max()) + 1, structure.frame.length)
    for i in np.unique(own):
        found[i] = np.median(reach[own == i])
    return found


def _least_missing(structure: Structure, cuts: Cuts, length: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The out-of-balance forces (f,) of free blocks with the least sum, and the dual velocities: those of the fall, of
    length one at most for each block. ``cuts`` bound the area joints; a moment counts as the force that causes it at a
    ``length`` (f,) m."""
    n, rows, per = structure.layout.n, structure.frame.rows, structure.frame.per_block
    blocks = rows // per
    plain = programme_of(structure, Loads(structure.dead, None), np.zeros(n), cuts)
    number, d = np.arange(rows), len(structure.frame.forces)
    unit = np.ones((blocks, per))
    unit[:, d:] = (length / structure.frame.length)[:, None]
    size = (per + 1) * np.arange(blocks)
    extra = Entries.joined(
        Entries(size, n + rows + np.arange(blocks), np.full(blocks, -1.0)),
        Entries(np.repeat(size, per) + 1 + number % per, n + number, np.full(rows, -1.0)),
    ).moved(rows=len(plain.limits))
    programme = Programme(
        cost=np.concatenate([np.zeros(n + rows), np.ones(blocks)]),
        equations=Entries.joined(plain.equations, Entries(number, n + number, unit.ravel())),
        right_hand=plain.right_hand,
        rows=Entries.joined(plain.rows, extra),
        limits=np.concatenate([plain.limits, np.zeros((per + 1) * blocks)]),
        linear=plain.linear,
        quadratic=np.concatenate([plain.quadratic, np.full(blocks, per + 1)]),
    )
    found = solver.solve(programme)
    missing = not_nan(float(programme.cost @ found.x), "what limit analysis leaves out of balance")
    little = missing <= LITTLE * structure.weight
    if found.status != SOLVED or (little and found.said != solver.TO_TOLERANCE):
        raise NotConvergedError(
            f"limit analysis: the solver ended with the status {found.said} while it balanced the dead loads"
        )
    return np.maximum(found.x[n + rows :], 0.0), found.equation_dual
