"""The families of joints: points and areas, None if a scene has none of them.

Where one joint is meant, ``family`` and ``index`` say which: POINTS or AREAS, and its number there.
"""

from dembrick._jit import jit

POINTS, AREAS = 0, 1
FAMILIES = 2


@jit
def joint_count(points, areas, family):
    """How many joints a family has."""
    if points is not None:
        if family == POINTS:
            return points.joint.size
    if areas is not None:
        if family == AREAS:
            return areas.joint.size
    return 0


@jit
def joint_of(points, areas, family, index):
    """The number of a joint among all joints."""
    if points is not None:
        if family == POINTS:
            return points.joint[index]
    if areas is not None:
        if family == AREAS:
            return areas.joint[index]
    return 0
