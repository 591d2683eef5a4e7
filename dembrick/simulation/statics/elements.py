"""Elements that couple the blocks in the equations of equilibrium: joints, then ties, then guides.

A guide is an element between a block and the ground that no force can stretch. Where it acts, the out-of-balance is
its own to bear (`kernels.statics.block_forces.hold`), so that its stiffness only keeps the equations from answering
there: what they move along it is `RIGID` times less than what they move elsewhere.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dembrick.simulation.statics import joint_families, ties
from dembrick.simulation.statics.stiffness import block_stiffness

if TYPE_CHECKING:
    from dembrick.simulation.statics.state import State

RIGID = 1e18  # times the stiffness of the block on its joints


def ends(state: State, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """``a`` and ``b``, of the joints, followed by those of the ties and of the guides: block numbers, or matrices
    (6, 6) of what ends see of the motion of their blocks."""
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
    """Stiffness (e, 6, 6) of all elements: of the joints, of the ties that are tight now, and of the guides."""
    found, blocks = [joint_families.stiffness(state)], state.blocks
    if state.ties is not None:
        found.append(ties.tangent(state.ties))
    if len(blocks.guided):
        diagonal = np.diagonal(block_stiffness(state, shared=1.0)[blocks.guided], axis1=1, axis2=2)
        found.append(np.eye(6) * (RIGID * blocks.held * diagonal)[:, None])
    return np.concatenate(found)
