"""Curves over the driven displacement or over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from dembrick.errors import HistoryError, ScenarioError
from dembrick.plot import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MILLIMETRES_FROM = 2e-3  # m: longer travels are drawn in mm, shorter ones in um


def force_displacement(
    histories,
    labels: Sequence[str] | None = None,
    ax: Axes | None = None,
    references: Mapping[str, float] | None = None,
    bracket: bool = True,
) -> Figure:
    """V (N) over the driven displacement of one or several histories (or results).

    ``references``: name -> V (N), drawn as horizontal lines (theory, experiment). ``bracket``: the band between the
    bounds of each yield point.
    """
    histories, labels = _series(histories, labels)
    with style.settings():
        figure, axes = style.canvas(ax)
        longest = max((float(np.abs(h.displacement).max()) for h in histories if len(h.displacement)), default=0.0)
        unit, factor = ("mm", 1e3) if longest > _MILLIMETRES_FROM else ("µm", 1e6)
        for i, (history, label) in enumerate(zip(histories, labels, strict=True)):
            colour, line, _ = style.FORMULATION.get(label) or style.CYCLE[i % len(style.CYCLE)]
            axes.plot(factor * np.asarray(history.displacement), history.load, color=colour, ls=line, label=label)
            point = history.results.get("yield_point") or {}
            lower, upper = point.get("V_lower"), point.get("V_upper")
            if bracket and lower is not None and upper is not None:
                name = "bracket" if point.get("bracket") == "certified" else "indicator"
                text = f"{name} {lower:.5g} to {upper:.5g} N" if len(histories) == 1 else None
                axes.axhspan(lower, upper, color=colour, alpha=0.25, lw=0.6, label=text)
        for i, (name, value) in enumerate((references or {}).items()):
            axes.axhline(value, color=style.GREY, lw=1.0, ls=(0, (6 - 2 * (i % 3), 2)), label=f"{name}: {value:.5g} N")
        axes.set_xlabel(f"driven displacement [{unit}]")
        axes.set_ylabel("load V [N]")
        axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
        style.legend(figure, axes, ax is None, columns=1 if max(map(len, labels)) > 36 else 2)
    return figure


def unbalanced(histories, labels: Sequence[str] | None = None, ax: Axes | None = None) -> Figure:
    """Unbalanced-force ratio over time, logarithmic."""
    histories, labels = _series(histories, labels)
    with style.settings():
        figure, axes = style.canvas(ax, (5.2, 3.6))
        for i, (history, label) in enumerate(zip(histories, labels, strict=True)):
            colour, line, _ = style.CYCLE[i % len(style.CYCLE)]
            ratio = np.asarray(history.unbalanced, float)
            axes.plot(history.time, np.where(ratio > 0.0, ratio, np.nan), color=colour, ls=line, label=label)
        axes.set_yscale("log")
        axes.set_xlabel("time [s]")
        axes.set_ylabel("unbalanced-force ratio [-]")
        style.legend(figure, axes, ax is None, columns=1 if max(map(len, labels)) > 36 else 2)
    return figure


def energies(history, ax: Axes | None = None) -> Figure:
    """The energies of one history over time; HistoryError where none was recorded."""
    recorded = history.energy
    if not recorded:
        raise HistoryError(f"{history.path}: no energies were recorded in this history")
    with style.settings():
        figure, axes = style.canvas(ax)
        for i, (name, values) in enumerate(recorded.items()):
            colour, line, _ = style.CYCLE[i % len(style.CYCLE)]
            axes.plot(history.time, values, color=colour, ls=line, label=name.replace("_", " "))
        axes.set_xlabel("time [s]")
        axes.set_ylabel("energy [J]")
        style.legend(figure, axes, ax is None, columns=3)
    return figure


def label_of(history) -> str:
    """What a legend calls a history: the start of its title and its formulation."""
    results = history.results
    title = str(results.get("title") or getattr(history, "title", "") or "run").split(":")[0]
    formulation = results.get("formulation")
    return f"{title}, {formulation}" if formulation else title


def _series(histories, labels) -> tuple[list, list[str]]:
    histories = list(histories) if isinstance(histories, list | tuple) else [histories]
    if not histories:
        raise ScenarioError("a figure needs at least one history")
    labels = [label_of(history) for history in histories] if labels is None else list(labels)
    if len(labels) != len(histories):
        raise ScenarioError(f"{len(labels)} labels for {len(histories)} histories; give one each")
    return histories, labels
