"""Convex polyhedra from polygons, arch stones and point clouds, with exact mass properties.

Volume, centroid and inertia are sums over the tetrahedra between the faces and one interior point; they are exact for
the polyhedron that the vertices describe.
"""

from __future__ import annotations

import math

import numpy as np

from dembrick.errors import ScenarioError
from dembrick.geometry.rotations import rotation_matrix
from dembrick.geometry.shapes import Compound, Polyhedron

FLAT = 1e-6  # of the size of a shape: points this close to a plane or a line lie on it
_THIN = 1e-9  # volume over the cube of the size: a thinner shape has no volume
_SIDES = 1e-12  # of the size: least distance at which a point sees a face of the growing hull from outside


def from_faces(vertices, faces) -> Polyhedron:
    """The polyhedron with ``vertices`` (nv, 3) and ``faces`` (vertex indices, counterclockwise seen from outside)."""
    points = np.asarray(vertices, float)
    volume, centroid, inertia = mass_properties(points, faces)
    return Polyhedron(points - centroid, tuple(tuple(map(int, face)) for face in faces), volume, inertia, centroid)


def mass_properties(points: np.ndarray, faces) -> tuple[float, np.ndarray, np.ndarray]:
    """Volume (m3), centroid (3,) and inertia (3, 3) about it at unit density (m5) of a closed surface."""
    middle = points.mean(axis=0)
    triangles = np.array([(face[0], face[i], face[i + 1]) for face in faces for i in range(1, len(face) - 1)])
    a, b, c = (points[triangles[:, i]] - middle for i in range(3))
    sixfold = (a * np.cross(b, c)).sum(axis=1)
    total = a + b + c
    volume = float(sixfold.sum()) / 6.0
    if not abs(volume) > 0.0:
        return 0.0, middle, np.zeros((3, 3))
    centroid = sixfold @ total / (24.0 * volume)
    second = np.einsum("t,ti,tj->ij", sixfold, total, total)
    for corner in (a, b, c):
        second += np.einsum("t,ti,tj->ij", sixfold, corner, corner)
    second = second / 120.0 - volume * np.outer(centroid, centroid)
    return volume, middle + centroid, np.trace(second) * np.eye(3) - second


def prism(polygon, height: float) -> Polyhedron:
    """A convex ``polygon`` (m, 2) in the x-y plane, extruded from -height/2 to height/2 along z.

    Corners on the line of their neighbours are dropped. ScenarioError if the polygon is not convex.
    """
    corners = _convex_polygon(np.asarray(polygon, float))
    n = len(corners)
    ends = [np.column_stack([corners, np.full(n, z)]) for z in (-0.5 * height, 0.5 * height)]
    sides = [(i, (i + 1) % n, n + (i + 1) % n, n + i) for i in range(n)]
    return from_faces(np.concatenate(ends), [tuple(range(n))[::-1], tuple(range(n, 2 * n)), *sides])


def _convex_polygon(corners: np.ndarray) -> np.ndarray:
    """The corners counterclockwise, without those on the line of their neighbours; refuse non-convex polygons."""
    size = float(np.ptp(corners, axis=0).max())
    kept = list(range(len(corners)))
    i = 0
    while len(kept) >= 3 and i < len(kept):
        before, here, after = (corners[kept[k % len(kept)]] for k in (i - 1, i, i + 1))
        chord = after - before
        off = abs(_cross(chord, here - before))
        if np.hypot(*(here - before)) <= 1e-9 * size or off <= 1e-9 * size * max(np.hypot(*chord), 1e-9 * size):
            del kept[i]
            i = max(i - 2, 0)
        else:
            i += 1
    points = corners[kept]
    if len(points) < 3:
        raise ScenarioError("polygon: its corners lie on one line; a prism needs a polygon with an area")
    # convex and simple: all corners turn in the same sense, and the angles add up to one full turn
    edges = np.roll(points, -1, axis=0) - points
    following = np.roll(edges, -1, axis=0)
    turns = _cross(edges, following)
    angles = np.arctan2(turns, (edges * following).sum(axis=1))
    once = abs(abs(angles.sum()) - 2.0 * math.pi) < 1e-6
    if not once or (np.sign(turns) != np.sign(angles.sum())).any():
        wrong = int(np.argmax(np.sign(turns) != np.sign(angles.sum())))
        number = kept[(wrong + 1) % len(kept)] if once else kept[0]
        reason = f"it is not convex at corner {number}" if once else "its outline crosses itself"
        raise ScenarioError(f"polygon: {reason} (corners are counted from 0); describe the block by convex parts")
    return points if angles.sum() > 0.0 else points[::-1]


