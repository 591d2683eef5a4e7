"""Views of a history that is given by the path of its file."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import wraps
from typing import Any, Concatenate, ParamSpec, TypeAlias, TypeVar

P, R = ParamSpec("P"), TypeVar("R")
Given: TypeAlias = "Any | str | os.PathLike | Sequence[Any]"  # a history or a result, the path of one, or several


def takes_paths(view: Callable[Concatenate[Any, P], R]) -> Callable[Concatenate[Given, P], R]:
    """A view whose first argument, a history or several, may as well be the path of one: opened for as long as the
    view takes. Raises HistoryError as `dembrick.read_history`."""

    @wraps(view)
    def opening(history: Given, /, *args: P.args, **options: P.kwargs) -> R:
        from dembrick.history import read  # and h5py: for paths only

        with ExitStack() as opened:

            def of(one: Any) -> Any:
                return opened.enter_context(read(one)) if isinstance(one, str | os.PathLike) else one

            found = [of(one) for one in history] if isinstance(history, list | tuple) else of(history)
            return view(found, *args, **options)

    return opening
