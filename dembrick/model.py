"""What a scenario says, as plain frozen data: the same names as in the TOML file, SI units, no files, no physics.

``scenario.load`` makes a :class:`Scenario` out of a TOML file; it can as well be written in Python, with lists or
arrays for vectors, which become tuples of floats. Types, lengths, bounds and names are checked where they are made:
a negative friction, a number given as text or a load on a block that is not there never gets further than this module.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from numbers import Integral, Real

from dembrick.errors import ScenarioError

FORMULATIONS = ("concave", "corrected", "corrected-shear", "convex", "distributed")
PRESSURES = ("full", "effective", "linear")
CHANNELS = ("joints", "energy", "frames", "velocity", "contacts")  # of the record; the last three are of frames

Vector = tuple[float, float, float]


def show(value: object) -> str:
    """A value as it stands in a message: as TOML writes it where that is short, never longer than a line."""
    if isinstance(value, bool):
        return "true" if value else "false"
    try:
        text = repr(list(value)) if isinstance(value, tuple) else repr(value)
    except (ValueError, RecursionError):  # integers of thousands of digits, lists in lists without end
        text = f"<{type(value).__name__}>"
    return text if len(text) <= 80 else text[:77] + "..."


def nearest(word: str, known: Iterable[str]) -> str:
    """The end of a message about an unknown ``word``: what was probably meant, else all that is known."""
    from difflib import SequenceMatcher

    def likeness(name: str) -> float:
        return SequenceMatcher(None, word.lower(), name.lower(), autojunk=False).ratio()

    ranked = sorted(known, key=likeness, reverse=True)
    if not ranked:
        return "there is none"
    if likeness(ranked[0]) >= 0.6:
        return f"did you mean {show(ranked[0])}?"
    more = ", ..." if len(ranked) > 20 else ""
    return f"known: {', '.join(show(name) for name in ranked[:20])}{more}"


def _require(condition: bool, key: str, value: object, bound: str) -> None:
    if not condition:
        raise ScenarioError(f"{key} = {show(value)} is out of range: {bound}")


def _type(condition: bool, key: str, value: object, wanted: str) -> None:
    if not condition:
        raise ScenarioError(f"{key} = {show(value)} is of the wrong type: it must be {wanted}")


def _number(key: str, value) -> float:
    """A finite float out of an integer or a float; a truth value or a text is neither."""
    _type(isinstance(value, Real) and not isinstance(value, bool), key, value, "a number")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    _require(math.isfinite(number), key, value, "it must be a finite number")
    return number


def _vector(key: str, value, length: int = 3, label: str = "") -> tuple[float, ...]:
    """A tuple of ``length`` finite floats; ``label`` says whose, " of block 'upper'"."""
    value = value.tolist() if hasattr(value, "tolist") else value
    _type(isinstance(value, list | tuple), key + label, value, f"a list of {length} numbers")
    _require(len(value) == length, key + label, value, f"it must have {length} numbers, not {len(value)}")
    return tuple(_number(f"{key}[{i}]{label}", component) for i, component in enumerate(value))


def _unit(vector: tuple[float, ...]) -> tuple[float, ...]:
    """The vector at length 1; one that has it already is left alone to the last bit (so text round trips exactly)."""
    if abs(math.hypot(*vector) - 1.0) <= 1e-15:
        return vector
    largest = max(abs(component) for component in vector)  # scaled first: the square of 1e-200 is nothing
    scaled = [component / largest for component in vector]
    length = math.hypot(*scaled)
    return tuple(component / length for component in scaled)


def _text(key: str, value) -> str:
    _type(isinstance(value, str), key, value, "a text")
    _require(value.isprintable(), key, value, "it must be one line of printable characters")
    return value


def _name(key: str, value) -> str:
    _require(_text(key, value) != "", key, value, "a name must not be empty")
    return value


def _choice(key: str, value, choices: tuple[str, ...]) -> None:
    _type(isinstance(value, str), key, value, f"one of {', '.join(choices)}")
    if value not in choices:
        raise ScenarioError(f"{key} = {show(value)} is not one of {', '.join(choices)}; {nearest(value, choices)}")


def _members(key: str, value, kind: type) -> tuple:
    _type(isinstance(value, list | tuple), key, value, f"a list of {kind.__name__}")
    for i, member in enumerate(value):
        _type(isinstance(member, kind), f"{key}[{i}]", member, f"a {kind.__name__}")
    return tuple(value)


def _set(instance: object, **values: object) -> None:
    for key, value in values.items():
        object.__setattr__(instance, key, value)


@dataclass(frozen=True, slots=True)
class Material:
    """What a block is made of. ``density`` in kg/m3."""

    density: float

    def __post_init__(self):
        _set(self, density=_number("density", self.density))
        _require(self.density > 0.0, "density", self.density, "it must be greater than 0 kg/m3")


@dataclass(frozen=True, slots=True)
class JointLaw:
    """Contact law of a joint: formulation, friction coefficient, stiffness per area (Pa/m).

    ``points`` (n along t1, m along t2) belongs to ``distributed`` only; None lets the tolerance choose.
    ``pressure`` belongs to ``convex`` only.
    """

    formulation: str
    friction: float
    normal_stiffness: float
    shear_stiffness: float
    points: tuple[int, int] | None = None
    pressure: str = "full"

    def __post_init__(self):
        _choice("formulation", self.formulation, FORMULATIONS)
        _set(self, friction=_number("friction", self.friction))
        _require(self.friction >= 0.0, "friction", self.friction, "it must be at least 0")
        for key in ("normal_stiffness", "shear_stiffness"):
            value = _number(key, getattr(self, key))
            _require(value > 0.0, key, value, "it must be greater than 0 Pa/m")
            _set(self, **{key: value})
        _choice("pressure", self.pressure, PRESSURES)
        convex = self.pressure == "full" or self.formulation == "convex"
        _require(convex, "pressure", self.pressure, "only formulation = 'convex' has a choice of pressure")
        if self.points is not None:
            self._check_points()

    def _check_points(self):
        value = self.points.tolist() if hasattr(self.points, "tolist") else self.points
        _require(self.formulation == "distributed", "points", value, "only formulation = 'distributed' has points")
        whole = isinstance(value, list | tuple) and all(
            isinstance(n, Integral) and not isinstance(n, bool) for n in value
        )
        _type(whole, "points", value, "a list of 2 whole numbers")
        _require(len(value) == 2, "points", value, f"it must have 2 whole numbers, not {len(value)}")
        _require(all(n >= 1 for n in value), "points", value, "both counts must be at least 1")
        _require(value[0] * value[1] <= 1_000_000, "points", value, "at most a million points a joint")
        _set(self, points=(int(value[0]), int(value[1])))


@dataclass(frozen=True, slots=True)
class JointOverride:
    """A law for the joints between two named blocks, in place of the default."""

    between: tuple[str, str]
    law: JointLaw

    def __post_init__(self):
        pair = self.between
        _type(isinstance(pair, list | tuple), "between", pair, "a list of two block names")
        _require(len(pair) == 2, "between", pair, f"it must name two blocks, not {len(pair)}")
        _set(self, between=tuple(_name(f"between[{i}]", name) for i, name in enumerate(pair)))
        _require(pair[0] != pair[1], "between", pair, "a block has no joint with itself")
        _type(isinstance(self.law, JointLaw), "law", self.law, "a JointLaw")


@dataclass(frozen=True, slots=True)
class Block:
    """A rigid block. ``box``: edge lengths (m), centred on ``position``; ``orientation``: quaternion, body to world.

    ``velocity`` (m/s) and ``angular_velocity`` (rad/s), both in world axes, start a dynamic run.
    """

    name: str
    material: str
    box: Vector
    position: Vector
    orientation: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    fixed: bool = False
    velocity: Vector = (0.0, 0.0, 0.0)
    angular_velocity: Vector = (0.0, 0.0, 0.0)

    def __post_init__(self):
        label = f" of block {show(_name('name', self.name))}"
        _name(f"material{label}", self.material)
        _type(isinstance(self.fixed, bool), f"fixed{label}", self.fixed, "true or false")
        for key in ("box", "position", "velocity", "angular_velocity"):
            _set(self, **{key: _vector(key, getattr(self, key), label=label)})
        for edge in self.box:
            _require(edge > 0.0, f"box{label}", self.box, "every edge must be longer than 0 m")
        quaternion = _vector("orientation", self.orientation, 4, label)
        unit = abs(math.hypot(*quaternion) - 1.0) < 1e-6
        _require(unit, f"orientation{label}", quaternion, "it must be a unit quaternion (w, x, y, z)")
        _set(self, orientation=_unit(quaternion))


@dataclass(frozen=True, slots=True)
class Load:
    """A dead load: ``force`` (N, world) on ``block`` at ``point`` (m, world at the start; None: the centroid)."""

    block: str
    force: Vector
    point: Vector | None = None

    def __post_init__(self):
        label = f" of the load on block {show(_name('block', self.block))}"
        _set(self, force=_vector("force", self.force, label=label))
        if self.point is not None:
            _set(self, point=_vector("point", self.point, label=label))


@dataclass(frozen=True, slots=True)
class Actuator:
    """A jack: a spring at a material ``point`` (m, world at the start), along a ``direction`` fixed in the world.

    ``direction`` is stored at length 1. The jack carries ``weight`` times the load of the system of all jacks.
    """

    name: str
    block: str
    point: Vector
    direction: Vector
    weight: float = 1.0

    def __post_init__(self):
        label = f" of actuator {show(_name('name', self.name))}"
        _name(f"block{label}", self.block)
        direction = _vector("direction", self.direction, label=label)
        _require(any(direction), f"direction{label}", direction, "its length must be greater than 0")
        weight = _number(f"weight{label}", self.weight)
        _require(weight != 0.0, f"weight{label}", weight, "it must not be 0")
        _set(self, point=_vector("point", self.point, label=label), direction=_unit(direction), weight=weight)


@dataclass(frozen=True, slots=True)
class YieldControl:
    """The limit load to ``tolerance``, the relative half-width of its bracket; everything else follows from it."""

    tolerance: float = 1.0e-3

    kind = "yield"

    def __post_init__(self):
        _set(self, tolerance=_number("tolerance", self.tolerance))
        _require(
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
            value = _number(key, getattr(self, key))
            _require(value > 0.0, key, value, f"it must be greater than 0 {unit}")
            _set(self, **{key: value})


Control = YieldControl | DisplacementControl


@dataclass(frozen=True, slots=True)
class Solver:
    """``step_factor``: time step over the critical one."""

    step_factor: float = 0.9

    def __post_init__(self):
        value = _number("step_factor", self.step_factor)
        _require(0.0 < value < 1.0, "step_factor", value, "it must lie between 0 and 1, the critical time step")
        _set(self, step_factor=value)


@dataclass(frozen=True, slots=True)
class Output:
    """What is recorded. ``channels``: "joints" (resultants, a row each), "energy", "frames" (motion of the blocks),
    "velocity" and "contacts" (contact forces) in every frame; time, load and displacement always are.

    ``rows`` and ``frames``: about how many of a constant-rate test; a search keeps a row of every step.
    """

    channels: tuple[str, ...] = ("joints", "energy", "frames", "velocity")
    rows: int = 1000
    frames: int = 200

    def __post_init__(self):
        _set(self, channels=_members("channels", self.channels, str))
        for i, channel in enumerate(self.channels):
            _choice(f"channels[{i}]", channel, CHANNELS)
        for channel in ("velocity", "contacts"):
            framed = channel not in self.channels or "frames" in self.channels
            _require(framed, "channels", self.channels, f'"{channel}" is recorded in frames, so "frames" must be there')
        for key in ("rows", "frames"):
            value = getattr(self, key)
            _type(isinstance(value, Integral) and not isinstance(value, bool), key, value, "a whole number")
            _require(1 <= value <= 10_000_000, key, value, "it must lie between 1 and 10 million")
            _set(self, **{key: int(value)})
        _require(self.frames <= self.rows, "frames", self.frames, f"a frame is taken at a row, and rows = {self.rows}")


@dataclass(frozen=True, slots=True)
class Scenario:
    """One test, complete. ``text`` is the TOML it came from, ``path`` its file (both None when written in Python).

    Two scenarios are equal when they say the same, wherever they come from.
    """

    title: str
    gravity: Vector
    joint: JointLaw
    materials: dict[str, Material]
    blocks: tuple[Block, ...]
    control: Control
    joints: tuple[JointOverride, ...] = ()
    loads: tuple[Load, ...] = ()
    actuators: tuple[Actuator, ...] = ()
    solver: Solver = field(default_factory=Solver)
    output: Output = field(default_factory=Output)
    path: str | None = field(default=None, compare=False)
    text: str | None = field(default=None, compare=False, repr=False)

    def __post_init__(self):
        _text("title", self.title)
        _set(self, gravity=_vector("gravity", self.gravity))
        _type(isinstance(self.joint, JointLaw), "joint", self.joint, "a JointLaw")
        _type(isinstance(self.control, Control), "control", self.control, "a YieldControl or DisplacementControl")
        _type(isinstance(self.solver, Solver), "solver", self.solver, "a Solver")
        _type(isinstance(self.output, Output), "output", self.output, "an Output")
        _type(isinstance(self.materials, dict), "materials", self.materials, "a mapping of names to Material")
        _members("materials", list(self.materials.values()), Material)
        for name in self.materials:
            _name("name of a material", name)
        for key, kind in (("blocks", Block), ("joints", JointOverride), ("loads", Load), ("actuators", Actuator)):
            _set(self, **{key: _members(key, getattr(self, key), kind)})
        if not self.blocks:
            raise ScenarioError("a scenario needs at least one block")
        self._check_names()

    def _check_names(self):
        """Names are unique, and whatever is referred to is there."""
        for kind, members in (("block", self.blocks), ("actuator", self.actuators)):
            seen = set()
            for member in members:
                if member.name in seen:
                    raise ScenarioError(f"two {kind}s are named {show(member.name)}; every {kind} needs its own name")
                seen.add(member.name)
        blocks = {block.name: None for block in self.blocks}
        references = [(f"material of block {show(b.name)}", b.material, self.materials) for b in self.blocks]
        references += [(f"block of load number {i}", load.block, blocks) for i, load in enumerate(self.loads, 1)]
        references += [(f"block of actuator {show(a.name)}", a.block, blocks) for a in self.actuators]
        references += [("between", name, blocks) for override in self.joints for name in override.between]
        for key, name, known in references:
            if name not in known:
                kind = "material" if known is self.materials else "block"
                raise ScenarioError(f"{key} = {show(name)} is not the name of a {kind}; {nearest(name, known)}")

    def law_between(self, first: str, second: str) -> JointLaw:
        """The law of the joints between two named blocks; the last override that names the pair holds."""
        for override in reversed(self.joints):
            if set(override.between) == {first, second}:
                return override.law
        return self.joint
