"""The elastic stiffness of a whole assembly, factorised: all joints closed, none slipping.

As an artificial inertia it lets all modes of an assembly swing together, the long ones of a tower as fast as those of
one block, which the stiffness of each block by itself cannot do.
"""

from __future__ import annotations

import numpy as np

from dembrick.errors import ScenarioError
from dembrick.kernels.math.multifrontal import Rounded, round_factors
from dembrick.kernels.state import WholeInertia
from dembrick.simulation.statics import elements
from dembrick.simulation.statics.sparse_equations import Factors, Pattern, analyse, check_room
from dembrick.simulation.statics.state import State
from dembrick.simulation.statics.stiffness import block_stiffness, to_joint

SINGULAR = 1e-13  # of a diagonal entry: a pivot below this is rounding


def touches_itself(state: State) -> bool:
    """Whether any free block touches another one, is tied, or held by a guide."""
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
    block_a, block_b = elements.ends(state, joints.block_a, joints.block_b)
    return analyse(position[free], number[block_a], number[block_b])


def elastic_factor(state: State, position: np.ndarray) -> Factors:
    """LU factors of the elastic stiffness of blocks whose centroids stand at ``position`` (n, 3) m.

    Ties count where they are tight now. Raises ScenarioError if the joints, closed and sticking, do not hold every
    free block, and if the equations of a search would not fit into the memory.
    """
    joints, free = state.joints, state.blocks.free
    pattern = equations(state, position)
    check_room(pattern)
    factors = Factors(pattern)
    diagonal = np.diagonal(block_stiffness(state, shared=1.0)[free], axis1=1, axis2=2)
    ends = to_joint(joints.axes, joints.arm_a), to_joint(joints.axes, joints.arm_b)
    ends = elements.ends(state, *ends)
    stiffness, least = elements.stiffness(state), pattern.to_rows(SINGULAR * diagonal)
    factors.prepare(*ends, stiffness)
    failed = factors.make(*ends, stiffness, threshold=0.0, least=least)  # symmetric: no row moves
    if failed >= 0:
        block = free[int(np.flatnonzero(pattern.place == failed)[0])]
        raise ScenarioError(
            f"the joints do not hold block number {block} even when they are closed and stick: give its joints more "
            "contact points"
        )
    return factors


def whole_inertia(factors: Factors) -> WholeInertia:
    """The elastic stiffness as artificial inertia."""
    return WholeInertia(factors.pattern.place, factors.fronts, None, np.zeros((1, factors.pattern.rows)))


def rounded_inertia(factors: Factors) -> WholeInertia:
    """The same in single precision."""
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
    return WholeInertia(pattern.place, None, rounded, np.zeros((1, pattern.rows)))
