"""The energy books of a run in real time: every term is evaluated or summed on its own, none is what is left over.

Central differences balance exactly in this form: with the kinetic energy v(-1/2) M v(+1/2) / 2 at the moment of the
forces, its change over a step is the work of all forces by the trapezoidal rule over the step's motion. So the books
are those of the last forces, a step before the blocks' present places. Over a step in which the slip and the closing
of a contact grow by s, a spring takes (e + e') s / 2 and a dashpot (d + d') s / 2; what slides by q loses
(e + e') q / 2. A normal spring that opens or closes within a step works by that rule a little more, or less, than it
holds: (<g>+ g' - <g'>+ g) k / 2, of the order of the square of the step. That is an error of the step and no friction;
it has its own term.
"""

from typing import NamedTuple

from numpy import ndarray

from dembrick._jit import entry, jit
from dembrick.kernels.dynamics.rigid_bodies import gathered
from dembrick.kernels.dynamics.tiles import (
    AREA,
    BEFORE,
    DEPTH,
    ELASTIC,
    GROWTH,
    MOVED,
    POINT,
    SEEN,
    TILE,
    W,
    X,
    Y,
    lane_of,
    offset_of,
    sense_of,
    three,
)
from dembrick.kernels.joint.area_law import spring_pressure
from dembrick.kernels.joint.point_law import shear_loss
from dembrick.kernels.math.vec3 import cross, rows_times

FRICTION, RELEASED, STEPPING, BY_LAW = range(4)
LOADS, CONTACTS, HANDED = range(3)

DASHPOT = 3 * W  # rows of a point in `Books.dashpots`

# Rows of a tile of `Books.ledger`, J: what dashpots took; the smallest friction work of a step; what was lost, see
# `Books.lost` (4). All since `share` changed
OF_DASHPOTS, SMALLEST, GONE = 0, 1, 2
LEDGER = 6 * W


class Books(NamedTuple):
    """What is booked, J; and what the last step left behind. None where nobody asks for it.

    Shear and torsion are in the sense in which the host slips; axes are those of the joint's elastic forces.
    """

    dashpots: ndarray  # N, their last forces at every point: shear in the sense in which the host slips (2), and N;
    # three rows of every point of a tile, as in `Corners.points`
    ledger: ndarray  # (t * LEDGER,) the books of the point joints, in tiles like theirs
    face: ndarray  # (a, 16) N, N m, J, those of the convex joints, one row because every step reads and writes it all.
    # Springs (3): N and its x and y moments. Dashpots: V_1, V_2, M_T (6 to 8), what opening and closing within steps
    # took (9), N and its moments (12 to 14). What dashpots took (15). All that was taken is since `share` changed
    damped: ndarray  # (j,) what dashpots took until then
    lost: ndarray  # (j, 4) friction; springs let go; opening and closing within a step; friction by its law
    least: ndarray  # (j,) the smallest friction work of a step
    share: ndarray  # (j,) what new contacts leave to the joint
    place: ndarray  # (j,) int64, its number among the point joints; of a convex joint -1 less its number
    fallen: ndarray  # (n,) work of gravity, and of what shaking puts in its place
    load: ndarray  # (k, 6) N, N m, the loads
    push: ndarray  # (n, 6) N, N m, of all new contacts on each block
    total: ndarray  # (3,) work of loads, work of new contacts, what springs held whose joints were handed over
    gravity: ndarray  # (3,) m/s2
    begun: ndarray  # (1,) 1 from the first forces on, which are where the books begin


