"""Magnification of small motions in pictures and pages."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dembrick.views.motion.blocks import CarriedPoints, Poses, all_vertices, largest_extent
from dembrick.views.motion.joints import JointMotion

if TYPE_CHECKING:
    from dembrick.history.reader import History

_SEEN = 0.12  # of the largest block: how far the farthest corner moves in a picture by itself
_SUNK = 0.25  # of the thinnest block's thickness: blocks do not sink further into each other as joints are compressed


def automatic_magnification(history: History, frame: int) -> float:
    """A round number, at least 1, by which the motion of the farthest corner is seen in a frame; 1 without motion."""
    body, block, starts = all_vertices(history)
    carried, poses = CarriedPoints(history, body, block), Poses.read(history, frame, frame + 1)
    moved = float(np.linalg.norm(carried.moved(poses)[0], axis=1).max(initial=0.0))
    solid = [i for i in range(history.n_block) if starts[i] < starts[i + 1]]
    largest = largest_extent(carried.magnified(poses, 0.0)[0], starts, solid)
    if not moved > 1e-12 * largest:
        return 1.0
    factor = _SEEN * largest / moved
    if factor > 1.0 and history.n_joint:
        sunk = -float(JointMotion(history).at([frame]).relative.plane[..., 0].min())
        thinnest = min(float(np.ptp(body[starts[i] : starts[i + 1]], axis=0).min()) for i in solid)
        if sunk * factor > _SUNK * thinnest:
            factor = _SUNK * thinnest / sunk
    return round_down(max(1.0, factor))


def round_down(value: float) -> float:
    """The greatest of 1, 2 or 5 times a power of ten that is not above ``value``."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= value * (1.0 + 1e-9)))
