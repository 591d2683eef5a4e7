"""Functions that kernels call by an address (`_jit.call_law`): user-defined joint laws.

Kernels are not compiled with them: one machine code serves all such laws, and none enters the kernel cache. Only
numba's public API is used.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numba
import numpy as np
from numba import carray, types

ANSWERS = 4  # numbers that a law returns


class PointerLaw:
    """A compiled function with an address: it takes three records of the ``kinds`` and returns `ANSWERS` numbers.

    If it raises an exception, the results are NaN. Without a compiler (``NUMBA_DISABLE_JIT``) the address is a
    function. Raises numba's error for a function that it cannot compile.
    """

    def __init__(self, function: Callable, kinds: Sequence[np.dtype]):
        if numba.config.DISABLE_JIT:
            self._compiled = None
            self._plain = _plain(getattr(function, "py_func", function), kinds)
            return
        law = function if hasattr(function, "py_func") else numba.njit(function, error_model="numpy")

        def called(move, record, memory, answer):
            found = carray(answer, ANSWERS)
            for k in range(ANSWERS):
                found[k] = np.nan  # remains if the law raises an exception
            one, own, kept = carray(move, 1), carray(record, 1), carray(memory, 1)
            found[0], found[1], found[2], found[3] = law(one[0], own[0], kept[0])

        pointers = [types.CPointer(numba.from_dtype(kind)) for kind in kinds]
        signature = types.void(*pointers, types.CPointer(types.float64))
        self._compiled = numba.cfunc(signature, error_model="numpy")(called)

    @property
    def at(self) -> np.ndarray:
        """Its address in this process (1,), for `_jit.call_law`."""
        if self._compiled is None:
            return np.array([self._plain], object)
        return np.array([self._compiled.address], np.int64)

    def __call__(self, *rows: np.ndarray) -> None:
        """Call it with a row of each kind, and one of `ANSWERS` numbers for the results."""
        if self._compiled is None:
            self._plain(*rows)
            return
        call = self._compiled.ctypes
        call(*(row.ctypes.data_as(kind) for row, kind in zip(rows, call.argtypes, strict=True)))


def _plain(function: Callable, kinds: Sequence[np.dtype]) -> Callable:
    """The same function without compilation."""

    def called(move, record, memory, answer):
        rows = (row.view(kind).view(np.recarray)[0] for row, kind in zip((move, record, memory), kinds, strict=True))
        answer[:] = function(*rows)

    return called
