"""Constant-rate test in the deformed geometry: a path of equilibria while actuators push blocks by a given travel.

The parameter of the path (`equilibria`) is the displacement of a head that a spring joins to the driven displacement u:
V = K (head - u), with the multiplier V of the load system (`driven_loads`) and a dashpot that damps their swing. The
spring is soft beside joints, so that V
can be held for some steps at a time, and stiff beside what structures lose as they come down, so that V falls again
behind its peak. Equilibria know no rate.

The path ends with u at the travel: an equilibrium beyond it is given up, and the head of the one at the travel found
between those of the two on either side.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from dembrick.assembly.actuators import effective_mass
from dembrick.errors import NotConvergedError
from dembrick.scenario.controls import Control, DisplacementControl
from dembrick.scenario.model import Output
from dembrick.simulation.dynamics.equilibria import BALANCED, FEWEST, EquilibriumPath, plan_of
from dembrick.simulation.dynamics.integrator import Motion
from dembrick.simulation.dynamics.load_path import LoadPathRun, run_of
from dembrick.simulation.dynamics.loads import Driving
from dembrick.simulation.dynamics.outcome import mechanism, moved_most
from dembrick.simulation.dynamics.time_histories import Curve
from dembrick.simulation.session import Plan, Session

EQUILIBRIA = 60  # of the whole travel, equally far apart
MOST = 6 * EQUILIBRIA  # actuators that have not come so far by then do not give way
STRETCH = 0.05  # of what the spring is stretched by: the head goes on by so much, or by a part of the travel
HELD = 8  # steps, for which V is held,
SWING = 0.3  # rad, of the spring's own swing in that
END = 1e-9  # of the travel: so close u comes to it, or as close as the spring knows it
SECANTS = 6  # of the attempts at that; behind them every second one halves the way that is left,
ATTEMPTS = 12  # and after so many the last equilibrium lies beyond the travel, where the blocks jump past it
SETTLES = round(4.0 * math.pi * HELD / SWING) + FEWEST  # steps: two periods of it, and what joints need


@dataclass
class Head:
    """V as a function of time: that of the spring to a head that follows ``displacement`` (m), held between looks."""

    displacement: Curve
    V: float = 0.0

    def __call__(self, times: np.ndarray) -> np.ndarray:
        """V, whatever the time."""
        return np.full(np.shape(times), self.V)


class DrivenPath(EquilibriumPath):
    """A travel of actuators from equilibrium to equilibrium; the parameter is the displacement of their head (m)."""

    greatest = math.inf

    def __init__(self, moving: Motion, control: Control, driving: Driving, session: Session, refine: float = 1.0):
        assert driving.driven is not None and isinstance(control, DisplacementControl)
        self.loads, self.refine = driving.driven, refine
        self.swing = SWING / (HELD * moving.time_step)  # rad/s
        self.stiffness = effective_mass(moving.assembly) * self.swing**2
        self.travel, self.step = control.travel, refine * control.travel / EQUILIBRIA
        self.V = 0.0
        self.attempts: list[tuple[float, float]] = []  # of the head, and how far u is past the travel
        super().__init__(moving, control, driving, session, math.ceil(MOST / refine))

    @classmethod
    def plan(cls, moving: Motion, control: Control, driving: Driving, output: Output) -> Plan:
        return plan_of(moving, control, output, EQUILIBRIA, 4 * SETTLES)

    def driven(self, parameter: Curve) -> Driving:
        """The head follows that path."""
        return replace(self.driving, multiplier=Head(parameter, self.V))

    def _begun(self) -> float:  # m, the driven displacement at the first equilibrium
        return self.path[0][0] if self.path else self.loads.displacement(self.moving.state.bodies)

    def advance(self, driving: Driving, steps: int) -> None:
        """Steps, V set to what the spring carries after every few."""
        head = driving.multiplier
        assert isinstance(head, Head)
        while steps > 0:
            some = min(steps, HELD)
            if self.path:
                time = self.moving.steps * self.dt
                bodies, at = self.moving.state.bodies, float(head.displacement(np.array([time]))[0])
                stretch = at - self.loads.displacement(bodies) + self._begun()
                head.V = self.V = self.stiffness * (stretch - 2.0 / self.swing * self.loads.velocity(bodies))
            super().advance(driving, some)
            steps -= some

    def steps(self, begin: float, end: float) -> int:
        """So many that the spring follows."""
        return SETTLES

    def _past(self, displacement: float) -> float:
        """How far (m) a driven displacement lies past the end of the travel."""
        return displacement - self._begun() - self.travel

    def belongs(self, parameter: float) -> bool:
        """Not if it lies beyond the travel, nor short of it once one did: the last one is at its end."""
        past = self._past(self.loads.displacement(self.moving.state.bodies))
        close = abs(past) <= END * self.travel + BALANCED * abs(self.V) / self.stiffness
        short = past < 0.0 and not self.attempts
        if close or short or self.failed < math.inf or len(self.attempts) == ATTEMPTS:
            return True
        self.attempts.append((parameter, past))
        return False

    def following(self) -> float | None:
        """The next displacement of the head, until the blocks have come as far as the travel."""
        past = self._past(self.path[-1][0])
        if past >= -END * self.travel - BALANCED * abs(self.V) / self.stiffness:
            return None
        if self.equilibria > self.way:
            raise NotConvergedError(
                f"the actuators have come {self.travel + past:.3g} m of their travel of {self.travel:.3g} m, and carry "
                f"V = {self.V:.6g} N: nothing gives way; shorten control.travel"
            )
        if self.attempts:
            return self._at_the_end(past)
        return self.reached + max(self.step, STRETCH * self.refine * (self.reached - self.travel - past))

    def _at_the_end(self, past: float) -> float:
        """The displacement of the head at which u is about at the travel; at the last equilibrium it was ``past``."""
        short = max([(self.reached, past), *(tried for tried in self.attempts if tried[1] < 0.0)])
        beyond = min(tried for tried in self.attempts if tried[1] > 0.0)
        if len(self.attempts) == ATTEMPTS:
            return beyond[0]
        halves = len(self.attempts) > SECANTS and len(self.attempts) % 2
        share = 0.5 if halves else short[1] / (short[1] - beyond[1])
        return short[0] + share * (beyond[0] - short[0])

    def said(self, parameter: float) -> str:
        return f"a displacement of {parameter:.6g} m of the actuators"

    def finished(self) -> LoadPathRun:
        moving, start = self.moving, self.past.at_rest
        return run_of(super().finished(), moved_most(moving, start), mechanism(moving, start))
