"""Forces of new contacts, one for each pair of convex parts that overlap (``contact_surface``).

Pressure: 2 kn times the penetration, plus a dashpot of given damping ratio on the closing of the last step, never
negative. Friction: one elastic force in the plane orthogonal to the mean normal, and one torsion about it, at the
centre of pressure; stiffness ks A and ks J of the patches, strength on the exact limit surface of the pressure
(``contact_friction``). The memory of a contact turns with both blocks and stays orthogonal to the normal; if patches
shrink it is reduced with their stiffness, so that no loop of loads returns energy that was not put in. It is cleared
when the overlap ends.

Transition from joints to contacts: the joint of a pair of blocks is handed over to a new contact (``hand_over``).

The new contact counts by its weight, the joint by the rest. The weight grows with the motion that the joint's polygon
cannot follow, between two bounds each: the turn of one face against the other; and, if the polygon is less than the
face of its host, the slip in the plane, because the faces may then overlap more than before, and slip times turn, which
is how deep that part may penetrate unnoticed. It grows by at most `GROWTH` in a step. If the joint is open and all of
it lies well apart there is nothing to hand over, and it is 1: faces that land on each other then bounce as they should.

It decreases as slowly where the joint can follow again and presses: a block that was thrown, or rocked far over, then
rocks on its corners again and not on a bed of springs. It stays while the faces lie flat. A rocking block leaves its
corners at each impact by as little as it bounces; that does not count as apart.

In the search for an equilibrium, no joint that crushes begins to hand over while its blocks overlap by more than its
crushing depth: a new contact would press on crushed material, which only the joint knows, and hold up falling blocks.
"""

from math import sqrt
from typing import NamedTuple

from numpy import ndarray

from dembrick._jit import entry, jit
from dembrick.kernels.dynamics.contact_friction import flatten, friction_wrench, reset_memory, share_pressure
from dembrick.kernels.dynamics.contact_stiffness import (
    add_stability_load,
    gather_springs,
    inverse_mass,
    stepped_dashpot,
)
from dembrick.kernels.dynamics.contact_surface import (
    Parts,
    Scratch,
    contact_surface,
    lies_apart,
    positive_part,
    sum_patches,
)
from dembrick.kernels.dynamics.law_memory import MOVING, RESTED
from dembrick.kernels.dynamics.tiles import W, offset_of, sense_of, three, wrench_at
from dembrick.kernels.joint.dashpots import damped_push
from dembrick.kernels.joint.pressure import Pressed
from dembrick.kernels.math.vectors import add_wrench, columns_times, cross, put_vector, rows_times, tangent

TOUCHED, DEEP, CROWDED = 0, 11, 12  # distinct from the loop's own states
DEEPEST = 0.25  # of the thinner part's inner radius: a deeper penetration ends the run


class Touching(NamedTuple):
    """t pairs of parts that are near each other and have no joint, or one that is handed over."""

    parts: Parts
    scratch: Scratch
    pressed: Pressed  # scratch: the pressure of one contact about its centre, `contact_friction`
    free: ndarray  # (n,) 1 for blocks that move, 0 for fixed ones
    first: ndarray  # (t,) int64, part A
    second: ndarray  # (t,) int64, part B
    joint: ndarray  # (t,) int64, their joint, or -1
    k_n: ndarray  # (t,) Pa/m
    k_s: ndarray  # (t,) Pa/m
    friction: ndarray  # (t,)
    cohesion: ndarray  # (t,) Pa
    weight: ndarray  # (t,) share of the new contact: 1 if there is no joint
    slack: ndarray  # (t,) m, depth up to which edges in contact along each other since the start do not press,
    least: ndarray  # (t,) N, force from which on they do, and
    deepest: ndarray  # (t,) m, depth from which on they do
    size: ndarray  # (t,) m, greatest distance of the joint's polygon from its centroid at the start
    partial: ndarray  # (t,) whether that polygon is less than the face of its host
    crushes: ndarray  # (t,) m, overlap from which on the joint crushes; infinite if it does not
    start: ndarray  # (j, 9) `Links.seen` at the start, of all joints
    shift: ndarray  # (j, 2) m, shift of their O on the host since then
    plane: ndarray  # (t,) int64, the face that separated the parts last, those of B after those of A; -1: none
    elastic: ndarray  # (t, 4) N, N m: elastic shear force on A (world), torsion on A about the normal from A to B
    stiffness: ndarray  # (t, 2) N/m, N m: shear and torsion stiffness to which these belong
    twist: ndarray  # (t, 3) m, m, rad: plastic twist of the last plastic step, in the axes of the contact
    slip: ndarray  # (t,) m, length of the slip path, see `area_law`
    normal: ndarray  # (t,) N, normal force
    area: ndarray  # (t,) m2, of the patches
    point: ndarray  # (t, 3) m, centre of pressure, world
    axis: ndarray  # (t, 3) mean normal there, from A to B, world
    force: ndarray  # (t, 3) N, on B, world
    torque: ndarray  # (t, 3) N m, on B about that point, world
    springs: (
        ndarray  # (t, 16) of contacts now: normal and an axis t orthogonal to it (world); N/m: the springs along the
    )
    # normal, those times x and y (N) and x^2, x y, y^2 (N m), along t and u = n x t from the centre of pressure;
    # dashpot over spring; N/m: additional stiffness across, and shear stiffness; N m: torsion stiffness
    load: ndarray  # (n,) bound of the effect of its contacts on a block: M^-1 (dt^2 K + 2 dt C), stable up to 4
    bearable: ndarray  # (n,) load up to which no closer check is needed
    overloaded: ndarray  # (1,) int64, 1 if a block has more
    laws: ndarray  # (1,) int64, mode of friction: `law_memory.MOVING` or another
    dashpot: ndarray  # (9,) dashpot over spring, times w, as a polynomial in the phase w (rad) of a step; greatest w
    room: ndarray  # (1,) m, how far blocks may still move until near pairs must be searched again
    trouble: ndarray  # (1,) int64, the pair that ended the run


