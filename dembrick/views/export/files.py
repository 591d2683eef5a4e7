"""Checks of the path of an export."""

from __future__ import annotations

import os

from dembrick.errors import OutputError
from dembrick.history import History, check_output
from dembrick.views.motion.frames import frame_number


def checked_target(history: History, path: str | os.PathLike, frames: bool = True) -> str:
    """The real path to write to; OutputError if that is impossible, HistoryError if there is nothing to write."""
    target = check_output(path)
    if os.path.realpath(history.path) == target:
        raise OutputError(f"{path}: this is the history itself; choose another name")
    if frames:
        frame_number(history)  # raises if there is no motion to export
    return target
