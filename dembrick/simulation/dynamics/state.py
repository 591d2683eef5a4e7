"""State of dynamics: the arrays of the loop, made from the immutable geometry, and the forces of joints.

Positions are measured from the middle of the scene, so that a wall far from the origin loses no digits.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dembrick.assembly.joints import JointTable
from dembrick.geometry.rotations import frame_quaternion
from dembrick.kernels.dynamics.area_tiles import Faces
from dembrick.kernels.dynamics.point_joints import Corners
from dembrick.kernels.dynamics.record import write_resultants
from dembrick.kernels.dynamics.rigid_bodies import Bodies
from dembrick.kernels.dynamics.tiles import FIXED, SEEN, WRENCHES, Links, W, rows_of_lanes
from dembrick.kernels.joint.ties import Ties
from dembrick.simulation.dynamics import joint_families
from dembrick.simulation.dynamics.memory_order import (
    LoopOrder,
    in_turn,
    memory_order,
    own_lanes,
    ways,
    without_rounding,
)
from dembrick.simulation.moving_ties import moving_ties

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly


class MovingState(NamedTuple):
    """State of a dynamic run; ``corners`` or ``faces`` is None if no joint is of that family."""

    bodies: Bodies
    links: Links
    corners: Corners | None
    faces: Faces | None
    ties: Ties
    middle: np.ndarray  # (3,) m, origin of positions
    order: LoopOrder | None = None  # of the blocks in the loop; None if it is that of the scenario

    @property
    def arrays(self) -> list[np.ndarray]:
        """All arrays that a run changes."""
        own = () if self.order is None else self.order.bodies
        return [*self.bodies, *own, *self.links, *joint_families.arrays(self), *self.ties]


def moving_state(assembly: Assembly) -> MovingState:
    """State at the start: nothing displaced, no force in any joint, nothing moves."""
    middle = assembly.position.mean(axis=0)
    table = JointTable.of(assembly.joints)
    order = memory_order(table, assembly.fixed)
    row = np.arange(len(assembly.fixed)) if order is None else np.argsort(order)
    fixings = _Fixings.of(assembly, table)
    turn = in_turn(row[table.block_a], row[table.block_b])
    corners, faces = joint_families.at_rest(assembly, turn, ways(table.axes[:, 2], fixings.numbers(table.area)))
    links = _links(table, fixings, corners, faces, row)
    bodies = _bodies(assembly, links, middle)
    links.put_seen(seen(bodies, links))
    links.kept[:] = links.seen[:, [0, 1, 3, 4]]
    ties = moving_ties(assembly.ties, assembly.position, assembly.rotation)
    own = None if order is None else LoopOrder(order, row, _in_order(bodies, links, order, row))
    return MovingState(bodies, links, corners, faces, ties, middle, own)


def _bodies(assembly: Assembly, links: Links, middle: np.ndarray) -> Bodies:
    n = len(assembly.names)
    side_start, side = _sides(n, links.host, links.other, links.place)
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
        side_start=side_start,
        side=side,
        guided=assembly.guided.astype(np.uint32),
        held=np.ascontiguousarray(assembly.held[assembly.guided]),
        guide=np.zeros((len(assembly.guided), 6)),
    )


def _in_order(bodies: Bodies, links: Links, order: np.ndarray, row: np.ndarray) -> Bodies:
    """A copy of the blocks in another ``order`` (n,), in which block i is ``row`` [i] (n,)."""
    guides = {"guided": row[bodies.guided].astype(np.uint32), "held": bodies.held, "guide": bodies.guide}
    lists = ("free", "side_start", "side", *guides)
    side_start, side = _sides(len(order), row[links.host], row[links.other], links.place)
    arrays = {name: array[order] for name, array in bodies._asdict().items() if name not in lists}
    free = np.sort(row[bodies.free]).astype(np.uint32)
    return Bodies(free=free, side_start=side_start, side=side, **guides, **arrays)


def _sides(n: int, host: np.ndarray, other: np.ndarray, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`Bodies.side_start` and `Bodies.side` of n blocks, the joints of each in their order."""
    blocks = np.concatenate([other, host])
    joints = np.tile(np.arange(len(host)), 2)
    order = np.lexsort((joints, blocks))
    sides = np.concatenate([2 * place.astype(np.int64), 2 * place.astype(np.int64) + 1])
    return np.searchsorted(blocks[order], np.arange(n + 1)).astype(np.uint32), sides[order].astype(np.uint32)


class _Fixings(NamedTuple):
    """Attachment of the polygons and planes of the joints to their blocks: fields as in `Links`, rows of its
    tiles."""

    host: np.ndarray
    other: np.ndarray
    tangents: np.ndarray
    plane: np.ndarray
    axes: np.ndarray
    lever: np.ndarray
    sense: np.ndarray
    offset: np.ndarray

    @classmethod
    def of(cls, assembly: Assembly, table: JointTable) -> _Fixings:
        a, b = table.block_a, table.block_b
        b_hosts = table.host == b
        host, other = np.where(b_hosts, b, a), np.where(b_hosts, a, b)
        arm_host = np.where(b_hosts[:, None], table.arm_b, table.arm_a)
        arm_other = np.where(b_hosts[:, None], table.arm_a, table.arm_b)
        sense = np.where(b_hosts, 1.0, -1.0)
        tangents, plane = (table.axes[:, :2] @ assembly.rotation[block] for block in (host, other))
        # adding zero makes -0 the same as 0
        axes, row = np.unique(np.concatenate([tangents, plane]) + 0.0, axis=0, return_inverse=True)
        row = row.reshape(2, len(table)).astype(np.uint32)
        lever = without_rounding(np.einsum("jik,jk->ji", table.axes, arm_host), lengths=True)
        offset = (arm_other * table.axes[:, 2]).sum(axis=1) - sense * table.gap
        offset = without_rounding(offset, lengths=True)
        return cls(host, other, row[0].copy(), row[1].copy(), axes, lever, sense, offset)

    def numbers(self, area: np.ndarray) -> np.ndarray:
        """Numbers (j, k) that describe the geometry of joints, with their areas (j,): equal for identical joints."""
        return np.column_stack([self.tangents, self.plane, self.sense, self.offset, self.lever, area])


