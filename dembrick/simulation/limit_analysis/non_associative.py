"""A second opinion without dilatancy: a sequence of programmes with cohesion from the last normal forces.

With Coulomb's cone normality makes sliding joints open, and the associative limit is an upper bound of the limit
without dilatancy. Gilbert, Casapulla and Ahmed (Limit analysis of masonry block structures with non-associative
frictional joints using linear programming, Computers and Structures 84, 2006) replace the cone of each point, programme
by programme, by a line through its last normal force N_i, nearly level: |t_i| <= mu N_i + m (N - N_i) with m much less
than mu. Normality to it lets blocks slide almost level. If N settles, the last state balances the loads, keeps
Coulomb's law, and its mechanism slides by the dilatancy m. That state is one of many: the limit without dilatancy is
not unique, the sequence need not settle, and where it settles depends on where it starts. It is a heuristic, no bound.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from dembrick.errors import NotConvergedError
from dembrick.simulation.floating_point import not_nan
from dembrick.simulation.limit_analysis.analysis import live_wrench, prepared
from dembrick.simulation.limit_analysis.mechanism import Mechanism, mechanism_of
from dembrick.simulation.limit_analysis.optimum import optimum
from dembrick.simulation.limit_analysis.programme import Loads, Structure
from dembrick.simulation.limit_analysis.solver import SOLVED

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly

MOST_PROGRAMMES = 60
DILATANCY = (0.3, 0.1, 0.03, 0.01)  # m over mu: decreasing, each until the load factor settles
KEPT = 0.5  # share of the last N in the next: under-relaxation against oscillation of the sequence
SETTLED = 1e-4  # of the load factor: change between two programmes
LONG = 6  # programmes over which the load factor must be constant if Coulomb's law is not yet met in idle joints
KEPT_TO = 1e-3  # of the greatest strength of a point: accuracy to which the last state meets Coulomb's law
_LEAST = 1e-7  # of the greatest N: least N for the cohesion of a point


@dataclass(frozen=True)
class SecondOpinion:
    """Result of the sequence. ``load_factor`` of the last programme, ``low`` and ``high`` of the last ten;
    ``settled``; ``programmes``: number solved; ``excess``: of the last state over Coulomb's law, relative to the
    greatest strength of a point or area joint; ``ended``: a sentence on how it ended."""

    load_factor: float
    low: float
    high: float
    settled: bool
    programmes: int
    excess: float
    mechanism: Mechanism
    ended: str


def second_opinion(assembly: Assembly) -> SecondOpinion:
    """The limit without dilatancy by the sequence; NotConvergedError if its first programme has no solution."""
    live = live_wrench(assembly)
    structure = prepared(assembly, [live])
    vector = structure.frame.vector(live)
    size = float(np.abs(vector).sum())
    loads = Loads(structure.dead, vector / size)
    seen: list[float] = []
    slope, stage, at_last, settled = structure, 0, 0, False
    last = _solved(slope, loads)
    if last is None:
        raise NotConvergedError(
            "no estimate without dilatancy: the associative programme has no finite limit to start from"
        )
    normal, area_normal = _normals(slope, last.x)
    excess, ended = 0.0, ""
    while len(seen) < MOST_PROGRAMMES:
        slope = _levelled(structure, normal, area_normal, DILATANCY[stage])
        found = _solved(slope, loads)
        if found is None:
            ended = f"stopped, because programme {len(seen) + 1} has no answer"
            break
        last = found
        seen.append(float(last.x[-1]) / size)
        at_last += stage + 1 == len(DILATANCY)
        new, new_area = _normals(slope, last.x)
        excess = _excess(structure, slope, last.x)
        if len(seen) > 1 and abs(seen[-1] - seen[-2]) <= SETTLED * max(abs(seen[-1]), 1e-9):
            if stage + 1 < len(DILATANCY):
                stage += 1
            elif excess <= KEPT_TO or (at_last > LONG and np.ptp(seen[-LONG:]) <= SETTLED * abs(seen[-1])):
                settled = True
                break
        normal, area_normal = (KEPT * old + (1.0 - KEPT) * now for old, now in ((normal, new), (area_normal, new_area)))
    recent = seen[-10:] or [float(last.x[-1]) / size]
    if settled:
        ended = (
            f"settled after {len(seen)} programmes, with a dilatancy of {DILATANCY[-1]:g} of the friction; its forces "
            f"exceed Coulomb's law by {excess:.2g} of the greatest strength"
        )
    elif not ended:
        ended = (
            f"did not settle within {MOST_PROGRAMMES} programmes: the last ten lie between {min(recent):.5g} and "
            f"{max(recent):.5g}, and forces exceed Coulomb's law by {excess:.2g} of the greatest strength"
        )
    _, resultants = slope.carried(last.x)
    moved = mechanism_of(slope, last.y / (size * structure.frame.unit), resultants)
    return SecondOpinion(recent[-1], min(recent), max(recent), settled, len(seen), excess, moved, ended)


def _solved(structure: Structure, loads: Loads):
    cost = np.zeros(structure.layout.n + 1)
    cost[-1] = -1.0
    found = optimum(structure, loads, cost)
    return found if found.status == SOLVED else None


def _normals(structure: Structure, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Normal forces (N) of points (p,) and of area joints (a,), not negative."""
    forces = structure.layout.forces(x)
    area = np.bincount(structure.areas.owner, forces.corner, minlength=len(structure.areas))
    return np.maximum(forces.normal, 0.0), np.maximum(area, 0.0)


def _levelled(structure: Structure, normal: np.ndarray, area_normal: np.ndarray, share: float) -> Structure:
    """The structure with cones whose slope is reduced to its ``share``, turned about the last normal forces."""

    def turned(strengths, carried):
        least = _LEAST * max(float(normal.max(initial=0.0)), float(area_normal.max(initial=0.0)))
        cohesion = (1.0 - share) * strengths.friction * np.maximum(carried, least)
        return replace(strengths, friction=share * strengths.friction, adhesion=strengths.adhesion + cohesion)

    return structure.strengthened(turned(structure.points, normal), turned(structure.areas, area_normal))


def _excess(structure: Structure, slope: Structure, x: np.ndarray) -> float:
    """Excess of points and area joints over Coulomb's law, relative to the greatest strength of one."""
    forces, worst, most = slope.layout.forces(x), 0.0, 1e-300
    points, areas = structure.points, structure.areas
    if len(points.joint):
        cap = points.adhesion + points.friction * forces.normal
        worst = float((np.linalg.norm(forces.tangential, axis=1) - cap).max())
        most = float(cap.max())
    if len(areas):
        carried = np.bincount(areas.owner, forces.corner, minlength=len(areas)) - areas.tension
        cap = areas.adhesion + areas.friction * carried
        worst = max(worst, float((np.linalg.norm(forces.shear[:, :2], axis=1) - cap).max()))
        most = max(most, float(cap.max()))
    return max(0.0, not_nan(worst / most, "the out-of-balance force of the estimate without dilatancy"))
