"""Contact points of all joints of an assembly, as columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dembrick.assembly.joints import JointTable
from dembrick.assembly.quadrature import ContactPoints, contact_points, corner_points
from dembrick.scenario.checks import present

DISCRETISATION = 1e-3  # tolerance of distributed points for a control without a tolerance
ROUNDING = 1e-9  # relative


@dataclass(frozen=True, eq=False)
class PointTable(Sequence[ContactPoints | None]):
    """Contact points of all joints in joint order; also a sequence of them by joint, with None for a ``convex`` joint.

    ``normal_arm`` and ``shear_arm`` (c, 2), ``area`` (c,): see :class:`ContactPoints`; the two arms share one array if
    they are equal for all joints. ``start`` (j + 1,): index of the first point of each joint. ``resultant`` (j,):
    whether the joint has a resultant instead of points. ``tolerance``: that of ``distributed`` points.
    """

    normal_arm: np.ndarray
    shear_arm: np.ndarray
    area: np.ndarray
    start: np.ndarray
    resultant: np.ndarray
    tolerance: float = DISCRETISATION

    @staticmethod
    def of(points: Sequence[ContactPoints | None]) -> PointTable:
        """The table of a list of points; a table is returned as it is."""
        if isinstance(points, PointTable):
            return points
        sets = [p for p in points if p is not None]
        shared = all(p.shear_arm is p.normal_arm for p in sets)
        normal_arm = np.concatenate([*(p.normal_arm for p in sets), np.empty((0, 2))])
        return PointTable(
            normal_arm=normal_arm,
            shear_arm=normal_arm if shared else np.concatenate([p.shear_arm for p in sets]),
            area=np.concatenate([*(p.area for p in sets), np.empty(0)]),
            start=np.cumsum([0, *(0 if p is None else len(p.area) for p in points)]),
            resultant=np.array([p is None for p in points], bool),
        )

    def __len__(self) -> int:
        return len(self.resultant)

    def __getitem__(self, index):
        if isinstance(index, slice):
            return tuple(self[i] for i in range(*index.indices(len(self))))
        i = range(len(self))[index]
        if self.resultant[i]:
            return None
        some = slice(self.start[i], self.start[i + 1])
        return ContactPoints(self.normal_arm[some], self.shear_arm[some], self.area[some])


def place_points(joints: JointTable, tolerance: float) -> PointTable:
    """The contact points of every joint by its law; see :func:`dembrick.assembly.quadrature.contact_points`.

    Joints with points at their corners are batched by number of corners.
    """
    formulation = np.array([law.formulation for law in joints.law], dtype="U16")
    alone = formulation == "distributed"
    alone[[j for j in joints.pieces if formulation[j] != "convex"]] = True
    at_corners = (formulation != "convex") & ~alone
    single = {int(j): present(contact_points(joints[j], tolerance)) for j in np.flatnonzero(alone)}
    count = np.where(at_corners, np.diff(joints.start), 0)
    for j, points in single.items():
        count[j] = len(points.area)
    start = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    normal_arm, area = np.empty((start[-1], 2)), np.empty(start[-1])
    shear_arm = np.empty_like(normal_arm) if "corrected-shear" in formulation else normal_arm
    for law in set(formulation[at_corners].tolist()):
        for numbers, corners in joints.by_corners(np.flatnonzero(at_corners & (formulation == law))):
            where, points = start[numbers, None] + np.arange(corners.shape[1]), corner_points(law, corners)
            normal_arm[where], shear_arm[where], area[where] = points.normal_arm, points.shear_arm, points.area
    for j, points in single.items():
        some = slice(start[j], start[j + 1])
        normal_arm[some], shear_arm[some], area[some] = points.normal_arm, points.shear_arm, points.area
    return PointTable(normal_arm, shear_arm, area, start, formulation == "convex", tolerance)


def edge_shortfall(joints: JointTable, points: PointTable, numbers: np.ndarray) -> np.ndarray:
    """Distance of the outermost contact points of some joints inside an edge of the polygon, over the distance of that
    edge from O; the greatest ratio over the edges (k,). A block that rocks about the edge topples too early by that
    fraction. Edges of a piece on whose line or outer side O lies are not edges of the whole joint and are skipped."""
    gaps = np.zeros(len(numbers))
    for place, j in enumerate(np.asarray(numbers).tolist()):
        corners = joints[j].polygon
        edge = np.roll(corners, -1, axis=0) - corners
        outward = np.stack([edge[:, 1], -edge[:, 0]], axis=1)
        far = (corners * outward).sum(axis=1)
        reached = (present(points[j]).normal_arm @ outward.T).max(axis=0)
        ahead = far > ROUNDING * np.abs(far).max()
        gaps[place] = float(((far - reached)[ahead] / far[ahead]).max(initial=0.0))
    return gaps


def largest_edge_shortfall(
    joints: JointTable, points: PointTable, chosen: bool = False, formulation: str = "distributed"
) -> tuple[float, int]:
    """The greatest `edge_shortfall` of the joints of a ``formulation``, and the index of that joint; (0, -1) if there
    are none. With ``chosen`` only joints whose points the program chose are considered."""
    numbers = [
        j
        for j, law in enumerate(joints.law)
        if law.formulation == formulation and not (chosen and law.points is not None)
    ]
    if not numbers:
        return 0.0, -1
    gaps = edge_shortfall(joints, points, np.array(numbers))
    return float(gaps.max()), numbers[int(np.argmax(gaps))]
