"""Where the machine code of the kernels is kept, who compiles it, and how it is loaded.

The cache folder carries a hash of all that every kernel depends on in its name (`_kernel_sources.compiler_hash`), the
files of a kernel that of its module's sources (`closure_hash`). What is not there may have come with the package
(`_packaged_kernels`).
"""

from __future__ import annotations

import hashlib
import os
import platform
import stat
import tempfile
import time
from contextlib import suppress
from functools import cache
from pathlib import Path

try:
    import fcntl
except ImportError:  # a system without POSIX locks
    fcntl = None  # type: ignore[assignment]

import numba
from llvmlite import binding
from numba.core import event, types
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.codegen import JITCodeLibrary

from dembrick._kernel_sources import closure_hash, compiler_hash
from dembrick._packaged_kernels import packaged_kernels, why_compiled

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


def versions() -> list[str]:
    """Lines about Python, numba, and where machine code of the kernels comes from."""
    lines = [f"Python {platform.python_version()}, numba {numba.__version__}"]
    package, reason = packaged_kernels(), why_compiled()
    if package is not None:
        return [*lines, f"kernels: package, compiled for {package.target[1]}"]
    kept = any(CACHE_FOLDER.glob("*.nbi"))
    lines.append(f"kernels: {'cache' if kept else 'compiled at the first run, and kept in'} {CACHE_FOLDER}")
    return [*lines, f"         not from the package: {reason}"] if reason else lines


class _Folder:
    """Where the machine code of a kernel is kept: found by its module and the sources of that, not by its path."""

    def __init__(self, function):
        self._stamp = closure_hash(function.__module__)
        self._name = f"{function.__module__}-{function.__code__.co_firstlineno}-{self._stamp}"
        self._py_file = function.__code__.co_filename  # where numba warns of a kernel that it cannot keep

    @classmethod
    def from_function(cls, function, _file):
        """See numba."""
        return cls(function)

    def ensure_cache_path(self):
        """The folder was made when its name was chosen."""

    def get_cache_path(self):
        """See numba."""
        return str(CACHE_FOLDER)

    def get_source_stamp(self):
        """What makes old machine code useless: an edit of a source, which gives the file another name as well."""
        return self._stamp

    def get_disambiguator(self):
        """See numba."""
        return self._name


class CacheFile(IndexDataCacheFile):
    """numba's file of one kernel, whose index is read and written again by one process at a time.

    Two processes that compile the same kernel for other arguments would lose an entry, or give two the same number.
    What cannot be written, on a full disk for one, is compiled again by the next run.
    """

    def save(self, key, data):
        """See numba."""
        with suppress(OSError), open(CACHE_FOLDER / ".lock", "a") as lock:
            if fcntl is not None:
                with suppress(OSError):  # a disk without locks
                    fcntl.flock(lock, fcntl.LOCK_EX)  # let go of when the file is closed
            super().save(key, data)


class Claims:
    """Who compiles what: of the processes that want a kernel for the same arguments one compiles it, others wait.

    A claim is a locked byte of a file, so that a process that dies leaves none. The file stays open: to close it would
    let go of all claims of this process.
    """

    def __init__(self, path: Path):
        self._path = path
        self._file = None

    def take(self, byte: int) -> bool:
        """Whether no other process has the claim: this one has it then, or nobody can, as on a disk without locks."""
        if fcntl is None:
            return True
        try:
            if self._file is None:
                self._file = open(self._path, "ab")  # noqa: SIM115
            fcntl.lockf(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, byte)
        except (BlockingIOError, PermissionError):  # what a lock that another has looks like
            return self._file is None
        except OSError:
            pass
        return True

    def wait(self, byte: int) -> None:
        """Take a claim, if need be when who has it is done, or after `PATIENCE`."""
        if self.take(byte):
            return
        with event.trigger_event(WAITING):
            began = time.monotonic()
            while not self.take(byte) and time.monotonic() - began < PATIENCE:
                time.sleep(LOOK)

    def let_go(self, byte: int) -> None:
        """Let others have it."""
        if self._file is not None:
            with suppress(OSError):
                fcntl.lockf(self._file, fcntl.LOCK_UN, 1, byte)


