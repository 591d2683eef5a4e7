"""Points of joints with strengths, in real time: what such a point answers, and what it loses. The law is
`kernels.joint.point_law.bonded_law`.
"""

from dembrick._jit import jit
from dembrick.kernels.dynamics.tiles import W, put_three, record, three, two
from dembrick.kernels.joint.point_law import bonded_law, bonded_losses, shear_loss, spring_of

# Memory of a point with strengths: 1 while the bond holds, else 0; crushed depth and rise by dilation (m)
BOND = record(("bonded", 1), ("crushed", 1), ("rise", 1))


@jit
def answer_bonded(
    work, own, sheared, which, lane, k_n, k_s, friction, arm, energy, force_out, strengths, law, bonds, ledger
):  # fmt: skip
    """`answer` of a point of a scene with strengths, those of the ``law``; ``bonds``: the rows of the two points in
    `Corners.bonds`. What it loses is counted in the ``ledger`` of its tile."""
    x = own[which].x[lane]
    y = own[which].y[lane]
    area = own[which].area[lane]
    g0, gx, gy = three(work.depth, lane)
    d0, dx, dy = three(work.growth, lane)
    g = g0 + x * gx + y * gy
    d = d0 + x * dx + y * dy
    xs = arm * x
    ys = arm * y
    p1, p2 = two(work.slip, lane)
    x1, x2 = two(work.slip_x, lane)
    y1, y2 = two(work.slip_y, lane)
    u1 = p1 + xs * x1 + ys * y1
    u2 = p2 + xs * x2 + ys * y2
    b1 = sheared[which].elastic[0, lane]
    b2 = sheared[which].elastic[1, lane]
    k = k_n * area
    bond = bonds[which].bonded[lane]
    depth = bonds[which].crushed[lane]
    rise = bonds[which].rise[lane]
    normal, spring, t1, t2, e1, e2, slid, bonded, crushed, risen = bonded_law(
        g, d, u1, u2, b1, b2, k, k_s * area, friction, work.normal[lane], work.damped[lane],
        work.damping[lane], strengths, law, area, bond, depth, rise,
    )  # fmt: skip
    sheared[which].elastic[0, lane] = e1
    sheared[which].elastic[1, lane] = e2
    work.slid[which, lane] = slid
    bonds[which].bonded[lane] = bonded
    bonds[which].crushed[lane] = crushed
    bonds[which].rise[lane] = risen
    if energy is not None:
        before = spring_of(strengths, law, k, g - d, area, bond, depth, rise)
        opened = normal == 0.0 and (b1 != 0.0 or b2 != 0.0)
        held, by_law, crush, fracture, released, stepping, dash = bonded_losses(
            strengths, law, area, friction, k, d, before, spring, normal,
            shear_loss(b1, b2, e1, e2, u1, u2, k_s * area), slid, bonded < bond, crushed - depth, risen - rise, opened,
        )  # fmt: skip
        ledger.dashpots[lane] += dash
        least = ledger.smallest[lane]
        ledger.smallest[lane] = held if held < least else least
        ledger.friction[lane] += held
        ledger.by_law[lane] += by_law
        ledger.released[lane] += released
        ledger.stepping[lane] += stepping
        ledger.crushing[lane] += crush
        ledger.fracture[lane] += fracture
    if force_out is not None:
        put_three(work.last[which], lane, (t1, t2, normal))
    return x, y, xs, ys, t1, t2, normal, t1 - e1, t2 - e2, normal - spring, slid > 0.0


@jit
def bonds_of(bonds, point):
    """The rows of two points in `Corners.bonds`, from number ``point`` on; None without any."""
    if bonds is None:
        return None
    return bonds[point : point + 2]


@jit
def spring_length(strengths, bonds, law, k_n, place, g):
    """By how much the normal spring of a point is pressed (m, negative if a bond is pulled) at the penetration
    ``g``; ``place``: see `Corners.where`."""
    if bonds is not None:
        own = bonds[place // W]
        lane = place % W
        bond, depth, rise = own.bonded[lane], own.crushed[lane], own.rise[lane]
        return spring_of(strengths, law, k_n, g, 1.0, bond, depth, rise) / k_n
    return max(g, 0.0)
