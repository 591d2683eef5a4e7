"""Every key of a scenario with its unit, what is allowed, and what it means: the reference that pages and schema share.

Types and defaults come from the dataclasses themselves; a test holds the two together, so that no key is without a
word here, and none stands here that no scenario has.
"""

from __future__ import annotations

import types
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import cache
from typing import Any, Union, get_args, get_origin, get_type_hints

from dembrick.scenario.blocks import Block, Mesh, Part, Prism, Voussoir
from dembrick.scenario.cad_models import CadModel
from dembrick.scenario.controls import CONTROLS, Control, Pulse, Sine
from dembrick.scenario.generators import Arch, Dome, Opening, Return, Stack, Wall
from dembrick.scenario.model import (
    Actuator,
    ControlPoint,
    JointLaw,
    JointOverride,
    Load,
    Material,
    Output,
    Scenario,
    Solver,
)
from dembrick.scenario.pressures import Fill, Pressure
from dembrick.scenario.ties import Tie, TieEnd
from dembrick.scenario.time_functions import SupportPath, Turn

NOT_KEYS = {"text", "path", "files"}  # fields of dataclasses that no file writes


@dataclass(frozen=True, slots=True)
class Key:
    """A key of a table: ``unit`` ("" if it has none), what is ``allowed``, what it is about (``meaning``)."""

    name: str
    unit: str
    allowed: str
    meaning: str


# key | unit | allowed | meaning
_SCENARIO = """
title | | one line | what is shown on plots and pages
gravity | m/s2 | 3 numbers | acceleration of gravity in world axes, usually [0, 0, -9.81]
joint | | table | joint law of every pair of blocks that no [[joints]] names
materials | | tables | materials by name, [materials.NAME]
blocks | | tables | single blocks
control | | table | what is done to the blocks; its kind decides which keys it has
joints | | tables | joint laws of some pairs, in place of the default
loads | | tables | dead loads, constant or varying in time
actuators | | tables | actuators; all of them are one load system with the multiplier V
solver | | table | numerical choices
output | | table | what is recorded
walls | | tables | walls of coursed blocks; where two lie in one another with their ends they meet in bond
stacks | | tables | equal blocks on one another
arches | | tables | circular arches
domes | | tables | spherical domes
models | | tables | structures drawn in CAD, many solids in a file
supports | | names | blocks and groups that are fixed
control_points | | tables | points whose displacement is recorded
pressures | | tables | pressures on bare faces: constant, of a fluid or of a fill
fills | | tables | fills on the backs of arches and vaults: weight and earth pressure
ties | | tables | bars and cables between points of two blocks
stages | | tables | controls that are carried out before [control], one after the other; keys as there
"""
_LAW = """
formulation | | concave, corrected, corrected-shear, convex, distributed | how a joint carries force: at \
its corners, at corners shrunk towards its centre, shear alone at these, as a whole area, or at many points
friction | 1 | >= 0 | coefficient of Coulomb friction, tan(phi)
normal_stiffness | Pa/m | > 0 | penalty stiffness along the normal, per area
shear_stiffness | Pa/m | > 0 | penalty stiffness in the plane, per area
points | 1 | 2 whole numbers >= 1, or "auto" | distributed only: points along t1 and t2; left out, the tolerance decides
pressure | | full, effective, linear | convex only: how friction follows bending: not at all, on the \
largest part centred on the resultant, or by the no-tension linear pressure
cohesion | Pa | >= 0 | shear strength of the bond besides friction, per area; 0 is a dry joint
tensile_strength | Pa | 0 to cohesion / friction | tensile strength of the bond; never regained once it broke
dilation | 1 | 0 to residual_friction | tangent of the dilation angle: rise over slip, for slips small against \
asperities
residual_friction | 1 | 0 to friction | friction after the first slip or opening; left out, friction stays
residual_cohesion | Pa | 0 to cohesion | cohesion of what is closed after the first slip or opening; left out \
there is none (a brittle bond), residual_cohesion = cohesion is a ductile joint
compressive_strength | Pa | > 0 | pressure at which the joint crushes, without hardening; left out, it never does
"""
_BLOCK = """
name | | text without control characters | its name; what stands before a dot names a group
material | | a material | what it is made of
box | m | 3 numbers > 0 | edge lengths of a box, centred on position
position | m | 3 numbers | world position of the origin of the shape
orientation | 1 | 4 numbers (w, x, y, z) | quaternion from body to world; scaled to length 1
fixed | | true, false | a support that does not move
held | | names of x, y, z, rx, ry, rz | directions of the world in which a rig holds the block
velocity | m/s | 3 numbers | velocity of the centroid at the start of a dynamic run, world axes
angular_velocity | rad/s | 3 numbers | angular velocity at the start of a dynamic run, world axes
group | | text | a set of blocks that loads, supports and joint laws can name
prism | | table | a convex polygon, extruded
voussoir | | table | a stone of an arch
vertices | m | at least 4 points | the convex hull of these points
mesh | | table | a closed surface in a file
parts | | tables | convex parts that make one rigid block
"""
_PLACED = """
name | | text | name of the structure, and the beginning of the names of its blocks
material | | a material | what its blocks are made of
position | m | 3 numbers | where it stands
heading | deg | a number | direction of its axis about z; zero is along x
group | | text | a further group that its blocks belong to
"""
_TOLERANCE = "tolerance | 1 | 1e-8 to 0.1 | relative half-width of the error bar of the limit"
_LARGE = (
    "large_displacements | | true, false | from equilibrium to equilibrium in the deformed geometry; true after a "
    "settlement"
)
_DAMPING = "damping | 1 | 0 to 0.9 | dashpot of a contact, as a part of critical damping (real time)"
_IMPACT = """
duration | s | > 0 | how long the run lasts
restitution | 1 | 0.14 to 1 | speed after over speed before an impact face to face
"""

