"""Display options of a history: camera, magnification, the quantity that colours the blocks and its unit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypedDict

import numpy as np

from dembrick.errors import HistoryError, ScenarioError
from dembrick.views.motion.blocks import CarriedPoints, Poses, block_quantities
from dembrick.views.motion.frames import MECHANISM
from dembrick.views.motion.joint_frames import CHANNELS
from dembrick.views.motion.joints import JointMotion

if TYPE_CHECKING:
    from dembrick.history.reader import History


VIEWS = {  # direction from the focus to the camera, and the upward direction of the picture
    "iso": ((1.0, -1.5, 1.4), (0.0, 0.0, 1.0)),
    "front": ((0.0, -1.0, 0.0), (0.0, 0.0, 1.0)),
    "back": ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    "iso-back": ((1.0, 1.5, 1.4), (0.0, 0.0, 1.0)),
    "side": ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    "top": ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0)),
}
NAMES = ("none", "blocks", "joints", "all")


class LookOptions(TypedDict, total=False):
    """The fields of `Look` as optional keywords."""

    view: str
    magnification: float | None
    color: str
    forces: bool
    names: str
    thrust: bool
    reactions: bool


@dataclass(frozen=True, slots=True)
class Look:
    """Display options of a history: camera ``view`` (iso, iso-back, front, back, side, top); ``magnification`` of the
    motion (None: chosen to make it visible, and stated in the picture); ``color`` of the blocks (displacement; energy,
    which is kinetic; utilisation or slip, the greatest of their joints; or none). ``forces``: draw the forces of joints
    and new contacts. ``names``: those of blocks, joints, all or none, and only of moving ones if any block moves.
    ``thrust``: draw the line of thrust with its hinges. ``reactions``: draw those of the supports."""

    view: str = "iso"
    magnification: float | None = None
    color: str = "displacement"
    forces: bool = False
    names: str = "none"
    thrust: bool = False
    reactions: bool = False

    @property
    def needs_forces(self) -> bool:
        """Whether forces of joints or supports are shown."""
        return self.forces or self.thrust or self.reactions or self.color in ("utilisation", "slip")

    def __post_init__(self):
        told = (("view", self.view, VIEWS), ("color", self.color, COLORS), ("names", self.names, NAMES))
        for name, value, known in told:
            if value not in known:
                raise ScenarioError(f"{name} = {value!r} is unknown; use one of {', '.join(known)}")
        factor = self.magnification
        if factor is not None and not (np.isfinite(factor) and factor >= 0.0):
            raise ScenarioError(f"magnification = {factor!r} is out of range: it must be finite and at least 0")


COLORS = ("displacement", "utilisation", "slip", "energy", "none")
_TITLES = {
    "displacement": "displacement\nof each point",
    "utilisation": "utilisation of the\nmost used joint",
    "slip": "greatest slip\nof its joints",
    "energy": "kinetic energy",
}
_UNITS = {  # unit in steps of a thousand
    "displacement": ("m", "mm", "µm", "nm"),
    "slip": ("m", "mm", "µm", "nm"),
    "energy": ("J", "mJ", "µJ", "nJ"),
    "utilisation": ("-",),
}


class Colouring:
    """Values of ``color`` at the vertices ("displacement") or of the blocks (all others), frame by frame.

    Raises HistoryError if the history lacks the data for them.
    """

    def __init__(self, history: History, color: str, carried: CarriedPoints, joints: JointMotion | None):
        self._history, self.color, self._carried, self._joints = history, color, carried, joints
        if color in ("utilisation", "slip") and not (history.n_joint and history.has_joints and history.n_row):
            raise HistoryError(
                f"{history.path}: {color} cannot be shown because the forces of joints were not recorded; run it again "
                'with "joints" in output.channels'
            )
        if color == "energy" and history.counts_equilibria:
            raise HistoryError(
                f"{history.path}: energy cannot be shown: the run goes from equilibrium to equilibrium, where blocks "
                "have no velocity"
            )
        if color == "energy" and (history.block_mass is None or history.n_frames < 2):
            raise HistoryError(
                f"{history.path}: energy cannot be shown, because the file has no masses or only one frame"
            )

    @property
    def at_vertices(self) -> bool:
        return self.color == "displacement"

    def values(self, frame: int, poses: Poses) -> np.ndarray:
        """(n_vertex,) or (n_block,), in SI units, in a frame with the given ``poses``."""
        if self.color == "displacement":
            return np.linalg.norm(self._carried.moved(poses)[0], axis=1)
        if self.color == "energy":
            return block_quantities(self._history, poses, frame, frame + 1)["kinetic_energy"][0]
        now = self._joints.at([frame])
        of_joint = now.utilisation[0] if self.color == "utilisation" else now.resultants[0, :, CHANNELS.index("slip")]
        return self._joints.greatest_of_blocks(of_joint[None])[0]

    def scale(self, largest: float) -> Scale:
        """Unit and range for values up to ``largest``; velocities of a mechanism, which have no scale, over it."""
        if self.color == "displacement" and self._history.status == MECHANISM:
            return Scale("velocity over\nthe greatest [-]", 1.0 / max(largest, 1e-300), 1.0)
        units = _UNITS[self.color]
        step = 0
        # lengths in metres from 1 m on, as in all other views
        while step < len(units) - 1 and 0.0 < largest * 1e3**step < (1.0 if units[step] == "m" else 0.1):
            step += 1
        top = 1.0 if self.color == "utilisation" else max(largest * 1e3**step, 1e-12)
        return Scale(f"{_TITLES[self.color]} [{units[step]}]", 1e3**step, top)


@dataclass(frozen=True, slots=True)
class Scale:
    """``factor``: from SI units to the unit of ``title``; ``top``: value at the end of the colour scale."""

    title: str
    factor: float
    top: float
