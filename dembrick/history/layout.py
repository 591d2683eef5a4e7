"""The layout of a history file: its datasets, and how the file is created.

A history is one HDF5 file. Numbers that grow with the run are those of its channels (``simulation.channels``), with one
entry per row (``/history``), per frame (``/frames``), or per new contact of a frame (``/frames/new_contacts``); data
known at the start are in a :class:`Table` each. ``/written`` holds the numbers of valid rows and frames: in a file in
progress the growing datasets are longer, and zero beyond.

A frame may have any number of new contacts. Those of all frames are stored one after the other, and
``/frames/new_contacts/end`` contains the end of each frame. The number of valid contacts thus follows from that of the
frames, and after a kill a file is as complete as its frames are.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import h5py
import numpy as np
from h5py import h5a, h5d, h5p, h5s, h5t

from dembrick.assembly.actuators import KINDS
from dembrick.history.hdf5_files import rewritten
from dembrick.history.rest_geometry import CRUSHING
from dembrick.simulation.channels import Channel

if TYPE_CHECKING:
    from dembrick.assembly.build import Assembly

FORMAT = 1
WRITTEN = "written"

_TEXT = h5py.string_dtype()


@dataclass(frozen=True, slots=True)
class Table:
    """A dataset known at the start: numbers (float64, int64, uint8) or list of strings; ``packed``: compressed."""

    path: str
    value: np.ndarray
    units: str
    description: str
    packed: bool = False


_STRENGTHS = (
    ("cohesion", "Pa", "cohesion of the bond", lambda law: law.cohesion),
    ("tensile_strength", "Pa", "tensile strength of the bond", lambda law: law.tensile_strength),
    ("residual_cohesion", "Pa", "cohesion after the bond broke", lambda law: law.cohesion_after),
    ("residual_friction", "1", "friction coefficient after the bond broke", lambda law: law.friction_after),
)


def geometry(assembly: Assembly) -> list[Table]:
    """Initial geometry of blocks, joints and actuators, as needed for pictures; ragged lists as values and starts."""
    shapes, joints, points, actuators = assembly.shapes, assembly.joints, assembly.contact_points, assembly.actuators
    faces = [face for shape in shapes for face in shape.faces]
    arms = np.column_stack([points.normal_arm, points.shear_arm, points.area])
    pairs = np.column_stack([joints.block_a, joints.block_b, joints.host])
    b, j, a, c = (f"geometry/{group}/" for group in ("blocks", "joints", "actuators", "control_points"))
    tables = [
        Table(b + "name", texts_of(assembly.names), "1", "name of each block"),
        Table(b + "fixed", np.asarray(assembly.fixed, np.uint8), "1", "1 where the block is a support"),
        Table(b + "held", assembly.held.astype(np.uint8), "1", "1 in directions x, y, z, rx, ry, rz that are held"),
        Table(b + "position", _floats(assembly.position, 3), "m", "centroids at the start, world axes"),
        Table(b + "orientation", _floats(assembly.orientation, 4), "1", "quaternions (w, x, y, z) at the start"),
        Table(b + "mass", _floats(assembly.mass), "kg", "mass of each block"),
        Table(b + "inertia", _floats(assembly.inertia, 3, 3), "kg m2", "about the centroids, body axes"),
        Table(b + "vertices", _stacked([s.vertices for s in shapes], 3), "m", "vertices of all blocks, body axes"),
        Table(b + "vertex_start", _starts(len(s.vertices) for s in shapes), "1", "first vertex of each block, and end"),
        Table(b + "face_start", _starts(len(s.faces) for s in shapes), "1", "first face of each block, and end"),
        Table(b + "corner", _ints(np.concatenate([*faces, ()])), "1", "vertex numbers of all faces, within the block"),
        Table(b + "corner_start", _starts(len(face) for face in faces), "1", "first corner of each face, and end"),
        Table(j + "blocks", _ints(pairs), "1", "block a, block b, and the block the polygon rides on"),
        Table(j + "origin", _floats(joints.origin, 3), "m", "centroid O at the start, world axes"),
        Table(j + "axes", _floats(joints.axes, 3, 3), "1", "t1, t2 and the normal from a to b, as rows"),
        Table(j + "area", _floats(joints.area), "m2", "area of the joint"),
        Table(j + "polygon", _floats(joints.corner, 2), "m", "corners of the joints along t1, t2 from O"),
        Table(j + "polygon_start", _ints(joints.start), "1", "first corner of each joint, and end"),
        Table(j + "formulation", texts_of(law.formulation for law in joints.law), "1", "contact formulation"),
        Table(
            j + "pressure", texts_of(law.pressure for law in joints.law), "1", "pressure that a convex joint assumes"
        ),
        Table(j + "friction", _floats([law.friction for law in joints.law]), "1", "friction coefficient"),
        Table(j + "point", arms, "m, m, m, m, m2", "contact points: normal arm (2), shear arm (2) from O, area"),
        Table(j + "point_start", _ints(points.start), "1", "first point, and end"),
        Table(a + "name", texts_of(actuators.names), "1", "name of each actuator"),
        Table(a + "block", _ints(actuators.at.block), "1", "block that the actuator pushes"),
        Table(a + "point", _floats(actuators.at.start(assembly.position), 3), "m", "its point at the start, world"),
        Table(a + "direction", _floats(actuators.direction, 3), "1", "its direction, world axes"),
        Table(a + "weight", _floats(actuators.weight), "1", "its share of the load"),
        Table(a + "kind", texts_of(actuators.kind), "1", f"what it is: {', '.join(KINDS)}"),
    ]
    if any(not law.dry for law in joints.law):
        tables += [
            Table(j + name, _floats([value(law) for law in joints.law]), units, about)
            for name, units, about, value in _STRENGTHS
        ]
        crushes = [law.compressive_strength for law in joints.law]
        if any(strength is not None for strength in crushes):
            about = "compressive strength, zero where nothing crushes"
            tables.append(Table(j + CRUSHING, _floats([strength or 0.0 for strength in crushes]), "Pa", about))
    loads = assembly.point_loads
    if len(loads.at):
        d = "geometry/loads/"
        tables += [
            Table(
                d + "block",
                _ints(loads.at.block),
                "1",
                "block that each dead load acts on; one row per face of a pressure",
            ),
            Table(d + "point", _floats(loads.at.start(assembly.position), 3), "m", "its point at the start"),
            Table(d + "force", _floats(loads.force, 3), "N", "its force at the start, world axes"),
        ]
    ties = assembly.ties
    if len(ties):
        t = "geometry/ties/"
        between, ends = ties.ends.block, ties.ends.start(assembly.position)
        tables += [
            Table(t + "blocks", _ints(between), "1", "the two blocks that each tie joins"),
            Table(t + "points", _floats(ends, 2, 3), "m", "its ends at the start, world axes"),
            Table(t + "strength", _floats(ties.strength), "N", "force at which it yields, infinite if it never does"),
        ]
    watched = assembly.control_points
    if watched.names:
        tables += [
            Table(c + "name", texts_of(watched.names), "1", "name of each control point"),
            Table(c + "block", _ints(watched.at.block), "1", "block that it belongs to"),
            Table(
                c + "point",
                _floats(watched.at.start(assembly.position), 3),
                "m",
                "its position at the start, world axes",
            ),
        ]
    return tables


def scenario_table(text: str) -> Table:
    return Table("scenario", np.array(text, dtype=_TEXT), "1", "the scenario, as it was read (TOML)")


def create(
    path: str,
    growing: Mapping[Channel, int],
    tables: Iterable[Table],
    attributes: Mapping[str, object],
    packed: Mapping[str, int],
) -> dict[str, int]:
    """Create a file with all datasets, and close it; return the offset of each growing dataset.

    ``growing``: entries to reserve for each field. They are contiguous and unwritten (a hole on most disks), so that
    writing at the returned offsets never changes the structure of the file. ``packed``: fields to compress instead,
    with the entries per chunk; they have no offset. If nothing grows there is no count either.
    """
    offsets: dict[str, int] = {}

    def reserve(name: str, shape: tuple[int, ...], kind: str, units: str, description: str) -> None:
        if name in packed:
            made = file.create_dataset(
                name, shape, kind, dcpl=_unwritten(), chunks=(packed[name], *shape[1:]), compression=1, shuffle=True
            ).id
        else:
            how = _unwritten()
            how.set_layout(h5d.CONTIGUOUS)
            how.set_alloc_time(h5d.ALLOC_TIME_EARLY)
            made = _dataset(file, name, shape, np.dtype(kind), how)
            if (offset := made.get_offset()) is not None:
                offsets[name] = offset
        _describe(made, units, description)

    with rewritten(path) as (file, _):
        file.attrs.update(attributes)
        for table in tables:
            if table.packed and table.value.size:
                made = file.create_dataset(table.path, data=table.value, compression=1).id
            else:
                made = _dataset(file, table.path, table.value.shape, table.value.dtype, _untimed())
                if table.value.size:
                    made.write(h5s.ALL, h5s.ALL, np.ascontiguousarray(table.value).reshape(table.value.shape))
            _describe(made, table.units, table.description)
        for field, count in growing.items():
            reserve(field.path, (count, *field.shape), field.kind, field.unit, field.about)
        if growing:
            about = "rows of /history and entries of /frames that are valid; what lies beyond is reserved space"
            reserve(WRITTEN, (2,), "<i8", "1", about)
    return offsets


# A history has dozens of datasets with two texts each. The low-level calls of h5py create them in a third of the time
# of its objects, which matters in short runs.


def _unwritten() -> h5p.PropDCID:
    how = _untimed()
    how.set_fill_time(h5d.FILL_TIME_NEVER)
    return how


def _untimed() -> h5p.PropDCID:
    how = h5p.create(h5p.DATASET_CREATE)
    how.set_obj_track_times(False)  # for reproducible files
    return how


def _links() -> h5p.PropLCID:
    """Link properties that create missing groups above a dataset."""
    links = h5p.create(h5p.LINK_CREATE)
    links.set_create_intermediate_group(True)
    links.set_char_encoding(h5t.CSET_UTF8)
    return links


_LINKS, _SCALAR, _KIND_OF_TEXT = _links(), h5s.create(h5s.SCALAR), h5t.py_create(_TEXT, logical=True)


def _dataset(file: h5py.File, name: str, shape: tuple[int, ...], kind: np.dtype, how: h5p.PropDCID) -> h5d.DatasetID:
    """Create a dataset, and the groups above it."""
    space = h5s.create_simple(shape) if shape else _SCALAR
    return h5d.create(file.id, name.encode(), h5t.py_create(kind, logical=True), space, dcpl=how, lcpl=_LINKS)


def _describe(made: h5d.DatasetID, units: str, description: str) -> None:
    for name, text in ((b"units", units), (b"description", description)):
        h5a.create(made, name, _KIND_OF_TEXT, _SCALAR).write(_as_text(text))


@cache
def _as_text(text: str) -> np.ndarray:
    """A text as h5py writes it; cached, as files repeat the same few units and descriptions."""
    return np.array(text, dtype=_TEXT)


def put(file, position: int, array: np.ndarray) -> None:
    """Write an array at an offset in the file; unbuffered files may accept only part at a time."""
    rest = memoryview(np.ascontiguousarray(array)).cast("B") if array.size else b""
    file.seek(position)
    while len(rest):
        rest = rest[file.write(rest) :]


def texts_of(values: Iterable[str]) -> np.ndarray:
    """An array of strings, as HDF5 stores them."""
    values = list(values)
    array = np.empty(len(values), dtype=_TEXT)
    array[:] = values
    return array


def _floats(values, *tail: int) -> np.ndarray:
    return np.ascontiguousarray(values, "<f8").reshape(-1, *tail)


def _ints(values) -> np.ndarray:
    return np.ascontiguousarray(values, "<i8")


def _stacked(arrays: list, width: int) -> np.ndarray:
    return _floats(np.concatenate([np.zeros((0, width)), *arrays]), width)


def _starts(lengths: Iterable[int]) -> np.ndarray:
    return np.concatenate([[0], np.cumsum(list(lengths), dtype=np.int64)]).astype("<i8")
