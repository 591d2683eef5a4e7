"""Arrows in a picture: driven and dead loads outside the blocks, with tips at their points of application; reactions
along their lines of action, below the supports; ties as lines.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from dembrick.assembly.actuators import BODY_FORCE, PRESSURE
from dembrick.errors import HistoryError
from dembrick.geometry.rotations import rotation_matrix
from dembrick.scenario.checks import listed
from dembrick.views import summary
from dembrick.views.motion import loads
from dembrick.views.motion.blocks import CarriedPoints, Poses
from dembrick.views.motion.frames import START, in_collapse, nearest
from dembrick.views.motion.loads import TieMotion
from dembrick.views.render.force_arrows import ARROW, glyphs, put_glyphs

if TYPE_CHECKING:
    from dembrick.history.reader import History


DRIVEN, DEAD, SETTLES, REACTION, TIE = "#D55E00", "#5B3FA0", "#0072B2", "#333333", "#D8008A"
_LONGEST = 0.5  # of the largest free block: length of the longest arrow
_OF_BODIES = 0.15  # of the extent of the structure: length of the arrow of the forces on all blocks
_POINT = 0.03  # of the longest arrow: radius of the ball at a point of application


class LoadArrows:
    """Loads ``given`` of a ``history`` in one colour, on blocks whose motion is multiplied by ``factor``. ``length``
    (m): that of the longest arrow; ``balls``: mark the points of application."""

    def __init__(self, history: History, given: Sequence[loads.Load], factor: float, length: float, balls: bool = True):
        self._given, self._factor, self._length, self._has_balls = given, factor, length, balls
        block = np.array([load.block for load in given], np.int64)
        arm = np.array([load.arm for load in given]).reshape(-1, 3)
        body = np.einsum("nji,nj->ni", rotation_matrix(history.orientation0)[block], arm)
        self._points = CarriedPoints(history, body, block)
        size = np.array([load.size for load in given])
        way = np.array([load.way for load in given]).reshape(-1, 3)
        self._arrow = (length * size / max(float(size.max(initial=0.0)), 1e-300))[:, None] * way
        shift = np.array([load.place.shift for load in given])[:, None] * way
        pulls = np.array([load.place.pulls for load in given], bool)[:, None]
        self._from_point = shift - np.where(pulls, 0.0, self._arrow)

    def __len__(self) -> int:
        return len(self._given)

    def ends(self, poses: Poses) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points of application on the drawn blocks, tails and tips of the arrows, (k, 3) m each."""
        if not self._given:
            return (np.zeros((0, 3)),) * 3
        points = self._points.magnified(poses, self._factor)[0]
        tails = points + self._from_point
        return points, tails, tails + self._arrow

    def build(self, plotter, colour: str, somewhere: np.ndarray) -> None:
        """Add the arrows to a plotter; they lie ``somewhere`` (3,) until they are shown."""
        import pyvista

        place = np.tile(somewhere, (len(self._given), 1))
        self.arrows = glyphs(plotter, pyvista.Arrow(start=(0, 0, 0), direction=(1, 0, 0), **ARROW), place, colour)
        self._balls = glyphs(plotter, pyvista.Sphere(radius=_POINT * self._length), place, colour)

    def show(self, poses: Poses) -> None:
        points, tails, tips = self.ends(poses)
        put_glyphs(self.arrows, tails, tips - tails, np.linalg.norm(tips - tails, axis=1))
        put_glyphs(self._balls, points, tips - tails, float(self._has_balls))


class DrawnLoads:
    """All loads of a history except gravity: driven ones in orange, dead ones in violet. ``length`` (m): size of the
    largest free block; ``extent`` (m): that of the structure."""

    def __init__(self, history: History, factor: float, length: float, extent: float):
        self._history, dead = history, loads.dead_loads(history)
        driven = loads.driven_loads(history)
        self.of_bodies = loads.all_of(history, BODY_FORCE)
        longest = _OF_BODIES * extent if self.of_bodies else _LONGEST * length
        self.driven = LoadArrows(history, driven, factor, longest, balls=not self.of_bodies)
        self.dead = LoadArrows(history, dead, factor, _LONGEST * length)
        self._largest = max((load.size for load in dead), default=0.0)

    def reach(self, poses: Poses) -> np.ndarray:
        """Tails and tips (n, 3) of all arrows."""
        return np.concatenate([*self.driven.ends(poses)[1:], *self.dead.ends(poses)[1:]])

    def build(self, plotter, somewhere: np.ndarray) -> None:
        self.driven.build(plotter, DRIVEN, somewhere)
        self.dead.build(plotter, DEAD, somewhere)

    def show(self, poses: Poses) -> None:
        self.driven.show(poses)
        self.dead.show(poses)

    def words(self) -> list[str]:
        """Meaning of the colours of the arrows."""
        found = []
        if self.driven:
            found.append(f"orange: {self._what_drives()}")
        if self._largest:
            found.append(f"violet: dead loads, the longest {summary.load_text(self._largest)}")
        return found

    def _what_drives(self) -> str:
        if loads.all_of(self._history, PRESSURE):
            return "driven pressure"
        return "resultant of the body forces" if self.of_bodies else "actuators"


