"""Forces of contacts that form anew, one for each pair of convex parts that overlap (`patches`).

Pressure: 2 kn times the penetration, plus a dashpot of stated ratio that sees the closing of the last step, never
negative. Friction: one elastic force in the plane square to the mean normal, and one torsion about it, at the centre of
pressure; stiffness ks A and ks J of the patches, strength on the exact limit surface of the pressure there is
(`rubbing`). What a contact remembers turns with both blocks and stays square to the normal; where patches shrink it
shrinks with their stiffness, so that no loop of loads gives energy back that was not put in. It is forgotten where the
overlap ends.

A pair that has a joint is handed over (`handing_over`): the new contact counts by its weight, the joint by the rest.
"""

from math import sqrt
from typing import NamedTuple

from numpy import ndarray

from dembrick._jit import entry, jit
from dembrick.kernels.handing_over import GROWTH, hand_over
from dembrick.kernels.moving_joints import met
from dembrick.kernels.patches import Parts, Scratch, contact_surface, flat_sums, lies_apart, positive_part
from dembrick.kernels.rubbing import flatten, rub, share_pressure
from dembrick.kernels.vec3 import columns_times, cross, rows_times
from dembrick.state import Pressed

TOUCHED, DEEP, CROWDED = 0, 11, 12  # apart from the loop's own states
DEEPEST = 0.25  # of the thinner part's inner radius: a deeper penetration ends the run


class Touching(NamedTuple):
    """t pairs of parts that are near each other and have no joint, or one that is handed over."""

    parts: Parts
    scratch: Scratch
    pressed: Pressed  # scratch: how one contact is pressed, seen from its centre of pressure, `kernels.rubbing`
    free: ndarray  # (n,) 1 for blocks that move, 0 for fixed ones
    first: ndarray  # (t,) int64, part A
    second: ndarray  # (t,) int64, part B
    joint: ndarray  # (t,) int64, their joint, or -1
    k_n: ndarray  # (t,) Pa/m
    k_s: ndarray  # (t,) Pa/m
    friction: ndarray  # (t,)
    weight: ndarray  # (t,) share of the new contact: 1 where there is no joint
    size: ndarray  # (t,) m, greatest distance of the joint's polygon from its centroid at the start
    partial: ndarray  # (t,) whether that polygon is less than the face that it rides on
    start: ndarray  # (j, 9) `Links.seen` at the start, of all joints
    shift: ndarray  # (j, 2) m, where their O is now on the host, from where it was then
    plane: ndarray  # (t,) int64, the face that kept the parts apart last, those of B after those of A; -1: none
    elastic: ndarray  # (t, 4) N, N m: elastic shear force on A (world), torsion on A about the normal from A to B
    stiffness: ndarray  # (t, 2) N/m, N m: shear and torsion stiffness that these came with
    twist: ndarray  # (t, 3) m, m, rad: plastic twist of the last plastic step, in the axes of the contact
    slip: ndarray  # (t,) m, length of the slip path at the centre of pressure
    normal: ndarray  # (t,) N, normal force
    area: ndarray  # (t,) m2, of the patches
    point: ndarray  # (t, 3) m, centre of pressure, world
    axis: ndarray  # (t, 3) mean normal there, from A to B, world
    force: ndarray  # (t, 3) N, on B, world
    torque: ndarray  # (t, 3) N m, on B about that point, world
    dashpot: ndarray  # (9,) dashpot over spring, times w, as a polynomial in the swing w (rad) of a step; greatest w
    room: ndarray  # (1,) m, how far blocks may still move until pairs must be looked for again
    trouble: ndarray  # (1,) int64, the pair that ended the run


@jit
def clear_applied(touching, bodies):
    """Nothing on the blocks that may touch, before loads and contacts of a step are put on them."""
    owner = touching.parts.owner
    for t in range(touching.first.size):
        for i in range(6):
            bodies.applied[owner[touching.first[t]], i] = 0.0
            bodies.applied[owner[touching.second[t]], i] = 0.0


@jit
def give(bodies, b, sense, force, torque, r1, r2, r3):
    """Put ``sense`` times a force and a couple, at r from the centroid of block ``b``, on it."""
    t1, t2, t3 = cross(r1, r2, r3, force[0], force[1], force[2])
    load = bodies.applied[b]
    load[0] += sense * force[0]
    load[1] += sense * force[1]
    load[2] += sense * force[2]
    load[3] += sense * (t1 + torque[0])
    load[4] += sense * (t2 + torque[1])
    load[5] += sense * (t3 + torque[2])


