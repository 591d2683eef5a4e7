"""Stores for the record of a run: in memory, or in a history with checkpoints. Both audit the energy."""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from dembrick._kernel_sources import kernel_hash
from dembrick.errors import HistoryError
from dembrick.scenario.model import Output, Scenario
from dembrick.simulation.channels import FRAMES, ROWS, followed, recorded
from dembrick.simulation.dynamics.recorder import joined
from dembrick.simulation.energy_audit import Auditor
from dembrick.simulation.session import Kept, RestartChanges, Session

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.history import Checkpoint, HistoryWriter


TOGETHER = 64  # most chunks passed to the writer at once
MOST_WAITING = 1 << 20  # bytes of their rows


class Memory:
    """Keeps everything in memory, for a run without a history."""

    write_seconds = 0.0

    def __init__(self, scenario: Scenario, assembly: Assembly):
        self.auditor, self._scenario = Auditor(), scenario
        self._rows: list[dict] = []
        self._frames: list[dict] = []
        self.place(assembly)

    def place(self, assembly: Assembly) -> None:
        """Set the assembly with its final contact points, before anything is recorded."""
        output, self._assembly = self._scenario.output, assembly
        self._fields = recorded(assembly, output.channels, self._scenario.control)

    def observe(self, rows: Mapping, frames: Mapping) -> None:
        """Record the rows and frames of a chunk."""
        self.auditor.observe(rows)
        self._rows.append(followed(rows, self._fields, ROWS, self._assembly))
        if frames:
            self._frames.append(followed(frames, self._fields, FRAMES, self._assembly))

    def session(self, output: Output) -> Session:
        """Session of a run that records into this store."""
        return Session(self.observe, output)

    @property
    def rows(self) -> Mapping:
        """All rows, one array per name."""
        return joined(self._rows)

    @property
    def frames(self) -> Mapping:
        """All frames, one array per name."""
        return joined(self._frames)


