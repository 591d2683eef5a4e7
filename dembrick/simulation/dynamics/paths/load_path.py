"""Paths of equilibria in the deformed geometry: a load system grows until the blocks collapse, or supports move.

The parameter of the path (`equilibria`) is the multiplier V of the load system (`driven_loads`). It grows by a fixed
ratio from one equilibrium to the next, until there is none nearby: the blocks collapse, or jump to a distant
equilibrium however small the increment.
The greatest V with an equilibrium nearby and the least without one are the bracket of the limit load of this path;
friction without dilatancy has no unique one.

Without a load system the path is its first equilibrium, under the dead loads alone (`rest`).

A quasi-static settlement is such a path too: its parameter is the share of their displacement that the supports have
gone through, up to 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from dembrick.kernels.dynamics.rigid_bodies import Bodies
from dembrick.scenario.model import Output
from dembrick.scenario.regimes import ACTUATORS, Control
from dembrick.simulation import expected_cost, load_increments
from dembrick.simulation.channels import bytes_of, recorded
from dembrick.simulation.dynamics import joint_families
from dembrick.simulation.dynamics.dead_load import STEP
from dembrick.simulation.dynamics.integrator import Motion
from dembrick.simulation.dynamics.loads import Driving
from dembrick.simulation.dynamics.outcome import moved_most
from dembrick.simulation.dynamics.paths.equilibria import FEWEST, TOLERANCE, EquilibriumPath
from dembrick.simulation.dynamics.paths.stage_loads import carried
from dembrick.simulation.dynamics.pushover import STRONGEST
from dembrick.simulation.dynamics.run import MEETINGS, EquilibriaRun
from dembrick.simulation.dynamics.state import joint_resultants
from dembrick.simulation.dynamics.time_histories import Curve
from dembrick.simulation.joint_laws import about_start
from dembrick.simulation.session import Kept, Plan, Progress, Session
from dembrick.simulation.statics.rest.dead_load import Rest

FIRST = 0.01  # load factor of the first equilibrium; of actuators that times the weight of the free blocks
GROWTH = 1.4  # of V from one equilibrium to the next
BEYOND = 100.0  # weights of all free blocks: actuators that push harder than this find no limit
NEAR = 0.05  # of a block's least dimension: a block that moves further in a step has no equilibrium nearby
JUMP, SEEN = 2.0, 1e-9  # times the expected displacement, and of a block's least dimension: beyond both, halve the step
FAR = 1e-3  # of that dimension: a displacement that may be a jump in the shortest step
HALVES, STAYS = 3, 0.5  # halvings of such a step; share of its motion that stays in one eighth of it if it is a jump
LONGER = 2.0  # times the last step: the next one at the most
SLOWER = 8.0  # times the time steps, once blocks have collapsed


@dataclass
class LoadPathRun(EquilibriaRun):
    """A finished path of a growing load. ``joint``: number of the joint that moved most in the collapse (else since the
    start), ``resultant`` (7,): its resultant at the last equilibrium, as `joint_resultants` but with moments about O of
    the start, and ``mechanism``: how it moved. ``turns``: the equilibria at which the segments of a protocol end;
    ``rest``: whether the blocks stand under the dead loads, of a path that follows no protocol."""

    joint: int = 0
    resultant: np.ndarray | None = None
    mechanism: str = "none"
    turns: tuple[int, ...] | None = None
    rest: Rest | None = None


class LoadPath(EquilibriumPath):
    """Path of a growing load system; the parameter is its multiplier."""

    overshoot = 2.0  # displacement of an undamped elastic system under a sudden load, over the static one

    def __init__(self, moving: Motion, control: Control, driving: Driving, session: Session, refine: float = 1.0):
        self.scale, self.refine = scale_of(moving, control), refine
        self.greatest = (STRONGEST if control.drives != ACTUATORS else BEYOND) * self.scale
        self.growth = 1.0 + refine * (GROWTH - 1.0)
        super().__init__(moving, control, driving, session, equilibria_of(self.greatest / self.scale, self.growth))
        self.joint, self.stands = 0, True
        if driving.driven is not None:
            self.dropped = NEAR
        else:
            moving.settled = True  # this path only tells whether the blocks rest or fall from where they are

    @classmethod
    def plan(cls, moving: Motion, control: Control, driving: Driving, output: Output) -> Plan:
        if driving.driven is None:
            return plan_of(moving, control, output, 1)
        bonds, tolerance = int(joint_families.bonds(moving.state).sum()), control.tolerance or TOLERANCE
        breaking = expected_cost.breaking_equilibria(bonds, tolerance)
        way = equilibria_of(STRONGEST, GROWTH)
        return plan_of(moving, control, output, way, breaking=breaking, tried=expected_cost.TRIED)

    def driven(self, parameter: Curve) -> Driving:
        """Loads at that multiplier; a table tilts by the angle of which it is the tangent."""
        axis = self.control.tilt_axis
        tilt = None if axis is None else (np.array(axis, float), lambda times: np.arctan(parameter(times)))
        return replace(self.driving, multiplier=parameter, tilt=tilt)

    def steps(self, begin: float, end: float) -> int:
        """`FEWEST` over ``refine``, and more once the load grows slowly (``careful``)."""
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
        """Whether a block moved much further than expected: swinging blocks may slide away below the limit."""
        expected = JUMP * self.pace * (parameter - self.reached)
        return bool((self._away(self.at_last) > np.maximum(expected, SEEN * self.least)).any())

    def _go(self, parameter: float) -> float | None:
        """As in the base class; a jump in a step as short as the tolerance counts as a collapse, too. Blocks with ties
        are exempt, as they may move on until a tie is taut."""
        ratio = super()._go(parameter)
        short = 0.0 < parameter - self.reached <= self.tolerance * parameter
        far = bool((self._away(self.at_last) > FAR * self.least).any())
        if ratio is None or not short or not far or len(self.moving.state.ties.stiffness):
            return ratio
        there = Kept(self.past.snapshot())
        jumps = self._jumps(parameter)
        there.arrays["loop"][1] = self.moving.time_step  # as in `_go_back`
        self.past.restore(there)
        if jumps:
            self.record_collapse_frame(1.0)
        return None if jumps else ratio

    def _jumps(self, parameter: float) -> bool:
        """Whether the step to ``parameter`` is a jump: after repeated halving, one part still has most of the motion,
        or blocks collapse."""
        most = float(self._away(self.at_last).max())
        low, high = (self.reached, 0.0), (parameter, most)
        for _ in range(HALVES):
            self._go_back()
            middle = 0.5 * (low[0] + high[0])
            if super()._go(middle) is None:
                return True
            there = middle, float(self._away(self.at_last).max())
            low, high = (low, there) if there[1] - low[1] > high[1] - there[1] else (there, high)
            if high[1] - low[1] <= STAYS * most:
                return False
        return True

    def said(self, parameter: float) -> str:
        return f"a load of V = {parameter:.6g}"

    def refuse_collapse_under_dead_loads(self, stood: Bodies) -> None:
        """Without a load system the collapse is the result of the path, no error."""
        if self.driving.driven is not None:
            super().refuse_collapse_under_dead_loads(stood)
        self.stands = False
        self.fall = None
        self._note(0.0, 1.0)
        self._fell(stood)

    def collapse_record(self, before: np.ndarray, blocks: np.ndarray) -> dict:
        self.joint = moved_most(self.moving, before)
        return super().collapse_record(before, blocks)

    def finished(self) -> LoadPathRun:
        if self.collapse is None:
            self.joint = moved_most(self.moving, self.past.at_rest)
        how = None if self.collapse is None else self.collapse["mechanism"]
        found = run_of(super().finished(), self.joint, how or "none")
        greatest = float(np.abs(carried(self.moving)).max(initial=0.0))
        errors = load_increments.both_errors(self.path_error, self.session.force_error, greatest)
        blocks, seconds = tuple(np.flatnonzero(found.fallen).tolist()), (found.compile_seconds, found.loop_seconds)
        rest = Rest(self.stands, found.unbalanced, self.moving.steps, how, blocks, *seconds, self.increments, *errors)
        return replace(found, rest=rest)


def run_of(found: EquilibriaRun, joint: int, how: str) -> LoadPathRun:
    """A finished path with the resultant of the ``joint`` of that number at its last equilibrium and ``how`` it
    moved."""
    state, resultant = found.motion.state, None
    if len(state.links.host):
        resultant = about_start(joint_resultants(state)[joint], found.motion.polygons.shift[joint])
    return LoadPathRun(**vars(found), joint=joint, resultant=resultant, mechanism=how)


def scale_of(moving: Motion, control: Control) -> float:
    """Scale of V: 1 for load factors; for actuators the weight of the free blocks over the sum of their weights."""
    if control.drives != ACTUATORS:
        return 1.0
    assembly = moving.assembly
    dead = np.linalg.norm(assembly.dead_force[~np.asarray(assembly.fixed)], axis=1).sum()
    return float(dead or 1.0) / float(np.abs(assembly.actuators.weight).sum())


def equilibria_of(most: float, growth: float) -> int:
    """Number of equilibria of a path without a collapse until V is ``most`` times its scale."""
    return 1 + math.ceil(math.log(most / FIRST) / math.log(growth))


def plan_of(
    moving: Motion,
    control: Control,
    output: Output,
    equilibria: int,
    each: float = 4.0 * FEWEST,
    step: float = STEP,
    breaking: int = 0,
    tried: float = 1.0,
) -> Plan:
    """Plan of a path of so many ``equilibria`` of roughly ``each`` steps, and of those of half as many while bonds are
    ``breaking``; ``step``: over the time step of the run, and ``tried``: all steps over those that are kept."""
    count, state = equilibria + breaking, moving.state
    fields = recorded(moving.assembly, output.channels, control)
    memory = 3 * sum(array.nbytes for array in state.arrays)
    memory += bytes_of(fields, count, count, count * MEETINGS * len(moving.assembly.names))
    steps = int(equilibria * each + breaking * 2.0 * FEWEST)
    convex, points = len(joint_families.convex_joints(state)), joint_families.contact_points(state)
    seconds = expected_cost.path_seconds(tried * steps, convex, points, joint_families.has_strengths(state))
    within = expected_cost.PATH_WITHIN if breaking else Plan.within
    return Plan(step * moving.time_step, moving.critical_time_step, steps, memory, seconds, within=within)


EQUILIBRIA = 80  # of the whole settlement, equally spaced
HALVINGS = 7  # of the first of these steps: the reaction changes most when the supports begin to move
WITHIN = 0.05  # of the smallest block: the longest step
GENTLE = 0.005  # of gravity: the greatest acceleration of the supports; at 0.02 hinges of stiff joints rattle open
CAREFUL = 0.2  # of the tolerance: the same over gravity, once blocks have collapsed
OF_START = 12.0  # greatest acceleration of the supports over distance / time squared


def shares(longest: float, refine: float = 1.0) -> list[float]:
    """Shares of the settlement at which equilibria are sought, spaced by ``longest`` at the most."""
    count = math.ceil(max(EQUILIBRIA / refine, 1.0 / longest))
    first = [2.0**-k / count for k in range(HALVINGS, 0, -1)]
    return first + [(k + 1) / count for k in range(count)]


class Settlement(EquilibriumPath):
    """Path of settling supports; the parameter is the share of their displacement that they have gone through."""

    def __init__(self, moving: Motion, control: Control, driving: Driving, session: Session, refine: float = 1.0):
        self.supports = driving.supports
        self.shares = shares(WITHIN * moving.smallest / self.supports.length, refine)
        super().__init__(moving, control, driving, session, len(self.shares))
        self.gentle = refine * GENTLE
        self.gravity = float(np.linalg.norm(moving.assembly.gravity))

    @property
    def progress(self) -> Progress:
        """As in the base class; with the most equilibria, the first and those of all shares, unless bonds may break or
        blocks have collapsed."""
        most = None if self.careful or self.bonded else 1 + len(self.shares)
        return Progress("equilibrium", self.equilibria, most, None, True)

    @classmethod
    def plan(cls, moving: Motion, control: Control, driving: Driving, output: Output) -> Plan:
        """Plan with a rough number of steps: those while the supports move, and half as many to come to rest."""
        length, gravity = driving.supports.length, float(np.linalg.norm(moving.assembly.gravity))
        way = shares(WITHIN * moving.smallest / length)
        fastest = OF_START * length / (GENTLE * gravity) if gravity > 0.0 else 0.0
        seconds = (math.sqrt(fastest * (end - begin)) for begin, end in pairwise([0.0, *way]))
        moves = sum(max(FEWEST, lasts / (STEP * moving.time_step)) for lasts in seconds)
        return plan_of(moving, control, output, len(way) + 1, 1.5 * moves / len(way))

    def driven(self, parameter: Curve) -> Driving:
        """Supports displaced by that share of their settlement."""
        return replace(self.driving, share=parameter)

    def steps(self, begin: float, end: float) -> int:
        """Enough steps for the acceleration of the supports to stay small compared with gravity."""
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

    def collapse_record(self, before: np.ndarray, blocks: np.ndarray) -> dict:
        """Record of the collapse, with the settlement at which it occurs (m)."""
        low, high = self.reached * self.supports.length, self.falls * self.supports.length
        return super().collapse_record(before, blocks) | {
            "settlement": 0.5 * (low + high),
            "settlement_range": [low, high],
        }
