"""From a scenario to its immutable geometry: blocks, joints, contact points, dead loads, and what is attached.

:func:`assemble` also refuses what cannot be a test: blocks that overlap or hang in the air, jacks that push beside
their block, joints too soft for their load. Its messages name the blocks and say how far off they are.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from typing import NoReturn

import numpy as np

from dembrick.assembly.actuators import (
    NO_ACTUATORS,
    NO_CONTROL_POINTS,
    Actuators,
    ControlPoints,
    check_inside,
    control_points,
    jacks,
    jacks_on_all_blocks,
)
from dembrick.assembly.block_shapes import shapes_of
from dembrick.assembly.broad_phase import Bodies, bodies_of, close_pairs, overlap_depths
from dembrick.assembly.contact_points import PointTable, place_points, widest_rim
from dembrick.assembly.joints import TOLERANCE, JointTable, find_joints
from dembrick.errors import ScenarioError
from dembrick.geometry import polygons
from dembrick.geometry.shapes import Shape, rotation_matrix, unit_quaternion
from dembrick.scenario.checks import show
from dembrick.scenario.controls import on_all_blocks
from dembrick.scenario.limits import check_magnitudes
from dembrick.scenario.model import JointLaw, Scenario

SOFT_WARNING = 1e-3  # elastic closing or sliding of a joint under its dead load, over its short side
SOFT_LIMIT = 1e-2
_QUASI_STATIC = ("yield", "displacement")
_DISCRETISATION = 1e-3  # tolerance of distributed points where the control has none
_FAR = 0.1  # of the smaller block's diameter: how far a message looks for the block that should have been touched


@dataclass(frozen=True, eq=False)
class Assembly:
    """A scenario as geometry. n blocks, in the order of the scenario; SI units; world axes at the start.

    ``position`` (n, 3) of the centroids, ``orientation`` (n, 4) unit quaternions, ``rotation`` (n, 3, 3) the same as
    matrices, ``mass`` (n,), ``inertia`` (n, 3, 3) about the centroid in body axes, ``velocity`` and
    ``angular_velocity`` (n, 3) at the start; ``dead_force`` and ``dead_torque`` (n, 3) about the centroid, gravity
    and loads together. ``contact_points``: one entry a joint, None for ``convex``. ``joint_force`` (n_joint, 3):
    what block a exerts on block b under the dead loads, see :func:`dead_joint_forces`; ``joint_force_exact`` says
    whether statics alone gives it. ``laws`` tells the law of joints and new contacts between any two blocks.
    """

    names: tuple[str, ...]
    shapes: tuple[Shape, ...]
    position: np.ndarray
    orientation: np.ndarray
    rotation: np.ndarray
    fixed: np.ndarray
    mass: np.ndarray
    inertia: np.ndarray
    velocity: np.ndarray
    angular_velocity: np.ndarray
    joints: JointTable
    contact_points: PointTable
    gravity: np.ndarray
    dead_force: np.ndarray
    dead_torque: np.ndarray
    joint_force: np.ndarray
    joint_force_exact: bool
    actuators: Actuators
    control_points: ControlPoints
    warnings: tuple[str, ...]
    laws: Laws


_NO_POINTS = place_points(JointTable.of(()), _DISCRETISATION)


def assemble(scenario: Scenario) -> Assembly:
    """Geometry, joints and dead loads of a scenario; ScenarioError where it cannot describe a test."""
    return loaded(scenario, at_rest(scenario))


def at_rest(scenario: Scenario) -> Assembly:
    """The blocks of a scenario and the joints between them, without any load."""
    blocks = scenario.all_blocks
    names = tuple(block.name for block in blocks)
    try:
        check_magnitudes(scenario)
        shapes = shapes_of(blocks, os.path.dirname(scenario.path or ""))
    except ScenarioError as error:
        _refuse(scenario, str(error))
    orientation = unit_quaternion([block.orientation for block in blocks])
    rotation = rotation_matrix(orientation)
    centroid = np.array([shape.centroid for shape in shapes])
    position = np.array([block.position for block in blocks], float) + np.einsum("nij,nj->ni", rotation, centroid)
    fixed = np.array([block.fixed for block in blocks], bool)
    density = np.array([scenario.materials[block.material].density for block in blocks])
    mass = density * [shape.volume for shape in shapes]
    quasi_static = scenario.control.kind in _QUASI_STATIC or on_all_blocks(scenario.control)

    if quasi_static and not fixed.any():
        kind = show(scenario.control.kind)
        _refuse(scenario, f"no block is fixed, and a test of kind {kind} needs a support: give one fixed = true")
    bodies = bodies_of(shapes, position, rotation)
    pairs = close_pairs(bodies, TOLERANCE)
    _check_overlap(scenario, bodies, pairs)

    laws = Laws(scenario)
    # moving joints are cut by the faces they slide over, so that each keeps to one pair of convex parts
    unite = scenario.control.kind in ("yield", "displacement")
    joints = find_joints(shapes, position, orientation, fixed, laws.between, TOLERANCE, (bodies, pairs), unite)
    _check_pieces(scenario, joints)
    _check_overrides(scenario, laws, joints, fixed)
    level = _levels(joints, fixed)
    if quasi_static and (level < 0).any():
        _refuse_unsupported(scenario, shapes, position, orientation, fixed, level < 0)

    nothing = np.zeros((len(blocks), 3))
    return Assembly(
        names=names,
        shapes=shapes,
        position=position,
        orientation=orientation,
        rotation=rotation,
        fixed=fixed,
        mass=mass,
        inertia=density[:, None, None] * np.array([shape.inertia for shape in shapes]),
        velocity=np.array([block.velocity for block in blocks], float),
        angular_velocity=np.array([block.angular_velocity for block in blocks], float),
        joints=joints,
        contact_points=_NO_POINTS,
        gravity=np.zeros(3),
        dead_force=nothing,
        dead_torque=nothing,
        joint_force=np.zeros((len(joints), 3)),
        joint_force_exact=True,
        actuators=NO_ACTUATORS,
        control_points=NO_CONTROL_POINTS,
        warnings=(),
        laws=laws,
    )


def loaded(scenario: Scenario, bare: Assembly, points: bool = True) -> Assembly:
    """The assembly ``bare`` with the loads, the jacks and the joint law of a scenario that has the same blocks,
    materials, supports and [[joints]]; without ``points`` its joints get no contact points."""
    number = {name: i for i, name in enumerate(bare.names)}
    joints = bare.joints
    if not scenario.joints:
        joints = replace(joints, law=(scenario.joint,) * len(joints))
    gravity = np.array(scenario.gravity, float)
    dead_force = bare.mass[:, None] * gravity
    dead_torque = np.zeros_like(dead_force)
    try:
        for index, load in enumerate(scenario.loads, 1):
            for block in scenario.groups.get(load.block) or (number[load.block],):
                dead_force[block] += load.force
                if load.point is not None:
                    arm = check_inside(f"load number {index}", load.point, bare, block)
                    dead_torque[block] += np.cross(arm, load.force)
        actuators = (jacks_on_all_blocks if on_all_blocks(scenario.control) else jacks)(scenario, number, bare)
        watched = control_points(scenario, number, bare)
    except ScenarioError as error:
        _refuse(scenario, str(error))

    joint_force, exact = dead_joint_forces(joints, bare.fixed, dead_force)
    warnings = _check_stiffness(scenario, joints, joint_force)
    tolerance = getattr(scenario.control, "tolerance", _DISCRETISATION)
    if len(joints) == 1:  # the search for its limit load places the points of a lone joint itself
        tolerance = max(tolerance, _DISCRETISATION)
    contact_points = place_points(joints, tolerance) if points else _NO_POINTS
    if points and (len(joints) > 1 or scenario.control.kind not in ("yield", "displacement")):
        warnings += _check_rim(scenario, joints, contact_points)
    return replace(
        bare,
        joints=joints,
        contact_points=contact_points,
        gravity=gravity,
        dead_force=dead_force,
        dead_torque=dead_torque,
        joint_force=joint_force,
        joint_force_exact=exact,
        actuators=actuators,
        control_points=watched,
        warnings=warnings,
        laws=Laws(scenario),
    )


def dead_joint_forces(joints, fixed, dead_force) -> tuple[np.ndarray, bool]:
    """Force that block a exerts on block b in every joint under dead loads (n_joint, 3), and whether it is exact.

    Every free block hands its load, with what it carries, to the joints that lie one step nearer to a fixed block,
    shared by area and by how squarely they face the load. Where each free block has a single joint to hand it to and
    no others, that is statics; elsewhere (walls, arches) an estimate without thrust and arching.
    """
    fixed = np.asarray(fixed, bool)
    carried = np.array(dead_force, float)
    force = np.zeros((len(joints), 3))
    if not len(joints):
        return force, not (~fixed).any()
    level = _levels(joints, fixed)
    a, b, normal, area = joints.block_a, joints.block_b, joints.axes[:, 2], joints.area
    down = np.where(level[a] < level[b], 1, -1)  # +1: b hands its load to a
    giver, taker = np.where(down > 0, b, a), np.where(down > 0, a, b)
    hands = (level[a] != level[b]) & (level[taker] >= 0)
    for step in range(int(level.max()), 0, -1):
        chosen = np.flatnonzero(hands & (level[giver] == step))
        load = carried[giver[chosen]]
        square = (load * load).sum(axis=1)
        facing = np.divide((load * normal[chosen]).sum(axis=1) ** 2, square, out=np.ones_like(square), where=square > 0)
        weight = area[chosen] * (facing + 1e-12)  # a block that only leans on others still hands its load on
        total = np.bincount(giver[chosen], weight, minlength=len(fixed))
        passed = (weight / total[giver[chosen]])[:, None] * load
        force[chosen] = -down[chosen, None] * passed
        np.add.at(carried, taker[chosen], passed)
    free = ~fixed
    return force, bool((level[free] > 0).all() and len(joints) == free.sum())


def _levels(joints, fixed: np.ndarray) -> np.ndarray:
    """Joints between each block and the nearest fixed one (n,): 0 where fixed, -1 where no chain leads to one."""
    level = np.where(fixed, 0, -1)
    a, b = joints.block_a, joints.block_b
    step = 0
    while True:
        reached = np.concatenate([b[(level[a] == step) & (level[b] < 0)], a[(level[b] == step) & (level[a] < 0)]])
        if not len(reached):
            return level
        step += 1
        level[reached] = step


def _refuse(scenario: Scenario, message: str) -> NoReturn:
    raise ScenarioError(f"{scenario.path}: {message}" if scenario.path else message)


def _check_overlap(scenario: Scenario, bodies: Bodies, pairs) -> None:
    depths = overlap_depths(bodies, pairs)
    over = np.flatnonzero(depths > TOLERANCE * bodies.table.diameter[pairs].min(axis=1))
    if not len(over):
        return
    worst = over[np.argmax(depths[over])]
    blocks = bodies.owner[pairs[worst]]
    first, second = (show(scenario.all_blocks[i].name) for i in blocks)
    if blocks[0] == blocks[1]:
        one, two = pairs[worst] - np.searchsorted(bodies.owner, blocks[0])
        _refuse(
            scenario,
            f"parts[{one}] and parts[{two}] of block {first} overlap by {depths[worst]:.6g} m; "
            "their common volume would count twice: let them touch",
        )
    more = f" ({len(over) - 1} more pairs overlap less)" if len(over) > 1 else ""
    _refuse(
        scenario, f"blocks {first} and {second} overlap by {depths[worst]:.6g} m{more}; move one of them that far out"
    )


def _check_pieces(scenario: Scenario, joints: JointTable) -> None:
    """The pressed part of a joint that is not convex is not defined for every pressure."""
    for number in joints.pieces:
        joint = joints[number]
        if joint.law.pressure != "full":
            first, second = (show(scenario.all_blocks[i].name) for i in (joint.block_a, joint.block_b))
            _refuse(
                scenario,
                f'pressure = "{joint.law.pressure}" holds for convex joints, and that between {first} and {second} is '
                f'one of {len(joint.pieces)} pieces; use "full" or formulation = "distributed" there',
            )


class Laws:
    """Which law holds between two blocks: that of the last override that names them or their groups."""

    def __init__(self, scenario: Scenario):
        self.default = scenario.joint
        self.overrides = scenario.joints
        self.ends = [tuple(frozenset(scenario.members(name)) for name in entry.between) for entry in scenario.joints]

    @property
    def all(self) -> tuple[JointLaw, ...]:
        """The laws of the scenario: its default and those of the overrides."""
        return (self.default, *(entry.law for entry in self.overrides))

    def covers(self, number: int, a: int, b: int) -> bool:
        """Whether an override is meant for a pair of blocks."""
        first, second = self.ends[number]
        return (a in first and b in second) or (a in second and b in first)

    def between(self, a: int, b: int) -> JointLaw:
        """The law of the joints between two blocks."""
        for number in range(len(self.overrides) - 1, -1, -1):
            if self.covers(number, a, b):
                return self.overrides[number].law
        return self.default


def _check_overrides(scenario: Scenario, laws: Laws, joints, fixed: np.ndarray) -> None:
    pairs = set(zip(joints.block_a.tolist(), joints.block_b.tolist(), strict=True)) if scenario.joints else ()
    for number, entry in enumerate(scenario.joints):
        if any(laws.covers(number, a, b) for a, b in pairs):
            continue
        first, second = laws.ends[number]
        both_fixed = all(fixed[i] for i in first | second)
        reason = "both are fixed" if both_fixed else "they do not touch face to face"
        kind = "groups" if any(name in scenario.groups for name in entry.between) else "blocks"
        _refuse(
            scenario,
            f"[[joints]] between {show(entry.between)}: there is no joint between these {kind}, as {reason}; "
            "remove the entry or move the blocks together",
        )


def _refuse_unsupported(scenario: Scenario, shapes, position, orientation, fixed, loose: np.ndarray) -> NoReturn:
    """Name the blocks that no chain of joints ties to a support, and the nearest face that they miss."""
    missed = [
        joint
        for joint in find_joints(shapes, position, orientation, fixed, lambda a, b: scenario.joint, _FAR)
        if loose[joint.block_a] != loose[joint.block_b]
    ]
    name, hint = show(scenario.all_blocks[int(np.flatnonzero(loose)[0])].name), "put it on another block, face to face"
    if missed:
        nearest = min(missed, key=lambda joint: abs(joint.gap))
        pair = (nearest.block_a, nearest.block_b)
        here, there = pair if loose[pair[0]] else pair[::-1]
        name = show(scenario.all_blocks[here].name)
        hint = f"the nearest face is that of {show(scenario.all_blocks[there].name)}, {abs(nearest.gap):.6g} m away"
        if abs(nearest.gap) <= TOLERANCE * min(shapes[here].diameter, shapes[there].diameter):
            hint = f"it touches {show(scenario.all_blocks[there].name)}, but their faces are not parallel"
    others = f" (nor from {int(loose.sum()) - 1} more)" if loose.sum() > 1 else ""
    _refuse(
        scenario, f"block {name} rests on nothing: no chain of joints leads from it to a fixed block{others}; {hint}"
    )


def _check_rim(scenario: Scenario, joints: JointTable, points: PointTable) -> tuple[str, ...]:
    """Warn where blocks that rock would topple early, because no contact point reaches the edge of their joint."""
    gap, j = widest_rim(joints, points)
    if not gap > _DISCRETISATION:
        return ()
    first, second = (show(scenario.all_blocks[i].name) for i in (joints.block_a[j], joints.block_b[j]))
    return (
        f"the outermost points of the distributed joint between {first} and {second} stay {100.0 * gap:.2g} % of its "
        "half width inside the edge: what rocks there topples that much early. Use concave or convex joints, or more "
        "joint.points",
    )


def _check_stiffness(scenario: Scenario, joints, joint_force: np.ndarray) -> tuple[str, ...]:
    """Refuse joints that their dead load would close, or friction shear, by more than a hundredth of their short side.

    The numbers of this project are those of stiff joints (undeformed geometry); a tenth of the limit is warned about.
    """
    if not len(joints):
        return ()
    laws, area, side = joints.law, joints.area, np.empty(len(joints))
    for numbers, shapes in joints.by_corners():
        side[numbers] = polygons.width(shapes)
    for number, pieces in joints.pieces.items():
        side[number] = max(polygons.width(piece) for piece in pieces)
    normal = np.maximum((joint_force * joints.axes[:, 2]).sum(axis=1), 0.0)
    strength = normal * [law.friction for law in laws]
    closing = normal / (area * [law.normal_stiffness for law in laws] * side)
    sliding = strength / (area * [law.shear_stiffness for law in laws] * side)
    worst = int(np.argmax(np.maximum(closing, sliding)))
    softness = max(closing[worst], sliding[worst])
    if not softness > SOFT_WARNING:
        return ()
    first, second = (show(scenario.all_blocks[i].name) for i in (joints.block_a[worst], joints.block_b[worst]))
    numbers = (
        f"the joint between {first} and {second} is soft for its load: N = {normal[worst]:.6g} N closes it by "
        f"N/(kn A) = {closing[worst]:.3g} of its short side ({side[worst]:.6g} m), and V_0 = {strength[worst]:.6g} N "
        f"shears it by V_0/(ks A) = {sliding[worst]:.3g} of it"
    )
    keys = [
        key
        for key, value in (("normal_stiffness", closing[worst]), ("shear_stiffness", sliding[worst]))
        if value > SOFT_WARNING
    ]
    if softness > SOFT_LIMIT:
        _refuse(scenario, f"{numbers}; at most {SOFT_LIMIT:g} is accepted: raise {' and '.join(keys)}")
    count = int((np.maximum(closing, sliding) > SOFT_WARNING).sum())
    more = f" ({count - 1} more joints are above it too)" if count > 1 else ""
    effect = f"above {SOFT_WARNING:g} the deformed geometry shows in the result"
    return (f"{numbers}; {effect}{more}: raise {' and '.join(keys)}",)
