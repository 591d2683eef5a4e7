"""Whether the bracket of a scene is strict, and what the compiled loop needs to form it."""

from __future__ import annotations

import numpy as np

from dembrick.kernels.statics.certify import Basis, at_joint, certify
from dembrick.kernels.statics.load_bounds import NEVER, Certificate
from dembrick.simulation.statics import joint_families
from dembrick.simulation.statics.state import State

WINDOW = 32  # steps over which an indicator must hold still
CAUTION = 0.5  # an indicator must be this much narrower than asked: what still drifts is not in it


def certificate(state: State, load: np.ndarray, elastic: float, tolerance: float) -> Certificate:
    """The certificate of a dead-load equilibrium for the unit load (n, 6) of the actuators.

    ``elastic`` (N/m) is the elastic stiffness of V against the driven displacement.

    Strict where the scene has one joint, and its friction does not depend on the load: point forces while the load
    neither presses nor tilts the joint, the full pressure of a convex joint while it does not press, and slides before
    it could overturn; the pressures of a convex joint that follow the bending like points. Never with bonds, which may
    break one after another, nor with a law of the user's own. A tolerance of 0 never ends a run.
    """
    parts = {
        "strict": False,
        "joint": 0,
        "family": 0,
        "index": 0,
        "unit": np.zeros(3),
        "dead": np.zeros(3),
        "dead_gauge": 0.0,
        "centre": np.zeros(2),
        "radius": 1.0,
        "normal": 0.0,
        "rest": np.zeros(1),
        "tilts": True,
    }
    alone = len(state.joints.block_a) == 1 and state.ties is None and not len(state.blocks.guided)
    if alone and not joint_families.has_strengths(state) and not joint_families.is_custom(state):
        parts |= _single_joint(state, load)
    return Certificate(
        every=1,
        **parts,
        tolerance=tolerance if parts["strict"] else CAUTION * tolerance,
        bracket=np.array([0.0, NEVER]),
        elastic=elastic,
        doubling=np.zeros(6),
        twist=np.zeros(3),
        window=np.tile([0.0, NEVER, 0.0, 0.0], (WINDOW, 1)),
    )


def frictionless(state: State, certificate: Certificate) -> bool:
    """Whether the one joint has no friction and the load asks for some: the limit load is zero."""
    if len(state.joints.block_a) != 1 or joint_families.has_strengths(state):
        return False
    return float(joint_families.friction(state)[0]) == 0.0 and bool(np.any(certificate.unit))


def _single_joint(state: State, load: np.ndarray) -> dict:
    joints, points, areas = state.joints, state.points, state.areas
    b = joints.block_b[0]
    basis = Basis(
        unit=np.zeros(3),
        dead=np.zeros(3),
        centre=np.zeros(2),
        rest=np.zeros(max(1, joint_families.contact_points(state))),
        scalars=np.zeros(5),
        twist=np.zeros(3),
        across=np.zeros(6),
    )
    unit, dead = np.zeros(6), np.zeros(6)
    at_joint(joints, 0, np.ascontiguousarray(load[b]), unit)
    at_joint(joints, 0, np.concatenate([state.blocks.dead_force[b], state.blocks.dead_torque[b]]), dead)
    certify(joints, points, areas, unit, dead, basis)
    strict, dead_gauge, radius, normal, tilts = (float(value) for value in basis.scalars)
    return {
        "strict": strict == 1.0,
        "family": joint_families.number(state),
        "unit": basis.unit,
        "dead": basis.dead,
        "dead_gauge": dead_gauge,
        "centre": basis.centre,
        "radius": radius,
        "normal": normal,
        "rest": basis.rest,
        "tilts": tilts == 1.0,
    }
