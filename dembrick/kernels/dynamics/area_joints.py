"""Convex joints, in real time: the area family. The law of a convex joint is `kernels.joint.area_law`; the functions
of a family are those of `point_joints`, and `joint_families` calls them.

Shear memory lives in the polygon's axes and turns with them. The normal force acts along the other's normal.
"""

from math import inf, sqrt
from typing import NamedTuple

from numpy import ndarray

from dembrick._jit import jit
from dembrick.kernels.dynamics.energy_terms import BY_LAW, FRACTURE, FRICTION, RELEASED
from dembrick.kernels.dynamics.tiles import (
    DEPTH,
    FIRST,
    FORCE,
    GROWTH,
    MOVED,
    SEEN_TILE,
    TILE,
    TURN,
    TWISTING,
    VISCOUS,
    W,
    deliver,
    fetch,
    look,
    offset_of,
    put_three,
    resultant,
    seen_by,
    sense_of,
    three,
)
from dembrick.kernels.joint.area_law import (
    area_friction,
    area_pressure,
    area_springs,
    bonded_area,
    follow_bending,
    spring_pressure,
    springs_hold,
)
from dembrick.kernels.joint.point_law import Strengths
from dembrick.kernels.joint.pressure import Pressed


class FaceBonds(NamedTuple):
    """What convex joints with strengths remember."""

    bonded: ndarray  # (a,) 1 while the bond holds, else 0
    rise: ndarray  # (a,) m, by dilation


class Faces(NamedTuple):
    """Convex joints. Equal polygons share their vertices and their series; a joint that was cut has its own."""

    joint: ndarray  # (a,) uint32
    tile: ndarray  # (t,) int64, which tile of `Links` each tile of these joints is
    lane: ndarray  # (t, W) uint32, which of the a joints each lane has; the last one again where there are no more
    used: ndarray  # (t,) int64, lanes that have one of their own
    outline: ndarray  # (a,) uint32, which polygon: a row of `count`, `x`, `y` and `far`
    k_n: ndarray  # (a,) Pa/m
    k_s: ndarray  # (a,) Pa/m
    friction: ndarray  # (a,)
    area: ndarray  # (a,) m2
    second: ndarray  # (a, 3) m4, integrals of y^2, x^2, x y about O, the centroid
    negligible: ndarray  # (a,) N, friction strength up to which the limit surface need not be the exact one
    reach: ndarray  # (a,) m, greatest vertex distance from O
    radius: ndarray  # (a,) m, torsion strength over V_0
    elastic: ndarray  # (a, 3) N, N, N m, in the sense in which the host slips, polygon axes
    twist: ndarray  # (a, 3) m, m, rad, last plastic twist
    slip: ndarray  # (a,) m, length of the slip path
    count: ndarray  # (o,) int64, vertices of each polygon
    x: ndarray  # (o, v) m, vertices from O along e1, counter-clockwise about e1 x e2
    y: ndarray  # (o, v) m, along e2
    far: ndarray  # (o, 42) series of the limit surface about pure translation
    pressed: Pressed | None  # None where all pressures are full
    strengths: Strengths | None = None  # beside friction; None where no joint has any
    bonds: FaceBonds | None = None  # None where ``strengths`` is


@jit
def add_pressure_energy(row, q0, qx, qy, n, nx, ny, g0, gx, gy, d0, dx, dy):
    """Dashpots along the normal of a convex joint with the ``row`` (16,): pressure of the springs q, of all n; its
    penetration g and the growth of it d."""
    stepping = row[0] * g0 + row[1] * gx + row[2] * gy - (q0 * (g0 - d0) + qx * (gx - dx) + qy * (gy - dy))
    add_dashpot_work(row, n - q0, nx - qx, ny - qy, d0, dx, dy)
    row[0] = q0
    row[1] = qx
    row[2] = qy
    row[9] += 0.5 * stepping


@jit
def add_dashpot_work(row, n, nx, ny, d0, dx, dy):
    """The work of its dashpots along the normal, that carry ``n`` and its moments now; d: growth of the penetration."""
    row[15] += 0.5 * ((row[12] + n) * d0 + (row[13] + nx) * dx + (row[14] + ny) * dy)
    row[12] = n
    row[13] = nx
    row[14] = ny


