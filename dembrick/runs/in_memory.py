"""The record of a run that is still in memory, as a history: for pictures of a result without a file."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager

from dembrick import history
from dembrick.errors import HistoryError
from dembrick.scenario import toml as scenarios


@contextmanager
def recording(result) -> Iterator[history.History]:
    """The history of a result: its file where it has one, else a temporary file that goes away again.

    Raises HistoryError if the run kept no record.
    """
    if result.history is not None:
        with history.read(result.history) as found:
            yield found
        return
    if not result.rows:
        raise HistoryError(f"{result.scenario.title}: the run kept no record; simulate it with record=True")
    with tempfile.TemporaryDirectory(prefix="dembrick-") as folder:
        path, channels = os.path.join(folder, "run.h5"), result.scenario.output.channels
        text, control = scenarios.text_of(result.scenario), result.scenario.control
        with history.HistoryWriter(path, text, result.assembly, {}, channels=channels, control=control) as writer:
            writer.append(result.rows)
            if "frames" in channels:
                writer.append_frames(**result.frames)
            chosen = result.run.settings
            writer.finish(result.status, result.as_dict(), chosen)
        with history.read(path) as found:
            yield found


def meshes(result, frame: int = -1, time: float | None = None, magnification: float = 1.0):
    """The blocks of a result in one frame as a ``pyvista.MultiBlock`` by name; see ``render.meshes``."""
    from dembrick.views import render

    with recording(result) as found:
        return render.meshes(found, frame, magnification, time)
