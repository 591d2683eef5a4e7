"""The misfit of a simulated curve against a measured one: force over displacement, both one way.

Curves are compared over the displacements that both have, by straight lines between their points.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from dembrick.errors import ScenarioError

THIRD = 1.0 / 3.0  # of the peak, up to which the initial stiffness is taken, as EN 1052-1 takes the modulus of masonry
BACK = 0.05  # of its range, by which a measured displacement may go back: the scatter of a gauge, and not a cycle


NUMBERS = ("rms", "peak", "stiffness", "energy")


class Curve(Protocol):
    """Displacement (k,) m and load (k,) N."""

    @property
    def displacement(self) -> np.ndarray: ...
    @property
    def load(self) -> np.ndarray: ...


class Misfit(NamedTuple):
    """Simulated against measured; relative, None where the measured curve does not say.

    ``rms``: root mean square of the difference at the measured points, over the measured peak. ``peak``, ``stiffness``
    (the secant from the origin to a third of its own peak), ``energy`` (the area below the curve): simulated over
    measured, less 1. ``compared``: from and up to where, m.
    """

    rms: float
    peak: float
    stiffness: float | None
    energy: float | None
    compared: tuple[float, float]

    def numbers(self) -> dict[str, float | None]:
        """The four numbers by name, as in ``--json``."""
        return dict(zip(NUMBERS, self, strict=False))  # type: ignore[arg-type]


def text(misfit: Misfit) -> str:
    """The misfit in words, in per cent."""
    parts = [f"rms {100.0 * misfit.rms:.2f} % of the peak"]
    for name, value in list(misfit.numbers().items())[1:]:
        parts.append(f"{name} not on the curve" if value is None else f"{name} {100.0 * value:+.2f} %")
    return ", ".join(parts)


def between(simulated: Curve, measured: Curve, name: str = "the measured curve") -> Misfit:
    """The misfit; ScenarioError if a curve goes to and fro, or the two share no displacements."""
    ours, theirs = one_way(simulated, "the simulated curve"), one_way(measured, name)
    low, high = max(ours[0][0], theirs[0][0]), min(ours[0][-1], theirs[0][-1])
    inside = (theirs[0] >= low) & (theirs[0] <= high)
    if inside.sum() < 2:
        raise ScenarioError(
            f"{name} and the simulated curve share no displacements: {theirs[0][0]:.4g} to {theirs[0][-1]:.4g} m, and "
            f"{ours[0][0]:.4g} to {ours[0][-1]:.4g} m"
        )
    peak = float(theirs[1][inside].max())
    if not peak > 0.0:
        raise ScenarioError(f"{name} has no force above 0; turn its sign round if the rig counts the other way")
    difference = np.interp(theirs[0][inside], *ours) - theirs[1][inside]
    at = np.union1d(np.concatenate([ours[0], theirs[0]]).clip(low, high), [low, high])
    own, other = np.interp(at, *ours), np.interp(at, *theirs)
    area = float(np.trapezoid(other, at))
    stiffness, measured_stiffness = _initial_stiffness(at, own), _initial_stiffness(*theirs)
    known = stiffness is not None and measured_stiffness is not None
    return Misfit(
        float(np.sqrt(np.mean(difference**2))) / peak,
        float(own.max()) / peak - 1.0,
        stiffness / measured_stiffness - 1.0 if known else None,  # type: ignore[operator]
        float(np.trapezoid(own, at)) / area - 1.0 if area > 0.0 else None,
        (float(low), float(high)),
    )


def one_way(curve: Curve, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Displacement and load of a curve that goes one way, in the order of the displacement; points at one displacement
    count by their mean. ScenarioError for a curve that turns."""
    displacement, load = np.asarray(curve.displacement, float), np.asarray(curve.load, float)
    if len(displacement) < 2 or not np.ptp(displacement) > 0.0:
        raise ScenarioError(f"{name} has no two points at different displacements")
    if (np.maximum.accumulate(displacement) - displacement).max() > BACK * np.ptp(displacement):
        raise ScenarioError(f"{name} goes to and fro; give the part that goes one way, or the envelope of its loops")
    at, place = np.unique(displacement, return_inverse=True)
    return at, np.bincount(place, load) / np.bincount(place)


def _initial_stiffness(displacement: np.ndarray, load: np.ndarray) -> float | None:
    """The secant (N/m) from the origin to where a curve first has a third of its peak; None if it begins above."""
    wanted = THIRD * load.max()
    i = int(np.argmax(load >= wanted))
    if i == 0:
        return None
    share = (wanted - load[i - 1]) / (load[i] - load[i - 1])
    at = displacement[i - 1] + share * (displacement[i] - displacement[i - 1])
    return float(wanted / at) if at > 0.0 else None
