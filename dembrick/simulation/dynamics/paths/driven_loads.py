"""Loads that grow together with one multiplier V: actuators, driven pressures, and a load on every block.

Jacks keep their directions and stay at their points, which move with the blocks. What is work-conjugate to V is the
driven displacement, sum(weight u) / sum|weight|, with the displacement u of every point along its direction. A driven
pressure follows its faces (`kernels.dynamics.block_loads`); the displacement is counted at its centre and along its
direction of the start. V is a function of time, or that of a spring to a head which moves (`Head`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from dembrick.assembly.actuators import PRESSURE, Attached
from dembrick.kernels.dynamics import block_loads

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.kernels.dynamics.rigid_bodies import Bodies
    from dembrick.simulation.dynamics.state import MovingState
    from dembrick.simulation.dynamics.time_histories import Curve


@dataclass(frozen=True, eq=False)
class DrivenLoads:
    """k loads: the points ``at`` which they act, and ``start`` (k, 3) where these are before V grows, from the middle
    of the scene (m); ``direction`` (k, 3) unit, world; ``weight`` (k,): N for V = 1; ``pressed`` (k,): driven
    pressures."""

    at: Attached
    start: np.ndarray
    direction: np.ndarray
    weight: np.ndarray
    pressed: np.ndarray

    @classmethod
    def of(cls, assembly: Assembly, state: MovingState) -> DrivenLoads:
        """The load system of an assembly."""
        table = assembly.actuators
        pressed = np.array([kind == PRESSURE for kind in table.kind], bool)
        loads = cls(table.at, np.zeros((len(table.at), 3)), table.direction, table.weight, pressed)
        loads.start_from(state.bodies)
        return loads

    def start_from(self, bodies: Bodies) -> None:
        """Count displacements from where the blocks are now."""
        self.start[:] = self._points(bodies)

    @property
    def jacks(self) -> tuple[Attached, np.ndarray]:
        """Points and forces (N, for V = 1) of those that are no pressures."""
        own = ~self.pressed
        return self.at[own], self.weight[own, None] * self.direction[own]

    def displacements(self, bodies: Bodies) -> np.ndarray:
        """Of the points along their directions (k,), m."""
        return ((self._points(bodies) - self.start) * self.direction).sum(axis=1)

    def _points(self, bodies: Bodies) -> np.ndarray:
        return bodies.position[self.at.block] + self.at.arms(bodies.rotation)

    def displacement(self, bodies: Bodies) -> float:
        """The driven displacement (m)."""
        return float(self._share @ self.displacements(bodies))

    @cached_property
    def _share(self) -> np.ndarray:
        """Of each point in the driven displacement (k,)."""
        return self.weight / np.abs(self.weight).sum()

    @property
    def along(self) -> np.ndarray:
        """Directions (k, 3), each times the share of its point in the driven displacement."""
        return self._share[:, None] * self.direction


@dataclass(frozen=True, eq=False)
class Head:
    """A head that a spring of ``stiffness`` (N/m) and a ``dashpot`` (N s/m) join to the driven displacement of a load
    system, and its displacement ``way`` (m), a function of time; V is ``held`` for so many steps at a time. ``V`` (1,)
    and ``steps`` (1,) are what the loop makes of them."""

    way: Curve
    stiffness: float
    dashpot: float
    held: int
    V: np.ndarray = field(default_factory=lambda: np.zeros(1))
    steps: np.ndarray = field(default_factory=lambda: np.zeros(1, np.int64))

    def multiplier(self, times: np.ndarray) -> np.ndarray:
        """V of now, whatever the time."""
        return np.full(np.shape(times), self.V[0])

    def at(self, times: np.ndarray, loads: DrivenLoads) -> block_loads.Head:
        """The head as the loop takes it, for the steps at ``times`` (s,)."""
        where, spring = loads.at, np.array([self.stiffness, self.dashpot])
        _, force = loads.jacks
        ends = where.block, where.lever, loads.start, loads.along, force
        return block_loads.Head(*ends, spring, self.held, self.way(times), self.V, self.steps)


NO_HEAD = block_loads.Head(
    np.zeros(0, np.int64), *(np.zeros((0, 3)) for _ in range(4)), np.zeros(2), 1, np.zeros(0), np.zeros(1),
    np.zeros(1, np.int64),
)  # fmt: skip
