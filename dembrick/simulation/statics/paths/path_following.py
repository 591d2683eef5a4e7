"""Path following: the limit load of an assembly from equilibrium to equilibrium, without inertia.

An assembly stores much elastic displacement before any joint slips or opens, a tower orders of magnitude more than its
joints; the mechanism that follows is governed by small remaining forces. So each step solves for the next equilibrium
directly: the driven displacement is prescribed, and the motion of all blocks and V are found by Newton's method on
the joint laws, implicit in the friction (backward Euler), in the geometry of the start. While everything is
elastic a step is exact; once a mechanism moves, V is that of the mechanism for steps of any length, and they are
doubled until the elastic forces of the past, and the strip of a rocking convex joint, have become negligible.

If many contacts are at the brink of opening or slipping, Newton's method fails. Then a viscous drag, a small part
of the elastic stiffness, acts on each joint during the step. V is corrected for the drag by virtual work, and what the
drag leaves out of balance reduces the lower bound; the drag is lowered until that is negligible.
Bonds break between equilibria, not within one (`bond_breaking`).

If blocks snap from one state into another, there is no equilibrium nearby. Then they are released: under a greater
drag they drift to a new equilibrium at constant driven displacement.
"""

from __future__ import annotations

import math
import time

import numpy as np

from dembrick.kernels.statics.energy import elastic_energy
from dembrick.kernels.statics.load_bounds import NEVER, Certificate
from dembrick.simulation import interrupts
from dembrick.simulation.checkpoint_arrays import flattened, restored_state
from dembrick.simulation.expected_cost import LEAST_WASTED, WASTED
from dembrick.simulation.session import Progress, Session, Snapshot
from dembrick.simulation.statics import joint_families, ties
from dembrick.simulation.statics.newton import HELD, Equilibria
from dembrick.simulation.statics.paths import bounds
from dembrick.simulation.statics.paths.bond_breaking import BondBreaking
from dembrick.simulation.statics.paths.driven_relaxation import DrivenRelaxation
from dembrick.simulation.statics.paths.instant_bounds import HIDDEN, LEAST_BALANCED, NOTHING, InstantBounds
from dembrick.simulation.statics.paths.limit_state import LimitState
from dembrick.simulation.statics.paths.other_paths import FrictionReserve
from dembrick.simulation.statics.paths.path_state import MOST_EQUILIBRIA, Drift, Path, PathState
from dembrick.simulation.statics.recorder import Recorder
from dembrick.simulation.statics.sparse_equations import Factors, inner
from dembrick.simulation.statics.state import State, for_kernels, move_actuators, zero_actuators

ELASTIC_STEPS = 16  # to the estimated limit load
EASY, HARD = 6, 12  # iterations up to which a step may grow, from which it shrinks
GROWTH, SHRINKING = 2.0, 0.5  # of an easy step; of one that finds no equilibrium
SHORTEST = 1e-6  # of the inelastic displacement so far: shorter steps are hopeless
BALANCED, USUAL = 1e-2, 1e-3  # of the tolerance, or of the usual one: out-of-balance of a block over its forces
CONSTANT = 1e-6  # of the elastic slope of V: below it a mechanism moves
YIELDING = 0.5  # of the elastic slope of V: below it steps may grow
TURNING = 0.02  # of the longest step so far: if only shorter ones find equilibrium, the blocks are released
JUMP = 0.25  # of it: the step of the driven displacement then
LITTLE = 0.1  # of the tolerance: what a step with drag may leave out of balance over the joint forces or the load
FASTER = 4.0  # by which the drag of a step rises if it is too small, or falls at most; the square if it hardly mattered
MOST_PUSHES, MOST_TRIES = 12, 6  # pushes of driven relaxation in a path; attempts of a step with less and less drag
ALONG = 4  # steps with drag before one without is tried again
MOST_JUMPS, MOST_DRIFTS, MOST_DRAG = 20, 300, 1e4  # in a path; steps of one; drag over elastic stiffness
TAKES_UP = 0.1  # of the tolerance: what ties that still stretch may add to V at its limit
UNLIMITED = 1e4  # of the dead loads: a load that grows beyond is limited by nothing
WITHOUT_END = 4 * ELASTIC_STEPS  # equilibria after which steps may grow even if elastic: the estimate was far too small


