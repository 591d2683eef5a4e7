"""Time histories: sines, pulses and CSV files, and the velocity of supports that follow them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dembrick.errors import ScenarioError
from dembrick.scenario.controls import BaseMotionControl, Pulse, Sine
from dembrick.scenario.csv_tables import read_columns
from dembrick.scenario.stages import controls_of
from dembrick.scenario.support_controls import QUANTITIES
from dembrick.scenario.text_files import require_file
from dembrick.scenario.units import STANDARD_GRAVITY

if TYPE_CHECKING:
    from dembrick.scenario.model import Scenario

Curve = Callable[[np.ndarray], np.ndarray]  # times (s,) -> values (s,)

AT_REST = 0.01  # of the greatest velocity: a lower one at the end of a record counts as rest
STRONGEST = {  # peaks of earthquakes; few have had more
    "acceleration": 1.5 * STANDARD_GRAVITY,  # m/s2
    "velocity": 5.0,  # m/s
    "displacement": 10.0,  # m
}
GAP = 1.5  # of the usual step: a longer one means that samples are missing


@dataclass(frozen=True)
class Samples:
    """A sampled history: ``time`` (s) and ``value`` (m,), ``path`` for messages."""

    time: np.ndarray
    value: np.ndarray
    path: str

    @property
    def step(self) -> float:
        """The shortest step (s)."""
        return float(np.diff(self.time).min())


def read_samples(
    path: str | Path, duration: float, quantity: str, columns: Sequence[str] | None = None, may_end: bool = False
) -> Samples:
    """Time (s) and ``quantity`` (SI; see `scenario.units`) from a CSV file or a PEER record.

    ``columns`` names the two columns if the units do not identify them. ScenarioError if a line has no numbers, if
    time does not increase, or if the history ends before ``duration`` (s), unless it ``may_end``; also if samples of
    a motion seem to be missing. A factor may be given at its corners alone, as it is linear between samples.
    """
    found, numbers = read_columns(path, "a history in time", ("time", quantity), columns)
    time, value = found["time"], found[quantity]
    steps = np.diff(time)
    usual = float(np.median(steps))
    wrong = np.flatnonzero((steps <= 0.0) | ((steps > GAP * usual) & (quantity != "factor")))
    if len(wrong):
        first = int(wrong[0])
        fault = _fault(float(steps[first]), usual, quantity)
        raise ScenarioError(f"{path}, line {numbers[first + 1]}: time {fault}")
    if time[0] > 0.0 or time[-1] < (0.0 if may_end else duration):
        raise ScenarioError(
            f"{path}: covers {time[0]:.6g} to {time[-1]:.6g} s, but the run lasts from 0 to {duration:.6g} s; "
            "shorten control.duration or lengthen the history"
        )
    return Samples(time, value, str(path))


@dataclass(frozen=True)
class Record:
    """A record that shakes supports: its ``name``, ``samples`` and ``duration`` (s), and the greatest value of its
    ``quantity``, times the factor of the control: ``peak`` (SI)."""

    name: str
    samples: int
    duration: float
    quantity: str
    peak: float

    def __str__(self) -> str:
        return f"{self.name}: {self.samples} samples, {self.duration:.4g} s, peak {self._peak}"

    @property
    def warning(self) -> str | None:
        """Remark on a peak that no earthquake has; None otherwise."""
        if self.peak <= STRONGEST[self.quantity]:
            return None
        return f"the peak of the record {self.name} is {self._peak}: are its units, control.quantity and scale right?"

    @property
    def _peak(self) -> str:
        size, unit = (STANDARD_GRAVITY, "g") if self.quantity == "acceleration" else (1.0, QUANTITIES[self.quantity])
        return f"{self.peak / size:.3g} {unit}"


def records_of(scenario: Scenario) -> list[Record]:
    """The records of all controls of a scenario, by component; ScenarioError for one that cannot be read."""
    found = []
    for control in controls_of(scenario):
        if not isinstance(control, BaseMotionControl):
            continue
        for _, file, columns in control.components:
            if file is not None:
                path = require_file(scenario, "control.file", file)
                read, _ = read_columns(path, "a history in time", ("time", control.quantity), columns)
                time, peak = read["time"], abs(control.scale) * float(np.abs(read[control.quantity]).max())
                name = file if columns is None else f"{file}, {columns[1]}"
                found.append(Record(name, len(time), float(time[-1] - time[0]), control.quantity, peak))
    return found


def _fault(step: float, usual: float, quantity: str) -> str:
    """End of a message on a wrong time step (s): the fault and its remedy."""
    if step < 0.0:
        return "goes back; give samples in order"
    if step == 0.0:
        return "does not advance; give a jump as two samples at least one time step of the run apart"
    what = f"leaves a gap of {step:.6g} s (the usual step is {usual:.6g} s); add the missing samples"
    if quantity == "displacement":
        return f"{what}, because a smooth curve is drawn through samples of a displacement"
    return f"{what}, also where the {quantity} is straight"


def sine(shape: Sine) -> Curve:
    """The sine as a function of time."""
    omega = 2.0 * math.pi * shape.frequency
    return lambda t: shape.amplitude * np.sin(omega * t + shape.phase)


def linear(samples: Samples) -> Curve:
    """Linear interpolation of the samples."""
    return lambda t: np.interp(t, samples.time, samples.value)


def sine_velocity(shape: Sine, quantity: str) -> Curve:
    """Velocity (m/s) of supports whose ``quantity`` follows a sine from time zero on."""
    omega, phase, a = 2.0 * math.pi * shape.frequency, shape.phase, shape.amplitude
    if quantity == "acceleration":
        return _from_rest(lambda t: a / omega * (np.cos(phase) - np.cos(omega * t + phase)))
    if quantity == "velocity":
        return _from_rest(lambda t: a * np.sin(omega * t + phase))
    return _from_rest(lambda t: a * omega * np.cos(omega * t + phase))


def pulse_velocity(shape: Pulse, quantity: str) -> Curve:
    """Velocity (m/s) of supports whose acceleration, or velocity, is a pulse."""
    end, back = shape.start + shape.duration, shape.rebound * shape.amplitude
    last = end + (shape.duration / shape.rebound if back else 0.0)
    if quantity == "acceleration":
        return lambda t: (
            shape.amplitude * np.clip(t - shape.start, 0.0, shape.duration) - back * np.clip(t - end, 0.0, last - end)
        )
    return lambda t: np.where(
        (t >= shape.start) & (t < end), shape.amplitude, np.where((t >= end) & (t < last), -back, 0.0)
    )


def sampled_velocity(samples: Samples, quantity: str) -> Curve:
    """Velocity (m/s) of supports with a sampled motion: linear between samples of acceleration or velocity, the
    natural cubic spline through samples of displacement. After the end of the samples the acceleration is zero, and
    supports whose velocity or displacement is given are at rest."""
    t, y = samples.time, samples.value
    if quantity == "velocity":
        return _from_rest(_until(linear(samples), t[-1]))
    if quantity == "displacement":
        return _from_rest(_until(_spline_slope(t, y), t[-1]))
    steps = np.diff(t)
    gained = np.concatenate([[0.0], np.cumsum(0.5 * (y[1:] + y[:-1]) * steps)])

    def velocity(at: np.ndarray) -> np.ndarray:
        i = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(steps) - 1)
        s = np.clip(at - t[i], 0.0, steps[i])
        return gained[i] + s * y[i] + 0.5 * s * s * (y[i + 1] - y[i]) / steps[i]

    before = velocity(np.zeros(1))
    return _from_rest(lambda at: velocity(at) - before)


def must_end_at_rest(samples: Samples, quantity: str) -> None:
    """Raise ScenarioError if supports that follow samples of velocity or displacement would stop suddenly at their
    end."""
    if quantity == "acceleration":
        return
    speed = np.abs(sampled_velocity(samples, quantity)(samples.time))
    if speed[-1] > AT_REST * speed.max():
        raise ScenarioError(
            f"{samples.path}: the supports move at {speed[-1]:.3g} m/s at the end of the history, "
            f"{samples.time[-1]:.6g} s, and would stop abruptly in a longer run; shorten control.duration or "
            "lengthen the history"
        )


def with_baseline(samples: Samples) -> Samples:
    """Accelerations with a linear baseline correction, so that the supports end at rest and without displacement.

    For the motion from time zero on, linear between the samples, with final velocity V and displacement D after L
    seconds, the line c0 + c1 t with c0 L + c1 L^2 / 2 = V and c0 L^2 / 2 + c1 L^3 / 6 = D removes both.
    """
    kept = samples.time > 0.0
    t = np.concatenate([[0.0], samples.time[kept]])
    y = np.concatenate([[np.interp(0.0, samples.time, samples.value)], samples.value[kept]])
    h, length = np.diff(t), float(t[-1])
    velocity = np.concatenate([[0.0], np.cumsum(0.5 * h * (y[1:] + y[:-1]))])
    moved = float((h * velocity[:-1] + h * h * (2.0 * y[:-1] + y[1:]) / 6.0).sum())
    c0 = (6.0 * moved / length - 2.0 * velocity[-1]) / length
    c1 = (6.0 * velocity[-1] - 12.0 * moved / length) / length**2
    return Samples(t, y - c0 - c1 * t, samples.path)


def _until(curve: Curve, end: float) -> Curve:
    """A curve that is zero after its ``end`` (s)."""
    return lambda t: np.where(t > end, 0.0, curve(t))


def _from_rest(curve: Curve) -> Curve:
    """A velocity that is zero before time zero, so that one that begins above zero is a jump, like a pulse."""
    return lambda t: np.where(t < 0.0, 0.0, curve(np.maximum(t, 0.0)))


def _spline_slope(t: np.ndarray, y: np.ndarray) -> Curve:
    """Slope of the natural cubic spline through (t, y)."""
    h = np.diff(t)
    n = len(t)
    curvature = np.zeros(n)
    if n > 2:
        diagonal = 2.0 * (h[:-1] + h[1:])
        right = 6.0 * np.diff(np.diff(y) / h)
        for i in range(1, n - 2):  # elimination and back substitution of the three diagonals
            factor = h[i] / diagonal[i - 1]
            diagonal[i] -= factor * h[i]
            right[i] -= factor * right[i - 1]
        for i in range(n - 3, -1, -1):
            curvature[i + 1] = (right[i] - h[i + 1] * curvature[i + 2]) / diagonal[i]

    def slope(at: np.ndarray) -> np.ndarray:
        i = np.clip(np.searchsorted(t, at, side="right") - 1, 0, n - 2)
        s = np.clip(at - t[i], 0.0, h[i])
        first = (y[i + 1] - y[i]) / h[i] - h[i] * (2.0 * curvature[i] + curvature[i + 1]) / 6.0
        return first + s * curvature[i] + 0.5 * s * s * (curvature[i + 1] - curvature[i]) / h[i]

    return slope


def eased(x: np.ndarray) -> np.ndarray:
    """Smooth growth from 0 to 1 (t,) at shares ``x`` of its time. It starts with zero rate and ends as 1 - (1 - x)^5:
    the force that decelerates sliding blocks fades before they stop, so that they do not spring back and leave their
    friction partly unused."""
    left = 1.0 - x
    return 1.0 - left**5 * (1.0 + 5.0 * x)
