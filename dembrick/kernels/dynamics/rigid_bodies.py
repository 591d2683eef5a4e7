"""Rigid blocks of an assembly in free motion: their arrays, and the step of one block.

Central difference: positions and rotations at whole steps, velocities and momenta half a step behind. Rotation of
blocks: `kernels.math.rigid_turns`.
"""

from typing import NamedTuple

from numpy import ndarray

from dembrick._jit import entry, jit
from dembrick.kernels.dynamics.tiles import ACTION, W, combined, dot, four, put_three, three
from dembrick.kernels.math.rigid_turns import SLOW, turn
from dembrick.kernels.math.vectors import axes_of, cross, product, put_vector, three_of


class Bodies(NamedTuple):
    """n blocks. World axes, positions relative to the middle of the scene, so that they keep their digits."""

    free: ndarray  # (f,) uint32, blocks that move
    position: ndarray  # (n, 3) m, centroids now
    rotation: ndarray  # (n, 3, 3) body to world, of the orientation at the last call of `write_rotations`
    orientation: ndarray  # (n, 4) quaternions (w, x, y, z), body to world, now
    velocity: ndarray  # (n, 3) m/s, half a step back
    spin: ndarray  # (n, 3) rad/s, half a step back
    momentum: ndarray  # (n, 3) N m s, angular momentum about the centroid, half a step back
    mass: ndarray  # (n,) kg
    inverse: ndarray  # (n, 3, 3) 1/(kg m2), inverse of the inertia in body axes
    reach: ndarray  # (n,) m, greatest distance of a vertex from the centroid
    start: ndarray  # (n, 3) m, centroids from which displacements count
    applied: ndarray  # (n, 6) N, N m, loads besides gravity
    side_start: ndarray  # (n + 1,) uint32, first entry of each block in `side`
    side: ndarray  # (2 j,) uint32, twice the joint's `Links.place`, plus 1 if the block is its host
    guided: ndarray  # (g,) uint32, free blocks with guides, which fix them in some directions
    held: ndarray  # (g, 6) bool, the fixed directions: along x, y, z, about x, y, z of the world
    guide: ndarray  # (g, 6) N, N m: force and moment of the guides on them, zero in free directions


@jit
def move_support(bodies, b, x, q, v, w):
    """Move a fixed block to its prescribed position at the end of a step: centroid x (3,), orientation q (4,); v and w
    (3,): its mean velocity and spin in the step."""
    for i in range(3):
        bodies.position[b, i] = x[i]
        bodies.velocity[b, i] = v[i]
        bodies.spin[b, i] = w[i]
    for i in range(4):
        bodies.orientation[b, i] = q[i]


@jit
def write_rotation(bodies, b):
    """Write the orientation of block ``b`` as a rotation matrix."""
    q = bodies.orientation[b]
    e1, e2, e3 = axes_of((q[0], q[1], q[2], q[3]))
    R = bodies.rotation[b]
    for i in range(3):
        put_vector(R[i], e1[i], e2[i], e3[i])


@entry
def write_rotations(bodies, supports):
    """Write the orientations of all moving blocks, free ones and ``supports`` (m,), as rotation matrices."""
    for b in bodies.free:
        write_rotation(bodies, b)
    for b in supports:
        write_rotation(bodies, b)


@jit
def turn_body(bodies, b, dt):
    """Rotate block ``b`` through a step under its angular momentum; returns the square of the angle."""
    spin, angle2 = turn(bodies.orientation, b, bodies.inverse[b], three_of(bodies.momentum[b]), dt)
    put_vector(bodies.spin[b], *spin)
    return angle2


@entry
def turn_slowly(work, dt):
    """`turn_body` for the blocks in all lanes of ``work``; valid for those that rotate by no more than `SLOW`."""
    half = 0.5 * dt
    for lane in range(W):
        q = four(work.orientation, lane)
        u, w, m = axes_of(q)
        L = three(work.momentum, lane)
        ixx, ixy, ixz = three(work.inverse, lane)
        iyy, iyz, izz = three(work.inverse[3:], lane)
        l1 = dot(u, L)
        l2 = dot(w, L)
        l3 = dot(m, L)
        # the momentum turns back by half the step's rotation r
        r1 = half * (ixx * l1 + ixy * l2 + ixz * l3)
        r2 = half * (ixy * l1 + iyy * l2 + iyz * l3)
        r3 = half * (ixz * l1 + iyz * l2 + izz * l3)
        c1, c2, c3 = cross(r1, r2, r3, l1, l2, l3)
        d1, d2, d3 = cross(r1, r2, r3, c1, c2, c3)
        angle2 = r1 * r1 + r2 * r2 + r3 * r3
        s = 1.0 - angle2 * (1.0 / 6.0)
        k = 0.5 - angle2 * (1.0 / 24.0)
        l1 += k * d1 - s * c1
        l2 += k * d2 - s * c2
        l3 += k * d3 - s * c3
        w1 = ixx * l1 + ixy * l2 + ixz * l3
        w2 = ixy * l1 + iyy * l2 + iyz * l3
        w3 = ixz * l1 + iyz * l2 + izz * l3
        angle2 = dt * dt * (w1 * w1 + w2 * w2 + w3 * w3)
        s = dt * (0.5 - angle2 * (1.0 / 48.0))
        a0, a1, a2, a3 = product(*q, 1.0 - 0.125 * angle2, s * w1, s * w2, s * w3)
        # normalise by one Newton step: the length is already close to 1
        n = 1.5 - 0.5 * (a0 * a0 + a1 * a1 + a2 * a2 + a3 * a3)
        q = (n * a0, n * a1, n * a2, n * a3)
        for i in range(4):
            work.turned[i, lane] = q[i]
        # a rotation does not change its own axis, so the world spin is the same before and after it
        put_three(work.spin, lane, combined((w1, w2, w3), (0.0, 0.0, 0.0), u, w, m))
        work.angle2[lane] = angle2


