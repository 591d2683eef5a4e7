"""Common style of all figures: colours for colour-blind readers, lines and markers that are distinct in grey print."""

from __future__ import annotations

import io
import os
import re
import textwrap
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from dembrick.errors import OutputError, ScenarioError, needed
from dembrick.history.files import write_whole

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe and Ito's palette
BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
BLUE, VERMILLION, PURPLE, GREY = "#0072B2", "#D55E00", "#CC79A7", "#666666"

CYCLE = (  # colour, line style, marker of overlaid curves
    (BLUE, "-", "o"),
    (VERMILLION, "--", "s"),
    (GREEN, "-.", "^"),
    (BLACK, ":", "D"),
    (ORANGE, (0, (8, 2)), "v"),
    (PURPLE, (0, (3, 1, 1, 1, 1, 1)), "P"),
    (SKY, (0, (1, 2, 6, 2)), "X"),
    (GREY, (0, (5, 1, 1, 1)), "*"),
)
FORMULATION = {
    "convex": (BLUE, "-", "o"),
    "concave": (VERMILLION, "--", "s"),
    "corrected": (GREEN, "-.", "^"),
    "corrected-shear": (PURPLE, (0, (3, 1, 1, 1, 1, 1)), "v"),
    "distributed": (ORANGE, ":", "D"),
}
# Points that coincide (convex and distributed do) stay visible as nested markers, the largest drawn first.
MARKER_SIZE = {"distributed": 9.0, "corrected": 7.5, "concave": 6.0, "corrected-shear": 4.0, "convex": 4.0}
EXPERIMENT = {"color": BLACK, "marker": "*", "markersize": 9, "linestyle": "none"}

FORMATS = (".png", ".svg", ".pdf")
DOTS_PER_INCH = 300
SETTINGS = {
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "legend.fontsize": 8.0,
    "figure.autolayout": False,  # each figure sets its own layout
    "figure.constrained_layout.use": False,
    "axes.grid": True,
    "grid.linewidth": 0.4,
    "grid.color": "#D9D9D9",
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "lines.linewidth": 1.4,
    "lines.markersize": 5.5,
    "legend.frameon": False,
    "pdf.fonttype": 42,  # whole fonts in the file: text stays text for the journal
    "svg.fonttype": "none",
    "svg.hashsalt": "dembrick",  # the same figure gives the same file
}


def settings():
    """Context in which figures are made and written: our settings in place of the user's."""
    return needed("matplotlib", "a figure").rc_context(SETTINGS)


def canvas(ax: Axes | None, size: tuple[float, float] = (5.2, 4.4)) -> tuple[Figure, Axes]:
    """The figure and axes to draw in: those of ``ax``, else new ones of ``size`` (inches)."""
    if ax is not None:
        return ax.figure, ax
    figure = new_figure(size)
    return figure, figure.add_subplot()


def panels(
    ax: Axes | Sequence[Axes] | None, count: int, what: str, size: tuple[float, float], **shared
) -> tuple[Figure, list[Axes]]:
    """The figure and ``count`` axes to draw in, side by side: those of ``ax``, else new ones of ``size`` (inches).

    ScenarioError if ``ax`` does not have one for each of ``what``.
    """
    if ax is None:
        figure = new_figure(size)
        return figure, list(figure.subplots(1, count, squeeze=False, **shared)[0])
    axes = list(np.ravel(np.asarray(ax, dtype=object)))
    if len(axes) != count:
        raise ScenarioError(f"{len(axes)} axes for {count} {what}; give one each")
    return axes[0].figure, axes


def new_figure(size: tuple[float, float]) -> Figure:
    """A figure of ``size`` (inches) without a window; notebooks show it as a picture."""
    needed("matplotlib", "a figure")
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    setattr(figure, "_repr_png_", partial(_as_png, figure))  # noqa: B010 - called by notebooks
    return figure


def _as_png(figure: Figure) -> bytes:
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=110)
    return picture.getvalue()


def look(number: int) -> tuple:
    """Colour, line style and marker of overlaid curve ``number``. When the colours repeat, the line styles differ."""
    (colour, _, marker), turn = CYCLE[number % len(CYCLE)], number // len(CYCLE)
    return colour, CYCLE[(number + turn) % len(CYCLE)][1], marker


