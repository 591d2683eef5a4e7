"""All series of a history as text."""

from __future__ import annotations

import csv
import os
from collections.abc import Callable

import numpy as np

from dembrick.history import History, replacing
from dembrick.history.layout import JOINT_CHANNELS, load_of
from dembrick.views.export.files import checked_target, writing

_ROWS = 4096  # rows held at a time


def to_csv(history: History, path: str | os.PathLike, report: Callable[[str], None] | None = None) -> list[str]:
    """All series as text, a column each with its unit in the header; numbers read back exactly."""
    target = checked_target(history, path, frames=False)
    units, _ = load_of(history.scenario_text)
    time = "equilibrium [1]" if history.counts_equilibria else "time [s]"
    columns = [("time", [time]), ("load", [f"load [{units}]"]), ("displacement", ["displacement [m]"])]
    actuators, watched = [actuator["name"] for actuator in history.actuators], []
    columns.append(("actuator_displacement", [f"displacement of {name} [m]" for name in actuators]))
    columns.append(("actuator_force", [f"force of {name} [N]" for name in actuators]))
    for point in history.control_points:
        watched += [f"u_{axis} of {point['name']} [m]" for axis in "xyz"]
    if watched:
        columns.append(("control_point", watched))
    names = history.block_names
    pairs = [f"{names[joint['block_a']]}/{names[joint['block_b']]}" for joint in history.joints]
    if len(set(pairs)) < len(pairs):
        pairs = [f"{pair} #{i}" for i, pair in enumerate(pairs)]
    if history.has_joints:
        for name, (unit, _) in JOINT_CHANNELS.items():
            columns.append((f"joint/{name}", [f"{name} {pair} [{unit}]" for pair in pairs]))
    elif report:
        report('the forces of the joints were not recorded; run again with "joints" in output.channels')
    columns += [(f"energy/{name}", [f"{name} energy [J]"]) for name in history.energy_names]
    columns.append(("unbalanced", ["unbalanced [1]"]))
    with writing(path), replacing(target) as part, open(part, "w", newline="", encoding="utf-8") as file:
        lines = csv.writer(file, lineterminator="\n")
        lines.writerow([title for _, titles in columns for title in titles])
        for start in range(0, history.n_row, _ROWS):
            stop = min(start + _ROWS, history.n_row)
            block = [history.series(name, start, stop).reshape(stop - start, -1) for name, _ in columns]
            lines.writerows(np.hstack(block).tolist())
    return [target]
