"""Joints: facing faces of two blocks, their shared polygon and its axes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dembrick.assembly.broad_phase import Bodies, bodies_of, close_pairs
from dembrick.assembly.joint_detection import TOLERANCE, Contacts, shared_polygons
from dembrick.geometry.rotations import rotation_matrix
from dembrick.geometry.shapes import Shape
from dembrick.scenario.model import JointLaw


@dataclass(frozen=True, eq=False)
class Joint:
    """Two facing faces and their shared polygon.

    ``block_a``, ``block_b``: indices of the blocks; a comes first in the scenario, unless b alone is fixed (then they
    are swapped). ``host``: the block with the smaller face (b if equal); the polygon lies on that face and moves with
    it. ``origin`` (3,): centroid O of the polygon, world axes at the start; ``arm_a``, ``arm_b`` (3,): vectors to O
    from the centroids of a and b. ``axes`` (3, 3): rows t1, t2, n; n is the outward normal of a's face, t1 the first
    body axis of a that is not along n, projected onto the joint plane. ``polygon`` (m, 2): corners about O along t1 and
    t2, counterclockwise, no three collinear. ``area`` (m2). ``gap`` (m): distance of the faces at O, positive if open;
    rounding errors are stored as 0.

    Where blocks of several parts touch in one plane, all contact in it is one joint. Its ``pieces`` are the convex
    polygons (m, 2) about the common O, and ``polygon`` links them by edges traversed in both directions, so that sums
    over its edges equal those over the pieces. A convex joint has no pieces. ``part_a``, ``part_b``: the parts of the
    blocks on which the joint lies (for several pieces, those of the largest).
    """

    block_a: int
    block_b: int
    host: int
    origin: np.ndarray
    axes: np.ndarray
    polygon: np.ndarray
    area: float
    law: JointLaw
    gap: float
    arm_a: np.ndarray
    arm_b: np.ndarray
    pieces: tuple[np.ndarray, ...] = ()
    part_a: int = 0
    part_b: int = 0


_COLUMNS: dict[str, tuple[type, tuple[int, ...]]] = {  # fields of a joint that all joints share: type and shape
    **dict.fromkeys(("block_a", "block_b", "host", "part_a", "part_b"), (np.int64, ())),
    **dict.fromkeys(("area", "gap"), (float, ())),
    **dict.fromkeys(("origin", "arm_a", "arm_b"), (float, (3,))),
    "axes": (float, (3, 3)),
}


@dataclass(frozen=True, eq=False)
class JointTable(Sequence[Joint]):
    """All joints of a scene as columns (j, ...), named like the fields of :class:`Joint`; also a sequence of joints.

    ``corner`` (v, 2) holds the polygons one after another, each from its ``start`` (j + 1,); ``pieces`` maps the index
    of a joint to its pieces, for the few joints that have any.
    """

    block_a: np.ndarray
    block_b: np.ndarray
    host: np.ndarray
    origin: np.ndarray
    axes: np.ndarray
    corner: np.ndarray
    start: np.ndarray
    area: np.ndarray
    law: tuple[JointLaw, ...]
    gap: np.ndarray
    arm_a: np.ndarray
    arm_b: np.ndarray
    pieces: dict[int, tuple[np.ndarray, ...]]
    part_a: np.ndarray
    part_b: np.ndarray

    @staticmethod
    def of(joints: Sequence[Joint]) -> JointTable:
        """The table of a list of joints; a table is returned as it is."""
        if isinstance(joints, JointTable):
            return joints

        shapes = [np.asarray(joint.polygon, float) for joint in joints]
        columns: dict[str, Any] = {
            name: np.array([getattr(joint, name) for joint in joints], kind).reshape(-1, *shape)
            for name, (kind, shape) in _COLUMNS.items()
        }
        return JointTable(
            **columns,
            corner=np.concatenate([*shapes, np.empty((0, 2))]),
            start=np.cumsum([0, *map(len, shapes)]),
            law=tuple(joint.law for joint in joints),
            pieces={j: joint.pieces for j, joint in enumerate(joints) if joint.pieces},
        )

    def __len__(self) -> int:
        return len(self.block_a)

    def __getitem__(self, index):
        if isinstance(index, slice):
            return tuple(self[i] for i in range(*index.indices(len(self))))
        i = range(len(self))[index]  # handles negative indices, raises IndexError beyond the end
        values = {name: getattr(self, name)[i] for name in _COLUMNS}
        plain = {name: value if value.ndim else value.item() for name, value in values.items()}
        polygon = self.corner[self.start[i] : self.start[i + 1]]
        return Joint(**plain, polygon=polygon, law=self.law[i], pieces=self.pieces.get(i, ()))

    def by_corners(self, chosen=None) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Joints grouped by number of corners: indices (g,) and polygons (g, m, 2); of all joints or the ``chosen``."""
        numbers = np.arange(len(self)) if chosen is None else np.asarray(chosen)
        counts = (self.start[1:] - self.start[:-1])[numbers]
        for count in sorted(set(counts.tolist())):
            some = numbers[counts == count]
            yield some, self.corner[self.start[some, None] + np.arange(count)]


