"""Kernels by public means of numba alone, where its private parts (`_numba`) moved: right, and slower to compile.

Called kernels are inlined by ``forceinline`` and compiled once for every caller; nothing comes with a wheel, and no
second process compiles ahead. Machine code is kept by numba's own cache, in a folder that is named by all sources of
kernels, as that cache looks at the file of a kernel only. It may lose or mix entries that two processes write at once:
the first process has the folder for as long as it lives, others compile for themselves.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import numba
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, overload, register_jitable

from dembrick import _file_locks, _kernel_cache
from dembrick._kernel_cache import claims_in, is_own
from dembrick._kernel_sources import kernel_hash

compute_fingerprint = numba.typeof


@cache
def _folder() -> Path | None:
    """Folder of the machine code; None if this process cannot have it for itself."""
    folder = _kernel_cache.CACHE_FOLDER / f"public-{kernel_hash()}"
    if not _file_locks.known() or not is_own(folder):
        return None
    return folder if claims_in(folder).take(0) else None


@contextmanager
def _numba_keeps_in(folder: Path | None) -> Iterator[None]:
    """Context in which numba makes the cache of a kernel in a folder; afterwards that of others is where it was."""
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = before if folder is None else str(folder)
    try:
        yield
    finally:
        numba.config.CACHE_DIR = before


def _compiled(function, **options):
    folder = _folder() if function.__module__.startswith(f"{__package__}.kernels.") else None
    with _numba_keeps_in(folder):
        return numba.njit(error_model="numpy", cache=folder is not None, **options)(function)


def inlined(function, **options):
    """Kernel that other kernels take into their own code."""
    return _compiled(function, nogil=True, forceinline=True, **options)


def entry(function, **options):
    """Kernel that Python or a batch enters."""
    return _compiled(function, nogil=True, **options)


def parallel(function, **options):
    """Kernel over threads."""
    return _compiled(function, parallel=True, **options)


@contextmanager
def hearing(_kinds: tuple[str, ...], _begun: Callable[[], None]) -> Iterator[None]:
    """Context that hears of nothing: numba's events are private."""
    yield


def call_at(place, *arguments):
    """`_jit.call_at`: the kernel itself is its address."""
    return place(*arguments)


@overload(call_at)
def _call(place, *arguments):
    """`call_at` for numba; no kernel, the number 0, is there where the call is never reached."""
    if isinstance(place, types.Integer):
        return lambda place, *arguments: 0
    return lambda place, *arguments: place(*arguments)


@overload(operator.ne)
def _differs(place, number):
    """The test whether there is a kernel to call."""
    if isinstance(place, types.Dispatcher) and isinstance(number, types.Integer):
        return lambda place, number: True
    return None


@intrinsic
def _call_c(_, place, move, record, memory, answer):
    def code(context, builder, signature, arguments):
        kind = ir.FunctionType(ir.VoidType(), [row.type for row in arguments[1:]])
        builder.call(builder.inttoptr(arguments[0], kind.as_pointer()), arguments[1:])
        return context.get_dummy_value()

    return types.void(place, move, record, memory, answer), code


@register_jitable
def call_law(place, move, record, memory, answer):
    """`_jit.call_law` for numba: the places of the rows as whole numbers."""
    _call_c(place, move.ctypes.data, record.ctypes.data, memory.ctypes.data, answer.ctypes.data)


@numba.njit
def prefetch(*_):
    """`_jit.prefetch`: nothing, as no public instruction does it."""
