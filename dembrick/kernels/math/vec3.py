"""Vectors and rotations as bare floats: an array of three costs fifty times as much in a compiled loop."""

from math import cos, sin, sqrt

from dembrick._jit import jit


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
def product(a, b, c, d, w, x, y, z):
    """The quaternion of the turn (w, x, y, z) followed by the turn (a, b, c, d)."""
    return (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )


@jit
def rotate(q, b, a1, a2, a3):
    """R(q[b]) a: body vector to world by the unit quaternion of block ``b``."""
    w = q[b, 0]
    x = q[b, 1]
    y = q[b, 2]
    z = q[b, 3]
    c1, c2, c3 = cross(x, y, z, a1, a2, a3)
    c1 = 2.0 * c1
    c2 = 2.0 * c2
    c3 = 2.0 * c3
    d1, d2, d3 = cross(x, y, z, c1, c2, c3)
    return a1 + w * c1 + d1, a2 + w * c2 + d2, a3 + w * c3 + d3


@jit
def rotate_back(q, b, a1, a2, a3):
    """R(q[b])^T a: world vector to the body frame of block ``b``."""
    w = q[b, 0]
    x = -q[b, 1]
    y = -q[b, 2]
    z = -q[b, 3]
    c1, c2, c3 = cross(x, y, z, a1, a2, a3)
    c1 = 2.0 * c1
    c2 = 2.0 * c2
    c3 = 2.0 * c3
    d1, d2, d3 = cross(x, y, z, c1, c2, c3)
    return a1 + w * c1 + d1, a2 + w * c2 + d2, a3 + w * c3 + d3


@jit
def turned(q, b, r1, r2, r3):
    """Quaternion exp(r) q[b] for a rotation vector r in the world frame, normalised."""
    angle2 = r1 * r1 + r2 * r2 + r3 * r3
    angle = sqrt(angle2)
    if angle > 1e-4:
        s = sin(0.5 * angle) / angle
        c = cos(0.5 * angle)
    else:
        s = 0.5 - angle2 / 48.0
        c = 1.0 - angle2 / 8.0 + angle2 * angle2 / 384.0
    x = s * r1
    y = s * r2
    z = s * r3
    qw = q[b, 0]
    qx = q[b, 1]
    qy = q[b, 2]
    qz = q[b, 3]
    w = c * qw - x * qx - y * qy - z * qz
    i = c * qx + x * qw + y * qz - z * qy
    j = c * qy + y * qw + z * qx - x * qz
    k = c * qz + z * qw + x * qy - y * qx
    n = 1.0 / sqrt(w * w + i * i + j * j + k * k)
    return w * n, i * n, j * n, k * n


@jit
def tangent(e1, e2, e3):
    """A unit vector orthogonal to the unit vector e, which follows it smoothly while it stays about where it is."""
    if abs(e1) < 0.8:
        t1, t2, t3 = cross(e1, e2, e3, 1.0, 0.0, 0.0)
    else:
        t1, t2, t3 = cross(e1, e2, e3, 0.0, 1.0, 0.0)
    scale = 1.0 / sqrt(t1 * t1 + t2 * t2 + t3 * t3)
    return scale * t1, scale * t2, scale * t3
