"""Kinds of control: what is done to the blocks, as plain frozen data.

A class says everything about its kind: how it is carried out (``regime``), what grows and in which unit (``curve``),
what it ends with (``ends_with``), what it needs (``drives``, ``needs_supports``). No other module asks for the name of
a kind. A new kind is a class here, an entry of `CONTROLS`, and, if no regime fits it, a driver in ``runs.drivers``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from dembrick.errors import ScenarioError
from dembrick.scenario.blocks import Vector
from dembrick.scenario.checks import (
    assign,
    assign_positive,
    assign_within,
    check_name,
    direction,
    members_of,
    one_of,
    present,
    real,
    require,
    require_type,
)
from dembrick.scenario.protocols import checked
from dembrick.scenario.regimes import (
    ACTUATORS,
    COLLAPSE,
    CONSTANT_RATE,
    DEAD_LOAD,
    DEFORMED_REST,
    DRIVEN,
    DRIVEN_PATH,
    EVERY_BLOCK,
    FURTHEST,
    LIMIT_LOAD,
    LOAD_PATH,
    PATH_FOLLOWING,
    REAL_TIME,
    SETTLEMENT,
    STEEPEST,
    SUPPORTS,
    TILT_LOAD,
    YIELD,
    Control,
    Curve,
    Limit,
    Regime,
)
from dembrick.scenario.time_functions import Pulse, Sine, SupportPath, Turn, check_baseline, checked_columns

TOLERANCE = "it is a relative error between 1e-8 and 0.1; 1e-3 is usual"
DAMPING = "it must lie between 0 and 0.9 of critical"
QUANTITIES = ("acceleration", "velocity", "displacement")


@dataclass(frozen=True, slots=True)
class YieldControl(Control):
    """The limit load to ``tolerance``, the relative half-width of its bracket; everything else follows from it.

    With ``large_displacements`` it is that of the deformed geometry, and found from equilibrium to equilibrium.
    """

    tolerance: float = 1.0e-3
    large_displacements: bool = False

    kind = "yield"
    ends_with = YIELD
    drives = ACTUATORS

    @property
    def regime(self) -> Regime:
        return LOAD_PATH if self.large_displacements else LIMIT_LOAD

    def __post_init__(self):
        _check_large_displacements(self)
        assign_within(self, "tolerance", 1e-8, 0.1, TOLERANCE)


@dataclass(frozen=True, slots=True)
class DisplacementControl(Control):
    """A constant-rate test as the laboratory runs it: ``rate`` (m/s) over ``travel`` (m), physical mass.

    With ``large_displacements`` it goes from equilibrium to equilibrium in the deformed geometry, as a slow test would.
    In place of the travel a cyclic test has a ``protocol``: turning points (m) of the jack's end from its start, or a
    CSV file of a measured one with a column of displacement, and perhaps of time. ``force_protocol`` (N), in the
    deformed geometry, has those of V, its ``rate`` is in N/s.
    """

    rate: float
    travel: float | None = None
    large_displacements: bool = False
    protocol: tuple[float, ...] | str | None = None
    force_protocol: tuple[float, ...] | str | None = None

    kind = "displacement"
    drives = ACTUATORS

    @property
    def regime(self) -> Regime:
        return DRIVEN_PATH if self.large_displacements else CONSTANT_RATE

    def __post_init__(self):
        _check_large_displacements(self)
        assign_positive(self, "rate", "m/s")
        given = [key for key in ("travel", "protocol", "force_protocol") if getattr(self, key) is not None]
        if len(given) != 1:
            what = " and ".join(given) if given else "none of them"
            raise ScenarioError(f"a test by displacement has one of travel, protocol and force_protocol; given: {what}")
        if self.travel is not None:
            assign_positive(self, "travel", "m")
        for key in given:
            if key != "travel":
                assign(self, **{key: checked(key, getattr(self, key))})
        if self.force_protocol is not None and not self.large_displacements:
            raise ScenarioError("force_protocol is for the deformed geometry; add large_displacements = true")

    @property
    def cyclic(self) -> bool:
        return self.travel is None


@dataclass(frozen=True, slots=True)
class StaticsControl(Control):
    """Whether the blocks stand under their dead loads; nothing is driven, and actuators carry nothing.

    ``large_displacements``: in the deformed geometry.
    """

    large_displacements: bool = False

    kind = "statics"

    @property
    def regime(self) -> Regime:
        return DEFORMED_REST if self.large_displacements else DEAD_LOAD

    def __post_init__(self):
        _check_large_displacements(self)


@dataclass(frozen=True, slots=True)
class TiltControl(Control):
    """A table with the supports that turns about ``axis`` (right-hand rule), to the angle at which the blocks fall.

    ``quasi_static``, which is the default without a ``rate``, looks for that limit to ``tolerance`` and follows it
    until a block has moved ``displacement`` (m), if one is given. Else the table turns at ``rate`` (deg/s) in real time
    until a block has moved ``displacement`` against it since it was at rest. ``damping``: of critical, of a contact's
    dashpot against the two blocks it joins. ``large_displacements``: the limit is that of the deformed geometry.
    """

    axis: Vector
    rate: float | None = None
    displacement: float | None = None
    damping: float = 0.05
    quasi_static: bool | None = None
    tolerance: float = 1.0e-3
    large_displacements: bool = False

    kind = "tilt"
    ends_with = COLLAPSE
    drives = EVERY_BLOCK

    @property
    def regime(self) -> Regime:
        return _searched(self)

    @property
    def curve(self) -> Curve:
        """A search drives the blocks by their weights, as actuators would."""
        about = "load factor: the tangent of the angle of the table"
        return Curve(TILT_LOAD, "1", about, DRIVEN if self.quasi_static else FURTHEST)

    @property
    def tilt_axis(self) -> Vector:
        return self.axis

    @property
    def limit(self) -> Limit:
        return Limit(STEEPEST / present(self.rate), "rate", "tilt faster")

    def angle(self, load_factor: float) -> float:
        return math.degrees(math.atan(load_factor))

    def __post_init__(self):
        quasi_static = self.rate is None if self.quasi_static is None else self.quasi_static
        require_type(isinstance(quasi_static, bool), "quasi_static", quasi_static, "true or false")
        assign(self, axis=direction("axis", self.axis), quasi_static=quasi_static)
        _check_large_displacements(self)
        for key, unit in (("rate", "deg/s"), ("displacement", "m")):
            value = getattr(self, key)
            require(quasi_static or value is not None, key, value, f"a tilt in real time needs it, in {unit}")
            if value is not None:
                assign_positive(self, key, unit)
        if self.rate is not None:
            require(self.rate <= 10.0, "rate", self.rate, "it must be at most 10 deg/s: a table tilts slowly")
        assign_within(self, "damping", 0.0, 0.9, DAMPING)
        assign_within(self, "tolerance", 1e-8, 0.1, TOLERANCE)


@dataclass(frozen=True, slots=True)
class PushoverControl(Control):
    """Every block pushed along ``direction`` by the same share of its weight, the load factor, to its limit.

    ``tolerance`` is the relative half-width of the bracket of that limit. The curve goes on past it until a block has
    moved ``displacement`` (m) since the dead-load equilibrium, if given. With ``quasi_static`` false the blocks are
    pushed in real time, their mean displacement by ``rate`` (m/s), with contact ``damping`` as in `TiltControl`.
    ``large_displacements``: the limit is that of the deformed geometry.
    """

    direction: Vector
    displacement: float | None = None
    quasi_static: bool = True
    tolerance: float = 1.0e-3
    rate: float | None = None
    damping: float = 0.05
    large_displacements: bool = False

    kind = "pushover"
    curve = Curve("load factor", "1", "load factor: the share of its weight by which every block is pushed", DRIVEN)
    ends_with = COLLAPSE
    drives = EVERY_BLOCK

    @property
    def regime(self) -> Regime:
        return _searched(self)

    @property
    def push_direction(self) -> Vector:
        return self.direction

    def __post_init__(self):
        assign(self, direction=direction("direction", self.direction))
        if self.displacement is not None:
            assign_positive(self, "displacement", "m")
        require_type(isinstance(self.quasi_static, bool), "quasi_static", self.quasi_static, "true or false")
        _check_large_displacements(self)
        assign_within(self, "tolerance", 1e-8, 0.1, TOLERANCE)
        assign_within(self, "damping", 0.0, 0.9, DAMPING)
        if self.quasi_static:
            require(self.rate is None, "rate", self.rate, "it belongs to a push in real time: quasi_static = false")
            return
        for key, unit in (("rate", "m/s"), ("displacement", "m")):
            value = getattr(self, key)
            require(value is not None, key, value, f"a push in real time needs it, in {unit}")
        assign_positive(self, "rate", "m/s")


@dataclass(frozen=True, slots=True)
class DynamicControl(Control):
    """Free motion for ``duration`` (s), from the velocities of the blocks, under gravity and loads.

    ``restitution``: speed after over speed before the impact of two blocks face to face.
    """

    duration: float
    restitution: float = 0.5

    kind = "dynamic"
    curve = Curve(None, "1", "zero: no load grows", FURTHEST)
    needs_supports = False
    loads_vary = True

    @property
    def limit(self) -> Limit:
        return Limit(self.duration, "duration", "shorten it")

    def __post_init__(self):
        _check_motion(self)


@dataclass(frozen=True, slots=True)
class BaseMotionControl(Control):
    """Supports that shake along ``direction`` for ``duration`` (s), by a ``sine``, a ``pulse`` or a ``file``, whose
    ``quantity`` is an acceleration, velocity or displacement, times ``scale``; ``restitution`` as in `DynamicControl`.

    The file is a CSV whose first line names columns and units, "time [s], acceleration [g]", or a PEER record (.AT2,
    .VT2, .DT2). ``columns`` picks two of its columns by name, time first. Up to three directions have a component each:
    of a file each, or of one, whose ``columns`` are time and one for each. All is at rest before time zero; a record
    is zero after its end. ``baseline``: accelerations without the line that would leave the supports moving or moved.
    """

    duration: float
    direction: Vector | tuple[Vector, ...]
    file: str | tuple[str, ...] | None = None
    sine: Sine | None = None
    pulse: Pulse | None = None
    quantity: str = "acceleration"
    restitution: float = 0.5
    columns: tuple[str, ...] | None = None
    scale: float = 1.0
    baseline: bool = False

    kind = "base-motion"
    curve = Curve(None, "m/s2", "acceleration of the supports along the (first) direction of their motion", FURTHEST)
    drives = SUPPORTS
    loads_vary = True
    shakes = True

    @property
    def limit(self) -> Limit:
        return Limit(self.duration, "duration", "shorten it")

    def __post_init__(self):
        _check_motion(self)
        several = isinstance(self.direction, list | tuple) and any(isinstance(v, list | tuple) for v in self.direction)
        given = self.direction if several else (self.direction,)
        require(len(given) <= 3, "direction", self.direction, "the supports move along one to three directions")
        directions = tuple(direction("direction", v) for v in given)
        assign(self, direction=directions if several else directions[0], scale=real("scale", self.scale))
        one_of("quantity", self.quantity, QUANTITIES)
        if isinstance(self.file, list | tuple):
            assign(self, file=tuple(check_name(f"file[{i}]", name) for i, name in enumerate(self.file)))
            require(len(self.file) == len(directions), "file", list(self.file), "it must name one for each direction")
        elif self.file is not None:
            check_name("file", self.file)
        values = len(directions) if isinstance(self.file, str) else 1
        assign(self, columns=checked_columns(self.columns, self.file, values))
        needed = "one file for several directions needs them: of time, and one for each direction"
        require(values == 1 or self.columns is not None, "columns", self.columns, needed)
        require_type(self.sine is None or isinstance(self.sine, Sine), "sine", self.sine, "a Sine")
        require_type(self.pulse is None or isinstance(self.pulse, Pulse), "pulse", self.pulse, "a Pulse")
        sources = [key for key in ("file", "sine", "pulse") if getattr(self, key) is not None]
        require(len(sources) == 1, "control", sources, "a base motion needs exactly one of file, sine and pulse")
        check_baseline(self.baseline, self.file, self.quantity)
        moves = self.pulse is None or self.quantity != "displacement"
        require(moves, "quantity", self.quantity, "a pulse of displacement has no finite velocity; use another")
        alone = self.file is not None or len(directions) == 1
        require(alone, "direction", self.direction, "a sine or a pulse has one direction, which may be inclined")

    @property
    def components(self) -> tuple[tuple[Vector, str | None, tuple[str, str] | None], ...]:
        """Direction, file, and its columns of time and values, of every component."""
        directions: Any = self.direction if isinstance(self.direction[0], tuple) else (self.direction,)
        files = self.file if isinstance(self.file, tuple) else (self.file,) * len(directions)
        columns: Any = self.columns
        if columns is None or isinstance(self.file, tuple):
            names: Any = (columns,) * len(directions)
        else:
            names = tuple((columns[0], value) for value in columns[1:])
        return tuple(zip(directions, files, names, strict=True))


@dataclass(frozen=True, slots=True)
class SettlementControl(Control):
    """Supports that settle: named ``supports`` move by ``displacement`` (m) and turn by ``rotation``, all else loaded
    as it is. ``motions`` has further supports that move differently at the same time.

    ``quasi_static`` goes from equilibrium to equilibrium in the deformed geometry, until the motion is complete or the
    structure comes down, whose settlement it finds to ``tolerance``. Else the supports move in real time at ``rate``
    (m/s, of the point that moves furthest), with contact ``damping`` as in `TiltControl`.
    """

    supports: tuple[str, ...] = ()
    displacement: Vector | None = None
    rotation: Turn | None = None
    motions: tuple[SupportPath, ...] = ()
    quasi_static: bool = True
    rate: float | None = None
    tolerance: float = 5.0e-3
    damping: float = 0.05

    kind = "settlement"
    curve = Curve(
        "reaction along the motion", "N",
        "force of the structure on the supports that move, along their motion: its work over the displacement",
        "displacement of the supports",
    )  # fmt: skip
    drives = SUPPORTS

    @property
    def regime(self) -> Regime:
        return SETTLEMENT if self.quasi_static else REAL_TIME

    @property
    def loads_vary(self) -> bool:
        return not self.quasi_static

    @property
    def support_paths(self) -> tuple[SupportPath, ...]:
        own = (SupportPath(self.supports, self.displacement, self.rotation),) if self.supports else ()
        return own + self.motions

    def __post_init__(self):
        assign(self, motions=members_of("motions", self.motions, SupportPath))
        if self.supports:
            path = SupportPath(self.supports, self.displacement, self.rotation)
            assign(self, supports=path.supports, displacement=path.displacement)
        else:
            for key in ("displacement", "rotation"):
                value = getattr(self, key)
                require(value is None, key, value, "supports must say which blocks or groups move so")
        named = "name the supports that move, or give motions"
        require(bool(self.support_paths), "supports", list(self.supports), named)
        require_type(isinstance(self.quasi_static, bool), "quasi_static", self.quasi_static, "true or false")
        assign_within(self, "tolerance", 1e-5, 0.1, "it is a relative error between 1e-5 and 0.1")
        assign_within(self, "damping", 0.0, 0.9, DAMPING)
        if self.quasi_static:
            in_time = "it belongs to a settlement in real time: quasi_static = false"
            require(self.rate is None, "rate", self.rate, in_time)
            return
        if self.rate is None:
            raise ScenarioError("missing key 'rate': a settlement in real time (quasi_static = false) needs it, in m/s")
        assign_positive(self, "rate", "m/s")


def _searched(control: TiltControl | PushoverControl) -> Regime:
    if not control.quasi_static:
        return REAL_TIME
    return LOAD_PATH if control.large_displacements else PATH_FOLLOWING


def _check_large_displacements(control: Control) -> None:
    """It is true or false, and an end of the path is not asked for beside it: a load path ends at its limit."""
    given = control.large_displacements  # type: ignore[attr-defined]
    require_type(isinstance(given, bool), "large_displacements", given, "true or false")
    end = getattr(control, "displacement", None)
    if control.in_deformed_geometry and end is not None:
        raise ScenarioError(
            f"displacement = {end:g}: a search in the deformed geometry ends where the blocks come down; leave it out, "
            "or take quasi_static = false"
        )


def _check_motion(control: DynamicControl | BaseMotionControl) -> None:
    duration = real("duration", control.duration)
    require(duration > 0.0, "duration", duration, "it must be longer than 0 s")
    assign(control, duration=duration)
    bound = "the speed after over the speed before an impact lies between 0.14 (critically damped) and 1"
    assign_within(control, "restitution", 0.14, 1.0, bound)


CONTROLS: dict[str, type[Control]] = {
    control.kind: control
    for control in (
        YieldControl,
        DisplacementControl,
        StaticsControl,
        TiltControl,
        PushoverControl,
        DynamicControl,
        BaseMotionControl,
        SettlementControl,
    )
}
