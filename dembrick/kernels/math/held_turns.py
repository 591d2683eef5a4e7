"""Turns of a block about the free axes of a guide: the angular momentum that its guide must change in a step.

With I the inertia about the centroid in world axes, the spin is w = I^-1 L. That it is zero about the held axes asks
for a change l of the momentum along them, (I^-1 l)_h = -w_h; it does no work, as nothing turns there.
"""

from dembrick._jit import jit

MOST_CORRECTIONS = 6  # of the momentum in a step
STILL = 1e-15  # of the spin: a part of it that is rounding


@jit
def held_momentum(e1, e2, e3, h1, h2, h3, w1, w2, w3):
    """The change (3) of the angular momentum along the held axes ``h`` that takes the spin ``w`` away there.

    ``e1``, ``e2``, ``e3``: columns of I^-1 in world axes. The rows of free axes say that nothing changes along them.
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
    """Whether the spin ``w`` has no part about the ``held`` axes (3,), but for rounding."""
    most = STILL * max(abs(w1), abs(w2), abs(w3))
    return (not held[0] or abs(w1) <= most) and (not held[1] or abs(w2) <= most) and (not held[2] or abs(w3) <= most)
