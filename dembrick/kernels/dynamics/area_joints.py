"""Convex joints, in real time: the area family. The law of a convex joint is `kernels.joint.area_law`; the functions
of a family are those of `point_joints`, and `joint_families` calls them.

Shear memory lives in the polygon's axes and turns with them. The normal force acts along the other's normal.
"""

from math import inf

from dembrick._jit import entry, jit
from dembrick.kernels.dynamics.area_energy import add_slip_work, add_work, keep_for_work
from dembrick.kernels.dynamics.area_tiles import (
    fetch_corners,
    in_polygon_axes,
    put_force,
)
from dembrick.kernels.dynamics.bonded_areas import bonded_face
from dembrick.kernels.dynamics.energy_terms import STEPPING_AT
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
    look,
    offset_of,
    put_three,
    resultant,
    sense_of,
    three,
    two,
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
    spring_pressure,
    trial_force,
    wholly_closed,
)
from dembrick.kernels.math.vec3 import put_vector


@entry
def press(tile, face, work, energy):
    """Pressure on the joints of a tile, all of them side by side, into ``work.pressed``, and that on their springs
    into ``work.still`` unless ``energy`` is None; not right for any other number of corners than four."""
    for lane in range(W):
        x = four(work.corner_x, lane)
        y = four(work.corner_y, lane)
        area = face.area[lane]
        second = three(face.second, lane)
        g0, gx, gy = three(work.depth, lane)
        d0, dx, dy = three(work.growth, lane)
        n, nx, ny, touching = area_pressure_of_four(x, y, area, second, tile.viscous[0, lane], g0, gx, gy, d0, dx, dy)
        put_three(work.pressed, lane, (n, nx, ny))
        if energy is not None:
            put_three(work.still, lane, pressure_of_four(x, y, area, second, touching, g0, gx, gy))


@jit
def pressure_of(faces, pressed, a, tile, face, lane, work):
    """Integrals over convex joint ``a`` of what presses it, and its x and y moments: those that `press` found, or, of
    polygons of more or fewer corners than four and if friction follows the bending, those of `area_pressure`."""
    outline = faces.outline[a]
    count = faces.count[outline]
    if pressed is None:
        if count == FOUR:
            return three(work.pressed, lane)
    h0, hx, hy = three(work.depth, lane)
    d0, dx, dy = three(work.growth, lane)
    x = faces.x[outline]
    y = faces.y[outline]
    reach = face.reach[lane]
    n, nx, ny, p0, px, py = area_pressure(
        x, y, 0, count, face.area[lane], three(face.second, lane), reach, tile.viscous[0, lane],
        h0, hx, hy, d0, dx, dy,
    )  # fmt: skip
    follow_bending(pressed, a, x, y, 0, count, reach, n, nx, ny, p0, px, py)
    return n, nx, ny


@jit
def find_still(faces, pressed, a, face, lane, work):
    """What presses the springs of convex joint ``a`` into ``work.still``, if it is not what `press` found."""
    outline = faces.outline[a]
    count = faces.count[outline]
    if pressed is None:
        if count == FOUR:
            return
    g0, gx, gy = three(work.depth, lane)
    still = spring_pressure(
        faces.x[outline], faces.y[outline], 0, count, face.area[lane], three(face.second, lane),
        face.reach[lane], g0, gx, gy,
    )  # fmt: skip
    put_three(work.still, lane, still)


@jit
def face_force(faces, pressed, a, tile, seen, face, sheared, lane, work, ledger):
    """Force of convex joint ``a``, in that lane of the tile: what `resultant` makes wrenches of. ``pressed`` is
    ``faces.pressed``, given apart so that its code goes where it is None; ``face``, ``sheared`` and ``ledger``: its
    tiles of `Faces.tiles`, `Faces.sheared` and `EnergyTerms.ledger`, or None."""
    outline = faces.outline[a]
    x = faces.x[outline]
    y = faces.y[outline]
    count = faces.count[outline]
    area = face.area[lane]
    second = three(face.second, lane)
    reach = face.reach[lane]
    n, nx, ny = pressure_of(faces, pressed, a, tile, face, lane, work)
    k_n = face.k_n[lane]
    n *= k_n
    nx *= k_n
    ny *= k_n
    # slip of the step at the foot of O
    p1, p2 = two(work.slip, lane)
    turn = work.turn[lane]
    s1, s2, cosine, sine = in_polygon_axes(seen, lane, p1, p2)
    b1, b2, bm = three(sheared.elastic, lane)
    k_s = face.k_s[lane]
    twist = faces.twist[a]
    t1, t2, tm, e1, e2, em, q1, q2, qm, w1, w2, wm, slid, _ = area_friction(
        x, y, 0, count, area, reach, faces.far[outline], pressed, a, face.radius[lane], n, face.friction[lane],
        face.negligible[lane], k_s * area, k_s * (second[0] + second[1]), 1.0 + tile.viscous[1, lane],
        s1, s2, turn, b1, b2, bm, twist[0], twist[1], twist[2],
    )  # fmt: skip
    put_three(sheared.elastic, lane, (e1, e2, em))
    put_vector(twist, w1, w2, wm)
    faces.slip[a] += slid
    put_force(work, lane, cosine, sine, n, nx, ny, t1, t2, tm)
    if ledger is not None:
        find_still(faces, pressed, a, face, lane, work)
        keep_for_work(work, lane, t1, t2, tm, e1, e2, em, s1, s2, turn)
        if slid > 0.0 or (n <= 0.0 and (b1 != 0.0 or b2 != 0.0 or bm != 0.0)):
            add_slip_work(ledger, lane, n, q1, q2, qm, t1, t2, tm, b1, b2, bm, e1, e2, em)


