"""The guards of a run in words: what the time loop watches, and what is said when it stops."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dembrick.errors import DivergedError
from dembrick.kernels.statics.divergence import RUNAWAY as TIMES
from dembrick.kernels.statics.divergence import Guard
from dembrick.kernels.statics.loop import DIVERGED, RUNAWAY
from dembrick.simulation.statics.state import State, turned_blocks

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly

DROPPED = 0.5  # of the least dimension of a block: one that has come down by more has fallen
LONGEST_MOVE = 0.1  # of the smallest block: a step that moves a block further has diverged
LOOK = 64  # steps between two looks at the energy, at most; a power of two
STRETCHES = 64  # of a constant-rate test, over which its load is summed


def new_guard(assembly: Assembly, state: State, steps: int | None = None) -> Guard:
    """The guard of a run that starts from ``state``, all blocks at rest, for so many ``steps`` (None: unknown)."""
    look, stretch = LOOK, 1 << 62
    if steps is not None:
        wanted = max(1, steps // STRETCHES)
        look = min(LOOK, 1 << (wanted.bit_length() - 1))
        stretch = look * (wanted // look)
    return Guard(
        longest=LONGEST_MOVE * min(float(np.ptp(shape.vertices, axis=0).min()) for shape in assembly.shapes),
        mask=look - 1,
        stretch=stretch,
        weights=float(np.abs(state.actuators.weight).sum()),
        turned=turned_blocks(state),
        start=np.zeros(2),
        work=np.zeros(2),
        sums=np.zeros(3),
        load=np.zeros((1 if steps is None else -(-steps // stretch), 3)),
    )


def refuse_divergence(status: int, assembly: Assembly, state: State, steps: int, dt: float, critical: float) -> None:
    """DivergedError if a guard ended the run: which block, at which joint, when, and the time step it was made with.

    ``status`` is that of the loop, ``critical`` the critical time step (s).
    """
    if status not in (DIVERGED, RUNAWAY):
        return
    blocks, joints = state.blocks, state.joints
    speed = np.abs(blocks.velocity).max(axis=1) + np.abs(blocks.spin).max(axis=1)
    lost = np.flatnonzero(~np.isfinite(speed))
    if len(lost):
        b, did = int(lost[0]), "has a velocity that is no number"
    elif status == RUNAWAY:
        b = _most_energy(assembly, state)
        did = f"moves where the blocks have more than {TIMES:g} times the energy that dead loads and actuators put in"
    else:
        b = int(np.argmax(np.abs(blocks.velocity).max(axis=1)))
        did = f"moved more than {LONGEST_MOVE:g} of the smallest block in one step"
    fall = came_down(assembly, state)
    if fall:
        raise DivergedError(f"{fall} (step {steps}, t = {steps * dt:.4g} s)")
    raise DivergedError(
        f"the run diverged at step {steps} (t = {steps * dt:.4g} s): block {assembly.names[b]!r} "
        f"({_joint_of(b, assembly, joints)}) {did}; the time step {dt:.3g} s is {dt / critical:.2f} of the critical "
        "one. Lower solver.step_factor, or check the load"
    )


def came_down(assembly: Assembly, state: State) -> str | None:
    """A sentence on the free blocks that lie lower than they were by more than half of their least dimension, as after
    a fall that joints of the start know nothing of; None without any."""
    weight = float(np.linalg.norm(assembly.gravity))
    if not weight > 0.0:
        return None
    drop = state.blocks.displacement @ (np.asarray(assembly.gravity, float) / weight)
    least = np.array([float(np.ptp(shape.vertices, axis=0).min()) for shape in assembly.shapes])
    low = np.flatnonzero(~np.asarray(assembly.fixed) & (drop > DROPPED * least))
    if not len(low):
        return None
    deepest = int(low[np.argmax(drop[low])])
    more = f" (and {len(low) - 1} more)" if len(low) > 1 else ""
    return (
        f"block {assembly.names[deepest]!r}{more} has come down by {drop[deepest]:.3g} m: a constant-rate test knows "
        "the joints of its start only and ends where blocks fall; shorten control.travel (the record is right up to "
        'the fall), or live through the fall with control.kind = "dynamic"'
    )


def _most_energy(assembly: Assembly, state: State) -> int:
    """The free block that moves with most kinetic energy, by its physical inertia."""
    blocks, free = state.blocks, state.blocks.free
    moment = np.trace(np.asarray(assembly.inertia)[free], axis1=1, axis2=2) / 3.0
    energy = np.asarray(assembly.mass)[free] * (blocks.velocity[free] ** 2).sum(axis=1)
    return int(free[np.argmax(energy + moment * (blocks.spin[free] ** 2).sum(axis=1))])


def _joint_of(b: int, assembly: Assembly, joints) -> str:
    """The joint of block ``b`` that carries most, or that carries no number."""
    mine = np.flatnonzero((joints.block_a == b) | (joints.block_b == b))
    if not len(mine):
        return "no joint"
    force = np.linalg.norm(joints.resultant[mine, :3], axis=1)
    j = mine[np.argmax(np.where(np.isfinite(force), force, np.inf))]
    return f"joint {assembly.names[joints.block_a[j]]}-{assembly.names[joints.block_b[j]]}"
