"""From a scenario to its immutable geometry: blocks, joints, contact points, dead loads, and attached points.

:func:`assemble` also refuses scenarios that describe no valid test, see `validation`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from dembrick.assembly.actuators import (
    NO_ACTUATORS,
    NO_CONTROL_POINTS,
    ActuatorTable,
    ControlPoints,
    actuators_on_all_blocks,
    control_points,
    given_actuators,
)
from dembrick.assembly.block_shapes import shapes_of
from dembrick.assembly.broad_phase import bodies_of, close_pairs
from dembrick.assembly.contact_points import DISCRETISATION, PointTable, place_points
from dembrick.assembly.joints import TOLERANCE, JointTable, find_joints
from dembrick.assembly.laws import Laws
from dembrick.assembly.loads import NO_LOADS, PointLoads, point_loads, weight_without_mass
from dembrick.assembly.surface_pressures import NO_POLYGONS, PressurePolygons, pressure_polygons
from dembrick.assembly.ties import NO_TIES, TieTable, given_ties
from dembrick.assembly.validation import (
    check_control,
    check_finite,
    check_gaps,
    check_overlap,
    check_overrides,
    check_pieces,
    check_rim,
    check_stages,
    check_stiffness,
    check_strengths,
    refuse,
    refuse_unsupported,
)
from dembrick.errors import ScenarioError
from dembrick.geometry.rotations import rotation_matrix, unit_quaternion
from dembrick.geometry.shapes import Shape
from dembrick.scenario.checks import show
from dembrick.scenario.controls import ACTUATORS, EVERY_BLOCK
from dembrick.scenario.joint_laws import CustomLaw
from dembrick.scenario.model import Scenario
from dembrick.scenario.stages import at_stage
from dembrick.scenario.text_files import require_file
from dembrick.scenario.units import check_magnitudes

_NO_POINTS = place_points(JointTable.of(()), DISCRETISATION)


@dataclass(frozen=True, eq=False, repr=False)
class Assembly:
    """A scenario as geometry. n blocks, in the order of the scenario; SI units; world axes at the start.

    ``position`` (n, 3) of the centroids, ``orientation`` (n, 4) unit quaternions, ``rotation`` (n, 3, 3) the same as
    matrices, ``mass`` (n,), ``inertia`` (n, 3, 3) about the centroid in body axes, ``velocity`` and
    ``angular_velocity`` (n, 3) at the start; ``held`` (n, 6): world directions in which a block cannot move or rotate,
    all for a fixed block; ``dead_force`` and ``dead_torque`` (n, 3) about the centroid, of gravity and loads;
    ``point_loads``: the individual loads; ``pressed``: the faces on which pressures follow moving blocks, none with
    small displacements. ``contact_points``: one entry per joint, None for ``convex``.
    ``joint_force`` (n_joint, 3): force that block a exerts on block b under the dead loads, see
    :func:`dead_joint_forces`; ``joint_force_exact``: whether it follows from statics alone. ``laws`` gives the law of
    joints and new contacts between any two blocks; ``custom_law``: a user-defined law that the joints follow instead,
    or None.
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
    laws: Laws
    joint_force: np.ndarray
    dead_force: np.ndarray
    dead_torque: np.ndarray
    contact_points: PointTable = _NO_POINTS
    gravity: np.ndarray = field(default_factory=lambda: np.zeros(3))
    joint_force_exact: bool = True
    actuators: ActuatorTable = NO_ACTUATORS
    control_points: ControlPoints = NO_CONTROL_POINTS
    warnings: tuple[str, ...] = ()
    point_loads: PointLoads = NO_LOADS
    pressed: PressurePolygons = NO_POLYGONS
    ties: TieTable = NO_TIES
    held: np.ndarray = field(default_factory=lambda: np.zeros((0, 6), bool))
    custom_law: CustomLaw | None = None

    @cached_property
    def least_size(self) -> np.ndarray:
        """Shortest edge of the bounding box of each block (n,), in its own axes (m)."""
        return np.array([np.ptp(shape.vertices, axis=0).min() for shape in self.shapes])

    @property
    def supporting(self) -> np.ndarray:
        """Whether each block (n,) has a reaction: it is fixed, or held in some directions."""
        return np.asarray(self.fixed, bool) | self.held.any(axis=1)

    @property
    def guided(self) -> np.ndarray:
        """Indices (g,) of the blocks that are held in some directions and free in others."""
        return np.flatnonzero(self.held.any(axis=1) & ~np.asarray(self.fixed, bool))

    def __repr__(self) -> str:
        return f"<Assembly: {len(self.names)} blocks, {len(self.joints)} joints>"


