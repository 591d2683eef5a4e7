"""Curves over the driven displacement or over time."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dembrick.errors import HistoryError, ScenarioError
from dembrick.scenario.csv_tables import read_columns
from dembrick.views import summary
from dembrick.views.given import accepts_paths
from dembrick.views.plot import runs, style, subject
from dembrick.views.plot.runs import labelled
from dembrick.views.structure_numbers import BEFORE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_THETA = r"$\theta$"
_OPEN = {"lw": 0.8, "ls": (0, (5, 3))}  # line of a lower bound without an upper one
_ALLOWED = {"least": {"lw": 0.9, "ls": (0, (1, 2))}, "greatest": {"lw": 0.9, "ls": (0, (6, 2, 1, 2))}}
_WIDE = 36  # characters: with a longer text the legend has one column
MEASURED = ("o", "s", "^", "D", "v", "P")  # markers of measured curves


class MeasuredCurve(NamedTuple):
    """A measured curve: its name, ``displacement`` (k,) m, ``load`` (k,) N."""

    name: str
    displacement: np.ndarray
    load: np.ndarray


class CurvePanel(NamedTuple):
    """One panel: its title, histories with labels, and a measured V (N; None: none) drawn as a line."""

    title: str
    histories: list
    labels: Sequence[str]
    experiment: float | None = None


@accepts_paths
def force_displacement(
    histories,
    labels: Sequence[str] | None = None,
    ax: Axes | None = None,
    references: Mapping[str, float] | None = None,
    bracket: bool = True,
    measured: Sequence[MeasuredCurve] = (),
) -> Figure:
    """V (N) over the driven displacement of one or several histories (or results).

    For a tilting table, its angle over the displacement of the block that moved farthest; for shaken and free blocks,
    that displacement over time. Forces from 10 kN on are drawn in kN. The colour of a run is that of its formulation.

    ``references``: name -> V (N), drawn as horizontal lines (theory, experiment). ``bracket``: draw the band between
    the bounds of each yield point, or a line with arrows at the lower bound if there is no upper one, and for moving
    supports the least and the greatest reaction by limit analysis. ``measured``: measured curves
    (:func:`read_measured`) to be drawn over.
    """
    above = runs.heading(histories, labels)
    histories, labels = labelled(histories, labels)
    diagram = common_diagram(histories)
    if measured and diagram.unit != "N":
        raise ScenarioError("measured forces can be drawn only with runs that have actuators, and these have none")
    with style.settings():
        figure, axes = style.canvas(ax)
        records = [subject.record_of(history) for history in histories]
        shown: list[subject.Record | MeasuredCurve] = [*records, *measured]
        travels = [np.abs(own.displacement) for own in shown if len(own.displacement)]
        longest = max((float(travel.max()) for travel in travels), default=0.0)
        unit, factor = summary.travel_unit(longest)
        limits = [diagram.limit(history.results) if bracket else None for history in histories]
        loads = [own.load for own in shown] if diagram.load is not None else []
        loads += [np.array([V for V in found[:2] if V is not None]) for found in limits if found]
        allowed = [diagram.allowed(history.results) if bracket else {} for history in histories]
        loads += [np.array([value for value, _ in ends.values()]) for ends in allowed]
        loads.append(np.array([*(references or {}).values()]))
        loads_in, scale = runs.unit_of_loads(loads, diagram.unit)
        looks = runs.looks([runs.formulation_of(history) for history in histories])
        for record, label, look, limit, ends in zip(records, labels, looks, limits, allowed, strict=True):
            travel = factor * record.displacement
            x, y = (record.time, travel) if diagram.load is None else (travel, scale * diagram.loads(record.load))
            axes.plot(x, y, color=look.colour, ls=look.line, label=label)
            if limit is not None:
                lower, upper, said = limit
                text = said if len(histories) == 1 else None
                if upper is None:
                    _at_least(axes, scale * lower, look.colour, text)
                else:
                    axes.axhspan(scale * lower, scale * upper, color=look.colour, alpha=0.25, lw=0.6, label=text)
            for which, (value, said) in ends.items():
                text = said if len(histories) == 1 else None
                axes.axhline(scale * value, color=look.colour, **_ALLOWED[which], label=text)
        if len(histories) > 1 and any(limit and limit[1] is not None for limit in limits):
            axes.fill([], [], color=style.GREY, alpha=0.25, lw=0.6, label="bands: brackets of the limits")
        if len(histories) > 1 and any(limit and limit[1] is None for limit in limits):
            axes.plot([], [], color=style.GREY, **_OPEN, label="lines with arrows: no upper bound")
        for which in _ALLOWED if len(histories) > 1 else ():
            if any(which in ends for ends in allowed):
                text = f"{which} by limit analysis, {BEFORE}"
                axes.plot([], [], color=style.GREY, **_ALLOWED[which], label=text)
        for i, curve in enumerate(measured):
            marker, load = MEASURED[i % len(MEASURED)], scale * curve.load
            axes.plot(factor * curve.displacement, load, color=style.BLACK, ls="-", lw=0.9, marker=marker, ms=4,
                      mfc="white", markevery=max(1, len(curve.load) // 15), zorder=4,
                      label=style.plain(f"measured: {curve.name}"))  # fmt: skip
        for i, (name, value) in enumerate((references or {}).items()):
            axes.axhline(
                scale * value,
                color=style.GREY,
                lw=1.0,
                ls=(0, (6 - 2 * (i % 3), 2)),
                label=style.plain(f"{name}: {scale * value:.5g} {loads_in}"),
            )
        name_axes(axes, diagram, f"{diagram.displacement} [{unit}]", loads_in)
        axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
        head_and_legend(figure, axes, ax is None, above)
    return figure


def _at_least(axes: Axes, load: float, colour: str, label: str | None) -> None:
    """Draw a line at a lower bound of a limit load, with arrows upwards."""
    axes.axhline(load, color=colour, **_OPEN, label=label)
    for share in (0.06, 0.94):  # of the width
        style.upwards(axes, (share, load), ("axes fraction", "data"), colour)


def curve_panels(panels: Sequence[CurvePanel]) -> Figure:
    """Force-displacement curves, two panels per row, with one legend."""
    rows = -(-len(panels) // 2)
    with style.settings():
        figure = style.new_figure((7.2, 2.9 * rows + 0.5))
        axes = figure.subplots(rows, min(2, len(panels)), squeeze=False)
        for ax, panel in zip(axes.flat, panels, strict=False):
            force_displacement(panel.histories, panel.labels, ax=ax, bracket=False)
            title = panel.title
            if panel.experiment is not None:
                ax.axhline(panel.experiment, color=style.GREY, lw=1.0, ls=(0, (6, 2)), label="experiment (measured V)")
                title += f", measured {panel.experiment:.0f} N"
            ax.set_title(title)
            ax.get_legend().remove()
        for ax in list(axes.flat)[len(panels) :]:
            ax.remove()
        style.legend(figure, list(axes.flat)[: len(panels)], True, columns=3)
    return figure


def read_measured(path: str | os.PathLike, name: str | None = None) -> MeasuredCurve:
    """Read a measured curve from a CSV file whose first line other than comments (``#``) names the columns and their
    units, such as ``displacement [mm],force [N]``, in any order; others are ignored. ``name``: by default that of the
    file.

    Raises ScenarioError, with the line, for columns, units or values that do not fit the format.
    """
    found, _ = read_columns(path, "a measured curve", ("displacement", "force"))
    stem = os.path.splitext(os.path.basename(os.fspath(path)))[0]
    return MeasuredCurve(name or stem, found["displacement"], found["force"])


def common_diagram(histories) -> subject.Diagram:
    """The diagram of all histories; ScenarioError if they differ."""
    diagrams = {subject.diagram_of(history) for history in histories}
    if len(diagrams) > 1:
        raise ScenarioError(
            "the runs are driven in different ways, so their curves have no common axes; draw each by itself"
        )
    return diagrams.pop()


def name_axes(axes: Axes, diagram: subject.Diagram, travel: str, unit: str) -> None:
    """Label the axes: load in ``unit`` over ``travel``, or ``travel`` over time if no load grows."""
    axes.set_xlabel("time [s]" if diagram.load is None else travel)
    axes.set_ylabel(travel if diagram.load is None else f"{diagram.load.replace('θ', _THETA)} [{unit}]")


def head_and_legend(figure: Figure, axes: Axes, own: bool, above: str, columns: int = 2) -> None:
    """Set the title of our ``own`` figures to ``above``, and draw the legend, in one column if its texts are long."""
    if own and above:
        axes.set_title(style.wrapped(above, 60))
    longest = max(map(len, axes.get_legend_handles_labels()[1]), default=0)
    style.legend(figure, axes, own, columns=1 if longest > _WIDE else columns)


@accepts_paths
def unbalanced(histories, labels: Sequence[str] | None = None, ax: Axes | None = None) -> Figure:
    """Unbalanced-force ratio over time, logarithmic."""
    above = runs.heading(histories, labels)
    histories, labels = labelled(histories, labels)
    with style.settings():
        figure, axes = style.canvas(ax, (5.2, 3.6))
        looks = runs.looks([runs.formulation_of(history) for history in histories])
        for history, label, look in zip(histories, labels, looks, strict=True):
            ratio = np.asarray(history.unbalanced, float)
            shown = np.where(ratio > 0.0, ratio, np.nan)
            axes.plot(history.time, shown, color=look.colour, ls=look.line, label=label)
        axes.set_yscale("log")
        axes.set_xlabel(" or ".join(dict.fromkeys(map(subject.time_name, histories))))
        axes.set_ylabel("unbalanced-force ratio [-]")
        head_and_legend(figure, axes, ax is None, above)
    return figure


@accepts_paths
def energies(histories, labels: Sequence[str] | None = None, ax: Axes | None = None) -> Figure:
    """The energies of histories over time, one panel each; HistoryError if none were recorded. Terms that stay zero
    are left out.

    ``ax``: one axes, or one for each history.
    """
    above = runs.heading(histories, labels)
    histories, labels = labelled(histories, labels)
    for history in histories:
        if not history.energy:
            raise HistoryError(f"{history.path}: no energies were recorded in this history")
    with style.settings():
        size = (max(5.2, 3.2 * len(histories)), 4.0)
        figure, panels = style.panels(ax, len(histories), "histories", size, sharey=True)
        each = [{name: own for name, own in history.energy.items() if own.any()} for history in histories]
        each = [shown or history.energy for shown, history in zip(each, histories, strict=True)]
        names = list(dict.fromkeys(name for shown in each for name in shown))
        for axes, history, shown, label in zip(panels, histories, each, labels, strict=True):
            for name, values in shown.items():
                colour, line, _ = style.look(names.index(name))
                axes.plot(history.time, values, color=colour, ls=line, label=style.plain(name.replace("_", " ")))
            axes.set_xlabel(subject.time_name(history))
            axes.set_title(style.wrapped(label, 44))
        panels[0].set_ylabel("energy [J]")
        if ax is None and above:
            figure.suptitle(style.wrapped(above, 60), fontsize=9)
        style.legend(figure, panels, ax is None, columns=3)
    return figure
