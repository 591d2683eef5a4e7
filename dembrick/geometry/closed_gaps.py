"""Close the gaps between solids whose faces nearly touch: facing faces are moved onto one plane.

CAD models are drawn to some tolerance. Two facing faces whose gap or overlap is within it are meant to touch. All faces
linked in this way are given one common plane, their mean weighted by area; every solid is then rebuilt from its planes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dembrick.errors import ScenarioError
from dembrick.geometry import clipping, polygons
from dembrick.geometry.cad_file import Solid, linked
from dembrick.geometry.convex_hull import hull

_TOUCH = 1e-6  # of the smaller solid: faces this close touch already, see assembly.joint_detection
_ANGLE = 0.1  # rad: faces inclined by more do not face each other


class Gap(NamedTuple):
    """Two facing faces: indices of solids and faces, and their greatest distance (m)."""

    first: tuple[int, int]
    second: tuple[int, int]
    distance: float


class Face(NamedTuple):
    """A face in the world: outward unit ``normal``, ``offset`` along it, ``area``, corners (m, 3)."""

    normal: np.ndarray
    offset: float
    area: float
    corners: np.ndarray


def faces_of(solid: Solid) -> list[Face]:
    """The faces of a solid."""
    shape, corners = solid.shape, solid.corners
    offsets = (shape.face_offsets + shape.face_normals @ shape.centroid).tolist()
    planes = zip(shape.face_normals, offsets, shape.face_areas.tolist(), shape.faces, strict=True)
    return [Face(normal, offset, area, corners[list(numbers)]) for normal, offset, area, numbers in planes]


def gaps(solids: list[Solid], tolerance: float) -> list[Gap]:
    """Pairs of faces closer than ``tolerance`` (m) over the whole area that they share, but not yet touching."""
    faces = [faces_of(solid) for solid in solids]
    normals = [np.array([face.normal for face in own]) for own in faces]
    low = np.array([solid.corners.min(axis=0) for solid in solids]) - tolerance
    high = np.array([solid.corners.max(axis=0) for solid in solids]) + tolerance
    size = (high - low).max(axis=1)
    order = np.argsort(low[:, 0], kind="stable")
    found: list[Gap] = []
    for place, a in enumerate(order):
        for b in order[place + 1 :]:
            if low[b, 0] > high[a, 0]:
                break
            if (low[a] > high[b]).any() or (low[b] > high[a]).any():
                continue
            i, j = min(int(a), int(b)), max(int(a), int(b))
            for k, m in np.argwhere(normals[i] @ normals[j].T < -np.cos(_ANGLE)).tolist():
                distance = _distance(faces[i][k], faces[j][m], tolerance)
                if distance is not None and distance > _TOUCH * min(size[i], size[j]):
                    found.append(Gap((i, k), (j, m), distance))
    return found


def _distance(one: Face, two: Face, tolerance: float) -> float | None:
    """Greatest distance of two facing faces over the area that they share; None if it exceeds ``tolerance``, or if they
    share none."""
    apart = (two.corners - one.corners[0]) @ one.normal
    if apart.min() > tolerance or apart.max() < -tolerance:
        return None
    first = np.cross(one.normal, np.eye(3)[int(np.argmin(np.abs(one.normal)))])
    first /= np.linalg.norm(first)
    axes = np.stack([first, np.cross(one.normal, first)], axis=1)
    own, other = ((face.corners - one.corners[0]) @ axes for face in (one, two))
    corners, count = clipping.clip(own[None], other[None, ::-1])
    shared = corners[0, : count[0]]
    if len(shared) < 3:
        return None
    area, _, _ = polygons.area_and_centroid(shared)
    if area <= 0.5 * tolerance * polygons.perimeter(shared):  # a strip along an edge does not count
        return None
    # height of the second plane over the shared corners
    world = one.corners[0] + shared @ axes.T
    heights = (two.offset - world @ two.normal) / (one.normal @ two.normal)
    distance = float(np.abs(heights).max())
    return distance if distance <= tolerance else None


def close(solids: list[Solid], tolerance: float) -> tuple[list[Solid], list[Gap]]:
    """Close all :func:`gaps` within ``tolerance``; return the solids, and the gaps that were closed.

    Raises ScenarioError if a face would have to move by more than the tolerance, because faces linked through others
    are not in one plane.
    """
    found = gaps(solids, tolerance)
    if not found:
        return solids, []
    faces = [faces_of(solid) for solid in solids]
    planes = {(i, k): (face.normal, face.offset) for i, own in enumerate(faces) for k, face in enumerate(own)}
    moved: set[int] = set()
    for group in linked((gap.first, gap.second) for gap in found):
        reference = faces[group[0][0]][group[0][1]].normal
        chosen = [faces[i][k] for i, k in group]
        signs = np.sign([face.normal @ reference for face in chosen])
        areas = np.array([face.area for face in chosen])
        normal = (signs * areas) @ np.array([face.normal for face in chosen])
        normal /= np.linalg.norm(normal)
        middles = np.array([face.corners.mean(axis=0) for face in chosen])
        offset = float(areas @ (middles @ normal) / areas.sum())
        for (i, k), face, sign in zip(group, chosen, signs, strict=True):
            way = float(np.abs(face.corners @ normal - offset).max())
            if way > tolerance:
                raise ScenarioError(
                    f"closing the gaps at solid {solids[i].name!r} would move a face of it by {way:.3g} m, more than "
                    f"gap_tolerance = {tolerance:g} m: the faces that touch there do not lie in one plane; mend the "
                    "model, or use a smaller gap_tolerance"
                )
            planes[i, k] = sign * normal, float(sign * offset)
            moved.add(i)
    closed = [
        _cut(solid, [planes[i, k] for k in range(len(faces[i]))]) if i in moved else solid
        for i, solid in enumerate(solids)
    ]
    return closed, found


def _cut(solid: Solid, planes: list[tuple[np.ndarray, float]]) -> Solid:
    """The solid bounded by ``planes`` (outward normal, offset); corners are intersections of three that satisfy all."""
    middle = solid.corners.mean(axis=0)
    # dual of the half-spaces: a plane is the point normal / distance, a corner is a face of the hull of these points
    dual = hull(np.array([normal / (offset - normal @ middle) for normal, offset in planes]))
    corners = []
    for numbers in dual.faces:
        points = (dual.vertices + dual.centroid)[list(numbers)]
        corners.append(middle + np.linalg.lstsq(points, np.ones(len(points)), rcond=None)[0])
    return solid._replace(shape=hull(np.array(corners)))
