"""Where the machine code of the kernels is kept, who compiles it, and how it is loaded.

The cache folder carries a hash of all that every kernel depends on in its name (`_kernel_sources.compiler_hash`), the
files of a kernel that of its module's sources (`closure_hash`). What is not there may have come with the package
(`_packaged_kernels`).
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

PATIENCE = 60.0  # s, for which a process waits for another that compiles what it wants; then it compiles that itself
LOOK = 0.02  # s, between two looks whether the other is done
WAITING = "dembrick:waiting"  # numba's event of such a wait


def is_own(folder: Path) -> bool:
    """Make a folder, if it is missing, and say whether it is this user's alone: numba unpickles what lies in it.

    It must be a folder and no link, belong to whoever runs this, and nobody else may write in it.
    """
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = os.lstat(folder)
        ours = not hasattr(os, "geteuid") or found.st_uid == os.geteuid()
        return stat.S_ISDIR(found.st_mode) and ours and not _others_write(found) and os.access(folder, os.W_OK)
    except OSError:
        return False


def _others_write(found: os.stat_result) -> bool:
    """Whether anyone but the owner may write in a folder; what systems without owners report says nothing."""
    return hasattr(os, "geteuid") and bool(found.st_mode & (stat.S_IWGRP | stat.S_IWOTH))


def _is_safe(base: Path) -> bool:
    """Whether nobody else can put another folder in the place of one of ours in ``base``, which is made if missing."""
    try:
        base.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = os.stat(base)
    except OSError:
        return False
    owned = not hasattr(os, "geteuid") or found.st_uid in (0, os.geteuid())
    return owned and (not _others_write(found) or bool(found.st_mode & stat.S_ISVTX))


def cache_folder() -> Path:
    """``$DEMBRICK_CACHE_DIR``, else the user's cache folder, else a temporary one; a folder per `compiler_hash` in it.

    One that others could have written is not taken: then the machine code is kept for this process alone.
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
    """A copy of a Python function under another name: compiled in another way, it must not share a cache entry."""
    copy = FunctionType(function.__code__, function.__globals__, name, function.__defaults__, function.__closure__)
    copy.__qualname__, copy.__doc__, copy.__module__ = name, function.__doc__, function.__module__
    return copy


class Claims:
    """Who compiles what: of the processes that want a kernel for the same arguments one compiles it, others wait.

    A claim is a locked byte of a file, so that a process that dies leaves none. The file stays open: to close it would
    let go of all claims of this process.
    """

    def __init__(self, path: Path):
        self._path = path
        self._file: int | None = None
        self._held: set[int] = set()

    def take(self, byte: int) -> bool:
        """Whether no other process has the claim: this one has it then, or nobody can, as on a disk without locks."""
        if not _file_locks.known() or byte in self._held:
            return True
        with suppress(OSError):  # where the file cannot be made, or on a disk without locks
            if self._file is None:
                self._file = os.open(self._path, os.O_RDWR | os.O_CREAT, 0o600)
            try:
                _file_locks.lock_byte(self._file, byte)
            except BlockingIOError:
                return False
            self._held.add(byte)
        return True

    def wait(self, byte: int) -> None:
        """Take a claim, if need be when who has it is done, or after `PATIENCE`."""
        began = time.monotonic()
        while not self.take(byte) and time.monotonic() - began < PATIENCE:
            time.sleep(LOOK)

    def let_go(self, byte: int) -> None:
        """Let others have it."""
        if self._file is not None and byte in self._held:
            self._held.remove(byte)
            with suppress(OSError):
                _file_locks.unlock_byte(self._file, byte)


@cache
def claims_in(folder: Path) -> Claims:
    """Those of the processes that keep their machine code in a folder."""
    return Claims(folder / ".claims")
