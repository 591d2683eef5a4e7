"""The record of a run in memory as a history, to draw a result that has no file."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from dembrick import history
from dembrick.errors import HistoryError
from dembrick.scenario import toml as scenarios


@contextmanager
def temporary(write: Callable[[str], object], name: str = "run.h5") -> Iterator[history.History]:
    """Context with the history that ``write(path)`` writes into a temporary file, which is removed at the end."""
    with tempfile.TemporaryDirectory(prefix="dembrick-") as folder:
        path = os.path.join(folder, name)
        write(path)
        with history.read(path) as found:
            yield found


@contextmanager
def recording(result) -> Iterator[history.History]:
    """Context with the history of a result: its file if it has one, else a temporary file, removed at the end.

    Raises HistoryError if the run kept no record.
    """

    def write(path: str) -> None:
        scenario, channels = result.scenario, result.scenario.output.channels
        text = scenarios.text_of(scenario)
        with history.HistoryWriter(
            path, text, result.assembly, {}, channels=channels, control=scenario.control
        ) as writer:
            writer.append(result.rows)
            if "frames" in channels:
                writer.append_frames(**result.frames)
            writer.finish(result.status, result.as_dict(), result.run.settings)

    if result.history is None and not result.rows:
        raise HistoryError(f"{result.scenario.title}: the run kept no record; simulate it with record=True")
    with temporary(write) if result.history is None else history.read(result.history) as found:
        yield found
