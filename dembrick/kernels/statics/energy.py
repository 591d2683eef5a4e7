"""Energy balance of searches and constant-rate tests: every term is integrated by itself, none is a residual.

Central differences balance exactly in this form: with the kinetic energy v(-1/2) M v(+1/2) / 2, its change over a step
is the work of the forces by the trapezoidal rule over the motion of the step. Two effects do not balance: contacts that
open or close within a step, and, in finite motion, the rotation of the geometry within it.
"""

from dembrick._jit import jit
from dembrick.kernels.joint.families import FAMILIES, joint_count, joint_of
from dembrick.kernels.joint.ties import tie_energy, tie_losses
from dembrick.kernels.statics import joint_families as families


@jit
def dead_force_work(blocks):
    """Work (J) of the dead forces over the displacements since the scenario's geometry."""
    total = 0.0
    for f in range(blocks.free.size):
        b = blocks.free[f]
        for i in range(3):
            total += blocks.dead_force[b, i] * blocks.displacement[b, i]
    return total


@jit
def dead_torque_work(turned, blocks, dt):
    """Work (J) of the dead torques on the blocks ``turned`` over the last step: it depends on the path of the
    rotations."""
    total = 0.0
    for t in range(turned.size):
        b = turned[t]
        for i in range(3):
            total += dt * blocks.dead_torque[b, i] * blocks.spin[b, i]
    return total


@jit
def yielded_in_step(ties):
    """Energy that ties lost by yielding in the last step (J); ``ties`` may be None."""
    if ties is not None:
        yielded, _ = tie_losses(ties)
        return yielded
    return 0.0


@jit
def begin_energy(energy, state):
    """Store the elastic energy and the work of the dead loads at the start, with blocks at rest."""
    if energy is not None:
        energy.work[0].elastic_at_start = elastic_energy(state, None) + energy_in_ties(state.ties)
        energy.work[0].dead_loads = dead_force_work(state.blocks)


@jit
def energy_in_ties(ties):
    """Energy (J) in the springs of all ties; zero if ``ties`` is None."""
    if ties is not None:
        return tie_energy(ties)
    return 0.0


@jit
def normal_energy(joints, j, dash):
    """Energy (J) in the normal springs of joint ``j``: half their resultant times its opening and tilts.

    This equals half the sum, or integral, of k_n <g>+ squared, since <g>+ squared is <g>+ g and g is linear over the
    joint. The springs carry N, M_1, M_2 less the part of the dashpots (``dash``; None if there are none).
    """
    now = joints.resultant[j]
    seen = joints.opening[j]
    twice = now[4] * seen[1] + now[5] * seen[2] - now[0] * seen[0]
    if dash is not None:
        twice -= dash[j, 4] * seen[1] + dash[j, 5] * seen[2] - dash[j, 3] * seen[0]
    return 0.5 * twice


@jit
def elastic_energy(state, dash):
    """Energy (J) in the springs of all joints now; ``dash`` as in `normal_energy`."""
    points = state.points
    areas = state.areas
    total = 0.0
    for family in range(FAMILIES):
        for i in range(joint_count(points, areas, family)):
            j = joint_of(points, areas, family, i)
            total += normal_energy(state.joints, j, dash) + families.shear_energy(points, areas, family, i)
    return total


@jit
def kinetic_energy(blocks, scaled, inertia, dt):
    """v(-1/2) M v(+1/2) / 2 of all free blocks (J), before they move in the step."""
    total = 0.0
    for f in range(blocks.free.size):
        b = blocks.free[f]
        for i in range(3):
            total += 0.5 * dt * (blocks.force[b, i] * blocks.velocity[b, i] + blocks.torque[b, i] * blocks.spin[b, i])
        if scaled is not None:
            m = scaled.matrix[b]
            for i in range(3):
                push = twist = 0.0
                for k in range(3):
                    push += m[i, k] * blocks.velocity[b, k] + m[i, k + 3] * blocks.spin[b, k]
                    twist += m[i + 3, k] * blocks.velocity[b, k] + m[i + 3, k + 3] * blocks.spin[b, k]
                total += 0.5 * (blocks.velocity[b, i] * push + blocks.spin[b, i] * twist)
        if inertia is not None:
            for i in range(3):
                total += 0.5 * inertia.mass[b] * blocks.velocity[b, i] ** 2
                total += 0.5 * blocks.momentum[b, i] * blocks.spin[b, i]
    return total


@jit
def balance(energy, state, drive, scaled, inertia, dt):
    """The nine energies of this instant (J): kinetic, elastic, actuator spring, external, friction, dashpots,
    crushing, fracture, yielding."""
    blocks = state.blocks
    actuators = state.actuators
    weights = 0.0
    for i in range(actuators.weight.size):
        weights += abs(actuators.weight[i])
    spring = actuators.driven[0].head - actuators.driven[0].displacement
    work = energy.work[0]
    return (
        kinetic_energy(blocks, scaled, inertia, dt),
        elastic_energy(state, energy.dash) - work.elastic_at_start + energy_in_ties(state.ties),
        0.5 * drive.stiffness * spring * spring * weights,
        work.head + work.torques + (dead_force_work(blocks) - work.dead_loads),
        work.sliding,
        work.damping + work.actuator_damping,
        work.crushing,
        work.fracture,
        work.yielding,
    )
