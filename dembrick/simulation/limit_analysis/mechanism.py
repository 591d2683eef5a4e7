"""The mechanism of a limit state: velocities of the blocks, and motions of the joints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from dembrick.simulation.limit_analysis.programme import Structure
from dembrick.simulation.mechanism import assembly_mechanism, crushes, fastest_blocks, joint_mechanism, nothing_between

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly

_CLOSED = 1e-6  # of the greatest normal force: joints that carry less are open


@dataclass(frozen=True)
class Mechanism:
    """``velocity`` (n, 6) of the blocks, translation of the centroid and rotation, at the rate 1 of the load's
    displacement; ``relative`` (j, 6) d1, d2, dn, r1, r2, rn of block b relative to a at O in the joint's axes;
    ``blocks`` that take part; ``joint``: the one that moves most among those under pressure; ``kind``: rocking,
    sliding, torsion, uplift, crushing, and torsion-shear of a single joint."""

    velocity: np.ndarray
    relative: np.ndarray
    blocks: np.ndarray
    joint: int
    kind: str


def names_of(assembly: Assembly, mechanism: Mechanism | None) -> list[str]:
    """Names of the blocks that move in a mechanism."""
    return [] if mechanism is None else [assembly.names[i] for i in mechanism.blocks]


def mechanism_of(structure: Structure, y: np.ndarray, resultants: np.ndarray, supports=None) -> Mechanism:
    """The mechanism from duals ``y`` of equilibrium and joint forces ``resultants`` (j, 6); ``supports``: prescribed
    velocities (n, 3), or with rotations (n, 6), of fixed blocks."""
    assembly, joints = structure.assembly, structure.assembly.joints
    velocity = structure.frame.velocities(y)
    if supports is not None:
        velocity[:, : supports.shape[1]] += supports
    relative = joint_motions(assembly, velocity)
    reach = np.zeros(len(joints))
    areas = structure.areas
    for joint, arm in ((structure.points.joint, structure.points.shear_arm), (areas.joint[areas.owner], areas.corner)):
        np.maximum.at(reach, joint, np.linalg.norm(arm, axis=1))
    pressed = resultants[:, 0] > _CLOSED * resultants[:, 0].max(initial=0.0)
    slid = np.hypot(relative[:, 0], relative[:, 1]) * pressed
    turned = reach * np.abs(relative[:, 5]) * pressed
    tilted = reach * np.hypot(relative[:, 3], relative[:, 4]) * pressed
    most = np.maximum(np.maximum(slid, turned), tilted)
    joint = int(np.argmax(most)) if len(most) else -1
    kind = assembly_mechanism(slid, turned, tilted)
    if len(joints) == 1:
        kind = joint_mechanism(relative[0, [0, 1, 5]], relative[0, 3:5], float(reach[0]))[1]
    strength = np.full(len(joints), np.inf)
    for part in (structure.points, areas):
        strength[part.joint] = part.crushing
    if crushes(-relative[:, 2], strength, slid, turned, tilted):
        kind = "crushing"
    moving = fastest_blocks(np.linalg.norm(velocity[:, :3], axis=1))
    weight = float(np.linalg.norm(assembly.dead_force[~assembly.fixed], axis=1).max())
    if nothing_between(moving, (joints.block_a, joints.block_b), resultants[:, 0], weight):
        kind = "uplift"
    return Mechanism(velocity, relative, moving, joint, kind)


def joint_motions(assembly: Assembly, velocity: np.ndarray) -> np.ndarray:
    """Motion (j, 6) of block b relative to a at O in the joint's axes, of blocks with ``velocity`` (n, 6)."""
    joints = assembly.joints
    relative = np.zeros((len(joints), 6))
    for block, sign in ((joints.block_a, -1.0), (joints.block_b, 1.0)):
        arm = joints.origin - assembly.position[block]
        moved = velocity[block, :3] + np.cross(velocity[block, 3:], arm)
        relative[:, :3] += sign * np.einsum("jik,jk->ji", joints.axes, moved)
        relative[:, 3:] += sign * np.einsum("jik,jk->ji", joints.axes, velocity[block, 3:])
    return relative
