"""One writer a file: a second run that would write the same history is refused while the first one goes on."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from dembrick.errors import OutputError

try:
    import fcntl
except ImportError:  # Windows: there an open file cannot be replaced, and the second run fails by itself
    fcntl = None  # type: ignore[assignment]


@contextmanager
def claimed(path: str | os.PathLike) -> Iterator[None]:
    """Within, no other process writes the file ``path``; OutputError if one does.

    A lock on a hidden neighbour, which the system lets go of when a process dies. Where the disk knows no locks, or
    cannot be written, nothing is claimed.
    """
    folder, name = os.path.split(os.path.realpath(path))
    neighbour = os.path.join(folder, f".{name}.lock")
    lock = _locked(neighbour, os.fspath(path)) if fcntl else None
    try:
        yield
    finally:
        if lock is not None:
            with suppress(OSError):
                os.unlink(neighbour)  # before it is let go of: who opened it meanwhile finds it gone, and makes another
            os.close(lock)


def _locked(neighbour: str, path: str) -> int | None:
    """An open and locked file, None if that is impossible."""
    while True:
        try:
            lock = os.open(neighbour, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
        except OSError:
            return None
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.stat(neighbour).st_ino == os.fstat(lock).st_ino:
                return lock
        except BlockingIOError:
            os.close(lock)
            raise OutputError(
                f"{path}: another run is writing this file; wait until it is over, or choose another name"
            ) from None
        except FileNotFoundError:
            pass  # its last holder removed it in between
        except OSError:
            os.close(lock)
            return None
        os.close(lock)
