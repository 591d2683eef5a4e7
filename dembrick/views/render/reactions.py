"""Reactions of supports in a picture: an arrow along the line of action of each, below its support."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dembrick.errors import HistoryError
from dembrick.geometry.rotations import rotation_matrix
from dembrick.views import summary
from dembrick.views.motion.blocks import Poses
from dembrick.views.motion.frames import coming_down, nearest
from dembrick.views.render.force_arrows import ARROW, glyphs, put_glyphs

if TYPE_CHECKING:
    from dembrick.history.reader import History

COLOUR = "#333333"
LONGEST = 0.2  # of the structure's greatest extent: the arrow of the greatest reaction


class DrawnReactions:
    """The reactions of a ``history``, drawn with the motion of the supports times ``factor``; none unless ``wanted``.

    ``extent`` (m) is that of the structure. Raises HistoryError if they are wanted and nothing is fixed.
    """

    def __init__(self, history: History, wanted: bool, factor: float, extent: float):
        if wanted and not (history.n_support and history.n_row):
            raise HistoryError(f"{history.path}: it has no reactions of supports to draw: no block is fixed")
        self._history, self._factor, self._longest = history, factor, LONGEST * extent
        names = history.support_names if wanted else []
        self._blocks = [history.block_names.index(name) for name in names]
        self.largest = 0.0

    def survey(self, frames: list[int], poses_of, make_room) -> None:
        """Let the longest arrow of all ``frames`` stand for the greatest reaction, and make room for the arrows."""
        if self._blocks:
            self.largest = max(float(np.linalg.norm(self._now(frame)[:, :3], axis=1).max()) for frame in frames)
            for frame in frames:
                make_room(self.ends(frame, poses_of(frame)).reshape(-1, 3))

    def _now(self, frame: int) -> np.ndarray:
        """Forces and moments (s, 6) of the row next to a frame; zero if the structure comes down."""
        history = self._history
        if coming_down(history, [frame])[0]:
            return np.zeros((len(self._blocks), 6))
        return history.reaction[nearest(history.time, [history.frame_time[frame]])[0]]

    def ends(self, frame: int, poses: Poses) -> np.ndarray:
        """Tails and tips (s, 2, 3) of the arrows. They end at the far side of the support, on the line of action."""
        history, found = self._history, np.zeros((len(self._blocks), 2, 3))
        for k, (i, wrench) in enumerate(zip(self._blocks, self._now(frame), strict=True)):
            force = wrench[:3]
            moment = wrench[3:] - np.cross(poses.displacement[0, i], force)  # about its centroid now
            size = float(np.linalg.norm(force))
            corners = history.block_vertices(i) @ rotation_matrix(history.orientation0[i]).T
            place, way = np.zeros(3), force / (size or 1.0)
            if size > 1e-9 * self.largest:
                place = np.cross(force, moment) / size**2
                reach = float(np.linalg.norm(corners, axis=1).max())
                place *= min(1.0, reach / max(float(np.linalg.norm(place)), 1e-300))
            tip = history.position0[i] + self._factor * poses.displacement[0, i] + place
            tip = tip + float(((corners - place) @ way).min()) * way
            found[k] = tip - self._longest * size / (self.largest or 1.0) * way, tip
        return found

    def build(self, plotter) -> None:
        import pyvista

        arrow = pyvista.Arrow(start=(0, 0, 0), direction=(1, 0, 0), **ARROW)
        self._arrows = glyphs(plotter, arrow, self._history.position0[self._blocks], COLOUR)

    def show(self, frame: int, poses: Poses) -> None:
        if self._blocks:
            tails, tips = self.ends(frame, poses).swapaxes(0, 1)
            put_glyphs(self._arrows, tails, tips - tails, np.linalg.norm(tips - tails, axis=1))

    def words(self) -> list[str]:
        return [f"dark: reactions, the longest {summary.load_text(self.largest)}"] if self._blocks else []
