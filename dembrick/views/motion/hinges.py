"""The hinges of a structure in a frame: during collapse those named by the result, else those found from the forces."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dembrick.views import summary
from dembrick.views.motion.bending import eccentricity_utilisation
from dembrick.views.motion.frames import LAST, frame_number
from dembrick.views.motion.joints import HINGE, JointMotion

if TYPE_CHECKING:
    from dembrick.history.reader import History

CLOSE = 1e-6  # of a joint's size: corners whose gaps differ by less count as equally open
CARRIES = 1e-6  # of the greatest N of a frame: joints with less carry nothing


def hinges(history: History, joints: JointMotion, frame: int) -> list[int]:
    """Numbers of the joints that are hinges in a frame.

    From the last equilibrium before a collapse on, those named by the result: the joints that rotate in the collapse.
    Before that, and if the result names none, those whose centre of pressure has reached the edge.
    """
    named = summary.part(history.results, "collapse").get("hinges")
    if isinstance(named, list) and named and frame >= frame_number(history, LAST, in_rows=True):
        names = history.block_names
        pairs = [{names[a], names[b]} for a, b in zip(joints.block_a, joints.block_b, strict=True)]
        told = [set(text.split(" / ")) for text in named if isinstance(text, str)]
        return [j for j, pair in enumerate(pairs) if pair in told]
    now = joints.at([frame])
    N = now.resultants[0, :, 0]
    # from the initial O even if a joint was cut as it slid over an edge: the slip is small relative to the joint
    at = now.shift[0] + now.pressed_arm[0]
    out = eccentricity_utilisation(joints, N[None], at[None])[0]
    return np.flatnonzero((N > CARRIES * N.max(initial=0.0)) & (out >= HINGE)).tolist()


def closed_edges(joints: JointMotion, frame: int) -> np.ndarray:
    """Point (j, 2) m from O where the faces of each joint are closest in a frame: the middle of the box around the
    corners with the least gap."""
    owner, corner = np.nonzero(joints.is_corner)
    arms = joints.polygon[owner, corner]
    apart = np.full(joints.is_corner.shape, np.inf)
    apart[owner, corner] = joints.at([frame]).relative.distance(arms, owner)[0]
    nearest = (apart <= apart.min(axis=1, keepdims=True) + CLOSE * joints.size[:, None])[..., None]
    low, high = (np.where(nearest, joints.polygon, beyond) for beyond in (np.inf, -np.inf))
    return 0.5 * (low.min(axis=1) + high.max(axis=1))
