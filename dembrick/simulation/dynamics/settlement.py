"""Quasi-static settlement: a path of equilibria in the deformed geometry while supports move.

The parameter of the path (`equilibria`) is the share of their way that the supports have gone, up to 1.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np

from dembrick.scenario.model import Output
from dembrick.scenario.regimes import Control
from dembrick.simulation.dynamics.dead_load import STEP
from dembrick.simulation.dynamics.equilibria import FEWEST, EquilibriumPath, plan_of
from dembrick.simulation.dynamics.integrator import Motion
from dembrick.simulation.dynamics.loads import Driving
from dembrick.simulation.dynamics.time_histories import Curve
from dembrick.simulation.session import Plan, Session

EQUILIBRIA = 80  # of the whole way, equally far apart
HALVINGS = 7  # of the first of these steps: the reaction changes most when the supports begin to move
WITHIN = 0.05  # of the smallest block: the longest step
GENTLE = 0.005  # of gravity: the greatest acceleration of the supports; at 0.02 hinges of stiff joints rattle open,
CAREFUL = 0.2  # of the tolerance: the same in gravities, once blocks have come down
OF_START = 12.0  # of distance over time squared


def shares(longest: float, refine: float = 1.0) -> list[float]:
    """Shares of the way at which equilibria are looked for, none further than ``longest`` from the last."""
    count = math.ceil(max(EQUILIBRIA / refine, 1.0 / longest))
    first = [2.0**-k / count for k in range(HALVINGS, 0, -1)]
    return first + [(k + 1) / count for k in range(count)]


class Settlement(EquilibriumPath):
    """The way of the supports, from equilibrium to equilibrium; the parameter is the share that they have gone."""

    def __init__(self, moving: Motion, control: Control, driving: Driving, session: Session, refine: float = 1.0):
        self.supports = driving.supports
        self.shares = shares(WITHIN * moving.smallest / self.supports.length, refine)
        super().__init__(moving, control, driving, session, len(self.shares))
        self.gentle = refine * GENTLE
        self.gravity = float(np.linalg.norm(moving.assembly.gravity))

    @classmethod
    def plan(cls, moving: Motion, control: Control, driving: Driving, output: Output) -> Plan:
        """Plan with a rough count of steps: as many as the supports move for, and half as many for rest."""
        length, gravity = driving.supports.length, float(np.linalg.norm(moving.assembly.gravity))
        way = shares(WITHIN * moving.smallest / length)
        fastest = OF_START * length / (GENTLE * gravity) if gravity > 0.0 else 0.0
        seconds = (math.sqrt(fastest * (end - begin)) for begin, end in pairwise([0.0, *way]))
        moves = sum(max(FEWEST, lasts / (STEP * moving.time_step)) for lasts in seconds)
        return plan_of(moving, control, output, len(way) + 1, 1.5 * moves / len(way))

    def driven(self, parameter: Curve) -> Driving:
        """The supports have gone that share of their way."""
        return replace(self.driving, share=parameter)

    def steps(self, begin: float, end: float) -> int:
        """So many that the supports' acceleration stays small beside gravity."""
        distance = (end - begin) * self.supports.length
        gentle = min(self.gentle, CAREFUL * self.control.tolerance) if self.careful else self.gentle
        seconds = math.sqrt(OF_START * distance / (gentle * self.gravity)) if self.gravity > 0.0 else 0.0
        return max(FEWEST, math.ceil(seconds / self.dt))

    def following(self) -> float | None:
        return next((share for share in self.shares if share > self.reached * (1.0 + 1e-12)), None)

    def said(self, parameter: float) -> str:
        return f"a settlement of {parameter * self.supports.length:.6g} m"

    @property
    def slow(self) -> str:
        return f"{super().slow}, or take quasi_static = false"

    def come_down(self, before: np.ndarray, blocks: np.ndarray) -> dict:
        """The collapse, with its settlement (m)."""
        low, high = self.reached * self.supports.length, self.falls * self.supports.length
        return super().come_down(before, blocks) | {"settlement": 0.5 * (low + high), "settlement_range": [low, high]}
