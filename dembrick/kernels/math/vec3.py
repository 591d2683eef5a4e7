"""Vectors as bare floats: an array of three costs fifty times as much in a compiled loop."""

from math import sqrt

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
    """A unit vector orthogonal to the unit vector e, which follows it smoothly while it stays about where it is."""
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
