"""Transition from joints to contacts: when a joint hands its pair of blocks over to a new contact.

The new contact counts by its weight, the joint by the rest. The weight grows with what the joint's polygon cannot
follow, between two bounds each: the turn of the one face against the other; and, where the polygon is not the whole
face that it rides on, the slip in the plane, because faces may share more then than they did, and slip times turn,
which is how deep that may sink in unseen. It grows by no more than `GROWTH` in a step. Where the joint is open and all
of it lies well apart there is nothing to hand over, and it is 1: faces that land on each other bounce as they should.

It falls back as slowly where the joint can follow again and presses: a block that was tossed, or rocked far over, rocks
on its corners again and not on a bed of springs. It stays while the faces lie flat. A block that rocks leaves its
corners at each impact by as little as it bounces; that is not apart.
"""

from math import sqrt

from dembrick._jit import jit
from dembrick.kernels.dynamics.tiles import W, offset_of, sense_of, three, wrench_at

TURN = 0.2, 0.4  # sine of the turn of the faces at which the handing over of a joint begins, and ends
SLIP = 0.05, 0.15  # of the joint's size: slip
SINK = 1e-4, 5e-4  # of its size: slip times turn
PARTED = 0.05  # of its size: an open joint is apart if its nearest corner is, by so much
FLUSH = 1e-3  # sine of a turn below which faces land on each other flat: their bounce is that of the new contact
GROWTH = 1.0 / 300.0  # in a step, of the weight of a new contact


@jit
def ramp(x, low, high):
    """From 0 at ``low`` to 1 at ``high``, smoothly."""
    s = min(1.0, max(0.0, (x - low) / (high - low)))
    return s * s * (3.0 - 2.0 * s)


@jit
def hand_over(touching, links, t):
    """Let the weight of pair ``t`` grow as its joint fails to follow, and leave the joint the rest of its force.

    Returns whether the joint is open, and whether it is open and apart.
    """
    joint = touching.joint[t]
    size = touching.size[t]
    seen = links.seen_tiles[links.place[joint] // W]
    lane = links.place[joint] % W
    o1, o2, o3 = three(seen.origin, lane)
    x1, x2, x3 = three(seen.first, lane)
    y1, y2, y3 = three(seen.second, lane)
    wrench = links.wrenches[wrench_at(links, joint)]
    turn = sqrt(x3 * x3 + y3 * y3)
    due = ramp(turn, TURN[0], TURN[1])
    if touching.partial[t]:
        start = touching.start[joint]
        shift = touching.shift[joint]
        p1 = o1 - shift[0] * x1 - shift[1] * y1 - start[0]
        p2 = o2 - shift[0] * x2 - shift[1] * y2 - start[1]
        e1 = x1 - start[3]
        e2 = x2 - start[4]
        slip = sqrt(p1 * p1 + p2 * p2) + size * sqrt(e1 * e1 + e2 * e2)
        due = max(due, ramp(slip, SLIP[0] * size, SLIP[1] * size))
        due = max(due, ramp(slip * turn, SINK[0] * size, SINK[1] * size))
    is_open = True
    for i in range(3):
        is_open = is_open and wrench[i] == 0.0
    weight = touching.weight[t]
    if due > weight:
        weight = min(due, weight + GROWTH)
    elif not is_open and turn > FLUSH:
        weight = max(due, weight - GROWTH)
    touching.weight[t] = weight
    for i in range(9):
        wrench[i] *= 1.0 - weight
    gap = sense_of(links, joint) * (o3 - offset_of(links, joint))
    return is_open, is_open and gap - size * turn > PARTED * size
