"""Calls of small kernels between the chunks of a run, without checking the types of their arguments each time."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from dembrick._jit import ready

if TYPE_CHECKING:
    from dembrick.simulation.dynamics.state import MovingState


class KnownTypes:
    """Cache of the machine code of kernels for the argument types of a state, valid as long as the state is the same
    object. Arguments other than those of the state must have the same types at every call."""

    def __init__(self) -> None:
        self._state: MovingState | None = None
        self._codes: dict[int, Callable] = {}

    def call(self, state: MovingState, kernel: Callable, *arguments) -> Any:
        """Call a kernel with arrays of the ``state``, and others."""
        return self.of(state, kernel, *arguments)(*arguments)

    def of(self, state: MovingState, kernel: Callable, *arguments) -> Callable:
        """The machine code that `call` calls."""
        if state is not self._state:
            self._state, self._codes = state, {}
        code = self._codes.get(id(kernel))
        if code is None:
            code = self._codes[id(kernel)] = ready(kernel, *arguments)
        return code