_MOTION = """
supports | | names | blocks and groups that move so; they must be fixed
displacement | m | 3 numbers | how far they have moved at the end, world axes
rotation | | table | how far they have turned at the end
"""

_TEXTS: dict[type, str] = {
    Scenario: _SCENARIO,
    JointLaw: _LAW,
    JointOverride: "between | | 2 names | the two blocks or groups whose joints have this law\n"
    "stages | | whole numbers >= 1 | the stages in which it holds; left out, all\n"
    "law | | keys of [joint] | what differs from the default law",
    Material: "density | kg/m3 | > 0 | mass per volume",
    Block: _BLOCK,
    Part: "\n".join(
        line
        for line in _BLOCK.splitlines()
        if line.split(" |")[0] in ("box", "position", "orientation", "prism", "voussoir", "vertices", "mesh")
    ),
    Prism: "polygon | m | at least 3 points | corners of a convex polygon in the x-y plane\n"
    "height | m | > 0 | thickness along z, half of it below the plane",
    Voussoir: """
radius | m | > 0 | mean radius of the ring
thickness | m | > 0, below 2 radius | thickness of the ring
depth | m | > 0 | length along y
angle | deg | 0 to 180 | angle that the stone spans
curved | | true, false | mass, centroid and inertia of the piece of a ring instead of the quadrilateral
""",
    Mesh: "file | | a path | STL, OBJ, PLY, .msh or .vtu file, beside the scenario\n"
    "unit | | m, cm, mm, in, ft | unit of the lengths in the file\n"
    "scale | 1 | > 0 | factor of these lengths",
    Wall: _PLACED
    + """
block | m | 3 numbers > 0 | length, thickness and height of a block
courses | 1 | whole number >= 1 | number of courses
blocks | 1 | whole number >= 1 | blocks in a course
pattern | | texts | courses from the bottom, repeated: 1 a block, h half, q one and a half, o a gap of one, . of half
bond | 1 | 0 to 1 | shift of every second course, as a part of a block
ends | | half, quoin, toothed | how shifted courses end
openings | | tables | doors and windows
returns | | tables | walls that turn the corner
base | m | > 0 | thickness of a fixed slab below; of walls that meet, one for all
""",
    Opening: """
span | m | 2 numbers | from where to where, from the left end of the wall; in a return from the outer face of the wall
courses | 1 | 2 whole numbers | first and last course, from 1
lintel | m | > 0 | bearing of a lintel on either side; left out, there is none
""",
    Return: """
end | | left, right | at which end of the wall
side | | front, back | to which side; front is towards -y of a wall along x
blocks | 1 | whole number >= 2 | its length in blocks, from the outer face of the wall
openings | | tables | doors and windows of the return
""",
    Stack: _PLACED
    + """
blocks | 1 | whole number >= 1 | number of blocks
box | m | 3 numbers > 0 | edge lengths of each
prism | | table | or a prism each, as for drums
base | m | > 0 | thickness of a fixed slab below
""",
    Arch: _PLACED
    + """
radius | m | > 0 | mean radius
thickness | m | > 0, below 2 radius | thickness of the ring
depth | m | > 0 | length out of the plane
voussoirs | 1 | whole number >= 2 | number of stones
angle | deg | 0 to 360 | angle of embrace; 180 is a semicircle
curved | | true, false | weight, centroid and inertia of pieces of a ring
abutments | | true, false | a fixed stone under each springing
""",
    Dome: _PLACED
    + """
radius | m | > 0 | mean radius
thickness | m | > 0, below 2 radius | thickness of the shell
rings | 1 | whole number >= 1 | number of rings
blocks | 1 | whole number >= 3 | stones in a ring
angle | deg | 0 to 120 | from the axis down to the springing; 90 is a hemisphere
oculus | deg | 0 to 60 | from the axis to the rim of an open eye
key | deg | 0 to 60 | or from the axis to the rim of the key stone
springing | | true, false | a ring of fixed stones below
""",
    CadModel: _PLACED
    + """
file | | a path | OBJ, STL, glTF (.gltf, .glb), COMPAS JSON, PLY, .msh or .vtu file, beside the scenario
unit | | m, cm, mm, in, ft | unit of the lengths in the file
gap_tolerance | m | >= 0 | faces of two solids that look at each other nearer than this come to lie on one plane
united | | lists of names | solids that are one rigid block, called by the first of them
""",
    Load: """
block | | a block or group | what it acts on; each block of a group bears the whole force
force | N | 3 numbers | force in world axes
point | m | 3 numbers | where it acts, world position at the start; left out, at the centroid
sine | | table | factor of the force in time, in runs in real time
history | | a path | CSV file with the factor over time, in runs in real time
columns | | 2 names | the columns of time and of values in the file
stages | | whole numbers >= 1 | the stages in which it acts; left out, all
""",
    Actuator: """
name | | text | its name
block | | a block | the block it pushes
point | m | 3 numbers | where it pushes, world position at the start, in the block or on a face
direction | 1 | 3 numbers | along which line, in world axes; scaled to length 1
weight | 1 | not 0 | it carries weight times V
stages | | whole numbers >= 1 | the stages in which it pushes; left out, all that drive actuators
""",
    Pressure: """
block | | a block or group | whose faces are loaded
direction | 1 | 3 numbers | outward normal of the loaded faces
value | Pa | > 0 | a constant pressure
surface | m | a number | or the height of the surface of a fluid or fill
weight | N/m3 | > 0 | its weight per volume; the pressure is weight times depth
actuator | | true, false | the pressure is the driven load, with the multiplier V
stages | | whole numbers >= 1 | the stages in which it acts; left out, all
""",
    Fill: """
block | | a block or group | whose bare faces that look up bear the fill
surface | m | a number | height of its surface
weight | N/m3 | > 0 | its weight per volume
pressure | | none, at-rest, active, passive | its state, which decides how it presses sideways
friction_angle | deg | 0 to 60 | of the fill; needed for at-rest, active and passive
coefficient | 1 | >= 0 | in place of pressure: horizontal over vertical stress
stages | | whole numbers >= 1 | the stages in which it acts; left out, all
""",
    Tie: """
between | | 2 tables | the ends of the tie
stiffness | N/m | > 0 | force over elongation
strength | N | > 0 | it yields at this force without end; left out, it never does
prestress | N | a number | force at the start, or as it comes
tension_only | | true, false | slack where it would push; false for a bar or a spring
stages | | whole numbers >= 1 | the stages in which it is there; left out, all. It comes with its prestress
""",
    TieEnd: """
block | | a block | the block it is fastened to
point | m | 3 numbers | where, world position at the start, in the block or on a face
""",
    ControlPoint: """
name | | text | its name
block | | a block | the block it belongs to
point | m | 3 numbers | world position at the start; left out, the centroid
""",
    Solver: "step_factor | 1 | 0 to 1 | time step over the critical one",
    Output: """
channels | | joints, energy, frames, velocity, contacts | what is recorded besides time, load and displacement
rows | 1 | 1 to 10 million | about how many rows a run in time records; a search keeps every step
frames | 1 | 1 to rows | about how many frames of the motion
checkpoint | s | >= 0 | time between two checkpoints
""",
    Sine: """
amplitude | of the load | a number | amplitude
frequency | Hz | > 0 | frequency
phase | rad | a number | phase
""",
    Pulse: """
amplitude | of the motion | a number | height of a rectangular pulse
duration | s | > 0 | its length
start | s | >= 0 | when it begins
rebound | 1 | 0 to 1 | then so much of the amplitude the other way, until the impulses cancel
""",
    Turn: """
axis | 1 | 3 numbers | axis of the turn, right-hand rule
angle | deg | -90 to 90, not 0 | by how much, at the end
point | m | 3 numbers | a point of the axis at the start; left out, the centroid of each support
""",
    SupportPath: _MOTION,
    CONTROLS["yield"]: f"{_TOLERANCE}\n{_LARGE}",
    CONTROLS["displacement"]: """
rate | m/s | > 0 | speed of the actuators; N/s of a force_protocol
travel | m | > 0 | how far they move, one way
protocol | m | numbers, or a path | turning points of a cyclic test, or a CSV file of a measured one
force_protocol | N | numbers, or a path | turning points of V, with large_displacements
"""
    + _LARGE,
    CONTROLS["statics"]: _LARGE,
    CONTROLS["tilt"]: f"""
axis | 1 | 3 numbers | axis of the table through the origin, right-hand rule
rate | deg/s | 0 to 10 | how fast it turns, in real time; without it the limit itself is searched
displacement | m | > 0 | the run ends when a block has moved so far against the table
quasi_static | | true, false | find the angle of the limit itself, without time; the default without a rate
{_TOLERANCE}
{_DAMPING}
{_LARGE}
""",
    CONTROLS["pushover"]: f"""
direction | 1 | 3 numbers | along which every block is pushed by the same share of its weight
displacement | m | > 0 | the curve goes on until a block has moved so far
quasi_static | | true, false | find the limit itself; false: push in real time
rate | m/s | > 0 | how fast the mean displacement grows, in real time
{_TOLERANCE}
{_DAMPING}
{_LARGE}
""",
    CONTROLS["settlement"]: f"""
{_MOTION}
motions | | tables | further supports that move differently at the same time
quasi_static | | true, false | from equilibrium to equilibrium in the deformed geometry; false: in real time
rate | m/s | > 0 | how fast the supports move, in real time
tolerance | 1 | 1e-5 to 0.1 | relative error of the settlement at which the structure comes down (quasi-static)
{_DAMPING}
""",
    CONTROLS["dynamic"]: _IMPACT,
    CONTROLS["base-motion"]: f"""
{_IMPACT}
direction | 1 | 3 numbers, or up to three such lists | along which the supports shake, one for each component
file | | a path, or one for each direction | CSV with units, or a PEER record (.AT2, .VT2, .DT2); zero after its end
sine | | table | or a sine
pulse | | table | or a rectangular pulse
quantity | | acceleration, velocity, displacement | what file, sine or pulse give
columns | | 2 to 4 names | the columns of time and of values in the file, one for each direction
scale | 1 | a number | file, sine or pulse times this
baseline | | true, false | take a straight line from recorded accelerations: the supports end at rest where they began
""",
}


