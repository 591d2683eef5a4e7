"""Bounds of the limit load from a path of equilibria, and extrapolation of the path while convex joints rock."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dembrick.kernels.statics.load_bounds import MISSING, NEVER, STILL, converges, remaining_growth
from dembrick.simulation.statics.paths.path_state import PathState

EIGHTH = 0.125  # of the inelastic displacement so far: there must have been an equilibrium between it and a quarter
APART = 3.0  # times the difference of two estimates of the limit: error of the last of them

LEFT_OUT = 0.2  # times (limit - V)^2 / limit: least error of an estimate

PUSHES, STILL_GROWS = 3, 0.05  # pushes that bound V, and the part by which it may grow in the last of them
BEYOND = 0.5  # of the range of V in the pushes: added to it at either end

Seen = tuple[float, float, float, float, bool]  # inelastic displacement (m), V, its bounds (N), whether a gap closes


def limit_bounds(seen: list[Seen], elastic: float, rocks_on: Callable[[float], bool]) -> tuple[float, float, bool]:
    """Lower and upper bound of V from the equilibria ``seen`` so far, and whether V is that of a mechanism.

    The bounds are those since half of the present inelastic displacement. If a contact shrinks for ever (a rocking
    convex joint), V keeps growing: the growth still to come is estimated as a geometric series from the last two
    growths, or by `_beyond_the_strip` if that is more accurate and convex joints rock on up to there (``rocks_on``);
    V ends earlier if friction is exhausted. A decrease of V meanwhile, as normal forces drift and elastic forces fade,
    lowers the lower bound in the same way. ``elastic`` (N/m): the elastic slope of V.
    """
    given, V = seen[-1][:2]
    half = _when(seen, 0.5 * given)
    quarter = _when(seen, 0.25 * given)
    growth, before = V - seen[half][1], seen[half][1] - seen[quarter][1]
    recent = seen[half + 1 :] or seen[-1:]
    to_come = remaining_growth(growth, before)
    lower = max(0.0, min(s[2] for s in recent) + min(to_come, 0.0))
    upper = max(s[3] for s in recent) + max(to_come, 0.0)
    if rocks_on(V):
        closer = _beyond_the_strip([seen[_when(seen, 0.125 * given)], seen[quarter], seen[half], seen[-1]])
        if closer is not None and closer[1] - closer[0] < upper - lower and rocks_on(closer[1]):
            lower, upper = closer
    # over the second half V must grow more slowly than elastically
    followed = 0.0 < EIGHTH * given <= seen[quarter][0] and not any(s[4] for s in recent)
    slow = growth <= STILL * elastic * (given - seen[half][0]) and converges(growth, before, V - seen[-1][2], V)
    return lower, upper, followed and slow


def pushed_bounds(pushes: list[Seen], strips: bool) -> tuple[float, float, bool]:
    """Bounds as in `limit_bounds` from the outcomes of ``pushes`` by driven relaxation.

    V rises and falls as blocks snap, without converging: its lower bound is the least V in the last part of the last
    two pushes and after them, its upper bound the greatest in the last three. Half of that range is added at either
    end, as three pushes do not show all of it. If V still grew in the last push, the same growth may follow again, or
    more with ``strips``; if it grew by much, there is no upper bound.
    """
    if len(pushes) < PUSHES:
        return 0.0, NEVER, False
    before, recent = pushes[-PUSHES], pushes[1 - PUSHES :]
    lower, upper = min(s[2] for s in recent), max(s[3] for s in (before, *recent))
    more = BEYOND * (upper - lower)
    lower, upper = max(0.0, lower - more), upper + more
    grown = pushes[-1][1] - pushes[-2][1]
    if grown > STILL_GROWS * abs(pushes[-1][1]):
        return lower, NEVER, False
    return lower, max(upper, pushes[-1][1] + (MISSING if strips else 1.0) * grown), True


def bounds_after_jumps(seen: list[Seen], strips: bool) -> tuple[float, float, bool]:
    """Bounds of V as `pushed_bounds`, if the blocks jumped again and again and no relaxation drives them on.

    They come from all equilibria since half of the inelastic displacement: from the least V to the greatest upper bound
    of the mechanisms, extended at either end by half the range of V. V must have grown by little compared with before;
    as much again may still be missing, or more if joints rock on shrinking ``strips``.
    """
    half = _when(seen, 0.5 * seen[-1][0]) + 1
    before, recent = seen[:half], seen[half:]
    if sum(s[4] for s in recent) < PUSHES:
        return 0.0, NEVER, False
    loads = [s[1] for s in recent]
    more, grown = BEYOND * (max(loads) - min(loads)), max(loads) - max(s[1] for s in before)
    lower = max(0.0, min(s[2] for s in recent) - more)
    if grown > STILL_GROWS * max(loads):
        return lower, NEVER, False
    upper = max(s[3] if s[3] < NEVER else s[1] for s in recent)
    return lower, upper + max(more, (MISSING if strips else 1.0) * grown), True


def peak_bounds(seen: list[Seen], compliance: float) -> tuple[float, float]:
    """Bounds of the greatest V on the path ``seen``: the load that its best equilibrium certainly carried, and the peak
    between its neighbours, extrapolated linearly from both sides. ``compliance``: elastic, m/N."""
    i = max(range(len(seen)), key=lambda k: min(seen[k][1], seen[k][2]))
    _, V, lower = seen[i][:3]
    sure, above = min(V, lower), []
    if 0 < i < len(seen) - 1:
        before, here, after = (s[0] + s[1] * compliance for s in seen[i - 1 : i + 2])
        above.append((V - seen[i - 1][1]) * (after - here) / (here - before))
        above.append((V - seen[i + 1][1]) * (here - before) / (after - here))
    return sure, max(sure, V) + max(0.0, min(above, default=0.0))


def carried(way: PathState) -> float:
    """Greatest load (N) that an equilibrium of a path certainly carried; those near the ends of pushes, where blocks
    may still move, do not count."""
    return max((min(s[1:3]) for s in way.seen[: len(way.seen) - way.pushes]), default=0.0)


def _when(seen: list[Seen], given: float) -> int:
    """Number of the last equilibrium whose inelastic displacement is at most ``given``."""
    return next((i for i in range(len(seen) - 1, -1, -1) if seen[i][0] <= given), 0)


def _beyond_the_strip(marks: list[Seen]) -> tuple[float, float] | None:
    """Bounds of the limit of V while convex joints rock, from equilibria each about twice as far as the last; or None.

    A joint that has turned by theta presses on a strip of the width w = sqrt(2 N / (k_n L theta)), and the resultant
    acts w/3 inside the edge: V falls short by c / sqrt(theta). The rotation is proportional to the inelastic
    displacement g but for an offset from before rocking: V = limit - c / sqrt(g) - d / g^(3/2). Three equilibria give
    all three unknowns. The error is estimated by the difference of two such limits, or by half the effect of the offset
    on the last; both may vanish by chance, and then the truncation error of the series (`LEFT_OUT`) is the least.
    """
    pairs = list(zip(marks, marks[1:], strict=False))
    if not marks[0][0] > 0.0 or not all(now[1] > before[1] and now[0] > before[0] for before, now in pairs):
        return None
    without, offset = [], []  # the limit as if d were zero, and what d adds to that
    for before, now in pairs:
        little, much = before[0] ** 0.5, now[0] ** 0.5
        without.append((now[1] * much - before[1] * little) / (much - little))
        offset.append((little + much) / (before[0] * now[0]))
    early, late = (
        (without[k + 1] * offset[k] - without[k] * offset[k + 1]) / (offset[k] - offset[k + 1]) for k in (0, 1)
    )
    _, V, lower, upper, _ = marks[-1]
    left = (late - V) ** 2 / max(abs(late), abs(V))
    apart = max(APART * max(abs(late - early), 0.5 * abs(late - without[-1])), LEFT_OUT * left)
    return late - apart - (V - lower), late + apart + (upper - V)


FURTHEST = 2.0  # times the difference of tangent and secant: how far it is extrapolated


def go_on_rocking(way: PathState, tangent: np.ndarray, secant: np.ndarray, slope: float) -> None:
    """Predict the next equilibrium of rocking convex joints; the ``secant`` of the last step is the second choice.

    Motions (6 f,) are per metre of driven displacement, exactly: the ``tangent`` of the path, and the secant,
    along which V grew by ``slope`` (N/m). At an inelastic displacement g, the strip on which a joint presses
    is c / sqrt(g) wide (`limit_bounds`) and closed by a multiple of sqrt(g) at its edge: the motion is A g + B sqrt(g),
    and V falls short of its limit by a multiple of 1 / sqrt(g). From g to h the motion per metre is A + B / (sqrt(g) +
    sqrt(h)) on average.
    """
    (g, V, *_), (now, V_now, _, upper, _) = way.seen[-2:]
    if upper >= NEVER or not (0.0 < g < now and V < V_now):
        return
    before, here, there = g**0.5, now**0.5, (now + way.step) ** 0.5
    at_tangent, at_secant, ahead = 0.5 / here, 1.0 / (before + here), 1.0 / (here + there)
    part = max((ahead - at_tangent) / (at_secant - at_tangent), -FURTHEST)
    grown = (V_now - V) / (1.0 / before - 1.0 / here) * (1.0 / here - 1.0 / there)
    way.direction, way.gain = secant, slope
    way.turn_to(tangent + part * (secant - tangent), grown / way.step)
