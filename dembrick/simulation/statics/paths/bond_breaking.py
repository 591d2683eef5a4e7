"""Bonds that break along a path of equilibria: between two of them, where their strength is exhausted.

During the search for an equilibrium all bonds stay intact, so that the forces are a continuous function of the motion
and Newton's method converges. A step at whose end a bond is overloaded is shortened until it ends where the strength is
reached, by linear interpolation of the reserves; then the joint law breaks it. A ductile bond under pressure slips
without breaking. If within a step it goes into tension with more shear than its strength, the step ends where the
pressure vanishes.
"""

from __future__ import annotations

import numpy as np

from dembrick.kernels.statics.energy import elastic_energy
from dembrick.simulation.statics import joint_families
from dembrick.simulation.statics.newton import Equilibria
from dembrick.simulation.statics.paths.path_state import PathState
from dembrick.simulation.statics.state import State, for_kernels

BRINK = 1e-4  # of a step: accuracy to which its end meets the failure of a bond
SHORTEST = 1e-4  # of the longest step: least step when locating the failure of a bond
AFTER = 1e-4  # of it: the step after bonds broke


class BondBreaking:
    """The bonds of a ``state`` whose path is followed; inactive in dry scenes.

    ``reserves``: unused strength of the bonds at the last equilibrium (N). ``borne``: the part of the last step that
    they withstood, zero if it is a jump at whose end some are overloaded. ``strength``: sum of the strengths of all
    bonds (N).
    """

    def __init__(self, state: State):
        self._state, self.present = state, joint_families.has_strengths(state)
        self.strength = float(joint_families.greatest_strength(state).sum())
        self.reserves, self.borne = joint_families.reserves(state), 1.0
        joint_families.keep_bonds_intact(state, True)

    def bear(self, way: PathState) -> bool:
        """Whether the bonds withstand the step that was found; if not, shorten ``way.step`` to the first failure."""
        self.borne = self._withstood()
        if self.borne == 1.0 or way.broke:
            return True
        now = joint_families.reserves(self._state)
        over = now < 0.0
        before = np.maximum(self.reserves, 0.0)
        slipping = np.isinf(before)
        tension = joint_families.tensile_strengths(self._state)
        before[slipping] = np.broadcast_to(before[:, :1] - tension[:, None], before.shape)[slipping]
        after = np.where(slipping, now[:, :1] - tension[:, None], now)
        self.borne = float((before[over] / (before[over] - after[over])).min())
        least = SHORTEST * way.usual
        if self.borne >= 1.0 - BRINK or way.step <= 1.001 * least:
            return True
        way.step = max((1.0 + 0.5 * BRINK) * self.borne * way.step, least)
        return False

    def jumped(self, V: float) -> float:
        """Note whether the bonds withstand the equilibrium at ``V`` to which the blocks jumped, or which they found
        after others broke. No shorter step leads to it, so if they do not, it proves nothing of the load. Returns V."""
        self.borne = self._withstood()
        return V

    def _withstood(self) -> float:
        """1 if no bond is overloaded at present, else 0."""
        return 0.0 if self.present and joint_families.overloaded(self._state).any() else 1.0

    def give_way(self, search: Equilibria, way: PathState) -> bool:
        """Break the bonds that are overloaded in the present equilibrium; whether there are any.

        The next equilibrium is then sought at almost the same driven displacement. The energy that the springs lose is
        added to the energy terms.
        """
        state, way.broke = self._state, False
        if not self.present:
            return False
        self.reserves = joint_families.reserves(state)
        if not (self.reserves < 0.0).any():
            return False
        before = elastic_energy(for_kernels(state), None)
        joint_families.keep_bonds_intact(state, False)
        search.attempt(way.motion, way.V)
        joint_families.keep_bonds_intact(state, True)
        way.fracture += before - elastic_energy(for_kernels(state), None)
        search.remember()
        self.reserves = joint_families.reserves(state)
        way.broke, way.step = True, AFTER * way.usual
        return True
