"""Joints with many points, in real time: the points of a joint side by side in several lanes of its tile.

Joints of a tile have the same number of points. In a scene of few blocks most lanes of a tile would be spare, and a
joint of some hundred points would use one lane of `W`. There each joint has ``width`` neighbouring lanes: its first
points are side by side in these lanes, the next ones in the following row. Only the first of the lanes has the motion
of the joint, its wrench and its energy terms; the others get a copy of the motion before the points are evaluated, and
return what they add up.
"""

from dembrick._jit import entry
from dembrick.kernels.dynamics.tiles import W


@entry
def spread_motion(work, width):
    """Copy the motion and the dashpot ratios of every joint of a tile into all of its ``width`` lanes."""
    for first in range(0, W, width):
        for lane in range(first + 1, first + width):
            for i in range(3):
                work.depth[i, lane] = work.depth[i, first]
                work.growth[i, lane] = work.growth[i, first]
            for i in range(2):
                work.slip[i, lane] = work.slip[i, first]
                work.slip_x[i, lane] = work.slip_x[i, first]
                work.slip_y[i, lane] = work.slip_y[i, first]
            work.normal[lane] = work.normal[first]
            work.damped[lane] = work.damped[first]
            work.damping[lane] = work.damping[first]


@entry
def gather_sums(work, width):
    """Move the sums over the points in the ``width`` lanes of every joint of a tile into its first lane."""
    for first in range(0, W, width):
        for lane in range(first + 1, first + width):
            for i in range(3):
                for rows in (work.force, work.x_force, work.y_force, work.dashpot, work.x_dashpot, work.y_dashpot):
                    rows[i, first] += rows[i, lane]
                    rows[i, lane] = 0.0
            for row in (work.rubbed, work.carrying):
                row[first] += row[lane]
                row[lane] = 0.0


@entry
def gather_losses(ledger, width):
    """`gather_sums` for the energy terms of the tile."""
    for first in range(0, W, width):
        for lane in range(first + 1, first + width):
            ledger.smallest[first] = min(ledger.smallest[first], ledger.smallest[lane])
            ledger.smallest[lane] = 0.0
            for row in (
                ledger.dashpots, ledger.friction, ledger.released, ledger.stepping, ledger.by_law, ledger.crushing,
                ledger.fracture,
            ):  # fmt: skip
                row[first] += row[lane]
                row[lane] = 0.0