@jit
def clear_applied(touching, bodies):
    """Clear the loads on blocks that may touch, before loads and contacts of a step are applied to them."""
    owner = touching.parts.owner
    for t in range(touching.first.size):
        a = owner[touching.first[t]]
        b = owner[touching.second[t]]
        touching.load[a] = 0.0
        touching.load[b] = 0.0
        for i in range(6):
            bodies.applied[a, i] = 0.0
            bodies.applied[b, i] = 0.0


@jit
def clear_contact(touching, t):
    """Set force and memory of pair ``t`` to zero."""
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
def edge_contact_matters(touching, t, patches, depth):
    """Whether edges in contact along each other since the start press with a force that counts by now; if not, the
    depth for the next check is doubled."""
    _, _, e1, e2, e3 = sum_patches(touching.scratch, patches)
    force = 2.0 * touching.k_n[t] * sqrt(e1 * e1 + e2 * e2 + e3 * e3)
    counting = force > touching.least[t] or depth > touching.deepest[t]
    touching.slack[t] = 0.0 if counting else 2.0 * touching.slack[t]
    return counting


@jit
def contact_force(touching, bodies, t, patches, depth, dt, x, y):
    """Normal pressure and friction of the patches in scratch, as `force`, `torque` and `point` of pair ``t``.

    ``depth``: the greatest penetration; x, y: the patches' origin from the centroids of the blocks of A and B, world.
    """
    x1, x2, x3 = x
    y1, y2, y3 = y
    scratch = touching.scratch
    area, total, e1, e2, e3 = sum_patches(scratch, patches)
    size = sqrt(e1 * e1 + e2 * e2 + e3 * e3)
    if not (total > 0.0 and size > 0.0):
        clear_contact(touching, t)
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
    c = c1, c2, c3
    e = e1, e2, e3
    t1, t2, t3 = across = tangent(e1, e2, e3)
    springs = touching.springs[t]
    polar, even = gather_springs(scratch, patches, springs, c, e, across)
    stiff = springs[6]
    x1 += d1
    x2 += d2
    x3 += d3
    y1 += d1
    y2 += d2
    y3 += d3
    # dashpot: the given damping ratio for the effective mass there, and for the linear spring that would store the
    # present energy at the present force, F^2 / (2 E): with that a contact F = c g^p is a linear oscillator in
    # g^((p + 1) / 2) and in a time of its own (Antypov and Elliott, Europhysics Letters 94 (2011) 50004). On an edge
    # the force grows with the square of the penetration, on a corner with its cube: all have one restitution
    k_n = touching.weight[t] * touching.k_n[t]
    k_s = touching.weight[t] * touching.k_s[t]
    felt = inverse_mass(touching, bodies, a, x1, x2, x3, n1, n2, n3)
    felt += inverse_mass(touching, bodies, b, y1, y2, y3, n1, n2, n3)
    viscous = stepped_dashpot(touching.dashpot, sqrt(felt * k_n * even) * dt) * even / stiff
    if touching.laws[0] == RESTED:
        viscous = 0.0
    # closing of the blocks at the centre of pressure in the last step, and their relative rotation
    va = bodies.velocity[a]
    vb = bodies.velocity[b]
    wa = bodies.spin[a]
    wb = bodies.spin[b]
    p1, p2, p3 = cross(wa[0], wa[1], wa[2], x1, x2, x3)
    q1, q2, q3 = cross(wb[0], wb[1], wb[2], y1, y2, y3)
    ahead = (va[0] + p1 - vb[0] - q1) * n1 + (va[1] + p2 - vb[1] - q2) * n2 + (va[2] + p3 - vb[2] - q3) * n3
    w1, w2, w3 = columns_times(R, dt * (wb[0] - wa[0]), dt * (wb[1] - wa[1]), dt * (wb[2] - wa[2]))
    # the dashpot force against closing is distributed as the pressure is, so that no part of it pulls before all of it
    # would; that against rotation is a linear field
    deep = 2.0 * size / stiff
    begins = touching.area[t] == 0.0
    swing2 = felt * k_n * stiff * dt * dt
    more = 1.0 + damped_push(deep, 2.0 * depth, dt * ahead, viscous, swing2, begins) / deep
    f1 = f2 = f3 = m1 = m2 = m3 = 0.0
    for p in range(patches):
        F = scratch.frame[p]
        g = scratch.depth[p]
        h1, h2, h3 = cross(w1, w2, w3, F[0, 3] - c1, F[1, 3] - c2, F[2, 3] - c3)
        closing = -(h1 * F[2, 0] + h2 * F[2, 1] + h3 * F[2, 2])
        h1, h2, h3 = cross(F[2, 0], F[2, 1], F[2, 2], w1, w2, w3)
        turned = viscous * g[3]
        force, about_x, about_y = positive_part(
            scratch.x, scratch.y, scratch.start[p], scratch.start[p + 1],
            2.0 * more * g[0] + turned * closing,
            2.0 * more * g[1] - turned * (h1 * F[0, 0] + h2 * F[0, 1] + h3 * F[0, 2]),
            2.0 * more * g[2] - turned * (h1 * F[1, 0] + h2 * F[1, 1] + h3 * F[1, 2]),
        )  # fmt: skip
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
    wide = flatten(touching.pressed, scratch, patches, whole, c, e, across)
    t1, t2, t3 = rows_times(R, t1, t2, t3)
    put_vector(springs, n1, n2, n3)
    put_vector(springs[3:], t1, t2, t3)
    for i in range(6, 14):
        springs[i] *= k_n
    springs[12] = viscous
    springs[14] = k_s * area
    springs[15] = k_s * polar
    at_a = x1, x2, x3
    at_b = y1, y2, y3
    add_stability_load(touching, bodies, a, b, springs, dt, at_a, at_b)
    shear = k_s * area, k_s * polar
    s1 = s2 = s3 = turn = 0.0
    if wide:
        axes = (n1, n2, n3), (t1, t2, t3)
        s1, s2, s3, turn = friction_wrench(
            touching, bodies, t, (a, b), dt, normal, shear, 1.0 + viscous, axes, (at_a, at_b)
        )
    else:
        reset_memory(touching, t, *shear)
    # friction as computed acts on A
    touching.normal[t] = normal
    touching.area[t] = area
    f1 -= s1
    f2 -= s2
    f3 -= s3
    m1 -= turn * n1
    m2 -= turn * n2
    m3 -= turn * n3
    o = bodies.position[a]
    put_vector(touching.force[t], f1, f2, f3)
    put_vector(touching.torque[t], m1, m2, m3)
    put_vector(touching.axis[t], n1, n2, n3)
    put_vector(touching.point[t], o[0] + x1, o[1] + x2, o[2] + x3)
    add_wrench(bodies.applied[a], -1.0, (f1, f2, f3), (m1, m2, m3), at_a)
    add_wrench(bodies.applied[b], 1.0, (f1, f2, f3), (m1, m2, m3), at_b)


