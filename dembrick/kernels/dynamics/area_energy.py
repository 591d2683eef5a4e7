"""The energy balance of convex joints in real time, side by side: work of their springs and dashpots over a step, and
what friction takes. What is counted is told in `energy_terms`, and how it balances in `energy`."""

from dembrick._jit import entry, jit
from dembrick.kernels.dynamics.area_tiles import AREA, K_N, REACH, SECOND
from dembrick.kernels.dynamics.energy_terms import (
    BY_LAW,
    DASHPOTS,
    FRICTION,
    GONE,
    LEDGER,
    OF_DASHPOTS,
    PRESSING,
    RELEASED,
    SHEARING,
    SMALLEST,
    SPRINGS,
    STEPPING,
    dashpot_work,
)
from dembrick.kernels.dynamics.tiles import (
    CARRIED,
    DEPTH,
    FORCE,
    GROWTH,
    SLIPPED,
    STILL,
    W,
    put_three,
    three,
)
from dembrick.kernels.joint.area_law import closed_pressure, either_wholly


@jit
def rows_of(energy_terms, own):
    """The tiles of `EnergyTerms.dashpots` and `EnergyTerms.ledger` of tile ``own`` of `Links`; None without any."""
    if energy_terms is None:
        return None, None
    dashpots = energy_terms.dashpots[own * DASHPOTS : (own + 1) * DASHPOTS]
    return dashpots, energy_terms.ledger[own * LEDGER : (own + 1) * LEDGER]


@jit
def add_slip_work(ledger, lane, normal, q1, q2, qm, t1, t2, tm, b1, b2, bm, e1, e2, em):
    """A step in which a convex joint slides by the plastic twist q, or in which it is open and lets go; it held b
    before and holds e."""
    loss = 0.5 * ((b1 + e1) * q1 + (b2 + e2) * q2 + (bm + em) * qm)
    if normal > 0.0:
        ledger[(GONE + FRICTION) * W + lane] += loss
        ledger[(GONE + BY_LAW) * W + lane] += t1 * q1 + t2 * q2 + tm * qm
        ledger[SMALLEST * W + lane] = min(ledger[SMALLEST * W + lane], loss)
    else:
        ledger[(GONE + RELEASED) * W + lane] += loss


@jit
def keep_for_work(work, lane, t1, t2, tm, e1, e2, em, s1, s2, turn):
    """Keep what `add_dashpot_work` wants to know of shear and torsion."""
    put_three(work, CARRIED, lane, (t1 - e1, t2 - e2, tm - em))
    put_three(work, SLIPPED, lane, (s1, s2, turn))


@entry
def add_dashpot_work(face, work, dashpots, ledger):
    """Add what the dashpots of the joints of a tile took in a step: of the forces that were found, what presses the
    springs, what dashpots carry in shear, and the slip."""
    for lane in range(W):
        k_n = face[K_N * W + lane]
        q0, qx, qy = three(work, STILL, lane)
        c0 = work[(FORCE + 2) * W + lane] - k_n * q0
        cx = work[(FORCE + 5) * W + lane] - k_n * qx
        cy = work[(FORCE + 8) * W + lane] - k_n * qy
        taken = dashpot_work(dashpots, lane, PRESSING, c0, cx, cy, *three(work, GROWTH, lane))
        taken += dashpot_work(dashpots, lane, SHEARING, *three(work, CARRIED, lane), *three(work, SLIPPED, lane))
        ledger[OF_DASHPOTS * W + lane] += taken


@jit
def springs_before(face, springs, kept, lane, g0, gx, gy):
    """What pressed the springs of the joint in that lane, N and its moments, at the penetration g of a step ago: kept
    in ``springs``, unless ``kept`` is None: then it was wholly closed or wholly open."""
    if kept is not None:
        return three(springs, 0, lane)
    k_n = face[K_N * W + lane] if g0 > 0.0 else 0.0
    n, nx, ny = closed_pressure(face[AREA * W + lane], three(face, SECOND, lane), g0, gx, gy)
    return k_n * n, k_n * nx, k_n * ny


@entry
def add_stepping(face, work, springs, kept, ledger):
    """Add what opening and closing within a step took from the springs of the joints of a tile, and keep what presses
    them in ``springs``; ``kept``: see `springs_before`."""
    for lane in range(W):
        k_n = face[K_N * W + lane]
        q0, qx, qy = three(work, STILL, lane)
        q0 *= k_n
        qx *= k_n
        qy *= k_n
        g0, gx, gy = three(work, DEPTH, lane)
        d0, dx, dy = three(work, GROWTH, lane)
        o0 = g0 - d0
        ox = gx - dx
        oy = gy - dy
        p0, px, py = springs_before(face, springs, kept, lane, o0, ox, oy)
        ledger[(GONE + STEPPING) * W + lane] += 0.5 * (p0 * g0 + px * gx + py * gy - (q0 * o0 + qx * ox + qy * oy))
        put_three(springs, 0, lane, (q0, qx, qy))


@entry
def opening(face, work):
    """How many joints of a tile are neither wholly closed nor wholly open, and how many went from either to the other
    in the step."""
    partly = passed = 0
    for lane in range(W):
        g0, gx, gy = three(work, DEPTH, lane)
        partly += 0 if either_wholly(face[REACH * W + lane], g0, gx, gy) else 1
        passed += 1 if (g0 > 0.0) != (g0 - work[GROWTH * W + lane] > 0.0) else 0
    return partly, passed


@jit
def add_work(energy_terms, t, own, face, work):
    """Add the work over a step of springs and dashpots of the convex joints in their tile ``t``, which is ``own`` of
    `Links`. The springs of joints that are and stay wholly closed give back what they took to the last."""
    ledger = energy_terms.ledger[own * LEDGER : (own + 1) * LEDGER]
    dashpots = energy_terms.dashpots[own * DASHPOTS : (own + 1) * DASHPOTS]
    add_dashpot_work(face, work, dashpots, ledger)
    springs = energy_terms.springs[t * SPRINGS : (t + 1) * SPRINGS]
    partly, passed = opening(face, work)
    if energy_terms.partly[t] > 0:
        add_stepping(face, work, springs, True, ledger)
    elif partly + passed > 0:
        add_stepping(face, work, springs, None, ledger)
    energy_terms.partly[t] = partly
