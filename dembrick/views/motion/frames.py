"""Which row or frame of a record is next to a time, and which frames are of no equilibrium."""

from __future__ import annotations

import numpy as np


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


def last_in_rows(history) -> int:
    """The number of the last frame that is not `coming_down`; -1 if there is none."""
    return history.n_frames - 1 - int(coming_down(history).sum())
