"""Multifrontal LU factors of large sparse matrices of 6 x 6 blocks, with row exchanges inside a front.

A matrix whose pattern is symmetric is eliminated front by front along an elimination tree. A front is a small dense
matrix: p pivot rows, and the b boundary rows of blocks that come later and are coupled to them,

    [ F11  F12 ]      F11 = P^T L11 U11,   U12 = L11^-1 P F12,   L21 = F21 U11^-1,
    [ F21  F22 ]      update = F22 - L21 U12 (Schur complement), which is added to the parent's front.

[F11 F12] (p, p + b) and F21 (b, p) stand in ``entries`` and are replaced by their factors; the update stays in ``room``
until it is added to the parent's front. Rows are exchanged among the pivot rows of a front only (static pivoting): the
pattern never changes, so one symbolic analysis serves all matrices of an assembly. Duff and Reid, ACM TOMS 9 (1983)
302. The tree fixes the order of all operations, so the result does not depend on the number of threads.
"""

from typing import NamedTuple

from numpy import ndarray

from dembrick._jit import entry, jit

SIX = 6  # rows of a block
AT_ONCE = 192  # columns of a product that fit the fastest cache


class Fronts(NamedTuple):
    """Elimination tree and factors of n blocks in s fronts; each front comes after all its children."""

    first: ndarray  # (s + 1,) int64, first pivot block of each front, in the order of elimination
    edge: ndarray  # (s + 1,) int64, where its boundary blocks start in ``boundary``
    boundary: ndarray  # (e,) int64, boundary blocks by their place in the order of elimination, ascending
    inside: ndarray  # (e,) int64, the same as block numbers of the parent's front
    start: ndarray  # (s,) int64, where its entries start
    update: ndarray  # (s,) int64, where its update starts in ``room``
    child: ndarray  # (s + 1,) int64, where its children start in ``children``
    children: ndarray  # (c,) int64
    part: ndarray  # (s + 1,) int64, where its contributions start in the four arrays below
    element: ndarray  # (m,) int64, an element (joint) ...
    sides: ndarray  # (m,) int64, ... its rows of block a (0) or b (2), plus its columns of a (0) or b (1)
    target: ndarray  # (m,) int64, first entry it is added to
    stride: ndarray  # (m,) int64, entries from one row to the next there
    entries: ndarray  # (f,) the matrix, then its factors
    room: ndarray  # (r,) updates
    exchange: ndarray  # (6 n,) int64, the row that each pivot row was exchanged with
    near: ndarray  # (6 b,) scratch for the boundary of one front


class Rounded(NamedTuple):
    """Factors A = L D L^T of a symmetric matrix in single precision, where that is enough, as for an artificial
    inertia.

    Half of the entries, each in half of the bytes: the speed of a substitution is that of the memory. The matrix that
    they represent is symmetric, and positive as long as D is. The energy of a motion differs from that of A by at most
    1e-7 times the root of the condition number, since (L^T x) . D (L^T x) contains the rounding of L to first order.
    """

    first: ndarray  # as in `Fronts`
    edge: ndarray
    boundary: ndarray
    start: ndarray  # (s,) int64, where the rows of L^T of each front start: to the right of each diagonal entry
    values: ndarray  # (v,) float32
    inverse: ndarray  # (6 n,) of D
    near: ndarray  # (6 b,) scratch for the boundary of one front


@jit
def subtract_three(c, multiples, b):
    """Subtract from each of three rows c its six ``multiples`` of the six rows b."""
    c0, c1, c2 = c
    m0, m1, m2 = multiples
    b0, b1, b2, b3, b4, b5 = b
    p0, p1, p2, p3, p4, p5 = m0[0], m0[1], m0[2], m0[3], m0[4], m0[5]
    q0, q1, q2, q3, q4, q5 = m1[0], m1[1], m1[2], m1[3], m1[4], m1[5]
    r0, r1, r2, r3, r4, r5 = m2[0], m2[1], m2[2], m2[3], m2[4], m2[5]
    for i in range(c0.size):
        x0 = b0[i]
        x1 = b1[i]
        x2 = b2[i]
        x3 = b3[i]
        x4 = b4[i]
        x5 = b5[i]
        c0[i] -= ((p0 * x0 + p1 * x1) + (p2 * x2 + p3 * x3)) + (p4 * x4 + p5 * x5)
        c1[i] -= ((q0 * x0 + q1 * x1) + (q2 * x2 + q3 * x3)) + (q4 * x4 + q5 * x5)
        c2[i] -= ((r0 * x0 + r1 * x1) + (r2 * x2 + r3 * x3)) + (r4 * x4 + r5 * x5)


