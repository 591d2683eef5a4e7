"""The hinges of a structure in a frame: those of its result where it comes down, else those that its forces tell."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dembrick.views import summary
from dembrick.views.motion.bending import way_to_edge
from dembrick.views.motion.frames import LAST, frame_number
from dembrick.views.motion.joints import HINGE, JointMotion

if TYPE_CHECKING:
    from dembrick.history.reader import History

CLOSE = 1e-6  # of a joint: corners whose openings differ by less are as far apart
CARRIES = 1e-6  # of the greatest N of a frame: joints with less carry nothing


def hinges(history: History, joints: JointMotion, frame: int) -> list[int]:
    """Numbers of the joints that are hinges in a frame.

    From the last equilibrium before a collapse on they are those that the result names: the joints that turn as the
    blocks come down. Before that, and where the result names none, those whose centre of pressure has come to the edge.
    """
    named = summary.part(history.results, "collapse").get("hinges")
    if isinstance(named, list) and named and frame >= frame_number(history, LAST, in_rows=True):
        names = history.block_names
        pairs = [{names[a], names[b]} for a, b in zip(joints.block_a, joints.block_b, strict=True)]
        told = [set(text.split(" / ")) for text in named if isinstance(text, str)]
        return [j for j, pair in enumerate(pairs) if pair in told]
    now = joints.at([frame])
    N = now.resultants[0, :, 0]
    # from O of the start, also where a joint was cut as it slid over an edge: a slip is small against the joint
    at = now.shift[0] + now.pressed_arm[0]
    out = way_to_edge(joints, N[None], at[None])[0]
    return np.flatnonzero((N > CARRIES * N.max(initial=0.0)) & (out >= HINGE)).tolist()


def closed_edges(joints: JointMotion, frame: int) -> np.ndarray:
    """Where the two faces of every joint are nearest to one another in a frame (j, 2) m, from O: half way between the
    outermost of those corners."""
    owner, corner = np.nonzero(joints.is_corner)
    arms = joints.polygon[owner, corner]
    apart = np.full(joints.is_corner.shape, np.inf)
    apart[owner, corner] = joints.at([frame]).relative.distance(arms, owner)[0]
    nearest = (apart <= apart.min(axis=1, keepdims=True) + CLOSE * joints.size[:, None])[..., None]
    low, high = (np.where(nearest, joints.polygon, beyond) for beyond in (np.inf, -np.inf))
    return 0.5 * (low.min(axis=1) + high.max(axis=1))
