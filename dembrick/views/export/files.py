"""What every export does with its path: check it, and leave nothing half written."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

from dembrick.errors import OutputError, WriteError
from dembrick.history import History, check_output, reason
from dembrick.views.motion.frames import frame_number


def checked_target(history: History, path: str | os.PathLike, frames: bool = True) -> str:
    """The real path to write to; OutputError if that is impossible, HistoryError if there is nothing to write."""
    target = check_output(path)
    if os.path.realpath(history.path) == target:
        raise OutputError(f"{path}: this is the history itself; choose another name")
    if frames:
        frame_number(history)  # or there is no motion to export
    return target


@contextmanager
def writing(path: str | os.PathLike) -> Iterator[None]:
    """A failed write becomes a WriteError; nothing that looks finished is left."""
    try:
        yield
    except (OSError, RuntimeError) as error:
        raise WriteError(f"{path}: the export could not be written ({reason(error)})") from error
