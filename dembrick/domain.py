"""Yield domains of one rectangular joint in the plane of V (along b) and M_T, by theory and by simulation."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from dembrick import theory
from dembrick.errors import ScenarioError
from dembrick.model import FORMULATIONS, Actuator, Block, JointLaw, Load, Material, Scenario, YieldControl
from dembrick.result import simulate

STIFF = 1e-6  # elastic closing and slip over the short side of the joints made here: a numerical choice
DENSITY = 1500.0  # kg/m3, of blocks whose weight is balanced away; no yield point depends on it


class JointOfInterest(NamedTuple):
    """Joint a x b (m) with friction coefficient ``friction`` under ``normal_force`` (N)."""

    a: float
    b: float
    friction: float
    normal_force: float


def _check(joint: JointOfInterest, formulations: Sequence[str]) -> None:
    for name, value in zip(("--a", "--b", "--N"), (joint.a, joint.b, joint.normal_force), strict=True):
        if not (math.isfinite(value) and value > 0.0):
            raise ScenarioError(f"{name} = {value!r} is out of range: it must be greater than 0")
    if not (math.isfinite(joint.friction) and joint.friction > 0.0):
        raise ScenarioError(f"--mu = {joint.friction!r} is out of range: a domain needs friction greater than 0")
    for name in formulations:
        if name not in FORMULATIONS:
            raise ScenarioError(f"unknown formulation {name!r}: use {', '.join(FORMULATIONS)}")


def by_theory(joint: JointOfInterest, formulations: Sequence[str], count: int) -> list[dict]:
    """Points of the curve M_T(V) of each formulation; ``distributed`` is drawn as its limit, the convex joint."""
    _check(joint, formulations)
    if count < 2:
        raise ScenarioError(f"--points = {count} is out of range: a curve needs at least 2")
    rows = []
    for name in formulations:
        law = theory.formulation_law(
            "convex" if name == "distributed" else name, joint.a, joint.b, joint.friction, joint.normal_force
        )
        for i in range(count):
            V, M_T = _direction(joint, 0.5 * math.pi * i / (count - 1))
            limit = theory.limit_load(law, (0.0, V, M_T)).V
            rows.append(_row(name, "theory", limit * V, limit * M_T, None))
    return rows


def _direction(joint: JointOfInterest, angle: float) -> tuple[float, float]:
    """Unit load (N, N m) at ``angle`` from pure shear to pure torsion, scaled with the joint."""
    lever = theory.equations.torsion_parameter(joint.a, joint.b)
    V, M_T = math.cos(angle), math.sin(angle) * float(lever)
    return (V if abs(V) > 1e-15 else 0.0), (M_T if angle else 0.0)


def by_simulation(
    joint: JointOfInterest,
    formulations: Sequence[str],
    count: int,
    tolerance: float,
    progress: Callable[[int, int, str], None] | None = None,
) -> list[dict]:
    """A replay of its own for each of ``count`` directions and each formulation, with the bracket of each."""
    _check(joint, formulations)
    if count < 0 or count == 1:
        raise ScenarioError(f"--simulate = {count} is out of range: use 0, or at least 2 directions")
    rows = []
    for f, name in enumerate(formulations):
        for i in range(count):
            if progress:
                progress(f * count + i, len(formulations) * count, name)
            V, M_T = _direction(joint, 0.5 * math.pi * i / (count - 1))
            point = simulate(_scenario(joint, name, V, M_T, tolerance), record=False).yield_point
            # the load keeps its direction: both components carry the same relative error
            row = _row(name, "DEM", point.V * V, point.V * M_T, point.half_width)
            row |= {"V_lower": point.V_lower * V, "V_upper": point.V_upper * V, "bracket": point.bracket}
            row |= {"V_1": 0.0, "V_2": point.V * V, "N": joint.normal_force, "friction": joint.friction}
            rows.append(row | {"a": joint.a, "b": joint.b})
    if progress and count:
        progress(len(formulations) * count, len(formulations) * count, "")
    return rows


def _row(name: str, source: str, V: float, M_T: float, half: float | None) -> dict:
    return {"formulation": name, "source": source, "V": V, "M_T": M_T, "half_width": half}


def _scenario(joint: JointOfInterest, formulation: str, V: float, M_T: float, tolerance: float) -> Scenario:
    """Two blocks a x b with the joint between them; two jacks along b that together are the unit load (V, M_T)."""
    a, b, mu, N = joint
    height = min(a, b)
    law = JointLaw(
        formulation,
        mu,
        normal_stiffness=N / (a * b * STIFF * min(a, b)),
        shear_stiffness=max(mu, 1.0) * N / (a * b * STIFF * min(a, b)),
    )
    arm = 0.25 * a
    jacks = []
    for sign in (1.0, -1.0):
        weight = 0.5 * V + sign * 0.5 * M_T / arm
        if weight:
            jacks.append(Actuator(f"jack{len(jacks) + 1}", "upper", (sign * arm, 0.0, 0.0), (0.0, 1.0, 0.0), weight))
    return Scenario(
        title=f"{formulation}, direction V = {V:.4g}, M_T = {M_T:.4g}",
        gravity=(0.0, 0.0, 0.0),
        joint=law,
        materials={"stone": Material(DENSITY)},
        blocks=(
            Block("lower", "stone", (a, b, height), (0.0, 0.0, -0.5 * height), fixed=True),
            Block("upper", "stone", (a, b, height), (0.0, 0.0, 0.5 * height)),
        ),
        loads=(Load("upper", (0.0, 0.0, -N)),),
        actuators=tuple(jacks),
        control=YieldControl(tolerance),
    )
