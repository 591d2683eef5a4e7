"""What drives a dynamic run: gravity and loads as functions of time, seen from the supports.

Whatever the supports do, the run is made in their frame. A table that tilts turns gravity and the loads the other way
(its rate is slow: what its turning adds to the acceleration is left out); supports that shake put their acceleration,
reversed, on every block. Moving supports enter by the velocity they gain in each step, so that a history is integrated
exactly, jumps and all.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

Curve = Callable[[np.ndarray], np.ndarray]  # times (s,) -> values (s,)


@dataclass(frozen=True)
class Driving:
    """Gravity (3,), loads and the motion of the supports.

    ``block`` (k,), ``lever`` (k, 3; body axes, m) and ``force`` (k, 3; N, world) of the loads, ``factor`` a curve for
    each or None. ``tilt``: (axis, rate in rad/s). ``support_velocity``: a curve of the speed along ``direction``, m/s.
    """

    gravity: np.ndarray
    block: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    lever: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    force: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    factor: tuple[Curve | None, ...] = ()
    tilt: tuple[np.ndarray, float] | None = None
    support_velocity: Curve | None = None
    direction: np.ndarray = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))

    def at(self, times: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
        """Gravity (s, 3) in m/s2 and load forces (s, k, 3) in N for the steps at ``times`` (s,)."""
        gravity, force = (np.repeat(vectors[None], len(times), axis=0) for vectors in (self.gravity, self.force))
        for k, curve in enumerate(self.factor):
            if curve is not None:
                force[:, k] *= curve(times)[:, None]
        if self.tilt is not None:
            axis, rate = self.tilt
            cosine, sine = np.cos(rate * times), np.sin(rate * times)
            gravity = turned_back(gravity, axis, cosine[:, None], sine[:, None])
            if len(self.block):
                force = turned_back(force, axis, cosine[:, None, None], sine[:, None, None])
        if self.support_velocity is not None:
            gained = self.support_velocity(times + 0.5 * dt) - self.support_velocity(times - 0.5 * dt)
            gravity = gravity - (gained / dt)[:, None] * self.direction
        return gravity, np.ascontiguousarray(force)


def turned_back(vectors: np.ndarray, axis: np.ndarray, cosine: np.ndarray, sine: np.ndarray) -> np.ndarray:
    """``vectors`` (..., 3) seen from what has turned about the unit ``axis`` (Rodrigues' formula)."""
    along = (vectors @ axis)[..., None] * axis
    x, y, z = axis
    beside = vectors @ np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])  # axis x v
    return along + cosine * (vectors - along) - sine * beside
