"""Surface pressures on the bare faces of blocks: the faces on which they act, and their resultants at the start.

On each face with the stated outward normal n the pressure p(z) = c0 + c1 z acts where it is positive and no joint
covers the face. With dF = -n p dA, parallel all over the face, the resultant is F = -n int p dA at the centre of
pressure int p x dA / int p dA. Both integrals are exact: p x is quadratic, and the edge-midpoint rule on triangles
integrates it. For moving blocks, the polygons move with them, and `kernels.dynamics.block_loads` integrates over them
at every step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dembrick.errors import ScenarioError
from dembrick.geometry.clipping import clip
from dembrick.geometry.shapes import parts_of
from dembrick.scenario.checks import show

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.scenario.model import Scenario

FACING = 1e-3  # rad: largest angle between the normal of a loaded face and the stated direction
COPLANAR = 1e-6  # of the block's diameter: a joint this close to a face lies on it


@dataclass(frozen=True)
class FaceForce:
    """A resultant on a ``block``: ``arm`` (3,), from the centroid to the centre of pressure (m, world at the start),
    and ``force`` (3,) (N)."""

    block: int
    arm: np.ndarray
    force: np.ndarray


@dataclass(frozen=True)
class LoadedFace:
    """A face of ``block`` under a pressure: outward ``normal`` (3,), ``corners`` (m, 3), and ``covers`` (each (k, 3)),
    the polygons that cover it, counterclockwise about the normal; world, at the start."""

    block: int
    normal: np.ndarray
    corners: np.ndarray
    covers: tuple[np.ndarray, ...]


@dataclass(frozen=True, eq=False)
class PressurePolygons:
    """The polygons of all loaded faces, which move with their blocks: q polygons with c corners in total.

    ``block`` (q,); ``first`` (q + 1,): index of the first corner of each; ``corner`` (c, 3): m, from the centroid in
    body axes, counterclockwise seen from outside; ``sense`` (q,): 1, or -1 for a polygon that covers a face; the
    pressure is ``level`` + ``slope`` z where that is positive (q,), Pa and Pa/m, with z the height in the world;
    ``driven`` (q,): whether the load factor multiplies it.
    """

    block: np.ndarray
    first: np.ndarray
    corner: np.ndarray
    sense: np.ndarray
    level: np.ndarray
    slope: np.ndarray
    driven: np.ndarray


NO_POLYGONS = PressurePolygons(
    np.zeros(0, np.int64), np.zeros(1, np.int64), np.zeros((0, 3)), *(np.zeros(0),) * 3, np.zeros(0, bool)
)


def loaded_faces(pressure, members, bare: Assembly) -> list[LoadedFace]:
    """The faces of the free blocks among ``members`` whose normal is along the direction of a pressure."""

    def along(normal: np.ndarray) -> bool:
        return bool(np.linalg.norm(np.cross(normal, pressure.direction)) <= FACING and normal @ pressure.direction >= 0)

    return bare_faces(along, members, bare)


def bare_faces(wanted: Callable[[np.ndarray], bool], members, bare: Assembly) -> list[LoadedFace]:
    """The faces of the free blocks among ``members`` whose outward normal (3,) satisfies ``wanted``."""
    found = []
    for block in members:
        if bare.fixed[block]:
            continue
        shape, rotation, covers = bare.shapes[block], bare.rotation[block], None
        for number, (place, part) in enumerate(parts_of(shape)):
            for face, normal in zip(part.faces, part.face_normals @ rotation.T, strict=True):
                if not wanted(normal):
                    continue
                corners = bare.position[block] + (place + part.vertices[list(face)]) @ rotation.T
                covers = _joint_polygons(bare, block) if covers is None else covers
                siblings = _faces_against(bare, block, number, normal)
                on_face = _parts_on_face(corners, normal, covers + siblings, COPLANAR * shape.diameter)
                found.append(LoadedFace(int(block), normal, corners, on_face))
    return found


def face_forces(pressure, members, bare: Assembly, moving: bool = False) -> list[FaceForce]:
    """Resultants of one pressure on the blocks ``members`` of an assembly, one for each face on which it acts.

    Raises ScenarioError if there is no face in its direction, on a free block, on which it acts. With ``moving`` blocks
    it need not act at the start, except for a driven pressure.
    """
    faces = loaded_faces(pressure, members, bare)
    pressed = [(face, resultant(face, pressure.at_height, bare)) for face in faces]
    found = [FaceForce(face.block, arm, -face.normal * force) for face, (force, arm) in pressed if force > 0.0]
    if not found and not (moving and faces and not pressure.actuator):
        raise ScenarioError(
            f"the pressure on {show(pressure.block)}: no free block of it has a bare face with the outward normal "
            f"{show(tuple(round(x, 6) for x in pressure.direction))} on which it acts; check block, direction and "
            "surface"
        )
    return found


def resultant(face: LoadedFace, at_height: tuple[float, float], bare: Assembly) -> tuple[float, np.ndarray]:
    """int p dA (N) over the bare part of a face (0 if within rounding), and the arm (3,) from the centroid of its block
    to the centre of pressure (m)."""
    c0, c1 = at_height
    total = _moments(face.corners, c0, c1)
    for cover in face.covers:
        total -= _moments(cover, c0, c1)
    least = COPLANAR**2 * abs(c0 + c1 * bare.position[face.block][2]) * bare.shapes[face.block].diameter ** 2
    if total[0] <= least:
        return 0.0, np.zeros(3)
    return float(total[0]), total[1:] / total[0] - bare.position[face.block]


def pressure_polygons(scenario: Scenario, number: dict[str, int], bare: Assembly) -> PressurePolygons:
    """The polygons of all pressures of a scenario; ``number``: index of every block by name."""
    rows: list[tuple] = []
    for pressure in scenario.pressures:
        members = scenario.groups.get(pressure.block) or (number[pressure.block],)
        for face in loaded_faces(pressure, members, bare):
            for corners, sense in [(face.corners, 1.0), *((cover, -1.0) for cover in face.covers)]:
                local = (corners - bare.position[face.block]) @ bare.rotation[face.block]
                rows.append((face.block, local, sense, *pressure.at_height, pressure.actuator))
    if not rows:
        return NO_POLYGONS
    block, corner, senses, level, slope, driven = zip(*rows, strict=True)
    return PressurePolygons(
        block=np.array(block, np.int64),
        first=np.cumsum([0, *map(len, corner)]),
        corner=np.concatenate(corner),
        sense=np.array(senses),
        level=np.array(level),
        slope=np.array(slope),
        driven=np.array(driven, bool),
    )


def _parts_on_face(corners: np.ndarray, normal: np.ndarray, polygons: list, near: float) -> tuple[np.ndarray, ...]:
    """Parts of a face covered by convex polygons (k, 3) within ``near`` (m) of its plane; a joint may extend over
    several parts of a block."""
    flat = np.linalg.svd(corners - corners.mean(axis=0))[2][:2]
    axes = flat if np.cross(flat[0], flat[1]) @ normal > 0.0 else flat[::-1]
    face, found = (corners - corners[0]) @ axes.T, []
    for polygon in polygons:
        if np.abs((polygon - corners[0]) @ normal).max() > near:
            continue
        cover = (_ordered_like(polygon, normal) - corners[0]) @ axes.T
        shared, count = clip(face[None], cover[None])
        if count[0] >= 3:
            found.append(corners[0] + shared[0, : count[0]] @ axes)
    return tuple(found)


def _faces_against(bare: Assembly, block: int, number: int, normal: np.ndarray) -> list[np.ndarray]:
    """World corners (m, 3) of the faces of other convex parts of a block that face the opposite way to ``normal``, that
    of a face of its part ``number``."""
    rotation, found = bare.rotation[block], []
    for other, (place, part) in enumerate(parts_of(bare.shapes[block])):
        if other == number:
            continue
        for face, facing in zip(part.faces, part.face_normals @ rotation.T, strict=True):
            if facing @ normal <= FACING - 1.0:
                found.append(bare.position[block] + (place + part.vertices[list(face)]) @ rotation.T)
    return found


def _joint_polygons(bare: Assembly, block: int) -> list[np.ndarray]:
    """World corners (m, 3) of the polygons of all joints of a block, one per convex piece."""
    joints = bare.joints
    polygons = []
    for j in np.flatnonzero((joints.block_a == block) | (joints.block_b == block)):
        joint = joints[int(j)]
        for piece in joint.pieces or (joint.polygon,):
            polygons.append(joint.origin + np.asarray(piece) @ joint.axes[:2])
    return polygons


def _ordered_like(corners: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """The corners in counterclockwise order about ``normal``."""
    area = np.cross(corners - corners[0], np.roll(corners, -1, axis=0) - corners[0]).sum(axis=0)
    return corners if area @ normal > 0.0 else corners[::-1]


def _moments(corners: np.ndarray, c0: float, c1: float) -> np.ndarray:
    """int p dA and int p x dA (4,) over a convex polygon, corners (m, 3), of the positive part of p = c0 + c1 z."""
    corners = _under_pressure(corners, c0 + c1 * corners[:, 2])
    if len(corners) < 3:
        return np.zeros(4)
    a, b, c = np.broadcast_to(corners[0], corners[2:].shape), corners[1:-1], corners[2:]
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    sums = np.zeros(4)
    for middle in (0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)):
        weighted = area * (c0 + c1 * middle[:, 2]) / 3.0
        sums[0] += weighted.sum()
        sums[1:] += (weighted[:, None] * middle).sum(axis=0)
    return sums


def _under_pressure(corners: np.ndarray, pressure: np.ndarray) -> np.ndarray:
    """The part (k, 3) of a convex polygon where a linear pressure, given at its corners (m,), is not negative."""
    kept = []
    for i in range(len(corners)):
        here, there = pressure[i - 1], pressure[i]
        if (here >= 0.0) != (there >= 0.0):
            kept.append(corners[i - 1] + here / (here - there) * (corners[i] - corners[i - 1]))
        if there >= 0.0:
            kept.append(corners[i])
    return np.array(kept).reshape(-1, 3)
