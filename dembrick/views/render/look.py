"""How a history is shown: camera, magnification of the motion, colours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypedDict

import numpy as np

from dembrick.errors import ScenarioError
from dembrick.views.motion import blocks
from dembrick.views.motion.blocks import CarriedPoints, Poses, all_vertices
from dembrick.views.render.colors import COLORS

if TYPE_CHECKING:
    from dembrick.history.reader import History

VIEWS = {  # direction from the focus to the camera, and what is up in the picture
    "iso": ((1.0, 1.5, 1.4), (0.0, 0.0, 1.0)),
    "front": ((0.0, -1.0, 0.0), (0.0, 0.0, 1.0)),
    "back": ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    "iso-front": ((1.0, -1.5, 1.4), (0.0, 0.0, 1.0)),
    "side": ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    "top": ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0)),
}
NAMES = ("none", "blocks", "joints", "all")


class LookOptions(TypedDict, total=False):
    """The fields of `Look` as keywords, each of which may be left out."""

    view: str
    magnification: float | None
    color: str
    forces: bool
    names: str
    thrust: bool
    reactions: bool


@dataclass(frozen=True, slots=True)
class Look:
    """How a history is shown: camera ``view`` (iso, iso-front, front, back, side, top), ``magnification`` of the motion
    (None: so that it is seen; the picture says how much), the ``color`` of blocks (displacement, utilisation, slip, the
    greatest of their joints, energy, kinetic, or none), whether the ``forces`` of joints and of new contacts are drawn.
    ``names``: of blocks, joints, all or none of them, and only of those that move, where any does. ``thrust``: the line
    of thrust with its hinges. ``reactions``: of the supports."""

    view: str = "iso"
    magnification: float | None = None
    color: str = "displacement"
    forces: bool = False
    names: str = "none"
    thrust: bool = False
    reactions: bool = False

    @property
    def needs_forces(self) -> bool:
        """Whether it shows anything of what joints and supports carry."""
        return self.forces or self.thrust or self.reactions or self.color in ("utilisation", "slip")

    def __post_init__(self):
        told = (("view", self.view, VIEWS), ("color", self.color, COLORS), ("names", self.names, NAMES))
        for name, value, known in told:
            if value not in known:
                raise ScenarioError(f"{name} = {value!r} is unknown; use one of {', '.join(known)}")
        factor = self.magnification
        if factor is not None and not (np.isfinite(factor) and factor >= 0.0):
            raise ScenarioError(f"magnification = {factor!r} is out of range: it must be finite and at least 0")


def automatic_magnification(history: History, frame: int) -> float:
    """The magnification by which the motion of the farthest corner in a frame is seen; 1 without motion."""
    body, block, starts = all_vertices(history)
    carried, poses = CarriedPoints(history, body, block), Poses.read(history, frame, frame + 1)
    start = carried.magnified(poses, 0.0)[0]
    moved = float(np.linalg.norm(carried.moved(poses)[0], axis=1).max())
    return blocks.automatic_magnification(moved, blocks.largest_extent(start, starts, range(history.n_block)))
