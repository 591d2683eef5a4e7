"""Bounds from a solution of interior points: joint forces corrected to balance exactly, and the value of a mechanism.

An interior-point method leaves a residual, so neither of its two values is a bound. The forces get the least correction
that restores equilibrium, weighted by the distance of each joint from its limit; a state that is then still outside a
strength is mixed with one that balances the dead loads well inside. What is left, rounding next to the largest joint
force but perhaps not next to a light block, is charged at the price of the mechanism (`price_of_excess`). The bound of
the mechanism is corrected for its incompatibility: its residual velocity times forces ``CAP`` times the largest joint
force found.
"""

from __future__ import annotations

import numpy as np

from dembrick.simulation.limit_analysis.friction_surface import FrictionSurfaces, PressedPolygons
from dembrick.simulation.limit_analysis.programme import Structure, area_normals, area_shears
from dembrick.simulation.limit_analysis.solver import Entries, Programme, Solution, SparseMatrix
from dembrick.simulation.limit_analysis.support_function import gauges

CAP = 10.0  # of the largest joint force found: greatest forces that the upper bound covers
ROUNDING = 1e-11  # of the largest joint force: excess over a strength that is charged, not mixed away
SMALLEST = 1e-9  # of the largest unknown: least size by which one is measured
PRICED = 2.0  # factor on the charge for such an excess, as the duals are approximate
ROUNDS = 5  # in which the mechanism is made compatible
PAID = 1e-9  # of the bound: correction below which no further round is needed
_LEAST = 1e-14  # of the largest slack: least distance from a limit in the correction


def sizes(structure: Structure, x: np.ndarray) -> np.ndarray:
    """Sizes of the unknowns near a solution ``x``: of joint forces the scale of their joint, of others their own."""
    layout, scale = structure.layout, force_scales(structure, x)
    joint = np.concatenate([
        np.repeat(layout.joint, layout.width),
        layout.areas.joint[layout.corner_owner],
        np.repeat(layout.areas.joint, layout.n_shear),
    ])  # fmt: skip
    own = np.append(scale[joint], np.abs(x[len(joint) :]))
    most = own.max(initial=0.0) or 1.0
    return np.maximum(own, SMALLEST * most)


def least_cost(
    structure: Structure, programme: Programme, solution: Solution
) -> tuple[float, tuple[np.ndarray, np.ndarray]]:
    """Lower bound of cost . x, from the duals of a solution, for any x in the programme whose entries are at most `CAP`
    times the largest found; and the duals, of equilibrium and of the strengths, that prove it.

    The duals are first made compatible, by least squares weighted by the distance of those of the strengths from the
    edge of their cone: velocities y, then the duals z of the strengths, in a few rounds. The remaining residual is
    charged to the bound; usually it is rounding, and the cap plays no part.
    """
    free = structure.layout.n
    equations, rows = _matrices(programme)
    balance, own = _matrices(programme, free)
    y, z = solution.equation_dual, solution.cone_dual
    starts = programme.linear + np.cumsum(programme.quadratic) - programme.quadratic
    first = np.concatenate([np.arange(programme.linear), starts])
    cap = CAP * float(np.abs(solution.x).max(initial=0.0))
    best, proof = -np.inf, (y, z)

    def residual() -> np.ndarray:
        return programme.cost + equations.transposed_times(y) + rows.transposed_times(z)

    for _ in range(ROUNDS):
        spread = SparseMatrix(_inverse_barrier(programme, z), (len(z), len(z)))
        inverse = SparseMatrix(
            _inverse_blocks(own.sandwiched(spread.entries).entries, *_blocks(structure)), (free, free)
        )
        y = y - balance.least_squares(inverse, residual()[:free])
        worked = -equations.transposed_times(y)[free:]  # work of the load, if it has a multiplier
        if len(worked) and worked[0] * programme.cost[free] > 0.0:
            y, z = (dual * programme.cost[free] / worked[0] for dual in (y, z))
        for _ in range(3):
            z = z - spread.times(own.times(inverse.times(residual()[:free])))
        outside = np.maximum(cone_excess(programme, z), 0.0)
        z[first] += (1.0 + 1e-3) * outside + np.where(outside > 0.0, _LEAST, 0.0)
        paid = cap * float(np.abs(residual()).sum())
        value = float(-(programme.right_hand @ y) - programme.limits @ z)
        rounded = np.finfo(float).eps * float(np.abs(programme.right_hand) @ np.abs(y) + np.abs(programme.limits) @ z)
        if value - paid - rounded > best:
            best, proof = value - paid - rounded, (y, z.copy())
        if paid <= PAID * abs(value):
            break
    return best, proof


