"""Limit load and mechanism from a finished replay (`read_off`); before it, whether the bracket of a scene is strict,
and the data from which the compiled loop forms it (`certificate`).
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace

import numpy as np

from dembrick.errors import BracketError
from dembrick.kernels.statics.load_bounds import NEVER, Basis, Certificate, at_joint, certify
from dembrick.scenario.checks import present
from dembrick.simulation.mechanism import assembly_mechanism, crushes, fastest_blocks, joint_mechanism, nothing_between
from dembrick.simulation.statics import joint_families
from dembrick.simulation.statics.state import State

_CROSSED = 1e-10  # of V: bounds that have met may cross by rounding
_NOTHING = 1e-14  # of the largest joint force: a smaller load is rounding
SLIDING = 1e-2  # of the motion of a joint in the last step: smaller slip is neglected
OPEN = 0.5  # of the lower bound: a wider bracket is reported as open


@dataclass(frozen=True)
class YieldPoint:
    """Limit load of the load system, with its bracket and the joint that moves most (SI units, joint axes).

    ``V`` is the middle of the bracket; if the load falls after a peak, the middle of that of the peak, and ``V_after``
    is the residual load of the mechanism (else None). ``bracket`` is "certified" if the normal forces do not depend on
    the load, else "indicator"; "open" if the bounds are too far apart for a limit load (or ``V_upper`` is None: there
    is no upper one), and V is then only the load of the actuators at the end, or the greatest one carried in
    equilibrium if that is ``V_lower``. ``unlimited``: no mechanism up to
    ``V_lower``, and V is None. ``actuator_load``: load of the actuators at the end of the replay; ``displacement``:
    the driven one at the limit, or at the end of a test that went past it (m); ``V_peak``: the V of the largest
    absolute value, with its sign, at ``displacement_at_peak``: in equilibrium and within the bracket, or at a constant
    rate of the whole test, with its rate effect. ``V_1``, ``V_2``, ``M_T``, ``N`` are those of the joint at the limit,
    ``torsion_centre`` is measured from its O (None in pure shear). ``limit_at``: time (s) or number of the equilibrium
    at the limit, None for a test that goes on past its peak. ``mechanism``: its name, "none" if the
    blocks move elastically; ``joint``: the blocks of the joint that moves most.
    """

    V: float | None
    V_lower: float
    V_upper: float | None
    bracket: str
    V_peak: float
    displacement_at_peak: float
    actuator_load: float
    V_1: float
    V_2: float
    M_T: float
    N: float
    displacement: float
    torsion_centre: tuple[float, float] | None
    mechanism: str
    joint: tuple[str, str]
    V_after: float | None = None
    unlimited: bool = False
    limit_at: float | None = None

    @property
    def half_width(self) -> float:
        """Greatest distance of the bounds from V (N), half the width if V is in the middle; infinite without an upper
        bound."""
        if self.V_upper is None or self.V is None:
            return math.inf
        return max(self.V_upper - self.V, self.V - self.V_lower)

    def as_dict(self) -> dict:
        return asdict(self)


def read_off(state: State, certificate: Certificate, names, physical: bool = False) -> YieldPoint:
    """The yield point of a finished replay; BracketError if the two bounds contradict each other.

    ``physical``: whether the replay was a test with physical inertia, whose peak may exceed the upper bound.
    """
    lower, upper = (float(v) for v in certificate.bracket)
    if upper < NEVER:
        carried = float(np.abs(state.joints.resultant[:, :3]).max() / np.abs(state.actuators.weight).sum())
        if lower - upper > max(_CROSSED * abs(lower), _NOTHING * carried):
            raise BracketError(
                f"the lower bound {lower:.9g} N of the limit load lies above the upper one {upper:.9g} N, so one of "
                "them is wrong; please report this scenario"
            )
        lower, upper = min(lower, upper), max(lower, upper)
    kind = "certified" if certificate.strict else "indicator"
    V = 0.5 * (lower + upper)
    if upper >= NEVER or (not certificate.strict and upper - lower > OPEN * abs(lower)):
        kind, V = "open", float(state.actuators.driven[0].load)
    slid, turned, tilted = last_moves(state)
    j = int(np.argmax(np.maximum(np.maximum(slid, turned), tilted)))
    resultant = state.joints.resultant[j]
    centre, mechanism = _mechanism(state, certificate, j)
    driven = state.actuators.driven[0]
    peak = float(driven.peak)
    if not physical and kind != "open":
        peak = min(peak, upper)  # below the lower bound if V only approaches its limit
    # + 0.0 turns a negative zero, which would only puzzle the reader, into zero
    return YieldPoint(
        V=V,
        V_lower=lower,
        V_upper=upper if upper < NEVER else None,
        bracket=kind,
        V_peak=peak,
        displacement_at_peak=float(driven.peak_at),
        actuator_load=float(driven.load),
        V_1=float(resultant[1]) + 0.0,
        V_2=float(resultant[2]) + 0.0,
        M_T=float(resultant[3]) + 0.0,
        N=float(resultant[0]) + 0.0,
        displacement=float(driven.displacement),
        torsion_centre=centre,
        mechanism=mechanism,
        joint=(names[state.joints.block_a[j]], names[state.joints.block_b[j]]),
    )


def carried_by(point: YieldPoint, state: State) -> YieldPoint:
    """``point`` with the forces of its joint in a ``state``."""
    if len(state.joints.resultant) != 1:
        return point
    N, V_1, V_2, M_T = (float(value) + 0.0 for value in state.joints.resultant[0, :4])
    return replace(point, N=N, V_1=V_1, V_2=V_2, M_T=M_T)


def in_equilibrium(point: YieldPoint, certificate: Certificate) -> YieldPoint:
    """``point`` of the one joint of a strict bracket with its forces in equilibrium at V, without inertia effects."""
    V_1, V_2, M_T = (float(value) + 0.0 for value in certificate.dead + present(point.V) * certificate.unit)
    return replace(point, V_1=V_1, V_2=V_2, M_T=M_T)


def at_the_end(point: YieldPoint, certificate: Certificate) -> YieldPoint:
    """``point`` whose V is the final load of the actuators, in a bracket that includes it. If the strengths of the
    joints would resist far more than V along the last motion, joints and ties move elastically, at least in part, and
    there is no mechanism."""
    V = point.actuator_load
    above = None if point.V_upper is None else max(point.V_upper, V)
    point = replace(point, V=V, V_lower=min(point.V_lower, V), V_upper=above)
    taken = float(np.median(present(certificate.window)[:, 1]))
    return without_mechanism(point) if taken - V > OPEN * abs(V) else point


def without_mechanism(point: YieldPoint) -> YieldPoint:
    """``point`` of a test that ends without a mechanism."""
    return replace(point, mechanism="none", torsion_centre=None)


def at_peak(point: YieldPoint, peak: tuple[float, float], within: float) -> YieldPoint:
    """``point`` of a path with a ``peak`` (given by bounds): at the peak, if that lies above the bracket.

    A peak above the bracket by less than ``within`` (N) only extends it.
    """
    if point.V_upper is None or not peak[0] > point.V_upper:
        return point
    if peak[0] <= point.V_upper + within:
        V = 0.5 * (point.V_lower + peak[0])
        return replace(point, V=V, V_upper=peak[0], V_peak=peak[0])
    V = 0.5 * (peak[0] + peak[1])
    return replace(point, V=V, V_lower=peak[0], V_upper=peak[1], V_peak=V, V_after=point.V)


def at_greatest(point: YieldPoint, carried: float) -> YieldPoint:
    """``point`` of a path whose load rises and falls without end, in bounds too far apart: the limit is at least the
    greatest load ``carried`` in equilibrium (N), which is V if the bracket stays open."""
    lower = max(point.V_lower, carried)
    return closed(replace(point, V=lower, V_lower=lower))


def closed(point: YieldPoint) -> YieldPoint:
    """``point`` with V in the middle of its bracket if that is open and no longer too wide."""
    lower, upper = point.V_lower, point.V_upper
    if point.bracket != "open" or upper is None or not upper - lower <= OPEN * abs(lower):
        return point
    return replace(point, V=0.5 * (lower + upper), bracket="indicator")


def without_limit(point: YieldPoint) -> YieldPoint:
    """``point`` of a path on which nothing limited the load: V is at least the last load."""
    followed = point.actuator_load
    return replace(
        point, V=None, V_lower=followed, V_upper=None, bracket="open", V_peak=followed, mechanism="none", unlimited=True
    )


def _mechanism(state: State, certificate: Certificate, j: int) -> tuple[tuple[float, float] | None, str]:
    """Torsion centre of the last slip of joint ``j``, and the name of the mechanism.

    With a strict bracket the joint slides before it overturns, and the slip is the twist of the upper bound: the
    bracket may close on the last elastic step, which tilts the joint.
    """
    reach = joint_families.reach(state)[j]
    if certificate.strict and certificate.twist.any():
        return joint_mechanism(certificate.twist, np.zeros(2), reach)
    if lifted_off(state):
        return None, "uplift"
    if crushed(state):
        return None, "crushing"
    if (broken := joint_families.overloaded(state)).any():
        if broken[:, 0].any():
            return None, "rocking"
        return joint_mechanism(state.joints.step[j], np.zeros(2), reach)
    return joint_mechanism(joint_families.slip_twists(state)[j], state.joints.tilt[j], reach)


def last_moves(state: State) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """How far the rim of each joint slid, turned about the normal and tilted in the last step (j,) in m.

    Joints without a normal force are open and do not count: motion across them is no slip.
    """
    joints = state.joints
    reach = joint_families.reach(state) * (joints.resultant[:, 0] > 0.0)
    slid = np.hypot(joints.step[:, 0], joints.step[:, 1]) * (joints.resultant[:, 0] > 0.0)
    return slid, reach * np.abs(joints.step[:, 2]), reach * np.hypot(joints.tilt[:, 0], joints.tilt[:, 1])


def mechanism_of(state: State) -> str:
    """Name of the mechanism of an assembly in its last step: that of the joint that moved most."""
    if lifted_off(state):
        return "uplift"
    if crushed(state):
        return "crushing"
    slid, turned, tilted = last_moves(state)
    if (broken := joint_families.overloaded(state)).any():
        # the step before bonds break is elastic and moves all joints: joints that open rock, others only slip
        if broken[:, 0].any():
            return "rocking"
        tilted = np.zeros_like(tilted)
    return assembly_mechanism(slid, turned, tilted)


def slides(state: State) -> bool:
    """Whether joints between several free blocks slide in the mechanism, and do not only rock.

    Friction without dilatancy then has no unique limit load: joint forces depend on the load history.
    """
    slid, turned, tilted = last_moves(state)
    several = len(state.joints.block_a) > 1
    return bool(several and max(slid.max(), turned.max()) > SLIDING * max(tilted.max(), slid.max(), turned.max()))


def crushed(state: State) -> bool:
    """Whether the last step was crushing of joints."""
    strength = joint_families.compressive_strength(state)
    if not np.isfinite(strength).any():
        return False
    joints, blocks = state.joints, state.blocks
    sides = ((joints.block_a, joints.arm_a), (joints.block_b, joints.arm_b))
    moved_a, moved_b = (blocks.velocity[block] + np.cross(blocks.spin[block], arm) for block, arm in sides)
    closed = np.einsum("jk,jk->j", moved_a - moved_b, joints.axes[:, 2])
    return crushes(closed, strength, *last_moves(state))


def lifted_off(state: State) -> bool:
    """Whether the moving blocks have lost contact with those at rest: no joint between the two carries a force."""
    weight = np.linalg.norm(state.blocks.dead_force[state.blocks.free], axis=1).max()
    ends = state.joints.block_a, state.joints.block_b
    moving = np.array(moving_blocks(state), np.int64)
    return nothing_between(moving, ends, state.joints.resultant[:, 0], float(weight))


def moving_blocks(state: State) -> tuple[int, ...]:
    """Numbers of the blocks that moved in the last step, at least a tenth as far as the fastest."""
    speed = np.linalg.norm(state.blocks.velocity, axis=1)
    return tuple(fastest_blocks(speed).tolist())


WINDOW = 32  # steps over which an indicator must be constant
CAUTION = 0.5  # factor on the tolerance of an indicator, as it does not include any remaining drift


def certificate(state: State, load: np.ndarray, elastic: float, tolerance: float) -> Certificate:
    """The certificate of a dead-load equilibrium for the unit load (n, 6) of the actuators.

    ``elastic`` (N/m) is the elastic stiffness of V against the driven displacement.

    Strict if the scene has one joint whose friction does not depend on the load: with point forces, if the load
    neither presses nor tilts the joint; with the full pressure of a convex joint, if the load does not press and the
    joint slides before it overturns; pressures of a convex joint that follow the bending count as points. Never with
    bonds, which may break one after another, nor with a user-defined law. A tolerance of 0 never ends a run.
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
    certify(joints, points, areas, (joint_families.number(state), 0, 0), unit, dead, basis)
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
