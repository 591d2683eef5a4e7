"""Arrows for the forces of joints and of new contacts, where they act on the drawn blocks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dembrick.geometry.rotations import rotation_matrix
from dembrick.views import summary
from dembrick.views.motion.blocks import CarriedPoints, Poses
from dembrick.views.motion.joints import JointMotion

if TYPE_CHECKING:
    from dembrick.history.reader import History

GREEN, PURPLE = "#009E73", "#CC79A7"
ARROW = {"tip_length": 0.22, "tip_radius": 0.035, "shaft_radius": 0.012}
IMPACT = 3.0  # times the median over frames of the greatest force: if exceeded, the median sets the longest arrow


def glyphs(plotter, source, start: np.ndarray, colour: str, ambient: float = 0.0):
    """Add a copy of the mesh ``source``, which points along x, to a plotter at each point of ``start`` (n, 3); its
    length is zero until :func:`put_glyphs` moves it."""
    import pyvista
    from vtkmodules.vtkRenderingCore import vtkActor, vtkGlyph3DMapper

    found = pyvista.PolyData(start.copy())
    if not len(start):
        return found
    found["vector"], found["length"] = np.zeros((len(start), 3)), np.zeros(len(start))
    mapper = vtkGlyph3DMapper()
    mapper.SetInputData(found)
    mapper.SetSourceData(source)
    mapper.SetOrientationArray("vector")
    mapper.SetScaleArray("length")
    mapper.SetScaleModeToScaleByMagnitude()
    mapper.ScalarVisibilityOff()
    actor = vtkActor()
    actor.SetMapper(mapper)
    actor.GetProperty().SetColor(*pyvista.Color(colour).float_rgb)
    actor.GetProperty().SetAmbient(ambient)
    actor.GetProperty().SetDiffuse(1.0 - ambient)
    plotter.add_actor(actor)
    return found


def put_glyphs(found, points: np.ndarray, vectors: np.ndarray, length) -> None:
    """Move the first k :func:`glyphs` to ``points`` (k, 3), along ``vectors`` (k, 3), scaled by ``length``; hide the
    others."""
    n = len(points)
    if found.n_points:
        found.points[:n], found["vector"][:n] = points, vectors
        found["length"][:n], found["length"][n:] = length, 0.0
        found.Modified()


class DrawnForces:
    """Forces of the joints and new contacts of a history, at their points on the drawn blocks, whose motion is
    magnified by ``factor``; ``meets``: whether there are recorded new contacts."""

    def __init__(self, history: History, joints: JointMotion, factor: float, meets: bool):
        self._history, self._joints, self._factor, self._meets = history, joints, factor, meets

    def of_joints(self, frame: int, poses: Poses) -> tuple[np.ndarray, np.ndarray]:
        """Point of the resultant of every joint on the drawn blocks, and its force on b: (j, 3) m, (j, 3) N."""
        joints, now = self._joints, self._joints.at(range(frame, frame + 1))
        N, V_1, V_2 = now.resultants[0, :, :3].T
        at = now.pressed_arm[0].copy()
        # the centre of pressure is outside the joint only by rounding of a small N
        far = np.linalg.norm(at, axis=1)
        at *= np.minimum(1.0, np.divide(joints.size, far, out=np.ones_like(far), where=far > 0.0))[:, None]
        place = self.on_joints(poses, now.shift[0] + at)
        force = np.einsum("ji,jik->jk", np.stack([-V_1, -V_2, N], axis=1), now.acting_axes[0])
        return place, force

    def on_joints(self, poses: Poses, at: np.ndarray) -> np.ndarray:
        """Points ``at`` (j, 2) m in the joints' planes from the initial O, on the drawn blocks (j, 3) m."""
        joints, host = self._joints, self._joints.host
        arm = joints.arm_host + np.einsum("ji,jik->jk", at, joints.axes[:, :2])
        body = np.einsum("jki,jk->ji", rotation_matrix(self._history.orientation0)[host], arm)
        return CarriedPoints(self._history, body, host).magnified(poses, self._factor)[0]

    def of_new_contacts(self, frame: int, poses: Poses) -> tuple[np.ndarray, np.ndarray]:
        """Points of the new contacts on the drawn second blocks, and the forces on these: (c, 3) m, (c, 3) N."""
        if not self._meets:
            return np.zeros((0, 3)), np.zeros((0, 3))
        _, met = self._history.frame_new_contacts(frame, frame + 1)
        block = met["blocks"][:, 1]
        body = np.einsum("cki,ck->ci", poses.rotation[0, block], met["point"] - poses.position[0, block])
        return CarriedPoints(self._history, body, block).magnified(poses, self._factor)[0], met["force"]

    def both(self, frame: int, poses: Poses) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
        return self.of_joints(frame, poses), self.of_new_contacts(frame, poses)


class ForceArrows:
    """The force arrows in a plotter; the longest is ``longest`` (m) long.

    ``most_force``: the greatest force of all frames; ``largest_force``: the force shown by the longest arrow.
    """

    def __init__(self, forces: DrawnForces, longest: float):
        self._forces, self._longest = forces, longest
        self.most_force = self.largest_force = 0.0
        self.most_met = 0

    def survey(self, frames: list[int], poses_of, make_room) -> None:
        """Scale the arrows for all ``frames``, and make room for them in the picture."""
        found = [self._forces.both(frame, poses_of(frame)) for frame in frames]
        pressed = [max(float(np.linalg.norm(force, axis=1).max(initial=0.0)) for _, force in both) for both in found]
        # an impact in one frame would make the forces in all others invisible
        self.most_force = max(pressed, default=0.0)
        usual = float(np.median(pressed or [0.0]))
        self.largest_force = usual if 0.0 < IMPACT * usual < self.most_force else self.most_force
        for both in found:
            self.most_met = max(self.most_met, len(both[1][0]))
            for place, force in both:
                size = np.linalg.norm(force, axis=1, keepdims=True)
                way = np.divide(force, size, out=np.zeros_like(force), where=size > 0.0)
                half = 0.5 * self.length(size) * way
                make_room(np.concatenate([place - half, place + half]))

    def build(self, plotter, n_joint: int, somewhere: np.ndarray) -> None:
        """Add the arrows to the plotter; unused ones lie ``somewhere``, with zero length."""
        import pyvista

        arrow = pyvista.Arrow(start=(-0.5, 0, 0), **ARROW | {"tip_radius": 0.07, "shaft_radius": 0.025})
        self.of_joints = glyphs(plotter, arrow, np.tile(somewhere, (n_joint, 1)), GREEN, ambient=0.4)
        self.of_new_contacts = glyphs(plotter, arrow, np.tile(somewhere, (self.most_met, 1)), PURPLE, ambient=0.4)

    def length(self, force):
        """Length (m) of the arrow of a force (N), at most that of ``largest_force``."""
        return self._longest / (self.largest_force or 1.0) * np.minimum(force, self.largest_force)

    def show(self, frame: int, poses: Poses) -> None:
        """Show the forces of joints and new contacts on their second blocks; lengths are proportional to forces."""
        shown = self.of_joints, self.of_new_contacts
        for arrows, (at, force) in zip(shown, self._forces.both(frame, poses), strict=True):
            put_glyphs(arrows, at, force, self.length(np.linalg.norm(force, axis=1)))

    def words(self) -> str:
        more = " or more" if self.most_force > self.largest_force else ""
        met = " purple: those of new contacts," if self.most_met else ""
        return f"green: joint forces,{met} the longest {summary.load_text(self.largest_force)}{more}"
