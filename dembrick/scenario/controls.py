"""Kinds of control: what is done to the blocks, as plain frozen data.

Each class contains everything about its kind: how it is carried out (``regime``), what grows and in which unit
(``curve``), how it ends (``ends_with``), what it drives and needs (``drives``, ``needs_supports``). No other module
checks the name of a kind. Each field declares its key (`declared`): unit, range, meaning. A new kind is a class here,
an entry of `CONTROLS`, and, if no regime fits it, a driver in ``runs.drivers``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from dembrick.errors import ScenarioError
from dembrick.scenario.blocks import Vector
from dembrick.scenario.checks import assign, present, real, require
from dembrick.scenario.declared import (
    Key,
    check_keys,
    declare,
    positive,
    truth,
    unit_vector,
)
from dembrick.scenario.protocols import checked
from dembrick.scenario.regimes import (
    ACTUATORS,
    COLLAPSE,
    CONSTANT_RATE,
    DAMPING,
    DEAD_LOAD,
    DEFORMED_REST,
    DRIVEN,
    DRIVEN_PATH,
    DURATION,
    EVERY_BLOCK,
    FURTHEST,
    LARGE,
    LIMIT_LOAD,
    LOAD_PATH,
    PATH_FOLLOWING,
    REAL_TIME,
    RESTITUTION,
    STEEPEST,
    TILT_LOAD,
    TOLERANCE,
    YIELD,
    Control,
    Curve,
    Limit,
    Regime,
)
from dembrick.scenario.support_controls import BaseMotionControl, SettlementControl
from dembrick.scenario.time_functions import Pulse, Sine  # noqa: F401 (parts of controls, imported from here)


def _turning(meaning: str, unit: str) -> dict[str, Key]:
    """Metadata of a protocol."""
    return declare("numbers, or a path", meaning, unit, lambda key, value, _: checked(key, value))


def _check_tilt_rate(key: str, value: Any, label: str) -> float:
    found = real(key, value)
    require(found > 0.0, key, found, "it must be greater than 0 deg/s")
    require(found <= 10.0, key, found, "it must be at most 10 deg/s: a table tilts slowly")
    return found


@dataclass(frozen=True, slots=True)
class YieldControl(Control):
    """Compute the limit load to ``tolerance``, the relative half-width of its bracket; it needs no other settings.

    With ``large_displacements`` the limit is that of the deformed geometry, found by a path of equilibria.
    """

    tolerance: float = field(default=1.0e-3, metadata=TOLERANCE)
    large_displacements: bool = field(default=False, metadata=LARGE)

    kind = "yield"
    ends_with = YIELD
    drives = ACTUATORS

    @property
    def regime(self) -> Regime:
        return LOAD_PATH if self.large_displacements else LIMIT_LOAD


@dataclass(frozen=True, slots=True)
class DisplacementControl(Control):
    """A displacement-controlled test as in the laboratory: ``rate`` (m/s) over ``travel`` (m), with physical mass.

    With ``large_displacements`` it follows equilibria in the deformed geometry, as a slow test does. A cyclic test has
    a ``protocol`` in place of the travel: turning points (m) of the jack's end from its start, or a CSV file of a
    measured protocol with a column of displacement and optionally one of time. ``force_protocol`` (N), for the deformed
    geometry only, has turning points of V instead. In the deformed geometry no time passes and ``rate`` has no effect;
    travel and protocol are those of the pushed points, as there is no jack spring in between.
    """

    rate: float | None = field(
        default=None, metadata=positive("m/s", "speed of the actuators; not needed with large_displacements")
    )
    travel: float | None = field(default=None, metadata=positive("m", "how far the actuators move, one way"))
    large_displacements: bool = field(default=False, metadata=LARGE)
    protocol: tuple[float, ...] | str | None = field(
        default=None,
        metadata=_turning("turning points of a cyclic test, or a CSV file of measured ones", "m"),
    )
    force_protocol: tuple[float, ...] | str | None = field(
        default=None, metadata=_turning("turning points of V, with large_displacements", "N")
    )

    kind = "displacement"
    drives = ACTUATORS

    @property
    def regime(self) -> Regime:
        return DRIVEN_PATH if self.large_displacements else CONSTANT_RATE

    def __post_init__(self):
        check_keys(self)
        given = [key for key in ("travel", "protocol", "force_protocol") if getattr(self, key) is not None]
        if len(given) != 1:
            what = " and ".join(given) if given else "none"
            raise ScenarioError(
                f"a test by displacement needs one of travel, protocol and force_protocol; given: {what}"
            )
        if self.force_protocol is not None and not self.large_displacements:
            raise ScenarioError("force_protocol needs the deformed geometry; add large_displacements = true")
        if self.rate is None and not self.large_displacements:
            what = "a test at a constant rate needs it, in m/s; or give large_displacements = true"
            raise ScenarioError(f"missing key 'rate': {what}")

    @property
    def cyclic(self) -> bool:
        return self.travel is None

    @property
    def files(self) -> tuple[str, ...]:
        return tuple(one for one in (self.protocol, self.force_protocol) if isinstance(one, str))


@dataclass(frozen=True, slots=True)
class StaticsControl(Control):
    """Check whether the blocks stand under their dead loads; nothing is driven, and actuators carry nothing.

    ``large_displacements``: in the deformed geometry.
    """

    large_displacements: bool = field(default=False, metadata=LARGE)

    kind = "statics"

    @property
    def regime(self) -> Regime:
        return DEFORMED_REST if self.large_displacements else DEAD_LOAD


@dataclass(frozen=True, slots=True)
class TiltControl(Control):
    """Tilt a table with the supports about ``axis`` (right-hand rule) to the angle at which the blocks collapse.

    ``quasi_static``, the default without a ``rate``, finds that limit to ``tolerance`` and follows the path beyond it
    until a block has moved ``displacement`` (m), if that is given. Otherwise the table turns at ``rate`` (deg/s) in
    real time until a block has moved ``displacement`` relative to the table since equilibrium. ``damping``: dashpot of
    a contact as a fraction of critical damping for its two blocks. ``large_displacements``: limit of the deformed
    geometry.
    """

    axis: Vector = field(metadata=unit_vector("axis of the table through the origin, right-hand rule"))
    rate: float | None = field(
        default=None,
        metadata=declare(
            "0 to 10",
            "how fast the table turns, in real time; left out, the limit itself is found",
            "deg/s",
            _check_tilt_rate,
        ),
    )
    displacement: float | None = field(
        default=None, metadata=positive("m", "the run ends when a block has moved this far relative to the table")
    )
    damping: float = field(default=0.05, metadata=DAMPING)
    quasi_static: bool | None = field(
        default=None,
        metadata=truth("find the limit angle itself, without time; the default if rate is left out"),
    )
    tolerance: float = field(default=1.0e-3, metadata=TOLERANCE)
    large_displacements: bool = field(default=False, metadata=LARGE)

    kind = "tilt"
    ends_with = COLLAPSE
    drives = EVERY_BLOCK

    @property
    def regime(self) -> Regime:
        return _searched(self)

    @property
    def curve(self) -> Curve:
        """Curve of a quasi-static search: it drives the blocks by their weights, as actuators would."""
        about = "load factor: the tangent of the angle of the table"
        return Curve(TILT_LOAD, "1", about, DRIVEN if self.quasi_static else FURTHEST)

    @property
    def tilt_axis(self) -> Vector:
        return self.axis

    @property
    def furthest(self) -> float | None:
        return self.displacement

    @property
    def limit(self) -> Limit:
        return Limit(STEEPEST / present(self.rate), "rate", "tilt faster")

    def angle(self, load_factor: float) -> float:
        return math.degrees(math.atan(load_factor))

    def __post_init__(self):
        check_keys(self)
        if self.quasi_static is None:
            assign(self, quasi_static=self.rate is None)
        _check_end(self, self.displacement)
        for name, value, unit in (("rate", self.rate, "deg/s"), ("displacement", self.displacement, "m")):
            needed = f"a tilt in real time needs it, in {unit}"
            require(self.quasi_static or value is not None, name, value, needed)


@dataclass(frozen=True, slots=True)
class PushoverControl(Control):
    """Push every block along ``direction`` by the same share of its weight, the load factor, up to the limit.

    ``tolerance`` is the relative half-width of the bracket of the limit. If ``displacement`` (m) is given, the curve
    continues until a block has moved that far from the dead-load equilibrium. With ``quasi_static`` false the blocks
    are pushed in real time, at the ``rate`` (m/s) of their mean displacement, with contact ``damping`` as in
    `TiltControl`. ``large_displacements``: limit of the deformed geometry.
    """

    direction: Vector = field(
        metadata=unit_vector("direction in which every block is pushed by the same share of its weight")
    )
    displacement: float | None = field(
        default=None, metadata=positive("m", "the curve continues until a block has moved this far")
    )
    quasi_static: bool = field(default=True, metadata=truth("find the limit itself; false: push in real time"))
    tolerance: float = field(default=1.0e-3, metadata=TOLERANCE)
    rate: float | None = field(
        default=None, metadata=positive("m/s", "how fast the mean displacement grows, in real time")
    )
    damping: float = field(default=0.05, metadata=DAMPING)
    large_displacements: bool = field(default=False, metadata=LARGE)

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

    @property
    def furthest(self) -> float | None:
        return self.displacement

    def __post_init__(self):
        check_keys(self)
        _check_end(self, self.displacement)
        if self.quasi_static:
            require(self.rate is None, "rate", self.rate, "it belongs to a push in real time: quasi_static = false")
            return
        for name, value, unit in (("rate", self.rate, "m/s"), ("displacement", self.displacement, "m")):
            require(value is not None, name, value, f"a push in real time needs it, in {unit}")


@dataclass(frozen=True, slots=True)
class DynamicControl(Control):
    """Free motion for ``duration`` (s) from the initial velocities of the blocks, under gravity and loads.

    ``restitution``: ratio of the speeds after and before a face-to-face impact of two blocks.
    """

    duration: float = field(metadata=DURATION)
    restitution: float = field(default=0.5, metadata=RESTITUTION)

    kind = "dynamic"
    curve = Curve(None, "1", "zero: no load grows", FURTHEST)
    needs_supports = False
    loads_vary = True

    @property
    def limit(self) -> Limit:
        return Limit(self.duration, "duration", "shorten it")


def _searched(control: TiltControl | PushoverControl) -> Regime:
    if not control.quasi_static:
        return REAL_TIME
    return LOAD_PATH if control.large_displacements else PATH_FOLLOWING


def _check_end(control: Control, end: float | None) -> None:
    """Refuse an end displacement in the deformed geometry: such a load path ends at its limit."""
    if control.in_deformed_geometry and end is not None:
        raise ScenarioError(
            f"displacement = {end:g}: a search in the deformed geometry ends at collapse; leave it out, or give "
            "quasi_static = false"
        )


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
