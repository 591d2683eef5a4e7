"""Convex joints, in searches and constant-rate tests: the area family.

Its functions have the same names as those of `point_joints`; `joint_families` calls either. The law of a convex joint
is `kernels.joint.area_law`.
"""

from math import inf
from typing import NamedTuple

from numpy import ndarray

from dembrick._jit import entry, jit
from dembrick.kernels.joint.area_law import (
    Memory,
    area_friction,
    area_pressure,
    area_springs,
    bonded_area,
    follow_bending,
    shear_springs,
    spring_pressure,
    springs_hold,
)
from dembrick.kernels.joint.dashpots import dashpot_work
from dembrick.kernels.joint.geometry import Polygon, gap_closes
from dembrick.kernels.joint.limit_surface import LimitSurface, gauge, surface
from dembrick.kernels.joint.no_tension import extremes
from dembrick.kernels.joint.point_law import Strengths, breaks_at_once, shear_strength
from dembrick.kernels.joint.pressure import Pressed
from dembrick.kernels.math.vectors import put_vector, three_of

SAME = 1e-9  # relative change of the normal force and its moments below which the pressure counts as unchanged
NEVER_OVER = 1e300  # N, for a block that no load in this direction overturns


class AreaBonds(NamedTuple):
    """Memory of convex joints with strengths, and the energy of their springs."""

    bonded: ndarray  # (a,) 1 while the bond holds, else 0
    rise: ndarray  # (a,) m, by dilation
    crushed: ndarray  # (a,) m3, volume of penetration beyond the crushing depth
    more: ndarray  # (a,) J, twice the energy of the springs beyond half the resultant times the opening
    normal: ndarray  # (a,) N
    least: ndarray  # (a,) Pa, least pressure at a corner, negative in tension


class Areas(NamedTuple):
    """Convex joints: the no-tension integral over the polygon and the exact torsion-shear limit surface."""

    joint: ndarray  # (a,) int64, which joint
    start: ndarray  # (a + 1,) int64, first vertex of each polygon
    friction: ndarray  # (a,) friction coefficient
    x: ndarray  # (v,) m, vertices about O along t1, counter-clockwise
    y: ndarray  # (v,) m, along t2
    area: ndarray  # (a,) m2
    second: ndarray  # (a, 3) m4, integrals of y^2, x^2, x y
    reach: ndarray  # (a,) m, greatest vertex distance from O
    radius: ndarray  # (a,) m, torsion strength over V_0
    far: ndarray  # (a, 42) coefficients of the series about pure translation
    k_n: ndarray  # (a,) Pa/m
    k_s: ndarray  # (a,) Pa/m
    elastic: ndarray  # (a, 3) N, N, N m, elastic shear resultant on b
    twist: ndarray  # (a, 3) m, m, rad, plastic twist of the last plastic step
    slip: ndarray  # (a,) m, length of the slip path at O
    evaluations: ndarray  # (a,) int64, evaluations of the limit surface
    pressed: Pressed | None  # None if all pressures are full
    strengths: Strengths | None = None  # besides friction; None if no joint has any
    bonds: AreaBonds | None = None  # None if ``strengths`` is


@jit
def limit_of(areas, a):
    """The `LimitSurface` of convex joint ``a`` under its present pressure."""
    return limit_under(areas.pressed, areas, a)


@jit
def limit_under(pressed, areas, a):
    """The `LimitSurface` of convex joint ``a`` under the pressure ``pressed``; None: full."""
    polygon = Polygon(
        areas.x, areas.y, areas.start[a], areas.start[a + 1], areas.area[a], three_of(areas.second[a]), areas.reach[a]
    )
    return LimitSurface(polygon, areas.far[a], areas.reach[a], areas.radius[a], pressed, a)


@jit
def forces(areas, a, before, motion, viscous, energy):
    """Resultant (N, V_1, V_2, M_T, M_1, M_2, slip) of convex joint ``a`` for a `Motion`; updates its memory and, with
    ``energy`` (not None), adds the work of the step to it. ``viscous``: as in `point_joints`."""
    return forces_by(areas.strengths, areas.bonds, areas, a, motion, viscous, energy)


