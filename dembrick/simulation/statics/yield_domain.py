"""A joint's yield domain in the space of V_1, V_2 and M_T by simulation: one replay from rest in each direction.

The set of loads that a joint carries at fixed normal forces is convex, and its slip is normal to it (limit analysis;
friction without dilatancy is associated in this space). A replay assumes neither, so both are checked on its results,
each as one number with a tolerance that follows from the error bars of the points.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dembrick.errors import NotConvergedError, ScenarioError
from dembrick.geometry import polygons
from dembrick.simulation.statics import batch

SPACES = ("quarter", "plane", "all")
_NEIGHBOURS = 10  # directions around each, from which the cones of the test of convexity are formed
_ROUNDING = 1e-9  # of a load
_TURN = (3.0 - 5.0**0.5) * np.pi  # golden angle


@dataclass(frozen=True)
class Check:
    """A defect that should be zero, and its tolerance from the error bars of the points (both relative)."""

    value: float
    tolerance: float

    @property
    def holds(self) -> bool:
        """Whether the defect is within its tolerance."""
        return self.value <= self.tolerance

    def as_dict(self) -> dict:
        return {"value": self.value, "tolerance": self.tolerance, "holds": self.holds}


@dataclass(frozen=True)
class YieldDomain:
    """n points of the boundary of a yield domain. SI units, joint axes, moments about O.

    ``load`` (n, 3): unit loads (V_1, V_2, M_T); ``limits``: results of the replays, whose V multiplies these loads.
    ``space`` is that of :func:`directions`. ``V_0`` (N) and ``lever`` (m), the mean distance of the corners, scale the
    space to numbers of order one.
    """

    load: np.ndarray
    limits: batch.LimitLoads
    space: str
    V_0: float
    lever: float

    @property
    def points(self) -> np.ndarray:
        """(V_1, V_2, M_T) (n, 3) at the limit."""
        return self.load * self.limits.V[:, None]

    @property
    def certified(self) -> bool:
        """Whether every bracket is strict: the normal forces do not depend on the loads."""
        return bool(self.limits.certified.all())

    @property
    def error_bar(self) -> float:
        """Greatest half-width of a bracket over its V."""
        return float((self.limits.half_width / self.limits.V).max())

    @property
    def _allowed(self) -> float:
        """Tolerance on the ratio of two points: one too low and the other too high by its error bar, and rounding."""
        return 2.0 * self.error_bar / (1.0 - self.error_bar) + _ROUNDING

    @property
    def _scaled(self) -> np.ndarray:
        return self.points / (self.V_0 * np.array([1.0, 1.0, self.lever]))

    def convexity(self) -> Check:
        """Greatest part by which a point lies inside the plane (in 2D: the line) through points around it.

        If P is the point and P_i are others whose cone contains it, P = sum of c_i P_i with c_i >= 0, and a convex set
        has sum c_i >= 1. All cones of the nearest directions are tried. A star-shaped surface that is locally convex
        everywhere is convex.
        """
        P = self._scaled
        return Check(float(max(0.0, 1.0 - _least_sum(P, 3 if self.space == "all" else 2))), self._allowed)

    def normality(self) -> Check:
        """Greatest part by which a point does more work on the slip of another point than that point itself.

        If the slip q_i at P_i is normal to a convex set, q_i.P is greatest at P_i (maximum dissipation), so
        q_i.P_j / q_i.P_i - 1 is at most zero.
        """
        P = self.points
        q = self.limits.twist
        work = q @ P.T
        own = np.einsum("ij,ij->i", q, P)
        if not (own > 0.0).all():
            return Check(np.inf, self._allowed)
        return Check(float(max(0.0, (work / own[:, None]).max() - 1.0)), self._allowed)


def _least_sum(P: np.ndarray, dimension: int) -> float:
    """Least sum of the coefficients of any point in cones of its neighbours that contain it; at least 1 if convex."""
    if dimension == 2:
        # the plane of the points: an orthonormal pair by singular values
        P = P @ np.linalg.svd(P, full_matrices=False)[2][:2].T
    u = P / np.linalg.norm(P, axis=1, keepdims=True)
    near = np.argsort(-(u @ u.T), axis=1, kind="stable")[:, 1 : _NEIGHBOURS + 1]
    chosen = np.array(list(itertools.combinations(range(near.shape[1]), dimension)), int).reshape(-1, dimension).T
    least = np.inf
    for i, others in enumerate(near):
        cones = np.stack([P[others[k]] for k in chosen], axis=-1)
        sound = np.abs(np.linalg.det(cones)) > 1e-9
        c = np.linalg.solve(cones[sound], np.broadcast_to(P[i][:, None], (int(sound.sum()), dimension, 1)))[..., 0]
        held = (c >= 0.0).all(axis=1)
        if held.any():
            least = min(least, float(c[held].sum(axis=1).min()))
    return min(least, 1.0) if least < np.inf else 1.0


def directions(count: int, space: str, shear_angle: float = 90.0) -> np.ndarray:
    """Directions (n, 3) of (V_1, V_2, M_T / lever), unit vectors.

    "quarter": from pure shear to pure torsion, equally spaced; "plane": all the way round; both with the shear at
    ``shear_angle`` degrees from t1. "all": evenly over the sphere, on a spiral of golden angles.
    """
    if space not in SPACES:
        raise ScenarioError(f"space = {space!r} is unknown: use one of {', '.join(SPACES)}")
    least = {"quarter": 2, "plane": 3, "all": 4}[space]
    if count < least:
        raise ScenarioError(f"{count} directions are too few: space = {space!r} takes at least {least}")
    if space == "all":
        z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
        turn, rim = _TURN * np.arange(count), np.sqrt(1.0 - z * z)
        return np.stack([rim * np.cos(turn), rim * np.sin(turn), z], axis=1)
    angle = np.linspace(0.0, 0.5 * np.pi, count) if space == "quarter" else 2.0 * np.pi * np.arange(count) / count
    shear, torsion = np.cos(angle), np.sin(angle)
    turned = np.radians(shear_angle)
    found = np.stack([shear * np.cos(turned), shear * np.sin(turned), torsion], axis=1)
    found[np.abs(found) < 1e-15] = 0.0
    return found


def lever_of(polygon: np.ndarray) -> float:
    """Mean distance (m) of the corners of a joint from O, by tributary area."""
    return float(np.average(np.hypot(*polygon.T), weights=polygons.tributary_areas(polygon)))


def actuators_for(load: np.ndarray, lever: float, height: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Two parallel actuators for each unit load (n, 3), ``lever`` (m) to either side of O: point, direction, weight."""
    force = np.hypot(load[:, 0], load[:, 1])
    along = np.where(force[:, None] > 0.0, load[:, :2], [0.0, 1.0])
    along /= np.hypot(along[:, 0], along[:, 1])[:, None]
    side = lever * np.stack([along[:, 1], -along[:, 0]], axis=1)
    point = np.stack([side, -side], axis=1)
    point = np.concatenate([point, np.full((*point.shape[:2], 1), height)], axis=2)
    direction = np.concatenate([along, np.zeros((len(load), 1))], axis=1)[:, None]
    turning = load[:, 2] / lever
    return point, np.repeat(direction, 2, axis=1), 0.5 * np.stack([force + turning, force - turning], axis=1)


