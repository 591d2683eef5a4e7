"""The joint between a free block and a fixed one, and its equilibria by Newton's method.

In the geometry of the start such a joint is a structure of its own. Statics gives the wrench that it carries,
t(u) = g + V f: t = (V_1, V_2, -N, M_1, M_2, M_T) at its centroid O does work on the motion u = (d1, d2, dn, r1, r2, rn)
of b against a, g is the dead load and f the load of the actuators for V = 1. At a given driven displacement f.u there
are seven unknowns, u and V; friction is implicit (backward Euler), from the memory of the last equilibrium.

Many joints are stored one after another in the same arrays; `lone_search` follows each to its limit load.
"""

from math import isfinite, sqrt
from typing import NamedTuple

import numpy as np
from numpy import ndarray

from dembrick._jit import jit
from dembrick.kernels.math.vectors import put_vector
from dembrick.kernels.state import Joints
from dembrick.kernels.statics import joint_families as families
from dembrick.kernels.statics.area_joints import Areas
from dembrick.kernels.statics.load_bounds import Basis
from dembrick.kernels.statics.newton import trial_resultant
from dembrick.kernels.statics.point_joints import Points
from dembrick.kernels.statics.small_displacement import motion_at

MOST_ITERATIONS = 30  # of Newton's method for an equilibrium
BACKTRACKS = 8  # most halvings of a Newton step
ENOUGH = 0.9  # part of the out-of-balance that an accepted full step may leave
HELD = 1e-10  # part of the elastic stiffness that is added to the tangent
DIFFERENCE = 1e-6  # step of the tangent's differences, over the elastic displacement of the joint
RESTING, RUNNING, CONVERGED, LOST, FALLS, UNLIMITED = 0, 1, 2, 3, 4, 5  # status of a search


# State of the search of a joint; all numbers of one type, as in a checkpoint
SEARCH = np.dtype(
    (
        np.record,
        [
            ("load", float),  # N, V
            ("driven", float),  # m, f.u
            ("start", float),  # m, f.u at which the path begins
            ("step", float),  # m, to the next equilibrium
            ("longest", float),  # m
            ("moved", float),  # m, by the last step
            ("peak", float),  # N, the greatest V so far
            ("peak_at", float),  # m, f.u there
            ("compliance", float),  # m/N, elastic, of f.u
            ("equilibria", float),
            ("iterations", float),
            ("status", float),
            ("strict", float),
            ("extrapolated", float),  # whether the next equilibrium is predicted by `predict_rocking`
            ("unbalanced", float),  # out-of-balance over joint force at the last equilibrium
        ],
    )
)


class LoneJoints(NamedTuple):
    """k joints, each between a free block and a fixed one, with their memory, loads and searches."""

    joints: Joints
    points: Points | None
    areas: Areas | None
    point_memory: Points | None  # of the last equilibrium
    area_memory: Areas | None
    base: ndarray  # (k, 6) m, rad: u of the last equilibrium
    direction: ndarray  # (k, 6) predictor of the next: change of u per driven displacement
    secant: ndarray  # (k, 6) the same over the last step
    dead: ndarray  # (k, 6) N, N m: g
    unit: ndarray  # (k, 6) f
    reach: ndarray  # (k,) m, greatest distance from O at which shear is carried
    stiffness: ndarray  # (k, 6, 6) elastic dt/du
    search: ndarray  # (k,) records `SEARCH`
    basis: Basis  # with one entry per joint, and for all contact points
    bracket: ndarray  # (k, 2) N
    twist: ndarray  # (k, 3) slip twist of the upper bound, where strict
    seen: ndarray  # (k, 3, 4) inelastic driven displacement (m), V and its bounds (N): when the first was at most a
    # quarter and a half of its present value, with the extreme bounds since; and now


class Room(NamedTuple):
    """Scratch for the equilibria of one joint after another."""

    motion: ndarray  # (6,) m, rad: u
    forces: ndarray  # (7, 6) N, N m: t of six neighbours, and t
    tangent: ndarray  # (6, 6) dt/du
    equations: ndarray  # (7, 8)
    change: ndarray  # (7,) of u and V by a Newton step
    begin: ndarray  # (6,) u at the start of the Newton step


