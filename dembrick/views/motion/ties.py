"""Ties of a recorded run in its frames: their ends, and what they carry."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dembrick.geometry.rotations import rotation_matrix
from dembrick.views.motion.blocks import CarriedPoints, Poses
from dembrick.views.motion.frames import nearest

if TYPE_CHECKING:
    from dembrick.history.reader import History


class TieMotion:
    """The t ties of a history, carried by their blocks."""

    def __init__(self, history: History):
        self._history, self.count = history, history.n_tie
        block = np.array([tie["blocks"] for tie in history.ties], np.int64).reshape(-1)
        point = np.array([tie["points"] for tie in history.ties], float).reshape(-1, 3)
        turn = rotation_matrix(history.orientation0)[block]
        body = np.einsum("nji,nj->ni", turn, point - history.position0[block])
        self.blocks, self._ends = block.reshape(-1, 2), CarriedPoints(history, body, block)

    def ends(self, poses: Poses, factor: float = 1.0) -> np.ndarray:
        """Ends (f, 2 t, 3) m, one tie after the other, with the motion of the blocks times ``factor``."""
        return self._ends.magnified(poses, factor)

    def series(self, name: str, start: int, stop: int) -> np.ndarray:
        """``tension`` (N) or ``yielded`` (m) of the frames start to stop (f, t)."""
        history = self._history
        if not history.n_row:
            return np.zeros((stop - start, self.count))
        return history.series(name)[nearest(history.time, history.frame_time[start:stop])]
