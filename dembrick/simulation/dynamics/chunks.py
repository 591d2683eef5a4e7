"""Chunks of steps of a run in real time: calls of the compiled loop, and of the row writer between them."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, NamedTuple

from dembrick._ahead import compile_ahead, compiling
from dembrick._jit import address, compute_fingerprint, get_num_threads, ready
from dembrick.kernels.dynamics.contact_forces import touch
from dembrick.kernels.dynamics.loop import (
    RUNNING,
    STALE,
    Contacts,
    Course,
    Limits,
    Loads,
    advance_bodies,
    advance_bodies_together,
    shares,
)
from dembrick.kernels.dynamics.rigid_bodies import write_rotations
from dembrick.simulation.dynamics import joint_families

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from dembrick.simulation.dynamics.integrator import Motion
    from dembrick.simulation.dynamics.loads import Driving
    from dembrick.simulation.dynamics.state import MovingState
    from dembrick.simulation.dynamics.support_motion import PrescribedMotion

MANY = 2000  # joints from which a step may be worth sharing among threads


def advance_chunk(
    motion: Motion,
    bodies,
    driving: Driving,
    times,
    limits: Limits,
    damping: float,
    dt: float,
    touching=None,
    supports: PrescribedMotion | None = None,
    loads: Loads | None = None,
    room: float = math.inf,
):
    """Advance by a chunk of steps at ``times``, with polygons cut when due; return the status and the steps done.

    ``supports``: their motion in these steps, and perhaps in more, if known; ``loads``: likewise. ``room`` (m):
    greatest displacement of any block while there are no contacts (else ``touching`` has it)."""
    motion.no_contacts.room[0] = room
    state, energy = motion.state, motion.energy
    energy.fit(driving.n_load, len(driving.supports))
    loads = driving.loads(times, dt, supports) if loads is None else loads
    loops = loops_for(motion, bodies)
    fixed = limits, damping, motion.travel, touching
    forms = [compiled(motion, loop, own, dt, state, bodies, loads, *fixed, energy.table) for loop, own in loops]
    done, status = 0, RUNNING
    while status == STALE or (status == RUNNING and done < len(times)):
        which, most = motion.pace.choose(len(loops))
        form, own = forms[which], loops[which][1]
        loads.first[0] = done
        began = time.perf_counter()
        n_steps = min(most, len(times) - done)
        status, some = call_loop(motion, form, n_steps, dt, state, bodies, loads, *fixed, energy.table, own)
        write_rotations(bodies, loads.support)
        done += some
        took = time.perf_counter() - began
        motion.pace.note(which, some, took)
        motion.loop_seconds += took
        if status == STALE:
            state = _cut(motion)
    return status, done


def _cut(motion: Motion) -> MovingState:
    """Cut polygons that are stale; return the state with the new ones."""
    began = time.perf_counter()
    motion.energy.cut(motion.polygons)
    motion.phases["geometry"] += time.perf_counter() - began
    return motion.state


def in_one_thread(motion: Motion) -> bool:
    """Whether the loop runs in one thread, as the scene is small or there is only one."""
    return len(loops_for(motion, motion.state.bodies)) == 1


def advance_rows(
    motion: Motion, driving: Driving, every: int, limits: Limits, loads: Loads, gravity: Sequence, write: Callable
) -> tuple[int, int]:
    """Advance a run in one thread from row to row, ``every`` steps apart; return the status and the steps done.

    ``loads``: of all these steps; ``gravity``: (3) at each of the rows. ``write(steps, gravity)`` writes a row, or
    returns zero if contacts must be detected first, which ends the advance.
    """
    motion.energy.fit(driving.n_load, len(driving.supports))
    motion.no_contacts.room[0] = math.inf
    dt, done, status, code, bodies = motion.time_step, 0, RUNNING, None, motion.state.bodies
    rotate, began = ready(write_rotations, bodies, loads.support), time.perf_counter()
    while done < every * len(gravity):
        if code is None:
            state = motion.state
            ((loop, own),) = loops_for(motion, bodies)
            others = limits, 0.0, motion.travel, motion.contact_detection.touching, motion.energy.table
            compiling_before = motion.compile_seconds
            form = compiled(motion, loop, own, dt, state, bodies, loads, *others)
            began += motion.compile_seconds - compiling_before
            (_, *arguments), _ = arguments_of(motion, form.touch_at, every, dt, state, bodies, loads, *others, own)
            code = form.code
        loads.first[0] = done
        status, some = code(every - done % every, *arguments)
        rotate(bodies, loads.support)
        done += some
        if status == STALE:
            motion.loop_seconds += time.perf_counter() - began
            _cut(motion)
            code, began = None, time.perf_counter()
        elif status != RUNNING or not write(done, gravity[done // every - 1]):
            break
    motion.loop_seconds += time.perf_counter() - began
    return status, done


class Form(NamedTuple):
    """The machine code of a loop for arguments of some types, and the address of `touch` for them (0: no contacts)."""

    code: Callable
    touch_at: int


def compiled(motion: Motion, loop, own, dt: float, state: MovingState, bodies, loads: Loads, *others) -> Form:
    """A ``loop``, compiled or loaded unless that is done already; ``own``: its arguments for the shares of threads;
    ``others``: those between the loads and ``own``, as in `call_loop`. Meanwhile a second process compiles the kernel
    of new contacts.
    """
    limits, *_, touching, table = others
    types = (
        loop is advance_bodies,
        motion.types_of(bodies, *state[1:5], touching, table),
        compute_fingerprint((loads, limits)),
    )
    if types not in motion.forms:
        began, touch_at = time.perf_counter(), 0
        arguments, near = arguments_of(motion, touch_at, 0, dt, state, bodies, loads, *others, own)
        _, _, in_loop, links, *_ = arguments
        contacts = near, links, in_loop, dt
        with compile_ahead(lambda: [compiling(touch, contacts)] if touching is None else []):
            if touching is not None:
                touch_at = address(touch, *contacts)
            motion.forms[types] = Form(ready(loop, *arguments), touch_at)
        motion.compile_seconds += time.perf_counter() - began
    return motion.forms[types]


def call_loop(motion: Motion, form: Form, n_steps: int, dt: float, state: MovingState, bodies, loads: Loads, *others):
    """Call a compiled loop with the blocks in its own order; return status and steps. ``others``: its arguments after
    the loads, without the address; the last are those for the shares of threads."""
    arguments, near = arguments_of(motion, form.touch_at, n_steps, dt, state, bodies, loads, *others)
    found = form.code(*arguments)
    if state.order is not None:
        state.order.leave(bodies, others[-3], near)
    return found


def arguments_of(motion: Motion, touch_at: int, n_steps: int, dt: float, state: MovingState, bodies, loads, *others):
    """The arguments of a loop with the blocks in its own order, and the new contacts among them."""
    limits, damping, travel, touching, table, own = others
    arguments = bodies, state.ties, loads, motion.no_contacts if touching is None else touching
    if state.order is not None:
        arguments = state.order.enter(*arguments)
    in_loop, ties, loads, near = arguments
    course, contacts = Course(*limits, damping=damping, laws=motion.laws, travel=travel), Contacts(touch_at, near)
    return (n_steps, dt, in_loop, *state[1:4], ties, loads, course, contacts, table, own), near


def loops_for(motion: Motion, bodies) -> list[tuple]:
    """The loops for the scene, each with its scratch arrays: for one thread, and for several if it is large."""
    state, threads = motion.state, get_num_threads()
    if len(state.links.host) < MANY or joint_families.of_several_parts(state):
        threads = 1
    wanted = len(bodies.free), threads  # neither joints nor their tiles become more or fewer
    if wanted not in motion.shares:
        loops = [(advance_bodies, shares(state.corners, state.faces, bodies, 1))]
        if threads > 1:
            loops.append((advance_bodies_together, shares(state.corners, state.faces, bodies, threads)))
        motion.shares[wanted] = loops
    return motion.shares[wanted]