def price_of_excess(programme: Programme, x: np.ndarray, duals: tuple[np.ndarray, np.ndarray]) -> float:
    """Most by which cost . x of nearly feasible unknowns may lie below the least cost of feasible ones.

    The least cost is convex in the strengths and the loads, with the ``duals`` as its slope: what lies outside
    a strength, and what is out of balance, each costs at most its dual.
    """
    y, z = duals
    equations, rows = _matrices(programme)
    outside = np.maximum(cone_excess(programme, programme.limits - rows.times(x)), 0.0)
    starts = programme.linear + np.cumsum(programme.quadratic) - programme.quadratic
    price = np.maximum(z[np.concatenate([np.arange(programme.linear), starts])], 0.0)
    missing = np.abs(programme.right_hand - equations.times(x))
    rounded = np.finfo(float).eps * (
        np.abs(programme.right_hand) @ np.abs(y) + float(np.abs(programme.cost) @ np.abs(x))
    )
    return float(PRICED * (outside @ price + missing @ np.abs(y)) + rounded)


def force_scales(structure: Structure, x: np.ndarray) -> np.ndarray:
    """Scale of the forces (j,) of every joint in the unit of forces: the sum of all joint forces on the lighter loaded
    of its blocks."""
    joints, fixed = structure.assembly.joints, np.asarray(structure.assembly.fixed)
    size = np.linalg.norm(structure.carried(x)[1][:, :3], axis=1) / structure.frame.unit
    ends = joints.block_a, joints.block_b
    total = sum(np.bincount(block, size, minlength=len(fixed)) for block in ends)
    return np.minimum(*(np.where(fixed[block], np.inf, total[block]) for block in ends))


def balanced(structure: Structure, programme: Programme, solution: Solution) -> np.ndarray:
    """The joint forces and the multiplier of a solution, corrected so that the blocks balance to rounding."""
    x, free = solution.x.copy(), structure.layout.n
    residual = programme.right_hand - _matrices(programme)[0].times(x)
    if np.abs(residual).max(initial=0.0) > 0.0:
        balance, own = _matrices(programme, free)
        barrier = own.sandwiched(_barrier(programme, solution.slack)).entries
        spread = SparseMatrix(_inverse_blocks(barrier, *_blocks(structure)), (free, free))
        x[:free] += balance.least_weighted(spread, residual)
    return x


def _matrices(programme: Programme, columns: int | None = None) -> tuple[SparseMatrix, SparseMatrix]:
    """The equations and the rows of a programme as matrices, their first ``columns`` if given."""
    n = len(programme.cost) if columns is None else columns
    both = []
    for entries, count in ((programme.equations, len(programme.right_hand)), (programme.rows, len(programme.limits))):
        kept = slice(None) if columns is None else entries.column < n
        both.append(SparseMatrix(Entries(*(part[kept] for part in entries)), (count, n)))
    return both[0], both[1]


