"""Bounds of the limit load from a path of equilibria, whether it is one, and where the path goes on while convex joints
rock.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dembrick.kernels.statics.load_bounds import MISSING, NEVER, STILL, settles, still_to_come
from dembrick.simulation.statics.paths.path_state import PathState

EIGHTH = (
    0.125  # of what the blocks have given way: by which there must have been an equilibrium, before a quarter of it
)
APART = 3.0  # times that estimates of the limit differ: how far it may be from the last of them

LEFT_OUT = 0.2  # times the square of how far V falls short of the limit, over the limit: no estimate is closer

PUSHES, STILL_GROWS = 3, 0.05  # pushes that tell of V, and the part by which it may grow in the last of them
BEYOND = 0.5  # of the range that pushes have shown: how far V may go beyond it at either end

Seen = tuple[float, float, float, float, bool]  # inelastic displacement (m), V, its bounds (N), whether a gap closes


def limit_bounds(seen: list[Seen], elastic: float, rocks_on: Callable[[float], bool]) -> tuple[float, float, bool]:
    """Lower and upper bound of V from the equilibria ``seen`` so far, and whether V is that of a mechanism.

    The bounds are those since the blocks had given way half as far. What V grew meanwhile shows how much is still
    missing where a contact shrinks for ever (a convex joint that rocks): the sum of all growths to come, each smaller
    than the last as the last was than the one before; or `_beyond_the_strip`, where that tells it closer and convex
    joints rock on up to there (``rocks_on``): where friction gives out before, V ends there. What V fell meanwhile, as
    normal forces drift and elastic forces are forgotten, is charged to the lower bound in the same way. ``elastic``
    (N/m): the slope of V before anything gives way.
    """
    given, V = seen[-1][:2]
    half = _when(seen, 0.5 * given)
    quarter = _when(seen, 0.25 * given)
    growth, before = V - seen[half][1], seen[half][1] - seen[quarter][1]
    recent = seen[half + 1 :] or seen[-1:]
    to_come = still_to_come(growth, before)
    lower = max(0.0, min(s[2] for s in recent) + min(to_come, 0.0))
    upper = max(s[3] for s in recent) + max(to_come, 0.0)
    if rocks_on(V):
        closer = _beyond_the_strip([seen[_when(seen, 0.125 * given)], seen[quarter], seen[half], seen[-1]])
        if closer is not None and closer[1] - closer[0] < upper - lower and rocks_on(closer[1]):
            lower, upper = closer
    # over half the way V must grow more slowly than the elastic structure would let it
    followed = 0.0 < EIGHTH * given <= seen[quarter][0] and not any(s[4] for s in recent)
    slow = growth <= STILL * elastic * (given - seen[half][0]) and settles(growth, before, V - seen[-1][2], V)
    return lower, upper, followed and slow


def pushed_bounds(pushes: list[Seen], strips: bool) -> tuple[float, float, bool]:
    """The same where driven relaxation pushes the blocks on, from what each of the ``pushes`` has ended with.

    V rises and falls by turns as blocks snap, without a limit that it tends to: it is at least what it fell to in the
    last part of the last two pushes, and what the blocks carried after them, and at most what it came to in the last
    three. Half of that range is added at either end, as three pushes do not tell all of it. If V still grew in the
    last, as much again may be missing, or more where there are ``strips``; and if it grew by much, nothing bounds it.
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


def peak_bounds(seen: list[Seen], compliance: float) -> tuple[float, float]:
    """Bounds of the greatest V on the path ``seen``: the load that its best equilibrium surely carried, and what V may
    have reached between its neighbours, by straight lines from either side. ``compliance``: elastic, m/N."""
    i = max(range(len(seen)), key=lambda k: min(seen[k][1], seen[k][2]))
    _, V, lower = seen[i][:3]
    sure, above = min(V, lower), []
    if 0 < i < len(seen) - 1:
        before, here, after = (s[0] + s[1] * compliance for s in seen[i - 1 : i + 2])
        above.append((V - seen[i - 1][1]) * (after - here) / (here - before))
        above.append((V - seen[i + 1][1]) * (here - before) / (after - here))
    return sure, max(sure, V) + max(0.0, min(above, default=0.0))


def _when(seen: list[Seen], given: float) -> int:
    """The last equilibrium before the blocks had given way so far."""
    return next((i for i in range(len(seen) - 1, -1, -1) if seen[i][0] <= given), 0)


def _beyond_the_strip(marks: list[Seen]) -> tuple[float, float] | None:
    """Bounds of what V tends to while convex joints rock, from equilibria each about twice as far as the last; or None.

    The strip that a joint presses is w = sqrt(2 N / (k_n L theta)) wide when it has turned by theta, and the resultant
    stands w/3 inside the edge: V falls short by c / sqrt(theta). The rotation is g, what the blocks have given way, but
    for an offset from before they rocked: V = limit - c / sqrt(g) - d / g^(3/2). Three equilibria give all three. How
    far the limits of two such sets differ, or else what the offset still does to the last, shows how good that is; both
    may vanish by chance, and then what the series leaves out (`LEFT_OUT`) is the bar.
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
    """Look for the next equilibrium where convex joints that rock come to, then along the ``secant`` of the last step.

    Motions (6 f,) are a metre of the driven displacement, to the last bit: the ``tangent`` of the path, and the secant,
    along which V grew by ``slope`` (N/m). When the blocks have given way by g, the strip that a joint presses
    is c / sqrt(g) wide (`limit_bounds`) and closed by a multiple of sqrt(g) at its edge: the motion is A g + B sqrt(g),
    and V falls short of its limit by a multiple of 1 / sqrt(g). From g to h the motion a metre is A + B / (sqrt(g) +
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
