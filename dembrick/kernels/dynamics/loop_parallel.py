"""The loop of `dynamics` on several threads, for scenes of many thousand joints.

Threads share the tiles of joints, then the blocks. A joint writes its own wrench and a block gathers its joints in
their order, so every number is, to the last bit, that of the serial loop, whatever the number of threads.
"""

from math import sqrt

import numpy as np

from dembrick._jit import get_num_threads, jit_parallel, prange
from dembrick.kernels.dynamics.area_joints import face_forces
from dembrick.kernels.dynamics.contact_forces import TOUCHED, clear_applied, touch
from dembrick.kernels.dynamics.energy import book_step
from dembrick.kernels.dynamics.loop import DIVERGED, MEETING, OVERLOADED, REACHED, RUNNING, STALE, apply_loads
from dembrick.kernels.dynamics.point_joints import corner_forces
from dembrick.kernels.dynamics.rigid_bodies import step_bodies
from dembrick.kernels.dynamics.tiles import WORK, least_slack, rows_of_lanes


def shares(corners, faces, bodies) -> tuple[np.ndarray, ...]:
    """The last six arguments of `advance_bodies_together`: equal shares for as many threads as numba may use."""
    threads = get_num_threads()
    sizes = (0 if corners is None else corners.used.size, 0 if faces is None else faces.used.size, bodies.free.size)
    parts = (np.linspace(0, size, threads + 1).astype(np.int64) for size in sizes)
    return rows_of_lanes(threads * WORK).reshape(threads, WORK), *parts, np.zeros(threads), np.zeros(threads)


@jit_parallel
def advance_bodies_together(
    n_steps, dt, bodies, links, corners, faces, loads, limits, damping, travel, touching, books, work,
    share_corners, share_faces, share_bodies, moved, away,
):  # fmt: skip
    """As `advance_bodies`, with the work shared; new contacts, few beside the joints, are one thread's.

    ``share_*`` (t + 1,) int64: where the share of each thread begins among tiles of point joints, of convex joints and
    free blocks; ``work`` (t, WORK): scratch; ``moved`` and ``away`` (t,) m2: room for what each thread finds.
    """
    goal2 = limits.displacement**2
    longest2 = limits.longest**2
    for step in range(n_steps):
        if travel[0] <= 0.0:
            travel[0] = least_slack(links)
            if travel[0] <= 0.0:
                return STALE, step
        if touching is not None:
            if touching.room[0] <= 0.0:
                return MEETING, step
            if touching.overloaded[0] > 0:
                return OVERLOADED, step
            clear_applied(touching, bodies)
        apply_loads(loads, bodies, step)
        for t in prange(moved.size):
            if corners is not None:
                corner_forces(
                    links, corners, bodies, share_corners[t], share_corners[t + 1], corners.force, books, work[t]
                )
            if faces is not None:
                face_forces(links, faces, bodies, share_faces[t], share_faces[t + 1], books, work[t])
        if touching is not None:
            touched = touch(touching, links, bodies, dt)
            if touched != TOUCHED:
                return touched, step
        if books is not None:
            mean = book_step(books, bodies, links, corners, faces, loads, touching, step, dt)
        for t in prange(moved.size):
            if books is None:
                moved[t], away[t] = step_bodies(
                    bodies, links.wrench, share_bodies[t], share_bodies[t + 1], loads.gravity[step], dt, damping, None,
                    None, work[t],
                )  # fmt: skip
            if books is not None:
                moved[t], away[t] = step_bodies(
                    bodies, links.wrench, share_bodies[t], share_bodies[t + 1], loads.gravity[step], dt, damping,
                    books.fallen, mean, work[t],
                )  # fmt: skip
        moved2 = away2 = 0.0
        for t in range(moved.size):
            if moved[t] > moved2 or moved[t] != moved[t]:
                moved2 = moved[t]
            away2 = max(away2, away[t])
        if not moved2 <= longest2:
            return DIVERGED, step + 1
        if away2 >= goal2:
            return REACHED, step + 1
        move = sqrt(moved2)
        travel[0] -= 2.0 * move
        travel[1] += move
        if touching is not None:
            touching.room[0] -= move
    return RUNNING, n_steps
