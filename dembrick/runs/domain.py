"""Yield domains of one joint by theory and by simulation, side by side, as rows for tables, files and plots.
For a joint with lasting cohesion, the directions are searched one after the other.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from dembrick import theory
from dembrick._ahead import compile_ahead
from dembrick.assembly import quadrature
from dembrick.errors import ScenarioError
from dembrick.geometry import polygons
from dembrick.runs.simulate import simulate
from dembrick.runs.theory_check import known_cohesion, wrench
from dembrick.scenario.blocks import Block, Prism
from dembrick.scenario.checks import nearest, present
from dembrick.scenario.controls import YieldControl
from dembrick.scenario.model import FORMULATIONS, PRESSURES, Actuator, JointLaw, Load, Material, Scenario
from dembrick.simulation.statics.batch import LimitLoads, face
from dembrick.simulation.statics.yield_domain import Fan, YieldDomain, actuators_for, directions, lever_of, yield_domain

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly


__all__ = ["DomainJoint", "Request", "by_simulation", "by_theory", "simulate_domain"]


@dataclass(frozen=True)
class DomainJoint:
    """Joint of a yield domain: ``polygon`` (m, 2) about its centroid along t1 and t2 (m),
    counter-clockwise; ``friction``; ``normal_force`` (N) through ``eccentricity`` (m, from the centroid); ``cohesion``
    (Pa), which the joint keeps as it slips."""

    polygon: np.ndarray
    friction: float
    normal_force: float
    eccentricity: tuple[float, float] = (0.0, 0.0)
    cohesion: float = 0.0

    def __post_init__(self):
        if not (math.isfinite(self.cohesion) and self.cohesion >= 0.0):
            raise ScenarioError(f"cohesion = {self.cohesion!r} is out of range: it must be finite and at least 0 Pa")
        for name, value in (("friction", self.friction), ("normal force", self.normal_force)):
            if not (math.isfinite(value) and value > 0.0):
                raise ScenarioError(f"{name} = {value!r} is out of range: a domain needs one greater than 0")
        place = np.array([self.eccentricity], float)
        # a joint of several pieces can carry N between them as well
        outside = float(polygons.distance_outside(place, theory.polygons.convex_hull(self.polygon))[0])
        if self.cohesion == 0.0 and not outside <= 1e-9 * float(np.abs(self.polygon).max()):
            raise ScenarioError(
                f"eccentricity = {tuple(place[0].tolist())} m lies {1e3 * outside:.4g} mm outside the joint, where N "
                "overturns the block: choose a point inside"
            )

    @staticmethod
    def rectangle(a: float, b: float, friction: float, normal_force: float, **options) -> DomainJoint:
        """A rectangle a (along t1) x b (along t2)."""
        for name, value in (("a", a), ("b", b)):
            if not (math.isfinite(value) and value > 0.0):
                raise ScenarioError(f"{name} = {value!r} is out of range: an edge must be longer than 0 m")
        return DomainJoint(theory.polygons.rectangle(a, b), friction, normal_force, **options)

    @staticmethod
    def from_corners(corners, friction: float, normal_force: float, **options) -> DomainJoint:
        """A convex polygon by its corners (m, 2), with any origin and orientation."""
        polygon = theory.polygons.as_polygon(corners)
        if not theory.polygons.is_convex(polygon):
            raise ScenarioError("the polygon is not convex, but a joint between two convex faces is")
        return DomainJoint(polygon - theory.polygons.centroid([polygon]), friction, normal_force, **options)

    @staticmethod
    def of_assembly(assembly: Assembly) -> DomainJoint:
        """The joint of a scene that has one, under its dead loads: N and eccentricity from statics."""
        if len(assembly.joints) != 1:
            raise ScenarioError(
                f"a domain belongs to one joint, but this scenario has {len(assembly.joints)}: give one with two blocks"
            )
        for key, found in (("[[ties]]", len(assembly.ties)), ("blocks.held", len(assembly.guided))):
            if found:
                raise ScenarioError(f"a domain belongs to a joint alone, but this scenario has {key}: leave it out")
        if not assembly.joint_force_exact:
            raise ScenarioError("a domain needs one free block on a fixed one, so that statics gives its N")
        joint = assembly.joints[0]
        free = joint.block_a if assembly.fixed[joint.block_b] else joint.block_b
        arm = joint.arm_a if free == joint.block_a else joint.arm_b
        sign = -1.0 if free == joint.block_a else 1.0
        load = sign * wrench(joint.axes, arm, assembly.dead_force[free], assembly.dead_torque[free])
        normal = -float(load[2])
        eccentricity = (float(load[4]) / normal, float(-load[3]) / normal) if normal > 0.0 else (0.0, 0.0)
        x, y = (0.0 if abs(e) < 1e-12 * np.abs(joint.polygon).max() else e for e in eccentricity)
        cohesion = known_cohesion(joint.law)
        if cohesion is None:
            raise ScenarioError(
                "a domain needs a joint that keeps its strength: residual_cohesion = cohesion, and no "
                "residual_friction, dilation or compressive_strength"
            )
        return DomainJoint(np.array(joint.polygon), joint.law.friction, normal, (x, y), cohesion)

    @property
    def edges(self) -> tuple[float, float] | None:
        """(a, b) of a rectangle along t1 and t2; None for another polygon."""
        a, b = (float(edge) for edge in np.ptp(self.polygon, axis=0))
        straight = len(self.polygon) == 4 and abs(polygons.area(self.polygon) - a * b) <= 1e-9 * a * b
        return (a, b) if straight else None

    @property
    def has_several_pieces(self) -> bool:
        """Whether the joint has several pieces, of blocks of several parts, here strung together into one outline."""
        return len(np.unique(self.polygon, axis=0)) < len(self.polygon)  # the outline passes through a corner twice

    def as_dict(self) -> dict:
        """As in the JSON output; a and b are null unless the joint is a rectangle."""
        a, b = self.edges or (None, None)
        return {
            "a": a,
            "b": b,
            "friction": self.friction,
            "normal_force": self.normal_force,
            "cohesion": self.cohesion,
            "polygon": self.polygon.tolist(),
            "eccentricity": list(self.eccentricity),
        }


@dataclass(frozen=True)
class Request:
    """Request for a domain: ``space`` and ``shear_angle`` as for ``yield_domain.directions``, ``height`` (m) of the
    load above the joint, ``pressure`` of the convex joint, ``points`` of ``distributed``, ``tolerance`` of replays."""

    space: str = "quarter"
    shear_angle: float = 90.0
    height: float = 0.0
    pressure: str = "full"
    points: tuple[int, int] | None = None
    tolerance: float = 1e-3

    def pressure_of(self, formulation: str) -> str:
        """Pressure of a formulation; "full" unless it has a choice."""
        return self.pressure if formulation == "convex" else "full"

    def points_of(self, formulation: str) -> tuple[int, int] | None:
        """Points of a formulation; None unless it has a choice."""
        return self.points if formulation == "distributed" else None


def _check(joint: DomainJoint, formulations: Sequence[str], request: Request) -> None:
    for name in formulations:
        if name not in FORMULATIONS:
            raise ScenarioError(f"unknown formulation {name!r}: {nearest(name, FORMULATIONS)}")
    if request.pressure not in PRESSURES:
        raise ScenarioError(f"unknown pressure {request.pressure!r}: {nearest(request.pressure, PRESSURES)}")
    known = joint.cohesion == 0.0 and set(formulations) == {"convex"} and request.pressure == "full"
    if joint.has_several_pieces and not known:
        raise ScenarioError(
            "the domain of a joint of several feet is known only for the convex formulation with full pressure, "
            "without cohesion: give --formulation convex without cohesion, or run the scenario for single limits"
        )


def _formulation(joint: DomainJoint, name: str, request: Request, continuum: bool) -> theory.Formulation:
    """Theory of the joint; with ``continuum`` a dry distributed one is the limit of infinitely many points."""
    if name == "convex" or (name == "distributed" and continuum and joint.cohesion == 0.0):
        pressure = request.pressure if name == "convex" else "linear"
        return theory.polygon_formulation(joint.polygon, joint.friction, pressure, joint.cohesion)
    law = JointLaw(name, joint.friction, 1.0, 1.0, points=request.points_of(name))
    arms = present(quadrature.contact_points(face(joint.polygon, law), request.tolerance))
    of_points = arms.normal_arm, arms.area, joint.friction, arms.shear_arm, name
    return theory.point_formulation(*of_points, joint.cohesion)


def _limits(joint: DomainJoint, formulation: theory.Formulation, load: np.ndarray, height: float) -> np.ndarray:
    """Limit multipliers (n,) of unit loads (n, 3) by theory."""
    e = joint.eccentricity
    if height == 0.0 or not formulation.follows_pressure:
        return theory.limit_loads(formulation.law(joint.normal_force, e), load).V
    return np.array(
        [theory.limit_load_at_height(formulation, joint.normal_force, f, height=height, centre=e).V for f in load]
    )


def by_theory(
    joint: DomainJoint, formulations: Sequence[str], count: int, request: Request | None = None
) -> list[dict]:
    """Points of the domain of each formulation; ``distributed`` is drawn as its limit, the no-tension continuum."""
    request = request or Request()
    _check(joint, formulations, request)
    load = directions(count, request.space, request.shear_angle) * [1.0, 1.0, lever_of(joint.polygon)]
    rows = []
    for name in formulations:
        V = _limits(joint, _formulation(joint, name, request, continuum=True), load, request.height)
        rows += [_row(name, "theory", point, None, request) for point in load * V[:, None]]
    return rows


def simulate_domain(
    polygon=None,
    *,
    a: float | None = None,
    b: float | None = None,
    friction: float,
    normal_force: float,
    formulation: str = "convex",
    count: int = 36,
    eccentricity: tuple[float, float] = (0.0, 0.0),
    cohesion: float = 0.0,
    threads: int | None = None,
    **request,
) -> YieldDomain:
    """The yield domain of a joint by simulation: a replay in each of ``count`` directions, all in one compiled call.

    The joint is a rectangle a x b or a convex ``polygon`` of corners (m, 2) in m; with lasting ``cohesion``
    (Pa) the directions are searched one after the other. ``request``: space, shear_angle, height, pressure, points,
    tolerance, see :class:`Request`. The result has ``points`` (V_1, V_2, M_T), the bracket
    of each in ``limits``, and ``convexity()`` and ``normality()``.
    """
    if (polygon is None) == (a is None or b is None):
        raise ScenarioError("a joint is given either by its polygon or by the edges a and b")
    options = {"eccentricity": tuple(eccentricity), "cohesion": cohesion}
    if polygon is None:
        joint = DomainJoint.rectangle(present(a), present(b), friction, normal_force, **options)
    else:
        joint = DomainJoint.from_corners(polygon, friction, normal_force, **options)
    return _simulated(joint, formulation, count, Request(**request), threads)


def _simulated(joint, formulation, count, request, threads=None, progress=None) -> YieldDomain:
    _check(joint, [formulation], request)
    if joint.cohesion > 0.0:
        return cohesive_yield_domain(joint, formulation, count, request, progress)
    return yield_domain(
        joint.polygon,
        formulation,
        friction=joint.friction,
        normal_force=joint.normal_force,
        eccentricity=joint.eccentricity,
        fan=Fan(count, request.space, request.shear_angle),
        height=request.height,
        pressure=request.pressure_of(formulation),
        points=request.points_of(formulation),
        tolerance=request.tolerance,
        threads=threads,
        progress=progress,
    )


def by_simulation(
    joint: DomainJoint,
    formulations: Sequence[str],
    count: int,
    request: Request | None = None,
    progress: Callable[[int, int, str], None] | None = None,
) -> tuple[list[dict], dict]:
    """Rows, one for each of ``count`` directions and each formulation, with bracket and error against theory; and
    checks of the domain of each formulation: convexity, normality, greatest error against theory."""
    request = request or Request()
    _check(joint, formulations, request)
    rows, checks = [], {}
    a, b = joint.edges or (None, None)
    other = [name for name in ("convex", "distributed", "concave") if name in formulations[1:]]
    for f, name in enumerate(formulations if count else ()):

        def report(done: int, of: int, f: int = f, name: str = name) -> None:
            if progress:
                progress(f * of + done, len(formulations) * of, name)

        with compile_ahead(lambda: [(_simulated, joint, one, 2, request) for one in other]):
            domain = _simulated(joint, name, count, request, progress=report)
        limits = domain.limits
        expected = _limits(joint, _formulation(joint, name, request, continuum=False), domain.load, request.height)
        error = limits.V / expected - 1.0
        for i, point in enumerate(domain.points):
            row = _row(name, "DEM", point, limits.half_width[i] * np.abs(domain.load[i]), request)
            # the load keeps its direction: all components have the same relative error
            shear = row["V"]
            row |= {"V_lower": float(shear * limits.V_lower[i] / limits.V[i])}
            row |= {"V_upper": float(shear * limits.V_upper[i] / limits.V[i])}
            row |= {"relative_half_width": float(limits.half_width[i] / limits.V[i])}
            row |= {"bracket": "certified" if limits.certified[i] else "indicator", "error_vs_theory": float(error[i])}
            row |= {"slip": limits.twist[i].tolist(), "N": joint.normal_force, "friction": joint.friction}
            rows.append(row | {"a": a, "b": b, "load_height": request.height, "cohesion": joint.cohesion})
        checks[name] = {
            "certified": domain.certified,
            "convexity": domain.convexity().as_dict(),
            "normality": domain.normality().as_dict(),
            "error_vs_theory": float(np.abs(error).max()),
        }
    return rows, checks


def _row(name: str, source: str, point, half: np.ndarray | None, request: Request) -> dict:
    """Row of a point; V is the size of the shear force, signed if ``space`` is "plane". ``half`` (3,): half widths of
    V_1, V_2 and M_T; None by theory."""
    V_1, V_2, M_T = (float(value) + 0.0 for value in point)
    turned = math.radians(request.shear_angle)
    V = math.hypot(V_1, V_2)
    if request.space == "plane" and V_1 * math.cos(turned) + V_2 * math.sin(turned) < 0.0:
        V = -V
    row = {"formulation": name, "pressure": request.pressure_of(name), "source": source}
    of_shear, of_torsion = (None, None) if half is None else (math.hypot(half[0], half[1]), float(half[2]))
    bars = {"half_width": of_shear, "M_T_half_width": of_torsion}
    return row | {"V": V, "M_T": M_T, "V_1": V_1, "V_2": V_2} | bars


STIFFNESS = 1e10  # Pa/m; a limit load does not depend on it


def cohesive_yield_domain(
    joint: DomainJoint, formulation: str, count: int, request: Request, progress: Callable[[int, int], None] | None
) -> YieldDomain:
    """As `simulation.statics.yield_domain.yield_domain`, of a ``joint`` with cohesion; brackets are indicators. Raises
    NotConvergedError if a direction has no answer."""
    polygon = joint.polygon
    law = JointLaw(
        formulation, joint.friction, STIFFNESS, 0.4 * STIFFNESS, request.points_of(formulation),
        request.pressure_of(formulation), joint.cohesion, residual_cohesion=joint.cohesion,
    )  # fmt: skip
    lever = lever_of(polygon)
    load = directions(count, request.space, request.shear_angle) * [1.0, 1.0, lever]
    point, direction, weight = actuators_for(load, 0.5 * lever, request.height)
    depth = max(float(np.ptp(polygon, axis=0).min()), 2.0 * abs(request.height))
    outline = Prism(tuple(map(tuple, polygon.tolist())), depth)
    scene = Scenario(
        title="yield domain",
        gravity=(0.0, 0.0, 0.0),
        joint=law,
        materials={"stone": Material(2000.0)},
        blocks=(
            Block("lower", "stone", prism=outline, position=(0.0, 0.0, -0.5 * depth), fixed=True),
            Block("upper", "stone", prism=outline, position=(0.0, 0.0, 0.5 * depth)),
        ),
        loads=(Load("upper", (0.0, 0.0, -joint.normal_force), (*joint.eccentricity, 0.0)),),
        control=YieldControl(request.tolerance),
    )
    found: list[tuple[Any, Any]] = []
    for i in range(count):
        actuators = tuple(
            Actuator(f"jack {k}", "upper", tuple(point[i, k]), tuple(direction[i, k]), float(weight[i, k]))
            for k in range(2)
            if abs(weight[i, k]) > 1e-12 * np.abs(weight[i]).max()
        )
        result = simulate(replace(scene, actuators=actuators), record=False, progress=False)
        found.append((result.yield_point, result.run))
        if progress:
            progress(i + 1, count)
    limits = LimitLoads(
        certified=np.zeros(count, bool),
        status=np.full(count, "yield"),
        twist=np.array([run.state.joints.step[0] for _, run in found]),
        tilt=np.array([run.state.joints.tilt[0] for _, run in found]),
        steps=np.array([run.steps for _, run in found]),
        **{
            name: np.array([present(getattr(one, name)) for one, _ in found])
            for name in ("V", "V_lower", "V_upper", "actuator_load", "N", "V_1", "V_2", "M_T")
        },
    )
    V_0 = float(law.cohesion * polygons.area(polygon) + law.friction * joint.normal_force)
    return YieldDomain(load, limits, request.space, V_0, lever)
