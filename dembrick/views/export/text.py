"""All series of a history as text."""

from __future__ import annotations

import csv
import os
from collections.abc import Callable

import numpy as np

from dembrick.history import History, replacing
from dembrick.simulation.channels import CHANNELS, ROWS
from dembrick.views.export.files import checked_target, writing

_ROWS = 4096  # rows held at a time


def to_csv(history: History, path: str | os.PathLike, report: Callable[[str], None] | None = None) -> list[str]:
    """All series as text, a column each with its unit in the header; numbers read back exactly."""
    target = checked_target(history, path, frames=False)
    names = history.block_names
    pairs = [f"{names[joint['block_a']]}/{names[joint['block_b']]}" for joint in history.joints]
    if len(set(pairs)) < len(pairs):
        pairs = [f"{pair} #{i}" for i, pair in enumerate(pairs)]
    counted = {"joint": pairs, "block": names}
    counted["actuator"] = [actuator["name"] for actuator in history.actuators]
    counted["control_point"] = [point["name"] for point in history.control_points]
    there = set(history.series_names("history"))
    columns = [
        (channel.name, channel.titles(counted, history.unit(channel.path)))
        for channel in CHANNELS
        if channel.columns and channel.grows_by == ROWS and channel.name in there
    ]
    if report and not history.has_joints:
        report('the forces of the joints were not recorded; run again with "joints" in output.channels')
    with writing(path), replacing(target) as part, open(part, "w", newline="", encoding="utf-8") as file:
        lines = csv.writer(file, lineterminator="\n")
        lines.writerow([title for _, titles in columns for title in titles])
        for start in range(0, history.n_row, _ROWS):
            stop = min(start + _ROWS, history.n_row)
            block = [history.series(name, start, stop).reshape(stop - start, -1) for name, _ in columns]
            lines.writerows(np.hstack(block).tolist())
    return [target]
