"""Many scenes of a fixed and a free block in one compiled call: each brought to rest, pushed and bracketed as in a
scene of its own, by the same kernels.

The arrays of a batch are those of ``state`` for k scenes one after another: blocks 2 i (fixed) and 2 i + 1 (free),
joint i between them, the actuators of scene i, and one row each of what a scene has once. A scene is a view of its
rows; nothing is copied. Both blocks are seen from O, the centroid of the joint, along the joint's axes.
"""

from typing import NamedTuple

from numpy import ndarray

from dembrick._jit import entry, jit
from dembrick.kernels.state import Actuators, Blocks, Joints, ScaledInertia
from dembrick.kernels.statics import joint_families as families
from dembrick.kernels.statics.load_bounds import NEVER, Certificate, certify
from dembrick.kernels.statics.loop import CONVERGED, RUNNING, Drive, Guard, Relaxing, advance
from dembrick.kernels.statics.state import State

FALLS = 5  # besides the states of `advance`: the dead loads alone bring the block down


class Settings(NamedTuple):
    """Numerical choices of the search for a limit load, as ``replay`` makes them; the time step is 1."""

    tolerance: float
    caution: float  # part of the tolerance that an indicator gets
    unbalanced: float  # of the joint forces: equilibrium under the dead loads
    first_steps: int  # of the dead-load equilibrium, without momentum
    dead_load_steps: int
    momentum: float
    eta: float  # circular frequency of the blocks times the time step
    slip_per_step: float
    gently: float  # of it, where the load tilts the block
    ramp: float
    steady: int
    slowing: float
    actuator: float  # stiffness of the actuators over that of the joint
    viscous: float
    damping: float
    mean_weight: float
    chunk: int  # steps between two looks at the clock
    most_steps: int
    window: int  # steps of the window of an indicator
    mask: int  # of the guard, first and later
    stretch: int


class Room(NamedTuple):
    """Where the scenes of one call work, one after another, and the numbers of the one joint and of its blocks in their
    own arrays, which all share."""

    zero: ndarray  # (1,) int64, 0
    one: ndarray  # (1,) int64, 1
    ratio: ndarray  # (1,), see `Relaxing`
    window: ndarray  # (window, 4), see `Certificate`
    doubling: ndarray  # (6,)
    start: ndarray  # (2,), see `Guard`
    work: ndarray  # (2,)
    sums: ndarray  # (3,)
    load: ndarray  # (1, 3)
    until: ndarray  # (0,) int64 and (0,), of a head that does not turn, see `Drive`
    ways: ndarray


class Loading(NamedTuple):
    """Loads of k scenes."""

    unit: ndarray  # (k, 6) wrench of the actuators for V = 1 on b about O, the joint's axes
    dead: ndarray  # (k, 6) wrench of the dead load likewise
    compliance: ndarray  # (k,) m/N, unit load times the closed joint's answer to it
    weight: ndarray  # (k,) sum of the actuators' weights without their signs
    size: ndarray  # (k,) m, a step that moves a block further has diverged


class Answer(NamedTuple):
    """What became of each of k scenes; the rest is in their state."""

    bracket: ndarray  # (k, 2) N, bounds of V
    basis: ndarray  # (k, 5) strict, gauge of the dead load, torsion radius, N, tilts; see `certify`
    twist: ndarray  # (k, 3) m, m, rad: slip that gave the upper bound, where strict
    status: ndarray  # (k,) int64
    steps: ndarray  # (k,) int64


@jit
def blocks_of(blocks, lone, i):
    """The two blocks of scene ``i``."""
    s = slice(2 * i, 2 * i + 2)
    return Blocks(
        lone.one, blocks.displacement[s], blocks.rotation[s], blocks.orientation[s], blocks.velocity[s],
        blocks.spin[s], blocks.mean_velocity[s], blocks.momentum[s], blocks.force[s], blocks.torque[s],
        blocks.dead_force[s], blocks.dead_torque[s], blocks.guided, blocks.held, blocks.guide,
    )  # fmt: skip


@jit
def joint_of(joints, lone, i):
    """The joint of scene ``i``."""
    s = slice(i, i + 1)
    return Joints(
        lone.zero, lone.one, joints.host[s], joints.axes[s], joints.arm_a[s], joints.arm_b[s], joints.axes_a[s],
        joints.axes_b[s], joints.lever_a[s], joints.lever_b[s], joints.offset[s], joints.gap[s], joints.relative[s],
        joints.damping[s], joints.opening[s], joints.step[s], joints.tilt[s], joints.resultant[s],
    )  # fmt: skip


@jit
def actuators_of(actuators, i, each):
    """The ``each`` actuators of scene ``i``."""
    s = slice(each * i, each * i + each)
    return Actuators(
        actuators.block[s], actuators.arm[s], actuators.lever[s], actuators.start[s], actuators.direction[s],
        actuators.weight[s], actuators.displacement[s], actuators.drive[i],
    )  # fmt: skip


@jit
def empty(room, steps):
    """Let the ``steps`` rows of the window hold nothing."""
    for i in range(steps):
        room.window[i, 0] = 0.0
        room.window[i, 1] = NEVER
        room.window[i, 2] = 0.0
        room.window[i, 3] = 0.0


@jit
def clear(room):
    """Let all sums start again."""
    for i in range(6):
        room.doubling[i] = 0.0
    for i in range(2):
        room.start[i] = 0.0
        room.work[i] = 0.0
    for i in range(3):
        room.sums[i] = 0.0
        room.load[0, i] = 0.0