@cache
def claims_in(folder: Path) -> Claims:
    """Those of the processes that keep their machine code in a folder."""
    return Claims(folder / ".claims")


class _Kept(JITCodeLibrary):
    """Machine code out of the cache. What other kernels would take into their own code is parsed if one of them does:
    that took longer than all else that loading a kernel takes."""

    @classmethod
    def _unserialize(cls, codegen, state):
        name, _, (code, taken_in) = state
        self = codegen.create_library(name)
        self.enable_object_caching()
        self._set_compiled_object(code)
        self._taken_in = taken_in
        self._finalize_final_module()
        return self

    def _get_module_for_linking(self):
        if self._shared_module is None:
            self._shared_module = binding.parse_bitcode(self._taken_in)
        return self._shared_module


class _Impl(FunctionCache._impl_class):
    _locator_classes = [_Folder]

    def reduce(self, cres):
        """See numba. The names that the machine code defines are kept beside it."""
        module = cres._asdict()["library"]._get_module_for_linking()
        found = (*module.functions, *module.global_variables)
        return [one.name for one in found if not one.is_declaration], super().reduce(cres)

    def rebuild(self, target_context, kept):
        """See numba, of whose compiler lock nobody else has the code generator meanwhile."""
        (names, payload), codegen = kept, target_context.codegen()
        codegen._engine._defined_symbols.update(names)
        codegen._library_class = _Kept
        try:
            return super().rebuild(target_context, payload)
        finally:
            del codegen._library_class


class ParallelKernelCache(FunctionCache):
    """numba's cache in the package's own folder; what is not there is compiled by one process at a time."""

    _impl_class = _Impl

    def __init__(self, function):
        super().__init__(function)
        self._cache_file = CacheFile(self._cache_path, self._impl.filename_base, self._impl.locator.get_source_stamp())
        self._claimed: dict = {}

    def load_overload(self, sig, target_context):
        """See numba. Where there is nothing this process has claimed it when it returns."""
        found = self._load(sig, target_context)
        if found is None:
            what = f"{self._impl.filename_base} {sig} {target_context.codegen().magic_tuple()}"
            byte = int.from_bytes(hashlib.sha256(what.encode()).digest()[:7], "big")
            self._claimed[sig] = byte
            claims_in(CACHE_FOLDER).wait(byte)
            found = self._load(sig, target_context)
        return found

    def _load(self, sig, target_context):
        found = super().load_overload(sig, target_context)
        return self._from_package(sig, target_context) if found is None else found

    def _from_package(self, sig, target_context):
        """Machine code that came with the package, for any processor that has what it needs; None if there is none."""
        package = packaged_kernels()
        if package is None:
            return None
        arguments, _, *rest = self._index_key(sig, target_context.codegen())
        stamp, name = self._impl.locator.get_source_stamp(), self._impl.filename_base
        data = IndexDataCacheFile(str(package.folder), name, stamp).load((arguments, package.target, *rest))
        return None if data is None else self._impl.rebuild(target_context, data)

    def _index_key(self, sig, codegen):
        """See numba. Machine code reads a named tuple by the places of its fields, numba's type has their names only
        by the class, which another version of the package may define otherwise."""
        return (*super()._index_key(sig, codegen), _fields(sig))

    def let_go(self, sig) -> None:
        """Let others compile it, or find what was compiled."""
        if sig in self._claimed:
            claims_in(CACHE_FOLDER).let_go(self._claimed.pop(sig))


class KernelCache(ParallelKernelCache):
    """The same, but machine code that is found there is loaded as it is.

    numba first prepares for all that could be compiled, which took longer than loading the kernels of a short run.
    A kernel without the memory runtime needs none of it, and where nothing is found the compiler prepares itself.
    """

    def _load(self, sig, target_context):
        with self._guard_against_spurious_io_errors():
            found = self._load_overload(sig, target_context)
        return self._from_package(sig, target_context) if found is None else found


def _fields(kinds) -> tuple:
    """Names of the fields of all named tuples in numba's types of arguments, at any depth, in order."""
    named = [(kind.fields, _fields(kind.types)) for kind in kinds if isinstance(kind, types.BaseNamedTuple)]
    return (*named, *(_fields(kind.types) for kind in kinds if isinstance(kind, types.Tuple | types.UniTuple)))
