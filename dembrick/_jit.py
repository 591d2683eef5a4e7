"""The one decorator of the compiled kernels (in five strengths)."""

from __future__ import annotations

import platform
from collections.abc import Callable

import numba
from numba import get_num_threads, prange

from dembrick._numba_check import refusal

if WHY_PUBLIC := refusal():  # reason why kernels are compiled by numba's public means
    from dembrick import _numba_public as compiler
else:
    from dembrick import _numba as compiler  # type: ignore[no-redef]

from dembrick._kernel_cache import CACHE_FOLDER, renamed  # noqa: E402
from dembrick._packaged_kernels import packaged_kernels, why_compiled  # noqa: E402

__all__ = [
    "address",
    "call_at",
    "call_law",
    "compute_fingerprint",
    "get_num_threads",
    "hearing",
    "jit",
    "jit_parallel",
    "jit_rounded",
    "jit_sum",
    "prange",
    "ready",
    "renamed",
    "versions",
]

# A product and a sum may be rounded once instead of twice (a fused multiply-add): no result gets worse, what is not a
# number stays so, and the order of a sum is as written. All else that is called fast math is left alone: it reorders
# sums, or takes it that NaN and infinity never come, and a run lives by its NaN guard.
FLOATS = {"contract"}


compute_fingerprint, hearing = compiler.compute_fingerprint, compiler.hearing


def _inlined(function, **options):
    return function if numba.config.DISABLE_JIT else compiler.inlined(function, **options)


def jit(function):
    """Compile lazily, cached on disk.

    Without numba's memory runtime nothing can be allocated in a kernel, and no array is reference-counted in its inner
    loop; inlined, nothing is copied for a call. Together that made a step of the lab scene five times faster. Python's
    lock is let go of, so that threads can share a batch.
    """
    return _inlined(function, fastmath=FLOATS)


def jit_rounded(function):
    """The same, every product and every sum rounded by itself, as numpy does: who adds up the same numbers there finds
    the same bits."""
    return _inlined(function, fastmath=False)


def jit_sum(function):
    """The same for a sum whose terms may be added in any order, and so several at once; no block must move by it."""
    return _inlined(function, fastmath=FLOATS | {"reassoc"})


def entry(function):
    """The same for a loop that Python or a batch enters: compiled once, not inlined into every caller."""
    return function if numba.config.DISABLE_JIT else compiler.entry(function, fastmath=FLOATS)


def ready(kernel, *arguments) -> Callable:
    """The machine code of an `entry` for arguments of these types, compiled or out of the cache: what to call instead.

    Whoever calls the kernel itself has the types of all arguments found at every call, which takes 8 us for the 70
    arrays of a search, ten times as long as unpacking them. What is called here takes them for known: where an array
    has another data type, layout or number of dimensions it ends the process, or reads what is not there.
    """
    return kernel.ready(*arguments) if hasattr(kernel, "ready") else kernel


def address(kernel, *arguments) -> int | Callable:
    """Where the machine code of an `entry` for arguments of these types lies in this process, for `call_at`."""
    return kernel.address(*arguments) if hasattr(kernel, "address") else kernel


def call_at(place, *arguments):
    """Call the `entry` of four arguments, and one integer that it returns, whose code lies at that `address`.

    Its code does not become part of the caller's: it is compiled once for all loops that call it. Nobody checks that
    the arguments are of the types for which the address was asked.
    """
    return place(*arguments)


def call_law(place, move, record, memory, answer) -> None:
    """Call the function of four rows of numbers that lies at an address (`_pointer_law`), by the conventions of C.

    Nobody checks that there is one, or that the rows are long enough.
    """
    place(move, record, memory, answer)


def prefetch(array, index, byte) -> None:
    """Have the line of the cache with a byte of one entry of an array (one-dimensional) on its way before it is needed.

    It is no error if there is no such entry.
    """


if not numba.config.DISABLE_JIT:
    prefetch, call_at, call_law = compiler.prefetch, compiler.call_at, compiler.call_law


def jit_parallel(function):
    """The same for a loop over threads (``prange``); it compiles for much longer, so only large scenes call for it."""
    return function if numba.config.DISABLE_JIT else compiler.parallel(function, fastmath=FLOATS)


def versions() -> list[str]:
    """Lines about Python, numba, and where machine code of the kernels comes from."""
    lines = [f"Python {platform.python_version()}, numba {numba.__version__}"]
    if WHY_PUBLIC:
        return [*lines, f"kernels: compiled by public means of numba alone, which takes longer: {WHY_PUBLIC}"]
    package, reason = packaged_kernels(), why_compiled()
    if package is not None:
        return [*lines, f"kernels: package, compiled for {package.target[1]}"]
    kept = any(CACHE_FOLDER.glob("*.nbi"))
    lines.append(f"kernels: {'cache' if kept else 'compiled at the first run, and kept in'} {CACHE_FOLDER}")
    return [*lines, f"         not from the package: {reason}"] if reason else lines
