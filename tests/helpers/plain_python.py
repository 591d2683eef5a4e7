"""Kernels in plain Python (`NUMBA_DISABLE_JIT`) take a hundred times as long: tests draw fewer cases there."""

from typing import TypeVar

import numba

T = TypeVar("T")


def cases(compiled: T, plain: T) -> T:
    """``plain`` where kernels are not compiled."""
    return plain if numba.config.DISABLE_JIT else compiled
