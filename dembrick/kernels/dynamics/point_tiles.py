"""Joints with contact points side by side, in real time: their arrays."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy import ndarray

from dembrick.kernels.dynamics.bonded_points import BOND
from dembrick.kernels.dynamics.tiles import AREA, ELASTIC, POINT, SHEAR, SLIP, W, X, Y, alike, set_apart
from dembrick.kernels.joint.point_law import Strengths


class Corners(NamedTuple):
    """p joints with contact points, in t tiles. What stands in tiles can be read point by point under the names
    below, as copies; `put` writes it."""

    joint: ndarray  # (p,) uint32
    start: ndarray  # (p + 1,) uint32, first contact point of each
    place: ndarray  # (p,) uint32, where its first point is: its lane, plus W times the points in tiles before
    law: ndarray  # (p,) uint32, which of the following
    k_n: ndarray  # (l,) Pa/m
    k_s: ndarray  # (l,) Pa/m
    friction: ndarray  # (l,)
    shear_arm: ndarray  # (l,) friction acts at this times the arm of the normal force
    lane: ndarray  # (t, W) uint32, which of the p joints each lane has; the last one again where there are no more
    used: ndarray  # (t,) uint32, lanes that have one of their own
    tile_law: ndarray  # (t,) uint32
    tile_start: ndarray  # (t + 1,) int64, first point of each tile
    like: ndarray  # (t,) uint32, the tile of ``points`` that the loop reads in place of each: see `alike`
    points: ndarray  # point after point of a tile, rows as above
    sheared: ndarray  # likewise, elastic shear force: two rows a point
    slipped: ndarray  # likewise, length of the slip path: one row a point
    force: ndarray | None  # (c, 3) N, world, last force on the host at each point; None if nobody asks for it
    strengths: Strengths | None = None  # beside friction, an entry a law; None if no joint has any
    bonds: ndarray | None = None  # likewise, see `bonded_points`; None if ``strengths`` is

    def where(self, joint: int | None = None) -> ndarray:
        """Each contact point in the sense of ``place``, of all joints (c,) or of one."""
        if joint is not None:
            return int(self.place[joint]) + np.arange(int(self.start[joint + 1]) - int(self.start[joint])) * W
        count = np.diff(self.start)
        own = np.arange(int(self.start[-1])) - np.repeat(self.start[:-1].astype(np.int64), count)
        return np.repeat(self.place.astype(np.int64), count) + own * W

    def of_bonds(self, row: int, joint: int | None = None) -> ndarray:
        """Where a row of each contact point is in ``bonds``, of all joints (c,) or of one."""
        where = self.where(joint)
        return where // W * BOND + row * W + where % W

    def row(self, row: int, joint: int | None = None) -> ndarray:
        """A copy of a row of contact points, of all joints (c,) or of one."""
        array, where = self._where(row, joint)
        found = array[where]
        found.flags.writeable = False  # who writes into it means `put`
        return found

    def put(self, row: int, values, joint: int | None = None) -> None:
        """Write a row of contact points, of all joints (c,) or of one."""
        if row < ELASTIC:
            tiles = np.searchsorted(self.tile_start, self.where(joint) // W, side="right") - 1
            set_apart(self.like, tiles)
        array, where = self._where(row, joint)
        array[where] = values

    def share(self) -> None:
        """Let tiles whose points are the same to the last bit take them from one of them."""
        self.like[:] = alike(self.points[a * POINT : b * POINT] for a, b in pairwise(self.tile_start.tolist()))

    def _where(self, row: int, joint: int | None) -> tuple[ndarray, ndarray]:
        """The array that has this row, and where it is in it."""
        array, size, row = (self.points, POINT, row) if row < ELASTIC else (self.sheared, SHEAR, row - ELASTIC)
        if row >= SLIP - ELASTIC and array is self.sheared:
            array, size, row = self.slipped, W, 0
        where = self.where(joint)
        return array, where // W * size + row * W + where % W

    x = property(lambda self: self.row(X), doc="(c,) m, from O along e1")
    y = property(lambda self: self.row(Y), doc="(c,) m, along e2")
    area = property(lambda self: self.row(AREA), doc="(c,) m2, tributary")
    slip = property(lambda self: self.row(SLIP), doc="(c,) m, length of the slip path")

    @property
    def elastic(self) -> ndarray:
        """(c, 2) N, elastic shear force, in the sense in which the host slips, along u1, u2."""
        return np.stack([self.row(ELASTIC), self.row(ELASTIC + 1)], axis=1)
