"""Equilibrium by Newton's method in small motion: forces of a trial motion and their tangent.

The motion of b against a at O, u = (d1, d2, dn, r1, r2, rn) in the joint's axes, gives the work-conjugate force
t = (V_1, V_2, -N, M_1, M_2, M_T) of the joint. A trial starts from the memory of the last equilibrium, so it may be
repeated. The tangent dt/du is exact if the family provides it (`joint_families.tangent`), else it is formed by finite
differences, for any law.
"""

from typing import NamedTuple

from numpy import ndarray

from dembrick._jit import entry, jit
from dembrick.kernels.joint.families import FAMILIES, joint_count, joint_of
from dembrick.kernels.math.vectors import NO_MOMENT, put_vector
from dembrick.kernels.statics import joint_families as families
from dembrick.kernels.statics.area_joints import Areas
from dembrick.kernels.statics.block_forces import add_force, add_joint_reaction, apply_guides, clear_forces
from dembrick.kernels.statics.point_joints import Points
from dembrick.kernels.statics.small_displacement import motion_at

UNDAMPED = (0.0, 0.0)


class Trial(NamedTuple):
    """Memory of the last equilibrium, and scratch for the forces and the tangent of a trial."""

    seen_a: ndarray  # (j, 6, 6) maps the motion of block a to that of O in the joint's axes
    seen_b: ndarray  # (j, 6, 6) the same of b
    row: ndarray  # (n,) int64, first row of each block in the equations, -1 if fixed
    reach: ndarray  # (j,) m, greatest distance of a joint from its O
    move: ndarray  # (j,) m, step of the finite differences of the tangent
    stiffness: ndarray  # (j, 6, 6) elastic stiffness of the joints
    drag: ndarray  # (2,) parts of it that resist the motion of the trial: in the forces, in the tangent
    base: ndarray  # (j, 6) m, rad: motion of the joint at the last equilibrium
    points: Points | None  # memory of the contact points then
    areas: Areas | None  # likewise the convex joints
    force: ndarray  # (7, 6) t of the trial and of its six neighbours
    tangent: ndarray  # (j, 6, 6) dt/du
    residual: ndarray  # (6 f,) out-of-balance


@jit
def remember(trial, joints, points, areas):
    """Make the present state the memory from which trials start."""
    for j in range(joints.block_a.size):
        for i in range(6):
            trial.base[j, i] = joints.relative[j, i]
    families.remember(points, areas, trial.points, trial.areas)


@jit
def trial_resultant(points, areas, point_memory, area_memory, family, index, gap, base, u):
    """Resultant (N, V_1, V_2, M_T, M_1, M_2, slip) of a joint for the motion u (6), from the memory."""
    depth = -(u[2] + gap), u[4], -u[3]
    motion = families.recalled_motion(points, areas, point_memory, area_memory, family, index, depth, base, u)
    return families.forces(points, areas, family, index, None, motion, UNDAMPED, None)


@jit
def perturbed(u, i, h):
    """The motion u (6) with h added to its component i."""
    return (
        u[0] + (h if i == 0 else 0.0), u[1] + (h if i == 1 else 0.0), u[2] + (h if i == 2 else 0.0),
        u[3] + (h if i == 3 else 0.0), u[4] + (h if i == 4 else 0.0), u[5] + (h if i == 5 else 0.0),
    )  # fmt: skip


@jit
def try_joint(trial, state, family, index, j, with_tangent):
    """Apply the forces of joint ``j`` for the present motion of its blocks to them; form its tangent if
    ``with_tangent``."""
    blocks = state.blocks
    joints = state.joints
    points = state.points
    areas = state.areas
    a = joints.block_a[j]
    b = joints.block_b[j]
    u = joints.relative[j]
    from_a = trial.seen_a[j]
    from_b = trial.seen_b[j]
    for i in range(6):
        total = 0.0
        for k in range(3):
            total += from_b[i, k] * blocks.displacement[b, k] - from_a[i, k] * blocks.displacement[a, k]
            total += from_b[i, k + 3] * blocks.rotation[b, k] - from_a[i, k + 3] * blocks.rotation[a, k]
        u[i] = total
    base = trial.base[j]
    gap = joints.gap[j]
    tilts = 0.0, u[3] - base[3], u[4] - base[4]
    motion_at(joints, j, (u[2] + gap, u[3], u[4]), tilts, (u[0] - base[0], u[1] - base[1], u[5] - base[5]))
    t = trial.force
    known = with_tangent and families.knows_tangent(points, areas, family, index)
    by_differences = with_tangent and not known
    if by_differences:
        for i in range(6):
            h = trial.move[j] if i < 3 else trial.move[j] / trial.reach[j]
            n, v1, v2, mt, m1, m2, _ = trial_resultant(
                points, areas, trial.points, trial.areas, family, index, gap, base, perturbed(u, i, h)
            )
            put_vector(t[i], v1, v2, -n)
            put_vector(t[i, 3:], m1, m2, mt)
    n, v1, v2, mt, m1, m2, slip = trial_resultant(points, areas, trial.points, trial.areas, family, index, gap, base, u)
    if known:
        families.tangent(points, areas, trial.areas, family, index, n, u[2] + gap, u[3], u[4], trial.tangent[j])
    if by_differences:
        put_vector(t[6], v1, v2, -n)
        put_vector(t[6, 3:], m1, m2, mt)
        for i in range(6):
            h = trial.move[j] if i < 3 else trial.move[j] / trial.reach[j]
            for k in range(6):
                trial.tangent[j, k, i] = (t[i, k] - t[6, k]) / h
    if with_tangent:
        for i in range(6):
            for k in range(6):
                trial.tangent[j, k, i] += trial.drag[1] * trial.stiffness[j, k, i]
    if trial.drag[0] > 0.0:
        for k in range(6):
            total = 0.0
            for i in range(6):
                total += trial.stiffness[j, k, i] * (u[i] - base[i])
            t[6, k] = trial.drag[0] * total
        v1 += t[6, 0]
        v2 += t[6, 1]
        n -= t[6, 2]
        m1 += t[6, 3]
        m2 += t[6, 4]
        mt += t[6, 5]
    add_joint_reaction(blocks, joints, j, n, v1, v2, mt, m1, m2, slip)


@entry
def try_motion(trial, state, v, with_tangent):
    """Compute the out-of-balance of the blocks for their displacements and rotations and the load ``v``; form the
    tangents of the joints if ``with_tangent``."""
    blocks = state.blocks
    actuators = state.actuators
    clear_forces(blocks)
    for family in range(FAMILIES):
        for i in range(joint_count(state.points, state.areas, family)):
            j = joint_of(state.points, state.areas, family, i)
            try_joint(trial, state, family, i, j, with_tangent)
    for i in range(actuators.block.size):
        load = v * actuators.weight[i]
        add_force(blocks, actuators.block[i], load, actuators.direction[i], NO_MOMENT, actuators.arm[i])
    apply_guides(blocks)
    for f in range(blocks.free.size):
        b = blocks.free[f]
        row = trial.row[b]
        for i in range(3):
            trial.residual[row + i] = blocks.force[b, i]
            trial.residual[row + 3 + i] = blocks.torque[b, i]
