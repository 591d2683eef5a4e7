"""Memory order of the blocks: in the compiled loop blocks that touch are near each other, whatever their order.

A step reads the positions of both blocks of a joint, and a block gathers the wrenches of its joints. If these are near
each other in memory they are still in the cache; a wall of 10,000 blocks in random order takes 1.6
times as long as one that is drawn in courses. Scenes that are drawn so are left as they are. Others run in reverse
Cuthill-McKee order (E. Cuthill, J. McKee, Proc. 24th ACM National Conference (1969) 157): from a block at the rim
outwards, neighbours after neighbours. Joints follow in tiles, in the order of their blocks.

Outside the loop everything has the numbers of the scenario; only `LoopOrder` converts to others.
`tiled` assigns joints to the tiles of the kernels.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dembrick.kernels.dynamics.loop import Loads
from dembrick.kernels.dynamics.rigid_bodies import Bodies
from dembrick.kernels.dynamics.tiles import W

if TYPE_CHECKING:
    from dembrick.assembly.joints import JointTable
    from dembrick.kernels.dynamics.contact_forces import Touching
    from dembrick.kernels.joint.ties import Ties


# Mean distance of the two blocks of a joint in the order. Up to NEAR, about a megabyte with their joints, all are in
# the cache; beyond, another order must reduce it by the factor NEARER to be used
NEAR, NEARER = 512, 0.5
ENTER = ("position", "rotation", "orientation", "velocity", "spin", "momentum", "start", "applied")  # of `Bodies`
LEAVE = ("position", "orientation", "velocity", "spin", "momentum", "applied")


def memory_order(joints: JointTable, fixed: np.ndarray) -> np.ndarray | None:
    """The order of the blocks (n,) in the loop; None if that of the scenario is as good."""
    if not len(joints):
        return None
    a, b = joints.block_a, joints.block_b
    apart = float(np.abs(a - b).mean())
    if apart <= NEAR:
        return None
    order = neighbours_together(a, b, np.asarray(fixed, bool))
    row = np.argsort(order)
    return order if float(np.abs(row[a] - row[b]).mean()) <= NEARER * apart else None


def neighbours_together(a: np.ndarray, b: np.ndarray, fixed: np.ndarray) -> np.ndarray:
    """Blocks (n,) in an order in which the pairs a, b (j,) are near each other: reverse Cuthill-McKee of the free
    ones; a fixed one, which may be a floor under all of them, comes before the first of its neighbours."""
    n = len(fixed)
    between = ~(fixed[a] | fixed[b])
    end, far = np.concatenate([a[between], b[between]]), np.concatenate([b[between], a[between]])
    count = np.bincount(end, minlength=n)
    by_block = np.lexsort((count[far], end))
    start, neighbour = [0, *np.cumsum(count).tolist()], far[by_block].tolist()

    def outwards(root: int, seen: list[bool]) -> list[int]:
        found = [root]
        seen[root] = True
        for block in found:
            for other in neighbour[start[block] : start[block + 1]]:
                if not seen[other]:
                    seen[other] = True
                    found.append(other)
        return found

    order: list[int] = []
    reached, placed = fixed.tolist(), fixed.tolist()
    for block in np.argsort(count, kind="stable").tolist():
        if not reached[block]:
            rim = outwards(block, reached)[-1]  # a block at the greatest distance
            order += outwards(rim, placed)
    order.reverse()
    key = np.full(n, float(n))
    key[order] = np.arange(len(order))
    for one, other in ((a, b), (b, a)):
        beside = fixed[one] & ~fixed[other]
        np.minimum.at(key, one[beside], key[other[beside]] - 0.5)
    return np.argsort(key, kind="stable")


@dataclass(frozen=True)
class LoopOrder:
    """Order of the blocks in the loop: row r is block ``order`` [r], and block i is row ``row`` [i], both (n,).

    ``bodies`` is the loop's own copy; `enter` fills it and `leave` writes changes back.
    """

    order: np.ndarray
    row: np.ndarray
    bodies: Bodies

    def enter(
        self, bodies: Bodies, ties: Ties, loads: Loads, touching: Touching
    ) -> tuple[Bodies, Ties, Loads, Touching]:
        """The arguments with block numbers replaced by rows of the loop."""
        for name in ENTER:
            np.take(getattr(bodies, name), self.order, axis=0, out=getattr(self.bodies, name), mode="clip")
        lists = {name: self.row[getattr(bodies, name)].astype(np.uint32) for name in ("free", "guided")}
        own = self.bodies._replace(free=np.sort(lists["free"]), guided=lists["guided"])
        ties = ties._replace(block=self.row[ties.block])
        faces = loads.faces._replace(block=self.row[loads.faces.block])
        head = loads.head._replace(body=self.row[loads.head.body])
        loads = loads._replace(block=self.row[loads.block], support=self.row[loads.support], faces=faces, head=head)
        touching = touching._replace(
            parts=touching.parts._replace(owner=self.row[touching.parts.owner]),
            **{name: getattr(touching, name)[self.order] for name in ("free", "load", "bearable")},
        )
        return own, ties, loads, touching

    def leave(self, bodies: Bodies, touching: Touching | None, used: Touching) -> None:
        """Copy the rows of the loop back to ``bodies``, and the loads of the contacts ``used`` to ``touching``."""
        for name in LEAVE:
            getattr(bodies, name)[self.order] = getattr(self.bodies, name)
        if touching is not None:
            touching.load[self.order] = used.load


FEW = 8  # directions of normals: with more, sorting is useless and would only separate near joints
ROUNDING = 1e-12
ALIKE = 8 * W  # identical joints: so many get tiles of their own
STRETCH = 512  # joints that are sorted by their direction at a time
TILE_ROWS, SPREAD_ROWS = 3, 3  # rows of points that take as long as the other work on a tile, and more if it is spread


def tiled(
    kind: np.ndarray, way: np.ndarray, turn: np.ndarray, points: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The joint in each lane of t tiles, out of p joints (t, W), the number of used lanes of each tile (t,), and the
    number of neighbouring lanes of each joint (p,).

    ``turn`` (p,): the joints in an order in which neighbours are near each other. Joints are grouped by ``kind`` (p,),
    and within it by direction, ``way`` (p,): head joints of a wall slide all the time and bed joints hardly ever, and a
    tile without sliding joints is faster; tiles of identical joints share rows. Grouping by direction is done within
    stretches of joints only, so that the blocks of a tile are still in the cache. Unused lanes repeat the last joint.
    Joints that do not fill a tile get several lanes each for their ``points`` (p,), the same number within a kind, if
    that is faster (`kernels.dynamics.spread_points`).
    """
    lanes, used, width = [np.zeros((0, W), np.uint32)], [np.zeros(0, np.int64)], np.ones(len(kind), np.int64)
    for one in np.unique(kind):
        members = turn[kind[turn] == one]
        members = members[np.lexsort((way[members], np.arange(len(members)) // STRETCH))]
        rest = members[len(members) // W * W :]
        if len(rest) and points is not None:
            width[rest] = fastest_width(len(rest), int(points[rest[0]]))
        members = np.repeat(members, width[members])
        tiles = -(-len(members) // W)
        padded = np.full(tiles * W, members[-1], np.uint32)
        padded[: len(members)] = members
        lanes.append(padded.reshape(tiles, W))
        used.append(np.minimum(len(members) - W * np.arange(tiles), W))
    return np.concatenate(lanes), np.concatenate(used), width


def fastest_width(joints: int, points: int) -> int:
    """The number of lanes for each of some ``joints`` with that many ``points``, by the rows that take as long."""

    def rows(width: int) -> int:
        tiles, more = -(-joints * width // W), SPREAD_ROWS if width > 1 else 0
        return tiles * (TILE_ROWS + more + rows_of_points(points, width))

    return min((2**k for k in range(W.bit_length())), key=rows)


def rows_of_points(points, width):
    """Rows of a tile for so many ``points`` of each joint, in ``width`` lanes: an even number."""
    return 2 * -(-points // (2 * width))


def own_lanes(lane: np.ndarray) -> np.ndarray:
    """Which lanes of tiles (t, W) are the first of their joint, as in `tiled`."""
    first = np.ones(lane.shape, bool)
    first[:, 1:] = lane[:, 1:] != lane[:, :-1]
    return first


def without_rounding(values: np.ndarray, lengths: bool = False) -> np.ndarray:
    """Numbers (k, ...), made equal if they differ by rounding alone, so that tiles of a regular wall are identical.

    The tolerance is `ROUNDING` times the numbers themselves, or times the greatest of them if they are ``lengths``,
    differences of coordinates.
    """
    flat = values.reshape(-1)
    order = np.argsort(flat, kind="stable")
    ascending = flat[order]
    size = np.abs(ascending)
    new = np.diff(ascending, prepend=-np.inf) > ROUNDING * (size.max(initial=0.0) if lengths else size)
    same = np.empty_like(flat)
    same[order] = ascending[new][np.cumsum(new) - 1]
    return same.reshape(values.shape) + 0.0  # and -0 is 0


def in_turn(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The joints (j,) in the order of their blocks, which are rows a and b (j,) of the loop."""
    return np.lexsort((np.maximum(a, b), np.minimum(a, b)))


def ways(normals: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    """A number (p,) for the direction of each normal (p, 3) and, within a direction, for joints whose ``numbers``
    (p, k) are equal but for rounding. Zero for all if there are more than a few directions; joints with too few equals
    are numbered by direction alone."""
    _, way, count = np.unique(np.round(np.abs(normals), 6), axis=0, return_inverse=True, return_counts=True)
    if len(count) > FEW:
        return np.zeros(len(normals), np.int64)
    scale = np.abs(numbers).max(axis=0, initial=1e-300)
    mixed = without_rounding(numbers / scale @ np.sqrt(1.0 + np.arange(numbers.shape[1])), lengths=True)
    _, kind, count = np.unique(mixed, return_inverse=True, return_counts=True)
    return way.reshape(-1) * (len(count) + 1) + np.where(count[kind] >= ALIKE, kind + 1, 0)
