"""Vectors as bare floats: an array of three costs fifty times as much in a compiled loop.

Quaternions (w, x, y, z) and rotation vectors as bare floats: all rotations of the kernels.

A unit quaternion rotates body axes into world axes. `geometry.rotations` has the same for numpy arrays.
"""

from math import cos, sin, sqrt

from dembrick._jit import jit

NO_MOMENT = (0.0, 0.0, 0.0)


@jit
def cross(a1, a2, a3, b1, b2, b3):
    """a x b."""
    return a2 * b3 - a3 * b2, a3 * b1 - a1 * b3, a1 * b2 - a2 * b1


@jit
def rows_times(m, a1, a2, a3):
    """m a for a (3, 3) array: components of a along the rows of m."""
    return (
        m[0, 0] * a1 + m[0, 1] * a2 + m[0, 2] * a3,
        m[1, 0] * a1 + m[1, 1] * a2 + m[1, 2] * a3,
        m[2, 0] * a1 + m[2, 1] * a2 + m[2, 2] * a3,
    )


@jit
def columns_times(m, a1, a2, a3):
    """m^T a for a (3, 3) array: the vector whose components along the rows of m are a."""
    return (
        m[0, 0] * a1 + m[1, 0] * a2 + m[2, 0] * a3,
        m[0, 1] * a1 + m[1, 1] * a2 + m[2, 1] * a3,
        m[0, 2] * a1 + m[1, 2] * a2 + m[2, 2] * a3,
    )


@jit
def tangent(e1, e2, e3):
    """A unit vector orthogonal to the unit vector e; it varies smoothly with e, except where |e1| passes 0.8."""
    if abs(e1) < 0.8:
        t1, t2, t3 = cross(e1, e2, e3, 1.0, 0.0, 0.0)
    else:
        t1, t2, t3 = cross(e1, e2, e3, 0.0, 1.0, 0.0)
    scale = 1.0 / sqrt(t1 * t1 + t2 * t2 + t3 * t3)
    return scale * t1, scale * t2, scale * t3


@jit
def three_of(row):
    """The first three numbers of a row."""
    return row[0], row[1], row[2]


@jit
def put_vector(row, a1, a2, a3):
    """Write a vector into the first three numbers of a row."""
    row[0] = a1
    row[1] = a2
    row[2] = a3


@jit
def add_wrench(wrench, sense, f, m, r):
    """Add ``sense`` times a force f and a couple m, at the arm r, to a ``wrench`` (6,)."""
    c1, c2, c3 = cross(r[0], r[1], r[2], f[0], f[1], f[2])
    wrench[0] += sense * f[0]
    wrench[1] += sense * f[1]
    wrench[2] += sense * f[2]
    wrench[3] += sense * (m[0] + c1)
    wrench[4] += sense * (m[1] + c2)
    wrench[5] += sense * (m[2] + c3)


SMALL = 1e-8  # rad2: below it the series of `half_turn` are exact to rounding
SERIES = 1e-4  # rad2: below it those of `turned_back` are


@jit
def product(a, b, c, d, w, x, y, z):
    """The quaternion of the rotation (w, x, y, z) followed by the rotation (a, b, c, d)."""
    return (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )


@jit
def axes_of(q):
    """The three axes, in the world, of a frame with the unit quaternion q."""
    w, x, y, z = q
    x2 = x + x
    y2 = y + y
    z2 = z + z
    xx = x * x2
    yy = y * y2
    zz = z * z2
    xy = x * y2
    xz = x * z2
    yz = y * z2
    wx = w * x2
    wy = w * y2
    wz = w * z2
    return (
        (1.0 - yy - zz, xy + wz, xz - wy),
        (xy - wz, 1.0 - xx - zz, yz + wx),
        (xz + wy, yz - wx, 1.0 - xx - yy),
    )


@jit
def half_turn(angle2):
    """cos(a / 2) and sin(a / 2) / a of the angle a whose square is ``angle2``: the quaternion of a rotation vector r is
    (c, s r)."""
    if angle2 > SMALL:
        angle = sqrt(angle2)
        return cos(0.5 * angle), sin(0.5 * angle) / angle
    return 1.0 - 0.125 * angle2, 0.5 - angle2 * (1.0 / 48.0)


@jit
def rotate_by(w, x, y, z, a1, a2, a3):
    """R(q) a by the unit quaternion q = (w, x, y, z)."""
    c1, c2, c3 = cross(x, y, z, a1, a2, a3)
    c1 = 2.0 * c1
    c2 = 2.0 * c2
    c3 = 2.0 * c3
    d1, d2, d3 = cross(x, y, z, c1, c2, c3)
    return a1 + w * c1 + d1, a2 + w * c2 + d2, a3 + w * c3 + d3


@jit
def rotate(q, b, a1, a2, a3):
    """R(q[b]) a: body vector to world by the unit quaternion of block ``b``."""
    return rotate_by(q[b, 0], q[b, 1], q[b, 2], q[b, 3], a1, a2, a3)


@jit
def rotate_back(q, b, a1, a2, a3):
    """R(q[b])^T a: world vector to the body frame of block ``b``."""
    return rotate_by(q[b, 0], -q[b, 1], -q[b, 2], -q[b, 3], a1, a2, a3)


@jit
def turned(q, b, r1, r2, r3):
    """Quaternion exp(r) q[b] for a rotation vector r in the world frame, normalised."""
    c, s = half_turn(r1 * r1 + r2 * r2 + r3 * r3)
    w, x, y, z = product(c, s * r1, s * r2, s * r3, q[b, 0], q[b, 1], q[b, 2], q[b, 3])
    n = 1.0 / sqrt(w * w + x * x + y * y + z * z)
    return w * n, x * n, y * n, z * n


@jit
def turned_back(r1, r2, r3, a1, a2, a3):
    """exp(-r) a for a rotation vector r."""
    c1, c2, c3 = cross(r1, r2, r3, a1, a2, a3)
    d1, d2, d3 = cross(r1, r2, r3, c1, c2, c3)
    angle2 = r1 * r1 + r2 * r2 + r3 * r3
    if angle2 > SERIES:
        angle = sqrt(angle2)
        s = sin(angle) / angle
        h = sin(0.5 * angle) / angle
        k = 2.0 * h * h
    else:
        s = 1.0 - angle2 * (1.0 / 6.0 - angle2 * (1.0 / 120.0))
        k = 0.5 - angle2 * (1.0 / 24.0 - angle2 * (1.0 / 720.0))
    return a1 - s * c1 + k * d1, a2 - s * c2 + k * d2, a3 - s * c3 + k * d3


@jit
def turning(w, x, y, z, a, b, c):
    """R v - v of the vector (a, b, c), without loss of digits: 2 w (u x v) + 2 u x (u x v)."""
    p, q, r = cross(2.0 * x, 2.0 * y, 2.0 * z, a, b, c)
    i, j, k = cross(x, y, z, p, q, r)
    return w * p + i, w * q + j, w * r + k
