"""Convex joints, in real time: the Python side of the area family.

The functions are those of `point_joints`, under the same names; `joint_families` calls them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dembrick.assembly.contact_points import PointTable
from dembrick.assembly.joints import JointTable
from dembrick.errors import HistoryError
from dembrick.geometry import friction_integrals, polygons
from dembrick.kernels.dynamics.area_tiles import FACE, SHEARED, FaceBonds, Faces
from dembrick.kernels.dynamics.tiles import rows_of_lanes
from dembrick.simulation.dynamics.memory_order import own_lanes, tiled, without_rounding
from dembrick.simulation.joint_laws import (
    bonded_at_start,
    check_pressures,
    elastic_stiffness,
    pressed_parts,
    room_of,
    strengths_of,
)

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.kernels.statics.area_joints import Areas

PART_OF_WEIGHT = 1e-5  # of the lighter block's weight: negligible force, as in head joints of a wall, which always slip
EQUAL = 12  # digits to which equal polygons agree: rounding makes those of a wall differ in the last one or two


def at_rest(assembly: Assembly, turn: np.ndarray, way: np.ndarray, first_tile: int) -> Faces | None:
    """The convex joints of an assembly, at rest, whose tiles begin with number ``first_tile``; None without any.
    ``turn``, ``way``: see `joint_families`."""
    joints, table = JointTable.of(assembly.joints), PointTable.of(assembly.contact_points)
    chosen = turn[table.resultant[turn]]
    if not len(chosen):
        return None
    laws = [joints.law[j] for j in chosen]
    check_pressures(joints, chosen)
    # cutting a polygon by a face adds at most as many corners as the face has
    longest = np.array([shape.longest_face for shape in assembly.shapes])
    most = np.maximum(longest[joints.block_a], longest[joints.block_b])[chosen]
    room = int((np.diff(joints.start)[chosen] + most).max())
    n = len(chosen)
    lane, used, _ = tiled(np.zeros(n), way[chosen], np.arange(n))
    own = own_lanes(lane)
    place = np.zeros(n, np.uint32)
    place[lane[own]] = np.arange(lane.size).reshape(lane.shape)[own]
    strengths = strengths_of(laws)
    faces = Faces(  # type: ignore[call-arg]  # properties are no fields
        joint=chosen.astype(np.uint32),
        tile=np.arange(len(used)) + first_tile,
        lane=lane,
        used=used,
        outline=np.zeros(n, np.uint32),
        place=place,
        like=np.arange(len(lane), dtype=np.uint32),
        tiles=rows_of_lanes(len(lane), FACE),
        sheared=rows_of_lanes(len(lane), SHEARED),
        twist=np.zeros((n, 3)),
        slip=np.zeros(n),
        count=np.zeros(0, np.int64),
        x=np.zeros((0, room)),
        y=np.zeros((0, room)),
        far=np.zeros((0, 42)),
        pressed=pressed_parts([law.pressure for law in laws], [room] * n),
        strengths=strengths,
        bonds=None if strengths is None else FaceBonds(bonded_at_start(laws), np.zeros(n)),
    )
    faces.tiles["radius"] = 1.0  # a divisor, in lanes without a joint too
    faces.put("k_n", [law.normal_stiffness for law in laws])
    faces.put("k_s", [law.shear_stiffness for law in laws])
    faces.put("friction", [law.friction for law in laws])
    faces.put("negligible", without_rounding(PART_OF_WEIGHT * _lightest(assembly, joints)[chosen]))
    number = np.zeros(len(joints), np.int64)  # among the convex joints
    number[chosen] = np.arange(n)
    for numbers, outlines in joints.by_corners(np.sort(chosen)):  # equal outlines are stored once
        size = np.abs(outlines).max(axis=(1, 2), keepdims=True)
        form = np.concatenate([(outlines / size).reshape(len(size), -1), np.log(size)[:, :, 0]], axis=1)
        _, first, which = np.unique(np.round(form, EQUAL) + 0.0, axis=0, return_index=True, return_inverse=True)
        rows = len(faces.count) + np.arange(len(first))
        faces = with_outlines(faces, len(faces.count) + len(first))
        put_outlines(faces, rows, outlines[first], number[numbers], which.reshape(-1))
    faces.share()
    return faces


def _lightest(assembly: Assembly, joints: JointTable) -> np.ndarray:
    """Weight of the lighter free block of each joint (j,), N."""
    weight = np.where(assembly.fixed, np.inf, np.asarray(assembly.mass) * np.linalg.norm(assembly.gravity))
    return np.minimum(weight[joints.block_a], weight[joints.block_b])


def with_outlines(faces: Faces, rows: int) -> Faces:
    """The same joints with room for exactly ``rows`` polygons."""
    if rows == len(faces.count):
        return faces
    table = {}
    for name in ("count", "x", "y", "far"):
        array = getattr(faces, name)[:rows]
        table[name] = np.concatenate([array, np.zeros((rows - len(array), *array.shape[1:]), array.dtype)])
    return faces._replace(**table)


def put_outlines(faces: Faces, rows: np.ndarray, outlines: np.ndarray, i: np.ndarray, which: np.ndarray) -> None:
    """Write polygons (g, m, 2) about their centroids, and their series, into ``rows`` (g,); and assign them to the
    convex joints ``i`` (k,), ``which`` (k,) to each, with the section properties that follow."""
    m = outlines.shape[1]
    faces.count[rows] = m
    faces.x[rows, :m], faces.y[rows, :m] = outlines[..., 0], outlines[..., 1]
    faces.far[rows] = friction_integrals.far_moments(outlines)
    faces.outline[i] = rows[which]
    second = np.stack(polygons.second_moments(outlines), axis=1)
    faces.put("area", polygons.area(outlines)[which], i)
    faces.put("second", second[which], i)
    reach = np.sqrt((outlines**2).sum(axis=2).max(axis=1))
    faces.put("reach", reach[which], i)
    faces.put("radius", friction_integrals.area_radius(outlines)[which], i)


def stiffness(faces: Faces) -> np.ndarray:
    """Elastic stiffness (a, 6, 6) of the closed joints, see `elastic_stiffness`."""
    yy, xx, xy = faces.second.T
    moments, k_n, k_s = (faces.area, 0.0, 0.0, xx, yy, xy), faces.k_n, faces.k_s
    return elastic_stiffness([k_s * a for a in moments], [k_n * a for a in moments])


def normal_stiffness(faces: Faces) -> np.ndarray:
    """The normal entry of `stiffness` (a,), N/m."""
    return faces.k_n * faces.area


def friction(faces: Faces) -> np.ndarray:
    """A copy of the friction of the joints (a,)."""
    return faces.friction.copy()


def put_friction(faces: Faces, values) -> None:
    """Set the friction of the joints to a number, or one for each."""
    faces.put("friction", values)
    faces.share()


def retire(faces: Faces, a: int) -> None:
    """Set the stiffness of joint ``a`` to zero, so that it carries nothing any more."""
    faces.put("k_n", 0.0, a)


def take_memory(faces: Faces, left: Areas, sense: np.ndarray) -> None:
    """Copy elastic shear resultants, plastic twists, slip and bonds of the same joints of statics; ``sense`` (j,) of
    the joints."""
    own, there = sense[faces.joint][:, None], np.argsort(np.argsort(faces.joint))  # in the order of the joints there
    faces.put_elastic(own * left.elastic[there])
    faces.twist[:], faces.slip[:] = own * left.twist[there], left.slip[there]
    if faces.bonds is not None and left.bonds is not None:
        faces.bonds.bonded[:], faces.bonds.rise[:] = left.bonds.bonded[there], left.bonds.rise[there]


def arrays(faces: Faces) -> list[np.ndarray]:
    """All arrays but the strengths, which are constant."""
    own = [array for array in faces if isinstance(array, np.ndarray)]
    return [*own, *(faces.pressed or ()), *(faces.bonds or ())]


def bonded(faces: Faces) -> np.ndarray:
    """The part of each joint's area whose bond is intact (a,)."""
    return np.zeros(len(faces.joint)) if faces.bonds is None else faces.bonds.bonded


def bonds(faces: Faces) -> np.ndarray:
    """Whether the bond of each joint holds, 1 or 0 (a,)."""
    return (bonded(faces) > 0.0).astype(np.int64)


memory = arrays  # there are no forces that are only recorded


def rooms(faces: Faces, snapshot) -> int:
    """Number of polygons for which the joints need room before ``snapshot`` is restored."""
    outline = snapshot.array("faces.outline", faces.outline)
    if int(outline.max()) >= len(faces.count) + len(outline):
        raise HistoryError(f"{snapshot.path}: faces.outline is outside the range of its polygons")
    return int(outline.max()) + 1


def check_restored(faces: Faces, path) -> None:
    """Raise HistoryError if indices restored from the checkpoint ``path`` are out of bounds."""
    faces.share()
    if (faces.count < 0).any() or (faces.count > faces.x.shape[1]).any():
        raise HistoryError(f"{path}: faces.count is outside the range of its polygons")
    part = faces.pressed
    if part is not None and ((part.count < 0).any() or (part.count > room_of(part)).any()):
        raise HistoryError(f"{path}: faces.pressed.count is outside the range of its polygons")
