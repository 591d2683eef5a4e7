"""Magnification of small motions in pictures and pages."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from dembrick.views.motion.blocks import CarriedPoints, Poses, all_vertices, largest_extent
from dembrick.views.motion.joints import JointMotion

if TYPE_CHECKING:
    from dembrick.history.reader import History

_SEEN = 0.12  # of the largest block: drawn displacement of the corner that moves farthest
_SUNK = 0.25  # of the thinnest block's thickness: greatest drawn overlap of blocks at compressed joints


def automatic_magnification(history: History, frames: int | Iterable[int]) -> float:
    """Magnification that makes the motion visible in a frame, or in that of several ``frames`` with the greatest
    motion: a round number, at least 1; 1 without motion."""
    numbers = sorted({frames} if isinstance(frames, int) else set(frames))
    body, block, starts = all_vertices(history)
    carried = CarriedPoints(history, body, block)
    solid = [i for i in range(history.n_block) if starts[i] < starts[i + 1]]
    largest = largest_extent(carried.magnified(Poses.read(history, 0, 1), 0.0)[0], starts, solid)
    # one frame after the other: a whole movie would need too much memory
    moved = _greatest(np.linalg.norm(carried.moved(Poses.read(history, k, k + 1))[0], axis=1).max() for k in numbers)
    if not moved > 1e-12 * largest:
        return 1.0
    factor = _SEEN * largest / moved
    if factor > 1.0 and history.n_joint:
        joints = JointMotion(history)
        sunk = _greatest(-joints.at([k]).relative.plane[..., 0].min() for k in numbers)
        thinnest = min(float(np.ptp(body[starts[i] : starts[i + 1]], axis=0).min()) for i in solid)
        if sunk * factor > _SUNK * thinnest:
            factor = _SUNK * thinnest / sunk
    return round_down(max(1.0, factor))


def _greatest(values: Iterable[float]) -> float:
    """The greatest of the values, at least 0; values that are not finite, from a run that diverged, are ignored."""
    return max([0.0, *(float(value) for value in values if np.isfinite(value))])


def round_down(value: float) -> float:
    """The greatest number of the form 1, 2 or 5 times a power of ten that does not exceed ``value``."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= value * (1.0 + 1e-9)))
