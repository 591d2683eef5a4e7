"""Loads that grow together with one multiplier V: actuators, driven pressures, and a load on every block.

Jacks keep their directions and stay at their points, which move with the blocks. Work-conjugate to V is the driven
displacement, sum(weight u) / sum|weight|, with the displacement u of every point along its direction. A driven
pressure follows its faces (`kernels.dynamics.block_loads`); its displacement is measured at its centre along its
initial direction. V is a function of time, or the force that moves the driven displacement as prescribed (`Head`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from dembrick.assembly.actuators import PRESSURE, Attached
from dembrick.kernels.dynamics import driven_displacement

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.kernels.dynamics.block_loads import PressedFaces
    from dembrick.kernels.dynamics.rigid_bodies import Bodies
    from dembrick.simulation.dynamics.state import MovingState
    from dembrick.simulation.dynamics.time_histories import Curve


@dataclass(frozen=True, eq=False)
class DrivenLoads:
    """k loads: the points ``at`` which they act and their positions ``start`` (k, 3) before V grows, from the middle of
    the scene (m); ``direction`` (k, 3) unit, world; ``weight`` (k,): N for V = 1; ``pressed`` (k,): whether they are
    driven pressures; ``guided`` (g,): the blocks that are guided."""

    at: Attached
    start: np.ndarray
    direction: np.ndarray
    weight: np.ndarray
    pressed: np.ndarray
    guided: np.ndarray

    @classmethod
    def of(cls, assembly: Assembly, state: MovingState) -> DrivenLoads:
        """The load system of an assembly."""
        table = assembly.actuators
        pressed = np.array([kind == PRESSURE for kind in table.kind], bool)
        start = np.zeros((len(table.at), 3))
        loads = cls(table.at, start, table.direction, table.weight, pressed, state.bodies.guided)
        loads.start_from(state.bodies)
        return loads

    def start_from(self, bodies: Bodies) -> None:
        """Measure displacements from the present positions of the blocks."""
        self.start[:] = self._points(bodies)

    @property
    def jacks(self) -> tuple[Attached, np.ndarray]:
        """Points and forces (N, for V = 1) of all loads but the pressures."""
        own = ~self.pressed
        return self.at[own], self.weight[own, None] * self.direction[own]

    def guide_of(self, blocks: np.ndarray) -> np.ndarray:
        """Which of the guided blocks each of ``blocks`` (b,) is, -1 for none (b,)."""
        number = {block: g for g, block in enumerate(self.guided.tolist())}
        return np.array([number.get(block, -1) for block in blocks.tolist()], np.int64)

    def displacements(self, bodies: Bodies) -> np.ndarray:
        """Displacements of the points along their directions (k,), m."""
        return ((self._points(bodies) - self.start) * self.direction).sum(axis=1)

    def _points(self, bodies: Bodies) -> np.ndarray:
        return bodies.position[self.at.block] + self.at.arms(bodies.rotation)

    def displacement(self, bodies: Bodies) -> float:
        """The driven displacement (m)."""
        return float(self._share @ self.displacements(bodies))

    @cached_property
    def _share(self) -> np.ndarray:
        """Weight of each point in the driven displacement (k,)."""
        return self.weight / np.abs(self.weight).sum()

    @property
    def along(self) -> np.ndarray:
        """Directions (k, 3), each times the share of its point in the driven displacement."""
        return self._share[:, None] * self.direction


@dataclass(frozen=True, eq=False)
class Head:
    """Actuator head that prescribes the driven displacement of a load system as the function of time ``way`` (m); the
    loop finds the ``V`` (1,) that this takes."""

    way: Curve
    V: np.ndarray = field(default_factory=lambda: np.zeros(1))

    def multiplier(self, times: np.ndarray) -> np.ndarray:
        """The present V, constant over the times."""
        return np.full(np.shape(times), self.V[0])

    def at(self, times: np.ndarray, loads: DrivenLoads, faces: PressedFaces) -> driven_displacement.Head:
        """The head in the form that the loop needs, for the steps at ``times`` (s,)."""
        where, (jacks, force) = loads.at, loads.jacks
        body = np.unique(np.concatenate([where.block, faces.block[faces.driven]]))
        of_face = np.where(faces.driven, np.searchsorted(body, faces.block), -1)
        point, jack = (np.searchsorted(body, points) for points in (where.block, jacks.block))
        return driven_displacement.Head(
            body, loads.guide_of(body), point, jack, of_face, where.lever, loads.start, loads.along, force,
            self.way(times), self.V, *np.zeros((3, len(body), 6)),
        )  # fmt: skip


NONE = np.zeros(0, np.int64)
NO_HEAD = driven_displacement.Head(
    *(NONE,) * 5, *np.zeros((4, 0, 3)), way=np.zeros(0), V=np.zeros(1),
    **{name: np.zeros((0, 6)) for name in ("unit", "along", "total")},
)  # fmt: skip
