"""Strengths of the bonded joints of a recorded run: shear strength, and utilisation of the tensile strength.

While a bond holds, the normal stress of a joint is linear over its area or its points, and may be tensile.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dembrick.history.rest_geometry import STRENGTHS
from dembrick.theory.polygons import moment_matrix

if TYPE_CHECKING:
    from dembrick.views.motion.joints import JointMotion


class Bonds:
    """Strengths (j,) of the joints of ``joints``: cohesion, tension, residual cohesion (Pa), residual friction."""

    def __init__(self, joints: JointMotion):
        self.cohesion, self.tension, self.after, self.residual = (
            np.array([joint[key] for joint in joints.given], float) for key in STRENGTHS
        )
        self._area, self._friction = joints.area, joints.friction
        self.cohere = (self.cohesion > 0.0) | (self.after > 0.0)  # part of the shear strength grows with the area
        self.bonded = (self.cohesion > 0.0) | (self.tension > 0.0) | (self.residual < self._friction)
        self.brittle = (self.after < self.cohesion) | (self.residual < self._friction)  # in shear
        arms, _, self._areas, self._owner = joints.points
        self._start = joints.point_start
        # stress at each point or corner: phi . H^-1 (N, M_2, -M_1)
        self._places, self._matrices = [], []
        for j in range(joints.n_joint):
            own = slice(self._start[j], self._start[j + 1])
            corners = joints.polygon[j, : joints.n_corner[j]]
            at = arms[own] if own.stop > own.start else corners
            phi = np.column_stack([np.ones(len(at)), at])
            H = (phi * self._areas[own, None]).T @ phi if own.stop > own.start else moment_matrix(corners)
            self._places.append(phi)
            self._matrices.append(np.linalg.pinv(H, rcond=1e-12, hermitian=True))

    def _stress(self, j: int, resultants: np.ndarray) -> np.ndarray:
        """Linear normal stress (f, k) Pa of joint ``j`` at its points or corners."""
        load = np.stack([resultants[:, j, 0], resultants[:, j, 5], -resultants[:, j, 4]], axis=1)
        return load @ self._matrices[j] @ self._places[j].T

    def tension_utilisation(self, resultants: np.ndarray) -> np.ndarray:
        """(f, j): greatest tension over tensile strength in joints with intact bonds; without tensile strength, the
        bending stress over the mean stress, which is 1 at the onset of tension."""
        found = np.zeros(resultants.shape[:2])
        for j in np.flatnonzero(self.bonded):
            stress = self._stress(j, resultants)
            least = stress.min(axis=1)
            if self.tension[j] > 0.0:
                found[:, j] = np.maximum(-least, 0.0) / self.tension[j]
            else:
                mean = resultants[:, j, 0] / self._area[j]
                found[:, j] = np.where(mean > 0.0, (mean - least) / np.where(mean > 0.0, mean, 1.0), 0.0)
        return found

    def use_of_points(self, forces: np.ndarray, area: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(f, j) and (f, j): greatest tension over tensile strength, and greatest shear over c A + mu N, among the
        contact points of each joint, from their ``forces`` (f, c, 3) N in its axes and areas, (f, c) or (c,) in m2.

        The record does not say which points are intact: those in tension are, and broken ones bear less than
        c A + mu N.
        """
        owner, normal = self._owner, forces[..., 2]
        found = []
        for carried, strength in (
            (-normal, self.tension[owner] * area),
            (np.hypot(forces[..., 0], forces[..., 1]), self.cohesion[owner] * area + self._friction[owner] * normal),
        ):
            used = np.divide(carried, strength, out=np.zeros_like(carried), where=(carried > 0.0) & (strength > 0.0))
            greatest = np.zeros((len(self.tension), len(used)))
            np.maximum.at(greatest, owner, used.T)
            found.append(greatest.T)
        return found[0], found[1]

    def area_strength(self, N: np.ndarray, held: np.ndarray, closed: np.ndarray) -> np.ndarray:
        """V_0 (f, j) N of joints under ``N``; ``held`` and ``closed`` (f, j): shares of their areas that are bonded,
        and that are closed."""
        bonded = self.cohesion * self._area + self._friction * N
        broken = np.where(N > 0.0, self.after * self._area * closed + self.residual * N, 0.0)
        return np.maximum(held * bonded + (1.0 - held) * broken, 0.0)

    def point_strength(
        self, resultants: np.ndarray, held: np.ndarray, normal: np.ndarray, recorded: bool, area: np.ndarray
    ) -> np.ndarray:
        """Shear strength (N) of every contact point (f, c) under its ``normal`` force on its ``area``, (f, c) or (c,)
        in m2; unless the forces were ``recorded``, joints with intact bonds have a linear stress. In joints that have
        lost some of their bonds, the mean of bonded and broken strength."""
        normal = normal.copy()
        for j in np.flatnonzero(np.diff(self._start)) if not recorded else ():
            own, whole = slice(self._start[j], self._start[j + 1]), held[:, j] == 1.0
            normal[whole, own] = self._stress(j, resultants)[whole] * self._areas[own]
        owner, held = self._owner, held[:, self._owner]
        bonded = self.cohesion[owner] * area + self._friction[owner] * normal
        broken = np.where(normal > 0.0, self.after[owner] * area + self.residual[owner] * normal, 0.0)
        return np.maximum(held * bonded + (1.0 - held) * broken, 0.0)