@jit
def add_shear_energy(row, e, s1, s2, turn, t1, t2, tm):
    """Its dashpots in shear and torsion: slip s and turn, friction t, elastic forces e (3,)."""
    t1 -= e[0]
    t2 -= e[1]
    tm -= e[2]
    row[15] += 0.5 * ((row[6] + t1) * s1 + (row[7] + t2) * s2 + (row[8] + tm) * turn)
    row[6] = t1
    row[7] = t2
    row[8] = tm


@jit
def add_slip_work(energy_terms, faces, a, normal, q1, q2, qm, t1, t2, tm, b1, b2, bm):
    """A step in which convex joint ``a`` slides by the plastic twist q, or in which it is open and lets go; it held b
    before."""
    j = faces.joint[a]
    e = faces.elastic[a]
    share = energy_terms.share[j]
    loss = 0.5 * share * ((b1 + e[0]) * q1 + (b2 + e[1]) * q2 + (bm + e[2]) * qm)
    if normal > 0.0:
        energy_terms.lost[j, FRICTION] += loss
        energy_terms.lost[j, BY_LAW] += share * (t1 * q1 + t2 * q2 + tm * qm)
        energy_terms.least[j] = min(energy_terms.least[j], loss)
    else:
        energy_terms.lost[j, RELEASED] += loss


@jit
def put_force(work, lane, cosine, sine, n, nx, ny, t1, t2, tm):
    """Write down what `resultant` makes a wrench of: N and its moments, shear and torsion in the polygon's axes."""
    put_three(work, FORCE, lane, (sine * t2 - cosine * t1, -(sine * t1 + cosine * t2), n))
    put_three(work, FORCE + 3, lane, (0.0, 0.0, nx))
    put_three(work, FORCE + 6, lane, (0.0, 0.0, ny))
    work[TWISTING * W + lane] = -tm


@jit
def add_bonded_losses(
    energy_terms, faces, strengths, bonds, a, bond, rise, g0, gx, gy, d0, dx, dy, n, nx, ny, shear, by_law
):
    """Add what a step took from the springs of convex joint ``a`` with strengths, whose bond and rise were those of
    before; ``shear`` (J) by its plastic twist, ``by_law`` by friction. N and its moments are those of now."""
    outline = faces.outline[a]
    x = faces.x[outline]
    y = faces.y[outline]
    count = faces.count[outline]
    area = faces.area[a]
    second = faces.second[a]
    reach = faces.reach[a]
    k_n = faces.k_n[a]
    most = strengths.crushing[a]  # infinite: what is crushed is not followed in real time
    now = bonds.bonded[a]
    risen = bonds.rise[a]
    q0, qx, qy, _ = area_springs(x, y, 0, count, area, second, reach, now, most, g0 + risen, gx, gy)
    p0, px, py, _ = area_springs(x, y, 0, count, area, second, reach, bond, most, g0 - d0 + rise, gx - dx, gy - dy)
    across = springs_hold(x, y, 0, count, area, second, reach, bond, rise, most, g0 - d0, gx - dx, gy - dy)
    across -= springs_hold(x, y, 0, count, area, second, reach, now, risen, most, g0, gx, gy)
    across += (p0 + q0) * d0 + (px + qx) * dx + (py + qy) * dy
    across *= 0.5 * k_n
    row = energy_terms.face[a]
    add_dashpot_work(row, n - k_n * q0, nx - k_n * qx, ny - k_n * qy, d0, dx, dy)
    row[0] = k_n * q0
    row[1] = k_n * qx
    row[2] = k_n * qy
    j = faces.joint[a]
    share = energy_terms.share[j]
    if now < bond:
        energy_terms.lost[j, FRACTURE] += share * (shear + across)
    elif n > 0.0:
        dash = (n - k_n * q0) * (risen - rise)  # lengthens with what lifts
        lifted = across - dash if risen > rise else 0.0
        row[15] += dash
        energy_terms.lost[j, FRICTION] += share * (shear + lifted)
        energy_terms.lost[j, BY_LAW] += share * (by_law - n * (risen - rise))
        energy_terms.least[j] = min(energy_terms.least[j], share * (shear + lifted))
        row[9] += across - dash - lifted if risen > rise else across
    else:
        energy_terms.lost[j, RELEASED] += share * shear
        row[9] += across