@jit
def lightness(touching, bodies, b, r1, r2, r3, n1, n2, n3):
    """Velocity along n that a unit impulse along n gives the point of block ``b`` at r from its centroid (1/kg)."""
    R = bodies.rotation[b]
    c1, c2, c3 = cross(r1, r2, r3, n1, n2, n3)
    c1, c2, c3 = columns_times(R, c1, c2, c3)
    d1, d2, d3 = rows_times(bodies.inverse[b], c1, c2, c3)
    return touching.free[b] * (1.0 / bodies.mass[b] + c1 * d1 + c2 * d2 + c3 * d3)


@jit
def stepped_dashpot(polynomial, swing):
    """Dashpot over spring for a contact that swings by ``swing`` (rad) in a step: `frequencies.stepped_dashpots`."""
    if not swing > 0.0:
        return 0.0
    swing = min(swing, polynomial[8])
    value = polynomial[7]
    for k in range(6, -1, -1):
        value = value * swing + polynomial[k]
    return value / swing


@jit
def rest(touching, t):
    """No force, and nothing remembered."""
    touching.normal[t] = 0.0
    touching.area[t] = 0.0
    for i in range(3):
        touching.force[t, i] = 0.0
        touching.torque[t, i] = 0.0
        touching.twist[t, i] = 0.0
    for i in range(4):
        touching.elastic[t, i] = 0.0
    touching.stiffness[t, 0] = 0.0
    touching.stiffness[t, 1] = 0.0


@jit
def sum_patches(scratch, patches):
    """Area and integrals of the penetration D of every patch into `sums`; returns the sums over all of the area, of D
    and of D times the normal (3)."""
    area = total = e1 = e2 = e3 = 0.0
    for p in range(patches):
        first = scratch.start[p]
        last = scratch.start[p + 1]
        g = scratch.depth[p]
        sums = scratch.sums[p]
        sums[0], _, _, sums[4] = flat_sums(scratch.x, scratch.y, first, last)
        sums[1], sums[2], sums[3] = positive_part(scratch.x, scratch.y, first, last, g[0], g[1], g[2])
        F = scratch.frame[p]
        area += sums[0]
        total += sums[1]
        e1 += sums[1] * F[2, 0]
        e2 += sums[1] * F[2, 1]
        e3 += sums[1] * F[2, 2]
    return area, total, e1, e2, e3


@jit
def tangent(e1, e2, e3):
    """A unit vector square to the unit vector e, which follows it smoothly while it stays about where it is."""
    if abs(e1) < 0.8:
        t1, t2, t3 = cross(e1, e2, e3, 1.0, 0.0, 0.0)
    else:
        t1, t2, t3 = cross(e1, e2, e3, 0.0, 1.0, 0.0)
    scale = 1.0 / sqrt(t1 * t1 + t2 * t2 + t3 * t3)
    return scale * t1, scale * t2, scale * t3


