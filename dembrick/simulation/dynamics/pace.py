"""Choice between one thread and several for the loop of a run in real time, by measured speed."""

from __future__ import annotations

import math

LONGEST_CHUNK = 2048  # steps
TRIAL = 64  # steps of a measurement
FIRST_PAUSE, LONGEST_PAUSE = 250, 20_000  # steps until the next measurements


class Pace:
    """Selects the faster of two loops: both give the same bits, and threads only help if cores are free.

    Both are measured twice in turns, and the better time counts. As threads need a while to wake up, and cores become
    busy or free, measurements are repeated after ever longer pauses.
    """

    TURNS = 1, 0, 1, 0

    def __init__(self):
        self._seconds = [math.inf, math.inf]  # of a step
        self._turn, self._shown, self._took = 0, 0, 0.0  # of TURNS; steps of it, and their seconds
        self._pause = self._left = FIRST_PAUSE

    def choose(self, loops: int) -> tuple[int, int]:
        """The loop to call next, and for how many steps at most."""
        if loops == 1:
            return 0, LONGEST_CHUNK
        if self._turn < len(self.TURNS):
            return self.TURNS[self._turn], TRIAL - self._shown
        return (0 if self._seconds[0] <= self._seconds[1] else 1), LONGEST_CHUNK

    def note(self, which: int, steps: int, seconds: float) -> None:
        """Record the ``seconds`` of so many ``steps`` of a loop."""
        if self._turn < len(self.TURNS):
            self._shown, self._took = self._shown + steps, self._took + seconds
            if self._shown >= TRIAL:
                step = self._took / self._shown
                self._seconds[which] = step if self._turn < 2 else min(step, self._seconds[which])
                self._turn, self._shown, self._took = self._turn + 1, 0, 0.0
            return
        self._left -= steps
        if self._left <= 0:
            self._pause = min(2 * self._pause, LONGEST_PAUSE)
            self._turn, self._left = 0, self._pause
