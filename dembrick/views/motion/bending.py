"""How far the forces of the joints of a recorded run bend them: on their way to the edge of what can carry N."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from dembrick.theory.polygons import convex_hull

if TYPE_CHECKING:
    from dembrick.views.motion.joints import JointMotion

_GOLDEN = 0.5 * (5.0**0.5 - 1.0)
_SECTIONS = 40  # of half a turn: to 1e-8 of it


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


def way_to_edge(joints: JointMotion, N: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """(f, j): how far each ``centre`` of pressure (f, j, 2) m is on its way from O to the edge of what can carry ``N``
    (f, j): to the `edges`, or where a joint crushes to the middle of the strip along them that bears N at f_c."""
    normals, distances = joints.edges
    found = (np.einsum("jmk,fjk->fjm", normals, centre) / distances).max(axis=-1, initial=0.0)
    for j in np.flatnonzero(np.isfinite(joints.crushing)):
        own = slice(joints.point_start[j], joints.point_start[j + 1])
        arms, areas = joints.points[0][own], joints.points[2][own]
        whole = areas.sum() if len(areas) else joints.area[j]
        pressed = N[:, j] / joints.crushing[j]
        some = (pressed > 0.0) & (pressed < whole)
        polygon = joints.polygon[j, : joints.n_corner[j]]

        def reach(towards: np.ndarray, pressed=pressed[some], arms=arms, areas=areas, polygon=polygon) -> np.ndarray:
            return reach_of_points(arms, areas, towards, pressed) if len(arms) else reach_of(polygon, towards, pressed)

        found[some, j] = _way(centre[some, j], reach)
    return found


def crushed_share(joints: JointMotion, N: np.ndarray) -> np.ndarray:
    """(f, j): ``N`` (f, j) over what the whole of a joint bears, f_c A; zero where nothing crushes."""
    return np.maximum(N, 0.0) / (joints.crushing * joints.area)


def _way(centre: np.ndarray, reach: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """(k,): how far each ``centre`` (k, 2) m is on its way to the edge of a convex set about O, of which ``reach`` says
    how far it goes along unit vectors (k, 2): the greatest d . centre over it, which has one maximum over d."""
    size = np.hypot(*centre.T)
    along = np.divide(centre, size[:, None], out=np.tile([1.0, 0.0], (len(centre), 1)), where=size[:, None] > 0.0)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)

    def way(angle: np.ndarray) -> np.ndarray:
        towards = np.cos(angle)[:, None] * along + np.sin(angle)[:, None] * across
        return size * np.cos(angle) / reach(towards)

    low, high = np.full(len(centre), -0.5 * np.pi), np.full(len(centre), 0.5 * np.pi)
    for _ in range(_SECTIONS):
        step = _GOLDEN * (high - low)
        left = way(high - step) > way(low + step)
        high, low = np.where(left, low + step, high), np.where(left, low, high - step)
    return way(0.5 * (low + high))


def reach_of_points(arms: np.ndarray, areas: np.ndarray, towards: np.ndarray, pressed: np.ndarray) -> np.ndarray:
    """(k,) m: how far along unit vectors ``towards`` (k, 2) the middle of those points (c, 2) is that are farthest that
    way and have the areas ``pressed`` (k,) m2 of ``areas`` (c,), of the last one as much as is wanting."""
    height = towards @ arms.T
    order = np.argsort(-height, axis=1)
    area = areas[order]
    taken = np.clip(pressed[:, None] - (np.cumsum(area, axis=1) - area), 0.0, area)
    return (taken * np.take_along_axis(height, order, axis=1)).sum(axis=1) / pressed


def reach_of(polygon: np.ndarray, towards: np.ndarray, pressed: np.ndarray) -> np.ndarray:
    """(k,) m: how far along unit vectors ``towards`` (k, 2) the centroid of that part of a convex polygon (m, 2) is
    which a line across cuts off with the area ``pressed`` (k,) m2."""
    height, side = towards @ polygon.T, np.stack([-towards[:, 1], towards[:, 0]], axis=1) @ polygon.T
    level = -np.sort(-height, axis=1)
    # the width at the level of every corner (k, level, edge): between them it is linear
    start, end = height[:, None, :], np.roll(height, -1, axis=1)[:, None, :]
    meets = (start - level[..., None]) * (end - level[..., None]) <= 0.0
    way = np.divide(start - level[..., None], start - end, out=np.zeros(meets.shape), where=meets & (start != end))
    at = side[:, None, :] + way * (np.roll(side, -1, axis=1) - side)[:, None, :]
    width = np.where(meets, at, -np.inf).max(axis=-1) - np.where(meets, at, np.inf).min(axis=-1)
    # slabs from corner to corner, filled from the farthest on
    top, deep, wide, wider = level[:, :-1], level[:, :-1] - level[:, 1:], width[:, :-1], np.diff(width, axis=1)
    area = deep * (wide + 0.5 * wider)
    taken = np.clip(pressed[:, None] - (np.cumsum(area, axis=1) - area), 0.0, area)
    slope = np.divide(wider, deep, out=np.zeros_like(deep), where=deep > 0.0)
    root = wide + np.sqrt(np.maximum(wide**2 + 2.0 * slope * taken, 0.0))
    depth = np.divide(2.0 * taken, root, out=np.zeros_like(deep), where=root > 0.0)
    moment = top * taken - depth**2 * (0.5 * wide + slope * depth / 3.0)
    return moment.sum(axis=1) / pressed
