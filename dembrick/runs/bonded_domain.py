"""Yield domain of a joint with cohesion that it keeps: a search in each direction, one after the other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from dembrick.geometry import polygons
from dembrick.runs.simulate import simulate
from dembrick.scenario.blocks import Block, Prism
from dembrick.scenario.checks import present
from dembrick.scenario.controls import YieldControl
from dembrick.scenario.model import Actuator, JointLaw, Load, Material, Scenario
from dembrick.simulation.statics.batch import LimitLoads
from dembrick.simulation.statics.yield_domain import YieldDomain, actuators_for, directions, lever_of

if TYPE_CHECKING:
    from dembrick.runs.domain import DomainJoint, Request

STIFFNESS = 1e10  # Pa/m; a limit load does not depend on it


def yield_domain(
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
