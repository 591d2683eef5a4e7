"""The energy terms of a run in real time: what joints, loads, gravity and new contacts add, and what a step leaves
behind for the next. How they balance: see `energy`."""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from dembrick._jit import jit
from dembrick.kernels.dynamics.tiles import put_three, record, three

# What a joint lost, J: friction; springs let go; opening and closing within a step; friction by its law; crushing;
# bonds that broke
LOST = np.dtype((np.record, [(name, float) for name in (
    "friction", "released", "stepping", "by_law", "crushing", "fracture",
)]))  # fmt: skip
# J: work of loads and of supports that are moved, of new contacts, and what springs of joints held that were handed
# over; what yielding took from ties, and what those took that became tight or slack within a step
TOTAL = np.dtype((np.record, [(name, float) for name in (
    "loads", "contacts", "handed", "ties_yielded", "ties_stepped",
)]))  # fmt: skip

# What dashpots carried last: N and its x and y moments of those along the normal (N, N m), V_1, V_2 and M_T of those in
# shear and torsion, in the axes of the joint's elastic forces. Single precision: they are most of what the energy
# balance moves through the memory, and a trapezium with one rounded side errs by some 1e-8 of the work, either way
CARRIED = record(("pressing", 3), ("shearing", 3), kind=np.float32)

# J, all since `share` changed: what dashpots took, the smallest friction work of a step, and what was lost
LEDGER = record(
    ("dashpots", 1), ("smallest", 1), ("friction", 1), ("released", 1), ("stepping", 1), ("by_law", 1), ("crushing", 1),
    ("fracture", 1),
)  # fmt: skip

STEPPING_AT: int = LEDGER.fields["stepping"][1]  # bytes before that row

PRESSURE = record(("pressure", 3))  # N, N m: N and its x and y moments of the springs of convex joints


class Counted(NamedTuple):
    """Records of one tile of `EnergyTerms`."""

    dashpots: ndarray  # a record `CARRIED`
    ledger: ndarray  # a record `LEDGER`


class EnergyTerms(NamedTuple):
    """Energies counted, J, and those that the last step left behind. None if nobody asks for it.

    Shear and torsion are in the sense in which the host slips; axes are those of the joint's elastic forces.
    """

    dashpots: ndarray  # (t,) records `CARRIED`, one a tile of `Links`
    ledger: ndarray  # (t,) records `LEDGER`, the energy terms of the joints, in the same tiles
    springs: ndarray  # (u,) records `PRESSURE`, of those of the convex joints, in their tiles;
    partly: ndarray  # (u,) int64, they are there where this is 1: if one was neither wholly closed nor wholly open
    damped: ndarray  # (j,) what dashpots took until then
    lost: ndarray  # (j,) records `LOST`
    least: ndarray  # (j,) the smallest friction work of a step
    share: ndarray  # (j,) what new contacts leave to the joint
    place: ndarray  # (j,) int64, its number among the point joints; of a convex joint -1 less its number
    fallen: ndarray  # (n,) work of gravity, and of what shaking puts in its place
    load: ndarray  # (k + q, 6) N, N m, the loads and the pressures
    support: ndarray  # (k, 6) N, N m, of joints and contacts on the supports that are moved
    push: ndarray  # (n, 6) N, N m, of all new contacts on each block
    total: ndarray  # (1,) record `TOTAL`
    gravity: ndarray  # (3,) m/s2
    begun: ndarray  # (1,) 1 from the first forces on, which are where the energy terms begin


@jit
def dashpot_work(carried, lane, c0, c1, c2, d0, d1, d2):
    """Work (J) of the dashpots of the joint in that lane over the motion d of a step; ``carried``: the field of
    `CARRIED` for them. They carry c now, which is written down for the next one."""
    last0, last1, last2 = three(carried, lane)
    put_three(carried, lane, (c0, c1, c2))
    return 0.5 * ((last0 + c0) * d0 + (last1 + c1) * d1 + (last2 + c2) * d2)
