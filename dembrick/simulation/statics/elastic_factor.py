"""The elastic stiffness of a whole assembly, factorised: all joints closed, none slipping.

As an artificial inertia it gives all modes of an assembly the same frequency, the long ones of a tower as those of
one block, which the stiffness of each block by itself cannot do.

The elements that couple the blocks in the equations of equilibrium are joints, then ties, then guides.

A guide is a rigid element between a block and the ground. In its direction it carries the out-of-balance force
(`kernels.statics.block_forces.apply_guides`), so its stiffness only suppresses motion in the equations: motion along it
is `RIGID` times less than elsewhere.
"""

from __future__ import annotations

import time

import numpy as np

from dembrick.errors import ScenarioError
from dembrick.kernels.math.multifrontal import Rounded, round_factors
from dembrick.kernels.state import WholeInertia
from dembrick.simulation.statics import joint_families, ties
from dembrick.simulation.statics.sparse_equations import Factors, Pattern, analyse, check_room
from dembrick.simulation.statics.state import State
from dembrick.simulation.statics.stiffness import block_stiffness, to_joint

SINGULAR = 1e-13  # of a diagonal entry: a pivot below this is rounding


def touches_itself(state: State) -> bool:
    """Whether any free block touches another free block, has a tie, or a guide."""
    if state.ties is not None or len(state.blocks.guided):
        return True
    free = np.zeros(len(state.blocks.displacement), bool)
    free[state.blocks.free] = True
    return bool((free[state.joints.block_a] & free[state.joints.block_b]).any())


def equations(state: State, position: np.ndarray) -> Pattern:
    """Symbolic analysis of the equations of blocks whose centroids stand at ``position`` (n, 3) m."""
    joints, free = state.joints, state.blocks.free
    number = np.full(len(position), -1)
    number[free] = np.arange(len(free))
    block_a, block_b = ends(state, joints.block_a, joints.block_b)
    return analyse(position[free], number[block_a], number[block_b])


def elastic_factor(state: State, position: np.ndarray) -> Factors:
    """LU factors of the elastic stiffness of blocks whose centroids stand at ``position`` (n, 3) m.

    Ties contribute if they are taut now. Raises ScenarioError if the joints, closed and sticking, do not hold every
    free block, and if the equations of a search would not fit into the memory.
    """
    joints, free, began = state.joints, state.blocks.free, time.perf_counter()
    pattern = equations(state, position)
    check_room(pattern)
    factors = Factors(pattern)
    factors.seconds = time.perf_counter() - began  # the order of elimination is part of the work on the equations
    diagonal = np.diagonal(block_stiffness(state, shared=1.0)[free], axis1=1, axis2=2)
    seen = ends(state, to_joint(joints.axes, joints.arm_a), to_joint(joints.axes, joints.arm_b))
    own, least = stiffness(state), pattern.to_rows(SINGULAR * diagonal)
    factors.prepare(*seen, own)
    failed = factors.make(*seen, own, threshold=0.0, least=least)  # symmetric: no row moves
    if failed >= 0:
        block = free[int(np.flatnonzero(pattern.place == failed)[0])]
        raise ScenarioError(
            f"block number {block} can move even if all its joints are closed and stick: give its joints more "
            "contact points"
        )
    return factors


def rounded_inertia(factors: Factors) -> WholeInertia:
    """The elastic stiffness as artificial inertia, in single precision."""
    pattern, fronts = factors.pattern, factors.fronts
    pivots = 6 * np.diff(fronts.first)
    count = pivots * (pivots - 1) // 2 + pivots * 6 * np.diff(fronts.edge)
    rounded = Rounded(
        first=fronts.first,
        edge=fronts.edge,
        boundary=fronts.boundary,
        start=np.cumsum(count) - count,
        values=np.empty(count.sum(), np.float32),
        inverse=np.empty(pattern.rows),
        near=np.empty_like(fronts.near),
    )
    round_factors(fronts, rounded)
    return WholeInertia(pattern.place, rounded, np.zeros((1, pattern.rows)))


RIGID = 1e18  # times the stiffness of the block on its joints


def ends(state: State, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """``a`` and ``b``, of the joints, followed by those of the ties and of the guides: block numbers, or matrices
    (6, 6) from the motion of blocks to that of the ends of elements."""
    found, guided = [(a, b)], state.blocks.guided
    if state.ties is not None:
        of_ties = state.ties
        found.append((of_ties.block_a, of_ties.block_b) if a.ndim == 1 else (of_ties.seen_a, of_ties.seen_b))
    if len(guided):
        seen = np.tile(np.eye(6), (len(guided), 1, 1))
        found.append((np.full(len(guided), ground(state)), guided) if a.ndim == 1 else (seen, seen))
    first, second = zip(*found, strict=True)
    return np.concatenate(first), np.concatenate(second)


def ground(state: State) -> int:
    """A fixed block."""
    fixed = np.ones(len(state.blocks.displacement), bool)
    fixed[state.blocks.free] = False
    return int(np.flatnonzero(fixed)[0])


def stiffness(state: State) -> np.ndarray:
    """Stiffness (e, 6, 6) of all elements: of the joints, of the ties that are taut now, and of the guides."""
    found, blocks = [joint_families.stiffness(state)], state.blocks
    if state.ties is not None:
        found.append(ties.tangent(state.ties))
    if len(blocks.guided):
        diagonal = np.diagonal(block_stiffness(state, shared=1.0)[blocks.guided], axis1=1, axis2=2)
        found.append(np.eye(6) * (RIGID * blocks.held * diagonal)[:, None])
    return np.concatenate(found)
