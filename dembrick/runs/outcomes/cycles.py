"""Cycles of a cyclic test: peak force of each half cycle, dissipated energy, damping, residual displacement.

A cycle goes from a turning point to the next but one; the first begins at the first turning point after the start. An
incomplete one does not count: one whose record ends half way back or earlier after its last turning point. If
amplitudes grow, its loop closes before its last turning point, and what lies beyond belongs to no loop.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from dembrick.scenario.model import Scenario


LOSSES = "friction", "crushing", "fracture", "yielding"  # of the energies: those that are dissipated
RETURN_SHARE = 0.51  # of the way to the last turning point but one: from there on a record's end is one too
MISSED = 1e-2  # of the dissipated energy: straight lines between rows may miss so much of a loop
CLOSED = 1e-5  # of the way out: a loop that misses its start by less is closed
ROUNDING = 1e-12  # of the ranges of force and displacement: smaller works and displacements are zero
FASTER = 3.0  # times as fast, at most, is a test at a constant rate in the next row, as after a turn
DRIFTS, PLATEAU = 10, 1e-2  # over a DRIFTS-th of a half cycle beside its peak, the force of a plateau changes by less


def cycles_of(
    scenario: Scenario, rows: Mapping[str, np.ndarray], turns: Sequence[int], weight: float = 1.0
) -> list[dict] | None:
    """The cycles of a run from its ``rows``; ``turns`` are the rows at the turning points. None if it does
    not turn, or kept no record. ``weight``: the sum of the weights of the actuators, without their signs, as their work
    is that times V du.

    Each with ``peak`` [of its first half, of the second] (N), ``V_lower`` and ``V_upper`` of these, up to its turning
    points; ``residual`` (m): where V passes zero after the second peak, None if it does not. Of the loop, until it is
    back at the displacement of its start: ``dissipated`` (J), the work of `LOSSES` or, if no energies are recorded,
    that of the actuators; and ``damping``: the work of the actuators, which is the same unless joints dilate or open,
    over 2 pi F_a u_a, with half the ranges of the force, ``weight`` times V, and of the displacement. A cycle of
    shrinking amplitude never is back: its work is that of `LOSSES` up to its last turning point (None without
    energies).
    """
    control = scenario.control
    if not control.cyclic or not len(rows.get("load", ())):
        return None
    in_equilibrium = control.in_deformed_geometry
    V, u = np.asarray(rows["load"], float), np.asarray(rows["displacement"], float)
    noise = np.asarray(rows["unbalanced"], float) * _greatest_force(rows, V)
    energies: Mapping = rows.get("energy") or {}  # type: ignore[assignment]
    lost = np.sum([np.asarray(energies[name], float) for name in LOSSES], axis=0) if energies else None
    laws = scenario.joint, *(entry.law for entry in scenario.joints)
    dilates, may_break = any(law.dilation for law in laws), any(law.weakens for law in laws)
    breaks = np.diff(energies["fracture"]) > 0.0 if energies else np.full(len(V) - 1, may_break)
    found = []
    for first, middle, last in zip(turns[:-2:2], turns[1:-1:2], turns[2::2], strict=False):
        if last == len(u) - 1 and abs(u[last] - u[middle]) <= RETURN_SHARE * abs(u[first] - u[middle]):
            break
        whole = slice(first, last + 1)
        closes = _closing(u[whole], middle - first)
        path, force = _until(closes, u[whole]), _until(closes, weight * V[whole])
        area = None if closes is None else _area(force, path, middle - first)
        taken = None if lost is None else float(np.diff(_until(closes, lost[whole])[[0, -1]])[0])
        same = taken is not None and not dilates and (area is None or abs(area - taken) <= MISSED * abs(taken))
        work, dissipated = taken if same else area, area if taken is None else taken
        halves = [_peak(V, u, noise, *ends, in_equilibrium) for ends in ((first, middle), (middle, last))]
        if not in_equilibrium:
            ends = (first, middle), (middle, last)
            halves = [(at, bar + _missed(V, u, breaks, at, *end)) for (at, bar), end in zip(halves, ends, strict=True)]
        sizes = 0.25 * float(np.ptp(force) * np.ptp(path))
        work, dissipated = (_but_for_rounding(value, sizes) for value in (work, dissipated))
        found.append(
            {
                "peak": [float(V[at]) for at, _ in halves],
                "V_lower": [float(V[at]) - bar for at, bar in halves],
                "V_upper": [float(V[at]) + bar for at, bar in halves],
                "dissipated": dissipated,
                "damping": _damping(work, sizes),
                "residual": _but_for_rounding(_residual(V, u, halves[1][0]), float(np.ptp(path))),
            }
        )
    return found


def _greatest_force(rows: Mapping[str, np.ndarray], V: np.ndarray) -> float:
    """Reference force (N) of the out-of-balance of the rows: the greatest reaction of a support, or V."""
    reaction = rows.get("reaction")
    most = float(np.abs(V).max())
    if reaction is None or not np.size(reaction):
        return most
    return max(most, float(np.linalg.norm(np.asarray(reaction)[..., :3], axis=-1).max()))


def _peak(
    V: np.ndarray, u: np.ndarray, noise: np.ndarray, first: int, last: int, equilibria: bool
) -> tuple[int, float]:
    """The row of a half cycle at which the force is furthest from that at its start, and the error bar of that force.

    The bar is the sum of the out-of-balance force there, the change of a plateau's force over the calmer adjacent tenth
    of the half cycle, and the swing of the forces about their trend on the calmer side; for equilibria, instead of the
    swing, the difference to the nearer neighbour, as the peak may lie between rows.
    """
    half, way = V[first : last + 1], np.abs(u[first : last + 1] - u[first])
    at = int(np.argmax((np.sign(half[-1] - half[0]) or 1.0) * half))
    tenth = way[-1] / DRIFTS
    ends = [np.argmax(way >= way[at] - tenth), *np.flatnonzero(way >= way[at] + tenth)[:1]]
    drift = float(np.abs(half[ends] - half[at]).min())
    level = drift < PLATEAU * abs(half[at])  # else a rise that ends at the turning point
    bar = float(noise[first + at]) + (drift if level else 0.0)
    if equilibria:
        beside = [abs(half[at] - half[i]) for i in (at - 1, at + 1) if 0 < at < len(half) - 1]
        return first + at, bar + min(beside, default=0.0)
    sides = (half[max(at - 3, 0) : at + 1], half[at : at + 4])
    return first + at, bar + min((float(np.ptp(np.diff(side))) for side in sides if len(side) > 2), default=0.0)


def _missed(V: np.ndarray, u: np.ndarray, breaks: np.ndarray, at: int, first: int, last: int) -> float:
    """How far (N) the force of a half cycle may rise above that of its row ``at`` between rows (n - 1,) between which a
    bond ``breaks``: straight on from the two rows before."""
    way = np.sign(V[last] - V[first]) or 1.0
    i = first + 1 + np.flatnonzero(breaks[first + 1 : last])
    before, behind = np.abs(u[i] - u[i - 1]), np.abs(u[i + 1] - u[i])
    steps = np.clip(behind, before, FASTER * before) / np.where(before > 0.0, before, 1.0)
    return float((way * (V[i] - V[at]) + steps * np.maximum(0.0, way * (V[i] - V[i - 1]))).max(initial=0.0))


def _closing(u: np.ndarray, middle: int) -> tuple[int, float] | None:
    """Where a loop with its turning point at ``middle`` is back at its first displacement: the row at or behind it, and
    the part of the way there from the row before; None if it does not come back."""
    way = 1.0 if u[0] > u[middle] else -1.0
    beyond, slack = way * (u[middle:] - u[0]), CLOSED * np.ptp(u[: middle + 1])
    back = middle + np.flatnonzero(beyond >= (0.0 if (beyond >= 0.0).any() else -slack))
    if not len(back):
        return None
    end = int(back[0])
    return end, float(min((u[0] - u[end - 1]) / (u[end] - u[end - 1]), 1.0))


def _until(closes: tuple[int, float] | None, values: np.ndarray) -> np.ndarray:
    """The values at the rows of a loop until it ``closes``, the last one interpolated; all if it does not close."""
    if closes is None:
        return values
    end, part = closes
    return np.append(values[:end], values[end - 1] + part * (values[end] - values[end - 1]))


def _area(V: np.ndarray, u: np.ndarray, middle: int) -> float:
    """The work (J) of a force V along a closed loop with its turning point at ``middle``; zero if leaving out every
    second row changes it by as much."""
    end = len(u) - 1
    area = float(np.trapezoid(V, u))
    coarser = np.unique(np.append(np.arange(0, end, 2), [middle, end]))
    return 0.0 if abs(area) <= abs(area - float(np.trapezoid(V[coarser], u[coarser]))) else area


def _but_for_rounding(value: float | None, size: float) -> float | None:
    """The value; zero if it is a rounding error of numbers of that ``size``."""
    return 0.0 if value is not None and abs(value) <= ROUNDING * size else value


def _damping(dissipated: float | None, sizes: float) -> float | None:
    if dissipated is None:
        return None
    return dissipated / (2.0 * math.pi * sizes) if sizes > 0.0 else 0.0


def _residual(V: np.ndarray, u: np.ndarray, peak: int) -> float | None:
    """Where V passes zero after a ``peak`` (m), between two rows."""
    behind = np.flatnonzero(V[peak:-1] * V[peak + 1 :] <= 0.0)
    if not len(behind):
        return None
    i = peak + int(behind[0])
    step = V[i + 1] - V[i]
    return float(u[i] if step == 0.0 else u[i] - V[i] * (u[i + 1] - u[i]) / step)
