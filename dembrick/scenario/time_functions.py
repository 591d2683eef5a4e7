"""Functions of time that a scenario may name: sines, pulses, and the columns of a file."""

from __future__ import annotations

from dataclasses import dataclass

from dembrick.scenario.checks import assign, assign_positive, check_name, real, require, require_type


@dataclass(frozen=True, slots=True)
class Sine:
    """``amplitude`` times sin(2 pi ``frequency`` t + ``phase``); frequency in Hz, phase in rad."""

    amplitude: float
    frequency: float
    phase: float = 0.0

    def __post_init__(self):
        assign(self, amplitude=real("amplitude", self.amplitude), phase=real("phase", self.phase))
        assign_positive(self, "frequency", "Hz")


@dataclass(frozen=True, slots=True)
class Pulse:
    """``amplitude`` from ``start`` for ``duration`` (s), then -``rebound`` times ``amplitude`` for ``duration`` over
    ``rebound``, so that the integral of both is zero; else zero. Without a rebound there is the first part only."""

    amplitude: float
    duration: float
    start: float = 0.0
    rebound: float = 0.0

    def __post_init__(self):
        for key in ("amplitude", "duration", "start", "rebound"):
            assign(self, **{key: real(key, getattr(self, key))})
        require(self.duration > 0.0, "duration", self.duration, "it must be longer than 0 s")
        require(self.start >= 0.0, "start", self.start, "the run starts at 0 s")
        require(0.0 <= self.rebound <= 1.0, "rebound", self.rebound, "it is a part of the amplitude, between 0 and 1")


def check_baseline(baseline, file: str | tuple[str, ...] | None, quantity: str) -> None:
    """ScenarioError if there is no baseline to correct: only recorded accelerations have one."""
    require_type(isinstance(baseline, bool), "baseline", baseline, "true or false")
    recorded = file is not None and quantity == "acceleration"
    require(recorded or not baseline, "baseline", baseline, "only accelerations of a file have one to correct")


def checked_columns(columns, file: str | tuple[str, ...] | None, values: int = 1) -> tuple[str, ...] | None:
    """Names of the columns of time and of so many ``values`` in a ``file``, None if it does not need them."""
    if columns is None:
        return None
    require(file is not None, "columns", columns, "they belong to a file, and none is named")
    count = f"{1 + values} columns, of time and of values"
    require_type(isinstance(columns, list | tuple), "columns", columns, f"a list of names of {count}")
    require(len(columns) == 1 + values, "columns", columns, f"it must name {count}")
    return tuple(check_name(f"columns[{i}]", name) for i, name in enumerate(columns))
