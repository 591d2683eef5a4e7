"""One writer per file: a second run that would write the same history is refused while the first is running.

It uses a lock of the operating system, see `_file_locks`.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from dembrick import _file_locks
from dembrick.errors import OutputError

_NO_LINKS = getattr(os, "O_NOFOLLOW", 0)  # Windows has no such flag


@contextmanager
def claimed(path: str | os.PathLike) -> Iterator[None]:
    """Context in which no other process writes the file ``path``; raise an OutputError if one does.

    The lock is on a hidden file beside it and ends with the process. On a disk without locks, or one that cannot be
    written, there is no protection.
    """
    folder, name = os.path.split(os.path.realpath(path))
    neighbour = os.path.join(folder, f".{name}.lock")
    lock = _locked(neighbour, os.fspath(path)) if _file_locks.known() else None
    try:
        yield
    finally:
        if lock is not None:
            with suppress(OSError):
                os.unlink(neighbour)  # before unlocking: a process that has opened it finds it gone and makes another
            os.close(lock)
            if os.name == "nt":  # Windows cannot remove an open file, also if the next writer has opened it
                with suppress(OSError):
                    os.unlink(neighbour)


def _locked(neighbour: str, path: str) -> int | None:
    """Open and lock a file; None if that is impossible."""
    while True:
        try:
            lock = os.open(neighbour, os.O_RDWR | os.O_CREAT | _NO_LINKS, 0o600)
        except OSError:
            return None
        try:
            _file_locks.lock(lock)
            if os.stat(neighbour).st_ino == os.fstat(lock).st_ino:
                return lock
        except BlockingIOError:
            os.close(lock)
            raise OutputError(
                f"{path}: another run is writing this file; wait until it is over, or choose another name"
            ) from None
        except FileNotFoundError:
            pass  # its last owner removed it in between
        except OSError:
            os.close(lock)
            return None
        os.close(lock)
