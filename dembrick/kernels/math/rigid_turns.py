"""Rotation of a rigid block through a step at constant angular momentum L, and the change of L by guides.

The spin of a step is that at its middle: L turns back in body axes by half the step's rotation, w = I^-1 exp(-dt w / 2)
L, and the block rotates by the exact exponential of dt w. So |L| is kept to the last bit, and the energy of a free top
does not drift. Orientations ``q`` (n, 4) are unit quaternions (w, x, y, z) of n blocks, body to world; ``inverse``
(3, 3) is the inverse of the inertia about the centroid in body axes.

A guide prevents rotation of its block about some axes h. With I the inertia in world axes, the spin is w = I^-1 L. For
the spin about these axes to vanish, the momentum along them must change by l with (I^-1 l)_h = -w_h. This does no work,
as nothing rotates about them. An inertia that is not diagonal in world axes couples the axes: the moment about a guided
axis then depends on the spin about the free ones.
"""

from dembrick._jit import jit
from dembrick.kernels.math.vectors import half_turn, product, rotate, rotate_back, rows_times, turned_back

SLOW = 1e-4  # rad per step: below it one correction of the spin leaves a relative error of at most SLOW^2 / 4
MOST_CORRECTIONS = 6  # of the momentum per step
STILL = 1e-15  # part of the spin that counts as rounding


@jit
def spin_of_step(q, b, inverse, momentum, dt):
    """Spin (3), body axes, of block ``b`` in a step ``dt`` through which its angular momentum is ``momentum`` (3)."""
    l1, l2, l3 = rotate_back(q, b, momentum[0], momentum[1], momentum[2])
    w1, w2, w3 = rows_times(inverse, l1, l2, l3)
    half = 0.5 * dt
    m1, m2, m3 = turned_back(half * w1, half * w2, half * w3, l1, l2, l3)
    w1, w2, w3 = rows_times(inverse, m1, m2, m3)
    angle2 = dt * dt * (w1 * w1 + w2 * w2 + w3 * w3)
    if angle2 > SLOW * SLOW:
        for _ in range(10):
            m1, m2, m3 = turned_back(half * w1, half * w2, half * w3, l1, l2, l3)
            x1, x2, x3 = rows_times(inverse, m1, m2, m3)
            change = abs(x1 - w1) + abs(x2 - w2) + abs(x3 - w3)
            w1 = x1
            w2 = x2
            w3 = x3
            if change * dt <= 1e-15:
                break
    return w1, w2, w3


@jit
def turn(q, b, inverse, momentum, dt):
    """Rotate block ``b`` through a step under its angular ``momentum`` (3); return its spin (3) in the step, world
    axes, and the square of the angle."""
    w1, w2, w3 = spin_of_step(q, b, inverse, momentum, dt)
    angle2 = dt * dt * (w1 * w1 + w2 * w2 + w3 * w3)
    c, s = half_turn(angle2)
    s *= dt
    # a rotation does not change its own axis, so the world spin is the same before and after it
    spin = rotate(q, b, w1, w2, w3)
    a0, a1, a2, a3 = product(q[b, 0], q[b, 1], q[b, 2], q[b, 3], c, s * w1, s * w2, s * w3)
    # normalise by one Newton step: the length is already close to 1
    n = 1.5 - 0.5 * (a0 * a0 + a1 * a1 + a2 * a2 + a3 * a3)
    q[b, 0] = n * a0
    q[b, 1] = n * a1
    q[b, 2] = n * a2
    q[b, 3] = n * a3
    return spin, angle2


@jit
def spin_under(q, b, inverse, l1, l2, l3):
    """I^-1 l of block ``b``, world axes: its spin under the angular momentum l."""
    return rotate(q, b, *rows_times(inverse, *rotate_back(q, b, l1, l2, l3)))


@jit
def held_momentum(e1, e2, e3, h1, h2, h3, w1, w2, w3):
    """The change (3) of the angular momentum along the guided axes ``h`` that makes the spin ``w`` vanish about them.

    ``e1``, ``e2``, ``e3``: columns of I^-1 in world axes. The rows of free axes state that their momentum does not
    change.
    """
    a11 = e1[0] if h1 else 1.0
    a12 = e2[0] if h1 and h2 else 0.0
    a13 = e3[0] if h1 and h3 else 0.0
    a22 = e2[1] if h2 else 1.0
    a23 = e3[1] if h2 and h3 else 0.0
    a33 = e3[2] if h3 else 1.0
    b1 = -w1 if h1 else 0.0
    b2 = -w2 if h2 else 0.0
    b3 = -w3 if h3 else 0.0
    c11 = a22 * a33 - a23 * a23
    c12 = a13 * a23 - a12 * a33
    c13 = a12 * a23 - a13 * a22
    inverse = 1.0 / (a11 * c11 + a12 * c12 + a13 * c13)
    c22 = a11 * a33 - a13 * a13
    c23 = a12 * a13 - a11 * a23
    c33 = a11 * a22 - a12 * a12
    return (
        inverse * (c11 * b1 + c12 * b2 + c13 * b3),
        inverse * (c12 * b1 + c22 * b2 + c23 * b3),
        inverse * (c13 * b1 + c23 * b2 + c33 * b3),
    )


@jit
def turns_freely(held, w1, w2, w3):
    """Whether the spin ``w`` has no part about the ``held`` axes (3,), except for rounding."""
    most = STILL * max(abs(w1), abs(w2), abs(w3))
    return (not held[0] or abs(w1) <= most) and (not held[1] or abs(w2) <= most) and (not held[2] or abs(w3) <= most)


@jit
def guided_momentum(q, b, inverse, held, momentum, dt):
    """The change (3) of the angular ``momentum`` (3) of block ``b`` that prevents its rotation about the ``held`` axes
    (3,) in a step; zero if there are none."""
    m1 = m2 = m3 = 0.0
    if held[0] or held[1] or held[2]:
        l1, l2, l3 = momentum
        e1 = spin_under(q, b, inverse, 1.0, 0.0, 0.0)
        e2 = spin_under(q, b, inverse, 0.0, 1.0, 0.0)
        e3 = spin_under(q, b, inverse, 0.0, 0.0, 1.0)
        for _ in range(MOST_CORRECTIONS):
            w1, w2, w3 = rotate(q, b, *spin_of_step(q, b, inverse, (l1 + m1, l2 + m2, l3 + m3), dt))
            d1, d2, d3 = held_momentum(e1, e2, e3, held[0], held[1], held[2], w1, w2, w3)
            m1 += d1
            m2 += d2
            m3 += d3
            if turns_freely(held, w1, w2, w3):
                break
    return m1, m2, m3
