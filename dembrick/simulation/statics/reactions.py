"""What the supports and the ties do at the end of a search or constant-rate test."""

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


class Ended:
    """What a finished search or test says of its last ``state``."""

    state: State

    @property
    def reactions(self) -> np.ndarray:
        """Of the supports (s, 6), see `reactions`."""
        return reactions(self.state)

    @property
    def ties(self) -> tuple[np.ndarray, np.ndarray]:
        """Tension (t,) N of the ties at the end, and the elongation (t,) m that they keep."""
        return self.state.ties.tension, self.state.ties.yielded
