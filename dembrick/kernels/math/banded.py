"""Band matrices without symmetry: Gaussian elimination with row exchanges, for two right-hand sides at once.

Row i holds the columns i - h ... i + 2 h of a matrix whose half width is h - 5, column k at ``band[i, k - i + h]``; the
rest is room for what the exchanges bring. Six columns are eliminated at a time, those of one block: a row below is then
fetched and stored once for six multiples of the rows above. The rows of a matrix are a multiple of six.
"""

from dembrick._jit import jit

WIDE = 6  # columns eliminated at a time
LEAST = 0.1  # of the greatest entry of a column: a pivot above it stays where it is, and the band does not widen


@jit
def take(a, m, b):
    """Subtract m b from a, in place; on slices, so that the processor can take several entries at once."""
    for c in range(a.size):
        a[c] -= m * b[c]


@jit
def take_six(a, m, b0, b1, b2, b3, b4, b5):
    """Subtract m[0] b0 + ... + m[5] b5 from a, in place."""
    m0 = m[0]
    m1 = m[1]
    m2 = m[2]
    m3 = m[3]
    m4 = m[4]
    m5 = m[5]
    for c in range(a.size):
        a[c] -= ((m0 * b0[c] + m1 * b1[c]) + (m2 * b2[c] + m3 * b3[c])) + (m4 * b4[c] + m5 * b5[c])


@jit
def eliminate_six(band, h, x, y, start, reach):
    """Find the pivots of six columns from ``start`` on, and eliminate below them within these columns only.

    What a row was multiplied by stays in the place of the entry that it made zero. Returns how far the rows of the
    pivots reach, given how far those before did, or -1 where A is singular.
    """
    n = x.size
    half = h - WIDE + 1
    for k in range(start, start + WIDE):
        last = min(n, k + half + 1)
        p = k
        for i in range(k + 1, last):
            if abs(band[i, k - i + h]) > abs(band[p, k - p + h]):
                p = i
        if band[p, k - p + h] == 0.0:
            return -1
        if abs(band[k, h]) >= LEAST * abs(band[p, k - p + h]):
            p = k
        reach = max(reach, min(n, p + half + 1))
        if p != k:
            for c in range(start, reach):
                band[k, c - k + h], band[p, c - p + h] = band[p, c - p + h], band[k, c - k + h]
            x[k], x[p] = x[p], x[k]
            y[k], y[p] = y[p], y[k]
        for i in range(k + 1, last):
            below = band[i, k - i + h]
            if below != 0.0:
                m = below / band[k, h]
                band[i, k - i + h] = m
                for c in range(k + 1, start + WIDE):
                    band[i, c - i + h] -= m * band[k, c - k + h]
                x[i] -= m * x[k]
                y[i] -= m * y[k]
    return reach


@jit
def eliminate(band, h, x, y, first, stop):
    """Eliminate the columns ``first`` to ``stop`` of A, multiples of six, from the rows below, and from x and y.

    Returns False where A is singular. A large matrix is taken in parts, so that nobody waits long for any of them.
    """
    n = x.size
    reach = min(n, first + 2 * h)  # of rows that were exchanged before
    for start in range(first, stop, WIDE):
        reach = eliminate_six(band, h, x, y, start, reach)
        if reach < 0:
            return False
        end = start + WIDE
        # the rest of the pivots' rows, then that of the rows below
        for k in range(start + 1, end):
            for j in range(start, k):
                m = band[k, j - k + h]
                if m != 0.0:
                    take(band[k, end - k + h : reach - k + h], m, band[j, end - j + h : reach - j + h])
        s = end - start + h
        t = reach - start + h
        for i in range(end, min(n, start + h + 1)):
            m = band[i, start - i + h : end - i + h]
            if m[0] != 0.0 or m[1] != 0.0 or m[2] != 0.0 or m[3] != 0.0 or m[4] != 0.0 or m[5] != 0.0:
                take_six(
                    band[i, end - i + h : reach - i + h], m,
                    band[start, s:t], band[start + 1, s - 1 : t - 1], band[start + 2, s - 2 : t - 2],
                    band[start + 3, s - 3 : t - 3], band[start + 4, s - 4 : t - 4], band[start + 5, s - 5 : t - 5],
                )  # fmt: skip
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
