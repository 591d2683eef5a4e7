"""Loads of a stage that come in increments, as what slides under them depends on their way.

Their way is straight, from the loads of the stage before to those of now. Each increment is an implicit step (backward
Euler) from one equilibrium to the next, whose error goes with its length: there are twice as many of them, again and
again, until that changes little.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

INCREMENTS = 10  # at first
DOUBLINGS = 4  # of these, at most
SETTLED = 1e-3  # of the greatest force: what twice as many may change
UNSEEN = 2.5e-4  # of it: what they leave of joints that begin to slide in the last of them
LOUD = 2.0 * SETTLED + UNSEEN  # of it: error that is remarked on


def by_increments(
    go: Callable[[int], bool], carried: Callable[[], np.ndarray], slid: Callable[[], bool] = lambda: True
) -> tuple[int, float]:
    """In how many increments the loads came, and the error that is left of the forces ``carried`` (N), over the
    greatest of them; infinite if there is none to be compared with.

    ``go`` goes through so many of them from the start, and leaves the last answer, if it says that one was not found.
    Where nothing has ``slid`` the first are enough, and leave no error.
    """
    found, before = (1, math.inf), carried()
    for count in (INCREMENTS * 2**k for k in range(DOUBLINGS + 1)):
        if not go(count):
            break
        if not slid():
            return count, 0.0
        now = carried()
        changed = float(np.abs(now - before).max() / max(np.abs(now).max(), 1e-300))
        # what a single step changed is no measure of it
        found, before = (count, 2.0 * changed + UNSEEN if count > INCREMENTS else math.inf), now
        if found[1] <= LOUD:
            break
    return found


def report_error(report: Callable[[str], None] | None, increments: int, error: float) -> None:
    """Remark on forces that so many increments leave with a large ``error``, over the greatest of them."""
    if report is None or error <= LOUD:
        return
    way = "what slides depends on the way of the loads"
    if error == math.inf:
        report(f"{way}, which could not be followed in increments: forces are those of one step; split the stage")
    else:
        report(f"{way}: in {increments} increments forces are known to {error:.1g} of the greatest; split the stage")


def described(increments: int, error: float) -> dict[str, int | float | None]:
    """Entries of ``statics`` in the JSON output; an ``error`` that is not known is null."""
    return {"increments": increments, "path_error": error if math.isfinite(error) else None}
