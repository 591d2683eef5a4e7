"""Which row or frame of a record is next to a time."""

from __future__ import annotations

import numpy as np


def nearest(times: np.ndarray, wanted) -> np.ndarray:
    """Index of the entry of ``times`` (ascending) next to each wanted time; halfway, the earlier one."""
    return np.searchsorted(0.5 * (times[1:] + times[:-1]), wanted)
