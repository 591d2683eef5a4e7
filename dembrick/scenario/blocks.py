"""A block of a scenario: shape, position and material. Plain frozen data, no geometry.

A shape has its own coordinates; ``position`` is the place of their origin in the world, and ``orientation`` rotates the
shape about it. The origin is the centre of a box, the origin of the polygon at half height of a prism, and the centre
of the arch of a voussoir; ``vertices``, mesh files and ``parts`` have the origin of their coordinates. The centroid,
about which a block rotates and to which results refer, follows from the shape.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from dembrick.errors import ScenarioError
from dembrick.scenario.checks import (
    assign,
    check_name,
    one_of,
    present,
    require,
    require_type,
    show,
    unit_vector,
    vector,
)
from dembrick.scenario.declared import check_keys, choice, declare, naming, positive, truth
from dembrick.scenario.units import LENGTHS

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

CONVEX_SOLIDS = ("box", "prism", "voussoir", "vertices", "mesh")
SOLIDS = (*CONVEX_SOLIDS, "parts")
DIRECTIONS = ("x", "y", "z", "rx", "ry", "rz")  # of the world; those along or about which a block may be held
UPRIGHT: Quaternion = (1.0, 0.0, 0.0, 0.0)
MOST_VERTICES = 2000  # limit for a convex polyhedron

# keys of blocks and of their parts
BOX = declare("3 numbers > 0", "edge lengths of a box, centred on position", "m")
PRISM = declare("table", "a convex polygon, extruded")
VOUSSOIR = declare("table", "a stone of an arch")
VERTICES = declare("at least 4 points", "the convex hull of these points", "m")
MESH = declare("table", "a closed surface in a file")
POSITION = declare("3 numbers", "world position of the origin of the shape", "m")
ORIENTATION = declare("4 numbers (w, x, y, z)", "quaternion from body to world; scaled to length 1", "1")


@dataclass(frozen=True, slots=True)
class Prism:
    """A convex ``polygon`` (corners in m, in either sense) in the x-y plane, extruded by ``height`` (m) along z.

    The plane of the polygon is at half height.
    """

    polygon: tuple[tuple[float, float], ...] = field(
        metadata=declare("at least 3 points", "corners of a convex polygon in the x-y plane", "m")
    )
    height: float = field(metadata=positive("m", "thickness along z, half of it below the plane"))

    def __post_init__(self):
        corners = _points("polygon", self.polygon, 2, least=3)
        assign(self, polygon=corners)
        check_keys(self)


@dataclass(frozen=True, slots=True)
class Voussoir:
    """A stone of an arch: ``angle`` (deg) of a ring of mean ``radius`` and ``thickness`` (m), ``depth`` (m) along y.

    The origin is the centre of the arch, which lies in the x-z plane; the axis of the stone points along z. The faces
    are those of the quadrilateral between the two radial joints. So are mass, centroid and inertia, unless ``curved``
    is set: then they are those of the ring segment.
    """

    radius: float = field(metadata=positive("m", "mean radius of the ring"))
    thickness: float = field(metadata=positive("m", "thickness of the ring, below twice the radius"))
    depth: float = field(metadata=positive("m", "length along y"))
    angle: float = field(metadata=declare("0 to 180", "angle that the stone spans", "deg"))
    curved: bool = field(
        default=False, metadata=truth("mass, centroid and inertia of the piece of a ring instead of the quadrilateral")
    )

    def __post_init__(self):
        check_keys(self)
        require(self.thickness < 2.0 * self.radius, "thickness", self.thickness, "it must be below twice the radius")
        require(self.angle < 180.0, "angle", self.angle, "a voussoir spans less than 180 deg")


@dataclass(frozen=True, slots=True)
class Mesh:
    """A closed surface in a ``file`` (STL, OBJ, PLY, .msh, .vtu); a relative path starts at the scenario's folder.

    A surface that is not convex is cut into convex parts. ``unit``: unit of its lengths (m, cm, mm, in or ft);
    ``scale``: a further factor on them.
    """

    file: str = field(metadata=naming("a path", "STL, OBJ, PLY, .msh or .vtu file, beside the scenario"))
    scale: float = field(default=1.0, metadata=positive("1", "factor on the lengths in the file"))
    unit: str = field(default="m", metadata=choice(tuple(LENGTHS), "unit of the lengths in the file"))

    def __post_init__(self):
        check_keys(self)

    @property
    def metres(self) -> float:
        """Length in metres of a length of 1 in the file."""
        return self.scale * LENGTHS[self.unit]


@dataclass(frozen=True, slots=True)
class Part:
    """A convex part of a block: one shape (``box``, ``prism``, ``voussoir``, ``vertices`` or ``mesh``, as for a block),
    at a ``position`` (m) and with an ``orientation`` (quaternion) in the block's own coordinates."""

    box: Vector | None = field(default=None, metadata=BOX)
    prism: Prism | None = field(default=None, metadata=PRISM)
    voussoir: Voussoir | None = field(default=None, metadata=VOUSSOIR)
    vertices: tuple[Vector, ...] | None = field(default=None, metadata=VERTICES)
    mesh: Mesh | None = field(default=None, metadata=MESH)
    position: Vector = field(default=(0.0, 0.0, 0.0), metadata=POSITION)
    orientation: Quaternion = field(default=UPRIGHT, metadata=ORIENTATION)

    def __post_init__(self):
        _check_solid(self, CONVEX_SOLIDS, "a part", "")
        assign(self, position=vector("position", self.position), orientation=_quaternion(self.orientation, ""))

    @property
    def solid(self) -> tuple[str, object]:
        """Kind of the shape and its data; equal shapes have equal data."""
        return _solid(self, CONVEX_SOLIDS)