@jit
def dead_load_equilibrium(first, state, inertia, settings, ratio):
    """Equilibrium under the dead loads, as ``simulation.statics.dead_load`` finds it; False if there is none.

    ``first`` is 0, of the type that a scene of its own has compiled, which a literal is not."""
    ratio[0] = 1.0
    for attempt in range(2):
        most = settings.first_steps if attempt == 0 else settings.dead_load_steps
        momentum = 0.0 if attempt == 0 else settings.momentum
        if not ratio[0] <= settings.unbalanced:
            relaxing = Relaxing(settings.unbalanced, momentum, ratio)
            advance(first, most, 1.0, state, inertia, None, None, relaxing, None, None, None, None)
    for i in range(3):
        state.blocks.velocity[1, i] = 0.0
        state.blocks.spin[1, i] = 0.0
        state.joints.step[0, i] = 0.0
    return ratio[0] <= settings.unbalanced


@jit
def replay_one(i, state, resting, pushing, loading, basis, room, settings, answer):
    """Load and push scene ``i`` until its bracket is within tolerance; returns the status and the steps taken."""
    blocks = state.blocks
    joints = state.joints
    points = state.points
    areas = state.areas
    actuators = state.actuators
    step = answer.steps[i]  # 0
    if not dead_load_equilibrium(step, state, resting, settings, room.ratio):
        return FALLS, 0
    # the actuators come to a block that the dead load has moved already, and do not push it back
    driven = 0.0
    for c in range(3):
        driven += loading.unit[i, c] * blocks.displacement[1, c] + loading.unit[i, c + 3] * blocks.rotation[1, c]
    actuators.drive[0] = driven / loading.weight[i]
    actuators.drive[1] = driven / loading.weight[i]
    certify(joints, points, areas, loading.unit[i], loading.dead[i], basis)
    strict = basis.scalars[0] == 1.0
    radius = basis.scalars[2]
    normal = basis.scalars[3]
    bracket = answer.bracket[i]
    bracket[0] = 0.0
    bracket[1] = NEVER
    family = families.only_family(points, areas)
    mu = families.friction_of(points, areas, family, 0)
    if mu == 0.0:
        bracket[1] = 0.0
        return CONVERGED, 0
    unit = basis.unit
    strength = max(mu, 1e-3) * normal / ((unit[0] ** 2 + unit[1] ** 2) ** 0.5 + abs(unit[2]) / radius)
    stiffness = settings.actuator * loading.weight[i] / loading.compliance[i]
    elastic = loading.weight[i] / loading.compliance[i]
    empty(room, settings.window)
    clear(room)
    damping = 0.0
    slip = settings.slip_per_step
    tilts = basis.scalars[4] == 1.0
    if tilts:
        slip *= settings.gently
        damping = settings.damping
    status = RUNNING
    while status == RUNNING and step < settings.most_steps:
        guard = Guard(
            loading.size[i], settings.mask, settings.stretch, loading.weight[i], room.one, room.start, room.work,
            room.sums, room.load,
        )  # fmt: skip
        drive = Drive(
            slip * strength * loading.compliance[i] / loading.weight[i], settings.ramp,
            settings.steady, settings.slowing, stiffness, settings.viscous * stiffness, settings.viscous,
            settings.viscous, damping, settings.mean_weight, room.until, room.ways,
        )  # fmt: skip
        certificate = Certificate(
            1, strict, 0, family, 0, unit, basis.dead, basis.scalars[1], basis.centre, radius, normal, basis.rest,
            tilts, settings.tolerance if strict else settings.caution * settings.tolerance, bracket, elastic,
            room.doubling, answer.twist[i], room.window,
        )  # fmt: skip
        status, step = advance(
            step, settings.chunk, 1.0, state, pushing, None, drive, None, certificate, None, None, guard
        )
    return status, step


@jit
def state_of(all_scenes, each, lone, i):
    """Scene ``i`` of the `State` of a batch, with ``each`` actuators."""
    return State(
        blocks_of(all_scenes.blocks, lone, i), joint_of(all_scenes.joints, lone, i),
        families.points_of_scene(all_scenes.points, lone, i), families.areas_of_scene(all_scenes.areas, lone, i),
        actuators_of(all_scenes.actuators, i, each), None,
    )  # fmt: skip


@entry
def replay_batch(first, last, scenes, each, inertias, loading, basis, room, settings, answer):
    """Replay the scenes ``first`` to ``last`` - 1 of a batch one after another.

    ``scenes``: their `State`, in which either the points or the areas are None. ``each``: actuators of a scene.
    ``inertias``: scaled inertia of the blocks (2 k, 6, 6) that come to rest, and of those that are pushed. ``basis``
    (`certify`) and ``room`` are to work in.
    """
    resting, pushing = inertias
    for i in range(first, last):
        s = slice(2 * i, 2 * i + 2)
        still = ScaledInertia(resting.inverse[s], resting.matrix[s], None)
        moving = ScaledInertia(pushing.inverse[s], pushing.matrix[s], None)
        state = state_of(scenes, each, room, i)
        status, steps = replay_one(i, state, still, moving, loading, basis, room, settings, answer)
        answer.status[i] = status
        answer.steps[i] = steps
        for c in range(5):
            answer.basis[i, c] = basis.scalars[c]
