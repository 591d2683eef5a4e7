"""From the immutable geometry to the arrays of the dynamic loop, and back to what joints carry.

Positions count from the middle of the scene, so that a wall far from the origin keeps its digits.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dembrick.assembly.contact_points import PointTable
from dembrick.assembly.joints import JointTable
from dembrick.errors import ScenarioError
from dembrick.geometry import friction_integrals, polygons
from dembrick.geometry.rotations import frame_quaternion
from dembrick.kernels.dynamics.area_joints import Faces
from dembrick.kernels.dynamics.point_joints import Corners
from dembrick.kernels.dynamics.record import write_resultants
from dembrick.kernels.dynamics.rigid_bodies import Bodies
from dembrick.kernels.dynamics.tiles import (
    AREA,
    LEVER,
    OFFSET,
    PLANE,
    POINT,
    ROWS,
    SEEN,
    SENSE,
    TANGENTS,
    TILE,
    Links,
    W,
    X,
    Y,
    rows_of_lanes,
)

NEGLIGIBLE = 1e-5  # of the lighter block's weight: head joints of a wall carry so little, and slip all the time
FEW = 8  # directions of normals: more are of no use, and joints near each other should stay so
STRETCH = 512  # joints that are sorted by their direction at a time
EQUAL = 12  # digits to which polygons are the same: rounding makes those of a wall differ in the last one or two


class MovingState(NamedTuple):
    """What a dynamic run changes; ``corners`` or ``faces`` is None where no joint is of that family."""

    bodies: Bodies
    links: Links
    corners: Corners | None
    faces: Faces | None
    middle: np.ndarray  # (3,) m, what positions count from

    @property
    def families(self) -> list[Corners | Faces]:
        """The families of joints that there are."""
        return [family for family in (self.corners, self.faces) if family is not None]

    @property
    def arrays(self) -> list[np.ndarray]:
        """All arrays that a run changes."""
        parts = (self.bodies, self.links, self.corners, self.faces)
        return [array for part in parts if part is not None for array in part if array is not None]


def moving_state(assembly) -> MovingState:
    """State at the start: nothing displaced, no force in any joint, nothing moves."""
    middle = assembly.position.mean(axis=0)
    corners = _corners(assembly)
    faces = _faces(assembly, 0 if corners is None else len(corners.used))
    links = _links(assembly, corners, faces)
    bodies = _bodies(assembly, links, middle)
    links.put(SEEN, seen(bodies, links))
    links.kept[:] = links.seen[:, [0, 1, 3, 4]]
    return MovingState(bodies, links, corners, faces, middle)


def tiled(kind: np.ndarray, way: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Which of p joints each lane of t tiles has, (t, W), and how many of its lanes a tile uses, (t,).

    Joints of one ``kind`` (p,) side by side, of those the ones whose normals go the same ``way`` (p,): head joints of a
    wall slide all the time and beds hardly ever, and a tile where nothing slides is done sooner. But only within
    stretches of joints, so that what a tile wants of its blocks is still in the cache. The last joint stands again in
    lanes that are left over.
    """
    lanes, used = [np.zeros((0, W), np.uint32)], [np.zeros(0, np.int64)]
    for one in np.unique(kind):
        members = np.flatnonzero(kind == one)
        members = members[np.lexsort((way[members], np.arange(len(members)) // STRETCH))]
        tiles = -(-len(members) // W)
        padded = np.full(tiles * W, members[-1], np.uint32)
        padded[: len(members)] = members
        lanes.append(padded.reshape(tiles, W))
        used.append(np.minimum(len(members) - W * np.arange(tiles), W))
    return np.concatenate(lanes), np.concatenate(used)


def _ways(normals: np.ndarray) -> np.ndarray:
    """A number (p,) for the direction of each normal (p, 3); zero for all where there are more than a few."""
    _, way = np.unique(np.round(np.abs(normals), 6), axis=0, return_inverse=True)
    return way.reshape(-1) * (way.max() < FEW)


def _bodies(assembly, links: Links, middle: np.ndarray) -> Bodies:
    n = len(assembly.names)
    blocks = np.concatenate([links.other, links.host])
    sides = np.concatenate([2 * np.arange(len(links.other)), 2 * np.arange(len(links.host)) + 1])
    order = np.lexsort((sides, blocks))
    position = assembly.position - middle
    return Bodies(
        free=np.flatnonzero(~assembly.fixed).astype(np.uint32),
        position=position,
        rotation=np.array(assembly.rotation, float, order="C"),
        orientation=np.array(assembly.orientation, float),
        velocity=np.zeros((n, 3)),
        spin=np.zeros((n, 3)),
        momentum=np.zeros((n, 3)),
        mass=np.array(assembly.mass, float),
        inverse=np.linalg.inv(assembly.inertia),
        reach=np.array([0.5 * shape.diameter for shape in assembly.shapes]),
        start=position.copy(),
        applied=np.zeros((n, 6)),
        side_start=np.searchsorted(blocks[order], np.arange(n + 1)).astype(np.uint32),
        side=sides[order].astype(np.uint32),
    )


def _links(assembly, corners: Corners | None, faces: Faces | None) -> Links:
    table = JointTable.of(assembly.joints)
    n, a, b = len(table), table.block_a, table.block_b
    b_hosts = table.host == b
    host, other = np.where(b_hosts, b, a), np.where(b_hosts, a, b)
    arm_host = np.where(b_hosts[:, None], table.arm_b, table.arm_a)
    arm_other = np.where(b_hosts[:, None], table.arm_a, table.arm_b)
    sense = np.where(b_hosts, 1.0, -1.0)
    tangents, plane = (table.axes[:, :2] @ assembly.rotation[block] for block in (host, other))
    # adding zero makes -0 the same as 0
    axes, row = np.unique(np.concatenate([tangents, plane]) + 0.0, axis=0, return_inverse=True)
    row = row.reshape(2, n).astype(np.uint32)
    frames = np.array([frame_quaternion(pair) for pair in axes]).reshape(-1, 4)
    place, tiles = np.zeros(n, np.uint32), 0
    for family in (corners, faces):
        if family is not None:
            lanes = np.arange(W) < family.used[:, None]
            where = W * ROWS * np.arange(tiles, tiles + len(lanes))[:, None] + np.arange(W)
            place[family.joint[family.lane[lanes]]] = where[lanes]
            tiles += len(lanes)
    reach = np.empty(n)
    for numbers, outlines in table.by_corners():
        reach[numbers] = np.sqrt((outlines**2).sum(axis=2).max(axis=1))
    links = Links(
        host=host.astype(np.uint32),
        other=other.astype(np.uint32),
        tangents=row[0].copy(),
        plane=row[1].copy(),
        axes=axes,
        place=place,
        tiles=rows_of_lanes(tiles * TILE),
        wrench=np.zeros((n, 9)),
        kept=np.zeros((n, 4)),
        reach=reach.astype(np.float32),
        slack=np.zeros(n, np.float32),
    )
    links.put(PLANE, frames[links.plane])
    links.put(TANGENTS, frames[links.tangents])
    links.put(LEVER, np.einsum("jik,jk->ji", table.axes, arm_host))
    links.put(SENSE, sense[:, None])
    links.put(OFFSET, ((arm_other * table.axes[:, 2]).sum(axis=1) - sense * table.gap)[:, None])
    return links


def _corners(assembly) -> Corners | None:
    joints, table = JointTable.of(assembly.joints), PointTable.of(assembly.contact_points)
    chosen = np.flatnonzero(~table.resultant)
    if not len(chosen):
        return None
    laws = [joints.law[j] for j in chosen]
    start = np.concatenate([[0], np.cumsum(np.diff(table.start)[chosen])])
    x, y = table.normal_arm.T.copy()
    farthest = np.maximum.reduceat(np.abs(table.normal_arm).max(axis=1), start[:-1])
    shear_arm = np.maximum.reduceat(np.abs(table.shear_arm).max(axis=1), start[:-1]) / farthest
    values = [(k.normal_stiffness, k.shear_stiffness, k.friction) for k in laws]
    distinct, law = np.unique(np.column_stack([values, np.round(shear_arm, 12)]), axis=0, return_inverse=True)
    k_n, k_s, friction, shear_arm = np.ascontiguousarray(distinct.T)
    law = law.reshape(-1)
    count = np.diff(start)
    lane, used = tiled(law * (count.max() + 1) + count, _ways(joints.axes[chosen, 2]))
    first = lane[:, 0]
    tile_start = np.concatenate([[0], np.cumsum((count[first] + 1) // 2 * 2 * POINT)])
    place = np.zeros(len(chosen), np.uint32)
    own = np.arange(W) < used[:, None]
    place[lane[own]] = (tile_start[:-1, None] + np.arange(W))[own]
    corners = Corners(
        joint=chosen.astype(np.uint32),
        start=start.astype(np.uint32),
        place=place,
        law=law.astype(np.uint32),
        k_n=k_n.copy(),
        k_s=k_s.copy(),
        friction=friction.copy(),
        shear_arm=shear_arm.copy(),
        lane=lane,
        used=used,
        tile_law=law[first].astype(np.int64),
        tile_start=tile_start,
        points=rows_of_lanes(int(tile_start[-1])),
        force=None,
    )
    for row, values in ((X, x), (Y, y), (AREA, table.area)):
        corners.put(row, values)
    return corners


def _faces(assembly, first_tile: int) -> Faces | None:
    joints, table = JointTable.of(assembly.joints), PointTable.of(assembly.contact_points)
    chosen = np.flatnonzero(table.resultant)
    if not len(chosen):
        return None
    laws = [joints.law[j] for j in chosen]
    for law in laws:
        if law.pressure != "full":
            raise ScenarioError(
                f'pressure = "{law.pressure}" is not followed by moving joints: use "full", or '
                'formulation = "distributed", whose friction follows its own pressure'
            )
    # a polygon cut by a face has at most as many corners more
    longest = np.array([shape.longest_face for shape in assembly.shapes])
    most = np.maximum(longest[joints.block_a], longest[joints.block_b])[chosen]
    room = int((np.diff(joints.start)[chosen] + most).max())
    n = len(chosen)
    lane, used = tiled(np.zeros(n), _ways(joints.axes[chosen, 2]))
    faces = Faces(
        joint=chosen.astype(np.uint32),
        tile=np.arange(len(used)) + first_tile,
        lane=lane,
        used=used,
        outline=np.zeros(n, np.uint32),
        k_n=np.array([law.normal_stiffness for law in laws]),
        k_s=np.array([law.shear_stiffness for law in laws]),
        friction=np.array([law.friction for law in laws]),
        area=np.zeros(n),
        second=np.zeros((n, 3)),
        negligible=NEGLIGIBLE * _lightest(assembly, joints)[chosen],
        reach=np.zeros(n),
        radius=np.zeros(n),
        elastic=np.zeros((n, 3)),
        twist=np.zeros((n, 3)),
        slip=np.zeros(n),
        count=np.zeros(0, np.int64),
        x=np.zeros((0, room)),
        y=np.zeros((0, room)),
        far=np.zeros((0, 42)),
    )
    for numbers, outlines in joints.by_corners(chosen):
        size = np.abs(outlines).max(axis=(1, 2), keepdims=True)
        form = np.concatenate([(outlines / size).reshape(len(size), -1), np.log(size)[:, :, 0]], axis=1)
        _, first, which = np.unique(np.round(form, EQUAL) + 0.0, axis=0, return_index=True, return_inverse=True)
        rows = len(faces.count) + np.arange(len(first))
        faces = with_outlines(faces, len(faces.count) + len(first))
        put_outlines(faces, rows, outlines[first], np.searchsorted(chosen, numbers), which.reshape(-1))
    return faces


def _lightest(assembly, joints: JointTable) -> np.ndarray:
    """Weight of the lighter free block of each joint (j,), N."""
    weight = np.where(assembly.fixed, np.inf, np.asarray(assembly.mass) * np.linalg.norm(assembly.gravity))
    return np.minimum(weight[joints.block_a], weight[joints.block_b])


def with_outlines(faces: Faces, rows: int) -> Faces:
    """The same joints with room for that many polygons."""
    table = {}
    for name in ("count", "x", "y", "far"):
        array = getattr(faces, name)
        table[name] = np.concatenate([array, np.zeros((rows - len(array), *array.shape[1:]), array.dtype)])
    return faces._replace(**table)


def put_outlines(faces: Faces, rows: np.ndarray, outlines: np.ndarray, i: np.ndarray, which: np.ndarray) -> None:
    """Write polygons (g, m, 2) about their centroids, and their series, into the ``rows`` (g,) for them; and give the
    convex joints ``i`` (k,) ``which`` (k,) of them, with the numbers that follow."""
    m = outlines.shape[1]
    faces.count[rows] = m
    faces.x[rows, :m], faces.y[rows, :m] = outlines[..., 0], outlines[..., 1]
    faces.far[rows] = friction_integrals.far_moments(outlines)
    faces.outline[i] = rows[which]
    faces.area[i] = polygons.area(outlines)[which]
    faces.second[i] = np.stack(polygons.second_moments(outlines), axis=1)[which]
    faces.reach[i] = np.sqrt((outlines**2).sum(axis=2).max(axis=1))[which]
    faces.radius[i] = friction_integrals.area_radius(outlines)[which]


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a x b for (j, 3) arrays: every row of a record takes it, and ``numpy.cross`` is slow for few vectors."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for i, k, m in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., i] = a[..., k] * b[..., m] - a[..., m] * b[..., k]
    return out


def arms(bodies: Bodies, links: Links) -> tuple[np.ndarray, np.ndarray]:
    """Arms of O from the centroids of the hosts (j, 3) and tangents e1, e2 (j, 2, 3), world, where the blocks are."""
    tangents = np.einsum("jik,jlk->jli", bodies.rotation[links.host], links.axes[links.tangents])
    frame = np.concatenate([tangents, cross(tangents[:, 0], tangents[:, 1])[:, None]], axis=1)
    return np.einsum("ji,jik->jk", links.lever, frame), tangents


def seen(bodies: Bodies, links: Links) -> np.ndarray:
    """`Links.seen` (j, 9) of where the blocks are now."""
    u = np.einsum("jik,jlk->jli", bodies.rotation[links.other], links.axes[links.plane])
    axes = np.concatenate([u, cross(u[:, 0], u[:, 1])[:, None]], axis=1)
    arm, tangents = arms(bodies, links)
    arm = arm + bodies.position[links.host] - bodies.position[links.other]
    vectors = np.concatenate([arm[:, None], tangents], axis=1)
    return np.einsum("jvi,jki->jvk", vectors, axes).reshape(-1, 9)


def joint_resultants(state: MovingState) -> np.ndarray:
    """N, V_1, V_2, M_T, M_1, M_2 (action on b about O) and slip of every joint (j, 7), of the last forces."""
    out = np.empty((len(state.links.host), 7))
    write_resultants(state.bodies, state.links, state.corners, state.faces, out)
    return out


def with_contact_forces(state: MovingState) -> MovingState:
    """The same state, the forces at its contact points written down at every step."""
    if state.corners is None:
        return state
    return state._replace(corners=state.corners._replace(force=np.zeros((int(state.corners.start[-1]), 3))))


def contact_forces(state: MovingState, share: np.ndarray) -> np.ndarray:
    """Force (c, 3) on block b at every contact point of `with_contact_forces`, world axes (N), of the last forces.

    ``share`` (j,): what of it the joints still carry, see `ContactDetection.left_to_joints`.
    """
    if state.corners is None:
        return np.zeros((0, 3))
    corners = state.corners
    signed = (state.links.sense * share)[corners.joint]  # b is the host where the sense is +1
    on_b = np.repeat(signed, np.diff(corners.start))
    return on_b[:, None] * corners.force


def contact_arms(state: MovingState, shift: np.ndarray) -> np.ndarray:
    """Where every contact point is on its host (c, 2), along the joint's tangents from O of the start (m).

    ``shift`` (j, 2): where O is now, from there, see `Polygons`.
    """
    if state.corners is None:
        return np.zeros((0, 2))
    corners = state.corners
    own = np.repeat(corners.joint, np.diff(corners.start))
    return np.column_stack([corners.x, corners.y]) + shift[own]


def out_of_balance(state: MovingState, gravity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Force (n, 3) and torque (n, 3) on every block under ``gravity`` (3,), loads and the last joint forces."""
    bodies, links = state.bodies, state.links
    force = bodies.mass[:, None] * gravity + bodies.applied[:, :3]
    torque = bodies.applied[:, 3:].copy()
    np.add.at(force, links.host, links.wrench[:, :3])
    np.add.at(force, links.other, -links.wrench[:, :3])
    np.add.at(torque, links.host, links.wrench[:, 3:6])
    np.add.at(torque, links.other, links.wrench[:, 6:9])
    return force, torque
