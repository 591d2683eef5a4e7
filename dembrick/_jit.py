"""The one decorator of the compiled kernels (in four strengths), and where their machine code is kept.

numba's cache looks at the file of a kernel only: after an edit in a helper module it would go on serving the old
physics. So the cache folder carries a hash of all kernel sources and of numba's version in its name.
"""

from __future__ import annotations

import hashlib
import os
import stat
import tempfile
import time
from contextlib import suppress
from functools import cache, cached_property
from pathlib import Path
from types import FunctionType

try:
    import fcntl
except ImportError:  # a system without POSIX locks
    fcntl = None  # type: ignore[assignment]

import numba
from llvmlite import ir
from numba import get_num_threads, prange
from numba.core import cgutils, event, types
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.registry import CPUDispatcher
from numba.extending import intrinsic

__all__ = ["CACHE_FOLDER", "get_num_threads", "jit", "jit_parallel", "jit_sum", "kernel_hash", "prange"]

PACKAGE = Path(__file__).parent
PATIENCE = 60.0  # s, for which a process waits for another that compiles what it wants; then it compiles that itself
LOOK = 0.02  # s, between two looks whether the other is done
WAITING = "dembrick:waiting"  # numba's event of such a wait


@cache
def kernel_hash() -> str:
    """Hash of everything that ends up in machine code, as its sources were when it was first asked for."""
    return source_hash(PACKAGE)


def source_hash(package: Path) -> str:
    """Hash of numba and of all sources of kernels in a copy of the package, at any depth below ``kernels``.

    numba counts by its version, by whether it checks bounds (``NUMBA_BOUNDSCHECK``) and by how far it optimises
    (``NUMBA_OPT``), which its own cache ignores. The path does not count: copies of the same sources share what one of
    them has compiled.
    """
    settings = f"{numba.__version__} {numba.config.BOUNDSCHECK} {numba.config.OPT}"
    digest = hashlib.sha256(settings.encode())
    for source in [package / "_jit.py", *sorted((package / "kernels").rglob("*.py"))]:
        digest.update(f"\n{source.relative_to(package).as_posix()}\n".encode() + source.read_bytes())
    return digest.hexdigest()[:16]


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
    """``$DEMBRICK_CACHE_DIR``, else the user's cache folder, else a temporary one; a folder per source hash in it.

    One that others could have written is not taken: then the machine code is kept for this process alone.
    """
    bases = []
    if os.environ.get("DEMBRICK_CACHE_DIR"):
        bases.append(Path(os.environ["DEMBRICK_CACHE_DIR"]))
    bases.append(Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "dembrick")
    bases.append(Path(tempfile.gettempdir()) / f"dembrick-{os.getuid() if hasattr(os, 'getuid') else 'user'}")
    for base in bases:
        folder = base / kernel_hash()
        if _is_safe(base) and is_own(folder):
            return folder
    return Path(tempfile.mkdtemp(prefix="dembrick-"))


CACHE_FOLDER = cache_folder()


# A product and a sum may be rounded once instead of twice (a fused multiply-add): no result gets worse, what is not a
# number stays so, and the order of a sum is as written. All else that is called fast math is left alone: it reorders
# sums, or takes it that NaN and infinity never come, and a run lives by its NaN guard.
FLOATS = {"contract"}


class _Folder:
    """Where the machine code of a kernel of this package is kept: found by the kernel's module, not by its path."""

    def __init__(self, function):
        self._name = f"{function.__module__}-{function.__code__.co_firstlineno}"
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
        """What makes old machine code useless: any edit of a kernel, which gives the folder another name."""
        return CACHE_FOLDER.name

    def get_disambiguator(self):
        """See numba."""
        return self._name


class _CacheFile(IndexDataCacheFile):
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


class _Claims:
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
def _claims_in(folder: Path) -> _Claims:
    return _Claims(folder / ".claims")


class _Impl(FunctionCache._impl_class):
    _locator_classes = [_Folder]


class _ParallelCache(FunctionCache):
    """numba's cache in the package's own folder; what is not there is compiled by one process at a time."""

    _impl_class = _Impl

    def __init__(self, function):
        super().__init__(function)
        self._cache_file = _CacheFile(self._cache_path, self._impl.filename_base, self._impl.locator.get_source_stamp())
        self._claimed: dict = {}

    def load_overload(self, sig, target_context):
        """See numba. Where there is nothing this process has claimed it when it returns."""
        found = self._load(sig, target_context)
        if found is None:
            what = f"{self._impl.filename_base} {sig} {target_context.codegen().magic_tuple()}"
            byte = int.from_bytes(hashlib.sha256(what.encode()).digest()[:7], "big")
            self._claimed[sig] = byte
            _claims_in(CACHE_FOLDER).wait(byte)
            found = self._load(sig, target_context)
        return found

    def _load(self, sig, target_context):
        return super().load_overload(sig, target_context)

    def let_go(self, sig) -> None:
        """Let others compile it, or find what was compiled."""
        if sig in self._claimed:
            _claims_in(CACHE_FOLDER).let_go(self._claimed.pop(sig))


class _Cache(_ParallelCache):
    """The same, but machine code that is found there is loaded as it is.

    numba first prepares for all that could be compiled, which took longer than loading the kernels of a short run.
    A kernel without the memory runtime needs none of it, and where nothing is found the compiler prepares itself.
    """

    def _load(self, sig, target_context):
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)


class _Called(CPUDispatcher):
    """A function as Python calls it."""

    def compile(self, sig):
        """See numba."""
        try:
            return super().compile(sig)
        finally:
            if isinstance(self._cache, _ParallelCache):
                self._cache.let_go(sig)


