"""Joint kinematics in SIMD tiles: relative position and motion of the two blocks, and joint wrenches.

A processor adds eight numbers as fast as one, if they lie side by side. So joints are stored in *tiles* of `W` lanes, a
joint a lane. A tile is a record (`record`) each of whose fields is a number of rows of `W` lanes: ``tile.offset[lane]``
is one number of the joint in that lane, ``tile.lever[i, lane]`` one of a vector. The offsets of rows are part of the
type of the record, and every loop over lanes is a function of its own that is not inlined: so the compiler turns such a
loop into a few wide instructions. Data pass from one loop to the next in ``work``, a record of the same kind, one for
each thread and small enough to stay in the cache.

The contact polygon moves with one block, the *host*; the *other* block provides the plane. The frame of the plane is
u1, u2 and m = u1 x u2, that of the polygon e1, e2 and e1 x e2, each a quaternion in the axes of its block. Both blocks'
quaternions give the rotation of one frame against the other, and with it the host's O and its two tangents in the
plane's axes: nine numbers, `SEEN`. A point (x, y) of the polygon is O + x e1 + y e2: its gap is linear in x and y
however far the blocks have turned. Slip and closing of a step are differences of these numbers, so they add up to the
total motion: nothing drifts, and a pair that moves as one rigid body has neither. Friction acts in the plane, at the
foot of its point: when a block rocks, that point (O of a convex joint) rises from the plane while the toe stays.

The speed of large scenes is limited by the memory. So constants are stored apart from what a step changes, and tiles
with the same constants, to the last bit, share those of one of them, which stays in the cache (`alike`).
"""

from collections.abc import Iterable
from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy import ndarray

from dembrick._jit import entry, jit, prefetch
from dembrick.kernels.math.vectors import axes_of, cross, product

W = 16  # lanes of a tile
LINE = 64  # bytes of a line of the cache
ROW = 8 * W  # bytes of a row
NONE = 1e-140  # least divisor, in place of zero


def record(*fields: tuple[str, int | tuple[int, ...]], kind: type = float) -> np.dtype:
    """The type of a record of rows of `W` lanes; each field is a name and a number of rows, or their shape; 1 is a
    single row (W,)."""
    shapes = ((name, rows if isinstance(rows, tuple) else (rows,) if rows > 1 else ()) for name, rows in fields)
    own = np.dtype([(name, kind, (*shape, W)) for name, shape in shapes], align=True)
    return np.dtype((np.record, own))  # whose fields are attributes in plain Python too


# Constants of the joints of a tile
FIXED = record(
    ("plane", 4),  # quaternion (w, x, y, z) of the plane's frame in the axes of the other block
    ("tangents", 4),  # the same of the polygon's frame in those of the host
    ("lever", 3),  # m, arm of O from the host's centroid, along e1, e2 and e1 x e2
    ("sense", 1),  # +1 if the other's outward normal is m, -1 if it is -m
    ("offset", 1),  # m, distance of the plane from the other's centroid, along m
    ("viscous", 2),  # dashpot over spring force for the same increment: normal, shear
)

# Position of the hosts: O from the other's centroid (m), e1 and e2, in the plane's axes
SEEN = record(("origin", 3), ("first", 3), ("second", 3))

# Wrenches are stored lane after lane, since blocks read them one by one: nine numbers each
ACTION = 9
WRENCHES = ACTION * W

FOUR = 4  # vertices of polygons that are evaluated for all joints of a tile at once

