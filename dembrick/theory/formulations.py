"""The five contact formulations as friction laws that depend on the centre of pressure.

A :class:`Formulation` is a joint without its load: where normal forces act, where friction acts, and how a normal force
N with its resultant at a point e of the joint is distributed. ``law(N, e)`` is the friction law for that distribution.
The normal forces of points are those of springs of equal stiffness per area without tension (a planar distribution
while all points press); a rigid joint with free normal forces would give other results. Cohesion (of joints that keep
it during slip) acts on the closed area: V_0 = c A + mu N takes the place of mu N in the paper's formulas.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dembrick.errors import NotConvergedError, ScenarioError
from dembrick.theory.equations import reduced_dimensions
from dembrick.theory.limit_surface import Law, PointLaw, PolygonLaw, convex, linear_pressure, points
from dembrick.theory.polygons import (
    as_parts,
    as_polygon,
    centroid,
    clip,
    convex_hull,
    distance_to_exit,
    intersect,
    is_convex,
    moment_matrix,
    rectangle,
)

FORMULATIONS = ("concave", "corrected", "corrected-shear", "convex", "distributed")
PRESSURES = ("full", "effective", "linear")

#: A centre of pressure on the very edge leaves a line of contact. It is limited to this fraction of the distance to the
#: edge, so that every integral remains one over a polygon; this changes a limit by at most 1e-9 (relative) with the
#: effective pressure and 1e-7 with the linear one, whose steep plane cancels more digits on a thin strip.
_EDGE = {"effective": 1.0 - 1e-5, "linear": 1.0 - 1e-4}


def _no_tension(moments_of, normal_force: float) -> np.ndarray:
    """Plane (3,) = (level, slope_x, slope_y) of a no-tension pressure with resultant N through the origin.

    ``moments_of(plane)`` is the integral of phi phi^T over the region where the plane is positive, phi = (1, x, y) in
    units of the joint's size, from the centre of pressure (near the joint's edge any other origin causes cancellation).
    Newton iteration on the convex potential of the springs, with line search; sections are exact, convergence
    quadratic.
    """
    target = np.array([normal_force, 0.0, 0.0])
    everywhere = np.array([1.0, 0.0, 0.0])
    H = moments_of(everywhere)
    if np.linalg.cond(H) > 1e13:  # collinear points carry no moment across their line: take the least-norm plane
        plane = np.linalg.lstsq(H, target, rcond=1e-12)[0]
    else:
        plane = np.linalg.solve(H, target)
    for _ in range(200):
        H = moments_of(plane)
        residual = H @ plane - target
        if np.abs(residual).max() <= 4e-15 * normal_force:
            break
        step = -np.linalg.lstsq(H, residual, rcond=1e-14)[0]
        potential, slope = 0.5 * plane @ H @ plane - target @ plane, residual @ step
        trial = plane + step
        if -slope < 1e-12 * abs(potential):  # the potential has no digits left, but the residual still has
            if np.abs(moments_of(trial) @ trial - target).max() >= np.abs(residual).max():
                break
        else:
            length = 1.0
            while 0.5 * trial @ moments_of(trial) @ trial - target @ trial > potential + 1e-4 * length * slope:
                length *= 0.5
                trial = plane + length * step
        plane = trial
    residual = moments_of(plane) @ plane - target
    if np.abs(residual).max() > 1e-9 * normal_force:
        raise NotConvergedError("no compressive pressure was found: the centre of pressure is at the edge of the joint")
    return plane


def spring_forces(arms: ArrayLike, areas: ArrayLike, normal_force: float, centre: ArrayLike = (0.0, 0.0)) -> np.ndarray:
    """Normal forces (n,) of no-tension springs, equal per area, with resultant N through ``centre`` (about O)."""
    arms, areas = np.asarray(arms, float), np.asarray(areas, float)
    weights = areas / areas.sum()
    size = float(np.abs(arms).max()) or 1.0
    phi = np.column_stack([np.ones(len(arms)), (arms - np.asarray(centre, float)) / size])

    def moments_of(plane: np.ndarray) -> np.ndarray:
        pressed = phi @ plane > 0.0
        return (phi[pressed] * weights[pressed, None]).T @ phi[pressed]

    return weights * np.maximum(phi @ _no_tension(moments_of, normal_force), 0.0)


def pressure_plane(
    polygon: ArrayLike | Sequence[ArrayLike], normal_force: float, centre: ArrayLike = (0.0, 0.0)
) -> tuple[float, np.ndarray]:
    """No-tension linear pressure max(0, level + slope . (r - centre)), resultant N through ``centre``: (level, slope).

    Exact on the polygon clipped at the line of zero pressure. Level in Pa, slope (2,) in Pa/m.
    """
    centre = np.asarray(centre, float)
    parts = [part - centre for part in as_parts(polygon)]
    size = float(max(np.abs(part).max() for part in parts))
    parts = [part / size for part in parts]
    area = sum(moment_matrix(part)[0, 0] for part in parts)

    def moments_of(plane: np.ndarray) -> np.ndarray:
        pressed = [clip(part, plane[1:], plane[0]) for part in parts]
        return sum((moment_matrix(part) for part in pressed if len(part) > 2), start=np.zeros((3, 3))) / area

    plane = _no_tension(moments_of, normal_force) / (area * size * size)
    return float(plane[0]), plane[1:] / size


def effective_polygon(polygon: ArrayLike | Sequence[ArrayLike], centre: ArrayLike) -> tuple[np.ndarray, ...]:
    """Largest part of the polygon that is centrally symmetric about ``centre``: rectangle a x b -> a x (b - 2e).

    It is the intersection of the polygon with its reflection through the centre of pressure. A non-convex polygon must
    be given as a union of convex parts.
    """
    parts = as_parts(polygon)
    if not all(is_convex(part) for part in parts):
        raise ScenarioError('pressure "effective" needs convex polygons: give a non-convex joint as convex parts')
    twice = 2.0 * np.asarray(centre, float)
    pieces = [intersect(part, twice - other) for part in parts for other in parts]
    pieces = [piece for piece in pieces if len(piece) > 2 and moment_matrix(piece, piece[0])[0, 0] > 0.0]
    if not pieces:
        raise ScenarioError(f"the centre of pressure {tuple(map(float, centre))} has no joint area around it")
    return tuple(pieces)


@dataclass(frozen=True)
class Formulation:
    """A joint without its load. Exactly one of ``shear_arms`` (points) and ``parts`` (polygons) is set."""

    name: str
    friction: float
    hull: np.ndarray  # (k, 2): contains all possible centres of pressure
    normal_arms: np.ndarray | None = None
    shear_arms: np.ndarray | None = None
    areas: np.ndarray | None = None
    parts: tuple[np.ndarray, ...] | None = None
    pressure: str = "full"
    cohesion: float = 0.0  # Pa, on the closed area

    def __post_init__(self):
        if not (np.isfinite(self.cohesion) and self.cohesion >= 0.0):
            raise ScenarioError(f"cohesion = {self.cohesion!r} is out of range: it must be finite and at least 0 Pa")
        if self.cohesion > 0.0 and self.pressure != "full":
            raise ScenarioError(
                f'pressure = "{self.pressure}" is that of a dry joint: cohesion acts on the whole polygon, friction on '
                'the pressure, and the two surfaces do not scale; use pressure = "full"'
            )

    @property
    def area(self) -> float:
        """Area of the joint (m2)."""
        if self.parts is None:
            return float(self.areas.sum())
        return float(sum(moment_matrix(part, part[0])[0, 0] for part in self.parts))

    @property
    def follows_pressure(self) -> bool:
        """Whether the friction law depends on the centre of pressure."""
        return self.parts is None or self.pressure != "full"

    @property
    def middle(self) -> np.ndarray:
        """Centre of pressure without overturning: O, up to rounding, if the arms are about the centroid."""
        if self.parts is not None:
            return centroid(self.parts)
        return self.areas @ self.normal_arms / self.areas.sum()

    def law(self, normal_force: float, centre: ArrayLike | None = None) -> Law:
        """Friction law for a normal force N (N) through ``centre`` (m, about O; None: the centroid of the area)."""
        e = self.middle if centre is None else np.asarray(centre, float)
        if self.parts is not None and not self.follows_pressure:
            return convex(self.parts, self.friction, normal_force, self.cohesion)
        if not distance_to_exit(self.hull, e, (0.0, 0.0)) >= 0.0:
            raise ScenarioError(
                f"the normal force acts at {tuple(e.tolist())} m, outside the joint: the block overturns"
            )
        if self.parts is None:
            forces = spring_forces(self.normal_arms, self.areas, normal_force, e)
            return points(self.shear_arms, forces, self.friction, self.cohesion * self.areas)
        if centre is not None:  # keep off the edge, see _EDGE
            out = e - self.middle
            reach = distance_to_exit(self.hull, self.middle, out)
            if reach < 1.0 / _EDGE[self.pressure]:
                e = self.middle + out * reach * _EDGE[self.pressure]
        if self.pressure == "effective":
            return convex(effective_polygon(self.parts, e), self.friction, normal_force)
        level, slope = pressure_plane(self.parts, normal_force, e)
        return linear_pressure(self.parts, self.friction, level, slope, e)


def point_formulation(
    normal_arms: ArrayLike,
    areas: ArrayLike,
    friction: float,
    shear_arms: ArrayLike | None = None,
    name: str = "points",
    cohesion: float = 0.0,
) -> Formulation:
    """Points with normal forces at ``normal_arms`` (n, 2) and slip at ``shear_arms`` (None: the same), areas (n,)."""
    normal_arms, areas = np.array(normal_arms, float), np.array(areas, float)
    shear_arms = normal_arms if shear_arms is None else np.array(shear_arms, float)
    if normal_arms.ndim != 2 or normal_arms.shape != shear_arms.shape or areas.shape != normal_arms.shape[:1]:
        raise ScenarioError("point arms must have shape (n, 2) and areas (n,), the same n for all")
    if not (np.all(areas > 0.0) and np.isfinite(normal_arms).all() and np.isfinite(shear_arms).all()):
        raise ScenarioError("point areas must be greater than 0 and arms finite")
    hull = convex_hull(normal_arms)
    return Formulation(name, friction, hull, normal_arms, shear_arms, areas, cohesion=cohesion)


def polygon_formulation(
    polygon: ArrayLike | Sequence[ArrayLike], friction: float, pressure: str = "full", cohesion: float = 0.0
) -> Formulation:
    """The convex formulation on a polygon, or on a union of polygons that do not overlap."""
    if pressure not in PRESSURES:
        raise ScenarioError(f"pressure = {pressure!r} is unknown: use one of {', '.join(PRESSURES)}")
    parts = as_parts(polygon)
    hull = convex_hull(np.concatenate(parts))
    return Formulation("convex", friction, hull, parts=parts, pressure=pressure, cohesion=cohesion)


def rectangle_formulation(
    name: str,
    a: float,
    b: float,
    friction: float,
    cohesion: float = 0.0,
    *,
    pressure: str = "full",
    cells: tuple[int, int] | None = None,
) -> Formulation:
    """One of :data:`FORMULATIONS` on a rectangle a (along x) by b (along y) about O.

    ``cells`` = (n, m) is for ``distributed`` only: points at the centres of n x m equal cells.
    """
    if not (np.isfinite([a, b]).all() and a > 0.0 and b > 0.0):
        raise ScenarioError(f"a joint of {a!r} x {b!r} m needs two finite edges greater than 0")
    corners = as_polygon(rectangle(a, b))
    if name == "convex":
        return polygon_formulation(corners, friction, pressure, cohesion)
    quarter = np.full(4, a * b / 4.0)
    if name == "concave":
        return point_formulation(corners, quarter, friction, name=name, cohesion=cohesion)
    if name in ("corrected", "corrected-shear"):
        reduced = rectangle(*reduced_dimensions(a, b))
        pressed = corners if name == "corrected-shear" else reduced
        return point_formulation(pressed, quarter, friction, reduced, name, cohesion)
    if name == "distributed":
        if cells is None:
            raise ScenarioError("distributed needs cells = (n, m): how many points along each edge")
        n, m = cells
        x, y = (np.arange(n) + 0.5) / n - 0.5, (np.arange(m) + 0.5) / m - 0.5
        arms = np.stack([grid.ravel() for grid in np.meshgrid(a * x, b * y, indexing="ij")], axis=1)
        return point_formulation(arms, np.full(n * m, a * b / (n * m)), friction, name=name, cohesion=cohesion)
    raise ScenarioError(f"formulation = {name!r} is unknown: use one of {', '.join(FORMULATIONS)}")


def formulation_law(
    name: str,
    a: float,
    b: float,
    friction: float,
    normal_force: float,
    cohesion: float = 0.0,
    *,
    centre: ArrayLike | None = None,
    pressure: str = "full",
    cells: tuple[int, int] | None = None,
) -> PolygonLaw | PointLaw:
    """Friction law of a formulation on a rectangle under N through ``centre`` (None: central); ``cohesion`` in Pa."""
    joint = rectangle_formulation(name, a, b, friction, cohesion, pressure=pressure, cells=cells)
    return joint.law(normal_force, centre)
