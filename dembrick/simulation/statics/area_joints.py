"""Convex joints, in statics: the Python side of the area family.

The functions are those of `point_joints`, under the same names; `joint_families` calls them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dembrick.assembly.contact_points import PointTable
from dembrick.assembly.joints import JointTable
from dembrick.geometry import friction_integrals, polygons
from dembrick.kernels.statics.area_joints import AreaBonds, Areas, reserves
from dembrick.simulation.joint_laws import (
    bonded_at_start,
    check_pressures,
    elastic_stiffness,
    pressed_parts,
    sliding_strength,
    strengths_of,
)

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly

MEMORY = ("elastic", "twist", "slip", "bonds")  # fields of the history
LONGER = 2.0  # times a step: its plastic part may be longer than the step by what the springs of a joint give back
FOUND = ("evaluations", "pressed")  # fields that each evaluation computes again


def at_rest(assembly: Assembly) -> Areas | None:
    """The convex joints of an assembly, at rest; None without any."""
    joints, table = JointTable.of(assembly.joints), PointTable.of(assembly.contact_points)
    chosen = np.flatnonzero(table.resultant)
    if not len(chosen):
        return None
    laws = [joints.law[j] for j in chosen]
    check_pressures(joints, chosen)
    counts = np.diff(joints.start)[chosen]
    n, start = len(chosen), np.concatenate([[0], np.cumsum(counts)])
    corners = joints.corner[np.repeat(joints.start[chosen] - start[:-1], counts) + np.arange(start[-1])]
    second, reach, radius, far = np.empty((n, 3)), np.empty(n), np.empty(n), np.empty((n, 42))
    strengths = strengths_of(laws)
    for numbers, shapes in joints.by_corners(chosen):
        some = np.searchsorted(chosen, numbers)
        second[some] = np.stack(polygons.second_moments(shapes), axis=1)
        reach[some] = np.sqrt((shapes**2).sum(axis=2).max(axis=1))
        radius[some] = friction_integrals.area_radius(shapes)
        far[some] = friction_integrals.far_moments(shapes)
    return Areas(
        joint=chosen,
        start=start,
        friction=np.array([law.friction for law in laws]),
        x=corners[:, 0].copy(),
        y=corners[:, 1].copy(),
        area=joints.area[chosen],
        second=second,
        reach=reach,
        radius=radius,
        far=far,
        k_n=np.array([law.normal_stiffness for law in laws]),
        k_s=np.array([law.shear_stiffness for law in laws]),
        elastic=np.zeros((n, 3)),
        twist=np.zeros((n, 3)),
        slip=np.zeros(n),
        evaluations=np.zeros(n, np.int64),
        pressed=pressed_parts([law.pressure for law in laws], counts.tolist()),
        strengths=strengths,
        bonds=None if strengths is None else AreaBonds(bonded_at_start(laws), *np.zeros((5, n))),
    )


def of_cases(areas: Areas, cases) -> Areas:
    """The joints of a batch, one for each of the ``cases``, from those of its distinct shapes ``areas``."""
    counts = np.diff(areas.start)[cases.shape]
    start = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    entry = np.repeat(areas.start[:-1][cases.shape] - start[:-1], counts) + np.arange(start[-1])
    own = {
        "joint": np.arange(cases.count),
        "start": start,
        "friction": np.array(cases.friction),
        "x": areas.x[entry],
        "y": areas.y[entry],
        "k_n": np.array(cases.normal_stiffness),
        "k_s": np.array(cases.shear_stiffness),
        "pressed": pressed_parts([cases.pressure] * cases.count, counts.tolist()),
        "strengths": None,
        "bonds": None,
    }
    return Areas(**own, **{name: value[cases.shape] for name, value in areas._asdict().items() if name not in own})


def stiffness(areas: Areas) -> np.ndarray:
    """Elastic stiffness (a, 6, 6) of the closed joints, see `elastic_stiffness`."""
    yy, xx, xy = areas.second.T
    moments = (areas.area, 0.0, 0.0, xx, yy, xy)
    return elastic_stiffness([areas.k_s * a for a in moments], [areas.k_n * a for a in moments])


def corners(areas: Areas) -> tuple[np.ndarray, np.ndarray]:
    """Points (x, y) at which the joints open and close, in the order of ``start`` (m)."""
    return areas.x, areas.y


shear_corners = corners  # points at which they carry shear


def torsion_radius(areas: Areas) -> np.ndarray:
    """Torsion strength of each joint over V_0 (a,) in m; if friction follows the bending, at most that of the present
    pressed part."""
    return areas.radius if areas.pressed is None else np.minimum(areas.radius, areas.pressed.radius)


def entries(areas: Areas) -> int:
    """Number of contact entries that the kernels process per evaluation: a measure of their time."""
    return 4 * len(areas.x)


def friction_work(areas: Areas, before: Areas, normal: np.ndarray) -> float:
    """Work dissipated by friction since the history ``before``, with the present forces (J); ``normal`` (a,) N."""
    strength = sliding_strength(areas.strengths, areas.area, areas.friction, normal)
    return float((strength * (areas.slip - before.slip)).sum())


def crushing_work(areas: Areas, before: Areas) -> float:
    """Work dissipated by crushing since the history ``before`` (J)."""
    if areas.strengths is None:
        return 0.0
    deeper = areas.bonds.crushed - before.bonds.crushed
    return float((areas.strengths.crushing[deeper > 0.0] * deeper[deeper > 0.0]).sum())


def reserve(areas: Areas) -> np.ndarray:
    """Reserve of the bonds (a, 2) in N: in tension, and in shear if failure in shear would lose strength. Infinite
    without a bond."""
    found = np.zeros((len(areas.joint), 2))
    reserves(areas, found)
    return found


def tensile_strength(areas: Areas) -> np.ndarray:
    """Tensile strength of the bond of each joint (a,) in N, over its whole area."""
    return areas.strengths.tension * areas.area


def whole_area(areas: Areas) -> np.ndarray:
    """Area of each joint (a,) in m2."""
    return areas.area


def greatest_strength(areas: Areas) -> np.ndarray:
    """Greatest force (a,) in N that the bond of each joint may carry in addition to friction."""
    if areas.strengths is None:
        return np.zeros(len(areas.joint))
    return areas.area * np.maximum(areas.strengths.cohesion, areas.strengths.tension)


def slip_twists(areas: Areas, steps: np.ndarray) -> np.ndarray:
    """Slip twists (k, 3) of the joints: the plastic part of their last ``steps``, or all of an elastic step. A twist
    longer than its step is left from before, or only a direction in which the joint would slip."""

    def length(twists: np.ndarray) -> np.ndarray:
        return np.hypot(np.hypot(twists[:, 0], twists[:, 1]), areas.reach * twists[:, 2])

    slipped = length(areas.twist) <= LONGER * length(steps)
    return np.where(slipped[:, None], areas.twist, steps)
