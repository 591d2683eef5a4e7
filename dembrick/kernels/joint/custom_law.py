"""A user-defined law, evaluated point by point, and the dashpots beside it.

The law is a function of the user's, called by its address (`_jit.call_law`). Its arguments are the motion of the point,
the record of the law there, and the memory of the point; it returns the normal and shear force of its springs and the
energy that they store. The work of the step that is not stored counts as lost.

As in `point_law`, dashpots are in series with whatever slips or yields. Their force is scaled by the ratio of the law's
force increment to the elastic one: in full where a point sticks, zero where it slides or softens; in shear also by the
part of the work of its force that the law does not lose. No dashpot makes a pressing point pull, and an open point has
none.
"""

from math import sqrt
from typing import NamedTuple

from numpy import ndarray

from dembrick._jit import call_law, jit
from dembrick.kernels.math.vectors import put_vector

GIVEN, ANSWERS = 4, 4  # numbers in a row of `Custom.move`; of `Custom.answer`, which also begin a row of the memory
ROUNDED = 1e-9  # part of the slip of a step below which its irreversible part counts as zero


class Custom(NamedTuple):
    """One row per contact point; m and k: numbers of the law's own memory, and of its parameters."""

    move: ndarray  # (c, 4) m: penetration, its growth in the step, slip of the step in two directions
    record: ndarray  # (c, 4 + k) m2, N/m, N/m, 1: area, elastic stiffness along the normal and in shear, friction
    memory: ndarray  # (c, 4 + m) N, N, N, J: its result of the last step; the law's own memory
    at: ndarray  # (1,) int64, address of the machine code of the law
    answer: ndarray  # (c, 4) N, N, N, J: normal force, shear force in the sense of slip, energy held
    since: ndarray  # (c, 3) m, growth and slip since the last equilibrium, while blocks swing past the next one
    tried: ndarray  # (c, 4 + m) provisional memory while blocks swing


@jit
def custom_law(custom, i, g, d, slip_1, slip_2, viscous_n, viscous_s, searching):
    """Forces of contact point ``i`` by the law, and its new memory.

    ``g`` penetration now and ``d`` its growth in the step (m); ``slip_*`` of the step (m); ``viscous_*``: dashpot over
    spring force. In a search for an equilibrium (``searching``), all motion counts as one step from the last
    equilibrium, and the memory stays that of there. Returns N, N of the spring alone, the shear force (2), that of the
    spring alone (2), the irreversible length of slip of the step (m), and the work of the step that the law does not
    store (J).
    """
    move = custom.move[i]
    memory = custom.memory[i]
    answer = custom.answer[i]
    record = custom.record[i]
    since = custom.since[i]
    d += since[0]
    slip_1 += since[1]
    slip_2 += since[2]
    put_vector(since, 0.0, 0.0, 0.0)
    move[0] = g
    move[1] = d
    move[2] = slip_1
    move[3] = slip_2
    before = memory[0]
    b1 = memory[1]
    b2 = memory[2]
    held = memory[3]
    if searching:
        put_vector(since, d, slip_1, slip_2)
        tried = custom.tried[i]
        for k in range(memory.size):
            tried[k] = memory[k]
        memory = tried
    call_law(custom.at[0], move, record, memory, answer)
    spring = answer[0]
    e1 = answer[1]
    e2 = answer[2]
    for k in range(ANSWERS):
        memory[k] = answer[k]
    lost = 0.5 * ((b1 + e1) * slip_1 + (b2 + e2) * slip_2 + (before + spring) * d) - (answer[3] - held)
    normal = spring
    t1 = e1
    t2 = e2
    slid = 0.0
    if spring != 0.0:
        stiff = record[1] * d
        if stiff != 0.0:
            normal += viscous_n * stiff * min(max((spring - before) / stiff, 0.0), 1.0)
            if spring > 0.0 and normal < 0.0:
                normal = 0.0
        k = record[2]
        along = slip_1 * slip_1 + slip_2 * slip_2
        if k > 0.0 and along > 0.0:
            part = min(max(((e1 - b1) * slip_1 + (e2 - b2) * slip_2) / (k * along), 0.0), 1.0)
            if lost > 0.0 and part > 0.0:
                at_most = 0.5 * (sqrt(b1 * b1 + b2 * b2) + sqrt(e1 * e1 + e2 * e2)) * sqrt(along)
                part *= max(1.0 - lost / at_most, 0.0)
            t1 += viscous_s * part * k * slip_1
            t2 += viscous_s * part * k * slip_2
            q1 = slip_1 - (e1 - b1) / k
            q2 = slip_2 - (e2 - b2) / k
            slid = sqrt(q1 * q1 + q2 * q2)
            if searching or slid < ROUNDED * sqrt(along):
                slid = 0.0
    return normal, spring, t1, t2, e1, e2, slid, lost


@jit
def resize(custom, i, area, k_n, k_s):
    """Give contact point ``i`` another ``area`` (m2), with springs of ``k_n`` and ``k_s`` (Pa/m); ``custom`` may be
    None. A loss of area reduces forces and stored energy in proportion; a gain begins without any. The law's own memory
    is not changed."""
    if custom is not None:
        record = custom.record[i]
        if area < record[0]:
            for k in range(ANSWERS):
                custom.memory[i, k] *= area / record[0]
        record[0] = area
        record[1] = k_n * area
        record[2] = k_s * area


@jit
def energy_held(custom, i):
    """Energy (J) stored in the springs of point ``i``."""
    return custom.memory[i, 3]


@jit
def shear_held(custom, i):
    """`energy_held` less half the normal force times the penetration, which is counted with the joint."""
    return custom.memory[i, 3] - 0.5 * custom.memory[i, 0] * custom.move[i, 0]


@jit
def shear_power(custom, i, slip_1, slip_2):
    """Work of the shear force of point ``i`` on a slip (J)."""
    return custom.memory[i, 1] * slip_1 + custom.memory[i, 2] * slip_2


@jit
def remember(custom, memory, first, last):
    """Copy the memory of the points ``first`` to ``last`` - 1."""
    if custom is not None:
        for i in range(first, last):
            for k in range(custom.memory.shape[1]):
                memory.memory[i, k] = custom.memory[i, k]