@entry
def book_losses(work, own, dashpots, which, k_n, k_s, friction, arm, ledger):
    """Book what one point of every joint of a tile lost in a step, ``which`` of the two of `point_joints.press`: in
    friction, or let go where the point has opened."""
    for lane in range(W):
        at = which * POINT + lane
        x = own[X * W + at]
        y = own[Y * W + at]
        area = own[AREA * W + at]
        e1 = own[ELASTIC * W + at]
        e2 = own[(ELASTIC + 1) * W + at]
        g0, gx, gy = three(work, DEPTH, lane)
        d0, dx, dy = three(work, GROWTH, lane)
        p1, p2, x1 = three(work, MOVED, lane)
        x2, y1, y2 = three(work, MOVED + 3, lane)
        b1, b2, slid = three(work, BEFORE + 3 * which, lane)
        s1 = p1 + arm * (x * x1 + y * y1)
        s2 = p2 + arm * (x * x2 + y * y2)
        lost = shear_loss(b1, b2, e1, e2, s1, s2, k_s * area)
        held = lost if slid > 0.0 else 0.0
        least = ledger[SMALLEST * W + lane]
        ledger[SMALLEST * W + lane] = held if held < least else least
        g = g0 + x * gx + y * gy
        normal = dashpots[(which * 3 + 2) * W + lane] + k_n * area * max(g, 0.0)
        let_go = lost if slid == 0.0 and e1 == 0.0 and e2 == 0.0 and area > 0.0 else 0.0
        before = g - (d0 + x * dx + y * dy)
        stepping = min(g, 0.0) * max(before, 0.0) - max(g, 0.0) * min(before, 0.0)
        ledger[(GONE + FRICTION) * W + lane] += held
        ledger[(GONE + RELEASED) * W + lane] += let_go
        ledger[(GONE + STEPPING) * W + lane] += 0.5 * k_n * area * stepping
        ledger[(GONE + BY_LAW) * W + lane] += friction * normal * slid


@jit
def settle(books, links, j):
    """Put what a joint lost into its own books; what follows may have another share."""
    share = books.share[j]
    place = books.place[j]
    if place < 0:
        row = books.face[-1 - place]
        books.damped[j] += share * row[15]
        row[15] = 0.0
        books.lost[j, STEPPING] += share * row[9]
        row[9] = 0.0
    else:
        begin = links.place[j] // TILE * LEDGER + links.place[j] % W
        row = books.ledger[begin : begin + LEDGER - W + 1 : W]
        books.damped[j] += share * row[OF_DASHPOTS]
        row[OF_DASHPOTS] = 0.0
        books.least[j] = min(books.least[j], share * row[SMALLEST])
        row[SMALLEST] = 0.0
        for i in range(4):
            books.lost[j, i] += share * row[GONE + i]
            row[GONE + i] = 0.0


@entry
def settle_all(books, links):
    """`settle` for all joints."""
    for j in range(books.share.size):
        settle(books, links, j)


@jit
def springs_of(faces, a, g0, gx, gy):
    """k_n times the integrals of <g>+, x <g>+ and y <g>+ over convex joint ``a``."""
    outline = faces.outline[a]
    n, nx, ny = spring_pressure(
        faces.x[outline], faces.y[outline], 0, faces.count[outline], faces.area[a], faces.second[a], faces.reach[a], g0,
        gx, gy,
    )  # fmt: skip
    k = faces.k_n[a]
    return k * n, k * nx, k * ny


@jit
def book_pressure(row, q0, qx, qy, n, nx, ny, g0, gx, gy, d0, dx, dy):
    """Dashpots along the normal of a convex joint with the ``row`` (16,): pressure of the springs q, of all n; its
    penetration g and the growth of it d."""
    stepping = row[0] * g0 + row[1] * gx + row[2] * gy - (q0 * (g0 - d0) + qx * (gx - dx) + qy * (gy - dy))
    n -= q0
    nx -= qx
    ny -= qy
    row[15] += 0.5 * ((row[12] + n) * d0 + (row[13] + nx) * dx + (row[14] + ny) * dy)
    row[0] = q0
    row[1] = qx
    row[2] = qy
    row[12] = n
    row[13] = nx
    row[14] = ny
    row[9] += 0.5 * stepping


@jit
def book_shear(row, e, s1, s2, turn, t1, t2, tm):
    """Its dashpots in shear and torsion: slip s and turn, friction t, elastic forces e (3,)."""
    t1 -= e[0]
    t2 -= e[1]
    tm -= e[2]
    row[15] += 0.5 * ((row[6] + t1) * s1 + (row[7] + t2) * s2 + (row[8] + tm) * turn)
    row[6] = t1
    row[7] = t2
    row[8] = tm