# Scratch, see above
WORK = record(
    ("other", 4),  # quaternions of the two blocks
    ("host", 4),
    ("apart", 3),  # m, world, centroid of the host from that of the other
    ("u1", 3),  # the plane's frame in the world
    ("u2", 3),
    ("m", 3),
    ("arm", 3),  # m, of O from the host's centroid, in the plane's axes
    ("depth", 3),  # m, penetration at O, and its slopes along e1 and e2
    ("growth", 3),  # their growth in the step
    ("slip", 2),  # m, slip of the step along u1 and u2 at the foot of O
    ("slip_x", 2),  # and its slopes along e1
    ("slip_y", 2),  # and e2
    ("turn", 1),  # rad, rotation of the step about m
    ("force", 3),  # N, sums over the polygon of the force on the host in the plane's axes
    ("x_force", 3),  # N m, and of x and y times it
    ("y_force", 3),
    ("twisting", 1),  # N m, additional couple about m
    ("wrench", (3, 3)),  # N, N m, see `Links`
    ("undamped", 1),  # 1 where no dashpot acts: `law_memory`
    ("searching", 1),  # 1 where laws store nothing of a step
    ("keeping", 1),  # 1 where joints that open on a swing keep their shear
    ("normal", 1),  # of joints that act at points: dashpot along the normal
    ("damped", 1),  # one plus that in shear
    ("damping", 1),  # one over that
    ("last", (2, 3)),  # N, of the last two points: shear in the sense in which the host slips, and normal force
    ("slid", 2),  # m, length of their slip in the step
    ("weight", 2),  # N, of each of them in the mean of the slip, see `slip_paths`
    ("rubbed", 1),  # N m, sum over the points of their weight times their slip
    ("carrying", 1),  # N, and of their weight, if they are not dry
    ("dashpot", 3),  # N, N m, for the energy: sums over the points of dashpot forces
    ("x_dashpot", 3),
    ("y_dashpot", 3),
    ("before", (2, 3)),  # N, of the last two points: elastic shear before the step, and normal force
    # of convex joints
    ("rest", 1),  # whether it slides, or is not wholly closed
    ("pressed", 3),  # m3, m4, integrals of its pressure, with their x and y moments, over k_n
    ("still", 3),  # the same of the pressure on its springs
    ("carried", 3),  # N, N m, for the energy: dashpot forces in shear and torsion, in the polygon's axes
    ("slipped", 3),  # m, rad, slip and rotation of the step, likewise
    ("corner_x", FOUR),  # m, its first vertices
    ("corner_y", FOUR),
    # of blocks, see `rigid_bodies`
    ("orientation", 4),
    ("momentum", 3),
    ("inverse", 6),  # inverse of the inertia, its six parts
    ("turned", 4),  # orientation a step later
    ("spin", 3),
    ("angle2", 1),  # square of the angle of rotation
)

# Constants of contact points: position along e1 and e2 from O (m); tributary area (m2)
POINT = record(("x", 1), ("y", 1), ("area", 1))
# Their memory: elastic shear force in the sense in which the host slips, along u1 and u2 (N)
SHEAR = record(("elastic", 2))


def rows_of_lanes(size: int, kind: type | np.dtype = float) -> ndarray:
    """Room (size,) for tiles or for numbers of them, all zero, aligned with the lines of the cache, so that no row lies
    across two."""
    kind = np.dtype(kind)
    room = np.zeros(size * kind.itemsize + LINE, np.uint8)
    first = -room.ctypes.data % LINE
    return room[first : first + size * kind.itemsize].view(kind)


def alike(tiles: Iterable[ndarray]) -> ndarray:
    """For each of t tiles the first one whose rows are the same to the last bit, (t,)."""
    first: dict[bytes, int] = {}
    return np.array([first.setdefault(tile.tobytes(), t) for t, tile in enumerate(tiles)], np.uint32)


