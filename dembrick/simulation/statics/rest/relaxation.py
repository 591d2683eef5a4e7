"""Relaxation to rest: the blocks move by the elastic answer to what is out of balance, until nothing is.

Joints answer from what they remembered at the start (`simulation.statics.newton.Trials`), as in one implicit step, so
that nothing stays of how blocks swing past their rest. Where they bore other loads before and slide, or bonds break,
the loads come in increments (`simulation.load_increments`), each by Newton's method if it can be.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from functools import partial
from types import SimpleNamespace

import numpy as np

from dembrick.errors import HistoryError
from dembrick.simulation import interrupts, load_increments
from dembrick.simulation.checkpoint_arrays import flattened, restored_state
from dembrick.simulation.session import DEAD_LOADS, Progress, Session, Snapshot
from dembrick.simulation.statics import joint_families, ties
from dembrick.simulation.statics.handover import carried, changing, come_to_rest, put_back
from dembrick.simulation.statics.newton import Trials
from dembrick.simulation.statics.rest.viscous_rest import FreeEquilibria, ViscousMotion
from dembrick.simulation.statics.sparse_equations import Factors, inner
from dembrick.simulation.statics.state import State

UNBALANCED = 1e-12  # of the joint forces
ROUNDED = 1e-6  # of the motion of joints: a slip of so little where nothing moves is none
FEW = 8  # steps in the first chunk, before the pace is known
SNAPSHOT = "dead_load"  # what a checkpoint of it has, and no other
CHUNK_SECONDS = 0.2  # of a chunk: a signal is answered within that


class Relaxation:
    """The relaxation, chunk by chunk: ``rounds`` of (most steps, momentum), until one of them balances the forces, and
    again without the bonds that then bear too much, until all that are left can bear it.

    ``answer``: the elastic motion (f, 6) to loads (f, 6); ``factor``: makes that of the elastic stiffness."""

    def __init__(
        self,
        state: State,
        answer: Callable[[np.ndarray], np.ndarray],
        rounds: tuple[tuple[int, float], ...],
        factor: Callable[[], Factors],
    ):
        self._state, self._answer, self._rounds, self._factor = state, answer, rounds, factor
        self._start = [(array, array.copy()) for array in changing(state)]
        self._trials = Trials(state, 6 * np.arange(len(state.blocks.free)))
        self._trials.remember()
        levers = ((arm**2).sum(axis=1).max() for arm in (state.joints.arm_a, state.joints.arm_b))
        self._arms = np.array([1.0, 1.0 / max(*levers)])  # of a force and of a moment, 1 and 1/m2
        self._round = self._step = 0
        self._newton: FreeEquilibria | None = None  # of increments: finds most of them at once
        self._reserves = joint_families.reserves(state)  # of bonds, before the loads of now
        self._from_start = False  # whether a checkpoint of now begins there
        self.own_way = False  # whether friction remembers viscous motion

    def session_of(self, session: Session) -> Session:
        """The session that this works in; it goes on from what that resumes."""
        if session.resumed is not None and SNAPSHOT in session.resumed:
            self._restore(session.resumed)
            session.resumed = None
        elif session.resumed is not None:
            return Session(output=session.output)  # what is kept is further on, and must not be written over
        return session

    def run(self, session: Session) -> tuple[float, int]:
        """The unbalanced-force ratio reached, and the steps of the last round."""
        joint_families.hold_bonds(self._state, True)
        ratio = self._to_rest(session)
        while ratio <= UNBALANCED and self._bonds_break():
            self._round = self._step = 0
            ratio = self._to_rest(session)
        joint_families.hold_bonds(self._state, False)
        return ratio, self._step

    def _to_rest(self, session: Session) -> float:
        """`run` while no bond breaks."""
        if self._newton is not None:
            begun = [(array, array.copy()) for array, _ in self._start]
            found, _ = self._newton.find(self._newton.motion(), 0.0)
            if found is not None:
                self._step += 1
                return min(self.unbalanced(), UNBALANCED)
            put_back(begun)
        ratio, pace = 1.0, FEW
        with interrupts.deferred():
            while self._round < len(self._rounds):
                most, momentum = self._rounds[self._round]
                steps, began = min(pace, most - self._step), time.perf_counter()
                ratio = self._relaxed(steps, momentum)
                pace = max(1, min(int(steps * CHUNK_SECONDS / max(time.perf_counter() - began, 1e-9)), 16 * steps))
                if ratio <= UNBALANCED or (self._step >= most and self._round + 1 == len(self._rounds)):
                    return ratio
                if self._step >= most:
                    self._round, self._step = self._round + 1, 0
                session.pause(self)
        return ratio

    def _bonds_break(self) -> bool:
        """Let the bonds go that bear too much first, in the memory from which joints answer; whether there are any."""
        if not joint_families.overborne(self._state).any():
            return False
        self._from_start = True
        joint_families.break_bonds(self._trials.trial, joint_families.without_first(self._state, self._reserves))
        return True

    def _relaxed(self, steps: int, momentum: float) -> float:
        """Relax by so many ``steps`` at most; returns the unbalanced-force ratio reached."""
        trials, blocks, free = self._trials, self._state.blocks, self._state.blocks.free
        velocity = np.concatenate([blocks.velocity[free], blocks.spin[free]], axis=1)
        for _ in range(steps):
            trials.stay()
            ratio = self.unbalanced()
            if self._step > 0 and ratio <= UNBALANCED:
                break
            load = trials.trial.residual[trials.rows]
            # the first step is the elastic answer, and no start for a swing; what works against forces has swung over
            keep = momentum if self._step > 1 and inner(load, velocity) > 0.0 else 0.0
            velocity = keep * velocity + self._answer(load)
            blocks.displacement[free] += velocity[:, :3]
            blocks.rotation[free] += velocity[:, 3:]
            self._step += 1
        blocks.velocity[free], blocks.spin[free] = velocity[:, :3], velocity[:, 3:]
        return ratio

    def unbalanced(self) -> float:
        """Greatest out-of-balance force, or moment at the longest lever of a joint, over the greatest joint force or
        dead load of a block: guides and ties may carry a block whose joints do not press."""
        trials, blocks = self._trials, self._state.blocks
        squares = (trials.trial.residual[trials.rows].reshape(-1, 2, 3) ** 2).sum(axis=2).max(axis=0)
        forces = self._state.joints.resultant[:, :3], blocks.dead_force[blocks.free]
        largest = max(float((force**2).sum(axis=1).max()) for force in forces)
        worst = float(np.maximum(*(squares * self._arms)))
        if largest == 0.0:
            return float(worst > 0.0)
        return math.sqrt(worst / largest)

    def by_increments(self, session: Session, memory: SimpleNamespace, stands: bool) -> tuple[int, float, int]:
        """Go from the start to the equilibrium again that was reached in one step, or was not (``stands``), by loads
        that come in increments, each with the memory of the equilibrium before. Returns how many there were,
        `Rest.path_error`, and the steps of all. Where one of these equilibria is not found, the last answer stays.
        """
        steps: list[int] = []
        gave_way = partial(joint_families.gave_way, self._state, memory)
        broke = partial(joint_families.broke, self._state, memory)
        if not joint_families.is_custom(self._state):
            self._newton = self._trials = FreeEquilibria(self._state, self._factor())
            self._newton.pause = lambda: session.pause(self)

        def go(count: int) -> bool | None:
            reached = [(array, array.copy()) for array, _ in self._start]
            more, early = self._in_increments(count, session, gave_way)
            steps.append(more)
            if not more:
                put_back(reached)
            return early if more else None

        found = load_increments.by_increments(go, lambda: carried(self._state), gave_way, broke, one_step=stands)
        return *found, sum(steps)

    def _in_increments(self, count: int, session: Session, gave_way: Callable[[], bool]) -> tuple[int, bool]:
        """`by_increments` with so many: the steps, zero if an equilibrium is not found; whether any joint ``gave_way``
        before the last."""
        state, free, steps = self._state, self._state.blocks.free, 0
        self._from_start = True
        put_back(self._start)
        self._begin()
        self._trials.stay()
        trial = self._trials.trial
        weaker = joint_families.slid(state, trial, ROUNDED * float(np.abs(trial.base[:, :3]).max()))
        if weaker or joint_families.overborne(state).any():
            return 0, False  # laws have become weaker than what joints bear, which no loads can be followed from
        loads, change = ties.dead_loads(state).copy(), np.zeros((len(state.blocks.force), 6))
        change[free] = np.concatenate([state.blocks.force, state.blocks.torque], axis=1)[free]
        put_back(self._start)
        for left in range(count - 1, -1, -1):
            early = gave_way()
            ties.put_dead_loads(state, loads - left / count * change)
            self._begin()
            begun = [(array, array.copy()) for array, _ in self._start]
            ratio, more = self.run(session)
            steps += more
            if not ratio <= UNBALANCED:
                put_back(begun)
                if joint_families.is_custom(state):
                    return 0, False
                stands, _, more = self.by_viscous_motion(session)
                steps += more
                if not stands:
                    return 0, False
            come_to_rest(state)
        return steps, early

    def _begin(self) -> None:
        """Let joints answer from what they are now, in the first round."""
        self._trials.remember()
        self._reserves = joint_families.reserves(self._state)
        self._round = self._step = 0

    def by_viscous_motion(self, session: Session) -> tuple[bool | None, float, int]:
        """`ViscousMotion` from where the blocks are: whether they stand, what is out of balance, and the iterations."""
        begun = [(array, array.copy()) for array, _ in self._start]
        motion = ViscousMotion(self._state, self._factor(), lambda: session.pause(self))
        with interrupts.deferred():
            stands = motion.run()
        if stands:
            self.own_way = not self._in_one_step(begun)
        return stands, motion.unbalanced, motion.iterations

    def _in_one_step(self, begun: list[tuple[np.ndarray, np.ndarray]]) -> bool:
        """Answer to the loads in one implicit step from where it ``begun``, near the rest of now, which viscous motion
        found on a way of its own; whether there is one, else all stays."""
        state, free = self._state, self._state.blocks.free
        moved = np.concatenate([state.blocks.displacement, state.blocks.rotation], axis=1)[free]
        reached, bonds = [(array, array.copy()) for array, _ in begun], joint_families.bonds(state)
        put_back(begun)
        joint_families.break_bonds(state, bonds)
        joint_families.hold_bonds(state, True)
        search = FreeEquilibria(state, self._factor())
        search.remember()
        motion = search.motion()
        motion[search.rows] = moved
        found, _ = search.find(motion, 0.0)
        joint_families.hold_bonds(state, False)
        if found is None or joint_families.overborne(state).any():
            put_back(reached)
            return False
        return True

    def start_again(self) -> None:
        """Put everything as it was at the start; the relaxation is over, and a checkpoint of now begins there."""
        self._round = len(self._rounds)
        put_back(self._start)

    @property
    def over(self) -> bool:
        """Whether it has ended without rest (`start_again`), after the steps of its last round."""
        return self._round == len(self._rounds)

    @property
    def _kept(self) -> tuple[int, int]:
        """Round and step at which a checkpoint of now begins; one of increments begins at the start."""
        return (0, 0) if self._from_start else (self._round, self._step)

    @property
    def where(self) -> str:
        return f"step {self._kept[1]} of the dead-load equilibrium"

    @property
    def progress(self) -> Progress:
        return Progress(DEAD_LOADS, self._step)

    def snapshot(self) -> dict[str, np.ndarray]:
        state = flattened({"state": self._state})
        if self._from_start or self.over:
            starts = {id(array): start for array, start in self._start}
            state = {name: starts.get(id(array), array) for name, array in state.items()}
        return {SNAPSHOT: np.array(self._kept, float), **state}

    def _restore(self, snapshot: Snapshot) -> None:
        """Take it from a snapshot of the same scene; HistoryError if it is of another."""
        at, step = snapshot.array(SNAPSHOT, np.zeros(2)).tolist()
        steps = [most for most, _ in self._rounds]
        steps.append(steps[-1] + 1)
        if not (at in range(len(steps)) and step in range(steps[int(at)])):
            raise HistoryError(f"{snapshot.path}: this checkpoint is of no step of this run")
        self._round, self._step = int(at), int(step)
        restored_state(self._state, snapshot)
