"""Limit loads of many two-block scenes at once: one compiled call instead of an assembly, a state and a file for each.

Every case (see `cases`) is stepped through time by the kernels of a scene of its own (``limit_load.find_limit_load``)
and ends with the same bracket; a test holds the two against each other. Cases run in blocks of `BLOCK`, so memory does
not grow with their number, and the compiled call lets go of Python's lock, so that threads share them. Whatever the
number of threads, the answers are the same to the last bit.

    >>> cases = Cases.on(corners, "convex", friction=0.64, normal_force=467.0,
    ...                  actuator_point=[[0.075, 0.0, 0.05]], actuator_direction=[[0.0, 1.0, 0.0]])
    >>> find_limit_loads(cases).V
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from dembrick.assembly.joints import Joint
from dembrick.assembly.quadrature import ContactPoints, contact_points
from dembrick.geometry import polygons
from dembrick.kernels.state import Actuators, Blocks, Joints, ScaledInertia
from dembrick.kernels.statics.batch import FALLS, Answer, Loading, Room, Settings, replay_batch
from dembrick.kernels.statics.load_bounds import NEVER, Basis
from dembrick.kernels.statics.loop import CONVERGED
from dembrick.scenario.model import JointLaw
from dembrick.simulation.statics import dead_load, guards, joint_families, limit_load, load_system, state, yield_point
from dembrick.simulation.statics.batch_cases import Cases, check, wrench
from dembrick.simulation.statics.critical_step import critical_time_step
from dembrick.simulation.statics.yield_point import OPEN

BLOCK = 128  # cases prepared and run at a time
STEP_FACTOR = 0.9  # of the time step that is stable


@dataclass(frozen=True)
class LimitLoads:
    """Limit loads of k cases, row by row. SI units, joint axes; N, V_1, V_2, M_T act on b about O.

    ``status``: "yield", or what went wrong: "not converged", "diverged", "no equilibrium" (under dead load
    alone); V and its bounds are those reached. ``V`` is the middle of the bracket, NaN without an upper bound
    (``V_upper`` infinite). ``certified`` tells a strict bracket from an indicator. ``twist`` (k, 3) is the slip twist
    that gave the upper bound, where certified, else that at the end; ``tilt`` (k, 2) how the block rocked in the last
    step (rad).
    """

    V: np.ndarray
    V_lower: np.ndarray
    V_upper: np.ndarray
    certified: np.ndarray
    status: np.ndarray
    actuator_load: np.ndarray
    N: np.ndarray
    V_1: np.ndarray
    V_2: np.ndarray
    M_T: np.ndarray
    twist: np.ndarray
    tilt: np.ndarray
    steps: np.ndarray

    @property
    def half_width(self) -> np.ndarray:
        """Half the width of each bracket (N)."""
        return 0.5 * (self.V_upper - self.V_lower)


_STATUS = np.array(["not converged", "yield", "diverged", "not converged", "diverged", "no equilibrium"])
assert _STATUS[CONVERGED] == "yield" and _STATUS[FALLS] == "no equilibrium"


def find_limit_loads(
    cases: Cases, threads: int | None = None, progress: Callable[[int, int], None] | None = None
) -> LimitLoads:
    """The limit load of every case; ``threads`` defaults to the cores of the machine.

    Cases that have no answer say so in ``status``, and the others go on. ``progress`` gets the number of cases done
    and of all. ScenarioError if the cases are no tests: shapes, signs, a load that does not push along the joint.
    """
    check(cases)
    starts = range(0, cases.count, BLOCK)
    parts = [cases.part(first, min(first + BLOCK, cases.count)) for first in starts]
    faces = _Faces(cases)
    threads = min(threads or os.cpu_count() or 1, len(parts))
    found, done = [], 0

    def run(part: Cases) -> LimitLoads:
        return _run(part, faces)

    if threads > 1:
        _run(cases.part(0, 1), faces)  # loads or fills the cache of compiled code before the threads meet at it
    with ThreadPoolExecutor(threads) as pool:
        for result in pool.map(run, parts) if threads > 1 else map(run, parts):
            found.append(result)
            done += len(result.V)
            if progress:
                progress(done, cases.count)
    names = LimitLoads.__dataclass_fields__
    return LimitLoads(**{name: np.concatenate([getattr(result, name) for result in found]) for name in names})


def face(polygon: np.ndarray, law: JointLaw) -> Joint:
    """A joint by itself, in its own axes about its centroid, where the points of its law can be placed."""
    zero, polygon = np.zeros(3), np.asarray(polygon, float)
    return Joint(0, 1, 1, zero, np.eye(3), polygon, polygons.area(polygon), law, 0.0, zero, zero)


class _Faces:
    """The different joints of a batch with friction and stiffnesses of 1, as the engine sees them."""

    custom_law = None

    def __init__(self, cases: Cases):
        law = JointLaw(cases.formulation, 1.0, 1.0, 1.0, points=cases.points, pressure=cases.pressure)
        self.joints = [face(polygon, law) for polygon in cases.polygons]
        self.contact_points: list[ContactPoints | None] = [contact_points(f, cases.tolerance) for f in self.joints]
        self.width = np.array([polygons.width(p) for p in cases.polygons])
        self.points, self.areas = joint_families.at_rest(self)


def _joints(k: int) -> Joints:
    """k joints in their own axes, both blocks seen from O."""
    axes = np.tile(np.eye(3), (k, 1, 1))
    zero = {name: np.zeros((k, 3)) for name in ("arm_a", "arm_b", "lever_a", "lever_b", "offset")}
    own = {"axes": axes, "axes_a": axes.copy(), "axes_b": axes.copy(), **zero}
    return state.joints_at_rest(
        block_a=2 * np.arange(k), block_b=2 * np.arange(k) + 1, host=np.ones(k), gap=np.zeros(k), **own
    )


def _blocks(k: int, dead: np.ndarray) -> Blocks:
    dead_force, dead_torque = np.zeros((2, 2 * k, 3))
    dead_force[1::2], dead_torque[1::2] = dead[:, :3], dead[:, 3:]
    orientation = np.tile([1.0, 0.0, 0.0, 0.0], (2 * k, 1))
    return state.blocks_at_rest(2 * np.arange(k) + 1, orientation, dead_force, dead_torque)


def _actuators(cases: Cases) -> Actuators:
    k, each = cases.actuator_weight.shape
    arm = np.array(cases.actuator_point, float).reshape(-1, 3)
    return Actuators(
        block=np.ones(k * each, np.int64),
        arm=arm.copy(),
        lever=arm.copy(),
        start=arm.copy(),
        direction=np.array(cases.actuator_direction, float, order="C").reshape(-1, 3),
        weight=np.array(cases.actuator_weight, float).reshape(-1),
        displacement=np.zeros(k * each),
        drive=np.zeros((k, 6)),
    )


def _inertia(stiffness: np.ndarray) -> ScaledInertia:
    """Scaled inertia (2 k, 6, 6) of the free blocks from their stiffness (k, 6, 6)."""
    inverse, matrix = np.zeros((2, 2 * len(stiffness), 6, 6))
    inverse[1::2], matrix[1::2] = np.linalg.inv(stiffness), stiffness
    return ScaledInertia(inverse, matrix, None)


def _settings(tolerance: float, eta: float) -> Settings:
    """The choices of ``replay`` and ``equilibrium``."""
    return Settings(
        tolerance=tolerance,
        caution=yield_point.CAUTION,
        unbalanced=dead_load.UNBALANCED,
        first_steps=dead_load.FIRST_STEPS,
        dead_load_steps=dead_load.MOST_STEPS,
        momentum=dead_load.MOMENTUM,
        eta=eta,
        slip_per_step=limit_load.SLIP_PER_STEP,
        gently=limit_load.GENTLY,
        ramp=float(load_system.RAMP),
        steady=16 * limit_load.HALVING,
        slowing=0.5 ** (1.0 / limit_load.HALVING),
        actuator=load_system.ACTUATOR_STIFFNESS,
        viscous=load_system.VISCOUS,
        damping=limit_load.FLUCTUATION_DAMPING,
        mean_weight=load_system.MEAN_WEIGHT,
        chunk=limit_load.CHUNK_OF_SEARCH,
        most_steps=limit_load.MOST_STEPS,
        window=yield_point.WINDOW,
        mask=guards.LOOK - 1,
        stretch=1 << 62,
    )


def _run(cases: Cases, faces: _Faces) -> LimitLoads:
    k = cases.count
    points, areas = joint_families.of_cases(faces, cases)
    blocks, joints, actuators = _blocks(k, cases.dead), _joints(k), _actuators(cases)
    whole = state.State(blocks, joints, points, areas, actuators)
    stiffness = joint_families.stiffness(whole)
    eta = STEP_FACTOR * critical_time_step(float(np.sqrt(1.0 + load_system.ACTUATOR_STIFFNESS)), load_system.VISCOUS)
    unit = wrench(cases)
    loading = Loading(
        unit=unit,
        dead=np.array(cases.dead, float),
        compliance=(unit * np.linalg.solve(stiffness, unit[:, :, None])[:, :, 0]).sum(1),
        weight=np.abs(cases.actuator_weight).sum(1),
        size=guards.LONGEST_MOVE * faces.width[cases.shape],
    )
    counts = np.zeros((2, k), np.int64)
    answer = Answer(np.zeros((k, 2)), np.zeros((k, 5)), np.zeros((k, 3)), *counts)
    rest = np.zeros(max(1, joint_families.contact_points(whole)))
    basis = Basis(np.zeros(3), np.zeros(3), np.zeros(2), rest, np.zeros(5), np.zeros(3), np.zeros(6))
    room = Room(
        np.zeros(1, np.int64), np.ones(1, np.int64), np.zeros(1), np.zeros((yield_point.WINDOW, 4)), np.zeros(6),
        np.zeros(2), np.zeros(2), np.zeros(3), np.zeros((1, 3)), np.zeros(0, np.int64), np.zeros(0),
    )  # fmt: skip
    replay_batch(
        0, k, state.for_kernels(whole), cases.actuator_weight.shape[1],
        (_inertia(stiffness), _inertia(stiffness / eta**2)), loading, basis, room, _settings(cases.tolerance, eta),
        answer,
    )  # fmt: skip
    strict = answer.basis[:, 0] == 1.0
    lower, upper = np.minimum(answer.bracket[:, 0], answer.bracket[:, 1]), answer.bracket.max(axis=1)
    unbounded = upper >= NEVER
    open_ = unbounded | (~strict & (upper - lower > OPEN * np.abs(lower)))
    status = np.where(open_ & (answer.status == CONVERGED), "not converged", _STATUS[answer.status])
    V = np.where(open_, np.nan, 0.5 * (lower + np.where(unbounded, 0.0, upper)))
    carried = np.where(open_, actuators.drive[:, 2], V)
    forces = loading.dead + carried[:, None] * unit  # in equilibrium: the joint is the only one
    return LimitLoads(
        V=V,
        V_lower=lower,
        V_upper=np.where(unbounded, np.inf, upper),
        certified=strict,
        status=status,
        actuator_load=carried,
        N=-forces[:, 2],
        V_1=forces[:, 0],
        V_2=forces[:, 1],
        M_T=forces[:, 5],
        twist=np.where(strict[:, None], answer.twist, joint_families.slip_twists(whole)),
        tilt=np.where(strict[:, None], 0.0, joints.tilt),  # what is certified slides before it overturns
        steps=answer.steps,
    )
