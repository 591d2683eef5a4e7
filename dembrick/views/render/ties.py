"""Ties in a picture: a line between the ends of each, and what they carry in words."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dembrick.views import summary
from dembrick.views.motion.blocks import Poses
from dembrick.views.motion.ties import TieMotion

if TYPE_CHECKING:
    from dembrick.history.reader import History

COLOUR = "#D8008A"
WIDTH = 5


class DrawnTies:
    """The ties of a ``history``, drawn with the motion of their blocks times ``factor``."""

    def __init__(self, history: History, factor: float):
        self._motion, self._factor, self._mesh = TieMotion(history), factor, None

    def ends(self, poses: Poses) -> np.ndarray:
        """Where they are drawn (2 t, 3)."""
        return self._motion.ends(poses, self._factor)[0]

    def build(self, plotter) -> None:
        if not self._motion.count:
            return
        import pyvista

        lines = np.column_stack([np.full(self._motion.count, 2), np.arange(2 * self._motion.count).reshape(-1, 2)])
        self._mesh = pyvista.PolyData(np.zeros((2 * self._motion.count, 3)), lines=lines.ravel())
        plotter.add_mesh(self._mesh, color=COLOUR, line_width=WIDTH, render_lines_as_tubes=True, lighting=False)

    def show(self, poses: Poses) -> None:
        if self._mesh is not None:
            self._mesh.points[:] = self.ends(poses)

    def words(self, frame: int) -> list[str]:
        if not self._motion.count:
            return []
        tension = self._motion.series("tension", frame, frame + 1)[0]
        least, most = float(tension.min()), float(tension.max())
        if len(tension) == 1:
            return [f"magenta: tie, {summary.load_text(most)}"]
        return [f"magenta: ties, {summary.load_text(least)} to {summary.load_text(most)}"]
