"""Convex joints, in real time: the area family. The law of a convex joint is `kernels.joint.area_law`; the functions
have the same names as those of `point_joints`, and `joint_families` calls either.

Shear memory is stored in the polygon's axes and turns with them. The normal force acts along the other's normal.
"""

from math import inf, sqrt

from dembrick._jit import entry, jit
from dembrick.kernels.dynamics.area_energy import add_slip_work, add_work, store_shear
from dembrick.kernels.dynamics.area_tiles import (
    fetch_corners,
    in_polygon_axes,
    put_force,
)
from dembrick.kernels.dynamics.bonded_areas import bonded_face
from dembrick.kernels.dynamics.energy_terms import STEPPING_AT, Counted
from dembrick.kernels.dynamics.law_memory import dashpots_of, keeps_shear
from dembrick.kernels.dynamics.tiles import (
    ACTION,
    FOUR,
    ROW,
    WRENCHES,
    W,
    deliver,
    expect,
    expect_part,
    fetch,
    four,
    offset_of,
    put_three,
    resultant,
    sense_of,
    three,
    two,
    update_kinematics,
)
from dembrick.kernels.joint.area_law import (
    area_friction,
    area_pressure,
    area_pressure_of_four,
    area_springs,
    closed_pressure,
    either_wholly,
    follow_bending,
    pressure_of_four,
    shear_springs,
    spring_pressure,
    stretched,
    trial_force,
    wholly_closed,
)
from dembrick.kernels.joint.geometry import Polygon
from dembrick.kernels.joint.limit_surface import LimitSurface
from dembrick.kernels.math.vectors import put_vector, three_of


@entry
def tile_pressure(tile, face, work, energy):
    """Pressure on the joints of a tile, all side by side, into ``work.pressed``, and that on their springs into
    ``work.still`` unless ``energy`` is None; valid only for joints with four corners."""
    for lane in range(W):
        x = four(work.corner_x, lane)
        y = four(work.corner_y, lane)
        area = face.area[lane]
        second = three(face.second, lane)
        g0, gx, gy = three(work.depth, lane)
        n, nx, ny, touching = area_pressure_of_four(
            x, y, area, second, dashpots_of(tile, work, lane)[0], (g0, gx, gy), three(work.growth, lane)
        )
        put_three(work.pressed, lane, (n, nx, ny))
        if energy is not None:
            put_three(work.still, lane, pressure_of_four(x, y, area, second, touching, g0, gx, gy))


@jit
def polygon_of(faces, a, face, lane):
    """The `Polygon` of convex joint ``a``, in lane ``lane`` of the tile ``face``."""
    outline = faces.outline[a]
    return Polygon(
        faces.x[outline], faces.y[outline], 0, faces.count[outline], face.area[lane], three(face.second, lane),
        face.reach[lane],
    )  # fmt: skip


@jit
def limit_of(faces, pressed, a, face, lane):
    """The `LimitSurface` of convex joint ``a``, in lane ``lane`` of the tile ``face``, as it is ``pressed``."""
    far = faces.far[faces.outline[a]]
    return LimitSurface(polygon_of(faces, a, face, lane), far, face.reach[lane], face.radius[lane], pressed, a)


@jit
def pressure_of(faces, pressed, a, tile, face, lane, work):
    """Integrals over convex joint ``a`` of its pressure, and the x and y moments: those of `tile_pressure`, or, for
    polygons of more or fewer corners than four and if friction follows the bending, those of `area_pressure`."""
    if pressed is None:
        if faces.count[faces.outline[a]] == FOUR:
            return three(work.pressed, lane)
    polygon = polygon_of(faces, a, face, lane)
    pressure, depth = area_pressure(
        polygon, dashpots_of(tile, work, lane)[0], three(work.depth, lane), three(work.growth, lane)
    )
    follow_bending(pressed, a, polygon, pressure, depth)
    return pressure


@jit
def store_spring_pressure(faces, pressed, a, face, lane, work):
    """Write the pressure on the springs of convex joint ``a`` into ``work.still``, unless `tile_pressure` has computed
    it."""
    if pressed is None:
        if faces.count[faces.outline[a]] == FOUR:
            return
    put_three(work.still, lane, spring_pressure(polygon_of(faces, a, face, lane), *three(work.depth, lane)))