def _cross(a, b):
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def voussoir(radius: float, thickness: float, depth: float, angle: float, curved: bool) -> Polyhedron:
    """A stone of an arch in the x-z plane about the origin, its axis along z: ``angle`` in rad, ``depth`` along y.

    Faces and corners are those of the quadrilateral between the radial joints. With ``curved``, volume, centroid and
    inertia are those of the ring segment, which is outside the quadrilateral at the extrados and inside it at the
    intrados.
    """
    half, inner, outer = 0.5 * angle, radius - 0.5 * thickness, radius + 0.5 * thickness
    y = 0.5 * depth
    corners = [
        (s * r * math.sin(half), y0, r * math.cos(half)) for y0 in (-y, y) for r in (inner, outer) for s in (-1, 1)
    ]
    # 0, 1: intrados left and right, 2, 3: extrados left and right, at the front; 4 ... 7 the same at the back
    faces = ((0, 1, 3, 2), (5, 4, 6, 7), (1, 5, 7, 3), (4, 0, 2, 6), (2, 3, 7, 6), (4, 5, 1, 0))
    straight = from_faces(corners, faces)
    if not curved:
        return straight
    area = half * (outer**2 - inner**2)
    height = 2.0 * math.sin(half) * (outer**3 - inner**3) / (3.0 * area)
    quartic = 0.25 * (outer**4 - inner**4)
    both = math.sin(half) * math.cos(half)
    xx, zz = depth * quartic * (half - both), depth * (quartic * (half + both) - area * height**2)
    yy = area * depth**3 / 12.0
    centroid = np.array([0.0, 0.0, height])
    vertices = straight.vertices + straight.centroid - centroid
    return Polyhedron(vertices, straight.faces, area * depth, np.diag([yy + zz, xx + zz, xx + yy]), centroid)


def compound(parts, positions, orientations) -> Compound:
    """One rigid body of convex parts at ``positions`` with ``orientations``, in its own coordinates."""
    turned, centroids = [], []
    for part, position, orientation in zip(parts, positions, orientations, strict=True):
        rotation = rotation_matrix(orientation)
        vertices, inertia = part.vertices @ rotation.T, rotation @ part.inertia @ rotation.T
        centroids.append(np.asarray(position, float) + rotation @ part.centroid)
        turned.append(Polyhedron(vertices, part.faces, part.volume, inertia, centroids[-1]))
    volumes, centroids = np.array([part.volume for part in turned]), np.array(centroids)
    centroid = volumes @ centroids / volumes.sum()
    places = centroids - centroid
    inertia = sum(part.inertia for part in turned)
    inertia = inertia + (volumes * (places**2).sum(axis=1)).sum() * np.eye(3) - (places.T * volumes) @ places
    return Compound(tuple(turned), places, float(volumes.sum()), inertia, centroid)


def hull(points, inner: bool = False) -> Polyhedron:
    """The convex hull of points (n, 3), with coplanar triangles merged into faces.

    Points on a face or an edge are dropped. Raises ScenarioError if the points have no volume. A point inside the hull
    of the others is an error too, since it probably means a hole, unless ``inner`` points are expected.
    """
    points = np.asarray(points, float)
    size = float(np.ptp(points, axis=0).max())
    if not size > 0.0:
        raise ScenarioError("vertices: all points are the same; a block needs a volume")
    scaled = (points - points.mean(axis=0)) / size
    triangles = _triangulated_hull(scaled)
    faces = _merged(scaled, triangles)
    used = np.unique(np.concatenate([np.array(face) for face in faces]))
    number = {int(old): new for new, old in enumerate(used)}
    renumbered = [tuple(number[int(i)] for i in face) for face in faces]
    _check_closed(renumbered)
    shape = from_faces(points[used], renumbered)
    rest = np.setdiff1d(np.arange(len(points)), used)
    depth = (shape.face_offsets - (points[rest] - shape.centroid) @ shape.face_normals.T).min(axis=1)
    if len(rest) and depth.max() > 10.0 * FLAT * size and not inner:
        raise ScenarioError(
            f"vertices: point {int(rest[np.argmax(depth)])} (counted from 0) lies {depth.max():.6g} m inside the hull "
            "of the others; leave it out, or describe a block that is not convex by parts"
        )
    return shape


