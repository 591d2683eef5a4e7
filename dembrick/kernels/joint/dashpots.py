"""Dashpots: their work over a step, by the trapezoidal rule, and their action where contact begins or ends in it.

A force acts for half a step on either side of its instant. If contact began within the last step, with the penetration
g now and the closing d >= g in the step, it has lasted for g / d of that step, in which no earlier force acted. So the
dashpot has to act over g / d + 1/2 of a step, during which the penetration grows by g + d / 2. With d alone the impulse
of a dashpot is wrong by up to half a step of its full force, an error of first order in the step: the restitution of a
bounce then varies by a tenth and more with the instant within a step at which it begins.

The spring's own error there, k d / 8 at most, is of second order. Only `damped_push` corrects it as well, for new
contacts, whose impacts are short compared with the time step; at a joint it would cost two divisions per point and
change no result.
"""

from dembrick._jit import jit
from dembrick.kernels.math.vectors import put_vector

NEARLY = 1e-6  # part of the closing of a step that counts as rounding


@jit
def dashpot_growth(g, d):
    """Growth on which the dashpot of a contact acts (m): ``g`` penetration now, ``d`` its growth in the last step."""
    return g + 0.5 * d if d >= g else d


@jit
def damped_push(deep, depth, ahead, viscous, swing2, begins):
    """Pressure of a new contact besides its springs, as a penetration (m), to be added to the mean one ``deep``.

    ``depth``: the greatest penetration; ``ahead``: closing of the last step; ``viscous``: dashpot over spring;
    ``swing2``: square of the phase angle (rad) of a step; ``begins``: whether there was no contact a step ago. If
    contact began within the last step, the spring's impulse up to half a step later is that of (deep + ahead / 2)^2 /
    (2 ahead). The same holds in reverse if the force will end within the next step. Without this a flat bounce depends
    by some per cent on where in a step it begins and ends.
    """
    if begins and depth <= (1.0 + NEARLY) * ahead:  # rounding may put the onset on either side of the end of a step
        return viscous * (deep + 0.5 * ahead) + (deep - 0.5 * ahead) ** 2 / (2.0 * ahead)
    push = viscous * ahead
    left = deep + push
    if left > 0.0 and -ahead > swing2 * left:
        leaving = (1.0 + viscous) * swing2 * left - ahead
        if left < leaving:
            push += (left - 0.5 * leaving) ** 2 / (2.0 * leaving)
    return push


@jit
def dashpot_work(dash, shear, pressure, motion):
    """Twice the work of the dashpots of a joint over the step of a `Motion`, by the trapezoidal rule; stores their
    forces in ``dash`` (6,): ``shear``, V_1, V_2, M_T, and ``pressure``, N, M_1, M_2."""
    v1, v2, mt = shear
    n, m1, m2 = pressure
    p1, p2, pr = motion.slip
    d0, dx, dy = motion.growth
    work = (dash[0] + v1) * p1 + (dash[1] + v2) * p2 + (dash[2] + mt) * pr
    work += -(dash[4] + m1) * dy + (dash[5] + m2) * dx + (dash[3] + n) * d0
    put_vector(dash, v1, v2, mt)
    put_vector(dash[3:], n, m1, m2)
    return work
