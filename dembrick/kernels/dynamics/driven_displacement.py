"""Displacement control in dynamic runs: the multiplier V of the load system that makes the blocks follow a driving
head.

V is found in each step so that the driven displacement u becomes that of the head, h. With the forces W for V = 1, the
rate J v of u, and local damping D of the out-of-balance,

    J (v + dt M^-1 D(F + V W)) = (h - u) / dt.

This is one equation for V, piecewise linear as D is. Directions fixed by guides are removed from M^-1.
"""

from typing import NamedTuple

from numpy import ndarray

from dembrick._jit import jit
from dembrick.kernels.dynamics.rigid_bodies import gathered, resisted
from dembrick.kernels.math.rigid_turns import held_momentum, spin_under
from dembrick.kernels.math.vectors import NO_MOMENT, add_wrench, rotate

STRAIGHT = 8  # corrections of V by the slope of a linear piece
MOST_CORRECTIONS = 100
ROUNDING = 1e-13


class Head(NamedTuple):
    """A head that drives the loads on b blocks, m forces and pressures, by the motion of k points; none if k = 0."""

    body: ndarray  # (b,) int64, the blocks
    guided: ndarray  # (b,) int64, number of each among the guided blocks, -1 for none
    point: ndarray  # (k,) int64, number of each point's block among these
    jack: ndarray  # (m,) int64, likewise of each of the last m loads of a step
    face: ndarray  # (q,) int64, likewise of each polygon on whose pressure V acts; -1 for others
    lever: ndarray  # (k, 3) m, from the centroid in body axes
    start: ndarray  # (k, 3) m, the points at the start of the drive, from the origin of `Bodies.position`
    direction: ndarray  # (k, 3) world: the driven displacement is the sum of the points' displacements, each dot this
    force: ndarray  # (m, 3) N for V = 1, world
    way: ndarray  # (s,) m, h of each step
    V: ndarray  # (1,) N
    unit: ndarray  # (b, 6) scratch for W
    along: ndarray  # (b, 6) scratch for J, then J M^-1
    total: ndarray  # (b, 6) scratch for F: see `follow_head`


@jit
def start_head(head, force, multiplier, step):
    """Set the ``multiplier`` and the loads ``force`` of a step by V of the last step, if there is a head."""
    if head.body.size:
        put_load(head, force, multiplier, step)


@jit
def put_load(head, force, multiplier, step):
    """Set the ``multiplier`` and the loads ``force`` of a step by V."""
    multiplier[step] = head.V[0]
    before = force.shape[1] - head.jack.size
    for k in range(head.jack.size):
        for i in range(3):
            force[step, before + k, i] = head.V[0] * head.force[k, i]


@jit
def follow_head(head, loads, bodies, wrenches, g1, g2, g3, dt, damping, step):
    """Find V of a step, once all other forces but those of guides are there, and add its change to the loads."""
    if head.body.size == 0:
        return
    for r in range(head.body.size):
        for i in range(6):
            head.unit[r, i] = head.along[r, i] = 0.0
    before = loads.block.size - head.jack.size
    for k in range(head.jack.size):
        lever = loads.lever[before + k]
        arm = rotate(bodies.orientation, loads.block[before + k], lever[0], lever[1], lever[2])
        add_wrench(head.unit[head.jack[k]], 1.0, head.force[k], NO_MOMENT, arm)
    for q in range(head.face.size):
        if head.face[q] >= 0:
            for i in range(6):
                head.unit[head.face[q], i] += loads.faces.wrench[q, i]
    driven = 0.0
    for k in range(head.point.size):
        b = head.body[head.point[k]]
        arm = rotate(bodies.orientation, b, head.lever[k, 0], head.lever[k, 1], head.lever[k, 2])
        add_wrench(head.along[head.point[k]], 1.0, head.direction[k], NO_MOMENT, arm)
        for i in range(3):
            driven += (bodies.position[b, i] + arm[i] - head.start[k, i]) * head.direction[k, i]
    rate = 0.0  # without any force
    for r in range(head.body.size):
        b = head.body[r]
        divide_by_mass(head, r, bodies)
        head.total[r, 0], head.total[r, 1], head.total[r, 2], head.total[r, 3], head.total[r, 4], head.total[r, 5] = (
            gathered(bodies, b, wrenches, True, g1, g2, g3)
        )
        for i in range(3):
            rate += head.along[r, i] * bodies.mass[b] * bodies.velocity[b, i]
            rate += head.along[r, i + 3] * bodies.momentum[b, i]
    change = load_change(head, bodies, (head.way[step] - driven) / dt - rate, dt, damping)
    head.V[0] += change
    put_load(head, loads.force, loads.multiplier, step)
    for r in range(head.body.size):
        for i in range(6):
            bodies.applied[head.body[r], i] += change * head.unit[r, i]


@jit
def divide_by_mass(head, r, bodies):
    """Turn J into J M^-1 in a row of ``along``, without the directions fixed by guides."""
    b = head.body[r]
    along = head.along[r]
    g = head.guided[r]
    q = bodies.orientation
    e1 = spin_under(q, b, bodies.inverse[b], 1.0, 0.0, 0.0)
    e2 = spin_under(q, b, bodies.inverse[b], 0.0, 1.0, 0.0)
    e3 = spin_under(q, b, bodies.inverse[b], 0.0, 0.0, 1.0)
    c1, c2, c3 = along[3], along[4], along[5]
    y1 = c1 * e1[0] + c2 * e2[0] + c3 * e3[0]
    y2 = c1 * e1[1] + c2 * e2[1] + c3 * e3[1]
    y3 = c1 * e1[2] + c2 * e2[2] + c3 * e3[2]
    if g >= 0:
        # moments of guides m, with I^-1 (c + m) zero about fixed axes: J M^-1 in the free directions
        held = bodies.held[g]
        m1, m2, m3 = held_momentum(e1, e2, e3, held[3], held[4], held[5], y1, y2, y3)
        y1 += m1 * e1[0] + m2 * e2[0] + m3 * e3[0]
        y2 += m1 * e1[1] + m2 * e2[1] + m3 * e3[1]
        y3 += m1 * e1[2] + m2 * e2[2] + m3 * e3[2]
    for i in range(3):
        along[i] /= bodies.mass[b]
        if g >= 0 and bodies.held[g, i]:
            along[i] = 0.0
    along[3], along[4], along[5] = y1, y2, y3


@jit
def load_change(head, bodies, rate, dt, damping):
    """The change of V by which the forces raise the rate of the driven displacement by ``rate`` (m/s) in a step."""
    change = 0.0
    for correction in range(MOST_CORRECTIONS):
        raised = slope = size = 0.0
        for r in range(head.body.size):
            b = head.body[r]
            for i in range(6):
                motion = bodies.velocity[b, i] if i < 3 else bodies.momentum[b, i - 3]
                force = head.total[r, i] + change * head.unit[r, i]
                left = resisted(force, motion, damping)
                raised += dt * head.along[r, i] * left
                size += dt * abs(head.along[r, i] * left)
                # slopes of the linear pieces at first; then the steepest, which never overshoots
                one = 1.0 + damping
                if correction < STRAIGHT and force != 0.0:
                    one = left / force
                slope += dt * head.along[r, i] * one * head.unit[r, i]
        if not slope > 0.0:
            break
        change += (rate - raised) / slope
        if abs(rate - raised) <= ROUNDING * (size + abs(rate)):
            break
    return change
