"""Writing a history during the run, so that a kill at any time loses nothing that was flushed."""

from __future__ import annotations

import io
import json
import os
import platform
import sys
import time
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

import h5py
import numpy as np

import dembrick
from dembrick.assembly.actuators import recorded_curve
from dembrick.errors import HistoryError, OutputError, WriteError
from dembrick.history import layout
from dembrick.history.files import check_output, clear_parts, reason, replacing
from dembrick.history.hdf5_files import rewritten
from dembrick.history.inputs import Input, tables
from dembrick.history.reader import History, is_of
from dembrick.scenario.checks import present
from dembrick.scenario.controls import Control, YieldControl
from dembrick.simulation.channels import CONTACTS, FRAMES, ROWS, Channel, recorded, taken

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly

RUNNING, FAILED = "running", "failed"
REPLACE = "choose another name, or --force replaces it (force=True in Python)"
OWN = "own"  # value of ``force`` for which a finished history of the same scenario may be replaced
_SLAB = 4 << 20  # bytes moved at a time in a rewrite, which limits its memory
_HELD = 4 << 20  # bytes that may be buffered; a short run of few blocks has less in total
_RESERVE = 16 << 20  # bytes reserved for rows, and again for frames, in a new file; a hole until it is written
_PACK_FROM = 1 << 20  # bytes: smaller datasets are not compressed
_CHUNK = 256 << 10  # bytes of a compressed chunk
_SYNC_AFTER = 1.0  # s: files of longer runs are synced to disk before the rename
_FAILURES = (OSError, RuntimeError, ValueError)  # what h5py raises if the system refuses