@cache
def keys_of(table: type) -> dict[str, Key]:
    """Name -> key of a dataclass of the scenario."""
    found = {}
    for line in filter(None, map(str.strip, _TEXTS[table].splitlines())):
        name, unit, allowed, meaning = (part.strip() for part in line.split("|"))
        found[name] = Key(name, unit, allowed, meaning)
    return found


def tables() -> dict[str, type]:
    """Heading in a TOML file -> dataclass, in the order of the reference."""
    found: dict[str, type] = {"": Scenario, "[joint]": JointLaw, "[[joints]]": JointOverride}
    found |= {"[materials.NAME]": Material, "[[blocks]]": Block}
    found |= {"prism = {}": Prism, "voussoir = {}": Voussoir, "mesh = {}": Mesh, "parts = [{}]": Part}
    found |= {"[[walls]]": Wall, "openings = [{}]": Opening, "returns = [{}]": Return}
    found |= {"[[stacks]]": Stack, "[[arches]]": Arch, "[[domes]]": Dome, "[[models]]": CadModel}
    found |= {"[[loads]]": Load, "[[actuators]]": Actuator, "[[pressures]]": Pressure, "[[fills]]": Fill}
    found |= {"[[ties]]": Tie, "between = [{}] of [[ties]]": TieEnd}
    found |= {"sine = {}": Sine, "pulse = {}": Pulse, "[[control_points]]": ControlPoint}
    found |= {"rotation = {}": Turn, "motions = [{}]": SupportPath}
    found |= {f'[control] kind = "{kind}"': control for kind, control in CONTROLS.items()}
    return found | {"[solver]": Solver, "[output]": Output}


