"""Joints that act at contact points, in real time: the point family. The law of one point is `kernels.joint.point_law`;
the functions have the same names as those of `area_joints`, and `joint_families` calls either.

All joints of a tile have the same law and the same number of points, which never change; the first two points of each
joint, then the next two and so on are evaluated side by side. An odd number is completed by a point without area. In a
tile with few joints, each may have several lanes for its points (`spread_points`). Shear memory is stored in the
plane's axes and turns with them. The normal force acts along the other's normal, and force and reaction at one world
point.

If any joint has strengths, all points of the scene follow the law with bonds (`bonded_force` instead of `point_force`),
which counts their losses itself; the same applies to a user-defined law (`custom_force`).
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy import ndarray

from dembrick._jit import entry, jit
from dembrick.kernels.dynamics.energy_terms import dashpot_work
from dembrick.kernels.dynamics.law_memory import dashpots_of
from dembrick.kernels.dynamics.point_laws import (
    bonded_force,
    bonded_pair,
    custom_force,
    energy_of,
    place_of,
    rows_of,
    spring_length,
)
from dembrick.kernels.dynamics.slip_paths import add_slip, lengthen_paths
from dembrick.kernels.dynamics.spread_points import gather_losses, gather_sums, spread_motion
from dembrick.kernels.dynamics.tiles import (
    ACTION,
    POINT,
    ROW,
    WRENCHES,
    W,
    alike,
    combined,
    deliver,
    expect,
    expect_part,
    fetch,
    in_lanes,
    offset_of,
    put_in_lanes,
    put_three,
    resultant,
    sense_of,
    set_apart,
    three,
    two,
    update_kinematics,
)
from dembrick.kernels.joint.custom_law import Custom
from dembrick.kernels.joint.point_law import Strengths, point_law, shear_loss
from dembrick.kernels.math.vectors import put_vector


@entry
def clear_sums(tile, work):
    """Set the sums over the points to zero, and store the dashpot ratios for all points of each joint."""
    zero = (0.0, 0.0, 0.0)
    for lane in range(W):
        normal, damped = dashpots_of(tile, work, lane)
        work.normal[lane] = normal
        work.damped[lane] = damped
        work.damping[lane] = 1.0 / damped
        put_three(work.force, lane, zero)
        put_three(work.x_force, lane, zero)
        put_three(work.y_force, lane, zero)
        put_three(work.dashpot, lane, zero)
        put_three(work.x_dashpot, lane, zero)
        put_three(work.y_dashpot, lane, zero)
        work.twisting[lane] = 0.0
        work.rubbed[lane] = 0.0
        work.carrying[lane] = 0.0


class PointLaw(NamedTuple):
    """The law of the points of a tile."""

    k_n: float  # Pa/m
    k_s: float  # Pa/m
    friction: float
    arm: float  # distance from O at which friction acts, over that of the normal force


@jit
def point_force(work, pair, which, lane, law, energy, force_out):
    """Forces of one point, number ``which`` of the ``pair`` of `pair_forces`: its arms of the normal force and of
    friction, its shear force in the sense in which the host slips, its normal force, the parts of these three in its
    dashpots, whether it slid or lost other energy."""
    own, sheared = pair
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
    u1 = p1 + xs * x1 + ys * y1
    u2 = p2 + xs * x2 + ys * y2
    b1 = sheared[which].elastic[0, lane]
    b2 = sheared[which].elastic[1, lane]
    k = law.k_n * area
    dashpots = work.normal[lane], work.damped[lane], work.damping[lane]
    k_s = law.k_s * area
    normal, t1, t2, e1, e2, slid = point_law(g, d, (u1, u2), (b1, b2), (k, k_s), law.friction, dashpots)
    searching = work.searching[lane] if (normal > 0.0) | (work.keeping[lane] * (abs(b1) + abs(b2)) > 0.0) else 0.0
    e1 += searching * (b1 + k_s * u1 - e1)
    e2 += searching * (b2 + k_s * u2 - e2)
    slid -= searching * slid
    sheared[which].elastic[0, lane] = e1
    sheared[which].elastic[1, lane] = e2
    work.slid[which, lane] = slid
    work.weight[which, lane] = normal
    dashpot = 0.0
    loses = slid > 0.0
    if energy is not None:
        dashpot = normal - k * max(g, 0.0)
        put_three(work.before[which], lane, (b1, b2, normal))
        # slides, or releases its shear, or opened or closed in the step
        held = abs(b1) + abs(b2)
        loses = loses | ((normal == 0.0) & (held > 0.0)) | (g * (g - d) < 0.0)
    if force_out is not None:
        put_three(work.last[which], lane, (t1, t2, normal))
    return x, y, xs, ys, t1, t2, normal, t1 - e1, t2 - e2, dashpot, loses


@jit
def point_force_by(work, pair, which, lane, law, energy, force_out, bonded, custom, ledger):
    """`point_force` by the law of the points: dry if ``bonded`` and ``custom`` are None."""
    if custom is not None:
        return custom_force(work, pair, which, lane, law.arm, energy, force_out, custom, ledger)
    if bonded is not None:
        return bonded_force(work, pair, which, lane, law, energy, force_out, bonded, ledger)
    return point_force(work, pair, which, lane, law, energy, force_out)


@entry
def pair_forces(work, pair, law, energy, force_out, bonded=None, custom=None, ledger=None):
    """Forces of two points of every joint of a tile, added to the sums in ``work``.

    ``pair``: the rows of the points and of their elastic shear; ``law``: their `PointLaw`; ``energy`` is None if no
    energy is counted, and ``force_out`` if the forces of single points are not wanted; the last three: see
    `bonded_force` and `custom_force`. Returns whether any slides or has a loss for `add_losses`.
    """
    losing = False
    for lane in range(W):
        x, y, xs, ys, t1, t2, n, c1, c2, c, loses = point_force_by(
            work, pair, 0, lane, law, energy, force_out, bonded, custom, ledger
        )
        X, Y, XS, YS, T1, T2, N, C1, C2, C, LOSES = point_force_by(
            work, pair, 1, lane, law, energy, force_out, bonded, custom, ledger
        )
        work.force[0, lane] -= t1 + T1
        work.force[1, lane] -= t2 + T2
        work.force[2, lane] += n + N
        work.x_force[0, lane] -= xs * t1 + XS * T1
        work.x_force[1, lane] -= xs * t2 + XS * T2
        work.x_force[2, lane] += x * n + X * N
        work.y_force[0, lane] -= ys * t1 + YS * T1
        work.y_force[1, lane] -= ys * t2 + YS * T2
        work.y_force[2, lane] += y * n + Y * N
        if energy is not None:
            work.dashpot[0, lane] += c1 + C1
            work.dashpot[1, lane] += c2 + C2
            work.dashpot[2, lane] += c + C
            work.x_dashpot[0, lane] += xs * c1 + XS * C1
            work.x_dashpot[1, lane] += xs * c2 + XS * C2
            work.x_dashpot[2, lane] += x * c + X * C
            work.y_dashpot[0, lane] += ys * c1 + YS * C1
            work.y_dashpot[1, lane] += ys * c2 + YS * C2
            work.y_dashpot[2, lane] += y * c + Y * C
        losing |= loses | LOSES
    return losing


@jit
def write_forces(corners, t, row, sense, work, out):
    """Write the forces on the host, in the world, at the points in the rows ``row`` and row + 1 of tile ``t``."""
    for lane in range(corners.used[t]):
        p = corners.lane[t, lane]
        width = corners.width[p]
        own = lane - lane % width
        for which in range(2):
            i = (row + which) * width + lane % width
            if i < corners.start[p + 1] - corners.start[p]:
                t1, t2, normal = three(work.last[which], lane)
                force = combined(
                    (-t1, -t2, sense[own] * normal), (0.0, 0.0, 0.0),
                    three(work.u1, own), three(work.u2, own), three(work.m, own),
                )  # fmt: skip
                put_vector(out[corners.start[p] + i], force[0], force[1], force[2])


@entry
def add_dashpot_work(work, seen, dashpots, ledger):
    """Add the work of the dashpots of a tile in a step, see `EnergyTerms.dashpots`.

    All points of a joint slip as one rigid figure: by the slip at the foot of O, and by the rotation.
    """
    for lane in range(W):
        v1, v2, n = three(work.dashpot, lane)
        x1, x2, nx = three(work.x_dashpot, lane)
        y1, y2, ny = three(work.y_dashpot, lane)
        e1, e2, _ = three(seen.first, lane)
        g1, g2, _ = three(seen.second, lane)
        twisting = e1 * x2 - e2 * x1 + g1 * y2 - g2 * y1
        d0, dx, dy = three(work.growth, lane)
        p1, p2 = two(work.slip, lane)
        taken = dashpot_work(dashpots.pressing, lane, n, nx, ny, d0, dx, dy)
        taken += dashpot_work(dashpots.shearing, lane, v1, v2, twisting, p1, p2, work.turn[lane])
        ledger.dashpots[lane] += taken


@entry
def add_losses(work, pair, law, ledger):
    """Add the losses of the two points of `pair_forces` of every joint of a tile in a step: in friction, or released
    where a point has opened."""
    own, sheared = pair
    for lane in range(W):
        g0, gx, gy = three(work.depth, lane)
        d0, dx, dy = three(work.growth, lane)
        p1, p2 = two(work.slip, lane)
        x1, x2 = two(work.slip_x, lane)
        y1, y2 = two(work.slip_y, lane)
        for which in range(2):
            x = own[which].x[lane]
            y = own[which].y[lane]
            area = own[which].area[lane]
            e1 = sheared[which].elastic[0, lane]
            e2 = sheared[which].elastic[1, lane]
            b1, b2, normal = three(work.before[which], lane)
            slid = work.slid[which, lane]
            s1 = p1 + law.arm * (x * x1 + y * y1)
            s2 = p2 + law.arm * (x * x2 + y * y2)
            lost = shear_loss((b1, b2), (e1, e2), (s1, s2), law.k_s * area)
            held = lost if slid > 0.0 else 0.0
            least = ledger.smallest[lane]
            ledger.smallest[lane] = held if held < least else least
            g = g0 + x * gx + y * gy
            let_go = lost if slid == 0.0 and e1 == 0.0 and e2 == 0.0 and area > 0.0 else 0.0
            before = g - (d0 + x * dx + y * dy)
            stepping = min(g, 0.0) * max(before, 0.0) - max(g, 0.0) * min(before, 0.0)
            ledger.friction[lane] += held
            ledger.released[lane] += let_go
            ledger.stepping[lane] += 0.5 * law.k_n * area * stepping
            ledger.by_law[lane] += law.friction * normal * slid


@jit
def forces(links, corners, bodies, share, force_out, strengths, bonds, custom, energy_terms, work):
    """Forces of the point joints in the tiles of a ``share`` (first, last + 1); ``work`` is scratch.

    ``force_out``, ``strengths``, ``bonds`` and ``custom`` are those of ``corners``, passed separately so that numba
    omits their code if they are None; ``energy_terms`` may be None.
    """
    for t in range(share[0], share[1]):
        like = links.like[t]
        tile = links.tiles[like]
        seen = links.seen_tiles[t]
        expect(links.seen_tiles, t + 1)
        next_point = corners.tile_start[t + 1]
        coming = next_point - corners.tile_start[t]
        expect_part(corners.sheared, next_point, 0, coming * corners.sheared.itemsize)
        if energy_terms is not None:
            expect(energy_terms.dashpots, t + 1)
            expect_part(energy_terms.ledger, t + 1, 0, ROW)
        expect_part(links.wrenches, t * WRENCHES, 0, ACTION * ROW)
        fetch(links, t, bodies, work)
        update_kinematics(tile, seen, work)
        clear_sums(tile, work)
        width = corners.width[corners.lane[t, 0]]
        if width > 1:
            spread_motion(work, width)
        law = corners.tile_law[t]
        dry = PointLaw(corners.k_n[law], corners.k_s[law], corners.friction[law], corners.shear_arm[law])
        start = corners.tile_start[t]
        begins = corners.tile_start[corners.like[t]]
        slides = False
        for i in range(0, corners.tile_start[t + 1] - start, 2):
            own = corners.points[begins + i : begins + i + 2]
            first_point = start + i
            pair = own, corners.sheared[first_point : first_point + 2]
            bonded = bonded_pair(strengths, law, bonds, first_point)
            rows = rows_of(custom, first_point)
            if energy_terms is None:
                losing = pair_forces(work, pair, dry, None, force_out, bonded, rows, None)
            if energy_terms is not None:
                ledger = energy_terms.ledger[t]
                losing = pair_forces(work, pair, dry, True, force_out, bonded, rows, ledger)
                if strengths is None and custom is None and losing:
                    add_losses(work, pair, dry, ledger)
            if losing:
                add_slip(work)
                slides = True
            if force_out is not None:
                write_forces(corners, t, i, tile.sense, work, force_out)
        if width > 1:
            gather_sums(work, width)
            if energy_terms is not None:
                gather_losses(energy_terms.ledger[t], width)
        if slides:
            all_dry = strengths is None and custom is None
            lengthen_paths(work, all_dry, corners.lane[t, : corners.used[t]], corners.slip)
        resultant(tile, seen, work)
        deliver(work, links.wrenches, t)
        if energy_terms is not None:
            add_dashpot_work(work, seen, energy_terms.dashpots[t], energy_terms.ledger[t])


@jit
def springs_at(corners, p, i, sense, offset, heights):
    """Point ``i`` of joint ``p``: its position (m, along e1 and e2), its area (m2), its elastic shear force (N) and the
    compression of its normal spring (m); ``heights``: components of O (m), e1 and e2 along the plane's normal."""
    place = place_of(corners, p, i)
    point = corners.points[place // W]
    own = place % W
    x, y = point.x[own], point.y[own]
    e1, e2 = two(corners.sheared[place // W].elastic, own)
    g = sense * (offset - heights[0] - x * heights[1] - y * heights[2])
    law = corners.law[p]
    g = spring_length(corners.strengths, corners.bonds, law, corners.k_n[law], place, g)
    return x, y, point.area[own], e1, e2, g


@jit
def spring_energy(links, corners, p, held):
    """Energy (J) in the springs of point joint ``p``; ``held`` is used for convex joints only."""
    return spring_energy_by(corners.custom, links, corners, p)


@jit
def spring_energy_by(custom, links, corners, p):
    """`spring_energy` by the law of the points."""
    if custom is not None:
        return energy_of(custom, corners, p)
    j = corners.joint[p]
    seen = links.seen_tiles[links.place[j] // W]
    lane = links.place[j] % W
    sense = sense_of(links, j)
    offset = offset_of(links, j)
    law = corners.law[p]
    heights = seen.origin[2, lane], seen.first[2, lane], seen.second[2, lane]
    twice = 0.0
    for i in range(corners.start[p + 1] - corners.start[p]):
        _, _, area, e1, e2, g = springs_at(corners, p, i, sense, offset, heights)
        if g != 0.0:
            twice += corners.k_n[law] * area * g * g
        if area > 0.0:
            twice += (e1 * e1 + e2 * e2) / (corners.k_s[law] * area)
    return 0.5 * twice


@jit
def work_ahead(corners, p, held, sense, offset, now, step, slip, turn):
    """Work (J) on the springs of point joint ``p`` over a ``step`` (9) of `Links.seen` from ``now``, if their forces
    stayed constant; ``slip`` (9) and ``turn`` of the feet in it, ``held`` is used for convex joints only."""
    law = corners.law[p]
    arm = corners.shear_arm[law]
    work = 0.0
    for i in range(corners.start[p + 1] - corners.start[p]):
        x, y, area, e1, e2, g = springs_at(corners, p, i, sense, offset, (now[2], now[5], now[8]))
        work -= corners.k_n[law] * sense * area * g * (step[2] + x * step[5] + y * step[8])
        work += e1 * (slip[0] + arm * (x * slip[3] + y * slip[6]))
        work += e2 * (slip[1] + arm * (x * slip[4] + y * slip[7]))
    return work


@jit
def mean_slip(corners, p):
    """Length of the slip path (m) of point joint ``p``."""
    return corners.slip[p]


class Corners(NamedTuple):
    """p joints with contact points, in t tiles. Data of tiles can be read point by point under the names below, as
    copies; `put` writes them."""

    joint: ndarray  # (p,) uint32
    start: ndarray  # (p + 1,) uint32, first contact point of each
    width: ndarray  # (p,) int64, lanes in which its points are: the first of them is its own
    place: ndarray  # (p,) uint32, place of its first point: its lane, plus W times the rows of points before
    law: ndarray  # (p,) uint32, index of its law in the following
    k_n: ndarray  # (l,) Pa/m
    k_s: ndarray  # (l,) Pa/m
    friction: ndarray  # (l,)
    shear_arm: ndarray  # (l,) friction acts at this times the arm of the normal force
    lane: ndarray  # (t, W) uint32, which of the p joints each lane has; spare lanes repeat the last one
    used: ndarray  # (t,) uint32, lanes that are not spare
    tile_law: ndarray  # (t,) uint32
    tile_start: ndarray  # (t + 1,) int64, first row of points of each tile
    like: ndarray  # (t,) uint32, the tile of ``points`` that the loop reads in place of each: see `alike`
    points: ndarray  # records `POINT`, point after point of a tile
    sheared: ndarray  # records `SHEAR`, likewise
    slip: ndarray  # (p,) m, length of the slip path of each joint: see `kernels.joint.point_law`
    force: ndarray | None  # (c, 3) N, world, last force on the host at each point; None if not requested
    strengths: Strengths | None = None  # besides friction, one entry per law; None if no joint has any
    bonds: ndarray | None = None  # records `BOND`, likewise, see `point_laws`; None if ``strengths`` is
    custom: Custom | None = None  # arrays of a user-defined law, rows as ``place``; None if there is none

    def where(self, joint: int | None = None) -> ndarray:
        """The place of each contact point, as in ``place``, of all joints (c,) or of one."""
        own = np.arange(len(self.joint)) if joint is None else np.array([joint])
        count = np.diff(self.start.astype(np.int64))[own]
        number = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        row, lane = np.divmod(number, np.repeat(self.width[own], count))
        return np.repeat(self.place[own].astype(np.int64), count) + row * W + lane

    def field(self, name: str, joint: int | None = None) -> ndarray:
        """A copy of a field of contact points, of all joints (c,) or of one."""
        return in_lanes(self._tiles(name), name, self.where(joint))

    def put(self, name: str, values, joint: int | None = None) -> None:
        """Write a field of contact points, of all joints (c,) or of one."""
        where = self.where(joint)
        if name in (POINT.names or ()):
            set_apart(self.like, np.searchsorted(self.tile_start, where // W, side="right") - 1)
        put_in_lanes(self._tiles(name), name, where, values)

    def share(self) -> None:
        """Let tiles whose points are the same to the last bit share those of one of them."""
        self.like[:] = alike(self.points[a:b] for a, b in pairwise(self.tile_start.tolist()))

    def _tiles(self, name: str) -> ndarray:
        """The records that have a field ``name``."""
        records = (self.points, self.sheared, self.bonds)
        return next(tiles for tiles in records if tiles is not None and name in tiles.dtype.names)

    x = property(lambda self: self.field("x"), doc="(c,) m, from O along e1")
    y = property(lambda self: self.field("y"), doc="(c,) m, along e2")
    area = property(lambda self: self.field("area"), doc="(c,) m2, tributary")
    elastic = property(
        lambda self: self.field("elastic"), doc="(c, 2) N, elastic shear force, in the sense in which the host slips"
    )
