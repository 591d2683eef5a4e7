"""Response spectra of ground motion records."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from dembrick.errors import ScenarioError
from dembrick.scenario.csv_tables import read_columns
from dembrick.scenario.units import STANDARD_GRAVITY
from dembrick.theory.response_spectrum import Spectrum, response_spectrum
from dembrick.views.plot import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PERIODS = np.geomspace(0.05, 4.0, 120)  # s, the periods drawn


def read_spectrum(
    path: str | os.PathLike, damping: float = 0.05, periods: Sequence[float] = tuple(PERIODS)
) -> Spectrum:
    """The response spectrum of an acceleration record, CSV with units or PEER (.AT2), read as for base motions."""
    found, numbers = read_columns(path, "a record of the ground", ("time", "acceleration"))
    back = np.flatnonzero(np.diff(found["time"]) <= 0.0)
    if len(back):
        raise ScenarioError(f"{os.fspath(path)}, line {numbers[back[0] + 1]}: time goes back; give samples in order")
    return response_spectrum(found["time"], found["acceleration"], np.asarray(periods, float), damping)


def spectra(records, damping: float = 0.05, ax: Axes | None = None) -> Figure:
    """Pseudo-acceleration over the period for one or several ``records``, paths of ground motion files."""
    paths = list(records) if isinstance(records, list | tuple) else [records]
    if not paths:
        raise ScenarioError("a figure needs at least one record")
    found = [read_spectrum(path, damping) for path in paths]
    with style.settings():
        figure, axes = style.canvas(ax)
        for i, (path, spectrum) in enumerate(zip(paths, found, strict=True)):
            colour, line, _ = style.look(i)
            name = style.plain(os.path.splitext(os.path.basename(os.fspath(path)))[0])
            axes.plot(
                spectrum.period, spectrum.pseudo_acceleration / STANDARD_GRAVITY, color=colour, ls=line, label=name
            )
        axes.set_xscale("log")
        axes.set_xticks([0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 4.0], ["0.05", "0.1", "0.2", "0.5", "1", "2", "4"])
        axes.minorticks_off()
        axes.set(xlabel="period T [s]", ylabel="pseudo-acceleration [g]", ylim=(0.0, None))
        axes.set_title(f"response spectrum, damping {100.0 * damping:g} %")
        style.legend(figure, axes, ax is None)
    return figure
