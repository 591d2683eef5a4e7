"""Loads of a stage applied in increments, as slip under them depends on the load path.

The path is straight, from the loads of the stage before to the present ones. Each increment is an implicit step
(backward Euler) from one equilibrium to the next, whose error is proportional to its length: the number of increments
is raised until the results change little.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

COUNTS = (8, 19, 43, 97, 220)  # no doublings, so that an event at some share of the loads falls differently into each
SETTLED = 1e-3  # of the greatest force on a block: change by more increments that is accepted
UNSEEN = 2.5e-4  # of it: error from joints that begin to slide in the last increment
LOUD = 2.0 * SETTLED + UNSEEN  # of it: error that is reported
LINEAR = 1e-5  # of it: greatest change if nothing depends on the path
LEAST = 1e-6  # of the greatest force of all: least force by which those of a block are measured


def greatest_on_blocks(ends: np.ndarray, forces: np.ndarray, n_block: int) -> np.ndarray:
    """Greatest component of ``forces`` (e, 3) between blocks ``ends`` (2, e) on each block (n,), N; of that of all,
    `LEAST` at the least."""
    size, found = np.abs(forces).max(axis=1), np.zeros(n_block)
    for block in ends:
        np.maximum.at(found, block, size)
    return np.maximum(found, LEAST * size.max(initial=0.0))


def on_less_loaded(ends: np.ndarray, forces: np.ndarray, fixed: np.ndarray) -> np.ndarray:
    """Greatest force (e,) on the less loaded free block at either end of ``forces`` (e, 3), as in
    `greatest_on_blocks`; ``fixed`` (n,)."""
    return np.where(fixed, math.inf, greatest_on_blocks(ends, forces, len(fixed)))[ends].min(axis=0)


def by_increments(
    go: Callable[[int], bool | None],
    carried: Callable[[], np.ndarray],
    scale: Callable[[np.ndarray], np.ndarray],
    slid: Callable[[], bool],
    erratic: Callable[[], bool],
    one_step: bool,
) -> tuple[int, float]:
    """Apply loads in increments; return their number and the error left in the forces ``carried`` (e, 3) (N), over
    their ``scale`` (e,), as a light block may stand beside heavy ones; infinite if there is no result to compare with.

    ``go`` applies a given number of increments from the start and returns whether anything slid before the last; None
    if an equilibrium was not found, and then the last result stays. If more increments change nothing and nothing has
    ``slid``, there is no error; if something slid before the last, no more are needed. If the error is ``erratic``, as
    bonds break or joints swing open, at least three counts are compared, as two may agree by chance. ``one_step``: the
    present forces are the result of one step, to be compared with.
    """
    found, before, last = (1, math.inf), carried() if one_step else None, 1
    expected = 0.0  # change, from the one before
    for i, count in enumerate(COUNTS):
        early = go(count)
        if early is None:
            break
        now = carried()
        if before is not None:
            size = np.maximum(scale(now), 1e-300)
            changed = float((np.abs(now - before).max(axis=1) / size).max())
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
    """Sum of an ``error`` of forces, over the greatest on a block, and that of the stages ``before`` (N): over the
    same, and in N for a block with the ``greatest`` of all (N). Stable joints do not amplify the latter."""
    if greatest > 0.0 and before > 0.0:
        error += before / greatest
    return error, error * greatest if greatest > 0.0 else 0.0


def report_error(report: Callable[[str], None] | None, increments: int, error: float, weakened: bool = False) -> None:
    """Report a large ``error`` of forces (over the greatest on a block) after so many increments; ``weakened``: with
    the joint laws of this stage there is no equilibrium under the loads of the stage before."""
    if report is None or error <= LOUD:
        return
    way = "friction depends on the load path"
    more = "add [[stages]] to follow it more closely"
    if error == math.inf and weakened:
        report(
            "with the joint laws of this stage no equilibrium was found under the loads of the stage before: forces "
            "are those of one step, as if laws and loads changed together; let a stage with the new loads go before"
        )
    elif error == math.inf:
        report(f"{way}, but the loads were applied in one step; {more}")
    else:
        known = f"the forces are known to {error:.1g} of the greatest on a block"
        report(f"{way}: after {increments} increments {known}; {more}")


def described(increments: int, error: float, force: float) -> dict[str, int | float | None]:
    """Entries of ``statics`` in the JSON output: ``error`` over the greatest force, and as a ``force`` (N); null if
    unknown."""
    known = math.isfinite(error)
    return {"increments": increments, "path_error": error if known else None, "force_error": force if known else None}


def left_by(results: Sequence[Mapping]) -> float:
    """Error of forces (N) that stages with these ``results`` leave; infinite if unknown."""
    for result in reversed(results):
        found = result.get("statics") or {}
        if "force_error" in found:
            return math.inf if found["force_error"] is None else float(found["force_error"])
    return 0.0
