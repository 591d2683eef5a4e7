"""Whether the bracket of a scene is strict, and what the compiled loop needs to form it."""

from __future__ import annotations

import numpy as np

from dembrick import limit_set
from dembrick.kernels.bracket import NEVER, Certificate
from dembrick.kernels.limit_surface import gauge
from dembrick.simulation import State

WINDOW = 16  # steps over which an indicator must hold still
CAUTION = 0.5  # an indicator must be this much narrower than asked: what still drifts is not in it
_NONE = 1e-12  # of the load: a component that is rounding


def certificate(state: State, load: np.ndarray, elastic: float, tolerance: float) -> Certificate:
    """The certificate of a seated state for the unit load (n, 6) of the jacks.

    ``elastic`` (N/m) is the elastic stiffness of V against the driven displacement.

    Strict where the scene has one joint, and its friction does not depend on the load: point forces while the load
    neither presses nor tilts the joint, the full pressure of a convex joint while it does not press, and slides before
    it could overturn; the pressures of a convex joint that follow the bending like points. A tolerance of 0 never ends
    a run.
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
    }
    if len(state.joints.block_a) == 1:
        parts |= _single_joint(state, load)
    return Certificate(
        every=1,
        **parts,
        tolerance=tolerance if parts["strict"] else CAUTION * tolerance,
        bracket=np.array([0.0, NEVER]),
        elastic=elastic,
        doubling=np.zeros(4),
        window=empty_window(WINDOW),
    )


def empty_window(steps: int) -> np.ndarray:
    """A window (steps, 4) that holds nothing yet."""
    return np.tile([0.0, NEVER, 0.0, 0.0], (steps, 1))


def frictionless(state: State, certificate: Certificate) -> bool:
    """Whether the one joint has no friction and the load asks for some: the limit load is nought."""
    if len(state.joints.block_a) != 1:
        return False
    family = state.points if state.points is not None else state.areas
    return float(family.friction[0]) == 0.0 and bool(np.any(certificate.unit))


def _at_joint(state: State, wrench: np.ndarray) -> np.ndarray:
    """Force and moment (6,) at the centroid of b, as V_1, V_2, V_n, M_1, M_2, M_T about O in the joint's axes."""
    axes, arm = state.joints.axes[0], state.joints.arm_b[0]
    return np.concatenate([axes @ wrench[:3], axes @ (wrench[3:] - np.cross(arm, wrench[:3]))])


def _single_joint(state: State, load: np.ndarray) -> dict:
    b = state.joints.block_b[0]
    unit = _at_joint(state, load[b])
    dead = _at_joint(state, np.concatenate([state.blocks.dead_force[b], state.blocks.dead_torque[b]]))
    normal = float(state.joints.resultant[0, 0])
    friction = float((state.points if state.points is not None else state.areas).friction[0])
    centre, rest = np.zeros(2), np.zeros(1)
    if state.points is not None:
        family, follows, p = 0, True, state.points
        rest = p.normal.copy()
        weights = rest / rest.sum()
        centre = np.array([weights @ p.x_s, weights @ p.y_s])
        radius = limit_set.torsion_radius(p.x_s, p.y_s, weights)
        reach = float(np.hypot(p.x_s, p.y_s).max())
    else:
        family, follows = 1, state.areas.pressed is not None
        radius, reach = float(state.areas.radius[0]), float(state.areas.reach[0])
        if follows:
            centre = state.areas.pressed.centre[0].copy()
            radius = 1.0 / _gauge(state, (0.0, 0.0, 1.0))
    size = max(float(np.abs(unit[:2]).max()), abs(float(unit[5])) / reach)
    strict = abs(unit[2]) <= _NONE * size
    tilted = float(np.abs(unit[3:5]).max()) > _NONE * size * reach
    if follows:
        strict = strict and not tilted
    elif tilted:
        # translation bounds what friction can carry: strict if the block cannot overturn before that
        most = friction * normal + float(np.hypot(dead[0], dead[1]))
        strict = strict and most <= float(np.hypot(unit[0], unit[1])) * _overturning_load(state, normal, unit)
    tangential = [0, 1, 5]
    # rounding of the geometry must not tilt the load
    shear = np.where(np.abs(unit[tangential]) <= _NONE * size * np.array([1.0, 1.0, reach]), 0.0, unit[tangential])
    unbalanced = dead[tangential]
    dead_gauge = 0.0
    if friction > 0.0 and np.any(unbalanced):
        dead_gauge = _dead_gauge(state, family, friction * normal, unbalanced)
    return {
        "strict": bool(strict),
        "family": family,
        "unit": shear,
        "dead": unbalanced,
        "dead_gauge": dead_gauge,
        "centre": centre,
        "radius": radius,
        "normal": normal,
        "rest": rest,
    }


def _overturning_load(state: State, normal: float, unit: np.ndarray) -> float:
    """V at which the centre of pressure of the one convex joint reaches the edge of its polygon."""
    now = state.joints.resultant[0]
    centre = np.array([now[5], -now[4]]) / normal
    shift = np.array([unit[4], -unit[3]]) / normal
    corners = np.stack([state.areas.x, state.areas.y], axis=1)
    edges = np.concatenate([corners[1:], corners[:1]]) - corners
    outward = np.stack([edges[:, 1], -edges[:, 0]], axis=1)
    room = ((corners - centre) * outward).sum(axis=1)
    speed = outward @ shift
    reached = speed > 0.0
    return float((room[reached] / speed[reached]).min(initial=np.inf))


def _dead_gauge(state: State, family: int, strength: float, dead: np.ndarray) -> float:
    """Upper bound of the gauge of the tangential dead load in the limit set, at the seated state.

    Points: the largest utilisation of a point, because the seated forces are one way to carry the load. Convex: exact.
    """
    if family == 1:
        return _gauge(state, dead / strength)
    p = state.points
    closed = p.normal > 0.0
    return float((np.hypot(p.elastic_1, p.elastic_2)[closed] / (p.friction[0] * p.normal[closed])).max())


def _gauge(state: State, force) -> float:
    """Gauge of a tangential force (3,) over V_0 in the limit set of the one convex joint, at the seated state."""
    a = state.areas
    f1, f2, m = (float(f) for f in force)
    shape = (a.x, a.y, 0, a.x.size, a.area[0], a.reach[0], a.far[0], a.pressed, 0)
    return float(gauge(*shape, f1, f2, m, 0.0, 0.0, 0.0, False)[0])