@jit
def press(touching, bodies, t, patches, dt, x1, x2, x3, y1, y2, y3):
    """Normal pressure and friction of the patches in scratch, as `force`, `torque` and `point` of pair ``t``.

    x, y: their origin from the centroids of the blocks of A and B, world.
    """
    scratch = touching.scratch
    area, total, e1, e2, e3 = sum_patches(scratch, patches)
    size = sqrt(e1 * e1 + e2 * e2 + e3 * e3)
    if not (total > 0.0 and size > 0.0):
        rest(touching, t)
        return
    a = touching.parts.owner[touching.first[t]]
    b = touching.parts.owner[touching.second[t]]
    R = bodies.rotation[a]
    # mean normal and centre of pressure, in A's axes and in the world's
    e1 /= size
    e2 /= size
    e3 /= size
    whole, c1, c2, c3 = share_pressure(scratch, patches, e1, e2, e3, size)
    n1, n2, n3 = rows_times(R, e1, e2, e3)
    d1, d2, d3 = rows_times(R, c1, c2, c3)
    # dashpot: the stated ratio for the mass that is felt there and the stiffness that there is now
    k_n = touching.weight[t] * touching.k_n[t]
    k_s = touching.weight[t] * touching.k_s[t]
    stiff = polar = 0.0
    for p in range(patches):
        F = scratch.frame[p]
        sums = scratch.sums[p]
        along = F[2, 0] * e1 + F[2, 1] * e2 + F[2, 2] * e3
        stiff += sums[0] * scratch.depth[p, 3] * along * along
        # polar moment of the area, from the centre of pressure
        g1 = c1 - F[0, 3]
        g2 = c2 - F[1, 3]
        g3 = c3 - F[2, 3]
        u = g1 * F[0, 0] + g2 * F[0, 1] + g3 * F[0, 2]
        v = g1 * F[1, 0] + g2 * F[1, 1] + g3 * F[1, 2]
        _, mu, mv, _ = flat_sums(scratch.x, scratch.y, scratch.start[p], scratch.start[p + 1])
        polar += max(0.0, sums[4] - 2.0 * (u * mu + v * mv) + sums[0] * (u * u + v * v))
    felt = lightness(touching, bodies, a, x1 + d1, x2 + d2, x3 + d3, n1, n2, n3)
    felt += lightness(touching, bodies, b, y1 + d1, y2 + d2, y3 + d3, n1, n2, n3)
    viscous = stepped_dashpot(touching.dashpot, sqrt(felt * k_n * stiff) * dt)
    # what the last step brought the blocks nearer: a linear field, in A's axes at the patches' origin
    va = bodies.velocity[a]
    vb = bodies.velocity[b]
    wa = bodies.spin[a]
    wb = bodies.spin[b]
    p1, p2, p3 = cross(wa[0], wa[1], wa[2], x1, x2, x3)
    q1, q2, q3 = cross(wb[0], wb[1], wb[2], y1, y2, y3)
    v1, v2, v3 = columns_times(
        R, dt * (vb[0] + q1 - va[0] - p1), dt * (vb[1] + q2 - va[1] - p2), dt * (vb[2] + q3 - va[2] - p3)
    )
    w1, w2, w3 = columns_times(R, dt * (wb[0] - wa[0]), dt * (wb[1] - wa[1]), dt * (wb[2] - wa[2]))
    f1 = f2 = f3 = m1 = m2 = m3 = 0.0
    for p in range(patches):
        F = scratch.frame[p]
        g = scratch.depth[p]
        first = scratch.start[p]
        last = scratch.start[p + 1]
        h1, h2, h3 = cross(w1, w2, w3, F[0, 3], F[1, 3], F[2, 3])
        closing = -((v1 + h1) * F[2, 0] + (v2 + h2) * F[2, 1] + (v3 + h3) * F[2, 2])
        h1, h2, h3 = cross(F[2, 0], F[2, 1], F[2, 2], w1, w2, w3)
        # penetration in all and its growth in the step, from the patch's origin
        g0 = 2.0 * g[0]
        gx = 2.0 * g[1]
        gy = 2.0 * g[2]
        d0 = g[3] * closing
        dx = -g[3] * (h1 * F[0, 0] + h2 * F[0, 1] + h3 * F[0, 2])
        dy = -g[3] * (h1 * F[1, 0] + h2 * F[1, 1] + h3 * F[1, 2])
        before = -1e300
        for k in range(first, last):
            before = max(before, g0 - d0 + (gx - dx) * scratch.x[k] + (gy - dy) * scratch.y[k])
        if before <= 0.0:  # it was open a step ago: see `moving_joints.met`
            force, about_x, about_y = positive_part(
                scratch.x, scratch.y, first, last, g0 + met(g0, viscous * d0, viscous),
                gx + met(gx, viscous * dx, viscous), gy + met(gy, viscous * dy, viscous),
            )  # fmt: skip
        else:
            force, about_x, about_y = positive_part(
                scratch.x, scratch.y, first, last, g0 + viscous * d0, gx + viscous * dx, gy + viscous * dy
            )
        force *= k_n
        f1 += force * F[2, 0]
        f2 += force * F[2, 1]
        f3 += force * F[2, 2]
        # force times point, about the centre of pressure
        s1 = force * (F[0, 3] - c1) + k_n * (about_x * F[0, 0] + about_y * F[1, 0])
        s2 = force * (F[1, 3] - c2) + k_n * (about_x * F[0, 1] + about_y * F[1, 1])
        s3 = force * (F[2, 3] - c3) + k_n * (about_x * F[0, 2] + about_y * F[1, 2])
        h1, h2, h3 = cross(s1, s2, s3, F[2, 0], F[2, 1], F[2, 2])
        m1 += h1
        m2 += h2
        m3 += h3
    normal = sqrt(f1 * f1 + f2 * f2 + f3 * f3)
    f1, f2, f3 = rows_times(R, f1, f2, f3)
    m1, m2, m3 = rows_times(R, m1, m2, m3)
    t1, t2, t3 = tangent(e1, e2, e3)
    wide = flatten(touching.pressed, scratch, patches, whole, c1, c2, c3, e1, e2, e3, t1, t2, t3)
    t1, t2, t3 = rows_times(R, t1, t2, t3)
    s1, s2, s3, turn = rub(
        touching, bodies, t, a, b, dt, normal, wide, k_s * area, k_s * polar, 1.0 + viscous,
        n1, n2, n3, t1, t2, t3, x1 + d1, x2 + d2, x3 + d3, y1 + d1, y2 + d2, y3 + d3,
    )  # fmt: skip
    # friction is what acts on A
    touching.normal[t] = normal
    touching.area[t] = area
    force = touching.force[t]
    force[0] = f1 - s1
    force[1] = f2 - s2
    force[2] = f3 - s3
    torque = touching.torque[t]
    torque[0] = m1 - turn * n1
    torque[1] = m2 - turn * n2
    torque[2] = m3 - turn * n3
    point = touching.point[t]
    point[0] = bodies.position[a, 0] + x1 + d1
    point[1] = bodies.position[a, 1] + x2 + d2
    point[2] = bodies.position[a, 2] + x3 + d3
    axis = touching.axis[t]
    axis[0] = n1
    axis[1] = n2
    axis[2] = n3
    give(bodies, a, -1.0, force, torque, x1 + d1, x2 + d2, x3 + d3)
    give(bodies, b, 1.0, force, torque, y1 + d1, y2 + d2, y3 + d3)