@jit
def fetch_block(bodies, b, work, lane):
    """Copy the input of `turn_slowly` for block ``b`` into a lane of ``work``."""
    q = bodies.orientation[b]
    for i in range(4):
        work.orientation[i, lane] = q[i]
    L = bodies.momentum[b]
    put_three(work.momentum, lane, (L[0], L[1], L[2]))
    inverse = bodies.inverse[b]
    put_three(work.inverse, lane, (inverse[0, 0], inverse[0, 1], inverse[0, 2]))
    put_three(work.inverse[3:], lane, (inverse[1, 1], inverse[1, 2], inverse[2, 2]))


@jit
def turn_block(bodies, b, work, lane, dt):
    """Rotate block ``b`` by the result of `turn_slowly` in its lane, or by `turn_body`; returns the square of the
    angle."""
    angle2 = work.angle2[lane]
    if not angle2 <= SLOW * SLOW:
        return turn_body(bodies, b, dt)
    q = bodies.orientation[b]
    for i in range(4):
        q[i] = work.turned[i, lane]
    spin = bodies.spin[b]
    for i in range(3):
        spin[i] = work.spin[i, lane]
    return angle2


@jit
def resisted(f, v, damping):
    """A force reduced by local damping: ``damping`` times its size, against the motion."""
    if v > 0.0:
        return f - damping * abs(f)
    if v < 0.0:
        return f + damping * abs(f)
    return f


@jit
def gathered(bodies, b, wrenches, loaded, g1, g2, g3):
    """Force and couple (6) at the centroid of block ``b``: gravity, applied loads if any block is ``loaded``, and its
    joints in a fixed order."""
    mass = bodies.mass[b]
    f1 = mass * g1
    f2 = mass * g2
    f3 = mass * g3
    t1 = t2 = t3 = 0.0
    if loaded:
        load = bodies.applied[b]
        f1 += load[0]
        f2 += load[1]
        f3 += load[2]
        t1 += load[3]
        t2 += load[4]
        t3 += load[5]
    for k in range(bodies.side_start[b], bodies.side_start[b + 1]):
        side = bodies.side[k]
        hosts = side & 1
        w = (side >> 1) * ACTION
        sign = 2.0 * hosts - 1.0
        about = w + 6 - 3 * hosts
        f1 += sign * wrenches[w]
        f2 += sign * wrenches[w + 1]
        f3 += sign * wrenches[w + 2]
        t1 += wrenches[about]
        t2 += wrenches[about + 1]
        t3 += wrenches[about + 2]
    return f1, f2, f3, t1, t2, t3


@jit
def step_bodies(bodies, wrenches, loaded, share, g, dt, damping, fallen, mean, work):
    """Move the free blocks of a ``share`` (first, last + 1) through a step, under gravity g (3,), loads and joints.

    Every block sums the forces of its joints in a fixed order, so the sums do not depend on the threads. ``loaded``:
    whether there are loads besides gravity on any block. ``damping`` is local damping (dead-load equilibrium only; zero
    in a dynamic run). To ``fallen`` (n,), unless it is None, is added the momentum times ``mean`` (3), the work of
    gravity over the last step. ``work``: a record of `tiles.WORK`. Returns the squares of the longest move of a
    material point of a block in this step and of the longest displacement since the start (m2).
    """
    first, last = share
    moved = away = 0.0
    g1 = g[0]
    g2 = g[1]
    g3 = g[2]
    for begin in range(first, last, W):
        n = min(W, last - begin)
        for lane in range(n):
            b = bodies.free[begin + lane]
            mass = bodies.mass[b]
            f1, f2, f3, t1, t2, t3 = gathered(bodies, b, wrenches, loaded, g1, g2, g3)
            v = bodies.velocity[b]
            L = bodies.momentum[b]
            if damping > 0.0:
                f1 = resisted(f1, v[0], damping)
                f2 = resisted(f2, v[1], damping)
                f3 = resisted(f3, v[2], damping)
                t1 = resisted(t1, L[0], damping)
                t2 = resisted(t2, L[1], damping)
                t3 = resisted(t3, L[2], damping)
            if fallen is not None:
                fallen[b] += mass * (mean[0] * v[0] + mean[1] * v[1] + mean[2] * v[2])
            h = dt / mass
            v1 = v[0] + h * f1
            v2 = v[1] + h * f2
            v3 = v[2] + h * f3
            put_vector(v, v1, v2, v3)
            L[0] += dt * t1
            L[1] += dt * t2
            L[2] += dt * t3
            x = bodies.position[b]
            x[0] += dt * v1
            x[1] += dt * v2
            x[2] += dt * v3
            fetch_block(bodies, b, work, lane)
        turn_slowly(work, dt)
        for lane in range(n):
            b = bodies.free[begin + lane]
            angle2 = turn_block(bodies, b, work, lane, dt)
            v = bodies.velocity[b]
            x = bodies.position[b]
            reach = bodies.reach[b]
            step2 = 2.0 * (dt * dt * (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]) + angle2 * reach * reach)
            if step2 > moved or step2 != step2:  # NaN stays
                moved = step2
            s = bodies.start[b]
            d1 = x[0] - s[0]
            d2 = x[1] - s[1]
            d3 = x[2] - s[2]
            away = max(away, d1 * d1 + d2 * d2 + d3 * d3)
    return moved, away
