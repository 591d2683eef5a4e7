"""Test by displacement in the deformed geometry: a path of equilibria while actuators move blocks by a given travel.

The parameter of the path (`equilibria`) is the way of the driven displacement of the load system (`driven_loads`), of a
head without a spring: the loop finds the multiplier V that this takes (`kernels.dynamics.driven_displacement`), so that
V falls behind a peak, or as bonds break, however steeply. Equilibria know no rate.

A protocol is one such way after another, to and fro; the parameter is then the sum of the ways. Where a protocol is one
of forces, V is what it says.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from dembrick.errors import HistoryError, NotConvergedError
from dembrick.scenario.checks import present
from dembrick.scenario.controls import Control, DisplacementControl
from dembrick.scenario.model import Output
from dembrick.scenario.protocols import Protocol
from dembrick.simulation.dynamics import joint_families
from dembrick.simulation.dynamics.dead_load import FIRM_STEP, STEP, of_rounding
from dembrick.simulation.dynamics.integrator import Motion
from dembrick.simulation.dynamics.loads import Driving
from dembrick.simulation.dynamics.outcome import mechanism, moved_most, opened
from dembrick.simulation.dynamics.paths.driven_loads import Head
from dembrick.simulation.dynamics.paths.equilibria import BALANCED, FEWEST, EquilibriumPath
from dembrick.simulation.dynamics.paths.load_path import (
    CAREFUL,
    GENTLE,
    OF_START,
    LoadPathRun,
    plan_of,
    run_of,
)
from dembrick.simulation.dynamics.paths.stage_loads import slip_path
from dembrick.simulation.dynamics.time_histories import Curve
from dembrick.simulation.session import Plan, Session, Snapshot

EQUILIBRIA = 60  # of the whole travel, equally far apart; of a protocol of each way out, or half of one there and back
MOST = 6 * EQUILIBRIA  # actuators that have not come so far by then do not give way
FIRST = 2.0**-12  # of a step: that at the start and at a turn, where joints are elastic for a short way
LONGER = 2.0  # times the last step: the next
ROUNDED = 1e5  # times the rounding of a position: no step at the start is shorter
END = 1e-9  # of the travel: so close it ends
HELD = 1e-6  # of the way: points that are further from where they are to be do not move freely
BENDS = 4.0  # times as far as could be expected: there the curve bends, and is followed in shorter steps,
FLAT = 0.01  # of the greatest V: if V is off the straight line by more,
NOISE = 100.0  # and by so much more than what is out of balance where blocks rest, or a displacement than its rounding
PROTOCOL, WHOLE = "driven_path.protocol", "driven_path.whole"  # what a checkpoint has of it


class DrivenPath(EquilibriumPath):
    """Ways of actuators from equilibrium to equilibrium; the parameter is the way that their head has gone (m).

    ``way_number``: of the ways of the ``protocol``, and ``turned``: where it began, as the parameter and the
    displacement of the head (m); ``turns``: the equilibria at which ways ended, and ``V`` now; ``whole``: the slip path
    of all joints (m) and how many bonds held, before.
    """

    greatest = math.inf
    step = FIRM_STEP  # where points may not give way, forces of dashpots are felt in full

    def __init__(
        self, moving: Motion, control: Control, driving: Driving, session: Session, refine: float = 1.0,
        protocol: Protocol | None = None,
    ):  # fmt: skip
        assert driving.driven is not None and isinstance(control, DisplacementControl)
        self.loads, self.refine, self.protocol = driving.driven, refine, present(protocol)
        self.V, self.way_number, self.turned = 0.0, 0, (0.0, 0.0)
        self.turns, self.whole = np.zeros(len(self.protocol.ways)), np.zeros(2)
        ways = np.abs(self.protocol.ways)
        self.ranges = np.maximum(ways[0], 0.5 * ways)  # m: there and back is twice as far as out
        free = ~np.asarray(moving.assembly.fixed)
        dead = np.linalg.norm(moving.assembly.dead_force[free], axis=1).sum()
        self.gentle = refine * GENTLE
        self.pull = float(dead / np.asarray(moving.assembly.mass)[free].sum())  # m/s2, of the dead loads
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
    def stride(self) -> float:
        """The parameter from one equilibrium to the next (m), where nothing asks for less."""
        return self.refine * float(self.ranges[self.way_number]) / EQUILIBRIA

    def head(self, parameter):
        """The displacement of the head (m)."""
        began, at = self.turned
        return at + self.sense * (parameter - began)

    @classmethod
    def plan(cls, moving: Motion, control: Control, driving: Driving, output: Output) -> Plan:
        return plan_of(moving, control, output, EQUILIBRIA, step=cls.step)

    def driven(self, parameter: Curve) -> Driving:
        """The head follows that path; before the first equilibrium there is none."""
        if not self.path:
            return self.driving
        head = Head(lambda times: self.head(parameter(times)), np.array([self.V]))
        return replace(self.driving, multiplier=head.multiplier, head=head)

    def advance(self, driving: Driving, steps: int) -> None:
        """Steps, V found in each of them."""
        super().advance(driving, steps)
        if driving.head is not None:
            self.V = float(driving.head.V[0])

    def steps(self, begin: float, end: float) -> int:
        """So many that the acceleration of the points stays small beside that of the dead loads, as of supports."""
        fastest = self.pull * (min(self.gentle, CAREFUL * self.tolerance) if self.careful else self.gentle)
        seconds = math.sqrt(OF_START * (end - begin) / fastest) if fastest > 0.0 else 0.0
        return max(FEWEST, math.ceil(seconds / self.dt))

    def jumped(self, parameter: float) -> bool:
        """Where joints begin to slip or bonds break the curve bends: straight lines between equilibria cut it, and laws
        that depend on the way of a slip want it in steps."""
        if not self._goes_on:
            return False
        (u_0, V_0, _), (u, V, _) = self.path[-2:]
        straight = V + (V - V_0) / (u - u_0) * (self.head(parameter) - u)
        return abs(self.V - straight) > max(FLAT * max(self._greatest(), abs(self.V)), self._noise())

    def _noise(self) -> float:
        """Error of V (N), as blocks rest but for a part of the forces that there are."""
        state, assembly = self.moving.state, self.moving.assembly
        forces = np.abs(state.links.wrench[:, :3]).max(initial=0.0), np.abs(assembly.dead_force).max()
        off = NOISE * BALANCED * max(forces) + of_rounding(state)
        return float(off / np.abs(assembly.actuators.weight).max())

    def _whole(self) -> np.ndarray:
        """``whole`` now."""
        return np.array([slip_path(self.moving), float(joint_families.bonded(self.moving.state).sum())])

    @property
    def _goes_on(self) -> bool:
        """Whether the last equilibrium is not the first of its way."""
        return self.reached > self.turned[0]

    @property
    def _rounding(self) -> float:
        """Rounding of positions (m)."""
        return float(np.finfo(float).eps * np.abs(self.moving.state.bodies.position).max())

    def _greatest(self) -> float:
        """V (N), without its sign."""
        return max(abs(V) for _, V, _ in self.path)

    def close(self, parameter: float) -> float:
        """Of the ways there and back, as far as the head ever is from where it began."""
        return self.tolerance * min(parameter, float(self.ranges.max()))

    def following(self) -> float | None:
        """The next displacement of the head, until it has come as far as the travel."""
        gone = self.reached - self.turned[0]
        if gone >= self.travel * (1.0 - END):
            if self.way_number + 1 == len(self.protocol.ways):
                return None
            self._turn()
            gone = 0.0
        step = min(self.stride, max(FIRST * self.stride, ROUNDED * self._rounding))
        if self._goes_on:
            step = min(self.stride, LONGER * abs(self.path[-1][0] - self.path[-2][0]))
        return self.reached + min(step, self.travel - gone)

    def _turn(self) -> None:
        """Begin the next way where the head is."""
        self.turned = float(self.reached), float(self.head(self.reached))
        self.turns[self.way_number] = self.equilibria - 1
        self.way_number += 1

    def said(self, parameter: float) -> str:
        return f"a displacement of {self.head(parameter):.6g} m of the actuators"

    def _note(self, parameter: float, ratio: float) -> None:
        """Points that are not where they are to be cannot go there (NotConvergedError)."""
        if not self.path:
            self.whole = self._whole()
        super()._note(parameter, ratio)
        u, V, _ = self.path[-1]
        if not self.arrived(parameter):
            raise NotConvergedError(
                f"the actuators have come {u:.3g} m of {self.head(parameter):.3g} m, and carry V = {V:.6g} N: guides "
                "or supports hold the points that they push; let these go, or push elsewhere"
            )

    def arrived(self, parameter: float) -> bool:
        """Whether the points are where the head has them be."""
        return abs(self.path[-1][0] - self.head(parameter)) <= HELD * parameter + NOISE * self._rounding

    # --- checkpoints

    def _go_back(self) -> None:
        super()._go_back()
        self.V = self.path[-1][1]

    def _own(self) -> dict[str, np.ndarray]:
        protocol = np.array([self.way_number, *self.turned, *self.turns])
        return super()._own() | {PROTOCOL: protocol, WHOLE: self.whole}

    def _restore(self, snapshot: Snapshot) -> None:
        super()._restore(snapshot)
        kept = snapshot.array(PROTOCOL, np.zeros(3 + len(self.turns)))
        self.whole = snapshot.array(WHOLE, self.whole).copy()
        (number, *turned), self.turns = kept[:3].tolist(), kept[3:].copy()
        if not (number.is_integer() and 0 <= number < len(self.protocol.ways)):
            raise HistoryError(f"{snapshot.path}: this checkpoint is of no step of this run")
        self.way_number, self.turned = int(number), (turned[0], turned[1])
        self.V = self.path[-1][1]

    def finished(self) -> LoadPathRun:
        moving, start = self.moving, self.past.at_rest
        gave_way = self.collapse is not None or (self._whole() != self.whole).any() or opened(moving)
        how = mechanism(moving, start) if gave_way else "none"
        found = run_of(super().finished(), moved_most(moving, start), how)
        ended = [*self.turns[: self.way_number].astype(int).tolist()]
        if found.collapse is None:
            ended.append(self.equilibria - 1)
        return replace(found, turns=tuple(ended))


class ForcePath(DrivenPath):
    """Ways of the force of actuators from equilibrium to equilibrium; the parameter is the sum of its ways (N)."""

    step = STEP

    def steps(self, begin: float, end: float) -> int:
        """The least."""
        return FEWEST

    def driven(self, parameter: Curve) -> Driving:
        """V follows that path."""
        return replace(self.driving, multiplier=lambda times: self.head(parameter(times)))

    def jumped(self, parameter: float) -> bool:
        """Where blocks begin to slide, or snap."""
        far = float(self._away(self.at_last).max()) > BENDS * self.pace * (parameter - self.reached)
        return far and abs(float(self.head(parameter)) - self.path[-1][1]) > FLAT * self._greatest()

    def arrived(self, parameter: float) -> bool:
        """Blocks go as far as the force takes them."""
        return True

    def following(self) -> float | None:
        """The next sum of ways, until the last of them ends."""
        if self.reached - self.turned[0] >= self.travel * (1.0 - END):
            if self.way_number + 1 == len(self.protocol.ways):
                return None
            self._turn()
        return min(self.reached + self.stride, self.turned[0] + self.travel)

    def said(self, parameter: float) -> str:
        return f"V = {self.head(parameter):.6g} N"
