"""Magnification of small motions in pictures and pages."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from dembrick.views.motion.blocks import CarriedPoints, Poses, all_vertices, largest_extent
from dembrick.views.motion.joints import JointMotion

if TYPE_CHECKING:
    from dembrick.history.reader import History

_SEEN = 0.12  # of the largest block: how far the farthest corner moves in a picture by itself
_SUNK = 0.25  # of the thinnest block's thickness: blocks do not sink further into each other as joints are compressed


def automatic_magnification(history: History, frames: int | Iterable[int]) -> float:
    """A round number, at least 1, by which the motion of the farthest corner is seen in the frame of a history, or the
    greatest motion of several ``frames``; 1 without motion."""
    numbers = sorted({frames} if isinstance(frames, int) else set(frames))
    body, block, starts = all_vertices(history)
    carried = CarriedPoints(history, body, block)
    solid = [i for i in range(history.n_block) if starts[i] < starts[i + 1]]
    largest = largest_extent(carried.magnified(Poses.read(history, 0, 1), 0.0)[0], starts, solid)
    # one frame after the other: a movie is too much to hold at once
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
    """The greatest of the values, at least 0; a run that diverged has some that are not finite, which do not count."""
    return max([0.0, *(float(value) for value in values if np.isfinite(value))])


def round_down(value: float) -> float:
    """The greatest of 1, 2 or 5 times a power of ten that is not above ``value``."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= value * (1.0 + 1e-9)))