class PathFollower:
    """Follows the equilibria of a ``state`` under multiples of the unit ``load`` (n, 6) as far as its limit, if found.

    ``factor``: of the elastic stiffness. The bracket is stored in ``certificate``; every equilibrium is recorded, with
    its number in place of a time. ``session`` keeps checkpoints and may restart from one.
    """

    def __init__(
        self,
        state: State,
        load: np.ndarray,
        factor: Factors,
        certificate: Certificate,
        recorder: Recorder | None = None,
        session: Session | None = None,
    ):
        session = session or Session()
        self.state, self.certificate, self.recorder = state, certificate, recorder
        self.loosest = max(BALANCED * min(certificate.tolerance, USUAL), LEAST_BALANCED)
        self.search = Equilibria(state, load, factor, self.loosest)
        self.free, self.rows, self.trial = self.search.free, self.search.rows, self.search.trial
        self.weight = float(np.abs(state.actuators.weight).sum())
        self.elastic = factor.pattern.to_rows(factor.elastic_motion(load[self.free]))
        self.compliance = inner(self.search.load, self.elastic)
        self.elastic_at_start = 0.0
        if recorder is not None:
            self.elastic_at_start = elastic_energy(for_kernels(state), None) + ties.energy(state)
        self.displacement_at_start = state.blocks.displacement.copy()
        # V whose loads equal the sum of all dead loads and bond strengths
        self.dead = float(np.linalg.norm(ties.dead_loads(state)[self.free, :3], axis=1).sum()) / self.weight
        self.bonds, self.grip = BondBreaking(state), FrictionReserve(state)
        self.dead += self.bonds.strength / self.weight
        self.instant = InstantBounds(self.search, certificate, self.weight, self.dead)
        self.relaxation = DrivenRelaxation(state, factor, self.weight / self.compliance)
        self.patience: float = max(LEAST_WASTED, WASTED // len(self.free) ** 2)
        if state.ties is not None or joint_families.has_strengths(state):
            self.patience = math.inf  # driven relaxation supports neither
        self.session = session
        self.turn_began: dict[str, np.ndarray] = {}
        self.way, self.limit, self.ties_hold = self._at_start(0.0), LimitState(state, session.hands_on), False
        self.search.pause = lambda: session.pause(self, within=True)
        self.phases = {**self.search.phases, "bracket": 0.0, "record": 0.0, "path": 0.0}
        self.elsewhere = 0.0  # s, in the observer of the record and in checkpoints

    def prepare(self) -> None:
        """Call every kernel once, at the present motion, to compile or load it; the state is unchanged."""
        self.search.remember()
        self.search.attempt(self.search.motion(), 0.0)
        self.search.differentiate(0.0)
        self.search.prepare()
        self.instant.bounds(0.0, 0.0, 0.0)
        if self.recorder is not None:
            self._write(0)
            self.recorder.record.count[:] = 0
        self.search.phases.update(dict.fromkeys(self.search.phases, 0.0))

    def run(self, strength: float, goal: float = 0.0) -> Path:
        """Follow the path until the bracket is narrow enough and a block has moved by ``goal`` (m).

        ``strength`` is a guess of the limit load. Raises Interrupted.
        """
        began = time.perf_counter()
        way = self.way = self._at_start(strength)
        if self.session.resumed is not None:
            self._restore(self.session.resumed)
        else:
            self.search.remember()
            self._record()
        converged, unlimited, wanders, more = False, False, False, True
        with interrupts.deferred():
            while more and way.equilibria < MOST_EQUILIBRIA:
                paused = time.perf_counter()
                if self.session.keep is not None:
                    self.turn_began = self._snapshot()
                self.session.pause(self)
                self.elsewhere += time.perf_counter() - paused
                V, more = self._drifted() if way.drift else self._stepped()
                if V is None and not more and self.patience < math.inf:
                    way.drift, way.wasted, more = None, int(self.patience) + 1, True
                if V is not None and self._went_to(V) and self._moved() >= goal:
                    converged, more = True, False
                elif way.pushes >= bounds.PUSHES and self.certificate.bracket[1] < NEVER and self._moved() >= goal:
                    wanders, more = True, False
                elif way.pushes >= MOST_PUSHES:
                    more = False
                elif not (more or self.certificate.strict) and way.jumps > MOST_JUMPS and self._moved() >= goal:
                    *self.certificate.bracket[:], wanders = bounds.bounds_after_jumps(way.seen, self.search.smooth)
                elif V is not None and V > UNLIMITED * self.dead > 0.0:
                    unlimited, more = True, False
        self.limit.record_end(self.recorder, self.state, way)
        phases = self.phases | self.search.phases
        if way.pushes:
            phases["driven_relaxation"] = self.relaxation.seconds
        beside = self.elsewhere + self.relaxation.compile_seconds
        phases["path"] = time.perf_counter() - began - beside - sum(phases.values())
        peak = bounds.peak_bounds(way.seen, self.compliance / self.weight)
        if peak[0] <= NOTHING * self.dead:
            peak = 0.0, 0.0
        # any smaller inelastic displacement is rounding of the elastic one
        moved = way.seen[-1][0] > 1e-6 * way.driven
        return Path(converged, unlimited, wanders, moved, peak, way.iterations, way.equilibria, phases)

    def _at_start(self, strength: float) -> PathState:
        zero_actuators(self.state)
        step = strength * self.compliance / self.weight / ELASTIC_STEPS
        direction = self._elastic_way()
        steps = dict.fromkeys(("step", "elastic", "usual", "longest"), step)
        gain, balanced, motion = self.weight / self.compliance, self.search.balanced, self.search.motion()
        return PathState(motion, direction, direction.copy(), **steps, gain=gain, balanced=balanced)

    def _found(self, motion: np.ndarray, V: float) -> tuple[float | None, int]:
        """V of the equilibrium near ``motion`` at its driven displacement, or None; and the iterations."""
        found = self.search.find(motion, V)
        self.way.iterations = self.search.iterations
        return found

    def _stepped(self) -> tuple[float | None, bool]:
        """V of the next equilibrium, None if there is none yet; and whether there is anything left to try."""
        way = self.way
        if way.wasted > self.patience:
            return self.bonds.jumped(self.relaxation.push(self.search, way)), True
        guess = way.motion + way.step * way.direction, way.V + way.step * way.gain
        V = None
        if not way.dragged:
            V, way.tried = self._found(*guess)
        if V is None:
            way.wasted += way.tried
            V, way.tried = self._dragged(*guess)
            way.wasted += way.tried
        if V is not None:
            return (V, True) if self.bonds.bear(way) else (None, True)
        if way.has_spare:
            way.direction, way.gain, way.has_spare = way.spare, way.spare_gain, False
            return None, True
        if self.search.balanced < self.loosest:
            way.closest = way.balanced = self.search.balanced = min(10.0 * self.search.balanced, self.loosest)
            return None, True
        way.step, way.since_failure = SHRINKING * way.step, -2
        if way.step <= SHORTEST * way.longest:
            return None, False
        if way.step > TURNING * way.usual:
            return None, True
        # the path turns back: release the blocks and let them find a new equilibrium
        way.jumps, way.step = way.jumps + 1, JUMP * way.usual
        if way.jumps > MOST_JUMPS:
            return None, False
        way.drift = Drift(way.motion + way.step * way.direction, way.V)
        return None, True

    def _elastic_way(self) -> np.ndarray:
        """Elastic motion per metre of the driven displacement."""
        return self.elastic / self.compliance * self.weight

    def _dragged(self, motion: np.ndarray, V: float) -> tuple[float | None, int]:
        """`_found` with a drag at each joint that is lowered until it is negligible; V is corrected for the drag."""
        way, search = self.way, self.search
        iterations, excess = 0, np.inf
        for _ in range(MOST_TRIES):
            self.trial.drag[:] = way.drag, way.drag
            found, tried = self._found(motion, V)
            self.trial.drag[:] = 0.0, HELD
            iterations += tried
            if found is None:
                break
            motion = search.motion()
            search.attempt(motion, found)
            work = inner(self.trial.residual, motion - way.motion)
            V = found - work / (way.step * self.weight)
            search.attempt(motion, V)
            excess = self.instant.held_up(V) / (LITTLE * self.certificate.tolerance)
            if excess <= 1.0:
                break
            way.drag *= max(1.0 / (FASTER if tried > 1 else FASTER**2), 0.5 / excess)
        if excess > 1.0:
            if found is None:
                way.drag = min(FASTER * way.drag, MOST_DRAG)
            return None, iterations
        if not way.dragged:
            found, tried = self._found(motion, V)  # from so near it may be found without drag
            iterations += tried
            if found is not None:
                return found, iterations
            search.attempt(motion, V)
        way.drag *= min(FASTER, 0.5 / max(excess, 0.1))
        way.lost += work
        way.dragged = way.dragged - 1 if way.dragged else ALONG - 1
        return V, iterations

    def _went_to(self, V: float) -> bool:
        """Accept the present equilibrium at V and choose the next step; whether the bracket is narrow enough."""
        way = self.way
        way.equilibria += 1
        now = self.search.motion()
        change, slope = now - way.motion, (V - way.V) / way.step
        secant = change / way.step
        self._accept(change, V, way.step)
        way.motion = now
        if way.pushes:
            (given, _, lower, _, _), pushed = way.seen[-1], self.relaxation.pushed
            hidden = max(HIDDEN * self.certificate.tolerance, self.instant.held_up(V)) * abs(V)
            if not self.certificate.strict:
                way.seen[-1] = given, V, min(lower, pushed.least), max(V, pushed.greatest) + hidden, False
            self.relaxation.show_what_moves(self.search.rows)
            return self._judged_limit()
        if way.broke:
            # the redistribution after a break is no step: try the elastic direction next, else that of the mechanism
            way.spare, way.spare_gain, way.has_spare = secant, 0.0, True
            way.direction, way.gain = self._elastic_way(), self.weight / self.compliance
            way.seen[-1], way.step = (*way.seen[-1][:3], NEVER, True), way.usual
        elif way.jumps == way.kept:
            way.direction, way.gain, way.has_spare = secant, slope, False
            mechanism = self.search.mechanism(CONSTANT / self.compliance) if way.tried else None
            if mechanism is not None:
                way.turn_to(mechanism * self.weight, 0.0)
            way.usual = max(way.usual, way.step)
        else:
            # the blocks found their mechanism or returned to an elastic state: both directions may lead on
            way.turn_to(secant, 0.0)
            way.seen[-1], way.kept = (*way.seen[-1][:3], NEVER, True), way.jumps
        way.longest = max(way.longest, way.seen[-1][0])
        judged = self._judged_limit()
        way.since_failure += 1
        jumped = way.broke
        if self.bonds.give_way(self.search, way):
            way.direction, way.gain, way.has_spare = self._elastic_way(), 0.0, False
        if way.broke or jumped:
            return judged and not way.broke
        if way.tried >= HARD:
            way.step *= SHRINKING
        elif (
            way.tried <= EASY
            and way.since_failure > 0
            and (
                slope <= YIELDING * self.weight / self.compliance
                or way.step <= SHRINKING * way.usual
                or way.equilibria >= WITHOUT_END
            )
        ):
            way.step, way.drag = GROWTH * way.step, way.drag / GROWTH  # what drags is about the same
        if way.tried and joint_families.has_areas(self.state):
            tangent, along = self.search.mechanism(math.inf), inner(self.search.load, secant) / self.weight
            if tangent is not None and along > 0.0:  # exactly per metre: a rounding error would double at every step
                bounds.go_on_rocking(way, tangent * self.weight, secant / along, slope)
        return judged

    def _judged_limit(self) -> bool:
        """Keep the present equilibrium, with its bonds, if it is the limit; whether the bracket is narrow enough."""
        judged, within = self._judged(), 2.0 * self.certificate.tolerance
        self.limit.look_at(self.state, self.way, judged and not joint_families.overloaded(self.state).any(), within)
        return judged

    @property
    def where(self) -> str:
        return f"equilibrium {self.way.equilibria}"

    @property
    def progress(self) -> Progress:
        return Progress("equilibrium", self.way.equilibria)

    def snapshot(self) -> dict[str, np.ndarray]:
        """Arrays at the beginning of this iteration, without any trace of attempts since."""
        return self.turn_began

    def _memory(self) -> dict[str, np.ndarray]:
        trial = {"base": self.trial.base, **joint_families.memory_arrays(self.trial)}
        return {
            **{f"trial.{name}": array for name, array in trial.items()},
            "bracket": self.certificate.bracket,
            "way.displacement_at_start": self.displacement_at_start,
            "way.reserves": self.bonds.reserves,
            "way.forces": self.grip.forces,
        }

    def _snapshot(self) -> dict[str, np.ndarray]:
        arrays = {**self._memory(), **flattened({"state": self.state}), **self.limit.arrays()}
        return {**self.way.snapshot(), **{name: array.copy() for name, array in arrays.items()}}

    def _restore(self, snapshot: Snapshot) -> None:
        """Restart from a snapshot of the same scene; HistoryError if it is of another."""
        self.way.restore(snapshot)
        for name, own in self._memory().items():
            own[...] = snapshot.array(name, own)
        restored_state(self.state, snapshot)
        self.limit.restore(snapshot)
        self.search.iterations, self.search.balanced = self.way.iterations, self.way.balanced

    def _moved(self) -> float:  # m, greatest displacement of a block since the start of the path
        return float(np.linalg.norm(self.state.blocks.displacement - self.displacement_at_start, axis=1).max())

    def _drifted(self) -> tuple[float | None, bool]:
        """One step of released blocks at constant driven displacement: V once they rest, else None; and whether they
        may go on.

        In every step a drag proportional to the elastic stiffness acts on each joint; it fades as they come to rest.
        """
        trial, state, drift = self.trial, self.state, self.way.drift
        trial.drag[:] = drift.drag, drift.drag
        found, iterations = self._found(drift.motion, drift.V)
        trial.drag[:] = 0.0, HELD
        drift.steps += 1
        self.way.wasted += iterations
        if found is None:
            drift.drag *= 4.0
            return None, drift.drag <= MOST_DRAG and drift.steps < MOST_DRIFTS
        drift.V, drift.motion = found, self.search.motion()
        self.way.friction += joint_families.friction_work(state, self.trial)
        self.way.yielding += ties.remember(state)
        self.way.crushing += joint_families.crushing_work(state, trial)
        self.search.remember()
        self.search.attempt(drift.motion, drift.V)
        if self.search.is_balanced():
            self.way.drift = None
            return self.bonds.jumped(drift.V), True
        if iterations <= EASY:
            drift.drag *= 0.5
        return None, drift.steps < MOST_DRIFTS

    def _accept(self, change: np.ndarray, V: float, step: float) -> None:
        """Accept an equilibrium: update history, energies and actuators, and find the bounds of this instant."""
        state, blocks, way = self.state, self.state.blocks, self.way
        rows = change[self.rows]
        blocks.velocity[self.free], blocks.spin[self.free] = rows[:, :3], rows[:, 3:]
        way.friction += joint_families.friction_work(state, self.trial)
        way.yielding += ties.remember(state)
        way.crushing += joint_families.crushing_work(state, self.trial)
        moved = step * self.weight
        way.external += 0.5 * (way.V + V) * moved
        way.external += float((ties.dead_loads(state) * np.concatenate([blocks.velocity, blocks.spin], axis=1)).sum())
        closing = joint_families.closes_gaps(state, self.trial.base)
        hidden = 0.0 if self.certificate.strict else self.instant.hidden(V, moved, way.closest)
        way.balanced = self.search.balanced
        self.search.remember()
        before, way.V, way.driven = way.V, V, way.driven + step
        move_actuators(state)
        now = state.actuators.driven[0]
        now.head, now.displacement, now.load = way.driven, way.driven, V
        began = time.perf_counter()
        lower, upper = self.instant.bounds(V, moved, hidden)
        self.phases["bracket"] += time.perf_counter() - began
        if self.bonds.borne < 1.0:  # a bond broke before the end of the step
            before = min(before, way.seen[-1][2])
            lower = min(lower, before + self.bonds.borne * (V - before))
        sure = min(V, lower)  # the share of V that a drag carries does not count for the peak
        if sure > now.peak:
            now.peak, now.peak_at = sure, way.driven
        given = way.driven - V * self.compliance / self.weight
        way.seen.append((given, V, lower, upper, closing))
        self.grip.note(V)
        little = TAKES_UP * self.certificate.tolerance * max(abs(V), NOTHING * self.dead) * moved
        self.ties_hold = ties.unspent(state, UNLIMITED * self.dead * self.weight) > little

    def _judged(self) -> bool:
        """Update the bracket by the bounds; True if it is narrow enough and V is that of a mechanism."""
        bracket = self.certificate.bracket
        if self.certificate.strict:
            bracket[:] = max(bracket[0], self.way.seen[-1][2]), min(bracket[1], self.way.seen[-1][3])
            limit = True
        elif self.way.pushes:
            *bracket[:], limit = bounds.pushed_bounds(self.way.seen[-self.way.pushes :], self.search.smooth)
        else:
            *bracket[:], limit = bounds.limit_bounds(self.way.seen, self.weight / self.compliance, self.grip.rocks_on)
        if (limit := limit and not self.ties_hold) and bracket[1] <= NOTHING * self.dead:
            bracket[:] = 0.0
        self._record()
        if limit and bracket[1] == 0.0:
            return True
        width = 2.0 * self.certificate.tolerance * bracket[0]
        return bool(limit and bracket[1] - bracket[0] <= width and width > 0.0)

    def _record(self) -> None:
        if self.recorder is not None:
            began = time.perf_counter()
            if min(self.way.seen[-1][1:3]) <= self.way.limit_load:
                self.limit.record(self.recorder, self.way)
            self._write(len(self.way.seen) - 1)
            written = time.perf_counter()
            self.recorder.drain()
            self.phases["record"] += written - began
            self.elsewhere += time.perf_counter() - written

    def _write(self, number: int) -> None:
        """Add the present equilibrium, with its ``number``, to the record."""
        way, given = self.way, (self.state, number, self.elastic_at_start, self.certificate.bracket)
        terms = {"external": way.external, "friction": way.friction, "dashpots": way.lost}
        terms |= {"crushing": way.crushing, "fracture": way.fracture, "yielding": way.yielding}
        if self.recorder.write_equilibrium(*given, terms if number else None, framed=way.pushes > 0):
            way.framed = number
