"""Limit loads of cases with a single joint, found together in compiled calls instead of one by one.

The limit load of two blocks with a joint is the same as in a separate run, but without record, history and comparison
with theory. A case that does not fit, or finds no answer here, is left to a separate run, which also reports the
error.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from dembrick.assembly import build as assemblies
from dembrick.assembly.actuators import recorded_curve
from dembrick.errors import ScenarioError
from dembrick.runs import theory_check
from dembrick.scenario.model import Scenario, Solver, YieldControl
from dembrick.simulation.mechanism import joint_mechanism
from dembrick.simulation.statics import batch

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly

_NUMBERS = ("V", "V_lower", "V_upper", "N", "V_1", "V_2", "M_T")
_NO_PUSH = 1e-12  # of the actuators' force times the joint's size: a smaller load counts as none


def fits(scenario: Scenario) -> bool:
    """Whether a case may be run with others: a limit load of one free block on a fixed one, with given points or by the
    area, with friction as the only strength, in the geometry of the start, with the default time step."""
    law = scenario.joint
    return (
        isinstance(scenario.control, YieldControl)
        and not scenario.control.large_displacements
        and len(scenario.all_blocks) == 2
        and sum(block.fixed for block in scenario.all_blocks) == 1
        and not any(block.held for block in scenario.all_blocks)
        and not scenario.joints
        and not scenario.ties
        and not scenario.stages
        and not scenario.supports
        and scenario.solver == Solver()
        and law.friction > 0.0
        and law.dry
        and (law.formulation != "distributed" or law.points is not None)
    )


def limit_loads(scenarios: Sequence[Scenario]) -> dict[int, dict[str, Any]]:
    """The results, by index, of those scenarios that fit and have an answer, with the keys of a run's JSON object.

    Never raises ScenarioError: errors of a scenario are raised by its separate run.
    """
    groups: dict[tuple, list[tuple[int, _Case]]] = {}
    for index, scenario in enumerate(scenarios):
        case, control = _case(scenario) if fits(scenario) else None, scenario.control
        if case is not None and isinstance(control, YieldControl):
            law = scenario.joint
            kind = (law.formulation, law.pressure, law.points, control.tolerance, len(case.weight))
            groups.setdefault(kind, []).append((index, case))
    results: dict[int, dict[str, Any]] = {}
    for (formulation, pressure, points, tolerance, _), group in groups.items():
        found = _run(formulation, pressure, points, tolerance, [case for _, case in group])
        results |= {group[i][0]: result for i, result in found.items()}
    return results


class _Case:
    """One joint under its loads, in its own axes about O."""

    def __init__(self, scenario: Scenario, assembly: Assembly):
        joint = assembly.joints[0]
        self.name = assembly.names[joint.block_b]
        b, arm, axes = joint.block_b, np.asarray(joint.arm_b), np.asarray(joint.axes)
        actuators = assembly.actuators
        self.load_unit = recorded_curve(scenario.control, actuators).unit
        self.polygon, self.law = np.asarray(joint.polygon), scenario.joint
        self.dead = theory_check.wrench(axes, arm, assembly.dead_force[b], assembly.dead_torque[b])
        self.point = (actuators.at.arm - arm) @ axes.T
        self.direction = actuators.direction @ axes.T
        self.weight = actuators.weight
        force = self.direction * self.weight[:, None]
        turn = abs(float(np.cross(self.point, force)[:, 2].sum()))
        self.reach = float(np.hypot(*self.polygon.T).max())
        pushing = float(np.hypot(*force.sum(axis=0)[:2])) * self.reach + turn
        self.sound = self.dead[2] < 0.0 and pushing > _NO_PUSH * float(np.abs(self.weight).sum()) * self.reach


def _case(scenario: Scenario) -> _Case | None:
    try:
        bare = _at_rest(_Geometry(scenario))
        if len(bare.joints) != 1 or bare.joints[0].pieces:  # points are placed piece by piece in a separate run
            return None
        case = _Case(scenario, assemblies.with_loads(scenario, bare, points=False))
    except ScenarioError:
        return None
    return case if case.sound else None


class _Geometry:
    """Cache key of the part of a scenario that determines its joints: equal parts give equal joints."""

    def __init__(self, scenario: Scenario):
        self.scenario = scenario
        densities = {name: material.density for name, material in scenario.materials.items()}
        self._key = (scenario.all_blocks, tuple(sorted(densities.items())), scenario.path)

    def __eq__(self, other) -> bool:
        return self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)


@lru_cache(maxsize=64)
def _at_rest(geometry: _Geometry):
    return assemblies.unloaded_assembly(geometry.scenario)


def _run(formulation: str, pressure: str, points, tolerance: float, cases: list[_Case]) -> dict[int, dict[str, Any]]:
    """The results of cases of one kind that have an answer, by their place in the list."""
    polygons: dict[bytes, int] = {}
    shape = np.array([polygons.setdefault(case.polygon.tobytes(), len(polygons)) for case in cases])
    corners = [np.frombuffer(polygon).reshape(-1, 2) for polygon in polygons]
    law = [case.law for case in cases]
    together = batch.Cases(
        formulation,
        corners,
        shape,
        friction=np.array([one.friction for one in law]),
        normal_stiffness=np.array([one.normal_stiffness for one in law]),
        shear_stiffness=np.array([one.shear_stiffness for one in law]),
        dead=np.array([case.dead for case in cases]),
        actuator_point=np.array([case.point for case in cases]),
        actuator_direction=np.array([case.direction for case in cases]),
        actuator_weight=np.array([case.weight for case in cases]),
        pressure=pressure,
        points=points,
        tolerance=tolerance,
    )
    began = time.perf_counter()
    found = batch.find_limit_loads(together, threads=1)
    seconds = (time.perf_counter() - began) / len(cases)
    # without a certified bracket, a separate run follows equilibria to another V within the tolerance
    answered = (found.status == "yield") & found.certified
    return {i: _result(found, i, case, seconds) for i, case in enumerate(cases) if answered[i]}


def _result(found: batch.LimitLoads, i: int, case: _Case, seconds: float) -> dict[str, Any]:
    """The JSON object of one case; its loop time is the mean of all cases run with it."""
    centre, how = joint_mechanism(found.twist[i], found.tilt[i], case.reach)
    numbers = {name: float(getattr(found, name)[i]) + 0.0 for name in _NUMBERS}
    bracket = "certified" if found.certified[i] else "indicator"
    point = {**numbers, "bracket": bracket, "torsion_centre": centre, "mechanism": how}
    known = {"path_dependent": False, "no_path_above": True, "associative": None, "blocks": [case.name]}
    cost = {"steps": int(found.steps[i]), "wall": {"loop": seconds}}
    return {"status": "yield", "yield_point": point, "load_unit": case.load_unit, **known, **cost}
