"""The least and the greatest reaction of a support, to which a small motion of the support leads; or force of joints.

A statically indeterminate structure can carry its dead loads in many ways. If a support yields along a
direction, the reaction along it falls at once to the least value that equilibrium allows within the strengths; if it is
pushed against the structure, the reaction grows to the greatest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from dembrick.simulation.limit_analysis.analysis import Standing, falls, prepared, refuse_gap, standing
from dembrick.simulation.limit_analysis.mechanism import Mechanism, mechanism_of
from dembrick.simulation.limit_analysis.optimum import optimum
from dembrick.simulation.limit_analysis.programme import Loads, Structure
from dembrick.simulation.limit_analysis.solver import UNBOUNDED

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly


@dataclass(frozen=True)
class Extreme:
    """One end of the range of a reaction (N): it lies between ``reached``, the value of forces in equilibrium, and
    ``bound``; both are infinite if nothing limits it. ``resultants`` (j, 6) there; ``mechanism`` of the blocks when the
    support begins to move along the direction (least) or against it (greatest), None for the force of a joint;
    ``carried``: sum of the joint forces on the support, or in the joint (N)."""

    reached: float
    bound: float
    resultants: np.ndarray | None
    mechanism: Mechanism | None
    carried: float = 0.0

    @property
    def value(self) -> float:
        """The middle of both; 0 if they lie on either side of it."""
        if math.isinf(self.reached):
            return self.reached
        return 0.0 if self.reached * self.bound <= 0.0 else 0.5 * (self.reached + self.bound)


def reaction_range(
    assembly: Assembly, support: np.ndarray, direction: np.ndarray, joints: np.ndarray | None = None
) -> tuple[Extreme, Extreme]:
    """Least and greatest force along ``direction`` (3,) unit that the fixed blocks ``support`` (k,) exert on the others
    under the dead loads; with ``joints`` (j,) bool, that any blocks exert through these joints alone.
    NotConvergedError if the structure does not stand."""
    structure = prepared(assembly, along=direction)
    inner = standing(structure)
    if not inner.stands:
        raise falls(assembly, inner)
    row, level = _reaction(structure, support, direction, joints=joints)
    loads, unit = Loads(structure.dead, None), structure.frame.unit
    touching = joints
    if joints is None:
        touching = np.isin(assembly.joints.block_a, support) | np.isin(assembly.joints.block_b, support)
    ends = []
    for sign in (1.0, -1.0):
        found = optimum(structure, loads, sign * row, inner.x)
        if found.status == UNBOUNDED:
            ends.append(Extreme(-sign * math.inf, -sign * math.inf, None, None))
            continue
        reached, bound = (unit * (sign * value + level) for value in (found.reached, found.bound))
        refuse_gap(min(reached, bound), max(reached, bound), unit * structure.weight, "a reaction")
        _, resultants = structure.carried(found.x)
        given = np.zeros((len(assembly.fixed), 3))
        given[support] = -sign * np.asarray(direction, float)
        moved = mechanism_of(structure, found.y, resultants, given) if joints is None else None
        carried = float(np.linalg.norm(resultants[touching, :3], axis=1).sum())
        ends.append(Extreme(reached, bound, resultants, moved, carried))
    return ends[0], ends[1]


def first_motion(structure: Structure, stands: Standing, support: int, motion: np.ndarray) -> Mechanism | None:
    """Mechanism by which a structure that ``stands`` follows the small ``motion`` (6,) of a fixed block, velocity of
    its centroid and rotation. The reaction along the motion falls to its least value, whose dual is the mechanism. None
    if the blocks are locked between their supports and cannot follow.
    """
    row, _ = _reaction(structure, np.array([support]), -motion[:3], -motion[3:])
    found = optimum(structure, Loads(structure.dead, None), row, stands.x)
    if found.status == UNBOUNDED:
        return None
    _, resultants = structure.carried(found.x)
    given = np.zeros((len(structure.assembly.fixed), 6))
    given[support] = motion
    return mechanism_of(structure, found.y, resultants, given)


def _reaction(
    structure: Structure,
    support: np.ndarray,
    direction: np.ndarray,
    axis: np.ndarray | None = None,
    joints: np.ndarray | None = None,
) -> tuple[np.ndarray, float]:
    """The reaction along ``direction`` (3,), and about an ``axis`` (3,) through the centroid of the first block, in
    ``frame.unit`` as row . x + level: row (n,), level; with ``joints`` (j,) bool, the force through these alone."""
    number = np.full(len(structure.assembly.fixed), -1)
    number[support] = 0
    none = np.zeros((0, 3))
    ways = [(1.0, np.reshape(direction, (1, 3)), none)]
    if axis is not None and axis.any():
        ways.append((structure.frame.length, none, np.reshape(axis, (1, 3))))
    row, level = np.zeros(structure.layout.n), 0.0
    for size, forces, moments in ways:
        frame = replace(
            structure.frame,
            free=np.asarray(support)[:1],
            number=number,
            forces=forces,
            moments=moments,
            moves=np.ones((1, 1), bool),
        )
        entries = structure.layout.equilibrium(frame)
        np.add.at(row, entries.column, -size * entries.value)
        level += size * float(structure.layout.bond(frame, joints)[0])
    if joints is not None:
        row[~structure.layout.of_joints(joints)] = 0.0
    return row, level
