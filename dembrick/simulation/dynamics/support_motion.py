"""Supports with prescribed motion, each on its own path: their positions, and the reaction along the motion.

All paths are run through together: a share of 0 to 1 of each displacement and rotation. The reaction along the motion
is work-conjugate to the displacement of the point that moves furthest.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dembrick.geometry.rotations import quaternion_product, rotation_matrix, rotation_quaternion

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.kernels.dynamics.rigid_bodies import Bodies
    from dembrick.scenario.model import Scenario

PIECES = 256  # of a path, for measuring its length


class PrescribedMotion(NamedTuple):
    """Fields of `kernels.dynamics.loop.Loads` for moving supports, described there."""

    support: np.ndarray
    place: np.ndarray
    orientation: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray
    moved: np.ndarray


@dataclass(frozen=True)
class SupportMotion:
    """The paths of k supports: ``block`` (k,), ``start`` (k, 3) m and ``orientation`` (k, 4) at the start, ``reach``
    (k,) m; at the end ``displacement`` (k, 3) m of the ``point`` (k, 3) about which it has turned by ``turn`` (k, 3)
    rad. Positions have the same origin as in the run. ``length`` (m): of the path of the corner that moves furthest.
    """

    block: np.ndarray
    start: np.ndarray
    orientation: np.ndarray
    reach: np.ndarray
    displacement: np.ndarray
    point: np.ndarray
    turn: np.ndarray
    length: float

    def pose(self, share: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Centroids (s, k, 3) and orientations (s, k, 4) at shares (s,) of the paths."""
        part = np.asarray(share, float)[:, None, None]
        carried, arm = self.point + part * self.displacement, self.start - self.point
        if not self.turn.any():
            return carried + arm, np.repeat(self.orientation[None], len(part), axis=0)
        turn = rotation_quaternion(part * self.turn)
        turned = np.einsum("skij,kj->ski", rotation_matrix(turn), arm)
        return carried + turned, quaternion_product(turn, self.orientation)

    def __len__(self) -> int:
        return len(self.block)

    def between(self, share: np.ndarray, dt: float) -> PrescribedMotion:
        """The motion in s steps of ``dt`` (s) through shares (s + 1,), for the loop."""
        if (share == share[0]).all():
            return self._held(share[:1], len(share) - 1)
        position, orientation = self.pose(share)
        move, part = np.diff(position, axis=0), np.diff(share)[:, None, None]
        turn = part * self.turn
        angle2 = (turn**2).sum(axis=2)
        moved = 2.0 * ((move**2).sum(axis=2) + angle2 * self.reach**2)
        return PrescribedMotion(
            self.block, position[1:], orientation[1:], move / dt, turn / dt, moved.max(axis=1, initial=0.0)
        )

    def _held(self, share: np.ndarray, steps: int) -> PrescribedMotion:
        """`between` for supports at rest at one share (1,)."""
        position, orientation = (np.repeat(part, steps, axis=0) for part in self.pose(share))
        return PrescribedMotion(
            self.block, position, orientation, np.zeros_like(position), np.zeros_like(position), np.zeros(steps)
        )

    def resisting(self, share: float, reaction: np.ndarray) -> float:
        """The reaction along the motion (N) at a share: force of the structure on the supports along their motion,
        positive if it drives them on. ``reaction`` (k, 6): of these supports on the structure, about their centroids at
        the start."""
        centre = self.pose(np.array([share]))[0][0]
        carried = self.point + share * self.displacement
        along = self.displacement + np.cross(self.turn, centre - carried)
        force, moment = reaction[:, :3], reaction[:, 3:] - np.cross(centre - self.start, reaction[:, :3])
        return -float((force * along + moment * self.turn).sum()) / self.length


AT_REST = SupportMotion(
    np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 4)), np.zeros(0), *np.zeros((3, 0, 3)), length=1.0
)


def support_motion(scenario: Scenario, assembly: Assembly, bodies: Bodies) -> SupportMotion:
    """The paths of a control's supports from their positions in ``bodies``; `AT_REST` if none moves."""
    paths: dict[int, tuple] = {}
    for path in scenario.control.support_paths:
        for name in path.supports:
            for i in scenario.members(name):
                paths[i] = path.displacement or (0.0, 0.0, 0.0), path.rotation
    if not paths:
        return AT_REST
    block, middle = np.array(sorted(paths), np.int64), assembly.position.mean(axis=0)
    start = bodies.position[block].copy()
    point, turn = start.copy(), np.zeros_like(start)
    for k, i in enumerate(block.tolist()):
        rotation = paths[i][1]
        if rotation is not None:
            turn[k] = np.radians(rotation.angle) * np.array(rotation.axis)
            if rotation.point is not None:
                point[k] = np.array(rotation.point) - middle
    motion = SupportMotion(
        block, start, bodies.orientation[block].copy(),
        np.array([0.5 * assembly.shapes[i].diameter for i in block]),
        np.array([paths[i][0] for i in block.tolist()], float), point, turn, 1.0,
    )  # fmt: skip
    position, orientation = motion.pose(np.linspace(0.0, 1.0, PIECES + 1))
    longest = 0.0
    for k, i in enumerate(block.tolist()):
        corners = np.einsum("sij,vj->svi", rotation_matrix(orientation[:, k]), assembly.shapes[i].vertices)
        way = np.diff(corners + position[:, k, None], axis=0)
        longest = max(longest, float(np.sqrt((way**2).sum(axis=2)).sum(axis=0).max()))
    return replace(motion, length=longest)
