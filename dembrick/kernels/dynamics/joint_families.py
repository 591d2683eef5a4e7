"""The joint families of a run in real time: only this module distinguishes which of them a scene has.

A family is a module (`point_joints`, `area_joints`) with one set of functions; its joints are a NamedTuple of arrays,
or None if the scene has none of them, and numba then omits its code. ``family`` and ``index``: see
`kernels.joint.families`.
"""

from dembrick._jit import jit
from dembrick.kernels.dynamics import area_joints, point_joints
from dembrick.kernels.joint.families import AREAS, POINTS, by_family


@jit
def family_of(place):
    """Family and number of a joint from its entry in `EnergyTerms.place`."""
    if place >= 0:
        return POINTS, place
    return AREAS, -1 - place


def tiles_of(joints) -> int:
    """Number of tiles of the joints of a family; zero for None."""
    return 0 if joints is None else len(joints.used)


@jit
def forces(links, corners, faces, bodies, share_corners, share_faces, t, energy_terms, work):
    """Forces of all joints in the tiles of share ``t``; ``share_*`` (t + 1,): first tile of each share."""
    if corners is not None:
        share = share_corners[t], share_corners[t + 1]
        point_joints.forces(
            links, corners, bodies, share, corners.force, corners.strengths, corners.bonds, corners.custom,
            energy_terms, work,
        )  # fmt: skip
    if faces is not None:
        area_joints.forces(links, faces, bodies, share_faces[t], share_faces[t + 1], energy_terms, work)


@jit
def spring_energy(links, corners, faces, family, index, held):
    """Energy (J) in the springs of a joint; for a convex one, writes N and its x and y moments into its row of
    ``held``."""
    if corners is not None:
        if family == POINTS:
            return point_joints.spring_energy(links, corners, index, held)
    if faces is not None:
        if family == AREAS:
            return area_joints.spring_energy(links, faces, index, held)
    return 0.0


# Work (J) on the springs of a joint if their forces stayed constant; called with corners, faces, family, index
work_ahead = by_family(point_joints.work_ahead, area_joints.work_ahead, 0.0)
# Length of the slip path (m) of a joint; called with corners, faces, family, index
mean_slip = by_family(point_joints.mean_slip, area_joints.mean_slip, 0.0)