@jit
def bonded_face(faces, strengths, bonds, a, tile, seen, lane, work, energy_terms):
    """`face_force` of a joint of a scene where some have strengths."""
    g0, gx, gy = three(work, DEPTH, lane)
    d0, dx, dy = three(work, GROWTH, lane)
    outline = faces.outline[a]
    p1, p2, _ = three(work, MOVED, lane)
    turn = work[TURN * W + lane]
    c1 = seen[FIRST * W + lane]
    c2 = seen[(FIRST + 1) * W + lane]
    scale = 1.0 / sqrt(c1 * c1 + c2 * c2)
    cosine = c1 * scale
    sine = c2 * scale
    s1 = cosine * p1 + sine * p2
    s2 = cosine * p2 - sine * p1
    elastic = faces.elastic[a]
    b1 = elastic[0]
    b2 = elastic[1]
    bm = elastic[2]
    twist = faces.twist[a]
    bond = bonds.bonded[a]
    rise = bonds.rise[a]
    n, nx, ny, t1, t2, tm, e1, e2, em, q1, q2, qm, w1, w2, wm, slid, _, bonded, risen = bonded_area(
        faces.x[outline], faces.y[outline], 0, faces.count[outline], faces.area[a], faces.second[a], faces.reach[a],
        faces.far[outline], faces.radius[a], strengths, a, faces.k_n[a], faces.k_s[a], faces.friction[a],
        faces.negligible[a], tile[VISCOUS * W + lane], 1.0 + tile[(VISCOUS + 1) * W + lane], bond, rise, g0, gx, gy, d0,
        dx, dy, s1, s2, turn, b1, b2, bm, twist[0], twist[1], twist[2],
    )  # fmt: skip
    elastic[0] = e1
    elastic[1] = e2
    elastic[2] = em
    twist[0] = w1
    twist[1] = w2
    twist[2] = wm
    faces.slip[a] += slid
    bonds.bonded[a] = bonded
    bonds.rise[a] = risen
    put_force(work, lane, cosine, sine, n, nx, ny, t1, t2, tm)
    if energy_terms is not None:
        shear = 0.5 * ((b1 + e1) * q1 + (b2 + e2) * q2 + (bm + em) * qm)
        by_law = t1 * q1 + t2 * q2 + tm * qm
        add_bonded_losses(
            energy_terms, faces, strengths, bonds, a, bond, rise, g0, gx, gy, d0, dx, dy, n, nx, ny, shear, by_law
        )
        add_shear_energy(energy_terms.face[a], elastic, s1, s2, turn, t1, t2, tm)


@jit
def force_by(faces, pressed, strengths, bonds, a, tile, seen, lane, work, energy_terms):
    """`face_force` by the law that the joints have: dry if ``strengths`` is None."""
    if strengths is not None:
        bonded_face(faces, strengths, bonds, a, tile, seen, lane, work, energy_terms)
    else:
        face_force(faces, pressed, a, tile, seen, lane, work, energy_terms)


@jit
def face_force(faces, pressed, a, tile, seen, lane, work, energy_terms):
    """Force of convex joint ``a``, in that lane of the tile: what `resultant` makes wrenches of. ``pressed`` is
    ``faces.pressed``, given apart so that its code goes where it is None."""
    viscous = tile[VISCOUS * W + lane]
    h0, hx, hy = three(work, DEPTH, lane)
    d0, dx, dy = three(work, GROWTH, lane)
    outline = faces.outline[a]
    x = faces.x[outline]
    y = faces.y[outline]
    count = faces.count[outline]
    area = faces.area[a]
    second = faces.second[a]
    reach = faces.reach[a]
    n, nx, ny, p0, px, py = area_pressure(x, y, 0, count, area, second, reach, viscous, h0, hx, hy, d0, dx, dy)
    follow_bending(pressed, a, x, y, 0, count, reach, n, nx, ny, p0, px, py)
    k_n = faces.k_n[a]
    n *= k_n
    nx *= k_n
    ny *= k_n
    # slip of the step at the foot of O in the plane's axes, and what turns them into the polygon's
    p1, p2, _ = three(work, MOVED, lane)
    turn = work[TURN * W + lane]
    c1 = seen[FIRST * W + lane]
    c2 = seen[(FIRST + 1) * W + lane]
    scale = 1.0 / sqrt(c1 * c1 + c2 * c2)
    cosine = c1 * scale
    sine = c2 * scale
    elastic = faces.elastic[a]
    b1 = elastic[0]
    b2 = elastic[1]
    bm = elastic[2]
    s1 = cosine * p1 + sine * p2
    s2 = cosine * p2 - sine * p1
    k_t = faces.k_s[a] * area
    k_r = faces.k_s[a] * (second[0] + second[1])
    twist = faces.twist[a]
    t1, t2, tm, e1, e2, em, q1, q2, qm, w1, w2, wm, slid, _ = area_friction(
        x, y, 0, count, area, reach, faces.far[outline], pressed, a, faces.radius[a], n, faces.friction[a],
        faces.negligible[a], k_t, k_r, 1.0 + tile[(VISCOUS + 1) * W + lane], s1, s2, turn, b1, b2, bm, twist[0],
        twist[1], twist[2],
    )  # fmt: skip
    elastic[0] = e1
    elastic[1] = e2
    elastic[2] = em
    twist[0] = w1
    twist[1] = w2
    twist[2] = wm
    faces.slip[a] += slid
    put_force(work, lane, cosine, sine, n, nx, ny, t1, t2, tm)
    if energy_terms is not None:
        row = energy_terms.face[a]
        q0, qx, qy = spring_pressure(x, y, 0, count, area, second, reach, h0, hx, hy)
        add_pressure_energy(row, k_n * q0, k_n * qx, k_n * qy, n, nx, ny, h0, hx, hy, d0, dx, dy)
        add_shear_energy(row, elastic, s1, s2, turn, t1, t2, tm)
        if slid > 0.0 or n <= 0.0:
            add_slip_work(energy_terms, faces, a, n, q1, q2, qm, t1, t2, tm, b1, b2, bm)


