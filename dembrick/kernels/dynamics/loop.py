"""The compiled loop of dynamic runs: true mass, exact rotations, moving joints.

The caller prepares gravity and loads for a chunk of steps, one entry per step: tilting tables, shaken supports and load
histories are therefore all the same to the loop. Threads share the tiles of joints, then the blocks.
"""

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy import ndarray

from dembrick._jit import call_at, entry, jit, jit_parallel, prange, renamed
from dembrick.kernels.dynamics.block_loads import (
    PressedFaces,
    apply_guides,
    apply_pressures,
    clear_guided,
    clear_pressed,
    clear_tied,
    pull_ties,
)
from dembrick.kernels.dynamics.contact_forces import TOUCHED, Touching, clear_applied
from dembrick.kernels.dynamics.driven_displacement import Head, follow_head, start_head
from dembrick.kernels.dynamics.energy import add_step
from dembrick.kernels.dynamics.joint_families import forces as joint_forces
from dembrick.kernels.dynamics.joint_families import tiles_of
from dembrick.kernels.dynamics.law_memory import in_search, set_law_mode
from dembrick.kernels.dynamics.rigid_bodies import move_support, step_bodies, write_rotations
from dembrick.kernels.dynamics.tiles import WORK, least_slack, rows_of_lanes
from dembrick.kernels.math.vectors import NO_MOMENT, add_wrench, rotate

RUNNING, REACHED, STALE, DIVERGED, MEETING, OVERLOADED = 0, 1, 2, 3, 4, 5


class Loads(NamedTuple):
    """Forces at material points of blocks, gravity, motions of supports, and pressures: one entry per step, perhaps for
    several chunks."""

    first: ndarray  # (1,) int64, the entry of the first step of the chunk
    block: ndarray  # (k,) int64
    lever: ndarray  # (k, 3) m, from the centroid in body axes
    force: ndarray  # (s, k, 3) N, world
    gravity: ndarray  # (s, 3) m/s2, world
    support: ndarray  # (m,) int64, moving supports; below, their state at the end of each step and motion in it
    place: ndarray  # (s, m, 3) m, their centroids, from the origin of `Bodies.position`
    orientation: ndarray  # (s, m, 4) quaternions (w, x, y, z), body to world
    velocity: ndarray  # (s, m, 3) m/s, mean of the step
    spin: ndarray  # (s, m, 3) rad/s, likewise, world
    moved: ndarray  # (s,) m2, square of the longest move of any of their points in the step
    faces: PressedFaces  # polygons under pressure
    multiplier: ndarray  # (s,) V, multiplier of driven pressures
    height: ndarray  # (s, 4) height of a point x, as `Bodies.position`: the first three times x, plus the fourth (m)
    head: Head  # that determines V


class Limits(NamedTuple):
    """Limits at which a chunk ends early."""

    displacement: float  # m, of any centroid from its start
    longest: float  # m, a longer move of a block in a step is divergence


class Course(NamedTuple):
    """Conditions that end a chunk of steps, and its damping."""

    displacement: float  # m, see `Limits`
    longest: float  # m
    damping: float  # local damping, in the search for an equilibrium
    laws: int  # mode of the laws of joints: `law_memory.MOVING` or another
    # (2,) m, how far two blocks may still move against each other before a polygon could be stale; and a bound of the
    # motion of any block since the caller last set it to zero
    travel: ndarray


class Contacts(NamedTuple):
    """New contacts, and the kernel that computes their forces."""

    touch_at: int  # address of `touch`, zero if there are none
    touching: Touching


@jit
def apply_loads(loads, bodies, step):
    """Apply the loads of a step to the blocks."""
    start_head(loads.head, loads.force, loads.multiplier, step)
    block = loads.block
    for k in range(block.size):
        for i in range(6):
            bodies.applied[block[k], i] = 0.0
    clear_pressed(loads.faces, bodies)
    for k in range(block.size):
        b = block[k]
        arm = rotate(bodies.orientation, b, loads.lever[k, 0], loads.lever[k, 1], loads.lever[k, 2])
        add_wrench(bodies.applied[b], 1.0, loads.force[step, k], NO_MOMENT, arm)
    apply_pressures(loads.faces, bodies, loads.multiplier[step], loads.height[step])


class Shares(NamedTuple):
    """Share of each of t threads, and its scratch. ``corners``, ``faces`` and ``bodies`` (t + 1,) int64: first index of
    each share among the tiles of point joints, those of convex joints and the free blocks."""

    work: ndarray  # (t,) records `WORK`
    corners: ndarray
    faces: ndarray
    bodies: ndarray
    moved: ndarray  # (t,) m2, results of each: see `step_bodies`
    away: ndarray  # (t,) m2


