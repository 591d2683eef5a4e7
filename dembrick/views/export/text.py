"""All series of a history as text."""

from __future__ import annotations

import csv
import os
from collections.abc import Callable

import numpy as np

from dembrick.history import History, replacing
from dembrick.history.files import writing
from dembrick.history.tables import columns_of
from dembrick.views.export.files import checked_target

_ROWS = 4096  # rows in memory at a time


def to_csv(history: History, path: str | os.PathLike, report: Callable[[str], None] | None = None) -> list[str]:
    """Write all series as text, one column each with its unit in the header; numbers keep all digits."""
    target = checked_target(history, path, frames=False)
    columns = columns_of(history)
    if report and not history.has_joints:
        report('the forces of the joints were not recorded; run again with "joints" in output.channels')
    with writing(path, "export"), replacing(target) as part, open(part, "w", newline="", encoding="utf-8") as file:
        lines = csv.writer(file, lineterminator="\n")
        lines.writerow([title for _, titles in columns for title in titles])
        for start in range(0, history.n_row, _ROWS):
            stop = min(start + _ROWS, history.n_row)
            block = [history.series(name, start, stop).reshape(stop - start, -1) for name, _ in columns]
            lines.writerows(np.hstack(block).tolist())
    return [target]
