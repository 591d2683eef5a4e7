"""Limit loads of many two-block scenes at once: one compiled call instead of an assembly, a state and a file for each.

Every case (see `Cases`) is a lone joint, searched by the same kernel as a single scene
(`kernels.statics.lone_search`), even if friction depends on the load: then the bracket is an indicator. Cases run in
blocks of `BLOCK`, so memory does not grow with their number, and the compiled call releases Python's global lock, so
that threads share them. The results are the same to the last bit whatever the number of threads.

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
from dembrick.kernels.state import Joints
from dembrick.kernels.statics.load_bounds import NEVER
from dembrick.kernels.statics.lone_joint import CONVERGED, FALLS, new_room
from dembrick.kernels.statics.lone_search import MOST_EQUILIBRIA, search_joints
from dembrick.scenario.model import JointLaw
from dembrick.simulation.statics import joint_families, state
from dembrick.simulation.statics.batch_cases import Cases, check, wrench
from dembrick.simulation.statics.lone_joint import JointsAlone, lone_joints
from dembrick.simulation.statics.yield_point import OPEN

BLOCK = 128  # cases prepared and run at a time


@dataclass(frozen=True)
class LimitLoads:
    """Limit loads of k cases, row by row. SI units, joint axes; N, V_1, V_2, M_T act on b about O.

    ``status``: "yield", or the failure: "not converged", "no equilibrium" (under dead load alone); V and its bounds
    are those reached. ``V`` is the middle of the bracket, NaN without an upper bound (``V_upper`` infinite).
    ``certified``: whether the bracket is strict, else an indicator. ``twist`` (k, 3): slip twist that gave the upper
    bound if certified, else that at the end; ``tilt`` (k, 2): rocking of the block in the last step (rad);
    ``steps``: iterations of Newton's method.
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


_STATUS = np.array(["not converged"] * 6, dtype="<U14")
_STATUS[[CONVERGED, FALLS]] = "yield", "no equilibrium"


def find_limit_loads(
    cases: Cases, threads: int | None = None, progress: Callable[[int, int], None] | None = None
) -> LimitLoads:
    """The limit load of every case; ``threads`` defaults to the cores of the machine.

    Cases that fail are marked in ``status``, and the others go on. ``progress`` gets the number of cases done
    and of all. Raises ScenarioError for invalid cases: shapes, signs, a load that does not push along the joint.
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
        _run(cases.part(0, 1), faces)  # loads or fills the cache of compiled code before threads compete for it
    with ThreadPoolExecutor(threads) as pool:
        for result in pool.map(run, parts) if threads > 1 else map(run, parts):
            found.append(result)
            done += len(result.V)
            if progress:
                progress(done, cases.count)
    names = LimitLoads.__dataclass_fields__
    return LimitLoads(**{name: np.concatenate([getattr(result, name) for result in found]) for name in names})


def face(polygon: np.ndarray, law: JointLaw) -> Joint:
    """A single joint in its own axes about its centroid, for which the points of its law can be placed."""
    zero, polygon = np.zeros(3), np.asarray(polygon, float)
    return Joint(0, 1, 1, zero, np.eye(3), polygon, polygons.area(polygon), law, 0.0, zero, zero)


class _Faces:
    """The different joints of a batch with friction and stiffnesses of 1, in place of an assembly."""

    custom_law = None

    def __init__(self, cases: Cases):
        law = JointLaw(cases.formulation, 1.0, 1.0, 1.0, points=cases.points, pressure=cases.pressure)
        self.joints = [face(polygon, law) for polygon in cases.polygons]
        self.contact_points: list[ContactPoints | None] = [contact_points(f, cases.tolerance) for f in self.joints]
        self.points, self.areas = joint_families.at_rest(self)


def _joints(k: int) -> Joints:
    """k joints in their own axes, both blocks seen from O."""
    axes = np.tile(np.eye(3), (k, 1, 1))
    zero = {name: np.zeros((k, 3)) for name in ("arm_a", "arm_b", "lever_a", "lever_b", "offset")}
    own = {"axes": axes, "axes_a": axes.copy(), "axes_b": axes.copy(), **zero}
    return state.joints_at_rest(
        block_a=2 * np.arange(k), block_b=2 * np.arange(k) + 1, host=np.ones(k), gap=np.zeros(k), **own
    )


def _run(cases: Cases, faces: _Faces) -> LimitLoads:
    k = cases.count
    points, areas = joint_families.of_cases(faces, cases)
    unit = wrench(cases)
    lone = lone_joints(JointsAlone(_joints(k), points, areas), cases.dead, unit)
    search_joints(0, k, lone, MOST_EQUILIBRIA, cases.tolerance, new_room())
    found = lone.search
    strict = found["strict"] == 1
    lower, upper = np.minimum(lone.bracket[:, 0], lone.bracket[:, 1]), lone.bracket.max(axis=1)
    unbounded = upper >= NEVER
    open_ = unbounded | (~strict & (upper - lower > OPEN * np.abs(lower)))
    status = np.where(open_ & (found["status"] == CONVERGED), "not converged", _STATUS[found["status"].astype(int)])
    V = np.where(open_, np.nan, 0.5 * (lower + np.where(unbounded, 0.0, upper)))
    carried = np.where(open_, found["load"], V)
    forces = lone.dead + carried[:, None] * unit  # in equilibrium: the joint is the only one
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
        twist=np.where(strict[:, None], lone.twist, joint_families.slip_twists(lone)),
        tilt=np.where(strict[:, None], 0.0, lone.joints.tilt),  # certified joints slide before they overturn
        steps=found["iterations"].astype(np.int64),
    )