@entry
def touch(touching, links, bodies, dt):
    """Put the forces of all new contacts on their blocks, in the order of the pairs.

    Returns TOUCHED; DEEP where parts overlap by more than `DEEPEST`; CROWDED where scratch has no room for a contact
    surface; `trouble` is the pair then.
    """
    parts = touching.parts
    for t in range(touching.first.size):
        is_open = parted = False
        if touching.joint[t] >= 0:
            is_open, parted = hand_over(touching, links, t)
            if touching.weight[t] <= 0.0 and not is_open:
                continue
        elif touching.weight[t] < 1.0:
            touching.weight[t] = min(1.0, touching.weight[t] + GROWTH)
        first = touching.first[t]
        second = touching.second[t]
        faces = parts.face_count[first]
        plane = touching.plane[t]
        apart = False
        if plane >= faces:
            apart = lies_apart(parts, bodies, second, first, plane - faces)
        elif plane >= 0:
            apart = lies_apart(parts, bodies, first, second, plane)
        patches = 0
        depth = o1 = o2 = o3 = 0.0
        if not apart:
            patches, depth, plane, o1, o2, o3 = contact_surface(parts, bodies, first, second, touching.scratch)
            touching.plane[t] = plane
        if patches == 0:
            if parted:
                touching.weight[t] = 1.0
            rest(touching, t)
            continue
        if patches < 0:
            touching.trouble[0] = t
            return CROWDED
        if depth > DEEPEST * min(parts.inner[first], parts.inner[second]):
            touching.trouble[0] = t
            return DEEP
        if is_open:
            touching.weight[t] = min(1.0, touching.weight[t] + GROWTH)
        a = parts.owner[first]
        b = parts.owner[second]
        x1, x2, x3 = rows_times(bodies.rotation[a], o1, o2, o3)
        x = bodies.position
        press(
            touching, bodies, t, patches, dt, x1, x2, x3,
            x1 + (x[a, 0] - x[b, 0]), x2 + (x[a, 1] - x[b, 1]), x3 + (x[a, 2] - x[b, 2]),
        )  # fmt: skip
    return TOUCHED
