"""Joint kinematics in SIMD tiles: relative position and motion of the two blocks, and joint wrenches.

A processor adds eight numbers as fast as one, if they lie side by side. So joints live in *tiles* of `W` lanes, a
joint a lane: a tile is a number of rows of `W` doubles, row after row, and number r of the joint in lane l is
``tile[r * W + l]``. A tile is one flat array and every loop over lanes is a function of its own that is not inlined:
then the compiler knows the distance of all rows, and makes such a loop a few wide instructions. What passes from one
loop to the next stands in ``work``, rows in the same way, one for each thread and small enough to stay in the cache.

The contact polygon rides on one block, the *host*; the *other* block offers the plane. The frame of the plane is
u1, u2 and m = u1 x u2, that of the polygon e1, e2 and e1 x e2, each a quaternion in the axes of its block. Both blocks'
quaternions give the turn of the one frame against the other, and with it the host's O and its two tangents in the
plane's axes: nine numbers, `SEEN`. A point (x, y) of the polygon is O + x e1 + y e2: its gap is linear in x and y
however far the blocks have turned. Slip and closing of a step are differences of what was seen, so they add up to the
total motion: nothing drifts, and a pair that moves as one rigid body sees nothing. Friction acts in the plane, at the
foot of the point that it belongs to: where a block rocks, that point (O of a convex joint) rises from the plane while
its toe stays.

Large scenes are bound by the memory, so what a step does not change stands apart from what it does, and tiles in which
it is the same to the last bit take it from one of them, which stays in the cache (`alike`): a regular wall has some
hundred kinds of tiles.
"""

from collections.abc import Iterable
from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy import ndarray

from dembrick._jit import entry, jit, prefetch
from dembrick.kernels.math.quaternion import axes_of, product
from dembrick.kernels.math.vec3 import cross

W = 16  # lanes of a tile
LINE = 64  # bytes of a line of the cache
NONE = 1e-140  # as good as zero, in a divisor

# Rows of a tile of `Links.tiles`, which no step changes: quaternions (w, x, y, z) of the plane's frame in the axes of
# the other block and of the polygon's in those of the host; arm of O from the host's centroid, along e1, e2 and e1 x e2
# (m); +1 if the other's outward normal is m, -1 if it is -m; distance of the plane from the other's centroid,
# along m (m); dashpot over spring force for the same increment, normal and shear
PLANE, TANGENTS, LEVER, SENSE, OFFSET, VISCOUS = 0, 4, 8, 11, 12, 13
ROWS = 15
TILE = ROWS * W

# Rows of a tile of `Links.seen_tiles`: O from the other's centroid, e1 and e2, in the plane's axes; outside of kernels
# they have the numbers from SEEN on, after those of `Links.tiles`
ORIGIN, FIRST, SECOND = 0, 3, 6
SEEN = ROWS
SEEN_TILE = 9 * W

# Wrenches stand lane after lane, since blocks gather them one by one: nine numbers each
ACTION = 9
WRENCHES = ACTION * W

# Rows of `work`: quaternions of the two blocks and centroid of the host from that of the other (m, world); the plane's
# frame in the world; arm of O from the host's centroid in the plane's axes (m); penetration at O and its slopes along
# e1 and e2, and what they grew by in the step; slip of the step along u1 and u2 at the foot of O, and its slopes along
# e1 and e2; turn of the step about m (rad); sums over the polygon of the force on the host in the plane's axes, and of
# x and y times it (N, N m); couple about m on top (N m); the wrench
OTHER, HOST, APART, FRAME, ARM, DEPTH, GROWTH, MOVED = 0, 4, 8, 11, 20, 23, 26, 29
TURN, FORCE, TWISTING, WRENCH = 35, 36, 45, 46
# and, for the points of a joint: dashpot along the normal, one plus that in shear, one over that; of the last two
# points the force in the sense in which the host slips, and along the normal (N), and the length that they slid by in
# the step (m); for the energy the sums over the points of what dashpots carry, as in FORCE, and of the last two points
# the elastic shear before the step and the force along the normal (N)
NORMAL, DAMPED, DAMPING, LAST, SLID, DASHPOT, BEFORE = 55, 56, 57, 58, 64, 66, 75
# and, of a convex joint, whether it slides, or is not wholly closed; integrals of what presses it, and of what presses
# its springs, with their x and y moments, over k_n (m3, m4); for the energy what dashpots carry in shear and torsion
# (N, N m), and slip and turn of the step, both in the axes of the polygon; x of its first vertices, then y (m)
REST, PRESSED, STILL, CARRIED, SLIPPED, CORNERS = 55, 56, 59, 62, 65, 68
FOUR = 4  # of them
WORK = 81 * W

