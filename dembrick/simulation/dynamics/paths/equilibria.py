"""A path of equilibria in the deformed geometry: a sequence of them under a growing load or support displacement.

One parameter drives the blocks: the share of their displacement that supports have gone through, or a load. It grows by
a small increment, slowly compared with gravity, and stays constant until the blocks rest, by dynamic relaxation with
local damping. Finite rotations, opening and sliding joints and new contacts are treated as in a run in real time. After
a collapse the increment is repeated from the last equilibrium, so slowly that inertia is negligible, then by halves
until the parameter at collapse is known to the tolerance.

Blocks swing past their equilibrium. Sliding, yielding, crushing and uplift on that swing would be irreversible, so the
laws remember only their state at the equilibrium (`kernels.dynamics.law_memory`).

Frames of the collapse follow that of the last equilibrium: their times lie between its number and the next.
Bonds are kept intact until the blocks rest; those that are overloaded then break, and the blocks come to rest again
until none is overloaded. So no swing breaks a bond, and the parameter at failure is known to the tolerance too.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import replace
from functools import partial

import numpy as np

from dembrick.errors import HistoryError, NotConvergedError, UndecidedError, of_joint_forces
from dembrick.kernels.dynamics.law_memory import FORGETTING, SEARCHING
from dembrick.kernels.dynamics.loop import Limits
from dembrick.kernels.dynamics.rigid_bodies import Bodies
from dembrick.scenario.regimes import Control
from dembrick.simulation import interrupts
from dembrick.simulation.dynamics import joint_families
from dembrick.simulation.dynamics.checkpoint import RunHistory
from dembrick.simulation.dynamics.dead_load import CHUNK, LOCAL_DAMPING, STEP, find_equilibrium, most_steps, unbalanced
from dembrick.simulation.dynamics.integrator import (
    LONGEST_MOVE,
    NO_LIMIT,
    Motion,
    advance,
    detect_initial_contacts,
    rest_in_each_other,
    stop,
    update_history_at_rest,
)
from dembrick.simulation.dynamics.loads import Driving
from dembrick.simulation.dynamics.outcome import MOVED, moved, places, settlement_collapse, standing
from dembrick.simulation.dynamics.paths.falls import falls_in, in_resolved_steps, still_follows
from dembrick.simulation.dynamics.paths.stage_loads import PendingLoads, rest_by_increments
from dembrick.simulation.dynamics.recorder import Recorder
from dembrick.simulation.dynamics.run import EquilibriaRun
from dembrick.simulation.dynamics.state import seen
from dembrick.simulation.dynamics.support_motion import AT_REST
from dembrick.simulation.dynamics.time_histories import Curve, eased
from dembrick.simulation.floating_point import not_nan
from dembrick.simulation.session import Kept, Progress, Session, Snapshot

TOLERANCE = 1e-3  # relative, of the parameter at collapse, if the control sets none
FEWEST = 768  # time steps in which the parameter grows by an increment, at least
BALANCED = 1e-6  # out-of-balance force over joint forces at which the blocks rest
ROUNDS = 5  # each of as many steps as a dead-load equilibrium may take: sliding blocks come to rest slowly
KEPT = 0.05  # of a round: if blocks do not rest within it, joints that open lose their shear
INTACT = 0.05  # of a round: if blocks do not rest within it after a bond broke, the other bonds may break on the swing
DRIFTING = 2.0  # displacement from a quarter of a round to its end over that to its middle: blocks drift if it is more
DROPPED = 0.5  # of a block's least dimension: a block that has moved so far since the last equilibrium has collapsed
FALL = 8  # frames of a collapse, equally far apart
SPARE = 200  # room for equilibria beyond the planned ones, such as those that narrow down where bonds break
LEFT = 50  # of these, reserved for narrowing down the end; a path that still follows its load by then gives up
BREAKS = 64  # of each joint
FASTER = 4.0  # bound on the growth of the predicted displacement rate from one step to the next
SNAPSHOT = "equilibria"  # array that only checkpoints of such a path have


class EquilibriumPath(ABC):
    """A sequence of equilibria while a parameter grows from zero.

    ``reached``: the parameter of the last equilibrium, and ``failed``: that at which the blocks collapsed (infinite:
    not yet) although it grew slowly (``careful``); ``broken``: that at which bonds broke or blocks jumped (infinite: at
    none to come). ``fall``: frames of the collapse, None unless they are wanted. ``way``: equilibria to leave
    room for, beside `SPARE`. ``from_where``: the parameter and the `places` of the equilibrium from which displacements
    tell a collapse: the last one, or an earlier one if equilibria are closer than the tolerance. ``pace``: displacement
    per unit of the parameter in the last step (m), which ended at the `places` ``at_last``. Subclasses define the loads
    and supports at a parameter (`driven`), the number of time steps of an increment (`steps`) and the next parameter
    (`following`).
    """

    greatest = 1.0  # parameter of all
    step = STEP  # of the time step
    overshoot = 1.0  # displacement on the swing of a step over that at its equilibrium, at most: see `falls`
    dropped = DROPPED
    often = math.inf  # see `falls_in`
    to_come: PendingLoads | None = None
    new_loads, loads_wait = None, False  # see `PendingLoads`
    increments, path_error = 1, 0.0  # of loads that are added to those of the stage before: `load_increments`

    def __init__(self, moving: Motion, control: Control, driving: Driving, session: Session, way: int):
        self.moving, self.control, self.driving, self.session = moving, control, driving, session
        self.past, self.tolerance = RunHistory(moving, None), control.tolerance or TOLERANCE
        self.reached, self.failed, self.equilibria, self.careful = 0.0, math.inf, 0, False
        moving.laws = SEARCHING
        self.broken, self.bonds = math.inf, joint_families.bonds(moving.state)
        self.bonded = joint_families.has_strengths(moving.state)
        self.from_where = 0.0, places(moving.state.bodies)
        self.pace, self.at_last = math.inf, self.from_where[1]
        self.room = way + SPARE + (BREAKS * len(moving.state.links.host) if self.bonded else 0)
        self.path: list[tuple[float, float, float]] = []
        self.collapse: dict | None = None
        self.fall: list[dict] | None = None
        self.free = ~np.asarray(moving.assembly.fixed)
        self.least = moving.assembly.least_size[self.free]
        self.limits = Limits(NO_LIMIT, LONGEST_MOVE * moving.smallest)
        self.recorder = Recorder(moving, driving, session, self.past.extremes, 1, 1, equilibria=True)

    @property
    def dt(self) -> float:
        """Time step of the relaxation (s)."""
        return self.step * self.moving.time_step

    @abstractmethod
    def driven(self, parameter: Curve) -> Driving:
        """Loads and supports of the run for a ``parameter`` as a function of time."""

    @abstractmethod
    def steps(self, begin: float, end: float) -> int:
        """Number of time steps in which the parameter grows from ``begin`` to ``end``."""

    @abstractmethod
    def following(self) -> float | None:
        """The parameter of the next equilibrium, None at the end of the path."""

    def jumped(self, parameter: float) -> bool:
        """Whether the blocks jumped to this equilibrium although there may be one nearer to the last."""
        return False

    def close(self, parameter: float) -> float:
        """Resolution of the parameter to which collapse, breaking bonds and jumps are located."""
        return self.tolerance * parameter

    @abstractmethod
    def said(self, parameter: float) -> str:
        """A value of the parameter as text for a message."""

    def collapse_record(self, before: np.ndarray, blocks: np.ndarray) -> dict:
        """Record of the collapse of ``blocks`` (k,) from the joint positions ``before`` (j, 9, of `seen`)."""
        return settlement_collapse(self.moving, before, blocks)

    @property
    def slow(self) -> str:
        """Advice in the message on blocks that neither come to rest nor collapse."""
        return "lower the stiffness of the joints"

    def _growing(self, begin: float, end: float) -> tuple[Driving, int]:
        """Loads and supports while the parameter grows smoothly from ``begin`` to ``end``, with zero rate at both, and
        the number of time steps."""
        steps, start = self.steps(begin, end), self.moving.steps * self.dt

        def parameter(times: np.ndarray) -> np.ndarray:
            x = np.clip((times - start) / (steps * self.dt), 0.0, 1.0)
            return begin + (end - begin) * eased(x)

        return self.driven(parameter), steps

    def _at(self, parameter: float) -> Driving:
        """Loads and supports of the run at a constant parameter."""
        driving = self.driven(lambda times: np.full(np.shape(times), parameter))
        return replace(driving if self.to_come is None else self.to_come.held_off(driving), constant=True)

    def advance(self, driving: Driving, steps: int) -> None:
        """Advance by ``steps`` time steps under the loads and supports ``driving``."""
        for done in range(0, steps, 8 * CHUNK):
            advance(self.moving, driving, min(steps - done, 8 * CHUNK), self.limits, LOCAL_DAMPING, self.step)
            if self.path:  # before the first equilibrium there is no state to restart from
                self.session.pause(self, within=True)

    def _go(self, parameter: float) -> float | None:
        """Change the parameter and relax the blocks; return the out-of-balance over the joint forces, None if they
        collapse."""
        return in_resolved_steps(self, partial(self._gone, parameter, self.from_where[1]), self._go_back)

    def _gone(self, parameter: float, before: np.ndarray) -> float | None:
        """`_go` with the present time step, for blocks whose `places` were ``before`` at the last equilibrium."""
        self.moving.laws = SEARCHING
        driving, steps = self._growing(self.reached, parameter)
        joint_families.keep_bonds_intact(self.moving.state, self.bonded)
        return None if falls_in(self, driving, steps, before) else self._rest_and_break(parameter, before)

    def _rest_and_break(self, parameter: float, before: np.ndarray, intact: float = math.inf) -> float | None:
        """`_rest` with all bonds intact; those that are overloaded then break, and the blocks come to rest again with
        the others intact, since which bonds a swing breaks would depend on rounding."""
        while True:
            joint_families.keep_bonds_intact(self.moving.state, self.bonded)
            ratio = self._rest(parameter, before, intact)
            joint_families.keep_bonds_intact(self.moving.state, False)
            if not self.bonded or ratio is None:
                return ratio
            bonds, intact = joint_families.bonds(self.moving.state), INTACT
            self.advance(self._at(parameter), 1)
            if not (joint_families.bonds(self.moving.state) < bonds).any():
                return ratio

    def _rest(self, parameter: float, before: np.ndarray, intact: float) -> float | None:
        """Relax blocks whose `places` were ``before`` at the last equilibrium; returns as `_go`. Bonds stay ``intact``
        for that part of a round."""
        still, balanced, chunks, passed, ratio = self._at(parameter), 0, most_steps(self.moving) // CHUNK, {}, 1.0
        for chunk in range(ROUNDS * chunks):
            self.moving.laws = SEARCHING if chunk < KEPT * chunks else FORGETTING
            if chunk >= intact * chunks:
                joint_families.keep_bonds_intact(self.moving.state, False)
            if falls_in(self, still, CHUNK, before):
                return None
            down = self.down(before)
            self.record_collapse_frame(down)
            if down > 1.0:
                return None
            ratio, enough = unbalanced(self.moving.state, still, self.free)
            ratio = not_nan(ratio, f"the out-of-balance force at {self.said(parameter)}")
            balanced = balanced + 1 if ratio <= max(BALANCED, enough) else 0
            if balanced == 2:  # on a swing the out-of-balance force may pass through zero, but not twice running
                stop(self.moving.state.bodies)
                return ratio
            if chunk % chunks in (chunks // 4, chunks // 2, chunks - 1):
                passed[chunk % chunks] = places(self.moving.state.bodies)
            if chunk % chunks == chunks - 1:
                first, middle, last = passed.values()
                if moved(last, first).max() > DRIFTING * moved(middle, first).max():
                    self.record_collapse_frame(1.0)
                    return None
        raise UndecidedError(
            f"undecided at {self.said(parameter)}, neither in equilibrium nor falling: {of_joint_forces(ratio)} are "
            f"still out of balance after {ROUNDS * CHUNK * chunks} steps of relaxation; {self.slow}"
        )

    def down(self, before: np.ndarray) -> float:
        """Greatest displacement since the `places` ``before``, over that of a collapsed block: above 1 one has."""
        return float((self._away(before) / (self.dropped * self.least)).max())

    def _away(self, before: np.ndarray) -> np.ndarray:
        """Displacement of every free block, by translation or rotation, since the `places` ``before`` (m)."""
        return moved(places(self.moving.state.bodies), before)[self.free]

    def record_collapse_frame(self, down: float) -> None:
        """Record a frame of the collapse if wanted; ``down`` is the progress of the fall, 1 at its end."""
        if self.fall is None or not self.recorder.takes_frames:
            return
        last = self.equilibria - 1
        before = float(self.fall[-1]["time"][0]) - last if self.fall else 0.0
        if down >= 1.0 or down >= before + 1.0 / FALL:
            self.fall.append(self.recorder.frame(last + min(down, 1.0)))

    def begin(self, resumed: Snapshot | None) -> None:
        """Find the equilibrium under the dead loads, before the parameter grows, or restart from a checkpoint."""
        moving, past = self.moving, self.past
        if resumed is not None and SNAPSHOT in resumed:
            self.recorder.compile()
            goes_on = self.session.goes_on
            past.restore(resumed, goes_on)
            self._restore(resumed)
            self.kept = self._equilibrium()
            if goes_on is not None and goes_on.anything:
                found = self._rest_again(self.reached)
                if found is not None:
                    self.from_where = self.reached, places(self.moving.state.bodies)
                    self._note(self.reached, found)
            return
        held = replace(self._at(0.0), supports=AT_REST)
        resume = None if resumed is None else partial(past.restore, resumed)
        past.unbalanced[0] = find_equilibrium(moving, held, False, resume, partial(self.session.pause, past))
        moving.phases["dead_load"], moving.loop_seconds = moving.loop_seconds, 0.0
        self.recorder.compile()
        past.at_rest[:] = seen(moving.state.bodies, moving.state.links)
        ratio: float | None = float(past.unbalanced[0])
        joint_families.keep_bonds_intact(moving.state, self.bonded)
        detect_initial_contacts(moving)
        if self.bonded or moving.settled or moving.contact_detection.met:
            # bonds may break now, and new contacts or the loads of a new stage move blocks
            ratio = self._rest_again(0.0)
        else:
            self.advance(self._at(0.0), CHUNK)
        if ratio is not None:
            self._note(0.0, ratio)

    def _rest_again(self, parameter: float) -> float | None:
        """Relax the blocks at the same parameter under laws, loads and ties that differ from those of the last
        equilibrium; return the out-of-balance over the joint forces, None if they collapse."""
        stood = standing(self.moving.state.bodies)
        joint_families.keep_bonds_intact(self.moving.state, self.bonded)
        rest, still = partial(self._rest_and_break, parameter, places(stood)), partial(self._at, parameter)
        detect_initial_contacts(self.moving)
        kept = Kept(self.past.snapshot() | self.moving.contact_detection.snapshot())

        def go_back() -> None:
            self.to_come = None
            self.moving.energy.fit(still().n_load, len(still().supports))
            self.past.go_back(kept)

        comes = partial(rest_by_increments, self, kept, still, rest) if self.moving.settled or self.path else rest
        ratio = in_resolved_steps(self, comes, go_back)
        if ratio is None:
            self.refuse_collapse_under_dead_loads(stood)
        return ratio

    def _note(self, parameter: float, ratio: float) -> None:
        """Store and record an equilibrium; the driven displacement is measured from the first."""
        if self.driving.driven is not None and not self.path:
            self.driving.driven.start_from(self.moving.state.bodies)
        update_history_at_rest(self.moving, self._at(parameter))
        now, step = places(self.moving.state.bodies), parameter - self.reached
        if step > 0.0:
            pace = float(self._away(self.at_last).max()) / step
            self.pace = min(pace, FASTER * self.pace) if self.pace > 0.0 else pace
        self.at_last = now
        self.reached, self.bonds = parameter, joint_families.bonds(self.moving.state)
        self.recorder.driving = self._at(parameter)
        self.reaction = self.moving.reactions
        self.path.append((*self.recorder.curve(self.reaction), ratio))
        if not self.equilibria or parameter > self.from_where[0] * (1.0 + self.tolerance):
            self.from_where = parameter, now
        self.recorder.take(equilibrium=self.equilibria)
        self.equilibria += 1
        self.kept = self._equilibrium()

    def _equilibrium(self) -> Kept:
        return Kept(self.past.snapshot() | self._own(), path="the last equilibrium")

    def refuse_collapse_under_dead_loads(self, stood: Bodies) -> None:
        """Raise NotConvergedError for blocks that collapse under the dead loads; ``stood``: their positions before."""
        if self.moving.contact_detection.met:
            raise NotConvergedError(rest_in_each_other(self.moving))
        raise NotConvergedError(
            "no equilibrium under the dead loads: blocks fall before the load grows, because bonds break or loads "
            "differ from those of the previous stage; check loads, supports and the strengths of the joints"
        )

    def _target(self) -> float | None:
        """The parameter of the next equilibrium; None at the end of the path or if collapse is located well enough."""
        end = min(self.failed, self.broken)
        if end < math.inf:
            proven = self.falls - self.reached if end == self.failed else end - self.reached
            if proven > self.close(end):
                return 0.5 * (self.reached + end)
            return None if end == self.failed else self.broken
        target = self.following()
        if target is not None and self.equilibria >= self.room - LEFT:
            raise UndecidedError(still_follows(self))
        return target

    def run(self) -> None:
        """Follow the path to its end or until the structure collapses. Raises NotConvergedError, Interrupted."""
        with interrupts.deferred():
            while self.collapse is None:
                target = self._target()
                if target is None and self.failed < math.inf:
                    target = self.failed  # once more, from nearby, to record the collapse
                if target is None:
                    self.session.ended(self)
                    return
                self.session.pause(self)
                self.fall = [] if self.careful else None
                ratio = self._go(target)
                if ratio is not None:
                    jumped, far = self.jumped(target), target - self.reached > self.close(target)
                    broke = (joint_families.bonds(self.moving.state) < self.bonds).any() or jumped
                    if broke and far and self.equilibria < self.room - 2 * LEFT and target < self.broken:
                        self.broken = target  # approach it in smaller steps: which bonds break first, is it a jump?
                        self._go_back()
                        continue
                    if broke or target >= self.broken:
                        self.broken = math.inf
                    self.failed = math.inf if target >= self.failed else self.failed
                    self._note(target, ratio)
                    continue
                if self.careful:
                    self.failed = target
                    if self._target() is None:  # they fell from the nearest equilibrium
                        self._fell(standing(self.moving.state.bodies, self.kept.arrays))
                self.careful = True
                self._go_back()

    @property
    def falls(self) -> float:
        """Upper bound of the parameter at collapse (infinite: none yet). Blocks overshoot on the swing from one
        equilibrium to the next, so a collapse proves no limit below the parameter that the swing may stand for."""
        return self.reached + self.overshoot * (self.failed - self.reached)

    def _fell(self, stood: Bodies) -> None:
        """Record the collapse of the blocks from where they ``stood`` at the last equilibrium."""
        self.recorder.follow_up(self.fall or [])
        away = np.where(self.free, moved(places(self.moving.state.bodies), places(stood)), 0.0)
        blocks = np.flatnonzero(away > MOVED * away.max())
        self.collapse = self.collapse_record(seen(stood, self.moving.state.links), blocks)

    def _go_back(self) -> None:
        own = self._own()
        self.kept.arrays["loop"][1] = self.moving.time_step  # keeps a time step that was shortened
        self.past.restore(self.kept)
        self.kept.arrays.update(own)

    def found(self) -> EquilibriaRun:
        """Follow the whole path, from the start or from the checkpoint of the session, and return its result.

        Raises NotConvergedError if blocks fall under the dead loads, UndecidedError if they neither rest nor collapse.
        """
        self.begin(self.session.resumed)
        self.run()
        return self.finished()

    def finished(self) -> EquilibriaRun:
        """Result of the path."""
        last = {"reaction": self.reaction, "state": self.kept, "bracket": (self.reached, self.falls)}
        return EquilibriaRun.of(self.past, np.array(self.path), self.collapse, **last)

    @property
    def where(self) -> str:
        return f"equilibrium {self.equilibria}"

    @property
    def progress(self) -> Progress:
        return Progress("equilibrium", self.equilibria)  # increments adapt: nobody knows how many there will be

    def _own(self) -> dict[str, np.ndarray]:
        path = np.zeros((self.room, 3))
        path[: len(self.path)] = np.array(self.path).reshape(-1, 3)
        ends = (0.0 if end == math.inf else end for end in (self.failed, self.broken))  # both are greater than zero
        since, stood = self.from_where
        pace = self.pace if self.pace < math.inf else -1.0
        numbers = np.array([self.reached, *ends, self.equilibria, self.careful, since, pace])
        own = {"path": path, "reaction": self.reaction, "start": self.driving.start, "stood": stood}
        return {SNAPSHOT: numbers} | {f"{SNAPSHOT}.{name}": array for name, array in own.items()}

    def snapshot(self) -> dict[str, np.ndarray]:
        """Arrays of the last equilibrium, without any trace of attempts since."""
        return self.kept.arrays

    def _restore(self, snapshot: Snapshot) -> None:
        self.reaction = np.zeros_like(self.moving.reactions)
        shapes = self._own()
        numbers = snapshot.array(SNAPSHOT, shapes[SNAPSHOT]).tolist()
        self.reached, failed, broken, count, careful, since, pace = numbers
        self.pace, self.at_last = (pace if pace >= 0.0 else math.inf), places(self.moving.state.bodies)
        self.failed, self.broken = (end or math.inf for end in (failed, broken))
        self.bonds = joint_families.bonds(self.moving.state)
        sound = 0.0 <= since <= self.reached <= self.greatest and self.reached < math.inf and min(failed, broken) >= 0.0
        if not (sound and count.is_integer() and 1 <= count <= len(shapes[f"{SNAPSHOT}.path"])):
            raise HistoryError(f"{snapshot.path}: this checkpoint holds no step of this run")
        self.equilibria, self.careful = int(count), bool(careful)
        self.from_where = since, snapshot.array(f"{SNAPSHOT}.stood", shapes[f"{SNAPSHOT}.stood"]).copy()
        rows = snapshot.array(f"{SNAPSHOT}.path", shapes[f"{SNAPSHOT}.path"])[: self.equilibria]
        self.path = list(map(tuple, rows.tolist()))
        self.reaction = snapshot.array(f"{SNAPSHOT}.reaction", self.reaction).copy()
        self.driving.start[:] = snapshot.array(f"{SNAPSHOT}.start", self.driving.start)
