"""Cut a solid that is not convex into convex parts along the planes of its own faces.

The hull of the solid is cut by the plane of a face that crosses it, and each piece by the next such plane, until no
face passes through the interior of a piece; each piece is then entirely inside or outside the solid (binary space
partition; Fuchs, Kedem and Naylor 1980). Inner pieces whose union is convex are merged again. Approximate
decompositions, as used for collisions in games, displace faces, and with them the joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from dembrick.errors import ScenarioError
from dembrick.geometry import clipping, polygons
from dembrick.geometry.convex_hull import FLAT, hull, mass_properties
from dembrick.geometry.shapes import Polyhedron

MOST_PARTS = 100  # of one block: a body with more is a scan or a statue, and its joints would be splinters
MOST_PIECES = 2000  # limit while cutting
CROSSES = 1e-9  # of the size squared: a face with less area inside a piece does not cross it
EXACT = 10.0 * FLAT  # of the volume: largest error of the sum of the parts, as files give few digits
CONVEX = FLAT  # of the volume: largest excess of the hull of two pieces that may be merged

Plane = tuple[np.ndarray, float]  # unit normal (3,), distance from the origin (m)


def convex_parts(points: np.ndarray, faces: Sequence[tuple[int, ...]]) -> list[Polyhedron]:
    """The convex parts of a solid with plane ``faces`` (indices of ``points`` (n, 3), counterclockwise from outside).

    Raises ScenarioError for a solid of too many parts, and if the parts do not add up to its volume.
    """
    size = float(np.ptp(points, axis=0).max())
    outlines = [points[list(face)] for face in faces]
    volume, _, _ = mass_properties(points, faces)
    planes = _planes(outlines, size)
    waiting, inside = [hull(points, inner=True)], []
    done = 0
    while waiting:
        piece, done = waiting.pop(), done + 1
        if done > MOST_PIECES:
            raise ScenarioError(_TOO_MANY)
        plane = _crossing(piece, planes, size)
        if plane is not None:
            waiting += _halves(piece, plane, size)
        elif _winding(piece.centroid, outlines) > 0.5:
            inside.append(piece)
    parts = _together(inside)
    if len(parts) > MOST_PARTS:
        raise ScenarioError(_TOO_MANY)
    held = sum(part.volume for part in parts)
    if not abs(held - volume) <= EXACT * volume:
        raise ScenarioError(
            f"the surface encloses {volume:.9g} m3, but its convex parts {held:.9g} m3: it crosses itself, or its "
            "faces are not quite plane; describe the block by convex parts"
        )
    return parts


_TOO_MANY = (
    f"the solid is not convex, and needs more than {MOST_PARTS} convex parts: it has curved or very many faces; "
    "simplify the mesh, or describe the block by convex parts"
)


def _planes(outlines: list[np.ndarray], size: float) -> list[tuple[Plane, list[np.ndarray]]]:
    """The distinct planes of the faces, each with its outlines (m, 3), those counterclockwise about its normal."""
    found: list[tuple[Plane, list[np.ndarray]]] = []
    for outline in outlines:
        area = 0.5 * np.cross(outline - outline[0], np.roll(outline, -1, axis=0) - outline[0]).sum(axis=0)
        length = float(np.linalg.norm(area))
        if length <= FLAT * size**2:
            continue
        normal = area / length
        offset = float((outline @ normal).mean())
        for (other, distance), own in found:
            sign = 1.0 if other @ normal > 0.0 else -1.0
            if np.abs(outline @ other - distance).max() <= FLAT * size:
                own.append(outline if sign > 0.0 else outline[::-1])
                break
        else:
            found.append(((normal, offset), [outline]))
    return found


def _crossing(piece: Polyhedron, planes: list[tuple[Plane, list[np.ndarray]]], size: float) -> Plane | None:
    """The plane with most face area inside a piece; None if no face passes through it."""
    best, most = None, CROSSES * size**2
    for plane, outlines in planes:
        heights, normal = _heights(piece, plane, size), plane[0]
        if heights.min() >= 0.0 or heights.max() <= 0.0:
            continue
        first = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
        first /= np.linalg.norm(first)
        axes = np.stack([first, np.cross(normal, first)], axis=1)
        section = _convex_polygon(_cut(piece, heights) @ axes)
        area = sum(_common_area(outline @ axes, section) for outline in outlines)
        if abs(area) > most:
            best, most = plane, abs(area)
    return best


def _heights(piece: Polyhedron, plane: Plane, size: float) -> np.ndarray:
    """Heights of the corners of a piece above a plane (k,) m; zero for those in it."""
    heights = (piece.vertices + piece.centroid) @ plane[0] - plane[1]
    heights[np.abs(heights) <= FLAT * size] = 0.0
    return heights


def _cut(piece: Polyhedron, heights: np.ndarray) -> np.ndarray:
    """The corners (k, 3) of the section of a piece where the linear field ``heights`` is zero."""
    corners = piece.vertices + piece.centroid
    found = [*corners[heights == 0.0]]
    for face in piece.faces:
        for i, j in zip(face, face[1:] + face[:1], strict=True):
            if i < j and heights[i] * heights[j] < 0.0:  # every edge once
                share = heights[i] / (heights[i] - heights[j])
                found.append(corners[i] + share * (corners[j] - corners[i]))
    return np.array(found)


def _convex_polygon(points: np.ndarray) -> np.ndarray:
    """Points in convex position (k, 2), counterclockwise about their centre."""
    arms = points - points.mean(axis=0)
    return points[np.argsort(np.arctan2(arms[:, 1], arms[:, 0]))]


def _common_area(outline: np.ndarray, section: np.ndarray) -> float:
    """Area that an outline (m, 2), convex or not, shares with a convex polygon: a sum over the triangles from its first
    corner, in which clockwise ones count as negative."""
    fan = np.stack([np.repeat(outline[:1], len(outline) - 2, axis=0), outline[1:-1], outline[2:]], axis=1)
    u, v = fan[:, 1] - fan[:, 0], fan[:, 2] - fan[:, 0]
    turn = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
    fan[turn < 0.0] = fan[turn < 0.0, ::-1]
    shared, count = clipping.clip(fan, np.repeat(section[None], len(fan), axis=0))
    areas = [polygons.area_and_centroid(own[:n])[0] if n >= 3 else 0.0 for own, n in zip(shared, count, strict=True)]
    return float(np.sign(turn) @ np.array(areas))


def _halves(piece: Polyhedron, plane: Plane, size: float) -> list[Polyhedron]:
    """The two parts of a piece on either side of a plane that crosses it."""
    heights = _heights(piece, plane, size)
    corners, section = piece.vertices + piece.centroid, _cut(piece, heights)
    sides = (heights > 0.0, heights < 0.0)
    return [hull(_distinct(np.concatenate([corners[side], section])), inner=True) for side in sides]


def _distinct(points: np.ndarray) -> np.ndarray:
    """The points (k, 3) without repeated ones."""
    near = np.abs(points[:, None] - points).max(axis=-1) <= FLAT * np.ptp(points, axis=0).max()
    return points[~np.tril(near, -1).any(axis=1)]


def _winding(point: np.ndarray, outlines: list[np.ndarray]) -> float:
    """Winding number of the surface about a point: 1 inside, 0 outside (van Oosterom and Strackee 1983)."""
    total = 0.0
    for outline in outlines:
        a, b, c = outline[:1] - point, outline[1:-1] - point, outline[2:] - point
        la, lb, lc = (np.linalg.norm(arm, axis=1) for arm in (a, b, c))
        above = (a * np.cross(b, c)).sum(axis=1)
        below = la * lb * lc + (a * b).sum(axis=1) * lc + (b * c).sum(axis=1) * la + (c * a).sum(axis=1) * lb
        total += float(np.arctan2(above, below).sum())
    return total / (2.0 * np.pi)


def _together(pieces: list[Polyhedron]) -> list[Polyhedron]:
    """Merge pieces in pairs where their union is convex, largest first."""
    parts = sorted(pieces, key=lambda piece: -piece.volume)
    while True:
        for a, b in combinations(range(len(parts)), 2):
            one, other = parts[a], parts[b]
            corners = np.concatenate([own.vertices + own.centroid for own in (one, other)])
            reach = 0.5 * (one.diameter + other.diameter)
            if np.linalg.norm(one.centroid - other.centroid) > reach:
                continue
            union = hull(_distinct(corners), inner=True)
            if union.volume - one.volume - other.volume <= CONVEX * union.volume:
                parts[a : a + 1], parts[b : b + 1] = [union], []
                break
        else:
            return parts