@dataclass(frozen=True, slots=True)
class Block:
    """A rigid block called ``name``, of a ``material``, with one of the shapes ``box`` (edge lengths, m), ``prism``,
    ``voussoir``, ``vertices`` (convex hull of the points), ``mesh``, or ``parts`` (convex parts that form one rigid
    block).

    ``position`` (m) is the place of the shape's origin, of a box its centre. If it is left out (not allowed for a box),
    the coordinates of the shape are world coordinates. ``orientation``: quaternion, body to world.
    ``held`` guides a block as a rig does: it lists the world directions ``x`` ``y`` ``z`` in which the centroid cannot
    move, and the axes ``rx`` ``ry`` ``rz`` about which the block cannot rotate; all six are the same as ``fixed``.
    ``group`` is the name of a set of blocks, for loads, supports and joint laws. ``velocity`` (m/s) and
    ``angular_velocity`` (rad/s), both in world axes, are the initial velocities of a dynamic run.
    """

    name: str = field(
        metadata=declare("text without control characters", "its name; the part before a dot names a group")
    )
    material: str = field(metadata=declare("a material", "what it is made of"))
    box: Vector | None = field(default=None, metadata=BOX)
    position: Vector | None = field(default=None, metadata=POSITION)
    orientation: Quaternion = field(default=UPRIGHT, metadata=ORIENTATION)
    fixed: bool = field(default=False, metadata=declare("true, false", "a support that does not move"))
    velocity: Vector = field(
        default=(0.0, 0.0, 0.0),
        metadata=declare("3 numbers", "velocity of the centroid at the start of a dynamic run, world axes", "m/s"),
    )
    angular_velocity: Vector = field(
        default=(0.0, 0.0, 0.0),
        metadata=declare("3 numbers", "angular velocity at the start of a dynamic run, world axes", "rad/s"),
    )
    group: str | None = field(
        default=None, metadata=declare("text", "a set of blocks that loads, supports and joint laws can name")
    )
    prism: Prism | None = field(default=None, metadata=PRISM)
    voussoir: Voussoir | None = field(default=None, metadata=VOUSSOIR)
    vertices: tuple[Vector, ...] | None = field(default=None, metadata=VERTICES)
    mesh: Mesh | None = field(default=None, metadata=MESH)
    parts: tuple[Part, ...] | None = field(
        default=None, metadata=declare("tables", "convex parts that make one rigid block")
    )
    held: tuple[str, ...] | None = field(
        default=None,
        metadata=declare("names of x, y, z, rx, ry, rz", "world directions in which a rig holds the block"),
    )

    def __post_init__(self):
        label = f" of block {show(check_name('name', self.name))}"
        check_name(f"material{label}", self.material)
        require_type(isinstance(self.fixed, bool), f"fixed{label}", self.fixed, "true or false")
        if self.held is not None:
            self._check_held(label)
        if self.group is not None:
            check_name(f"group{label}", self.group)
        kind = _check_solid(self, SOLIDS, f"block {show(self.name)}", label)
        if self.position is None:
            if kind == "box":
                raise ScenarioError(f"missing key 'position'{label}; it has no default")
            assign(self, position=(0.0, 0.0, 0.0))
        assign(
            self,
            position=vector("position", self.position, label=label),
            velocity=vector("velocity", self.velocity, label=label),
            angular_velocity=vector("angular_velocity", self.angular_velocity, label=label),
            orientation=_quaternion(self.orientation, label),
        )

    def _check_held(self, label: str) -> None:
        """Check that each name is a direction, given once, and that ``fixed`` is not set as well (it means all six)."""
        names = present(self.held)
        require_type(isinstance(names, list | tuple), f"held{label}", names, f"a list of {', '.join(DIRECTIONS)}")
        require(len(names) > 0, f"held{label}", [], "name a direction, or leave the key out")
        for name in names:
            one_of(f"held{label}", name, DIRECTIONS)
        twice = [name for i, name in enumerate(names) if name in names[:i]]
        require(not twice, f"held{label}", list(names), f"{twice[0] if twice else ''} is listed twice")
        require(not self.fixed, f"held{label}", list(names), "the block is fixed already; remove one of the two")
        every = set(names) == set(DIRECTIONS)
        assign(self, held=None if every else tuple(name for name in DIRECTIONS if name in names), fixed=every)

    @property
    def guides(self) -> tuple[bool, ...]:
        """For each of `DIRECTIONS`, whether it is held; all are for a fixed block."""
        return tuple(self.fixed or name in (self.held or ()) for name in DIRECTIONS)

    @property
    def solid(self) -> tuple[str, object]:
        """Kind of the shape and its data; equal shapes have equal data."""
        return _solid(self, SOLIDS)