def assemble(scenario: Scenario) -> Assembly:
    """Geometry, joints and dead loads of a scenario (of its last stage if it has stages); raise a ScenarioError if it
    does not describe a valid test."""
    last = at_stage(scenario, len(scenario.stages) + 1)
    made = with_loads(last, unloaded_assembly(last))
    return replace(made, warnings=made.warnings + check_stages(scenario)) if scenario.stages else made


def unloaded_assembly(scenario: Scenario) -> Assembly:
    """The blocks of a scenario and their joints, without any load."""
    blocks = scenario.all_blocks
    names = tuple(block.name for block in blocks)
    try:
        check_magnitudes(scenario)
    except ScenarioError as error:
        refuse(scenario, str(error))
    for block in scenario.blocks:
        for solid in block.parts or (block,):
            if solid.mesh is not None:
                require_file(scenario, f"mesh of block {show(block.name)}", solid.mesh.file)
    try:
        shapes = shapes_of(blocks, scenario.path_of)
    except ScenarioError as error:
        refuse(scenario, str(error))
    orientation = unit_quaternion([block.orientation for block in blocks])
    rotation = rotation_matrix(orientation)
    centroid = np.array([shape.centroid for shape in shapes])
    position = np.array([block.position for block in blocks], float) + np.einsum("nij,nj->ni", rotation, centroid)
    fixed = np.array([block.fixed for block in blocks], bool)
    density = np.array([scenario.materials[block.material].density for block in blocks])
    mass = density * [shape.volume for shape in shapes]
    control = scenario.control
    quasi_static = control.regime.quasi_static

    if quasi_static and not fixed.any():
        kind = show(control.kind)
        refuse(scenario, f"no block is fixed, but a test of kind {kind} needs a support: give a block fixed = true")
    bodies = bodies_of(shapes, position, rotation)
    pairs = close_pairs(bodies, TOLERANCE)
    check_overlap(scenario, bodies, pairs)

    laws = Laws(scenario)
    # moving joints are clipped to the faces on which they slide, which requires one pair of convex parts each
    moving = any(one.regime.real_time for one in scenario.among or (control,))
    joints = find_joints(shapes, position, orientation, fixed, laws.between, TOLERANCE, (bodies, pairs), not moving)
    if moving:
        check_pieces(scenario, joints, bodies)
    check_overrides(scenario, laws, joints, fixed)
    gaps = check_gaps(scenario, bodies, position, fixed, joints)
    level = _levels(joints, fixed)
    if quasi_static and (level < 0).any():
        refuse_unsupported(scenario, shapes, position, orientation, fixed, level < 0)

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
        laws=laws,
        warnings=gaps,
        joint_force=np.zeros((len(joints), 3)),
        dead_force=nothing,
        dead_torque=nothing,
        held=np.array([block.guides for block in blocks], bool),
    )


