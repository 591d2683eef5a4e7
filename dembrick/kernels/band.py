"""Band matrices without symmetry: Gaussian elimination with row exchanges, for two right-hand sides at once.

Row i holds the columns i - h ... i + 2 h of a matrix of half width h, column k at ``band[i, k - i + h]``; the last h
are room for what the exchanges bring.
"""

from dembrick._jit import jit


@jit
def take(a, m, b):
    """Subtract m b from a, in place; on slices, so that the processor can take several entries at once."""
    for c in range(a.size):
        a[c] -= m * b[c]


@jit
def solve_band(band, h, x, y):
    """Solve A x' = x and A y' = y in place, and destroy the matrix. Returns False where it is singular."""
    n = x.size
    for k in range(n):
        last = min(n, k + h + 1)
        p = k
        for i in range(k + 1, last):
            if abs(band[i, k - i + h]) > abs(band[p, k - p + h]):
                p = i
        if band[p, k - p + h] == 0.0:
            return False
        end = min(n, k + 2 * h + 1)
        if p != k:
            for c in range(k, end):
                band[k, c - k + h], band[p, c - p + h] = band[p, c - p + h], band[k, c - k + h]
            x[k], x[p] = x[p], x[k]
            y[k], y[p] = y[p], y[k]
        for i in range(k + 1, last):
            first = band[i, k - i + h]
            if first != 0.0:
                m = first / band[k, h]
                take(band[i, h + k - i + 1 : h + end - i], m, band[k, h + 1 : h + end - k])
                x[i] -= m * x[k]
                y[i] -= m * y[k]
    for k in range(n - 1, -1, -1):
        a = x[k]
        b = y[k]
        for c in range(1, min(n - k, 2 * h + 1)):
            a -= band[k, h + c] * x[k + c]
            b -= band[k, h + c] * y[k + c]
        x[k] = a / band[k, h]
        y[k] = b / band[k, h]
    return True
