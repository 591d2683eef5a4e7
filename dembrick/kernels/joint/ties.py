"""The law of a tie: a bar, cable or prop along the line between two points of two blocks.

T = T_0 + k (l - l_0 - l_p), but zero instead of compression if it takes tension only; at its strength it yields without
hardening, and l_p grows by the excess elongation. Both engines call `tie_force` once per tie and step, in the moving
geometry.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy import ndarray

from dembrick._jit import jit
from dembrick.kernels.math.vectors import put_vector, rotate

# Of a tie: length (m), tension (N), plastic elongation (m)
TIE = np.dtype((np.record, [("length", float), ("tension", float), ("yielded", float)]))
SHORTEST = 1e-12  # m, below it the line of a tie has no direction


class Ties(NamedTuple):
    """The t ties of a scene, possibly none."""

    block: ndarray  # (t, 2) int64, blocks a and b
    lever: ndarray  # (t, 2, 3) m, from their centroids to the ends, body axes
    offset: ndarray  # (t, 3) m, centroid of b seen from that of a at the start, world
    stiffness: ndarray  # (t,) N/m
    strength: ndarray  # (t,) N, infinite if it never yields
    least: ndarray  # (t,) N, zero if it takes tension only, else minus the strength
    prestress: ndarray  # (t,) N, T_0
    length: ndarray  # (t,) m, l_0
    now: ndarray  # (t,) record `TIE`
    before: ndarray  # (t,) record `TIE`, a step ago
    force: ndarray  # (t, 3) N, on the end of a, world
    arm: ndarray  # (t, 2, 3) m, from the centroids to the ends now, world


@jit
def stretch(ties, t, searching, s1, s2, s3):
    """Update the force and the state of tie ``t`` for the line s from its end on a to that on b (m, world); it does not
    yield while blocks swing."""
    now = ties.now[t]
    before = ties.before[t]
    before.length = now.length
    before.tension = now.tension
    before.yielded = now.yielded
    k = ties.stiffness[t]
    least = ties.least[t]
    length = sqrt(s1 * s1 + s2 * s2 + s3 * s3)
    tension = ties.prestress[t] + k * (length - ties.length[t] - now.yielded)
    if tension > ties.strength[t]:
        now.yielded += 0.0 if searching else (tension - ties.strength[t]) / k
        tension = ties.strength[t]
    if tension < least:
        if least < 0.0 and not searching:
            now.yielded += (tension - least) / k
        tension = least
    now.length = length
    now.tension = tension
    share = tension / max(length, SHORTEST)
    put_vector(ties.force[t], share * s1, share * s2, share * s3)


@jit
def tie_force(ties, t, q, away, searching):
    """Update arms, force and state of tie ``t`` for the orientations ``q`` (n, 4) of the blocks and the vector ``away``
    (3) from the centroid of a to that of b (m, world); ``searching``: see `stretch`."""
    arm = ties.arm[t]
    for side in range(2):
        lever = ties.lever[t, side]
        r1, r2, r3 = rotate(q, ties.block[t, side], lever[0], lever[1], lever[2])
        put_vector(arm[side], r1, r2, r3)
    d1, d2, d3 = away
    stretch(
        ties, t, searching, d1 + (arm[1, 0] - arm[0, 0]), d2 + (arm[1, 1] - arm[0, 1]), d3 + (arm[1, 2] - arm[0, 2])
    )


@jit
def tie_energy(ties):
    """Elastic energy of all ties (J)."""
    total = 0.0
    for t in range(ties.stiffness.size):
        total += 0.5 * ties.now[t].tension ** 2 / ties.stiffness[t]
    return total


@jit
def tie_losses(ties):
    """Energies that all ties lost in the last step (J): by yielding, and by becoming tight or slack within the step."""
    yielding = stepping = 0.0
    for t in range(ties.stiffness.size):
        now = ties.now[t]
        before = ties.before[t]
        mean = 0.5 * (before.tension + now.tension)
        yielded = mean * (now.yielded - before.yielded)
        held = mean * (now.tension - before.tension) / ties.stiffness[t]
        yielding += yielded
        stepping += mean * (now.length - before.length) - held - yielded
    return yielding, stepping
