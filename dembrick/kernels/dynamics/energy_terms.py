"""The energy terms of a run in real time: contributions of joints, loads, gravity and new contacts, and the quantities
of a step that the next one needs. How they balance: see `energy`."""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from dembrick._jit import jit
from dembrick.kernels.dynamics.tiles import put_three, record, three

# Losses of a joint, J: friction; release of springs; opening and closing within a step; friction by its law; crushing;
# breaking of bonds
LOST = np.dtype((np.record, [(name, float) for name in (
    "friction", "released", "stepping", "by_law", "crushing", "fracture",
)]))  # fmt: skip
# J: work of loads and of moving supports, of new contacts, energy in springs of joints that were handed over; losses
# of ties by yielding, and by becoming tight or slack within a step
TOTAL = np.dtype((np.record, [(name, float) for name in (
    "loads", "contacts", "handed", "ties_yielded", "ties_stepped",
)]))  # fmt: skip

# Last forces of the dashpots: N and its x and y moments along the normal (N, N m), V_1, V_2 and M_T in shear and
# torsion, in the axes of the joint's elastic forces. Single precision: they are most of the memory traffic of the
# energy balance, and rounding one side of a trapezium costs some 1e-8 of the work, of either sign
CARRIED = record(("pressing", 3), ("shearing", 3), kind=np.float32)

# J, since the last `collect_losses`: work of dashpots, the smallest friction work of a step, and losses
LEDGER = record(
    ("dashpots", 1), ("smallest", 1), ("friction", 1), ("released", 1), ("stepping", 1), ("by_law", 1), ("crushing", 1),
    ("fracture", 1),
)  # fmt: skip

STEPPING_AT: int = LEDGER.fields["stepping"][1]  # offset of that row in bytes

PRESSURE = record(("pressure", 3))  # N, N m: N and its x and y moments of the springs of convex joints


class Counted(NamedTuple):
    """Records of one tile of `EnergyTerms`."""

    dashpots: ndarray  # a record `CARRIED`
    ledger: ndarray  # a record `LEDGER`


class EnergyTerms(NamedTuple):
    """Energies accumulated, J, and quantities of the last step. None if they are not requested.

    Shear and torsion are in the sense in which the host slips; axes are those of the joint's elastic forces.
    """

    dashpots: ndarray  # (t,) records `CARRIED`, one per tile of `Links`
    ledger: ndarray  # (t,) records `LEDGER`, the energy terms of the joints, in the same tiles
    springs: ndarray  # (u,) records `PRESSURE` of the convex joints, in their tiles
    partly: ndarray  # (u,) int64, 1 if ``springs`` is stored: if a joint was neither wholly closed nor wholly open
    damped: ndarray  # (j,) work of dashpots until the last `collect_losses`
    lost: ndarray  # (j,) records `LOST`
    least: ndarray  # (j,) the smallest friction work of a step
    share: ndarray  # (j,) share of the joint beside a new contact
    place: ndarray  # (j,) int64, its number among the point joints; -1 minus its number for a convex joint
    fallen: ndarray  # (n,) work of gravity, or of the acceleration of shaking in its place
    load: ndarray  # (k + q, 6) N, N m, the loads and the pressures
    support: ndarray  # (k, 6) N, N m, of joints and contacts on the moving supports
    push: ndarray  # (n, 6) N, N m, of all new contacts on each block
    total: ndarray  # (1,) record `TOTAL`
    gravity: ndarray  # (3,) m/s2
    begun: ndarray  # (1,) 1 from the first forces on, from which the energy terms count


@jit
def dashpot_work(carried, lane, c0, c1, c2, d0, d1, d2):
    """Work (J) of the dashpots of the joint in that lane over the motion d of a step; ``carried``: the field of
    `CARRIED` for them. Their force is c now, which is stored for the next step."""
    last0, last1, last2 = three(carried, lane)
    put_three(carried, lane, (c0, c1, c2))
    return 0.5 * ((last0 + c0) * d0 + (last1 + c1) * d1 + (last2 + c2) * d2)
