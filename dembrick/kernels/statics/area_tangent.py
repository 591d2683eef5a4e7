"""The tangent of convex joints in searches: derivatives of their forces with respect to the motion of the joint."""

from math import sqrt

from dembrick._jit import jit
from dembrick.kernels.joint.limit_surface import solve_symmetric, surface
from dembrick.kernels.joint.no_tension import extremes, pressed_moments
from dembrick.kernels.joint.pressure import FULL
from dembrick.kernels.statics.area_joints import limit_of


@jit
def knows_tangent(strengths, pressed, a):
    """Whether `tangent` applies to convex joint ``a``: it has no strengths and is under full pressure."""
    if strengths is not None:
        return False
    if pressed is not None:
        return pressed.kind[a] == FULL
    return True


@jit
def tangent(areas, memory, a, normal, dn, r1, r2, out):
    """dt/du (6, 6) of `kernels.statics.newton` into ``out``, at the result of `forces` from ``memory``: under the
    ``normal`` force at the opening (dn, r1, r2).

    The normal force and its moments change with the moments of the pressed part. A joint that slides carries t = f - K
    q with K q + mu N D'(q) = f, where f = b + K s is the trial force: (K + mu N D'') dq = K ds - mu D' dN.
    """
    for i in range(6):
        for k in range(6):
            out[i, k] = 0.0
    if not normal > 0.0:
        return
    first = areas.start[a]
    last = areas.start[a + 1]
    x = areas.x
    y = areas.y
    reach = areas.reach[a]
    area = whole = areas.area[a]
    second = areas.second[a]
    mx = my = 0.0
    myy = second[0]
    mxx = second[1]
    mxy = second[2]
    k_t = areas.k_s[a] * whole
    k_r = areas.k_s[a] * (myy + mxx)
    if -dn < reach * sqrt(r1 * r1 + r2 * r2) and extremes(x, y, first, last, -dn, r2, -r1)[0] < 0.0:
        area, mx, my, myy, mxx, mxy = pressed_moments(x, y, first, last, -dn, r2, -r1)
    k_n = areas.k_n[a]
    out[2, 2] = k_n * area
    out[2, 3] = out[3, 2] = k_n * my
    out[2, 4] = out[4, 2] = -k_n * mx
    out[3, 3] = k_n * myy
    out[3, 4] = out[4, 3] = -k_n * mxy
    out[4, 4] = k_n * mxx
    if not areas.slip[a] > memory.slip[a]:
        out[0, 0] = out[1, 1] = k_t
        out[5, 5] = k_r
        return
    friction = areas.friction[a]
    if friction > 0.0:
        q = areas.twist[a]
        _, g1, g2, g3, h11, h12, h22, h13, h23, h33 = surface(limit_of(areas, a), q[0], q[1], q[2])
        v = friction * normal
        h11 = k_t + v * h11
        h22 = k_t + v * h22
        h33 = k_r + v * h33
        h12 *= v
        h13 *= v
        h23 *= v
        for column in range(3):
            s1 = k_t if column == 0 else 0.0
            s2 = k_t if column == 1 else 0.0
            s3 = k_r if column == 2 else 0.0
            q1, q2, q3 = solve_symmetric(h11, h12, h22, h13, h23, h33, s1, s2, s3)
            i = column if column < 2 else 5
            out[0, i] = s1 - k_t * q1
            out[1, i] = s2 - k_t * q2
            out[5, i] = s3 - k_r * q3
        q1, q2, q3 = solve_symmetric(h11, h12, h22, h13, h23, h33, friction * g1, friction * g2, friction * g3)
        for i in range(2, 5):  # N grows by -out[2, i]
            out[0, i] = -k_t * q1 * out[2, i]
            out[1, i] = -k_t * q2 * out[2, i]
            out[5, i] = -k_r * q3 * out[2, i]
