"""Forces on blocks in real time besides joints, contacts and gravity: ties, guides, pressures on faces.

Ties: their forces are applied to the blocks like loads. The law is `kernels.joint.ties`.

Guides: forces and moments that prevent motion of blocks in their fixed directions. They act beside the loads of a step,
so that the step of a block, its energy and its joints need not know of them. A zero velocity requires a force against
all others; a zero spin about an axis requires a moment that depends on the spin about the other two
(`kernels.math.rigid_turns`).

Pressures follow the faces of moving blocks, and fluid pressures the present depth of each part. On a convex polygon
with the outward normal n the pressure p = max(0, c0 + c1 z) is linear where it is positive. That part is a fan of
triangles of vector area A n. On a triangle with pressures p_i at the corners r_i, relative to the centroid of the
block, force and moment are, exactly,

    F = -A n (p_1 + p_2 + p_3) / 3,    M = -(sum p_i sum r_i + sum p_i r_i) / 12 x A n.

The vector areas of a closed surface cancel in the present geometry: a block surrounded by water has no moment.
"""

from typing import NamedTuple

from numpy import ndarray

from dembrick._jit import jit
from dembrick.kernels.dynamics.rigid_bodies import gathered, resisted
from dembrick.kernels.joint.ties import tie_force
from dembrick.kernels.math.rigid_turns import guided_momentum
from dembrick.kernels.math.vectors import NO_MOMENT, add_wrench, cross, rotate


@jit
def clear_tied(ties, bodies):
    """Clear the loads on blocks with ties, before those of the step are applied."""
    for t in range(ties.stiffness.size):
        for side in range(2):
            for i in range(6):
                bodies.applied[ties.block[t, side], i] = 0.0


@jit
def pull_ties(ties, bodies, searching):
    """Add the forces of all ties to the loads on their blocks; ``searching``: see `stretch`."""
    for t in range(ties.stiffness.size):
        a = ties.block[t, 0]
        b = ties.block[t, 1]
        x = bodies.position
        tie_force(ties, t, bodies.orientation, (x[b, 0] - x[a, 0], x[b, 1] - x[a, 1], x[b, 2] - x[a, 2]), searching)
        for side in range(2):
            load = bodies.applied[ties.block[t, side]]
            add_wrench(load, 1.0 - 2.0 * side, ties.force[t], NO_MOMENT, ties.arm[t, side])


@jit
def clear_guided(bodies):
    """Clear the loads on guided blocks, before those of the step are applied."""
    for g in range(bodies.guided.size):
        for i in range(6):
            bodies.applied[bodies.guided[g], i] = 0.0


@jit
def unresisted(force, motion, damping):
    """Inverse of `resisted`: the force that local damping reduces to ``force``."""
    against = force if motion > 0.0 else -force
    if damping == 0.0 or motion == 0.0:
        return force
    return force / (1.0 - damping) if against > 0.0 else force / (1.0 + damping)


@jit
def apply_guides(bodies, wrenches, g1, g2, g3, dt, damping):
    """Add the forces of guides to the loads of guided blocks, once all other forces of the step are there."""
    for g in range(bodies.guided.size):
        b = bodies.guided[g]
        held = bodies.held[g]
        guide = bodies.guide[g]
        f1, f2, f3, t1, t2, t3 = gathered(bodies, b, wrenches, True, g1, g2, g3)
        v = bodies.velocity[b]
        for i, f in enumerate((f1, f2, f3)):
            guide[i] = 0.0
            if held[i]:
                guide[i] = unresisted(-bodies.mass[b] * v[i] / dt, v[i], damping) - f
        L = bodies.momentum[b]
        l1 = L[0] + dt * resisted(t1, L[0], damping)
        l2 = L[1] + dt * resisted(t2, L[1], damping)
        l3 = L[2] + dt * resisted(t3, L[2], damping)
        change = guided_momentum(bodies.orientation, b, bodies.inverse[b], held[3:], (l1, l2, l3), dt)
        for i, t in enumerate((t1, t2, t3)):
            guide[i + 3] = 0.0
            if held[i + 3]:
                moment = change[i] / dt + resisted(t, L[i], damping)
                guide[i + 3] = unresisted(moment, L[i], damping) - t
        for i in range(6):
            bodies.applied[b, i] += guide[i]


