"""Services for a time loop: its record, checkpoints and progress."""

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
    "the joints or contact points of this stage do not match those at the end of the previous stage: run the "
    "scenario from its start"
)
Observer = Callable[[Mapping[str, np.ndarray], Mapping[str, np.ndarray]], None]


class Snapshot(Protocol):
    """Named arrays from which a time loop restarts, read one by one because they may come from an untrusted file."""

    path: str

    def __contains__(self, name: str) -> bool:
        """Whether there is an array of that name."""

    def array(self, name: str, like: np.ndarray) -> np.ndarray:
        """The array ``name``, which must have the shape and the type of ``like``."""


class Kept:
    """A snapshot in memory: copies of ``arrays``, and of those that are read from ``source`` on demand."""

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
    """View of the arrays of a snapshot whose names begin with a prefix, under names without it."""

    def __init__(self, snapshot: Snapshot, prefix: str):
        self._snapshot, self._prefix, self.path = snapshot, prefix, snapshot.path

    def __contains__(self, name: str) -> bool:
        return f"{self._prefix}{name}" in self._snapshot

    def array(self, name: str, like: np.ndarray) -> np.ndarray:
        return self._snapshot.array(f"{self._prefix}{name}", like)


class Pausable(Protocol):
    """A run between two chunks: its progress, and the arrays for a restart."""

    where: str  # for a message, as "step 12 (t = 0.5 s)"
    progress: Progress

    def snapshot(self) -> Mapping[str, np.ndarray]:
        """Arrays by name, not copied."""


@dataclass(frozen=True)
class Progress:
    """Progress of a run: steps ``done`` of a ``stage``, of ``total`` (None: unknown; ``at_most``: an upper bound), at
    the simulated ``time`` (s; None if there is none)."""

    stage: str
    done: int
    total: int | None = None
    time: float | None = None
    at_most: bool = False


@dataclass(frozen=True)
class RestartChanges:
    """Changes when a run continues from a snapshot of another: ``ties``, None if they are the same; ``loads``: for each
    row of the work of loads its row there, -1 for a new load, None if they are the same; ``gone``: rows of removed
    loads, with their blocks; ``anything``: whether anything has changed."""

    ties: TiesBefore | None
    loads: tuple[int, ...] | None
    gone: tuple[tuple[int, int], ...]
    anything: bool


DEAD_LOADS = "dead-load equilibrium: step"
TOLD_EVERY = 0.1  # s, between two progress reports


@dataclass(frozen=True)
class Plan:
    """Size and cost of a run: time step and critical time step (s), steps, bytes in addition to the program itself,
    and ``seconds`` of compiled code on one core (None: unknown). ``exact``: the steps are not an estimate;
    ``at_most``: they are those of the longest such run. ``seconds_falling``: cost of a run in real time if all blocks
    fall into a heap, where they may; ``seconds`` is then the cost if they stand. ``seconds_snapping``: cost of a search
    if blocks snap again and again, where that is not known beforehand. ``within``: the factor by which an estimate of
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
    """Callbacks and context of a run; all are optional.

    ``observe(rows, frames)`` gets copies of the rows and frames of each chunk of steps (see ``recorder``), with the
    channels of ``output``. ``keep(arrays, where)`` writes a checkpoint, every ``output.checkpoint`` seconds and when a
    signal ends the run. ``resumed``: snapshot from which the run restarts. ``start``: final state of a static run of
    the same blocks, from which this one starts; None for the blocks as drawn. ``ties_before``: which of the ties of
    that run are kept, None: all are the same; ``force_error`` (N): error of the joint forces at its end; ``hands_on``:
    whether a later run starts from the final state of this one. ``goes_on``: what has changed since the run of
    ``resumed``; ``tilts``: V is the tangent of the angle of a table, and the record shows that table. ``keep_last``
    gets the final snapshot. ``tell`` gets the progress, ten times a second, and ``report`` remarks.
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
    goes_on: RestartChanges | None = None
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
        """Seconds until the next checkpoint or progress report is due."""
        now, soon = time.monotonic(), [np.inf]
        if self.tell is not None:
            soon.append(self.last_told + TOLD_EVERY - now)
        if self.keep is not None:
            soon.append(self.last_kept + self.output.checkpoint - now)
        return max(0.0, min(soon))

    def ended(self, run: Pausable) -> None:
        """Pass on the final snapshot, after the last row of a run."""
        if self.keep_last is not None:
            self.keep_last(run.snapshot(), run.where)

    @classmethod
    def of(cls, given: Session | Observer | None) -> Session:
        """The session itself, or a new one from an observer or from nothing."""
        return given if isinstance(given, Session) else cls(observe=given)

    def pause(self, run: Pausable, within: bool = False) -> None:
        """Write a checkpoint if one is due between two chunks; raise Interrupted if a signal asked to stop.

        ``within``: inside a chunk from whose beginning the run could restart; a checkpoint is then due only on a
        signal.
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
    """Position of a time loop as text for a message."""
    return f"step {step} (t = {step * time_step:.4g} s)"
