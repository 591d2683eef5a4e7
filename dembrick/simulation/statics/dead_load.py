"""Equilibrium under the dead loads, before any actuator moves: found directly, not waited for."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dembrick._jit import ready
from dembrick.errors import HistoryError, NotConvergedError
from dembrick.kernels.state import ScaledInertia
from dembrick.kernels.statics.loop import settle
from dembrick.simulation import interrupts
from dembrick.simulation.checkpoint_arrays import flattened, restored_state
from dembrick.simulation.session import DEAD_LOADS, Progress, Session, Snapshot
from dembrick.simulation.statics import joint_families, ties
from dembrick.simulation.statics.elastic_factor import touches_itself, whole_inertia
from dembrick.simulation.statics.sparse_equations import Factors
from dembrick.simulation.statics.state import State
from dembrick.simulation.statics.yield_point import mechanism_of, moving_blocks

UNBALANCED = 1e-12  # of the joint forces
MOST_STEPS = 20_000
FIRST_STEPS = 30  # without momentum, for blocks on fixed ones
MOMENTUM = 0.9  # of the last move that is kept where blocks stand on free blocks
FEW = 8  # steps in the first chunk, before the pace is known
SNAPSHOT = "dead_load"  # what a checkpoint of it has, and no other
CHUNK_SECONDS = 0.2  # of a chunk: a signal is answered within that


def inverse_inertia(state: State, inertia: np.ndarray) -> ScaledInertia:
    """Generalised inertia (n, 6, 6), inverted for every free block."""
    inverse = np.zeros_like(inertia)
    free = state.blocks.free
    inverse[free] = np.linalg.inv(inertia[free])
    return ScaledInertia(inverse, np.ascontiguousarray(inertia), None)


@dataclass(frozen=True)
class Rest:
    """What the dead loads leave: whether the blocks stand, the out-of-balance over the joint forces and the steps that
    took; of blocks that fall their numbers and the mechanism; seconds of compiling and of relaxing."""

    stands: bool
    unbalanced: float
    steps: int
    mechanism: str | None
    blocks: tuple[int, ...]
    compile_seconds: float
    loop_seconds: float


def dead_load_equilibrium(
    state: State, stiffness: np.ndarray, names, factor: Factors | None = None, session: Session | None = None
) -> Rest:
    """`rest` of blocks that must stand: NotConvergedError, which names those that do not."""
    found = rest(state, stiffness, factor, session)
    if not found.stands:
        raise NotConvergedError(
            f"{does_not_stand(found, names)} before any actuator moves; no equilibrium under the dead loads was found "
            f"in {found.steps} steps, the out-of-balance force is still {found.unbalanced:.2g} of the joint forces. "
            "Check loads, friction and supports"
        )
    return found


def does_not_stand(found: Rest, names) -> str:
    """The sentence that says which blocks fall, and how."""
    moving = [names[i] for i in found.blocks]
    more = f" and {len(moving) - 5} more" if len(moving) > 5 else ""
    falls = "falls" if len(moving) == 1 else "fall"
    return f"does not stand: {', '.join(moving[:5])}{more} {falls} by {found.mechanism}"


def rest(state: State, stiffness: np.ndarray, factor: Factors | None = None, session: Session | None = None) -> Rest:
    """Relax ``state`` until the out-of-balance forces are ``UNBALANCED`` of the joint forces.

    Where free blocks touch only fixed ones, every block moves by the answer of its own ``stiffness`` (n, 6, 6) to its
    out-of-balance: a single Newton step is enough. Else the whole assembly moves by its elastic answer, ``factor`` is
    that of its stiffness, first in one go and then with momentum, which is dropped whenever it works against the
    forces. ``session`` keeps checkpoints of it, and may go on from one. Blocks that fall are those that still move at
    the end. Raises Interrupted.

    Where joints have bonds they hold until the blocks rest; those that bear too much then break, and the others must
    carry the loads without them.
    """
    joints, blocks = state.joints, state.blocks
    began = time.perf_counter()
    alone = not touches_itself(state)
    if not alone:
        if factor is None:
            raise ValueError("free blocks that touch each other need the factor of their stiffness")
        none = np.zeros((0, 6, 6))
        inertia = ScaledInertia(none, none, whole_inertia(factor))
    else:
        inertia = inverse_inertia(state, stiffness)
    bonded, blocks = joint_families.has_strengths(state), state.blocks
    if bonded and not (blocks.dead_force.any() or blocks.dead_torque.any()):
        return Rest(True, 0.0, 0, None, (), 0.0, 0.0)  # what holds by itself
    relax = ready(settle, 0, 0, UNBALANCED, *state[:4], inertia, MOMENTUM)
    compiled = time.perf_counter()
    # where blocks stand alone and do not come to rest at once, what opened is softer than the closed joint whose answer
    # each step is
    rounds = ((FIRST_STEPS, 0.0, False), (MOST_STEPS, MOMENTUM, False)) if alone else ((MOST_STEPS, MOMENTUM, False),)
    if bonded:
        rounds = (*((most, momentum, True) for most, momentum, _ in rounds), *rounds)
    ratio, steps = _Relaxation(state, inertia, rounds, relax).run(session or Session())
    done = time.perf_counter()
    seconds = compiled - began, done - compiled
    if not ratio <= UNBALANCED:
        moving = moving_blocks(state)
        if moving:
            return Rest(False, ratio, steps, mechanism_of(state), moving, *seconds)
        ratio = 0.0  # there is no force at all: no gravity and no loads
    ties.remember(state)
    blocks.velocity[:] = 0.0
    blocks.spin[:] = 0.0
    joints.step[:] = 0.0
    joints.tilt[:] = 0.0
    return Rest(True, ratio, steps, None, (), *seconds)


class _Relaxation:
    """The relaxation, chunk by chunk: ``rounds`` of (most steps, momentum, whether bonds are held), until one of them
    balances the forces; where that was one with held bonds, until one does without. ``settle``: the kernel."""

    def __init__(
        self, state: State, inertia: ScaledInertia, rounds: tuple[tuple[int, float, bool], ...], settle: Callable
    ):
        self._state, self._inertia, self._rounds, self._settle = state, inertia, rounds, settle
        self._bonded = any(held for _, _, held in rounds)
        self._round = self._step = 0

    def run(self, session: Session) -> tuple[float, int]:
        """The unbalanced-force ratio reached, and the steps of the last round."""
        if session.resumed is not None and SNAPSHOT in session.resumed:
            self._restore(session.resumed)
            session.resumed = None
        elif session.resumed is not None:
            session = Session(output=session.output)  # what is kept is further on, and must not be written over
        ratio, pace = 1.0, FEW
        with interrupts.deferred():
            while True:
                most, momentum, held = self._rounds[self._round]
                if self._bonded:
                    joint_families.hold_bonds(self._state, held)
                steps, began = min(pace, most - self._step), time.perf_counter()
                if self._state.ties is not None:
                    ties.pull(self._state)
                    steps = 1  # their forces follow every step
                ratio, self._step = self._settle(
                    self._step, steps, UNBALANCED, *self._state[:4], self._inertia, momentum
                )  # fmt: skip
                pace = max(1, min(int(steps * CHUNK_SECONDS / max(time.perf_counter() - began, 1e-9)), 16 * steps))
                balanced, last = ratio <= UNBALANCED, self._round + 1 == len(self._rounds)
                if (balanced and not held) or (self._step >= most and last):
                    return ratio, self._step
                if balanced:
                    self._round, self._step = sum(held for _, _, held in self._rounds), 0
                elif self._step >= most:
                    self._round, self._step = self._round + 1, 0
                session.pause(self)

    @property
    def where(self) -> str:
        return f"step {self._step} of the dead-load equilibrium"

    @property
    def progress(self) -> Progress:
        return Progress(DEAD_LOADS, self._step)

    def snapshot(self) -> dict[str, np.ndarray]:
        return {SNAPSHOT: np.array([self._round, self._step], float), **flattened({"state": self._state})}

    def _restore(self, snapshot: Snapshot) -> None:
        """Take it from a snapshot of the same scene; HistoryError if it is of another."""
        at, step = snapshot.array(SNAPSHOT, np.zeros(2)).tolist()
        if not (at in range(len(self._rounds)) and step in range(self._rounds[int(at)][0])):
            raise HistoryError(f"{snapshot.path}: this checkpoint is of no step of this run")
        self._round, self._step = int(at), int(step)
        restored_state(self._state, snapshot)
