"""Forces of contacts that form anew, one for each pair of convex parts that overlap (`patches`).

Pressure: 2 kn times the penetration, plus a dashpot of stated ratio that sees the closing of the last step, never
negative. Friction: one elastic force in the plane square to the mean normal, and one torsion about it, at the centre of
pressure c; stiffness ks A and ks J of the patches, strength mu N and mu N r_T with r_T the mean distance of the
pressure from c. Between pure shear and pure torsion the limit surface is taken as the ellipse, which is up to a tenth
larger than the exact one; on its axes it is exact. What a contact remembers turns with both blocks and stays square to
the normal; where patches shrink it shrinks with their stiffness, so that no loop of loads gives energy back that was
not put in. It is forgotten where the overlap ends.

A pair that has a joint is handed over: the new contact counts by its weight, the joint by the rest. The weight grows
with what the joint's polygon cannot follow, between two bounds each: the turn of the one face against the other; and,
where the polygon is not the whole face that it rides on, the slip in the plane, because faces may share more then than
they did, and slip times turn, which is how deep that may sink in unseen. It grows by no more than `GROWTH` in a step
and never falls back. Where the joint is open and the parts lie apart there is nothing to hand over, and it is 1.
"""

from math import sqrt
from typing import NamedTuple

from numpy import ndarray

from dembrick._jit import entry, jit
from dembrick.kernels.bodies import turned_back
from dembrick.kernels.moving_joints import met
from dembrick.kernels.patches import Parts, Scratch, contact_surface, flat_sums, lies_apart, positive_part
from dembrick.kernels.pressed import weighted_edge_sums
from dembrick.kernels.vec3 import columns_times, cross, rows_times

TOUCHED, DEEP, CROWDED = 0, 11, 12  # apart from the loop's own states
TURN = 0.2, 0.4  # sine of the turn of the faces at which the handing over of a joint begins, and ends
SLIP = 0.05, 0.15  # of the joint's size: slip
SINK = 1e-4, 5e-4  # of its size: slip times turn
PARTED = 0.02  # of its size: an open joint whose faces are so far apart has done its work
GROWTH = 1.0 / 300.0  # in a step, of the weight of a new contact
BAND = 0.999  # a stiffness that trembles by less than a thousandth wears nothing off what a contact remembers
RIM = 1e-5  # of the pressure: smaller patches count nothing for the strength in torsion
DEEPEST = 0.25  # of the thinner part's inner radius: a deeper penetration ends the run


class Touching(NamedTuple):
    """t pairs of parts that are near each other and have no joint, or one that is handed over."""

    parts: Parts
    scratch: Scratch
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
    slip: ndarray  # (t,) m, length of the slip path at the centre of pressure
    normal: ndarray  # (t,) N, normal force
    area: ndarray  # (t,) m2, of the patches
    point: ndarray  # (t, 3) m, centre of pressure, world
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
def moved(bodies, b, dt, r1, r2, r3):
    """How far the point of block ``b`` at r from its centroid came in the last step."""
    v = bodies.velocity[b]
    w = bodies.spin[b]
    p1, p2, p3 = turned_back(dt * w[0], dt * w[1], dt * w[2], r1, r2, r3)
    return dt * v[0] + (r1 - p1), dt * v[1] + (r2 - p2), dt * v[2] + (r3 - p3)


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
def returned(shear2, torsion2, ratio):
    """The factor f >= 0 of the return to the ellipse: shear2/(1 + f)^2 + torsion2/(1 + ratio f)^2 = 1.

    Newton's iteration from a bound below, where the function falls and is convex, comes to the root from one side.
    """
    factor = max(0.0, sqrt(shear2) - 1.0)
    if torsion2 > 1.0:
        factor = max(factor, (sqrt(torsion2) - 1.0) / ratio)
    for _ in range(60):
        p = 1.0 / (1.0 + factor)
        q = 1.0 / (1.0 + ratio * factor)
        value = shear2 * p * p + torsion2 * q * q - 1.0
        if value <= 1e-14:
            break
        factor += 0.5 * value / (shear2 * p * p * p + ratio * torsion2 * q * q * q)
    return factor


@jit
def rest(touching, t):
    """No force, and nothing remembered."""
    touching.normal[t] = 0.0
    touching.area[t] = 0.0
    for i in range(3):
        touching.force[t, i] = 0.0
        touching.torque[t, i] = 0.0
    for i in range(4):
        touching.elastic[t, i] = 0.0
    touching.stiffness[t, 0] = 0.0
    touching.stiffness[t, 1] = 0.0