class DrawnSettlement:
    """Prescribed displacements of the supports of a ``history``, shown before a run by an arrow from each. ``length``
    (m): that of the longest."""

    def __init__(self, history: History, length: float):
        found = history.results.get("moving_supports") if history.status == START else None
        self._ways = {name: np.array(way, float) for name, way in (found or {}).items()}
        given = [
            loads.leaving(history, history.block_names.index(name), way)
            for name, way in self._ways.items()
            if way.any()
        ]
        self.arrows = LoadArrows(history, given, 1.0, length, balls=False)

    def reach(self, poses: Poses) -> np.ndarray:
        """Tails and tips (n, 3) of all arrows."""
        return np.concatenate(self.arrows.ends(poses)[1:])

    def build(self, plotter, somewhere: np.ndarray) -> None:
        self.arrows.build(plotter, SETTLES, somewhere)

    def show(self, poses: Poses) -> None:
        self.arrows.show(poses)

    def words(self) -> list[str]:
        if not self._ways:
            return []
        far = max(float(np.linalg.norm(way)) for way in self._ways.values())
        what = "is to move" if len(self._ways) == 1 else "are to move"
        told = f"by {summary.length(far)}" if far else "as they turn"
        return [f"{'blue: ' if far else ''}{listed(list(self._ways))} {what} {told}"]


LONGEST = 0.2  # of the structure's greatest extent: length of the arrow of the greatest reaction


class DrawnReactions:
    """The reactions of a ``history``, on supports whose motion is multiplied by ``factor``; none unless ``wanted``.

    ``extent`` (m): that of the structure. Raises HistoryError if they are wanted but there are none.
    """

    def __init__(self, history: History, wanted: bool, factor: float, extent: float):
        if wanted and not (history.n_support and history.n_row):
            raise HistoryError(f"{history.path}: there are no reactions to draw, because no block is fixed")
        self._history, self._factor, self._longest = history, factor, LONGEST * extent
        names = history.support_names if wanted else []
        self._blocks = [history.block_names.index(name) for name in names]
        self.largest = 0.0

    def survey(self, frames: list[int], poses_of, make_room) -> None:
        """Scale the arrows by the greatest reaction of all ``frames``, and make room for them in the picture."""
        if self._blocks:
            self.largest = max(float(np.linalg.norm(self._now(frame)[:, :3], axis=1).max()) for frame in frames)
            for frame in frames:
                make_room(self.ends(frame, poses_of(frame)).reshape(-1, 3))

    def _now(self, frame: int) -> np.ndarray:
        """Forces and moments (s, 6) of the row nearest to a frame; zero during a collapse."""
        history = self._history
        if in_collapse(history, [frame])[0]:
            return np.zeros((len(self._blocks), 6))
        return history.reaction[nearest(history.time, [history.frame_time[frame]])[0]]

    def ends(self, frame: int, poses: Poses) -> np.ndarray:
        """Tails and tips (s, 2, 3) m of the arrows, which end on the line of action at the far side of the support."""
        history, found = self._history, np.zeros((len(self._blocks), 2, 3))
        for k, (i, wrench) in enumerate(zip(self._blocks, self._now(frame), strict=True)):
            force = wrench[:3]
            moment = wrench[3:] - np.cross(poses.displacement[0, i], force)  # about its current centroid
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
        self._arrows = glyphs(plotter, arrow, self._history.position0[self._blocks], REACTION)

    def show(self, frame: int, poses: Poses) -> None:
        if self._blocks:
            tails, tips = self.ends(frame, poses).swapaxes(0, 1)
            put_glyphs(self._arrows, tails, tips - tails, np.linalg.norm(tips - tails, axis=1))

    def words(self) -> list[str]:
        return [f"dark: reactions, the longest {summary.load_text(self.largest)}"] if self._blocks else []


WIDTH = 5


class DrawnTies:
    """The ties of a ``history``, on blocks whose motion is multiplied by ``factor``."""

    def __init__(self, history: History, factor: float):
        self._motion, self._factor, self._mesh = TieMotion(history), factor, None

    def ends(self, poses: Poses) -> np.ndarray:
        """Drawn ends (2 t, 3) m."""
        return self._motion.ends(poses, self._factor)[0]

    def build(self, plotter) -> None:
        if not self._motion.count:
            return
        import pyvista

        lines = np.column_stack([np.full(self._motion.count, 2), np.arange(2 * self._motion.count).reshape(-1, 2)])
        self._mesh = pyvista.PolyData(np.zeros((2 * self._motion.count, 3)), lines=lines.ravel())
        plotter.add_mesh(self._mesh, color=TIE, line_width=WIDTH, render_lines_as_tubes=True, lighting=False)

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
