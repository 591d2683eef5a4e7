"""Services around a time loop: its record, its checkpoints, its progress."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import numpy as np

from dembrick.scenario.model import Output
from dembrick.simulation import expected_cost, interrupts

if TYPE_CHECKING:
    from dembrick.scenario.stages import TiesBefore
    from dembrick.simulation.statics.state import State

OTHER_JOINTS = (
    "the joints or contact points of this stage are not those that the stage before has left: run the scenario from "
    "its start"
)
Observer = Callable[[Mapping[str, np.ndarray], Mapping[str, np.ndarray]], None]


class Snapshot(Protocol):
    """Arrays by name from which a time loop goes on, read one by one because they may come from a stranger's file."""

    path: str

    def __contains__(self, name: str) -> bool:
        """Whether there is an array of that name."""

    def array(self, name: str, like: np.ndarray) -> np.ndarray:
        """The array ``name``, which must have the shape and the type of ``like``."""


class Kept:
    """A snapshot in memory: copies of ``arrays``, and of those that were read from ``source``."""

    def __init__(self, arrays: Mapping[str, np.ndarray], source: Snapshot | None = None, path: str = "what is kept"):
        self.arrays = {name: np.array(array) for name, array in arrays.items()}
        self._source, self.path = source, path if source is None else source.path

    def __contains__(self, name: str) -> bool:
        return name in self.arrays or (self._source is not None and name in self._source)

    def array(self, name: str, like: np.ndarray) -> np.ndarray:
        if name not in self.arrays and self._source is not None:
            self.arrays[name] = np.array(self._source.array(name, like))
        return self.arrays[name]


class Prefixed:
    """The arrays of a snapshot whose names begin with a prefix, without it."""

    def __init__(self, snapshot: Snapshot, prefix: str):
        self._snapshot, self._prefix, self.path = snapshot, prefix, snapshot.path

    def __contains__(self, name: str) -> bool:
        return f"{self._prefix}{name}" in self._snapshot

    def array(self, name: str, like: np.ndarray) -> np.ndarray:
        return self._snapshot.array(f"{self._prefix}{name}", like)


class Pausable(Protocol):
    """A run between two chunks: where it is, and all that it would go on from."""

    where: str  # for a message, as "step 12 (t = 0.5 s)"
    progress: Progress

    def snapshot(self) -> Mapping[str, np.ndarray]:
        """Arrays by name, not copied."""


@dataclass(frozen=True)
class Progress:
    """How far a run is: so many steps ``done`` of a ``stage``, of ``total`` (None: nobody knows, or ``at_most`` so
    many), at the simulated ``time`` (s; None if there is none)."""

    stage: str
    done: int
    total: int | None = None
    time: float | None = None
    at_most: bool = False


@dataclass(frozen=True)
class GoesOn:
    """Changes as a run goes on from a snapshot of another: ``ties``, None if they are the same; which row of the
    work of loads each row is of (``loads``), -1 for one that was not there, None if they are the same; the rows of
    those that are ``gone``, with their blocks; and whether ``anything`` does."""

    ties: TiesBefore | None
    loads: tuple[int, ...] | None
    gone: tuple[tuple[int, int], ...]
    anything: bool


DEAD_LOADS = "dead-load equilibrium: step"
TOLD_EVERY = 0.1  # s, between two words on how far a run is


@dataclass(frozen=True)
class Plan:
    """Size and cost of a run: time step and critical time step (s), steps, bytes beside those of the program itself,
    and ``seconds`` of compiled code on one core (None: nobody knows). ``exact``: the steps are not an estimate;
    ``at_most``: they are those of the longest such run. ``seconds_falling``: of a run in real time in which all blocks
    come down in a heap, if they may; ``seconds`` is then of one in which they stand. ``seconds_snapping``: of a search
    in which blocks snap on and on, where nobody knows whether they do. ``within``: the factor by which an estimate of
    the steps may be off."""

    time_step: float
    critical_time_step: float
    steps: int
    memory: int
    seconds: float | None = None
    exact: bool = False
    at_most: bool = False
    seconds_falling: float | None = None
    seconds_snapping: float | None = None
    within: float = 2.0