def with_loads(scenario: Scenario, bare: Assembly, points: bool = True) -> Assembly:
    """Add loads, actuators and joint laws of a scenario to ``bare``, an assembly of the same blocks, materials,
    supports and [[joints]]; without ``points`` the joints get no contact points."""
    control, number = scenario.control, {name: i for i, name in enumerate(bare.names)}
    joints = bare.joints
    if not scenario.joints:
        joints = replace(joints, law=(scenario.joint,) * len(joints))
    gravity = np.array(scenario.gravity, float)
    dead_force = bare.mass[:, None] * gravity
    dead_torque = np.zeros_like(dead_force)
    try:
        moving = control.regime.real_time
        loads = point_loads(scenario, number, bare, moving)
        np.add.at(dead_force, loads.at.block, loads.force)
        np.add.at(dead_torque, loads.at.block, np.cross(loads.at.arm, loads.force))
        if control.regime.quasi_static and control.drives == EVERY_BLOCK:
            actuators = actuators_on_all_blocks(scenario, loads, bare)
        else:
            actuators = given_actuators(scenario, number, bare)
        pressed = pressure_polygons(scenario, number, bare) if moving else NO_POLYGONS
        watched = control_points(scenario, number, bare)
        ties = given_ties(scenario, number, bare)
    except ScenarioError as error:
        refuse(scenario, str(error))

    joint_force, exact = dead_joint_forces(joints, bare.fixed, dead_force)
    exact = exact and not len(bare.guided)  # a guide can carry load in parallel to joints
    warnings = scenario.remarks + bare.warnings + check_control(scenario) + check_strengths(scenario, joints)
    warnings += weight_without_mass(scenario, loads, bare)
    warnings += check_stiffness(scenario, bare.shapes, joints, joint_force)
    tolerance = min(one.tolerance or DISCRETISATION for one in scenario.among or (control,))
    if len(joints) == 1 and not scenario.among:  # the limit search of a single joint places the points itself
        tolerance = max(tolerance, DISCRETISATION)
    contact_points = place_points(joints, tolerance) if points else _NO_POINTS
    if points and (len(joints) > 1 or control.drives != ACTUATORS):
        warnings += check_rim(scenario, joints, contact_points)
    made = replace(
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
        point_loads=loads,
        pressed=pressed,
        ties=ties,
    )
    check_finite(made)
    return made


def dead_joint_forces(joints, fixed, dead_force) -> tuple[np.ndarray, bool]:
    """Force that block a exerts on block b in every joint under dead loads (n_joint, 3), and whether it is exact.

    Every free block passes its load, including what it carries, on to the joints one step nearer to a fixed block, in
    proportion to area and to how squarely they face the load. If each free block has a single such joint and there are
    no other joints, this is statics; otherwise (walls, arches) it is an estimate without thrust and arching.
    """
    fixed = np.asarray(fixed, bool)
    carried = np.array(dead_force, float)
    force = np.zeros((len(joints), 3))
    if not len(joints):
        return force, not (~fixed).any()
    level = _levels(joints, fixed)
    a, b, normal, area = joints.block_a, joints.block_b, joints.axes[:, 2], joints.area
    down = np.where(level[a] < level[b], 1, -1)  # +1: b passes its load on to a
    giver, taker = np.where(down > 0, b, a), np.where(down > 0, a, b)
    hands = (level[a] != level[b]) & (level[taker] >= 0)
    for step in range(int(level.max()), 0, -1):
        chosen = np.flatnonzero(hands & (level[giver] == step))
        load = carried[giver[chosen]]
        square = (load * load).sum(axis=1)
        facing = np.divide((load * normal[chosen]).sum(axis=1) ** 2, square, out=np.ones_like(square), where=square > 0)
        weight = area[chosen] * (facing + 1e-12)  # not 0: a block that only leans on others passes its load on too
        total = np.bincount(giver[chosen], weight, minlength=len(fixed))
        passed = (weight / total[giver[chosen]])[:, None] * load
        force[chosen] = -down[chosen, None] * passed
        np.add.at(carried, taker[chosen], passed)
    free = ~fixed
    return force, bool((level[free] > 0).all() and len(joints) == free.sum())


def _levels(joints, fixed: np.ndarray) -> np.ndarray:
    """Number of joints between each block and the nearest fixed one (n,): 0 if fixed, -1 without a path to one."""
    level = np.where(fixed, 0, -1)
    a, b = joints.block_a, joints.block_b
    step = 0
    while True:
        reached = np.concatenate([b[(level[a] == step) & (level[b] < 0)], a[(level[b] == step) & (level[a] < 0)]])
        if not len(reached):
            return level
        step += 1
        level[reached] = step