def find_joints(
    shapes: Sequence[Shape],
    positions,
    orientations,
    fixed,
    law_of: Callable[[int, int], JointLaw],
    tolerance: float = TOLERANCE,
    near: tuple[Bodies, np.ndarray] | None = None,
    unite: bool = True,
) -> JointTable:
    """All joints of a scene, in the order of their blocks.

    ``positions`` (n, 3), ``orientations`` (n, 4), ``fixed`` (n,). Faces are facing if they are antiparallel within
    ``tolerance`` (rad) and if their gap or overlap is at most ``tolerance`` times the diameter of the smaller block;
    their polygon must also be wider than that. There are no joints between two fixed blocks. ``near``: the convex parts
    of the blocks and their close pairs, if already known. Without ``unite``, each touching pair of parts has its own
    joint.
    """
    positions = np.asarray(positions, float).reshape(-1, 3)
    fixed = np.asarray(fixed, bool)
    if near is None:
        bodies = bodies_of(shapes, positions, rotation_matrix(np.asarray(orientations, float).reshape(-1, 4)))
        near = bodies, close_pairs(bodies, tolerance)
    bodies, pairs = near
    ends = bodies.owner[pairs]
    pairs = pairs[(ends[:, 0] != ends[:, 1]) & ~fixed[ends].all(axis=1)]
    pairs = np.where(fixed[bodies.owner[pairs[:, 1]]][:, None], pairs[:, ::-1], pairs)
    joints = _table(shared_polygons(bodies, pairs, tolerance), bodies, positions, law_of)
    several = np.bincount(bodies.owner, minlength=len(positions)) > 1
    if unite and several.any():
        return united(joints, several, tolerance)
    return joints


def _table(found: list[Contacts], bodies: Bodies, positions: np.ndarray, law_of) -> JointTable:
    """The contacts of all groups as one table, sorted by block."""

    def column(name, *shape, kind=float):
        return np.concatenate([getattr(contacts, name) for contacts in found] or [np.empty((0, *shape), kind)])

    body, count = column("body", 2, kind=np.int64), column("n_corner", kind=np.int64)
    ends = bodies.owner[body]
    order = np.lexsort((ends.max(axis=1), ends.min(axis=1)))
    old_start = np.cumsum(count) - count
    body, ends, count = body[order], ends[order], count[order]
    a, b = ends.T
    arm_a = column("arm_a", 3)[order] + bodies.arm[body[:, 0]]
    # polygons one after another, in the order of the joints
    packed = [c.polygon[np.arange(c.polygon.shape[1]) < c.n_corner[:, None]] for c in found]
    corner = np.concatenate([*packed, np.empty((0, 2))])
    start = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    where = np.repeat(old_start[order] - start[:-1], count) + np.arange(len(corner))
    return JointTable(
        block_a=a.copy(),
        block_b=b.copy(),
        host=np.where(column("a_hosts", kind=bool)[order], a, b),
        origin=positions[a] + arm_a,
        axes=column("axes", 3, 3)[order],
        corner=corner[where],
        start=start,
        area=column("area")[order],
        law=tuple(law_of(first, second) for first, second in ends.tolist()),
        gap=column("gap")[order],
        arm_a=arm_a,
        arm_b=column("arm_b", 3)[order] + bodies.arm[body[:, 1]],
        pieces={},
        part_a=body[:, 0] - np.searchsorted(bodies.owner, a),
        part_b=body[:, 1] - np.searchsorted(bodies.owner, b),
    )


def united(joints: JointTable, several: np.ndarray, tolerance: float) -> JointTable:
    """The table with coplanar joints of two blocks merged, where a block has ``several`` (n,) parts.

    Planes are equal if their normals differ by at most ``tolerance`` (rad) and their gaps by at most ``tolerance``
    times the distance of the polygons. The merged joint moves with the block that hosts its largest piece. Joints whose
    pressed part follows the bending moment are not merged, as that part is derived for a convex polygon.
    """
    planes: dict[tuple[int, int], list[list[Joint]]] = {}
    for joint in joints:
        found = planes.setdefault((joint.block_a, joint.block_b), [])
        unite = (several[joint.block_a] or several[joint.block_b]) and joint.law.pressure == "full"
        same = next((members for members in found if unite and _same_plane(members[0], joint, tolerance)), None)
        if same is None:
            found.append([joint])
        else:
            same.append(joint)
    together = [members for found in planes.values() for members in found]
    return JointTable.of([members[0] if len(members) == 1 else _union(members) for members in together])


def _same_plane(first: Joint, second: Joint, tolerance: float) -> bool:
    size = max(float(np.abs(joint.polygon).max()) for joint in (first, second))
    apart = second.arm_a - first.arm_a
    reach = size + float(np.linalg.norm(apart))
    parallel = float(np.linalg.norm(first.axes[2] - second.axes[2])) <= 2.0 * tolerance
    return parallel and abs(float(first.axes[2] @ apart)) <= 2.0 * tolerance * reach


def _union(members: list[Joint]) -> Joint:
    """Merge coplanar joints into one: common O, the pieces about it, and the polygon that links them."""
    main = max(members, key=lambda joint: joint.area)
    area = sum(joint.area for joint in members)
    shift = sum(joint.area * (joint.arm_a - main.arm_a) for joint in members) / area
    t1, t2, normal = main.axes
    shift = shift - (shift @ normal) * normal
    pieces = []
    for joint in members:
        corners = joint.arm_a - main.arm_a - shift + joint.polygon @ joint.axes[:2]
        pieces.append(corners @ main.axes[:2].T)
    arm_a = main.arm_a + shift
    polygon = _strung(pieces)
    origin = main.origin + shift
    arm_b = main.arm_b + shift
    return replace(main, origin=origin, polygon=polygon, area=area, arm_a=arm_a, arm_b=arm_b, pieces=tuple(pieces))


def _strung(pieces: list[np.ndarray]) -> np.ndarray:
    """Corners of all pieces as one closed path: from the first corner out to each piece, around it, and back."""
    home = pieces[0][0]
    walk = [pieces[0], home[None]]
    for piece in pieces[1:]:
        first = int(np.argmax(((piece - home) ** 2).sum(axis=1)))  # furthest from home, to avoid a step of length zero
        walk += [piece[first:], piece[: first + 1], home[None]]
    return np.concatenate(walk[:-1])
