"""Guides in real time: forces and moments under which blocks do not move in the directions in which they are held.

They act beside the loads of a step, so that the step of a block, its energy and its joints know nothing of them. A
velocity that is zero takes a force against all others; a spin that is zero about an axis takes a moment that follows
the spin about the other two (`kernels.math.held_turns`).
"""

from dembrick._jit import jit
from dembrick.kernels.dynamics.rigid_bodies import gathered, resisted, spin_of_step
from dembrick.kernels.math.held_turns import MOST_CORRECTIONS, held_momentum, turns_freely
from dembrick.kernels.math.quaternion import rotate, rotate_back
from dembrick.kernels.math.vec3 import rows_times


@jit
def clear_guided(bodies):
    """Take all loads off the blocks that are guided: those of the step come next."""
    for g in range(bodies.guided.size):
        for i in range(6):
            bodies.applied[bodies.guided[g], i] = 0.0


@jit
def unresisted(force, motion, damping):
    """The force that `resisted` makes ``force`` of."""
    against = force if motion > 0.0 else -force
    if damping == 0.0 or motion == 0.0:
        return force
    return force / (1.0 - damping) if against > 0.0 else force / (1.0 + damping)


@jit
def spin_for(bodies, b, momentum, dt):
    """Spin (world) of a step at the angular ``momentum`` (3)."""
    w1, w2, w3 = spin_of_step(bodies, b, momentum, dt)
    return rotate(bodies.orientation, b, w1, w2, w3)


@jit
def answer_to(bodies, b, l1, l2, l3):
    """I^-1 times a vector, world axes."""
    return rotate(
        bodies.orientation, b, *rows_times(bodies.inverse[b], *rotate_back(bodies.orientation, b, l1, l2, l3))
    )


@jit
def hold(bodies, wrenches, g1, g2, g3, dt, damping):
    """Add to the loads of guided blocks what their guides exert, once all other forces of the step are there."""
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
        m1 = m2 = m3 = 0.0
        if held[3] or held[4] or held[5]:
            e1 = answer_to(bodies, b, 1.0, 0.0, 0.0)
            e2 = answer_to(bodies, b, 0.0, 1.0, 0.0)
            e3 = answer_to(bodies, b, 0.0, 0.0, 1.0)
            for _ in range(MOST_CORRECTIONS):
                w1, w2, w3 = spin_for(bodies, b, (l1 + m1, l2 + m2, l3 + m3), dt)
                d1, d2, d3 = held_momentum(e1, e2, e3, held[3], held[4], held[5], w1, w2, w3)
                m1 += d1
                m2 += d2
                m3 += d3
                if turns_freely(held[3:], w1, w2, w3):
                    break
        for i, t in enumerate((t1, t2, t3)):
            guide[i + 3] = 0.0
            if held[i + 3]:
                change = (m1, m2, m3)[i] / dt + resisted(t, L[i], damping)
                guide[i + 3] = unresisted(change, L[i], damping) - t
        for i in range(6):
            bodies.applied[b, i] += guide[i]
