"""Room for the pressed parts of convex joints whose friction follows the bending."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dembrick.errors import ScenarioError
from dembrick.kernels.joint.pressure import Pressed
from dembrick.scenario.model import PRESSURES


def check_pressures(joints, chosen: np.ndarray) -> None:
    """ScenarioError if one of the ``chosen`` joints of a `JointTable` has a pressure that its polygon cannot have."""
    for j in chosen.tolist():
        if joints.law[j].pressure == "effective" and j in joints.pieces:
            raise ScenarioError(
                'pressure = "effective" needs convex joints, and a joint here consists of several pieces: use "linear"'
            )


def pressed_parts(pressures: Sequence[str], corners: Sequence[int]) -> Pressed | None:
    """Room for the pressed parts of convex joints; the first forces fill it."""
    if all(pressure == "full" for pressure in pressures):
        return None
    room = [2 * m + 2 for m in corners]  # every edge of the reflected polygon can add a corner
    a, total = len(room), sum(room)
    return Pressed(
        kind=np.array([PRESSURES.index(pressure) for pressure in pressures], np.int64),
        pieces=np.ones(a, np.int64),
        start=np.cumsum([0, *room[:-1]]).astype(np.int64),
        count=np.zeros(a, np.int64),
        x=np.zeros(total),
        y=np.zeros(total),
        spare_x=np.zeros(total),
        spare_y=np.zeros(total),
        centre=np.zeros((a, 2)),
        density=np.zeros((a, 3)),
        reach=np.zeros(a),
        radius=np.ones(a),
    )


def room_of(part: Pressed) -> np.ndarray:
    """How many corners each pressed part has room for (a,)."""
    return np.diff(np.append(part.start, len(part.x)))
