"""The families of joints: points and areas, each None if a scene has no such joint.

A single joint is given by ``family``, POINTS or AREAS, and ``index``, its number within the family.
"""

from dembrick._jit import jit

POINTS, AREAS = 0, 1
FAMILIES = 2


def by_family(of_points, of_areas, absent):
    """A kernel that dispatches on the family of a joint: it calls ``of_points`` or ``of_areas`` with the joints of the
    family, the index there and further arguments; or returns ``absent``, of the same type, if there is no such family.
    """

    @jit
    def asked(points, areas, family, index, *more):
        if points is not None:
            if family == POINTS:
                return of_points(points, index, *more)
        if areas is not None:
            if family == AREAS:
                return of_areas(areas, index, *more)
        return absent

    return asked


@jit
def joint_count(points, areas, family):
    """Number of joints of a family."""
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
