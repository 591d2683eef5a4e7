"""How far the forces of the joints of a recorded run bend them: on their way to the edge of what can carry N."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dembrick.theory.polygons import convex_hull

if TYPE_CHECKING:
    from dembrick.views.motion.joints import JointMotion


def edges(joints: JointMotion) -> tuple[np.ndarray, np.ndarray]:
    """Outward normals (j, m, 2) of the edges of what can carry the normal force of every joint, and their distances
    (j, m) from O (m); joints with fewer than m edges have normals of no length."""
    normal_arms, found = joints.points[0], []
    for j in range(joints.n_joint):
        own = normal_arms[joints.point_start[j] : joints.point_start[j + 1]]
        corners = own if len(own) else joints.polygon[j, : joints.n_corner[j]]
        hull = convex_hull(corners / joints.size[j])
        along = np.roll(hull, -1, axis=0) - hull
        outward = np.stack([along[:, 1], -along[:, 0]], axis=1) / np.hypot(*along.T)[:, None]
        found.append((outward, (hull * outward).sum(axis=1)))
    most = max((len(distance) for _, distance in found), default=0)
    normals, distances = np.zeros((joints.n_joint, most, 2)), np.ones((joints.n_joint, most))
    for j, (outward, distance) in enumerate(found):
        normals[j, : len(distance)], distances[j, : len(distance)] = outward, joints.size[j] * distance
    return normals, distances


def way_to_edge(normals: np.ndarray, distances: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """(f, j): how far each ``centre`` of pressure (f, j, 2) m is on its way from O to the `edges`."""
    return (np.einsum("jmk,fjk->fjm", normals, centre) / distances).max(axis=-1, initial=0.0)
