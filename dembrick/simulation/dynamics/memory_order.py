"""Memory order of the blocks: in the compiled loop blocks that touch stand near each other, whatever their order.

A step reads the places of both blocks of a joint, and a block gathers the wrenches of its joints. If these are near
each other in memory they are still in the processor's own cache; a wall of 10,000 blocks in random order takes 1.6
times as long as one that is drawn in courses. Scenes that are drawn so are left as they are. Others run in the order of
reverse Cuthill-McKee (E. Cuthill, J. McKee, Proc. 24th ACM National Conference (1969) 157): from a block at the rim
outwards, neighbours after neighbours. Joints follow in tiles, in the order of their blocks.

Outside the loop everything has the numbers of the scenario: `LoopOrder` is the only place that knows of others.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dembrick.kernels.dynamics.loop import Loads
from dembrick.kernels.dynamics.rigid_bodies import Bodies

if TYPE_CHECKING:
    from dembrick.assembly.joints import JointTable
    from dembrick.kernels.dynamics.contact_forces import Touching
    from dembrick.kernels.joint.ties import Ties

# Blocks between the two of a joint, in the mean. Up to NEAR, with their joints about a megabyte, all are in the cache;
# beyond, another order must bring them nearer by NEARER to be worth it
NEAR, NEARER = 512, 0.5
ENTER = ("position", "rotation", "orientation", "velocity", "spin", "momentum", "start", "applied")  # of `Bodies`
LEAVE = ("position", "orientation", "velocity", "spin", "momentum", "applied")


def memory_order(joints: JointTable, fixed: np.ndarray) -> np.ndarray | None:
    """The blocks (n,) in the order in which the loop has them; None if that of the scenario is as good."""
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
    ones; a fixed one, which may be a floor under all of them, stands before the first of its neighbours."""
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
            rim = outwards(block, reached)[-1]  # as far away as any
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
    """The blocks as the loop has them: row r is block ``order`` [r], and block i is row ``row`` [i], both (n,).

    ``bodies`` is the loop's own copy; `enter` fills it and `leave` writes back what steps changed.
    """

    order: np.ndarray
    row: np.ndarray
    bodies: Bodies

    def enter(
        self, bodies: Bodies, ties: Ties, loads: Loads, touching: Touching
    ) -> tuple[Bodies, Ties, Loads, Touching]:
        """All that names blocks, with the loop's rows in place of their numbers."""
        for name in ENTER:
            np.take(getattr(bodies, name), self.order, axis=0, out=getattr(self.bodies, name), mode="clip")
        lists = {name: self.row[getattr(bodies, name)].astype(np.uint32) for name in ("free", "guided")}
        own = self.bodies._replace(free=np.sort(lists["free"]), guided=lists["guided"])
        ties = ties._replace(block=self.row[ties.block])
        faces = loads.faces._replace(block=self.row[loads.faces.block])
        loads = loads._replace(block=self.row[loads.block], support=self.row[loads.support], faces=faces)
        touching = touching._replace(
            parts=touching.parts._replace(owner=self.row[touching.parts.owner]),
            **{name: getattr(touching, name)[self.order] for name in ("free", "load", "bearable")},
        )
        return own, ties, loads, touching

    def leave(self, bodies: Bodies, touching: Touching | None, used: Touching) -> None:
        """Write into ``bodies`` and ``touching`` what steps made of the loop's rows, and of the contacts ``used``."""
        for name in LEAVE:
            getattr(bodies, name)[self.order] = getattr(self.bodies, name)
        if touching is not None:
            touching.load[self.order] = used.load
