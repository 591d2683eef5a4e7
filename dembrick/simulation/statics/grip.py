"""How much of its friction each joint uses along a path, and what that comes to if the load grows on."""

from __future__ import annotations

import numpy as np

from dembrick.simulation.statics import joint_families
from dembrick.simulation.statics.state import State

SURE = 0.98  # of the friction: joints that use less will hold
NOTHING = 1e-6  # of the greatest normal force: joints that carry less hold nothing up
SLIDES = 1e-6  # of the friction: joints that leave less of it unused slide already


class Grip:
    """The forces of the joints of a ``state`` at the last two equilibria of its path, whose friction may give out.

    ``forces`` (2, j + 1, 4): N, V_1, V_2 (N) and M_T (N m), the earlier first; V (N) in the last row.
    """

    def __init__(self, state: State):
        self._state, self._convex = state, joint_families.has_areas(state)
        self._friction = joint_families.friction(state)
        self._lever = joint_families.torsion_radius(state)
        self.forces = np.zeros((2, len(self._friction) + 1, 4))

    def note(self, V: float) -> None:
        """Keep the forces of the equilibrium of now, at ``V``."""
        self.forces[0] = self.forces[1]
        self.forces[1, :-1], self.forces[1, -1] = self._state.joints.resultant[:, :4], V

    def rocks_on(self, V: float) -> bool:
        """Whether convex joints may rock on until the load is ``V`` (N): no joint slides then that does not slide now.

        While one mechanism rocks, joint forces follow V on a straight line, that of one joint by statics.
        """
        if not self._convex:
            return False
        forces, (before, now) = self.forces[:, :-1], self.forces[:, -1, 0]
        if V <= now:
            return True
        if not now > before:
            return False
        there = forces[1] + (V - now) / (now - before) * (forces[1] - forces[0])
        slid = (self._slid(forces) >= (1.0 - SLIDES) * self._strength(forces)).all(axis=0)
        taken = self._slid(there) + np.abs(there[:, 3]) / self._lever
        nothing = NOTHING * there[:, 0].max()
        return bool((slid | (taken <= np.maximum(SURE * self._strength(there), nothing))).all())

    def _slid(self, forces: np.ndarray) -> np.ndarray:
        """Shear force (.., j) in N."""
        return np.hypot(forces[..., 1], forces[..., 2])

    def _strength(self, forces: np.ndarray) -> np.ndarray:
        """Friction (.., j) in N."""
        return self._friction * np.maximum(forces[..., 0], 0.0)
