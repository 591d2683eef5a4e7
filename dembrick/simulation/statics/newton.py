"""The next equilibrium of an assembly, by Newton's method on the joint laws (``kernels.statics.newton``)."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np

from dembrick._jit import ready
from dembrick.kernels.statics.newton import Trial, remember, try_motion
from dembrick.simulation.floating_point import not_nan
from dembrick.simulation.statics import elastic_factor, joint_families, ties
from dembrick.simulation.statics.rest.balance import Balance
from dembrick.simulation.statics.sparse_equations import Factors, inner
from dembrick.simulation.statics.state import State, for_kernels
from dembrick.simulation.statics.stiffness import to_joint

MOST_ITERATIONS = 20  # for one equilibrium
ENOUGH, SLACK = 0.9, 0.5  # of the out-of-balance, or of its work on a step: the most that a step, or part of it, leaves
MOST_PARTS, BACKTRACKS = 12, 8  # trial lengths in a line search, by secants or by halving
LOST = 1e4  # times the initial out-of-balance: the iteration has diverged beyond that
SHORT = 0.1  # of a Newton step: a smaller part counts as short
SINGULAR = 1e3  # times the present out-of-balance: a Newton step that ends above it has a singular tangent
HELD, LEAP = 1e-10, 1e-5  # of the elastic stiffness, added to the tangent; the same if that is singular
MOST_LEAPS, NEARER = 12, 0.8  # steps with a singular tangent; by which each must reduce the out-of-balance
DIFFERENCE = 1e-6  # of the elastic displacement of a joint: difference by which its tangent is taken
KEPT = 0.2  # of the out-of-balance: the most that a full step may leave for the next to use its factors again
PIVOT = 0.1  # of the greatest entry of its column in a front: a pivot above it is not exchanged


def elastic_moves(state: State) -> np.ndarray:
    """Elastic displacement of each joint before it slides or opens (j,) in m.

    An unloaded joint counts as if it carried the greatest force of any joint of its blocks.
    """
    joints = state.joints
    carried = np.zeros(len(state.blocks.displacement))
    for ends in (joints.block_a, joints.block_b):
        np.maximum.at(carried, ends, joints.resultant[:, 0])
    carried[np.setdiff1d(np.arange(len(carried)), state.blocks.free)] = 0.0
    normal = np.maximum(carried[joints.block_a], carried[joints.block_b])
    stiffness = joint_families.stiffness(state)
    if not normal.max() > 0.0:
        return 1e-6 * joint_families.reach(state)
    normal = np.maximum(normal, 1e-3 * normal.max())
    friction = joint_families.friction(state)
    return normal * np.maximum(1.0 / stiffness[:, 2, 2], friction / stiffness[:, 0, 0])


def _new_trial(state: State, place: np.ndarray) -> Trial:
    """Arrays for trials; ``place`` (f,): first row of each free block in the equations."""
    joints, free = state.joints, state.blocks.free
    count = len(joints.block_a)
    row = np.full(len(state.blocks.displacement), -1)
    row[free] = place
    seen = to_joint(joints.axes, joints.arm_a), to_joint(joints.axes, joints.arm_b)
    seen_a, seen_b = elastic_factor.ends(state, *seen)
    return Trial(
        seen_a=seen_a,
        seen_b=seen_b,
        row=row.astype(np.int64),
        reach=joint_families.reach(state),
        move=DIFFERENCE * elastic_moves(state),
        stiffness=joint_families.stiffness(state),
        drag=np.array([0.0, HELD]),
        base=np.zeros((count, 6)),
        **joint_families.memory(state),
        force=np.zeros((7, 6)),
        tangent=elastic_factor.stiffness(state),  # of joints, ties and guides
        residual=np.zeros(6 * len(free)),
    )


class Trials:
    """Forces of trial motions of a ``state``, each an implicit step from the history of its joints (`remember`).

    ``place`` (f,): first row of each free block in the equations. ``phases``: seconds that went into joint forces and
    into equations.
    """

    def __init__(self, state: State, place: np.ndarray):
        self.state, self.free = state, state.blocks.free
        self.rows = place[:, None] + np.arange(6)
        self.trial = _new_trial(state, place)
        self.phases = {"joint_forces": 0.0, "equations": 0.0}
        self.balance = Balance(state, self.trial)
        self._try_motion = ready(try_motion, self.trial, for_kernels(state), 0.0, False)

    def remember(self) -> None:
        """Make the present state the history from which trials start."""
        remember(self.trial, self.state.joints, self.state.points, self.state.areas)

    def motion(self) -> np.ndarray:
        """Displacements and rotations of the free blocks now, in the order of the equations (6 f,)."""
        motion = np.empty(self.rows.size)
        blocks = self.state.blocks
        motion[self.rows] = np.concatenate([blocks.displacement[self.free], blocks.rotation[self.free]], axis=1)
        return motion

    def go_to(self, motion: np.ndarray, V: float) -> None:
        """Move the blocks by a ``motion`` and evaluate the forces under the load V."""
        began = time.perf_counter()
        self._move(motion)
        self._try(V, with_tangent=False)
        self.phases["joint_forces"] += time.perf_counter() - began

    def stay(self) -> None:
        """Evaluate the forces at the present positions, without any actuator."""
        ties.pull(self.state)
        self._try(0.0, with_tangent=False)

    def out_of_balance(self) -> float:
        """Out-of-balance force, or moment over reach, of the worst block over its own forces."""
        return self.balance.ratio(self.trial.residual[self.rows])

    def _move(self, motion: np.ndarray) -> None:
        blocks, rows = self.state.blocks, motion[self.rows]
        blocks.displacement[self.free], blocks.rotation[self.free] = rows[:, :3], rows[:, 3:]
        ties.pull(self.state)

    def _try(self, V: float, with_tangent: bool) -> None:
        self._try_motion(self.trial, for_kernels(self.state), V, with_tangent)


class Equilibria(Trials):
    """Finds equilibria of ``state`` under V times the unit ``load`` (n, 6) at a given driven displacement.

    ``balanced``: tolerance of `out_of_balance`, at first the loosest. ``iterations``: of Newton's method so far;
    ``pause`` is called before each. ``most_short``: number of consecutive short steps after which the search gives up.
    ``stalled``: times the loosest tolerance, up to which it then counts as found, with wider bounds.
    """

    most_short, stalled = 3, 10.0

    def __init__(self, state: State, load: np.ndarray, factor: Factors, balanced: float):
        pattern = factor.pattern
        super().__init__(state, pattern.place)
        self.factor, self.balanced, self.loosest = factor, balanced, balanced
        self.load = pattern.to_rows(load[self.free])
        self.answers = np.zeros((2, pattern.rows))  # solutions with the tangent: for the out-of-balance, the unit load
        self.tangent, self._none = Factors(pattern, factor.fronts.room), np.zeros(pattern.rows)
        self.smooth = joint_families.has_areas(state)  # the forces of contact points are piecewise linear
        self.iterations = 0
        self.pause: Callable[[], None] = lambda: None

    def attempt(self, motion: np.ndarray, V: float) -> float:
        """Out-of-balance of a motion under the load V, as an energy norm: the square root of the elastic energy (J)
        that it would store."""
        self.go_to(motion, V)
        began = time.perf_counter()
        energy = self.factor.energy(self.trial.residual)
        self.phases["equations"] += time.perf_counter() - began
        return math.sqrt(max(0.0, not_nan(energy, "the out-of-balance force")))

    def differentiate(self, V: float) -> None:
        """Evaluate the tangents of the joints at the present motion."""
        began, state = time.perf_counter(), self.state
        if state.ties is not None:
            first = len(state.joints.block_a)
            self.trial.tangent[first : first + len(state.ties.stiffness)] = ties.tangent(state.ties)
        self._try(V, with_tangent=True)
        self.phases["joint_forces"] += time.perf_counter() - began

    def is_balanced(self) -> bool:
        """Whether the out-of-balance is within its tolerance; if this cannot be loosened, but for rounding."""
        if self.out_of_balance() <= self.balanced:
            return True
        residual = self.trial.residual[self.rows]
        return self.balanced >= self.loosest and self.balance.beyond_rounding(residual) <= self.balanced

    def find(self, motion: np.ndarray, V: float) -> tuple[float | None, int]:
        """V of the equilibrium near ``motion`` at its driven displacement, None if none is found; and the number of
        iterations."""
        before, short, leapt = self.iterations, 0, False
        start = size = self.attempt(motion, V)
        while size <= LOST * start and short < self.most_short and self.iterations - before < MOST_ITERATIONS:
            if self.is_balanced():
                return V, self.iterations - before
            step = self._newton_step(V)
            if step is None:
                break
            change, change_V = step
            work = inner(self.trial.residual, change)
            found = self.attempt(motion + change, V + change_V)
            if found > SINGULAR * size and not leapt and not self.trial.drag[0] > 0.0:
                leapt, landed = True, self._leap(motion, V, size)
                if landed is not None:
                    motion, V, size = landed
                    continue
                found = self.attempt(motion + change, V + change_V)
            part = 1.0
            if not found < ENOUGH * size:
                part = self._line_search(motion, V, step, work) if work > 0.0 else self._halved(motion, V, step, size)
                found = self.attempt(motion + part * change, V + part * change_V)
            near = self.smooth and part == 1.0 and found <= KEPT * size
            motion, V, size = motion + part * change, V + part * change_V, found
            short = short + 1 if part < SHORT else 0
            if near:
                motion, V, size = self._by_chords(motion, V)
        stalled = self.balanced >= self.loosest and self.out_of_balance() <= self.stalled * self.loosest
        return V if stalled else None, self.iterations - before

    def _by_chords(self, motion: np.ndarray, V: float) -> tuple[np.ndarray, float, float]:
        """Motion, V and out-of-balance after more steps with the last factors (modified Newton, or chord, method), as
        long as each reduces the out-of-balance to `KEPT`.

        A tangent that led so close is good enough here, too, and takes an eighth of the time of a new one.
        """
        left, before = self.out_of_balance(), math.inf
        while self.balanced < left <= KEPT * before:
            self.pause()
            began = time.perf_counter()
            self.answers[0] = self.trial.residual
            self.tangent.solve(self.answers[:1])
            change, change_V = self._at_held_displacement()
            self.phases["equations"] += time.perf_counter() - began
            self.go_to(motion + change, V + change_V)
            before, left = left, self.out_of_balance()
            if not left < before:
                break
            motion, V = motion + change, V + change_V
        return motion, V, 0.0 if left <= self.balanced else self.attempt(motion, V)

    def _newton_step(self, V: float) -> tuple[np.ndarray, float] | None:
        """Change of the motion and of V by a Newton step at constant driven displacement; None if it is singular."""
        self.pause()
        self.iterations += 1
        self.differentiate(V)
        if not self.solve():
            return None
        return self._at_held_displacement()

    def _at_held_displacement(self) -> tuple[np.ndarray, float]:
        """Change of the motion and of V from the two solutions with the tangent, at constant driven displacement."""
        by_residual, by_load = self.answers
        change_V = -inner(self.load, by_residual) / inner(self.load, by_load)
        return by_residual + change_V * by_load, change_V

    def _line_search(self, motion: np.ndarray, V: float, step: tuple[np.ndarray, float], work: float) -> float:
        """The part of a Newton ``step`` at which the out-of-balance forces do next to no work on it (Matthies and
        Strang, IJNME 14 (1979) 1613): the least potential energy, if nothing slides.

        ``work`` (J): that of the forces at the beginning of the step; the present forces are those at its end.
        """
        change, change_V = step
        low, high, part = (0.0, work), (1.0, inner(self.trial.residual, change)), 1.0
        if not high[1] < 0.0:
            return part
        for _ in range(MOST_PARTS):
            secant = low[0] + (high[0] - low[0]) * low[1] / (low[1] - high[1])
            part = min(max(secant, low[0] + 0.05 * (high[0] - low[0])), low[0] + 0.9 * (high[0] - low[0]))
            self._move(motion + part * change)
            self._try(V + part * change_V, with_tangent=False)
            rest = inner(self.trial.residual, change)
            if abs(rest) <= SLACK * work:
                break
            low, high = ((part, rest), high) if rest > 0.0 else (low, (part, rest))
        return part

    def _halved(self, motion: np.ndarray, V: float, step: tuple[np.ndarray, float], size: float) -> float:
        """The part of a Newton ``step`` with the least out-of-balance, by halving, for a step on which the forces do
        negative work from the start."""
        part, best = 1.0, (math.inf, 1.0)
        for _ in range(BACKTRACKS):
            found = self.attempt(motion + part * step[0], V + part * step[1])
            best = min(best, (found, part))
            if found < (1.0 - 0.1 * part) * size:
                break
            part *= 0.5
        return best[1]

    def _leap(self, motion: np.ndarray, V: float, start: float) -> tuple[np.ndarray, float, float] | None:
        """Motion, V and out-of-balance after full Newton steps from a singular tangent, or None.

        So many joints are open or slide there that several mechanisms may move. The laws are almost piecewise linear,
        so a full step shows which of the joints close again, however far away it ends (active-set method), about half
        of them at a time.
        """
        held, last, landed = self.trial.drag[1], math.inf, None
        self.trial.drag[1] = max(held, LEAP)
        self.attempt(motion, V)
        for _ in range(MOST_LEAPS):
            change = self._newton_step(V)
            if change is None:
                break
            motion, V = motion + change[0], V + change[1]
            size = self.attempt(motion, V)
            if size < start:
                landed = motion, V, size
            if not start <= size < NEARER * last:
                break
            last = size
        self.trial.drag[1] = held
        return landed

    def correction(self, V: float) -> float:
        """Change of V by one more Newton step at the present motion (N); infinite if the tangent is singular."""
        self.attempt(self.motion(), V)
        self.differentiate(V)
        if not self.solve():
            return math.inf
        by_residual, by_load = self.answers
        return -inner(self.load, by_residual) / inner(self.load, by_load)

    def mechanism(self, slope: float) -> np.ndarray | None:
        """Motion (6 f,) per unit of work of the unit load, along the tangent of the last iteration.

        None if V grows by more than ``slope`` (N/J) with that work, and so no mechanism moves.
        """
        by_load = self.answers[1]
        work = inner(self.load, by_load)
        return by_load / work if work * slope > 1.0 else None

    def prepare(self) -> None:
        """Compile or load the kernels of `solve`, without solving anything."""
        self.tangent.prepare(self.trial.seen_a, self.trial.seen_b, self.trial.tangent)

    def solve(self) -> bool:
        """Solve with the tangent for the out-of-balance and for the unit load; False if it is singular."""
        began = time.perf_counter()
        solved = self._solve()
        self.phases["equations"] += time.perf_counter() - began
        return solved

    def _solve(self) -> bool:
        trial = self.trial
        if self.tangent.make(trial.seen_a, trial.seen_b, trial.tangent, PIVOT, self._none) >= 0:
            return False
        self.answers[:] = trial.residual, self.load
        self.tangent.solve(self.answers)
        return True
