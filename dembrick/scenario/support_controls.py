"""Controls that move the supports: base motion and settlement."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from dembrick.errors import ScenarioError
from dembrick.scenario.blocks import Vector
from dembrick.scenario.checks import assign, check_name, direction, require
from dembrick.scenario.declared import check_keys, choice, declare, number, positive, table, tables, truth, within
from dembrick.scenario.regimes import (
    DAMPING,
    DURATION,
    FURTHEST,
    REAL_TIME,
    RESTITUTION,
    SETTLEMENT,
    SUPPORTS,
    Control,
    Curve,
    Limit,
    Regime,
)
from dembrick.scenario.time_functions import (
    MOVED,
    SUPPORTS_OF,
    TURNED,
    Pulse,
    Sine,
    SupportPath,
    Turn,
    check_baseline,
    checked_columns,
)

QUANTITIES = {"acceleration": "m/s2", "velocity": "m/s", "displacement": "m"}  # of a base motion, with their units


@dataclass(frozen=True, slots=True)
class BaseMotionControl(Control):
    """Shake the supports along ``direction`` for ``duration`` (s), by a ``sine``, a ``pulse`` or a ``file``, whose
    ``quantity`` is an acceleration, velocity or displacement, times ``scale``; ``restitution`` as in `DynamicControl`.

    The file is a CSV whose first line names columns and units, "time [s], acceleration [g]", or a PEER record (.AT2,
    .VT2, .DT2). ``columns`` picks two of its columns by name, time first. Up to three directions have one component
    each: from one file each, or from one file whose ``columns`` are time and one for each direction. Everything is at
    rest before time zero; a record is zero after its end. ``baseline``: subtract from the accelerations the straight
    line that makes the supports end at rest and undisplaced.
    """

    duration: float = field(metadata=DURATION)
    direction: Vector | tuple[Vector, ...] = field(
        metadata=declare(
            "3 numbers, or up to three such lists", "direction in which the supports shake, one per component", "1"
        )
    )
    file: str | tuple[str, ...] | None = field(
        default=None,
        metadata=declare(
            "a path, or one for each direction",
            "CSV with units, or a PEER record (.AT2, .VT2, .DT2); zero after its end",
        ),
    )
    sine: Sine | None = field(default=None, metadata=table(Sine, "or a sine"))
    pulse: Pulse | None = field(default=None, metadata=table(Pulse, "or a rectangular pulse"))
    quantity: str = field(default="acceleration", metadata=choice(tuple(QUANTITIES), "what file, sine or pulse give"))
    restitution: float = field(default=0.5, metadata=RESTITUTION)
    columns: tuple[str, ...] | None = field(
        default=None,
        metadata=declare("2 to 4 names", "the columns of time and of values in the file, one for each direction"),
    )
    scale: float = field(default=1.0, metadata=number("1", "factor on the file, sine or pulse"))
    baseline: bool = field(
        default=False,
        metadata=truth(
            "subtract a straight line from recorded accelerations, so that the supports end at rest where they began"
        ),
    )

    kind = "base-motion"
    curve = Curve(None, "m/s2", "acceleration of the supports along the (first) direction of their motion", FURTHEST)
    drives = SUPPORTS
    loads_vary = True
    shakes = True

    @property
    def limit(self) -> Limit:
        return Limit(self.duration, "duration", "shorten it")

    def __post_init__(self):
        check_keys(self)
        several = isinstance(self.direction, list | tuple) and any(isinstance(v, list | tuple) for v in self.direction)
        given = self.direction if several else (self.direction,)
        require(len(given) <= 3, "direction", self.direction, "the supports move along one to three directions")
        directions = tuple(direction("direction", v) for v in given)
        assign(self, direction=directions if several else directions[0])
        if isinstance(self.file, list | tuple):
            assign(self, file=tuple(check_name(f"file[{i}]", name) for i, name in enumerate(self.file)))
            require(
                len(self.file) == len(directions), "file", list(self.file), "it must name one file for each direction"
            )
        elif self.file is not None:
            check_name("file", self.file)
        values = len(directions) if isinstance(self.file, str) else 1
        assign(self, columns=checked_columns(self.columns, self.file, values))
        needed = "one file for several directions needs a column of time, and one for each direction"
        require(values == 1 or self.columns is not None, "columns", self.columns, needed)
        given_by = {"file": self.file, "sine": self.sine, "pulse": self.pulse}
        sources = [name for name, value in given_by.items() if value is not None]
        require(len(sources) == 1, "control", sources, "a base motion needs exactly one of file, sine and pulse")
        check_baseline(self.baseline, self.file, self.quantity)
        moves = self.pulse is None or self.quantity != "displacement"
        require(moves, "quantity", self.quantity, "a pulse of displacement has no finite velocity; use another")
        alone = self.file is not None or len(directions) == 1
        require(alone, "direction", self.direction, "a sine or a pulse has one direction, which may be inclined")

    @property
    def files(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(file for _, file, _ in self.components if file is not None))

    @property
    def components(self) -> tuple[tuple[Vector, str | None, tuple[str, str] | None], ...]:
        """Direction, file, and the file's columns of time and values, for every component."""
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
    """Settle supports: the named ``supports`` are displaced by ``displacement`` (m) and rotated by ``rotation`` under
    constant loads. ``motions`` has further supports with other motions at the same time.

    ``quasi_static`` follows equilibria in the deformed geometry until the motion is complete or the structure
    collapses; the settlement at collapse is found to ``tolerance``. Otherwise the supports move in real time at
    ``rate`` (m/s, of the point that moves furthest), with contact ``damping`` as in `TiltControl`.
    """

    supports: tuple[str, ...] = field(default=(), metadata=SUPPORTS_OF)
    displacement: Vector | None = field(default=None, metadata=MOVED)
    rotation: Turn | None = field(default=None, metadata=TURNED)
    motions: tuple[SupportPath, ...] = field(
        default=(), metadata=tables(SupportPath, "further supports that move differently at the same time")
    )
    quasi_static: bool = field(
        default=True,
        metadata=truth("from equilibrium to equilibrium in the deformed geometry; false: in real time"),
    )
    rate: float | None = field(default=None, metadata=positive("m/s", "how fast the supports move, in real time"))
    tolerance: float = field(
        default=5.0e-3,
        metadata=within(
            1e-5, 0.1, "1", "relative error of the settlement at collapse (quasi-static)",
            "it is a relative error between 1e-5 and 0.1",
        ),
    )  # fmt: skip
    damping: float = field(default=0.05, metadata=DAMPING)

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
        check_keys(self)
        if self.supports:
            path = SupportPath(self.supports, self.displacement, self.rotation)
            assign(self, supports=path.supports, displacement=path.displacement)
        else:
            for name, value in (("displacement", self.displacement), ("rotation", self.rotation)):
                require(value is None, name, value, "supports must name the blocks or groups that move")
        named = "name the supports that move, or give motions"
        require(bool(self.support_paths), "supports", list(self.supports), named)
        if self.quasi_static:
            in_time = "it belongs to a settlement in real time: quasi_static = false"
            require(self.rate is None, "rate", self.rate, in_time)
            return
        if self.rate is None:
            raise ScenarioError("missing key 'rate': a settlement in real time (quasi_static = false) needs it, in m/s")
