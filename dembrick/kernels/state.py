"""The arrays the kernels work on: contiguous float64 / int64, one line a field with shape, unit and sign.

Counts: n blocks, f free blocks, j joints, p point joints, c contact points, a area joints, v polygon vertices, k
actuators, l loads, r recorded rows. "start" is the scenario's geometry. Nothing else of a run is mutable.
"""

from typing import NamedTuple

import numpy as np
from numpy import ndarray

from dembrick.kernels.math.multifrontal import Rounded


class Blocks(NamedTuple):
    """Motion of the blocks and the forces on them."""

    free: ndarray  # (f,) int64, indices of the blocks that are integrated
    displacement: ndarray  # (n, 3) m, centroid since the start
    rotation: ndarray  # (n, 3) rad, rotation vector since the start (small motion only)
    orientation: ndarray  # (n, 4) unit quaternion (w, x, y, z), body to world; of the start in small motion
    velocity: ndarray  # (n, 3) m/s, centroid, half a step behind
    spin: ndarray  # (n, 3) rad/s, world, half a step behind
    mean_velocity: ndarray  # (n, 6) m/s, rad/s, running mean (small motion)
    momentum: ndarray  # (n, 3) kg m2/s, angular momentum about the centroid, world (finite motion)
    force: ndarray  # (n, 3) N, out of balance
    torque: ndarray  # (n, 3) N m about the centroid, out of balance
    dead_force: ndarray  # (n, 3) N, gravity and dead loads
    dead_torque: ndarray  # (n, 3) N m about the centroid, of the dead loads at the start
    guided: ndarray  # (g,) int64, free blocks with guides, which fix them in some directions
    held: ndarray  # (g, 6) bool, the fixed directions: along x, y, z, about x, y, z of the world
    guide: ndarray  # (g, 6) N, N m: force and moment of the guides on them, zero in free directions


class ScaledInertia(NamedTuple):
    """Artificial inertia of small motion: a full 6 x 6 matrix per block, proportional to its contact stiffness."""

    inverse: ndarray  # (n, 6, 6) per block, from (force, torque) to (acceleration, angular acceleration)
    matrix: ndarray  # (n, 6, 6) its inverse, for the energy terms
    whole: "WholeInertia | None"  # in place of both if free blocks touch free blocks


class WholeInertia(NamedTuple):
    """Artificial inertia of small motion in one piece: the elastic stiffness of the assembly, factorised."""

    place: ndarray  # (f,) int64, first of the six rows of each free block
    rounded: Rounded  # its LU factors in single precision, see `math.multifrontal`
    work: ndarray  # (1, 6 f) scratch


class Inertia(NamedTuple):
    """Physical inertia of finite motion."""

    mass: ndarray  # (n,) kg
    inverse: ndarray  # (n, 3, 3) 1/(kg m2), inverse of the inertia about the centroid, body frame


class Joints(NamedTuple):
    """Geometry and forces of the joints. In small motion, fields marked "now" keep their values of the start."""

    block_a: ndarray  # (j,) int64
    block_b: ndarray  # (j,) int64
    host: ndarray  # (j,) +1 if the polygon moves with b, -1 if with a
    axes: ndarray  # (j, 3, 3) rows t1, t2, n now, world
    arm_a: ndarray  # (j, 3) m, from the centroid of a to O now, world
    arm_b: ndarray  # (j, 3) m, likewise of b
    axes_a: ndarray  # (j, 3, 3) rows t1, t2, n in the body frame of a
    axes_b: ndarray  # (j, 3, 3) likewise of b
    lever_a: ndarray  # (j, 3) m, from the centroid of a to O in the body frame of a
    lever_b: ndarray  # (j, 3) m, likewise of b
    offset: ndarray  # (j, 3) m, centroid of b seen from that of a at the start, world
    gap: ndarray  # (j,) m, distance of the faces at the start, positive open
    relative: ndarray  # (j, 6) m, rad: motion of b against a at O in the joint's axes (d1, d2, dn, r1, r2, rn)
    damping: ndarray  # (j,) factor of the joint on the dashpot ratios of the drive
    opening: ndarray  # (j, 3) m, rad: opening at O and tilts now
    step: ndarray  # (j, 3) m, m, rad: slip twist of the last step
    tilt: ndarray  # (j, 2) rad: tilts of the last step
    resultant: ndarray  # (j, 7) N, V_1, V_2, M_T, M_1, M_2 (action on b about O), slip (m)


# State of the actuators
DRIVEN = np.dtype(
    (
        np.record,
        [
            ("head", float),  # m, travel of the head
            ("displacement", float),  # m, work-conjugate displacement of the loaded points
            ("load", float),  # N, V
            ("peak", float),  # N, V of the largest size so far, with its sign
            ("peak_at", float),  # m, driven displacement there
            ("greatest", float),  # N, V so far
            ("least", float),  # N, V so far
        ],
    )
)


class Actuators(NamedTuple):
    """The load system: actuator i carries V weight_i; one spring and dashpot drive the work-conjugate displacement."""

    block: ndarray  # (k,) int64
    arm: ndarray  # (k, 3) m, from the centroid to the loaded point now, world
    lever: ndarray  # (k, 3) m, the same in the body frame
    start: ndarray  # (k, 3) m, the arm at the start, world
    direction: ndarray  # (k, 3) unit vector, world
    weight: ndarray  # (k,)
    zero: ndarray  # (k,) m, displacements of the loaded points along their directions at V = 0
    displacement: ndarray  # (k,) m, the same now, counted from ``zero``
    driven: ndarray  # (1,) record `DRIVEN`


# Work done in a run and energy lost, J
WORK = np.dtype(
    (
        np.record,
        [
            ("head", float),  # work of the head of the actuators
            ("torques", float),  # work of the dead torques
            ("sliding", float),  # lost in friction
            ("damping", float),  # in dashpots of contacts and in the damping of fluctuations
            ("actuator_damping", float),  # in the dashpot of the head
            ("by_law", float),  # mu N |slip|
            ("least", float),  # the smallest friction work of an increment
            ("elastic_at_start", float),  # elastic energy of joints and ties at the start of the run
            ("dead_loads", float),  # work of the dead forces up to the start of the run
            ("crushing", float),  # lost by crushing
            ("fracture", float),  # by breaking bonds
            ("yielding", float),  # by ties that yield
        ],
    )
)


class Energy(NamedTuple):
    """The energy terms of a run: work summed step by step, and the quantities of the last step that the next needs."""

    work: ndarray  # (1,) record `WORK`
    turned: ndarray  # (t,) int64, free blocks with a dead torque
    dash: ndarray  # (j + 1, 6) N, N m: V_1, V_2, M_T, N, M_1, M_2 of each joint's dashpots, last step; V of the head's
    normal: ndarray  # (p, 7) N/m, N, N m: sums of k_n (1, x, y, x^2, y^2, x y) over each point joint; m, its reach