@jit
def book_slip(books, faces, a, normal, q1, q2, qm, t1, t2, tm, b1, b2, bm):
    """A step in which convex joint ``a`` slides by the plastic twist q, or in which it is open and lets go; it held b
    before."""
    j = faces.joint[a]
    e = faces.elastic[a]
    share = books.share[j]
    loss = 0.5 * share * ((b1 + e[0]) * q1 + (b2 + e[1]) * q2 + (bm + e[2]) * qm)
    if normal > 0.0:
        books.lost[j, FRICTION] += loss
        books.lost[j, BY_LAW] += share * (t1 * q1 + t2 * q2 + tm * qm)
        books.least[j] = min(books.least[j], loss)
    else:
        books.lost[j, RELEASED] += loss


@jit
def corner_stock(links, corners, p):
    """Energy (J) in the springs of point joint ``p``."""
    j = corners.joint[p]
    seen = links.tiles[lane_of(links, j, SEEN, 9)]
    sense = sense_of(links, j)
    offset = offset_of(links, j)
    law = corners.law[p]
    twice = 0.0
    for i in range(corners.start[p + 1] - corners.start[p]):
        begin = corners.place[p] + i * POINT
        point = corners.points[begin : begin + POINT : W]
        e1 = point[ELASTIC]
        e2 = point[ELASTIC + 1]
        g = sense * (offset - seen[2] - point[X] * seen[5] - point[Y] * seen[8])
        if g > 0.0:
            twice += corners.k_n[law] * point[AREA] * g * g
        if point[AREA] > 0.0:
            twice += (e1 * e1 + e2 * e2) / (corners.k_s[law] * point[AREA])
    return 0.5 * twice


@jit
def face_stock(links, faces, a, held):
    """Energy (J) in the springs of convex joint ``a``; writes their pressure and its moments into the first three of
    ``held``."""
    j = faces.joint[a]
    seen = links.tiles[lane_of(links, j, SEEN, 9)]
    sense = sense_of(links, j)
    g0 = sense * (offset_of(links, j) - seen[2])
    gx = -sense * seen[5]
    gy = -sense * seen[8]
    held[0], held[1], held[2] = springs_of(faces, a, g0, gx, gy)
    e = faces.elastic[a]
    k = faces.k_s[a]
    sheared = (e[0] * e[0] + e[1] * e[1]) / (k * faces.area[a])
    sheared += e[2] * e[2] / (k * (faces.second[a, 0] + faces.second[a, 1]))
    return 0.5 * (held[0] * g0 + held[1] * gx + held[2] * gy + sheared)


@entry
def take_stock(links, corners, faces, held_out, energy_out):
    """Energy (j,) J in the springs of every joint; of convex joints also N and its x and y moments (j, 3)."""
    if corners is not None:
        for p in range(corners.joint.size):
            energy_out[corners.joint[p]] = corner_stock(links, corners, p)
    if faces is not None:
        for a in range(faces.joint.size):
            j = faces.joint[a]
            energy_out[j] = face_stock(links, faces, a, held_out[j])


@entry
def kinetic_energy(bodies, wrench, g1, g2, g3, dt):
    """v(-1/2) M v(+1/2) / 2 of all free blocks (J), after the step; ``wrench`` and loads are those that it was made of,
    g its gravity."""
    twice = 0.0
    for f in range(bodies.free.size):
        b = bodies.free[f]
        mass = bodies.mass[b]
        f1, f2, f3, t1, t2, t3 = gathered(bodies, b, wrench, g1, g2, g3)
        v = bodies.velocity[b]
        w = bodies.spin[b]
        L = bodies.momentum[b]
        twice += v[0] * (mass * v[0] - dt * f1) + v[1] * (mass * v[1] - dt * f2) + v[2] * (mass * v[2] - dt * f3)
        twice += w[0] * (L[0] - dt * t1) + w[1] * (L[1] - dt * t2) + w[2] * (L[2] - dt * t3)
    return 0.5 * twice