def new_room() -> Room:
    """Scratch for the search of one joint."""
    return Room(*(np.zeros(shape) for shape in (6, (7, 6), (6, 6), (7, 8), 7, 6)))


@jit
def wrench_at(lone, family, index, j, u, out):
    """t for the motion ``u`` (6) from the memory, into ``out`` (6,); returns the slip path (m)."""
    n, v1, v2, mt, m1, m2, slip = trial_resultant(
        lone.points, lone.areas, lone.point_memory, lone.area_memory, family, index, lone.joints.gap[j], lone.base[j], u
    )
    put_vector(out, v1, v2, -n)
    put_vector(out[3:], m1, m2, mt)
    return slip


@jit
def out_of_balance(lone, j, t, v):
    """Out-of-balance (N) of joint ``j`` with the wrench ``t`` (6) under the load ``v`` (N), moments over the reach."""
    reach = lone.reach[j]
    total = 0.0
    for i in range(3):
        r = lone.dead[j, i] + v * lone.unit[j, i] - t[i]
        m = (lone.dead[j, i + 3] + v * lone.unit[j, i + 3] - t[i + 3]) / reach
        total += r * r + m * m
    return sqrt(total)


@jit
def size_of(wrench, reach):
    """Norm (N) of a ``wrench`` (6), moments divided by the ``reach`` (m)."""
    total = 0.0
    for i in range(3):
        total += wrench[i] * wrench[i] + wrench[i + 3] * wrench[i + 3] / (reach * reach)
    return sqrt(total)


@jit
def greatest_force(lone, j, t):
    """Norm (N) of the wrench ``t`` (6) of joint ``j``, or of its dead load if that is greater."""
    return max(size_of(t, lone.reach[j]), size_of(lone.dead[j], lone.reach[j]))


@jit
def tangent_by_differences(lone, family, index, j, room):
    """dt/du at the motion in ``room``, by finite differences of the law, for any law."""
    u = room.motion
    t = room.forces
    move = DIFFERENCE * greatest_force(lone, j, t[6]) / lone.stiffness[j, 2, 2]
    for i in range(7):
        h = move if i < 3 else move / lone.reach[j]
        here = u[i % 6]
        u[i % 6] += h if i < 6 else 0.0
        wrench_at(lone, family, index, j, u, t[i])
        u[i % 6] = here
    for i in range(6):
        h = move if i < 3 else move / lone.reach[j]
        for k in range(6):
            room.tangent[k, i] = (t[i, k] - t[6, k]) / h


@jit
def tangent_at(lone, family, index, j, room):
    """dt/du at the motion in ``room``, for which `wrench_at` was called last."""
    u = room.motion
    known = families.exact_tangent(
        lone.points, lone.areas, lone.point_memory, lone.area_memory, family, index, -room.forces[6, 2],
        (u[2] + lone.joints.gap[j], u[3], u[4]), room.tangent,
    )  # fmt: skip
    if not known:
        tangent_by_differences(lone, family, index, j, room)


@jit
def solve(a, n, x):
    """Solve the ``n`` equations ``a`` (n, n + 1), their right-hand side in the last column, for ``x``, by elimination
    with row pivots. False if they are singular."""
    for c in range(n):
        pivot = c
        for r in range(c + 1, n):
            if abs(a[r, c]) > abs(a[pivot, c]):
                pivot = r
        if not abs(a[pivot, c]) > 0.0:
            return False
        if pivot != c:
            for k in range(c, n + 1):
                kept = a[c, k]
                a[c, k] = a[pivot, k]
                a[pivot, k] = kept
        for r in range(c + 1, n):
            part = a[r, c] / a[c, c]
            if part != 0.0:
                for k in range(c, n + 1):
                    a[r, k] -= part * a[c, k]
    for c in range(n - 1, -1, -1):
        total = a[c, n]
        for k in range(c + 1, n):
            total -= a[c, k] * x[k]
        x[c] = total / a[c, c]
    return True


