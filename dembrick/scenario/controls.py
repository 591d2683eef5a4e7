"""What is done to the blocks: the kinds of control, as plain frozen data."""

from __future__ import annotations

from dataclasses import dataclass

from dembrick.scenario.blocks import Vector
from dembrick.scenario.checks import assign, check_name, one_of, real, require, require_type, unit_vector, vector

QUANTITIES = ("acceleration", "velocity", "displacement")


@dataclass(frozen=True, slots=True)
class Sine:
    """``amplitude`` times sin(2 pi ``frequency`` t + ``phase``); frequency in Hz, phase in rad."""

    amplitude: float
    frequency: float
    phase: float = 0.0

    def __post_init__(self):
        for key in ("amplitude", "frequency", "phase"):
            assign(self, **{key: real(key, getattr(self, key))})
        require(self.frequency > 0.0, "frequency", self.frequency, "it must be greater than 0 Hz")


@dataclass(frozen=True, slots=True)
class Pulse:
    """``amplitude`` from ``start`` for ``duration`` (s), else zero."""

    amplitude: float
    duration: float
    start: float = 0.0

    def __post_init__(self):
        for key in ("amplitude", "duration", "start"):
            assign(self, **{key: real(key, getattr(self, key))})
        require(self.duration > 0.0, "duration", self.duration, "it must be longer than 0 s")
        require(self.start >= 0.0, "start", self.start, "the run starts at 0 s")


@dataclass(frozen=True, slots=True)
class YieldControl:
    """The limit load to ``tolerance``, the relative half-width of its bracket; everything else follows from it."""

    tolerance: float = 1.0e-3

    kind = "yield"

    def __post_init__(self):
        assign(self, tolerance=real("tolerance", self.tolerance))
        require(
            1e-8 <= self.tolerance <= 0.1,
            "tolerance",
            self.tolerance,
            "it is a relative error between 1e-8 and 0.1; 1e-3 is usual",
        )


@dataclass(frozen=True, slots=True)
class DisplacementControl:
    """A constant-rate test as the laboratory runs it: ``rate`` (m/s) over ``travel`` (m), physical mass."""

    rate: float
    travel: float

    kind = "displacement"

    def __post_init__(self):
        for key, unit in (("rate", "m/s"), ("travel", "m")):
            value = real(key, getattr(self, key))
            require(value > 0.0, key, value, f"it must be greater than 0 {unit}")
            assign(self, **{key: value})


@dataclass(frozen=True, slots=True)
class TiltControl:
    """A table with the supports that turns about ``axis`` (right-hand rule) at ``rate`` (deg/s) until a block has moved
    ``displacement`` (m) against it since it was seated.

    ``damping``: of critical, of a contact's dashpot against the two blocks it joins. ``quasi_static`` looks for the
    angle of the limit to ``tolerance``, without living through the seconds.
    """

    axis: Vector
    rate: float
    displacement: float
    damping: float = 0.05
    quasi_static: bool = False
    tolerance: float = 1.0e-3

    kind = "tilt"

    def __post_init__(self):
        axis = vector("axis", self.axis)
        require(any(axis), "axis", axis, "its length must be greater than 0")
        assign(self, axis=unit_vector(axis), displacement=real("displacement", self.displacement))
        rate, damping = real("rate", self.rate), real("damping", self.damping)
        require(0.0 < rate <= 10.0, "rate", rate, "it must lie above 0 and be at most 10 deg/s: a table tilts slowly")
        require(self.displacement > 0.0, "displacement", self.displacement, "it must be greater than 0 m")
        require(0.0 <= damping <= 0.9, "damping", damping, "it must lie between 0 and 0.9 of critical")
        require_type(isinstance(self.quasi_static, bool), "quasi_static", self.quasi_static, "true or false")
        tolerance = real("tolerance", self.tolerance)
        bound = "it is a relative error between 1e-8 and 0.1; 1e-3 is usual"
        require(1e-8 <= tolerance <= 0.1, "tolerance", tolerance, bound)
        assign(self, rate=rate, damping=damping, tolerance=tolerance)