def default_of(field) -> Any:
    """Default of a dataclass field; MISSING if it has none."""
    if field.default is not MISSING:
        return field.default
    return field.default_factory() if field.default_factory is not MISSING else MISSING


def written_fields(table: type) -> list:
    """The fields of a table that a file may write."""
    return [field for field in fields(table) if field.init and field.name not in NOT_KEYS]


# --- JSON schema -----------------------------------------------------------------------------------------------------


def json_schema() -> dict:
    """JSON schema (draft 2020-12) of a scenario file, for editors that complete and check TOML."""
    schema = _object(Scenario)
    control = {"oneOf": [_object(control) for control in CONTROLS.values()]}
    schema["properties"] |= {"control": control, "stages": {"type": "array", "items": control}}
    schema["properties"]["joints"] = {"type": "array", "items": _override()}
    schema["properties"]["materials"] = {"type": "object", "additionalProperties": _object(Material)}
    schema["required"] = [*(key for key in schema["required"] if key != "blocks"), "control"]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "dembrick scenario",
        **schema,
    }


def _override() -> dict:
    law = _object(JointLaw)
    between = {"type": "array", "items": {"type": "string"}, "minItems": 2, "maxItems": 2}
    stages = _object(JointOverride)["properties"]["stages"]
    return {**law, "properties": {"between": between, "stages": stages, **law["properties"]}, "required": ["between"]}