def _solid(owner, kinds: tuple[str, ...]) -> tuple[str, object]:
    return next((kind, getattr(owner, kind)) for kind in kinds if getattr(owner, kind) is not None)


def _check_solid(owner, kinds: tuple[str, ...], who: str, label: str) -> str:
    """Check that exactly one shape is given and that its type is right; return its kind."""
    given = [kind for kind in kinds if getattr(owner, kind) is not None]
    if len(given) != 1:
        what = f"has {len(given)} shapes ({', '.join(given)})" if given else "has no shape"
        raise ScenarioError(f"{who} {what}; give it one of {', '.join(kinds)}")
    (kind,) = given
    value = getattr(owner, kind)
    if kind == "box":
        value = vector("box", value, label=label)
        for edge in value:
            require(edge > 0.0, f"box{label}", value, "every edge must be longer than 0 m")
    elif kind == "vertices":
        value = _points("vertices", value, 3, least=4, label=label)
    elif kind == "parts":
        require_type(isinstance(value, list | tuple), f"parts{label}", value, "a list of Part")
        require(len(value) > 0, f"parts{label}", value, "a block needs at least one part")
        for i, part in enumerate(value):
            require_type(isinstance(part, Part), f"parts[{i}]{label}", part, "a Part")
        value = tuple(value)
    else:
        wanted = {"prism": Prism, "voussoir": Voussoir, "mesh": Mesh}[kind]
        require_type(isinstance(value, wanted), f"{kind}{label}", value, f"a {wanted.__name__}")
    assign(owner, **{kind: value})
    return kind


def _points(key: str, value, length: int, least: int, label: str = "") -> tuple:
    value = value.tolist() if hasattr(value, "tolist") else value
    require_type(isinstance(value, list | tuple), key + label, value, f"a list of points of {length} numbers")
    bound = f"it must have {least} to {MOST_VERTICES} points, not {len(value)}"
    require(least <= len(value) <= MOST_VERTICES, key + label, value, bound)
    return tuple(vector(f"{key}[{i}]", point, length, label) for i, point in enumerate(value))


def _quaternion(value, label: str) -> tuple[float, ...]:
    quaternion = vector("orientation", value, 4, label)
    unit = abs(math.hypot(*quaternion) - 1.0) < 1e-6
    require(unit, f"orientation{label}", quaternion, "it must be a unit quaternion (w, x, y, z)")
    return unit_vector(quaternion)
