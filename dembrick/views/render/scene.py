"""The picture of a history in one of its frames: built once, moved from frame to frame.

Nothing is rebuilt for a frame: points and colours are written into the meshes that VTK draws already.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from dembrick.errors import HistoryError
from dembrick.geometry.rotations import rotation_matrix
from dembrick.views.motion.blocks import CarriedPoints, Poses, all_vertices, rotation_times
from dembrick.views.motion.joints import JointMotion
from dembrick.views.plot.subject import JointAlone, chosen_joint, pushes_several
from dembrick.views.render.colors import Colouring
from dembrick.views.render.look import VIEWS, Look, automatic_magnification, largest_extent

if TYPE_CHECKING:
    from dembrick.history.reader import History

# Where the blocks go in a picture, as parts of its width and height: text above them, the colour bar on the right.
_LEFT, _RIGHT, _BOTTOM, _TOP = 0.03, 0.81, 0.04, 0.87
_GREY, _ORANGE, _BLUE, _GREEN, _PURPLE = "#CFCFCF", "#D55E00", "#0072B2", "#009E73", "#CC79A7"
_ARROW = {"tip_length": 0.22, "tip_radius": 0.035, "shaft_radius": 0.012}
# blocks: more are drawn with thin lines, and without where they started; less where arrows stand between them
MECHANISM = "limit"  # status of a history that shows the mechanism of limit analysis
_FEW, _FEW_WITH_FORCES = 50, 12
_FORCE, _FORCE_OF_MANY = 0.6, 1.2  # of the largest block that is free to move: the longest arrow of a joint force
IMPACT = 3.0  # of the greatest force in the usual frame: where there are greater ones, arrows end at that of the usual


class Scene:
    """Blocks, actuators, torsion centre and joint forces of ``history`` in a pyvista ``plotter``.

    ``frames``: those that will be shown; the colours and the camera suit all of them. ``below``: the part of the
    picture's height that is left free at its foot.
    """

    def __init__(self, plotter, history: History, look: Look, frames: Iterable[int], below: float = _BOTTOM):
        frames = list(frames)
        self._below = below
        self._plotter, self._history, self._look = plotter, history, look
        body, self._block, self._starts = all_vertices(history)
        self._carried = CarriedPoints(history, body, self._block)
        needed = look.forces or look.color in ("utilisation", "slip")
        self._joints = JointMotion(history) if needed and history.n_joint else None
        self._colouring = None if look.color == "none" else Colouring(history, look.color, self._carried, self._joints)
        if look.forces and not (self._joints and history.has_joints and history.n_row):
            raise HistoryError(
                f'{history.path}: the forces of joints were not recorded; run it again with "joints" in output.channels'
            )
        first = Poses.read(history, 0, 1)
        self._start = self._carried.magnified(first, 0.0)[0]
        moving = [i for i in range(history.n_block) if not history.block_fixed[i]]
        self._length = largest_extent(self._start, self._starts, moving or range(history.n_block))
        self._factor = look.magnification
        if self._factor is None:
            self._factor = min(
                automatic_magnification(history, frame) for frame in {frames[0], frames[-1]} - {0} or {0}
            )
        direction, up = (np.array(v) for v in VIEWS[look.view])
        right = np.cross(up, direction)
        # rows: to the right and up in the picture, and towards the camera
        self._screen = np.array([right, np.cross(direction, right), direction])
        self._screen /= np.linalg.norm(self._screen, axis=1)[:, None]
        self._many = history.n_block > (_FEW_WITH_FORCES if look.forces else _FEW)
        self._meets = look.forces and history.has_new_contacts
        self._marked = self._marked_joint()
        self._survey(frames)
        self._build()
        self.show(frames[-1])
        self._place_camera()

    @property
    def frame(self) -> int:
        """The frame shown now."""
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
        self._show_actuators(poses)
        marked = self._show_centre(frame)
        if self._look.forces:
            self._show_forces(frame, poses)
        self._text.input = self._words(marked)

    def shades(self, width: int) -> np.ndarray:
        """Pixels (h, width, 3) of all shades of the arrows, thin as they are, for who chooses few colours."""
        import pyvista

        rows = [np.zeros((0, 3))]
        for colour in (_GREEN, _PURPLE) if self._look.forces else ():
            rows.append(np.outer(np.linspace(0.25, 1.0, 8), pyvista.Color(colour).int_rgb))
        return np.repeat(np.repeat(np.concatenate(rows)[:, None], 8, axis=0), width, axis=1).astype(np.uint8)

    # --- once ---

    def _poses(self, frame: int) -> Poses:
        return Poses.read(self._history, frame, frame + 1)

    def _marked_joint(self) -> tuple[dict, JointMotion] | None:
        """The joint whose torsion centre is marked: the one that gave way under an actuator."""
        history = self._history
        if not (history.n_joint and history.actuators):
            return None
        number = chosen_joint(history)
        return history.joints[number], JointMotion(JointAlone(history, number))

    def _survey(self, frames: list[int]) -> None:
        """The room that the motion needs, seen from the camera, and the largest values, over all frames to be shown."""
        self._seen = np.array([np.full(3, np.inf), np.full(3, -np.inf)])
        largest, pressed = 0.0, []
        self._make_room(self._start)
        for frame in frames:
            poses = self._poses(frame)
            self._make_room(self._carried.magnified(poses, self._factor)[0])
            self._make_room(self._rod_at(frame))
            self._make_room(
                np.concatenate(
                    [[tip, tip + length * way] for tip, way, length in self._arrows_of(poses)] or [np.zeros((0, 3))]
                )
            )
            if self._colouring is not None:
                values = self._colouring.values(frame, poses)
                largest = max(largest, float(values.max(initial=0.0, where=np.isfinite(values))))
            if self._look.forces:
                forces = np.concatenate([force for _, force in self._forces(frame, poses)])
                pressed.append(float(np.linalg.norm(forces, axis=1).max(initial=0.0)))
        # an impact in one of the frames would leave nothing to be seen of the forces in all others
        self._most_force = max(pressed, default=0.0)
        usual = float(np.median(pressed or [0.0]))
        self._largest_force = usual if 0.0 < IMPACT * usual < self._most_force else self._most_force
        self._most_met = 0
        if self._look.forces:
            for frame in frames:
                found = self._forces(frame, self._poses(frame))
                self._most_met = max(self._most_met, len(found[1][0]))
                for place, force in found:
                    size = np.linalg.norm(force, axis=1, keepdims=True)
                    way = np.divide(force, size, out=np.zeros_like(force), where=size > 0.0)
                    half = 0.5 * self._arrow_length(size) * way
                    self._make_room(np.concatenate([place - half, place + half]))
        if self._colouring is not None:
            self._scale = self._colouring.scale(largest)

    def _make_room(self, points: np.ndarray) -> None:
        """Points (n, 3) that must be in the picture."""
        if len(points):
            seen = points @ self._screen.T
            self._seen[0] = np.minimum(self._seen[0], seen.min(axis=0))
            self._seen[1] = np.maximum(self._seen[1], seen.max(axis=0))

    def _build(self) -> None:
        import pyvista

        plotter, history, fixed = self._plotter, self._history, self._history.block_fixed
        plotter.set_background("white")
        many, forces = self._many, self._look.forces
        # arrows stand between the blocks: the more blocks, the clearer these must be
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
            plotter.add_mesh(self._free, color=_GREY, ambient=0.35, diffuse=0.65, opacity=opacity)
        elif self._free.n_cells:
            data = self._free.point_data if self._colouring.at_vertices else self._free.cell_data
            data["shown"] = np.zeros(self._free.n_points if self._colouring.at_vertices else self._free.n_cells)
            plotter.add_mesh(
                self._free,
                scalars="shown",
                cmap="cividis",
                clim=(0.0, self._scale.top),
                ambient=0.35,  # with the diffuse part to one: what faces the light has the colour of the bar
                diffuse=0.65,
                opacity=opacity,
                scalar_bar_args=self._bar(),
            )
            if forces:
                self._fade_bar(1.0 - (1.0 - opacity) ** (4 if many else 2))  # two faces of a block or two
        thin = {"color": "#999999", "opacity": 0.5} if forces and many else {"color": "black"}
        plotter.add_mesh(edges, line_width=1.5 if many else 3, **thin)
        if not many:
            rest = self._edges(free)
            rest.points[:] = self._start
            plotter.add_mesh(rest, color="#777777", line_width=2, opacity=0.8)
        self._actuators = []
        for _ in history.actuators:
            arrow = plotter.add_mesh(pyvista.Arrow(start=(0, 0, 0), direction=(1, 0, 0), **_ARROW), color=_ORANGE)
            point = plotter.add_mesh(pyvista.Sphere(radius=0.015 * self._length), color=_ORANGE)
            self._actuators.append((arrow, point))
        if self._marked:
            rod = pyvista.Cylinder(direction=(1, 0, 0), radius=0.006 * self._length, height=self._length)
            self._rod = plotter.add_mesh(rod, color=_BLUE)
        if self._look.forces:
            self._build_forces()
        size = max(8, round(plotter.window_size[0] / 120))
        self._text = plotter.add_text(" ", position=(0.012, 0.985), viewport=True, color="black", font_size=size)
        axes = {"x_color": "#D55E00", "y_color": "#009E73", "z_color": "#0072B2", "color": "black"}
        plotter.add_axes(interactive=False, viewport=(0.0, 0.0, 0.14, 0.14), line_width=3, **axes)
        self._text.prop.justification_vertical = "top"

    def _surface(self, blocks: list[int]):
        """The faces of some blocks on the vertices of all."""
        import pyvista

        faces = [
            (len(face), *(self._starts[i] + number for number in face))
            for i in blocks
            for face in self._history.block_faces(i)
        ]
        return pyvista.PolyData(self._start.copy(), faces=np.concatenate([*faces, ()]).astype(np.int64))

    def _edges(self, blocks: Iterable[int]):
        """The edges of some blocks on the vertices of all."""
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
        bar |= {"position_x": 0.875, "position_y": 0.14, "height": 0.6, "width": 0.05}
        return bar | {"title_font_size": size, "label_font_size": size}

    def _fade_bar(self, opacity: float) -> None:
        """Give the colour bar the colours of blocks that shine through, on white."""
        from vtkmodules.vtkCommonCore import vtkLookupTable

        (bar,) = self._plotter.scalar_bars.values()
        table = vtkLookupTable()
        table.DeepCopy(bar.GetLookupTable())
        for i in range(table.GetNumberOfTableValues()):
            colour = np.array(table.GetTableValue(i))
            table.SetTableValue(i, *(1.0 - opacity * (1.0 - colour[:3])), 1.0)
        bar.SetLookupTable(table)

    def _place_camera(self) -> None:
        """Parallel projection: what must be seen fills the part of the picture that is left for it."""
        plotter = self._plotter
        low, high = self._seen
        width, height = plotter.window_size
        extent = (high - low)[:2]
        # height of the whole picture in the scene, and its middle against that of the part used
        whole = max(extent[1] / (_TOP - self._below), extent[0] / (_RIGHT - _LEFT) * height / width)
        aside = np.array([(1.0 - _LEFT - _RIGHT) * width / height, 1.0 - self._below - _TOP, 0.0])
        focus = (0.5 * (low + high) + 0.5 * whole * aside) @ self._screen
        distance = (high - low)[2] + self._length
        plotter.enable_parallel_projection()
        plotter.camera_position = [tuple(focus + distance * self._screen[2]), tuple(focus), tuple(self._screen[1])]
        plotter.camera.parallel_scale = 0.5 * whole
        plotter.renderer.reset_camera_clipping_range()

    # --- frame by frame ---

    def _arrows_of(self, poses: Poses) -> list[tuple[np.ndarray, np.ndarray, float]]:
        """Loaded point on the drawn block, direction and length of the arrow of each actuator."""
        history, arrows = self._history, []
        for actuator in history.actuators:
            i = actuator["block"]
            first = rotation_matrix(history.orientation0[i])
            turn = rotation_times(poses.rotation[0, i] @ first.T, self._factor)
            tip = history.position0[i] + self._factor * poses.displacement[0, i]
            tip = tip + turn @ (actuator["point"] - history.position0[i])
            way = actuator["direction"] * np.sign(actuator["weight"])
            # the head of the arrow lies outside the block, so that an actuator inside it is seen in every view
            corners = history.block_vertices(i) @ first.T @ way
            reach = float(corners.max() - (actuator["point"] - history.position0[i]) @ way)
            arrows.append((tip, way, reach + 0.35 * self._length))
        return arrows

    def _show_actuators(self, poses: Poses) -> None:
        """An arrow of one length an actuator, pushing at its point."""
        for (arrow, point), (tip, way, length) in zip(self._actuators, self._arrows_of(poses), strict=True):
            arrow.user_matrix = _placed(tip, way, length)
            point.user_matrix = _placed(tip, way, 1.0)

    def _rod_at(self, frame: int) -> np.ndarray:
        """Ends (2, 3) of a thin axis through the torsion centre of the marked joint; (0, 3) where none is in sight."""
        if self._marked:
            joint, motion = self._marked
            centre = motion.torsion_centre(frame)[0]
            # nearly pure shear: a mark far away would shrink the blocks
            if np.isfinite(centre).all() and np.linalg.norm(centre) <= 2.0 * self._length:
                middle = joint["origin"] + centre @ joint["axes"][:2]
                return middle + 0.5 * self._length * np.outer([-1.0, 1.0], joint["axes"][2])
        return np.zeros((0, 3))

    def _show_centre(self, frame: int) -> bool:
        """The axis of the torsion centre; whether it is in sight."""
        ends = self._rod_at(frame)
        if len(ends):
            self._rod.user_matrix = _placed(0.5 * (ends[0] + ends[1]), ends[1] - ends[0], 1.0)
        if self._marked:
            self._rod.visibility = bool(len(ends))
        return bool(len(ends))

    def _joint_forces(self, frame: int, poses: Poses) -> tuple[np.ndarray, np.ndarray]:
        """Where the resultant of every joint passes, on the drawn blocks, and its force on b: (j, 3) m, (j, 3) N."""
        joints, now = self._joints, self._joints.at(range(frame, frame + 1))
        N, V_1, V_2, _, M_1, M_2 = now.resultants[0, :, :6].T
        at = np.stack([M_2, -M_1], axis=1)
        at = np.divide(at, N[:, None], out=np.zeros_like(at), where=N[:, None] > 0.0)
        # the centre of pressure cannot be outside the joint but by rounding of a small N
        far = np.linalg.norm(at, axis=1)
        at *= np.minimum(1.0, np.divide(joints.size, far, out=np.ones_like(far), where=far > 0.0))[:, None]
        first, host = rotation_matrix(self._history.orientation0), joints.host
        turned = rotation_times(poses.rotation[0] @ first.swapaxes(1, 2), self._factor)[host]
        arm = joints.arm_host + np.einsum("ji,jik->jk", now.shift[0] + at, joints.axes[:, :2])
        place = joints.origin - joints.arm_host + self._factor * poses.displacement[0, host]
        place = place + np.einsum("jik,jk->ji", turned, arm)
        force = np.einsum("ji,jik->jk", np.stack([-V_1, -V_2, N], axis=1), now.acting_axes[0])
        return place, force

    def _met_forces(self, frame: int, poses: Poses) -> tuple[np.ndarray, np.ndarray]:
        """Where the new contacts press, on the drawn second blocks, and their forces on these: (c, 3) m, (c, 3) N."""
        if not self._meets:
            return np.zeros((0, 3)), np.zeros((0, 3))
        _, met = self._history.frame_new_contacts(frame, frame + 1)
        block, turn = met["blocks"][:, 1], poses.rotation[0]
        start = rotation_matrix(self._history.orientation0).swapaxes(1, 2)
        drawn = rotation_times(turn @ start, self._factor) @ start.swapaxes(1, 2) @ turn.swapaxes(1, 2)
        arm = np.einsum("cik,ck->ci", drawn[block], met["point"] - poses.position[0, block])
        return self._history.position0[block] + self._factor * poses.displacement[0, block] + arm, met["force"]

    def _forces(self, frame: int, poses: Poses) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
        """Places and forces of the joints, and of the new contacts."""
        return self._joint_forces(frame, poses), self._met_forces(frame, poses)

    def _build_forces(self) -> None:
        self._arrows = self._add_arrows(self._history.n_joint, _GREEN)
        self._met_arrows = self._add_arrows(self._most_met, _PURPLE)

    def _add_arrows(self, n: int, colour: str):
        """Up to ``n`` arrows, whose points, directions and lengths are written into what is returned."""
        import pyvista
        from vtkmodules.vtkRenderingCore import vtkActor, vtkGlyph3DMapper

        arrows = pyvista.PolyData(np.zeros((n, 3)))
        if not n:
            return arrows
        arrows.point_data["force"], arrows.point_data["length"] = np.zeros((n, 3)), np.zeros(n)
        mapper = vtkGlyph3DMapper()
        mapper.SetInputData(arrows)
        mapper.SetSourceData(
            pyvista.Arrow(start=(-0.5, 0, 0), **(_ARROW | {"tip_radius": 0.07, "shaft_radius": 0.025}))
        )
        mapper.SetOrientationArray("force")
        mapper.SetScaleArray("length")
        mapper.SetScaleModeToScaleByMagnitude()
        mapper.ScalarVisibilityOff()
        actor = vtkActor()
        actor.SetMapper(mapper)
        actor.GetProperty().SetColor(pyvista.Color(colour).float_rgb)
        actor.GetProperty().SetAmbient(0.4)
        actor.GetProperty().SetDiffuse(0.6)
        self._plotter.add_actor(actor)
        return arrows

    def _arrow_length(self, force):
        """Length (m) of the arrow of a force (N); no arrow is longer than that of the largest one to be told apart."""
        longest = (_FORCE_OF_MANY if self._many else _FORCE) * self._length
        return longest / (self._largest_force or 1.0) * np.minimum(force, self._largest_force)

    def _show_forces(self, frame: int, poses: Poses) -> None:
        """Arrows of the forces of joints and new contacts on their second blocks, as long as the force is large."""
        both = zip((self._arrows, self._met_arrows), self._forces(frame, poses), strict=True)
        for arrows, (place, force) in both:
            if not arrows.n_points:
                continue
            n = len(place)
            arrows.points[:n], arrows.point_data["force"][:n] = place, force
            arrows.point_data["length"][:n] = self._arrow_length(np.linalg.norm(force, axis=1))
            arrows.point_data["length"][n:] = 0.0  # contacts that there are in other frames
            arrows.points[n:] = self._start[0]
            arrows.Modified()

    def _words(self, marked: bool) -> str:
        history = self._history
        shown = f"motion x {self._factor:g}" if self._factor != 1.0 else "true scale"
        keys = ["grey: start"] if not self._many else []
        if self._actuators:
            keys.append("orange: body forces" if pushes_several(history) else "orange: actuators")
        if marked:
            keys.append("blue: torsion centre")
        if self._look.forces:
            more = " or more" if self._most_force > self._largest_force else ""
            met = " purple: those of new contacts," if self._most_met else ""
            keys.append(f"green: joint forces,{met} the longest {self._largest_force:.4g} N{more}")
            if history.in_real_time and not self._meets and history.new_contacts.any():
                keys.append("forces of new contacts were not recorded")
        now = float(history.frame_time[self._frame])
        if history.status == MECHANISM:
            told = "mechanism of limit analysis: velocities, to no scale"
        else:
            told = f"equilibrium {now:g}, {shown}" if history.counts_equilibria else f"time {now:.4g} s, {shown}"
        return "\n".join([*textwrap.wrap(history.title, 84)[:2], told, "; ".join(keys)]).rstrip()


def _placed(origin, direction, length: float) -> np.ndarray:
    """Matrix (4, 4) that takes the unit vector along x to ``length`` times ``direction`` from ``origin``."""
    x = np.asarray(direction, float) / np.linalg.norm(direction)
    helper = np.eye(3)[int(np.argmin(np.abs(x)))]
    y = np.cross(helper, x)
    y /= np.linalg.norm(y)
    matrix = np.eye(4)
    matrix[:3, :3] = length * np.column_stack([x, y, np.cross(x, y)])
    matrix[:3, 3] = origin
    return matrix
