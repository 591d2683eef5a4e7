"""Limit loads by theory, to compare with: from the undeformed geometry and N by statics, independent of a run.

The engine and the search for the yield point do not use them; the comparison comes afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from dembrick import theory
from dembrick.errors import NotConvergedError

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.scenario.joint_laws import JointLaw

_NONE = 1e-12


@dataclass(frozen=True)
class Theory:
    """Limit load ``V`` (N) by theory, the run's relative ``error`` against it (None before a run, or if theory is
    zero), and how far the points of a joint are from the continuum that they stand for (``discretisation_error``,
    relative; None if they stand for none)."""

    V: float
    error: float | None
    discretisation_error: float | None

    def compared(self, V: float) -> Theory:
        """A copy with the relative error of ``V``; None if theory is zero and ``V`` is not."""
        error = (V / self.V - 1.0) if self.V else (0.0 if V == 0.0 else None)
        return replace(self, error=error)


def wrench(axes, arm, force, torque) -> np.ndarray:
    """V_1, V_2, V_n, M_1, M_2, M_T about O in the joint's axes, of a force and torque at a centroid; ``arm``: to O."""
    return np.concatenate([axes @ force, axes @ (torque - np.cross(arm, force))])


def known_cohesion(law: JointLaw, after_slip: bool = False) -> float | None:
    """Cohesion (Pa) of a joint that theory covers: one that keeps its strength as it slips, or, before slip, one with a
    single bond over all of its area; None for others, which break point by point, dilate or crush."""
    if law.dilation > 0.0 or law.compressive_strength is not None:
        return None
    keeps = law.cohesion_after == law.cohesion and law.friction_after == law.friction
    return law.cohesion if keeps or (law.formulation == "convex" and not after_slip) else None


def _continuum(polygon, friction: float, cohesion: float, normal: float, centre: np.ndarray):
    """The continuum that the points of a joint stand for: its formulation, N and the centre of pressure.

    A bonded joint that stays closed bears c + mu p everywhere, as a dry one does under the pressure p + c / mu.
    """
    if friction == 0.0:
        return theory.polygon_formulation(polygon, 0.0, "full", cohesion), normal, centre
    formulation = theory.polygon_formulation(polygon, friction, "linear")
    pressed = normal + cohesion * formulation.area / friction
    return formulation, pressed, formulation.middle + (centre - formulation.middle) * normal / pressed


def theory_of(assembly: Assembly, after_slip: bool = False) -> Theory | None:
    """The limit load of the scenario by theory, or None if no theory holds: more than one joint, a joint that dilates,
    crushes, tears open or breaks point by point, a law of the user's own, ties, a load that changes the normal force,
    or a continuum whose pressure is not found. ``after_slip``: for a joint that may have slipped already."""
    if assembly.custom_law is not None:
        return None
    if len(assembly.joints) != 1 or len(assembly.ties) or assembly.supporting.sum() != 1 or len(assembly.names) != 2:
        return None
    joint = assembly.joints[0]
    law, polygon = joint.law, joint.pieces or joint.polygon
    cohesion = known_cohesion(law, after_slip)
    if cohesion is None:
        return None
    b = joint.block_b
    arm = np.asarray(joint.arm_b)
    dead = wrench(joint.axes, arm, assembly.dead_force[b], assembly.dead_torque[b])
    unit = np.zeros(6)
    actuators = assembly.actuators
    for lever, direction, weight in zip(actuators.at.arm, actuators.direction, actuators.weight, strict=True):
        force = weight * np.asarray(direction)
        unit += wrench(joint.axes, arm, force, np.cross(lever, force))
    reach = float(np.abs(joint.polygon).max())
    size = max(float(np.abs(unit[:2]).max()), abs(unit[5]) / reach)
    if abs(unit[2]) > _NONE * max(size, abs(unit[2])) or not size > 0.0:
        return None
    unit[np.abs(unit) < _NONE * size * np.array([1, 1, 1, reach, reach, reach])] = 0.0
    normal = -dead[2]
    if not normal > 0.0:
        return None
    if law.friction == 0.0 and cohesion == 0.0:
        return Theory(0.0, None, 0.0 if law.formulation == "distributed" else None)
    # a moment about t1 presses towards -t2, one about t2 towards +t1
    centre = np.array([dead[4], -dead[3]]) / normal
    overturning = np.array([unit[4], -unit[3]])
    load, tangential = unit[[0, 1, 5]], dead[[0, 1, 5]]

    def limit(formulation: theory.Formulation, pressed: float = normal, at: np.ndarray = centre) -> float:
        return theory.limit_load_at_height(
            formulation, pressed, load, overturning=overturning, dead_load=tangential, centre=at
        ).V

    points = assembly.contact_points[0]
    if law.formulation == "convex":
        formulation = theory.polygon_formulation(polygon, law.friction, law.pressure, cohesion)
    else:
        arms = points.normal_arm, points.area
        formulation = theory.point_formulation(*arms, law.friction, points.shear_arm, law.formulation, cohesion)
    V = limit(formulation)
    if not law.dry and V > theory.closed_until(formulation, normal, centre, overturning):
        return None  # a joint that opens before that loses its bond, or is held by it
    gap = None
    if law.formulation == "distributed":
        try:
            gap = V / limit(*_continuum(polygon, law.friction, cohesion, normal, centre)) - 1.0
        except NotConvergedError:  # the discretisation error is not known: no theory, rather than no gap
            return None
    return Theory(V, None, gap)
