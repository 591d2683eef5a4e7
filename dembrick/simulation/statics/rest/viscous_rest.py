"""Rest or fall under the dead loads, by viscous motion (`ViscousMotion`).

While the blocks move, a part of the elastic stiffness resists the motion of every joint, as a dashpot would. Each step
is found by Newton's method, implicit in drag and friction (backward Euler; without friction the proximal point method
of Rockafellar, SIAM J. Control Optim. 14 (1976) 877), and the drag falls from step to step, so that steps grow as fast
as the blocks' resistance fades. Blocks that have an equilibrium come to rest in it. Blocks that have none end in a
steady motion: what is out of balance no longer changes, no gap closes, and the same motion goes on for ever. There
the dead loads do more work than friction takes, whatever the speed: without the drag the blocks accelerate along that
mechanism. That is the proof of a fall. What shows neither is undecided.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dembrick.simulation.statics import joint_families, ties
from dembrick.simulation.statics.newton import DIFFERENCE, HELD, Equilibria, elastic_moves
from dembrick.simulation.statics.sparse_equations import Factors
from dembrick.simulation.statics.state import State

BALANCED, RESTS = 1e-12, 1e-9  # of the joint forces: out-of-balance that is asked for, and that is rest
NEAR = 1e-5  # of them: out-of-balance from which rest is looked for without drag
SOLVED = 1e-4  # of the out-of-balance of a step: what the next one may leave of its own
FINEST = 1e-13  # of the joint forces: no less can be asked for, nor less than so many times what a motion, rounded,
ROUNDED, COARSEST = 4.0 * float(np.finfo(float).eps), 0.01  # makes of force, up to this share of the out-of-balance
FASTER, FASTEST, SLOWER = 4.0, 16.0, 4.0  # by which the drag falls after a step, after an easy one; rises after none
EASY = 3  # iterations of an easy step
MOST_STEPS, MOST_DRAG = 150, 1e3  # of the motion; over the elastic stiffness
STRETCHES, LONGER = 2, 4.0  # of a steady motion, from a block's size on; how much further each goes than that before
STEADY = 0.25  # of the out-of-balance: what it may lose on each; of strips that shrink it loses as much again, no more


class FreeEquilibria(Equilibria):
    """Equilibria under the dead loads alone: no actuator holds any displacement."""

    most_short = 10  # nothing else finds the way out

    def __init__(self, state: State, factor: Factors):
        super().__init__(state, np.zeros((len(state.blocks.displacement), 6)), factor, BALANCED)

    def _at_held_displacement(self) -> tuple[np.ndarray, float]:
        return self.answers[0], 0.0


class ViscousMotion:
    """Viscous motion of a ``state`` from where its blocks are; ``factor``: of the elastic stiffness.

    ``pause`` is called before every iteration. ``iterations`` of Newton's method, and the out-of-balance over the joint
    forces that is left (``unbalanced``). The state ends at rest, or in the last step of the motion.
    """

    def __init__(self, state: State, factor: Factors, pause: Callable[[], None]):
        self.state = state
        self.search = FreeEquilibria(state, factor)
        self.search.pause = pause
        self.unbalanced, self.drag = 1.0, 1.0
        self.path: list[tuple[float, float]] = []  # how far (in block sizes), and what was out of balance (energy norm)
        self.stiffest = float(joint_families.stiffness(state)[:, 2, 2].max())  # N/m
        arms = (state.joints.arm_a, state.joints.arm_b)
        self.size = max(float(np.sqrt((arm**2).sum(axis=1)).max()) for arm in arms)

    @property
    def iterations(self) -> int:
        return self.search.iterations

    def run(self) -> bool | None:
        """True at rest, False if the blocks fall, None if neither shows.

        Bonds hold until the blocks rest; those that bear too much first then break, and the motion goes on.
        """
        self._reserves = joint_families.reserves(self.state)
        bonded = joint_families.has_strengths(self.state)
        joint_families.hold_bonds(self.state, bonded)
        stands = self._move()
        while stands and bonded and self._bonds_break():
            stands = self._move()
        joint_families.hold_bonds(self.state, False)
        return stands

    def _bonds_break(self) -> bool:
        """Let the bonds go that bear too much first; whether there are any."""
        if not joint_families.overborne(self.state).any():
            return False
        joint_families.break_bonds(self.search.trial, joint_families.without_first(self.state, self._reserves))
        self.search.attempt(self.search.motion(), 0.0)
        self._keep()
        return True

    def _move(self) -> bool | None:
        """`run` while no bond breaks."""
        self.drag, self.unbalanced = 1.0, 1.0
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
            self.unbalanced = self.search.out_of_balance()
            if self.unbalanced <= NEAR and self._rests(now):
                return True
            away = np.abs(now - start)[self.search.rows[:, :3]]
            self.path.append((float(away.max()) / self.size, force))
            if self._is_steady() and not closing:
                self._show(now, change)
                return False
            self.drag /= FASTEST if self.tried <= EASY else FASTER
        return True if self.unbalanced <= RESTS else None

    def _is_steady(self) -> bool:
        """Whether what is out of balance has stopped falling: twice by little while the blocks went four times as far,
        from further than their size on."""
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
        """The motion after a step from ``start`` with the drag of now; None if it is not found.

        It is looked for from ``start``, or ``ahead`` of it by as much, where less is out of balance.
        """
        search, drag = self.search, self.search.trial.drag
        drag[:] = self.drag, max(self.drag, HELD)
        rounding = float(np.abs(start + ahead).max()) * self.stiffest / search.greatest_force()
        search.balanced = max(SOLVED * self.unbalanced, FINEST, min(ROUNDED * rounding, COARSEST * self.unbalanced))
        guess = min((start, start + ahead), key=lambda motion: search.attempt(motion, 0.0))
        found, self.tried = search.find(guess.copy(), 0.0)
        drag[:] = 0.0, HELD
        return None if found is None else search.motion()

    def _rests(self, start: np.ndarray) -> bool:
        """Whether an equilibrium without any drag is found from here; else everything is as it was."""
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
        """Make the motion of now the one from which joints and ties go on."""
        state, trial = self.state, self.search.trial
        ties.remember(state)
        self.search.remember()
        trial.move[:] = DIFFERENCE * elastic_moves(state)

    def _show(self, now: np.ndarray, change: np.ndarray) -> None:
        """Leave the blocks in one more step of their steady motion."""
        blocks, rows = self.state.blocks, change[self.search.rows]
        self.search.attempt(now + change, 0.0)
        blocks.velocity[blocks.free], blocks.spin[blocks.free] = rows[:, :3], rows[:, 3:]
