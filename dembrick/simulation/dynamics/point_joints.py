"""Joints that act at contact points, in real time: the Python side of the point family.

The functions are those of `area_joints`, under the same names; `joint_families` calls them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dembrick.assembly.contact_points import PointTable
from dembrick.assembly.joints import JointTable
from dembrick.kernels.dynamics.point_joints import Corners
from dembrick.kernels.dynamics.point_laws import BOND
from dembrick.kernels.dynamics.tiles import POINT, SHEAR, W, rows_of_lanes
from dembrick.scenario.joint_laws import RECORD
from dembrick.simulation import joint_laws
from dembrick.simulation.dynamics.memory_order import own_lanes, rows_of_points, tiled, without_rounding
from dembrick.simulation.joint_laws import bonded_at_start, elastic_stiffness, strengths_of

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.kernels.statics.point_joints import Points
    from dembrick.scenario.joint_laws import CustomLaw, JointLaw


def at_rest(assembly: Assembly, turn: np.ndarray, way: np.ndarray) -> Corners | None:
    """The joints of an assembly that act at points, at rest; None without any. ``turn`` and ``way``: see
    `joint_families`."""
    joints, table = JointTable.of(assembly.joints), PointTable.of(assembly.contact_points)
    chosen = np.flatnonzero(~table.resultant)
    if not len(chosen):
        return None
    laws = [joints.law[j] for j in chosen]
    start = np.concatenate([[0], np.cumsum(np.diff(table.start)[chosen])])
    x, y = table.normal_arm.T.copy()
    farthest = np.maximum.reduceat(np.abs(table.normal_arm).max(axis=1), start[:-1])
    sheared = np.maximum.reduceat(np.abs(table.shear_arm).max(axis=1), start[:-1])
    shear_arm = np.divide(sheared, farthest, out=np.ones_like(farthest), where=farthest > 0.0)  # one point is at O
    values = [(k.normal_stiffness, k.shear_stiffness, k.friction) for k in laws]
    strengths = strengths_of(laws)
    more = np.zeros((len(laws), 0)) if strengths is None else np.column_stack([*strengths[:-1], bonded_at_start(laws)])
    distinct, one, law = np.unique(
        np.column_stack([values, np.round(shear_arm, 12), more]), axis=0, return_index=True, return_inverse=True
    )
    k_n, k_s, friction, shear_arm = np.ascontiguousarray(distinct[:, :4].T)
    law = law.reshape(-1)
    count = np.diff(start)
    own_turn = np.searchsorted(chosen, turn[~table.resultant[turn]])
    lane, used, width = tiled(law * (count.max() + 1) + count, way[chosen], own_turn, count)
    first = lane[:, 0]
    tile_start = np.concatenate([[0], np.cumsum(rows_of_points(count[first], width[first]))])
    place = np.zeros(len(chosen), np.uint32)
    own = own_lanes(lane)
    place[lane[own]] = (tile_start[:-1, None] * W + np.arange(W))[own]
    points = int(tile_start[-1])
    corners = Corners(  # type: ignore[call-arg]  # properties are no fields
        joint=chosen.astype(np.uint32),
        start=start.astype(np.uint32),
        width=width,
        place=place,
        law=law.astype(np.uint32),
        k_n=k_n.copy(),
        k_s=k_s.copy(),
        friction=friction.copy(),
        shear_arm=shear_arm.copy(),
        lane=lane,
        used=used,
        tile_law=law[first].astype(np.int64),
        tile_start=tile_start,
        like=np.arange(len(lane), dtype=np.uint32),
        points=rows_of_lanes(points, POINT),
        sheared=rows_of_lanes(points, SHEAR),
        slip=np.zeros(len(chosen)),
        force=None,
        strengths=None if strengths is None else strengths_of([laws[i] for i in one]),
        bonds=None if strengths is None else rows_of_lanes(points, BOND),
    )
    for field, values in (("x", x), ("y", y), ("area", table.area)):
        corners.put(field, without_rounding(values, lengths=field != "area"))
    corners.share()
    if corners.bonds is not None:
        corners.put("bonded", np.repeat(bonded_at_start(laws), count))
    if assembly.custom_law is not None:
        return _custom(corners, assembly.custom_law, laws)
    return corners


def _custom(corners: Corners, law: CustomLaw, laws: list[JointLaw]) -> Corners:
    """The same joints with a user-defined ``law``; ``laws`` (p,) are those of the scenario."""
    area = np.zeros(corners.points.size * W)
    given = np.zeros(area.size, np.int64)
    where = corners.where()
    area[where], given[where] = corners.area, np.repeat(np.arange(len(laws)), np.diff(corners.start))
    rows = joint_laws.rows_of(law, [laws[i] for i in given], area)
    return corners._replace(custom=rows)


def bonded(corners: Corners) -> np.ndarray:
    """The part of each joint's area whose bond is intact (p,)."""
    if corners.bonds is None:
        return np.zeros(len(corners.joint))
    area, starts = corners.area, corners.start[:-1]
    held = np.add.reduceat(area * corners.field("bonded"), starts)
    return held / np.maximum(np.add.reduceat(area, starts), 1e-300)