class Panel(NamedTuple):
    """A dense matrix by rows in a flat array."""

    values: ndarray
    first: int  # index of the first entry
    wide: int  # entries from one row to the next


@jit
def row_of(panel, i, column, size):
    """Slice of ``size`` entries of row ``i`` of a `Panel` from a ``column`` on."""
    start = panel.first + i * panel.wide + column
    return slice(start, start + size)


@entry
def subtract_product(c, a, b, rows, depth, columns):
    """C -= A B of three `Panel`; ``rows`` is a multiple of three, ``depth`` of six."""
    for column in range(0, columns, AT_ONCE):
        n = min(AT_ONCE, columns - column)
        for k in range(0, depth, SIX):
            for i in range(0, rows, 3):
                subtract_three(
                    (
                        c.values[row_of(c, i, column, n)],
                        c.values[row_of(c, i + 1, column, n)],
                        c.values[row_of(c, i + 2, column, n)],
                    ),
                    (
                        a.values[row_of(a, i, k, SIX)],
                        a.values[row_of(a, i + 1, k, SIX)],
                        a.values[row_of(a, i + 2, k, SIX)],
                    ),
                    (
                        b.values[row_of(b, k, column, n)],
                        b.values[row_of(b, k + 1, column, n)],
                        b.values[row_of(b, k + 2, column, n)],
                        b.values[row_of(b, k + 3, column, n)],
                        b.values[row_of(b, k + 4, column, n)],
                        b.values[row_of(b, k + 5, column, n)],
                    ),
                )


@jit
def factorise_six(a, start, wide, pivots, k0, exchange, row, threshold, least):
    """LU factors of six columns from ``k0`` on of the pivot rows of a front; rows are exchanged as a whole.

    A diagonal entry above ``threshold`` times the greatest below it stays the pivot. Returns -1, or the first column
    whose pivot is at most ``least`` or not a number.
    """
    end = k0 + SIX
    for k in range(k0, end):
        here = start + k * wide
        best = k
        for i in range(k + 1, pivots):
            if abs(a[start + i * wide + k]) > abs(a[start + best * wide + k]):
                best = i
        if abs(a[here + k]) >= threshold * abs(a[start + best * wide + k]):
            best = k
        exchange[row + k] = row + best
        if best != k:
            there = start + best * wide
            for c in range(wide):
                a[here + c], a[there + c] = a[there + c], a[here + c]
        pivot = a[here + k]
        if not abs(pivot) > least[row + k]:
            return k
        inverse = 1.0 / pivot
        for i in range(k + 1, pivots):
            at = start + i * wide
            m = a[at + k] * inverse
            a[at + k] = m
            if m != 0.0:
                for c in range(k + 1, end):
                    a[at + c] -= m * a[here + c]
    # the entries of these rows to the right
    for k in range(k0 + 1, end):
        at = start + k * wide
        for j in range(k0, k):
            m = a[at + j]
            if m != 0.0:
                there = start + j * wide
                for c in range(end, wide):
                    a[at + c] -= m * a[there + c]
    return -1