@jit
def forces(links, faces, bodies, first, last, energy_terms, work):
    """Forces of the convex joints in their tiles ``first`` to ``last``; ``work`` (WORK,) is scratch;
    ``energy_terms`` may be None."""
    for t in range(first, last):
        own = faces.tile[t]
        like = links.like[own]
        tile = links.tiles[like * TILE : (like + 1) * TILE]
        seen = links.seen_tiles[own * SEEN_TILE : (own + 1) * SEEN_TILE]
        fetch(faces.joint, faces.lane[t], links, bodies, work)
        look(tile, seen, work)
        for lane in range(faces.used[t]):
            force_by(
                faces,
                faces.pressed,
                faces.strengths,
                faces.bonds,
                faces.lane[t, lane],
                tile,
                seen,
                lane,
                work,
                energy_terms,
            )
        resultant(tile, seen, work)
        deliver(faces.joint, faces.lane[t], faces.used[t], work, links.wrench)


@jit
def springs_of(bonds, faces, a, g0, gx, gy):
    """k_n times the integrals of <g>+, x <g>+ and y <g>+ over convex joint ``a``, of g itself where a bond holds; and
    the penetration g0 at O, with the rise by dilation. ``bonds`` is ``faces.bonds``."""
    outline = faces.outline[a]
    k = faces.k_n[a]
    if bonds is not None:
        g0 += bonds.rise[a]
        n, nx, ny, _ = area_springs(
            faces.x[outline], faces.y[outline], 0, faces.count[outline], faces.area[a], faces.second[a], faces.reach[a],
            bonds.bonded[a], inf, g0, gx, gy,
        )  # fmt: skip
    else:
        n, nx, ny = spring_pressure(
            faces.x[outline], faces.y[outline], 0, faces.count[outline], faces.area[a], faces.second[a],
            faces.reach[a], g0, gx, gy,
        )  # fmt: skip
    return k * n, k * nx, k * ny, g0


@jit
def spring_energy(links, faces, a, held):
    """Energy (J) in the springs of convex joint ``a``; writes their pressure and its moments into row ``a`` of
    ``held``."""
    j = faces.joint[a]
    seen = links.seen_tiles[seen_by(links, j)]
    sense = sense_of(links, j)
    g0 = sense * (offset_of(links, j) - seen[2])
    gx = -sense * seen[5]
    gy = -sense * seen[8]
    row = held[a]
    row[0], row[1], row[2], g0 = springs_of(faces.bonds, faces, a, g0, gx, gy)
    e = faces.elastic[a]
    k = faces.k_s[a]
    sheared = (e[0] * e[0] + e[1] * e[1]) / (k * faces.area[a])
    sheared += e[2] * e[2] / (k * (faces.second[a, 0] + faces.second[a, 1]))
    return 0.5 * (row[0] * g0 + row[1] * gx + row[2] * gy + sheared)


@jit
def mean_slip(faces, a):
    """Length of the slip path (m) of convex joint ``a``."""
    return faces.slip[a]