def _compiled(function, cache=_Cache, fastmath=FLOATS, **options):
    wanted = {"nopython": True, "boundscheck": None, "error_model": "numpy", "fastmath": fastmath, **options}
    kernel = _Called(function, targetoptions={"no_cfunc_wrapper": True, **wanted})
    if function.__module__.startswith(f"{__package__}.kernels."):  # what the name of the folder answers for
        kernel._cache = cache(function)  # what ``cache=True`` does
    return kernel


def renamed(function, name: str):
    """A copy of a Python function under another name: compiled in another way, it must not share a cache entry."""
    copy = FunctionType(function.__code__, function.__globals__, name, function.__defaults__)
    copy.__qualname__, copy.__doc__, copy.__module__ = name, function.__doc__, function.__module__
    return copy


class _Part(JITCodeLibrary):
    """Code that only ever becomes part of other code: it is optimised, and made machine code, there and not by itself.

    numba does both for every function it compiles, together with all that it calls: what is called from a depth of ten
    was optimised ten times, and nobody ever ran nine of them.
    """

    def _optimize_final_module(self):
        pass

    def _finalize_final_module(self):
        self._finalize_dynamic_globals()
        self._finalized = True


class _PartCompiler(Compiler):
    def __init__(self, typingctx, targetctx, _, args, return_type, flags, locals):
        flags.no_compile = flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True
        super().__init__(typingctx, targetctx, _Part(targetctx.codegen(), "part"), args, return_type, flags, locals)


class _Parts(CPUDispatcher):
    """A function as other kernels see it."""

    def add_overload(self, cres):
        """See numba. What was compiled has no entry point, the name under which numba would find it: it gets one."""
        cres, part = cres._replace(entry_point=object()), cres._asdict()["library"]
        self.targetctx.insert_user_function(cres.entry_point, cres.fndesc, [part])
        self.overloads[tuple(cres.signature.args)] = cres


class Kernel:
    """A kernel that Python and other kernels call. numba's dispatcher of it is made when it is first asked for: a run
    that finds its kernels in the cache asks for few."""

    def __init__(self, function, **options):
        self.__name__, self.__qualname__ = function.__name__, function.__qualname__
        self.__module__, self.__doc__ = function.__module__, function.__doc__
        self.py_func = self.__wrapped__ = function
        self._options = options

    @cached_property
    def called(self):
        """What Python calls."""
        return _compiled(self.py_func, **self._options)

    @cached_property
    def _numba_type_(self):
        """What other kernels see; a weak reference."""
        return numba.types.Dispatcher(self.called)

    def __call__(self, *arguments):
        """Call it from Python."""
        return self.called(*arguments)


class Inlined(Kernel):
    """A kernel that other kernels take into their own code, and that Python may call as well.

    Other kernels take it as `_Parts`, without the code by which Python calls it, which holds the whole body once more;
    a first run compiles in less than half the time. ``called`` is compiled if Python calls. Not so for a kernel that
    only Python calls, which is better an `entry`.
    """

    def __init__(self, function, **options):
        super().__init__(function, **{"fastmath": FLOATS, **options})

    @cached_property
    def _part(self):
        wanted = {"nopython": True, "error_model": "numpy", "forceinline": True, **self._options}
        return _Parts(self.py_func, targetoptions=wanted, pipeline_class=_PartCompiler)

    @cached_property
    def _numba_type_(self):
        """What other kernels see; a weak reference."""
        return numba.types.Dispatcher(self._part)

    @cached_property
    def called(self):
        """What Python calls."""
        return _compiled(renamed(self.py_func, f"{self.py_func.__name__}_called"), **self._options)


def _inlined(function, **options):
    return function if numba.config.DISABLE_JIT else Inlined(function, nogil=True, _nrt=False, **options)


def jit(function):
    """Compile lazily, cached on disk.

    Without numba's memory runtime nothing can be allocated in a kernel, and no array is reference-counted in its inner
    loop; inlined, nothing is copied for a call. Together that made a step of the lab scene five times faster. Python's
    lock is let go of, so that threads can share a batch.
    """
    return _inlined(function)


def jit_sum(function):
    """The same for a sum whose terms may be added in any order, and so several at once; no block must move by it."""
    return _inlined(function, fastmath=FLOATS | {"reassoc"})


def entry(function):
    """The same for a loop that Python or a batch enters: compiled once, not inlined into every caller."""
    return function if numba.config.DISABLE_JIT else Kernel(function, nogil=True, _nrt=False)


def _prefetch(_, array, index):
    """`prefetch` for numba: the instruction of the processor."""

    def code(context, builder, signature, arguments):
        place = builder.gep(context.make_array(signature.args[0])(context, builder, arguments[0]).data, [arguments[1]])
        byte, number = cgutils.voidptr_t, cgutils.int32_t
        kind = ir.FunctionType(ir.VoidType(), [byte, number, number, number])
        instruction = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        read, keep, data = number(0), number(3), number(1)
        builder.call(instruction, [builder.bitcast(place, byte), read, keep, data])
        return context.get_dummy_value()

    return types.void(array, types.intp), code


def prefetch(array, index) -> None:
    """Have the line of the cache that holds this number of an array (one-dimensional) on its way before it is needed.

    It is no error if there is no such number.
    """


if not numba.config.DISABLE_JIT:
    prefetch = intrinsic(_prefetch)


def jit_parallel(function):
    """The same for a loop over threads (``prange``); it compiles for much longer, so only large scenes call for it."""
    return function if numba.config.DISABLE_JIT else Kernel(function, cache=_ParallelCache, parallel=True)
