"""Relaxation to equilibrium: the blocks move by their elastic response to the out-of-balance forces until these vanish.

Joint laws act from their history at the start (`simulation.statics.newton.Trials`), as in one implicit step, so
that an overshoot leaves no trace. If joints carried other loads before and slide, or bonds break, the loads are applied
in increments (`simulation.load_increments`), each by Newton's method if possible.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from types import SimpleNamespace

import numpy as np

from dembrick.errors import HistoryError
from dembrick.simulation import interrupts, load_increments
from dembrick.simulation.checkpoint_arrays import flattened, restored_state
from dembrick.simulation.session import DEAD_LOADS, Progress, Session, Snapshot
from dembrick.simulation.statics import elastic_factor, joint_families, ties
from dembrick.simulation.statics.handover import carried, changing, come_to_rest, put_back
from dembrick.simulation.statics.newton import Trials
from dembrick.simulation.statics.rest.viscous_rest import FreeEquilibria, ViscousMotion
from dembrick.simulation.statics.sparse_equations import Factors, inner
from dembrick.simulation.statics.state import State

UNBALANCED = 1e-12  # of the joint forces
ROUNDED = 1e-6  # of the motion of joints: a smaller slip, while nothing moves, is rounding
FEW = 8  # steps in the first chunk, before the speed is known
SNAPSHOT = "dead_load"  # array that only its checkpoints have
CHUNK_SECONDS = 0.2  # of a chunk: a signal is handled within that


class Relaxation:
    """The relaxation, chunk by chunk: ``rounds`` of (most steps, momentum), until one of them balances the forces.
    Overloaded bonds then break and the relaxation is repeated, until the remaining bonds hold.

    ``answer``: function from loads (f, 6) to the elastic motion (f, 6); ``factor``: makes the factors of the elastic
    stiffness."""

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
        self._round = self._step = 0
        self._newton: FreeEquilibria | None = None  # for increments: finds most of them at once
        self._reserves = joint_families.reserves(state)  # of bonds, before the present loads
        self._from_start = False  # whether a checkpoint written now restarts from the initial state
        self.weakened = False  # whether no equilibrium is found with the present laws under the loads at the start
        self.own_way = False  # whether the history of friction depends on the path of viscous motion

    def session_of(self, session: Session) -> Session:
        """The session to work with, after restarting from its snapshot if that is one of relaxation."""
        if session.resumed is not None and SNAPSHOT in session.resumed:
            self._restore(session.resumed)
            session.resumed = None
        elif session.resumed is not None:
            return Session(output=session.output)  # the existing checkpoint is further on: do not overwrite it
        return session

    def run(self, session: Session) -> tuple[float, int]:
        """Relax; return the out-of-balance ratio reached and the steps of the last round."""
        joint_families.keep_bonds_intact(self._state, True)
        ratio = self._to_rest(session)
        while ratio <= UNBALANCED and self._bonds_break():
            self._round = self._step = 0
            ratio = self._to_rest(session)
        joint_families.keep_bonds_intact(self._state, False)
        return ratio, self._step

    def _to_rest(self, session: Session) -> float:
        """`run` while no bond breaks."""
        if self._newton is not None:
            begun = [(array, array.copy()) for array, _ in self._start]
            found, _ = self._newton.find(self._newton.motion(), 0.0)
            if found is not None:
                self._step += 1
                return min(self.out_of_balance(), UNBALANCED)
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
        """Break the bonds that fail first, in the history from which trials start; whether there are any."""
        if not joint_families.overloaded(self._state).any():
            return False
        self._from_start = True
        joint_families.break_bonds(self._trials.trial, joint_families.without_first(self._state, self._reserves))
        return True

    def _relaxed(self, steps: int, momentum: float) -> float:
        """Relax by at most so many ``steps``; returns the out-of-balance ratio reached."""
        trials, blocks, free = self._trials, self._state.blocks, self._state.blocks.free
        velocity = np.concatenate([blocks.velocity[free], blocks.spin[free]], axis=1)
        for _ in range(steps):
            trials.stay()
            ratio = self.out_of_balance()
            if self._step > 0 and ratio <= UNBALANCED:
                break
            load = trials.trial.residual[trials.rows]
            # the first step is the elastic response and gives no momentum; momentum against the forces has overshot
            keep = momentum if self._step > 1 and inner(load, velocity) > 0.0 else 0.0
            velocity = keep * velocity + self._answer(load)
            blocks.displacement[free] += velocity[:, :3]
            blocks.rotation[free] += velocity[:, 3:]
            self._step += 1
        blocks.velocity[free], blocks.spin[free] = velocity[:, :3], velocity[:, 3:]
        return ratio

    def out_of_balance(self) -> float:
        """Out-of-balance of the worst block over its own forces, beyond rounding."""
        trials = self._trials
        return trials.balance.beyond_rounding(trials.trial.residual[trials.rows])

    def by_increments(self, session: Session, memory: SimpleNamespace, stands: bool) -> tuple[int, float, int]:
        """Repeat the relaxation from the start with the loads applied in increments, each with the history of the
        equilibrium before. ``stands``: whether one step found an equilibrium. Returns the number of increments,
        `Rest.path_error`, and the steps of all. If one of these equilibria is not found, the last result stays.
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

        state, fixed = self._state, np.ones(len(self._state.blocks.displacement), bool)
        fixed[state.blocks.free] = False
        ends = np.stack(elastic_factor.ends(state, state.joints.block_a, state.joints.block_b))

        def scale(forces: np.ndarray) -> np.ndarray:
            return load_increments.on_less_loaded(ends[:, : len(forces)], forces, fixed)

        found = load_increments.by_increments(go, lambda: carried(state), scale, gave_way, broke, one_step=stands)
        return *found, sum(steps)

    def _in_increments(self, count: int, session: Session, gave_way: Callable[[], bool]) -> tuple[int, bool]:
        """`by_increments` with ``count`` of them: the number of steps, zero if an equilibrium is not found; and whether
        any joint ``gave_way`` before the last increment."""
        state, steps, early = self._state, 0, False
        self._from_start = True
        before, way = self._way(count)
        for number, loads in enumerate(way):
            early, self.weakened = gave_way(), number < before
            ties.put_dead_loads(state, loads)
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
        self.weakened = False
        return steps, early

    def _way(self, count: int) -> tuple[int, list[np.ndarray]]:
        """Dead loads (n, 6) at the equilibria from the start to the present laws and loads, each by ``count``
        increments, and how many of them belong to the laws: forces that joints may no longer bear are let go first,
        under the loads that they bore, and bonds that these overload break."""
        state = self._state
        change, slid, overloaded = self._unbalanced_at_start()
        lost = np.zeros_like(change)
        if slid:
            with joint_families.stuck(state):
                new = self._unbalanced_at_start()[0]
            change, lost = new, change - new
        put_back(self._start)
        loads = ties.dead_loads(state).copy()
        parts = [left / count for left in range(count - 1, -1, -1)]
        let_go = parts if slid else [0.0] if overloaded else []
        of_laws = [loads - change - part * lost for part in let_go]
        return len(of_laws), of_laws + [loads - part * change for part in parts]

    def _unbalanced_at_start(self) -> tuple[np.ndarray, bool, bool]:
        """The out-of-balance (n, 6) at the start, and whether there any joint slides or any bond is overloaded."""
        state, free = self._state, self._state.blocks.free
        put_back(self._start)
        self._begin()
        joint_families.keep_bonds_intact(state, True)
        self._trials.stay()
        joint_families.keep_bonds_intact(state, False)
        found = np.zeros((len(state.blocks.force), 6))
        found[free] = np.concatenate([state.blocks.force, state.blocks.torque], axis=1)[free]
        trial = self._trials.trial
        slid = joint_families.slid(state, trial, ROUNDED * float(np.abs(trial.base[:, :3]).max()))
        return found, slid, bool(joint_families.overloaded(state).any())

    def _begin(self) -> None:
        """Start the first round with the present state as the history of the joints."""
        self._trials.remember()
        self._reserves = joint_families.reserves(self._state)
        self._round = self._step = 0

    def by_viscous_motion(self, session: Session) -> tuple[bool | None, float, int]:
        """Run `ViscousMotion` from the present state: whether the blocks stand, the out-of-balance over the joint
        forces, and the iterations."""
        begun = [(array, array.copy()) for array, _ in self._start]
        motion = ViscousMotion(self._state, self._factor(), lambda: session.pause(self))
        with interrupts.deferred():
            stands = motion.run()
        if stands:
            self.own_way = not self._in_one_step(begun)
        return stands, motion.unbalanced, motion.iterations

    def _in_one_step(self, begun: list[tuple[np.ndarray, np.ndarray]]) -> bool:
        """Replace the equilibrium that viscous motion found on its own path by one nearby that is reached in a single
        implicit step from the state ``begun``; whether there is one, else the state is unchanged."""
        state, free = self._state, self._state.blocks.free
        moved = np.concatenate([state.blocks.displacement, state.blocks.rotation], axis=1)[free]
        reached, bonds = [(array, array.copy()) for array, _ in begun], joint_families.bonds(state)
        put_back(begun)
        joint_families.break_bonds(state, bonds)
        joint_families.keep_bonds_intact(state, True)
        search = FreeEquilibria(state, self._factor())
        search.remember()
        motion = search.motion()
        motion[search.rows] = moved
        found, _ = search.find(motion, 0.0)
        joint_families.keep_bonds_intact(state, False)
        if found is None or joint_families.overloaded(state).any():
            put_back(reached)
            return False
        return True

    def start_again(self) -> None:
        """Restore the initial state; the relaxation is over, and a checkpoint written now restarts from that state."""
        self._round = len(self._rounds)
        put_back(self._start)

    @property
    def over(self) -> bool:
        """Whether the relaxation has ended without equilibrium, and started again."""
        return self._round == len(self._rounds)

    @property
    def _kept(self) -> tuple[int, int]:
        """Round and step from which a checkpoint written now restarts; during increments, from the start."""
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
        """Restart from a snapshot of the same scene; HistoryError if it is of another."""
        at, step = snapshot.array(SNAPSHOT, np.zeros(2)).tolist()
        steps = [most for most, _ in self._rounds]
        steps.append(steps[-1] + 1)
        if not (at in range(len(steps)) and step in range(steps[int(at)])):
            raise HistoryError(f"{snapshot.path}: this checkpoint holds no step of this run")
        self._round, self._step = int(at), int(step)
        restored_state(self._state, snapshot)