def _links(
    table: JointTable, fixings: _Fixings, corners: Corners | None, faces: Faces | None, in_loop: np.ndarray
) -> Links:
    """The joints at the start; ``in_loop`` (n,): the row of each block in the loop."""
    n, host, other = len(table), fixings.host, fixings.other
    place, tiles, in_lanes = np.zeros(n, np.uint32), 0, [np.zeros((0, W), np.int64)]
    for family in (corners, faces):
        if family is not None:
            lanes = own_lanes(family.lane)
            where = W * np.arange(tiles, tiles + len(lanes))[:, None] + np.arange(W)
            place[family.joint[family.lane[lanes]]] = where[lanes]
            tiles += len(lanes)
            in_lanes.append(family.joint[family.lane])
    joint = np.concatenate(in_lanes)
    reach = np.empty(n)
    for numbers, outlines in table.by_corners():
        reach[numbers] = np.sqrt((outlines**2).sum(axis=2).max(axis=1))
    links = Links(  # type: ignore[call-arg]  # properties are no fields
        host=host.astype(np.uint32),
        other=other.astype(np.uint32),
        tangents=fixings.tangents,
        plane=fixings.plane,
        axes=fixings.axes,
        place=place,
        tiles=rows_of_lanes(tiles, FIXED),
        like=np.arange(tiles, dtype=np.uint32),
        seen_tiles=rows_of_lanes(tiles, SEEN),
        wrenches=rows_of_lanes(tiles * WRENCHES),
        ends=np.stack([in_loop[other[joint]], in_loop[host[joint]]], axis=1).astype(np.uint32),
        kept=np.zeros((n, 4)),
        reach=reach.astype(np.float32),
        slack=np.zeros(n, np.float32),
        glide=np.tile(np.array([1.0, 0.0, 1.0], np.float32), (n, 1)),
    )
    frames = np.array([frame_quaternion(pair) for pair in fixings.axes]).reshape(-1, 4)
    links.put("plane", frames[links.plane])
    links.put("tangents", frames[links.tangents])
    links.put("lever", fixings.lever)
    links.put("sense", fixings.sense)
    links.put("offset", fixings.offset)
    return links


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a x b for (j, 3) arrays: needed for every row of a record, and ``numpy.cross`` is slow for few vectors."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    for i, k, m in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., i] = a[..., k] * b[..., m] - a[..., m] * b[..., k]
    return out


def arms(bodies: Bodies, links: Links) -> tuple[np.ndarray, np.ndarray]:
    """Present arms of O from the centroids of the hosts (j, 3) and tangents e1, e2 (j, 2, 3), in world axes."""
    tangents = np.einsum("jik,jlk->jli", bodies.rotation[links.host], links.axes[links.tangents])
    frame = np.concatenate([tangents, cross(tangents[:, 0], tangents[:, 1])[:, None]], axis=1)
    return np.einsum("ji,jik->jk", links.lever, frame), tangents


def seen(bodies: Bodies, links: Links) -> np.ndarray:
    """`Links.seen` (j, 9) at the positions of ``bodies``."""
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
    """The same state, with the forces at its contact points recorded at every step."""
    if state.corners is None:
        return state
    return state._replace(corners=state.corners._replace(force=np.zeros((int(state.corners.start[-1]), 3))))


def contact_forces(state: MovingState, share: np.ndarray) -> np.ndarray:
    """Force (c, 3) on block b at every contact point of `with_contact_forces`, world axes (N), of the last forces.

    ``share`` (j,): part that the joints still carry, see `ContactDetection.left_to_joints`.
    """
    if state.corners is None:
        return np.zeros((0, 3))
    corners = state.corners
    signed = (state.links.sense * share)[corners.joint]  # b is the host where the sense is +1
    on_b = np.repeat(signed, np.diff(corners.start))
    return on_b[:, None] * corners.force


def contact_arms(state: MovingState, shift: np.ndarray) -> np.ndarray:
    """Position of every contact point on its host (c, 2), along the joint's tangents from the initial O (m).

    ``shift`` (j, 2): displacement of O since then, see `Polygons`.
    """
    if state.corners is None:
        return np.zeros((0, 2))
    corners = state.corners
    own = np.repeat(corners.joint, np.diff(corners.start))
    return np.column_stack([corners.x, corners.y]) + shift[own]


def contact_areas(state: MovingState) -> np.ndarray:
    """Present tributary area (c,) of every contact point (m2)."""
    return np.zeros(0) if state.corners is None else np.asarray(state.corners.area)


def out_of_balance(state: MovingState, gravity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Force (n, 3) and torque (n, 3) on every block under ``gravity`` (3,), loads and the last joint forces."""
    bodies, links = state.bodies, state.links
    found, wrench, each = bodies.applied.copy(), links.wrench, np.arange(6)
    found[:, :3] += bodies.mass[:, None] * gravity
    reaction = np.concatenate([-wrench[:, :3], wrench[:, 6:]], axis=1)
    for block, acting in ((links.host, wrench[:, :6]), (links.other, reaction)):  # by numbers, as rows take longer
        np.add.at(found.reshape(-1), (6 * block.astype(np.intp)[:, None] + each).ravel(), acting.ravel())
    return found[:, :3], found[:, 3:]
