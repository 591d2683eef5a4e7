"""Bounds of the limit load from a single equilibrium of a path and its out-of-balance."""

from __future__ import annotations

import numpy as np

from dembrick.kernels.statics.load_bounds import Certificate, instant_upper, strict_bounds
from dembrick.simulation.statics.newton import Equilibria
from dembrick.simulation.statics.state import for_kernels

NOTHING = 1e-6  # of the dead loads: a limit load below it is zero
LEAST_BALANCED = 1e-9
CORRECTIONS = 2.0  # times the change of V by one more Newton step: another estimate of its error, if less
HIDDEN = 0.1  # of the tolerance: error of V by the out-of-balance above which equilibria are found more accurately


class InstantBounds:
    """Bounds of the limit load from the equilibrium that ``search`` has found. ``weight``: of all actuators; ``dead``
    (N): V whose loads equal the sum of all dead loads."""

    def __init__(self, search: Equilibria, certificate: Certificate, weight: float, dead: float):
        self._search, self._certificate, self._weight, self._dead = search, certificate, weight, dead

    def bounds(self, V: float, moved: float, hidden: float | None) -> tuple[float, float]:
        """Bounds of the limit load from the present equilibrium, by the motion of the last step, on which V does work
        over the distance ``moved`` (m).

        Strict if the certificate is; else for the present normal forces, widened by the error ``hidden`` of V (N).
        """
        state = for_kernels(self._search.state)
        if self._certificate.strict:
            lower, upper = strict_bounds(self._certificate, state, V)
            return float(lower), float(upper)
        upper = float(instant_upper(state, V, moved, 1.0))
        if hidden is None:  # a drag carried part of the load
            unbalanced = self.held_up(V)
            return V / (1.0 + unbalanced), max(V, upper) * (1.0 + unbalanced)
        return V - hidden, max(V, upper) + hidden

    def held_up(self, V: float) -> float:
        """Ratio of the out-of-balance left by a drag to the forces of its block, or to the load if that is less."""
        search, load = self._search, max(abs(V), NOTHING * self._dead) * self._weight
        greatest = float(search.balance.sizes(search.trial.residual[search.rows]).max())
        return max(search.out_of_balance(), greatest / load)

    def hidden(self, V: float, moved: float, closest: float) -> float | None:
        """Error of V (N) from the out-of-balance, by the motion of the last step. If it is large, the tolerance of the
        search is tightened, down to ``closest``. None if the balance is not met, as a drag carried part of the load.

        The error is bounded by the work of the out-of-balance forces on the motion of their blocks. If no closer
        balance is possible, as in high towers, one more Newton step gives an estimate. A block that has hardly moved
        yet may be the next to move: what any block lacks of its own forces, V may lack too, but for rounding.
        """
        search, hidden = self._search, 0.0
        blocks, free = search.state.blocks, search.free
        left = search.out_of_balance()
        if left > search.balanced and not search.is_balanced():
            return None
        if moved <= 0.0:
            return 0.0
        for force, way in ((blocks.force, blocks.velocity), (blocks.torque, blocks.spin)):
            work = np.linalg.norm(force[free], axis=1) @ np.linalg.norm(way[free], axis=1)
            hidden += float(work) / moved
        if hidden > HIDDEN * self._certificate.tolerance * V:
            search.balanced = max(closest, 0.1 * search.balanced)
            if closest > LEAST_BALANCED:
                hidden = min(hidden, CORRECTIONS * abs(search.correction(V)))
        if left * abs(V) <= hidden:
            return hidden
        return max(hidden, search.balance.beyond_rounding(search.trial.residual[search.rows]) * abs(V))