def _triangulated_hull(points: np.ndarray) -> np.ndarray:
    """Triangles (nt, 3) of the hull, grown point by point from the largest tetrahedron found."""
    first = int(np.argmin(points[:, 0]))
    second = int(np.argmax(((points - points[first]) ** 2).sum(axis=1)))
    line = points[second] - points[first]
    third = int(np.argmax((np.cross(line, points - points[first]) ** 2).sum(axis=1)))
    normal = np.cross(line, points[third] - points[first])
    heights = (points - points[first]) @ normal
    fourth = int(np.argmax(np.abs(heights)))
    if abs(heights[fourth]) <= _THIN:
        raise ScenarioError("vertices: the points lie in one plane (or nearly so); a block needs a volume")
    if heights[fourth] > 0.0:
        second, third = third, second
    # the first triangle faces away from the fourth point
    triangles = [(first, second, third), (first, fourth, second), (second, fourth, third), (third, fourth, first)]
    faces = np.array(triangles)
    order = np.argsort(
        -((points - points[[first, second, third, fourth]].mean(axis=0)) ** 2).sum(axis=1), kind="stable"
    )
    for new in order:
        if new in (first, second, third, fourth):
            continue
        a, b, c = (points[faces[:, i]] for i in range(3))
        normals = np.cross(b - a, c - a)
        lengths = np.sqrt((normals**2).sum(axis=1))
        seen = ((points[new] - a) * normals).sum(axis=1) > _SIDES * np.maximum(lengths, _SIDES)
        if not seen.any():
            continue
        lit = faces[seen]
        edges = np.concatenate([lit[:, [0, 1]], lit[:, [1, 2]], lit[:, [2, 0]]])
        reverse = {(int(j), int(i)) for i, j in edges}
        rim = np.array([edge for edge in edges if (int(edge[0]), int(edge[1])) not in reverse])
        faces = np.concatenate([faces[~seen], np.column_stack([rim, np.full(len(rim), new)])])
    return faces


def _merged(points: np.ndarray, triangles: np.ndarray) -> list[tuple[int, ...]]:
    """Faces as polygons: the points near the plane of each large triangle, ordered, without those on edges."""
    a, b, c = (points[triangles[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    areas = np.sqrt((normals**2).sum(axis=1))
    waiting = np.ones(len(triangles), bool)
    faces = []
    for t in np.argsort(-areas, kind="stable"):
        if not waiting[t] or areas[t] <= FLAT**2:
            continue
        normal = normals[t] / areas[t]
        on_plane = np.abs((points - a[t]) @ normal) <= FLAT
        same = on_plane[triangles].all(axis=1) & (normals @ normal > 0.0)
        waiting &= ~same
        faces.append(_ordered(points, np.flatnonzero(on_plane), normal))
    return faces


def _ordered(points: np.ndarray, chosen: np.ndarray, normal: np.ndarray) -> tuple[int, ...]:
    """The corners of the plane convex hull of the chosen points, counterclockwise about ``normal``."""
    first = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    first /= np.linalg.norm(first)
    plane = points[chosen] @ np.stack([first, np.cross(normal, first)], axis=1)
    arms = plane - plane.mean(axis=0)
    distance = np.hypot(arms[:, 0], arms[:, 1])
    turn = np.arctan2(arms[:, 1], arms[:, 0])
    # start at the corner furthest from the middle, which rounding cannot put between two others
    furthest = int(np.argmax(distance))
    order = np.lexsort((distance, (turn - turn[furthest]) % (2.0 * np.pi)))
    first_at = int(np.flatnonzero(order == furthest)[0])
    kept: list[int] = []
    for i in [*order[first_at:].tolist(), *order[:first_at].tolist(), furthest]:
        while len(kept) >= 2:
            u, v = plane[kept[-1]] - plane[kept[-2]], plane[i] - plane[kept[-2]]
            if _cross(u, v) > FLAT * np.hypot(*v):
                break
            kept.pop()
        kept.append(i)
    kept = kept[:-1]
    lowest = min(range(len(kept)), key=lambda k: (plane[kept[k]][0], plane[kept[k]][1]))
    return tuple(int(chosen[i]) for i in kept[lowest:] + kept[:lowest])


def _check_closed(faces) -> None:
    """Check that every edge has a face on either side; if not, points were too close together for a unique hull."""
    edges = {(face[i - 1], face[i]) for face in faces for i in range(len(face))}
    if any((j, i) not in edges for i, j in edges) or len(edges) != sum(map(len, faces)):
        raise ScenarioError(
            f"vertices: some points lie closer than {FLAT:g} of the block's size to an edge or a face of the others, "
            "so its faces are ambiguous; leave these points out or move them away"
        )
