"""Annotations over the blocks: a scale bar, the line of thrust with its hinges."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from dembrick.errors import HistoryError
from dembrick.views.motion.blocks import Poses
from dembrick.views.motion.hinges import CARRIES, closed_edges, hinges
from dembrick.views.motion.joints import JointMotion
from dembrick.views.motion.magnification import round_down
from dembrick.views.render.force_arrows import DrawnForces

if TYPE_CHECKING:
    from dembrick.history.reader import History

CRIMSON = "#B3003C"
_WIDEST = 0.13  # of the picture's width: greatest length of the scale bar
_BAR = (0.9, 0.055)  # middle of the scale bar, in shares of width and height
_IN_FRONT = -1e6  # depth offset that puts lines and points in front of everything else


def length_text(length: float) -> str:
    """A round length with a unit that leaves few zeros."""
    for unit, factor in (("m", 1.0), ("cm", 1e2), ("mm", 1e3)):
        if length * factor >= 0.999:
            return f"{length * factor:g} {unit}"
    return f"{length * 1e6:g} µm"


class ScaleBar:
    """A scale bar of round length at the lower right; it follows the camera, whose projection is parallel."""

    def __init__(self, plotter):
        import pyvista
        from vtkmodules.vtkRenderingCore import vtkActor2D, vtkCoordinate, vtkPolyDataMapper2D

        self._plotter = plotter
        self._bar = pyvista.PolyData(np.zeros((6, 3)), lines=np.array([[2, 0, 1], [2, 2, 3], [2, 4, 5]]).ravel())
        place, mapper, actor = vtkCoordinate(), vtkPolyDataMapper2D(), vtkActor2D()
        place.SetCoordinateSystemToNormalizedViewport()
        mapper.SetInputData(self._bar)
        mapper.SetTransformCoordinate(place)
        actor.SetMapper(mapper)
        actor.GetProperty().SetColor(0.0, 0.0, 0.0)
        actor.GetProperty().SetLineWidth(max(1.5, plotter.window_size[0] / 600))
        plotter.add_actor(actor, reset_camera=False)
        size = max(8, round(plotter.window_size[0] / 120))
        self._text = plotter.add_text(
            " ", position=(_BAR[0], _BAR[1] - 0.012), viewport=True, color="black", font_size=size
        )
        self._text.prop.justification_horizontal = "center"
        self._text.prop.justification_vertical = "top"
        self.length = self._whole = 0.0
        plotter.renderer.AddObserver("StartEvent", lambda *_: self.fit())

    def fit(self) -> None:
        """Set the length of the bar for the current camera."""
        width, height = self._plotter.window_size
        whole = 2.0 * self._plotter.camera.parallel_scale * width / height
        if not (np.isfinite(whole) and whole > 0.0):
            return
        length = round_down(_WIDEST * whole)
        if length == self.length and whole == self._whole:
            return
        self.length, self._whole = length, whole
        half, (x, y), tick = 0.5 * length / whole, _BAR, 0.008
        left, right = x - half, x + half
        self._bar.points[:] = [
            (left, y, 0.0), (right, y, 0.0), (left, y - tick, 0.0), (left, y + tick, 0.0), (right, y - tick, 0.0),
            (right, y + tick, 0.0),
        ]  # fmt: skip
        self._bar.Modified()
        self._text.input = length_text(length)


class ThrustLine:
    """The line of thrust: centres of pressure of the joints, connected through each block between two loaded joints.

    Dots are hinges, see `hinges`.
    """

    def __init__(self, plotter, history: History, joints: JointMotion, forces: DrawnForces):
        import pyvista

        self._joints, self._forces = joints, forces
        self._free = [i for i in range(history.n_block) if not history.block_fixed[i]]
        self._line = pyvista.PolyData(np.zeros((joints.n_joint, 3)))
        self._dots = pyvista.PolyData(np.zeros((joints.n_joint, 3)))
        width = max(2.0, plotter.window_size[0] / 360)
        how = {"color": CRIMSON, "lighting": False, "reset_camera": False}
        # an empty mesh cannot be added: every joint has a line of zero length until the first frame is shown
        self._line.lines = self._dots.verts = np.column_stack(
            [np.full(joints.n_joint, 2), np.arange(joints.n_joint), np.arange(joints.n_joint)]
        ).ravel()
        drawn = [
            plotter.add_mesh(self._line, line_width=width, **how),
            plotter.add_mesh(self._dots, point_size=3.6 * width, render_points_as_spheres=True, **how),
        ]
        for actor in drawn:
            actor.mapper.SetResolveCoincidentTopologyToPolygonOffset()
            actor.mapper.SetRelativeCoincidentTopologyLineOffsetParameters(0.0, _IN_FRONT)
            actor.mapper.SetRelativeCoincidentTopologyPointOffsetParameter(_IN_FRONT)
        self.hinges: list[int] = []

    def show(self, frame: int, poses: Poses) -> None:
        place, pairs, self.hinges = thrust_line(self._joints, self._forces, self._free, frame, poses)
        self._line.points[:] = self._dots.points[:] = place
        self._line.lines = np.column_stack([np.full(len(pairs), 2), pairs]).ravel().astype(np.int64)
        dots = np.array(self.hinges, np.int64)
        self._dots.verts = np.column_stack([np.ones(len(dots), np.int64), dots]).ravel()


def thrust_line(
    joints: JointMotion, forces: DrawnForces, free: Sequence[int], frame: int, poses: Poses
) -> tuple[np.ndarray, np.ndarray, list[int]]:
    """Centres of pressure (j, 3) m on the drawn blocks, pairs of joints (k, 2) connected by a block, and hinges."""
    place, _ = forces.of_joints(frame, poses)
    now = joints.at([frame])
    N = now.resultants[0, :, 0]
    carries, bent = N > CARRIES * N.max(initial=0.0), hinges(joints.history, joints, frame)
    if not carries[bent].all():  # a hinge opened so far that a new contact along the remaining edge carries its force
        meet = forces.on_joints(poses, closed_edges(joints, frame))
        place = np.where(carries[:, None], place, meet)
        carries[bent] = True
    own: dict[int, list[int]] = {i: [] for i in free}
    for j in np.flatnonzero(carries).tolist():
        for block in (int(joints.block_a[j]), int(joints.block_b[j])):
            if block in own:
                own[block].append(j)
    pairs = [pair for pair in own.values() if len(pair) == 2]
    return place, np.array(pairs, np.int64).reshape(-1, 2), bent


def require_thrust(history: History, joints: JointMotion | None) -> JointMotion:
    """The joints of the line of thrust; HistoryError if there is no such line."""
    if not (joints and history.has_joints and history.n_row):
        raise HistoryError(
            f"{history.path}: the line of thrust cannot be drawn because the forces of joints were not recorded; run "
            'it again with "joints" in output.channels'
        )
    touching = np.bincount(np.concatenate([joints.block_a, joints.block_b]), minlength=history.n_block)
    if not any(touching[i] == 2 and not history.block_fixed[i] for i in range(history.n_block)):
        raise HistoryError(
            f"{history.path}: there is no line of thrust, because no block has exactly two joints as in an arch or a "
            "column; use forces = true (--forces) to draw the force of every joint"
        )
    return joints
