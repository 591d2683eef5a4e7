"""Channels of the record: each quantity that a run may record, declared once.

Recorders provide values under these names, a history has a dataset for each, and the reader and CSV output use the same
list. A new channel is a declaration here, with a ``fill`` if its values follow from those that recorders provide; if
not, a recorder must provide them under the same name.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dembrick.assembly.actuators import recorded_curve
from dembrick.assembly.joints import JointTable
from dembrick.scenario.controls import Control
from dembrick.simulation.joint_laws import has_strengths

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly

ROWS, FRAMES, CONTACTS = 0, 1, 2  # a channel has an entry per row, per frame, or per new contact of a frame
AXES = tuple("xyz")
WRENCH = ("F_x [N]", "F_y [N]", "F_z [N]", "M_x [N m]", "M_y [N m]", "M_z [N m]")
OPTIONAL = ("control_point", "support", "tie")  # a scene without any of these has no channels for them
NO_BOUND = 1e300  # N, or a load factor: stands for no upper bound
CENTROID = "the centroid of what no edge cut off"  # of a joint; it lies frames/joint_shift from O of the start
STRENGTHS = "strengths"  # marks channels that only joints with strengths other than friction have


class Sizes(NamedTuple):
    """Counts to which shapes of channels refer; ``point``: contact points of joints (convex joints have none)."""

    block: int
    joint: int
    actuator: int
    control_point: int
    point: int
    support: int
    tie: int

    @classmethod
    def of(cls, assembly: Assembly) -> Sizes:
        """The counts of an assembly."""
        points = len(assembly.contact_points.area)
        return cls(
            len(assembly.names), len(assembly.joints), len(assembly.actuators.names),
            len(assembly.control_points.names), points, int(np.count_nonzero(assembly.supporting)),
            len(assembly.ties),
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Channel:
    """One quantity of the record.

    ``path``: its dataset in a history. ``shape`` of an entry: numbers, or names of `Sizes`. ``unit`` and ``about``:
    texts in which {load}, {time} and {when} are replaced according to the control. ``asked``: the word of
    ``output.channels`` that requests it, empty if it is always recorded, `STRENGTHS` if joints with strengths request
    it; ``real_time``: whether only runs in real time have it (True), or only others (False). ``columns``: the heading
    in CSV, in which {name}, {axis} (of ``axes``) and {time} identify the entry; empty if CSV omits it. ``fill``
    computes it from a record and its assembly, else a recorder provides it; ``in_file_only``: not part of results in
    memory. ``kind``: numpy's type string, of eight bytes.
    """

    path: str
    unit: str
    about: str
    shape: tuple[Any, ...] = ()
    asked: str = ""
    real_time: bool | None = None
    columns: str = ""
    fill: Callable[[Mapping, object], np.ndarray] | None = None
    in_file_only: bool = False
    kind: str = "<f8"
    axes: tuple[str, ...] = AXES
    grows_by: int = dataclasses.field(init=False, default=0)  # ROWS, FRAMES or CONTACTS

    def __post_init__(self):
        kind = FRAMES if self.path.startswith("frames/") else ROWS
        if kind == FRAMES and self.name.startswith("new_contacts/") and self.name != "new_contacts/end":
            kind = CONTACTS
        object.__setattr__(self, "grows_by", kind)  # set once, as it is needed for every row

    @property
    def name(self) -> str:
        """The path without its first folder."""
        return self.path.partition("/")[2]

    @property
    def always(self) -> bool:
        """Whether every record has it, or every one with frames."""
        return self.asked in ("", "frames") and self.real_time is None and not self.optional

    @property
    def optional(self) -> bool:
        """Whether only scenes with any of the items that it lists have it."""
        return self.shape[0] in OPTIONAL if self.shape else False

    def tail(self, sizes: Sizes) -> tuple[int, ...]:
        """Shape of an entry in numbers."""
        return tuple(getattr(sizes, n) if isinstance(n, str) else n for n in self.shape)

    @property
    def entry_bytes(self) -> int:
        """Bytes of one entry in a run."""
        return 8 * math.prod(self.shape)

    def of_run(self, sizes: Sizes, words: Mapping[str, str]) -> Channel:
        """The channel in a given run: the shape in numbers, and unit and description with these ``words`` filled in."""
        unit, about = self.unit.format(**words), self.about.format(**words)
        return dataclasses.replace(self, shape=self.tail(sizes), unit=unit, about=about)

    def titles(self, names: Mapping[str, list[str]], unit: str) -> list[str]:
        """Headings of its columns; ``names`` of the items along its shape."""
        which = names[self.shape[0]] if self.shape else [""]
        axes = self.axes if len(self.shape) == 2 else ("",)
        time = "equilibrium" if unit == "1" else "time"
        return [self.columns.format(name=name, axis=axis, unit=unit, time=time) for name in which for axis in axes]


def _position(record: Mapping, assembly: Assembly) -> np.ndarray:
    return np.asarray(assembly.position, float) + record["displacement"]


CHANNELS = (
    Channel("history/time", "{time_unit}", "{time} of the row", columns="{time} [{unit}]"),
    Channel("history/load", "{load_unit}", "{load}", columns="load [{unit}]"),
    Channel(
        "history/displacement", "m",
        "driven displacement: sum(weight u) / sum|weight| over the actuators since they began to push",
        columns="displacement [{unit}]",
    ),
    Channel(
        "history/actuator_displacement", "m", "displacement of each actuator's point along it since it began to push",
        ("actuator",), columns="displacement of {name} [{unit}]",
    ),
    Channel(
        "history/actuator_force", "N", "force of each actuator", ("actuator",), columns="force of {name} [{unit}]"
    ),
    Channel(
        "history/control_point", "m", "displacement of each control point, from the start, world axes",
        ("control_point", 3), columns="u_{axis} of {name} [{unit}]",
    ),
    Channel(
        "history/reaction", "N, N m",
        "force and moment of each support on the structure, about its centroid at the start, world axes{when}",
        ("support", 6), columns="reaction of {name} {axis}", axes=WRENCH,
    ),
    Channel("history/tension", "N", "tension of each tie, negative where a bar is pressed{when}", ("tie",),
            columns="tension of {name} [{unit}]"),
    Channel("history/yielded", "m", "plastic elongation of each tie", ("tie",),
            columns="yielded of {name} [{unit}]"),
    *(
        Channel(
            f"history/joint/{name}", unit, f"{about}{{when}}", ("joint",), "joints",
            columns=f"{name} {{name}} [{{unit}}]",
        )
        for name, unit, about in (
            ("N", "N", "normal force, compression positive"),
            ("V_1", "N", "shear force of block b on block a along the joint's first axis"),
            ("V_2", "N", "shear force of block b on block a along the joint's second axis"),
            ("M_T", "N m", f"torsion of block b on block a about the joint's normal, through {CENTROID}"),
            ("M_1", "N m", f"bending moment of block b on block a about the joint's first axis, through {CENTROID}"),
            ("M_2", "N m", f"bending moment of block b on block a about the joint's second axis, through {CENTROID}"),
            ("slip", "m", "length of the slip path, to and fro, mean over what presses; never falls"),
        )
    ),
    *(
        Channel(f"history/energy/{name}", "J", f"{about}{{when}}", (), "energy", only, f"{name} energy [{{unit}}]")
        for name, only, about in (
            ("kinetic", None, "kinetic energy"),
            ("elastic", None, "energy in the springs of joints and ties, since the start"),
            ("jack_spring", False, "energy in the spring of the actuators"),
            ("external", None, "work of gravity, loads and actuators since the start"),
            ("friction", None, "work dissipated by friction"),
            ("dashpots", None, "work dissipated by dashpots"),
            ("released", True, "energy lost by springs of joints that opened, were cut or passed to contacts"),
            ("stepping", True, "work lost in springs that open or close within a time step: an error of second "
                               "order in the step"),
            ("new_contacts", True, "work done on contacts that formed since the start: stored and dissipated"),
            ("crushing", None, "work dissipated by crushing of joints"),
            ("fracture", None, "energy lost by springs of joints as bonds broke; it depends on the stiffness of the "
                               "joints and is not a fracture energy of a material"),
            ("yielding", None, "work dissipated by yielding ties"),
        )
    ),
    Channel("history/unbalanced", "1", "unbalanced-force ratio", columns="unbalanced [{unit}]"),
    Channel("history/lower", "{load_unit}", "lower bound of the limit load so far"),
    Channel("history/upper", "{load_unit}", "upper bound of the limit load so far; 1e300 means none"),
    Channel(
        "history/new_contacts", "1", "contacts formed since the start that carry a force now", real_time=True
    ),
    Channel("frames/time", "{time_unit}", "{time} of the frame", (), "frames"),
    Channel(
        "frames/position", "m", "centroid of each block, world axes", ("block", 3), "frames", fill=_position,
        in_file_only=True,
    ),
    Channel(
        "frames/displacement", "m", "movement of each centroid from the start, world axes", ("block", 3), "frames"
    ),
    Channel(
        "frames/orientation", "1", "quaternion (w, x, y, z) of each block, body to world", ("block", 4), "frames"
    ),
    Channel(
        "frames/velocity", "m/s", "velocity of each centroid, world axes", ("block", 3), "velocity"
    ),
    Channel("frames/spin", "rad/s", "angular velocity, world axes", ("block", 3), "velocity"),
    Channel(
        "frames/bond", "1", "share of the area of each joint whose bond is intact", ("joint",), STRENGTHS,
    ),
    Channel(
        "frames/joint_shift", "m",
        "position of O on the block that carries the polygon, from the initial O, along t1 and t2 of the joint",
        ("joint", 2), "joints", True,
    ),
    Channel(
        "frames/contact_force", "N",
        "force on block b at each contact point, world axes; the points are those of geometry/joints/point",
        ("point", 3), "contacts",
    ),
    Channel(
        "frames/contact_arm", "m",
        "position of each contact point on the block that carries the polygon, from the initial O, along t1, t2",
        ("point", 2), "contacts", True,
    ),
    Channel(
        "frames/contact_area", "m2", "tributary area of each contact point, less where part of its joint was cut off",
        ("point",), "contacts", True,
    ),
    Channel(
        "frames/new_contacts/end", "1", "entries of frames/new_contacts of all frames up to this one", (), "contacts",
        True, kind="<i8",
    ),
    *(
        Channel(f"frames/new_contacts/{name}", unit, about, shape, "contacts", True, kind=kind)
        for name, kind, shape, unit, about in (
            ("blocks", "<i8", (2,), "1", "the two blocks, as numbers in geometry/blocks"),
            ("point", "<f8", (3,), "m", "centre of pressure, world axes"),
            ("normal", "<f8", (3,), "1", "mean normal of the contact, from the first block to the second, world axes"),
            ("force", "<f8", (3,), "N", "force on the second block, world axes"),
            ("torque", "<f8", (3,), "N m", "torque on the second block about the point, world axes"),
            ("area", "<f8", (), "m2", "area of the contact"),
            ("slip", "<f8", (), "m", "length of its slip path"),
        )
    ),
)  # fmt: skip
JOINT_CHANNELS = tuple(c.name.partition("/")[2] for c in CHANNELS if c.path.startswith("history/joint/"))
NEW_CONTACTS = {c.name.partition("/")[2]: c for c in CHANNELS if c.grows_by == CONTACTS}


def energies(real_time: bool) -> tuple[str, ...]:
    """Names of the energies that a run records, in their order."""
    found = [c for c in CHANNELS if c.path.startswith("history/energy/") and c.real_time in (None, real_time)]
    return tuple(c.name.partition("/")[2] for c in found)


def counts_equilibria(control: Control, assembly: Assembly) -> bool:
    """Whether the times of a record are numbers of equilibria; a search with a user-defined law pushes in time."""
    return control.regime.counts_equilibria and assembly.custom_law is None


def recorded(assembly: Assembly, asked: Container[str], control: Control) -> tuple[Channel, ...]:
    """The channels that a run records; ``asked``: the words of ``output.channels``."""
    sizes, regime = Sizes.of(assembly), control.regime
    joints = assembly.joints
    strong = has_strengths(joints.law if isinstance(joints, JointTable) else [joint.law for joint in joints])
    counts = counts_equilibria(control, assembly)
    curve = recorded_curve(control, assembly.actuators)
    words = {"load": curve.about, "load_unit": curve.unit}
    words |= {"time": "number of the equilibrium" if counts else "time", "time_unit": "1" if counts else "s"}
    words["when"] = " (one step before the row)" if regime.real_time else ""
    found = []
    for channel in CHANNELS:
        wanted = channel.real_time in (None, regime.real_time)
        wanted = wanted and ("frames" in asked or channel.grows_by == ROWS)
        wanted = wanted and (not channel.asked or channel.asked in asked or (strong and channel.asked == STRENGTHS))
        balances = regime.balances_energy and not control.pushes_as_tilted
        wanted = wanted and (channel.asked != "energy" or balances)
        wanted = wanted and not (channel.asked == "velocity" and counts)  # between equilibria there is no time
        if wanted and not (channel.optional and not getattr(sizes, channel.shape[0])):
            found.append(channel.of_run(sizes, words))
    return tuple(found)


def bytes_of(fields: tuple[Channel, ...], rows: int, frames: int, contacts: int = 0) -> int:
    """Bytes of so many ``rows``, ``frames`` and new ``contacts``."""
    counts = (rows, frames, contacts)
    return sum(counts[field.grows_by] * field.entry_bytes for field in fields)


def taken(record: Mapping, field: Channel, assembly: Assembly) -> np.ndarray:
    """Values of a channel in a record as recorders provide it: joints share an array, energies and new contacts a
    mapping. ValueError if the record lacks them."""
    group, _, name = field.name.partition("/")
    try:
        if field.fill is not None:
            return field.fill(record, assembly)
        if group == "joint":
            return np.asarray(record["joint"], float)[..., JOINT_CHANNELS.index(name)]
        return record[group][name] if name else record[group]
    except KeyError as error:
        raise ValueError(f"{field.path}: the record has no such channel") from error


def followed(record: Mapping, fields: tuple[Channel, ...], grows_by: int, assembly: Assembly) -> dict[str, np.ndarray]:
    """A record with the channels that are computed from it added, for results in memory."""
    own = [f for f in fields if f.grows_by == grows_by and f.fill and not f.in_file_only]
    return {**record, **{channel.name: channel.fill(record, assembly) for channel in own}}
