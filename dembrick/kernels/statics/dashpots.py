"""Work of the dashpots of a joint, by the trapezoidal rule."""

from dembrick._jit import jit
from dembrick.kernels.math.vec3 import put_vector


@jit
def dashpot_work(dash, shear, pressure, motion):
    """Twice the work of the dashpots of a joint over the step of a `Motion`, by the trapezoidal rule; keeps what they
    carry in ``dash`` (6,): ``shear``, V_1, V_2, M_T, and ``pressure``, N, M_1, M_2."""
    v1, v2, mt = shear
    n, m1, m2 = pressure
    p1, p2, pr = motion.slip
    d0, dx, dy = motion.growth
    work = (dash[0] + v1) * p1 + (dash[1] + v2) * p2 + (dash[2] + mt) * pr
    work += -(dash[4] + m1) * dy + (dash[5] + m2) * dx + (dash[3] + n) * d0
    put_vector(dash, v1, v2, mt)
    put_vector(dash[3:], n, m1, m2)
    return work
