"""Functions of time that a scenario may name: sines, pulses, and the columns of a file; and how supports are moved, by
a displacement and a turn, straight from the start to the end.
"""

from __future__ import annotations

from dataclasses import dataclass

from dembrick.errors import ScenarioError
from dembrick.scenario.blocks import Vector
from dembrick.scenario.checks import (
    assign,
    assign_positive,
    check_name,
    direction,
    present,
    real,
    require,
    require_type,
    show,
    vector,
)


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


STEEPEST_TURN = 90.0  # deg


@dataclass(frozen=True, slots=True)
class Turn:
    """A turn by ``angle`` (deg) about ``axis`` (right-hand rule) through ``point`` (m, world, at the start).

    Without a ``point`` each support turns about its own centroid.
    """

    axis: Vector
    angle: float
    point: Vector | None = None

    def __post_init__(self):
        angle = real("angle", self.angle)
        bound = f"it must lie between -{STEEPEST_TURN:g} and {STEEPEST_TURN:g} deg, and not be 0"
        require(0.0 < abs(angle) <= STEEPEST_TURN, "angle", angle, bound)
        assign(self, axis=direction("axis", self.axis), angle=angle)
        if self.point is not None:
            assign(self, point=vector("point", self.point))


@dataclass(frozen=True, slots=True)
class SupportPath:
    """The motion of ``supports``, blocks or groups: ``displacement`` (m, at the end) and ``rotation``, which grow
    together; the point of the rotation moves with the displacement."""

    supports: tuple[str, ...]
    displacement: Vector | None = None
    rotation: Turn | None = None

    def __post_init__(self):
        require_type(isinstance(self.supports, list | tuple), "supports", self.supports, "a list of names")
        assign(self, supports=tuple(check_name(f"supports[{i}]", name) for i, name in enumerate(self.supports)))
        require(len(self.supports) > 0, "supports", self.supports, "it must name a block or a group that moves")
        require_type(self.rotation is None or isinstance(self.rotation, Turn), "rotation", self.rotation, "a Turn")
        if self.displacement is not None:
            assign(self, displacement=vector("displacement", self.displacement))
        moves = self.rotation is not None or (self.displacement is not None and any(present(self.displacement)))
        if not moves:
            names = ", ".join(show(name) for name in self.supports)
            raise ScenarioError(f"supports {names}: they need a displacement or a rotation that is not zero")