class PressedFaces(NamedTuple):
    """q convex polygons with c corners in all: each is a face, or a covered part of one, which is subtracted."""

    block: ndarray  # (q,) int64
    first: ndarray  # (q + 1,) int64, number of the first corner of each
    corner: ndarray  # (c, 3) m, from the centroid in body axes, counter-clockwise seen from outside
    sense: ndarray  # (q,) 1, or -1 for a covered part
    level: ndarray  # (q,) Pa, c0
    slope: ndarray  # (q,) Pa/m, c1
    driven: ndarray  # (q,) bool, whether the multiplier V acts on it
    wrench: (
        ndarray  # (q, 6) N, N m, force and moment about the centroid at the last call of `apply_pressures`, for V = 1
    )


@jit
def clear_pressed(faces, bodies):
    """Clear the loads on blocks under pressure, before those of the step are applied."""
    for q in range(faces.block.size):
        for i in range(6):
            bodies.applied[faces.block[q], i] = 0.0


@jit
def apply_pressures(faces, bodies, multiplier, height):
    """Add the pressures to the loads on their blocks; the height of a point x is h x + h_0, with ``height``
    (4,) = (h, h_0)."""
    for q in range(faces.block.size):
        b = faces.block[q]
        wrench = faces.wrench[q]
        for i in range(6):
            wrench[i] = 0.0
        polygon_pressure(faces, q, bodies, height)
        load = bodies.applied[b]
        for i in range(6):
            wrench[i] *= faces.sense[q]
            load[i] += multiplier_on(faces, q, multiplier) * wrench[i]


@jit
def multiplier_on(faces, q, multiplier):
    """V for a polygon on which it acts, 1 for others."""
    return multiplier if faces.driven[q] else 1.0


@jit
def polygon_pressure(faces, q, bodies, height):
    """Add force and moment of the pressure on one polygon to its wrench. The part where the pressure is positive is a
    fan of triangles from its first corner, in the order of the outline."""
    b = faces.block[q]
    first = faces.first[q]
    last = faces.first[q + 1]
    slope = faces.slope[q]
    x = bodies.position[b]
    at_centroid = faces.level[q] + slope * (height[0] * x[0] + height[1] * x[1] + height[2] * x[2] + height[3])
    found = 0
    a = before = (0.0, 0.0, 0.0, 0.0)  # the first corner of the part, and the corner before
    k = last - 1
    u1, u2, u3 = rotate(bodies.orientation, b, faces.corner[k, 0], faces.corner[k, 1], faces.corner[k, 2])
    pu = at_centroid + slope * (height[0] * u1 + height[1] * u2 + height[2] * u3)
    for k in range(first, last):
        v1, v2, v3 = rotate(bodies.orientation, b, faces.corner[k, 0], faces.corner[k, 1], faces.corner[k, 2])
        pv = at_centroid + slope * (height[0] * v1 + height[1] * v2 + height[2] * v3)
        for at_corner in range(2):
            if at_corner:
                if pv < 0.0:
                    continue
                c = v1, v2, v3, pv
            else:
                if (pu >= 0.0) == (pv >= 0.0):
                    continue
                s = pu / (pu - pv)
                c = u1 + s * (v1 - u1), u2 + s * (v2 - u2), u3 + s * (v3 - u3), 0.0
            if found == 0:
                a = c
            if found >= 2:
                triangle_pressure(faces.wrench[q], a, before, c)
            before = c
            found += 1
        u1, u2, u3, pu = v1, v2, v3, pv


@jit
def triangle_pressure(wrench, a, b, c):
    """Add force and moment of a linear pressure on a triangle; corners (position and pressure, 4) counter-clockwise
    seen from outside."""
    a1, a2, a3, pa = a
    b1, b2, b3, pb = b
    c1, c2, c3, pc = c
    n1, n2, n3 = cross(b1 - a1, b2 - a2, b3 - a3, c1 - a1, c2 - a2, c3 - a3)  # twice the vector area
    total = pa + pb + pc
    m1 = (total * (a1 + b1 + c1) + pa * a1 + pb * b1 + pc * c1) / 24.0
    m2 = (total * (a2 + b2 + c2) + pa * a2 + pb * b2 + pc * c2) / 24.0
    m3 = (total * (a3 + b3 + c3) + pa * a3 + pb * b3 + pc * c3) / 24.0
    mean = total / 6.0
    moment = cross(m1, m2, m3, n1, n2, n3)
    add_wrench(wrench, -1.0, (mean * n1, mean * n2, mean * n3), moment, (0.0, 0.0, 0.0))
