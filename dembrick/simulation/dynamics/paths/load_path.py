"""Paths of equilibria in the deformed geometry: a load system grows until the blocks come down, or supports move.

The parameter of the path (`equilibria`) is the multiplier V of the load system (`driven_loads`). It grows by a part of
itself from one equilibrium to the next, until there is none near: blocks come down, or jump to where they rest again,
however little it grows.
The greatest V at which they came to rest nearby and the least at which they did not are the bracket of the limit: of
this path, since friction without dilatancy has no unique one.

Without a load system the path is its first equilibrium, under the dead loads alone (`rest`).

A quasi-static settlement is such a path too: its parameter is the share of their way that the supports have gone, up to
1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from dembrick.kernels.dynamics.rigid_bodies import Bodies
from dembrick.scenario.model import Output
from dembrick.scenario.regimes import ACTUATORS, Control
from dembrick.simulation import load_increments
from dembrick.simulation.channels import bytes_of, recorded
from dembrick.simulation.dynamics.dead_load import STEP
from dembrick.simulation.dynamics.integrator import Motion
from dembrick.simulation.dynamics.loads import Driving
from dembrick.simulation.dynamics.outcome import moved_most
from dembrick.simulation.dynamics.paths.equilibria import FEWEST, EquilibriumPath
from dembrick.simulation.dynamics.paths.stage_loads import carried
from dembrick.simulation.dynamics.pushover import STRONGEST
from dembrick.simulation.dynamics.run import MEETINGS, EquilibriaRun
from dembrick.simulation.dynamics.state import joint_resultants
from dembrick.simulation.dynamics.time_histories import Curve
from dembrick.simulation.expected_cost import motion_seconds
from dembrick.simulation.session import Plan, Session

FIRST = 0.01  # load factor of the first equilibrium; of actuators that times the weight of the free blocks
GROWTH = 1.4  # of V from one equilibrium to the next
BEYOND = 100.0  # weights of all free blocks: actuators that push harder find no limit
NEAR = 0.05  # of a block's least dimension: what moves further under a load that is held has no equilibrium near
JUMP, SEEN = 2.0, 1e-9  # times as far as could be expected, and of a block's least dimension: steps are halved there
FAR = 1e-3  # of that dimension: in a step as short as can be that may be a jump
HALVES, STAYS = 3, 0.5  # of such a step, and of its motion: what stays in an eighth of it
LONGER = 2.0  # times the last step: the next
SLOWER = 8.0  # times the steps, once blocks have come down


@dataclass
class LoadPathRun(EquilibriaRun):
    """A finished path of a load that grows. ``joint``: number of the joint that moved most in the collapse (else since
    the start), ``resultant`` (7,): what it carried at the last equilibrium, as `joint_resultants`, and ``mechanism``:
    how it moved. ``stands``: False if the blocks come down under the dead loads."""

    joint: int = 0
    resultant: np.ndarray | None = None
    mechanism: str = "none"
    turns: tuple[int, ...] | None = None  # the equilibria at which the ways of a protocol end
    stands: bool = True
    increments: int = 1  # of loads that came after others, and the error of forces: `Rest`
    path_error: float = 0.0
    force_error: float = 0.0


class LoadPath(EquilibriumPath):
    """The growth of a load system from equilibrium to equilibrium; the parameter is its multiplier."""

    overshoot = 2.0  # a load that comes at once moves an elastic system without damping so far

    def __init__(self, moving: Motion, control: Control, driving: Driving, session: Session, refine: float = 1.0):
        self.scale, self.refine = scale_of(moving, control), refine
        self.greatest = (STRONGEST if control.drives != ACTUATORS else BEYOND) * self.scale
        self.growth = 1.0 + refine * (GROWTH - 1.0)
        super().__init__(moving, control, driving, session, equilibria_of(self.greatest / self.scale, self.growth))
        self.joint, self.stands = 0, True
        if driving.driven is not None:
            self.dropped = NEAR
        else:
            moving.settled = True  # to rest from where the blocks are, or to fall, is what this path is for

    @classmethod
    def plan(cls, moving: Motion, control: Control, driving: Driving, output: Output) -> Plan:
        return plan_of(moving, control, output, equilibria_of(STRONGEST, GROWTH) if driving.driven is not None else 1)

    def driven(self, parameter: Curve) -> Driving:
        """The load system acts with that multiplier; a table tilts by the angle whose tangent it is."""
        axis = self.control.tilt_axis
        tilt = None if axis is None else (np.array(axis, float), lambda times: np.arctan(parameter(times)))
        return replace(self.driving, multiplier=parameter, tilt=tilt)

    def steps(self, begin: float, end: float) -> int:
        """The least, and more with all care."""
        return round(FEWEST / self.refine * (SLOWER if self.careful else 1.0))

    def following(self) -> float | None:
        """The next multiplier, up to the greatest."""
        if self.driving.driven is None or self.reached >= self.greatest:
            return None
        target = max(FIRST * self.scale, self.growth * self.reached)
        if len(self.path) > 1:
            step = max(LONGER * (self.path[-1][1] - self.path[-2][1]), self.tolerance * self.reached)
            target = min(target, max(FIRST * self.scale, self.reached + step))
        return min(self.greatest, target)

    def jumped(self, parameter: float) -> bool:
        """Blocks that swing under a load that grows may slide away below the limit, and come to rest there."""
        expected = JUMP * self.pace * (parameter - self.reached)
        return bool((self._away(self.at_last) > np.maximum(expected, SEEN * self.least)).any())

    def _go(self, parameter: float) -> float | None:
        """If blocks move far in a step as short as the tolerance, they have come down from the limit if that is a jump.
        Blocks that are tied may move on until a tie is taut."""
        ratio = super()._go(parameter)
        short = 0.0 < parameter - self.reached <= self.tolerance * parameter
        far = bool((self._away(self.at_last) > FAR * self.least).any())
        if ratio is None or not short or not far or len(self.moving.state.ties.stiffness):
            return ratio
        jumps = self._jumps(parameter)
        self._go_back()
        ratio = super()._go(parameter)  # again: how they come down, or rest
        if jumps:
            self.look_on(1.0)
        return None if jumps else ratio

    def _jumps(self, parameter: float) -> bool:
        """Whether most of the motion to there stays in one part of the step, however short that is; or blocks fall."""
        most = float(self._away(self.at_last).max())
        low, high = (self.reached, 0.0), (parameter, most)
        for _ in range(HALVES):
            self._go_back()
            middle = 0.5 * (low[0] + high[0])
            if super()._go(middle) is None:
                return True
            there = middle, float(self._away(self.at_last).max())
            low, high = (low, there) if there[1] - low[1] > high[1] - there[1] else (there, high)
        return high[1] - low[1] > STAYS * most

    def said(self, parameter: float) -> str:
        return f"a load of V = {parameter:.6g}"

    def falls_at_once(self, stood: Bodies) -> None:
        """That is the answer if nothing is to grow."""
        if self.driving.driven is not None:
            super().falls_at_once(stood)
        self.stands = False
        self.fall = None
        self._note(0.0, 1.0)
        self._fell(stood)

    def come_down(self, before: np.ndarray, blocks: np.ndarray) -> dict:
        self.joint = moved_most(self.moving, before)
        return super().come_down(before, blocks)

    def finished(self) -> LoadPathRun:
        if self.collapse is None:
            self.joint = moved_most(self.moving, self.past.at_rest)
        found = run_of(super().finished(), self.joint, "none" if self.collapse is None else self.collapse["mechanism"])
        greatest = float(np.abs(carried(self.moving)).max(initial=0.0))
        error, force = load_increments.both_errors(self.path_error, self.session.force_error, greatest)
        return replace(found, stands=self.stands, increments=self.increments, path_error=error, force_error=force)


def run_of(found: EquilibriaRun, joint: int, how: str) -> LoadPathRun:
    """A finished path with what the ``joint`` of that number carried at its last equilibrium, and ``how`` it moved."""
    state = found.motion.state
    resultant = joint_resultants(state)[joint] if len(state.links.host) else None
    return LoadPathRun(**vars(found), joint=joint, resultant=resultant, mechanism=how)


def scale_of(moving: Motion, control: Control) -> float:
    """Scale of V: 1 for load factors; for actuators the weight of the free blocks over their weights."""
    if control.drives != ACTUATORS:
        return 1.0
    assembly = moving.assembly
    dead = np.linalg.norm(assembly.dead_force[~np.asarray(assembly.fixed)], axis=1).sum()
    return float(dead or 1.0) / float(np.abs(assembly.actuators.weight).sum())


def equilibria_of(most: float, growth: float) -> int:
    """How many equilibria a path has, at the most, on which nothing comes down before V is ``most`` scales."""
    return 1 + math.ceil(math.log(most / FIRST) / math.log(growth))


def plan_of(
    moving: Motion, control: Control, output: Output, equilibria: int, each: float = 4.0 * FEWEST, step: float = STEP
) -> Plan:
    """The plan of a path of so many equilibria, of so many steps ``each``, roughly; ``step``: over the time step."""
    fields = recorded(moving.assembly, output.channels, control)
    memory = 3 * sum(array.nbytes for array in moving.state.arrays)
    memory += bytes_of(fields, equilibria, equilibria, equilibria * MEETINGS * len(moving.assembly.names))
    steps = int(equilibria * each)
    seconds = motion_seconds(steps, len(moving.assembly.joints))
    return Plan(step * moving.time_step, moving.critical_time_step, steps, memory, seconds)


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
