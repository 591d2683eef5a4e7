"""The picture of a history in one of its frames: built once, then moved from frame to frame.

Nothing is rebuilt for a new frame: its points and colours are written into the existing VTK meshes.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

import numpy as np

from dembrick.errors import HistoryError
from dembrick.scenario.blocks import DIRECTIONS
from dembrick.views.motion.blocks import CarriedPoints, Poses, all_vertices, largest_extent, moving_blocks
from dembrick.views.motion.frames import MECHANISM, PEAK, START, ejected, frame_number
from dembrick.views.motion.joints import JointMotion
from dembrick.views.motion.magnification import automatic_magnification
from dembrick.views.motion.moments import words
from dembrick.views.plot.subject import chosen_joint, joint_names
from dembrick.views.render.annotations import CRIMSON, ScaleBar, ThrustLine, require_thrust
from dembrick.views.render.force_arrows import GREEN, PURPLE, DrawnForces, ForceArrows, glyphs, put_glyphs
from dembrick.views.render.loads import DrawnLoads, DrawnReactions, DrawnSettlement, DrawnTies
from dembrick.views.render.look import VIEWS, Colouring, Look
from dembrick.views.render.names import NameBoard, Names

if TYPE_CHECKING:
    from dembrick.history.reader import History

# Part of the picture that the blocks fill, in shares of its width and height: text above, colour bar and axes beside.
_LEFT, _RIGHT, _BOTTOM, _TOP = 0.03, 0.81, 0.04, 0.87
_WORDS, _LINE = 0.985, 1.95  # top of the text, share of the height; height of a line (pixels) over the font size
_GREY, _SAND, _BLUE = "#CFCFCF", "#EBDDBE", "#0072B2"
_WIDE = 76  # characters of a line of text above the blocks
# greatest number of blocks drawn with thick lines and their initial positions; fewer if force arrows are drawn
_FEW, _FEW_WITH_FORCES = 50, 12
_FORCE, _FORCE_OF_MANY = 0.6, 1.2  # of the largest free block: the longest arrow of a joint force


class Scene:
    """Blocks, actuators, ties, reactions, torsion centre and joint forces of ``history`` in a pyvista ``plotter``.

    ``frames``: those to be shown; colours, camera and magnification are chosen for all of them. ``below``: the share of
    the picture's height left free at the bottom. ``name``: put before the title. With ``waits`` nothing is built yet;
    :meth:`build` must be called when the scenes beside it are known.
    """

    def __init__(
        self, plotter, history: History, look: Look, frames: Iterable[int], *, below: float = _BOTTOM, name: str = "",
        waits: bool = False,
    ):  # fmt: skip
        frames, self._name = list(frames), name
        self._below = below
        self._plotter, self._history, self._look = plotter, history, look
        body, self._block, self._starts = all_vertices(history)
        self._carried = CarriedPoints(history, body, self._block)
        needed = look.forces or look.thrust or look.color in ("utilisation", "slip")
        self._joints = JointMotion(history) if needed and history.n_joint else None
        self._colouring = None if look.color == "none" else Colouring(history, look.color, self._carried, self._joints)
        if look.forces and not (self._joints and history.has_joints and history.n_row):
            raise HistoryError(
                f'{history.path}: the forces of joints were not recorded; run it again with "joints" in output.channels'
            )
        if look.thrust:
            require_thrust(history, self._joints)
        first = Poses.read(history, 0, 1)
        self._start = self._carried.magnified(first, 0.0)[0]
        moving = [i for i in range(history.n_block) if not history.block_fixed[i]]
        self._length = largest_extent(self._start, self._starts, moving or range(history.n_block))
        self._factor = look.magnification
        if self._factor is None:
            self._factor = automatic_magnification(history, frames)
        extent = float(np.ptp(self._start, axis=0).max())
        self._ties = DrawnTies(history, self._factor)
        self._loads = DrawnLoads(history, self._factor, self._length, extent)
        self._settlement = DrawnSettlement(history, self._length)
        self._reactions = DrawnReactions(history, look.reactions, self._factor, extent)
        direction, up = (np.array(v) for v in VIEWS[look.view])
        right = np.cross(up, direction)
        # rows: right and up in the picture, and towards the camera
        self._screen = np.array([right, np.cross(direction, right), direction])
        self._screen /= np.linalg.norm(self._screen, axis=1)[:, None]
        self._many = history.n_block > (_FEW_WITH_FORCES if look.forces else _FEW)
        self._meets = look.forces and history.has_new_contacts
        self._marked = self._marked_joint()
        self._drawn_forces = self.arrows = self.thrust = None
        if self._joints is not None and history.has_joints and history.n_row:
            self._drawn_forces = DrawnForces(history, self._joints, self._factor, bool(self._meets))
        if look.forces:
            longest = (_FORCE_OF_MANY if self._many else _FORCE) * self._length
            self.arrows = ForceArrows(self._drawn_forces, longest)
        self._survey(frames)
        self._last = frames[-1]
        if not waits:
            self.build(self.largest, self.whole)

    def build(self, largest: float, whole: float) -> None:
        """Draw the last of the frames, with colours up to the value ``largest``; ``whole`` (m): picture height."""
        if self._colouring is not None:
            self._scale = self._colouring.scale(largest)
        self._build()
        self.show(self._last)
        self._place_camera(whole)
        self._spread_names()
        if self._names.named:  # in a window the camera moves
            self._plotter.renderer.AddObserver("StartEvent", lambda *_: self._spread_names())

    @property
    def frame(self) -> int:
        return self._frame

    def show(self, frame: int) -> None:
        """Move everything to a frame."""
        self._frame = frame
        poses = self._poses(frame)
        points = self._carried.magnified(poses, self._factor)[0]
        for mesh in self._meshes:
            mesh.points[:] = points
        if self._colouring is not None and self._free.n_cells:
            values = self._scale.factor * self._colouring.values(frame, poses)
            if self._colouring.at_vertices:
                self._free.point_data["shown"][:] = values
            else:
                self._free.cell_data["shown"][:] = np.minimum(values, 1e30)[self._owner]
        self._loads.show(poses)
        self._settlement.show(poses)
        self._ties.show(poses)
        self._reactions.show(frame, poses)
        self._centre_shown = self._show_centre(frame)
        if self.arrows is not None:
            self.arrows.show(frame, poses)
        if self.thrust is not None:
            self.thrust.show(frame, poses)
        self._names.show(poses, points)
        self._text.input = self._words(self._centre_shown)

    def _spread_names(self) -> None:
        """Place the names for the current camera."""
        if self._names.spread():
            self._text.input = self._words(self._centre_shown)

    def pixels(self) -> np.ndarray:
        """Pixels (h, w, 3) of the current picture."""
        self._plotter.render()
        return self._plotter.screenshot(return_img=True)

    def shades(self, width: int) -> np.ndarray:
        """Pixels (h, width, 3) of all shades of the thin arrows, to be included in the choice of a small palette."""
        import pyvista

        rows = [np.zeros((0, 3))]
        for colour in (*((GREEN, PURPLE) if self._look.forces else ()), *((CRIMSON,) if self._look.thrust else ())):
            rows.append(np.outer(np.linspace(0.25, 1.0, 8), pyvista.Color(colour).int_rgb))
        return np.repeat(np.repeat(np.concatenate(rows)[:, None], 8, axis=0), width, axis=1).astype(np.uint8)

    # --- done once ---

    def _poses(self, frame: int) -> Poses:
        return Poses.read(self._history, frame, frame + 1)

    def _marked_joint(self) -> tuple[dict, JointMotion] | None:
        """The joint whose torsion centre is marked: the one that failed under an actuator."""
        history = self._history
        if not (history.n_joint and history.actuators):
            return None
        number = chosen_joint(history)
        return history.joints[number], JointMotion(history, number)

    def _survey(self, frames: list[int]) -> None:
        """Find the extent of the motion seen from the camera, and the largest values, over all frames to be shown."""
        self._seen = np.array([np.full(3, np.inf), np.full(3, -np.inf)])
        largest, gone = 0.0, ejected(self._history)
        past = frame_number(self._history, PEAK) if gone.any() and len(frames) > 1 else None
        self._make_room(self._start)
        for frame in frames:
            poses = self._poses(frame)
            self._make_room(self._carried.magnified(poses, self._factor)[0])
            self._make_room(self._rod_at(frame))
            self._make_room(self._ties.ends(poses))
            self._make_room(self._loads.reach(poses))
            self._make_room(self._settlement.reach(poses))
            if self._colouring is not None:
                values = self._colouring.values(frame, poses)
                if past is not None and frame > past:
                    values = values[~(gone[self._block] if self._colouring.at_vertices else gone)]
                largest = max(largest, float(values.max(initial=0.0, where=np.isfinite(values))))
        if self.arrows is not None:
            self.arrows.survey(frames, self._poses, self._make_room)
        self._reactions.survey(frames, self._poses, self._make_room)
        self.largest = largest
        width, height = self._plotter.window_size
        extent = (self._seen[1] - self._seen[0])[:2]
        keys = self._keys(frames[-1], bool(self._marked), 9, n_left_out=9 if self._look.names != "none" else 0)
        lines = len(self._title()) + 1 + len(_lines(keys))
        # the font size grows with the width of the picture
        taken = (lines + 0.4) * _LINE * _font_size(width) / height
        self._top = max(min(_TOP, _WORDS - taken), self._below + 0.4)
        self.whole = max(extent[1] / (self._top - self._below), extent[0] / (_RIGHT - _LEFT) * height / width)

    def _make_room(self, points: np.ndarray) -> None:
        """Extend the picture to contain points (n, 3) m."""
        if len(points):
            seen = points @ self._screen.T
            self._seen[0] = np.minimum(self._seen[0], seen.min(axis=0))
            self._seen[1] = np.maximum(self._seen[1], seen.max(axis=0))

    def _build(self) -> None:
        import pyvista

        plotter, history, fixed = self._plotter, self._history, self._history.block_fixed
        plotter.set_background("white")
        many, forces = self._many, self._look.forces
        # arrows are drawn between the blocks: the more blocks, the more transparent they must be
        opacity = (0.1 if many else 0.35) if forces else 1.0
        free = [i for i in range(history.n_block) if not fixed[i]]
        held = [i for i in range(history.n_block) if fixed[i]]
        self._free, supports = self._surface(free), self._surface(held)
        self._owner = np.repeat(free, [len(history.block_faces(i)) for i in free])
        edges = self._edges(range(history.n_block))
        self._meshes = [mesh for mesh in (self._free, supports, edges) if mesh.n_cells]
        if supports.n_cells:
            plotter.add_mesh(supports, color=_GREY, ambient=0.35, diffuse=0.65, opacity=opacity)
        if self._free.n_cells and self._colouring is None:
            colour = _SAND if history.status == START else _GREY
            plotter.add_mesh(self._free, color=colour, ambient=0.35, diffuse=0.65, opacity=opacity)
        elif self._free.n_cells:
            data = self._free.point_data if self._colouring.at_vertices else self._free.cell_data
            data["shown"] = np.zeros(self._free.n_points if self._colouring.at_vertices else self._free.n_cells)
            plotter.add_mesh(
                self._free,
                scalars="shown",
                cmap="cividis",
                clim=(0.0, self._scale.top),
                ambient=0.35,  # sums to 1 with the diffuse part: faces towards the light have the colour of the bar
                diffuse=0.65,
                opacity=opacity,
                scalar_bar_args=self._bar(),
            )
            if forces:
                self._fade_bar(1.0 - (1.0 - opacity) ** (4 if many else 2))  # two faces each of one or two blocks
        thin = {"color": "#999999", "opacity": 0.5} if forces and many else {"color": "black"}
        plotter.add_mesh(edges, line_width=1.5 if many else 3, **thin)
        if not many:
            rest = self._edges(free)
            rest.points[:] = self._start
            plotter.add_mesh(rest, color="#777777", line_width=2, opacity=0.8)
        self._loads.build(plotter, self._start[0])
        self._settlement.build(plotter, self._start[0])
        self._ties.build(plotter)
        self._reactions.build(plotter)
        if self._marked:
            rod = pyvista.Cylinder(direction=(1, 0, 0), radius=0.006 * self._length, height=self._length)
            self._rod = glyphs(plotter, rod, self._start[:1], _BLUE)
        if self.arrows is not None:
            self.arrows.build(plotter, history.n_joint, self._start[0])
        if self._look.thrust:
            self.thrust = ThrustLine(plotter, history, self._joints, self._drawn_forces)
        self._names = NameBoard(plotter, self._build_names())
        self.bar = ScaleBar(plotter)
        size = _font_size(plotter.window_size[0])
        self._text = plotter.add_text(" ", position=(0.012, _WORDS), viewport=True, color="black", font_size=size)
        axes = {"x_color": "#D55E00", "y_color": "#009E73", "z_color": "#0072B2", "color": "black"}
        plotter.add_axes(interactive=False, viewport=(0.84, 0.08, 0.96, 0.22), line_width=3, **axes)
        self._text.prop.justification_vertical = "top"

    def _build_names(self) -> list[tuple[Names, Callable]]:
        """The requested names, each with the function ``(poses, vertices) -> points`` that gives their points."""
        history, found = self._history, [] if self._many else self._guides()
        if self._look.names in ("blocks", "all"):
            own = moving_blocks(history, self._last)
            ends = [slice(self._starts[i], self._starts[i + 1]) for i in own]
            found.append(
                (
                    Names(self._plotter, [history.block_names[i] for i in own], "black"),
                    lambda _, points: np.array([points[part].mean(axis=0) for part in ends]),
                )
            )
        if self._look.names in ("joints", "all") and history.n_joint:
            joints, moving = self._joints or JointMotion(history), set(moving_blocks(history, self._last))
            drawn, middle = DrawnForces(history, joints, self._factor, False), np.zeros((joints.n_joint, 2))
            shown = [i for i in range(joints.n_joint) if moving & {int(joints.block_a[i]), int(joints.block_b[i])}]
            told = joint_names(history)
            found.append(
                (
                    Names(self._plotter, [told[i] for i in shown], _BLUE),
                    lambda poses, _: drawn.on_joints(poses, middle)[shown],
                )
            )
        return found

    def _guides(self) -> list[tuple[Names, Callable]]:
        """Labels on top of guided blocks with the directions in which they are fixed."""
        history = self._history
        held = history.block_held
        guided = np.flatnonzero(held.any(axis=1) & ~history.block_fixed)
        if not len(guided):
            return []
        told = ["held: " + " ".join(np.array(DIRECTIONS)[held[i]]) for i in guided]
        ends = [slice(self._starts[i], self._starts[i + 1]) for i in guided]

        def tops(_, points: np.ndarray) -> np.ndarray:
            return np.array([[*points[own, :2].mean(axis=0), points[own, 2].max()] for own in ends])

        return [(Names(self._plotter, told, _BLUE), tops)]

    def _surface(self, blocks: list[int]):
        """Mesh of the faces of some blocks, with the vertices of all blocks."""
        import pyvista

        faces = [
            (len(face), *(self._starts[i] + number for number in face))
            for i in blocks
            for face in self._history.block_faces(i)
        ]
        return pyvista.PolyData(self._start.copy(), faces=np.concatenate([*faces, ()]).astype(np.int64))

    def _edges(self, blocks: Iterable[int]):
        import pyvista

        pairs = {
            (self._starts[i] + min(pair), self._starts[i] + max(pair))
            for i in blocks
            for face in self._history.block_faces(i)
            for pair in zip(face, face[1:] + face[:1], strict=True)
        }
        lines = np.array([(2, *pair) for pair in sorted(pairs)], np.int64)
        return pyvista.PolyData(self._start.copy(), lines=lines.ravel())

    def _bar(self) -> dict:
        size = round(self._plotter.window_size[0] / 62)
        bar = {"title": self._scale.title + "\n", "color": "black", "n_labels": 5, "fmt": "%.3g", "vertical": True}
        bar |= {"position_x": 0.875, "position_y": 0.26, "height": 0.5, "width": 0.05}
        return bar | {"title_font_size": size, "label_font_size": size}

    def _fade_bar(self, opacity: float) -> None:
        """Give the colour bar the colours of transparent blocks on white."""
        from vtkmodules.vtkCommonCore import vtkLookupTable

        (bar,) = self._plotter.scalar_bars.values()
        table = vtkLookupTable()
        table.DeepCopy(bar.GetLookupTable())
        for i in range(table.GetNumberOfTableValues()):
            colour = np.array(table.GetTableValue(i))
            table.SetTableValue(i, [*(1.0 - opacity * (1.0 - colour[:3])), 1.0])
        bar.SetLookupTable(table)

    def _place_camera(self, whole: float) -> None:
        """Set a parallel projection in which the required extent fills its part of the picture.

        ``whole`` (m): height of the whole picture in the scene.
        """
        plotter = self._plotter
        low, high = self._seen
        width, height = plotter.window_size
        # offset of the middle of the picture from that of the part used
        aside = np.array([(1.0 - _LEFT - _RIGHT) * width / height, 1.0 - self._below - self._top, 0.0])
        focus = (0.5 * (low + high) + 0.5 * whole * aside) @ self._screen
        distance = (high - low)[2] + self._length
        plotter.enable_parallel_projection()
        plotter.camera_position = [tuple(focus + distance * self._screen[2]), tuple(focus), tuple(self._screen[1])]
        plotter.camera.parallel_scale = 0.5 * whole
        plotter.renderer.reset_camera_clipping_range()

    # --- frame by frame ---

    def _rod_at(self, frame: int) -> np.ndarray:
        """Ends (2, 3) m of a rod through the torsion centre of the marked joint; (0, 3) if there is none nearby."""
        if self._marked:
            joint, motion = self._marked
            centre = motion.torsion_centre(frame)[0]
            # in nearly pure shear a mark far away would make the blocks small
            if np.isfinite(centre).all() and np.linalg.norm(centre) <= 2.0 * self._length:
                middle = joint["origin"] + centre @ joint["axes"][:2]
                return middle + 0.5 * self._length * np.outer([-1.0, 1.0], joint["axes"][2])
        return np.zeros((0, 3))

    def _show_centre(self, frame: int) -> bool:
        """Show the axis of the torsion centre; return whether it is visible."""
        ends = self._rod_at(frame)
        if self._marked:
            put_glyphs(self._rod, ends[:1] + 0.5 * np.diff(ends, axis=0), np.diff(ends, axis=0), 1.0)
        return bool(len(ends))

    def _words(self, marked: bool) -> str:
        history = self._history
        if history.status == MECHANISM:
            told = "mechanism of limit analysis: velocities, not to scale"
        else:
            shown = f"motion x {self._factor:g}" if self._factor != 1.0 else "true scale"
            told = ", ".join([*words(history, self._frame), shown])
            if history.results.get("unlimited"):
                told += "\nno limit: blocks overlap by the elastic deformation of their joints"
        n_hinges = len(self.thrust.hinges) if self.thrust else 0
        keys = self._keys(self._frame, marked, n_hinges, self._names.left_out)
        return "\n".join([*self._title(), told, *_lines(keys)]).rstrip()

    def _has_moved(self, frame: int) -> bool:
        """Whether any block is drawn away from its initial position."""
        poses = self._poses(frame)
        moved = poses.displacement.any() or (poses.orientation != self._history.orientation0).any()
        return bool(moved and self._factor)

    def _title(self) -> list[str]:
        """The title in one or two lines."""
        title = self._history.title
        return textwrap.wrap(f"{self._name}: {title}" if self._name else title, _WIDE)[:2]

    def _keys(self, frame: int, marked: bool, n_hinges: int, n_left_out: int) -> list[str]:
        """Legend of colours and arrows."""
        history = self._history
        if history.status == START:
            keys = ["grey: fixed"] if history.block_fixed.any() and self._colouring is None else []
        else:
            keys = ["grey: start"] if not self._many and self._has_moved(frame) else []
        keys += self._loads.words() + self._settlement.words() + self._ties.words(frame) + self._reactions.words()
        if marked:
            keys.append("blue: torsion centre")
        if self.arrows is not None:
            keys.append(self.arrows.words())
            if history.in_real_time and not self._meets and history.new_contacts.any():
                keys.append("forces of new contacts were not recorded")
        if self._look.thrust:
            keys.append(f"red: line of thrust, {_count(n_hinges, 'hinge')}")
        return [*keys, f"{_count(n_left_out, 'name')} left out for lack of space"] if n_left_out else keys


def _font_size(width: int) -> int:
    """Font size for a picture ``width`` pixels wide."""
    return max(8, round(width / 120))


def _lines(keys: list[str]) -> list[str]:
    """Legend entries joined into lines that fit the width of the picture."""
    lines: list[str] = []
    for key in keys:
        if lines and len(lines[-1]) + len(key) < _WIDE:
            lines[-1] += f"; {key}"
        else:
            lines.append(key)
    return lines


def _count(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number or 'no'} {what}s"