@dataclass
class Session:
    """Surroundings of a run; without any, it only answers.

    ``observe(rows, frames)`` gets copies of what each chunk of steps brought (see ``recorder``), of the channels of
    ``output``. ``keep(arrays, where)`` writes a checkpoint, every ``output.checkpoint`` seconds and when a signal ends
    the run. A run with ``resumed`` goes on from that snapshot. ``start``: the state of the searches that another run of
    the same blocks has left, to start on; None for the blocks as they are drawn. ``ties_before``: which of its
    ties this run goes on with, None: they are the same; ``force_error`` (N): by how much the joint forces at the end of
    that run may be off; ``hands_on``: whether another starts on what this one leaves. ``goes_on``: what is not as in
    the run that ``resumed`` is of; ``tilts``: V is the tangent of the angle of a table, and the record is of that
    table. ``keep_last`` gets the snapshot of the end. ``tell`` hears how far it is, ten times a second, and ``report``
    remarks.
    """

    observe: Observer | None = None
    output: Output = field(default_factory=Output)
    keep: Callable[[Mapping[str, np.ndarray], str], None] | None = None
    resumed: Snapshot | None = None
    start: State | Kept | None = None
    ties_before: TiesBefore | None = None
    force_error: float = 0.0
    hands_on: bool = False
    tilts: bool = False
    goes_on: GoesOn | None = None
    keep_last: Callable[[Mapping[str, np.ndarray], str], None] | None = None
    tell: Callable[[Progress], None] | None = None
    report: Callable[[str], None] | None = None
    last_kept: float = field(default_factory=time.monotonic)
    last_told: float = 0.0

    def warn_if_long(self, seconds: float, remedy: str, at_most: bool = False) -> None:
        """Report a run that will take over an hour, before it starts."""
        if not self.report or seconds < 0.1 * expected_cost.LONG:
            return
        seconds *= expected_cost.slowness()
        if seconds > expected_cost.LONG:
            takes = f"{'at most' if at_most else 'about'} {expected_cost.duration(seconds)}"
            self.report(f"this run will take {takes} of computing on one core; to shorten it, {remedy}")

    def undisturbed(self) -> float:
        """Seconds until somebody wants a checkpoint, or a word on how far the run is."""
        now, soon = time.monotonic(), [np.inf]
        if self.tell is not None:
            soon.append(self.last_told + TOLD_EVERY - now)
        if self.keep is not None:
            soon.append(self.last_kept + self.output.checkpoint - now)
        return max(0.0, min(soon))

    def ended(self, run: Pausable) -> None:
        """At the end of a run, behind its last row."""
        if self.keep_last is not None:
            self.keep_last(run.snapshot(), run.where)

    @classmethod
    def of(cls, given: Session | Observer | None) -> Session:
        """A session out of a session, of an observer alone, or of nothing."""
        return given if isinstance(given, Session) else cls(observe=given)

    def pause(self, run: Pausable, within: bool = False) -> None:
        """Between two chunks: write a checkpoint if it is time for one; Interrupted if a signal asked to stop.

        ``within`` a chunk, whose beginning the run still knows, only a signal counts.
        """
        signum = interrupts.requested()
        if self.tell is not None and time.monotonic() - self.last_told >= TOLD_EVERY:
            self.tell(run.progress)
            self.last_told = time.monotonic()
        due = not within and time.monotonic() - self.last_kept >= self.output.checkpoint
        if self.keep is not None and (due or signum):
            self.keep(run.snapshot(), run.where)
            self.last_kept = time.monotonic()
        if signum:
            raise interrupts.Interrupted(signum, f"interrupted after {run.where}")


def step_at(step: int, time_step: float) -> str:
    """Where a time loop is, for a message."""
    return f"step {step} (t = {step * time_step:.4g} s)"