@jit
def divide_six(a, start, wide, lower, pivots, rows, k0):
    """The six columns from ``k0`` on of L21: boundary rows divided by the triangle of the six pivots."""
    u0 = start + k0 * wide + k0
    u1 = u0 + wide
    u2 = u1 + wide
    u3 = u2 + wide
    u4 = u3 + wide
    r0 = 1.0 / a[u0]
    r1 = 1.0 / a[u1 + 1]
    r2 = 1.0 / a[u2 + 2]
    r3 = 1.0 / a[u3 + 3]
    r4 = 1.0 / a[u4 + 4]
    r5 = 1.0 / a[u4 + wide + 5]
    u01, u02, u03, u04, u05 = a[u0 + 1], a[u0 + 2], a[u0 + 3], a[u0 + 4], a[u0 + 5]
    u12, u13, u14, u15 = a[u1 + 2], a[u1 + 3], a[u1 + 4], a[u1 + 5]
    u23, u24, u25 = a[u2 + 3], a[u2 + 4], a[u2 + 5]
    u34, u35 = a[u3 + 4], a[u3 + 5]
    u45 = a[u4 + 5]
    for i in range(rows):
        at = lower + i * pivots + k0
        x0 = a[at] * r0
        x1 = (a[at + 1] - x0 * u01) * r1
        x2 = (a[at + 2] - x0 * u02 - x1 * u12) * r2
        x3 = (a[at + 3] - x0 * u03 - x1 * u13 - x2 * u23) * r3
        x4 = (a[at + 4] - x0 * u04 - x1 * u14 - x2 * u24 - x3 * u34) * r4
        x5 = (a[at + 5] - x0 * u05 - x1 * u15 - x2 * u25 - x3 * u35 - x4 * u45) * r5
        a[at] = x0
        a[at + 1] = x1
        a[at + 2] = x2
        a[at + 3] = x3
        a[at + 4] = x4
        a[at + 5] = x5


@jit
def add_elements(fronts, s, left_a, left_b, middle):
    """Add the contributions of the elements to front ``s``: +- left^T middle right, blocks of 6 x 6."""
    for q in range(fronts.part[s], fronts.part[s + 1]):
        j = fronts.element[q]
        side = fronts.sides[q]
        left = left_b[j] if side >= 2 else left_a[j]
        right = left_b[j] if side % 2 == 1 else left_a[j]
        sign = 1.0 if (side >= 2) == (side % 2 == 1) else -1.0
        for i in range(SIX):
            at = fronts.target[q] + i * fronts.stride[q]
            for m in range(SIX):
                total = 0.0
                for k in range(SIX):
                    total += left[k, i] * middle[j, k, m]
                if total != 0.0:
                    total *= sign
                    for c in range(SIX):
                        fronts.entries[at + c] += total * right[m, c]


@jit
def add_update(fronts, s, child, pivots, boundary):
    """Add the update of a child to front ``s``, which has ``pivots`` and ``boundary`` rows (extend-add)."""
    first = fronts.edge[child]
    count = fronts.edge[child + 1] - first
    wide = pivots + boundary
    lower = fronts.start[s] + pivots * wide
    entries = fronts.entries
    room = fronts.room
    for i in range(count):
        row = SIX * fronts.inside[first + i]
        for r in range(SIX):
            given = fronts.update[child] + (SIX * i + r) * SIX * count
            for k in range(count):
                column = SIX * fronts.inside[first + k]
                if row < pivots:
                    at = fronts.start[s] + (row + r) * wide + column
                    for c in range(SIX):
                        entries[at + c] += room[given + SIX * k + c]
                elif column < pivots:
                    at = lower + (row + r - pivots) * pivots + column
                    for c in range(SIX):
                        entries[at + c] += room[given + SIX * k + c]
                else:
                    at = fronts.update[s] + (row + r - pivots) * boundary + column - pivots
                    for c in range(SIX):
                        room[at + c] += room[given + SIX * k + c]


