"""Constant-rate test in the deformed geometry: a path of equilibria while actuators push blocks by a given travel.

The parameter of the path (`equilibria`) is the displacement of a head that a spring joins to the driven displacement u:
V = K (head - u), with the multiplier V of the load system (`driven_loads`) and a dashpot that damps their swing. The
spring is soft beside joints, so that V can be held for some steps at a time, and stiff beside what structures lose as
they come down, so that V falls again behind its peak. The loop finds V. Equilibria know no rate.

The path ends with u at the travel: an equilibrium beyond it is given up, and the head of the one at the travel found
between those of the two on either side. A protocol is one such way after another, to and fro; the parameter is then the
sum of the ways of the head. Where a protocol is one of forces there is no spring, and V is what it says.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from dembrick.assembly.actuators import effective_mass
from dembrick.errors import HistoryError, NotConvergedError
from dembrick.scenario.checks import present
from dembrick.scenario.controls import Control, DisplacementControl
from dembrick.scenario.model import Output
from dembrick.scenario.protocols import Protocol
from dembrick.simulation.dynamics.integrator import Motion
from dembrick.simulation.dynamics.loads import Driving
from dembrick.simulation.dynamics.outcome import mechanism, moved_most
from dembrick.simulation.dynamics.paths.driven_loads import Head
from dembrick.simulation.dynamics.paths.equilibria import BALANCED, FEWEST, EquilibriumPath
from dembrick.simulation.dynamics.paths.load_path import LoadPathRun, plan_of, run_of
from dembrick.simulation.dynamics.time_histories import Curve
from dembrick.simulation.session import Plan, Session, Snapshot

EQUILIBRIA = 60  # of the whole travel, equally far apart; of a protocol of each way out, or half of one there and back
MOST = 6 * EQUILIBRIA  # actuators that have not come so far by then do not give way
STRETCH = 0.05  # of what the spring is stretched by: the head goes on by so much, or by a part of the travel
UNLOADING = 0.5  # of the greatest stretch so far, which counts where the spring is relieved
HELD = 8  # steps, for which V is held,
SWING = 0.3  # rad, of the spring's own swing in that
END = 1e-9  # of the travel: so close u comes to it, or as close as the spring knows it
SECANTS = 1  # of the attempts at that; behind it every second one halves the way that is left,
ATTEMPTS = 60  # and after so many the last equilibrium lies beyond,
JUMPS = 100.0  # as where blocks move so many times as far as the head: they jump past it
MISSED = 1e-3  # of the travel: a turning point, or an end, that is missed by more is said
BENDS = 4.0  # times as far as could be expected: there the curve bends, and is followed in shorter steps,
FLAT = 0.01  # of the greatest V: if V changes by more
PROTOCOL = "driven_path.protocol"  # what a checkpoint has of it
SETTLES = round(4.0 * math.pi * HELD / SWING) + FEWEST  # steps: two periods of it, and what joints need


class DrivenPath(EquilibriumPath):
    """Ways of actuators from equilibrium to equilibrium; the parameter is the way that their head has gone (m).

    ``way_number``: of the ways of the ``protocol``, and ``turned``: where it began, as the parameter and the
    displacement of the head (m); ``turns``: the equilibria at which ways ended, and ``V`` now.
    """

    greatest = math.inf

    def __init__(
        self, moving: Motion, control: Control, driving: Driving, session: Session, refine: float = 1.0,
        protocol: Protocol | None = None,
    ):  # fmt: skip
        assert driving.driven is not None and isinstance(control, DisplacementControl)
        self.loads, self.refine, self.protocol = driving.driven, refine, present(protocol)
        self.swing = SWING / (HELD * moving.time_step)  # rad/s
        self.stiffness = effective_mass(moving.assembly) * self.swing**2
        self.V, self.way_number, self.turned = 0.0, 0, (0.0, 0.0)
        self.turns = np.zeros(len(self.protocol.ways))
        self.attempts: list[tuple[float, float]] = []  # the parameter, and how far u is past the end of the way
        ways = np.abs(self.protocol.ways)
        self.ranges = np.maximum(ways[0], 0.5 * ways)  # m: there and back is twice as far as out
        super().__init__(moving, control, driving, session, math.ceil(MOST * (ways / self.ranges).sum() / refine))

    @property
    def travel(self) -> float:
        """The way of now (m), without its sign."""
        return abs(float(self.protocol.ways[self.way_number]))

    @property
    def sense(self) -> float:
        """1 if the head goes forward on the way of now, -1 if it goes back."""
        return math.copysign(1.0, float(self.protocol.ways[self.way_number]))

    @property
    def step(self) -> float:
        """The parameter from one equilibrium to the next (m), where nothing asks for more."""
        return self.refine * float(self.ranges[self.way_number]) / EQUILIBRIA

    def head(self, parameter):
        """The displacement of the head (m)."""
        began, at = self.turned
        return at + self.sense * (parameter - began)

    @classmethod
    def plan(cls, moving: Motion, control: Control, driving: Driving, output: Output) -> Plan:
        return plan_of(moving, control, output, EQUILIBRIA, 4 * SETTLES)

    def driven(self, parameter: Curve) -> Driving:
        """The head follows that path; before the first equilibrium there is none."""
        if not self.path:
            return self.driving
        dashpot = 2.0 * self.stiffness / self.swing
        head = Head(lambda times: self.head(parameter(times)), self.stiffness, dashpot, HELD)
        head.V[0] = self.V
        return replace(self.driving, multiplier=head.multiplier, head=head)

    def advance(self, driving: Driving, steps: int) -> None:
        """Steps, V found at the first of them, and after every few."""
        head = driving.head
        if head is not None:
            head.steps[0] = 0
        super().advance(driving, steps)
        if head is not None:
            self.V = float(head.V[0])

    def steps(self, begin: float, end: float) -> int:
        """So many that the spring follows."""
        return SETTLES

    def _past(self, displacement: float) -> float:
        """How far (m) a driven displacement lies past the end of the way, in its sense."""
        return self.sense * (displacement - float(self.protocol.turns[self.way_number + 1]))

    def belongs(self, parameter: float) -> bool:
        """Not if it lies beyond the travel, nor short of it once one did: the last one is at its end."""
        past = self._past(self.loads.displacement(self.moving.state.bodies))
        close = abs(past) <= END * self.travel + BALANCED * abs(self.V) / self.stiffness
        if close or (past < 0.0 and not self.attempts) or self.failed < math.inf:
            return True
        short = self._short()
        jumps = past > 0.0 and past - short[1] > JUMPS * (parameter - short[0])
        if jumps or len(self.attempts) >= ATTEMPTS:
            self.attempts = []
            if past > MISSED * self.travel and self.session.report is not None:
                end = float(self.protocol.turns[self.way_number + 1])
                self.session.report(
                    f"the blocks jump past a displacement of {end:.6g} m, where they were to turn or end: the nearest "
                    f"equilibrium behind it is {past:.3g} m further"
                )
            return True
        self.attempts.append((parameter, past))
        return False

    def _short(self) -> tuple[float, float]:
        """The furthest parameter that is known to lie short of the end of the way, and how far that is past it (m)."""
        at_last = self.reached, self._past(self.path[-1][0])
        return max([at_last, *(tried for tried in self.attempts if tried[1] < 0.0)])

    def jumped(self, parameter: float) -> bool:
        """Where joints begin to slip, or blocks snap, the curve bends: straight lines between equilibria cut it, and
        laws that depend on the way of a slip want it in steps."""
        u, V, _ = self.path[-1]
        far = float(self._away(self.at_last).max()) > BENDS * self.pace * (parameter - self.reached)
        rises = abs(self._load(parameter) - V) > FLAT * self._greatest()
        slips = abs(self.loads.displacement(self.moving.state.bodies) - u) > BENDS * self._stride
        return far and (rises or slips) and not self.attempts  # the end of a way is looked for by itself

    @property
    def _stride(self) -> float:
        """How far blocks go from one equilibrium to the next (m)."""
        return self.step

    def _greatest(self) -> float:
        """V (N), without its sign."""
        return max(abs(V) for _, V, _ in self.path)

    def close(self, parameter: float) -> float:
        """Of the ways there and back, as far as the head ever is from where it began."""
        return self.tolerance * min(parameter, self._greatest() / self.stiffness + float(self.ranges.max()))

    def _load(self, parameter: float) -> float:
        """V where the parameter is now (N)."""
        return self.V

    def following(self) -> float | None:
        """The next displacement of the head, until the blocks have come as far as the travel."""
        past = self._past(self.path[-1][0])
        if past >= -END * self.travel - BALANCED * abs(self.V) / self.stiffness:
            if self.way_number + 1 == len(self.protocol.ways):
                return None
            self._turn()
            past = self._past(self.path[-1][0])
        if self.equilibria > self.way:
            raise NotConvergedError(
                f"the actuators have come {self.travel + past:.3g} m of their travel of {self.travel:.3g} m, and carry "
                f"V = {self.V:.6g} N: nothing gives way; shorten control.travel"
            )
        if self.attempts:
            return self._at_the_end()
        stretch = abs(self.head(self.reached) - self.path[-1][0])
        if self.way_number:  # a load that is taken back passes zero
            stretch = max(stretch, UNLOADING * self._greatest() / self.stiffness)
        step = STRETCH * self.refine * stretch
        if len(self.path) > 2:  # where joints slip the head takes the blocks along, as far as it goes itself
            (u_0, V_0, _), (u_1, V_1, _) = self.path[-2:]
            along = abs(u_1 - u_0) / max(abs(u_1 - u_0 + (V_1 - V_0) / self.stiffness), 1e-300)
            left = self.refine * abs(past) / EQUILIBRIA  # more than the step where blocks have jumped past the end
            step = min(step, max(self.step, left) / max(along, 1e-300))
        return self.reached + max(self.step, step)

    def _turn(self) -> None:
        """Begin the next way where the head is."""
        self.turned = float(self.reached), float(self.head(self.reached))
        self.turns[self.way_number] = self.equilibria - 1
        self.way_number += 1
        self.attempts = []

    def _at_the_end(self) -> float:
        """The displacement of the head at which u is about at the travel."""
        short, beyond = self._short(), min(tried for tried in self.attempts if tried[1] > 0.0)
        if len(self.attempts) >= ATTEMPTS:
            return beyond[0]
        halves = len(self.attempts) > SECANTS and len(self.attempts) % 2
        share = 0.5 if halves else short[1] / (short[1] - beyond[1])
        return short[0] + share * (beyond[0] - short[0])

    def said(self, parameter: float) -> str:
        return f"a displacement of {self.head(parameter):.6g} m of the actuators"

    # --- checkpoints

    def _own(self) -> dict[str, np.ndarray]:
        return super()._own() | {PROTOCOL: np.array([self.way_number, *self.turned, *self.turns])}

    def _restore(self, snapshot: Snapshot) -> None:
        super()._restore(snapshot)
        kept = snapshot.array(PROTOCOL, np.zeros(3 + len(self.turns)))
        (number, *turned), self.turns = kept[:3].tolist(), kept[3:].copy()
        if not (number.is_integer() and 0 <= number < len(self.protocol.ways)):
            raise HistoryError(f"{snapshot.path}: this checkpoint is of no step of this run")
        self.way_number, self.turned = int(number), (turned[0], turned[1])

    def finished(self) -> LoadPathRun:
        moving, start = self.moving, self.past.at_rest
        found = run_of(super().finished(), moved_most(moving, start), mechanism(moving, start))
        ended = [*self.turns[: self.way_number].astype(int).tolist()]
        if found.collapse is None:
            ended.append(self.equilibria - 1)
        return replace(found, turns=tuple(ended))


class ForcePath(DrivenPath):
    """Ways of the force of actuators from equilibrium to equilibrium; the parameter is the sum of its ways (N)."""

    _stride = math.inf  # blocks go as far as the force takes them

    def driven(self, parameter: Curve) -> Driving:
        """V follows that path."""
        return replace(self.driving, multiplier=lambda times: self.head(parameter(times)))

    def _load(self, parameter: float) -> float:
        return float(self.head(parameter))

    def belongs(self, parameter: float) -> bool:
        """All do."""
        return True

    def close(self, parameter: float) -> float:
        """Of the ways there and back, as far as the force ever is from where it began."""
        return self.tolerance * min(parameter, float(self.ranges.max()))

    def following(self) -> float | None:
        """The next sum of ways, until the last of them ends."""
        if self.reached - self.turned[0] >= self.travel * (1.0 - END):
            if self.way_number + 1 == len(self.protocol.ways):
                return None
            self._turn()
        return min(self.reached + self.step, self.turned[0] + self.travel)

    def said(self, parameter: float) -> str:
        return f"V = {self.head(parameter):.6g} N"
