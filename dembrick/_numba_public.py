"""Kernels by numba's public API alone, for versions whose private names (`_numba`) changed: correct, slower to compile.

Called kernels are inlined by ``forceinline`` and compiled once per caller; there is no machine code from a wheel, and
no second process that compiles ahead. Machine code is in numba's own cache, in a folder named by the hash of all kernel
sources, as that cache checks only the file of a kernel. It may lose or mix entries when two processes write at once;
therefore the first process owns the folder as long as it lives, and others compile for themselves.
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
    """Folder of the machine code; None if this process cannot own it."""
    folder = _kernel_cache.CACHE_FOLDER / f"public-{kernel_hash()}"
    if not _file_locks.known() or not is_own(folder):
        return None
    return folder if claims_in(folder).take(0) else None


@contextmanager
def _numba_keeps_in(folder: Path | None) -> Iterator[None]:
    """Context in which numba places the cache of a kernel in a folder; the setting is restored afterwards."""
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
    """Kernel that is inlined into other kernels."""
    return _compiled(function, nogil=True, forceinline=True, **options)


def entry(function, **options):
    """Kernel that is called from Python or by a batch."""
    return _compiled(function, nogil=True, **options)


def parallel(function, **options):
    """Kernel with a parallel loop."""
    return _compiled(function, parallel=True, **options)


@contextmanager
def hearing(_kinds: tuple[str, ...], _begun: Callable[[], None]) -> Iterator[None]:
    """Context without effect, as numba's events are private."""
    yield


def call_at(place, *arguments):
    """`_jit.call_at`: here the kernel itself serves as its address."""
    return place(*arguments)


@overload(call_at)
def _call(place, *arguments):
    """`call_at` for numba; in place of a kernel there may be the number 0, where the call is never reached."""
    if isinstance(place, types.Integer):
        return lambda place, *arguments: 0
    return lambda place, *arguments: place(*arguments)


@overload(operator.ne)
def _differs(place, number):
    """Comparison of an address with 0, true for a kernel."""
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
    """`_jit.call_law` for numba: row addresses are passed as integers."""
    _call_c(place, move.ctypes.data, record.ctypes.data, memory.ctypes.data, answer.ctypes.data)


@numba.njit
def prefetch(*_):
    """`_jit.prefetch` without effect, as there is no public instruction for it."""
