"""All forces on the blocks at an instant: dead loads, joints, actuators.

``inertia`` selects the motion: with physical inertia (not None) the geometry follows the blocks, without it, in small
motion, it stays that of the start.
"""

from math import isnan, nan, sqrt

from dembrick._jit import jit
from dembrick.kernels.joint.families import FAMILIES, joint_count, joint_of
from dembrick.kernels.joint.ties import tie_force
from dembrick.kernels.math.vectors import NO_MOMENT, columns_times, cross, put_vector
from dembrick.kernels.statics import joint_families as families
from dembrick.kernels.statics.finite_rotation import finite_actuator, finite_relative
from dembrick.kernels.statics.small_displacement import small_actuator, small_relative


@jit
def clear_forces(blocks):
    """Start the out-of-balance of the free blocks from the dead loads."""
    for f in range(blocks.free.size):
        b = blocks.free[f]
        for i in range(3):
            blocks.force[b, i] = blocks.dead_force[b, i]
            blocks.torque[b, i] = blocks.dead_torque[b, i]


@jit
def add_force(blocks, b, sign, f, m, r):
    """Add ``sign`` times a force f at the arm r from the centroid of ``b``, and a moment m, to its out-of-balance."""
    c1, c2, c3 = cross(r[0], r[1], r[2], f[0], f[1], f[2])
    blocks.force[b, 0] += sign * f[0]
    blocks.force[b, 1] += sign * f[1]
    blocks.force[b, 2] += sign * f[2]
    blocks.torque[b, 0] += sign * (m[0] + c1)
    blocks.torque[b, 1] += sign * (m[1] + c2)
    blocks.torque[b, 2] += sign * (m[2] + c3)


@jit
def add_joint_reaction(blocks, joints, j, n, v1, v2, mt, m1, m2, slip):
    """Store the resultant of joint ``j``; add its reaction (-V_1, -V_2, +N; -M_1, -M_2, -M_T) to b, minus it to a."""
    resultant = joints.resultant[j]
    put_vector(resultant, n, v1, v2)
    put_vector(resultant[3:], mt, m1, m2)
    resultant[6] = slip
    axes = joints.axes[j]
    force = columns_times(axes, -v1, -v2, n)
    moment = columns_times(axes, -m1, -m2, -mt)
    add_force(blocks, joints.block_b[j], 1.0, force, moment, joints.arm_b[j])
    add_force(blocks, joints.block_a[j], -1.0, force, moment, joints.arm_a[j])


@jit
def relative(blocks, joints, j, inertia, dt):
    """The `Motion` of joint ``j``."""
    if inertia is not None:
        return finite_relative(blocks, joints, j, dt)
    else:
        return small_relative(blocks, joints, j)


@jit
def joint_forces(state, inertia, dt, viscous, energy):
    """Add the forces of all joints to the blocks; their dashpots: ``viscous`` (2) times the joint's own ``damping``."""
    blocks = state.blocks
    joints = state.joints
    points = state.points
    areas = state.areas
    for family in range(FAMILIES):
        for i in range(joint_count(points, areas, family)):
            j = joint_of(points, areas, family, i)
            motion = relative(blocks, joints, j, inertia, dt)
            more = joints.damping[j]
            own = more * viscous[0], more * viscous[1]
            found = families.forces(points, areas, family, i, joints.resultant[j], motion, own, energy)
            add_joint_reaction(blocks, joints, j, *found)


@jit
def apply_guides(blocks):
    """Once all forces act, assign the out-of-balance of guided blocks in their fixed directions to the guides."""
    for g in range(blocks.guided.size):
        b = blocks.guided[g]
        for i in range(3):
            for vector, k in ((blocks.force, i), (blocks.torque, i + 3)):
                blocks.guide[g, k] = 0.0
                if blocks.held[g, k]:
                    blocks.guide[g, k] = -vector[b, i]
                    vector[b, i] = 0.0


@jit
def tie_forces(ties, blocks):
    """Add the forces of all ties in the moving geometry to the blocks; ``ties`` may be None."""
    if ties is not None:
        pull_ties(ties, blocks)


@jit
def pull_ties(ties, blocks):
    """`tie_forces` if there are ties."""
    u = blocks.displacement
    for t in range(ties.stiffness.size):
        a = ties.block[t, 0]
        b = ties.block[t, 1]
        offset = ties.offset[t]
        away = (
            offset[0] + u[b, 0] - u[a, 0],
            offset[1] + u[b, 1] - u[a, 1],
            offset[2] + u[b, 2] - u[a, 2],
        )
        tie_force(ties, t, blocks.orientation, away, False)
        for side in range(2):
            add_force(blocks, ties.block[t, side], 1.0 - 2.0 * side, ties.force[t], NO_MOMENT, ties.arm[t, side])


@jit
def actuator_forces(blocks, actuators, drive, inertia, rate, dt, energy):
    """Move the actuator head by one step at ``rate``, and add V weight_i, by its spring and dashpot, to the blocks.

    Returns V and the work-conjugate motion f.q of the last step.
    """
    driven = total = 0.0
    for i in range(actuators.block.size):
        if inertia is not None:
            u = finite_actuator(blocks, actuators, i)
        else:
            u = small_actuator(blocks, actuators, i)
        u -= actuators.zero[i]
        actuators.displacement[i] = u
        driven += actuators.weight[i] * u
        total += abs(actuators.weight[i])
    driven /= total
    now = actuators.driven[0]
    now.head += rate * dt
    dash = drive.dashpot * (rate - (driven - now.displacement) / dt)
    v = drive.stiffness * (now.head - driven) + dash
    if energy is not None:
        head = rate * dt * total
        last = energy.dash[energy.dash.shape[0] - 1]
        energy.work[0].head += 0.5 * (now.load + v) * head
        energy.work[0].actuator_damping += 0.5 * (last[0] + dash) * (head - (driven - now.displacement) * total)
        last[0] = dash
    moved = (driven - now.displacement) * total
    now.displacement = driven
    now.load = v
    for i in range(actuators.block.size):
        load = v * actuators.weight[i]
        add_force(blocks, actuators.block[i], load, actuators.direction[i], NO_MOMENT, actuators.arm[i])
    return v, moved


@jit
def unbalanced_ratio(blocks, joints):
    """Greatest out-of-balance force or moment on a free block over the greatest joint force.

    A moment counts as the force that makes it at the longest lever between a centroid and a joint. NaN if any force is
    NaN, which a maximum would hide.
    """
    force = moment = total = 0.0
    for i in range(blocks.free.size):
        b = blocks.free[i]
        f = blocks.force[b, 0] ** 2 + blocks.force[b, 1] ** 2 + blocks.force[b, 2] ** 2
        m = blocks.torque[b, 0] ** 2 + blocks.torque[b, 1] ** 2 + blocks.torque[b, 2] ** 2
        force, moment, total = max(force, f), max(moment, m), total + f + m
    largest = lever = 0.0
    for j in range(joints.block_a.size):
        r = joints.resultant[j]
        largest = max(largest, r[0] ** 2 + r[1] ** 2 + r[2] ** 2)
        for arm in (joints.arm_a[j], joints.arm_b[j]):
            lever = max(lever, arm[0] ** 2 + arm[1] ** 2 + arm[2] ** 2)
    worst = max(force, moment / lever) if lever > 0.0 else force
    if isnan(total):
        return nan
    return sqrt(worst / largest) if largest > 0.0 else 1.0
