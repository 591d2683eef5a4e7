"""Which joints share a tile of the kernels."""

from __future__ import annotations

import numpy as np

from dembrick.kernels.dynamics.tiles import W

FEW = 8  # directions of normals: more are of no use, and joints near each other should stay so
ROUNDING = 1e-12
STRETCH = 512  # joints that are sorted by their direction at a time


def tiled(kind: np.ndarray, way: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which of p joints each lane of t tiles has, (t, W), and how many of its lanes a tile uses, (t,).

    Joints of one ``kind`` (p,) side by side, of those the ones whose normals go the same ``way`` (p,): head joints of a
    wall slide all the time and beds hardly ever, and a tile where nothing slides is done sooner. But only within
    stretches of joints, so that what a tile wants of its blocks is still in the cache. The last joint stands again in
    lanes that are left over.
    """
    lanes, used = [np.zeros((0, W), np.uint32)], [np.zeros(0, np.int64)]
    for one in np.unique(kind):
        members = np.flatnonzero(kind == one)
        members = members[np.lexsort((way[members], np.arange(len(members)) // STRETCH))]
        tiles = -(-len(members) // W)
        padded = np.full(tiles * W, members[-1], np.uint32)
        padded[: len(members)] = members
        lanes.append(padded.reshape(tiles, W))
        used.append(np.minimum(len(members) - W * np.arange(tiles), W))
    return np.concatenate(lanes), np.concatenate(used)


def without_rounding(values: np.ndarray, lengths: bool = False) -> np.ndarray:
    """Numbers (k, ...), the same where they differ by rounding alone: then tiles of a regular wall are the same.

    Rounding is as large as `ROUNDING` of the numbers themselves, or of the greatest of them if they are ``lengths``:
    differences of coordinates.
    """
    flat = values.reshape(-1)
    order = np.argsort(flat, kind="stable")
    ascending = flat[order]
    size = np.abs(ascending)
    new = np.diff(ascending, prepend=-np.inf) > ROUNDING * (size.max(initial=0.0) if lengths else size)
    same = np.empty_like(flat)
    same[order] = ascending[new][np.cumsum(new) - 1]
    return same.reshape(values.shape) + 0.0  # and -0 is 0


def ways(normals: np.ndarray) -> np.ndarray:
    """A number (p,) for the direction of each normal (p, 3); zero for all where there are more than a few."""
    _, way = np.unique(np.round(np.abs(normals), 6), axis=0, return_inverse=True)
    return way.reshape(-1) * (way.max() < FEW)
