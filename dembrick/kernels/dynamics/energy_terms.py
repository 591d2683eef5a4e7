"""The energy terms of a run in real time: what joints, loads, gravity and new contacts book, and what a step leaves
behind for the next. How they balance: see `energy`."""

from typing import NamedTuple

from numpy import ndarray

from dembrick.kernels.dynamics.tiles import W

FRICTION, RELEASED, STEPPING, BY_LAW, CRUSHING, FRACTURE = range(6)
KINDS = 6
LOADS, CONTACTS, HANDED, TIES_YIELDED, TIES_STEPPED = range(5)

DASHPOTS = 9 * W  # rows of a tile in `EnergyTerms.dashpots`

# Rows of a tile of `EnergyTerms.ledger`, J: what dashpots took; the smallest friction work of a step; what was lost
# (`EnergyTerms.lost`, 6). All since `share` changed
OF_DASHPOTS, SMALLEST, GONE = 0, 1, 2
LEDGER = (GONE + KINDS) * W


class EnergyTerms(NamedTuple):
    """What is counted, J; and what the last step left behind. None where nobody asks for it.

    Shear and torsion are in the sense in which the host slips; axes are those of the joint's elastic forces.
    """

    dashpots: ndarray  # (t * DASHPOTS,) N, N m, what the dashpots of point joints carried last, in tiles like theirs:
    # shear in the sense in which the host slips (2) and N, summed over the points, and these sums times x and y
    ledger: ndarray  # (t * LEDGER,) the energy terms of the point joints, in tiles like theirs
    face: ndarray  # (a, 16) N, N m, J, those of the convex joints, one row because every step reads and writes it all.
    # Springs (3): N and its x and y moments. Dashpots: V_1, V_2, M_T (6 to 8), what opening and closing within steps
    # took (9), N and its moments (12 to 14). What dashpots took (15). All that was taken is since `share` changed
    damped: ndarray  # (j,) what dashpots took until then
    lost: ndarray  # (j, 6) friction; springs let go; opening and closing within a step; friction by its law; crushing;
    # bonds that broke
    least: ndarray  # (j,) the smallest friction work of a step
    share: ndarray  # (j,) what new contacts leave to the joint
    place: ndarray  # (j,) int64, its number among the point joints; of a convex joint -1 less its number
    fallen: ndarray  # (n,) work of gravity, and of what shaking puts in its place
    load: ndarray  # (k, 6) N, N m, the loads
    support: ndarray  # (k, 6) N, N m, of joints and contacts on the supports that are moved
    push: ndarray  # (n, 6) N, N m, of all new contacts on each block
    # (5,) work of loads and of supports that are moved, of new contacts, and what springs of joints held that were
    # handed over; what yielding took from ties, and what those took that became tight or slack within a step
    total: ndarray
    gravity: ndarray  # (3,) m/s2
    begun: ndarray  # (1,) 1 from the first forces on, which are where the energy terms begin
