"""Finite motion: blocks rotate by quaternions, joints move with them, inertia is physical.

The polygon of a joint moves with its host; the other block provides the plane, and its normal is the joint's. The slope
of the host's face against that plane gives the tilts: the penetration follows from total displacements, and errors do
not accumulate. The slope is taken to be small against one (the faces face each other); rotation about the normal is not
limited.
"""

from math import sqrt

from dembrick._jit import jit
from dembrick.kernels.math.rigid_turns import guided_momentum, turn
from dembrick.kernels.math.vectors import cross, put_vector, rotate, three_of
from dembrick.kernels.statics.small_displacement import motion_at


@jit
def finite_relative(blocks, joints, j, dt):
    """Motion of joint ``j``, as `small_displacement.small_relative`; updates its axes and arms."""
    a = joints.block_a[j]
    b = joints.block_b[j]
    q = blocks.orientation
    u = blocks.displacement
    v = blocks.velocity
    w = blocks.spin
    la = joints.lever_a
    lb = joints.lever_b
    ra1, ra2, ra3 = rotate(q, a, la[j, 0], la[j, 1], la[j, 2])
    rb1, rb2, rb3 = rotate(q, b, lb[j, 0], lb[j, 1], lb[j, 2])
    # from the point O of a to the point O of b
    offset = joints.offset
    s1 = offset[j, 0] + u[b, 0] - u[a, 0] + rb1 - ra1
    s2 = offset[j, 1] + u[b, 1] - u[a, 1] + rb2 - ra2
    s3 = offset[j, 2] + u[b, 2] - u[a, 2] + rb3 - ra3
    if joints.host[j] > 0:
        side = 1.0
        host = b
        on_host = joints.axes_b
        other = a
        on_other = joints.axes_a
        ra1 += s1
        ra2 += s2
        ra3 += s3
    else:
        side = -1.0
        host = a
        on_host = joints.axes_a
        other = b
        on_other = joints.axes_b
        rb1 -= s1
        rb2 -= s2
        rb3 -= s3
    n1, n2, n3 = rotate(q, other, on_other[j, 2, 0], on_other[j, 2, 1], on_other[j, 2, 2])
    e1, e2, e3 = rotate(q, host, on_host[j, 0, 0], on_host[j, 0, 1], on_host[j, 0, 2])
    f1, f2, f3 = rotate(q, host, on_host[j, 1, 0], on_host[j, 1, 1], on_host[j, 1, 2])
    slope_1 = e1 * n1 + e2 * n2 + e3 * n3
    slope_2 = f1 * n1 + f2 * n2 + f3 * n3
    t1 = e1 - slope_1 * n1
    t2 = e2 - slope_1 * n2
    t3 = e3 - slope_1 * n3
    scale = 1.0 / sqrt(t1 * t1 + t2 * t2 + t3 * t3)
    t1 *= scale
    t2 *= scale
    t3 *= scale
    z1, z2, z3 = cross(n1, n2, n3, t1, t2, t3)
    # velocity of b against a at the host's O
    a1, a2, a3 = cross(w[a, 0], w[a, 1], w[a, 2], ra1, ra2, ra3)
    b1, b2, b3 = cross(w[b, 0], w[b, 1], w[b, 2], rb1, rb2, rb3)
    v1 = dt * (v[b, 0] - v[a, 0] + b1 - a1)
    v2 = dt * (v[b, 1] - v[a, 1] + b2 - a2)
    v3 = dt * (v[b, 2] - v[a, 2] + b3 - a3)
    w1 = dt * (w[b, 0] - w[a, 0])
    w2 = dt * (w[b, 1] - w[a, 1])
    w3 = dt * (w[b, 2] - w[a, 2])
    dn = s1 * n1 + s2 * n2 + s3 * n3
    p1 = v1 * t1 + v2 * t2 + v3 * t3
    p2 = v1 * z1 + v2 * z2 + v3 * z3
    pn = v1 * n1 + v2 * n2 + v3 * n3
    pr1 = w1 * t1 + w2 * t2 + w3 * t3
    pr2 = w1 * z1 + w2 * z2 + w3 * z3
    pr = w1 * n1 + w2 * n2 + w3 * n3
    axes = joints.axes[j]
    put_vector(axes[0], t1, t2, t3)
    put_vector(axes[1], z1, z2, z3)
    put_vector(axes[2], n1, n2, n3)
    put_vector(joints.arm_a[j], ra1, ra2, ra3)
    put_vector(joints.arm_b[j], rb1, rb2, rb3)
    dn += joints.gap[j]
    r1 = side * slope_2
    r2 = -side * slope_1
    return motion_at(joints, j, (dn, r1, r2), (pn, pr1, pr2), (p1, p2, pr))


@jit
def finite_actuator(blocks, actuators, i):
    """Displacement of the loaded point of actuator ``i`` along its direction since the start (m); updates its arm."""
    b = actuators.block[i]
    u = blocks.displacement
    lever = actuators.lever
    r1, r2, r3 = rotate(blocks.orientation, b, lever[i, 0], lever[i, 1], lever[i, 2])
    put_vector(actuators.arm[i], r1, r2, r3)
    s = actuators.start
    d = actuators.direction
    return (u[b, 0] + r1 - s[i, 0]) * d[i, 0] + (u[b, 1] + r2 - s[i, 1]) * d[i, 1] + (u[b, 2] + r3 - s[i, 2]) * d[i, 2]


@jit
def finite_step(blocks, inertia, dt):
    """Central difference of the centroids, rotation at constant angular momentum. Returns the longest move (m)."""
    longest = 0.0
    for f in range(blocks.free.size):
        b = blocks.free[f]
        mass = inertia.mass[b]
        for i in range(3):
            blocks.velocity[b, i] += dt * blocks.force[b, i] / mass
            blocks.momentum[b, i] += dt * blocks.torque[b, i]
            blocks.displacement[b, i] += dt * blocks.velocity[b, i]
            move = abs(dt * blocks.velocity[b, i])
            if move > longest or move != move:
                longest = move
    q = blocks.orientation
    for g in range(blocks.guided.size):
        b = blocks.guided[g]
        held = blocks.held[g, 3:]
        change = guided_momentum(q, b, inertia.inverse[b], held, three_of(blocks.momentum[b]), dt)
        for i in range(3):
            blocks.momentum[b, i] += change[i]
            blocks.guide[g, i + 3] += change[i] / dt
    for f in range(blocks.free.size):
        b = blocks.free[f]
        spin, _ = turn(q, b, inertia.inverse[b], three_of(blocks.momentum[b]), dt)
        put_vector(blocks.spin[b], *spin)
    return longest
