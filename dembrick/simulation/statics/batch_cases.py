"""Input of a batch of two-block scenes as arrays, in the axes of the joint, and its checks.

A case is a joint between a fixed and a free block with its dead load and its actuators, all about the joint's centroid
O.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dembrick.errors import ScenarioError
from dembrick.geometry import polygons
from dembrick.scenario.model import JointLaw

STIFF = 1e-6  # elastic closing and slip over the short side, if no stiffness is given: a numerical choice


@dataclass(frozen=True)
class Cases:
    """k two-block scenes of one formulation. SI units, joint axes (t1, t2, n) about O; forces act on the free block b.

    ``polygons``: the different joint polygons, each (m, 2) about its centroid, counter-clockwise, convex; ``shape``
    (k,): number of the polygon of each case. ``friction``, ``normal_stiffness``, ``shear_stiffness`` (k,). ``dead``
    (k, 6): force and moment of the dead load (pressing: dead[:, 2] < 0). ``actuator_point``, ``actuator_direction``
    (k, j, 3) and ``actuator_weight`` (k, j): the j actuators of each case; a height above the joint is
    actuator_point[..., 2]. ``tolerance``: relative half-width of the brackets. ``points``: (n, m) of ``distributed``,
    None for as many as the tolerance needs.
    """

    formulation: str
    polygons: Sequence[np.ndarray]
    shape: np.ndarray
    friction: np.ndarray
    normal_stiffness: np.ndarray
    shear_stiffness: np.ndarray
    dead: np.ndarray
    actuator_point: np.ndarray
    actuator_direction: np.ndarray
    actuator_weight: np.ndarray
    pressure: str = "full"
    points: tuple[int, int] | None = None
    tolerance: float = 1e-3

    @property
    def count(self) -> int:
        return len(self.shape)

    @classmethod
    def on(
        cls,
        polygons_,
        formulation: str,
        *,
        friction,
        normal_force,
        actuator_point,
        actuator_direction,
        actuator_weight=1.0,
        shape=0,
        eccentricity=(0.0, 0.0),
        dead_shear=(0.0, 0.0),
        normal_stiffness=None,
        shear_stiffness=None,
        **options,
    ) -> Cases:
        """Cases from arguments that broadcast to k: numbers, or arrays with k rows.

        ``polygons_`` is one polygon (m, 2) or a list of them. N acts at ``eccentricity`` (..., 2), ``dead_shear`` (...,
        2) is a tangential dead force at O. ``actuator_point`` and ``actuator_direction`` (j, 3) or (k, j, 3). Without
        stiffnesses the joint is so stiff that it closes and slips by a millionth of its short side.
        """
        single = np.ndim(polygons_[0]) == 2
        shapes = [np.ascontiguousarray(p, float) for p in (polygons_ if single else [polygons_])]
        point, direction = (np.asarray(v, float) for v in (actuator_point, actuator_direction))
        weight = np.asarray(actuator_weight, float)
        k = np.broadcast_shapes(
            *(np.shape(v) for v in (shape, friction, normal_force)),
            *(np.shape(v)[:-1] for v in (eccentricity, dead_shear)),
            *(v.shape[:-2] for v in (point, direction)),
            weight.shape[:-1],
        )
        k = k if k else (1,)
        each = np.broadcast_shapes(point.shape[-2:-1], direction.shape[-2:-1], weight.shape[-1:])
        shape = np.broadcast_to(np.asarray(shape, np.int64), k)
        N, mu = (np.broadcast_to(np.asarray(v, float), k) for v in (normal_force, friction))
        e, shear = (np.broadcast_to(np.asarray(v, float), (*k, 2)) for v in (eccentricity, dead_shear))
        dead = np.zeros((*k, 6))
        dead[:, :2], dead[:, 2] = shear, -N
        dead[:, 3], dead[:, 4] = -N * e[:, 1], N * e[:, 0]
        stiff = np.array([1.0 / (polygons.area(p) * STIFF * polygons.width(p)) for p in shapes])[shape]
        kn = N * stiff if normal_stiffness is None else np.broadcast_to(np.asarray(normal_stiffness, float), k)
        ks = np.maximum(mu, 1.0) * N * stiff if shear_stiffness is None else np.broadcast_to(shear_stiffness, k)
        length = np.sqrt((direction**2).sum(axis=-1, keepdims=True))
        return cls(
            formulation, shapes, shape, mu, kn, np.asarray(ks, float), dead,
            np.broadcast_to(point, (*k, *each, 3)), np.broadcast_to(direction / length, (*k, *each, 3)),
            np.broadcast_to(weight, (*k, *each)), **options,
        )  # fmt: skip

    def part(self, first: int, last: int) -> Cases:
        s = slice(first, last)
        rows = ("shape", "friction", "normal_stiffness", "shear_stiffness", "dead")
        rows += ("actuator_point", "actuator_direction", "actuator_weight")
        fields = {name: getattr(self, name) for name in self.__dataclass_fields__}
        return Cases(**(fields | {name: fields[name][s] for name in rows}))


def wrench(cases: Cases) -> np.ndarray:
    """Force and moment (k, 6) of the actuators for V = 1 about O."""
    force = cases.actuator_direction * cases.actuator_weight[:, :, None]
    return np.concatenate([force.sum(1), np.cross(cases.actuator_point, force).sum(1)], axis=1)


def check(cases: Cases) -> None:
    """Raise ScenarioError for invalid cases: shapes, signs, a load that does not push along the joint."""

    def require(condition, what: str, bound: str) -> None:
        bad = np.flatnonzero(~np.asarray(condition))
        if len(bad):
            raise ScenarioError(f"case {int(bad[0])}: {what} is out of range: {bound}")

    if not cases.count:
        raise ScenarioError("there are no cases: give at least one")
    if not 1e-8 <= cases.tolerance <= 0.1:
        raise ScenarioError(f"tolerance = {cases.tolerance!r} is out of range: it is a relative error from 1e-8 to 0.1")
    JointLaw(cases.formulation, 0.0, 1.0, 1.0, points=cases.points, pressure=cases.pressure)  # checks the names
    rows = np.isfinite(cases.dead).all(1) & np.isfinite(cases.actuator_point).all((1, 2))
    rows &= np.isfinite(cases.actuator_direction).all((1, 2)) & np.isfinite(cases.actuator_weight).all(1)
    require(rows, "a load or an actuator", "it must be made of finite numbers, and no direction may be 0")
    require(np.isfinite(cases.friction) & (cases.friction >= 0.0), "friction", "it must be at least 0")
    for name in ("normal_stiffness", "shear_stiffness"):
        value = getattr(cases, name)
        require(np.isfinite(value) & (value > 0.0), name, "it must be greater than 0 Pa/m")
    require(cases.dead[:, 2] < 0.0, "the dead load", "it must press the joint (N greater than 0)")
    for i, polygon in enumerate(cases.polygons):
        _check_polygon(i, polygon)
    unit = wrench(cases)
    reach = np.array([np.hypot(*p.T).max() for p in cases.polygons])[cases.shape]
    pushing = np.hypot(unit[:, 0], unit[:, 1]) * reach + np.abs(unit[:, 5])
    most = np.abs(cases.actuator_weight).sum(1) * reach
    require(
        pushing > 1e-12 * most,
        "the load of the actuators",
        "it must have a force along the joint or a torque about its normal",
    )


def _check_polygon(i: int, polygon: np.ndarray) -> None:
    where = f"polygon {i}"
    if polygon.ndim != 2 or polygon.shape[1] != 2 or len(polygon) < 3 or not np.isfinite(polygon).all():
        raise ScenarioError(f"{where} needs at least three corners (x, y) of finite numbers")
    edges = np.roll(polygon, -1, axis=0) - polygon
    turns = edges[:, 0] * np.roll(edges[:, 1], -1) - edges[:, 1] * np.roll(edges[:, 0], -1)
    size = float(np.ptp(polygon, axis=0).max())
    if not (turns > 1e-12 * size * size).all():
        raise ScenarioError(
            f"{where} is not convex, runs clockwise, or has a corner on the line of its neighbours: list the corners "
            "of a convex polygon counter-clockwise, each once"
        )
    _, x, y = polygons.area_and_centroid([tuple(corner) for corner in polygon.tolist()])
    if np.hypot(x, y) > 1e-9 * size:
        raise ScenarioError(
            f"{where} must have its centroid at the origin, but it lies at ({x:.6g}, {y:.6g}) m: shift the polygon"
        )
