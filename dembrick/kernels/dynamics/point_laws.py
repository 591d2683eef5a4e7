"""Points of joints that are not dry, in real time: their forces and their losses. With strengths by
`kernels.joint.point_law.bonded_law`, or by a user-defined law, called by `kernels.joint.custom_law`.
"""

from typing import NamedTuple

from numpy import ndarray

from dembrick._jit import jit
from dembrick.kernels.dynamics.law_memory import bonded_dashpots, dashpots_in_mode, keeps_shear
from dembrick.kernels.dynamics.slip_paths import weigh
from dembrick.kernels.dynamics.tiles import W, put_three, record, three, two
from dembrick.kernels.joint.custom_law import Custom, custom_law, energy_held
from dembrick.kernels.joint.point_law import Bond, Strengths, bonded_law, bonded_losses, shear_loss, spring_of

# Memory of a point with strengths: 1 while the bond holds, else 0; crushed depth and rise by dilation (m)
BOND = record(("bonded", 1), ("crushed", 1), ("rise", 1))


class BondedPair(NamedTuple):
    """Strengths and memory of two points."""

    strengths: Strengths
    law: int  # number of their strengths
    bonds: ndarray  # (2,) records `BOND`


@jit
def bonded_force(work, pair, which, lane, law, energy, force_out, bonded, ledger):
    """`point_joints.point_force` of a point in a scene with strengths, those of a `BondedPair`. Its losses are added to
    the ``ledger`` of its tile."""
    own, sheared = pair
    strengths = bonded.strengths
    i = bonded.law
    memory = bonded.bonds[which]
    x = own[which].x[lane]
    y = own[which].y[lane]
    area = own[which].area[lane]
    g0, gx, gy = three(work.depth, lane)
    d0, dx, dy = three(work.growth, lane)
    g = g0 + x * gx + y * gy
    d = d0 + x * dx + y * dy
    xs = law.arm * x
    ys = law.arm * y
    p1, p2 = two(work.slip, lane)
    x1, x2 = two(work.slip_x, lane)
    y1, y2 = two(work.slip_y, lane)
    slip = p1 + xs * x1 + ys * y1, p2 + xs * x2 + ys * y2
    b1 = sheared[which].elastic[0, lane]
    b2 = sheared[which].elastic[1, lane]
    k = law.k_n * area
    bond = Bond((b1, b2), memory.bonded[lane], memory.crushed[lane], memory.rise[lane])
    viscous, damped = bonded_dashpots((work.normal[lane], work.damped[lane]), strengths, i, work, lane)
    dashpots = viscous, damped, 1.0 / damped
    springs = k, law.k_s * area
    normal, spring, (t1, t2), slid, now = bonded_law(
        g, d, slip, springs, law.friction, dashpots, strengths, i, area, bond
    )
    if work.searching[lane] > 0.0:
        closed = normal != 0.0 or now.bonded > 0.0 or keeps_shear((b1, b2, 0.0), work, lane)
        stretched = (b1 + springs[1] * slip[0], b2 + springs[1] * slip[1]) if closed else (0.0, 0.0)
        now = Bond(stretched, now.bonded, bond.crushed, bond.rise)
        slid = 0.0
    e1, e2 = now.elastic
    sheared[which].elastic[0, lane] = e1
    sheared[which].elastic[1, lane] = e2
    work.slid[which, lane] = slid
    weigh(work, which, lane, normal, t1, t2)
    memory.bonded[lane] = now.bonded
    memory.crushed[lane] = now.crushed
    memory.rise[lane] = now.rise
    if energy is not None:
        before = spring_of(strengths, i, k, g - d, area, bond)
        opened = normal == 0.0 and (b1 != 0.0 or b2 != 0.0)
        lost = bonded_losses(
            strengths, i, area, law.friction, k, d, (before, spring, normal),
            shear_loss(bond.elastic, now.elastic, slip, springs[1]), slid,
            (now.bonded < bond.bonded, now.crushed - bond.crushed, now.rise - bond.rise, opened),
        )  # fmt: skip
        held = lost.friction
        ledger.dashpots[lane] += lost.dash
        least = ledger.smallest[lane]
        ledger.smallest[lane] = held if held < least else least
        ledger.friction[lane] += held
        ledger.by_law[lane] += lost.by_law
        ledger.released[lane] += lost.released
        ledger.stepping[lane] += lost.stepping
        ledger.crushing[lane] += lost.crushing
        ledger.fracture[lane] += lost.fracture
    if force_out is not None:
        put_three(work.last[which], lane, (t1, t2, normal))
    return x, y, xs, ys, t1, t2, normal, t1 - e1, t2 - e2, normal - spring, slid > 0.0