def _object(kind: Any) -> dict:
    hints, told = get_type_hints(kind), keys_of(kind)
    properties, required = {}, []
    for field in written_fields(kind):
        key = told[field.name]
        meaning = f"{key.meaning} [{key.unit}]" if key.unit not in ("", "1") else key.meaning
        properties[field.name] = {"description": meaning, **_type(hints[field.name])}
        default = default_of(field)
        if default is MISSING:
            required.append(field.name)
        elif isinstance(default, bool | int | float | str):
            properties[field.name]["default"] = default
        words = key.allowed.split(", ")
        if (
            properties[field.name].get("type") == "string"
            and len(words) > 1
            and "".join(words).replace("-", "").isalpha()
        ):
            properties[field.name]["enum"] = words
    if issubclass(kind, Control):
        properties = {"kind": {"const": kind.kind}, **properties}
        required.insert(0, "kind")
    if kind is JointLaw:  # what the file may say in place of two numbers
        properties["points"] = {"anyOf": [properties["points"], {"const": "auto"}]}
    return {"type": "object", "properties": properties, "required": required, "additionalProperties": False}


def _type(hint: Any) -> dict:
    origin = get_origin(hint)
    if origin in (Union, types.UnionType):
        kinds = [_type(part) for part in get_args(hint) if part is not type(None)]
        return kinds[0] if len(kinds) == 1 else {"anyOf": kinds}
    if origin is tuple:
        parts = get_args(hint)
        if parts[-1] is Ellipsis:
            return {"type": "array", "items": _type(parts[0])}
        return {"type": "array", "items": _type(parts[0]), "minItems": len(parts), "maxItems": len(parts)}
    if is_dataclass(hint):
        return _object(hint)
    return {"type": {bool: "boolean", int: "integer", float: "number", str: "string"}.get(hint, "object")}
