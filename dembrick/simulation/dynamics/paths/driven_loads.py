"""Loads that grow together with one multiplier V: actuators, driven pressures, and a load on every block.

Jacks keep their directions and stay at their points, which move with the blocks. What is work-conjugate to V is the
driven displacement, sum(weight u) / sum|weight|, with the displacement u of every point along its direction. A driven
pressure follows its faces (`kernels.dynamics.block_loads`); the displacement is counted at its centre and along its
direction of the start.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from dembrick.assembly.actuators import PRESSURE, Attached
from dembrick.simulation.dynamics.state import cross

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.kernels.dynamics.rigid_bodies import Bodies
    from dembrick.simulation.dynamics.state import MovingState


@dataclass(frozen=True, eq=False)
class DrivenLoads:
    """k loads: the points ``at`` which they act, and ``start`` (k, 3) where these are as drawn or as the stage before
    left them, from the middle of the scene (m); ``direction`` (k, 3) unit, world; ``weight`` (k,): N for V = 1;
    ``pressed`` (k,): driven pressures."""

    at: Attached
    start: np.ndarray
    direction: np.ndarray
    weight: np.ndarray
    pressed: np.ndarray

    @classmethod
    def of(cls, assembly: Assembly, state: MovingState) -> DrivenLoads:
        """The load system of an assembly."""
        table = assembly.actuators
        start = state.bodies.position[table.at.block] + table.at.arms(state.bodies.rotation)
        pressed = np.array([kind == PRESSURE for kind in table.kind], bool)
        return cls(table.at, start, table.direction, table.weight, pressed)

    @property
    def jacks(self) -> tuple[Attached, np.ndarray]:
        """Points and forces (N, for V = 1) of those that are no pressures."""
        own = ~self.pressed
        return self.at[own], self.weight[own, None] * self.direction[own]

    def displacements(self, bodies: Bodies) -> np.ndarray:
        """Of the points along their directions (k,), m, from the start of the stage."""
        away = bodies.position[self.at.block] + self.at.arms(bodies.rotation) - self.start
        return (away * self.direction).sum(axis=1)

    def velocity(self, bodies: Bodies) -> float:
        """The rate of the driven displacement (m/s)."""
        moved, turned = bodies.velocity[self.at.block], bodies.spin[self.at.block]
        arm = self.at.arms(bodies.rotation)
        return float(self._share @ (moved * self.direction + turned * cross(arm, self.direction)).sum(axis=1))

    def displacement(self, bodies: Bodies) -> float:
        """The driven displacement (m), from the start of the stage."""
        return float(self._share @ self.displacements(bodies))

    @cached_property
    def _share(self) -> np.ndarray:
        """Of each point in the driven displacement (k,)."""
        return self.weight / np.abs(self.weight).sum()
