"""Convex joints with strengths, in real time: what such a joint answers, and what it loses. The law is
`kernels.joint.area_law.bonded_area`.
"""

from dembrick._jit import jit
from dembrick.kernels.dynamics.area_tiles import (
    in_polygon_axes,
    put_force,
)
from dembrick.kernels.dynamics.energy_terms import (
    dashpot_work,
)
from dembrick.kernels.dynamics.tiles import put_three, three, two
from dembrick.kernels.joint.area_law import area_springs, bonded_area, springs_hold
from dembrick.kernels.math.vec3 import put_vector


@jit
def add_bonded_losses(
    faces, face, strengths, bonds, a, lane, dashpots, ledger, bond, rise, g0, gx, gy, d0, dx, dy, n, nx, ny, shear,
    by_law,
):  # fmt: skip
    """Add what a step took from the springs of convex joint ``a`` with strengths, whose bond and rise were those of
    before; ``shear`` (J) by its plastic twist, ``by_law`` by friction. N and its moments are those of now."""
    outline = faces.outline[a]
    x = faces.x[outline]
    y = faces.y[outline]
    count = faces.count[outline]
    area = face.area[lane]
    second = three(face.second, lane)
    reach = face.reach[lane]
    k_n = face.k_n[lane]
    most = strengths.crushing[a]  # infinite: what is crushed is not followed in real time
    now = bonds.bonded[a]
    risen = bonds.rise[a]
    q0, qx, qy, _ = area_springs(x, y, 0, count, area, second, reach, now, most, g0 + risen, gx, gy)
    p0, px, py, _ = area_springs(x, y, 0, count, area, second, reach, bond, most, g0 - d0 + rise, gx - dx, gy - dy)
    across = springs_hold(x, y, 0, count, area, second, reach, bond, rise, most, g0 - d0, gx - dx, gy - dy)
    across -= springs_hold(x, y, 0, count, area, second, reach, now, risen, most, g0, gx, gy)
    across += (p0 + q0) * d0 + (px + qx) * dx + (py + qy) * dy
    across *= 0.5 * k_n
    c0, c1, c2 = n - k_n * q0, nx - k_n * qx, ny - k_n * qy
    ledger.dashpots[lane] += dashpot_work(dashpots.pressing, lane, c0, c1, c2, d0, dx, dy)
    if now < bond:
        ledger.fracture[lane] += shear + across
    elif n > 0.0:
        dash = (n - k_n * q0) * (risen - rise)  # lengthens with what lifts
        lifted = across - dash if risen > rise else 0.0
        ledger.dashpots[lane] += dash
        ledger.friction[lane] += shear + lifted
        ledger.by_law[lane] += by_law - n * (risen - rise)
        ledger.smallest[lane] = min(ledger.smallest[lane], shear + lifted)
        ledger.stepping[lane] += across - dash - lifted if risen > rise else across
    else:
        ledger.released[lane] += shear
        ledger.stepping[lane] += across


@jit
def bonded_face(faces, strengths, bonds, a, tile, seen, face, sheared, lane, work, dashpots, ledger):
    """`face_force` of a joint of a scene where some have strengths; ``dashpots`` and ``ledger``: its tiles of
    `EnergyTerms`, or None."""
    g0, gx, gy = three(work.depth, lane)
    d0, dx, dy = three(work.growth, lane)
    outline = faces.outline[a]
    p1, p2 = two(work.slip, lane)
    turn = work.turn[lane]
    s1, s2, cosine, sine = in_polygon_axes(seen, lane, p1, p2)
    b1, b2, bm = three(sheared.elastic, lane)
    twist = faces.twist[a]
    bond = bonds.bonded[a]
    rise = bonds.rise[a]
    n, nx, ny, t1, t2, tm, e1, e2, em, q1, q2, qm, w1, w2, wm, slid, _, bonded, risen = bonded_area(
        faces.x[outline], faces.y[outline], 0, faces.count[outline], face.area[lane], three(face.second, lane),
        face.reach[lane], faces.far[outline], face.radius[lane], strengths, a, face.k_n[lane],
        face.k_s[lane], face.friction[lane], face.negligible[lane], tile.viscous[0, lane],
        1.0 + tile.viscous[1, lane], bond, rise, g0, gx, gy, d0, dx, dy, s1, s2, turn, b1, b2, bm, twist[0],
        twist[1], twist[2],
    )  # fmt: skip
    put_three(sheared.elastic, lane, (e1, e2, em))
    put_vector(twist, w1, w2, wm)
    faces.slip[a] += slid
    bonds.bonded[a] = bonded
    bonds.rise[a] = risen
    put_force(work, lane, cosine, sine, n, nx, ny, t1, t2, tm)
    if ledger is not None:
        shear = 0.5 * ((b1 + e1) * q1 + (b2 + e2) * q2 + (bm + em) * qm)
        by_law = t1 * q1 + t2 * q2 + tm * qm
        add_bonded_losses(
            faces, face, strengths, bonds, a, lane, dashpots, ledger, bond, rise, g0, gx, gy, d0, dx, dy, n, nx, ny,
            shear, by_law,
        )  # fmt: skip
        taken = dashpot_work(dashpots.shearing, lane, t1 - e1, t2 - e2, tm - em, s1, s2, turn)
        ledger.dashpots[lane] += taken
