"""Labels over the blocks, placed so that none covers another."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from dembrick.views.motion.blocks import Poses

_STEPS = (0.0, 1.0, -1.0)  # allowed vertical shifts of a name from its point, in heights of the name
_GAP = 2.0  # pixels between names


class Names:
    """Names at points of the scene, in front of everything; `spread` draws those that have room.

    ``points`` (n, 3) m: their points; ``size`` (n, 2): width and height in pixels; ``drawn`` (k,): indices of those in
    the picture.
    """

    def __init__(self, plotter, names: Sequence[str], colour: str):
        import pyvista
        from vtkmodules.vtkRenderingCore import vtkActor2D
        from vtkmodules.vtkRenderingLabel import vtkLabeledDataMapper

        self._names = list(names)
        self._mapper, actor = vtkLabeledDataMapper(), vtkActor2D()
        self._mapper.SetLabelModeToLabelFieldData()
        self._mapper.SetFieldDataName("name")
        size = max(9, round(plotter.window_size[0] / 95))
        look = pyvista.TextProperty(color=colour, font_family="arial", font_size=size, bold=True)
        look.background_color, look.background_opacity = "white", 0.7
        look.justification_horizontal = look.justification_vertical = "center"
        self._mapper.SetLabelTextProperty(look)
        self.points = np.zeros((len(self._names), 3))
        self.size = np.array([_pixels(plotter, look, name) for name in self._names], float).reshape(-1, 2)
        self.draw(np.zeros(0, np.int64), self.points[:0])
        actor.SetMapper(self._mapper)
        plotter.add_actor(actor, reset_camera=False)

    def show(self, points: np.ndarray) -> None:
        """Set the points of the names (n, 3) m."""
        self.points = np.array(points, float).reshape(-1, 3)

    def draw(self, which: np.ndarray, places: np.ndarray) -> None:
        """Draw the names with the indices ``which`` (k,) at ``places`` (k, 3) m."""
        import pyvista
        from vtkmodules.vtkCommonCore import vtkStringArray

        self.drawn, texts = which, vtkStringArray()
        texts.SetName("name")
        for i in which:
            texts.InsertNextValue(self._names[i])
        cloud = pyvista.PolyData(np.array(places, float)) if len(which) else pyvista.PolyData()
        cloud.GetPointData().AddArray(texts)
        self._mapper.SetInputData(cloud)


class NameBoard:
    """All names of a picture. ``named``: pairs of `Names` and the function ``(poses, vertices) -> points`` that gives
    their points; ``left_out``: the number of names without room."""

    def __init__(self, plotter, named: Sequence[tuple[Names, Callable]]):
        self._plotter, self.named, self.left_out = plotter, list(named), 0
        self._seen: tuple | None = None

    def show(self, poses: Poses, vertices: np.ndarray) -> None:
        """Move the names with the blocks."""
        for names, places in self.named:
            names.show(places(poses, vertices))
        self._seen = None
        self.spread()

    def spread(self) -> bool:
        """Draw the names that have room in the current view; return whether they may have changed."""
        camera = self._plotter.camera
        seen = (*camera.position, *camera.focal_point, *camera.up, camera.parallel_scale, *self._plotter.window_size)
        if not self.named or seen == self._seen:
            return False
        self._seen = seen
        self.left_out = spread(self._plotter, [names for names, _ in self.named])
        return True


def spread(plotter, names: Iterable[Names]) -> int:
    """Draw the ``names`` of the picture in order, each at its point or one line above or below it, and leave out those
    that would cover another one. Returns how many are left out."""
    camera, (_, height) = plotter.camera, plotter.renderer.GetSize()
    up = np.array(camera.up, float)
    right = np.cross(np.array(camera.direction), up)
    pixel = 2.0 * camera.parallel_scale / max(height, 1)  # m; the projection is parallel
    taken, left_out = np.zeros((0, 4)), 0
    for own in names:
        at = own.points - np.array(camera.focal_point)
        at = np.column_stack([at @ right, at @ up]) / pixel
        which, places = [], []
        for i, (middle, size) in enumerate(zip(at, own.size, strict=True)):
            for step in _STEPS:
                shift = step * (size[1] + _GAP)
                box = np.concatenate([middle - 0.5 * size, middle + 0.5 * size]) + [0.0, shift, 0.0, shift]
                apart = (taken[:, :2] >= box[2:] + _GAP).any(axis=1) | (taken[:, 2:] <= box[:2] - _GAP).any(axis=1)
                if apart.all():
                    taken = np.vstack([taken, box])
                    which.append(i)
                    places.append(own.points[i] + shift * pixel * up)
                    break
            else:
                left_out += 1
        own.draw(np.array(which, np.int64), np.array(places).reshape(-1, 3))
    return left_out


def _pixels(plotter, look, text: str) -> tuple[float, float]:
    """Width and height of a text in pixels."""
    from vtkmodules.vtkRenderingCore import vtkTextRenderer

    box = [0, 0, 0, 0]
    vtkTextRenderer.GetInstance().GetBoundingBox(look, text, box, plotter.render_window.GetDPI())
    return box[1] - box[0] + 1.0, box[3] - box[2] + 1.0
