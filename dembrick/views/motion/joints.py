"""Joints of a recorded run: motion, opening, slip, torsion centre, forces, utilisation.

The motion of b relative to a is a finite rotation and a shift, as seen by an observer moving with a: the rotation is
that of b's quaternion relative to a's, the shift goes from point O of a to point O of b. Both are measured from the
start, in the joint's axes t1, t2, n. Small rotations keep their digits in quaternions, but not in rotation matrices.
Runs in small displacements, such as searches, use the initial geometry: shifts and rotation vectors are differences,
and openings and slip are linear in them, like the forces that were computed from them.

Arrays begin with the dimension of the requested frames: (j, ...) for one frame, (f, j, ...) for f of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from dembrick.geometry.friction_integrals import far_moments
from dembrick.geometry.polygons import area, distance_outside, pieces
from dembrick.kernels.joint.utilisation import Outlines
from dembrick.scenario.regimes import CONSTANT_RATE
from dembrick.views.motion.bending import edges
from dembrick.views.motion.bonds import Bonds
from dembrick.views.motion.frames import nearest
from dembrick.views.motion.joint_frames import JointFrames
from dembrick.views.motion.relative import STATES, torsion_centre

if TYPE_CHECKING:
    from dembrick.history.reader import History

HINGE = 0.99  # of the distance from O to the edge: in a hinge of stiff joints the centre of pressure is as far out


class JointMotion:
    """The joints of a history (or of an object with the same attributes), or ``only`` the one of that number.

    ``polygon`` (j, m, 2): corners; joints with fewer than m repeat the last one. ``n_corner`` (j,): their number.
    ``is_corner`` (j, m): false for repeated ones. ``size`` (j,) m: greatest distance of a corner from O.
    ``point_start`` (j + 1,): offsets into the list of all contact points.
    """

    def __init__(self, history: History, only: int | None = None):
        self.history = history
        before = [0, *np.cumsum([len(joint["areas"]) for joint in history.joints])]
        own = slice(None) if only is None else slice(only, only + 1)
        self.given = joints = history.joints[own]
        of_points = slice(None) if only is None else slice(before[only], before[only + 1])
        # positions of these joints and their contact points in the arrays of the history
        self.column = {"joint": own, "joint_shift": own, "bond": own}
        self.column |= dict.fromkeys(("contact_force", "contact_arm", "contact_area"), of_points)
        self.n_joint = len(joints)
        self.block_a, self.block_b, self.host = (
            np.array([joint[name] for joint in joints], np.int64) for name in ("block_a", "block_b", "host")
        )
        self.other = self.block_a + self.block_b - self.host
        self.origin = np.array([joint["origin"] for joint in joints], float).reshape(-1, 3)
        self.axes = np.array([joint["axes"] for joint in joints], float).reshape(-1, 3, 3)
        self.area = np.array([joint["area"] for joint in joints], float)
        self.friction = np.array([joint["friction"] for joint in joints], float)
        self.crushing = np.array([joint.get("compressive_strength", np.inf) for joint in joints], float)
        self.n_corner = np.array([len(joint["polygon"]) for joint in joints], np.int64)
        most = int(self.n_corner.max(initial=0))
        self.polygon = np.empty((self.n_joint, most, 2))
        for own, joint in zip(self.polygon, joints, strict=True):
            own[:] = joint["polygon"][-1]
            own[: len(joint["polygon"])] = joint["polygon"]
        self.size = np.hypot(self.polygon[..., 0], self.polygon[..., 1]).max(axis=1, initial=0.0)
        self.is_corner = np.arange(most) < self.n_corner[:, None]
        self.point_start = np.cumsum([0, *(len(joint["areas"]) for joint in joints)])
        self.arm_a = self.origin - history.position0[self.block_a]
        self.arm_b = self.origin - history.position0[self.block_b]
        self.arm_host = np.where((self.host == self.block_a)[:, None], self.arm_a, self.arm_b)
        self.custom = "custom_law" in getattr(history, "settings", {})
        self.small = bool(getattr(history, "small_displacements", False))
        self.small_slopes = self.small or getattr(history, "regime", None) == CONSTANT_RATE.name
        self.back = history.orientation0 * np.array([1.0, -1.0, -1.0, -1.0])

    def at(self, frames, rows: Sequence[int] | None = None) -> JointFrames:
        """The joints in some frames, a range or a list of numbers; with the forces of ``rows``, by default of the rows
        nearest in time."""
        return JointFrames(self, frames, rows)

    def torsion_centre(self, frame: int, since: int | None = None) -> np.ndarray:
        """Torsion centre (j, 2) m of every joint from O in its axes, for the increment from frame ``since`` (default:
        the one before) to ``frame``; see :func:`torsion_centre`. NaN also in the first frame, and for open joints."""
        frame = range(self.history.n_frames)[frame]
        since = frame - 1 if since is None else range(self.history.n_frames)[since]
        if since < 0:
            return np.full((self.n_joint, 2), np.nan)
        both = self.at([since, frame]).relative
        first, second = both[0], both[1]
        return np.where((second.state == STATES.index("open"))[:, None], np.nan, torsion_centre(first, second))

    def rows(self, frames) -> np.ndarray:
        """The row nearest in time to each frame."""
        return nearest(self.history.time, self.history.frame_time[frames])

    def along_axes(self, vectors: np.ndarray) -> np.ndarray:
        """Vectors (f, j, 3), one per joint, in the joints' axes."""
        return np.einsum("jik,fjk->fji", self.axes, vectors)

    # --- constant quantities ---

    @cached_property
    def points(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Normal arms (c, 2), shear arms (c, 2), tributary areas (c,) and joints (c,) of all contact points."""
        normal, shear = (
            np.concatenate([np.zeros((0, 2)), *(joint[name] for joint in self.given)])
            for name in ("normal_arms", "shear_arms")
        )
        areas = np.concatenate([np.zeros(0), *(joint["areas"] for joint in self.given)])
        return normal, shear, areas, np.repeat(np.arange(self.n_joint), np.diff(self.point_start))

    def sum_of_points(self, values: np.ndarray) -> np.ndarray:
        """(f, j): sum of the values (f, c) of the contact points of each joint; zero for joints without points."""
        found, own = np.zeros((len(values), self.n_joint)), np.flatnonzero(np.diff(self.point_start))
        if len(own):
            found[:, own] = np.add.reduceat(values, self.point_start[own], axis=1)
        return found

    @cached_property
    def pieces(self) -> list[list[np.ndarray]]:
        """Numbers of the corners of each convex piece of every joint: one piece, unless blocks of several parts touch
        in one plane."""
        return [pieces(corners[:count]) for corners, count in zip(self.polygon, self.n_corner, strict=True)]

    @cached_property
    def bonds(self) -> Bonds | None:
        """Strengths of the joints besides friction; None if they have none."""
        return Bonds(self) if self.given and "cohesion" in self.given[0] else None

    @cached_property
    def edges(self) -> tuple[np.ndarray, np.ndarray]:
        """Outward normals (j, m, 2) of the edges of the region that can carry the normal force of each joint, and their
        distances (j, m) from O (m); joints with fewer than m edges are filled up with zero normals."""
        return edges(self)

    @cached_property
    def twist(self) -> tuple[np.ndarray, np.ndarray]:
        """Last slip twists from the utilisation of convex joints and of joints with points: the start of the next
        search, which is five times as fast from there in a neighbouring frame."""
        with_points = np.diff(self.point_start) > 0
        return np.zeros(((~with_points).sum(), 3)), np.zeros((with_points.sum(), 3))

    @cached_property
    def pressures(self) -> list[str]:
        """Pressure assumed by the law of each convex joint."""
        return [self.given[j]["pressure"] for j in self.surfaces[-1]]

    @cached_property
    def surfaces(self) -> tuple[Outlines, np.ndarray, np.ndarray] | None:
        """Polygons of the joints without contact points, as `area_gauges` needs them, and numbers of these joints."""
        joint = np.flatnonzero(np.diff(self.point_start) == 0)
        if not len(joint):
            return None
        x, y = np.ascontiguousarray(self.polygon[joint][self.is_corner[joint]].T)
        start, far = np.cumsum([0, *self.n_corner[joint]]), far_moments(self.polygon[joint])
        outlines = Outlines(x, y, start, area(self.polygon[joint]), self.size[joint], far)
        return outlines, np.arange(len(joint)), joint

    def greatest_of_blocks(self, of_joint: np.ndarray) -> np.ndarray:
        """(f, n_block): greatest value of the joints (f, j) of each block; NaN values are ignored."""
        found = np.zeros((self.history.n_block, len(of_joint)))
        for blocks in (self.block_a, self.block_b):
            np.fmax.at(found, blocks, of_joint.T)
        return found.T

    def grid(self, joint: int, along: int = 12) -> np.ndarray:
        """(k, 2) m: points of a square grid over the polygon of a joint, ``along`` of them over its longer side."""
        polygon = self.polygon[joint, : self.n_corner[joint]]
        low, extent = polygon.min(axis=0), np.ptp(polygon, axis=0)
        counts = np.maximum(np.round(along * extent / extent.max()).astype(int), 1)
        lines = [low[i] + extent[i] * (np.arange(counts[i]) + 0.5) / counts[i] for i in (0, 1)]
        points = np.stack(np.meshgrid(*lines), axis=-1).reshape(-1, 2)
        beyond = [distance_outside(points, polygon[corners]) for corners in self.pieces[joint]]
        return points[np.min(beyond, axis=0) <= 0.0]
