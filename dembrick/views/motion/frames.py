"""Which row or frame of a record is next to a time, and which frames are of no equilibrium."""

from __future__ import annotations

import numpy as np

from dembrick.errors import HistoryError, ScenarioError


def nearest(times: np.ndarray, wanted) -> np.ndarray:
    """Index of the entry of ``times`` (ascending) next to each wanted time; halfway, the earlier one."""
    return np.searchsorted(0.5 * (times[1:] + times[:-1]), wanted)


def coming_down(history, frames=slice(None)) -> np.ndarray:
    """Which ``frames`` show a structure that comes down after the last equilibrium of its record: no row tells what
    its joints and supports carry then."""
    times = np.asarray(history.frame_time[frames])
    if not (history.counts_equilibria and len(history.time)):
        return np.zeros(times.shape, bool)
    return times > history.time[-1]


def frame_number(history, frame: int = -1, time: float | None = None) -> int:
    """The number of a frame, which may be counted from the end, or of the one nearest to a ``time`` (s).

    Raises HistoryError if there are no frames, ScenarioError for one that is not there.
    """
    if not history.n_frames:
        raise HistoryError(f'{history.path}: no frames were recorded; run it again with "frames" in output.channels')
    if time is not None:
        first, last = float(history.frame_time[0]), float(history.frame_time[-1])
        if not first - 1e-9 * (last - first) <= time <= last + 1e-9 * (last - first):
            raise ScenarioError(
                f"time = {time!r} s is out of range: {history.path} runs from {first:.6g} to {last:.6g} s"
            )
        return int(nearest(history.frame_time, [time])[0])
    if not -history.n_frames <= frame < history.n_frames:
        raise ScenarioError(f"frame {frame} is out of range: {history.path} has frames 0 to {history.n_frames - 1}")
    return frame % history.n_frames


def last_in_rows(history) -> int:
    """The number of the last frame that is not `coming_down`. Raises HistoryError if there are no frames."""
    return frame_number(history) - int(coming_down(history).sum())