# Rows of a contact point, that no step changes: where it is, along e1 and e2 from O (m); its tributary area (m2). Its
# memory, of which the slip path grows only where a point slides: elastic shear force in the sense in which the host
# slips, along u1 and u2 (N), and the length of its slip path (m)
X, Y, AREA = 0, 1, 2
POINT = 3 * W
SHEAR = 2 * W
ELASTIC, SLIP = 3, 5  # numbers of the rows of the memory outside of kernels, after those of a point


def rows_of_lanes(size: int, kind: type | np.dtype = float) -> ndarray:
    """Room (size,) for tiles, all zero, that begins where a line of the cache does: then no row lies across two."""
    room = np.zeros(size + LINE // 4, kind)
    first = -room.ctypes.data % LINE // room.itemsize
    return room[first : first + size]


def alike(tiles: Iterable[ndarray]) -> ndarray:
    """For each of t tiles the first one whose rows are the same to the last bit, (t,)."""
    first: dict[bytes, int] = {}
    return np.array([first.setdefault(tile.tobytes(), t) for t, tile in enumerate(tiles)], np.uint32)


def where_in(place: ndarray, size: int, first: int, count: int, joints=slice(None)) -> ndarray:
    """Where ``count`` rows of joints, from ``first`` on, are in tiles of that ``size``; ``place`` as in `Links`."""
    place = place[joints, None].astype(np.int64)
    return place // W * size + place % W + np.arange(first, first + count) * W


def set_apart(like: ndarray, tiles: ndarray) -> None:
    """Let each of the ``tiles`` (k,) stand for no other one in ``like`` (t,), see `alike`, before its rows change."""
    apart = np.unique(tiles)
    if len(apart) == len(like):
        like[:] = apart
        return
    for t in apart[np.bincount(like, minlength=len(like))[apart] != 1]:  # not those that stand for themselves alone
        rest = np.flatnonzero(like == t)
        rest = rest[rest != t]
        like[rest] = rest[:1]  # has the same rows
        like[t] = t


def rows_named(first: int, count: int, about: str) -> Any:
    """A property that reads so many rows of all joints out of tiles: (k, count), or (k,) if it is one."""

    def read(self) -> ndarray:
        found = self.rows(first, count)
        return found[:, 0] if count == 1 else found

    return property(read, doc=about)


class Links(NamedTuple):
    """j joints: which blocks, and where the polygon and the plane sit on them.

    A wrench holds the force on the host (3), its torque about the host's centroid (3) and that of the reaction about
    the other's centroid (3), world axes. What stands in tiles can be read joint by joint under the names below, as
    copies; `put` and `put_wrench` write it.
    """

    host: ndarray  # (j,) uint32
    other: ndarray  # (j,) uint32
    tangents: ndarray  # (j,) uint32, e1, e2 in the host's body axes: a row of `axes`
    plane: ndarray  # (j,) uint32, u1, u2 in the other's body axes: a row of `axes`
    axes: ndarray  # (k, 2, 3) pairs of directions in body axes, each once: blocks of a wall have few
    place: ndarray  # (j,) uint32, its lane: that of its tile, plus W times the tile
    tiles: ndarray  # (t * TILE,) see above
    like: ndarray  # (t,) uint32, the tile of ``tiles`` that the loop reads in place of each: see `alike`
    seen_tiles: ndarray  # (t * SEEN_TILE,) see above
    wrenches: ndarray  # (t * WRENCHES,) N, N m: see above, wrench after wrench in the order of ``place``
    ends: ndarray  # (t, 2, W) uint32, the other and the host of each lane, by their rows in the loop
    kept: ndarray  # (j, 4) O and e1 along u1 and u2, of `seen`, when the polygon was last cut to the other's face
    reach: ndarray  # (j,) float32, m, greatest distance of the polygon from O
    slack: ndarray  # (j,) float32, m, how far the polygon may move along the plane before it must be cut again
    glide: ndarray  # (j, 3) float32, a direction along u1 and u2 in which moves count only by the third number

    def rows(self, first: int, count: int, joints=slice(None)) -> ndarray:
        """A copy (k, count) of rows that stand in tiles; (count,) for a single joint."""
        array, where = self._where(first, count, joints)
        found = array[where]
        found.flags.writeable = False  # who writes into it means `put`
        return found

    def put(self, first: int, values, joints=slice(None)) -> None:
        """Write rows: values (k, count); (count,) for a single joint."""
        values = np.asarray(values, float)
        if first < SEEN:
            set_apart(self.like, self.place[joints] // W)
        array, where = self._where(first, values.shape[-1], joints)
        array[where] = values

    def share(self) -> None:
        """Let tiles that are the same to the last bit take their rows from one of them."""
        self.like[:] = alike(self.tiles.reshape(-1, TILE))

    def _where(self, first: int, count: int, joints) -> tuple[ndarray, ndarray]:
        """The array that has these rows, and where they are in it."""
        array, size, first = (self.tiles, TILE, first) if first < SEEN else (self.seen_tiles, SEEN_TILE, first - SEEN)
        return array, where_in(self.place, size, first, count, joints)

    @property
    def wrench(self) -> ndarray:
        """(j, 9) N, N m: see above."""
        found = self.wrenches.reshape(-1, ACTION)[self.place]
        found.flags.writeable = False
        return found

    def put_wrench(self, values, joints=slice(None)) -> None:
        """Write wrenches (k, 9)."""
        self.wrenches.reshape(-1, ACTION)[self.place[joints]] = values

    seen = rows_named(SEEN, 9, "(j, 9) O, e1, e2 of the host in the plane's axes, from the other's centroid")
    lever = rows_named(LEVER, 3, "(j, 3) m, from the host's centroid to O, along e1, e2 and e1 x e2")
    sense = rows_named(SENSE, 1, "(j,) +1 if the other's outward normal is m, -1 if it is -m")
    offset = rows_named(OFFSET, 1, "(j,) m, distance of the plane from the other's centroid, along m")
    viscous = rows_named(VISCOUS, 2, "(j, 2) dashpot over spring force for the same increment: normal, shear")


@jit
def three(rows, r, lane):
    """A vector that begins in row r."""
    return rows[r * W + lane], rows[(r + 1) * W + lane], rows[(r + 2) * W + lane]


@jit
def four(rows, r, lane):
    """A quaternion."""
    return rows[r * W + lane], rows[(r + 1) * W + lane], rows[(r + 2) * W + lane], rows[(r + 3) * W + lane]


@jit
def put_three(rows, r, lane, a):
    """Write a vector."""
    rows[r * W + lane] = a[0]
    rows[(r + 1) * W + lane] = a[1]
    rows[(r + 2) * W + lane] = a[2]


@jit
def dot(a, b):
    """a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@jit
def combined(a, f, r, s, t):
    """a[0] r + a[1] s + a[2] t, plus f."""
    return (
        f[0] + a[0] * r[0] + a[1] * s[0] + a[2] * t[0],
        f[1] + a[0] * r[1] + a[1] * s[1] + a[2] * t[1],
        f[2] + a[0] * r[2] + a[1] * s[2] + a[2] * t[2],
    )


@jit
def expect(array, begin, size, line=LINE // 8):
    """Have ``size`` numbers of an array, from number ``begin`` on, on their way into the cache; ``line``: how many are
    in a line of it.

    A tile is too short for the processor to see by itself what comes next.
    """
    for i in range(begin, begin + size, line):
        prefetch(array, i)


@jit
def fetch(links, t, bodies, work):
    """Bring the places of the blocks of the joints in tile ``t`` into ``work``."""
    q = bodies.orientation
    x = bodies.position
    ends = links.ends[t]
    for lane in range(W):
        other = ends[0, lane]
        host = ends[1, lane]
        work[lane] = q[other, 0]
        work[W + lane] = q[other, 1]
        work[2 * W + lane] = q[other, 2]
        work[3 * W + lane] = q[other, 3]
        work[4 * W + lane] = q[host, 0]
        work[5 * W + lane] = q[host, 1]
        work[6 * W + lane] = q[host, 2]
        work[7 * W + lane] = q[host, 3]
        work[8 * W + lane] = x[host, 0] - x[other, 0]
        work[9 * W + lane] = x[host, 1] - x[other, 1]
        work[10 * W + lane] = x[host, 2] - x[other, 2]


@entry
def look(tile, seen, work):
    """See where the hosts are now and what moved since the last step, when they were ``seen``."""
    for lane in range(W):
        p = product(*four(work, OTHER, lane), *four(tile, PLANE, lane))
        t = product(*four(work, HOST, lane), *four(tile, TANGENTS, lane))
        u, w, m = axes_of(p)
        e, g, n = axes_of(product(p[0], -p[1], -p[2], -p[3], *t))
        r = combined(three(tile, LEVER, lane), (0.0, 0.0, 0.0), e, g, n)
        d = three(work, APART, lane)
        o = (dot(d, u) + r[0], dot(d, w) + r[1], dot(d, m) + r[2])
        o1, o2, o3 = three(seen, ORIGIN, lane)
        e1, e2, e3 = three(seen, FIRST, lane)
        g1, g2, g3 = three(seen, SECOND, lane)
        sense = tile[SENSE * W + lane]
        offset = tile[OFFSET * W + lane]
        put_three(work, DEPTH, lane, (sense * (offset - o[2]), -sense * e[2], -sense * g[2]))
        put_three(work, GROWTH, lane, (sense * (o3 - o[2]), sense * (e3 - e[2]), sense * (g3 - g[2])))
        # the turn of the step, exact to its cube, and to the last bit zero if nothing turns
        x1 = e[0] - e1
        x2 = e[1] - e2
        x3 = e[2] - e3
        y1 = g[0] - g1
        y2 = g[1] - g2
        e1 += 0.5 * x1
        e2 += 0.5 * x2
        e3 += 0.5 * x3
        r1, r2, r3 = cross(e1, e2, e3, x1, x2, x3)
        about = dot((e1, e2, e3), cross(g1, g2, g3, y1, y2, g[2] - g3))  # r misses the turn about e1
        r1 += about * e1
        r2 += about * e2
        r3 += about * e3
        # feet that stand in the plane by its middle
        h = 0.5 * (o[2] + o3) - offset
        hy = 0.5 * (g[2] + g3)
        put_three(work, MOVED, lane, (o[0] - o1 - h * r2, o[1] - o2 + h * r1, x1 - e3 * r2))
        put_three(work, MOVED + 3, lane, (x2 + e3 * r1, y1 - hy * r2, y2 + hy * r1))
        work[TURN * W + lane] = r3
        put_three(work, FRAME, lane, u)
        put_three(work, FRAME + 3, lane, w)
        put_three(work, FRAME + 6, lane, m)
        put_three(work, ARM, lane, r)
        put_three(seen, ORIGIN, lane, o)
        put_three(seen, FIRST, lane, e)
        put_three(seen, SECOND, lane, g)


@entry
def resultant(tile, seen, work):
    """The wrenches of what `FORCE` and `TWISTING` hold, of which the parts along the plane act in it."""
    for lane in range(W):
        sense = tile[SENSE * W + lane]
        a1, a2, a3 = three(work, FORCE, lane)
        b1, b2, b3 = three(work, FORCE + 3, lane)
        c1, c2, c3 = three(work, FORCE + 6, lane)
        a3 *= sense
        b3 *= sense
        c3 *= sense
        e1, e2, _ = three(seen, FIRST, lane)
        g1, g2, _ = three(seen, SECOND, lane)
        height = seen[(ORIGIN + 2) * W + lane] - tile[OFFSET * W + lane]
        p1 = e2 * b3 + g2 * c3 + height * a2
        p2 = -(e1 * b3 + g1 * c3 + height * a1)
        p3 = e1 * b2 - e2 * b1 + g1 * c2 - g2 * c1 + work[TWISTING * W + lane]
        h1, h2, h3 = cross(*three(work, ARM, lane), a1, a2, a3)
        o1, o2, o3 = cross(*three(seen, ORIGIN, lane), a1, a2, a3)
        u = three(work, FRAME, lane)
        w = three(work, FRAME + 3, lane)
        m = three(work, FRAME + 6, lane)
        zero = (0.0, 0.0, 0.0)
        put_three(work, WRENCH, lane, combined((a1, a2, a3), zero, u, w, m))
        put_three(work, WRENCH + 3, lane, combined((p1 + h1, p2 + h2, p3 + h3), zero, u, w, m))
        put_three(work, WRENCH + 6, lane, combined((-p1 - o1, -p2 - o2, -p3 - o3), zero, u, w, m))


@jit
def deliver(work, wrenches, t):
    """Write the wrenches of tile ``t``."""
    rows = wrenches[t * WRENCHES : (t + 1) * WRENCHES]
    for lane in range(W):
        for i in range(ACTION):
            rows[lane * ACTION + i] = work[(WRENCH + i) * W + lane]


@jit
def wrench_at(links, j):
    """Where the wrench of joint ``j`` is in `Links.wrenches`."""
    first = links.place[j] * ACTION
    return slice(first, first + ACTION)


@jit
def lane_of(place, size):
    """Where the rows of a lane are in tiles of that ``size``, ``place`` as in `Links`: a kernel may not return them."""
    tile = place // W
    return slice(tile * size + place % W, (tile + 1) * size, W)


@jit
def seen_by(links, j):
    """Where `Links.seen` of joint ``j`` is in `Links.seen_tiles`."""
    return lane_of(links.place[j], SEEN_TILE)


@jit
def sense_of(links, j):
    """`Links.sense` of joint ``j``."""
    return links.tiles[lane_of(links.place[j], TILE)][SENSE]


@jit
def offset_of(links, j):
    """`Links.offset` of joint ``j``."""
    return links.tiles[lane_of(links.place[j], TILE)][OFFSET]


@jit
def least_slack(links):
    """How much farther a polygon may move along its plane before one must be cut again (m); zero or less: now."""
    least = 1e300
    for j in range(links.host.size):
        kept = links.kept[j]
        seen = links.seen_tiles[seen_by(links, j)]
        p1 = seen[0] - kept[0]
        p2 = seen[1] - kept[1]
        e1 = seen[3] - kept[2]
        e2 = seen[4] - kept[3]
        f1 = float(links.glide[j, 0])
        f2 = float(links.glide[j, 1])
        along = float(links.glide[j, 2]) * (p1 * f1 + p2 * f2)
        across = p2 * f1 - p1 * f2
        reach, slack = float(links.reach[j]), float(links.slack[j])  # double precision in plain Python as well
        moved = sqrt(along * along + across * across) + reach * sqrt(e1 * e1 + e2 * e2)
        least = min(least, slack - moved)
    return least
