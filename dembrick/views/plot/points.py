"""Displacements of control points: their lengths, or their components with signs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from dembrick.errors import HistoryError, ScenarioError
from dembrick.views import summary
from dembrick.views.given import accepts_paths
from dembrick.views.plot import runs, style, subject
from dembrick.views.plot.curves import common_diagram, head_and_legend, name_axes
from dembrick.views.plot.runs import labelled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COMPONENTS = ("x", "y", "z", "length")
_STILL = 1e-6  # of the greatest component: a smaller one is rounding


@accepts_paths
def control_points(
    histories,
    labels: Sequence[str] | None = None,
    ax: Axes | None = None,
    components: Sequence[str] | None = None,
) -> Figure:
    """The load over the displacement of every control point since the dead-load equilibrium; if no load grows, the
    displacement over time.

    ``components``: any of "x", "y", "z", with signs, and "length"; by default each of x, y and z in which any point
    moves. HistoryError if a history has no control points, ScenarioError for an unknown component.
    """
    above = runs.heading(histories, labels)
    histories, labels = labelled(histories, labels)
    for history in histories:
        if not history.control_points:
            raise HistoryError(f"{history.path}: it has no control points; add [[control_points]] and run it again")
    for name in components or ():
        if name not in COMPONENTS:
            raise ScenarioError(f"component {name!r} is unknown; use any of {', '.join(COMPONENTS)}")
    diagram = common_diagram(histories)
    moved = [history.control_point - history.control_point[:1] for history in histories]
    chosen = list(dict.fromkeys(components or _moving(moved)))
    ways = [{name: _component(own, name) for name in chosen} for own in moved]
    longest = max((float(np.abs(way).max()) for own in ways for way in own.values() if way.size), default=0.0)
    unit, factor = summary.travel_unit(longest)
    records = [subject.record_of(history) for history in histories]
    of_loads = [] if diagram.load is None else [diagram.loads(record.load) for record in records]
    loads_in, scale = runs.unit_of_loads(of_loads, diagram.unit)
    with style.settings():
        figure, axes = style.canvas(ax)
        lines = 0
        for history, record, label, own in zip(histories, records, labels, ways, strict=True):
            for i, point in enumerate(history.control_points):
                for name, way in own.items():
                    colour, line, _ = style.look(lines)
                    travel = factor * way[:, i]
                    x, y = (
                        (record.time, travel) if diagram.load is None else (travel, scale * diagram.loads(record.load))
                    )
                    axes.plot(x, y, color=colour, ls=line, label=_told(point["name"], name, label, len(histories)))
                    lines += 1
        name_axes(axes, diagram, f"displacement of control points [{unit}]", loads_in)
        head_and_legend(figure, axes, ax is None, above)
    return figure


def _component(moved: np.ndarray, name: str) -> np.ndarray:
    """A component (T, points) of displacements (T, points, 3)."""
    return np.linalg.norm(moved, axis=2) if name == "length" else moved[:, :, "xyz".index(name)]


def _moving(moved: Sequence[np.ndarray]) -> list[str]:
    """The directions in which any point moves, z if none does."""
    most = np.max([np.abs(own).max(axis=(0, 1), initial=0.0) for own in moved], axis=0)
    return [name for name, way in zip("xyz", most, strict=True) if way > _STILL * most.max()] or ["z"]


def _told(point: str, component: str, label: str, runs_drawn: int) -> str:
    """Legend text for a component of the displacement of a point."""
    own = f"{style.plain(point)}, {'|u|' if component == 'length' else f'$u_{component}$'}"
    return own if runs_drawn == 1 else f"{own}, {label.strip()}"
