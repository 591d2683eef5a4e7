"""Work of the dashpots of a joint, by the trapezoidal rule."""

from dembrick._jit import jit
from dembrick.kernels.math.vec3 import put_vector


@jit
def dashpot_work(dash, v1, v2, mt, n, m1, m2, p1, p2, pr, pn, pr1, pr2):
    """Twice the work of the dashpots of a joint over a step, by the trapezoidal rule; keeps their resultant."""
    work = (dash[0] + v1) * p1 + (dash[1] + v2) * p2 + (dash[2] + mt) * pr
    work += (dash[4] + m1) * pr1 + (dash[5] + m2) * pr2 - (dash[3] + n) * pn
    put_vector(dash, v1, v2, mt)
    put_vector(dash[3:], n, m1, m2)
    return work