def bonds(corners: Corners) -> np.ndarray:
    """How many points of each joint have a bond that holds (p,)."""
    if corners.bonds is None:
        return np.zeros(len(corners.joint), np.int64)
    return np.add.reduceat(corners.field("bonded") > 0.0, corners.start[:-1], dtype=np.int64)


def stiffness(corners: Corners) -> np.ndarray:
    """Elastic stiffness (p, 6, 6) of the closed joints, see `elastic_stiffness`."""
    arm = np.repeat(corners.shear_arm[corners.law], np.diff(corners.start))
    area, x, y = corners.area, corners.x, corners.y
    k_n, k_s = corners.k_n[corners.law], corners.k_s[corners.law]
    return elastic_stiffness(
        [k_s * np.add.reduceat(area * a, corners.start[:-1]) for a in _moments(arm * x, arm * y)],
        [k_n * np.add.reduceat(area * a, corners.start[:-1]) for a in _moments(x, y)],
    )


def normal_stiffness(corners: Corners) -> np.ndarray:
    """The normal entry of `stiffness` (p,), N/m."""
    return corners.k_n[corners.law] * np.add.reduceat(corners.area, corners.start[:-1])


def _moments(x: np.ndarray, y: np.ndarray) -> tuple:
    return 1.0, x, y, x * x, y * y, x * y


def friction(corners: Corners) -> np.ndarray:
    """A copy of the friction of the laws (l,)."""
    return corners.friction.copy()


def put_friction(corners: Corners, values) -> None:
    """Set the friction of the laws to a number, or one for each; also in the records of a user-defined law."""
    corners.friction[:] = values
    if corners.custom is not None:
        of_points = np.repeat(corners.tile_law, np.diff(corners.tile_start))
        corners.custom.record[:, RECORD.index("friction")] = np.repeat(corners.friction[of_points], W)


def retire(corners: Corners, p: int) -> None:
    """Set the area and elastic shear of joint ``p`` to zero, so that it carries nothing any more."""
    corners.put("area", 0.0, p)
    corners.put("elastic", 0.0, p)


def take_memory(corners: Corners, left: Points, sense: np.ndarray) -> None:
    """Copy elastic shear forces, slip and bonds of the same points of statics; ``sense`` (j,) of the joints."""
    own = np.repeat(sense[corners.joint], np.diff(corners.start))
    corners.put("elastic", np.column_stack([own * left.elastic_1, own * left.elastic_2]))
    corners.slip[:] = left.path
    if corners.bonds is not None and left.bonds is not None:
        bonds = left.bonds
        for name in BOND.names or ():
            corners.put(name, getattr(bonds, name))


def arrays(corners: Corners) -> list[np.ndarray]:
    """All arrays but the strengths, which are constant."""
    own = () if corners.custom is None else corners.custom
    return [array for array in (*corners, *own) if isinstance(array, np.ndarray)]


def memory(corners: Corners) -> list[np.ndarray]:
    """All arrays but the forces that are only recorded."""
    return [array for array in arrays(corners) if array is not corners.force]


def check_restored(corners: Corners, path) -> None:
    """Find identical tiles again after a restore from the checkpoint ``path``."""
    corners.share()
