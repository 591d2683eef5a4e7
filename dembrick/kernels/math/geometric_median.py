"""The geometric median of weighted points: the centre with the least mean distance from them."""

from math import sqrt

from dembrick._jit import jit


@jit
def median_distance(x, y, weights, first, last):
    """Least weighted mean distance of points from any centre: M_T0 / V_0 of a joint that acts at points.

    The geometric median by Weiszfeld's iteration, safeguarded at the points as by Vardi and Zhang. The value returned
    belongs to an actual centre: it is never below the minimum, and above it by rounding only.
    """
    total = c1 = c2 = 0.0
    for i in range(first, last):
        total += weights[i]
        c1 += weights[i] * x[i]
        c2 += weights[i] * y[i]
    c1 /= total
    c2 /= total
    best = 1e300
    for _ in range(10_000):
        value = 0.0
        for i in range(first, last):
            value += weights[i] * sqrt((x[i] - c1) ** 2 + (y[i] - c2) ** 2)
        value /= total
        if value >= best * (1.0 - 1e-15):
            return min(best, value)
        best = value
        pull = m1 = m2 = own = 0.0
        for i in range(first, last):
            distance = sqrt((x[i] - c1) ** 2 + (y[i] - c2) ** 2)
            share = weights[i] / total
            if distance <= 1e-14 * value:
                own += share
            else:
                pull += share / distance
                m1 += share / distance * x[i]
                m2 += share / distance * y[i]
        t1 = m1 / pull - c1
        t2 = m2 / pull - c2
        rest = pull * sqrt(t1 * t1 + t2 * t2)
        if rest <= own:
            return value
        c1 += (1.0 - own / rest) * t1
        c2 += (1.0 - own / rest) * t2
    return best
