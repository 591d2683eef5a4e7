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

from dembrick.simulation.dynamics.state import cross

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.kernels.dynamics.rigid_bodies import Bodies
    from dembrick.simulation.dynamics.state import MovingState


@dataclass(frozen=True, eq=False)
class DrivenLoads:
    """k loads: ``block`` (k,), ``lever`` (k, 3) from the centroid in body axes (m), ``start`` (k, 3) the points as
    drawn or as the stage before left them, from the middle of the scene (m), ``direction`` (k, 3) unit, world, and
    ``weight`` (k,): N for V = 1."""

    block: np.ndarray
    lever: np.ndarray
    start: np.ndarray
    direction: np.ndarray
    weight: np.ndarray
    pressed: np.ndarray

    @classmethod
    def of(cls, assembly: Assembly, state: MovingState) -> DrivenLoads:
        """The load system of an assembly."""
        table = assembly.actuators
        lever = np.einsum("kji,kj->ki", assembly.rotation[table.block], table.arm)
        bodies = state.bodies
        start = bodies.position[table.block] + np.einsum("kij,kj->ki", bodies.rotation[table.block], lever)
        return cls(table.block, lever, start, table.direction, table.weight, table.pressed)

    @property
    def jacks(self) -> dict[str, np.ndarray]:
        """Block, lever and force (N, for V = 1) of those that are no pressures, as loads have them."""
        own = ~self.pressed
        force = self.weight[own, None] * self.direction[own]
        return {"block": self.block[own], "lever": self.lever[own], "force": force}

    def displacements(self, bodies: Bodies) -> np.ndarray:
        """Of the points along their directions (k,), m, from the start of the stage."""
        away = bodies.position[self.block] + self._arm(bodies) - self.start
        return (away * self.direction).sum(axis=1)

    def velocity(self, bodies: Bodies) -> float:
        """The rate of the driven displacement (m/s)."""
        moved, turned = bodies.velocity[self.block], bodies.spin[self.block]
        return float(
            self._share @ (moved * self.direction + turned * cross(self._arm(bodies), self.direction)).sum(axis=1)
        )

    def displacement(self, bodies: Bodies) -> float:
        """The driven displacement (m), from the start of the stage."""
        return float(self._share @ self.displacements(bodies))

    @cached_property
    def _share(self) -> np.ndarray:
        """Of each point in the driven displacement (k,)."""
        return self.weight / np.abs(self.weight).sum()

    def _arm(self, bodies: Bodies) -> np.ndarray:
        """From the centroids to the points (k, 3), world."""
        return (bodies.rotation[self.block] @ self.lever[:, :, None])[:, :, 0]
