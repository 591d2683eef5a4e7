"""Simple approximations of the convex torsion-shear curve, each labelled with its error against the exact one.

In the non-dimensional plane v = V/V_0, m = M_T/(V_0 c_T) these are the ellipse v^2 + m^2 = 1 of robotics, the parabola
m = 1 - v^2, and piecewise linear curves. The paper does not print the break points of the literature; those used here
are on the exact curve of the given rectangle, at equal polar angles in the (v, m) plane: 45 degrees for the bi-linear
curve, 30 and 60 for the three pieces. The exact domain is convex, so these two are inscribed and safe. None is exact.

Also the torsion-shear curves of all formulations for a rectangle (paper Fig. 4 and Fig. 5), and points of any limit
surface.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dembrick.errors import ScenarioError
from dembrick.theory.formulations import formulation_law
from dembrick.theory.limit_load import limit_load, limit_loads
from dembrick.theory.limit_surface import Law

APPROXIMATIONS = ("bi-linear", "three-linear", "parabola", "ellipse")
_PIECES = {"bi-linear": 2, "three-linear": 3}


@dataclass(frozen=True)
class ApproximateDomain:
    """An approximation of the convex domain of a rectangle.

    ``unsafe`` is the largest relative excess of its V over the exact limit along a ray of fixed eccentricity, ``safe``
    the largest shortfall (both 0 or more). ``breakpoints`` (k, 2) are the corners (v, m) of a piecewise linear curve.
    """

    name: str
    V_0: float
    M_T0: float
    breakpoints: np.ndarray | None
    unsafe: float
    safe: float

    @property
    def label(self) -> str:
        """Label for a legend: the name and the largest errors in percent."""
        errors = ("unsafe", self.unsafe), ("safe", self.safe)
        parts = [f"{word} by {100.0 * error:.1f} %" for word, error in errors if error > 5e-5]
        return f"{self.name} ({', '.join(parts) or 'within 0.005 %'})"

    def limit(self, eccentricity: ArrayLike) -> np.ndarray:
        """V (N) on the curve for a force at an eccentricity (m) of either sign; inf means a couple, with V = 0."""
        e = np.abs(np.asarray(eccentricity, float))
        couple = np.isinf(e)
        slope = np.where(couple, 1.0, e) * self.V_0 / self.M_T0
        radius = _radius(self.name, self.breakpoints, np.ones_like(slope), slope)
        return np.where(couple, 0.0, self.V_0 * radius)[()]

    def curve(self, count: int = 181) -> tuple[np.ndarray, np.ndarray]:
        """(V / V_0, M_T / M_T0) from pure shear to pure torsion, (count,) each."""
        angle = np.linspace(0.0, np.pi / 2.0, count)
        v, m = np.cos(angle), np.sin(angle)
        v[-1] = 0.0
        radius = _radius(self.name, self.breakpoints, v, m)
        return radius * v, radius * m


def _radius(name: str, corners: np.ndarray | None, v: np.ndarray, m: np.ndarray) -> np.ndarray:
    """Factor that scales (v, m), both 0 or more, onto the curve."""
    if name == "ellipse":
        return 1.0 / np.hypot(v, m)
    if name == "parabola":  # r m = 1 - r^2 v^2, the root that stays finite for v = 0
        return 2.0 / (m + np.sqrt(m * m + 4.0 * v * v))
    # a convex polygon: its gauge is the largest over its sides
    (v_0, m_0), (v_1, m_1) = corners[:-1].T, corners[1:].T
    across = v_0 * m_1 - v_1 * m_0
    return 1.0 / np.max((np.multiply.outer(v, m_1 - m_0) + np.multiply.outer(m, v_0 - v_1)) / across, axis=-1)


def approximate_domain(
    name: str,
    a: float,
    b: float,
    friction: float = 1.0,
    normal_force: float = 1.0,
    cohesion: float = 0.0,
    *,
    direction: ArrayLike = (0.0, 1.0),
    count: int = 1441,
) -> ApproximateDomain:
    """One of :data:`APPROXIMATIONS` for a rectangle a x b; its errors are measured on ``count`` rays."""
    if name not in APPROXIMATIONS:
        raise ScenarioError(f"approximate domain {name!r} is unknown: use one of {', '.join(APPROXIMATIONS)}")
    exact = interaction_curve("convex", a, b, friction, normal_force, cohesion, count=count, direction=direction)
    v, m = exact.normalised
    corners = None
    if name in _PIECES:
        pieces = _PIECES[name]
        corner = interaction_curve(
            "convex", a, b, friction, normal_force, cohesion, count=pieces + 1, direction=direction
        )
        corners = np.stack(corner.normalised, axis=1)
    excess = _radius(name, corners, v, m) - 1.0
    # the excess of an inscribed curve is rounding
    unsafe, safe = (float(value) if value > 1e-12 else 0.0 for value in (excess.max(), -excess.min()))
    return ApproximateDomain(name, exact.V_0, exact.M_T0, corners, unsafe, safe)


@dataclass(frozen=True)
class InteractionCurve:
    """A yield domain in the (V, M_T) plane, from pure shear to pure torsion: V (k,) in N, M_T (k,) in N m about O.

    ``twist`` (k, 3) is the slip twist at each point. Fig. 5 draws (V, M_T), Fig. 4 :attr:`normalised`.
    """

    formulation: str
    V: np.ndarray
    M_T: np.ndarray
    twist: np.ndarray
    V_0: float
    M_T0: float

    @property
    def normalised(self) -> tuple[np.ndarray, np.ndarray]:
        """(V / V_0, M_T / M_T0)."""
        return self.V / self.V_0, self.M_T / self.M_T0


def torsion_strength(law: Law) -> float:
    """M_T0 (N m): limit of a pure couple. The joint rotates about the point of least mean distance, not always O."""
    return limit_load(law, (0.0, 0.0, 1.0)).V


def surface_along(law: Law, directions: ArrayLike) -> np.ndarray:
    """(V_1, V_2, M_T) (k, 3) on the limit surface along the rays of ``directions`` (k, 3) in (N, N, N m)."""
    directions = np.asarray(directions, float)
    return directions * limit_loads(law, directions).V[:, None]


def interaction_curve(
    formulation: str,
    a: float,
    b: float,
    friction: float,
    normal_force: float,
    cohesion: float = 0.0,
    *,
    count: int = 181,
    direction: ArrayLike = (0.0, 1.0),
    centre: ArrayLike | None = None,
    pressure: str = "full",
) -> InteractionCurve:
    """Yield domain of a rectangle a x b pressed at ``centre`` (m from the middle; None: in the middle) and sheared
    along ``direction`` (in the paper: along y).

    Points are on ``count`` rays, equally spaced in angle in the non-dimensional plane. By symmetry the limit for a
    force along an edge has no transverse component if the joint is pressed in the middle; otherwise the curve is that
    of forces restricted to that direction.
    """
    d = np.asarray(direction, float)
    size = float(np.hypot(*d))
    if not size > 0.0 or count < 2:
        raise ScenarioError("an interaction curve needs a direction longer than 0 and at least 2 points")
    law = formulation_law(formulation, a, b, friction, normal_force, cohesion, centre=centre, pressure=pressure)
    M_T0 = torsion_strength(law)
    if not law.strength > 0.0:
        raise ScenarioError("an interaction curve needs friction and normal force greater than 0")
    angle = np.linspace(0.0, np.pi / 2.0, count)
    v, m = law.strength * np.cos(angle), M_T0 * np.sin(angle)
    v[-1] = 0.0
    scale = 1.0 / law.strength
    loads = np.stack([v * d[0] / size, v * d[1] / size, m], axis=1) * scale
    found = limit_loads(law, loads)
    return InteractionCurve(formulation, found.V * v * scale, found.V * m * scale, found.twist, law.strength, M_T0)
