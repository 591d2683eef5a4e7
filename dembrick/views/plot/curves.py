"""Curves over the driven displacement or over time."""

from __future__ import annotations

import os
import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dembrick.errors import HistoryError, ScenarioError
from dembrick.scenario.csv_tables import read_columns
from dembrick.views import summary
from dembrick.views.given import takes_paths
from dembrick.views.plot import style, subject

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from dembrick.history.reader import History

MEASURED = ("o", "s", "^", "D", "v", "P")  # markers of measured curves


class MeasuredCurve(NamedTuple):
    """A curve from the laboratory: its name, ``displacement`` (k,) m, ``load`` (k,) N."""

    name: str
    displacement: np.ndarray
    load: np.ndarray


class CurvePanel(NamedTuple):
    """One panel: its title, histories with labels, and a measured V (N; None: none) drawn as a line."""

    title: str
    histories: list
    labels: Sequence[str]
    experiment: float | None = None


@takes_paths
def force_displacement(
    histories,
    labels: Sequence[str] | None = None,
    ax: Axes | None = None,
    references: Mapping[str, float] | None = None,
    bracket: bool = True,
    measured: Sequence[MeasuredCurve] = (),
) -> Figure:
    """V (N) over the driven displacement of one or several histories (or results).

    Of a table that tilts the load factor over the displacement of the block that moved furthest, of shaken and free
    blocks that displacement over time.

    ``references``: name -> V (N), drawn as horizontal lines (theory, experiment). ``bracket``: the band between the
    bounds of each yield point. ``measured``: curves of the laboratory (:func:`read_measured`), laid over.
    """
    histories, labels = labelled(histories, labels)
    diagram = _common_diagram(histories)
    if measured and diagram.unit != "N":
        raise ScenarioError("measured forces can be laid over runs with actuators only, and these have none")
    with style.settings():
        figure, axes = style.canvas(ax)
        records = [subject.record_of(history) for history in histories]
        travels = [np.abs(own.displacement) for own in (*records, *measured) if len(own.displacement)]
        longest = max((float(travel.max()) for travel in travels), default=0.0)
        unit, factor = summary.travel_unit(longest)
        for i, (history, record, label) in enumerate(zip(histories, records, labels, strict=True)):
            colour, line, _ = style.FORMULATION.get(label) or style.CYCLE[i % len(style.CYCLE)]
            travel = factor * record.displacement
            x, y = (record.time, travel) if diagram.load is None else (travel, record.load)
            axes.plot(x, y, color=colour, ls=line, label=label)
            point = summary.yield_point(history.results)
            lower, upper = point.get("V_lower"), point.get("V_upper")
            if bracket and "V" in point and lower is not None and upper is not None:
                said = summary.limit_text(point, summary.part(history.results, "path"), diagram.unit.strip("-"))
                text = str(said) if len(histories) == 1 else None
                axes.axhspan(lower, upper, color=colour, alpha=0.25, lw=0.6, label=text)
        for i, curve in enumerate(measured):
            marker = MEASURED[i % len(MEASURED)]
            axes.plot(factor * curve.displacement, curve.load, color=style.BLACK, ls="-", lw=0.9, marker=marker, ms=4,
                      mfc="white", markevery=max(1, len(curve.load) // 15), zorder=4,
                      label=style.plain(f"measured: {curve.name}"))  # fmt: skip
        for i, (name, value) in enumerate((references or {}).items()):
            axes.axhline(
                value,
                color=style.GREY,
                lw=1.0,
                ls=(0, (6 - 2 * (i % 3), 2)),
                label=style.plain(f"{name}: {value:.5g} N"),
            )
        _name_axes(axes, diagram, f"{diagram.displacement} [{unit}]")
        axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
        style.legend(figure, axes, ax is None, columns=1 if max(map(len, labels)) > 36 else 2)
    return figure


def curve_panels(panels: Sequence[CurvePanel]) -> Figure:
    """Force-displacement curves, two panels a row; the legend of the first serves all."""
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
        handles, labels = axes.flat[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


def read_measured(path: str | os.PathLike, name: str | None = None) -> MeasuredCurve:
    """A measured curve out of a CSV file whose first line that is no remark (``#``) names the columns with their units,
    such as ``displacement [mm],force [N]``, in any order; others are left out. ``name`` is the file's own without one.

    Raises ScenarioError, with the line, for columns, units or values that are not those of the format.
    """
    found, _ = read_columns(path, "a measured curve", ("displacement", "force"))
    stem = os.path.splitext(os.path.basename(os.fspath(path)))[0]
    return MeasuredCurve(name or stem, found["displacement"], found["force"])


def _common_diagram(histories) -> subject.Diagram:
    diagrams = {subject.diagram_of(history) for history in histories}
    if len(diagrams) > 1:
        raise ScenarioError("the runs are driven in different ways, so their curves have no axes in common; draw each")
    return diagrams.pop()


def _name_axes(axes: Axes, diagram: subject.Diagram, travel: str) -> None:
    """Load over ``travel``, or where no load grows ``travel`` over time."""
    axes.set_xlabel("time [s]" if diagram.load is None else travel)
    axes.set_ylabel(travel if diagram.load is None else f"{diagram.load} [{diagram.unit}]")


@takes_paths
def control_points(histories, labels: Sequence[str] | None = None, ax: Axes | None = None) -> Figure:
    """The load over the length of the displacement of every control point, in time where no load grows; HistoryError
    if a history has none."""
    histories, labels = labelled(histories, labels)
    for history in histories:
        if not history.control_points:
            raise HistoryError(f"{history.path}: it has no control points; add [[control_points]] and run it again")
    diagram = _common_diagram(histories)
    with style.settings():
        figure, axes = style.canvas(ax)
        moved = [history.control_point - history.control_point[:1] for history in histories]  # since the dead loads
        travels = [np.linalg.norm(own, axis=2) for own in moved]
        longest = max((float(travel.max()) for travel in travels if travel.size), default=0.0)
        unit, factor = summary.travel_unit(longest)
        lines = 0
        for history, label, travel in zip(histories, labels, travels, strict=True):
            record = subject.record_of(history)
            for point, way in zip(history.control_points, factor * travel.T, strict=True):
                colour, line, _ = style.CYCLE[lines % len(style.CYCLE)]
                name = style.plain(point["name"]) if len(histories) == 1 else f"{style.plain(point['name'])}, {label}"
                x, y = (record.time, way) if diagram.load is None else (way, record.load)
                axes.plot(x, y, color=colour, ls=line, label=name)
                lines += 1
        _name_axes(axes, diagram, f"displacement of control points [{unit}]")
        style.legend(figure, axes, ax is None)
    return figure


@takes_paths
def unbalanced(histories, labels: Sequence[str] | None = None, ax: Axes | None = None) -> Figure:
    """Unbalanced-force ratio over time, logarithmic."""
    histories, labels = labelled(histories, labels)
    with style.settings():
        figure, axes = style.canvas(ax, (5.2, 3.6))
        for i, (history, label) in enumerate(zip(histories, labels, strict=True)):
            colour, line, _ = style.CYCLE[i % len(style.CYCLE)]
            ratio = np.asarray(history.unbalanced, float)
            axes.plot(history.time, np.where(ratio > 0.0, ratio, np.nan), color=colour, ls=line, label=label)
        axes.set_yscale("log")
        axes.set_xlabel(" or ".join(dict.fromkeys(map(subject.time_name, histories))))
        axes.set_ylabel("unbalanced-force ratio [-]")
        style.legend(figure, axes, ax is None, columns=1 if max(map(len, labels)) > 36 else 2)
    return figure


@takes_paths
def energies(histories, labels: Sequence[str] | None = None, ax: Axes | None = None) -> Figure:
    """The energies of histories over time, a panel each; HistoryError if none was recorded. Terms that stay zero
    are left out.

    ``ax``: one axes, or one for each history.
    """
    histories, labels = labelled(histories, labels)
    for history in histories:
        if not history.energy:
            raise HistoryError(f"{history.path}: no energies were recorded in this history")
    with style.settings():
        size = (max(5.2, 3.2 * len(histories)), 4.0)
        figure, panels = style.panels(ax, len(histories), "histories", size, sharey=True)
        for axes, history, label in zip(panels, histories, labels, strict=True):
            shown = {name: values for name, values in history.energy.items() if values.any()}
            for i, (name, values) in enumerate((shown or history.energy).items()):
                colour, line, _ = style.CYCLE[i % len(style.CYCLE)]
                axes.plot(history.time, values, color=colour, ls=line, label=style.plain(name.replace("_", " ")))
            axes.set_xlabel(subject.time_name(history))
            axes.set_title("\n".join(textwrap.wrap(label, 44)))
        panels[0].set_ylabel("energy [J]")
        style.legend(figure, panels[0], ax is None, columns=3)
    return figure


def label_of(history: History) -> str:
    """What a legend calls a history: the start of its title and its formulation."""
    results = history.results
    title = str(results.get("title") or getattr(history, "title", "") or "run").split(":")[0]
    formulation = results.get("formulation")
    return f"{title}, {formulation}" if formulation else title


def labelled(histories, labels) -> tuple[list, list[str]]:
    """Histories as a list, and a label for each that is safe to draw; without ``labels``, what the histories say."""
    histories = list(histories) if isinstance(histories, list | tuple) else [histories]
    if not histories:
        raise ScenarioError("a figure needs at least one history")
    labels = [label_of(history) for history in histories] if labels is None else list(labels)
    if len(labels) != len(histories):
        raise ScenarioError(f"{len(labels)} labels for {len(histories)} histories; give one each")
    return histories, [style.plain(label) for label in labels]
