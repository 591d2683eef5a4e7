"""Convex sets of joint forces by their support functions: gauges of forces, and the planes that cut them off.

A force f is within the set if q . f <= D(q) for every motion q, with D convex and homogeneous of degree one. The gauge
of f is 1 / min of D(q) over q . f = 1, and the minimiser q is the normal of the plane that cuts f off. All functions
take stacks: k polygons with equally many corners (k, m, 2), motions q (k, 3); lengths are in gyrations.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from dembrick.simulation.limit_analysis.strength import Areas

CONVERGED = 1e-14  # of D: predicted decrease by the next step
_ITERATIONS = 100
_FIRST, _LESS, _MORE = 1e-2, 0.1, 10.0  # weight of the ellipsoid's Hessian added to the own one, and its changes
_LIGHTEST, _HEAVIEST = 1e-12, 1e12  # bounds of that weight; beyond the latter only rounding is left to gain


class SupportFunction(ABC):
    """D of some area joints; ``ellipsoid`` (k, 3, 3): matrix of a quadratic form whose square root approximates it."""

    ellipsoid: np.ndarray

    @abstractmethod
    def of(self, at: np.ndarray) -> SupportFunction:
        """The function of the joints at these places alone."""

    @abstractmethod
    def speed(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """D (k,), its gradient (k, 3) and its Hessian (k, 3, 3)."""

    def cut(self, g: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The gauges (k,) of forces g (k, 3), and the motions q (k, 3), scaled to D = 1, that attain them, by Newton
        steps on q . g = 1, damped by the ellipsoid (Levenberg and Marquardt)."""
        size = np.linalg.norm(g, axis=1)
        f = g / size[:, None]
        start = np.linalg.solve(self.ellipsoid, f[..., None])[..., 0]
        q = start / (start * f).sum(axis=1)[:, None]
        helper = np.eye(3)[np.argmin(np.abs(f), axis=1)]
        first = np.cross(f, helper)
        first /= np.linalg.norm(first, axis=1)[:, None]
        basis = np.stack([first, np.cross(f, first)], axis=2)
        back = basis.transpose(0, 2, 1)
        around = back @ self.ellipsoid @ basis
        value, gradient, hessian = self.speed(q)
        weight, live = np.full(len(g), _FIRST), np.arange(len(g))
        for _ in range(_ITERATIONS):
            inside = back[live] @ hessian[live] @ basis[live]
            damped = inside + (weight[live] / value[live])[:, None, None] * around[live]
            slope = np.einsum("kij,kj->ki", back[live], gradient[live])
            step = np.linalg.solve(damped, -slope[..., None])[..., 0]
            promised = -0.5 * (step * slope).sum(axis=1)
            tried = q[live] + np.einsum("kij,kj->ki", basis[live], step)
            new = self.of(live).speed(tried)
            better = new[0] <= value[live]
            taken = live[better]
            q[taken] = tried[better]
            value[taken], gradient[taken], hessian[taken] = (part[better] for part in new)
            weight[live] = np.maximum(weight[live] * np.where(better, _LESS, _MORE), _LIGHTEST)
            going = (promised > CONVERGED * value[live]) & (weight[live] < _HEAVIEST)
            live = live[going]
            if not len(live):
                break
        return size / value, q / value[:, None]

    @classmethod
    @abstractmethod
    def of_joints(cls, areas: Areas, chosen: np.ndarray) -> SupportFunction:
        """The function of the ``chosen`` area joints (k,), which have equally many corners."""


def by_corners(kind: type[SupportFunction], areas: Areas, chosen: np.ndarray):
    """The ``chosen`` area joints with equally many corners: places in ``chosen``, and their support function."""
    counts = np.diff(areas.start)[chosen]
    for count in np.unique(counts):
        places = np.flatnonzero(counts == count)
        yield places, kind.of_joints(areas, chosen[places])


def corners_of(areas: Areas, chosen: np.ndarray) -> np.ndarray:
    """Corners (k, m, 2) of joints with equally many, in gyrations."""
    count = areas.start[chosen[0] + 1] - areas.start[chosen[0]]
    return areas.corner[areas.start[chosen, None] + np.arange(count)] / areas.gyration[chosen, None, None]


def gauges(
    kind: type[SupportFunction], areas: Areas, chosen: np.ndarray, force: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """`SupportFunction.cut` of forces (k, 3) in the ``chosen`` joints (k,). A zero force has the gauge 0."""
    gauge, motion = np.zeros(len(chosen)), np.zeros((len(chosen), 3))
    acting = np.flatnonzero(np.linalg.norm(force, axis=1) > 0.0)
    for places, function in by_corners(kind, areas, chosen[acting]):
        own = acting[places]
        gauge[own], motion[own] = function.cut(force[own])
    return gauge, motion