@jit
def bonded_pair(strengths, law, bonds, point):
    """The `BondedPair` of two points, from index ``point`` of `Corners.bonds` on; None if there are no bonds."""
    if bonds is None:
        return None
    return BondedPair(strengths, law, bonds[point : point + 2])


@jit
def spring_length(strengths, bonds, law, k_n, place, g):
    """Compression of the normal spring of a point (m, negative if a bond is pulled) at the penetration ``g``;
    ``place``: see `Corners.where`."""
    if bonds is not None:
        own = bonds[place // W]
        lane = place % W
        bond = Bond((0.0, 0.0), own.bonded[lane], own.crushed[lane], own.rise[lane])
        return spring_of(strengths, law, k_n, g, 1.0, bond) / k_n
    return max(g, 0.0)


@jit
def place_of(corners, p, i):
    """Place of point ``i`` of point joint ``p``, as in `Corners.where`."""
    width = corners.width[p]
    return corners.place[p] + i // width * W + i % width


@jit
def rows_of(custom, point):
    """The rows of two points in `Corners.custom`, from index ``point`` on; None if there is none."""
    if custom is None:
        return None
    first, last = point * W, (point + 2) * W
    return Custom(
        custom.move[first:last], custom.record[first:last], custom.memory[first:last], custom.at,
        custom.answer[first:last], custom.since[first:last], custom.tried[first:last],
    )  # fmt: skip


@jit
def custom_force(work, pair, which, lane, arm, energy, force_out, custom, ledger):
    """`point_joints.point_force` of a point with a user-defined law, number ``which`` of the two of ``custom``. All
    energy that it does not store counts as friction, in the ``ledger`` of its tile."""
    own, sheared = pair
    x = own[which].x[lane]
    y = own[which].y[lane]
    g0, gx, gy = three(work.depth, lane)
    d0, dx, dy = three(work.growth, lane)
    xs = arm * x
    ys = arm * y
    work.slid[which, lane] = 0.0
    if own[which].area[lane] == 0.0:  # no point, or one that was retired
        if force_out is not None:
            put_three(work.last[which], lane, (0.0, 0.0, 0.0))
        return x, y, xs, ys, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, False
    p1, p2 = two(work.slip, lane)
    x1, x2 = two(work.slip_x, lane)
    y1, y2 = two(work.slip_y, lane)
    viscous, damped = dashpots_in_mode((work.normal[lane], work.damped[lane]), work, lane)
    normal, spring, t1, t2, e1, e2, slid, lost = custom_law(
        custom, which * W + lane, g0 + x * gx + y * gy, d0 + x * dx + y * dy,
        p1 + xs * x1 + ys * y1, p2 + xs * x2 + ys * y2, viscous, damped - 1.0, work.searching[lane] > 0.0,
    )  # fmt: skip
    sheared[which].elastic[0, lane] = e1
    sheared[which].elastic[1, lane] = e2
    work.slid[which, lane] = slid
    weigh(work, which, lane, normal, t1, t2)
    if energy is not None:
        ledger.friction[lane] += lost
        ledger.by_law[lane] += lost
    if force_out is not None:
        put_three(work.last[which], lane, (t1, t2, normal))
    return x, y, xs, ys, t1, t2, normal, t1 - e1, t2 - e2, normal - spring, slid > 0.0


@jit
def energy_of(custom, corners, p):
    """Energy (J) stored at the points of joint ``p``."""
    total = 0.0
    for i in range(corners.start[p + 1] - corners.start[p]):
        place = place_of(corners, p, i)
        if corners.points[place // W].area[place % W] > 0.0:
            total += energy_held(custom, place)
    return total
