"""Kernels in plain Python (`NUMBA_DISABLE_JIT`) take a hundred times as long: tests then draw fewer cases."""

from typing import TypeVar

import numba

T = TypeVar("T")


def cases(compiled: T, plain: T) -> T:
    """``plain`` if kernels are not compiled, otherwise ``compiled``."""
    return plain if numba.config.DISABLE_JIT else compiled
