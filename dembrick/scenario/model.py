"""What a scenario says, as plain frozen data: the same names as in the TOML file, SI units, no files, no physics.

``toml.load`` makes a :class:`Scenario` out of a TOML file; it can as well be written in Python, with lists or
arrays for vectors, which become tuples of floats. Types, lengths, bounds and names are checked where they are made:
a negative friction, a number given as text or a load on a block that is not there never gets further than this module.
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
    assign_positive,
    check_name,
    direction,
    members_of,
    one_line,
    one_of,
    real,
    require,
    require_type,
    show,
    vector,
)
from dembrick.scenario.controls import (  # noqa: F401 (all that a scenario is made of can be imported from here)
    BaseMotionControl,
    Control,
    DisplacementControl,
    DynamicControl,
    Pulse,
    Sine,
    StaticsControl,
    TiltControl,
    YieldControl,
    checked_columns,
)
from dembrick.scenario.generators import GENERATORS, Arch, Dome, Stack, Wall
from dembrick.scenario.generators.corners import lay
from dembrick.scenario.joint_laws import FORMULATIONS, PRESSURES, JointLaw, JointOverride  # noqa: F401
from dembrick.scenario.memory import check_memory
from dembrick.scenario.pressures import Fill, Pressure
from dembrick.scenario.references import check_references, unknown
from dembrick.scenario.stages import check_stages, controls_of, in_deformed_geometry, stage_numbers
from dembrick.scenario.ties import Tie

if TYPE_CHECKING:  # a bare Scenario is one of any control; typing knows defaults from Python 3.13 on
    from typing_extensions import TypeVar

    AControl = TypeVar("AControl", bound=Control, covariant=True, default=Control)
else:
    from typing import TypeVar

    AControl = TypeVar("AControl", bound=Control, covariant=True)

CHANNELS = ("joints", "energy", "frames", "velocity", "contacts")  # of the record; the last three are of frames


@dataclass(frozen=True, slots=True)
class Material:
    """What a block is made of. ``density`` in kg/m3."""

    density: float

    def __post_init__(self):
        assign_positive(self, "density", "kg/m3")


@dataclass(frozen=True, slots=True)
class Load:
    """A dead load: ``force`` (N, world) on ``block`` at ``point`` (m, world at the start; None: the centroid).

    ``block`` may name a group: then each of its blocks bears that force, at its centroid. In a dynamic run ``sine``, or
    the values of a CSV file ``history`` ("time [s], factor [1]"; ``columns`` picks two by name), multiply the force.
    ``stages``: numbers of the stages in which it acts, None for all.
    """

    block: str
    force: Vector
    point: Vector | None = None
    sine: Sine | None = None
    history: str | None = None
    columns: tuple[str, str] | None = None
    stages: tuple[int, ...] | None = None

    def __post_init__(self):
        label = f" of the load on block {show(check_name('block', self.block))}"
        assign(self, force=vector("force", self.force, label=label))
        if self.point is not None:
            assign(self, point=vector("point", self.point, label=label))
        require_type(self.sine is None or isinstance(self.sine, Sine), f"sine{label}", self.sine, "a Sine")
        if self.history is not None:
            check_name(f"history{label}", self.history)
        assign(self, columns=checked_columns(self.columns, self.history))
        both = self.sine is not None and self.history is not None
        require(not both, f"history{label}", self.history, "a load has either a sine or a history")
        assign(self, stages=stage_numbers(f"stages{label}", self.stages))

    @property
    def varies(self) -> bool:
        """Whether it changes with time."""
        return self.sine is not None or self.history is not None


@dataclass(frozen=True, slots=True)
class Actuator:
    """An actuator (``name``) on a ``block``: a spring at a material ``point`` (m, world at the start), along a
    ``direction`` fixed in the world.

    ``direction`` is stored at length 1. The actuator carries ``weight`` times the load of the system of all actuators
    of a stage; ``stages``: numbers of those in which it does, None for all that drive actuators.
    """

    name: str
    block: str
    point: Vector
    direction: Vector
    weight: float = 1.0
    stages: tuple[int, ...] | None = None

    def __post_init__(self):
        label = f" of actuator {show(check_name('name', self.name))}"
        check_name(f"block{label}", self.block)
        weight = real(f"weight{label}", self.weight)
        require(weight != 0.0, f"weight{label}", weight, "it must not be 0")
        assign(self, point=vector("point", self.point, label=label), weight=weight)
        assign(self, direction=direction("direction", self.direction, label))
        assign(self, stages=stage_numbers(f"stages{label}", self.stages))


@dataclass(frozen=True, slots=True)
class ControlPoint:
    """A material ``point`` (m, world at the start; None: the centroid) of a ``block``, whose displacement is recorded
    under a ``name``."""

    name: str
    block: str
    point: Vector | None = None

    def __post_init__(self):
        label = f" of control point {show(check_name('name', self.name))}"
        check_name(f"block{label}", self.block)
        if self.point is not None:
            assign(self, point=vector("point", self.point, label=label))


@dataclass(frozen=True, slots=True)
class Solver:
    """``step_factor``: time step over the critical one."""

    step_factor: float = 0.9

    def __post_init__(self):
        value = real("step_factor", self.step_factor)
        require(0.0 < value < 1.0, "step_factor", value, "it must lie between 0 and 1, the critical time step")
        assign(self, step_factor=value)


@dataclass(frozen=True, slots=True)
class Output:
    """What is recorded. ``channels``: "joints" (resultants, a row each), "energy", "frames" (motion of the blocks),
    "velocity" and "contacts" (contact forces) in every frame; time, load and displacement always are.

    ``rows`` and ``frames``: about how many of a constant-rate test; a search keeps a row of every step.
    ``checkpoint``: seconds between two checkpoints of a run that writes a history.
    """

    channels: tuple[str, ...] = ("joints", "energy", "frames", "velocity")
    rows: int = 1000
    frames: int = 200
    checkpoint: float = 60.0

    def __post_init__(self):
        assign(self, channels=members_of("channels", self.channels, str))
        for i, channel in enumerate(self.channels):
            one_of(f"channels[{i}]", channel, CHANNELS)
        for channel in ("velocity", "contacts"):
            framed = channel not in self.channels or "frames" in self.channels
            require(framed, "channels", self.channels, f'"{channel}" is recorded in frames, so "frames" must be there')
        for key in ("rows", "frames"):
            value = getattr(self, key)
            require_type(isinstance(value, Integral) and not isinstance(value, bool), key, value, "a whole number")
            require(1 <= value <= 10_000_000, key, value, "it must lie between 1 and 10 million")
            assign(self, **{key: int(value)})
        assign(self, checkpoint=real("checkpoint", self.checkpoint))
        require(self.checkpoint >= 0.0, "checkpoint", self.checkpoint, "it must be at least 0 s")
        require(self.frames <= self.rows, "frames", self.frames, f"a frame is taken at a row, and rows = {self.rows}")


@dataclass(frozen=True, slots=True, repr=False)
class Scenario(Generic[AControl]):
    """One test, complete: the blocks and how they touch, the loads, and what is done to them.

    ``title`` in a line, ``gravity`` (m/s2); ``joint`` is the law of all joints but those that ``joints`` tell of,
    ``materials`` by their names. ``loads``, ``pressures``, ``ties`` and ``fills`` act on the blocks, ``actuators`` push
    them; ``control_points`` are watched. ``walls``, ``stacks``, ``arches`` and ``domes`` are generators of blocks.
    ``solver`` and ``output``: how fine the steps are, and what is recorded.

    ``text`` is the TOML it came from, ``path`` its file (both None when written in Python). ``files``: paths of the
    files that it names, by their names, if they came with it out of a history; others are looked for beside ``path``.

    Two scenarios are equal when they say the same, wherever they come from. ``all_blocks`` holds ``blocks`` and then
    what the generators lay: walls, stacks, arches, domes, and what ``models`` from CAD hold, in the order in which they
    are written; ``remarks`` are those on the gaps of the models. ``supports`` names blocks and groups that are fixed.
    ``groups`` maps the name of every group to the numbers of its blocks in ``all_blocks``: what ``group`` keys say, and
    for a name with dots in it, "wall.3.7", the parts before each dot, "wall" and "wall.3" (unless a block is named so).
    ``stages``: controls that are carried out before ``control``. ``as_read``: the materials of a scenario that was read
    from its ``text``, the one part of it that can be changed in place; None if it was made otherwise.
    """

    title: str
    gravity: Vector
    joint: JointLaw
    materials: dict[str, Material]
    blocks: tuple[Block, ...] = ()
    control: AControl = None  # type: ignore[assignment]  # is required, and only stands after a key that is not
    joints: tuple[JointOverride, ...] = ()
    loads: tuple[Load, ...] = ()
    actuators: tuple[Actuator, ...] = ()
    solver: Solver = field(default_factory=Solver)
    output: Output = field(default_factory=Output)
    path: str | None = field(default=None, compare=False)
    text: str | None = field(default=None, compare=False, repr=False)
    files: Mapping[str, str] = field(default_factory=dict, compare=False, repr=False)
    walls: tuple[Wall, ...] = ()
    stacks: tuple[Stack, ...] = ()
    arches: tuple[Arch, ...] = ()
    domes: tuple[Dome, ...] = ()
    supports: tuple[str, ...] = ()
    control_points: tuple[ControlPoint, ...] = ()
    pressures: tuple[Pressure, ...] = ()
    stages: tuple[Control, ...] = ()
    ties: tuple[Tie, ...] = ()
    models: tuple[CadModel, ...] = ()
    fills: tuple[Fill, ...] = ()
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
                require(crosses, "control.axis", control.tilt_axis, "it lies along gravity, which a tilt has to turn")
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
        """Build what the generators describe, if memory holds it, and gather the groups."""
        generators = [generator for key in GENERATORS for generator in getattr(self, key)]
        check_memory([(generator.name, generator.count()) for generator in generators], len(self.blocks))
        blocks = [*self.blocks, *lay(self.walls)]
        others: list[Stack | Arch | Dome] = [*self.stacks, *self.arches, *self.domes]
        for generator in others:
            blocks += generator.build()
        for model in self.models:
            solids, remarks = model.build(self.path_of(model.file))
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
        """The path of a file that the scenario names: the one that came with it, or beside the scenario's own."""
        return self.files.get(name) or os.path.join(os.path.dirname(self.path or ""), name)

    def members(self, name: str) -> tuple[int, ...]:
        """Numbers in ``all_blocks`` of the blocks that ``name`` stands for, a group or a single block."""
        if name in self.groups:
            return self.groups[name]
        return tuple(i for i, block in enumerate(self.all_blocks) if block.name == name)


def _groups(blocks: list[Block]) -> dict[str, tuple[int, ...]]:
    """Groups by ``group`` keys and by the dots in names, each with the numbers of its blocks."""
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
