"""Resultants of surface pressures on the bare faces of blocks: force and centre of pressure.

On each face with the stated outward normal n the pressure p(z) = c0 + c1 z acts where it is positive and where no joint
covers the face. With dF = -n p dA, all parallel on one face, the resultant is F = -n int p dA at the centre of pressure
int p x dA / int p dA. Both integrals are exact: p x is quadratic, and the midpoint rule of triangles integrates that.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dembrick.errors import ScenarioError
from dembrick.geometry.shapes import parts_of
from dembrick.scenario.checks import show

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly

FACING = 1e-3  # rad: how far the normal of a loaded face may be off the stated direction
COPLANAR = 1e-6  # of the block's diameter: a joint so near a face lies on it


@dataclass(frozen=True)
class FaceForce:
    """A resultant: on ``block``, with its ``arm`` (3,) from the centroid to the centre of pressure (m, world at the
    start) and ``force`` (3,) (N)."""

    block: int
    arm: np.ndarray
    force: np.ndarray


def face_forces(pressure, members, bare: Assembly) -> list[FaceForce]:
    """Resultants of one pressure on the blocks ``members`` of an assembly, one a face; ScenarioError if no free block
    of them has a face that looks along its direction and feels it."""
    c0, c1 = pressure.at_height
    found = []
    for block in members:
        if bare.fixed[block]:
            continue
        covers = _joint_polygons(bare, block)
        shape, rotation = bare.shapes[block], bare.rotation[block]
        for place, part in parts_of(shape):
            for face, normal in zip(part.faces, part.face_normals @ rotation.T, strict=True):
                if np.linalg.norm(np.cross(normal, pressure.direction)) > FACING or normal @ pressure.direction < 0.0:
                    continue
                corners = bare.position[block] + (place + part.vertices[list(face)]) @ rotation.T
                total = _moments(corners, c0, c1)
                for cover in covers:
                    if np.abs((cover - corners[0]) @ normal).max() <= COPLANAR * shape.diameter:
                        total -= _moments(_ordered_like(cover, normal), c0, c1)
                if total[0] > COPLANAR**2 * abs(c0 + c1 * bare.position[block][2]) * shape.diameter**2:
                    centre = total[1:] / total[0]
                    found.append(FaceForce(int(block), centre - bare.position[block], -normal * total[0]))
    if not found:
        raise ScenarioError(
            f"the pressure on {show(pressure.block)}: no free block of it has a bare face with the outward normal "
            f"{show(tuple(round(x, 6) for x in pressure.direction))} that feels it; check block, direction and surface"
        )
    return found


def _joint_polygons(bare: Assembly, block: int) -> list[np.ndarray]:
    """World corners (m, 3) of the polygons of all joints of a block, convex pieces one by one."""
    joints = bare.joints
    polygons = []
    for j in np.flatnonzero((joints.block_a == block) | (joints.block_b == block)):
        joint = joints[int(j)]
        for piece in joint.pieces or (joint.polygon,):
            polygons.append(joint.origin + np.asarray(piece) @ joint.axes[:2])
    return polygons


def _ordered_like(corners: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """The corners, counterclockwise about ``normal``."""
    area = np.cross(corners - corners[0], np.roll(corners, -1, axis=0) - corners[0]).sum(axis=0)
    return corners if area @ normal > 0.0 else corners[::-1]


def _moments(corners: np.ndarray, c0: float, c1: float) -> np.ndarray:
    """int p dA and int p x dA (4,) over a convex polygon, corners (m, 3), of p = c0 + c1 z where p is positive."""
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
    """The part (k, 3) of a convex polygon in which a linear pressure, given at its corners (m,), is not negative."""
    kept = []
    for i in range(len(corners)):
        here, there = pressure[i - 1], pressure[i]
        if (here >= 0.0) != (there >= 0.0):
            kept.append(corners[i - 1] + here / (here - there) * (corners[i] - corners[i - 1]))
        if there >= 0.0:
            kept.append(corners[i])
    return np.array(kept).reshape(-1, 3)
