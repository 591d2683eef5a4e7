"""Equilibrium under the dead loads, before any actuator moves: found directly, not waited for.

Relaxation by the elastic answer to what is out of balance finds most in a few steps. Where it does not, the blocks
start again from where they were, by viscous motion (`viscous_rest`), which ends at rest or proves that they fall. Where
it shows neither, the answer is undecided.

`find_rest` asks whether a structure stands under its dead loads: one equilibrium, no actuator.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from types import SimpleNamespace
from typing import TYPE_CHECKING

import numpy as np

from dembrick.errors import HistoryError, NotConvergedError, UndecidedError
from dembrick.simulation import interrupts, load_increments
from dembrick.simulation.checkpoint_arrays import flattened, restored_state
from dembrick.simulation.expected_cost import STATICS_STEPS, relaxation_seconds
from dembrick.simulation.floating_point import not_nan
from dembrick.simulation.session import DEAD_LOADS, Plan, Progress, Session, Snapshot
from dembrick.simulation.statics import joint_families, ties
from dembrick.simulation.statics.elastic_factor import elastic_factor, equations, touches_itself
from dembrick.simulation.statics.handover import (
    carried,
    changing,
    come_to_rest,
    depends_on_size,
    put_back,
    show_falling,
    starting_state,
)
from dembrick.simulation.statics.newton import Trials
from dembrick.simulation.statics.recorder import Ended, Recorder
from dembrick.simulation.statics.sparse_equations import Factors, inner
from dembrick.simulation.statics.state import State, initial_state
from dembrick.simulation.statics.stiffness import answer_alone, block_stiffness
from dembrick.simulation.statics.viscous_rest import FreeEquilibria, ViscousMotion
from dembrick.simulation.statics.yield_point import mechanism_of, moving_blocks

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly


UNBALANCED = 1e-12  # of the joint forces
MOST_STEPS = 300  # of relaxation: what has not come to rest by then is left to viscous motion
FIRST_STEPS = 30  # without momentum, for blocks on fixed ones
MOMENTUM = 0.9  # of the last move that is kept where blocks stand on free blocks
ROUNDED = 1e-6  # of the motion of joints: a slip of so little where nothing moves is none
FEW = 8  # steps in the first chunk, before the pace is known
SNAPSHOT = "dead_load"  # what a checkpoint of it has, and no other
CHUNK_SECONDS = 0.2  # of a chunk: a signal is answered within that
DECIDES = (
    "dembrick limit decides it where no forces within the strengths balance the loads (it falls) or where nothing "
    "slides; softer or stiffer joints may decide it too"
)


@dataclass(frozen=True)
class Rest:
    """Outcome of the dead loads: whether the blocks stand (None: undecided), the out-of-balance over the joint forces
    and the steps that took; of blocks that fall their numbers and the mechanism; seconds of compiling and of relaxing;
    in how many ``increments`` the loads came, and the error of forces that this and the stages before leave, over the
    greatest joint force (``path_error``) and in N (``force_error``).
    """

    stands: bool | None
    unbalanced: float
    steps: int
    mechanism: str | None
    blocks: tuple[int, ...]
    compile_seconds: float
    loop_seconds: float
    increments: int = 1
    path_error: float = 0.0
    force_error: float = 0.0


def dead_load_equilibrium(
    state: State,
    stiffness: np.ndarray,
    assembly: Assembly,
    factor: Factors | None = None,
    session: Session | None = None,
) -> Rest:
    """`rest` of blocks that must stand: NotConvergedError, which names those that do not; UndecidedError if they are
    seen neither to stand nor to fall."""
    found = rest(state, stiffness, assembly.position, factor, session)
    if found.stands is None:
        raise UndecidedError(f"{undecided(found)}; no actuator has moved yet. {DECIDES}")
    if not found.stands:
        raise NotConvergedError(
            f"{does_not_stand(found, assembly.names)} before any actuator moves; no equilibrium under the dead loads: "
            f"along this mechanism {found.unbalanced:.2g} of the joint forces is never balanced. Check loads, friction "
            "and supports"
        )
    return found


def does_not_stand(found: Rest, names) -> str:
    """The sentence that says which blocks fall, and how."""
    moving = [names[i] for i in found.blocks]
    more = f" and {len(moving) - 5} more" if len(moving) > 5 else ""
    falls = "falls" if len(moving) == 1 else "fall"
    return f"does not stand: {', '.join(moving[:5])}{more} {falls} by {found.mechanism}"


def undecided(found: Rest) -> str:
    """The sentence that says that it is not known whether the blocks stand."""
    return (
        f"undecided under the dead loads: neither an equilibrium nor a mechanism of a fall was found in {found.steps} "
        f"steps; {found.unbalanced:.2g} of the joint forces is still out of balance"
    )


def rest(
    state: State,
    stiffness: np.ndarray,
    position: np.ndarray,
    factor: Factors | None = None,
    session: Session | None = None,
) -> Rest:
    """The equilibrium of ``state`` under its dead loads, or the mechanism by which it falls.

    It is relaxed until the out-of-balance forces are ``UNBALANCED`` of the joint forces. Where free blocks touch only
    fixed ones, every block moves by the answer of its own ``stiffness`` (n, 6, 6) to its out-of-balance: a single
    Newton step is enough. Else the whole assembly moves by its elastic answer, ``factor`` is that of its stiffness,
    first in one go and then with momentum, which is dropped whenever it works against the forces. What does not come to
    rest so starts again, by viscous motion; ``position`` (n, 3) of the centroids. ``session`` keeps checkpoints of it,
    and may go on from one. Raises Interrupted, and UndecidedError where relaxation does not balance the forces of a law
    of the user's own.

    Joints answer in one implicit step, which is what they carry if all loads grow together from zero; where they bore
    others before and slide, or where bonds break, loads come in increments (`load_increments`). Bonds hold until the
    blocks rest; those that bear too much then break, and the others must carry the loads without them.
    """
    blocks = state.blocks
    began, before = time.perf_counter(), 0.0 if session is None else session.force_error
    alone = not touches_itself(state)
    if not alone and factor is None:
        raise ValueError("free blocks that touch each other need the factor of their stiffness")
    bonded = joint_families.has_strengths(state)
    if bonded and not (blocks.dead_force.any() or blocks.dead_torque.any()):
        return Rest(True, 0.0, 0, None, (), 0.0, 0.0)  # what holds by itself
    carries, memory = bool(state.joints.relative.any()), SimpleNamespace(**joint_families.memory(state))
    # where blocks stand alone and do not come to rest at once, what opened is softer than the closed joint whose answer
    # each step is
    rounds = ((FIRST_STEPS, 0.0), (MOST_STEPS, MOMENTUM)) if alone else ((MOST_STEPS, MOMENTUM),)
    answer = answer_alone(state, stiffness) if factor is None else factor.answer
    relaxation = _Relaxation(state, answer, rounds, lambda: factor or elastic_factor(state, position))
    compiled = time.perf_counter()
    session = relaxation.session_of(session or Session())
    ratio, steps = relaxation.run(session)
    stands, mechanism, moving = not_nan(ratio, "what is out of balance under the dead loads") <= UNBALANCED, None, ()
    if not stands and not moving_blocks(state):
        stands, ratio = True, 0.0  # there is no force at all: no gravity and no loads
    if not stands and joint_families.is_custom(state):
        raise UndecidedError(
            f"undecided under the dead loads: after {steps} steps of relaxation {ratio:.2g} of the joint forces is "
            "still out of balance, and Newton's method, which would decide it, knows no joint law of one's own"
        )
    if not stands:
        relaxation.start_again()
        stands, ratio, more = relaxation.by_viscous_motion(session)
        steps += more
    increments, error = 1, math.inf if relaxation.own_way else 0.0
    alike = not (bonded and joint_families.gave_way(state, memory)) and not depends_on_size(state)
    if stands and (carries or not alike):
        increments, error, more = relaxation.by_increments(session, memory)
        steps += more
    if stands is False:
        mechanism, moving = mechanism_of(state), moving_blocks(state)
        show_falling(state)
    done = time.perf_counter()
    seconds = compiled - began, done - compiled
    if stands:
        come_to_rest(state)
    errors = load_increments.both_errors(error, before, float(np.abs(carried(state)).max(initial=0.0)))
    return Rest(stands, ratio, steps, mechanism, moving, *seconds, increments, *errors)


class _Relaxation:
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
        """Let the bonds go that bear too much, in the memory from which joints answer too; whether there are any."""
        if not joint_families.overborne(self._state).any():
            return False
        self._from_start = True
        joint_families.hold_bonds(self._state, False)
        self._trials.stay()
        joint_families.hold_bonds(self._state, True)
        joint_families.break_bonds(self._trials.trial, joint_families.bonds(self._state))
        return True

    def _relaxed(self, steps: int, momentum: float) -> float:
        """Relax by so many ``steps`` at most; returns the unbalanced-force ratio reached."""
        trials, blocks, free = self._trials, self._state.blocks, self._state.blocks.free
        load = trials.trial.residual.reshape(-1, 6)
        velocity = np.concatenate([blocks.velocity[free], blocks.spin[free]], axis=1)
        for _ in range(steps):
            trials.stay()
            ratio = self._unbalanced()
            if self._step > 0 and ratio <= UNBALANCED:
                break
            # the first step is the elastic answer, and no start for a swing; what works against forces has swung over
            keep = momentum if self._step > 1 and inner(load, velocity) > 0.0 else 0.0
            velocity = keep * velocity + self._answer(load)
            blocks.displacement[free] += velocity[:, :3]
            blocks.rotation[free] += velocity[:, 3:]
            self._step += 1
        blocks.velocity[free], blocks.spin[free] = velocity[:, :3], velocity[:, 3:]
        return ratio

    def _unbalanced(self) -> float:
        """Greatest out-of-balance force, or moment at the longest lever of a joint, over the greatest joint force."""
        squares = (self._trials.trial.residual.reshape(-1, 2, 3) ** 2).sum(axis=2).max(axis=0)
        largest = float((self._state.joints.resultant[:, :3] ** 2).sum(axis=1).max())
        return 1.0 if largest == 0.0 else math.sqrt(float(np.maximum(*(squares * self._arms))) / largest)

    def by_increments(self, session: Session, memory: SimpleNamespace) -> tuple[int, float, int]:
        """Go from the start to the equilibrium that was reached again, by loads that come in increments, each with the
        memory of the equilibrium before. Returns how many there were, `Rest.path_error`, and the steps of all. Where
        one of these equilibria is not found, the last answer stays.
        """
        steps: list[int] = []
        gave_way = partial(joint_families.gave_way, self._state, memory)
        broke = partial(joint_families.broke, self._state, memory)

        def go(count: int) -> bool | None:
            reached = [(array, array.copy()) for array, _ in self._start]
            more, early = self._in_increments(count, session, gave_way)
            steps.append(more)
            if not more:
                put_back(reached)
            return early if more else None

        found = load_increments.by_increments(go, lambda: carried(self._state), gave_way, broke, one_step=True)
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
        self._round, self._step = len(self._rounds), 0
        put_back(self._start)

    @property
    def _kept(self) -> tuple[int, int]:
        """Round and step at which a checkpoint of now begins; one of increments begins at the start."""
        if self._from_start:
            return 0, 0
        return self._round, 0 if self._round == len(self._rounds) else self._step

    @property
    def where(self) -> str:
        return f"step {self._kept[1]} of the dead-load equilibrium"

    @property
    def progress(self) -> Progress:
        return Progress(DEAD_LOADS, self._step)

    def snapshot(self) -> dict[str, np.ndarray]:
        state = flattened({"state": self._state})
        if self._from_start or self._round == len(self._rounds):
            starts = {id(array): start for array, start in self._start}
            state = {name: starts.get(id(array), array) for name, array in state.items()}
        return {SNAPSHOT: np.array(self._kept, float), **state}

    def _restore(self, snapshot: Snapshot) -> None:
        """Take it from a snapshot of the same scene; HistoryError if it is of another."""
        at, step = snapshot.array(SNAPSHOT, np.zeros(2)).tolist()
        steps = [most for most, _ in self._rounds] + [1]
        if not (at in range(len(steps)) and step in range(steps[int(at)])):
            raise HistoryError(f"{snapshot.path}: this checkpoint is of no step of this run")
        self._round, self._step = int(at), int(step)
        restored_state(self._state, snapshot)


@dataclass
class Standing(Ended):
    """Result of a search for rest: `Rest`, the state in which it ended, and seconds of compiling and of relaxing."""

    rest: Rest
    state: State
    settings: dict
    compile_seconds: float
    loop_seconds: float
    energy = None
    yield_point = None  # no load was increased
    phases = None


def find_rest(assembly: Assembly, session: Session) -> Standing:
    """The equilibrium of an assembly under its dead loads, the blocks that fall, or neither; recorded in one row."""
    state = starting_state(assembly, session.start, session.ties_before)
    factor = elastic_factor(state, assembly.position) if touches_itself(state) else None
    found = rest(state, block_stiffness(state, shared=2.0), assembly.position, factor, session)
    load_increments.report_error(session.report, found.increments, found.path_error)
    if session.observe is not None:
        recorder = Recorder(state, session, 1, 1, 1, assembly.control_points)
        recorder.write_equilibrium(state, 0, 0.0, np.zeros(2), framed=True)
        recorder.drain()
    return Standing(found, state, {"steps": found.steps}, found.compile_seconds, found.loop_seconds)


def plan(assembly: Assembly) -> Plan:
    """The plan of it, without running any of it."""
    n, j = len(assembly.names), len(assembly.joints)
    points = sum(len(p.area) for p in assembly.contact_points if p is not None)
    memory = 8 * (100 * n + 100 * j + 12 * points)
    state = initial_state(assembly)
    if not touches_itself(state):
        return Plan(1.0, 1.0, 1, memory, relaxation_seconds(1, j))
    memory += equations(state, assembly.position).bytes(factors=1)
    return Plan(1.0, 1.0, STATICS_STEPS, memory, relaxation_seconds(STATICS_STEPS, j))
