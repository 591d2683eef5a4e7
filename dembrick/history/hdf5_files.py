"""Writing HDF5 files so that a full disk is an error and not a crash; and a check of heaps before reading.

When a write fails, HDF5 keeps the unwritten data, fails again on closing, and the process dies. Therefore HDF5 never
writes to the disk itself: its bytes go through a Python file that accepts all of them and stores the first failure,
which is raised after HDF5 has closed the file.

The heaps in which an HDF5 file stores its texts are checked before HDF5 reads from one: HDF5 (2.0) trusts the sizes in
a heap, and one damaged byte can make it loop forever, where any other damage is an error. A heap is a sequence of
objects, each with a header of 16 bytes: its number (2 bytes), its reference count (2), 4 reserved bytes, its size (8);
the size is rounded up to a multiple of 8. Number 0 is the free space, including its header, up to the end of the heap
("Global Heap" of the HDF5 File Format Specification, version 3).
"""

from __future__ import annotations

import io
import os
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import h5py

from dembrick.errors import HistoryError

_READABLE = ("v108", "v108")  # format that every HDF5 in use reads, without marks of files open for writing


class FailSafeFile:
    """A file through which HDF5 writes: after a failed write, further data stays in memory for HDF5 to read again."""

    def __init__(self, path: str | os.PathLike, mode: str):
        """``mode``: "w" for a new file, "r+" for an existing one."""
        self._file = io.FileIO(path, {"w": "w+b", "r+": "r+b"}[mode])  # closed by `close`
        self._place = 0
        self._kept: dict[int, bytes] = {}  # by offset in the file
        self.failure: OSError | None = None

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        self._place = offset if whence == io.SEEK_SET else self._file.seek(offset, whence)
        return self._place

    def tell(self) -> int:
        return self._place

    def readinto(self, buffer) -> int:
        """Fill a buffer; with zeros beyond the end of the file."""
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
        """Write all data, or store the reason for a failure."""
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
        """No effect: writes are not buffered."""

    def close(self) -> None:
        """Close the file on the disk."""
        self._file.close()

    def check(self) -> None:
        """Raise the first failure, if any."""
        if self.failure is not None:
            raise self.failure


def _without_trace(error: OSError) -> OSError:
    """A copy of the error without traceback, which would keep HDF5 objects until Python exits and crash there."""
    return OSError(error.errno, error.strerror)


@contextmanager
def rewritten(path: str | os.PathLike, mode: str = "w") -> Iterator[tuple[h5py.File, Callable[[], None]]]:
    """Open an HDF5 file for writing, new ("w") or existing ("r+"); also yield a function that raises a failed write.

    A failure (OSError) is raised at the end in any case; long writers check in between, so that little stays in memory.
    """
    patient = FailSafeFile(path, mode)
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
)  # bytes at either end of a file; heaps are at the start, made with the layout, and at the end, made on closing


def check_heaps(path: str) -> None:
    """Raise a HistoryError if a heap of the file ``path`` does not end where it should."""
    with open(path, "rb") as file:
        for start in _starts(file):
            if not _ends_well(file, start):
                raise HistoryError(
                    f"{path}: its texts cannot be read; the file is damaged or was not written by dembrick"
                )


def _starts(file) -> Iterator[int]:
    """Offsets of heaps."""
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
    """Whether the objects of the heap at offset ``start`` fill it exactly."""
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
