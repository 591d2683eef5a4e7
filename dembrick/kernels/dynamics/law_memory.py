"""The memory of the laws of joints in motion and in the search for an equilibrium.

In the search for an equilibrium blocks swing past it, and nothing of that swing may be irreversible. So until they
rest, every law is evaluated from its memory at the last equilibrium for all motion of the blocks since, as in one
implicit step. Shear springs are stretched by all of it, even beyond the force that friction allows, or while a joint
that was closed is open on the swing; yielding, crushing and lift are computed from there again at every evaluation.
Once the blocks rest, one more evaluation, without motion or dashpots, stores the state. Only bonds break at once. If
laws crush or dilate, or are user-defined, no dashpot acts before that either: in every step it would respond to all
that is crushed or lifted.

Such friction is no loss, and if joints open and close again and again, with great friction, blocks may swing for ever.
So in a search that takes too long (`FORGETTING`) joints that open lose their shear.
"""

from math import inf

from dembrick._jit import jit
from dembrick.kernels.dynamics.tiles import W

MOVING, SEARCHING, RESTED, FORGETTING = 0, 1, 2, 3


@jit
def set_law_mode(work, laws):
    """Set the mode of the laws of joints, one of the four above."""
    for lane in range(W):
        work.undamped[lane] = 1.0 if laws == RESTED else 0.0
        work.searching[lane] = 1.0 if in_search(laws) else 0.0
        work.keeping[lane] = 1.0 if laws == SEARCHING else 0.0


@jit
def in_search(laws):
    """Whether laws store nothing of a step."""
    return laws in (SEARCHING, FORGETTING)


@jit
def keeps_shear(elastic, work, lane):
    """Whether a joint keeps its shear (3, N, N, N m) while open: it had some at the last equilibrium, closed there."""
    return work.keeping[lane] > 0.0 and (elastic[0] != 0.0 or elastic[1] != 0.0 or elastic[2] != 0.0)


@jit
def dashpots_of(tile, work, lane):
    """Dashpot over spring force for the same increment along the normal, and one plus that in shear."""
    acts = 1.0 - work.undamped[lane]
    return acts * tile.viscous[0, lane], 1.0 + acts * tile.viscous[1, lane]


@jit
def dashpots_in_mode(dashpots, work, lane):
    """The ``dashpots`` of a tile, or none while blocks swing."""
    if work.searching[lane] > 0.0:
        return 0.0, 1.0
    return dashpots


@jit
def bonded_dashpots(dashpots, strengths, i, work, lane):
    """`dashpots_in_mode` for a joint with the strengths ``i``, if it crushes or dilates."""
    if strengths.dilation[i] > 0.0 or strengths.crushing[i] < inf:
        return dashpots_in_mode(dashpots, work, lane)
    return dashpots
