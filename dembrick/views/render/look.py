"""How a history is shown: camera, magnification of the motion, colours."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypedDict

import numpy as np

from dembrick.errors import ScenarioError
from dembrick.views.motion.blocks import CarriedPoints, Poses, all_vertices
from dembrick.views.render.colors import COLORS

if TYPE_CHECKING:
    from dembrick.history.reader import History

VIEWS = {  # direction from the focus to the camera, and what is up in the picture
    "iso": ((1.0, 1.5, 1.4), (0.0, 0.0, 1.0)),
    "front": ((0.0, -1.0, 0.0), (0.0, 0.0, 1.0)),
    "side": ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    "top": ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0)),
}
NAMES = ("none", "blocks", "joints", "all")
_SEEN = 0.12  # of the largest block: how far the farthest corner moves in a picture by itself


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
    """How a history is shown: camera ``view``, ``magnification`` of the motion (None: so that it is seen), what the
    blocks are coloured by, and whether the forces of joints and of new contacts are drawn. ``names``: of blocks,
    joints, all or none of them. ``thrust``: the line of thrust with its hinges. ``reactions``: of the supports."""

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
    """1, 2 or 5 times a power of ten, at least 1, that makes the farthest corner's motion visible; 1 without motion."""
    body, block, starts = all_vertices(history)
    carried, poses = CarriedPoints(history, body, block), Poses.read(history, frame, frame + 1)
    start = carried.magnified(poses, 0.0)[0]
    moved = float(np.linalg.norm(carried.moved(poses)[0], axis=1).max())
    largest = largest_extent(start, starts, range(history.n_block))
    if moved <= 1e-12 * largest:
        return 1.0
    wanted = _SEEN * largest / moved
    if wanted <= 1.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= wanted * (1.0 + 1e-9)))


def largest_extent(points: np.ndarray, starts: list[int], blocks: Iterable[int]) -> float:
    """Greatest extent along an axis of any of the blocks (m); the points of block i: ``starts[i]:starts[i + 1]``."""
    return max(float(np.ptp(points[starts[i] : starts[i + 1]], axis=0).max()) for i in blocks)