@jit
def newton_step(lone, j, v, target, tangent, room):
    """Change (7) of u and V by Newton's method to the driven displacement ``target`` (m), or of u alone at ``v`` (N) if
    ``target`` is not finite. False if the equations are singular.

    Moments are divided by the reach, and the unknown of V is a displacement, so that pivots are comparable.
    """
    a = room.equations
    reach = lone.reach[j]
    scale = lone.stiffness[j, 0, 0]
    held = isfinite(target)
    last = 7 if held else 6  # column of the right-hand side
    behind = target
    for i in range(6):
        row = 1.0 if i < 3 else 1.0 / reach
        for k in range(6):
            column = 1.0 if k < 3 else 1.0 / reach
            a[i, k] = row * column * (tangent[i, k] + HELD * lone.stiffness[j, i, k])
        f = lone.unit[j, i]
        a[i, 6] = -scale * row * f
        a[6, i] = scale * row * f
        a[i, last] = row * (lone.dead[j, i] + v * f - room.forces[6, i])
        behind -= f * room.motion[i]
    a[6, 6] = 0.0
    a[6, 7] = scale * behind
    room.change[6] = 0.0
    found = solve(a, last, room.change)
    room.change[6] *= scale
    for i in range(3, 6):
        room.change[i] /= reach
    return found


@jit
def find_equilibrium(lone, family, index, j, v, target, balanced, room):
    """The equilibrium near the motion in ``room``, with the driven displacement ``target`` (m); if that is not finite,
    under the load ``v`` (N), by an elastic first step.

    ``balanced``: out-of-balance over joint force at convergence. Returns whether it was found, V (N), the slip path
    (m), the iterations and the out-of-balance (N). A full Newton step is taken if it reduces the out-of-balance enough,
    or is the first; else the one of its halvings that leaves the least out of balance.
    """
    u = room.motion
    t = room.forces[6]
    begin = v
    size = least = slip = left = 0.0
    part = best = 1.0
    halves = iterations = 0
    going = True
    while going:
        slip = wrench_at(lone, family, index, j, u, t)
        left = out_of_balance(lone, j, t, v)
        if iterations > 0 and left <= balanced * greatest_force(lone, j, t):
            break
        if halves == 0 or left < least:
            least = left
            best = part
        taken = iterations <= 1 or left <= ENOUGH * size or halves >= BACKTRACKS
        if taken and (left <= least or iterations == 0):
            going = isfinite(left) and iterations < MOST_ITERATIONS
            if going:
                if iterations == 0 and not isfinite(target):
                    going = newton_step(lone, j, v, target, lone.stiffness[j], room)
                else:
                    tangent_at(lone, family, index, j, room)
                    going = newton_step(lone, j, v, target, room.tangent, room)
            for i in range(6):
                room.begin[i] = u[i]
            begin = v
            size = left
            part = 1.0
            halves = 0
            iterations += 1
        else:
            part = best if taken else 0.5 * part
            halves += 1
        for i in range(6):
            u[i] = room.begin[i] + part * room.change[i]
        v = begin + part * room.change[6]
    return going, v, slip, iterations, left


@jit
def accept(lone, family, index, j, slip, room):
    """Make the equilibrium in ``room`` that of joint ``j``, with its ``slip`` path (m), and store its memory."""
    u = room.motion
    t = room.forces[6]
    joints = lone.joints
    base = lone.base[j]
    tilts = 0.0, u[3] - base[3], u[4] - base[4]
    motion_at(joints, j, (u[2] + joints.gap[j], u[3], u[4]), tilts, (u[0] - base[0], u[1] - base[1], u[5] - base[5]))
    resultant = joints.resultant[j]
    put_vector(resultant, -t[2], t[0], t[1])
    put_vector(resultant[3:], t[5], t[3], t[4])
    resultant[6] = slip
    for i in range(6):
        joints.relative[j, i] = u[i]
        base[i] = u[i]
    families.recall(lone.point_memory, lone.area_memory, lone.points, lone.areas, family, index)
