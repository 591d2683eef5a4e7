"""Histories as tables of pandas and datasets of xarray, if these libraries are installed."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

from dembrick.assembly.actuators import BODY_FORCE
from dembrick.errors import needed
from dembrick.simulation.channels import CHANNELS, CONTACTS, FRAMES, NO_BOUND, ROWS

if TYPE_CHECKING:
    import pandas
    import xarray

    from dembrick.history.reader import History

AXES = {3: ("axis", list("xyz")), 4: ("quaternion", list("wxyz")), 2: ("tangent", ["t1", "t2"])}
TAKEN = {"control_point": "control_point_displacement"}  # series with the name of a dimension: their variables
AXES[6] = ("component", ["F_x", "F_y", "F_z", "M_x", "M_y", "M_z"])


def names_of(history: History) -> dict[str, list[str]]:
    """Names of joints, blocks, actuators, control points, supports and ties, by array dimension.

    Joints are named after their blocks; if two have the same name, all names get a number. Of other things, such as the
    loads of a tilt, those that share a name get one.
    """
    names = history.block_names
    pairs = [f"{names[joint['block_a']]}/{names[joint['block_b']]}" for joint in history.joints]
    if len(set(pairs)) < len(pairs):
        pairs = [f"{pair} #{i}" for i, pair in enumerate(pairs)]
    actuators, points = ([one["name"] for one in many] for many in (history.actuators, history.control_points))
    found = {"joint": pairs, "block": names, "actuator": actuators, "control_point": points}
    found |= {"support": history.support_names, "tie": [tie["name"] for tie in history.ties]}
    return {kind: _told_apart(own) for kind, own in found.items()}


def _told_apart(names: list[str]) -> list[str]:
    """Names, with their numbers where several are the same."""
    count = Counter(names)
    return [f"{name} #{i}" if count[name] > 1 else name for i, name in enumerate(names)]


def columns_of(history: History) -> list[tuple[str, list[str]]]:
    """The tabular series of a history, with column headings that have units in brackets. Body forces, one on every
    block, come last."""
    names, there = names_of(history), set(history.series_names("history"))
    found = [one for one in CHANNELS if one.columns and one.grows_by == ROWS and one.name in there]
    if any(one["kind"] == BODY_FORCE for one in history.actuators):
        found.sort(key=lambda channel: channel.shape == ("actuator",))
    return [(channel.name, channel.titles(names, history.unit(channel.path))) for channel in found]


def to_pandas(history: History) -> pandas.DataFrame:
    """All series, one row each, indexed by time (s) or by the number of the equilibrium; headings include units.

    Raises MissingDependency without pandas.
    """
    pandas = needed("pandas", "a table")
    columns = columns_of(history)
    titles = [title for _, own in columns for title in own]
    values = [history.series(name).reshape(history.n_row, -1) for name, _ in columns]
    table = pandas.DataFrame(np.hstack(values) if values else np.zeros((0, 0)), columns=titles)
    return table.set_index(titles[0]) if titles else table


def to_xarray(history: History) -> xarray.Dataset:
    """All series and frames with named dimensions: ``row`` and ``frame`` (with their times, or numbers of equilibria),
    ``joint``, ``block``, ``actuator``, ``control_point``, ``support``, ``tie`` (with their names), ``axis``; unit and
    description are attributes of each variable. The series ``control_point`` is ``control_point_displacement`` there.
    While no upper bound is known, ``upper`` is infinite.

    Raises MissingDependency without xarray.
    """
    xarray = needed("xarray", "a dataset")
    names = names_of(history)
    counted = "number of the equilibrium" if history.counts_equilibria else "time"
    clock = {"units": history.unit("time"), "long_name": counted}
    variables, coordinates = {}, {"time": ("row", history.time, clock)}
    if history.has_frames:
        coordinates["frame_time"] = ("frame", history.frame_time, clock)
    there = {f"{group}/{name}" for group in ("history", "frames") for name in history.series_names(group)}
    for channel in CHANNELS:
        if channel.path not in there or channel.grows_by == CONTACTS or channel.path.endswith("/time"):
            continue
        framed = channel.grows_by == FRAMES
        dims = ["frame" if framed else "row"]
        for count in channel.shape:
            dim, labels = AXES[count] if isinstance(count, int) else (count, names.get(count))
            dims.append(dim)
            if labels is not None:
                coordinates[dim] = (dim, list(labels))
        name = TAKEN.get(channel.name, channel.name).replace("/", "_")
        values = history.entries(channel.path, 0, history.n_frames if framed else history.n_row)
        about = channel.about.format_map(_Words())
        if channel.path == "history/upper":
            values, about = np.where(values >= NO_BOUND, np.inf, values), about.replace("1e300", "inf")
        attributes = {"units": history.unit(channel.path), "long_name": about}
        variables[f"frame_{name}" if framed else name] = (dims, values, attributes)
    return xarray.Dataset(variables, coordinates, {"title": history.title, "status": history.status})


class _Words(dict):
    """Leaves placeholders of a description unchanged if only a run could fill them."""

    def __missing__(self, word: str) -> str:
        return word if word != "when" else ""
