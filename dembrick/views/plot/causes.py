"""Figure of causes of cracks: the observed openings, and beside them the motion of the blocks for likely causes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dembrick.geometry.rotations import rotation_matrix, turned_by
from dembrick.geometry.shapes import parts_of
from dembrick.views.plot import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from dembrick.assembly.build import Assembly

MOST = 3  # greatest number of causes shown beside the observation
SEEN = 0.08  # of the structure's size: drawn displacement of the block that moves farthest
_STONE, _SUPPORT, _EDGE = "#e8e4da", "#b8b4aa", "#6b675e"
_OPEN = "#c1272d"


class Motion(NamedTuple):
    """A panel: its ``title``, the ``velocity`` (n, 6) of the blocks, and the ``opening`` (j,) of the joints relative to
    the greatest."""

    title: str
    velocity: np.ndarray
    opening: np.ndarray


def causes(assembly: Assembly, seen: np.ndarray, likely: Sequence[Motion]) -> Figure:
    """Draw the joints that were ``seen`` (j,) to be open, in red, and beside them the likeliest causes, with enlarged
    motions; the view is along the structure's smallest dimension."""
    likely, still = likely[:MOST], np.zeros((len(assembly.names), 6))
    with style.settings():
        figure = style.new_figure((3.4 * (1 + len(likely)), 3.0))
        axes = list(figure.subplots(1, 1 + len(likely), squeeze=False)[0])
        _structure(axes[0], assembly, still, seen)
        axes[0].set_title("seen", fontsize=8)
        for own, motion in zip(axes[1:], likely, strict=True):
            _structure(own, assembly, motion.velocity, motion.opening > 0.0, motion.opening)
            own.set_title(motion.title.replace(" and ", "\nand "), fontsize=8)
    return figure


def _structure(axes: Axes, assembly: Assembly, velocity: np.ndarray, opens: np.ndarray, width=None) -> None:
    """Draw blocks moved by the enlarged ``velocity`` (n, 6), and the joints that open, with thicker lines for wider
    openings."""
    from matplotlib.collections import LineCollection, PolyCollection

    across = int(np.argmin(np.ptp(assembly.position, axis=0)))
    shown = [axis for axis in range(3) if axis != across]
    size = float(np.ptp(assembly.position, axis=0).max())
    most = float(np.linalg.norm(velocity[:, :3], axis=1).max(initial=0.0))
    moved = velocity * (SEEN * size / most) if most > 0.0 else velocity
    turn = rotation_matrix(turned_by(moved[:, 3:], assembly.orientation))
    view = np.zeros(3)
    view[across] = -1.0 if across == 1 else 1.0
    outlines, colours = [], []
    for i, shape in enumerate(assembly.shapes):
        for place, part in parts_of(shape):
            for normal, face in zip(part.face_normals, part.faces, strict=True):
                if turn[i] @ normal @ view > 1e-6:
                    corners = (place + part.vertices[list(face)]) @ turn[i].T + assembly.position[i] + moved[i, :3]
                    outlines.append(corners[:, shown])
                    colours.append(_SUPPORT if assembly.fixed[i] else _STONE)
    axes.add_collection(PolyCollection(outlines, facecolors=colours, edgecolors=_EDGE, linewidths=0.4))
    lines, widths, joints = [], [], assembly.joints
    for j in np.flatnonzero(opens):
        a = int(joints.block_a[j])
        corners = joints.origin[j] + joints[j].polygon @ joints.axes[j, :2] - assembly.position[a]
        corners = (corners @ (turn[a] @ assembly.rotation[a].T).T + assembly.position[a] + moved[a, :3])[:, shown]
        ends = corners[[int(np.argmin(corners @ way)) for way in _ways(corners)]]
        lines.append(ends)
        widths.append(2.0 if width is None else 2.5 * float(np.sqrt(max(width[j], 0.0))))
    axes.add_collection(LineCollection(lines, colors=_OPEN, linewidths=widths, capstyle="round"))
    axes.autoscale_view()
    axes.set_aspect("equal")
    axes.axis("off")


def _ways(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The direction in which a projected polygon (k, 2) is longest, and its opposite."""
    away = corners - corners.mean(axis=0)
    way = np.linalg.svd(away, full_matrices=False)[2][0]
    return way, -way