def shares(corners, faces, bodies, threads: int) -> Shares:
    """Equal shares for ``threads`` threads."""
    sizes = (tiles_of(corners), tiles_of(faces), bodies.free.size)
    parts = (np.arange(threads + 1) * size // threads for size in sizes)
    return Shares(rows_of_lanes(threads, WORK), *parts, np.zeros(threads), np.zeros(threads))


def advance_bodies(
    n_steps, dt, bodies, links, corners, faces, ties, loads, course, contacts, energy_terms, shares
):  # fmt: skip
    """Advance up to ``n_steps`` steps of ``dt``; ``corners`` or ``faces`` is None if no joint is of that family.

    Returns a status and the number of steps done: RUNNING when all are done, REACHED (a centroid has moved by the
    displacement of the ``course``), STALE (polygons must be cut again before the next step), DIVERGED, or one caused by
    new ``contacts``: MEETING (near pairs must be searched again), OVERLOADED (the time step may be too long for the
    contacts that a block had last), DEEP, CROWDED. ``energy_terms`` may be None.

    A joint writes its own wrench and a block sums those of its joints in a fixed order, so every number is the same to
    the last bit, whatever the number of threads that ``shares`` are for. New contacts, few compared with the joints,
    are computed by one thread.
    """
    work = shares.work
    share_corners = shares.corners
    share_faces = shares.faces
    share_bodies = shares.bodies
    moved = shares.moved
    away = shares.away
    damping = course.damping
    travel = course.travel
    searching = in_search(course.laws)
    touching = contacts.touching
    goal2 = course.displacement**2
    longest2 = course.longest**2
    meeting = contacts.touch_at != 0
    loaded = loads.block.size > 0 or loads.faces.block.size > 0 or ties.stiffness.size > 0 or meeting
    loaded = loaded or bodies.guided.size > 0
    for t in range(moved.size):
        set_law_mode(work[t], course.laws)
    touching.laws[0] = course.laws
    for done in range(n_steps):
        step = loads.first[0] + done
        if travel[0] <= 0.0:
            travel[0] = least_slack(links)
            if travel[0] <= 0.0:
                return STALE, done
        if touching.room[0] <= 0.0:
            return MEETING, done
        if meeting:
            if touching.overloaded[0] > 0:
                return OVERLOADED, done
            clear_applied(touching, bodies)
        clear_tied(ties, bodies)
        clear_guided(bodies)
        apply_loads(loads, bodies, step)
        pull_ties(ties, bodies, searching)
        for t in prange(moved.size):
            joint_forces(links, corners, faces, bodies, share_corners, share_faces, t, energy_terms, work[t])
        if meeting:
            write_rotations(bodies, loads.support)
            touched = call_at(contacts.touch_at, touching, links, bodies, dt)
            if touched != TOUCHED:
                return touched, done
        g = loads.gravity[step]  # threads receive only arrays and tuples of arrays
        follow_head(loads.head, loads, bodies, links.wrenches, g[0], g[1], g[2], dt, damping, step)
        if energy_terms is not None:
            joints = links, corners, faces
            mean = add_step(energy_terms, bodies, joints, ties, loads, meeting, touching, step, dt)
        apply_guides(bodies, links.wrenches, g[0], g[1], g[2], dt, damping)
        for t in prange(moved.size):
            share = share_bodies[t], share_bodies[t + 1]
            if energy_terms is None:
                moved[t], away[t] = step_bodies(
                    bodies, links.wrenches, loaded, share, g, dt, damping, None, None, work[t]
                )
            if energy_terms is not None:
                moved[t], away[t] = step_bodies(
                    bodies, links.wrenches, loaded, share, g, dt, damping, energy_terms.fallen, mean, work[t]
                )
        moved2 = away2 = 0.0
        for k in range(loads.support.size):
            move_support(
                bodies, loads.support[k], loads.place[step, k], loads.orientation[step, k], loads.velocity[step, k],
                loads.spin[step, k],
            )  # fmt: skip
            moved2 = loads.moved[step]
        for t in range(moved.size):
            if moved[t] > moved2 or moved[t] != moved[t]:
                moved2 = moved[t]
            away2 = max(away2, away[t])
        if not moved2 <= longest2:
            return DIVERGED, done + 1
        if away2 >= goal2:
            return REACHED, done + 1
        move = sqrt(moved2)
        travel[0] -= 2.0 * move
        travel[1] += move
        touching.room[0] -= move
    return RUNNING, n_steps


# One source, compiled twice: without threads `prange` is `range`. Small scenes neither call nor compile the second.
advance_bodies_together = jit_parallel(renamed(advance_bodies, "advance_bodies_together"))
advance_bodies = entry(advance_bodies)