@jit
def kept_unless(done, new, old):
    """A vector that changes only if ``done``."""
    return (new[0] if done else old[0], new[1] if done else old[1], new[2] if done else old[2])


@jit
def zero_unless(done, a):
    """A vector if ``done``, else zero."""
    return kept_unless(done, a, (0.0, 0.0, 0.0))


@entry
def stick(tile, seen, face, sheared, work, energy):
    """`face_force` of all joints of a tile that are wholly closed and do not slide, or wholly open with no memory, as
    most are most of the time.

    The others are left as they were, and marked in ``work``; ``energy`` is None if none is counted. Returns
    whether there are any.
    """
    rest = False
    for lane in range(W):
        viscous = tile.viscous[0, lane]
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
        t1, t2, tm, e1, e2, em, size = trial_force(
            None, 0, face.radius[lane], k_s * area, k_s * (second[0] + second[1]),
            1.0 + tile.viscous[1, lane], s1, s2, turn, b1, b2, bm,
        )  # fmt: skip
        whole = either_wholly(reach, g0, gx, gy)
        stuck = wholly_closed(reach, g0, d0, h0, hx, hy) & whole & (n > 0.0) & (size <= face.friction[lane] * n)
        idle = whole & (g0 <= 0.0) & (g0 <= d0) & (b1 == 0.0) & (b2 == 0.0) & (bm == 0.0)
        put_three(sheared.elastic, lane, kept_unless(stuck, (e1, e2, em), (b1, b2, bm)))
        n, nx, ny = zero_unless(stuck, (n, nx, ny))
        t1, t2, tm = zero_unless(stuck, (t1, t2, tm))
        put_force(work, lane, cosine, sine, n, nx, ny, t1, t2, tm)
        work.rest[lane] = 0.0 if stuck | idle else 1.0
        rest = rest | (not (stuck | idle))
        if energy is not None:
            put_three(work.slipped, lane, (s1, s2, turn))
    return rest


@jit
def forces_of_tile(faces, pressed, strengths, bonds, t, tile, seen, work, energy_terms, dashpots, ledger):
    """Forces of the convex joints in their tile ``t``: what `resultant` makes wrenches of.

    ``pressed``, ``strengths`` and ``bonds`` are those of ``faces``, given apart so that their code goes where they are
    None; ``dashpots`` and ``ledger``: its records of ``energy_terms``, or all three None.
    """
    like = faces.like[t]
    face = faces.tiles[like]
    sheared = faces.sheared[t]
    used = faces.used[t]
    if strengths is not None:
        for lane in range(used):
            a = faces.lane[t, lane]
            bonded_face(faces, strengths, bonds, a, tile, seen, face, sheared, lane, work, dashpots, ledger)
        return
    rest = True
    if pressed is not None:
        for lane in range(used):
            work.rest[lane] = 1.0
    else:
        rest = stick(tile, seen, face, sheared, work, ledger)
        if rest:
            fetch_corners(faces, t, work)
            press(tile, face, work, ledger)
    if rest:
        for lane in range(used):
            if work.rest[lane] > 0.0:
                face_force(faces, pressed, faces.lane[t, lane], tile, seen, face, sheared, lane, work, ledger)
    if energy_terms is not None:
        add_work(energy_terms, t, dashpots, ledger, tile, face, work, rest, used)


@jit
def forces(links, faces, bodies, first, last, energy_terms, work):
    """Forces of the convex joints in their tiles ``first`` to ``last``; ``work`` is scratch;
    ``energy_terms`` may be None."""
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
        look(tile, seen, work)
        if energy_terms is None:
            forces_of_tile(faces, faces.pressed, faces.strengths, faces.bonds, t, tile, seen, work, None, None, None)
        if energy_terms is not None:
            forces_of_tile(
                faces, faces.pressed, faces.strengths, faces.bonds, t, tile, seen, work, energy_terms,
                energy_terms.dashpots[own], energy_terms.ledger[own],
            )  # fmt: skip
        resultant(tile, seen, work)
        deliver(work, links.wrenches, own)


@jit
def springs_of(bonds, faces, a, g0, gx, gy):
    """k_n times the integrals of <g>+, x <g>+ and y <g>+ over convex joint ``a``, of g itself where a bond holds; and
    the penetration g0 at O, with the rise by dilation. ``bonds`` is ``faces.bonds``."""
    outline = faces.outline[a]
    face = faces.tiles[faces.place[a] // W]
    lane = faces.place[a] % W
    k = face.k_n[lane]
    area = face.area[lane]
    second = three(face.second, lane)
    reach = face.reach[lane]
    if bonds is not None:
        g0 += bonds.rise[a]
        n, nx, ny, _ = area_springs(
            faces.x[outline], faces.y[outline], 0, faces.count[outline], area, second, reach,
            bonds.bonded[a], inf, g0, gx, gy,
        )  # fmt: skip
    else:
        n, nx, ny = spring_pressure(
            faces.x[outline], faces.y[outline], 0, faces.count[outline], area, second, reach, g0, gx, gy,
        )  # fmt: skip
    return k * n, k * nx, k * ny, g0


@jit
def spring_energy(links, faces, a, held):
    """Energy (J) in the springs of convex joint ``a``; writes their pressure and its moments into row ``a`` of
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
def mean_slip(faces, a):
    """Length of the slip path (m) of convex joint ``a``."""
    return faces.slip[a]
