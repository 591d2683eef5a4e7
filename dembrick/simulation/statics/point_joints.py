"""Joints that act at contact points, in statics: the Python side of the point family.

The functions are those of `area_joints`, under the same names; `joint_families` calls them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dembrick.assembly.contact_points import PointTable
from dembrick.assembly.joints import JointTable
from dembrick.kernels.statics.point_joints import Bonds, Points, reserves
from dembrick.simulation.joint_laws import bonded_at_start, elastic_stiffness, repeated, sliding_strength, strengths_of

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly

MEMORY = ("elastic_1", "elastic_2", "slip", "path", "bonds", "custom")  # fields of the history
FOUND = ("normal",)  # fields that each evaluation computes again


def at_rest(assembly: Assembly) -> Points | None:
    """The joints of an assembly that act at points, at rest; None without any."""
    joints, table = JointTable.of(assembly.joints), PointTable.of(assembly.contact_points)
    chosen = np.flatnonzero(~table.resultant)
    if not len(chosen):
        return None
    laws = [joints.law[j] for j in chosen]
    counts = np.diff(table.start)[chosen]
    total = len(table.area)
    strengths, bonds = strengths_of(laws), None
    if strengths is not None:
        bonds = Bonds(np.array(table.area, float), np.repeat(bonded_at_start(laws), counts), *np.zeros((3, total)))
    custom = None
    if assembly.custom_law is not None:
        from dembrick.simulation import joint_laws

        each = [law for law, count in zip(laws, counts.tolist(), strict=True) for _ in range(count)]
        custom = joint_laws.rows_of(assembly.custom_law, each, table.area)
    x_n, y_n = table.normal_arm.T.copy()
    shared = table.shear_arm is table.normal_arm
    x_s, y_s = (x_n, y_n) if shared else table.shear_arm.T.copy()
    return Points(
        joint=chosen,
        start=np.concatenate([[0], np.cumsum(counts)]),
        friction=np.array([law.friction for law in laws]),
        x_n=x_n,
        y_n=y_n,
        x_s=x_s,
        y_s=y_s,
        k_n=np.repeat([law.normal_stiffness for law in laws], counts) * table.area,
        k_s=np.repeat([law.shear_stiffness for law in laws], counts) * table.area,
        normal=np.zeros(total),
        elastic_1=np.zeros(total),
        elastic_2=np.zeros(total),
        slip=np.zeros(total),
        path=np.zeros(len(chosen)),
        strengths=strengths,
        bonds=bonds,
        custom=custom,
    )


def of_cases(points: Points, cases) -> Points:
    """The joints of a batch, one for each of the ``cases``, from those of its distinct shapes ``points``, which have
    friction and stiffnesses of 1."""
    counts = np.diff(points.start)[cases.shape]
    start = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    entry = np.repeat(points.start[:-1][cases.shape] - start[:-1], counts) + np.arange(start[-1])
    own = {"joint": np.arange(cases.count), "start": start, "friction": np.array(cases.friction)}
    own |= {"path": np.zeros(cases.count), "strengths": None, "bonds": None, "custom": None}
    values = {name: value[entry] for name, value in points._asdict().items() if name not in own}
    values["k_n"] *= np.repeat(cases.normal_stiffness, counts)
    values["k_s"] *= np.repeat(cases.shear_stiffness, counts)
    return Points(**own, **values)


def stiffness(points: Points) -> np.ndarray:
    """Elastic stiffness (p, 6, 6) of the closed joints, see `elastic_stiffness`."""
    starts = points.start[:-1]
    return elastic_stiffness(
        [np.add.reduceat(points.k_s * a, starts) for a in _moments(points.x_s, points.y_s)],
        [np.add.reduceat(points.k_n * a, starts) for a in _moments(points.x_n, points.y_n)],
    )


def _moments(x: np.ndarray, y: np.ndarray) -> tuple:
    return 1.0, x, y, x * x, y * y, x * y


def corners(points: Points) -> tuple[np.ndarray, np.ndarray]:
    """Points (x, y) at which the joints open and close, in the order of ``start`` (m)."""
    return points.x_n, points.y_n


def shear_corners(points: Points) -> tuple[np.ndarray, np.ndarray]:
    """Points (x, y) at which the joints carry shear, in the order of ``start`` (m)."""
    return points.x_s, points.y_s


def torsion_radius(points: Points) -> np.ndarray:
    """Torsion strength of each joint over V_0 (p,) in m: infinite, as it is not computed."""
    return np.full(len(points.joint), np.inf)


def entries(points: Points) -> int:
    """Number of contact entries that the kernels process per evaluation: a measure of their time."""
    return len(points.k_n)


def friction_work(points: Points, before: Points, normal: np.ndarray) -> float:
    """Work dissipated by friction since the history ``before``, with the present forces (J)."""
    counts = np.diff(points.start)
    friction = np.repeat(points.friction, counts)
    strengths = None if points.strengths is None else repeated(points.strengths, counts)
    area = None if points.bonds is None else points.bonds.area
    return float((sliding_strength(strengths, area, friction, points.normal) * (points.slip - before.slip)).sum())


def crushing_work(points: Points, before: Points) -> float:
    """Work dissipated by crushing since the history ``before`` (J)."""
    if points.strengths is None:
        return 0.0
    deeper = points.bonds.crushed - before.bonds.crushed
    strength = np.repeat(points.strengths.crushing, np.diff(points.start)) * points.bonds.area
    return float((strength[deeper > 0.0] * deeper[deeper > 0.0]).sum())


def reserve(points: Points) -> np.ndarray:
    """Reserve of the bonds (c, 2) in N: in tension, and in shear if failure in shear would lose strength. Infinite
    without a bond."""
    found = np.zeros((len(points.normal), 2))
    reserves(points, found)
    return found


def tensile_strength(points: Points) -> np.ndarray:
    """Tensile strength of the bond of each point (c,) in N."""
    return np.repeat(points.strengths.tension, np.diff(points.start)) * points.bonds.area


def whole_area(points: Points) -> np.ndarray:
    """Area of each joint with bonds (p,) in m2."""
    return np.add.reduceat(points.bonds.area, points.start[:-1].astype(np.int64))


def greatest_strength(points: Points) -> np.ndarray:
    """Greatest force (p,) in N that the bonds of each joint may carry in addition to friction."""
    if points.strengths is None:
        return np.zeros(len(points.joint))
    area = np.add.reduceat(points.bonds.area, points.start[:-1])
    return area * np.maximum(points.strengths.cohesion, points.strengths.tension)


def slip_twists(points: Points, steps: np.ndarray) -> np.ndarray:
    """Slip twists (k, 3) of the joints: their last ``steps``."""
    return steps


def normal_sums(points: Points) -> np.ndarray:
    """`Energy.normal` (p, 7): sums of k_n (1, x, y, x^2, y^2, x y), and the reach of the normal forces (m)."""
    starts, reach = points.start[:-1], np.hypot(points.x_n, points.y_n)
    sums = [np.add.reduceat(points.k_n * a, starts) for a in _moments(points.x_n, points.y_n)]
    return np.column_stack([*sums, np.maximum.reduceat(reach, starts)])