@jit
def sum_patches(scratch, patches):
    """Area and integral of the penetration of every patch into `sums`; returns the sums over all of the area, of the
    penetration D, of D times the point (3) and of D times the normal (3)."""
    area = total = c1 = c2 = c3 = e1 = e2 = e3 = 0.0
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
        c1 += sums[1] * F[0, 3] + sums[2] * F[0, 0] + sums[3] * F[1, 0]
        c2 += sums[1] * F[1, 3] + sums[2] * F[0, 1] + sums[3] * F[1, 1]
        c3 += sums[1] * F[2, 3] + sums[2] * F[0, 2] + sums[3] * F[1, 2]
        e1 += sums[1] * F[2, 0]
        e2 += sums[1] * F[2, 1]
        e3 += sums[1] * F[2, 2]
    return area, total, c1, c2, c3, e1, e2, e3


@jit
def press(touching, bodies, t, patches, dt, x1, x2, x3, y1, y2, y3):
    """Normal pressure and friction of the patches in scratch, as `force`, `torque` and `point` of pair ``t``.

    x, y: their origin from the centroids of the blocks of A and B, world.
    """
    scratch = touching.scratch
    area, total, c1, c2, c3, e1, e2, e3 = sum_patches(scratch, patches)
    size = sqrt(e1 * e1 + e2 * e2 + e3 * e3)
    if not (total > 0.0 and size > 0.0):
        rest(touching, t)
        return
    a = touching.parts.owner[touching.first[t]]
    b = touching.parts.owner[touching.second[t]]
    R = bodies.rotation[a]
    # centre of pressure and mean normal, in A's axes and in the world's
    c1 /= total
    c2 /= total
    c3 /= total
    e1 /= size
    e2 /= size
    e3 /= size
    n1, n2, n3 = rows_times(R, e1, e2, e3)
    d1, d2, d3 = rows_times(R, c1, c2, c3)
    # dashpot: the stated ratio for the mass that is felt there and the stiffness that there is now
    k_n = touching.weight[t] * touching.k_n[t]
    k_s = touching.weight[t] * touching.k_s[t]
    stiff = polar = turning = 0.0
    for p in range(patches):
        F = scratch.frame[p]
        sums = scratch.sums[p]
        along = F[2, 0] * e1 + F[2, 1] * e2 + F[2, 2] * e3
        stiff += sums[0] * scratch.depth[p, 3] * along * along
        # from the centre of pressure: polar moment of the area, and mean distance of the pressure
        g1 = c1 - F[0, 3]
        g2 = c2 - F[1, 3]
        g3 = c3 - F[2, 3]
        u = g1 * F[0, 0] + g2 * F[0, 1] + g3 * F[0, 2]
        v = g1 * F[1, 0] + g2 * F[1, 1] + g3 * F[1, 2]
        g = scratch.depth[p]
        first = scratch.start[p]
        last = scratch.start[p + 1]
        _, mu, mv, _ = flat_sums(scratch.x, scratch.y, first, last)
        polar += max(0.0, sums[4] - 2.0 * (u * mu + v * mv) + sums[0] * (u * u + v * v))
        if sums[1] > RIM * total:
            turned, _, _, _, _, _ = weighted_edge_sums(scratch.x, scratch.y, first, last, g[0], g[1], g[2], u, v)
            turning += max(0.0, turned)
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
    s1, s2, s3, turn = rub(
        touching, bodies, t, a, b, dt, normal, turning / total, k_s * area, k_s * polar, 1.0 + viscous,
        n1, n2, n3, x1 + d1, x2 + d2, x3 + d3, y1 + d1, y2 + d2, y3 + d3,
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
    give(bodies, a, -1.0, force, torque, x1 + d1, x2 + d2, x3 + d3)
    give(bodies, b, 1.0, force, torque, y1 + d1, y2 + d2, y3 + d3)


@jit
def rub(
    touching, bodies, t, a, b, dt, normal, radius, k_t, k_r, damped, n1, n2, n3, r1, r2, r3, q1, q2, q3
):  # fmt: skip
    """Friction on A (3) and torsion on A about the normal n (world); r, q: the centre of pressure from the centroids.

    B slips against A by the difference of what their points there moved; the friction on A points that way.
    """
    elastic = touching.elastic[t]
    stiffness = touching.stiffness[t]
    if not normal > 0.0:
        for i in range(4):
            elastic[i] = 0.0
        stiffness[0] = k_t
        stiffness[1] = k_r
        return 0.0, 0.0, 0.0, 0.0
    wa = bodies.spin[a]
    wb = bodies.spin[b]
    half = -0.5 * dt
    e1, e2, e3 = turned_back(
        half * (wa[0] + wb[0]), half * (wa[1] + wb[1]), half * (wa[2] + wb[2]), elastic[0], elastic[1], elastic[2]
    )
    out = e1 * n1 + e2 * n2 + e3 * n3
    loss = min(1.0, k_t / (BAND * stiffness[0])) if stiffness[0] > 0.0 else 1.0
    e1 = loss * (e1 - out * n1)
    e2 = loss * (e2 - out * n2)
    e3 = loss * (e3 - out * n3)
    torsion = elastic[3] * (min(1.0, k_r / (BAND * stiffness[1])) if stiffness[1] > 0.0 else 1.0)
    stiffness[0] = min(max(stiffness[0], k_t), k_t / BAND)
    stiffness[1] = min(max(stiffness[1], k_r), k_r / BAND)
    s1, s2, s3 = moved(bodies, b, dt, q1, q2, q3)
    p1, p2, p3 = moved(bodies, a, dt, r1, r2, r3)
    s1 -= p1
    s2 -= p2
    s3 -= p3
    out = s1 * n1 + s2 * n2 + s3 * n3
    s1 -= out * n1
    s2 -= out * n2
    s3 -= out * n3
    turn = dt * ((wb[0] - wa[0]) * n1 + (wb[1] - wa[1]) * n2 + (wb[2] - wa[2]) * n3)
    full = damped * k_t
    t1 = e1 + full * s1
    t2 = e2 + full * s2
    t3 = e3 + full * s3
    tm = torsion + damped * k_r * turn
    strength = touching.friction[t] * normal
    arm = strength * radius
    if not (strength > 0.0 and k_t > 0.0):
        for i in range(4):
            elastic[i] = 0.0
        return 0.0, 0.0, 0.0, 0.0
    shear2 = (t1 * t1 + t2 * t2 + t3 * t3) / (strength * strength)
    torsion2 = tm * tm / (arm * arm) if arm > 0.0 else 0.0
    keep = keep_turn = 1.0
    if shear2 + torsion2 > 1.0:
        ratio = (k_r * strength * strength) / (k_t * arm * arm) if arm > 0.0 else 1.0
        factor = returned(shear2, torsion2, ratio)
        keep = 1.0 / (1.0 + factor)
        keep_turn = 1.0 / (1.0 + ratio * factor)
        touching.slip[t] += (1.0 - keep) * sqrt(shear2) * strength / full
    if not arm > 0.0:
        keep_turn = 0.0
    back = 1.0 / damped
    elastic[0] = e1 + k_t * s1 - (1.0 - keep) * back * t1
    elastic[1] = e2 + k_t * s2 - (1.0 - keep) * back * t2
    elastic[2] = e3 + k_t * s3 - (1.0 - keep) * back * t3
    elastic[3] = torsion + k_r * turn - (1.0 - keep_turn) * back * tm
    return keep * t1, keep * t2, keep * t3, keep_turn * tm


@jit
def ramp(x, low, high):
    """From 0 at ``low`` to 1 at ``high``, smoothly."""
    s = min(1.0, max(0.0, (x - low) / (high - low)))
    return s * s * (3.0 - 2.0 * s)


@jit
def hand_over(touching, links, t):
    """Let the weight of pair ``t`` grow as its joint fails to follow, and leave the joint the rest of its force.

    Returns whether the joint is open, and whether it has opened so far that it has done its work.
    """
    joint = touching.joint[t]
    size = touching.size[t]
    seen = links.seen[joint]
    wrench = links.wrench[joint]
    turn = sqrt(seen[5] * seen[5] + seen[8] * seen[8])
    due = ramp(turn, TURN[0], TURN[1])
    if touching.partial[t]:
        start = touching.start[joint]
        shift = touching.shift[joint]
        p1 = seen[0] - shift[0] * seen[3] - shift[1] * seen[6] - start[0]
        p2 = seen[1] - shift[0] * seen[4] - shift[1] * seen[7] - start[1]
        e1 = seen[3] - start[3]
        e2 = seen[4] - start[4]
        slip = sqrt(p1 * p1 + p2 * p2) + size * sqrt(e1 * e1 + e2 * e2)
        due = max(due, ramp(slip, SLIP[0] * size, SLIP[1] * size))
        due = max(due, ramp(slip * turn, SINK[0] * size, SINK[1] * size))
    weight = touching.weight[t]
    weight = max(weight, min(due, weight + GROWTH))
    touching.weight[t] = weight
    is_open = True
    for i in range(3):
        is_open = is_open and wrench[i] == 0.0
    for i in range(9):
        wrench[i] *= 1.0 - weight
    gap = links.sense[joint] * (seen[2] - links.offset[joint])
    return is_open, is_open and gap + size * turn > PARTED * size


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