@entry  # if inlined, its sums would be rounded differently in each of the two loops
def face_force(faces, pressed, a, tile, seen, face, sheared, lane, work, counted):
    """Force of convex joint ``a``, in lane ``lane`` of the tile: the input of `resultant`. ``pressed`` is
    ``faces.pressed``, passed separately so that numba omits its code if it is None; ``face``, ``sheared`` and
    ``counted``: its tiles of `Faces.tiles`, `Faces.sheared` and the energy terms, or None."""
    limit = limit_of(faces, pressed, a, face, lane)
    n, nx, ny = pressure_of(faces, pressed, a, tile, face, lane, work)
    k_n = face.k_n[lane]
    n *= k_n
    nx *= k_n
    ny *= k_n
    # slip of the step at the foot of O
    p1, p2 = two(work.slip, lane)
    s1, s2, cosine, sine = in_polygon_axes(seen, lane, p1, p2)
    slip = s1, s2, work.turn[lane]
    before = three(sheared.elastic, lane)
    twist = faces.twist[a]
    springs = shear_springs(limit.polygon, face.k_s[lane])
    force, elastic, slipped, start, slid, _ = area_friction(
        limit, n, face.friction[lane], face.negligible[lane], springs, dashpots_of(tile, work, lane)[1], slip, before,
        three_of(twist),
    )  # fmt: skip
    if work.searching[lane] > 0.0 and (n > 0.0 or keeps_shear(before, work, lane)):
        elastic = stretched(springs, slip, before)
        slid = 0.0
    put_three(sheared.elastic, lane, elastic)
    put_vector(twist, *start)
    faces.slip[a] += slid
    put_force(work, lane, cosine, sine, (n, nx, ny), force)
    if counted is not None:
        store_spring_pressure(faces, pressed, a, face, lane, work)
        store_shear(work, lane, force, elastic, slip)
        if slid > 0.0 or (n <= 0.0 and (before[0] != 0.0 or before[1] != 0.0 or before[2] != 0.0)):
            add_slip_work(counted.ledger, lane, n, slipped, force, before, elastic)


@jit
def new_if(done, new, old):
    """The vector ``new`` if ``done``, else ``old``."""
    return (new[0] if done else old[0], new[1] if done else old[1], new[2] if done else old[2])


@jit
def vector_if(done, a):
    """The vector a if ``done``, else zero."""
    return new_if(done, a, (0.0, 0.0, 0.0))


@entry
def sticking_forces(tile, seen, face, sheared, work, energy):
    """`face_force` of all joints of a tile that are wholly closed and do not slide, or wholly open without memory, as
    are most joints most of the time.

    The others are left unchanged, and marked in ``work``; ``energy`` is None if none is counted. Returns whether there
    are any.
    """
    rest = False
    for lane in range(W):
        viscous, damped = dashpots_of(tile, work, lane)
        g0, gx, gy = three(work.depth, lane)
        d0, dx, dy = three(work.growth, lane)
        h0 = g0 + viscous * d0
        hx = gx + viscous * dx
        hy = gy + viscous * dy
        area = face.area[lane]
        second = three(face.second, lane)
        reach = face.reach[lane]
        k_n = face.k_n[lane]
        k_s = face.k_s[lane]
        n, nx, ny = closed_pressure(k_n * area, (k_n * second[0], k_n * second[1], k_n * second[2]), h0, hx, hy)
        p1, p2 = two(work.slip, lane)
        turn = work.turn[lane]
        s1, s2, cosine, sine = in_polygon_axes(seen, lane, p1, p2)
        b1, b2, bm = three(sheared.elastic, lane)
        springs = k_s * area, k_s * (second[0] + second[1])
        trial, elastic, size = trial_force(None, 0, face.radius[lane], springs, damped, (s1, s2, turn), (b1, b2, bm))
        whole = either_wholly(reach, g0, gx, gy)
        stuck = wholly_closed(reach, g0, d0, h0, hx, hy) & whole & (n > 0.0) & (size <= face.friction[lane] * n)
        idle = whole & (g0 <= 0.0) & (g0 <= d0) & (b1 == 0.0) & (b2 == 0.0) & (bm == 0.0)
        put_three(sheared.elastic, lane, new_if(stuck, elastic, (b1, b2, bm)))
        put_force(work, lane, cosine, sine, vector_if(stuck, (n, nx, ny)), vector_if(stuck, trial))
        work.rest[lane] = 0.0 if stuck | idle else 1.0
        rest = rest | (not (stuck | idle))
        if energy is not None:
            put_three(work.slipped, lane, (s1, s2, turn))
    return rest


@jit
def forces_of_tile(faces, pressed, strengths, bonds, t, tile, seen, work, energy_terms, counted):
    """Forces of the convex joints in their tile ``t``: the input of `resultant`.

    ``pressed``, ``strengths`` and ``bonds`` are those of ``faces``, passed separately so that numba omits their code if
    they are None; ``counted``: the records of the tile in ``energy_terms``, or both None.
    """
    like = faces.like[t]
    face = faces.tiles[like]
    sheared = faces.sheared[t]
    used = faces.used[t]
    if strengths is not None:
        for lane in range(used):
            a = faces.lane[t, lane]
            limit = limit_of(faces, None, a, face, lane)
            bonded_face(faces, limit, (strengths, bonds), a, tile, seen, (face, sheared), lane, work, counted)
        return
    rest = True
    if pressed is not None:
        for lane in range(used):
            work.rest[lane] = 1.0
    else:
        rest = sticking_forces(tile, seen, face, sheared, work, counted)
        if rest:
            fetch_corners(faces, t, work)
            tile_pressure(tile, face, work, counted)
    if rest:
        for lane in range(used):
            if work.rest[lane] > 0.0:
                face_force(faces, pressed, faces.lane[t, lane], tile, seen, face, sheared, lane, work, counted)
    if energy_terms is not None:
        add_work(energy_terms, t, counted.dashpots, counted.ledger, tile, face, work, rest, used)


