"""A path of equilibria in the deformed geometry: one after the other, while something grows that drives the blocks.

What grows is a parameter: the share of their way that supports have gone, or a load. It grows a little, slowly against
gravity, and is held until the blocks rest, by dynamic relaxation with local damping. Finite rotations, joints that open
and slide and contacts that form on the way are those of a run in real time. Where the blocks come down instead, the
structure goes back to its last equilibrium and tries again so slowly that inertia does not count, then by half the
step, until the parameter at which it falls is known to the tolerance.

Blocks swing past where they rest, and what slides, yields, crushes or lifts does not take that back: so laws keep what
is so at the equilibrium, and nothing of the way there (`kernels.dynamics.swings`).

Frames of the fall follow that of the last equilibrium; their times are between its number and the next, and the row
next to them is its own: nothing is in equilibrium any more.

Bonds hold until the blocks rest; those that bear too much then break, and the blocks come to rest again. So no swing
breaks a bond, and the parameter at which bonds break is known to the tolerance too.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import replace
from functools import partial

import numpy as np

from dembrick.errors import HistoryError, NotConvergedError, UndecidedError, of_joint_forces
from dembrick.kernels.dynamics.loop import Limits
from dembrick.kernels.dynamics.rigid_bodies import Bodies
from dembrick.kernels.dynamics.swings import SWINGING
from dembrick.scenario.regimes import Control
from dembrick.simulation import interrupts
from dembrick.simulation.dynamics import joint_families
from dembrick.simulation.dynamics.checkpoint import Past
from dembrick.simulation.dynamics.dead_load import CHUNK, LOCAL_DAMPING, STEP, find_equilibrium, most_steps, unbalanced
from dembrick.simulation.dynamics.integrator import (
    LONGEST_MOVE,
    NO_LIMIT,
    Motion,
    advance,
    keep_of_rest,
    look_first,
    rest_in_each_other,
)
from dembrick.simulation.dynamics.loads import Driving
from dembrick.simulation.dynamics.outcome import MOVED, moved, places, settlement_collapse, standing
from dembrick.simulation.dynamics.paths.falls import seen_falling, watched
from dembrick.simulation.dynamics.paths.stage_loads import LoadsToCome, rest_by_increments
from dembrick.simulation.dynamics.recorder import Recorder
from dembrick.simulation.dynamics.run import EquilibriaRun
from dembrick.simulation.dynamics.state import seen
from dembrick.simulation.dynamics.support_motion import AT_REST
from dembrick.simulation.dynamics.time_histories import Curve, eased
from dembrick.simulation.floating_point import not_nan
from dembrick.simulation.session import Kept, Progress, Session, Snapshot

TOLERANCE = 1e-3  # of the parameter at which blocks come down, if the control says none
FEWEST = 768  # steps in which the parameter grows
BALANCED = 1e-6  # out-of-balance force over joint forces at which the blocks rest
ROUNDS = 5  # of as many steps as a dead-load equilibrium may take: blocks that slide come to rest slowly
DRIFTING = 2.0  # the way of blocks from the first quarter of a round to its end, over that to its middle, if they go on
DROPPED = 0.5  # of a block's least dimension: one that has moved so far since the last equilibrium has come down
FALL = 8  # frames of that, equally far apart
SPARE = 200  # equilibria for which there is room beside those of the way, and on the way to breaking bonds
LEFT = 50  # of these that a path keeps to find its end: where blocks follow a load on and on, it gives up
BREAKS = 64  # of each joint
FASTER = 4.0  # times as far as in the step before: so far blocks may be expected to move, whatever they did
SNAPSHOT = "equilibria"  # what a checkpoint of it has, and no other


class EquilibriumPath(ABC):
    """Equilibrium after equilibrium, while a parameter grows from zero.

    ``reached``: the parameter of the last equilibrium, and ``failed``: that at which the blocks came down (infinite:
    not yet) although it grew with all care (``careful``); ``broken``: at which bonds were seen to break, or blocks to
    jump (infinite: at none to come). ``fall``: frames of how they come down, once that is to be seen. ``way``:
    equilibria on the way, at the most. ``from_where``: the parameter and the `places` from which it is told whether
    blocks have come down: those of the last equilibrium, or of one before where these follow more closely than the
    tolerance. ``pace``: how far blocks moved on the last step (m a unit of the parameter), to the `places` ``at_last``.
    A kind of path says what drives the blocks at a parameter (`driven`), in how many steps it grows (`steps`) and where
    it goes next (`following`).
    """

    greatest = 1.0  # parameter of all
    step = STEP  # of the time step
    overshoot = 1.0  # how far blocks may swing in a step, over how far they rest: what a fall says of the parameter
    dropped = DROPPED
    often = math.inf  # see `falls`
    to_come: LoadsToCome | None = None
    increments, path_error = 1, 0.0  # of loads that came after others: `load_increments`

    def __init__(self, moving: Motion, control: Control, driving: Driving, session: Session, way: int):
        self.moving, self.control, self.driving, self.session, self.way = moving, control, driving, session, way
        self.past, self.tolerance = Past(moving, None), control.tolerance or TOLERANCE
        self.reached, self.failed, self.equilibria, self.careful = 0.0, math.inf, 0, False
        moving.laws = SWINGING
        self.broken, self.bonds = math.inf, joint_families.bonded(moving.state)
        self.bonded = joint_families.has_strengths(moving.state)
        self.from_where = 0.0, places(moving.state.bodies)
        self.pace, self.at_last = math.inf, self.from_where[1]
        self.room = way + SPARE + (BREAKS * len(moving.state.links.host) if self.bonded else 0)
        self.path: list[tuple[float, float, float]] = []
        self.collapse: dict | None = None
        self.fall: list[dict] | None = None
        self.free = ~np.asarray(moving.assembly.fixed)
        least = [float(np.ptp(shape.vertices, axis=0).min()) for shape in moving.assembly.shapes]
        self.least = np.array(least)[self.free]
        self.limits = Limits(NO_LIMIT, LONGEST_MOVE * moving.smallest)
        self.recorder = Recorder(moving, driving, session, self.past.extremes, 1, 1, equilibria=True)

    @property
    def dt(self) -> float:
        """A step of the relaxation (s)."""
        return self.step * self.moving.time_step

    @abstractmethod
    def driven(self, parameter: Curve) -> Driving:
        """Loads and supports of the run while the parameter is that function of time."""

    @abstractmethod
    def steps(self, begin: float, end: float) -> int:
        """In how many steps the parameter grows from ``begin`` to ``end``."""

    @abstractmethod
    def following(self) -> float | None:
        """The parameter of the next equilibrium, None at the end of the way."""

    def jumped(self, parameter: float) -> bool:
        """Whether the blocks came to that equilibrium by a jump, though there may be one nearby."""
        return False

    def close(self, parameter: float) -> float:
        """Distance of values of the parameter that are told apart, where blocks fall, bonds break or blocks jump."""
        return self.tolerance * parameter

    @abstractmethod
    def said(self, parameter: float) -> str:
        """A value of the parameter, for a message."""

    def come_down(self, before: np.ndarray, blocks: np.ndarray) -> dict:
        """How ``blocks`` (k,) come down since the joints looked like ``before`` (j, 9, of `seen`)."""
        return settlement_collapse(self.moving, before, blocks)

    @property
    def slow(self) -> str:
        """Advice for a message, beside others, if blocks find neither rest nor fall."""
        return "lower the stiffness of the joints"

    def _growing(self, begin: float, end: float) -> tuple[Driving, int]:
        """Loads and supports that take the parameter from one value to another, at rest at both ends, and how
        many steps that takes."""
        steps, start = self.steps(begin, end), self.moving.steps * self.dt

        def parameter(times: np.ndarray) -> np.ndarray:
            x = np.clip((times - start) / (steps * self.dt), 0.0, 1.0)
            return begin + (end - begin) * eased(x)

        return self.driven(parameter), steps

    def _at(self, parameter: float) -> Driving:
        """Loads and supports of the run while the parameter is constant."""
        driving = self.driven(lambda times: np.full(np.shape(times), parameter))
        driving = driving if self.to_come is None else self.to_come.held_off(driving)
        return replace(driving, constant=True)

    def advance(self, driving: Driving, steps: int) -> None:
        """Steps under what drives the blocks."""
        for done in range(0, steps, 8 * CHUNK):
            advance(self.moving, driving, min(steps - done, 8 * CHUNK), self.limits, LOCAL_DAMPING, self.step)
            if self.path:  # there is nothing to go on from before the first equilibrium
                self.session.pause(self, within=True)

    def _go(self, parameter: float) -> float | None:
        """Take the parameter there and let the blocks come to rest: the out-of-balance over the joint forces; None if
        they come down."""
        return watched(self, partial(self._gone, parameter, self.from_where[1]), self._go_back)

    def _gone(self, parameter: float, before: np.ndarray) -> float | None:
        """`_go`, in steps as long as they are, of blocks whose `places` were ``before`` at the last equilibrium."""
        driving, steps = self._growing(self.reached, parameter)
        joint_families.hold_bonds(self.moving.state, self.bonded)
        return None if seen_falling(self, driving, steps, before) else self._rest_and_break(parameter, before)

    def _rest_and_break(self, parameter: float, before: np.ndarray) -> float | None:
        """`_rest` with the bonds held; those that bear too much then break, and the blocks come to rest again."""
        joint_families.hold_bonds(self.moving.state, self.bonded)
        ratio = self._rest(parameter, before)
        if not self.bonded or ratio is None:
            return ratio
        joint_families.hold_bonds(self.moving.state, False)
        return self._rest(parameter, before)

    def _rest(self, parameter: float, before: np.ndarray) -> float | None:
        """Let the blocks come to rest, whose `places` were ``before`` at the last equilibrium; as `_go`."""
        still = self._at(parameter)
        balanced, chunks, passed, ratio = 0, most_steps(self.moving) // CHUNK, {}, 1.0
        for chunk in range(ROUNDS * chunks):
            if seen_falling(self, still, CHUNK, before):
                return None
            down = self.down(before)
            self.look_on(down)
            if down > 1.0:
                return None
            ratio, enough = unbalanced(self.moving.state, still, self.free)
            ratio = not_nan(ratio, f"what is out of balance at {self.said(parameter)}")
            balanced = balanced + 1 if ratio <= max(BALANCED, enough) else 0
            if balanced == 2:  # forces of a swing vanish at one moment, and not at the next
                return ratio
            if chunk % chunks in (chunks // 4, chunks // 2, chunks - 1):
                passed[chunk % chunks] = places(self.moving.state.bodies)
            if chunk % chunks == chunks - 1:
                first, middle, last = passed.values()
                if moved(last, first).max() > DRIFTING * moved(middle, first).max():
                    self.look_on(1.0)
                    return None
        raise UndecidedError(
            f"undecided at {self.said(parameter)}, neither at rest nor falling: after {ROUNDS * CHUNK * chunks} "
            f"steps of relaxation {of_joint_forces(ratio)} are still out of balance; {self.slow}"
        )

    def down(self, before: np.ndarray) -> float:
        """How far blocks have come down whose `places` were ``before``: 1 for one that has."""
        return float((self._away(before) / (self.dropped * self.least)).max())

    def _away(self, before: np.ndarray) -> np.ndarray:
        """How far every free block has moved or turned since the `places` of all were ``before`` (m)."""
        return moved(places(self.moving.state.bodies), before)[self.free]

    def look_on(self, down: float) -> None:
        """Keep a frame of how blocks come down, where that is to be seen: ``down`` is how far, 1 at the end."""
        if self.fall is None or not self.recorder.takes_frames:
            return
        last = self.equilibria - 1
        before = float(self.fall[-1]["time"][0]) - last if self.fall else 0.0
        if down >= 1.0 or down >= before + 1.0 / FALL:
            self.fall.append(self.recorder.frame(last + min(down, 1.0)))

    def begin(self, resumed: Snapshot | None) -> None:
        """The equilibrium under the dead loads, before the parameter grows; or go on from a checkpoint."""
        moving, past = self.moving, self.past
        if resumed is not None and SNAPSHOT in resumed:
            self.recorder.compile()
            goes_on = self.session.goes_on
            past.restore(resumed, goes_on)
            self._restore(resumed)
            self.kept = self._equilibrium()
            if goes_on is not None and goes_on.anything:
                ratio = self._rest_again(self.reached)
                if ratio is not None:
                    self.from_where = self.reached, places(self.moving.state.bodies)
                    self._note(self.reached, ratio)
            return
        held = replace(self._at(0.0), supports=AT_REST)
        resume = None if resumed is None else partial(past.restore, resumed)
        past.unbalanced[0] = find_equilibrium(moving, held, False, resume, partial(self.session.pause, past))
        moving.phases["dead_load"], moving.loop_seconds = moving.loop_seconds, 0.0
        self.recorder.compile()
        past.at_rest[:] = seen(moving.state.bodies, moving.state.links)
        ratio: float | None = float(past.unbalanced[0])
        joint_families.hold_bonds(moving.state, self.bonded)
        look_first(moving)
        if (
            self.bonded or moving.settled or moving.contact_detection.met
        ):  # bonds break now, and blocks move that others push than did before
            ratio = self._rest_again(0.0)
        else:
            self.advance(self._at(0.0), CHUNK)
        if ratio is not None:
            self._note(0.0, ratio)

    def _rest_again(self, parameter: float) -> float | None:
        """Rest under other laws, loads and ties than those of the last equilibrium, where the parameter is now: what is
        out of balance, None if the blocks fall."""
        stood = standing(self.moving.state.bodies)
        joint_families.hold_bonds(self.moving.state, self.bonded)
        rest, still = partial(self._rest_and_break, parameter, places(stood)), partial(self._at, parameter)
        look_first(self.moving)
        kept = Kept(self.past.snapshot() | self.moving.contact_detection.snapshot())

        def go_back() -> None:
            self.to_come = None
            self.moving.energy.fit(still().n_load, len(still().supports))
            self.past.go_back(kept)

        comes = partial(rest_by_increments, self, kept, still, rest) if self.moving.settled else rest
        ratio = watched(self, comes, go_back)
        if ratio is None:
            self.falls_at_once(stood)
        return ratio

    def _note(self, parameter: float, ratio: float) -> None:
        """Keep an equilibrium and record it; the driven displacement counts from the first."""
        if self.driving.driven is not None and not self.path:
            self.driving.driven.start_from(self.moving.state.bodies)
        keep_of_rest(self.moving, self._at(parameter))
        now, step = places(self.moving.state.bodies), parameter - self.reached
        if step > 0.0:
            pace = float(self._away(self.at_last).max()) / step
            self.pace = min(pace, FASTER * self.pace) if self.pace > 0.0 else pace
        self.at_last = now
        self.reached, self.bonds = parameter, joint_families.bonded(self.moving.state).copy()
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

    def falls_at_once(self, stood: Bodies) -> None:
        """Refusal of blocks that fall under the dead loads (NotConvergedError) and ``stood`` before."""
        if self.moving.contact_detection.met:
            raise NotConvergedError(rest_in_each_other(self.moving))
        raise NotConvergedError(
            "no equilibrium under the dead loads: blocks come down before anything grows, as bonds break or loads are "
            "not those of the stage before; check loads, supports and the strengths of the joints"
        )

    def _target(self) -> float | None:
        """The parameter of the next equilibrium; None at the end of the way or if its end is known well enough."""
        end = min(self.failed, self.broken)
        if end < math.inf:
            proven = self.falls - self.reached if end == self.failed else end - self.reached
            if proven > self.close(end):
                return 0.5 * (self.reached + end)
            return None if end == self.failed else self.broken
        target = self.following()
        if target is not None and self.equilibria >= self.room - LEFT:
            on = f"blocks still follow {self.said(self.reached)}; stiffen the ties or joints on which they move"
            raise UndecidedError(f"undecided: no limit in {self.equilibria} equilibria, as {on}")
        return target

    def run(self) -> None:
        """Go on to the end of the way or until the structure comes down. Raises NotConvergedError, Interrupted."""
        with interrupts.deferred():
            while self.collapse is None:
                target, last = self._target(), False
                if target is None and self.failed < math.inf:
                    target, last = self.failed, True  # once more, from nearby: how the blocks come down
                if target is None:
                    self.session.ended(self)
                    return
                self.session.pause(self)
                self.fall = [] if last else None
                ratio = self._go(target)
                if ratio is not None:
                    jumped, far = self.jumped(target), target - self.reached > self.close(target)
                    broke = (joint_families.bonded(self.moving.state) < self.bonds).any() or jumped
                    if broke and far and self.equilibria < self.room - 2 * LEFT and target < self.broken:
                        self.broken = target  # from nearby: which bonds break first, and whether blocks jump at all
                        self._go_back()
                        continue
                    if broke or target >= self.broken:
                        self.broken = math.inf
                    self.failed = math.inf if last else self.failed
                    self._note(target, ratio)
                    continue
                if last:
                    self._fell(standing(self.moving.state.bodies, self.kept.arrays))
                elif self.careful:
                    self.failed = target
                self.careful = True
                self._go_back()

    @property
    def falls(self) -> float:
        """The parameter at which the blocks fall for certain (infinite: at none that was tried). They swing on the way
        from one equilibrium to the next, so that a fall proves no limit nearer than the swing may have reached."""
        return self.reached + self.overshoot * (self.failed - self.reached)

    def _fell(self, stood: Bodies) -> None:
        """Note how the blocks come down, which ``stood`` before, and record it."""
        self.recorder.follow_up(self.fall or [])
        away = np.where(self.free, moved(places(self.moving.state.bodies), places(stood)), 0.0)
        self.collapse = self.come_down(seen(stood, self.moving.state.links), np.flatnonzero(away > MOVED * away.max()))

    def _go_back(self) -> None:
        own = self._own()
        self.kept.arrays["loop"][1] = self.moving.time_step  # as short as it has become
        self.past.restore(self.kept)
        self.kept.arrays.update(own)

    def found(self) -> EquilibriaRun:
        """Go the whole way, from the start or from where the session resumes it, and say what came of it.

        Raises NotConvergedError if the blocks do not stand before anything grows, UndecidedError if they find neither
        rest nor fall.
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
        return Progress("equilibrium", self.equilibria, self.way, None, True)

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
        """The last equilibrium: what was tried since leaves no trace."""
        return self.kept.arrays

    def _restore(self, snapshot: Snapshot) -> None:
        self.reaction = np.zeros_like(self.moving.reactions)
        shapes = self._own()
        numbers = snapshot.array(SNAPSHOT, shapes[SNAPSHOT]).tolist()
        self.reached, failed, broken, count, careful, since, pace = numbers
        self.pace, self.at_last = (pace if pace >= 0.0 else math.inf), places(self.moving.state.bodies)
        self.failed, self.broken = (end or math.inf for end in (failed, broken))
        self.bonds = joint_families.bonded(self.moving.state).copy()
        sound = 0.0 <= since <= self.reached <= self.greatest and self.reached < math.inf and min(failed, broken) >= 0.0
        if not (sound and count.is_integer() and 1 <= count <= len(shapes[f"{SNAPSHOT}.path"])):
            raise HistoryError(f"{snapshot.path}: this checkpoint is of no step of this run")
        self.equilibria, self.careful = int(count), bool(careful)
        self.from_where = since, snapshot.array(f"{SNAPSHOT}.stood", shapes[f"{SNAPSHOT}.stood"]).copy()
        rows = snapshot.array(f"{SNAPSHOT}.path", shapes[f"{SNAPSHOT}.path"])[: self.equilibria]
        self.path = list(map(tuple, rows.tolist()))
        self.reaction = snapshot.array(f"{SNAPSHOT}.reaction", self.reaction).copy()
        self.driving.start[:] = snapshot.array(f"{SNAPSHOT}.start", self.driving.start)
