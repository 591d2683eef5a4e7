"""Description of the moment that a picture or a table shows: the time or the equilibrium, and the load."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dembrick.scenario.regimes import TILT_LOAD
from dembrick.views import summary
from dembrick.views.motion.frames import START, default_frame, in_collapse, nearest, peak_time

if TYPE_CHECKING:
    from dembrick.history.reader import History

_SAME = 1e-12  # of a time: two times that differ by less are equal


def words(history: History, frame: int) -> list[str]:
    """Time or equilibrium of a frame, and its load, in words."""
    if history.status == START:
        return ["before the run"]
    now = float(history.frame_time[frame])
    if in_collapse(history, [frame])[0]:
        return [f"falling after equilibrium {history.time[-1]:g}"]
    if not history.n_row:
        return [_when(history, now)]
    return words_of_row(history, int(nearest(history.time, [now])[0]), now)


def words_of_row(history: History, row: int, time: float | None = None) -> list[str]:
    """Time or equilibrium of a row, or the given ``time`` (s) near it, and the load of the row, in words."""
    now = float(history.time[row]) if time is None else time
    return [f"{_when(history, now)}{_at_limit(history, now)}", *_load(history, float(history.load[row]))]


def _when(history: History, now: float) -> str:
    return f"equilibrium {now:g}" if history.counts_equilibria else f"time {now:.4g} s"


def _at_limit(history: History, now: float) -> str:
    if default_frame(history) == "last":
        return ""
    peak = peak_time(history)
    if abs(now - peak) <= _SAME * abs(peak):
        return " (the limit)"
    return f" (past the limit, which is at {peak:.4g})" if now > peak else ""


def _load(history: History, value: float) -> list[str]:
    """The load in words; for a tilting table also its angle."""
    curve = history.curve
    if curve.load is None:
        return []
    if curve.load == TILT_LOAD:
        return [f"table at {np.degrees(np.arctan(value)):.4g} deg", f"load factor {value:.4g}"]
    told = summary.load_text(value, "" if curve.unit == "1" else curve.unit).strip()
    return [f"{'V' if curve.unit == 'N' and curve.load.endswith(' V') else curve.load} {told}"]
