"""Views that accept the path of a history file in place of a history."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import wraps
from typing import Any, Concatenate, ParamSpec, TypeAlias, TypeVar

P = ParamSpec("P")
R = TypeVar("R")
Given: TypeAlias = "Any | str | os.PathLike | Sequence[Any]"  # a history or a result, the path of one, or several


def accepts_paths(view: Callable[Concatenate[Any, P], R]) -> Callable[Concatenate[Given, P], R]:
    """Let the first argument of a view, a history or several, also be a path or paths; the files stay open while the
    view runs. Raises HistoryError like `dembrick.read_history`."""

    @wraps(view)
    def opening(history: Given, /, *args: P.args, **options: P.kwargs) -> R:
        from dembrick.history import read  # imports h5py, which only paths need

        with ExitStack() as opened:

            def of(one: Any) -> Any:
                return opened.enter_context(read(one)) if isinstance(one, str | os.PathLike) else one

            found = [of(one) for one in history] if isinstance(history, list | tuple) else of(history)
            return view(found, *args, **options)

    return opening
