"""Convex joints with strengths, in real time: what such a joint answers, and what it loses. The law is
`kernels.joint.area_law.bonded_area`.
"""

from dembrick._jit import jit
from dembrick.kernels.dynamics.area_tiles import (
    AREA,
    K_N,
    K_S,
    MU,
    NEGLIGIBLE,
    RADIUS,
    REACH,
    SECOND,
    in_polygon_axes,
    put_force,
)
from dembrick.kernels.dynamics.energy_terms import (
    BY_LAW,
    FRACTURE,
    FRICTION,
    GONE,
    OF_DASHPOTS,
    PRESSING,
    RELEASED,
    SHEARING,
    SMALLEST,
    STEPPING,
    dashpot_work,
)
from dembrick.kernels.dynamics.tiles import DEPTH, GROWTH, MOVED, TURN, VISCOUS, W, put_three, three
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
    area = face[AREA * W + lane]
    second = three(face, SECOND, lane)
    reach = face[REACH * W + lane]
    k_n = face[K_N * W + lane]
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
    ledger[OF_DASHPOTS * W + lane] += dashpot_work(dashpots, lane, PRESSING, c0, c1, c2, d0, dx, dy)
    if now < bond:
        ledger[(GONE + FRACTURE) * W + lane] += shear + across
    elif n > 0.0:
        dash = (n - k_n * q0) * (risen - rise)  # lengthens with what lifts
        lifted = across - dash if risen > rise else 0.0
        ledger[OF_DASHPOTS * W + lane] += dash
        ledger[(GONE + FRICTION) * W + lane] += shear + lifted
        ledger[(GONE + BY_LAW) * W + lane] += by_law - n * (risen - rise)
        ledger[SMALLEST * W + lane] = min(ledger[SMALLEST * W + lane], shear + lifted)
        ledger[(GONE + STEPPING) * W + lane] += across - dash - lifted if risen > rise else across
    else:
        ledger[(GONE + RELEASED) * W + lane] += shear
        ledger[(GONE + STEPPING) * W + lane] += across


@jit
def bonded_face(faces, strengths, bonds, a, tile, seen, face, sheared, lane, work, dashpots, ledger):
    """`face_force` of a joint of a scene where some have strengths; ``dashpots`` and ``ledger``: its tiles of
    `EnergyTerms`, or None."""
    g0, gx, gy = three(work, DEPTH, lane)
    d0, dx, dy = three(work, GROWTH, lane)
    outline = faces.outline[a]
    p1, p2, _ = three(work, MOVED, lane)
    turn = work[TURN * W + lane]
    s1, s2, cosine, sine = in_polygon_axes(seen, lane, p1, p2)
    b1, b2, bm = three(sheared, 0, lane)
    twist = faces.twist[a]
    bond = bonds.bonded[a]
    rise = bonds.rise[a]
    n, nx, ny, t1, t2, tm, e1, e2, em, q1, q2, qm, w1, w2, wm, slid, _, bonded, risen = bonded_area(
        faces.x[outline], faces.y[outline], 0, faces.count[outline], face[AREA * W + lane], three(face, SECOND, lane),
        face[REACH * W + lane], faces.far[outline], face[RADIUS * W + lane], strengths, a, face[K_N * W + lane],
        face[K_S * W + lane], face[MU * W + lane], face[NEGLIGIBLE * W + lane], tile[VISCOUS * W + lane],
        1.0 + tile[(VISCOUS + 1) * W + lane], bond, rise, g0, gx, gy, d0, dx, dy, s1, s2, turn, b1, b2, bm, twist[0],
        twist[1], twist[2],
    )  # fmt: skip
    put_three(sheared, 0, lane, (e1, e2, em))
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
        taken = dashpot_work(dashpots, lane, SHEARING, t1 - e1, t2 - e2, tm - em, s1, s2, turn)
        ledger[OF_DASHPOTS * W + lane] += taken
