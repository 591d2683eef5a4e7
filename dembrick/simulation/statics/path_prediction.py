"""Where a path of equilibria goes on while convex joints rock."""

from __future__ import annotations

import numpy as np

from dembrick.kernels.statics.load_bounds import NEVER
from dembrick.simulation.statics.path_state import PathState

FURTHEST = 2.0  # times the difference of tangent and secant: how far it is extrapolated


def go_on_rocking(way: PathState, tangent: np.ndarray | None, secant: np.ndarray, slope: float) -> None:
    """Look for the next equilibrium where convex joints that rock come to, then along the ``secant`` of the last step.

    Motions (6 f,) are a metre of the driven displacement: the ``tangent`` of the path, None without one, and the
    secant, along which V grew by ``slope`` (N/m). When the blocks have given way by g, the strip that a joint presses
    is c / sqrt(g) wide (`path_bounds`) and closed by a multiple of sqrt(g) at its edge: the motion is A g + B sqrt(g),
    and V falls short of its limit by a multiple of 1 / sqrt(g). From g to h the motion a metre is A + B / (sqrt(g) +
    sqrt(h)) on average.
    """
    (g, V, *_), (now, V_now, _, upper, _) = way.seen[-2:]
    if tangent is None or upper >= NEVER or not (0.0 < g < now and V < V_now):
        return
    before, here, there = g**0.5, now**0.5, (now + way.step) ** 0.5
    at_tangent, at_secant, ahead = 0.5 / here, 1.0 / (before + here), 1.0 / (here + there)
    part = max((ahead - at_tangent) / (at_secant - at_tangent), -FURTHEST)
    grown = (V_now - V) / (1.0 / before - 1.0 / here) * (1.0 / here - 1.0 / there)
    way.direction, way.gain = secant, slope
    way.turn_to(tangent + part * (secant - tangent), grown / way.step)
