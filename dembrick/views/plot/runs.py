"""How the runs of one figure are told apart: what differs between them in the legend, what they share above it, and a
look for each, whose colour is that of its formulation."""

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

_DIVIDED = re.compile(r"(?<=[:,;])\s+")  # of a title: where its parts begin
_SHADES = (0.0, -0.45, 0.4, -0.7, 0.6)  # of a colour: towards black where negative, else towards white


def formulation_of(history: History) -> str:
    """The formulation of a run's joints, empty where it is not told."""
    return str(history.results.get("formulation") or "")


def title_of(history: History) -> str:
    """The title of a run, empty if it has none."""
    return str(history.results.get("title") or getattr(history, "title", "") or "")


def labelled(histories, labels: Sequence[str] | None) -> tuple[list, list[str]]:
    """Histories as a list, and a label for each that is safe to draw; without ``labels``, what differs between them."""
    histories = list(histories) if isinstance(histories, list | tuple) else [histories]
    if not histories:
        raise ScenarioError("a figure needs at least one history")
    labels = told_apart(histories)[1] if labels is None else list(labels)
    if len(labels) != len(histories):
        raise ScenarioError(f"{len(labels)} labels for {len(histories)} histories; give one each")
    return histories, [style.plain(label) for label in labels]


def heading(histories, labels: Sequence[str] | None) -> str:
    """Heading of a figure whose legend has the labels of `labelled`: what its histories share."""
    histories = list(histories) if isinstance(histories, list | tuple) else [histories]
    return "" if labels is not None or not histories else style.plain(told_apart(histories)[0])


def told_apart(histories: Sequence[History]) -> tuple[str, list[str]]:
    """Part that all histories share of their titles and formulations, and for each the rest.

    Histories that say the same of themselves are told apart by the names of their files.
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
    """All that a history says of itself: its title and its formulation."""
    return ", ".join(filter(None, (title_of(history), formulation_of(history))))


class RunLook(NamedTuple):
    """How the line of one run is drawn."""

    colour: str
    line: object
    marker: str


def looks(formulations: Sequence[str]) -> list[RunLook]:
    """A look for each run of a figure: the colour, the dashes and the mark of its formulation. Further runs of the same
    one have shades of its colour and dashes of their own."""
    met: Counter[str] = Counter()
    found = []
    for i, name in enumerate(formulations):
        own = style.FORMULATION.get(name)
        again = met[name]
        met[name] += 1
        if own is None:
            found.append(RunLook(*style.CYCLE[i % len(style.CYCLE)]))
        elif not again:
            found.append(RunLook(*own))
        else:
            other = style.CYCLE[again % len(style.CYCLE)]
            found.append(RunLook(_shade(own[0], _SHADES[again % len(_SHADES)]), other[1], own[2]))
    return found


def _shade(colour: str, share: float) -> str:
    """A colour as far towards white, or towards black where ``share`` is negative, as it says."""
    aim = 255.0 if share > 0.0 else 0.0
    levels = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return "#" + "".join(f"{round(level + abs(share) * (aim - level)):02X}" for level in levels)


def unit_of_loads(values, unit: str) -> tuple[str, float]:
    """The unit of an axis for loads, arrays of them, in ``unit``, and its factor; see `summary.load_unit`."""
    return summary.load_unit(max((float(abs(own).max()) for own in values if len(own)), default=0.0), unit)