@jit
def forces_by(strengths, bonds, areas, a, motion, viscous, energy):
    """`forces` by the law of the joints: dry if ``strengths`` is None."""
    if strengths is not None:
        return bonded_forces(strengths, bonds, areas, a, motion, viscous, energy)
    return dry_forces(areas, a, motion, viscous, energy)


@jit
def bonded_forces(strengths, bonds, areas, a, motion, viscous, energy):
    """`forces` of a joint in a scene where some have strengths."""
    limit = limit_under(None, areas, a)
    polygon = limit.polygon
    k_n = areas.k_n[a]
    elastic = areas.elastic[a]
    twist = areas.twist[a]
    b1, b2, br = three_of(elastic)
    bond = bonds.bonded[a]
    rise = bonds.rise[a]
    most = strengths.crushing[a] / k_n
    g0, gx, gy = motion.depth
    (n, nx, ny), (v1, v2, mt), (q1, q2, qr), slid, evaluations, memory = bonded_area(
        limit, strengths, a, (k_n, areas.k_s[a]), areas.friction[a], 0.0, (viscous[0], 1.0 + viscous[1]), motion,
        Memory((b1, b2, br), three_of(twist), bond, rise),
    )  # fmt: skip
    e1, e2, er = memory.elastic
    bonded = memory.bonded
    risen = memory.rise
    put_vector(elastic, e1, e2, er)
    put_vector(twist, *memory.start)
    areas.slip[a] += slid
    areas.evaluations[a] += evaluations
    bonds.bonded[a] = bonded
    bonds.rise[a] = risen
    (still, still_x, still_y), beyond = area_springs(polygon, bonded, most, g0 + risen, gx, gy)
    if energy is not None:
        d0, dx, dy = motion.growth
        o0, ox, oy = g0 - d0, gx - dx, gy - dy
        (before, before_x, before_y), crushed = area_springs(polygon, bond, most, o0 + rise, ox, oy)
        across = springs_hold(polygon, bond, rise, most, o0, ox, oy)
        across -= springs_hold(polygon, bonded, risen, most, g0, gx, gy)
        across += (before_x + still_x) * dx + (before_y + still_y) * dy + (before + still) * d0
        across *= 0.5 * k_n
        crushing = strengths.crushing[a] * (beyond - crushed) if beyond > crushed else 0.0
        shear = 0.5 * ((b1 + e1) * q1 + (b2 + e2) * q2 + (br + er) * qr)
        energy.work[0].crushing += crushing
        if bonded < bond:
            energy.work[0].fracture += shear + across - crushing
        elif n > 0.0:
            dash = (n - k_n * still) * (risen - rise)  # the dashpot lengthens with the lift
            lifted = across - dash if risen > rise else 0.0
            energy.work[0].damping += dash
            energy.work[0].sliding += shear + lifted
            energy.work[0].by_law += v1 * q1 + v2 * q2 + mt * qr - n * (risen - rise)
            energy.work[0].least = min(energy.work[0].least, shear + lifted)
        else:
            energy.work[0].damping += shear
        energy.work[0].damping += 0.5 * dashpot_work(
            energy.dash[areas.joint[a]], (v1 - e1, v2 - e2, mt - er),
            (n - k_n * still, k_n * still_y - ny, nx - k_n * still_x), motion,
        )  # fmt: skip
    bonds.crushed[a] = beyond
    bonds.normal[a] = n
    bonds.least[a] = k_n * extremes(polygon.x, polygon.y, polygon.first, polygon.last, g0 + risen, gx, gy)[0]
    bonds.more[a] = k_n * still * risen
    if beyond > 0.0:
        bonds.more[a] -= strengths.crushing[a] * beyond
    return n, v1, v2, mt, -ny, nx, areas.slip[a]