def upwards(axes: Axes, place: tuple[float, float], coords, colour: str) -> None:
    """An arrow up from a ``place`` in the coordinates ``coords``: from a load that a limit has at least."""
    axes.annotate(
        "", place, (0.0, 16.0), xycoords=coords, textcoords="offset points",
        arrowprops={"arrowstyle": "<-", "color": colour, "lw": 0.8, "shrinkA": 0.0, "shrinkB": 0.0},
    )  # fmt: skip


def legend(figure: Figure, panels: Axes | Sequence[Axes], own: bool, columns: int = 2) -> None:
    """Draw one legend for all panels: below the axes, where it hides no data, in our ``own`` figures, in as many of the
    ``columns`` as the figure is wide enough for; else a legend inside each of the user's axes."""
    first, *others = each = np.ravel(np.asarray(panels, dtype=object))
    if not own:
        for axes in each:
            if axes.get_legend_handles_labels()[0]:
                axes.legend(loc="best")
        return
    handles, labels = first.get_legend_handles_labels()
    for axes in others:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            if label not in labels:
                handles, labels = [*handles, handle], [*labels, label]
    for fewer in range(columns, 0, -1) if handles else ():
        drawn = figure.legend(handles, labels, loc="outside lower center", ncols=fewer)
        if drawn.get_window_extent().width <= figure.bbox.width or fewer == 1:
            break
        drawn.remove()


def plain(text: str) -> str:
    """Text drawn literally: dollar signs start no formula, and a leading underscore does not hide a label."""
    text = str(text).replace("$", r"\$")
    return f" {text}" if text.startswith("_") else text


_TOGETHER = re.compile(r"(?<==) | (?==)|(?<=\d) (?=[^\W\d_]{1,3}(?:\b|$))")  # " = ", and a number and its unit


def wrapped(text: str, width: int) -> str:
    """A text wrapped to ``width`` characters, without breaks at an equals sign or before a unit."""
    fixed = _TOGETHER.sub("\N{NO-BREAK SPACE}", text)
    return "\n".join(textwrap.wrap(fixed, width)).replace("\N{NO-BREAK SPACE}", " ")


def inline_svg(figure: Figure) -> str:
    """A figure as an ``<svg>`` element for an HTML page."""
    _write_out_controls(figure)
    with settings(), io.StringIO() as text:
        figure.savefig(text, format="svg", metadata={"Date": None})
        return text.getvalue().partition("<!DOCTYPE")[2].partition(">")[2].strip()


def _write_out_controls(figure: Figure) -> None:
    """Show control characters in the texts of a figure as ``\\x1b``: titles may come from an untrusted file, and the
    warnings of matplotlib about them would pass the characters on to the terminal."""
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        shown = text.get_text()
        if not all(sign.isprintable() or sign == "\n" for sign in shown):
            signs = (s if s.isprintable() or s == "\n" else s.encode("unicode_escape").decode("ascii") for s in shown)
            text.set_text("".join(signs))


def settle(figure: Figure) -> None:
    """Fix the layout of a figure, so that saving it in one or several formats draws it only once each, without a
    preceding run of the layout engine."""
    engine = figure.get_layout_engine()
    if engine is not None:
        _write_out_controls(figure)
        with settings():
            figure.set_dpi(DOTS_PER_INCH)  # the size of text depends on it
            engine.execute(figure)
            figure.set_layout_engine(None)


def save(figure: Figure, path: str | os.PathLike) -> str:
    """Write a figure as PNG (300 dpi), SVG or PDF, by the ending; the file appears only when it is complete."""
    path = os.fspath(path)
    ending = os.path.splitext(path)[1].lower()
    if ending not in FORMATS:
        raise OutputError(f"{path}: the ending {ending!r} is no figure format; use one of {', '.join(FORMATS)}")
    stamp = {".png": {}, ".svg": {"Date": None}, ".pdf": {"CreationDate": None}}[ending]
    _write_out_controls(figure)
    picture = io.BytesIO()  # a writer of matplotlib that fails on a file gives more than one error message
    with settings():
        figure.savefig(picture, format=ending[1:], dpi=DOTS_PER_INCH, metadata=stamp)
    write_whole(path, picture.getvalue(), "figure")
    return path
