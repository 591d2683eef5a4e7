"""All series of a history as text."""

from __future__ import annotations

import csv
import os
from collections.abc import Callable

import numpy as np

from dembrick.history import History, replacing
from dembrick.history.files import writing
from dembrick.simulation.channels import CHANNELS, ROWS
from dembrick.views.export.files import checked_target

_ROWS = 4096  # rows held at a time


def names_of(history: History) -> dict[str, list[str]]:
    """Names of joints, blocks, actuators, control points, supports and ties, by what the shape of a channel counts.

    Joints are called by their blocks, with a number if several join the same two.
    """
    names = history.block_names
    pairs = [f"{names[joint['block_a']]}/{names[joint['block_b']]}" for joint in history.joints]
    if len(set(pairs)) < len(pairs):
        pairs = [f"{pair} #{i}" for i, pair in enumerate(pairs)]
    actuators, points = ([one["name"] for one in many] for many in (history.actuators, history.control_points))
    found = {"joint": pairs, "block": names, "actuator": actuators, "control_point": points}
    return found | {"support": history.support_names, "tie": [tie["name"] for tie in history.ties]}


def columns_of(history: History) -> list[tuple[str, list[str]]]:
    """The series of a history that are tables, with the headings of their columns, units in brackets."""
    names, there = names_of(history), set(history.series_names("history"))
    return [
        (channel.name, channel.titles(names, history.unit(channel.path)))
        for channel in CHANNELS
        if channel.columns and channel.grows_by == ROWS and channel.name in there
    ]


def to_csv(history: History, path: str | os.PathLike, report: Callable[[str], None] | None = None) -> list[str]:
    """All series as text, a column each with its unit in the header; numbers read back exactly."""
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
