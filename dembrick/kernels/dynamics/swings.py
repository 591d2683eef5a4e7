"""What laws of joints keep of a step, while blocks move and while they come to rest.

Where blocks come to rest they swing past it, and nothing of the way there may stay: until they rest, every law answers
from what it kept at the last equilibrium and from how far the blocks have moved since, as in one implicit step. Shear
springs are stretched by all of it, beyond what friction lets them carry; what yields, crushes and lifts is found from
there again at every evaluation. Once the blocks rest, one evaluation more, in which nothing moves and no dashpot acts,
keeps what is so then. Bonds break at once, whatever moves. Where laws crush or dilate, or are the user's own, no
dashpot acts before either: it would answer to the whole of what is crushed or lifted at every step.
"""

from math import inf

from dembrick._jit import jit
from dembrick.kernels.dynamics.tiles import W

MOVING, SWINGING, RESTED = 0, 1, 2


@jit
def set_laws(work, laws):
    """Have the laws of joints answer so, one of the three above."""
    for lane in range(W):
        work.undamped[lane] = 1.0 if laws == RESTED else 0.0
        work.swings[lane] = 1.0 if laws == SWINGING else 0.0


@jit
def dashpots_of(tile, work, lane):
    """Dashpot over spring force for the same increment along the normal, and one plus that in shear."""
    acts = 1.0 - work.undamped[lane]
    return acts * tile.viscous[0, lane], 1.0 + acts * tile.viscous[1, lane]


@jit
def unless_swinging(dashpots, work, lane):
    """The ``dashpots`` of a tile, or none while blocks swing."""
    if work.swings[lane] > 0.0:
        return 0.0, 1.0
    return dashpots


@jit
def bonded_dashpots(dashpots, strengths, i, work, lane):
    """`unless_swinging` for a joint with the strengths ``i``, if it crushes or dilates."""
    if strengths.dilation[i] > 0.0 or strengths.crushing[i] < inf:
        return unless_swinging(dashpots, work, lane)
    return dashpots