class RecordStore:
    """Passes the record to a history writer, several rows at a time; writes checkpoints beside the history.

    ``text`` is that of the scenario; ``left``: the history of an interrupted run to continue; without it a new history
    is created.
    """

    def __init__(
        self, path, scenario: Scenario, text: str, assembly: Assembly, settings: Mapping, force=False, left=None
    ):
        from dembrick import history

        began, channels, control = time.perf_counter(), scenario.output.channels, scenario.control
        self.path, self._auditor = os.fspath(path), Auditor()
        self.checkpoint: Checkpoint | Kept | None = None
        self.goes_on: RestartChanges | None = None
        self.where = ""  # position in the run of the checkpoint
        self._writer: HistoryWriter | None = None
        self._recorded, self._assembly = history.recorded, assembly
        self._waiting: list[tuple[Mapping, Mapping]] = []
        self._checkpoints = history.Checkpoints(self.path)
        self._scenario = hashlib.sha256(text.encode()).hexdigest()
        if left is None:
            inputs = history.inputs_of(scenario)
            self._writer = history.HistoryWriter(
                self.path, text, assembly, settings, force, channels, control=control, inputs=inputs
            )
            self._checkpoints.discard()
        else:
            rows, frames = self._take_checkpoint(left)
            # opened at the first record: until then the checkpoint may turn out not to fit
            resume = history.HistoryWriter.resume
            self._open = lambda: resume(left, self._assembly, settings, channels, rows, frames, control)
        self.write_seconds = time.perf_counter() - began

    @property
    def auditor(self) -> Auditor:
        """The audit of everything observed."""
        self._pass_on()
        return self._auditor

    @property
    def writer(self) -> HistoryWriter:
        if self._writer is None:
            self._writer = self._open()
        return self._writer

    def place(self, assembly: Assembly) -> None:
        self._assembly = assembly
        if self._writer is not None:
            self._writer.place(assembly)

    def _take_checkpoint(self, left) -> tuple[int, int]:
        """Take the last good checkpoint; return how many rows and frames there were then."""
        found, faults = self._checkpoints.newest(left.run or "")
        remedy = f"run it again from the start: dembrick run {self.path} --force"
        if found is None and faults:
            raise HistoryError(f"{faults[0]}; {remedy}")
        rows = frames = 0
        if found is not None:
            for key, value in (("scenario", self._scenario), ("kernels", kernel_hash())):
                if found.about[key] != value:
                    what = "scenario" if key == "scenario" else "version of dembrick"
                    raise HistoryError(
                        f"{found.path}: this checkpoint is from another {what} and would not lead to the same "
                        f"result; {remedy}"
                    )
            rows, frames = found.about["rows"], found.about["frames"]
            if rows > left.n_row or frames > left.n_frames:
                raise HistoryError(
                    f"{self.path}: it has {left.n_row} rows and {left.n_frames} frames, but the run had written "
                    f"{rows} and {frames}; {remedy}"
                )
            self._auditor.worst[:] = found.array("audit.worst", self._auditor.worst)
            self.where = str(found.about["where"])
        self.checkpoint = found
        return rows, frames

    def session(self, output: Output) -> Session:
        return Session(self.observe, output, self.keep, self.checkpoint, goes_on=self.goes_on)

    def observe(self, rows: Mapping, frames: Mapping) -> None:
        """Record the rows and frames of a chunk, several at a time, as each call of the writer takes its time."""
        began = time.perf_counter()
        if self._waiting and rows["energy"].keys() != self._waiting[0][0]["energy"].keys():
            self._pass_on()  # the dead-load equilibrium has none
        self._waiting.append((rows, frames))
        waiting = len(self._waiting)
        if waiting == TOGETHER or waiting * _bytes(rows) > MOST_WAITING or self.writer.flush_is_due:
            self._pass_on()
        self.write_seconds += time.perf_counter() - began

    def _pass_on(self) -> None:
        """Pass all waiting rows and frames to the writer."""
        if not self._waiting:
            return
        rows, frames = [rows for rows, _ in self._waiting], [frames for _, frames in self._waiting if frames]
        self._waiting = []
        together = joined(rows)
        self._auditor.observe(together)
        self.writer.append(together)
        if frames:
            self.writer.append_frames(**joined(frames))

    def keep(self, arrays: Mapping[str, np.ndarray], where: str) -> None:
        """Flush the history, then write a checkpoint with its numbers of rows and frames, and ``where`` the run was."""
        began = time.perf_counter()
        self._pass_on()
        self.writer.flush()
        about: dict[str, object] = {"run": self.writer.run, "scenario": self._scenario, "kernels": kernel_hash()}
        about |= {"where": where, "rows": self.writer.n_row, "frames": self.writer.n_frames}
        self._checkpoints.save({**arrays, "audit.worst": self._auditor.worst}, about)
        self.write_seconds += time.perf_counter() - began

    def flush(self) -> None:
        """Write everything observed to the file."""
        self._pass_on()
        self.writer.flush()

    def abandon(self) -> bool:
        """Remove the history if nothing was recorded; return whether."""
        self._pass_on()
        return self._writer is not None and self._writer.abandon()

    @property
    def has_checkpoint(self) -> bool:
        """Whether there is a checkpoint to restart from."""
        return bool(self._checkpoints.existing())

    def finish(self, status: str, results: Mapping, settings: Mapping | None = None) -> None:
        """Finish the history; checkpoints are kept only if the run may be restarted."""
        self._pass_on()
        self.writer.finish(status, results, settings)
        if status != "interrupted":
            self._checkpoints.discard()

    @property
    def rows(self) -> Mapping:
        """All rows, read from the file on demand."""
        return self._recorded.Rows(self.path)

    @property
    def frames(self) -> Mapping:
        """All frames, read from the file on demand."""
        return self._recorded.Frames(self.path)


def _bytes(record: Mapping) -> int:
    """Bytes of the arrays of a record, without those in nested mappings."""
    return sum(array.nbytes for array in record.values() if isinstance(array, np.ndarray))
