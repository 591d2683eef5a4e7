"""Slip paths of joints that act at contact points, in real time: see `kernels.joint.point_law`."""

from dembrick._jit import entry, jit
from dembrick.kernels.dynamics.tiles import W
from dembrick.kernels.joint.point_law import slip_weight


@jit
def weigh(work, which, lane, normal, t1, t2):
    """Store the `slip_weight` of point ``which`` of two that are not dry, and add it to that of its joint."""
    work.weight[which, lane] = slip_weight(normal, t1, t2)
    work.carrying[lane] += work.weight[which, lane]


@entry
def add_slip(work):
    """Add the weighted slip of the last two points of every joint of a tile to its sum."""
    for which in range(2):
        for lane in range(W):
            work.rubbed[lane] += work.weight[which, lane] * work.slid[which, lane]


@entry
def lengthen_paths(work, dry, joints, slip):
    """Add the slip of the step, its mean by the weights, to the slip paths of the ``joints`` of a tile. The weights of
    ``dry`` points add up to the normal force."""
    for lane in range(joints.size):
        if work.rubbed[lane] > 0.0:
            slip[joints[lane]] += work.rubbed[lane] / (work.force[2, lane] if dry else work.carrying[lane])