@jit
def forces(links, faces, bodies, first, last, energy_terms, work):
    """Forces of the convex joints in their tiles ``first`` to ``last`` - 1; ``work`` is scratch; ``energy_terms`` may
    be None."""
    for t in range(first, last):
        own = faces.tile[t]
        like = links.like[own]
        tile = links.tiles[like]
        seen = links.seen_tiles[own]
        expect(links.seen_tiles, own + 1)
        expect(faces.sheared, t + 1)
        if energy_terms is not None:
            expect(energy_terms.dashpots, own + 1)
            expect_part(energy_terms.ledger, own + 1, 0, ROW)
            if t + 1 < last and energy_terms.partly[t + 1] > 0:
                expect_part(energy_terms.ledger, own + 1, STEPPING_AT, ROW)
                expect(energy_terms.springs, t + 1)
        expect_part(links.wrenches, own * WRENCHES, 0, ACTION * ROW)
        fetch(links, own, bodies, work)
        update_kinematics(tile, seen, work)
        if energy_terms is None:
            forces_of_tile(faces, faces.pressed, faces.strengths, faces.bonds, t, tile, seen, work, None, None)
        if energy_terms is not None:
            counted = Counted(energy_terms.dashpots[own], energy_terms.ledger[own])
            forces_of_tile(
                faces, faces.pressed, faces.strengths, faces.bonds, t, tile, seen, work, energy_terms, counted
            )
        resultant(tile, seen, work)
        deliver(work, links.wrenches, own)


@jit
def springs_of(bonds, faces, a, g0, gx, gy):
    """k_n times the integrals of <g>+, x <g>+ and y <g>+ over convex joint ``a``, or of g itself if a bond holds; and
    the penetration g0 at O, including the rise by dilation. ``bonds`` is ``faces.bonds``."""
    face = faces.tiles[faces.place[a] // W]
    lane = faces.place[a] % W
    k = face.k_n[lane]
    polygon = polygon_of(faces, a, face, lane)
    if bonds is not None:
        g0 += bonds.rise[a]
        (n, nx, ny), _ = area_springs(polygon, bonds.bonded[a], inf, g0, gx, gy)
    else:
        n, nx, ny = spring_pressure(polygon, g0, gx, gy)
    return k * n, k * nx, k * ny, g0


@jit
def spring_energy(links, faces, a, held):
    """Energy (J) in the springs of convex joint ``a``; writes their normal force and its moments into row ``a`` of
    ``held`` unless it is None."""
    j = faces.joint[a]
    seen = links.seen_tiles[links.place[j] // W]
    lane = links.place[j] % W
    sense = sense_of(links, j)
    g0 = sense * (offset_of(links, j) - seen.origin[2, lane])
    gx = -sense * seen.first[2, lane]
    gy = -sense * seen.second[2, lane]
    n, nx, ny, g0 = springs_of(faces.bonds, faces, a, g0, gx, gy)
    if held is not None:
        put_vector(held[a], n, nx, ny)
    tile = faces.place[a] // W
    lane = faces.place[a] % W
    e1, e2, em = three(faces.sheared[tile].elastic, lane)
    face = faces.tiles[tile]
    yy, xx, _ = three(face.second, lane)
    k = face.k_s[lane]
    sheared = (e1 * e1 + e2 * e2) / (k * face.area[lane])
    sheared += em * em / (k * (yy + xx))
    return 0.5 * (n * g0 + nx * gx + ny * gy + sheared)


@jit
def work_ahead(faces, a, held, sense, offset, now, step, slip, turn):
    """Work (J) on the springs of convex joint ``a`` over a ``step`` (9) of `Links.seen` from ``now``, if their forces
    stayed constant; ``slip`` (9) and ``turn`` of the feet in it, ``held`` (a, 3) N and its moments."""
    e1, e2, em = three(faces.sheared[faces.place[a] // W].elastic, faces.place[a] % W)
    c, s = now[3] + step[3], now[4] + step[4]
    length = sqrt(c * c + s * s)
    c /= length
    s /= length
    work = -sense * (held[a, 0] * step[2] + held[a, 1] * step[5] + held[a, 2] * step[8])
    return work + e1 * (c * slip[0] + s * slip[1]) + e2 * (c * slip[1] - s * slip[0]) + em * turn


@jit
def mean_slip(faces, a):
    """Length of the slip path (m) of convex joint ``a``."""
    return faces.slip[a]
