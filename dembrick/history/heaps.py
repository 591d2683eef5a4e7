"""The heaps in which an HDF5 file keeps its texts, looked through before HDF5 is asked for one.

HDF5 (2.0) trusts the sizes in a heap: one damaged byte there may send it round for ever, where any
other damage is an error. A heap is a run of objects, each with a header of 16 bytes: its number (2 bytes), how often it
is referred to (2), 4 bytes of nothing, its size (8); the size is rounded up to a multiple of 8. Number 0 is what is
free, header included, up to the end of the heap ("Global Heap" of the HDF5 File Format Specification, version 3).
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator

from dembrick.errors import HistoryError

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