@dataclass(frozen=True, slots=True)
class PushoverControl:
    """Every block pushed along ``direction`` by the same share of its weight, the load factor, to its limit.

    ``tolerance`` is the relative half-width of the bracket of that limit. The curve goes on past it until a block has
    moved ``displacement`` (m) since it was seated, where that is given. With ``quasi_static`` false the blocks are
    pushed in real time, their mean displacement by ``rate`` (m/s), with contact ``damping`` as in `TiltControl`.
    """

    direction: Vector
    displacement: float | None = None
    quasi_static: bool = True
    tolerance: float = 1.0e-3
    rate: float | None = None
    damping: float = 0.05

    kind = "pushover"

    def __post_init__(self):
        direction = vector("direction", self.direction)
        require(any(direction), "direction", direction, "its length must be greater than 0")
        assign(self, direction=unit_vector(direction), tolerance=real("tolerance", self.tolerance))
        if self.displacement is not None:
            assign(self, displacement=real("displacement", self.displacement))
            require(self.displacement > 0.0, "displacement", self.displacement, "it must be greater than 0 m")
        require_type(isinstance(self.quasi_static, bool), "quasi_static", self.quasi_static, "true or false")
        bound = "it is a relative error between 1e-8 and 0.1; 1e-3 is usual"
        require(1e-8 <= self.tolerance <= 0.1, "tolerance", self.tolerance, bound)
        damping = real("damping", self.damping)
        require(0.0 <= damping <= 0.9, "damping", damping, "it must lie between 0 and 0.9 of critical")
        assign(self, damping=damping)
        if self.quasi_static:
            require(self.rate is None, "rate", self.rate, "it belongs to a push in real time: quasi_static = false")
            return
        for key, unit in (("rate", "m/s"), ("displacement", "m")):
            value = getattr(self, key)
            require(value is not None, key, value, f"a push in real time needs it, in {unit}")
        assign(self, rate=real("rate", self.rate))
        require(self.rate > 0.0, "rate", self.rate, "it must be greater than 0 m/s")


@dataclass(frozen=True, slots=True)
class DynamicControl:
    """Free motion for ``duration`` (s), from the velocities of the blocks, under gravity and loads.

    ``restitution``: speed after over speed before the impact of two blocks face to face.
    """

    duration: float
    restitution: float = 0.5

    kind = "dynamic"

    def __post_init__(self):
        _check_motion(self)


@dataclass(frozen=True, slots=True)
class BaseMotionControl:
    """Supports that shake along ``direction`` for ``duration`` (s), by a ``sine``, a ``pulse`` or a ``file``, whose
    ``quantity`` is an acceleration, a velocity or a displacement.

    The file is a CSV whose first line names its columns with their units, such as "time [s], acceleration [g]", or a
    PEER record (.AT2, .VT2, .DT2). ``columns`` picks two of its columns by name, time first, where units do not tell.
    """

    duration: float
    direction: Vector
    file: str | None = None
    sine: Sine | None = None
    pulse: Pulse | None = None
    quantity: str = "acceleration"
    restitution: float = 0.5
    columns: tuple[str, str] | None = None

    kind = "base-motion"

    def __post_init__(self):
        _check_motion(self)
        direction = vector("direction", self.direction)
        require(any(direction), "direction", direction, "its length must be greater than 0")
        assign(self, direction=unit_vector(direction))
        one_of("quantity", self.quantity, QUANTITIES)
        if self.file is not None:
            check_name("file", self.file)
        assign(self, columns=checked_columns(self.columns, self.file))
        require_type(self.sine is None or isinstance(self.sine, Sine), "sine", self.sine, "a Sine")
        require_type(self.pulse is None or isinstance(self.pulse, Pulse), "pulse", self.pulse, "a Pulse")
        given = [key for key in ("file", "sine", "pulse") if getattr(self, key) is not None]
        require(len(given) == 1, "control", given, "a base motion needs exactly one of file, sine and pulse")
        still = self.pulse is not None and self.quantity == "displacement"
        require(not still, "quantity", self.quantity, "a pulse of displacement has no finite velocity; use another")


def checked_columns(columns, file: str | None) -> tuple[str, str] | None:
    """Names of the columns of time and of values in a ``file``, None where it does not need them."""
    if columns is None:
        return None
    require(file is not None, "columns", columns, "they belong to a file, and none is named")
    require_type(isinstance(columns, list | tuple), "columns", columns, "a list of two names, of time and of values")
    require(len(columns) == 2, "columns", columns, "it must name two columns, of time and of values")
    time, value = (check_name(f"columns[{i}]", name) for i, name in enumerate(columns))
    return time, value


def _check_motion(control) -> None:
    duration, restitution = real("duration", control.duration), real("restitution", control.restitution)
    require(duration > 0.0, "duration", duration, "it must be longer than 0 s")
    bound = "the speed after over the speed before an impact lies between 0.14 (critically damped) and 1"
    require(0.14 <= restitution <= 1.0, "restitution", restitution, bound)
    assign(control, duration=duration, restitution=restitution)


Control = YieldControl | DisplacementControl | TiltControl | PushoverControl | DynamicControl | BaseMotionControl
MOTIONS = ("tilt", "pushover", "dynamic", "base-motion")  # kinds that may move blocks in real time


def on_all_blocks(control: Control) -> bool:
    """Whether the control looks for the limit of a load that acts on every block."""
    return control.kind in ("tilt", "pushover") and control.quasi_static


def drives_to_collapse(control: Control) -> bool:
    """Whether the control ends when a block has moved far enough, which is a collapse."""
    return control.kind in ("tilt", "pushover")


def in_real_time(control: Control) -> bool:
    """Whether the control lives through seconds of motion."""
    return control.kind in MOTIONS and not on_all_blocks(control)
