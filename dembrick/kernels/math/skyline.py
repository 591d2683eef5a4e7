"""Cholesky factors of stiffness matrices, stored by rows from the first entry that is not zero (skyline).

Row i of the lower triangle holds the columns first[i] ... i, its diagonal last; entry (i, k) stands at
``start[i] + k - first[i]``. Nothing outside the skyline of a matrix fills in.
"""

from math import sqrt

from dembrick._jit import jit


@jit
def dot(a, i, b, k, n):
    """Sum of a[i + m] b[k + m] over m < n, in four independent parts: a single one waits for itself."""
    s0 = s1 = s2 = s3 = 0.0
    m = 0
    while m + 4 <= n:
        s0 += a[i + m] * b[k + m]
        s1 += a[i + m + 1] * b[k + m + 1]
        s2 += a[i + m + 2] * b[k + m + 2]
        s3 += a[i + m + 3] * b[k + m + 3]
        m += 4
    while m < n:
        s0 += a[i + m] * b[k + m]
        m += 1
    return (s0 + s1) + (s2 + s3)


@jit
def factorise(first, start, lower, least, first_row, stop):
    """Replace the rows ``first_row`` to ``stop`` of the lower triangle of a symmetric matrix by its Cholesky factor.

    Rows come in order; a large matrix is taken in parts, so that nobody waits long for any of them. Returns -1, or the
    first row whose pivot is below ``least`` of its diagonal: the matrix is not positive definite.
    """
    for i in range(first_row, stop):
        here = start[i] - first[i]
        diagonal = lower[here + i]
        for k in range(first[i], i):
            there = start[k] - first[k]
            begin = max(first[i], first[k])
            total = dot(lower, here + begin, lower, there + begin, k - begin)
            lower[here + k] = (lower[here + k] - total) / lower[there + k]
        pivot = diagonal - dot(lower, start[i], lower, start[i], i - first[i])
        if not pivot > least * diagonal:
            return i
        lower[here + i] = sqrt(pivot)
    return -1


@jit
def solve_in_place(first, start, lower, x):
    """Solve L L^T y = x, the answer in place of x."""
    for i in range(first.size):
        n = i - first[i]
        x[i] = (x[i] - dot(lower, start[i], x, first[i], n)) / lower[start[i] + n]
    for i in range(first.size - 1, -1, -1):
        n = i - first[i]
        value = x[i] / lower[start[i] + n]
        x[i] = value
        for m in range(n):
            x[first[i] + m] -= lower[start[i] + m] * value
