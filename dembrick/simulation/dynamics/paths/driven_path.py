"""Displacement control in the deformed geometry: a path of equilibria while actuators move blocks by a given travel.

The parameter of the path (`equilibria`) is the driven displacement of the load system (`driven_loads`), imposed by a
rigid actuator head: the loop finds the multiplier V that this takes (`kernels.dynamics.driven_displacement`), so
V may fall beyond a peak, or as bonds break, however steeply. Equilibria do not depend on a rate.

A protocol is a sequence of such segments, back and forth; the parameter is then the distance travelled over all
segments. A protocol of forces prescribes V itself.
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
from dembrick.simulation import expected_cost
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
from dembrick.simulation.dynamics.state import seen
from dembrick.simulation.dynamics.time_histories import Curve
from dembrick.simulation.session import Plan, Session, Snapshot

EQUILIBRIA = 60  # equally spaced over the travel; over each segment out of a protocol, or half of one there and back
MOST = 6 * EQUILIBRIA  # equilibria that there is room for, over the travel
FIRST = 2.0**-12  # of a step: the first one at the start and at a reversal, where joints are elastic for a short while
LONGER = 2.0  # times the last step: the next one at the most
ROUNDED = 1e5  # times the rounding of a position: the least first step
END = 1e-9  # of the travel: distance to its end that counts as arrived
HELD = 1e-6  # of the parameter: points that are further from their prescribed position cannot move freely
BENDS = 4.0  # times the expected displacement: there the curve bends and is followed in shorter steps,
FLAT = 0.01  # of the greatest V: if V is off the straight line by more,
NOISE = 100.0  # times the out-of-balance of blocks at rest, or the rounding of a displacement: smaller ones are noise
MECHANISMS = "none", "sliding", "rocking", "torsion", "uplift", "crushing"  # of `mechanism`
PROTOCOL, WHOLE, STOOD, GAVE_WAY = (  # arrays in a checkpoint
    f"driven_path.{name}" for name in ("protocol", "whole", "stood", "gave_way")
)


class DrivenPath(EquilibriumPath):
    """Path of displaced actuators; the parameter is the distance that their head has travelled (m).

    ``way_number``: current segment of the ``protocol``, and ``turned``: where it began, as the parameter and the
    displacement of the head (m); ``turns``: the equilibria at which segments ended, and ``V``: its current value;
    ``whole``: slip path of all joints (m), number of unbroken bonds, and 1 if a joint was open, at the last turning
    point, and ``stood``: positions of the joints there (j, 9, of `seen`); ``gave_way``: joint that moved most in the
    last segment so far in which any gave way, and the mechanism. A test that comes back to its start has moved nowhere
    as a whole.
    """

    greatest = math.inf
    step = FIRM_STEP  # shorter, as dashpot forces act in full on points that may not give way

    def __init__(
        self, moving: Motion, control: Control, driving: Driving, session: Session, refine: float = 1.0,
        protocol: Protocol | None = None,
    ):  # fmt: skip
        assert driving.driven is not None and isinstance(control, DisplacementControl)
        self.loads, self.refine, self.protocol = driving.driven, refine, present(protocol)
        self.V, self.way_number, self.turned = 0.0, 0, (0.0, 0.0)
        self.turns, self.whole = np.zeros(len(self.protocol.ways)), np.zeros(3)
        self.stood, self.gave_way = np.zeros((len(moving.state.links.host), 9)), (0, "none")
        ways = np.abs(self.protocol.ways)
        self.ranges = np.maximum(ways[0], 0.5 * ways)  # m: a segment there and back is twice as long as one out
        free = ~np.asarray(moving.assembly.fixed)
        dead = np.linalg.norm(moving.assembly.dead_force[free], axis=1).sum()
        self.gentle = refine * GENTLE
        self.pull = float(dead / np.asarray(moving.assembly.mass)[free].sum())  # m/s2, of the dead loads
        super().__init__(moving, control, driving, session, math.ceil(MOST * (ways / self.ranges).sum() / refine))

    @property
    def travel(self) -> float:
        """Length of the current segment (m)."""
        return abs(float(self.protocol.ways[self.way_number]))

    @property
    def sense(self) -> float:
        """1 if the head moves forward on the current segment, -1 if it moves back."""
        return math.copysign(1.0, float(self.protocol.ways[self.way_number]))

    @property
    def stride(self) -> float:
        """Regular increment of the parameter between equilibria (m)."""
        return self.refine * float(self.ranges[self.way_number]) / EQUILIBRIA

    def head(self, parameter):
        """The displacement of the head (m)."""
        began, at = self.turned
        return at + self.sense * (parameter - began)

    @classmethod
    def plan(cls, moving: Motion, control: Control, driving: Driving, output: Output) -> Plan:
        bonds = int(joint_families.bonds(moving.state).sum())
        breaking = min(round(expected_cost.TORN_PER_BOND * bonds), MOST)
        tried = expected_cost.TRIED_ON_TRAVELS
        return plan_of(moving, control, output, EQUILIBRIA, step=cls.step, breaking=breaking, tried=tried)

    def driven(self, parameter: Curve) -> Driving:
        """Loads with the head at that parameter; before the first equilibrium there is no head."""
        if not self.path:
            return self.driving
        head = Head(lambda times: self.head(parameter(times)), np.array([self.V]))
        return replace(self.driving, multiplier=head.multiplier, head=head)

    def advance(self, driving: Driving, steps: int) -> None:
        """As in the base class; also keep V, which the loop finds in each step."""
        super().advance(driving, steps)
        if driving.head is not None:
            self.V = float(driving.head.V[0])

    def steps(self, begin: float, end: float) -> int:
        """Enough steps for the acceleration of the points to stay small compared with that of the dead loads."""
        fastest = self.pull * (min(self.gentle, CAREFUL * self.tolerance) if self.careful else self.gentle)
        seconds = math.sqrt(OF_START * (end - begin) / fastest) if fastest > 0.0 else 0.0
        return max(FEWEST, math.ceil(seconds / self.dt))

    def jumped(self, parameter: float) -> bool:
        """Whether V is off the straight line of the last step: the curve bends as joints begin to slip or bonds break,
        and needs shorter steps, as do laws that depend on the slip path."""
        if not self._goes_on:
            return False
        (u_0, V_0, _), (u, V, _) = self.path[-2:]
        straight = V + (V - V_0) / (u - u_0) * (self.head(parameter) - u)
        return abs(self.V - straight) > max(FLAT * max(self._greatest(), abs(self.V)), self._noise())

    def _noise(self) -> float:
        """Error of V (N) from the out-of-balance that is left at an equilibrium."""
        state, assembly = self.moving.state, self.moving.assembly
        forces = np.abs(state.links.wrench[:, :3]).max(initial=0.0), np.abs(assembly.dead_force).max()
        off = NOISE * BALANCED * max(forces) + of_rounding(state).max()
        return float(off / np.abs(assembly.actuators.weight).max())

    def _whole(self) -> np.ndarray:
        """Current values of ``whole``."""
        unbroken = joint_families.bonds(self.moving.state).sum()
        return np.array([slip_path(self.moving), float(unbroken), float(opened(self.moving))])

    def _motion(self) -> tuple[int, str]:
        """Current value of ``gave_way``."""
        now = self._whole()
        if self.collapse is None and not now[-1] and (now == self.whole).all():
            return self.gave_way
        return moved_most(self.moving, self.stood), mechanism(self.moving, self.stood)

    def _stand(self) -> None:
        """Take the present positions for those from which blocks move."""
        self.whole, self.stood = self._whole(), seen(self.moving.state.bodies, self.moving.state.links)

    @property
    def _goes_on(self) -> bool:
        """Whether the current segment has an equilibrium beyond its beginning."""
        return self.reached > self.turned[0]

    @property
    def _rounding(self) -> float:
        """Rounding of positions (m)."""
        return float(np.finfo(float).eps * np.abs(self.moving.state.bodies.position).max())

    def _greatest(self) -> float:
        """Greatest absolute V so far (N)."""
        return max(abs(V) for _, V, _ in self.path)

    def close(self, parameter: float) -> float:
        """The tolerance over the parameter, or over the greatest range of the head if that is less."""
        return self.tolerance * min(parameter, float(self.ranges.max()))

    def following(self) -> float | None:
        """The next parameter, until the head has completed the last segment."""
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
        """Begin the next segment at the present position of the head."""
        self.gave_way = self._motion()
        self._stand()
        self.turned = float(self.reached), float(self.head(self.reached))
        self.turns[self.way_number] = self.equilibria - 1
        self.way_number += 1

    def said(self, parameter: float) -> str:
        return f"a displacement of {self.head(parameter):.6g} m of the actuators"

    def _note(self, parameter: float, ratio: float) -> None:
        """As in the base class; NotConvergedError if the points could not follow the head."""
        if not self.path:
            self._stand()
        super()._note(parameter, ratio)
        u, V, _ = self.path[-1]
        if not self.arrived(parameter):
            raise NotConvergedError(
                f"the actuators have moved {u:.3g} m of {self.head(parameter):.3g} m at V = {V:.6g} N, because "
                "guides or supports hold the points that they push; free these points, or push elsewhere"
            )

    def arrived(self, parameter: float) -> bool:
        """Whether the points are where the head prescribes."""
        return abs(self.path[-1][0] - self.head(parameter)) <= HELD * parameter + NOISE * self._rounding

    # --- checkpoints

    def _go_back(self) -> None:
        super()._go_back()
        self.V = self.path[-1][1]

    def _own(self) -> dict[str, np.ndarray]:
        protocol = np.array([self.way_number, *self.turned, *self.turns])
        joint, how = self.gave_way
        gave_way = np.array([joint, MECHANISMS.index(how)])
        return super()._own() | {PROTOCOL: protocol, WHOLE: self.whole, STOOD: self.stood, GAVE_WAY: gave_way}

    def _restore(self, snapshot: Snapshot) -> None:
        super()._restore(snapshot)
        kept = snapshot.array(PROTOCOL, np.zeros(3 + len(self.turns)))
        self.whole, self.stood = (snapshot.array(*own).copy() for own in ((WHOLE, self.whole), (STOOD, self.stood)))
        joint, how = snapshot.array(GAVE_WAY, np.zeros(2, np.int64)).tolist()
        self.gave_way = joint, MECHANISMS[how]
        (number, *turned), self.turns = kept[:3].tolist(), kept[3:].copy()
        if not (number.is_integer() and 0 <= number < len(self.protocol.ways)):
            raise HistoryError(f"{snapshot.path}: this checkpoint holds no step of this run")
        self.way_number, self.turned = int(number), (turned[0], turned[1])
        self.V = self.path[-1][1]

    def finished(self) -> LoadPathRun:
        joint, how = self._motion()
        if how == "none":
            joint = moved_most(self.moving, self.stood)
        found = run_of(super().finished(), joint, how)
        ended = [*self.turns[: self.way_number].astype(int).tolist()]
        if found.collapse is None:
            ended.append(self.equilibria - 1)
        return replace(found, turns=tuple(ended))


class ForcePath(DrivenPath):
    """Path of a protocol of actuator forces; the parameter is the sum of all changes of V (N)."""

    step = STEP

    def steps(self, begin: float, end: float) -> int:
        """Always `FEWEST`."""
        return FEWEST

    def driven(self, parameter: Curve) -> Driving:
        """Loads with the prescribed V at that parameter."""
        return replace(self.driving, multiplier=lambda times: self.head(parameter(times)))

    def jumped(self, parameter: float) -> bool:
        """Whether blocks moved much further than expected, as they begin to slide or snap."""
        far = float(self._away(self.at_last).max()) > BENDS * self.pace * (parameter - self.reached)
        return far and abs(float(self.head(parameter)) - self.path[-1][1]) > FLAT * self._greatest()

    def arrived(self, parameter: float) -> bool:
        """Always true: no displacement is prescribed."""
        return True

    def following(self) -> float | None:
        """The next parameter, until the last segment ends."""
        if self.reached - self.turned[0] >= self.travel * (1.0 - END):
            if self.way_number + 1 == len(self.protocol.ways):
                return None
            self._turn()
        return min(self.reached + self.stride, self.turned[0] + self.travel)

    def said(self, parameter: float) -> str:
        return f"V = {self.head(parameter):.6g} N"
