"""Several force-displacement panels in one figure, under one legend."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from dembrick.views.plot import style
from dembrick.views.plot.curves import force_displacement

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class CurvePanel(NamedTuple):
    """One panel: its title, histories with labels, and a measured V (N; None: none) drawn as a line."""

    title: str
    histories: list
    labels: Sequence[str]
    experiment: float | None = None


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
