"""Joint polygons in motion: cut to the face that they lie on.

A polygon rides on its host. Where the host slides or twists past the edge of the other's face, part of it hangs over,
and what hangs over carries nothing. The number of contact points never changes, so that nothing jumps: a corner beyond
the edge moves to the nearest point of the face, and the tributary areas are those of the polygon that this makes; a
point of a ``distributed`` joint fades out while the edge passes through its cell; a ``convex`` joint, which is an
integral, is clipped. Shear memory stays with the points (and with the centroid of a convex joint).

Cutting costs as much as many thousand steps of a joint, so it is done only where a polygon has moved along its plane by
``STALE`` of its short side since the last time; polygons well inside the other's face wait until they reach its edge.
One that slides along an edge, as a prism in a trough, keeps its overlap: in the direction in which it has moved since
the last time it may go as far as no distance between its corners and the edges that matter changes by more than that.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from dembrick.assembly.joints import JointTable
from dembrick.geometry import polygons
from dembrick.geometry.clipping import clip, simplify
from dembrick.geometry.shapes import parts_of
from dembrick.simulation.dynamics import joint_families
from dembrick.simulation.dynamics.area_joints import put_outlines, with_outlines
from dembrick.simulation.dynamics.state import MovingState

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.assembly.joints import Joint

STALE = 2e-4  # of the polygon's short side
PARALLEL = 1.0 - 1e-4  # cosine: a polygon that moves so near to along an edge moves along it
GONE = 1e-9  # of the polygon's area at the start: less than that is no contact any more


class Polygons:
    """The polygons of all joints as they were at the start, and the faces they lie on.

    ``state``: the joints as they are now, with as much room for polygons as cutting has asked for; ``shift`` (j, 2):
    where O is now, from where it was on the host at the start (m, along e1 and e2); ``whole`` (j,): nothing of the
    polygon has been cut off; ``size`` (j,): greatest distance of a corner from O at the start (m); ``start`` (j, 9):
    `Links.seen` then.
    """

    def __init__(self, assembly: Assembly, state: MovingState):
        joints = JointTable.of(assembly.joints)
        self.state, self._joints, self._shapes = state, joints, assembly.shapes
        self._shared = joint_families.outlines(state)  # polygons that no joint has for itself
        self._points = assembly.contact_points
        self.start = state.links.seen.copy()
        self.bound = np.empty(len(joints))
        self.size = np.empty(len(joints))
        for numbers, outlines in joints.by_corners():
            self.bound[numbers] = STALE * polygons.width(outlines)
            self.size[numbers] = np.sqrt((outlines**2).sum(axis=2).max(axis=1))
        self.shift = np.zeros((len(joints), 2))
        self.whole = np.ones(len(joints), bool)
        self._face_of: dict[int, np.ndarray] = {}
        self._drawn: dict[int, Joint] = {}  # joints that were cut, as they were drawn
        self._place = {int(j): i for _, joints in joint_families.present(state) for i, j in enumerate(joints.joint)}
        state.links.slack[:] = self.bound

    def outlines(self):
        """Corners (k, m, 2) of the polygons as they were drawn, and the joints (k,) that have m corners."""
        return self._joints.by_corners()

    def stale(self) -> np.ndarray:
        """The joints whose polygons have moved too far."""
        links = self.state.links
        moved = links.seen[:, [0, 1, 3, 4]] - links.kept
        f1, f2, ratio = links.glide.T.astype(float)
        along, across = ratio * (moved[:, 0] * f1 + moved[:, 1] * f2), moved[:, 1] * f1 - moved[:, 0] * f2
        distance = np.hypot(along, across) + links.reach * np.hypot(moved[:, 2], moved[:, 3])
        # a little before the kernel does, whose square roots may round the other way
        return np.flatnonzero(distance >= links.slack.astype(float) * (1.0 - 1e-9))

    def cut_stale(self) -> int:
        """Cut all polygons that have moved too far; returns how many."""
        stale = self.stale()
        for j in stale.tolist():
            self._cut(j)
        return len(stale)

    def make_room(self, rows: int) -> None:
        """Have room for that many polygons of convex joints, and as a rule for more."""
        if self._room_for(rows) > len(self.state.faces.count):
            self.state = self.state._replace(faces=with_outlines(self.state.faces, self._room_for(rows)))

    def take_room(self, rows: int) -> None:
        """Have the room of a state with that many polygons, be it less than now, to go back to one."""
        if self.state.faces is not None:
            self.state = self.state._replace(faces=with_outlines(self.state.faces, self._room_for(rows)))

    def _room_for(self, rows: int) -> int:
        own = rows - self._shared
        return self._shared + max(8, 1 << (own - 1).bit_length()) if own > 0 else self._shared

    def _away(self) -> np.ndarray:
        """How far O of the start and both tangents have moved, in the plane's axes (j, 3, 3)."""
        now = self.state.links.seen
        away = (now - self.start).reshape(-1, 3, 3)
        away[:, 0] -= np.einsum("ji,jik->jk", self.shift, now[:, 3:].reshape(-1, 2, 3))
        return away

    def moved(self) -> np.ndarray:
        """How far the corners of each polygon have moved against the other block since the start (j,), at most (m)."""
        length = np.sqrt((self._away() ** 2).sum(axis=2))
        return length[:, 0] + self.size * np.hypot(length[:, 1], length[:, 2])

    def slipped(self) -> np.ndarray:
        """How far they have moved along its plane (j,), at most (m)."""
        length = np.sqrt((self._away()[:, :2, :2] ** 2).sum(axis=2))
        return length[:, 0] + self.size * length[:, 1]

    def retire(self, j: int) -> None:
        """Let joint ``j`` carry nothing any more."""
        links, i = self.state.links, self._place[j]
        for module, joints in joint_families.present(self.state):
            if i < len(joints.joint) and joints.joint[i] == j:
                module.retire(joints, i)
        links.slack[j] = np.inf  # it never needs to be cut again
        links.put_wrench(0.0, j)

    def _face(self, j: int) -> np.ndarray:
        """Corners (m, 2) of the other's face in the plane's axes from its centroid, counter-clockwise about m."""
        if j not in self._face_of:
            links = self.state.links
            sense = float(links.field("sense", j))
            a_is_other = sense > 0.0
            part = int((self._joints.part_a if a_is_other else self._joints.part_b)[j])
            place, shape = parts_of(self._shapes[links.other[j]])[part]
            u = links.axes[links.plane[j]]
            number = int(np.argmax(shape.face_normals @ (sense * np.cross(u[0], u[1]))))
            corners = (place + shape.vertices[list(shape.faces[number])]) @ u.T
            self._face_of[j] = corners if a_is_other else corners[::-1]
        return self._face_of[j]

    def _joint(self, j: int) -> Joint:
        """Joint ``j`` as it was drawn."""
        if j not in self._drawn:
            self._drawn[j] = self._joints[j]
        return self._drawn[j]

    def _cut(self, j: int) -> None:
        links, face, outline = self.state.links, self._face(j), self._joint(j).polygon
        seen = links.seen_of(j)
        tangents = seen[[[3, 4], [6, 7]]]
        origin = seen[:2] - self.shift[j] @ tangents  # where O of the start is now
        outside = polygons.distance_outside(origin + outline @ tangents, face)
        if self.whole[j] and not (outside > 0.0).any():
            links.slack[j] = self.bound[j] - float(outside.max())
        else:
            self.whole[j] = not (outside > 0.0).any()
            links.slack[j] = self.bound[j]
            cut = {"convex": self._clip, "distributed": self._fade}.get(self._joint(j).law.formulation, self._project)
            cut(j, self._place[j], origin, tangents, face)
        self._let_glide(j, seen[:2] - links.kept[j, :2], origin + outline @ tangents, face)
        links.kept[j] = links.seen_of(j)[[0, 1, 3, 4]]  # O may have moved

    def _let_glide(self, j: int, step: np.ndarray, placed: np.ndarray, face: np.ndarray) -> None:
        """Let joint ``j``, with corners ``placed`` (m, 2) on the ``face``, go on as it has moved by ``step`` (2,)."""
        links, length = self.state.links, math.hypot(*step)
        links.glide[j] = 1.0, 0.0, 1.0
        if not length > 0.0:
            return
        direction = step / length
        edge = np.roll(face, -1, axis=0) - face
        edge /= np.sqrt((edge**2).sum(axis=1))[:, None]
        parallel = int(np.argmax(np.abs(edge @ direction)))
        if abs(edge[parallel] @ direction) > PARALLEL:
            direction = edge[parallel]
        slack = float(links.slack[j])
        margin = math.sqrt(self._points[j].area.max()) if self._joint(j).law.formulation == "distributed" else 0.0
        far = room_along(placed, face, direction, 0.5 * self.bound[j], margin)
        if far > slack > 0.0:
            links.glide[j] = *direction, slack / far

    def _move_origin(self, j: int, to: np.ndarray) -> np.ndarray:
        """Put O of joint ``j`` at ``to`` (from O of the start, along e1 and e2); returns how far that is (2,)."""
        links = self.state.links
        step = to - self.shift[j]
        seen = links.seen_of(j)
        links.put("lever", links.field("lever", j) + [*step, 0.0], j)
        links.put_seen([*(seen[:3] + step @ seen[3:].reshape(2, 3)), *seen[3:]], j)
        self.shift[j] = to
        return step

    def _project(self, j: int, i: int, origin, tangents, face) -> None:
        """Corners beyond the edge move to the nearest point of the face."""
        corners = self.state.corners
        placed = polygons.nearest_points(origin + self._joint(j).polygon @ tangents, face)
        outline = (placed - origin) @ np.linalg.inv(tangents)
        area, x, y = polygons.area_and_centroid(outline)
        if not area > GONE * self._joint(j).area:
            corners.put("area", 0.0, i)
            return
        self._move_origin(j, np.array([x, y]))
        outline = outline - (x, y)
        corners.put("area", np.maximum(polygons.tributary_areas(outline), 0.0), i)
        start = self._points[j].normal_arm
        shrink = np.abs(start).max() / np.abs(self._joint(j).polygon).max()
        corners.put("x", shrink * outline[:, 0], i)
        corners.put("y", shrink * outline[:, 1], i)
        self.state.links.reach[j] = np.sqrt((outline**2).sum(axis=1).max())

    def _fade(self, j: int, i: int, origin, tangents, face) -> None:
        """A point loses its area while the edge passes through its cell."""
        corners, start = self.state.corners, self._points[j]
        cell = np.sqrt(start.area)

        def inside(o, t):
            return np.clip(0.5 - polygons.distance_outside(o + start.normal_arm @ t, face) / cell, 0.0, 1.0)

        seen = self.start[j]
        left = inside(origin, tangents) / inside(seen[:2], seen[[[3, 4], [6, 7]]])
        corners.put("area", start.area * np.minimum(left, 1.0), i)

    def _clip(self, j: int, i: int, origin, tangents, face) -> None:
        """The polygon of an integral is what both faces share."""
        faces, links = self.state.faces, self.state.links
        placed = origin + self._joint(j).polygon @ tangents
        shared, count = simplify(*clip(placed[None], face[None]), np.array([1e-9 * links.reach[j]]))
        outline = (shared[0, : int(count[0])] - origin) @ np.linalg.inv(tangents)
        area, x, y = polygons.area_and_centroid(outline) if len(outline) else (0.0, 0.0, 0.0)
        if not area > GONE * self._joint(j).area:
            faces.put("k_n", 0.0, i)
            return
        step = self._move_origin(j, np.array([x, y]))
        if faces.outline[i] < self._shared:
            self.make_room(int(faces.outline.max()) + 2)
            faces = self.state.faces
            faces.outline[i] = faces.outline.max() + 1
        put_outlines(faces, faces.outline[[i]], (outline - (x, y))[None], np.array([i]), np.array([0]))
        faces.put("k_n", self._joint(j).law.normal_stiffness, i)
        e1, e2, em = faces.elastic[i]
        faces.put_elastic([e1, e2, em - (step[0] * e2 - step[1] * e1)], i)
        links.reach[j] = faces.field("reach", i)


def room_along(points: np.ndarray, face: np.ndarray, direction: np.ndarray, change: float, margin: float) -> float:
    """How far (m) ``points`` (k, 2) can go along a ``direction``, either way, before the distance of one beyond an edge
    of a convex face changes by more than ``change`` (m); those further inside than ``margin`` (m) do not count."""
    edge = np.roll(face, -1, axis=0) - face
    outward = np.stack([edge[:, 1], -edge[:, 0]], axis=1) / np.sqrt((edge**2).sum(axis=1))[:, None]
    beyond = points @ outward.T - (face * outward).sum(axis=1) + margin
    rate = np.abs(outward @ direction)
    room = np.maximum(-beyond, 0.0) + change
    return float((room / np.maximum(rate, 1e-12)).min())
