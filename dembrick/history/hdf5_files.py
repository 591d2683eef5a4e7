"""Writing HDF5 files so that a disk that fills up is an error and no crash.

HDF5 keeps what it has not yet written when a write fails, fails once more on closing, and the process dies. So it never
writes to the disk itself: its bytes pass through a Python file that takes every one of them and remembers the first
failure, which is raised once HDF5 has closed the file in peace.

The heaps in which an HDF5 file keeps its texts, looked through before HDF5 is asked for one.

HDF5 (2.0) trusts the sizes in a heap: one damaged byte there may send it round for ever, where any
other damage is an error. A heap is a run of objects, each with a header of 16 bytes: its number (2 bytes), how often it
is referred to (2), 4 bytes of nothing, its size (8); the size is rounded up to a multiple of 8. Number 0 is what is
free, header included, up to the end of the heap ("Global Heap" of the HDF5 File Format Specification, version 3).
"""

from __future__ import annotations

import io
import os
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import h5py

from dembrick.errors import HistoryError

_READABLE = ("v108", "v108")  # by any HDF5 in use; and no marks of a file that is open for writing


class Patient:
    """A file that HDF5 writes through: after a write that failed the rest is kept in memory, for HDF5 to read again."""

    def __init__(self, path: str | os.PathLike, mode: str):
        """``mode``: "w" for a new file, "r+" for one that is there."""
        self._file = open(path, {"w": "w+b", "r+": "r+b"}[mode], buffering=0)  # noqa: SIM115 - closed by `close`
        self._place = 0
        self._kept: dict[int, bytes] = {}  # by place in the file
        self.failure: OSError | None = None

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        self._place = offset if whence == io.SEEK_SET else self._file.seek(offset, whence)
        return self._place

    def tell(self) -> int:
        return self._place

    def readinto(self, buffer) -> int:
        """Fill a buffer; beyond the end of the file with zeros."""
        view = memoryview(buffer).cast("B")
        kept = self._kept.get(self._place, b"")[: len(view)]
        view[: len(kept)] = kept
        done = len(kept)
        if done < len(view):
            self._file.seek(self._place + done)
            while done < len(view) and (some := self._file.readinto(view[done:])):
                done += some
        view[done:] = bytes(len(view) - done)
        return len(view)

    def read(self, size: int = -1) -> bytes:
        self._file.seek(self._place)
        return self._file.read(size)

    def write(self, data) -> int:
        """Write all of it, or remember why that failed."""
        rest = memoryview(data).cast("B")
        if self.failure is None:
            try:
                self._file.seek(self._place)
                while len(rest):
                    rest = rest[self._file.write(rest) :]
            except OSError as error:
                self.failure = _without_trace(error)
        if self.failure is not None:
            self._kept[self._place] = bytes(memoryview(data).cast("B"))
        return len(memoryview(data).cast("B"))

    def truncate(self, size: int | None = None) -> int:
        """Set the length of the file."""
        size = self._place if size is None else size
        if self.failure is None:
            try:
                self._file.truncate(size)
            except OSError as error:
                self.failure = _without_trace(error)
        return size

    def flush(self) -> None:
        """Nothing is held back."""

    def close(self) -> None:
        """Close the file on the disk."""
        self._file.close()

    def check(self) -> None:
        """Raise the first failure."""
        if self.failure is not None:
            raise self.failure


def _without_trace(error: OSError) -> OSError:
    """The same error alone: a trace would hold on to objects of HDF5 until after Python's end, where they crash."""
    return OSError(error.errno, error.strerror)


@contextmanager
def rewritten(path: str | os.PathLike, mode: str = "w") -> Iterator[tuple[h5py.File, Callable[[], None]]]:
    """An HDF5 file to write, new ("w") or there already ("r+"), and a function that raises OSError once a write failed.

    It is raised at the end in any case; long writers ask in between, so that little is kept in memory.
    """
    patient = Patient(path, mode)
    try:
        with h5py.File(patient, mode, libver=_READABLE) as file:
            yield file, patient.check
        patient.check()
    finally:
        patient.close()


_MARK = b"GCOL\1\0\0\0"
_HEADER = 16
_CHUNK = 1 << 20
_SEARCHED = (
    32 << 20
)  # bytes at either end of a file; heaps come first, when it is laid out, and last, when it is closed


def check_heaps(path: str) -> None:
    """Raise HistoryError if a heap of the file ``path`` does not end where it should."""
    with open(path, "rb") as file:
        for start in _starts(file):
            if not _ends_well(file, start):
                raise HistoryError(f"{path}: its texts cannot be read; the file is damaged or was not written by us")


def _starts(file) -> Iterator[int]:
    """Where heaps start."""
    size = file.seek(0, os.SEEK_END)
    for first, last in ((0, min(size, _SEARCHED)), (max(_SEARCHED, size - _SEARCHED), size)):
        for begin in range(first, last, _CHUNK):
            file.seek(begin)
            piece = file.read(_CHUNK + len(_MARK) - 1)
            found = piece.find(_MARK)
            while found >= 0:
                yield begin + found
                found = piece.find(_MARK, found + 1)


def _ends_well(file, start: int) -> bool:
    """Whether the objects of the heap at ``start`` fill it."""
    file.seek(start)
    heap = file.read(_HEADER)
    size = struct.unpack_from("<Q", heap, 8)[0] if len(heap) == _HEADER else 0
    if not _HEADER <= size <= os.fstat(file.fileno()).st_size - start:
        return False
    heap += file.read(size - _HEADER)
    place = _HEADER
    while place + _HEADER <= size:
        number, length = struct.unpack_from("<H6xQ", heap, place)
        if number == 0:
            return length == size - place
        place += _HEADER + -(-length // 8) * 8
    return place <= size
