"""Base class of all controls: regime, recorded curve, end of the run, what is driven and what is needed."""

from __future__ import annotations

from typing import ClassVar, NamedTuple

from dembrick.scenario.blocks import Vector
from dembrick.scenario.declared import check_keys, positive, truth, within
from dembrick.scenario.time_functions import SupportPath

STEEPEST = 90.0  # deg: a tilt without collapse ends there

# what a control drives, and how it ends: the status of its result
ACTUATORS, EVERY_BLOCK, SUPPORTS, NOTHING = "actuators", "every block", "supports", "nothing"
YIELD, COLLAPSE, COMPLETED = "yield", "collapse", "completed"


class Regime(NamedTuple):
    """How a control is carried out; a driver in ``runs.drivers`` registers for it.

    ``quasi_static``: every block needs a chain of joints to a support. ``real_time``: blocks move in time, separate and
    meet again. ``counts_equilibria``: the record is numbered by equilibria instead of times. ``small_displacements``:
    the geometry stays that of the start, and small rotations are added up. ``balances_energy``: energies are recorded.
    ``stands_or_falls``: the result is whether the blocks stand, and not a load.

    A regime that is both quasi-static and in real time follows equilibria in the deformed geometry.
    """

    name: str
    quasi_static: bool = True
    real_time: bool = False
    counts_equilibria: bool = False
    small_displacements: bool = False
    balances_energy: bool = True
    stands_or_falls: bool = True

    @property
    def kinematics(self) -> str:
        """The kinematics in words, as written in histories."""
        return "small displacements" if self.small_displacements else "finite rotations"


LIMIT_LOAD = Regime("limit load", counts_equilibria=True, small_displacements=True, stands_or_falls=False)
CONSTANT_RATE = Regime("constant rate", stands_or_falls=False)
PATH_FOLLOWING = Regime("path following", counts_equilibria=True, small_displacements=True, stands_or_falls=False)
DEAD_LOAD = Regime("dead load", small_displacements=True)
LOAD_PATH = Regime("load path", real_time=True, counts_equilibria=True, balances_energy=False, stands_or_falls=False)
DRIVEN_PATH = LOAD_PATH._replace(name="driven path")
DEFORMED_REST = Regime("rest in the deformed geometry", real_time=True, counts_equilibria=True, balances_energy=False)
ASK_FOR_REST = (DEAD_LOAD, DEFORMED_REST)  # under the dead loads alone
SETTLEMENT = Regime("settlement", real_time=True, counts_equilibria=True, balances_energy=False)
REAL_TIME = Regime("real time", quasi_static=False, real_time=True)
REGIMES = (
    LIMIT_LOAD,
    CONSTANT_RATE,
    PATH_FOLLOWING,
    DEAD_LOAD,
    LOAD_PATH,
    DRIVEN_PATH,
    DEFORMED_REST,
    SETTLEMENT,
    REAL_TIME,
)


class Curve(NamedTuple):
    """The curve that a control records: ``load`` and ``displacement`` name its axes, ``unit`` is the unit of the load
    in histories, ``about`` describes the load. ``load`` is None if no load grows: then displacement is plotted over
    time.
    """

    load: str | None
    unit: str
    about: str
    displacement: str


DRIVEN = "driven displacement"
TILT_LOAD = "load factor tan(angle)"  # name of the load of a tilting table
FURTHEST = "displacement of the block that moved furthest"
OF_ACTUATORS = Curve("load V", "N", "load multiplier V: the force of an actuator of weight 1", DRIVEN)
OF_PRESSURES = Curve("load factor V", "1", "load multiplier V: of the driven pressures", DRIVEN)


class Limit(NamedTuple):
    """Latest end of a run in real time (s), the key that sets it, and the remedy to suggest to the user."""

    seconds: float
    key: str
    remedy: str


# keys that several kinds share
TOLERANCE = within(
    1e-8, 0.1, "1", "relative half-width of the error bar of the limit",
    "it is a relative error between 1e-8 and 0.1; 1e-3 is usual",
)  # fmt: skip
DAMPING = within(
    0.0, 0.9, "1", "dashpot of a contact, as a fraction of critical damping (real time)",
    "it must lie between 0 and 0.9 of critical",
)  # fmt: skip
LARGE = truth("from equilibrium to equilibrium in the deformed geometry; true after a settlement")
DURATION = positive("s", "how long the run lasts", "it must be longer than 0 s")
RESTITUTION = within(
    0.14, 1.0, "1", "speed after over speed before a face-to-face impact",
    "the speed after over the speed before an impact must lie between 0.14 (critically damped) and 1",
)  # fmt: skip


class Control:
    """Base class of the kinds of control; a subclass overrides what differs."""

    __slots__ = ()

    kind: ClassVar[str]
    ends_with: ClassVar[str] = COMPLETED  # status of its result: YIELD, COLLAPSE or COMPLETED
    drives: ClassVar[str] = NOTHING  # or ACTUATORS, EVERY_BLOCK, SUPPORTS
    needs_supports: ClassVar[bool] = True  # whether a block must be fixed
    shakes: ClassVar[bool] = False  # whether the supports follow a base motion

    # keys that only some kinds have
    tolerance: float | None = None  # relative error of the result; None if it cannot be chosen
    rate: float | None = None  # speed, in the units of the kind; None without time
    duration: float = 0.0  # duration of the run (s); zero if it follows from the blocks
    travel: float | None = None  # travel of the actuators, one way (m); None without actuators
    damping: float | None = None  # of a contact, as a fraction of critical; None if it follows from a restitution
    restitution: float | None = None  # speed after over speed before an impact; None if contacts have another damping
    large_displacements: bool = False  # whether the deformed geometry was requested

    def __post_init__(self):
        check_keys(self)

    @property
    def regime(self) -> Regime:
        """How the control is carried out."""
        return REAL_TIME

    @property
    def in_deformed_geometry(self) -> bool:
        """Whether it follows equilibria in the deformed geometry."""
        return self.regime.quasi_static and self.regime.real_time

    @property
    def curve(self) -> Curve:
        """The recorded curve."""
        return OF_ACTUATORS

    @property
    def cyclic(self) -> bool:
        """Whether the load reverses, by a protocol."""
        return False

    @property
    def loads_vary(self) -> bool:
        """Whether loads may be functions of time."""
        return False

    @property
    def support_paths(self) -> tuple[SupportPath, ...]:
        """Supports that move relative to the others, and their motions."""
        return ()

    @property
    def pushes_as_tilted(self) -> bool:
        """Whether it is a tilt with small displacements, which pushes the blocks by the tangent of its angle."""
        return self.tilt_axis is not None and self.regime.small_displacements

    @property
    def tilt_axis(self) -> Vector | None:
        """Axis of a tilting table; None for other kinds."""
        return None

    @property
    def push_direction(self) -> Vector | None:
        """The direction in which every block is pushed; None for other kinds."""
        return None

    @property
    def limit(self) -> Limit | None:
        """Latest end of a run in real time; None if it follows from the blocks."""
        return None

    @property
    def files(self) -> tuple[str, ...]:
        """Names of the files that the control reads."""
        return ()

    @property
    def furthest(self) -> float | None:
        """Displacement of a block (m) at which the run ends; None if there is no such end."""
        return None

    def angle(self, load_factor: float) -> float | None:
        """Angle (deg) of a tilting table at a load factor; None for other kinds."""
        return None
