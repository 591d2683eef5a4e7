"""Joints with contact points side by side, in real time: their arrays."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy import ndarray

from dembrick.kernels.dynamics.tiles import POINT, W, alike, in_lanes, put_in_lanes, set_apart
from dembrick.kernels.joint.custom_law import Custom
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
    points: ndarray  # records `POINT`, point after point of a tile
    sheared: ndarray  # records `SHEAR`, likewise
    slipped: ndarray  # records `PATH`, likewise
    force: ndarray | None  # (c, 3) N, world, last force on the host at each point; None if nobody asks for it
    strengths: Strengths | None = None  # beside friction, an entry a law; None if no joint has any
    bonds: ndarray | None = None  # records `BOND`, likewise, see `bonded_points`; None if ``strengths`` is
    custom: Custom | None = None  # what a law of the user's own works on, rows as ``place``; None if they have none

    def where(self, joint: int | None = None) -> ndarray:
        """Each contact point in the sense of ``place``, of all joints (c,) or of one."""
        if joint is not None:
            return int(self.place[joint]) + np.arange(int(self.start[joint + 1]) - int(self.start[joint])) * W
        count = np.diff(self.start)
        own = np.arange(int(self.start[-1])) - np.repeat(self.start[:-1].astype(np.int64), count)
        return np.repeat(self.place.astype(np.int64), count) + own * W

    def field(self, name: str, joint: int | None = None) -> ndarray:
        """A copy of a field of contact points, of all joints (c,) or of one."""
        return in_lanes(self._tiles(name), name, self.where(joint))

    def put(self, name: str, values, joint: int | None = None) -> None:
        """Write a field of contact points, of all joints (c,) or of one."""
        where = self.where(joint)
        if name in (POINT.names or ()):
            set_apart(self.like, np.searchsorted(self.tile_start, where // W, side="right") - 1)
        put_in_lanes(self._tiles(name), name, where, values)

    def share(self) -> None:
        """Let tiles whose points are the same to the last bit take them from one of them."""
        self.like[:] = alike(self.points[a:b] for a, b in pairwise(self.tile_start.tolist()))

    def _tiles(self, name: str) -> ndarray:
        """The records that have a field of that name."""
        records = (self.points, self.sheared, self.slipped, self.bonds)
        return next(tiles for tiles in records if tiles is not None and name in tiles.dtype.names)

    x = property(lambda self: self.field("x"), doc="(c,) m, from O along e1")
    y = property(lambda self: self.field("y"), doc="(c,) m, along e2")
    area = property(lambda self: self.field("area"), doc="(c,) m2, tributary")
    slip = property(lambda self: self.field("length"), doc="(c,) m, length of the slip path")
    elastic = property(
        lambda self: self.field("elastic"), doc="(c, 2) N, elastic shear force, in the sense in which the host slips"
    )
