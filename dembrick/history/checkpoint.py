"""Checkpoints: the data from which a run restarts, in two small files beside its history that are written in turn.

``FILE.h5.checkpoint-0`` and ``-1`` are zip archives of arrays, as written by ``numpy.savez``. Each is written under
another name, synced to disk and then renamed, so that after a kill or a power cut the last or the one before is intact.
Reading does not trust them: nothing is unpickled, arrays must have the expected shape and type, and all checksums are
verified.
"""

from __future__ import annotations

import json
import os
import zipfile
import zlib
from collections.abc import Mapping
from contextlib import suppress

import numpy as np

from dembrick.errors import HistoryError, WriteError
from dembrick.history.files import clear_parts, reason, replacing

FORMAT = 2
_ABOUT = "about"
_MOST_ARRAYS = 1000
_LONGEST_LINE = 100  # characters
# RuntimeError: from zipfile, also if a flipped byte gives an unknown compression method
_DAMAGE = (OSError, ValueError, KeyError, EOFError, MemoryError, RuntimeError, zipfile.BadZipFile, zlib.error)


class Checkpoint:
    """A complete and verified checkpoint; ``about`` describes the run at that time."""

    def __init__(self, path: str):
        """Raises HistoryError if the file is damaged, or not written by this package."""
        self.path = path
        try:
            self._read_about()
        except (*_DAMAGE, RecursionError, AttributeError, TypeError) as error:
            raise HistoryError(
                f"{path}: this checkpoint is damaged, or not written by dembrick ({_line(error)})"
            ) from error

    def _read_about(self) -> None:
        size = os.path.getsize(self.path)
        with np.load(self.path, allow_pickle=False) as archive:
            entries = archive.zip.infolist()
            if len(entries) > _MOST_ARRAYS or sum(entry.file_size for entry in entries) > size:
                raise ValueError("it claims more data than it holds")
            if any(entry.compress_type != zipfile.ZIP_STORED for entry in entries):
                raise ValueError("it is compressed")
            if archive.zip.testzip() is not None:
                raise ValueError("a checksum is wrong")
            self._names = archive.files
            self.about = json.loads(archive[_ABOUT].tobytes())
        if self.about.get("format") != FORMAT:
            raise ValueError(f"format {self.about.get('format')!r} is unknown to this version")
        texts, counts = ("run", "scenario", "kernels", "where"), ("number", "rows", "frames")
        for key in (*texts, *counts):
            if not isinstance(self.about.get(key), str if key in texts else int):
                raise ValueError(f"{key} is missing")
        if min(self.about[key] for key in counts) < 0:
            raise ValueError("its counts are negative")
        if not self.about["where"].isprintable() or len(self.about["where"]) > _LONGEST_LINE:
            raise ValueError("it does not say where the run was")

    def __contains__(self, name: str) -> bool:
        """Whether there is an array of that name."""
        return name in self._names

    def array(self, name: str, like: np.ndarray) -> np.ndarray:
        """The array ``name``; HistoryError unless it has the shape and the type of ``like``."""
        try:
            with np.load(self.path, allow_pickle=False) as archive:
                found = np.asarray(archive[name])
            if found.shape != like.shape or found.dtype != like.dtype or not found.flags.c_contiguous:
                wrong = f"shape {found.shape} of {found.dtype}"
                raise ValueError(f"{wrong}, but {like.shape} of {like.dtype} was expected")
        except _DAMAGE as error:
            raise HistoryError(f"{self.path}: {name} does not belong to this run ({_line(error)})") from error
        return found


def _line(error: BaseException) -> str:
    """Text of an error, shortened to one line."""
    return (str(error).splitlines() or [type(error).__name__])[0][:100]


class Checkpoints:
    """The two checkpoint files of the history ``path``."""

    def __init__(self, path: str | os.PathLike):
        self.paths = tuple(f"{os.path.realpath(path)}.checkpoint-{i}" for i in range(2))
        self._next = self._number = 0

    def save(self, arrays: Mapping[str, np.ndarray], about: Mapping) -> None:
        """Write a checkpoint in place of the older one; raise a WriteError if that fails, with both old ones intact."""
        path = self.paths[self._next]
        text = json.dumps({"format": FORMAT, "number": self._number + 1, **about}).encode()
        arrays = {name: np.asarray(value, order="C") for name, value in arrays.items()}
        try:
            with replacing(path, sync=True) as part, open(part, "wb") as file:
                np.savez(file, **{_ABOUT: np.frombuffer(text, np.uint8)}, **arrays)
        except OSError as error:
            raise WriteError(
                f"{path}: the checkpoint could not be written ({reason(error)}); the one before is kept"
            ) from error
        self._next, self._number = 1 - self._next, self._number + 1

    def existing(self) -> list[str]:
        """Those of the two files that exist."""
        return [path for path in self.paths if os.path.exists(path)]

    def newest(self, run: str) -> tuple[Checkpoint | None, list[str]]:
        """The last valid checkpoint of the run with that name, and reasons why others are unusable.

        The next ``save`` replaces the other file.
        """
        found, faults = [], []
        for i, path in enumerate(self.paths):
            if not os.path.exists(path):
                continue
            try:
                checkpoint = Checkpoint(path)
            except HistoryError as error:
                faults.append(str(error))
                continue
            if checkpoint.about["run"] == run:
                found.append((checkpoint.about["number"], i, checkpoint))
            else:
                faults.append(f"{path}: this is the checkpoint of another run")
        if not found:
            return None, faults
        self._number, i, checkpoint = max(found, key=lambda entry: entry[0])
        self._next = 1 - i
        return checkpoint, faults

    def discard(self) -> None:
        """Remove both files at the end of the run."""
        for path in self.paths:
            with suppress(OSError):
                os.unlink(path)
            clear_parts(path)  # of a process that was killed while writing
        self._next = self._number = 0
