"""Joint polygons in motion: cut to the face on which they lie.

A polygon is fixed to its host. If the host slides or twists past the edge of the other's face, the overhanging part
carries nothing. The number of contact points never changes, so that nothing jumps: a corner beyond
the edge moves to the nearest point of the face, and the tributary areas are those of the polygon that results; a
point of a ``distributed`` joint has the area that its cell shares with the face; a ``convex`` joint, which is an
integral, is clipped. Springs over the part that is cut off lose their shear; the rest keep theirs.

Cutting costs as much as many thousand steps of a joint, so it is done only after a polygon has moved along its plane by
``STALE`` of its short side since the last cut; polygons well inside the other's face wait until they reach its edge.
A polygon that slides along an edge, as a prism in a trough, keeps its overlap: in the direction of its motion since
the last cut it may go on until any distance between its corners and the relevant edges has changed by more than that.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dembrick.assembly.contact_points import PointTable
from dembrick.assembly.joints import JointTable
from dembrick.assembly.quadrature import cells_of
from dembrick.geometry import friction_integrals, polygons
from dembrick.geometry.shapes import parts_of
from dembrick.kernels.dynamics.polygon_clips import ORDER, Clipping, clip_area, must_clip
from dembrick.kernels.dynamics.polygon_cuts import Drawn, cut_points, find_stale
from dembrick.simulation.dynamics import joint_families
from dembrick.simulation.dynamics.area_joints import with_outlines
from dembrick.simulation.dynamics.known_types import KnownTypes
from dembrick.simulation.dynamics.state import MovingState

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly
    from dembrick.kernels.dynamics.point_joints import Corners

STALE = 2e-4  # of the polygon's short side


class Polygons:
    """The polygons of all joints at the start, and the faces on which they lie.

    ``state``: the present joints, with as much room for polygons as cutting has needed; ``shift`` (j, 2):
    displacement of O on the host since the start (m, along e1 and e2); ``whole`` (j,): whether nothing of the
    polygon is cut off; ``size`` (j,): greatest distance of a corner from O at the start (m); ``start`` (j, 9):
    `Links.seen` at the start.
    """

    def __init__(self, assembly: Assembly, state: MovingState):
        joints = JointTable.of(assembly.joints)
        self.state, self._joints, self._shapes = state, joints, assembly.shapes
        self._shared = joint_families.outlines(state)  # number of initial polygons, which joints may share
        self._points = PointTable.of(assembly.contact_points)
        self.start = state.links.seen.copy()
        self.bound = np.empty(len(joints))
        self.size = np.empty(len(joints))
        for numbers, outlines in joints.by_corners():
            self.bound[numbers] = STALE * polygons.width(outlines)
            self.size[numbers] = np.sqrt((outlines**2).sum(axis=2).max(axis=1))
        self.shift = np.zeros((len(joints), 2))
        self.whole = np.ones(len(joints), bool)
        self._drawn: dict[int, Drawn] = {}  # joints that have been looked at
        self._clipping: Clipping | None = None
        self._known, self._stale = KnownTypes(), np.zeros(len(joints), np.int64)
        self._place = {int(j): i for _, joints in joint_families.present(state) for i, j in enumerate(joints.joint)}
        state.links.slack[:] = self.bound

    def outlines(self):
        """Corners (k, m, 2) of the polygons as they were drawn, and the joints (k,) that have m corners."""
        return self._joints.by_corners()

    def stale(self) -> np.ndarray:
        """The joints whose polygons have moved too far."""
        links = self.state.links
        return self._stale[: self._known.call(self.state, find_stale, links, self._stale)].copy()

    def cut(self, stale: np.ndarray) -> None:
        """Cut the polygons of ``stale`` joints."""
        corners, _ = joint_families.springs(self.state)
        for j in stale.tolist():
            self._cut(j, corners)

    def cut_stale(self) -> int:
        """Cut all polygons that have moved too far; returns how many."""
        stale = self.stale()
        self.cut(stale)
        return len(stale)

    def make_room(self, rows: int) -> None:
        """Ensure room for ``rows`` polygons of convex joints, and usually for more."""
        if self._room_for(rows) > len(self.state.faces.count):
            self.state = self.state._replace(faces=with_outlines(self.state.faces, self._room_for(rows)))

    def take_room(self, rows: int) -> None:
        """Set the room to that of a state with ``rows`` polygons, even if that is less, before it is restored."""
        if self.state.faces is not None:
            self.state = self.state._replace(faces=with_outlines(self.state.faces, self._room_for(rows)))

    def _room_for(self, rows: int) -> int:
        own = rows - self._shared
        return self._shared + max(8, 1 << (own - 1).bit_length()) if own > 0 else self._shared

    def _away(self) -> np.ndarray:
        """Displacement of the initial O and changes of both tangents, in the plane's axes (j, 3, 3)."""
        now = self.state.links.seen
        away = (now - self.start).reshape(-1, 3, 3)
        away[:, 0] -= np.einsum("ji,jik->jk", self.shift, now[:, 3:].reshape(-1, 2, 3))
        return away

    def moved(self) -> np.ndarray:
        """Upper bound of the motion of each polygon's corners relative to the other block since the start (j,), m."""
        length = np.sqrt((self._away() ** 2).sum(axis=2))
        return length[:, 0] + self.size * np.hypot(length[:, 1], length[:, 2])

    def slipped(self) -> np.ndarray:
        """Upper bound of their motion along its plane (j,), m."""
        length = np.sqrt((self._away()[:, :2, :2] ** 2).sum(axis=2))
        return length[:, 0] + self.size * length[:, 1]

    def retire(self, j: int) -> None:
        """Disable joint ``j``, so that it carries nothing any more."""
        links, i = self.state.links, self._place[j]
        for module, joints in joint_families.present(self.state):
            if i < len(joints.joint) and joints.joint[i] == j:
                module.retire(joints, i)
        links.slack[j] = np.inf  # it never needs to be cut again
        links.put_wrench(0.0, j)

    def _face(self, j: int) -> np.ndarray:
        """Corners (m, 2) of the other's face in the plane's axes from its centroid, counter-clockwise about m."""
        links = self.state.links
        sense = float(links.field("sense", j))
        a_is_other = sense > 0.0
        part = int((self._joints.part_a if a_is_other else self._joints.part_b)[j])
        place, shape = parts_of(self._shapes[links.other[j]])[part]
        u = links.axes[links.plane[j]]
        number = int(np.argmax(shape.face_normals @ (sense * np.cross(u[0], u[1]))))
        corners = (place + shape.vertices[list(shape.faces[number])]) @ u.T
        return corners if a_is_other else corners[::-1]

    def _as_drawn(self, j: int) -> Drawn:
        """Joint ``j`` as it was drawn."""
        if j in self._drawn:
            return self._drawn[j]
        joint, points, face = self._joints[j], self._points[j], np.ascontiguousarray(self._face(j))
        outline, fades = np.array(joint.polygon, float), joint.law.formulation == "distributed"
        arms, areas = (np.zeros((0, 2)), np.zeros(0)) if points is None else (points.normal_arm, points.area)
        cells = cells_of(joint, self._points.tolerance) if fades else np.zeros((0, 4, 2))
        away = np.hypot(*(cells - arms[:, None]).T) if fades else np.zeros(1)
        self._drawn[j] = Drawn(
            face=face,
            outline=outline,
            arms=np.array(arms, float),
            areas=np.array(areas, float),
            cells=cells,
            placed=np.empty_like(outline),
            cut=np.empty_like(outline),
            **dict(zip(("x", "y", "spare_x", "spare_y"), np.zeros((4, 4 + len(face))), strict=True)),
            shift=self.shift[j],
            whole=self.whole[j : j + 1],
            area=float(joint.area),
            bound=float(self.bound[j]),
            shrink=float(np.abs(arms).max(initial=0.0) / np.abs(outline).max()),
            margin=float(away.max()),
            fades=fades,
        )
        return self._drawn[j]

    def _cut(self, j: int, corners: Corners | None) -> None:
        drawn, place, links = self._as_drawn(j), self._place[j], self.state.links
        if len(drawn.areas):
            self._known.call(self.state, cut_points, links, corners, place, j, drawn)
        elif self._known.call(self.state, must_clip, links, j, drawn):
            self._clip(j, place, drawn)

    def _clip(self, j: int, i: int, drawn: Drawn) -> None:
        """Clip the polygon of a convex joint to the intersection of both faces."""
        faces = self.state.faces
        if faces.outline[i] < self._shared:
            self.make_room(int(faces.outline.max()) + 2)
            faces = self.state.faces
            faces.outline[i] = faces.outline.max() + 1
        if self._clipping is None:
            self._clipping = clipping(faces.x.shape[1])
        stiffness = self._joints.law[j].normal_stiffness
        self._known.call(self.state, clip_area, self.state.links, faces, i, j, drawn, stiffness, self._clipping)


def clipping(room: int) -> Clipping:
    """Scratch arrays for polygons of up to ``room`` corners."""
    series = np.zeros((ORDER + 1, ORDER + 1, ORDER + 1))
    for n, matrix in friction_integrals.series_matrices().items():
        series[n, : n + 1, : n + 1] = matrix
    rule = np.ascontiguousarray(friction_integrals.triangle_rule())
    return Clipping(*np.zeros((4, room)), moments=np.zeros((ORDER + 1, ORDER + 1)), rule=rule, series=series)
