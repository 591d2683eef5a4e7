"""Distinction of the runs in a figure: their differences in the legend, their common description in the title, and a
line style for each, with the colour of its formulation."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from dembrick.errors import ScenarioError
from dembrick.views import summary
from dembrick.views.plot import style

if TYPE_CHECKING:
    from dembrick.history.reader import History

_DIVIDED = re.compile(r"(?<=[:,;])\s+")  # separators of the parts of a title
_SHADES = (0.0, -0.75, 0.5, -0.4, 0.7)  # shades of a colour: negative towards black, positive towards white


def formulation_of(history: History) -> str:
    """The formulation of a run's joints, empty if not recorded."""
    return str(history.results.get("formulation") or "")


def title_of(history: History) -> str:
    """The title of a run, empty if it has none."""
    return str(history.results.get("title") or getattr(history, "title", "") or "")


def labelled(histories, labels: Sequence[str] | None) -> tuple[list, list[str]]:
    """Histories as a list, and a label for each, escaped for drawing; by default the labels state their differences."""
    histories = list(histories) if isinstance(histories, list | tuple) else [histories]
    if not histories:
        raise ScenarioError("a figure needs at least one history")
    labels = told_apart(histories)[1] if labels is None else list(labels)
    if len(labels) != len(histories):
        raise ScenarioError(f"{len(labels)} labels for {len(histories)} histories; give one each")
    return histories, [style.plain(label) for label in labels]


def heading(histories, labels: Sequence[str] | None) -> str:
    """Heading of a figure whose legend has the default labels of `labelled`: the common part of its histories."""
    histories = list(histories) if isinstance(histories, list | tuple) else [histories]
    return "" if labels is not None or not histories else style.plain(told_apart(histories)[0])


def told_apart(histories: Sequence[History]) -> tuple[str, list[str]]:
    """The common part of the titles and formulations of all histories, and the remaining part of each.

    Histories with the same title and formulation are distinguished by the names of their files.
    """
    if len(histories) == 1:
        return title_of(histories[0]), [formulation_of(histories[0]) or "run"]
    parts = [_DIVIDED.split(_told(history)) for history in histories]
    bare = [[part.rstrip(":,;") for part in own] for own in parts]
    shared = set.intersection(*map(set, bare))
    common = " ".join(part for part, text in zip(parts[0], bare[0], strict=True) if text in shared)
    labels = [", ".join(part for part in own if part not in shared) for own in bare]
    count = Counter(labels)
    for i, history in enumerate(histories):
        if not labels[i] or count[labels[i]] > 1:
            stem = os.path.splitext(os.path.basename(str(getattr(history, "path", "") or "")))[0]
            labels[i] = ", ".join(filter(None, (labels[i], stem or f"run {i + 1}")))
    return common.rstrip(":,; "), labels


def _told(history: History) -> str:
    """Description of a history: its title and its formulation."""
    return ", ".join(filter(None, (title_of(history), formulation_of(history))))


class RunLook(NamedTuple):
    """Style of the line of one run."""

    colour: str
    line: object
    marker: str


def looks(formulations: Sequence[str]) -> list[RunLook]:
    """A style for each run of a figure: colour, line style and marker of its formulation. Further runs of the same
    formulation have shades of its colour and other line styles."""
    met: Counter[str] = Counter()
    found = []
    for i, name in enumerate(formulations):
        own = style.FORMULATION.get(name)
        again = met[name]
        met[name] += 1
        if own is None:
            found.append(RunLook(*style.look(i)))
        elif not again:
            found.append(RunLook(*own))
        else:
            found.append(RunLook(_shade(own[0], _SHADES[again % len(_SHADES)]), style.look(again)[1], own[2]))
    return found


def _shade(colour: str, share: float) -> str:
    """A colour mixed with white by ``share``, or with black by its size if it is negative."""
    aim = 255.0 if share > 0.0 else 0.0
    levels = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return "#" + "".join(f"{round(level + abs(share) * (aim - level)):02X}" for level in levels)


def unit_of_loads(values, unit: str) -> tuple[str, float]:
    """A suitable axis unit for ``values``, arrays of loads in ``unit``, and its factor; see `summary.load_unit`."""
    return summary.load_unit(max((float(abs(own).max()) for own in values if len(own)), default=0.0), unit)
