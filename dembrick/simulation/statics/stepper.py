"""Time stepping in chunks: compiled steps, and the work between two chunks.

Nothing here affects results: they are the same to the last bit whatever the length of chunks, the times of checkpoints
and restarts.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from dembrick._jit import ready
from dembrick.errors import HistoryError
from dembrick.kernels.joint.ties import Ties
from dembrick.kernels.state import Energy, Inertia, ScaledInertia
from dembrick.kernels.statics.load_bounds import Certificate
from dembrick.kernels.statics.loop import FULL, RUNNING, Drive, Guard, advance
from dembrick.kernels.statics.record import Record
from dembrick.simulation import interrupts
from dembrick.simulation.checkpoint_arrays import flattened, restored, restored_state
from dembrick.simulation.session import Progress, Session, Snapshot, step_at
from dembrick.simulation.statics import joint_families
from dembrick.simulation.statics.recorder import Recorder
from dembrick.simulation.statics.state import State, for_kernels

CHUNK_SECONDS = 0.2  # of a chunk: a signal is handled within that
FIRST_WORK = 200_000  # block and contact updates in the first chunk, before the speed is known


@dataclass
class Loop:
    """Arguments of `kernels.statics.loop.advance`; a checkpoint holds all of them but the record."""

    dt: float  # s
    state: State
    scaled: ScaledInertia | None
    inertia: Inertia | None
    drive: Drive
    certificate: Certificate
    energy: Energy | None
    guard: Guard | None
    ties: Ties | None = None  # in moving geometry
    record: Record | None = None
    step: int = 0
    seconds: float = 0.0  # wall time spent in it by this process
    _advance: Callable | None = field(default=None, init=False, repr=False)

    def advance(self, n_steps: int) -> int:
        """Do ``n_steps`` and return the status; zero steps only compile the kernel, or load it from the cache."""
        arguments = (
            self.step, n_steps, self.dt, for_kernels(self.state, self.ties), self.scaled, self.inertia, self.drive,
            self.certificate, self.record, self.energy, self.guard,
        )  # fmt: skip
        if self._advance is None:
            self._advance = ready(advance, *arguments)
        status, self.step = self._advance(*arguments)
        return status

    def parts(self) -> dict[str, tuple]:
        """The named tuples other than the state by name, without those that are None."""
        names = ("scaled", "inertia", "drive", "certificate", "energy", "guard", "ties")
        return {name: part for name in names if (part := getattr(self, name)) is not None}

    def snapshot(self) -> dict[str, np.ndarray]:
        """Everything as arrays; those of the state are not copied."""
        return {"loop": np.array([self.step, self.dt]), **flattened({"state": self.state, **self.parts()})}

    def restore(self, snapshot: Snapshot) -> None:
        """Restore everything from a snapshot of the same scene; HistoryError if it is of another."""
        step, self.dt = (float(x) for x in snapshot.array("loop", np.zeros(2)))
        if not (step >= 0.0 and step.is_integer() and 0.0 < self.dt < np.inf):
            raise HistoryError(f"{snapshot.path}: this checkpoint holds no step of this run")
        self.step = int(step)
        self.state = restored_state(self.state, snapshot)
        for name, part in self.parts().items():
            setattr(self, name, restored(name, part, snapshot))
        self._advance = None


class Stepper:
    """Runs a loop in chunks, passes on the record, writes checkpoints and handles signals.

    ``longest``: the most steps of a chunk, ``total``: steps of the run, if known. If the session keeps the last
    snapshot, a chunk ends at every row, which are ``rows_every`` steps apart.
    """

    def __init__(
        self,
        loop: Loop,
        session: Session,
        recorder: Recorder | None,
        longest: int,
        total: int | None = None,
        rows_every: int = 1,
    ):
        self._row = rows_every if session.keep_last is not None else 0
        self.loop, self.recorder, self._session, self._total = loop, recorder, session, total
        self._longest = min(longest, recorder.longest_chunk if recorder else longest)
        work = len(loop.state.blocks.displacement) + joint_families.entries(loop.state)  # of a step, roughly
        self._pace = max(1, FIRST_WORK // work)

    @property
    def where(self) -> str:
        return step_at(self.loop.step, self.loop.dt)

    @property
    def progress(self) -> Progress:
        """Progress of the run; the total of a search is unknown."""
        return Progress("step", self.loop.step, self._total, self.loop.step * self.loop.dt)

    def snapshot(self) -> dict[str, np.ndarray]:
        return self.loop.snapshot()

    def to(self, last: int) -> int:
        """Advance to step ``last``, or until the kernel ends the run; returns its status.

        Raises Interrupted at the end of the chunk in which a signal arrived.
        """
        status = RUNNING
        with interrupts.deferred():
            while status == RUNNING and self.loop.step < last:
                steps = min(self._pace, self._longest, last - self.loop.step)
                if self._row:
                    steps = min(steps, self._row - self.loop.step % self._row)
                began = time.perf_counter()
                status = self.loop.advance(steps)
                took = time.perf_counter() - began
                self.loop.seconds += took
                self._pace = max(1, min(int(steps * CHUNK_SECONDS / max(took, 1e-9)), 16 * steps))
                if self.recorder:
                    self.recorder.drain()
                if status == RUNNING:
                    self._session.pause(self)
        if status == FULL:
            raise RuntimeError("the record of a chunk is too short: please report this scenario")
        return status
