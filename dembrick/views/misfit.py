"""The misfit of a simulated curve against a measured one: force over displacement.

Curves are compared over the displacements that both cover, with linear interpolation between their points; cyclic
curves branch by branch, between their turning points. If only the simulated curve is cyclic, its branch up to the first
turning point is compared with the measured curve, which is then an envelope of loops or a monotonic test.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple, Protocol

import numpy as np

from dembrick.errors import ScenarioError
from dembrick.scenario.protocols import turning_points

THIRD = 1.0 / 3.0  # of the peak: where the secant of the initial stiffness is taken, as in EN 1052-1 for the modulus
# Share of the range by which a measured displacement may decrease (scatter of the gauge, not a cycle), and by which a
# measured turning point may lie beyond the simulated one.
REVERSAL_TOLERANCE = 0.05
NEARLY = 0.99  # of the greatest measured displacement: a run that turns before that turns early

NUMBERS = ("rms", "peak", "stiffness", "energy")


class Curve(Protocol):
    """Displacement (k,) m and load (k,) N."""

    @property
    def displacement(self) -> np.ndarray: ...
    @property
    def load(self) -> np.ndarray: ...


class Misfit(NamedTuple):
    """Relative differences, simulated against measured; None if the measured curve does not give the number.

    ``rms``: root mean square of the difference at the measured points, over the measured peak. ``peak``, ``stiffness``
    (the secant from the origin to a third of each curve's own peak), ``energy`` (area below the curve, or of the
    loops): simulated over measured, less 1, from the points of both. ``compared``: range of the comparison, m.
    """

    rms: float
    peak: float
    stiffness: float | None
    energy: float | None
    compared: tuple[float, float]

    def numbers(self) -> dict[str, float | None]:
        """The four numbers by name, as in ``--json``."""
        return dict(zip(NUMBERS, self, strict=False))


def text(misfit: Misfit) -> str:
    """The misfit in words, in per cent."""
    parts = [f"rms {100.0 * misfit.rms:.2f} % of the peak"]
    for name, value in list(misfit.numbers().items())[1:]:
        parts.append(f"{name} not determined" if value is None else f"{name} {100.0 * value:+.2f} %")
    return ", ".join(parts)


def extent(misfit: Misfit, simulated: Curve, measured: Curve) -> str:
    """Remark in brackets on how far a measured curve was compared; empty if all of it was."""
    last, most = misfit.compared[1], float(simulated.displacement.max())
    if last >= measured.displacement.max():
        if goes_on(simulated, measured):
            return " (up to the first turning point)"
        ends = [1e3 * float(np.abs(curve.displacement).max()) for curve in (simulated, measured)]
        early = turns_early(simulated, measured)
        return f" (the run turns at {ends[0]:.4g} mm, the curve at {ends[1]:.4g} mm)" if early else ""
    end = f"the run {'turns' if turns(simulated.displacement) else 'ends'} at {1e3 * most:.4g}"
    return f" (compared up to {1e3 * last:.4g} mm: {end}{', its last force is kept beyond' if last > most else ''})"


def turns_early(simulated: Curve, measured: Curve) -> bool:
    """Whether both curves turn, the simulated one at smaller displacements."""
    ours, theirs = (np.asarray(curve.displacement, float) for curve in (simulated, measured))
    return min(turns(ours), turns(theirs)) > 0 and np.abs(ours).max() < NEARLY * np.abs(theirs).max()


def between(simulated: Curve, measured: Curve, name: str = "the measured curve") -> Misfit:
    """The misfit; ScenarioError with the reason if the two curves cannot be compared."""
    require_comparable(simulated, measured, name)
    turning = len(_branches(simulated)) == len(_branches(measured)) > 1
    if goes_on(simulated, measured):
        simulated = _Branch(*_branches(simulated)[0])
    return _of_loops(simulated, measured, name) if turning else _one_way_each(simulated, measured, name)


def require_comparable(simulated: Curve, measured: Curve, name: str) -> None:
    """ScenarioError, with the remedy, if the displacements of a measured curve do not match the simulated ones."""
    ours, theirs = np.asarray(simulated.displacement, float), np.asarray(measured.displacement, float)
    size = np.abs(theirs).max(initial=0.0)
    if not size > 0.0 or not np.ptp(ours) > 0.0 or not np.ptp(theirs) > 0.0:
        return  # reported elsewhere
    if theirs.max() <= REVERSAL_TOLERANCE * size and ours.min() >= -REVERSAL_TOLERANCE * np.abs(ours).max():
        raise ScenarioError(
            f"the displacements of {name} are negative ({_range(theirs)}), and those of the run are not; change the "
            "signs of its columns, or reverse the actuator"
        )
    if turns(ours) < turns(theirs) and (np.maximum.accumulate(theirs) - theirs).max() > REVERSAL_TOLERANCE * np.ptp(
        theirs
    ):
        raise ScenarioError(
            f"{name} goes to and fro, but the run turns less often; if it was measured one way, sort its lines by "
            "displacement, else give the envelope of its loops, or their turning points as control.protocol"
        )
    first = [_branches(curve)[0][0] for curve in (simulated, measured)]
    if turns(ours) and turns(theirs) and (first[0][-1] - first[0][0]) * (first[1][-1] - first[1][0]) < 0.0:
        raise ScenarioError(
            f"{name} first moves opposite to the run, so their half cycles do not match; change the signs of its "
            "columns, or those of control.protocol"
        )
    slack = (REVERSAL_TOLERANCE if turns(ours) else 1e-9) * np.ptp(ours)
    inside = int(((theirs >= ours.min() - slack) & (theirs <= ours.max() + slack)).sum())
    if inside < 2:
        raise ScenarioError(
            f"{inside or 'none'} of the {len(theirs)} points of {name} ({_range(theirs)}) "
            f"{'lies' if inside == 1 else 'lie'} in the range of the run ({_range(ours)}), and 2 are needed; check "
            "the unit of its displacement, and that it begins at 0"
        )


def turns(displacement: np.ndarray) -> int:
    """Number of turning points of a curve, its ends excluded."""
    return len(turning_points(displacement)) - 2 if np.ptp(displacement) > 0.0 else 0


def _range(displacement: np.ndarray) -> str:
    """The range of displacements in words, in mm; an end that is only rounding error is printed as 0."""
    low, high = (1e3 * float(end) for end in (displacement.min(), displacement.max()))
    least = 1e-9 * max(abs(low), abs(high))
    return " to ".join(f"{end if abs(end) > least else 0.0:.4g}" for end in (low, high)) + " mm"


def compared(simulated: Curve, measured: Curve, beyond: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Displacements (m) of the measured points that the simulated curve reaches, the simulated forces (N) there, and
    the measured ones. Slightly beyond a turning point the last simulated force is used; with ``beyond`` it is used at
    all points of the branches that both curves have."""
    found = [(u, np.interp(u, x, y), V) for x, y, u, V in _ways_of_both(simulated, measured, beyond)]
    displacement, ours, theirs = (np.concatenate(column) for column in zip(*found, strict=True))
    return displacement, ours, theirs