@entry
def touch(touching, links, bodies, dt):
    """Apply the forces of all new contacts to their blocks, in the order of the pairs.

    Returns TOUCHED; DEEP if parts overlap by more than `DEEPEST`; CROWDED if scratch has no room for a contact surface;
    `trouble` is then the pair.
    """
    parts = touching.parts
    for t in range(touching.first.size):
        is_open = parted = False
        joint = touching.joint[t]
        before = touching.weight[t]
        if joint >= 0:
            is_open, parted = hand_over(touching, links, t)
            if touching.weight[t] <= 0.0 and not is_open:
                if touching.area[t] > 0.0:  # handed back: its last force must not be counted again
                    clear_contact(touching, t)
                continue
        elif touching.weight[t] < 1.0 and touching.slack[t] <= 0.0:
            touching.weight[t] = min(1.0, touching.weight[t] + GROWTH)
        first = touching.first[t]
        second = touching.second[t]
        faces = parts.face_count[first]
        plane = touching.plane[t]
        slack = touching.slack[t]
        apart = False
        if plane >= faces:
            apart = lies_apart(parts, bodies, second, first, plane - faces, slack)
        elif plane >= 0:
            apart = lies_apart(parts, bodies, first, second, plane, slack)
        patches = 0
        depth = o1 = o2 = o3 = 0.0
        if not apart:
            patches, depth, plane, o1, o2, o3 = contact_surface(
                parts, bodies, first, second, slack, touching.scratch
            )  # fmt: skip
            touching.plane[t] = plane
        if joint >= 0:
            if before <= 0.0 and touching.laws[0] != MOVING and 2.0 * depth > touching.crushes[t]:
                touching.weight[t] = 0.0
                clear_contact(touching, t)
                continue
            scale_joint_wrench(touching, links, t)
        if patches == 0:
            if parted:
                touching.weight[t] = 1.0
            clear_contact(touching, t)
            continue
        if patches < 0:
            touching.trouble[0] = t
            return CROWDED
        if depth > DEEPEST * min(parts.inner[first], parts.inner[second]):
            touching.trouble[0] = t
            return DEEP
        if slack > 0.0 and not edge_contact_matters(touching, t, patches, depth):
            clear_contact(touching, t)
            continue
        if is_open or slack > 0.0:
            touching.weight[t] = min(1.0, touching.weight[t] + GROWTH)
        a = parts.owner[first]
        b = parts.owner[second]
        x1, x2, x3 = rows_times(bodies.rotation[a], o1, o2, o3)
        x = bodies.position
        at_b = x1 + (x[a, 0] - x[b, 0]), x2 + (x[a, 1] - x[b, 1]), x3 + (x[a, 2] - x[b, 2])
        contact_force(touching, bodies, t, patches, depth, dt, (x1, x2, x3), at_b)
    return TOUCHED


