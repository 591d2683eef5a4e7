"""Points of joints with strengths, in real time: what such a point answers, and what it loses. The law is
`kernels.joint.point_law.bonded_law`.
"""

from dembrick._jit import jit
from dembrick.kernels.dynamics.energy_terms import (
    BY_LAW,
    CRUSHING,
    FRACTURE,
    FRICTION,
    GONE,
    OF_DASHPOTS,
    RELEASED,
    SMALLEST,
    STEPPING,
)
from dembrick.kernels.dynamics.tiles import (
    AREA,
    DAMPED,
    DAMPING,
    DEPTH,
    GROWTH,
    LAST,
    MOVED,
    NORMAL,
    POINT,
    SHEAR,
    SLID,
    W,
    X,
    Y,
    lane_of,
    put_three,
    three,
)
from dembrick.kernels.joint.point_law import bonded_law, bonded_losses, shear_loss, spring_of

# Rows of a point in `Corners.bonds`: 1 while the bond holds, else 0; crushed depth and rise by dilation (m)
BONDED, CRUSHED, RISE = 0, 1, 2
BOND = 3 * W


@jit
def answer_bonded(
    work, own, sheared, which, lane, k_n, k_s, friction, arm, energy, force_out, strengths, law, bonds, ledger
):  # fmt: skip
    """`answer` of a point of a scene with strengths, those of the ``law``; ``bonds``: the rows of the two points in
    `Corners.bonds`. What it loses is counted in the ``ledger`` of its tile."""
    at = which * POINT + lane
    x = own[X * W + at]
    y = own[Y * W + at]
    area = own[AREA * W + at]
    g0, gx, gy = three(work, DEPTH, lane)
    d0, dx, dy = three(work, GROWTH, lane)
    g = g0 + x * gx + y * gy
    d = d0 + x * dx + y * dy
    xs = arm * x
    ys = arm * y
    p1, p2, x1 = three(work, MOVED, lane)
    x2, y1, y2 = three(work, MOVED + 3, lane)
    u1 = p1 + xs * x1 + ys * y1
    u2 = p2 + xs * x2 + ys * y2
    of_shear = which * SHEAR + lane
    b1 = sheared[of_shear]
    b2 = sheared[W + of_shear]
    k = k_n * area
    of_bond = which * BOND + lane
    bond = bonds[BONDED * W + of_bond]
    depth = bonds[CRUSHED * W + of_bond]
    rise = bonds[RISE * W + of_bond]
    normal, spring, t1, t2, e1, e2, slid, bonded, crushed, risen = bonded_law(
        g, d, u1, u2, b1, b2, k, k_s * area, friction, work[NORMAL * W + lane], work[DAMPED * W + lane],
        work[DAMPING * W + lane], strengths, law, area, bond, depth, rise,
    )  # fmt: skip
    sheared[of_shear] = e1
    sheared[W + of_shear] = e2
    work[(SLID + which) * W + lane] = slid
    bonds[BONDED * W + of_bond] = bonded
    bonds[CRUSHED * W + of_bond] = crushed
    bonds[RISE * W + of_bond] = risen
    if energy is not None:
        before = spring_of(strengths, law, k, g - d, area, bond, depth, rise)
        opened = normal == 0.0 and (b1 != 0.0 or b2 != 0.0)
        held, by_law, crush, fracture, released, stepping, dash = bonded_losses(
            strengths, law, area, friction, k, d, before, spring, normal,
            shear_loss(b1, b2, e1, e2, u1, u2, k_s * area), slid, bonded < bond, crushed - depth, risen - rise, opened,
        )  # fmt: skip
        ledger[OF_DASHPOTS * W + lane] += dash
        least = ledger[SMALLEST * W + lane]
        ledger[SMALLEST * W + lane] = held if held < least else least
        ledger[(GONE + FRICTION) * W + lane] += held
        ledger[(GONE + BY_LAW) * W + lane] += by_law
        ledger[(GONE + RELEASED) * W + lane] += released
        ledger[(GONE + STEPPING) * W + lane] += stepping
        ledger[(GONE + CRUSHING) * W + lane] += crush
        ledger[(GONE + FRACTURE) * W + lane] += fracture
    if force_out is not None:
        put_three(work, LAST + 3 * which, lane, (t1, t2, normal))
    return x, y, xs, ys, t1, t2, normal, t1 - e1, t2 - e2, normal - spring, slid > 0.0


@jit
def bonds_of(bonds, point):
    """The rows of two points in `Corners.bonds`, from number ``point`` on; None without any."""
    if bonds is None:
        return None
    return bonds[point * BOND : (point + 2) * BOND]


@jit
def spring_length(strengths, bonds, law, k_n, place, g):
    """By how much the normal spring of a point is pressed (m, negative if a bond is pulled) at the penetration
    ``g``; ``place``: see `Corners.where`."""
    if bonds is not None:
        own = bonds[lane_of(place, BOND)]
        bond, depth, rise = own[BONDED], own[CRUSHED], own[RISE]
        return spring_of(strengths, law, k_n, g, 1.0, bond, depth, rise) / k_n
    return max(g, 0.0)
