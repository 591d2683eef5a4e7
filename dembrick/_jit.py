"""The decorators of all compiled kernels."""

from __future__ import annotations

import platform
from collections.abc import Callable

import numba
from numba import get_num_threads, prange

from dembrick._numba_check import refusal

if WHY_PUBLIC := refusal():  # reason for compiling kernels by numba's public API
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

# "contract" allows fused multiply-add, with one rounding instead of two: no result gets less accurate, NaN is preserved
# and sums keep their order. The other fast-math flags are not used: they reorder sums, or assume that NaN and infinity
# never occur, which would disable the NaN guard of runs.
FLOATS = {"contract"}


compute_fingerprint, hearing = compiler.compute_fingerprint, compiler.hearing


def _inlined(function, **options):
    return function if numba.config.DISABLE_JIT else compiler.inlined(function, **options)


def jit(function):
    """Compile lazily, cached on disk.

    Without numba's memory runtime a kernel cannot allocate, and no array is reference-counted in its inner loop; by
    inlining, no call copies its arguments. Together this made a step of the lab scene five times faster. The GIL is
    released, so that threads can share a batch.
    """
    return _inlined(function, fastmath=FLOATS)


def jit_rounded(function):
    """The same with every product and every sum rounded separately, as in numpy: the same sum there has equal bits."""
    return _inlined(function, fastmath=False)


def jit_sum(function):
    """The same for a sum whose terms may be reordered and so vectorised; no motion of a block may depend on it."""
    return _inlined(function, fastmath=FLOATS | {"reassoc"})


def entry(function):
    """The same for a loop that is called from Python or by a batch: compiled once, not inlined into every caller."""
    return function if numba.config.DISABLE_JIT else compiler.entry(function, fastmath=FLOATS)


def ready(kernel, *arguments) -> Callable:
    """Machine code of an `entry` for arguments of these types, compiled or from the cache, to be called directly.

    A call of the kernel itself determines the types of all arguments, which takes 8 us for the 70 arrays of a search,
    ten times as long as unpacking them. The function returned here does not check types: an array of another data type,
    layout or number of dimensions crashes the process, or causes invalid reads.
    """
    return kernel.ready(*arguments) if hasattr(kernel, "ready") else kernel


def address(kernel, *arguments) -> int | Callable:
    """Address of the machine code of an `entry` for arguments of these types in this process, for `call_at`."""
    return kernel.address(*arguments) if hasattr(kernel, "address") else kernel


def call_at(place, *arguments):
    """Call an `entry` with four arguments and one integer result, whose machine code is at that `address`.

    Its code is not inlined into the caller: it is compiled once for all loops that call it. The types of the arguments
    are not checked against those for which the address was obtained.
    """
    return place(*arguments)


def call_law(place, move, record, memory, answer) -> None:
    """Call the function of four rows of numbers at an address (`_pointer_law`), by the C calling convention.

    Neither the address nor the lengths of the rows are checked.
    """
    place(move, record, memory, answer)


def prefetch(array, index, byte) -> None:
    """Prefetch the cache line with a byte of one entry of a one-dimensional array.

    The entry need not exist.
    """


if not numba.config.DISABLE_JIT:
    prefetch, call_at, call_law = compiler.prefetch, compiler.call_at, compiler.call_law


def jit_parallel(function):
    """The same for a loop over threads (``prange``); it takes much longer to compile, so only large scenes use it."""
    return function if numba.config.DISABLE_JIT else compiler.parallel(function, fastmath=FLOATS)


def versions() -> list[str]:
    """Lines about Python, numba, and the source of the machine code of the kernels."""
    lines = [f"Python {platform.python_version()}, numba {numba.__version__}"]
    if WHY_PUBLIC:
        return [*lines, f"kernels: compiled by public means of numba alone, which takes longer: {WHY_PUBLIC}"]
    package, reason = packaged_kernels(), why_compiled()
    if package is not None:
        return [*lines, f"kernels: package, compiled for {package.target[1]}"]
    kept = any(CACHE_FOLDER.glob("*.nbi"))
    lines.append(f"kernels: {'cache' if kept else 'compiled at the first run, and kept in'} {CACHE_FOLDER}")
    return [*lines, f"         not from the package: {reason}"] if reason else lines
