"""File locks, by system calls of POSIX or Windows: a lock ends with its process, however that ends."""

from __future__ import annotations

import os
from importlib import import_module
from typing import Any


def _module(name: str) -> Any:
    """A module of the standard library that only some systems have; None if it is missing."""
    try:
        return import_module(name)
    except ImportError:
        return None


fcntl, msvcrt = _module("fcntl"), _module("msvcrt")
MOST = 2**31 - 1  # the last byte that both systems can lock


def known() -> bool:
    """Whether this system supports file locks."""
    return bool(fcntl or msvcrt)


def lock(file: int, wait: bool = False) -> None:
    """Lock an open file until it is closed: BlockingIOError if another has the lock, OSError on a disk without locks.

    With ``wait``, block until the lock is free; Windows gives up after ten seconds, with an OSError.
    """
    if fcntl is not None:
        fcntl.flock(file, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        return
    _of_windows(file, 0, msvcrt.LK_LOCK if wait else msvcrt.LK_NBLCK)


def lock_byte(file: int, byte: int) -> None:
    """Lock one byte of an open file, possibly beyond its end: BlockingIOError if another process has it, OSError on a
    disk without locks."""
    if fcntl is None:
        _of_windows(file, byte, msvcrt.LK_NBLCK)
        return
    try:
        fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, byte)
    except PermissionError as error:  # POSIX permits this error too
        raise BlockingIOError(error.errno, error.strerror) from None


def unlock_byte(file: int, byte: int) -> None:
    """Unlock a byte."""
    if fcntl is None:
        _of_windows(file, byte, msvcrt.LK_UNLCK)
    else:
        fcntl.lockf(file, fcntl.LOCK_UN, 1, byte)


def _of_windows(file: int, byte: int, how: int) -> None:
    """Lock or unlock one byte on Windows, whose call applies to the current position in the file."""
    os.lseek(file, byte, os.SEEK_SET)
    try:
        msvcrt.locking(file, how, 1)
    except PermissionError as error:
        raise BlockingIOError(error.errno, error.strerror) from None
