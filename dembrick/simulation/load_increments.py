"""Loads of a stage that come in increments, as what slides under them depends on their way.

Their way is straight, from the loads of the stage before to those of now. Each increment is an implicit step (backward
Euler) from one equilibrium to the next, whose error goes with its length: there are more and more of them, until that
changes little.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

COUNTS = (8, 19, 43, 97, 220)  # no doublings: what happens at some share of the loads is seen elsewhere by each
SETTLED = 1e-3  # of the greatest force: what more of them may change
UNSEEN = 2.5e-4  # of it: what they leave of joints that begin to slide in the last of them
LOUD = 2.0 * SETTLED + UNSEEN  # of it: error that is remarked on
LINEAR = 1e-5  # of it: what they change where nothing depends on the way


def by_increments(
    go: Callable[[int], bool | None],
    carried: Callable[[], np.ndarray],
    slid: Callable[[], bool],
    erratic: Callable[[], bool],
    one_step: bool,
) -> tuple[int, float]:
    """In how many increments the loads came, and the error that is left of the forces ``carried`` (N), over the
    greatest of them; infinite if there is none to be compared with.

    ``go`` goes through so many of them from the start and says whether anything had slid before the last; None if one
    was not found, and then the last answer is left. Where more of them change nothing, and nothing has ``slid``, there
    is no error; where it slid before the last, that is enough. Where their error is ``erratic``, as bonds break in one
    of them or joints swing open, there are three counts at least: two may agree by chance. ``one_step``: what is
    carried now is the answer in one step.
    """
    found, before, last = (1, math.inf), carried() if one_step else None, 1
    expected = 0.0  # change, from the one before
    for i, count in enumerate(COUNTS):
        early = go(count)
        if early is None:
            break
        now = carried()
        if before is not None:
            changed = float(np.abs(now - before).max() / max(np.abs(now).max(), 1e-300))
            if changed <= LINEAR and not slid():
                return count, 0.0
            if changed <= LINEAR and early and not erratic():
                return count, 2.0 * changed + UNSEEN * max(1.0, COUNTS[1] / count) ** 2
            if i:
                found = count, 2.0 * max(changed, expected) + UNSEEN
            if i + 1 < len(COUNTS):
                expected = changed * (1.0 / count - 1.0 / COUNTS[i + 1]) / (1.0 / last - 1.0 / count)
        before, last = now, count
        if found[1] <= LOUD and (i >= 2 or not erratic()):
            break
    return found


def both_errors(error: float, before: float, greatest: float) -> tuple[float, float]:
    """An ``error`` of forces, over the ``greatest`` of them (N), with what the stages ``before`` leave (N), over it and
    in N. Stable joints let no error of theirs grow."""
    if greatest > 0.0 and before > 0.0:
        error += before / greatest
    return error, error * greatest if greatest > 0.0 else 0.0


def report_error(report: Callable[[str], None] | None, increments: int, error: float) -> None:
    """Remark on forces that so many increments leave with a large ``error``, over the greatest of them."""
    if report is None or error <= LOUD:
        return
    way = "friction depends on the way of the loads"
    more = "more [[stages]] follow it more closely"
    if error == math.inf:
        report(f"{way}, which was not followed in increments: forces are those of one step; {more}")
    else:
        report(f"{way}: in {increments} increments forces are known to {error:.1g} of the greatest; {more}")


def described(increments: int, error: float, force: float) -> dict[str, int | float | None]:
    """Entries of ``statics`` in the JSON output: ``error`` over the greatest force, and as a ``force`` (N); null if it
    is not known."""
    known = math.isfinite(error)
    return {"increments": increments, "path_error": error if known else None, "force_error": force if known else None}


def left_by(results: Sequence[Mapping]) -> float:
    """The error of forces (N) that stages with these ``results`` leave, infinite if it is not known."""
    for result in reversed(results):
        found = result.get("statics") or {}
        if "force_error" in found:
            return math.inf if found["force_error"] is None else float(found["force_error"])
    return 0.0
