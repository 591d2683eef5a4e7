"""A scenario as plain frozen data: the names of the TOML file, SI units, no files, no physics.

``toml.load`` makes a :class:`Scenario` from a TOML file; one can also be written in Python, with lists or arrays for
vectors, which are converted to tuples of floats. Types, lengths, bounds and names are checked on construction: a
negative friction, a number given as text or a load on a block that does not exist is an error here.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from numbers import Integral
from typing import TYPE_CHECKING, Generic

from dembrick.errors import ScenarioError
from dembrick.scenario.blocks import Block, Vector
from dembrick.scenario.cad_models import CadModel
from dembrick.scenario.checks import (
    assign,
    check_name,
    members_of,
    one_line,
    one_of,
    real,
    require,
    require_type,
    show,
    vector,
)
from dembrick.scenario.controls import (  # noqa: F401 (all parts of a scenario can be imported from here)
    BaseMotionControl,
    Control,
    DisplacementControl,
    DynamicControl,
    Pulse,
    Sine,
    StaticsControl,
    TiltControl,
    YieldControl,
)
from dembrick.scenario.declared import (
    check_keys,
    declare,
    naming,
    not_negative,
    positive,
    table,
    unit_vector,
    vector_of,
)
from dembrick.scenario.generators import GENERATORS, Arch, Dome, Stack, Wall, sizes_of
from dembrick.scenario.generators.corners import lay
from dembrick.scenario.joint_laws import FORMULATIONS, PRESSURES, JointLaw, JointOverride  # noqa: F401
from dembrick.scenario.memory import check_memory
from dembrick.scenario.pressures import Fill, Pressure
from dembrick.scenario.references import Fault, ScenarioErrors, check_references, unknown
from dembrick.scenario.stages import check_stages, controls_of, in_deformed_geometry, stages_of
from dembrick.scenario.ties import Tie
from dembrick.scenario.time_functions import checked_columns

if TYPE_CHECKING:  # the control of a bare Scenario may be of any kind; typing has default= from Python 3.13 on
    from typing_extensions import TypeVar

    AControl = TypeVar("AControl", bound=Control, covariant=True, default=Control)
else:
    from typing import TypeVar

    AControl = TypeVar("AControl", bound=Control, covariant=True)

CHANNELS = ("joints", "energy", "frames", "velocity", "contacts")  # of the record; the last three are per frame


def _weight(key: str, value, label: str) -> float:
    weight = real(key + label, value)
    require(weight != 0.0, key + label, weight, "it must not be 0")
    return weight


def _step_factor(key: str, value, _: str) -> float:
    factor = real(key, value)
    require(0.0 < factor < 1.0, key, factor, "it must lie between 0 and 1, the critical time step")
    return factor


def _rows(key: str, value, _: str) -> int:
    require_type(isinstance(value, Integral) and not isinstance(value, bool), key, value, "a whole number")
    require(1 <= value <= 10_000_000, key, value, "it must lie between 1 and 10 million")
    return int(value)


@dataclass(frozen=True, slots=True)
class Material:
    """Material of a block. ``density`` in kg/m3."""

    density: float = field(metadata=positive("kg/m3", "mass per volume"))

    def __post_init__(self):
        check_keys(self)


@dataclass(frozen=True, slots=True)
class Load:
    """A dead load: ``force`` (N, world) on ``block`` at ``point`` (m, world at the start; None: the centroid).

    ``block`` may name a group: then the whole force acts on each of its blocks, at the centroid. In runs of kind
    dynamic and base-motion, and in a settlement in real time, the force may vary: it is multiplied by a ``sine``, or by
    the values of a CSV file ``history`` ("time [s], factor [1]"; ``columns`` picks two by name), linear between its
    lines. ``stages``: numbers of the stages in which the load acts, None for all.
    """

    block: str = field(
        metadata=naming("a block or group", "what it acts on; each block of a group bears the whole force")
    )
    force: Vector = field(metadata=vector_of("N", "force in world axes"))
    point: Vector | None = field(
        default=None, metadata=vector_of("m", "where it acts, world position at the start; left out, at the centroid")
    )
    sine: Sine | None = field(default=None, metadata=table(Sine, "factor of the force over time, in runs in real time"))
    history: str | None = field(
        default=None, metadata=naming("a path", "CSV file with the factor over time, in runs in real time")
    )
    columns: tuple[str, str] | None = field(
        default=None, metadata=declare("2 names", "the columns of time and of values in the file")
    )
    stages: tuple[int, ...] | None = field(
        default=None, metadata=stages_of("the stages in which it acts; left out, all")
    )

    def __post_init__(self):
        label = f" of the load on block {show(check_name('block', self.block))}"
        check_keys(self, label)
        assign(self, columns=checked_columns(self.columns, self.history))
        both = self.sine is not None and self.history is not None
        require(not both, f"history{label}", self.history, "a load has either a sine or a history")

    @property
    def varies(self) -> bool:
        """Whether the load changes with time."""
        return self.sine is not None or self.history is not None


@dataclass(frozen=True, slots=True)
class Actuator:
    """An actuator (``name``) on a ``block``: a spring at a material ``point`` (m, world at the start), along a
    ``direction`` fixed in the world.

    ``direction`` is stored at length 1. All actuators of a stage are one load system; this one carries ``weight`` times
    its load V. ``stages``: numbers of the stages in which it acts, None for all that drive actuators.
    """

    name: str = field(metadata=naming("text", "its name"))
    block: str = field(metadata=naming("a block", "the block it pushes"))
    point: Vector = field(
        metadata=vector_of("m", "where it pushes, world position at the start, in the block or on a face")
    )
    direction: Vector = field(metadata=unit_vector("direction of the push, in world axes; scaled to length 1"))
    weight: float = field(default=1.0, metadata=declare("not 0", "its force is weight times V", "1", _weight))
    stages: tuple[int, ...] | None = field(
        default=None, metadata=stages_of("the stages in which it pushes; left out, all that drive actuators")
    )

    def __post_init__(self):
        label = f" of actuator {show(check_name('name', self.name))}"
        check_keys(self, label)


@dataclass(frozen=True, slots=True)
class ControlPoint:
    """A material ``point`` (m, world at the start; None: the centroid) of a ``block``, whose displacement is recorded
    as ``name``."""

    name: str = field(metadata=naming("text", "its name"))
    block: str = field(metadata=naming("a block", "the block it belongs to"))
    point: Vector | None = field(
        default=None, metadata=vector_of("m", "world position at the start; left out, the centroid")
    )

    def __post_init__(self):
        label = f" of control point {show(check_name('name', self.name))}"
        check_keys(self, label)


@dataclass(frozen=True, slots=True)
class Solver:
    """``step_factor``: time step over the critical one."""

    step_factor: float = field(
        default=0.9, metadata=declare("0 to 1", "time step over the critical time step", "1", _step_factor)
    )

    def __post_init__(self):
        check_keys(self)


@dataclass(frozen=True, slots=True)
class Output:
    """Output of a run. ``channels``: "joints" (resultants, one row each), "energy", "frames" (motion of the blocks),
    "velocity" and "contacts" (contact forces) in every frame; time, load and displacement are always recorded.

    ``rows`` and ``frames``: least numbers for a run in time that is not over before its time; more are recorded if the
    steps or rows are no multiple of them. A search records a row at every step.
    ``checkpoint``: seconds between two checkpoints of a run that writes a history.
    """

    channels: tuple[str, ...] = field(
        default=("joints", "energy", "frames", "velocity"),
        metadata=declare(
            "joints, energy, frames, velocity, contacts", "what is recorded besides time, load and displacement"
        ),
    )
    rows: int = field(
        default=1000,
        metadata=declare(
            "1 to 10 million", "at least so many rows of a whole run in time; a search keeps every step", "1", _rows
        ),
    )
    frames: int = field(
        default=200,
        metadata=declare(
            "1 to rows",
            "at least so many frames of the motion, each at a row: 150 of 1000 rows are every sixth, 167",
            "1",
            _rows,
        ),
    )
    checkpoint: float = field(default=60.0, metadata=not_negative("s", "time between two checkpoints"))

    def __post_init__(self):
        assign(self, channels=members_of("channels", self.channels, str))
        for i, channel in enumerate(self.channels):
            one_of(f"channels[{i}]", channel, CHANNELS)
        for channel in ("velocity", "contacts"):
            framed = channel not in self.channels or "frames" in self.channels
            require(framed, "channels", self.channels, f'"{channel}" is recorded in frames, so "frames" must be there')
        check_keys(self)
        require(
            self.frames <= self.rows,
            "frames",
            self.frames,
            f"it must be at most rows = {self.rows}, as frames are taken at rows",
        )


@dataclass(frozen=True, slots=True, repr=False)
class Scenario(Generic[AControl]):
    """One complete test: the blocks and their joints, the loads, and what is done to them.

    ``title`` is one line, ``gravity`` a vector (m/s2); ``joint`` is the law of all joints that no entry of ``joints``
    overrides, ``materials`` maps names to materials. ``loads``, ``pressures``, ``ties`` and ``fills`` act on the
    blocks, ``actuators`` push them; displacements of ``control_points`` are recorded. ``walls``, ``stacks``, ``arches``
    and ``domes`` are generators of blocks. ``solver`` sets the step size, ``output`` what is recorded.

    ``text`` is the TOML source and ``path`` its file (both None for a scenario written in Python). ``files`` maps names
    of files to paths, for those restored from a history; other files are found relative to ``path``.

    Two scenarios are equal if their contents are, whatever their source. ``all_blocks`` holds ``blocks``, then those of
    the generators (walls, stacks, arches, domes) and of the CAD ``models``, in the order in which they are written;
    ``remarks`` concern gaps of the models. ``supports`` names blocks and groups that are fixed.
    ``groups`` maps the name of every group to the indices of its blocks in ``all_blocks``. Groups come from ``group``
    keys and from dots in names: "wall.3.7" is in "wall" and "wall.3" (unless a block has that name).
    ``stages``: controls carried out before ``control``. ``as_read``: the materials of a scenario that was read from its
    ``text`` (the one part of it that can be changed in place); None if it was made otherwise. ``among``: for a scenario
    that is one stage of another, the controls of all stages; joints and contact points are those of all.
    """

    title: str = field(metadata=declare("one line", "what is shown on plots and pages"))
    gravity: Vector = field(
        metadata=declare("3 numbers", "acceleration of gravity in world axes, usually [0, 0, -9.81]", "m/s2")
    )
    joint: JointLaw = field(metadata=declare("table", "joint law of every pair of blocks that no [[joints]] names"))
    materials: dict[str, Material] = field(metadata=declare("tables", "materials by name, [materials.NAME]"))
    blocks: tuple[Block, ...] = field(default=(), metadata=declare("tables", "single blocks"))
    control: AControl = field(
        default=None, metadata=declare("table", "what is done to the blocks; its kind decides which keys it has")
    )  # type: ignore[assignment]  # required, but must stand after a field with a default
    joints: tuple[JointOverride, ...] = field(
        default=(), metadata=declare("tables", "joint laws of some pairs, in place of the default")
    )
    loads: tuple[Load, ...] = field(default=(), metadata=declare("tables", "dead loads, constant or varying in time"))
    actuators: tuple[Actuator, ...] = field(
        default=(), metadata=declare("tables", "actuators; all of them are one load system with the multiplier V")
    )
    solver: Solver = field(default_factory=Solver, metadata=declare("table", "numerical choices"))
    output: Output = field(default_factory=Output, metadata=declare("table", "what is recorded"))
    path: str | None = field(default=None, compare=False)
    text: str | None = field(default=None, compare=False, repr=False)
    files: Mapping[str, str] = field(default_factory=dict, compare=False, repr=False)
    walls: tuple[Wall, ...] = field(
        default=(),
        metadata=declare("tables", "walls of coursed blocks; two whose ends overlap meet in bond"),
    )
    stacks: tuple[Stack, ...] = field(default=(), metadata=declare("tables", "equal blocks on top of one another"))
    arches: tuple[Arch, ...] = field(default=(), metadata=declare("tables", "circular arches"))
    domes: tuple[Dome, ...] = field(default=(), metadata=declare("tables", "spherical domes"))
    supports: tuple[str, ...] = field(default=(), metadata=declare("names", "blocks and groups that are fixed"))
    control_points: tuple[ControlPoint, ...] = field(
        default=(), metadata=declare("tables", "points whose displacement is recorded")
    )
    pressures: tuple[Pressure, ...] = field(
        default=(), metadata=declare("tables", "pressures on bare faces: constant, of a fluid or of a fill")
    )
    stages: tuple[Control, ...] = field(
        default=(),
        metadata=declare(
            "tables", "controls carried out before [control], one after the other; they have the same keys"
        ),
    )
    ties: tuple[Tie, ...] = field(
        default=(), metadata=declare("tables", "bars and cables between points of two blocks")
    )
    models: tuple[CadModel, ...] = field(
        default=(), metadata=declare("tables", "structures drawn in CAD, many solids in a file")
    )
    fills: tuple[Fill, ...] = field(
        default=(), metadata=declare("tables", "fills on the backs of arches and vaults: weight and earth pressure")
    )
    among: tuple[Control, ...] = field(default=(), compare=False, repr=False)
    all_blocks: tuple[Block, ...] = field(default=(), init=False, compare=False, repr=False)
    groups: dict[str, tuple[int, ...]] = field(default_factory=dict, init=False, compare=False, repr=False)
    remarks: tuple[str, ...] = field(default=(), init=False, compare=False, repr=False)
    as_read: dict[str, Material] | None = field(default=None, init=False, compare=False, repr=False)

    def __post_init__(self):
        one_line("title", self.title)
        assign(self, gravity=vector("gravity", self.gravity))
        require_type(isinstance(self.joint, JointLaw), "joint", self.joint, "a JointLaw")
        require_type(isinstance(self.control, Control), "control", self.control, "one of the controls")
        require_type(isinstance(self.solver, Solver), "solver", self.solver, "a Solver")
        require_type(isinstance(self.output, Output), "output", self.output, "an Output")
        require_type(isinstance(self.materials, dict), "materials", self.materials, "a mapping of names to Material")
        members_of("materials", list(self.materials.values()), Material)
        for name in self.materials:
            check_name("name of a material", name)
        lists = {"blocks": Block, "joints": JointOverride, "loads": Load, "actuators": Actuator, "supports": str}
        lists |= {"control_points": ControlPoint, "pressures": Pressure, "stages": Control, "ties": Tie}
        lists |= {"models": CadModel, "fills": Fill}
        for key, kind in (lists | GENERATORS).items():
            assign(self, **{key: members_of(key, getattr(self, key), kind)})
        controls: tuple[Control, ...] = (*self.stages, self.control)
        for control in controls:
            if control.tilt_axis is not None:
                along = abs(sum(a * g for a, g in zip(control.tilt_axis, self.gravity, strict=True)))
                crosses = along < (1.0 - 1e-12) * math.hypot(*self.gravity)
                require(
                    crosses, "control.axis", control.tilt_axis, "it is parallel to gravity, which a tilt has to turn"
                )
        *before, last = in_deformed_geometry(controls_of(self))
        assign(self, stages=tuple(before), control=last)
        check_stages(self)
        self._lay()
        if not self.all_blocks:
            raise ScenarioError("a scenario needs at least one block")
        check_references(self)

    def __repr__(self) -> str:
        blocks = f"{len(self.all_blocks)} block{'s' if len(self.all_blocks) != 1 else ''}"
        return f"<Scenario {self.title!r}: {self.control.kind}, {self.joint.formulation}, {blocks}>"

    def _lay(self):
        """Build the blocks of the generators, if memory is sufficient, and collect the groups."""
        counts = [
            (f"{key}.{one.name}: {sizes_of(one)}", one.count()) for key in GENERATORS for one in getattr(self, key)
        ]
        check_memory(counts, len(self.blocks))
        blocks = [*self.blocks, *lay(self.walls)]
        plain: tuple[Stack | Arch | Dome, ...] = (*self.stacks, *self.arches, *self.domes)
        for generator in plain:
            blocks += generator.build()
        for number, model in enumerate(self.models, 1):
            try:
                solids, remarks = model.build(self.path_of(model.file))
            except ScenarioError as error:
                raise ScenarioErrors([Fault(f"file of model {show(model.name)}: {error}", "models", number)]) from None
            blocks += solids
            assign(self, remarks=(*self.remarks, *remarks))
        assign(self, all_blocks=tuple(blocks), groups=_groups(blocks))
        if self.supports:
            numbers = {block.name: i for i, block in enumerate(blocks)}
            for name in self.supports:
                if message := unknown("supports", name, numbers, self.groups):
                    raise ScenarioError(message)
                for i in self.groups.get(name) or (numbers[name],):
                    blocks[i] = replace(blocks[i], fixed=True)
            assign(self, all_blocks=tuple(blocks))

    def path_of(self, name: str) -> str:
        """Path of a file that the scenario names: the one in ``files``, or relative to the scenario's own file."""
        return self.files.get(name) or os.path.join(os.path.dirname(self.path or ""), name)

    def members(self, name: str) -> tuple[int, ...]:
        """Indices in ``all_blocks`` of the blocks that ``name``, a group or a single block, refers to."""
        if name in self.groups:
            return self.groups[name]
        return tuple(i for i, block in enumerate(self.all_blocks) if block.name == name)


def _groups(blocks: list[Block]) -> dict[str, tuple[int, ...]]:
    """Groups, from ``group`` keys and from dots in names, each with the indices of its blocks."""
    found: dict[str, list[int]] = {}
    names = {block.name for block in blocks}
    for i, block in enumerate(blocks):
        own = set() if block.group is None else {block.group}
        stem = block.name.rpartition(".")[0]
        while stem:
            if stem not in names:
                own.add(stem)
            stem = stem.rpartition(".")[0]
        for name in own:
            found.setdefault(name, []).append(i)
    return {name: tuple(members) for name, members in found.items()}
