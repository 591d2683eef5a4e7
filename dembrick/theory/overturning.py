"""Loads above the joint: they overturn it, so that the centre of pressure moves as they grow.

A horizontal load V f at height h above the joint shifts the centre of pressure by V h (f1, f2) / N. If friction depends
on the pressure, the limit load solves V = limit(pressure at V); if the centre of pressure reaches the edge of the joint
first, the block overturns. The paper's formulas assume h = 0.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

import numpy as np
from numpy.typing import ArrayLike

from dembrick.errors import NotConvergedError, ScenarioError
from dembrick.theory.formulations import Formulation
from dembrick.theory.limit_load import LimitLoad, limit_load
from dembrick.theory.polygons import distance_to_exit, moment_matrix

_SCAN = 16
_SHORT_OF_TIPPING = (1e-12, 1e-3, 1e-2)  # relative


def overturning_load(
    formulation: Formulation, normal_force: float, overturning: ArrayLike, centre: ArrayLike | None = None
) -> float:
    """V at which the centre of pressure reaches the edge of the points or of the polygon; inf if it never does.

    ``overturning`` (2,) in N m per unit of V is the sum of h_i (f1, f2)_i over the loads; ``centre`` is the centre of
    pressure at V = 0.
    """
    start = formulation.middle if centre is None else np.asarray(centre, float)
    shift = np.asarray(overturning, float) / normal_force
    V = distance_to_exit(formulation.hull, start, shift)
    if V < 0.0:
        raise ScenarioError(
            f"the normal force acts at {tuple(start.tolist())} m, outside the joint: the block overturns without load"
        )
    return V


def limit_load_at_height(
    formulation: Formulation,
    normal_force: float,
    load: ArrayLike,
    *,
    height: float = 0.0,
    overturning: ArrayLike | None = None,
    dead_load: ArrayLike = (0.0, 0.0, 0.0),
    centre: ArrayLike | None = None,
) -> LimitLoad:
    """Limit multiplier of a load (f1, f2, m) about O acting ``height`` above the joint, by sliding or overturning.

    ``overturning`` (2,) replaces height * (f1, f2) if several loads act at different heights. ``centre`` is the centre
    of pressure at V = 0, including dead loads. The lowest V that meets the limit is returned.
    """
    load = np.asarray(load, float)
    start = formulation.middle if centre is None else np.asarray(centre, float)
    lever = height * load[:2] if overturning is None else np.asarray(overturning, float)
    V_tip = overturning_load(formulation, normal_force, lever, start)
    tipped = LimitLoad(V_tip, (np.nan, np.nan, np.nan), None, "overturning")

    twist = None

    def limit(V: float) -> LimitLoad:
        nonlocal twist
        found = limit_load(formulation.law(normal_force, start + V / normal_force * lever), load, dead_load, twist)
        twist = found.twist
        return found

    if not formulation.follows_pressure or not lever.any():
        sliding = limit_load(formulation.law(normal_force, start), load, dead_load)
        return sliding if sliding.V <= V_tip else tipped
    # no distribution of N carries more than V_0 = c A + mu N in translation
    force = float(np.hypot(*load[:2]))
    bound = np.inf
    if force > 0.0:
        V_0 = formulation.cohesion * formulation.area + formulation.friction * normal_force
        bound = (V_0 + float(np.hypot(*np.asarray(dead_load, float)[:2]))) / force
    end = min(V_tip, 1.001 * bound)
    below, excess_below = 0.0, limit(0.0).V
    steps = np.linspace(0.0, end, _SCAN + 1)[1:]
    if excess_below > 0.0:
        # While the whole joint is pressed, the pressure is linear in V. The limit, the minimum of D / (f . q) over all
        # twists, is then concave in V and crosses V only once.
        linear = formulation.parts is None or formulation.pressure == "linear"
        closed = min(closed_until(formulation, normal_force, start, lever), end) if linear else 0.0
        steps = np.concatenate([[closed] if closed > 0.0 else [], steps[steps > closed]])
    for above in steps.tolist():
        above, excess = _before_tipping(limit, V_tip) if above == V_tip else (above, limit(above).V - above)
        if excess <= 0.0:
            break
        below, excess_below = above, excess
    else:
        return tipped
    V = _root(lambda V: limit(V).V - V, below, excess_below, above, excess)
    found = limit(V)
    return LimitLoad(float(V), found.twist, found.torsion_centre)


def _before_tipping(limit: Callable[[float], LimitLoad], V_tip: float) -> tuple[float, float]:
    """A V as close to ``V_tip`` as possible for which a pressure can be found, and the excess of the limit over it (N).

    A joint of several parts that tips about an edge of its hull is pressed at few corners only.
    """
    for short in _SHORT_OF_TIPPING[:-1]:
        V = V_tip * (1.0 - short)
        with suppress(NotConvergedError):
            return V, limit(V).V - V
    V = V_tip * (1.0 - _SHORT_OF_TIPPING[-1])
    return V, limit(V).V - V


def closed_until(
    formulation: Formulation, normal_force: float, centre: ArrayLike, lever: ArrayLike = (0.0, 0.0)
) -> float:
    """V up to which a linear pressure, of N through ``centre`` + V ``lever`` / N, presses all points or corners."""
    at = formulation.normal_arms if formulation.parts is None else np.concatenate(formulation.parts)
    phi = np.column_stack([np.ones(len(at)), at])
    if formulation.parts is None:
        moments = (phi * formulation.areas[:, None]).T @ phi
    else:
        moments = sum(moment_matrix(part) for part in formulation.parts)
    if np.linalg.matrix_rank(moments) < 3:  # collinear points
        return 0.0
    thrust = normal_force * np.array([1.0, *centre])
    ends = np.linalg.solve(moments, np.array([thrust, [0.0, *lever]]).T)
    level, slope = (phi @ ends).T
    if not (level > 0.0).all():
        return 0.0
    falling = slope < 0.0
    return float((level[falling] / -slope[falling]).min(initial=np.inf))


def _root(f, x_0: float, f_0: float, x_1: float, f_1: float) -> float:
    """Zero of f between x_0 and x_1 with opposite signs, to rounding: false position with halving (Illinois)."""
    tolerance = 2e-14 * max(abs(x_0), abs(x_1))
    for _ in range(100):
        if f_1 == 0.0:
            return x_1
        if abs(x_1 - x_0) <= tolerance or abs(f_1) <= tolerance:
            break
        x = x_1 - f_1 * (x_1 - x_0) / (f_1 - f_0)
        f_x = f(x)
        if (f_x > 0.0) != (f_1 > 0.0):
            x_0, f_0 = x_1, f_1
        else:
            f_0 *= 0.5
        x_1, f_1 = x, f_x
    return x_1
