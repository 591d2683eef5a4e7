"""Torsion-shear curves of a rectangle's formulations (paper Fig. 4 and Fig. 5) and points of any limit surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dembrick.errors import ScenarioError
from dembrick.theory.formulations import formulation_law
from dembrick.theory.limit_load import limit_load, limit_loads
from dembrick.theory.limit_surface import Law


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
    """M_T0 (N m): the limit of a pure couple. The joint turns about the point of least mean distance, not always O."""
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
    pressure: str = "full",
    cells: tuple[int, int] | None = None,
) -> InteractionCurve:
    """Yield domain for a centrally pressed rectangle a x b sheared along ``direction`` (the paper: along y).

    Points lie on ``count`` rays, equally spaced in angle in the non-dimensional plane. By symmetry a force along an
    edge has no transverse part in its limit; for another direction the curve is that of forces held to that direction.
    """
    d = np.asarray(direction, float)
    size = float(np.hypot(*d))
    if not size > 0.0 or count < 2:
        raise ScenarioError("an interaction curve needs a direction longer than 0 and at least 2 points")
    law = formulation_law(formulation, a, b, friction, normal_force, cohesion, pressure=pressure, cells=cells)
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
