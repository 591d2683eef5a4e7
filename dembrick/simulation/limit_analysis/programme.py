"""The conic programme of the static theorem: the greatest load that joint forces within their strengths can balance."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from dembrick.simulation.limit_analysis.equilibrium import Frame, JointForces, Layout, frame_of, plane_of_symmetry
from dembrick.simulation.limit_analysis.solver import Entries, Programme
from dembrick.simulation.limit_analysis.strength import Areas, Points

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly


class Cuts(NamedTuple):
    """Planes that bound the strengths of area joints: for friction the joints ``area`` (k,) and a ``twist`` (k, 3) with
    D_1 = 1; for crushing the joints ``crushed`` (c,) and ``closing`` (c, 3) with a mean |l| of 1."""

    area: np.ndarray = np.zeros(0, np.int64)
    twist: np.ndarray = np.zeros((0, 3))
    crushed: np.ndarray = np.zeros(0, np.int64)
    closing: np.ndarray = np.zeros((0, 3))

    def more(self, area: np.ndarray, twist: np.ndarray, crushed: np.ndarray, closing: np.ndarray) -> Cuts:
        """These cuts and others."""
        return Cuts(*(np.concatenate(both) for both in zip(self, (area, twist, crushed, closing), strict=True)))


NO_CUTS = Cuts()


@dataclass(frozen=True)
class Structure:
    """Input of limit analysis from an assembly: strengths, equations, unknowns. ``dead`` (rows,) in ``frame.unit``."""

    assembly: Assembly
    points: Points
    areas: Areas
    frame: Frame
    layout: Layout
    equilibrium: Entries
    dead: np.ndarray

    @property
    def weights(self) -> np.ndarray:
        """Sum of the dead loads of each free block (f,) in ``frame.unit``, with those that guides carry."""
        own = np.abs(self.assembly.dead_force[self.frame.free]).sum(axis=1) / self.frame.unit
        return np.maximum(np.abs(self.dead).reshape(len(own), -1).sum(axis=1), own)

    @property
    def weight(self) -> float:
        """The sum of these."""
        return float(self.weights.sum())

    def carried(self, x: np.ndarray) -> tuple[JointForces, np.ndarray]:
        """The joint forces of a vector of unknowns, and their resultants (j, 6) of all joints (N, N m)."""
        forces = self.layout.forces(x)
        return forces, forces.resultants(self.points, self.areas, len(self.assembly.joints))

    def strengthened(self, points: Points, areas: Areas) -> Structure:
        """The same structure with other strengths of its joints."""
        layout = Layout(self.assembly, self.frame, points, areas)
        return replace(self, points=points, areas=areas, layout=layout, equilibrium=layout.equilibrium())


def structure_of(
    assembly: Assembly, points: Points, areas: Areas, dead: np.ndarray, live: list[np.ndarray], along=()
) -> Structure:
    """The structure of an assembly under ``dead`` and ``live`` wrenches (n, 6), in a plane of symmetry if there is one
    that also contains the directions ``along`` (3,)."""
    loads = [dead, *live]
    frame = frame_of(assembly, loads, plane_of_symmetry(assembly, points, areas, loads, along))
    layout = Layout(assembly, frame, points, areas)
    return Structure(assembly, points, areas, frame, layout, layout.equilibrium(), frame.vector(dead))


class Loads(NamedTuple):
    """Loads in the rows of equilibrium: ``dead`` (rows,), and ``live`` (rows,) times the unknown multiplier or None; in
    ``frame.unit``."""

    dead: np.ndarray
    live: np.ndarray | None


def programme_of(structure: Structure, loads: Loads, cost: np.ndarray, cuts: Cuts, reduced: float = 1.0) -> Programme:
    """min cost . x: the joint forces of the layout and, last, the multiplier of ``loads.live`` if there is one.

    ``reduced`` multiplies the shear strength and the compressive strength of area joints.
    """
    layout = structure.layout
    entries = structure.equilibrium
    if loads.live is not None:
        at = np.flatnonzero(loads.live)
        entries = Entries.joined(entries, Entries(at, np.full(len(at), layout.n), loads.live[at]))
    linear, limits, sizes = _linear_rows(layout, cuts, reduced)
    cones, cone_limits, quadratic = _cone_rows(layout, reduced)
    return Programme(
        cost=cost,
        equations=entries,
        right_hand=-loads.dead + layout.bond(),
        rows=Entries.joined(linear, cones.moved(rows=sizes)),
        limits=np.concatenate([limits, cone_limits]),
        linear=sizes,
        quadratic=quadratic,
    )


class _Stack:
    """Linear rows limit - row . x >= 0, gathered one after another."""

    def __init__(self) -> None:
        self._parts: list[Entries] = []
        self._limits: list[np.ndarray] = []
        self.count = 0

    def add(self, limit: np.ndarray, *entries: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
        """Rows with ``limit`` (k,) and entries (row among them, column, value)."""
        for row, column, value in entries:
            row = np.asarray(row)
            self._parts.append(Entries(row + self.count, np.asarray(column), np.broadcast_to(value, row.shape)))
        self._limits.append(np.asarray(limit, float))
        self.count += len(limit)

    @property
    def entries(self) -> Entries:
        return Entries.joined(*self._parts)

    @property
    def limits(self) -> np.ndarray:
        return np.concatenate([*self._limits, np.zeros(0)])


def _linear_rows(layout: Layout, cuts: Cuts, reduced: float) -> tuple[Entries, np.ndarray, int]:
    stack, unit = _Stack(), layout.frame.unit
    groups, points, areas = layout.point_groups, layout.points, layout.areas
    adhesion, tension, crushing = (
        groups.total(values) / unit for values in (points.adhesion, points.tension, points.crushing)
    )
    normal = layout.width * np.arange(layout.n_point)
    pulls = np.flatnonzero(layout.adhesive & (layout.friction * tension < adhesion * (1.0 - 1e-12)))
    stack.add(tension[pulls], (np.arange(len(pulls)), normal[pulls], np.array(-1.0)))
    crushes = np.flatnonzero(np.isfinite(crushing))
    stack.add(crushing[crushes], (np.arange(len(crushes)), normal[crushes], np.array(1.0)))
    slope, level = _cap_of_points(layout)
    if layout.flat:
        at = np.arange(layout.n_point)
        for sign in (1.0, -1.0):
            stack.add(level, (at, normal, -slope), (at, normal + 1, np.array(sign)))
    corner = layout.corner_start + np.arange(layout.n_corner)
    stack.add(np.zeros(layout.n_corner), (np.arange(layout.n_corner), corner, np.array(-1.0)))
    _add_ties(stack, layout)
    if not len(areas):
        return stack.entries, stack.limits, stack.count
    slope, level = _cap_of_areas(layout, reduced)
    corners_of = np.argsort(layout.corner_owner, kind="stable")
    first = np.searchsorted(layout.corner_owner[corners_of], np.arange(len(areas) + 1))

    def bounded(area: np.ndarray, factor, shear: np.ndarray) -> None:
        """Add factor * cap - shear . (V_1, V_2, M) >= 0 for areas (k,), ``shear`` (k, s)."""
        counts = np.diff(first)[area]
        row = np.repeat(np.arange(len(area)), counts)
        offset = np.arange(len(row)) - np.repeat(np.cumsum(counts) - counts, counts)
        column = layout.corner_start + corners_of[np.repeat(first[area], counts) + offset]
        factor = np.broadcast_to(factor, len(area))
        sheared = layout.shear_start + layout.n_shear * area[:, None] + np.arange(shear.shape[1])
        rows = np.broadcast_to(np.arange(len(area))[:, None], sheared.shape)
        stack.add(
            factor * level[area],
            (row, column, -(factor * slope[area])[row]),
            (rows.ravel(), sheared.ravel(), shear.ravel()),
        )

    every = np.arange(len(areas))
    for sign in (1.0, -1.0):
        if layout.flat:
            bounded(every, 1.0, np.full((len(areas), 1), sign))
        else:
            bounded(every, areas.radius / areas.gyration, np.tile([0.0, 0.0, sign], (len(areas), 1)))
    if len(cuts.area) and not layout.flat:
        bounded(cuts.area, 1.0, cuts.twist)
    _add_crushing(stack, layout, cuts, reduced)
    return stack.entries, stack.limits, stack.count


def _add_crushing(stack: _Stack, layout: Layout, cuts: Cuts, reduced: float) -> None:
    """Add f_c A <l> - sum of corner forces times l >= 0, l = closing . (1, r / gyration), for planes of ``cuts``."""
    areas, area = layout.areas, cuts.crushed
    if not len(area):
        return
    strongest = (areas.crushing + areas.tension)[area] / layout.frame.unit
    counts = np.diff(areas.start)[area]
    row = np.repeat(np.arange(len(area)), counts)
    corner = np.repeat(areas.start[area] - np.cumsum(counts) + counts, counts) + np.arange(len(row))
    arm = areas.corner[corner] / areas.gyration[area[row], None]
    value = cuts.closing[row, 0] + (cuts.closing[row, 1:] * arm).sum(axis=1)
    groups = layout.corner_groups
    column = layout.corner_start + groups.group[corner]
    # for a mean |l| of 1 and a mean l of closing[0] the mean positive part is half their sum
    stack.add(reduced * strongest * 0.5 * (1.0 + cuts.closing[:, 0]), (row, column, groups.share[corner] * value))


def _add_ties(stack: _Stack, layout: Layout) -> None:
    """Add the limits of ties: they yield at their strength, and tension-only ties carry no compression."""
    ties, column = layout.ties, layout.tie_start + np.arange(len(layout.ties))
    yields = np.isfinite(ties.strength)
    least = np.where(ties.tension_only, 0.0, np.where(yields, ties.strength, np.inf)) / layout.frame.unit
    for sign, limit in ((1.0, ties.strength / layout.frame.unit), (-1.0, least)):
        own = np.flatnonzero(np.isfinite(limit))
        stack.add(limit[own], (np.arange(len(own)), column[own], np.array(sign)))


def _cone_rows(layout: Layout, reduced: float) -> tuple[Entries, np.ndarray, np.ndarray]:
    """Second-order cones (cap, t_1, t_2) of the points and (cap, V_1, V_2, M_T / gyration) of the area joints, the
    ellipsoid around the limit surface; none in a plane."""
    if layout.flat:
        return Entries.joined(), np.zeros(0), np.zeros(0, np.int64)
    p, a = layout.n_point, len(layout.areas)
    slope, level = _cap_of_points(layout)
    row = 3 * np.arange(p)
    parts = [Entries(row, row, -slope)]
    parts += [Entries(row + i, row + i, np.full(p, -1.0)) for i in (1, 2)]
    limits = np.zeros(3 * p)
    limits[row] = level
    slope, level = _cap_of_areas(layout, reduced)
    row = 3 * p + 4 * np.arange(a)
    corner = layout.corner_start + np.arange(layout.n_corner)
    parts.append(Entries(row[layout.corner_owner], corner, -slope[layout.corner_owner]))
    parts += [Entries(row + 1 + i, layout.shear_start + 3 * np.arange(a) + i, np.full(a, -1.0)) for i in range(3)]
    area_limits = np.zeros(4 * a)
    area_limits[4 * np.arange(a)] = level
    sizes = np.concatenate([np.full(p, 3), np.full(a, 4)])
    return Entries.joined(*parts), np.concatenate([limits, area_limits]), sizes


def _cap_of_points(layout: Layout) -> tuple[np.ndarray, np.ndarray]:
    """Slope and level (p,) of the tangential strength of points, slope * N + level, in its unit."""
    points, total, unit = layout.points, layout.point_groups.total, layout.frame.unit
    slope = np.where(layout.adhesive, layout.friction, 1.0)
    return slope, np.where(layout.adhesive, total(points.adhesion), total(points.tension)) / unit


def _cap_of_areas(layout: Layout, reduced: float) -> tuple[np.ndarray, np.ndarray]:
    """Slope and level (a,) of V_0 of area joints, slope * sum of the corner forces + level, in its unit."""
    areas, unit = layout.areas, layout.frame.unit
    slope = np.where(layout.adhesive_area, areas.friction, 1.0)
    level = np.where(layout.adhesive_area, areas.adhesion - areas.friction * areas.tension, 0.0)
    return reduced * slope, reduced * level / unit


def area_shears(layout: Layout, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """V_0 (a,) and (V_1, V_2, M_T / gyration) (a, 3) of the area joints of a solution, in the unit of their shear."""
    slope, level = _cap_of_areas(layout, 1.0)
    corner = x[layout.corner_start : layout.shear_start]
    cap = level + slope * np.bincount(layout.corner_owner, corner, minlength=len(layout.areas))
    return cap, x[layout.shear_start : layout.tie_start].reshape(-1, layout.n_shear)


def area_normals(layout: Layout, x: np.ndarray) -> np.ndarray:
    """N, measured from -f_t A, and the integral of p r / gyration (a, 3) of the area joints of a solution."""
    areas, groups = layout.areas, layout.corner_groups
    force = groups.share * x[layout.corner_start : layout.shear_start][groups.group]
    arm = areas.corner / areas.gyration[areas.owner, None]
    values = (force, force * arm[:, 0], force * arm[:, 1])
    return np.stack([np.bincount(areas.owner, value, minlength=len(areas)) for value in values], axis=1)
