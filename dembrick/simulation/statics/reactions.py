"""Forces of supports and ties at the end of a search or constant-rate test."""

from __future__ import annotations

import numpy as np

from dembrick.kernels.statics.record import write_guides, write_reactions
from dembrick.simulation.statics import ties
from dembrick.simulation.statics.state import State


def support_numbers(state: State) -> np.ndarray:
    """The number (n,) of each block among those that are fixed, or held in some directions; -1 of the others."""
    supporting = np.ones(len(state.blocks.displacement), bool)
    supporting[state.blocks.free] = False
    supporting[state.blocks.guided] = True
    return np.where(supporting, np.cumsum(supporting) - 1, -1)


def reactions(state: State) -> np.ndarray:
    """Force (N) and moment (N m, about its centroid) of every fixed block on the structure, through its joints and
    ties, and of the guides on every block that they hold (s, 6).

    World axes: a block at rest on a floor is held up.
    """
    support = support_numbers(state)
    out = np.zeros((int(support.max(initial=-1)) + 1, 6))
    write_reactions(state.joints, support, out)
    if state.ties is not None:
        out += ties.on_supports(state, support)
    write_guides(state.blocks, support, out)
    return out


class Ended:
    """Reactions and ties in the last ``state`` of a finished search or test."""

    state: State

    @property
    def reactions(self) -> np.ndarray:
        """Of the supports (s, 6), see `reactions`."""
        return reactions(self.state)

    @property
    def ties(self) -> tuple[np.ndarray, np.ndarray]:
        """Tension (t,) N of the ties at the end, and the elongation (t,) m that they keep."""
        return self.state.ties.tension, self.state.ties.yielded
