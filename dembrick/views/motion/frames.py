"""The row or frame of a record nearest to a time, and the frames that show no equilibrium."""

from __future__ import annotations

import numpy as np

from dembrick.errors import HistoryError, ScenarioError
from dembrick.views import summary

PEAK, LAST = "peak", "last"
LEFT = 5e-3  # of a limit load: a row whose load differs by more belongs to blocks that have left the limit state
MECHANISM = "limit"  # status of a history that shows the mechanism of limit analysis
START = "start"  # status of a history that shows a structure before its run


def nearest(times: np.ndarray, wanted) -> np.ndarray:
    """Index of the entry of ``times`` (ascending) nearest to each wanted time; halfway, the earlier one."""
    return np.searchsorted(0.5 * (times[1:] + times[:-1]), wanted)


def in_collapse(history, frames=slice(None)) -> np.ndarray:
    """Whether each of ``frames`` shows the collapse after the last equilibrium of the record; no row has the forces of
    joints and supports then."""
    times = np.asarray(history.frame_time[frames])
    if not (history.counts_equilibria and len(history.time)):
        return np.zeros(times.shape, bool)
    return times > history.time[-1]


def frame_number(history, frame: int | str | None = None, time: float | None = None, in_rows: bool = False) -> int:
    """The number of a frame, given as such (negative: from the end) or as the one nearest to a ``time`` (s).

    PEAK is the frame at the limit, or at the greatest load of the record; LAST the last one, or with ``in_rows`` the
    last that is not `in_collapse`; None is the default for the run, see `default_frame`. Raises HistoryError if there
    are no frames, ScenarioError for a frame that does not exist.
    """
    if not history.n_frames:
        raise HistoryError(f'{history.path}: no frames were recorded; run it again with "frames" in output.channels')
    if time is not None:
        first, last = float(history.frame_time[0]), float(history.frame_time[-1])
        if not first - 1e-9 * (last - first) <= time <= last + 1e-9 * (last - first):
            what, unit = ("the equilibrium", "") if history.counts_equilibria else ("the time", " s")
            raise ScenarioError(
                f"{what} {time:g}{unit} is out of range: {history.path} runs from {first:.6g} to {last:.6g}{unit}"
            )
        return int(nearest(history.frame_time, [time])[0])
    frame = default_frame(history) if frame is None else frame
    if frame == PEAK:
        return int(nearest(history.frame_time, [peak_time(history)])[0])
    if frame == LAST:
        return history.n_frames - 1 - (int(in_collapse(history).sum()) if in_rows else 0)
    if not isinstance(frame, int):
        raise ScenarioError(f"frame {frame!r} is unknown: give {PEAK}, {LAST} or the number of a frame")
    if not -history.n_frames <= frame < history.n_frames:
        raise ScenarioError(f"frame {frame} is out of range: {history.path} has frames 0 to {history.n_frames - 1}")
    return frame % history.n_frames


def default_frame(history) -> str:
    """PEAK for a search that found a limit, LAST for every other run."""
    limit = summary.yield_point(history.results).get("V")
    return PEAK if getattr(history, "searches_limit", False) and limit is not None and history.n_row else LAST


def default_row(history) -> int:
    """Number of the row of the default frame: that at the limit of a search, the last one of every other run; the
    forces of its yield point are those of this row."""
    if default_frame(history) == PEAK:
        return int(nearest(history.time, [peak_time(history)])[0])
    return history.n_row - 1


def peak_time(history) -> float:
    """Time (s, or the number of the equilibrium) of the limit, or of the greatest load of the record, of either sign.
    Raises ScenarioError if no load grows."""
    point = summary.yield_point(history.results)
    at = point.get("limit_at")
    if history.curve.load is None or not history.n_row:
        if at is not None:
            return at
        raise ScenarioError(f"{history.path}: no load increases in this run, so it has no frame of a peak")
    loads, V = np.asarray(history.load), point.get("V")
    if at is None or V is None:
        return at if at is not None else float(history.time[int(np.argmax(np.abs(loads)))])
    carry = np.flatnonzero(np.abs(loads - V) <= LEFT * abs(V))
    if not len(carry) or int(nearest(history.time, [at])[0]) in carry:
        return at
    # later steps, with the block accelerating, have left the limit: take the best balanced of the rows with load V
    return float(history.time[carry[int(np.argmin(np.asarray(history.unbalanced)[carry]))]])


def ejected(history) -> np.ndarray:
    """Whether each block (n,) is ejected after the limit of a search: it moves at the end, when fewer than half as many
    blocks move as at the limit."""
    found = np.zeros(history.n_block, bool)
    results = history.results
    after, limit = (summary.part(results, name).get("blocks") for name in ("after", "collapse"))
    if not isinstance(after, list) or not (isinstance(limit, list) and 2 * len(after) < len(limit)):
        return found
    return np.isin(history.block_names, [name for name in after if isinstance(name, str)])