@entry
def eliminate(fronts, left_a, left_b, middle, first, stop, threshold, least):
    """Factorise the fronts ``first`` to ``stop`` - 1 of the matrix assembled from elements (joints).

    Element j couples the blocks a and b: ``middle[j]`` (6, 6) acts on its own motion, ``left_b[j]`` times that of b
    minus ``left_a[j]`` times that of a. A pivot above ``threshold`` times the greatest entry of its column in the front
    stays where it is. Returns -1, or the first row of the block where the matrix is singular: a pivot is at most
    ``least`` (6 n,).
    """
    entries = fronts.entries
    room = fronts.room
    for s in range(first, stop):
        pivots = SIX * (fronts.first[s + 1] - fronts.first[s])
        boundary = SIX * (fronts.edge[s + 1] - fronts.edge[s])
        start = fronts.start[s]
        wide = pivots + boundary
        lower = start + pivots * wide
        update = fronts.update[s]
        for i in range(start, lower + boundary * pivots):
            entries[i] = 0.0
        for i in range(update, update + boundary * boundary):
            room[i] = 0.0
        add_elements(fronts, s, left_a, left_b, middle)
        for c in range(fronts.child[s], fronts.child[s + 1]):
            add_update(fronts, s, fronts.children[c], pivots, boundary)
        row = SIX * fronts.first[s]
        for k in range(0, pivots, SIX):
            failed = factorise_six(entries, start, wide, pivots, k, fronts.exchange, row, threshold, least)
            if failed >= 0:
                return row + failed - failed % SIX
            below = k + SIX
            right = Panel(entries, start + k * wide + below, wide)
            rest = Panel(entries, start + below * wide + below, wide)
            subtract_product(
                rest, Panel(entries, start + below * wide + k, wide), right, pivots - below, SIX, wide - below
            )
            divide_six(entries, start, wide, lower, pivots, boundary, k)
            rest = Panel(entries, lower + below, pivots)
            subtract_product(rest, Panel(entries, lower + k, pivots), right, boundary, SIX, pivots - below)
        top = Panel(entries, start + pivots, wide)
        rest = Panel(room, update, boundary)
        subtract_product(rest, Panel(entries, lower, pivots), top, boundary, pivots, boundary)
    return -1


@jit
def dot(a, i, b, k, n):
    """Sum of a[i + m] b[k + m] over m < n, in eight independent parts: additions to one sum wait for each other."""
    s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = 0.0
    m = 0
    while m + 8 <= n:
        s0 += a[i + m] * b[k + m]
        s1 += a[i + m + 1] * b[k + m + 1]
        s2 += a[i + m + 2] * b[k + m + 2]
        s3 += a[i + m + 3] * b[k + m + 3]
        s4 += a[i + m + 4] * b[k + m + 4]
        s5 += a[i + m + 5] * b[k + m + 5]
        s6 += a[i + m + 6] * b[k + m + 6]
        s7 += a[i + m + 7] * b[k + m + 7]
        m += 8
    while m < n:
        s0 += a[i + m] * b[k + m]
        m += 1
    return ((s0 + s1) + (s2 + s3)) + ((s4 + s5) + (s6 + s7))


@entry
def substitute_forward(fronts, x):
    """L z = P x in place, for each row of ``x`` (m, 6 n): in the order of elimination."""
    a = fronts.entries
    for s in range(fronts.start.size):
        row = SIX * fronts.first[s]
        pivots = SIX * (fronts.first[s + 1] - fronts.first[s])
        wide = pivots + SIX * (fronts.edge[s + 1] - fronts.edge[s])
        for r in range(x.shape[0]):
            z = x[r]
            for k in range(pivots):
                other = fronts.exchange[row + k]
                z[row + k], z[other] = z[other], z[row + k]
            for i in range(1, pivots):
                z[row + i] -= dot(a, fronts.start[s] + i * wide, z, row, i)
            lower = fronts.start[s] + pivots * wide
            for e in range(fronts.edge[s], fronts.edge[s + 1]):
                to = SIX * fronts.boundary[e]
                for c in range(SIX):
                    z[to + c] -= dot(a, lower, z, row, pivots)
                    lower += pivots