def excess(structure: Structure, programme: Programme, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Excess of joint forces over their strengths, row by row and cone by cone, in the unit of forces (negative: the
    reserve); then the same of the area joints, by their exact surfaces of friction and of crushing."""
    slack = programme.limits - _matrices(programme)[1].times(x)
    return cone_excess(programme, slack), surface_excess(structure, x)[0], crushing_excess(structure, x)[0]


def ray_excess(programme: Programme, x: np.ndarray) -> float:
    """Violation of equilibrium and strengths by forces that grow along ``x`` (n,), over the greatest of them."""
    equations, rows = _matrices(programme)
    missing = np.abs(equations.times(x)).max(initial=0.0)
    outside = cone_excess(programme, -rows.times(x)).max(initial=0.0)
    return float(max(missing, outside) / max(np.abs(x).max(initial=0.0), 1e-300))


def cone_excess(programme: Programme, slack: np.ndarray) -> np.ndarray:
    """Distance by which a vector (k,) lies outside the programme's cone, linear row by row, then cone by cone."""
    over, at = [-slack[: programme.linear]], programme.linear
    for size, count in _runs(programme.quadratic):
        own = slack[at : at + size * count].reshape(count, size)
        over.append(np.sqrt((own[:, 1:] ** 2).sum(axis=1)) - own[:, 0])
        at += size * count
    return np.concatenate(over)


def surface_excess(structure: Structure, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(gauge - 1) V_0 (a,) of the area joints by their exact limit surface, and the twists (a, 3) that attain it."""
    areas, layout = structure.areas, structure.layout
    if not len(areas) or layout.flat:
        return np.zeros(0), np.zeros((0, 3))
    cap, shear = area_shears(layout, x)
    size, twist = gauges(FrictionSurfaces, areas, np.arange(len(areas)), shear)
    return size - cap, twist


def crushing_excess(structure: Structure, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(gauge - 1) f_c A / 2 (c,) of the area joints that crush, and the planes (c, 3) that attain it."""
    areas, layout = structure.areas, structure.layout
    chosen = areas.crushes
    if not len(chosen):
        return np.zeros(0), np.zeros((0, 3))
    strongest = (areas.crushing + areas.tension)[chosen] / layout.frame.unit
    force = area_normals(layout, x)[chosen] / strongest[:, None]
    about_centre = 2.0 * force - np.array([1.0, 0.0, 0.0])
    gauge, plane = gauges(PressedPolygons, areas, chosen, about_centre)
    return 0.5 * (gauge - 1.0) * strongest, plane


def allowed(structure: Structure, x: np.ndarray, over: tuple[np.ndarray, np.ndarray, np.ndarray]) -> np.ndarray:
    """The excesses (k,) over strengths, like those of `excess`, that are rounding: next to the largest force if duals
    charge them, and next to the scale of the joint if it is beyond an exact surface, which none charges."""
    areas, scale = structure.areas, force_scales(structure, x)
    parts = [np.full(len(over[0]), max(1.0, float(np.abs(x).max(initial=0.0))))]
    parts += [scale[areas.joint]] if len(over[1]) else []
    parts += [scale[areas.joint[areas.crushes]]] if len(over[2]) else []
    return ROUNDING * np.concatenate(parts)


def share_of_inner(over: np.ndarray, inner: np.ndarray, allowed: np.ndarray) -> float:
    """The least share of an inner state in a mixture that is feasible: ``over`` and ``inner`` (k,) are the excesses of
    the two states, ``allowed`` (k,) those that pass; 1 if no mixture is."""
    outside = over > allowed
    if not outside.any():
        return 0.0
    room = -inner[outside]
    if (room <= 0.0).any():
        return 1.0
    return float((over[outside] / (over[outside] + room)).max())


def _runs(sizes: np.ndarray) -> list[tuple[int, int]]:
    """Runs of consecutive cones of equal size: size and count of each."""
    if not len(sizes):
        return []
    ends = np.flatnonzero(np.diff(sizes)) + 1
    return [(int(run[0]), len(run)) for run in np.split(sizes, ends)]


def _barrier(programme: Programme, slack: np.ndarray) -> Entries:
    """Second derivatives of the logarithmic barrier of the cone at a slack: 1 / s^2, and of a second-order cone, with
    J = diag(1, -1, -1 ...) and d = s . J s, 4 J s s^T J / d^2 - 2 J / d."""

    def of_cones(own: np.ndarray, length: np.ndarray, J: np.ndarray) -> np.ndarray:
        mirrored = own * J
        margin = np.maximum(own[:, 0] - length, _LEAST * np.maximum(own[:, 0], 1e-300))
        det = (margin * (own[:, 0] + length))[:, None, None]
        return 4.0 * mirrored[:, :, None] * mirrored[:, None, :] / det**2 - 2.0 * np.diag(J) / det

    linear = np.maximum(slack[: programme.linear], _LEAST * np.abs(slack).max(initial=1.0))
    return _by_cones(programme, slack, linear**-2.0, of_cones)


def _inverse_barrier(programme: Programme, slack: np.ndarray) -> Entries:
    """The inverse of `_barrier`: s^2, and of a second-order cone s s^T - d J / 2."""

    def of_cones(own: np.ndarray, length: np.ndarray, J: np.ndarray) -> np.ndarray:
        det = np.maximum(own[:, 0] - length, 0.0) * (own[:, 0] + length)
        return own[:, :, None] * own[:, None, :] - 0.5 * np.diag(J) * det[:, None, None]

    return _by_cones(programme, slack, slack[: programme.linear] ** 2, of_cones)


def _by_cones(programme: Programme, slack: np.ndarray, linear: np.ndarray, of_cones) -> Entries:
    """A matrix with ``linear`` on the diagonal, then a block for each second-order cone: ``of_cones`` makes them from
    the slacks (c, s) of c cones, the lengths (c,) of all but their first components, and the diagonal (s,) of J."""
    number = np.arange(programme.linear)
    parts, at = [Entries(number, number, linear)], programme.linear
    for size, count in _runs(programme.quadratic):
        own = slack[at : at + size * count].reshape(count, size)
        J = np.append(1.0, np.full(size - 1, -1.0))
        values = of_cones(own, np.sqrt((own[:, 1:] ** 2).sum(axis=1)), J)
        parts.append(_square_entries(at + size * np.arange(count), values))
        at += size * count
    return Entries.joined(*parts)


def _square_entries(first: np.ndarray, values: np.ndarray) -> Entries:
    """Entries of square blocks (c, s, s) on the diagonal from the rows ``first`` (c,)."""
    place = np.arange(values.shape[1])
    row = first[:, None, None] + place[:, None] + 0 * place
    column = first[:, None, None] + place + 0 * place[:, None]
    return Entries(row.ravel(), column.ravel(), values.ravel())


def _blocks(structure: Structure) -> tuple[np.ndarray, np.ndarray]:
    """Groups of unknowns that share a strength: number of the group of each (n,), and its place within (n,)."""
    layout = structure.layout
    points = np.repeat(np.arange(layout.n_point), layout.width)
    place = [np.tile(np.arange(layout.width), layout.n_point)]
    owner = layout.corner_owner
    order = np.argsort(owner, kind="stable")
    counts = np.bincount(owner, minlength=len(layout.areas))
    within = np.empty(len(owner), np.int64)
    within[order] = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    shear = np.repeat(np.arange(len(layout.areas)), layout.n_shear)
    place += [within, counts[shear] + np.tile(np.arange(layout.n_shear), len(layout.areas))]
    ties = layout.n_point + len(layout.areas) + np.arange(len(layout.ties))
    place.append(np.zeros(len(ties), np.int64))
    return np.concatenate([points, layout.n_point + owner, layout.n_point + shear, ties]), np.concatenate(place)


def _inverse_blocks(entries: Entries, block: np.ndarray, place: np.ndarray) -> Entries:
    """The inverse of a symmetric block-diagonal matrix."""
    sizes = np.bincount(block)
    own = np.argsort(block, kind="stable")
    start = np.concatenate([[0], np.cumsum(sizes)])
    parts = []
    of_entry = block[entries.row]
    for size in np.unique(sizes[sizes > 0]):
        chosen = np.flatnonzero(sizes == size)
        number = np.full(len(sizes), -1)
        number[chosen] = np.arange(len(chosen))
        some = np.flatnonzero(number[of_entry] >= 0)
        dense = np.zeros((len(chosen), size, size))
        dense[number[of_entry[some]], place[entries.row[some]], place[entries.column[some]]] = entries.value[some]
        diagonal = np.einsum("kii->ki", dense)
        scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
        dense *= scale[:, :, None] * scale[:, None, :]
        dense[:, np.arange(size), np.arange(size)] += 1e-14
        inverse = np.linalg.inv(dense) * scale[:, :, None] * scale[:, None, :]
        variable = np.empty((len(chosen), size), np.int64)
        members = own[start[chosen][:, None] + np.arange(size)]
        np.put_along_axis(variable, place[members], members, axis=1)
        row = np.repeat(variable, size, axis=1)
        column = np.tile(variable, (1, size))
        parts.append(Entries(row.ravel(), column.ravel(), inverse.ravel()))
    return Entries.joined(*parts)