def _ways_of_both(
    simulated: Curve, measured: Curve, beyond: bool = False
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
    """For each branch that both curves have: displacement and load of the simulated curve in ascending order, and of
    the measured points that it reaches (see `compared`) in their own order."""
    ways = _branches(simulated)
    for (way_u, way_V), (our_u, our_V) in zip(_branches(measured), ways, strict=False):
        order = np.argsort(our_u, kind="stable")
        x, y = our_u[order], our_V[order]
        # an actuator is compliant, so the blocks turn back slightly before its end does
        slack = (REVERSAL_TOLERANCE if len(ways) > 1 else 1e-9) * float(np.ptp(x))
        inside = beyond | ((way_u >= x[0] - slack) & (way_u <= x[-1] + slack))
        yield x, y, way_u[inside], way_V[inside]


class _Branch(NamedTuple):
    """A branch of a curve: its displacement does not turn."""

    displacement: np.ndarray
    load: np.ndarray


def goes_on(simulated: Curve, measured: Curve) -> bool:
    """Whether the simulated curve turns and the measured one does not."""
    return len(_branches(simulated)) > 1 == len(_branches(measured))


def _branches(curve: Curve) -> list[tuple[np.ndarray, np.ndarray]]:
    """Displacement and load of a curve between its turning points."""
    u, V = np.asarray(curve.displacement, float), np.asarray(curve.load, float)
    if len(u) < 2 or not np.ptp(u) > 0.0:
        return [(u, V)]
    turns = turning_points(u)
    ends = [*turns[:-1].tolist(), len(u) - 1]
    if len(turns) < 3:
        return [(u, V)]
    return [(u[a : b + 1], V[a : b + 1]) for a, b in zip(ends[:-1], ends[1:], strict=True)]


def _of_loops(simulated: Curve, measured: Curve, name: str) -> Misfit:
    """The misfit of curves with equally many turning points; the initial stiffness is that of the first branch, the
    energy that of the loops."""
    u, ours, theirs = compared(simulated, measured)
    if len(u) < 2 or not np.abs(theirs).max() > 0.0:
        raise ScenarioError(f"{name} and the simulated curve have no common displacements, or its force is zero")
    peak, most, areas = float(np.abs(theirs).max()), 0.0, np.zeros(2)
    for x, y, way_u, way_V in _ways_of_both(simulated, measured):
        if len(way_u):
            order = np.argsort(way_u, kind="stable")
            at = _points_of_both(x, way_u, float(way_u.min()), float(way_u.max()))
            own, other = np.interp(at, x, y), np.interp(at, way_u[order], way_V[order])
            most = max(most, float(np.abs(own).max()))
            areas += np.sign(way_u[-1] - way_u[0]) * np.array([np.trapezoid(own, at), np.trapezoid(other, at)])
    first = [_branches(curve)[0] for curve in (simulated, measured)]
    slopes = [_initial_stiffness(*(np.sign(u[-1] - u[0]) * column for column in (u, V))) for u, V in first]
    return Misfit(
        float(np.sqrt(np.mean((ours - theirs) ** 2))) / peak,
        most / peak - 1.0,
        slopes[0] / slopes[1] - 1.0 if slopes[0] is not None and slopes[1] is not None else None,
        float(areas[0] / areas[1]) - 1.0 if areas[1] > 0.0 else None,
        (float(u.min()), float(u.max())),
    )


def _one_way_each(simulated: Curve, measured: Curve, name: str) -> Misfit:
    """The misfit of monotonic curves."""
    ours, theirs = one_way(simulated, "the simulated curve"), one_way(measured, name)
    low, high = max(ours[0][0], theirs[0][0]), min(ours[0][-1], theirs[0][-1])
    inside = (theirs[0] >= low) & (theirs[0] <= high)
    if inside.sum() < 2:
        raise ScenarioError(
            f"{name} and the simulated curve have no common displacements: {theirs[0][0]:.4g} to {theirs[0][-1]:.4g} "
            f"m, and {ours[0][0]:.4g} to {ours[0][-1]:.4g} m"
        )
    peak = float(theirs[1][inside].max())
    if not peak > 0.0:
        raise ScenarioError(f"{name} has no force above 0; change its sign if the rig uses the opposite one")
    difference = np.interp(theirs[0][inside], *ours) - theirs[1][inside]
    at = _points_of_both(ours[0], theirs[0], low, high)
    own, other = np.interp(at, *ours), np.interp(at, *theirs)
    area = float(np.trapezoid(other, at))
    stiffness, measured_stiffness = _initial_stiffness(at, own), _initial_stiffness(at, other)
    known = stiffness is not None and measured_stiffness is not None
    return Misfit(
        float(np.sqrt(np.mean(difference**2))) / peak,
        float(own.max()) / peak - 1.0,
        stiffness / measured_stiffness - 1.0 if known else None,
        float(np.trapezoid(own, at)) / area - 1.0 if area > 0.0 else None,
        (float(low), float(high)),
    )


def _points_of_both(ours: np.ndarray, theirs: np.ndarray, low: float, high: float) -> np.ndarray:
    """Displacements of the points of either curve between ``low`` and ``high``, and these two."""
    return np.union1d(np.concatenate([ours, theirs]).clip(low, high), [low, high])


def one_way(curve: Curve, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Displacement and load of a monotonic curve, sorted by displacement; the loads of points with the same
    displacement are averaged. ScenarioError for a curve that turns."""
    displacement, load = np.asarray(curve.displacement, float), np.asarray(curve.load, float)
    if len(displacement) < 2 or not np.ptp(displacement) > 0.0:
        raise ScenarioError(f"{name} has no two points at different displacements")
    if (np.maximum.accumulate(displacement) - displacement).max() > REVERSAL_TOLERANCE * np.ptp(displacement):
        raise ScenarioError(f"{name} goes to and fro; give the part that goes one way, or the envelope of its loops")
    at, place = np.unique(displacement, return_inverse=True)
    return at, np.bincount(place, load) / np.bincount(place)


def _initial_stiffness(displacement: np.ndarray, load: np.ndarray) -> float | None:
    """Secant stiffness (N/m) from the origin to where the load first reaches a third of the peak; None if it starts
    above that."""
    wanted = THIRD * load.max()
    i = int(np.argmax(load >= wanted))
    if i == 0:
        return None
    share = (wanted - load[i - 1]) / (load[i] - load[i - 1])
    at = displacement[i - 1] + share * (displacement[i] - displacement[i - 1])
    return float(wanted / at) if at > 0.0 else None
