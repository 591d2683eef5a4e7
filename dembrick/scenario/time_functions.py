"""Functions of time in a scenario (sines, pulses, columns of a file), and linear motions of supports, by a displacement
and a rotation.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from dembrick.errors import ScenarioError
from dembrick.scenario.blocks import Vector
from dembrick.scenario.checks import (
    assign,
    check_name,
    present,
    real,
    require,
    require_type,
    show,
)
from dembrick.scenario.declared import (
    check_keys,
    declare,
    not_negative,
    number,
    positive,
    table,
    unit_vector,
    vector_of,
    within,
)


@dataclass(frozen=True, slots=True)
class Sine:
    """``amplitude`` times sin(2 pi ``frequency`` t + ``phase``); frequency in Hz, phase in rad."""

    amplitude: float = field(
        metadata=number("", "amplitude: the factor of a load, or of the quantity of a base motion")
    )
    frequency: float = field(metadata=positive("Hz", "frequency"))
    phase: float = field(default=0.0, metadata=number("rad", "phase"))

    def __post_init__(self):
        check_keys(self)


@dataclass(frozen=True, slots=True)
class Pulse:
    """``amplitude`` from ``start`` for ``duration`` (s), then -``rebound`` times ``amplitude`` for ``duration`` over
    ``rebound``, so that the total integral is zero; zero otherwise. Without a rebound there is only the first part."""

    amplitude: float = field(metadata=number("", "height of a rectangular pulse, of the quantity of a base motion"))
    duration: float = field(metadata=positive("s", "its length", "it must be longer than 0 s"))
    start: float = field(default=0.0, metadata=not_negative("s", "when it begins"))
    rebound: float = field(
        default=0.0,
        metadata=within(
            0.0, 1.0, "1", "then this part of the amplitude in reverse, until the impulses cancel",
            "it is a part of the amplitude, between 0 and 1",
        ),
    )  # fmt: skip

    def __post_init__(self):
        check_keys(self)


def check_baseline(baseline, file: str | tuple[str, ...] | None, quantity: str) -> None:
    """Raise a ScenarioError if a requested baseline correction is impossible: only recorded accelerations have one."""
    require_type(isinstance(baseline, bool), "baseline", baseline, "true or false")
    recorded = file is not None and quantity == "acceleration"
    require(recorded or not baseline, "baseline", baseline, "only accelerations of a file can be corrected")


def checked_columns(columns, file: str | tuple[str, ...] | None, values: int = 1) -> tuple[str, ...] | None:
    """Check the names of the columns of time and of ``values`` columns in a ``file``; None if none are needed."""
    if columns is None:
        return None
    require(file is not None, "columns", columns, "they belong to a file, but none is named")
    count = f"{1 + values} columns, of time and of values"
    require_type(isinstance(columns, list | tuple), "columns", columns, f"a list of names of {count}")
    require(len(columns) == 1 + values, "columns", columns, f"it must name {count}")
    return tuple(check_name(f"columns[{i}]", name) for i, name in enumerate(columns))


STEEPEST_TURN = 90.0  # deg


def _check_turn(key: str, value, _: str) -> float:
    angle = real(key, value)
    bound = f"it must lie between -{STEEPEST_TURN:g} and {STEEPEST_TURN:g} deg, and not be 0"
    require(0.0 < abs(angle) <= STEEPEST_TURN, key, angle, bound)
    return angle


@dataclass(frozen=True, slots=True)
class Turn:
    """A rotation by ``angle`` (deg) about ``axis`` (right-hand rule) through ``point`` (m, world, at the start).

    Without a ``point`` each support rotates about its own centroid.
    """

    axis: Vector = field(metadata=unit_vector("axis of the turn, right-hand rule"))
    angle: float = field(metadata=declare("-90 to 90, not 0", "angle of the turn at the end", "deg", _check_turn))
    point: Vector | None = field(
        default=None,
        metadata=vector_of("m", "a point of the axis at the start; left out, the centroid of each support"),
    )

    def __post_init__(self):
        check_keys(self)


SUPPORTS_OF = declare("names", "blocks and groups with this motion; they must be fixed")
MOVED = vector_of("m", "how far they have moved at the end, world axes")
TURNED = table(Turn, "how far they have turned at the end")


@dataclass(frozen=True, slots=True)
class SupportPath:
    """Motion of ``supports``, blocks or groups: ``displacement`` (m, at the end) and ``rotation``, which grow in
    proportion; the point of the rotation moves with the displacement."""

    supports: tuple[str, ...] = field(metadata=SUPPORTS_OF)
    displacement: Vector | None = field(default=None, metadata=MOVED)
    rotation: Turn | None = field(default=None, metadata=TURNED)

    def __post_init__(self):
        check_keys(self)
        require_type(isinstance(self.supports, list | tuple), "supports", self.supports, "a list of names")
        assign(self, supports=tuple(check_name(f"supports[{i}]", name) for i, name in enumerate(self.supports)))
        require(len(self.supports) > 0, "supports", self.supports, "it must name a block or a group that moves")
        moves = self.rotation is not None or (self.displacement is not None and any(present(self.displacement)))
        if not moves:
            names = ", ".join(show(name) for name in self.supports)
            raise ScenarioError(f"supports {names}: they need a displacement or a rotation that is not zero")
