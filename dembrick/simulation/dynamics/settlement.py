"""Quasi-static settlement: equilibrium after equilibrium in the deformed geometry while supports move.

The supports move a small part of their way, slowly against gravity, and stand still again until the blocks rest, by
dynamic relaxation with local damping. Finite rotations, joints that open and slide and contacts that form on the way
are those of a run in real time. Where the blocks come down instead, the structure goes back to its last equilibrium and
tries again so slowly that inertia does not count, then by half the step, until the settlement at which it falls is
known to the tolerance.

Frames of the fall follow that of the last equilibrium; their times are between its number and the next, and the row
next to them is its own: nothing is in equilibrium any more.

Bonds hold until the blocks rest; those that bear too much then break, and the blocks come to rest again. So no swing
breaks a bond, and the settlement at which bonds break is known to the tolerance too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from dembrick.errors import HistoryError, NotConvergedError
from dembrick.kernels.dynamics.loop import Limits
from dembrick.scenario.model import Output
from dembrick.scenario.regimes import COLLAPSE, COMPLETED, Control
from dembrick.simulation import interrupts
from dembrick.simulation.channels import bytes_of, recorded
from dembrick.simulation.dynamics import joint_families
from dembrick.simulation.dynamics.checkpoint import Past
from dembrick.simulation.dynamics.dead_load import CHUNK, LOCAL_DAMPING, STEP, find_equilibrium, most_steps, unbalanced
from dembrick.simulation.dynamics.integrator import LONGEST_MOVE, NO_LIMIT, Motion, advance
from dembrick.simulation.dynamics.loads import Driving
from dembrick.simulation.dynamics.outcome import MOVED, settlement_collapse
from dembrick.simulation.dynamics.recorder import Recorder
from dembrick.simulation.dynamics.run import MEETINGS, MotionRun
from dembrick.simulation.dynamics.state import seen
from dembrick.simulation.dynamics.support_motion import AT_REST
from dembrick.simulation.expected_cost import motion_seconds
from dembrick.simulation.session import Kept, Plan, Progress, Session, Snapshot

EQUILIBRIA = 80  # of the whole way, equally far apart
HALVINGS = 7  # of the first of these steps: the reaction changes most when the supports begin to move
WITHIN = 0.05  # of the smallest block: the longest step
GENTLE = 0.005  # of gravity: the greatest acceleration of the supports; at 0.02 hinges of stiff joints rattle open,
CAREFUL = 0.2  # of the tolerance: the same in gravities, once blocks have come down
FEWEST = 512  # steps of a move
BALANCED = 1e-6  # out-of-balance force over joint forces at which the blocks rest
DRIFTING = 1.5  # how much further blocks are at its end than at its middle if they go on and do not swing
DROPPED = 0.5  # of a block's least dimension: one that has moved so far since the last equilibrium has come down
FALL = 8  # frames of that, equally far apart
SPARE = 200  # equilibria for which there is room beside those asked for, and on the way to breaking bonds:
BREAKS = 64  # of each joint
SNAPSHOT = "settlement"  # what a checkpoint of it has, and no other


@dataclass
class SettlementRun(MotionRun):
    """A finished settlement. ``path`` (T, 3): displacement of the supports (m), reaction along their motion (N) and
    out-of-balance over joint forces of every equilibrium; ``reaction`` (s, 6): of all supports at the last one, and
    ``state``: everything then, for a stage that comes after."""

    path: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    reaction: np.ndarray = field(default_factory=lambda: np.zeros((0, 6)))
    state: Kept | None = None

    @property
    def reactions(self) -> np.ndarray:
        """Of the supports (s, 6) at the last equilibrium."""
        return self.reaction


def shares(longest: float, refine: float = 1.0) -> list[float]:
    """Shares of the way at which equilibria are looked for, none further than ``longest`` from the last."""
    count = math.ceil(max(EQUILIBRIA / refine, 1.0 / longest))
    first = [2.0**-k / count for k in range(HALVINGS, 0, -1)]
    return first + [(k + 1) / count for k in range(count)]


class Settlement:
    """The way of the supports, from equilibrium to equilibrium.

    ``share``: how much of it they have gone, and ``failed``: at which share the blocks came down (infinite: not yet)
    although they were moved with all care (``careful``); ``broken``: at which share bonds were seen to break (infinite:
    at none to come). ``fall``: frames of how they come down, once that is to be seen.
    """

    def __init__(self, moving: Motion, control: Control, driving: Driving, session: Session, refine: float = 1.0):
        self.moving, self.control, self.driving, self.session = moving, control, driving, session
        self.past = Past(moving, None)
        self.supports = driving.supports
        self.shares = shares(WITHIN * moving.smallest / self.supports.length, refine)
        self.gentle = refine * GENTLE
        self.share, self.failed, self.equilibria, self.careful = 0.0, math.inf, 0, False
        self.broken, self.bonds = math.inf, joint_families.bonded(moving.state)
        self.bonded = joint_families.has_strengths(moving.state)
        self.room = len(self.shares) + SPARE + (BREAKS * len(moving.state.links.host) if self.bonded else 0)
        self.path: list[tuple[float, float, float]] = []
        self.collapse: dict | None = None
        self.fall: list[dict] | None = None
        self.limits = Limits(NO_LIMIT, LONGEST_MOVE * moving.smallest)
        self.recorder = Recorder(moving, driving, session, 1, 1, None)
        self.dt = STEP * moving.time_step
        self.gravity = float(np.linalg.norm(moving.assembly.gravity))

    # --- between two equilibria

    def _moving(self, begin: float, end: float) -> tuple[Driving, int]:
        """What drives supports from one share to another, at rest at both ends, and the steps that takes."""
        distance = (end - begin) * self.supports.length
        gentle = min(self.gentle, CAREFUL * self.control.tolerance) if self.careful else self.gentle
        seconds = math.sqrt(6.0 * distance / (gentle * self.gravity)) if self.gravity > 0.0 else 0.0
        steps = max(FEWEST, math.ceil(seconds / self.dt))
        start = self.moving.steps * self.dt

        def share(times: np.ndarray) -> np.ndarray:
            x = np.clip((times - start) / (steps * self.dt), 0.0, 1.0)
            return begin + (end - begin) * x * x * (3.0 - 2.0 * x)

        return replace(self.driving, share=share), steps

    def _at(self, share: float) -> Driving:
        """What drives the run while the supports stand at a share of their way."""
        return replace(self.driving, share=lambda times: np.full(np.shape(times), share))

    def _advance(self, driving: Driving, steps: int) -> None:
        while steps > 0:
            some = min(steps, 8 * CHUNK)
            advance(self.moving, driving, some, self.limits, LOCAL_DAMPING, STEP)
            steps -= some
            self.session.pause(self, within=True)

    def _go(self, share: float) -> float | None:
        """Take the supports to a share of their way and let the blocks come to rest: the out-of-balance over the joint
        forces; None where they come down."""
        driving, steps = self._moving(self.share, share)
        before = self.moving.state.bodies.position.copy()
        joint_families.hold_bonds(self.moving.state, self.bonded)
        self._advance(driving, steps)
        ratio = self._rest(share, before)
        if not self.bonded or ratio is None:
            return ratio
        joint_families.hold_bonds(self.moving.state, False)
        return self._rest(share, before)

    def _rest(self, share: float, before: np.ndarray) -> float | None:
        """Let the blocks come to rest, which were at ``before`` (n, 3) at the last equilibrium; as `_go`."""
        still = self._at(share)
        free = ~np.asarray(self.moving.assembly.fixed)
        least = np.array([float(np.ptp(shape.vertices, axis=0).min()) for shape in self.moving.assembly.shapes])
        arrived, balanced, middle = self.moving.state.bodies.position.copy(), 0, 0.0
        most = most_steps(self.moving)
        for chunk in range(most // CHUNK):
            self._advance(still, CHUNK)
            away = np.linalg.norm(self.moving.state.bodies.position - before, axis=1)
            down = float((away / (DROPPED * least))[free].max())
            self._look_on(down)
            if down > 1.0:
                return None
            ratio, enough = unbalanced(self.moving.state, still, free)
            balanced = balanced + 1 if ratio <= max(BALANCED, enough) else 0
            if balanced == 2:  # forces of a swing vanish at one moment, and not at the next
                return ratio
            if chunk == most // CHUNK // 2:
                middle = _farthest(self.moving.state.bodies.position, arrived)
        if _farthest(self.moving.state.bodies.position, arrived) > DRIFTING * middle:
            self._look_on(1.0)
            return None
        raise NotConvergedError(
            f"no equilibrium at a settlement of {share * self.supports.length:.6g} m: after {most} steps of "
            f"relaxation the out-of-balance force is still {ratio:.2g} of the joint forces; lower the stiffness of the "
            "joints, or take quasi_static = false"
        )

    def _look_on(self, down: float) -> None:
        """Keep a frame of how blocks come down, where that is to be seen: ``down`` is how far, 1 at the end."""
        if self.fall is None or not self.recorder.takes_frames:
            return
        last = self.equilibria - 1
        before = float(self.fall[-1]["time"][0]) - last if self.fall else 0.0
        if down >= 1.0 or down >= before + 1.0 / FALL:
            self.fall.append(self.recorder.frame(last + min(down, 1.0)))

    # --- equilibria

    def begin(self, resumed: Snapshot | None) -> None:
        """The equilibrium under the dead loads, before the supports move; or go on from a checkpoint."""
        moving, past = self.moving, self.past
        if resumed is not None and SNAPSHOT in resumed:
            past.restore(resumed)
            self._restore(resumed)
            self.kept = self._equilibrium()
            return
        held = replace(self.driving, supports=AT_REST)
        resume = None if resumed is None else partial(past.restore, resumed)
        past.unbalanced[0] = find_equilibrium(moving, held, False, resume, partial(self.session.pause, past))
        moving.phases["dead_load"], moving.loop_seconds = moving.loop_seconds, 0.0
        past.at_rest[:] = seen(moving.state.bodies, moving.state.links)
        self._advance(self._at(0.0), CHUNK)
        ratio = float(past.unbalanced[0])
        if self.bonded or moving.settled:  # what the dead loads break, breaks now; other loads than before move blocks
            ratio = self._rest(0.0, moving.state.bodies.position.copy())
            if ratio is None:
                raise NotConvergedError(
                    "no equilibrium under the dead loads: blocks come down before the supports move, as bonds break or "
                    "loads are not those of the stage before; check loads, supports and the strengths of the joints"
                )
        self._note(0.0, ratio)

    def _note(self, share: float, ratio: float) -> None:
        """Keep an equilibrium and record it."""
        self.share, self.bonds = share, joint_families.bonded(self.moving.state).copy()
        self.past.extremes.note(self.moving)
        self.recorder.driving = self._at(share)
        self.reaction = self.moving.reactions
        displacement, load = self.recorder.curve(self.reaction)
        self.path.append((displacement, load, ratio))
        self.recorder.take(equilibrium=self.equilibria)
        self.equilibria += 1
        self.kept = self._equilibrium()

    def _equilibrium(self) -> Kept:
        return Kept(self.past.snapshot() | self._own(), path="the last equilibrium")

    def _target(self) -> float | None:
        """The share of the next equilibrium; None if the motion is complete or its end known well enough."""
        if self.failed < math.inf:
            close = self.failed - self.share <= self.control.tolerance * self.failed
            return None if close else 0.5 * (self.share + self.failed)
        if self.broken < math.inf:
            close = self.broken - self.share <= self.control.tolerance * self.broken
            return self.broken if close else 0.5 * (self.share + self.broken)
        return next((share for share in self.shares if share > self.share * (1.0 + 1e-12)), None)

    def run(self) -> None:
        """Go on until the motion is complete or the structure comes down. Raises NotConvergedError, Interrupted."""
        with interrupts.deferred():
            while self.collapse is None:
                share, last = self._target(), False
                if share is None and self.failed < math.inf:
                    share, last = self.failed, True  # once more, from nearby: how the blocks come down
                if share is None:
                    return
                self.session.pause(self)
                self.fall = [] if last else None
                ratio = self._go(share)
                if ratio is not None:
                    broke = (joint_families.bonded(self.moving.state) < self.bonds).any()
                    far = share - self.share > self.control.tolerance * share and self.equilibria < self.room - SPARE
                    if broke and far and share < self.broken:
                        self.broken = share  # from nearby: which bonds break first
                        self._go_back()
                        continue
                    if broke or share >= self.broken:
                        self.broken = math.inf
                    self.failed = math.inf if last else self.failed
                    self._note(share, ratio)
                    continue
                if last:
                    self._fell()
                elif self.careful:
                    self.failed = share
                self.careful = True
                self._go_back()

    def _fell(self) -> None:
        """Note how the blocks come down, and record it."""
        self.recorder.follow_up(self.fall or [])
        moving, links = self.moving, self.moving.state.links
        position = self.kept.arrays["bodies.position"]
        away = np.linalg.norm(moving.state.bodies.position - position, axis=1)
        away[np.asarray(moving.assembly.fixed)] = 0.0
        before = seen(
            moving.state.bodies._replace(position=position, rotation=self.kept.arrays["bodies.rotation"]), links
        )
        blocks = np.flatnonzero(away > MOVED * away.max())
        self.collapse = settlement_collapse(moving, before, blocks)

    def _go_back(self) -> None:
        own = self._own()
        self.past.restore(self.kept)
        for name, array in own.items():
            self.kept.arrays[name] = array

    def finished(self) -> SettlementRun:
        """What came of it."""
        moving, length = self.moving, self.supports.length
        if self.collapse is not None:
            low, high = self.share * length, self.failed * length
            self.collapse |= {"settlement": 0.5 * (low + high), "settlement_range": [low, high]}
        path = np.array(self.path)
        settings = {
            "contact_damping": moving.damping,
            "local_damping": LOCAL_DAMPING,
            "dead_load_steps": moving.dead_load_steps,
            "equilibria": len(path),
        }
        return SettlementRun(
            motion=moving,
            status=COMPLETED if self.collapse is None else COLLAPSE,
            collapse=self.collapse,
            unbalanced=float(path[:, 2].max()),
            furthest=self.past.extremes.furthest,
            fallen=np.isin(moving.assembly.names, [] if self.collapse is None else self.collapse["blocks"]),
            settings=settings,
            path=path,
            reaction=self.reaction,
            state=self.kept,
        )

    # --- checkpoints

    @property
    def where(self) -> str:
        """Equilibria found."""
        return f"equilibrium {self.equilibria}"

    @property
    def progress(self) -> Progress:
        """How far it is."""
        return Progress("equilibrium", self.equilibria, HALVINGS + len(self.shares), None, True)

    def _own(self) -> dict[str, np.ndarray]:
        path = np.zeros((self.room, 3))
        path[: len(self.path)] = np.array(self.path).reshape(-1, 3)
        numbers = np.array([self.share, min(self.failed, 2.0), min(self.broken, 2.0), self.equilibria, self.careful])
        return {SNAPSHOT: numbers, f"{SNAPSHOT}.path": path, f"{SNAPSHOT}.reaction": self.reaction}

    def snapshot(self) -> dict[str, np.ndarray]:
        """The last equilibrium: what was tried since leaves no trace."""
        return self.kept.arrays

    def _restore(self, snapshot: Snapshot) -> None:
        self.reaction = np.zeros_like(self.moving.reactions)
        shapes = self._own()
        self.share, failed, broken, count, careful = snapshot.array(SNAPSHOT, shapes[SNAPSHOT]).tolist()
        self.failed, self.broken = (math.inf if share >= 2.0 else share for share in (failed, broken))
        self.bonds = joint_families.bonded(self.moving.state).copy()
        if not (0.0 <= self.share <= 1.0 and count.is_integer() and 1 <= count <= len(shapes[f"{SNAPSHOT}.path"])):
            raise HistoryError(f"{snapshot.path}: this checkpoint is of no step of this run")
        self.equilibria, self.careful = int(count), bool(careful)
        rows = snapshot.array(f"{SNAPSHOT}.path", shapes[f"{SNAPSHOT}.path"])[: self.equilibria].tolist()
        self.path = [tuple(row) for row in rows]
        self.reaction = snapshot.array(f"{SNAPSHOT}.reaction", self.reaction).copy()


def _farthest(position: np.ndarray, start: np.ndarray) -> float:
    """How far (m) the centroid that has moved furthest is from where it was (n, 3)."""
    return float(np.linalg.norm(position - start, axis=1).max())


def settle(moving: Motion, control: Control, driving: Driving, session: Session, refine: float = 1.0) -> SettlementRun:
    """Move the supports along their way, equilibrium by equilibrium; ``refine``: steps over the usual.

    Raises NotConvergedError where the blocks do not stand before the supports move, or find neither rest nor fall.
    """
    way = Settlement(moving, control, driving, session, refine)
    way.begin(session.resumed)
    way.run()
    moving.compile_seconds += way.recorder.compile_seconds
    return way.finished()


def plan(moving: Motion, control: Control, driving: Driving, output: Output) -> Plan:
    """What it will take, roughly: as many steps as the supports move for, and again for the blocks to come to rest."""
    way = shares(WITHIN * moving.smallest / driving.supports.length)
    gravity, dt = float(np.linalg.norm(moving.assembly.gravity)), STEP * moving.time_step
    each = math.sqrt(6.0 * driving.supports.length / len(way) / (GENTLE * gravity)) / dt if gravity > 0.0 else FEWEST
    rows = len(way) + 1
    fields = recorded(moving.assembly, output.channels, control)
    memory = 3 * sum(array.nbytes for array in moving.state.arrays)
    memory += bytes_of(fields, rows, rows, rows * MEETINGS * len(moving.assembly.names))
    steps = int(2 * rows * max(FEWEST, each))
    return Plan(dt, moving.critical_time_step, steps, memory, motion_seconds(steps, len(moving.assembly.joints)))