def in_lanes(tiles: ndarray, field: str, place: ndarray) -> ndarray:
    """A copy of one field of the joints at ``place`` (k,), as in `Links`: (k, rows), or (k,) if it is one row."""
    place = np.asarray(place, np.int64)
    found = tiles[field][place // W, ..., place % W].copy()  # for a single joint it would be a view of the lane
    found.flags.writeable = False  # to write, use `put_in_lanes`
    return found


def put_in_lanes(tiles: ndarray, field: str, place: ndarray, values) -> None:
    """Write one field of the joints at ``place`` (k,): values (k, rows), or (k,)."""
    place = np.asarray(place, np.int64)
    tiles[field][place // W, ..., place % W] = values


def set_apart(like: ndarray, tiles: ndarray) -> None:
    """Make each of the ``tiles`` (k,) represent no other one in ``like`` (t,), see `alike`, before its rows change."""
    apart = np.unique(tiles)
    if len(apart) == len(like):
        like[:] = apart
        return
    for t in apart[np.bincount(like, minlength=len(like))[apart] != 1]:  # not those that represent only themselves
        rest = np.flatnonzero(like == t)
        rest = rest[rest != t]
        like[rest] = rest[:1]  # has the same rows
        like[t] = t


def of_joints(field: str, about: str) -> Any:
    """A property that reads a field of all joints out of their tiles: (k, rows), or (k,) if it is one row."""
    return property(lambda self: in_lanes(self.tiles, field, self.place), doc=about)


class Links(NamedTuple):
    """j joints: their blocks, and the positions of the polygon and the plane on them.

    A wrench holds the force on the host (3), its torque about the host's centroid (3) and that of the reaction about
    the other's centroid (3), world axes. Data of tiles can be read joint by joint under the names below, as copies;
    `put` and `put_wrench` write them.
    """

    host: ndarray  # (j,) uint32
    other: ndarray  # (j,) uint32
    tangents: ndarray  # (j,) uint32, e1, e2 in the host's body axes: a row of `axes`
    plane: ndarray  # (j,) uint32, u1, u2 in the other's body axes: a row of `axes`
    axes: ndarray  # (k, 2, 3) pairs of directions in body axes, each stored once: blocks of a wall have few
    place: ndarray  # (j,) uint32, its lane: that of its tile, plus W times the tile
    tiles: ndarray  # (t,) records `FIXED`
    like: ndarray  # (t,) uint32, the tile of ``tiles`` that the loop reads in place of each: see `alike`
    seen_tiles: ndarray  # (t,) records `SEEN`
    wrenches: ndarray  # (t * WRENCHES,) N, N m: see above, wrench after wrench in the order of ``place``
    ends: ndarray  # (t, 2, W) uint32, the other and the host of each lane, by their rows in the loop
    kept: ndarray  # (j, 4) O and e1 along u1 and u2, of `seen`, when the polygon was last cut to the other's face
    reach: ndarray  # (j,) float32, m, greatest distance of the polygon from O
    slack: ndarray  # (j,) float32, m, how far the polygon may move along the plane before it must be cut again
    glide: ndarray  # (j, 3) float32, a direction along u1 and u2; motion along it counts times the third number

    def field(self, name: str, joints=slice(None)) -> ndarray:
        """A copy of a field of `FIXED` or `SEEN`, (k, rows) or (k,) if it is one row; of a single joint (rows,)."""
        tiles = self.tiles if name in (FIXED.names or ()) else self.seen_tiles
        return in_lanes(tiles, name, self.place[joints])

    def put(self, field: str, values, joints=slice(None)) -> None:
        """Write a field of `FIXED`: values (k, rows), or (k,) if it is one row."""
        set_apart(self.like, self.place[joints] // W)
        put_in_lanes(self.tiles, field, self.place[joints], np.asarray(values, float))

    def put_seen(self, values) -> None:
        """Write `seen`: values (j, 9)."""
        vectors = np.moveaxis(np.reshape(values, (-1, 3, 3)), 1, 0)
        for field, vector in zip(SEEN.names or (), vectors, strict=True):
            put_in_lanes(self.seen_tiles, field, self.place, vector)

    def share(self) -> None:
        """Let tiles that are the same to the last bit share the rows of one of them."""
        self.like[:] = alike(self.tiles)

    def seen_of(self, joints=slice(None)) -> ndarray:
        """O, e1 and e2 of the hosts of some joints in the plane's axes, from the other's centroid: (k, 9) or (9,)."""
        found = np.concatenate([self.field(name, joints) for name in SEEN.names or ()], axis=-1)
        found.flags.writeable = False  # to write, use `put_seen`
        return found

    seen = property(seen_of, doc="(j, 9), `seen_of` all joints")

    @property
    def wrench(self) -> ndarray:
        """(j, 9) N, N m: see above."""
        found = self.wrenches.reshape(-1, ACTION)[self.place]
        found.flags.writeable = False
        return found

    def put_wrench(self, values, joints=slice(None)) -> None:
        """Write wrenches (k, 9)."""
        self.wrenches.reshape(-1, ACTION)[self.place[joints]] = values

    lever = of_joints("lever", "(j, 3) m, from the host's centroid to O, along e1, e2 and e1 x e2")
    sense = of_joints("sense", "(j,) +1 if the other's outward normal is m, -1 if it is -m")
    offset = of_joints("offset", "(j,) m, distance of the plane from the other's centroid, along m")
    viscous = of_joints("viscous", "(j, 2) dashpot over spring force for the same increment: normal, shear")


@jit
def two(rows, lane):
    """A pair of numbers."""
    return rows[0, lane], rows[1, lane]


@jit
def three(rows, lane):
    """A vector."""
    return rows[0, lane], rows[1, lane], rows[2, lane]


@jit
def four(rows, lane):
    """A quaternion."""
    return rows[0, lane], rows[1, lane], rows[2, lane], rows[3, lane]


@jit
def put_two(rows, lane, a):
    """Write a pair of numbers."""
    rows[0, lane] = a[0]
    rows[1, lane] = a[1]


@jit
def put_three(rows, lane, a):
    """Write a vector."""
    rows[0, lane] = a[0]
    rows[1, lane] = a[1]
    rows[2, lane] = a[2]


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
def expect_part(tiles, t, begin, size):
    """Prefetch ``size`` bytes of an array, from byte ``begin`` of number ``t`` on, into the cache.

    A tile is too short for the processor to predict by itself what comes next.
    """
    for byte in range(begin, begin + size, LINE):
        prefetch(tiles, t, byte)


@jit
def expect(tiles, t):
    """`expect_part` for the whole of record ``t``."""
    expect_part(tiles, t, 0, tiles.itemsize)


@jit
def fetch(links, t, bodies, work):
    """Copy the positions of the blocks of the joints in tile ``t`` into ``work``."""
    q = bodies.orientation
    x = bodies.position
    ends = links.ends[t]
    for lane in range(W):
        other = ends[0, lane]
        host = ends[1, lane]
        for i in range(4):
            work.other[i, lane] = q[other, i]
        for i in range(4):
            work.host[i, lane] = q[host, i]
        for i in range(3):
            work.apart[i, lane] = x[host, i] - x[other, i]


@entry
def update_kinematics(tile, seen, work):
    """Update the position of the hosts, ``seen``, and compute penetration and slip, and their change in the step."""
    for lane in range(W):
        p = product(*four(work.other, lane), *four(tile.plane, lane))
        t = product(*four(work.host, lane), *four(tile.tangents, lane))
        u, w, m = axes_of(p)
        e, g, n = axes_of(product(p[0], -p[1], -p[2], -p[3], *t))
        r = combined(three(tile.lever, lane), (0.0, 0.0, 0.0), e, g, n)
        d = three(work.apart, lane)
        o = (dot(d, u) + r[0], dot(d, w) + r[1], dot(d, m) + r[2])
        o1, o2, o3 = three(seen.origin, lane)
        e1, e2, e3 = three(seen.first, lane)
        g1, g2, g3 = three(seen.second, lane)
        sense = tile.sense[lane]
        offset = tile.offset[lane]
        put_three(work.depth, lane, (sense * (offset - o[2]), -sense * e[2], -sense * g[2]))
        put_three(work.growth, lane, (sense * (o3 - o[2]), sense * (e3 - e[2]), sense * (g3 - g[2])))
        # the rotation of the step, exact to its cube, and exactly zero if nothing turns
        x1 = e[0] - e1
        x2 = e[1] - e2
        x3 = e[2] - e3
        y1 = g[0] - g1
        y2 = g[1] - g2
        e1 += 0.5 * x1
        e2 += 0.5 * x2
        e3 += 0.5 * x3
        r1, r2, r3 = cross(e1, e2, e3, x1, x2, x3)
        about = dot((e1, e2, e3), cross(g1, g2, g3, y1, y2, g[2] - g3))  # r lacks the rotation about e1
        r1 += about * e1
        r2 += about * e2
        r3 += about * e3
        # feet in the plane at the middle of the step
        h = 0.5 * (o[2] + o3) - offset
        hy = 0.5 * (g[2] + g3)
        put_two(work.slip, lane, (o[0] - o1 - h * r2, o[1] - o2 + h * r1))
        put_two(work.slip_x, lane, (x1 - e3 * r2, x2 + e3 * r1))
        put_two(work.slip_y, lane, (y1 - hy * r2, y2 + hy * r1))
        work.turn[lane] = r3
        put_three(work.u1, lane, u)
        put_three(work.u2, lane, w)
        put_three(work.m, lane, m)
        put_three(work.arm, lane, r)
        put_three(seen.origin, lane, o)
        put_three(seen.first, lane, e)
        put_three(seen.second, lane, g)


@entry
def resultant(tile, seen, work):
    """The wrenches of the sums of force and of the couple about m; forces along the plane act in it."""
    for lane in range(W):
        sense = tile.sense[lane]
        a1, a2, a3 = three(work.force, lane)
        b1, b2, b3 = three(work.x_force, lane)
        c1, c2, c3 = three(work.y_force, lane)
        a3 *= sense
        b3 *= sense
        c3 *= sense
        e1, e2, _ = three(seen.first, lane)
        g1, g2, _ = three(seen.second, lane)
        height = seen.origin[2, lane] - tile.offset[lane]
        p1 = e2 * b3 + g2 * c3 + height * a2
        p2 = -(e1 * b3 + g1 * c3 + height * a1)
        p3 = e1 * b2 - e2 * b1 + g1 * c2 - g2 * c1 + work.twisting[lane]
        h1, h2, h3 = cross(*three(work.arm, lane), a1, a2, a3)
        o1, o2, o3 = cross(*three(seen.origin, lane), a1, a2, a3)
        u = three(work.u1, lane)
        w = three(work.u2, lane)
        m = three(work.m, lane)
        zero = (0.0, 0.0, 0.0)
        put_three(work.wrench[0], lane, combined((a1, a2, a3), zero, u, w, m))
        put_three(work.wrench[1], lane, combined((p1 + h1, p2 + h2, p3 + h3), zero, u, w, m))
        put_three(work.wrench[2], lane, combined((-p1 - o1, -p2 - o2, -p3 - o3), zero, u, w, m))


@jit
def deliver(work, wrenches, t):
    """Write the wrenches of tile ``t``."""
    rows = wrenches[t * WRENCHES : (t + 1) * WRENCHES]
    for lane in range(W):
        for i in range(3):
            for k in range(3):
                rows[lane * ACTION + 3 * i + k] = work.wrench[i, k, lane]


@jit
def wrench_at(links, j):
    """The slice of `Links.wrenches` of joint ``j``."""
    first = links.place[j] * ACTION
    return slice(first, first + ACTION)


@jit
def sense_of(links, j):
    """`Links.sense` of joint ``j``."""
    return links.tiles[links.place[j] // W].sense[links.place[j] % W]


@jit
def offset_of(links, j):
    """`Links.offset` of joint ``j``."""
    return links.tiles[links.place[j] // W].offset[links.place[j] % W]


@jit
def glide_of(links, j):
    """How far the polygon of joint ``j`` has moved along its plane since it was last cut (m)."""
    kept = links.kept[j]
    seen = links.seen_tiles[links.place[j] // W]
    lane = links.place[j] % W
    p1 = seen.origin[0, lane] - kept[0]
    p2 = seen.origin[1, lane] - kept[1]
    e1 = seen.first[0, lane] - kept[2]
    e2 = seen.first[1, lane] - kept[3]
    f1 = float(links.glide[j, 0])
    f2 = float(links.glide[j, 1])
    along = float(links.glide[j, 2]) * (p1 * f1 + p2 * f2)
    across = p2 * f1 - p1 * f2
    reach = float(links.reach[j])  # double precision in plain Python as well
    return sqrt(along * along + across * across) + reach * sqrt(e1 * e1 + e2 * e2)


@jit
def least_slack(links):
    """How much farther a polygon may move along its plane before one must be cut again (m); zero or less: now."""
    least = 1e300
    for j in range(links.host.size):
        least = min(least, float(links.slack[j]) - glide_of(links, j))
    return least
