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
def eliminate(band, h, x, y, first, stop):
    """Eliminate the columns ``first`` to ``stop`` of A from the rows below, and from x and y.

    Returns False where A is singular. A large matrix is taken in parts, so that nobody waits long for any of them.
    """
    n = x.size
    for k in range(first, stop):
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
            below = band[i, k - i + h]
            if below != 0.0:
                m = below / band[k, h]
                take(band[i, h + k - i + 1 : h + end - i], m, band[k, h + 1 : h + end - k])
                x[i] -= m * x[k]
                y[i] -= m * y[k]
    return True


@jit
def substitute(band, h, x, y):
    """The answers x' and y' of A x' = x and A y' = y in place, once all columns are eliminated."""
    n = x.size
    for k in range(n - 1, -1, -1):
        a = x[k]
        b = y[k]
        for c in range(1, min(n - k, 2 * h + 1)):
            a -= band[k, h + c] * x[k + c]
            b -= band[k, h + c] * y[k + c]
        x[k] = a / band[k, h]
        y[k] = b / band[k, h]