@jit
def power(bodies, b, force):
    """Power (W) of a force and a couple (6,) at the centroid of block ``b``."""
    v = bodies.velocity[b]
    w = bodies.spin[b]
    return force[0] * v[0] + force[1] * v[1] + force[2] * v[2] + force[3] * w[0] + force[4] * w[1] + force[5] * w[2]


@jit
def book_loads(books, bodies, loads, step, dt):
    """Work of the loads over the step that led here."""
    total = 0.0
    for k in range(loads.block.size):
        b = loads.block[k]
        f = loads.force[step, k]
        last = books.load[k]
        total += power(bodies, b, last)
        r1, r2, r3 = rows_times(bodies.rotation[b], loads.lever[k, 0], loads.lever[k, 1], loads.lever[k, 2])
        last[0] = f[0]
        last[1] = f[1]
        last[2] = f[2]
        last[3], last[4], last[5] = cross(r1, r2, r3, f[0], f[1], f[2])
        total += power(bodies, b, last)
    books.total[LOADS] += 0.5 * dt * total


@jit
def book_contacts(books, bodies, touching, dt):
    """Work of the new contacts on the blocks over the step that led here."""
    total = 0.0
    push = books.push
    for b in range(push.shape[0]):
        total += power(bodies, b, push[b])
        for i in range(6):
            push[b, i] = 0.0
    for t in range(touching.first.size):
        f = touching.force[t]
        m = touching.torque[t]
        c = touching.point[t]
        for side in range(2):
            part = touching.second[t] if side else touching.first[t]
            sense = 1.0 if side else -1.0
            b = touching.parts.owner[part]
            x = bodies.position[b]
            t1, t2, t3 = cross(c[0] - x[0], c[1] - x[1], c[2] - x[2], f[0], f[1], f[2])
            on = push[b]
            on[0] += sense * f[0]
            on[1] += sense * f[1]
            on[2] += sense * f[2]
            on[3] += sense * (t1 + m[0])
            on[4] += sense * (t2 + m[1])
            on[5] += sense * (t3 + m[2])
    for b in range(push.shape[0]):
        total += power(bodies, b, push[b])
    books.total[CONTACTS] += 0.5 * dt * total


@jit
def book_handing_over(books, links, corners, faces, touching):
    """What the springs of joints held of which new contacts took over more."""
    for t in range(touching.first.size):
        j = touching.joint[t]
        if j >= 0:
            share = 1.0 - touching.weight[t]
            if share != books.share[j]:
                settle(books, links, j)
                place = books.place[j]
                energy = 0.0
                if corners is not None:
                    if place >= 0:
                        energy = corner_stock(links, corners, place)
                if faces is not None:
                    if place < 0:
                        energy = face_stock(links, faces, -1 - place, books.face[-1 - place])
                books.total[HANDED] += (books.share[j] - share) * energy
                books.share[j] = share


@jit
def book_step(books, bodies, links, corners, faces, loads, touching, step, dt):
    """Book what is not a joint's, after the forces of a step and before the blocks move.

    Returns what gravity's work over the step that led here is to the momentum of a block: dt times its mean (3).
    """
    book_loads(books, bodies, loads, step, dt)
    if touching is not None:
        book_contacts(books, bodies, touching, dt)
        book_handing_over(books, links, corners, faces, touching)
    g = loads.gravity[step]
    last = books.gravity
    half = 0.5 * dt
    if books.begun[0] == 0.0:  # there was no step before, and nothing that was booked counts
        books.begun[0] = 1.0
        half = 0.0
        settle_all(books, links)
        for i in range(books.total.size):
            books.total[i] = 0.0
        for b in range(books.fallen.size):
            books.fallen[b] = 0.0
        for j in range(books.damped.size):
            books.damped[j] = 0.0
            books.least[j] = 0.0
            for i in range(books.lost.shape[1]):
                books.lost[j, i] = 0.0
    m1 = half * (g[0] + last[0])
    m2 = half * (g[1] + last[1])
    m3 = half * (g[2] + last[2])
    for i in range(3):
        last[i] = g[i]
    return m1, m2, m3
