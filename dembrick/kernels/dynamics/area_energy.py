"""The energy balance of convex joints in real time, side by side: work of their springs and dashpots over a step, and
what friction takes. What is counted is told in `energy_terms`, and how it balances in `energy`."""

from dembrick._jit import entry, jit
from dembrick.kernels.dynamics.area_tiles import AREA, K_N, K_S, REACH, SECOND
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
    REST,
    SLIPPED,
    STILL,
    VISCOUS,
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
def add_dashpot_work(tile, face, work, dashpots, ledger, rest):
    """Add what the dashpots of the joints of a tile took in a step. Those of joints that are done by `stick` act on all
    that they move by, or on nothing where a joint is open; of the others, of which there are none if ``rest`` is None,
    from the forces that were found, what presses the springs and what dashpots carry in shear."""
    for lane in range(W):
        k_n = face[K_N * W + lane]
        k_s = face[K_S * W + lane]
        area = face[AREA * W + lane]
        second = three(face, SECOND, lane)
        growth = three(work, GROWTH, lane)
        slipped = three(work, SLIPPED, lane)
        closed = work[DEPTH * W + lane] > 0.0
        c = tile[VISCOUS * W + lane] * k_n if closed else 0.0
        c0, cx, cy = closed_pressure(c * area, (c * second[0], c * second[1], c * second[2]), *growth)
        c = tile[(VISCOUS + 1) * W + lane] * k_s if closed else 0.0
        c1 = c * area * slipped[0]
        c2 = c * area * slipped[1]
        cm = c * (second[0] + second[1]) * slipped[2]
        if rest is not None:
            q0, qx, qy = three(work, STILL, lane)
            v1, v2, vm = three(work, CARRIED, lane)
            alone = work[REST * W + lane] > 0.0
            c0 = work[(FORCE + 2) * W + lane] - k_n * q0 if alone else c0
            cx = work[(FORCE + 5) * W + lane] - k_n * qx if alone else cx
            cy = work[(FORCE + 8) * W + lane] - k_n * qy if alone else cy
            c1 = v1 if alone else c1
            c2 = v2 if alone else c2
            cm = vm if alone else cm
        taken = dashpot_work(dashpots, lane, PRESSING, c0, cx, cy, *growth)
        taken += dashpot_work(dashpots, lane, SHEARING, c1, c2, cm, *slipped)
        ledger[OF_DASHPOTS * W + lane] += taken


@entry
def press_wholly(face, work):
    """What presses the springs of the joints of a tile that are all wholly closed or wholly open, into `STILL`."""
    for lane in range(W):
        g = three(work, DEPTH, lane)
        n, nx, ny = closed_pressure(face[AREA * W + lane], three(face, SECOND, lane), *g)
        closed = g[0] > 0.0
        put_three(work, STILL, lane, (n if closed else 0.0, nx if closed else 0.0, ny if closed else 0.0))


@jit
def leave_alone(work, first):
    """Let no joint be in the lanes of a tile from ``first`` on."""
    zero = (0.0, 0.0, 0.0)
    for lane in range(first, W):
        work[REST * W + lane] = 0.0
        put_three(work, GROWTH, lane, zero)
        put_three(work, DEPTH, lane, zero)
        put_three(work, STILL, lane, zero)
        put_three(work, SLIPPED, lane, zero)


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
def add_work(energy_terms, t, own, tile, face, work, rest, used):
    """Add the work over a step of springs and dashpots of the convex joints in their tile ``t``, which is ``own`` of
    `Links`, in its first ``used`` lanes; ``rest``: see `stick`. The springs of joints that are and stay wholly closed
    give back what they took to the last."""
    ledger = energy_terms.ledger[own * LEDGER : (own + 1) * LEDGER]
    dashpots = energy_terms.dashpots[own * DASHPOTS : (own + 1) * DASHPOTS]
    springs = energy_terms.springs[t * SPRINGS : (t + 1) * SPRINGS]
    partly = 0
    if rest:
        leave_alone(work, used)
        add_dashpot_work(tile, face, work, dashpots, ledger, True)
        partly, passed = opening(face, work)
        if energy_terms.partly[t] > 0:
            add_stepping(face, work, springs, True, ledger)
        elif partly + passed > 0:
            add_stepping(face, work, springs, None, ledger)
    else:
        add_dashpot_work(tile, face, work, dashpots, ledger, None)
        if energy_terms.partly[t] > 0:
            press_wholly(face, work)
            add_stepping(face, work, springs, True, ledger)
    energy_terms.partly[t] = partly
