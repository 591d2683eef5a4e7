"""Sums in pairs, term by term those of ``numpy.sum``: their error grows with the logarithm of the number of terms."""

from numpy import empty, ndarray

from dembrick._jit import jit_rounded

LEAF = 128  # most terms that are summed without halving
LANES = 8
DEEPEST = 64  # deepest level of halving: more than any array needs


def room_for_halves() -> ndarray:
    """Scratch (2, `DEEPEST`) of `sum_in_pairs`."""
    return empty((2, DEEPEST))


@jit_rounded
def sum_of_leaf(values, first, count):
    """Sum of ``count`` values, at most `LEAF`, from index ``first`` on."""
    total = 0.0
    whole = 0
    if count >= LANES:
        a, b, c, d = values[first], values[first + 1], values[first + 2], values[first + 3]
        e, f, g, h = values[first + 4], values[first + 5], values[first + 6], values[first + 7]
        whole = count - count % LANES
        for i in range(first + LANES, first + whole, LANES):
            a += values[i]
            b += values[i + 1]
            c += values[i + 2]
            d += values[i + 3]
            e += values[i + 4]
            f += values[i + 5]
            g += values[i + 6]
            h += values[i + 7]
        total = ((a + b) + (c + d)) + ((e + f) + (g + h))
    for i in range(first + whole, first + count):
        total += values[i]
    return total


@jit_rounded
def sum_in_pairs(values, halves):
    """Sum of ``values`` (n,) by repeated halving. ``halves`` is scratch, see `room_for_halves`: the sums of first
    halves, and the numbers of terms of their second halves, set to zero while these are summed."""
    first = depth = 0
    count = values.size
    while True:
        while count > LEAF:
            half = count // 2
            half -= half % LANES
            halves[1, depth] = count - half
            depth += 1
            count = half
        total = sum_of_leaf(values, first, count)
        first += count
        while depth > 0 and halves[1, depth - 1] == 0.0:
            depth -= 1
            total = halves[0, depth] + total
        if depth == 0:
            return total
        halves[0, depth - 1] = total
        count = int(halves[1, depth - 1])
        halves[1, depth - 1] = 0.0
