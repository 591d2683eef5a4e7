"""Bending utilisation of the joints of a recorded run: eccentricity of N over that at the edge of the joint."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from dembrick.theory.polygons import convex_hull

if TYPE_CHECKING:
    from dembrick.views.motion.joints import JointMotion

_GOLDEN = 0.5 * (5.0**0.5 - 1.0)
_SECTIONS = 40  # golden sections of half a turn, down to 1e-8 of it


def edges(joints: JointMotion) -> tuple[np.ndarray, np.ndarray]:
    """Outward normals (j, m, 2) of the edges of the region that can carry the normal force of each joint, and their
    distances (j, m) from O (m); joints with fewer than m edges are filled up with zero normals."""
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


def eccentricity_utilisation(joints: JointMotion, N: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """(f, j): distance of each ``centre`` of pressure (f, j, 2) m from O over its limit in that direction, the edge of
    the region that can carry ``N`` (f, j): the `edges`, or in a joint that crushes the middle of the strip along them
    that bears N at f_c."""
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
    """(f, j): ``N`` (f, j) over the crushing strength of the whole joint, f_c A; zero for joints that do not crush."""
    return np.maximum(N, 0.0) / (joints.crushing * joints.area)


def _way(centre: np.ndarray, reach: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """(k,): gauge of each ``centre`` (k, 2) m in a convex set about O whose support function ``reach`` takes unit
    vectors (k, 2): the greatest d . centre / reach(d), which has a single maximum over d."""
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
    """(k,) m: distance along unit vectors ``towards`` (k, 2) of the centroid of the farthest points in that direction.
    As many of the points ``arms`` (c, 2) m with ``areas`` (c,) are taken as give the area ``pressed`` (k,) m2, the last
    one in part."""
    height = towards @ arms.T
    order = np.argsort(-height, axis=1)
    area = areas[order]
    taken = np.clip(pressed[:, None] - (np.cumsum(area, axis=1) - area), 0.0, area)
    return (taken * np.take_along_axis(height, order, axis=1)).sum(axis=1) / pressed


def reach_of(polygon: np.ndarray, towards: np.ndarray, pressed: np.ndarray) -> np.ndarray:
    """(k,) m: distance along unit vectors ``towards`` (k, 2) of the centroid of the part of a convex polygon (m, 2) m
    that a line normal to them cuts off with the area ``pressed`` (k,) m2."""
    height, side = towards @ polygon.T, np.stack([-towards[:, 1], towards[:, 0]], axis=1) @ polygon.T
    level = -np.sort(-height, axis=1)
    # width at the level of every corner, from (k, level, edge); it is linear between levels
    start, end = height[:, None, :], np.roll(height, -1, axis=1)[:, None, :]
    meets = (start - level[..., None]) * (end - level[..., None]) <= 0.0
    way = np.divide(start - level[..., None], start - end, out=np.zeros(meets.shape), where=meets & (start != end))
    at = side[:, None, :] + way * (np.roll(side, -1, axis=1) - side)[:, None, :]
    width = np.where(meets, at, -np.inf).max(axis=-1) - np.where(meets, at, np.inf).min(axis=-1)
    # slabs between the levels of the corners, filled from the farthest inwards
    top, deep, wide, wider = level[:, :-1], level[:, :-1] - level[:, 1:], width[:, :-1], np.diff(width, axis=1)
    area = deep * (wide + 0.5 * wider)
    taken = np.clip(pressed[:, None] - (np.cumsum(area, axis=1) - area), 0.0, area)
    slope = np.divide(wider, deep, out=np.zeros_like(deep), where=deep > 0.0)
    root = wide + np.sqrt(np.maximum(wide**2 + 2.0 * slope * taken, 0.0))
    depth = np.divide(2.0 * taken, root, out=np.zeros_like(deep), where=root > 0.0)
    moment = top * taken - depth**2 * (0.5 * wide + slope * depth / 3.0)
    return moment.sum(axis=1) / pressed
