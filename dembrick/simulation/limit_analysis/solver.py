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
    large ones.
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
    linear, m = programme.linear, len(programme.right_hand)
    cone = np.concatenate(
        [np.arange(linear), linear + np.repeat(np.arange(len(programme.quadratic)), programme.quadratic)]
    )
    row, of_cone = greatest(equations, np.arange(m), m), greatest(rows, cone, linear + len(programme.quadratic))
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
