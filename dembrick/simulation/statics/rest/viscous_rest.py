"""Equilibrium or fall under the dead loads, decided by viscous motion (`ViscousMotion`).

While the blocks move, a drag proportional to the elastic stiffness resists the motion of every joint, like a dashpot.
Each step is solved by Newton's method, implicit in drag and friction (backward Euler; without friction the proximal
point method of Rockafellar, SIAM J. Control Optim. 14 (1976) 877), and the drag falls from step to step, so that steps
grow as fast as the blocks' resistance fades. Blocks that have an equilibrium come to rest in it. Blocks that have none
end in a steady motion: the out-of-balance force no longer changes, no gap closes, and the same motion goes on for ever.
The dead loads then do more work than friction dissipates, whatever the speed: without the drag the blocks accelerate
along that mechanism. That proves the fall. If neither shows, the result is undecided.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dembrick.simulation.statics import joint_families, ties
from dembrick.simulation.statics.newton import DIFFERENCE, HELD, Equilibria, elastic_moves
from dembrick.simulation.statics.sparse_equations import Factors
from dembrick.simulation.statics.state import State

BALANCED, RESTS = 1e-12, 1e-9  # of the joint forces: out-of-balance that is aimed at, and that counts as equilibrium
NEAR = 1e-5  # of them: out-of-balance below which an equilibrium without drag is tried
SOLVED = 1e-4  # of the out-of-balance after a step: tolerance of the next one
FINEST = 1e-13  # of the joint forces: least tolerance; nor is it less than what rounding causes,
COARSEST = 0.01  # up to this share of the out-of-balance
FASTER, FASTEST, SLOWER = 4.0, 16.0, 4.0  # drag is divided after a step, after an easy one; multiplied after a failure
EASY = 3  # iterations of an easy step
MOST_STEPS, MOST_DRAG = 150, 1e3  # of the motion; over the elastic stiffness
STRETCHES, LONGER = 2, 4.0  # of a steady motion beyond a block's size; ratio of the displacements at their ends
STEADY = 0.25  # of the out-of-balance: its greatest loss on each; shrinking strips lose as much again, no more


class FreeEquilibria(Equilibria):
    """Equilibria under the dead loads alone: no actuator prescribes any displacement."""

    most_short, stalled = 10, 1.0  # there is no other method to fall back on, nor are there bounds

    def __init__(self, state: State, factor: Factors):
        super().__init__(state, np.zeros((len(state.blocks.displacement), 6)), factor, BALANCED)
        self.loosest = RESTS

    def _at_held_displacement(self) -> tuple[np.ndarray, float]:
        return self.answers[0], 0.0


class ViscousMotion:
    """Viscous motion of a ``state`` from its present positions; ``factor``: of the elastic stiffness.

    ``pause`` is called before every iteration. ``iterations``: of Newton's method; ``unbalanced``: the out-of-balance
    over the joint forces that is left. The state ends in equilibrium, or in the last step of the motion.
    """

    def __init__(self, state: State, factor: Factors, pause: Callable[[], None]):
        self.state = state
        self.search = FreeEquilibria(state, factor)
        self.search.pause = pause
        self.drag = self.unbalanced = self.moving = 1.0  # moving: the out-of-balance over the forces of the scene
        self.path: list[tuple[float, float]] = []  # displacement (in block sizes) and out-of-balance (energy norm)
        arms = (state.joints.arm_a, state.joints.arm_b)
        self.size = max(float(np.sqrt((arm**2).sum(axis=1)).max()) for arm in arms)

    @property
    def iterations(self) -> int:
        return self.search.iterations

    def run(self) -> bool | None:
        """True if the blocks find an equilibrium, False if they fall, None if neither shows.

        Bonds stay intact until the blocks rest; those that fail first then break, and the motion goes on.
        """
        self._reserves = joint_families.reserves(self.state)
        bonded = joint_families.has_strengths(self.state)
        joint_families.keep_bonds_intact(self.state, bonded)
        stands = self._move()
        while stands and bonded and self._bonds_break():
            stands = self._move()
        joint_families.keep_bonds_intact(self.state, False)
        return stands

    def _bonds_break(self) -> bool:
        """Break the bonds that fail first; whether there are any."""
        if not joint_families.overloaded(self.state).any():
            return False
        joint_families.break_bonds(self.search.trial, joint_families.without_first(self.state, self._reserves))
        self.search.attempt(self.search.motion(), 0.0)
        self._keep()
        return True

    def _move(self) -> bool | None:
        """`run` while no bond breaks."""
        self.drag = self.unbalanced = self.moving = 1.0
        self._keep()
        start = now = self.search.motion()
        rate = np.zeros_like(now)  # of the last step, over the drag
        self.path.clear()
        for _ in range(MOST_STEPS):
            found = self._step(now, rate / self.drag)
            if found is None:
                self.drag *= SLOWER
                if self.drag > MOST_DRAG:
                    break
                continue
            change, now = found - now, found
            rate = self.drag * change
            closing = joint_families.closes_gaps(self.state, self.search.trial.base)
            self._keep()
            force = self.search.attempt(now, 0.0)
            self.unbalanced, self.moving = self.search.out_of_balance(), self._of_scene()
            if self.moving <= NEAR and self._rests(now):
                return True
            away = np.abs(now - start)[self.search.rows[:, :3]]
            self.path.append((float(away.max()) / self.size, force))
            if self._is_steady() and not closing:
                self._show(now, change)
                return False
            self.drag /= FASTEST if self.tried <= EASY else FASTER
        return True if self.unbalanced <= RESTS else None

    def _of_scene(self) -> float:
        """The greatest out-of-balance over the greatest force of the scene."""
        balance = self.search.balance
        balance.shared = True
        found = self.search.out_of_balance()
        balance.shared = False
        return found

    def _is_steady(self) -> bool:
        """Whether the out-of-balance force has stopped falling: it fell little over two stretches, on each of which the
        displacement grew fourfold, from more than a block's size on."""
        (far, force), stretches = self.path[-1], STRETCHES
        for at, before in reversed(self.path):
            if not stretches or at < 1.0:
                break
            if LONGER * at <= far:
                if before - force > STEADY * force:
                    return False
                far, force, stretches = at, before, stretches - 1
        return not stretches

    def _step(self, start: np.ndarray, ahead: np.ndarray) -> np.ndarray | None:
        """The motion after a step from ``start`` with the present drag; None if it is not found.

        The initial guess is ``start`` or ``start + ahead``, whichever has the smaller out-of-balance.
        """
        search, drag = self.search, self.search.trial.drag
        drag[:] = self.drag, max(self.drag, HELD)
        guess = min((start, start + ahead), key=lambda motion: search.attempt(motion, 0.0))
        search.balance.shared = True
        rounding = min(search.balance.rounding(), COARSEST * self.moving)
        search.balanced = max(SOLVED * self.moving, FINEST, rounding)
        found, self.tried = search.find(guess.copy(), 0.0)
        search.balance.shared = False
        drag[:] = 0.0, HELD
        return None if found is None else search.motion()

    def _rests(self, start: np.ndarray) -> bool:
        """Whether an equilibrium without drag is found from ``start``; else the state is restored."""
        search, found = self.search, None
        for balanced in (BALANCED, RESTS):
            search.balanced = balanced
            found, _ = search.find(start.copy(), 0.0)
            if found is not None:
                break
        if found is None:
            search.attempt(start, 0.0)
            return False
        self._keep()
        search.attempt(search.motion(), 0.0)
        self.unbalanced = search.out_of_balance()
        return True

    def _keep(self) -> None:
        """Make the present motion the history from which joints and ties continue."""
        state, trial = self.state, self.search.trial
        ties.remember(state)
        self.search.remember()
        trial.move[:] = DIFFERENCE * elastic_moves(state)

    def _show(self, now: np.ndarray, change: np.ndarray) -> None:
        """Leave the blocks in one more step of their steady motion."""
        blocks, rows = self.state.blocks, change[self.search.rows]
        self.search.attempt(now + change, 0.0)
        blocks.velocity[blocks.free], blocks.spin[blocks.free] = rows[:, :3], rows[:, 3:]
