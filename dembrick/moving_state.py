"""From the immutable geometry to the arrays of the dynamic loop, and back to what joints carry.

Positions count from the middle of the scene, so that a wall far from the origin keeps its digits.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dembrick import limit_set, polygons
from dembrick.errors import ScenarioError
from dembrick.kernels.bodies import Bodies
from dembrick.kernels.moving_joints import Corners, Faces, Links

NEGLIGIBLE = 1e-5  # of the lighter block's weight: head joints of a wall carry so little, and slip all the time


class MovingState(NamedTuple):
    """What a dynamic run changes; ``corners`` or ``faces`` is None where no joint is of that family."""

    bodies: Bodies
    links: Links
    corners: Corners | None
    faces: Faces | None
    middle: np.ndarray  # (3,) m, what positions count from


def moving_state(assembly) -> MovingState:
    """State at the start: nothing displaced, no force in any joint, nothing moves."""
    middle = assembly.position.mean(axis=0)
    links = _links(assembly)
    bodies = _bodies(assembly, links, middle)
    links.seen[:] = seen(bodies, links)
    links.kept[:] = links.seen[:, [0, 1, 3, 4]]
    return MovingState(bodies, links, _corners(assembly), _faces(assembly), middle)


def _bodies(assembly, links: Links, middle: np.ndarray) -> Bodies:
    n = len(assembly.names)
    blocks = np.concatenate([links.other, links.host])
    sides = np.concatenate([2 * np.arange(len(links.other)), 2 * np.arange(len(links.host)) + 1])
    order = np.lexsort((sides, blocks))
    position = assembly.position - middle
    return Bodies(
        free=np.flatnonzero(~assembly.fixed).astype(np.int64),
        position=position,
        rotation=np.ascontiguousarray(assembly.rotation, float),
        orientation=np.array(assembly.orientation, float),
        velocity=np.zeros((n, 3)),
        spin=np.zeros((n, 3)),
        momentum=np.zeros((n, 3)),
        mass=np.array(assembly.mass, float),
        inverse=np.linalg.inv(assembly.inertia),
        reach=np.array([0.5 * shape.diameter for shape in assembly.shapes]),
        start=position.copy(),
        applied=np.zeros((n, 6)),
        side_start=np.searchsorted(blocks[order], np.arange(n + 1)).astype(np.int64),
        side=sides[order].astype(np.int64),
    )


def _links(assembly) -> Links:
    joints = assembly.joints
    n = len(joints)
    a = np.array([joint.block_a for joint in joints], np.int64)
    b = np.array([joint.block_b for joint in joints], np.int64)
    b_hosts = np.array([joint.host == joint.block_b for joint in joints], bool)
    axes = np.array([joint.axes for joint in joints]).reshape(-1, 3, 3)
    arm_a = np.array([joint.arm_a for joint in joints]).reshape(-1, 3)
    arm_b = np.array([joint.arm_b for joint in joints]).reshape(-1, 3)
    host, other = np.where(b_hosts, b, a), np.where(b_hosts, a, b)
    arm_host = np.where(b_hosts[:, None], arm_b, arm_a)
    arm_other = np.where(b_hosts[:, None], arm_a, arm_b)
    sense = np.where(b_hosts, 1.0, -1.0)
    gap = np.array([joint.gap for joint in joints], float)
    return Links(
        host=host,
        other=other,
        sense=sense,
        lever=np.einsum("jik,ji->jk", assembly.rotation[host], arm_host),
        tangents=np.ascontiguousarray(axes[:, :2] @ assembly.rotation[host]),
        plane=np.ascontiguousarray(axes[:, :2] @ assembly.rotation[other]),
        offset=(arm_other * axes[:, 2]).sum(axis=1) - sense * gap,
        viscous=np.zeros((n, 2)),
        seen=np.zeros((n, 9)),
        wrench=np.zeros((n, 9)),
        kept=np.zeros((n, 4)),
        reach=np.array([np.sqrt((joint.polygon**2).sum(axis=1).max()) for joint in joints]),
        slack=np.zeros(n),
    )


def _corners(assembly) -> Corners | None:
    chosen = [j for j, points in enumerate(assembly.contact_points) if points is not None]
    if not chosen:
        return None
    sets = [assembly.contact_points[j] for j in chosen]
    laws = [assembly.joints[j].law for j in chosen]
    arms = np.concatenate([s.normal_arm for s in sets])
    return Corners(
        joint=np.array(chosen, np.int64),
        start=np.concatenate([[0], np.cumsum([len(s.area) for s in sets])]).astype(np.int64),
        k_n=np.array([law.normal_stiffness for law in laws]),
        k_s=np.array([law.shear_stiffness for law in laws]),
        friction=np.array([law.friction for law in laws]),
        shear_arm=np.array([np.abs(s.shear_arm).max() / np.abs(s.normal_arm).max() for s in sets]),
        x=arms[:, 0].copy(),
        y=arms[:, 1].copy(),
        area=np.concatenate([s.area for s in sets]),
        elastic=np.zeros((len(arms), 2)),
        slip=np.zeros(len(arms)),
    )


def _faces(assembly) -> Faces | None:
    chosen = [j for j, points in enumerate(assembly.contact_points) if points is None]
    if not chosen:
        return None
    joints = [assembly.joints[j] for j in chosen]
    for joint in joints:
        if joint.law.pressure != "full":
            raise ScenarioError(
                f'pressure = "{joint.law.pressure}" is not followed by moving joints: use "full", or '
                'formulation = "distributed", whose friction follows its own pressure'
            )
    outlines = [np.asarray(joint.polygon, float) for joint in joints]
    # a polygon cut by a face has at most as many corners more
    most = [max(assembly.shapes[b].face_table.shape[1] for b in (joint.block_a, joint.block_b)) for joint in joints]
    room = [len(outline) + more for outline, more in zip(outlines, most, strict=True)]
    start = np.concatenate([[0], np.cumsum(room)]).astype(np.int64)
    n, total = len(joints), int(start[-1])
    faces = Faces(
        joint=np.array(chosen, np.int64),
        start=start[:-1].copy(),
        count=np.zeros(n, np.int64),
        k_n=np.array([joint.law.normal_stiffness for joint in joints]),
        k_s=np.array([joint.law.shear_stiffness for joint in joints]),
        friction=np.array([joint.law.friction for joint in joints]),
        x=np.zeros(total),
        y=np.zeros(total),
        area=np.zeros(n),
        negligible=NEGLIGIBLE * _lightest(assembly, joints),
        second=np.zeros((n, 3)),
        reach=np.zeros(n),
        radius=np.zeros(n),
        far=np.zeros((n, 42)),
        elastic=np.zeros((n, 3)),
        twist=np.zeros((n, 3)),
        slip=np.zeros(n),
    )
    for i, outline in enumerate(outlines):
        put_outline(faces, i, outline)
    return faces


def _lightest(assembly, joints) -> np.ndarray:
    """Weight of the lighter free block of each joint (j,), N."""
    weight = np.where(assembly.fixed, np.inf, np.asarray(assembly.mass) * np.linalg.norm(assembly.gravity))
    return np.array([min(weight[joint.block_a], weight[joint.block_b]) for joint in joints])


def put_outline(faces: Faces, i: int, outline: np.ndarray) -> None:
    """Give convex joint ``i`` a polygon (m, 2) about its centroid, and the numbers that follow from it."""
    first, m = faces.start[i], len(outline)
    faces.x[first : first + m], faces.y[first : first + m] = outline.T
    faces.count[i] = m
    faces.area[i] = polygons.area(outline)
    faces.second[i] = polygons.second_moments(outline)
    faces.reach[i] = np.sqrt((outline**2).sum(axis=1).max())
    faces.radius[i] = limit_set.area_radius(outline)
    faces.far[i] = limit_set.far_moments(outline)


def seen(bodies: Bodies, links: Links) -> np.ndarray:
    """`Links.seen` (j, 9) of where the blocks are now."""
    u = np.einsum("jik,jlk->jli", bodies.rotation[links.other], links.plane)
    axes = np.concatenate([u, np.cross(u[:, 0], u[:, 1])[:, None]], axis=1)
    turn = bodies.rotation[links.host]
    arm = np.einsum("jik,jk->ji", turn, links.lever) + bodies.position[links.host] - bodies.position[links.other]
    tangents = np.einsum("jik,jlk->jli", turn, links.tangents)
    vectors = np.concatenate([arm[:, None], tangents], axis=1)
    return np.einsum("jvi,jki->jvk", vectors, axes).reshape(-1, 9)


def joint_axes(bodies: Bodies, links: Links) -> np.ndarray:
    """Axes (j, 3, 3) of the joints now, as rows: t1 (of the host, in the plane), t2 and n from a to b, world."""
    u = np.einsum("jik,jlk->jli", bodies.rotation[links.other], links.plane)
    normal = np.cross(u[:, 0], u[:, 1])
    t1 = np.einsum("jik,jk->ji", bodies.rotation[links.host], links.tangents[:, 0])
    t1 -= (t1 * normal).sum(axis=1)[:, None] * normal
    t1 /= np.sqrt((t1**2).sum(axis=1))[:, None]
    return np.stack([t1, np.cross(normal, t1), normal], axis=1)


def joint_resultants(state: MovingState) -> np.ndarray:
    """N, V_1, V_2, M_T, M_1, M_2 (action on b about O) and slip of every joint (j, 7), of the last forces."""
    bodies, links = state.bodies, state.links
    axes = joint_axes(bodies, links)
    arm = np.einsum("jik,jk->ji", bodies.rotation[links.host], links.lever)
    force, torque = links.wrench[:, :3], links.wrench[:, 3:6] - np.cross(arm, links.wrench[:, :3])
    # the wrench acts on the host; b is the host where sense is +1. The joint pushes back on b: V, M are minus that.
    on_b = links.sense[:, None]
    f = np.einsum("jki,ji->jk", axes, on_b * force)
    t = np.einsum("jki,ji->jk", axes, on_b * torque)
    out = np.empty((len(links.host), 7))
    out[:, 0], out[:, 1], out[:, 2] = f[:, 2], -f[:, 0], -f[:, 1]
    out[:, 3], out[:, 4], out[:, 5] = -t[:, 2], -t[:, 0], -t[:, 1]
    out[:, 6] = joint_slip(state)
    return out


def joint_slip(state: MovingState) -> np.ndarray:
    """Length of the slip path of every joint (j,), averaged over its points by area (m)."""
    slip = np.zeros(len(state.links.host))
    if state.corners is not None:
        c = state.corners
        area = np.add.reduceat(c.area, c.start[:-1])
        slip[c.joint] = np.add.reduceat(c.area * c.slip, c.start[:-1]) / np.where(area > 0.0, area, 1.0)
    if state.faces is not None:
        slip[state.faces.joint] = state.faces.slip
    return slip


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
