"""Intersections of many pairs of convex polygons at once, and removal of redundant corners.

Polygons of a batch are padded to equal numbers of corners: arrays (k, m, 2) with counts (k,); corners beyond the count
are undefined. Input polygons may instead repeat corners.
"""

from __future__ import annotations

import numpy as np

CHUNK = 4096  # polygons per batch


def clip(subject: np.ndarray, clipper: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Intersections of convex polygons ``subject`` (k, m, 2) with others ``clipper`` (k, n, 2), clipped edge by edge
    (Sutherland and Hodgman): corners (k, p, 2) and counts (k,), 0 if there is none.

    Both are counterclockwise and may repeat corners. Where polygons only touch, the result may be a sliver or repeat
    corners: see :func:`simplify`.
    """
    points, count = subject, np.full(len(subject), subject.shape[1])
    for e in range(clipper.shape[1]):
        start = clipper[:, e - 1]
        edge = clipper[:, e] - start
        arm = points - start[:, None]
        side = edge[:, :1] * arm[..., 1] - edge[:, 1:] * arm[..., 0]
        there = np.arange(points.shape[1]) < count[:, None]
        outside = there & (side < 0.0)
        if not outside.any():
            continue
        before = np.arange(points.shape[1]) - 1 + (np.arange(points.shape[1]) == 0) * count[:, None]
        before = np.maximum(before, 0)
        other, other_side = np.take_along_axis(points, before[..., None], axis=1), np.take_along_axis(side, before, 1)
        crosses = there & (outside != np.take_along_axis(outside, before, 1))
        share = np.divide(other_side, other_side - side, out=np.zeros_like(side), where=crosses)
        crossing = other + share[..., None] * (points - other)
        corners = np.stack([crossing, points], axis=2).reshape(len(points), -1, 2)
        kept = np.stack([crosses, there & ~outside], axis=2).reshape(len(points), -1)
        points, count = _packed(corners, kept)
        count[count < 3] = 0
    return points, count


def simplify(points: np.ndarray, count: np.ndarray, tolerance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The polygons without repeated corners and corners on the line of their neighbours, within ``tolerance`` (k,):
    corners (k, p, 2), counts (k,); 0 if fewer than three corners remain."""
    points, count = points.copy(), np.where(count >= 3, count, 0)
    active = np.flatnonzero(count)
    room = np.arange(points.shape[1])
    while len(active):
        p, n = points[active], count[active, None]
        before = np.take_along_axis(p, np.where(room == 0, n - 1, room - 1)[..., None], axis=1)
        after = np.take_along_axis(p, np.where(room >= n - 1, 0, room + 1)[..., None], axis=1)
        chord, here = after - before, p - before
        double_area = np.abs(here[..., 0] * chord[..., 1] - here[..., 1] * chord[..., 0])
        least = tolerance[active, None]
        idle = np.hypot(here[..., 0], here[..., 1]) <= least
        idle |= double_area <= least * np.hypot(chord[..., 0], chord[..., 1])
        idle &= room < n
        found = idle.any(axis=1)
        active, first = active[found], np.argmax(idle[found], axis=1)
        # remove the first redundant corner, shift those after it, and check the polygon again
        shifted = np.minimum(room + (room >= first[:, None]), len(room) - 1)
        points[active] = np.take_along_axis(points[active], shifted[..., None], axis=1)
        count[active] -= 1
        count[active[count[active] < 3]] = 0
        active = active[count[active] >= 3]
    return points, count


def started_lowest(points: np.ndarray, count: np.ndarray, direction: tuple[float, float]) -> np.ndarray:
    """The polygons starting with the corner lowest along ``direction``; padded with the last corner."""
    room = np.arange(points.shape[1])
    heights = np.where(room < count[:, None], points @ np.array(direction), np.inf)
    order = (np.argmin(heights, axis=1)[:, None] + np.minimum(room, count[:, None] - 1)) % count[:, None]
    return np.take_along_axis(points, order[..., None], axis=1)


def _packed(corners: np.ndarray, kept: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Move the kept corners of every row to its front; the width is that of the longest row."""
    count = kept.sum(axis=1)
    order = np.argsort(~kept, axis=1, kind="stable")[:, : max(3, int(count.max(initial=0)))]
    return np.take_along_axis(corners, order[..., None], axis=1), count
