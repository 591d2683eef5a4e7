"""Displacement control of a pushover in real time: every block is pushed by the same share of its weight.

The load acts on all free blocks at their centroids: the load factor V times their weight, along a direction.
Work-conjugate to V is their mean displacement u along it, weighted by mass. The head of the controller moves at a
constant rate, a spring connects it to the blocks, and a dashpot damps their mean motion, so that V rises to the peak
and falls beyond it as the resistance of the blocks decreases.

The spring is soft: a load factor of 1 stretches it by the displacement D of the control. Its frequency sqrt(g / D)
is far below that of the joints, so V can be constant for many steps at a time; a stiffer spring would only add an
inertia effect (rate times frequency over g) to the peak.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from dembrick.errors import ScenarioError
from dembrick.simulation.dynamics.loads import Driving

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.scenario.controls import PushoverControl

HELD = 0.05  # rad of the controller's own oscillation during which V is constant
STRONGEST = 10.0  # greatest load factor: beyond it a pushover gives up


@dataclass
class PushController:
    """Drives the mean displacement (m) along ``direction`` (3,) at ``rate`` (m/s); ``stretch``: m for V = 1.

    ``share`` (n,): weight of each block in the mean. ``steps``: number of steps of ``time_step`` (s) during which V is
    constant. ``present``: V; ``peak``: its greatest value so far and u (m) then.
    """

    direction: np.ndarray
    rate: float
    stretch: float
    share: np.ndarray
    weight: float  # m/s2, what a mass weighs
    steps: int
    time_step: float
    present: np.ndarray = field(default_factory=lambda: np.zeros(1))
    peak: np.ndarray = field(default_factory=lambda: np.zeros(2))

    @property
    def longest(self) -> int:
        """Steps after which V would be ``STRONGEST`` even for blocks that had not moved."""
        return math.ceil((1.0 + STRONGEST) * self.stretch / self.rate / self.time_step)

    def mean(self, vectors: np.ndarray) -> float:
        """Mean of displacements or velocities (n, 3) of the blocks, along the direction."""
        return float(self.share @ (vectors @ self.direction))

    def press(self, step: int, displacement: np.ndarray, velocity: np.ndarray) -> None:
        """Set V from the ``displacement`` and ``velocity`` (n, 3) of the blocks at the beginning of ``step``."""
        swing = math.sqrt(self.weight / self.stretch)  # rad/s
        u = self.mean(displacement)
        behind = self.rate * step * self.time_step - u - 2.0 / swing * self.mean(velocity)
        self.present[0] = behind / self.stretch
        if self.present[0] > self.peak[0]:
            self.peak[:] = self.present[0], u

    def pushing(self, driving: Driving) -> Driving:
        """Loads and supports of the run at the present V, as an inclined gravity."""
        return replace(driving, gravity=driving.gravity + self.present[0] * self.weight * self.direction)


def controller_of(control: PushoverControl, assembly: Assembly, gravity, time_step: float) -> PushController:
    """The controller of a push; ScenarioError without gravity."""
    weight = float(np.linalg.norm(gravity))
    if not weight > 0.0:
        raise ScenarioError("gravity is zero, but a pushover load is a share of the weight: give gravity")
    mass = np.where(assembly.fixed, 0.0, assembly.mass)
    swing = math.sqrt(weight / control.displacement)
    return PushController(
        direction=np.array(control.direction, float),
        rate=control.rate,
        stretch=control.displacement,
        share=mass / mass.sum(),
        weight=weight,
        steps=max(1, int(HELD / (swing * time_step))),
        time_step=time_step,
    )