TURN = 0.2, 0.4  # sine of the rotation between the faces at which the handover of a joint begins, and ends
SLIP = 0.05, 0.15  # of the joint's size: slip
SINK = 1e-4, 5e-4  # of its size: slip times turn
PARTED = 0.05  # of its size: gap of its nearest corner from which on an open joint is apart
FLUSH = 1e-3  # sine of a rotation below which faces land flat on each other: they bounce by the new contact
GROWTH = 1.0 / 300.0  # greatest change of the weight of a new contact in a step


@jit
def ramp(x, low, high):
    """Smooth step from 0 at ``low`` to 1 at ``high``."""
    s = min(1.0, max(0.0, (x - low) / (high - low)))
    return s * s * (3.0 - 2.0 * s)


@jit
def hand_over(touching, links, t):
    """Increase the weight of pair ``t`` as its joint fails to follow, or decrease it.

    Returns whether the joint is open, and whether it is open and apart.
    """
    joint = touching.joint[t]
    size = touching.size[t]
    seen = links.seen_tiles[links.place[joint] // W]
    lane = links.place[joint] % W
    o1, o2, o3 = three(seen.origin, lane)
    x1, x2, x3 = three(seen.first, lane)
    y1, y2, y3 = three(seen.second, lane)
    wrench = links.wrenches[wrench_at(links, joint)]
    turn = sqrt(x3 * x3 + y3 * y3)
    due = ramp(turn, TURN[0], TURN[1])
    if touching.partial[t]:
        start = touching.start[joint]
        shift = touching.shift[joint]
        p1 = o1 - shift[0] * x1 - shift[1] * y1 - start[0]
        p2 = o2 - shift[0] * x2 - shift[1] * y2 - start[1]
        e1 = x1 - start[3]
        e2 = x2 - start[4]
        slip = sqrt(p1 * p1 + p2 * p2) + size * sqrt(e1 * e1 + e2 * e2)
        due = max(due, ramp(slip, SLIP[0] * size, SLIP[1] * size))
        due = max(due, ramp(slip * turn, SINK[0] * size, SINK[1] * size))
    is_open = True
    for i in range(3):
        is_open = is_open and wrench[i] == 0.0
    weight = touching.weight[t]
    if due > weight:
        weight = min(due, weight + GROWTH)
    elif not is_open and turn > FLUSH:
        weight = max(due, weight - GROWTH)
    touching.weight[t] = weight
    gap = sense_of(links, joint) * (o3 - offset_of(links, joint))
    return is_open, is_open and gap - size * turn > PARTED * size


@jit
def scale_joint_wrench(touching, links, t):
    """Reduce the wrench of the joint of pair ``t`` by the weight of the new contact."""
    wrench = links.wrenches[wrench_at(links, touching.joint[t])]
    for i in range(9):
        wrench[i] *= 1.0 - touching.weight[t]
