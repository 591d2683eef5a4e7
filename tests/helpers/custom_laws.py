"""Joint laws as a user would write them, for tests."""

import math

import dembrick


def coulomb(move, law, memory):
    """The built-in dry law, without its dashpots."""
    normal = law.normal_stiffness * move.penetration
    if normal <= 0.0:
        return 0.0, 0.0, 0.0, 0.0
    t1 = memory.shear_1 + law.shear_stiffness * move.slip_1
    t2 = memory.shear_2 + law.shear_stiffness * move.slip_2
    size = math.hypot(t1, t2)
    cap = law.friction * normal
    if size > cap:
        t1 *= cap / size
        t2 *= cap / size
    held = normal * normal / law.normal_stiffness + (t1 * t1 + t2 * t2) / law.shear_stiffness
    return normal, t1, t2, 0.5 * held


def following(move, law, memory):
    """Friction as a function of slip: mu (1 + rise s/d exp(1 - s/d)) up to its peak mu (1 + rise) at s = d, then a
    linear fall to ``residual`` of mu over the same length."""
    normal = law.normal_stiffness * move.penetration
    if normal <= 0.0:
        return 0.0, 0.0, 0.0, 0.0
    t1 = memory.shear_1 + law.shear_stiffness * move.slip_1
    t2 = memory.shear_2 + law.shear_stiffness * move.slip_2
    size = math.hypot(t1, t2)
    s = memory.slipped / law.slip_distance
    if s < 1.0:
        factor = 1.0 + law.rise * s * math.exp(1.0 - s)
    else:
        factor = max(law.residual, 1.0 + law.rise - (1.0 + law.rise - law.residual) * (s - 1.0))
    cap = law.friction * factor * normal
    if size > cap:
        memory.slipped += (size - cap) / law.shear_stiffness
        t1 *= cap / size
        t2 *= cap / size
    held = normal * normal / law.normal_stiffness + (t1 * t1 + t2 * t2) / law.shear_stiffness
    return normal, t1, t2, 0.5 * held


def bilinear(move, law, memory):
    """`coulomb` with ``part`` of the normal stiffness beyond the penetration ``knee`` (m)."""
    if move.penetration <= 0.0:
        return 0.0, 0.0, 0.0, 0.0
    soft = max(move.penetration - law.knee, 0.0)
    stiff = move.penetration - soft
    k = law.normal_stiffness
    normal = k * (stiff + law.part * soft)
    t1 = memory.shear_1 + law.shear_stiffness * move.slip_1
    t2 = memory.shear_2 + law.shear_stiffness * move.slip_2
    size = math.hypot(t1, t2)
    cap = law.friction * normal
    if size > cap:
        t1 *= cap / size
        t2 *= cap / size
    held = k * (stiff * stiff + 2.0 * stiff * soft + law.part * soft * soft)
    return normal, t1, t2, 0.5 * (held + (t1 * t1 + t2 * t2) / law.shear_stiffness)


def cohesive(move, law, memory):
    """`coulomb` with a permanent ``cohesion`` (Pa) at points in compression."""
    normal = law.normal_stiffness * move.penetration
    if normal <= 0.0:
        return 0.0, 0.0, 0.0, 0.0
    t1 = memory.shear_1 + law.shear_stiffness * move.slip_1
    t2 = memory.shear_2 + law.shear_stiffness * move.slip_2
    size = math.hypot(t1, t2)
    cap = law.friction * normal + law.cohesion * law.area
    if size > cap:
        t1 *= cap / size
        t2 *= cap / size
    held = normal * normal / law.normal_stiffness + (t1 * t1 + t2 * t2) / law.shear_stiffness
    return normal, t1, t2, 0.5 * held


COULOMB = dembrick.joint_law(coulomb)
FOLLOWING = dembrick.joint_law(following, memory="slipped", slip_distance=2e-5, rise=0.2, residual=0.5)
BILINEAR = dembrick.joint_law(bilinear, knee=1e-7, part=0.25)
COHESIVE = dembrick.joint_law(cohesive, cohesion=500.0)