@entry
def substitute_back(fronts, x):
    """U y = z in place, for each row of ``x`` (m, 6 n)."""
    a = fronts.entries
    near = fronts.near
    for s in range(fronts.start.size - 1, -1, -1):
        row = SIX * fronts.first[s]
        pivots = SIX * (fronts.first[s + 1] - fronts.first[s])
        boundary = SIX * (fronts.edge[s + 1] - fronts.edge[s])
        for r in range(x.shape[0]):
            z = x[r]
            for e in range(fronts.edge[s], fronts.edge[s + 1]):
                to = SIX * (e - fronts.edge[s])
                for c in range(SIX):
                    near[to + c] = z[SIX * fronts.boundary[e] + c]
            for i in range(pivots - 1, -1, -1):
                at = fronts.start[s] + i * (pivots + boundary)
                known = dot(a, at + i + 1, z, row + i + 1, pivots - 1 - i) + dot(a, at + pivots, near, 0, boundary)
                z[row + i] = (z[row + i] - known) / a[at + i]


@entry
def energy_norm(fronts, x):
    """x . A^-1 x of a symmetric A = L D L^T factorised without row exchanges; ``x`` (1, 6 n) is overwritten."""
    substitute_forward(fronts, x)
    total = 0.0
    for s in range(fronts.start.size):
        row = SIX * fronts.first[s]
        pivots = SIX * (fronts.first[s + 1] - fronts.first[s])
        wide = pivots + SIX * (fronts.edge[s + 1] - fronts.edge[s])
        for i in range(pivots):
            total += x[0, row + i] * x[0, row + i] / fronts.entries[fronts.start[s] + i * wide + i]
    return total


@entry
def round_factors(fronts, rounded):
    """Fill ``rounded`` with the factors of a symmetric A that was factorised without row exchanges."""
    a = fronts.entries
    for s in range(fronts.start.size):
        row = SIX * fronts.first[s]
        pivots = SIX * (fronts.first[s + 1] - fronts.first[s])
        wide = pivots + SIX * (fronts.edge[s + 1] - fronts.edge[s])
        to = rounded.start[s]
        for i in range(pivots):
            at = fronts.start[s] + i * wide
            inverse = 1.0 / a[at + i]
            rounded.inverse[row + i] = inverse
            for c in range(i + 1, wide):
                rounded.values[to] = a[at + c] * inverse
                to += 1


@jit
def subtract_multiple(y, values, factor):
    """y -= factor values; takes slices, whose indices cannot be negative, so that the loop is vectorised."""
    for k in range(y.size):
        y[k] -= values[k] * factor


@jit
def solve_rounded_in_place(rounded, z):
    """Solve L D L^T y = z in place, ``z`` (6 n,) in the order of elimination."""
    values = rounded.values
    near = rounded.near
    for s in range(rounded.start.size):
        row = SIX * rounded.first[s]
        pivots = SIX * (rounded.first[s + 1] - rounded.first[s])
        edge = rounded.edge[s]
        boundary = SIX * (rounded.edge[s + 1] - edge)
        for k in range(boundary):
            near[k] = 0.0
        at = rounded.start[s]
        for i in range(pivots):
            inner = pivots - 1 - i
            subtract_multiple(z[row + i + 1 : row + pivots], values[at : at + inner], z[row + i])
            subtract_multiple(near[:boundary], values[at + inner : at + inner + boundary], z[row + i])
            at += inner + boundary
        for k in range(boundary):
            z[SIX * rounded.boundary[edge + k // SIX] + k % SIX] += near[k]
    for i in range(z.size):
        z[i] *= rounded.inverse[i]
    for s in range(rounded.start.size - 1, -1, -1):
        row = SIX * rounded.first[s]
        pivots = SIX * (rounded.first[s + 1] - rounded.first[s])
        edge = rounded.edge[s]
        boundary = SIX * (rounded.edge[s + 1] - edge)
        for k in range(boundary):
            near[k] = z[SIX * rounded.boundary[edge + k // SIX] + k % SIX]
        at = rounded.start[s] + (pivots * (pivots - 1)) // 2 + pivots * boundary
        for i in range(pivots - 1, -1, -1):
            at -= boundary
            known = dot(values, at, near, 0, boundary)
            at -= pivots - 1 - i
            z[row + i] -= known + dot(values, at, z, row + i + 1, pivots - 1 - i)
