"""Bonds that break along a path of equilibria: between two of them, where they bear all that they can.

Within an equilibrium all bonds hold, so that the forces are a continuous function of the motion and Newton's method
finds it. A step at whose end a bond bears too much is shortened until it ends there, by straight lines between what the
bonds had left before and after; then the same law lets it go. A ductile bond that presses slips and breaks nothing. If
it comes to be pulled by more shear than it bears within a step, then the step ends where it stops pressing.
"""

from __future__ import annotations

import numpy as np

from dembrick.kernels.statics.energy import elastic_energy
from dembrick.simulation.statics import joint_families
from dembrick.simulation.statics.newton import Equilibria
from dembrick.simulation.statics.paths.path_state import PathState
from dembrick.simulation.statics.state import State, for_kernels

BRINK = 1e-4  # of a step: so close to its end is where a bond breaks
SHORTEST = 1e-4  # of the longest step: no step is made shorter to find where a bond breaks
AFTER = 1e-4  # of it: the step after bonds broke


class BondBreaking:
    """The bonds of a ``state`` whose path is followed; it has none, and does nothing, in dry scenes.

    ``reserves``: what bonds could carry more at the last equilibrium (N). ``borne``: the part of the last step that
    they bore. ``strength``: sum of all bonds (N).
    """

    def __init__(self, state: State):
        self._state, self.present = state, joint_families.has_strengths(state)
        self.strength = float(joint_families.greatest_strength(state).sum())
        self.reserves, self.borne = joint_families.reserves(state), 1.0
        joint_families.hold_bonds(state, True)

    def bear(self, way: PathState) -> bool:
        """Whether the bonds bear the step that was found; if not, ``way.step`` becomes as long as they do."""
        self.borne = 1.0
        if not self.present or way.broke:
            return True
        now = joint_families.reserves(self._state)
        over = now < 0.0
        if not over.any():
            return True
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

    def give_way(self, search: Equilibria, way: PathState) -> bool:
        """Let the bonds go that bear too much in the equilibrium of now; whether there are any.

        The next equilibrium is then looked for at almost the same driven displacement. What the springs lose is
        added to the energy terms.
        """
        state, way.broke = self._state, False
        if not self.present:
            return False
        self.reserves = joint_families.reserves(state)
        if not (self.reserves < 0.0).any():
            return False
        before = elastic_energy(for_kernels(state), None)
        joint_families.hold_bonds(state, False)
        search.attempt(way.motion, way.V)
        joint_families.hold_bonds(state, True)
        way.fracture += before - elastic_energy(for_kernels(state), None)
        search.remember()
        self.reserves = joint_families.reserves(state)
        way.broke, way.step = True, AFTER * way.usual
        return True
