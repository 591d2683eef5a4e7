"""Ties in real time: their forces, put on the blocks as loads are. The law is `kernels.joint.ties`."""

from dembrick._jit import jit
from dembrick.kernels.joint.ties import stretch
from dembrick.kernels.math.quaternion import rotate
from dembrick.kernels.math.vec3 import NO_MOMENT, add_wrench, put_vector


@jit
def clear_tied(ties, bodies):
    """Take all loads off the blocks that ties hold: those of the step come next."""
    for t in range(ties.stiffness.size):
        for side in range(2):
            for i in range(6):
                bodies.applied[ties.block[t, side], i] = 0.0


@jit
def pull_ties(ties, bodies):
    """Add the forces of all ties to the loads on their blocks."""
    for t in range(ties.stiffness.size):
        a = ties.block[t, 0]
        b = ties.block[t, 1]
        for side in range(2):
            lever = ties.lever[t, side]
            r1, r2, r3 = rotate(bodies.orientation, ties.block[t, side], lever[0], lever[1], lever[2])
            put_vector(ties.arm[t, side], r1, r2, r3)
        arm = ties.arm[t]
        x = bodies.position
        stretch(
            ties,
            t,
            x[b, 0] - x[a, 0] + (arm[1, 0] - arm[0, 0]),
            x[b, 1] - x[a, 1] + (arm[1, 1] - arm[0, 1]),
            x[b, 2] - x[a, 2] + (arm[1, 2] - arm[0, 2]),
        )
        for side in range(2):
            add_wrench(bodies.applied[ties.block[t, side]], 1.0 - 2.0 * side, ties.force[t], NO_MOMENT, arm[side])