class Fan(NamedTuple):
    """The :func:`directions` of (V_1, V_2, M_T) in which a domain is computed."""

    count: int
    space: str = "quarter"
    shear_angle: float = 90.0  # degrees, of V in a quarter


def yield_domain(
    polygon,
    formulation: str,
    *,
    friction: float,
    normal_force: float,
    fan: Fan,
    height: float = 0.0,
    eccentricity=(0.0, 0.0),
    pressure: str = "full",
    points: tuple[int, int] | None = None,
    tolerance: float = 1e-3,
    threads: int | None = None,
    progress=None,
) -> YieldDomain:
    """Replays in the :func:`directions` of a ``fan`` on a joint ``polygon`` (m, 2) about its centroid.

    N acts at ``eccentricity`` (m, about O), the actuators ``height`` (m) above the joint. Raises ScenarioError for
    invalid input, NotConvergedError if no limit load is found in a direction.
    """
    polygon = np.asarray(polygon, float)
    if not (np.isfinite([friction, normal_force]).all() and friction > 0.0 and normal_force > 0.0):
        raise ScenarioError(
            f"friction = {friction!r} with normal_force = {normal_force!r} N gives no domain: both must be greater "
            "than 0"
        )
    lever = lever_of(polygon)
    load = directions(*fan) * [1.0, 1.0, lever]
    point, direction, weight = actuators_for(load, 0.5 * lever, height)
    cases = batch.Cases.on(
        polygon, formulation, friction=friction, normal_force=normal_force, eccentricity=eccentricity,
        actuator_point=point, actuator_direction=direction, actuator_weight=weight, pressure=pressure, points=points,
        tolerance=tolerance,
    )  # fmt: skip
    limits = batch.find_limit_loads(cases, threads, progress)
    bad = np.flatnonzero(limits.status != "yield")
    if len(bad):
        i = int(bad[0])
        raise NotConvergedError(
            f"{formulation}: the test in the direction (V_1, V_2, M_T) = {tuple(load[i].tolist())} ended as "
            f"{limits.status[i]} after {limits.steps[i]} steps, and so did {len(bad) - 1} more of {fan.count}: allow "
            "a larger tolerance, or check that the normal force acts inside the joint"
        )
    return YieldDomain(load, limits, fan.space, friction * normal_force, lever)
