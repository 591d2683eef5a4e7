"""Which joints share a tile of the kernels."""

from __future__ import annotations

import numpy as np

from dembrick.kernels.dynamics.tiles import W

FEW = 8  # directions of normals: more are of no use, and joints near each other should stay so
ROUNDING = 1e-12
ALIKE = 8 * W  # joints that are like each other: so many get tiles of their own
STRETCH = 512  # joints that are sorted by their direction at a time


def tiled(kind: np.ndarray, way: np.ndarray, turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which of p joints each lane of t tiles has, (t, W), and how many of its lanes a tile uses, (t,).

    ``turn`` (p,): the joints in an order in which neighbours are near each other. Those of one ``kind`` (p,) stand side
    by side, of those the ones that go the same ``way`` (p,): head joints of a wall slide all the time and beds hardly
    ever, and a tile where nothing slides is done sooner; and tiles of joints alike have rows in common. But only within
    stretches of joints, so that what a tile wants of its blocks is still in the cache. The last joint stands again in
    lanes that are left over.
    """
    lanes, used = [np.zeros((0, W), np.uint32)], [np.zeros(0, np.int64)]
    for one in np.unique(kind):
        members = turn[kind[turn] == one]
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


def in_turn(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The joints (j,) in the order of their blocks, which stand in rows a and b (j,) of the loop."""
    return np.lexsort((np.maximum(a, b), np.minimum(a, b)))


def ways(normals: np.ndarray, numbers: np.ndarray) -> np.ndarray:
    """A number (p,) for the direction of each normal (p, 3) and, among those of one direction, for joints whose
    ``numbers`` (p, k) are the same but for rounding. Zero for all where there are more directions than a few, and for
    joints that are like too few others."""
    _, way, count = np.unique(np.round(np.abs(normals), 6), axis=0, return_inverse=True, return_counts=True)
    if len(count) > FEW:
        return np.zeros(len(normals), np.int64)
    scale = np.abs(numbers).max(axis=0, initial=1e-300)
    mixed = without_rounding(numbers / scale @ np.sqrt(1.0 + np.arange(numbers.shape[1])), lengths=True)
    _, kind, count = np.unique(mixed, return_inverse=True, return_counts=True)
    return way.reshape(-1) * (len(count) + 1) + np.where(count[kind] >= ALIKE, kind + 1, 0)
