"""Whether the load of a constant-rate test has settled: only a steady load is a limit load.

The curve of an uncertified test may still rise when its travel ends, or swing about what it would be at rest: the mean
of neither is a limit load. The time loop sums V and its square over even stretches of the travel (``kernels.guard``). A
load that falls after its peak is no error: V is then what the blocks still carry.

The limit load is defined in the geometry of the start, and the head has moved on from there. By how much V drifts on
its way is known from the second half of the travel; back to its start, that is part of the bracket.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from dembrick.errors import NotConvergedError
from dembrick.kernels.statics.divergence import Guard
from dembrick.simulation.statics.yield_point import YieldPoint

STEADY = 1e-2  # of the mean load: swing (rms) and missing growth that are let pass
MISSING = 5.5  # times the growth from the third to the last quarter: what 1 - c/sqrt(u) still lacks
DRIFT = 1.5  # times the straight drift from the start of the travel: what is not straight in it
SLOW = 0.1  # elastic slips per critical time step: a head that is no faster cannot make a load swing
NEAR = 1e-2  # of the joint's reach: a block that has moved no further is where its limit load is defined
WILD = 0.1  # of the load: a swing (rms), or a want of load, that no slow test of a sound integration has
TWICE, MOST = 2.0, 100.0  # times the travel: the least and the most that is advised at once
ROUNDING = 1e-9  # of the first digit
FEWEST = 8  # stretches of the travel that must have been summed


def _late(guard: Guard) -> tuple[float, float, float]:
    """Over the second half of the travel: swing of the load about its linear trend (rms), the trend's end, and what it
    would gain over the whole travel (N)."""
    steps, mean, square = guard.load[guard.load[:, 0] > 0.0].T
    mean, square = mean / steps, square / steps
    done = (np.cumsum(steps) - 0.5 * steps) / steps.sum()
    half = done > 0.5
    line = np.polyfit(done[half], mean[half], 1)
    trend = np.polyval(line, done[half])
    # mean of (V - trend)^2 over each stretch
    spread = square[half] - 2.0 * mean[half] * trend + trend**2
    swing = float(np.sqrt(max(np.average(spread, weights=steps[half]), 0.0)))
    return swing, float(np.polyval(line, 1.0)), float(line[0])


def refuse_unsound(point: YieldPoint, guard: Guard, pace: float, reach: float) -> None:
    """NotConvergedError if the curve of a slow certified test is none: its load swings, or stays below the bracket.

    ``pace``: elastic slips of the head per critical time step, ``reach`` (m) of the joint. A fast test may swing, and a
    block that has moved far may carry less; the bracket of the start holds all the same.
    """
    if pace > SLOW or point.displacement > NEAR * reach or np.count_nonzero(guard.load[:, 0]) < FEWEST:
        return
    (swing, load, _), allowed = _late(guard), WILD * point.V_lower
    if not (swing <= allowed and load >= point.V_lower - allowed):
        raise NotConvergedError(
            f"over the second half of a slow test V swings by {swing:.3g} N (rms) towards {load:.6g} N, and at least "
            f"{point.V_lower:.6g} N is carried at the limit: the time step does not resolve this motion; "
            "lower solver.step_factor",
            point,
        )


def longer(travel: float, factor: float) -> str:
    """The advice to make a ``travel`` (m) longer by ``factor``, to one digit, rounded up."""
    wanted = factor * travel
    digit = 10.0 ** math.floor(math.log10(wanted))
    return f"lengthen control.travel, say to {digit * math.ceil(wanted / digit - ROUNDING):.1g} m"


def steady(point: YieldPoint, guard: Guard, least: float, travel: float) -> YieldPoint:
    """``point`` with the mean load of the last quarter for its V; NotConvergedError if the load is not steady.

    The bracket holds V, and what it would have been in the geometry of the start.
    ``least`` (N) is a load that counts as none: what is let pass is not less than a part of it. What a load that still
    rises lacks falls with the root of the ``travel`` (m), which tells how long it must be.
    """
    steps, mean, square = guard.load[guard.load[:, 0] > 0.0].T
    if len(steps) < FEWEST:
        raise NotConvergedError(
            f"{int(steps.sum())} steps are too few to tell whether the load is steady; {longer(travel, TWICE)}", point
        )
    mean, (swing, _, gain) = mean / steps, _late(guard)
    done = (np.cumsum(steps) - 0.5 * steps) / steps.sum()
    last, half = done > 0.75, done > 0.5
    V = float(np.average(mean[last], weights=steps[last]))
    growth = V - float(np.average(mean[half & ~last], weights=steps[half & ~last]))
    at_start = V - DRIFT * float(np.average(done[last], weights=steps[last])) * gain
    above = None if point.V_upper is None else max(point.V_upper, V, at_start)
    point = replace(point, V=V, V_lower=min(point.V_lower, V, max(0.0, at_start)), V_upper=above)
    allowed = STEADY * max(abs(V), least)
    if not (swing <= allowed and MISSING * growth <= allowed):
        rises = swing <= allowed
        what = "still rises" if rises else f"swings by {swing:.3g} N (rms)"
        factor = (MISSING * max(growth, 0.0) / allowed) ** 2 if rises else 1.0
        advice = longer(travel, min(max(TWICE, factor), MOST))
        raise NotConvergedError(
            f"no limit load: over the second half of the travel V {what} about {V:.6g} N, {growth:+.3g} N in its last "
            f"quarter; {f'{advice}, or lower control.rate' if rises else f'lower control.rate, or {advice}'}",
            point,
        )
    return point