@jit
def dry_forces(areas, a, motion, viscous, energy):
    """`forces` of a joint in a scene where none has strengths."""
    limit = limit_of(areas, a)
    polygon = limit.polygon
    k_n = areas.k_n[a]
    pressure, depth = area_pressure(polygon, viscous[0], motion.depth, motion.growth)
    n = k_n * pressure[0]
    m1 = -k_n * pressure[2]
    m2 = k_n * pressure[1]
    follow_bending(areas.pressed, a, polygon, pressure, depth)
    elastic = areas.elastic[a]
    twist = areas.twist[a]
    old = three_of(elastic)
    shear, new, slipped, start, slid, evaluations = area_friction(
        limit, n, areas.friction[a], 0.0, shear_springs(polygon, areas.k_s[a]), 1.0 + viscous[1], motion.slip, old,
        three_of(twist),
    )  # fmt: skip
    put_vector(elastic, *new)
    put_vector(twist, *start)
    v1, v2, mt = shear
    areas.slip[a] += slid
    if energy is not None:
        q1, q2, qr = slipped
        loss = 0.5 * ((old[0] + new[0]) * q1 + (old[1] + new[1]) * q2 + (old[2] + new[2]) * qr)
        if n > 0.0:
            energy.work[0].sliding += loss
            energy.work[0].by_law += v1 * q1 + v2 * q2 + mt * qr
            if loss < 0.0:
                energy.work[0].least = min(energy.work[0].least, loss)
        else:  # an open joint releases the energy of its springs
            energy.work[0].damping += loss
        still, still_x, still_y = spring_pressure(polygon, *motion.depth)
        energy.work[0].damping += 0.5 * dashpot_work(
            energy.dash[areas.joint[a]], (v1 - new[0], v2 - new[1], mt - new[2]),
            (n - k_n * still, m1 + k_n * still_y, m2 - k_n * still_x), motion,
        )  # fmt: skip
    areas.evaluations[a] += evaluations
    return n, v1, v2, mt, m1, m2, areas.slip[a]


@jit
def dissipation(areas, a, rest, normal, q1, q2, qr):
    """D(q) of convex joint ``a`` under the normal force ``normal``."""
    # D is homogeneous of degree one: near the unit twist nothing overflows
    size = max(abs(q1), abs(q2), abs(qr) * areas.reach[a])
    if size == 0.0:
        return 0.0
    d = surface(limit_of(areas, a), q1 / size, q2 / size, qr / size)[0]
    return strength(areas.strengths, areas.bonds, areas, a, normal) * size * d


@jit
def strength(strengths, bonds, areas, a, normal):
    """Scale of the limit surface of convex joint ``a`` (N) under the normal force ``normal``."""
    if strengths is not None:
        return shear_strength(strengths, a, areas.area[a], bonds.bonded[a], areas.friction[a], normal)
    return areas.friction[a] * normal


@jit
def shear_energy(areas, a):
    """Energy (J) in the shear and torsion springs of convex joint ``a``."""
    k_t = areas.k_s[a] * areas.area[a]
    k_r = areas.k_s[a] * (areas.second[a, 0] + areas.second[a, 1])
    e = areas.elastic[a]
    return 0.5 * ((e[0] ** 2 + e[1] ** 2) / k_t + e[2] ** 2 / k_r) + beyond_opening(areas.bonds, a)


@jit
def beyond_opening(bonds, a):
    """Energy (J) in normal springs beyond half their resultant times the opening, of a joint that was crushed or
    lifted."""
    if bonds is not None:
        return 0.5 * bonds.more[a]
    return 0.0


@jit
def copy_bonds(bonds, memory, a):
    """Copy the memory of the bond of joint ``a``."""
    if bonds is not None:
        memory.bonded[a] = bonds.bonded[a]
        memory.rise[a] = bonds.rise[a]
        memory.crushed[a] = bonds.crushed[a]


@jit
def remember(areas, memory, a):
    """Copy the memory of convex joint ``a`` into ``memory``, another `Areas`."""
    for i in range(3):
        memory.elastic[a, i] = areas.elastic[a, i]
        memory.twist[a, i] = areas.twist[a, i]
    memory.slip[a] = areas.slip[a]
    copy_bonds(areas.bonds, memory.bonds, a)


@jit
def write_bonds(bonds, areas, out):
    """1 for every joint whose bond holds, else 0, into ``out`` (j,); ``bonds`` is ``areas.bonds``."""
    if bonds is not None:
        for a in range(areas.joint.size):
            out[areas.joint[a]] = bonds.bonded[a]


# --- limit-analysis bounds


@jit
def carried_share(areas, a, rest, normal, now):
    """The part of the present forces that fits under ``normal``, the normal force before the actuators pushed: a block
    that bounces carries more for a moment."""
    return normal / now[0] if now[0] > normal else 1.0


