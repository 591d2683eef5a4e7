"""The energy balance of convex joints in real time, side by side: work of their springs and dashpots over a step, and
friction losses. `energy_terms` says what is counted, `energy` how it balances."""

from dembrick._jit import entry, jit
from dembrick.kernels.dynamics.energy_terms import (
    dashpot_work,
)
from dembrick.kernels.dynamics.tiles import (
    W,
    put_three,
    three,
)
from dembrick.kernels.joint.area_law import closed_pressure, either_wholly


@jit
def add_slip_work(ledger, lane, normal, twist, force, before, after):
    """Add the loss of a step in which a convex joint slides by the plastic ``twist`` (3) under its shear ``force`` (3),
    or is open and releases its springs; their forces were ``before`` (3) and are ``after``."""
    q1, q2, qm = twist
    loss = 0.5 * ((before[0] + after[0]) * q1 + (before[1] + after[1]) * q2 + (before[2] + after[2]) * qm)
    if normal > 0.0:
        ledger.friction[lane] += loss
        ledger.by_law[lane] += force[0] * q1 + force[1] * q2 + force[2] * qm
        ledger.smallest[lane] = min(ledger.smallest[lane], loss)
    else:
        ledger.released[lane] += loss


@jit
def store_shear(work, lane, force, elastic, slip):
    """Store shear and torsion for `add_dashpot_work`."""
    put_three(work.carried, lane, (force[0] - elastic[0], force[1] - elastic[1], force[2] - elastic[2]))
    put_three(work.slipped, lane, slip)


@entry
def add_dashpot_work(tile, face, work, dashpots, ledger, rest):
    """Add the work of the dashpots of the joints of a tile in a step. Dashpots of joints evaluated by `sticking_forces`
    act on all of their motion, or on none if a joint is open. For the other joints, of which there are none if ``rest``
    is None, it follows from their forces, the pressure on their springs and the shear in their dashpots."""
    for lane in range(W):
        k_n = face.k_n[lane]
        k_s = face.k_s[lane]
        area = face.area[lane]
        second = three(face.second, lane)
        growth = three(work.growth, lane)
        slipped = three(work.slipped, lane)
        closed = work.depth[0, lane] > 0.0
        c = tile.viscous[0, lane] * k_n if closed else 0.0
        c0, cx, cy = closed_pressure(c * area, (c * second[0], c * second[1], c * second[2]), *growth)
        c = tile.viscous[1, lane] * k_s if closed else 0.0
        c1 = c * area * slipped[0]
        c2 = c * area * slipped[1]
        cm = c * (second[0] + second[1]) * slipped[2]
        if rest is not None:
            q0, qx, qy = three(work.still, lane)
            v1, v2, vm = three(work.carried, lane)
            alone = work.rest[lane] > 0.0
            c0 = work.force[2, lane] - k_n * q0 if alone else c0
            cx = work.x_force[2, lane] - k_n * qx if alone else cx
            cy = work.y_force[2, lane] - k_n * qy if alone else cy
            c1 = v1 if alone else c1
            c2 = v2 if alone else c2
            cm = vm if alone else cm
        taken = dashpot_work(dashpots.pressing, lane, c0, cx, cy, *growth)
        taken += dashpot_work(dashpots.shearing, lane, c1, c2, cm, *slipped)
        ledger.dashpots[lane] += taken


@entry
def pressure_of_closed_or_open(face, work):
    """Pressure on the springs of the joints of a tile, all wholly closed or wholly open, into ``work.still``."""
    for lane in range(W):
        g = three(work.depth, lane)
        n, nx, ny = closed_pressure(face.area[lane], three(face.second, lane), *g)
        closed = g[0] > 0.0
        put_three(work.still, lane, (n if closed else 0.0, nx if closed else 0.0, ny if closed else 0.0))


@jit
def clear_unused_lanes(work, first):
    """Clear the lanes of a tile from ``first`` on, which have no joint."""
    zero = (0.0, 0.0, 0.0)
    for lane in range(first, W):
        work.rest[lane] = 0.0
        put_three(work.growth, lane, zero)
        put_three(work.depth, lane, zero)
        put_three(work.still, lane, zero)
        put_three(work.slipped, lane, zero)


@jit
def springs_before(face, springs, kept, lane, g0, gx, gy):
    """Normal force and its moments of the joint in lane ``lane`` at the penetration g of a step ago: stored in
    ``springs``, unless ``kept`` is None: then the joint was wholly closed or wholly open."""
    if kept is not None:
        return three(springs.pressure, lane)
    k_n = face.k_n[lane] if g0 > 0.0 else 0.0
    n, nx, ny = closed_pressure(face.area[lane], three(face.second, lane), g0, gx, gy)
    return k_n * n, k_n * nx, k_n * ny


@entry
def add_stepping(face, work, springs, kept, ledger):
    """Add the loss of the springs of the joints of a tile by opening and closing within a step, and store their
    pressure in ``springs``; ``kept``: see `springs_before`."""
    for lane in range(W):
        k_n = face.k_n[lane]
        q0, qx, qy = three(work.still, lane)
        q0 *= k_n
        qx *= k_n
        qy *= k_n
        g0, gx, gy = three(work.depth, lane)
        d0, dx, dy = three(work.growth, lane)
        o0 = g0 - d0
        ox = gx - dx
        oy = gy - dy
        p0, px, py = springs_before(face, springs, kept, lane, o0, ox, oy)
        ledger.stepping[lane] += 0.5 * (p0 * g0 + px * gx + py * gy - (q0 * o0 + qx * ox + qy * oy))
        put_three(springs.pressure, lane, (q0, qx, qy))


@entry
def opening(face, work):
    """Number of joints of a tile that are neither wholly closed nor wholly open, and of those that changed from closed
    to open at O, or back, in the step."""
    partly = passed = 0
    for lane in range(W):
        g0, gx, gy = three(work.depth, lane)
        partly += 0 if either_wholly(face.reach[lane], g0, gx, gy) else 1
        passed += 1 if (g0 > 0.0) != (g0 - work.growth[0, lane] > 0.0) else 0
    return partly, passed


@jit
def add_work(energy_terms, t, dashpots, ledger, tile, face, work, rest, used):
    """Add the work over a step of springs and dashpots of the convex joints in their tile ``t``, in its first ``used``
    lanes, to the given records of `EnergyTerms`; ``rest``: see `sticking_forces`. The springs of joints that are and
    stay wholly closed have no loss."""
    springs = energy_terms.springs[t]
    partly = 0
    if rest:
        clear_unused_lanes(work, used)
        add_dashpot_work(tile, face, work, dashpots, ledger, True)
        partly, passed = opening(face, work)
        if energy_terms.partly[t] > 0:
            add_stepping(face, work, springs, True, ledger)
        elif partly + passed > 0:
            add_stepping(face, work, springs, None, ledger)
    else:
        add_dashpot_work(tile, face, work, dashpots, ledger, None)
        if energy_terms.partly[t] > 0:
            pressure_of_closed_or_open(face, work)
            add_stepping(face, work, springs, True, ledger)
    energy_terms.partly[t] = partly
