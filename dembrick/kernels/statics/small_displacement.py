"""Small motion: the geometry stays that of the start, displacements and rotation vectors are infinitesimal.

It gives the limit load of the undeformed structure. Relative motions are computed from the total displacements, so
errors do not accumulate.
"""

from dembrick._jit import jit
from dembrick.kernels.joint.geometry import Motion
from dembrick.kernels.math.multifrontal import solve_rounded_in_place
from dembrick.kernels.math.vectors import cross, put_vector, rows_times


@jit
def motion_at(joints, j, opening, opened, slip):
    """The `Motion` of joint ``j`` from its opening at O and tilts (dn, r1, r2), their growth ``opened`` in the step and
    its slip twist; stores all of them."""
    dn, r1, r2 = opening
    pn, pr1, pr2 = opened
    put_vector(joints.opening[j], dn, r1, r2)
    joints.tilt[j, 0] = pr1
    joints.tilt[j, 1] = pr2
    put_vector(joints.step[j], slip[0], slip[1], slip[2])
    return Motion((-dn, r2, -r1), (-pn, pr2, -pr1), slip)


@jit
def small_relative(blocks, joints, j):
    """The `Motion` of joint ``j`` from the displacements of its blocks; stores it."""
    a = joints.block_a[j]
    b = joints.block_b[j]
    axes = joints.axes[j]
    u = blocks.displacement
    r = blocks.rotation
    ca1, ca2, ca3 = cross(r[a, 0], r[a, 1], r[a, 2], joints.arm_a[j, 0], joints.arm_a[j, 1], joints.arm_a[j, 2])
    cb1, cb2, cb3 = cross(r[b, 0], r[b, 1], r[b, 2], joints.arm_b[j, 0], joints.arm_b[j, 1], joints.arm_b[j, 2])
    d1, d2, dn = rows_times(
        axes, u[b, 0] - u[a, 0] + cb1 - ca1, u[b, 1] - u[a, 1] + cb2 - ca2, u[b, 2] - u[a, 2] + cb3 - ca3
    )
    r1, r2, rn = rows_times(axes, r[b, 0] - r[a, 0], r[b, 1] - r[a, 1], r[b, 2] - r[a, 2])
    old = joints.relative[j]
    p1 = d1 - old[0]
    p2 = d2 - old[1]
    pn = dn - old[2]
    pr1 = r1 - old[3]
    pr2 = r2 - old[4]
    pr = rn - old[5]
    put_vector(old, d1, d2, dn)
    put_vector(old[3:], r1, r2, rn)
    dn += joints.gap[j]
    return motion_at(joints, j, (dn, r1, r2), (pn, pr1, pr2), (p1, p2, pr))


@jit
def small_actuator(blocks, actuators, i):
    """Displacement of the loaded point of actuator ``i`` along its direction since the start (m)."""
    b = actuators.block[i]
    u = blocks.displacement
    r = blocks.rotation
    c1, c2, c3 = cross(r[b, 0], r[b, 1], r[b, 2], actuators.arm[i, 0], actuators.arm[i, 1], actuators.arm[i, 2])
    d = actuators.direction
    return (u[b, 0] + c1) * d[i, 0] + (u[b, 1] + c2) * d[i, 1] + (u[b, 2] + c3) * d[i, 2]


@jit
def accelerate_together(blocks, whole, dt):
    """Change the velocities of all free blocks by dt M^-1 force, M the inertia of the whole assembly."""
    x = whole.work[0]
    for f in range(blocks.free.size):
        b = blocks.free[f]
        row = whole.place[f]
        for i in range(3):
            x[row + i] = blocks.force[b, i]
            x[row + 3 + i] = blocks.torque[b, i]
    solve_rounded_in_place(whole.rounded, x)
    for f in range(blocks.free.size):
        b = blocks.free[f]
        row = whole.place[f]
        for i in range(3):
            blocks.velocity[b, i] += dt * x[row + i]
            blocks.spin[b, i] += dt * x[row + 3 + i]


@jit
def accelerate_alone(blocks, inverse, dt):
    """Change the velocity of every free block by dt M^-1 force, M its own 6 x 6 inertia."""
    for f in range(blocks.free.size):
        b = blocks.free[f]
        m = inverse[b]
        for i in range(3):
            a = w = 0.0
            for k in range(3):
                a += m[i, k] * blocks.force[b, k] + m[i, k + 3] * blocks.torque[b, k]
                w += m[i + 3, k] * blocks.force[b, k] + m[i + 3, k + 3] * blocks.torque[b, k]
            blocks.velocity[b, i] += dt * a
            blocks.spin[b, i] += dt * w


@jit
def accelerate(blocks, inverse, whole, dt):
    """Central difference of the velocities with the artificial inertia, that of the whole assembly if it is given."""
    if whole is not None:
        accelerate_together(blocks, whole, dt)
    else:
        accelerate_alone(blocks, inverse, dt)


@jit
def damping_loss(blocks, b, matrix, dt, damping):
    """Energy (J) that damping takes from block ``b``, whose velocity u is not yet damped.

    The impulse of the damping, -c M w with w = u - mean, does work on the motion before and after it, as a force does
    by the trapezoidal rule: c (w . M (2 u - c w) - dt w . force) / 2.
    """
    u = blocks.velocity[b]
    r = blocks.spin[b]
    mean = blocks.mean_velocity[b]
    lost = 0.0
    for i in range(3):
        w = u[i] - mean[i]
        turn = r[i] - mean[i + 3]
        lost -= dt * (w * blocks.force[b, i] + turn * blocks.torque[b, i])
        for k in range(3):
            v = 2.0 * u[k] - damping * (u[k] - mean[k])
            spin = 2.0 * r[k] - damping * (r[k] - mean[k + 3])
            lost += w * (matrix[i, k] * v + matrix[i, k + 3] * spin)
            lost += turn * (matrix[i + 3, k] * v + matrix[i + 3, k + 3] * spin)
    return 0.5 * damping * lost


@jit
def small_step(blocks, inertia, dt, damping, mean_weight, energy):
    """Central difference with the artificial inertia of the free blocks. Returns the longest move (m).

    ``damping`` is the part removed from the fluctuation of a block's velocity about its running mean, in which the
    latest step has the weight ``mean_weight``: oscillations are damped, steady motion is not. The energy removed is
    added to the energy terms.
    """
    longest = 0.0
    mean = blocks.mean_velocity
    accelerate(blocks, inertia.inverse, inertia.whole, dt)
    for f in range(blocks.free.size):
        b = blocks.free[f]
        if damping > 0.0:
            if energy is not None:
                energy.work[0].damping += damping_loss(blocks, b, inertia.matrix[b], dt, damping)
            for i in range(3):
                blocks.velocity[b, i] -= damping * (blocks.velocity[b, i] - mean[b, i])
                blocks.spin[b, i] -= damping * (blocks.spin[b, i] - mean[b, i + 3])
                mean[b, i] += mean_weight * (blocks.velocity[b, i] - mean[b, i])
                mean[b, i + 3] += mean_weight * (blocks.spin[b, i] - mean[b, i + 3])
        for i in range(3):
            blocks.displacement[b, i] += dt * blocks.velocity[b, i]
            blocks.rotation[b, i] += dt * blocks.spin[b, i]
            move = abs(dt * blocks.velocity[b, i])
            if move > longest or move != move:
                longest = move
    return longest
