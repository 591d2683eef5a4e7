"""Cache of the machine code of kernels: its folder, and claims that let one process compile while others wait.

The name of the cache folder contains a hash of everything that all kernels depend on (`_kernel_sources.compiler_hash`),
the files of a kernel contain that of its module's sources (`closure_hash`). Machine code that is not there may come
with the package (`_packaged_kernels`).
"""

from __future__ import annotations

import os
import stat
import tempfile
import time
from contextlib import suppress
from functools import cache
from pathlib import Path
from types import FunctionType

from dembrick import _file_locks
from dembrick._kernel_sources import compiler_hash

PATIENCE = 60.0  # s: longest wait for another process that compiles a kernel; then this one compiles it too
LOOK = 0.02  # s: polling interval of that wait
WAITING = "dembrick:waiting"  # event of numba for that wait


def is_own(folder: Path) -> bool:
    """Make a folder if it is missing; return whether only this user can write in it, as numba unpickles its files.

    It must be a folder and no link, belong to the user of this process, and not be writable by others.
    """
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = os.lstat(folder)
        ours = not hasattr(os, "geteuid") or found.st_uid == os.geteuid()
        return stat.S_ISDIR(found.st_mode) and ours and not _others_write(found) and os.access(folder, os.W_OK)
    except OSError:
        return False


def _others_write(found: os.stat_result) -> bool:
    """Whether anyone but the owner may write in a folder; false on systems without owners."""
    return hasattr(os, "geteuid") and bool(found.st_mode & (stat.S_IWGRP | stat.S_IWOTH))


def _is_safe(base: Path) -> bool:
    """Whether nobody else can replace one of our folders in ``base``, which is made if missing."""
    try:
        base.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = os.stat(base)
    except OSError:
        return False
    owned = not hasattr(os, "geteuid") or found.st_uid in (0, os.geteuid())
    return owned and (not _others_write(found) or bool(found.st_mode & stat.S_ISVTX))


def cache_folder() -> Path:
    """``$DEMBRICK_CACHE_DIR``, else the user's cache folder, else a temporary one; in it a folder per `compiler_hash`.

    A folder in which others could write is not used: machine code then lasts for this process only.
    """
    bases = []
    if os.environ.get("DEMBRICK_CACHE_DIR"):
        bases.append(Path(os.environ["DEMBRICK_CACHE_DIR"]))
    bases.append(Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "dembrick")
    bases.append(Path(tempfile.gettempdir()) / f"dembrick-{os.getuid() if hasattr(os, 'getuid') else 'user'}")
    for base in bases:
        folder = base / compiler_hash()
        if _is_safe(base) and is_own(folder):
            return folder
    return Path(tempfile.mkdtemp(prefix="dembrick-"))


CACHE_FOLDER = cache_folder()


def renamed(function, name: str):
    """A copy of a Python function under another name: with other compiler options it must not share a cache entry."""
    copy = FunctionType(function.__code__, function.__globals__, name, function.__defaults__, function.__closure__)
    copy.__qualname__, copy.__doc__, copy.__module__ = name, function.__doc__, function.__module__
    return copy


class Claims:
    """Claims to compile: of the processes that need a kernel for the same arguments one compiles it, the others wait.

    A claim is a locked byte of a file, so that it ends with its process. The file stays open, since closing it would
    release all claims of this process.
    """

    def __init__(self, path: Path):
        self._path = path
        self._file: int | None = None
        self._held: set[int] = set()

    def take(self, byte: int) -> bool:
        """Try to take a claim: false if another process has it; true also without file locks, where nobody can."""
        if not _file_locks.known() or byte in self._held:
            return True
        with suppress(OSError):  # if the file cannot be made, or on a disk without locks
            if self._file is None:
                self._file = os.open(self._path, os.O_RDWR | os.O_CREAT, 0o600)
            try:
                _file_locks.lock_byte(self._file, byte)
            except BlockingIOError:
                return False
            self._held.add(byte)
        return True

    def wait(self, byte: int) -> None:
        """Take a claim, waiting for its owner to finish, for at most `PATIENCE`."""
        began = time.monotonic()
        while not self.take(byte) and time.monotonic() - began < PATIENCE:
            time.sleep(LOOK)

    def let_go(self, byte: int) -> None:
        """Release a claim."""
        if self._file is not None and byte in self._held:
            self._held.remove(byte)
            with suppress(OSError):
                _file_locks.unlock_byte(self._file, byte)


@cache
def claims_in(folder: Path) -> Claims:
    """Claims of the processes that share a cache folder."""
    return Claims(folder / ".claims")
