"""Reactions of the supports in searches and constant-rate tests: what fixed blocks exert on the structure."""

from __future__ import annotations

import numpy as np

from dembrick.kernels.statics.record import write_reactions
from dembrick.simulation.statics import ties
from dembrick.simulation.statics.state import State


def support_numbers(state: State) -> np.ndarray:
    """The number (n,) of each block among the fixed ones, -1 if it is free."""
    fixed = np.ones(len(state.blocks.displacement), bool)
    fixed[state.blocks.free] = False
    return np.where(fixed, np.cumsum(fixed) - 1, -1)


def reactions(state: State) -> np.ndarray:
    """Force (N) and moment (N m, about its centroid) of every fixed block on the structure, through its joints and ties
    (s, 6).

    World axes: a block at rest on a floor is held up.
    """
    support = support_numbers(state)
    out = np.zeros((int(support.max(initial=-1)) + 1, 6))
    write_reactions(state.joints, support, out)
    return out + ties.at_supports(state)
