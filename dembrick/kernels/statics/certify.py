"""Whether the bracket of one joint between a fixed and a free block is strict, and what it is formed with.

One kernel for a scene of its own and for those of a batch: it reads the dead-load equilibrium, before actuators push.
"""

from math import sqrt
from typing import NamedTuple

from numpy import ndarray

from dembrick._jit import entry, jit
from dembrick.kernels.math.vec3 import cross, put_vector, rows_times
from dembrick.kernels.statics import joint_families as families

NONE = 1e-12  # of the load: a component that is rounding


class Basis(NamedTuple):
    """What `certify` finds; see ``load_bounds.Certificate``."""

    unit: ndarray  # (3,) V_1, V_2, M_T of the unit load about O
    dead: ndarray  # (3,) likewise of the dead load
    centre: ndarray  # (2,) m, centre of pressure where friction follows the pressure, else O
    rest: ndarray  # (c,) N, of the contact points
    scalars: ndarray  # (5,) strict (1 or 0), gauge of the dead load, torsion radius (m), N, tilts (1 or 0)
    twist: ndarray  # (3,) scratch
    across: ndarray  # (6,) scratch


@jit
def at_joint(joints, j, w, out):
    """Force and moment w (6,) at the centroid of b, as V_1, V_2, V_n, M_1, M_2, M_T about O in the joint's axes."""
    axes = joints.axes[j]
    arm = joints.arm_b[j]
    out[0], out[1], out[2] = rows_times(axes, w[0], w[1], w[2])
    c1, c2, c3 = cross(arm[0], arm[1], arm[2], w[0], w[1], w[2])
    out[3], out[4], out[5] = rows_times(axes, w[3] - c1, w[4] - c2, w[5] - c3)


@entry
def certify(joints, points, areas, unit, dead, basis):
    """Fill ``basis`` for joint 0, the only one of its scene, from the dead-load equilibrium.

    ``unit`` and ``dead`` (6,) are the wrenches of the unit load and of the dead load on b about O (`at_joint`). Strict
    where the friction of the joint does not depend on the load: where it follows the pressure, while the load neither
    presses nor tilts; under the full pressure of a convex joint while it does not press, and slides before it could
    overturn. A load ``tilts`` that moves the pressure, whatever friction makes of it.
    """
    resultant = joints.resultant[0]
    normal = resultant[0]
    basis.centre[0] = 0.0
    basis.centre[1] = 0.0
    family = families.only_family(points, areas)
    mu = families.friction_of(points, areas, family, 0)
    reach, follows = families.at_rest(points, areas, family, 0, basis)
    size = max(max(abs(unit[0]), abs(unit[1])), abs(unit[5]) / reach)
    strict = abs(unit[2]) <= NONE * size
    tilts = not strict
    if max(abs(unit[3]), abs(unit[4])) > NONE * size * reach:
        tilts = True
        if follows:
            strict = False
        else:
            # translation bounds what friction can carry: strict if the block cannot overturn before that
            most = mu * normal + sqrt(dead[0] * dead[0] + dead[1] * dead[1])
            shear = sqrt(unit[0] * unit[0] + unit[1] * unit[1])
            overturning = families.overturning_load(points, areas, family, 0, resultant, normal, unit)
            strict = strict and most <= shear * overturning
    # rounding of the geometry must not tilt the load
    basis.unit[0] = unit[0] if abs(unit[0]) > NONE * size else 0.0
    basis.unit[1] = unit[1] if abs(unit[1]) > NONE * size else 0.0
    basis.unit[2] = unit[5] if abs(unit[5]) > NONE * size * reach else 0.0
    put_vector(basis.dead, dead[0], dead[1], dead[5])
    taken = 0.0
    if mu > 0.0 and (dead[0] != 0.0 or dead[1] != 0.0 or dead[5] != 0.0):
        taken = families.dead_gauge(points, areas, family, 0, normal, dead, basis)
    basis.scalars[0] = 1.0 if strict else 0.0
    basis.scalars[1] = taken
    basis.scalars[3] = normal
    basis.scalars[4] = 1.0 if tilts else 0.0