@jit
def moved_from(pressed, a, reach, centre, normal, now):
    """`pressure_moved` by ``pressed``, None if all pressures are full."""
    if pressed is not None:
        most = SAME * normal
        return pressed.kind[a] != 0 and (
            abs(now[0] - normal) > most
            or abs(now[5] - now[0] * centre[0]) > most * reach
            or abs(now[4] + now[0] * centre[1]) > most * reach
        )
    return False


@jit
def pressure_moved(areas, a, centre, normal, now):
    """Whether friction follows a pressure that differs from that before the actuators pushed."""
    return moved_from(areas.pressed, a, areas.reach[a], centre, normal, now)


@jit
def bound_twist(areas, a, joints):
    """Slip twist (3) that gives the least upper bound: the plastic twist, for which bounds coincide up to rounding."""
    return areas.twist[a, 0], areas.twist[a, 1], areas.twist[a, 2]


@jit
def area_gauge(areas, a, f1, f2, m):
    """Gauge of a tangential force over V_0 in the limit set of convex joint ``a`` under its present pressure."""
    return gauge(limit_of(areas, a), (f1, f2, m), (0.0, 0.0, 0.0))[0]


@jit
def pressure_centre(pressed, areas, a, basis):
    """Centre of pressure and torsion radius if friction follows the bending; False if it does not."""
    if pressed is not None:
        if pressed.kind[a] != 0:
            basis.centre[0] = pressed.centre[a, 0]
            basis.centre[1] = pressed.centre[a, 1]
            basis.scalars[2] = 1.0 / area_gauge(areas, a, 0.0, 0.0, 1.0)
            return True
    return False


@jit
def at_rest(areas, a, basis):
    """Fill ``basis`` with the dead-load state of convex joint ``a``; returns the reach of its shear forces (m), and
    whether friction follows the pressure."""
    basis.scalars[2] = areas.radius[a]
    follows = pressure_centre(areas.pressed, areas, a, basis)
    return areas.reach[a], follows


@jit
def overturning_load(areas, a, resultant, normal, unit):
    """V at which the centre of pressure of a convex joint reaches the edge of its polygon."""
    e1 = resultant[5] / normal
    e2 = -resultant[4] / normal
    d1 = unit[4] / normal
    d2 = -unit[3] / normal
    least = NEVER_OVER
    last = areas.start[a + 1]
    xa = areas.x[last - 1]
    ya = areas.y[last - 1]
    for i in range(areas.start[a], last):
        out_1 = areas.y[i] - ya
        out_2 = xa - areas.x[i]
        speed = out_1 * d1 + out_2 * d2
        if speed > 0.0:
            least = min(least, ((xa - e1) * out_1 + (ya - e2) * out_2) / speed)
        xa = areas.x[i]
        ya = areas.y[i]
    return least


@jit
def closes_gap(areas, a, gap, base, u):
    """Whether a gap of convex joint ``a`` closes further between the motions ``base`` (6) and ``u`` (6)."""
    return gap_closes(areas.x, areas.y, areas.start[a], areas.start[a + 1], gap, base, u)


@jit
def dead_gauge(areas, a, normal, dead, basis):
    """Gauge of the dead load (6,) in the limit set, exact."""
    strength = areas.friction[a] * normal
    return area_gauge(areas, a, dead[0] / strength, dead[1] / strength, dead[5] / strength)


# --- bonds


@entry
def reserves(areas, out):
    """Reserve of bonds (a, 2), in N: in tension at the worst corner times the area; and in shear, if breaking would
    release force, else infinite. Both are infinite if there is no bond."""
    for a in range(areas.joint.size):
        out[a, 0] = out[a, 1] = inf
        strengths = areas.strengths
        if areas.bonds.bonded[a] > 0.0:
            least = areas.bonds.least[a]
            out[a, 0] = areas.area[a] * (strengths.tension[a] + least)
            if least < 0.0 or breaks_at_once(strengths, a):
                e = areas.elastic[a]
                cap = shear_strength(strengths, a, areas.area[a], 1.0, areas.friction[a], areas.bonds.normal[a])
                out[a, 1] = cap if cap <= 0.0 else cap - cap * area_gauge(areas, a, e[0] / cap, e[1] / cap, e[2] / cap)
