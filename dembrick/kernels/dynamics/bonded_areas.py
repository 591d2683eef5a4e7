"""Convex joints with strengths, in real time: their forces and their losses. The law is
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
from dembrick.kernels.dynamics.law_memory import bonded_dashpots, dashpots_of, keeps_shear
from dembrick.kernels.dynamics.tiles import put_three, three, two
from dembrick.kernels.joint.area_law import Memory, area_springs, bonded_area, shear_springs, springs_hold, stretched
from dembrick.kernels.joint.geometry import Motion
from dembrick.kernels.math.vectors import put_vector, three_of


@jit
def add_bonded_losses(polygon, k_n, most, before, now, motion, pressure, work, lane, counted):
    """Add the losses in a step of the springs of a convex joint with strengths, whose `Memory` was ``before`` and is
    ``now``; ``work`` (J): on its plastic twist, and of friction by its law; ``pressure``: N and its moments now."""
    n, nx, ny = pressure
    shear, by_law = work
    dashpots, ledger = counted
    g0, gx, gy = motion.depth
    d0, dx, dy = motion.growth
    o0, ox, oy = g0 - d0, gx - dx, gy - dy
    (q0, qx, qy), _ = area_springs(polygon, now.bonded, most, g0 + now.rise, gx, gy)
    (p0, px, py), _ = area_springs(polygon, before.bonded, most, o0 + before.rise, ox, oy)
    across = springs_hold(polygon, before.bonded, before.rise, most, o0, ox, oy)
    across -= springs_hold(polygon, now.bonded, now.rise, most, g0, gx, gy)
    across += (p0 + q0) * d0 + (px + qx) * dx + (py + qy) * dy
    across *= 0.5 * k_n
    c0, c1, c2 = n - k_n * q0, nx - k_n * qx, ny - k_n * qy
    ledger.dashpots[lane] += dashpot_work(dashpots.pressing, lane, c0, c1, c2, d0, dx, dy)
    lift = now.rise - before.rise
    if now.bonded < before.bonded:
        ledger.fracture[lane] += shear + across
    elif n > 0.0:
        dash = (n - k_n * q0) * lift  # the dashpot lengthens with the lift
        lifted = across - dash if now.rise > before.rise else 0.0
        ledger.dashpots[lane] += dash
        ledger.friction[lane] += shear + lifted
        ledger.by_law[lane] += by_law - n * lift
        ledger.smallest[lane] = min(ledger.smallest[lane], shear + lifted)
        ledger.stepping[lane] += across - dash - lifted if now.rise > before.rise else across
    else:
        ledger.released[lane] += shear
        ledger.stepping[lane] += across


@jit
def bonded_face(faces, limit, bonded, a, tile, seen, own, lane, work, counted):
    """`area_joints.face_force` of a joint in a scene where some have strengths, by the `LimitSurface` ``limit`` of its
    full pressure; ``bonded``: the strengths and the bonds; ``own``: its tiles of `Faces.tiles` and `Faces.sheared`,
    ``counted``: of `EnergyTerms`, or None."""
    face, sheared = own
    strengths, bonds = bonded
    p1, p2 = two(work.slip, lane)
    s1, s2, cosine, sine = in_polygon_axes(seen, lane, p1, p2)
    motion = Motion(three(work.depth, lane), three(work.growth, lane), (s1, s2, work.turn[lane]))
    before = Memory(three(sheared.elastic, lane), three_of(faces.twist[a]), bonds.bonded[a], bonds.rise[a])
    k_n = face.k_n[lane]
    pressure, shear, twist, slid, _, now = bonded_area(
        limit, strengths, a, (k_n, face.k_s[lane]), face.friction[lane], face.negligible[lane],
        bonded_dashpots(dashpots_of(tile, work, lane), strengths, a, work, lane), motion, before,
    )  # fmt: skip
    if work.searching[lane] > 0.0:
        closed = pressure[0] > 0.0 or now.bonded > 0.0 or keeps_shear(before.elastic, work, lane)
        springs = shear_springs(limit.polygon, face.k_s[lane])
        elastic = stretched(springs, motion.slip, before.elastic) if closed else (0.0, 0.0, 0.0)
        now = Memory(elastic, now.start, now.bonded, before.rise)
        slid = 0.0
    put_three(sheared.elastic, lane, now.elastic)
    put_vector(faces.twist[a], *now.start)
    faces.slip[a] += slid
    bonds.bonded[a] = now.bonded
    bonds.rise[a] = now.rise
    put_force(work, lane, cosine, sine, pressure, shear)
    if counted is not None:
        b1, b2, bm = before.elastic
        e1, e2, em = now.elastic
        t1, t2, tm = shear
        q1, q2, qm = twist
        lost = 0.5 * ((b1 + e1) * q1 + (b2 + e2) * q2 + (bm + em) * qm), t1 * q1 + t2 * q2 + tm * qm
        most = strengths.crushing[a]  # infinite: crushing of areas is not modelled in real time
        add_bonded_losses(limit.polygon, k_n, most, before, now, motion, pressure, lost, lane, counted)
        s1, s2, turn = motion.slip
        taken = dashpot_work(counted.dashpots.shearing, lane, t1 - e1, t2 - e2, tm - em, s1, s2, turn)
        counted.ledger.dashpots[lane] += taken
