"""Second-order cone programmes through Clarabel, and sparse linear systems through SciPy: optional packages, one
module.

Clarabel (interior points, qdldl on one thread) was chosen by measurement. Running-bond walls of 30 x 30 blocks,
processor time: out of their plane 0.7 s (31,860 unknown forces); in their plane, reduced to two dimensions, 0.3 s
against 1.5 s (interior points) and 5.6 s (simplex) of HiGHS 1.15 for the same linear programme. Supernodal factors
(faer) take as long or up to twice as long on such sparse systems, but half as long on those of a dome of 5,101 blocks
(183,000 unknown forces), whose factors are dense in large parts.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np

from dembrick.errors import MissingDependency, NotConvergedError

TOLERANCE = 1e-9  # of residuals and gap, relative, as Clarabel defines them
MOST_ITERATIONS = 300
LARGE = 60_000  # unknowns from which supernodal factors are faster
SIMILAR = 2.0  # powers of ten: loads of parts of a programme that are solved together
REGULAR = 1e-12  # of the diagonal: added to it before a symmetric matrix is factorized; refinement removes its effect
NEEDED = "limit analysis needs the package {name}: install it with pip install 'dembrick[limit]'"

SOLVED, INFEASIBLE, UNBOUNDED = "solved", "infeasible", "unbounded"
TO_TOLERANCE = "Solved"  # status of Clarabel
_STATUS = {
    TO_TOLERANCE: SOLVED,
    "AlmostSolved": SOLVED,  # the bounds show how accurate it is
    "InsufficientProgress": SOLVED,
    "PrimalInfeasible": INFEASIBLE,
    "AlmostPrimalInfeasible": INFEASIBLE,
    "DualInfeasible": UNBOUNDED,
    "AlmostDualInfeasible": UNBOUNDED,
}


class Entries(NamedTuple):
    """Entries of a sparse matrix: ``row``, ``column``, ``value`` (k,); those at the same place add up."""

    row: np.ndarray
    column: np.ndarray
    value: np.ndarray

    @staticmethod
    def joined(*parts: Entries) -> Entries:
        """All entries of several parts."""
        if not parts:
            return Entries(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0))
        return Entries(*(np.concatenate([np.ravel(part[i]) for part in parts]) for i in range(3)))

    def moved(self, rows: int = 0, columns: int = 0) -> Entries:
        """The same entries further down and to the right."""
        return Entries(self.row + rows, self.column + columns, self.value)


@dataclass(frozen=True)
class Programme:
    """min cost . x subject to equations @ x = right_hand and limits - rows @ x in the cone.

    ``equations`` (m, n) and ``rows`` (k, n) as `Entries`. The cone: the first ``linear`` rows are not negative, then
    ``quadratic`` (c,) rows each make a second-order cone, its first component at least the length of the others.
    """

    cost: np.ndarray
    equations: Entries
    right_hand: np.ndarray
    rows: Entries
    limits: np.ndarray
    linear: int
    quadratic: np.ndarray

    @property
    def cone(self) -> np.ndarray:
        """Number (k,) of the cone of each row; each linear row is one by itself."""
        of_quadratic = np.repeat(np.arange(len(self.quadratic)), self.quadratic)
        return np.concatenate([np.arange(self.linear), self.linear + of_quadratic])


@dataclass(frozen=True)
class Solution:
    """``x`` (n,); ``equation_dual`` (m,), ``cone_dual`` (k,) in the dual cone, ``slack`` (k,) in the cone's interior.

    ``status``: solved, infeasible (the duals are a certificate) or unbounded (``x`` is one); ``said``: the status in
    the solver's own words. For a solved one: cost + equations^T equation_dual + rows^T cone_dual = 0, to the solver's
    tolerance.
    """

    status: str
    said: str
    x: np.ndarray
    equation_dual: np.ndarray
    cone_dual: np.ndarray
    slack: np.ndarray
    iterations: int
    seconds: float


def require() -> None:
    """Raise MissingDependency if a package of the extra ``limit`` is not installed."""
    _clarabel(), _scipy()


def installed() -> bool:
    """Whether the packages of the extra ``limit`` are installed, without importing them."""
    return find_spec("clarabel") is not None and find_spec("scipy") is not None


def solve(programme: Programme, sizes: np.ndarray | None = None) -> Solution:
    """Solve a programme; NotConvergedError with the solver's own status if it fails.

    ``sizes`` (n,): expected sizes of the unknowns, by which they are measured, so that small ones are as accurate as
    large ones. Parts of a programme that have no unknown and no row in common, such as those of blocks between which
    only supports lie, are solved apart if their loads differ much, each measured by its own.
    """
    if sizes is not None:
        scaled, row, cone = _measured(programme, sizes)
        found = solve(scaled)
        return replace(
            found,
            x=sizes * found.x,
            equation_dual=found.equation_dual / row,
            cone_dual=found.cone_dual / cone,
            slack=cone * found.slack,
        )
    parts = _parts(programme)
    if len(parts) == 1:
        return _solved(programme)
    return _joined(programme, parts, [_solved_by_own_loads(part.programme) for part in parts])


def _solved(programme: Programme) -> Solution:
    """`solve` of a whole programme, as it is measured."""
    clarabel, sparse = _clarabel(), _scipy()
    n, m, k = len(programme.cost), len(programme.right_hand), len(programme.limits)
    began = time.perf_counter()
    both = Entries.joined(programme.equations, programme.rows.moved(rows=m))
    matrix = sparse.csc_matrix((both.value, (both.row, both.column)), shape=(m + k, n))
    cones: list[Any] = [clarabel.ZeroConeT(m)] if m else []
    cones += [clarabel.NonnegativeConeT(programme.linear)] if programme.linear else []
    cones += [clarabel.SecondOrderConeT(int(size)) for size in programme.quadratic]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.direct_solve_method = "faer" if n >= LARGE else "qdldl"
    settings.max_threads = 1
    settings.max_iter = MOST_ITERATIONS
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = TOLERANCE
    right = np.concatenate([programme.right_hand, programme.limits])
    found = clarabel.DefaultSolver(sparse.csc_matrix((n, n)), programme.cost, matrix, right, cones, settings).solve()
    said = str(found.status)
    x, dual, slack = (np.array(values) for values in (found.x, found.z, found.s))
    status = _STATUS.get(said)
    if status is None or not (np.isfinite(x).all() and np.isfinite(dual).all()):
        raise NotConvergedError(
            f"limit analysis: the solver Clarabel ended after {found.iterations} iterations with the status {said}, "
            "so there is no answer; the usual cause is joints or blocks of very different sizes"
        )
    seconds = time.perf_counter() - began
    return Solution(status, said, x, dual[:m], dual[m:], slack[m:], int(found.iterations), seconds)


def connected(first: np.ndarray, second: np.ndarray, count: int) -> np.ndarray:
    """Number (count,) of the connected component of each node of a graph with edges from ``first`` to ``second``."""
    graph = _scipy().csr_matrix((np.ones(len(first)), (first, second)), shape=(count, count))
    from scipy.sparse.csgraph import connected_components

    return connected_components(graph, directed=False)[1]


class _Part(NamedTuple):
    """A part of a programme, and its unknowns, equations and rows in the whole: (n,), (m,), (k,) numbers."""

    programme: Programme
    unknowns: np.ndarray
    equations: np.ndarray
    rows: np.ndarray


def _parts(programme: Programme) -> list[_Part]:
    """The parts of a programme without a common unknown or row, those of similar loads together; rows of a cone belong
    together."""
    n, m, linear, cone = len(programme.cost), len(programme.right_hand), programme.linear, programme.cone
    ends = (
        np.concatenate([programme.equations.column, programme.rows.column]),
        n + np.concatenate([programme.equations.row, m + cone[programme.rows.row]]),
    )
    part = connected(*ends, n + m + linear + len(programme.quadratic))
    count = int(part.max(initial=0)) + 1
    if count > 1:  # rows without unknowns, and unknowns without rows, go with the first part
        whole = np.isin(np.arange(count), part[:n]) & np.isin(np.arange(count), part[n:])
        number = np.where(whole, np.cumsum(whole) - 1, 0)
        size, part = np.zeros(max(int(whole.sum()), 1)), number[part]
        np.maximum.at(size, part[n : n + m], np.abs(programme.right_hand))
        np.maximum.at(size, part[n + m :][cone], np.abs(programme.limits))
        alike = np.unique(np.floor(np.log10(np.maximum(size, 1e-300)) / SIMILAR), return_inverse=True)[1]
        count, part = int(alike.max()) + 1, alike[part]
    if count == 1:
        return [_Part(programme, np.arange(n), np.arange(m), np.arange(len(cone)))]
    of_equation, of_cone = part[n : n + m], part[n + m :]
    (unknowns, column), (equations, equation), (rows, row), (balance, _), (strength, _), (quadratic, _) = (
        _grouped(of, count)
        for of in (
            part[:n],
            of_equation,
            of_cone[cone],
            of_equation[programme.equations.row],
            of_cone[cone[programme.rows.row]],
            of_cone[linear:],
        )
    )

    def taken(entries: Entries, own: np.ndarray, number: np.ndarray) -> Entries:
        return Entries(number[entries.row[own]], column[entries.column[own]], entries.value[own])

    return [
        _Part(
            Programme(
                cost=programme.cost[unknowns[i]],
                equations=taken(programme.equations, balance[i], equation),
                right_hand=programme.right_hand[equations[i]],
                rows=taken(programme.rows, strength[i], row),
                limits=programme.limits[rows[i]],
                linear=int(np.searchsorted(rows[i], linear)),
                quadratic=programme.quadratic[quadratic[i]],
            ),
            unknowns[i],
            equations[i],
            rows[i],
        )
        for i in range(count)
    ]


def _grouped(of: np.ndarray, count: int) -> tuple[list[np.ndarray], np.ndarray]:
    """The members of each of ``count`` groups in their order, by the group ``of`` each, and their numbers in it."""
    order = np.argsort(of, kind="stable")
    ends = np.searchsorted(of[order], np.arange(1, count))
    number = np.empty(len(of), np.int64)
    number[order] = np.arange(len(of)) - np.append(0, ends)[of[order]]
    return np.split(order, ends), number


def _solved_by_own_loads(programme: Programme) -> Solution:
    """Solution of a programme whose right-hand sides are measured by the greatest of them."""
    size = max(float(np.abs(side).max(initial=0.0)) for side in (programme.right_hand, programme.limits)) or 1.0
    found = _solved(replace(programme, right_hand=programme.right_hand / size, limits=programme.limits / size))
    return replace(found, x=size * found.x, slack=size * found.slack)


def _joined(programme: Programme, parts: list[_Part], found: list[Solution]) -> Solution:
    """Solution of a programme from those of its parts. If some of them have none, the certificate is theirs: the others
    have zeros in it."""
    status = next((one for one in (INFEASIBLE, UNBOUNDED) if any(part.status == one for part in found)), SOLVED)
    sizes = len(programme.cost), len(programme.right_hand), len(programme.limits), len(programme.limits)
    x, y, z, slack = (np.zeros(size) for size in sizes)
    for part, own in zip(parts, found, strict=True):
        if own.status == status:
            x[part.unknowns], y[part.equations] = own.x, own.equation_dual
            z[part.rows], slack[part.rows] = own.cone_dual, own.slack
    said = next((own.said for own in found if own.status == status and own.said != TO_TOLERANCE), TO_TOLERANCE)
    return Solution(
        status, said, x, y, z, slack, max(own.iterations for own in found), sum(own.seconds for own in found)
    )


def _measured(programme: Programme, sizes: np.ndarray) -> tuple[Programme, np.ndarray, np.ndarray]:
    """A programme in unknowns over their ``sizes`` (n,), equations and cones over their greatest coefficients: (m,)
    and (k,), the same for all rows of a cone."""

    def columns(entries: Entries) -> Entries:
        return entries._replace(value=entries.value * sizes[entries.column])

    def greatest(entries: Entries, group: np.ndarray, count: int) -> np.ndarray:
        most = np.zeros(count)
        np.maximum.at(most, group[entries.row], np.abs(entries.value))
        return np.where(most > 0.0, most, 1.0)[group]

    equations, rows = columns(programme.equations), columns(programme.rows)
    m, cones = len(programme.right_hand), programme.linear + len(programme.quadratic)
    row, of_cone = greatest(equations, np.arange(m), m), greatest(rows, programme.cone, cones)
    scaled = replace(
        programme,
        cost=programme.cost * sizes,
        equations=equations._replace(value=equations.value / row[equations.row]),
        right_hand=programme.right_hand / row,
        rows=rows._replace(value=rows.value / of_cone[rows.row]),
        limits=programme.limits / of_cone,
    )
    return scaled, row, of_cone


class SparseMatrix:
    """Products of a sparse matrix of `Entries`, and solutions with its Gram matrix."""

    def __init__(self, entries: Entries, shape: tuple[int, int]):
        self._matrix = _scipy().csr_matrix((entries.value, (entries.row, entries.column)), shape=shape)

    def times(self, x: np.ndarray) -> np.ndarray:
        return self._matrix @ x

    def transposed_times(self, y: np.ndarray) -> np.ndarray:
        return self._matrix.T @ y

    @property
    def entries(self) -> Entries:
        """Its entries, with duplicates summed."""
        found = self._matrix.tocoo()
        return Entries(found.row, found.col, found.data)

    def sandwiched(self, middle: Entries) -> SparseMatrix:
        """matrix^T @ middle @ matrix for a square ``middle``."""
        m = self._matrix.shape[0]
        product = self._matrix.T @ _scipy().csr_matrix((middle.value, (middle.row, middle.column)), shape=(m, m))
        found = object.__new__(SparseMatrix)
        found._matrix = product @ self._matrix
        return found

    def least_weighted(self, blocks: SparseMatrix, residual: np.ndarray) -> np.ndarray:
        """The x with matrix @ x = residual of the least norm, weighted by the inverse of the symmetric matrix
        ``blocks``: x = B M^T (M B M^T)^-1 residual, with two steps of iterative refinement."""
        weighted = blocks._matrix @ self._matrix.T
        solve = _factorized(self._matrix @ weighted)
        x = np.zeros(self._matrix.shape[1])
        for _ in range(3):
            x += weighted @ solve(residual - self._matrix @ x)
        return x

    def least_squares(self, blocks: SparseMatrix, right: np.ndarray) -> np.ndarray:
        """The y that minimises right - matrix^T @ y in the norm of the symmetric matrix ``blocks``."""
        weighted = self._matrix @ blocks._matrix
        solve = _factorized(weighted @ self._matrix.T)
        y = np.zeros(self._matrix.shape[0])
        for _ in range(3):
            y += solve(weighted @ (right - self._matrix.T @ y))
        return y


def _factorized(gram):
    """The solution with a symmetric positive matrix, as a function of the right-hand side."""
    from scipy.sparse.linalg import splu

    sparse = _scipy()
    scale = 1.0 / np.sqrt(np.maximum(gram.diagonal(), 1e-300))
    gram = sparse.diags(scale) @ gram @ sparse.diags(scale) + REGULAR * sparse.eye(gram.shape[0])
    factors = splu(gram.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    return lambda right: scale * factors.solve(scale * right)


def _clarabel():
    try:
        import clarabel
    except ImportError:
        raise MissingDependency(NEEDED.format(name="clarabel")) from None
    return clarabel


def _scipy():
    try:
        from scipy import sparse
    except ImportError:
        raise MissingDependency(NEEDED.format(name="scipy")) from None
    return sparse
