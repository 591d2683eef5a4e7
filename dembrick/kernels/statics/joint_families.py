"""The joint families of the searches: only this module distinguishes which of them a scene has.

A family is a module (`point_joints`, `area_joints`) with one set of functions; its joints are a NamedTuple of arrays,
or None if the scene has none of them, and numba then omits its code. ``family`` and ``index``: see
`kernels.joint.families`.
"""

from dembrick._jit import jit
from dembrick.kernels.joint.families import AREAS, POINTS, by_family
from dembrick.kernels.joint.geometry import Motion
from dembrick.kernels.statics import area_joints, area_tangent, point_joints, point_tangent


@jit
def only_family(points, areas):
    """The family of the one joint of a scene."""
    return POINTS if areas is None else AREAS


@jit
def friction_of(points, areas, family, index):
    """Friction coefficient of a joint."""
    if points is not None:
        if family == POINTS:
            return points.friction[index]
    if areas is not None:
        if family == AREAS:
            return areas.friction[index]
    return 0.0


# Called with points, areas, family, index, and the further arguments of the functions of the families.
# Resultant (N, V_1, V_2, M_T, M_1, M_2, slip): see `point_joints.forces`
forces = by_family(point_joints.forces, area_joints.forces, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
# D(q) with given normal forces: ``rest`` of the contact points, ``normal`` of a convex joint
dissipation = by_family(point_joints.dissipation, area_joints.dissipation, 0.0)
# Energy (J) in the shear springs
shear_energy = by_family(point_joints.shear_energy, area_joints.shear_energy, 0.0)
# The part of the forces ``now`` that fits under the normal forces before the actuators pushed
carried_share = by_family(point_joints.carried_share, area_joints.carried_share, 1.0)
# Whether friction follows a pressure that differs from that before the actuators pushed
pressure_moved = by_family(point_joints.pressure_moved, area_joints.pressure_moved, False)
# Slip twist (3) that gives the least upper bound
bound_twist = by_family(point_joints.bound_twist, area_joints.bound_twist, (0.0, 0.0, 0.0))
# Fills ``basis`` with the dead-load state; the reach of shear forces (m), whether friction follows the pressure
at_rest = by_family(point_joints.at_rest, area_joints.at_rest, (0.0, False))
# V at which a joint overturns, if friction does not follow the pressure
overturning_load = by_family(point_joints.overturning_load, area_joints.overturning_load, 0.0)
# Whether a gap of a joint closes further between two motions u (6)
closes_gap = by_family(point_joints.closes_gap, area_joints.closes_gap, False)
# Upper bound of the gauge of the dead load (6,) in the limit set
dead_gauge = by_family(point_joints.dead_gauge, area_joints.dead_gauge, 0.0)


@jit
def pressure_retreats(points, areas, family):
    """Whether the pressure of a family's joints retreats to a shrinking strip as they rock."""
    return areas is not None and family == AREAS


@jit
def knows_tangent(points, areas, family, index):
    """Whether `tangent` applies to a joint; if not, its tangent must be formed by finite differences."""
    if areas is not None:
        if family == AREAS:
            return area_tangent.knows_tangent(areas.strengths, areas.pressed, index)
    return False


@jit
def tangent(points, areas, area_memory, family, index, normal, dn, r1, r2, out):
    """dt/du (6, 6) of a joint that `knows_tangent`, into ``out``, at the result of `forces` from the memory."""
    if areas is not None:
        if family == AREAS:
            area_tangent.tangent(areas, area_memory, index, normal, dn, r1, r2, out)


@jit
def exact_tangent(points, areas, point_memory, area_memory, family, index, normal, opening, out):
    """Write dt/du (6, 6) of a joint into ``out``, at the result of `forces` from the memory; False if its family does
    not provide it. ``normal``: N; ``opening``: (dn, r1, r2)."""
    if points is not None:
        if family == POINTS:
            return point_tangent.exact_tangent(points.strengths, points.custom, points, point_memory, index, out)
    if areas is not None:
        if family == AREAS:
            if area_tangent.knows_tangent(areas.strengths, areas.pressed, index):
                area_tangent.tangent(areas, area_memory, index, normal, opening[0], opening[1], opening[2], out)
                return True
    return False


@jit
def dissipation_now(points, areas, family, index, normal, q1, q2, q3):
    """D(q) of a joint under its present normal forces, whose sum is ``normal``."""
    if points is not None:
        if family == POINTS:
            return point_joints.dissipation(points, index, points.normal, normal, q1, q2, q3)
    if areas is not None:
        if family == AREAS:
            return area_joints.dissipation(areas, index, None, normal, q1, q2, q3)
    return 0.0


@jit
def write_contacts(points, areas, joints, viscous, out):
    """Forces (N, world) on block b at all contact points into ``out`` (c, 3)."""
    if points is not None:
        for p in range(points.joint.size):
            point_joints.write_contacts(points, p, joints, viscous, out)


@jit
def write_bonds(points, areas, out):
    """Part of the area of every joint whose bond holds, into ``out`` (j,)."""
    if points is not None:
        point_joints.write_bonds(points.bonds, points, out)
    if areas is not None:
        area_joints.write_bonds(areas.bonds, areas, out)


@jit
def remember(points, areas, point_memory, area_memory):
    """Copy the memory of all joints into the memories, a `Points` and an `Areas`, None if the family is."""
    if points is not None:
        for p in range(points.joint.size):
            point_joints.remember(points, point_memory, p)
    if areas is not None:
        for a in range(areas.joint.size):
            area_joints.remember(areas, area_memory, a)


@jit
def recall(points, areas, point_memory, area_memory, family, index):
    """Restore the state of a joint from the memory of its family."""
    if points is not None:
        if family == POINTS:
            point_joints.remember(point_memory, points, index)
    if areas is not None:
        if family == AREAS:
            area_joints.remember(area_memory, areas, index)


@jit
def recalled_motion(points, areas, point_memory, area_memory, family, index, depth, base, u):
    """`recall`, and the `Motion` of one implicit step from there: from the motion ``base`` (6) to ``u`` (6) now, with
    the ``depth`` now. A step between equilibria has no rate: its growth is zero."""
    recall(points, areas, point_memory, area_memory, family, index)
    return Motion(depth, (0.0, 0.0, 0.0), (u[0] - base[0], u[1] - base[1], u[5] - base[5]))