class HistoryWriter:
    """Writes one history file.

    Rows and frames of ``append`` and ``append_frames`` are buffered for at most ``hold`` seconds and some megabytes: a
    run of milliseconds writes its data only once, in final form, and a long one not at every row. The file itself
    exists from the start, unless it would replace a finished one. ``finish`` makes the final file: exact lengths, long
    series compressed if that halves them. Until then the status is ``running``. ``resume`` continues an incomplete
    file. ``channels``: what is recorded (see ``model.Output``). ``control``: control of the run, which defines the
    load. ``inputs``: the files that the scenario reads.

    An existing file is replaced if it is of a failed run, or an unfinished history of the same scenario; with ``force``
    = `OWN` also a finished one, with True any file.

    Raises OutputError if the path cannot be used, WriteError if a write fails; what was flushed before
    stays readable.
    """

    def __init__(
        self,
        path: str | os.PathLike,
        scenario_text: str,
        assembly: Assembly,
        settings: Mapping,
        force: bool | str = False,
        channels: Iterable[str] = ("joints", "energy", "frames"),
        hold: float = 0.1,
        control: Control | None = None,
        inputs: Sequence[Input] = (),
    ):
        self.path = os.fspath(path)
        self._target = check_output(path)
        if force is not True:
            _refuse_other(self.path, self._target, scenario_text, settings.get("scenario"), force == OWN)
        clear_parts(self._target)
        self._assembly, self._settings = assembly, dict(settings)
        self._said = [layout.scenario_table(scenario_text), *tables(inputs)]
        self._channels, self._hold, self._opened = frozenset(channels), hold, time.monotonic()
        self._flushed = self._opened
        self._control = control or YieldControl()
        self._tables: list[layout.Table] | None = None
        self._file: io.FileIO | None = None
        self._offsets: dict[str, int] = {}
        # rows, frames and new contacts: reserved in the file, and valid in it
        self._capacity = self._stored = (0, 0, 0)
        self._pending: dict[str, list[np.ndarray]] = {}
        self._pending_count, self._pending_bytes = [0, 0, 0], 0
        self._source: History | None = None  # an incomplete file, until its data has been moved to the new one
        self._closed = False
        self.run = os.urandom(8).hex()
        self._set_fields()
        self._begun = not os.path.exists(self._target) or os.path.getsize(self._target) == 0 or not force
        if self._begun:
            self._begin()

    def _set_fields(self) -> None:
        self._fields = recorded(self._assembly, self._channels, self._control)
        self._of_rows = [field for field in self._fields if field.grows_by == ROWS]
        self._of_frames = [field for field in self._fields if field.grows_by != ROWS]

    @classmethod
    def resume(
        cls, left: History, assembly: Assembly, settings: Mapping, channels: Iterable[str], rows: int, frames: int,
        control: Control | None = None,
    ):  # fmt: skip
        """Continue the file of ``left`` after its first ``rows`` rows and ``frames`` frames.

        Later ones are dropped; ``left`` is closed.
        """
        text = left.scenario_text
        self = cls(left.path, text, assembly, settings, True, channels, control=control, inputs=left.inputs)
        self._source, self.run = left, left.run or self.run
        self._stored = rows, frames, left.new_contacts_before(frames)
        with self._failures():
            self._grow(self._stored)
        return self

    @property
    def _counts(self) -> tuple[int, int, int]:
        """Rows, frames and new contacts appended so far."""
        rows, frames, contacts = (a + b for a, b in zip(self._stored, self._pending_count, strict=True))
        return rows, frames, contacts

    @property
    def n_row(self) -> int:
        """Rows appended so far."""
        return self._counts[ROWS]

    @property
    def n_frames(self) -> int:
        """Frames appended so far."""
        return self._counts[FRAMES]

    @property
    def flush_is_due(self) -> bool:
        """Whether the next data appended will be written at once."""
        return time.monotonic() - self._flushed >= self._hold

    def place(self, assembly: Assembly) -> None:
        """Set the assembly with the final contact points, before the first row."""
        self._assembly, self._tables = assembly, None
        self._set_fields()

    def append(self, record: Mapping) -> None:
        """Add T rows of the channels that ``simulation.channels`` declares for rows, each (T, ...); ``joint`` is one
        array (T, n_joint, 7), ``energy`` a mapping by name. Data of channels that this history does not record is
        ignored."""
        rows = {field.path: taken(record, field, self._assembly) for field in self._of_rows}
        self._add(rows, (len(record["time"]), 0, 0))

    def append_frames(
        self, time, displacement, orientation, *, new_contacts: Mapping | None = None, **channels: np.ndarray
    ) -> None:
        """Add F frames: ``time`` (F,), ``displacement`` from the start (F, n_block, 3), ``orientation`` (F, n_block,
        4), and the other ``channels`` declared for frames, each (F, ...); in real time also ``new_contacts``: ``count``
        (F,) per frame, and the channels of all contacts (C, ...). Data of channels that this history does not record is
        ignored."""
        if "frames" not in self._channels:
            raise ValueError("this history was opened without frames")
        displacement = np.asarray(displacement, float)
        record = {"time": time, "displacement": displacement, "orientation": orientation, **channels}
        contacts = 0
        if any(field.grows_by == CONTACTS for field in self._of_frames):
            before = self._counts[CONTACTS]
            end = before + np.cumsum(new_contacts["count"], dtype=np.int64)
            contacts = int(end[-1]) - before if len(end) else 0
            record["new_contacts"] = {**new_contacts, "end": end}
        frames = {field.path: taken(record, field, self._assembly) for field in self._of_frames}
        self._add(frames, (0, len(displacement), contacts))

    def _add(self, channels: Mapping, counts: tuple[int, int, int]) -> None:
        if self._closed:
            raise ValueError(f"the history {self.path} is closed")
        arrays = {}
        for field in self._fields:
            if field.path in channels:
                array, expected = np.ascontiguousarray(channels[field.path], field.kind), counts[field.grows_by]
                if array.shape != (expected, *field.shape):
                    raise ValueError(f"{field.path} has shape {array.shape}, expected {(expected, *field.shape)}")
                arrays[field.path] = array
        for path, array in arrays.items():
            self._pending.setdefault(path, []).append(array)
        self._pending_count = [a + b for a, b in zip(self._pending_count, counts, strict=True)]
        self._pending_bytes += sum(array.nbytes for array in arrays.values())
        if self.flush_is_due or self._pending_bytes > _HELD:
            self.flush()

    def flush(self) -> None:
        """Write everything to the file now. A kill after this call loses none of it."""
        with self._failures():
            wanted = self._counts
            if self._file is None or any(a > b for a, b in zip(wanted, self._capacity, strict=True)):
                self._grow(wanted)
            for field in self._fields:
                pending = [array for array in self._pending.get(field.path, ()) if array.size]
                if pending:
                    array = np.concatenate(pending) if len(pending) > 1 else pending[0]
                    place = self._offsets[field.path] + self._stored[field.grows_by] * field.entry_bytes
                    layout.put(self._file, place, array)
            # The count is written last: all data that it covers is in the file then.
            layout.put(self._file, self._offsets[layout.WRITTEN], np.array(wanted[:2], "<i8"))
            self._stored, self._flushed = wanted, time.monotonic()
            self._forget_pending()

    def finish(self, status: str, results: Mapping, settings: Mapping | None = None) -> None:
        """Make the final file with its status, results (the object of ``run --json``) and additional settings."""
        if self._closed:
            raise WriteError(f"{self.path}: the history is already closed, so it cannot be finished")
        self._settings |= settings or {}
        if self._file is not None:
            self.flush()  # if the final file fails, the running one is complete
        sync = time.monotonic() - self._opened > _SYNC_AFTER
        with self._failures(), replacing(self._target, sync) as part:
            self._write_whole(part, self._counts, status, results, final=True)
            self._release()  # before the rename: some systems cannot replace an open file
        self._closed = True
        self._stored = self._counts
        self._forget_pending()

    def abandon(self) -> bool:
        """Remove the file if nothing was recorded, as for a run with invalid input; return whether it was removed."""
        if self.n_row or self.n_frames or self._closed or self._source is not None:
            return False
        self._closed = True
        self._release()
        if self._begun:
            with suppress(OSError):
                os.unlink(self._target)
        return True

    def close(self) -> None:
        """Stop writing. Without ``finish`` the status remains ``running``, as after a kill."""
        if not self._closed:
            try:
                if self.n_row or self.n_frames:
                    self.flush()
            finally:
                self._closed = True
                self._release()

    def __enter__(self) -> HistoryWriter:
        return self

    def __exit__(self, kind, *_) -> None:
        if kind is None:
            self.close()
        else:
            with suppress(WriteError):  # the error being raised says more
                self.close()

    # --- inside ---

    def _begin(self) -> None:
        """Make a file that identifies the run and has no data yet."""
        with self._failures(), replacing(self._target) as part:
            layout.create(part, {}, self._said, self._attributes(RUNNING, {}), {})

    def _attributes(self, status: str, results: Mapping) -> dict:
        found = {"format": layout.FORMAT, "status": status, "run": self.run, "versions": _json(_versions())}
        control = self._control
        curve = recorded_curve(control, self._assembly.actuators)
        found |= {"control": control.kind, "regime": control.regime.name, "kinematics": control.regime.kinematics}
        found |= {"load_name": curve.load or "", "load_unit": curve.unit, "displacement_name": curve.displacement}
        return found | {"results": _json(results), "settings": _json(self._settings)}

    @contextmanager
    def _failures(self) -> Iterator[None]:
        """Turn a failed write into a WriteError that says which data remains readable."""
        try:
            yield
        except _FAILURES as error:
            rows, frames, _ = self._stored
            # A file that could not be reopened must not be replaced by one without its rows.
            self._closed |= self._file is None and rows + frames > 0
            kept = f"the {rows} rows and {frames} frames written before stay readable in it"
            if not rows and not frames:
                kept = "nothing of this run is in it"
            raise WriteError(f"{self.path}: the history could not be written ({reason(error)}); {kept}") from error

    def _forget_pending(self) -> None:
        self._pending, self._pending_count, self._pending_bytes = {}, [0, 0, 0], 0

    def _release(self) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None
        if self._source is not None:
            self._source.close()
            self._source = None

    def _grow(self, wanted: tuple[int, int, int]) -> None:
        """Make a new running file with room for twice the entries, and move the data of the old one."""
        sizes = [sum(f.entry_bytes for f in self._fields if f.grows_by == what) for what in range(3)]
        rows, frames, contacts = (
            max(16, 2 * max(count, 1), min(_RESERVE // max(size, 1), 1 << 16))
            for count, size in zip(wanted, sizes, strict=True)
        )
        with replacing(self._target) as part:
            offsets = self._write_whole(part, (rows, frames, contacts), RUNNING, {}, final=False)
            self._release()
        self._file = open(self._target, "r+b", buffering=0)  # noqa: SIM115
        self._offsets, self._capacity = offsets, (rows, frames, contacts)

    def _write_whole(self, part: str, counts: tuple[int, int, int], status: str, results: Mapping, final: bool) -> dict:
        if self._tables is None:
            self._tables = [*self._said, *layout.geometry(self._assembly)]
        packed = {}
        if final:
            chunks = {f.path: self._worth_packing(f, counts[f.grows_by]) for f in self._fields}
            packed = {path: entries for path, entries in chunks.items() if entries}
        growing = {field: counts[field.grows_by] for field in self._fields}
        offsets = layout.create(part, growing, self._tables, self._attributes(status, results), packed)
        with open(part, "r+b", buffering=0) as file:
            for field in self._fields:
                if field.path in offsets:
                    position = offsets[field.path]
                    for array in self._slabs(field, pending=final):
                        layout.put(file, position, array)
                        position += array.nbytes
            layout.put(file, offsets[layout.WRITTEN], np.array((counts if final else self._stored)[:2], "<i8"))
        if packed:
            with rewritten(part, "r+") as (file, check):
                for field in self._fields:
                    if field.path in packed:
                        entry, data = 0, file[field.path]
                        for array in self._slabs(field, pending=True):
                            data[entry : entry + len(array)] = array
                            check()
                            entry += len(array)
        return offsets

    def _slabs(self, field: Channel, pending: bool) -> Iterator[np.ndarray]:
        """All entries of a field, a few megabytes at a time: first those in the file, then those in memory."""
        stored = self._stored[field.grows_by]
        if self._source is not None or (self._file is not None and field.path in self._offsets):
            # whole chunks, so that no chunk of a compressed dataset is compressed twice
            chunk = self._chunk(field)
            step = max(_SLAB // field.entry_bytes // chunk, 1) * chunk
            for start in range(0, stored, step):
                yield self._stored_entries(field, start, min(start + step, stored))
        if pending:
            yield from self._pending.get(field.path, ())

    def _stored_entries(self, field: Channel, start: int, stop: int) -> np.ndarray:
        if self._source is not None:
            return self._source.entries(field.path, start, stop)
        file = present(self._file)
        file.seek(self._offsets[field.path] + start * field.entry_bytes)
        raw = file.read((stop - start) * field.entry_bytes)
        return np.frombuffer(raw, field.kind).reshape(-1, *field.shape)

    def _chunk(self, field: Channel) -> int:
        return max(1, _CHUNK // max(field.entry_bytes, 1))

    def _worth_packing(self, field: Channel, count: int) -> int:
        """Entries per chunk if compression halves a sample from the middle of the field, else 0."""
        if count * field.entry_bytes < _PACK_FROM:
            return 0
        entries = min(self._chunk(field), count)
        stored = self._stored[field.grows_by]
        if stored >= entries and self._file is not None:
            start = (stored - entries) // 2
            sample = self._stored_entries(field, start, start + entries)
        else:
            sample = max(self._pending[field.path], key=len)[:entries]
        shuffled = np.ascontiguousarray(sample.reshape(-1).view(np.uint8).reshape(-1, 8).T)
        return entries if len(zlib.compress(shuffled, 1)) < 0.5 * sample.nbytes else 0


def _refuse_other(path: str, target: str, scenario_text: str, source: object, own: bool) -> None:
    """Refuse to replace a file, unless it is empty, of a failed run, or an unfinished history of the same scenario;
    with ``own`` also a finished one."""
    if not os.path.exists(target) or os.path.getsize(target) == 0:
        return
    try:
        with History(target) as there:
            same, status = is_of(there, scenario_text, source), there.status
    except HistoryError as error:
        raise OutputError(f"{path}: this file exists and is not a history; {REPLACE}") from error
    if status == FAILED or (same and (own or status == RUNNING)):
        return
    what = f"a finished history (status {status})" if status != RUNNING else "an unfinished run (dembrick restart)"
    whose = "" if same else " of another scenario"
    raise OutputError(f"{path}: {what}{whose} is there; {REPLACE}")


def _json(value) -> str:
    return json.dumps(value, default=_plain)


def _plain(value):
    """Convert numpy numbers and arrays, mappings and paths for JSON."""
    if hasattr(value, "tolist"):
        return value.tolist()
    return dict(value) if isinstance(value, Mapping) else str(value)


def _versions() -> dict:
    """Versions that affect the results, and the machine; numba's only if a kernel was used."""
    found = {"dembrick": getattr(dembrick, "__version__", "unknown"), "python": platform.python_version()}
    found |= {"numpy": np.__version__, "h5py": h5py.__version__, "hdf5": h5py.version.hdf5_version}
    if "numba" in sys.modules:
        found["numba"] = sys.modules["numba"].__version__
    return found | {"machine": f"{sys.platform} {platform.machine()}, {os.cpu_count()} cores"}
