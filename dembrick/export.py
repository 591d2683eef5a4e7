"""Histories in the formats of other programs: VTKHDF and PVD for ParaView, CSV for everything else.

The blocks are exported as a surface: the vertices of every block carried by its frames, one polygon a face. The joints
go to a second file beside it: their polygons, riding on their host block, with the forces of the moment.
"""

from __future__ import annotations

import csv
import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

import h5py
import numpy as np

from dembrick.errors import HistoryError, MissingDependency, OutputError, WriteError
from dembrick.history import History, check_output, reason, replacing
from dembrick.shapes import rotation_matrix

_JOINT_CHANNELS = {"N": "N", "V_1": "N", "V_2": "N", "M_T": "N m", "M_1": "N m", "M_2": "N m", "slip": "m"}
_CSV_ROWS = 4096  # rows held at a time


def export(history: History, path: str | os.PathLike) -> list[str]:
    """Write the history in the format that the ending of ``path`` names; returns the files written."""
    ending = os.path.splitext(os.fspath(path))[1].lower()
    writers = {".vtkhdf": to_vtkhdf, ".pvd": to_pvd, ".csv": to_csv}
    if ending not in writers:
        raise OutputError(f"{path}: no export has the ending {ending!r}; the known endings are {', '.join(writers)}")
    return writers[ending](history, path)


def to_vtkhdf(history: History, path: str | os.PathLike) -> list[str]:
    """Transient VTKHDF PolyData of the blocks at ``path``, and of the joints at ``<stem>_joints.vtkhdf``."""
    target = _target(history, path)
    written = [target]
    with _writing(path):
        _write_vtkhdf(target, _block_surface(history), history.frame_time)
        if history.n_joint and history.n_row:
            stem, ending = os.path.splitext(target)
            written.append(f"{stem}_joints{ending}")
            _write_vtkhdf(written[-1], _joint_surface(history), history.frame_time)
    return written


def to_pvd(history: History, path: str | os.PathLike) -> list[str]:
    """A ``.pvd`` list at ``path`` and one ``.vtu`` of the blocks a frame, ``<stem>_00000.vtu``, beside it."""
    try:
        import meshio
    except ImportError as error:
        raise MissingDependency("the export to .pvd needs meshio: pip install meshio") from error
    target = _target(history, path)
    surface = _block_surface(history)
    stem = os.path.splitext(target)[0]
    kinds: dict[int, list[int]] = {}
    for cell, face in enumerate(surface.faces):
        kinds.setdefault(len(face), []).append(cell)
    names = {3: "triangle", 4: "quad"}
    cells = [(names.get(n, "polygon"), np.array([surface.faces[i] for i in own])) for n, own in kinds.items()]
    written = []
    with _writing(path):
        with suppress(FileNotFoundError):
            os.unlink(target)  # an older list must not name the frames of this one
        for k in range(history.n_frames):
            frame = surface.frame(k)
            data = surface.fixed | frame.cells
            mesh = meshio.Mesh(
                frame.points,
                cells,
                point_data=frame.at_points,
                cell_data={name: [values[own] for own in kinds.values()] for name, values in data.items()},
            )
            written.append(f"{stem}_{k:05d}.vtu")
            with replacing(written[-1]) as part:
                meshio.write(part, mesh, file_format="vtu")
        with replacing(target) as part, open(part, "w", encoding="utf-8") as file:
            file.write('<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n<Collection>\n')
            for time, name in zip(history.frame_time.tolist(), written, strict=True):
                file.write(f'<DataSet timestep="{time!r}" part="0" file={quoteattr(os.path.basename(name))}/>\n')
            file.write("</Collection>\n</VTKFile>\n")
    return [target, *written]


def to_csv(history: History, path: str | os.PathLike) -> list[str]:
    """All series as text, a column each with its unit in the header; numbers read back exactly."""
    target = _target(history, path, frames=False)
    columns = [("time", ["time [s]"]), ("load", ["load [N]"]), ("displacement", ["displacement [m]"])]
    jacks = [jack["name"] for jack in history.actuators]
    columns.append(("actuator_displacement", [f"displacement of {name} [m]" for name in jacks]))
    columns.append(("actuator_force", [f"force of {name} [N]" for name in jacks]))
    names = history.block_names
    pairs = [f"{names[joint['block_a']]}/{names[joint['block_b']]}" for joint in history.joints]
    if len(set(pairs)) < len(pairs):
        pairs = [f"{pair} #{i}" for i, pair in enumerate(pairs)]
    for name, unit in _JOINT_CHANNELS.items():
        columns.append((f"joint/{name}", [f"{name} {pair} [{unit}]" for pair in pairs]))
    columns += [(f"energy/{name}", [f"{name} energy [J]"]) for name in history.energy_names]
    columns.append(("unbalanced", ["unbalanced [1]"]))
    with _writing(path), replacing(target) as part, open(part, "w", newline="", encoding="utf-8") as file:
        lines = csv.writer(file, lineterminator="\n")
        lines.writerow([title for _, titles in columns for title in titles])
        for start in range(0, history.n_row, _CSV_ROWS):
            stop = min(start + _CSV_ROWS, history.n_row)
            block = [history.series(name, start, stop).reshape(stop - start, -1) for name, _ in columns]
            lines.writerows(np.hstack(block).tolist())
    return [target]


@dataclass(frozen=True, slots=True)
class _Frame:
    """One moment: ``points`` (n, 3) m, and values by name at points and in cells."""

    points: np.ndarray
    at_points: dict[str, np.ndarray]
    cells: dict[str, np.ndarray]


@dataclass(frozen=True, slots=True)
class _Surface:
    """Polygons that keep their corners while the points move; ``fixed``: cell values that never change."""

    faces: list[tuple[int, ...]]
    fixed: dict[str, np.ndarray]
    frame: Callable[[int], _Frame]


class _Motion:
    """Material points of blocks, carried by the frames; ``body`` (n, 3) in the axes of ``block`` (n,)."""

    def __init__(self, history: History, body: np.ndarray, block: np.ndarray):
        self._history, self._body, self._block = history, body, block
        self._rotated0 = self._rotated(history.orientation0)

    def _rotated(self, orientation: np.ndarray) -> np.ndarray:
        return np.einsum("nij,nj->ni", rotation_matrix(orientation)[self._block], self._body)

    def at(self, k: int, displacement: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """World points (n, 3) in frame k, and their movement from the start, which keeps more digits."""
        rotated = self._rotated(self._history.frame_orientation(k))
        points = self._history.frame_position(k)[self._block] + rotated
        return points, displacement[self._block] + (rotated - self._rotated0)


def _block_surface(history: History) -> _Surface:
    vertices = [history.block_vertices(i) for i in range(history.n_block)]
    starts = np.cumsum([0, *map(len, vertices)]).tolist()
    faces, owner = [], []
    for i in range(history.n_block):
        for face in history.block_faces(i):
            faces.append(tuple(starts[i] + number for number in face))
            owner.append(i)
    owner = np.array(owner, np.int64)
    block = np.repeat(np.arange(history.n_block), np.diff(starts))
    motion = _Motion(history, np.concatenate([np.zeros((0, 3)), *vertices]), block)

    def frame(k: int) -> _Frame:
        displacement = history.frame_displacement(k)
        points, moved = motion.at(k, displacement)
        size = np.sqrt((displacement**2).sum(axis=1))
        cells = {"displacement": displacement[owner], "displacement_magnitude": size[owner]}
        return _Frame(points, {"displacement": moved}, cells)

    return _Surface(faces, {"block": owner}, frame)


def _joint_surface(history: History) -> _Surface:
    joints = history.joints
    host = np.array([joint["host"] for joint in joints])
    to_body = rotation_matrix(history.orientation0).transpose(0, 2, 1)
    corners, starts = [], [0]
    for joint in joints:
        world = joint["origin"] + joint["polygon"] @ joint["axes"][:2]
        corners.append((world - history.position0[joint["host"]]) @ to_body[joint["host"]].T)
        starts.append(starts[-1] + len(world))
    faces = [tuple(range(a, b)) for a, b in zip(starts, starts[1:], strict=False)]
    motion = _Motion(history, np.concatenate(corners), np.repeat(host, np.diff(starts)))
    ends = np.array([(joint["block_a"], joint["block_b"]) for joint in joints])
    rows = _nearest(history.time, history.frame_time)

    def frame(k: int) -> _Frame:
        points, moved = motion.at(k, history.frame_displacement(k))
        row = int(rows[k])
        cells = {name: history.series(f"joint/{name}", row, row + 1)[0] for name in _JOINT_CHANNELS}
        cells["V"] = np.hypot(cells["V_1"], cells["V_2"])
        return _Frame(points, {"displacement": moved}, cells)

    fixed = {"joint": np.arange(len(joints)), "block_a": ends[:, 0], "block_b": ends[:, 1]}
    return _Surface(faces, fixed, frame)


def _nearest(times: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Index of the entry of ``times`` (ascending) next to each wanted time; halfway, the earlier one."""
    return np.searchsorted(0.5 * (times[1:] + times[:-1]), wanted)


def _write_vtkhdf(target: str, surface: _Surface, times: np.ndarray) -> None:
    """One file, a frame at a time: the connectivity once, points and data for every step.

    VTK wants every offset of every step, also those that never move, and all four kinds of cells.
    """
    first = surface.frame(0)
    n_step, n_point, n_cell = len(times), len(first.points), len(surface.faces)
    with replacing(target) as part, h5py.File(part, "w") as file:
        root = file.create_group("VTKHDF")
        root.attrs["Version"] = np.array([2, 2])
        root.attrs.create("Type", b"PolyData", dtype=h5py.string_dtype("ascii", 8))
        for kind in ("Vertices", "Lines", "Polygons", "Strips"):
            faces = surface.faces if kind == "Polygons" else []
            group = root.create_group(kind)
            group["NumberOfCells"] = np.array([len(faces)])
            corners = np.concatenate([*faces, ()]).astype(np.int64)
            group["NumberOfConnectivityIds"] = np.array([len(corners)])
            group["Connectivity"] = corners
            group["Offsets"] = np.cumsum([0, *map(len, faces)], dtype=np.int64)
        root["NumberOfPoints"] = np.array([n_point])
        steps = root.create_group("Steps")
        steps.attrs["NSteps"] = n_step
        steps["Values"] = times
        still, step = np.zeros(n_step, np.int64), np.arange(n_step)
        steps["PartOffsets"], steps["NumberOfParts"] = still, still + 1
        steps["PointOffsets"] = step * n_point
        steps["CellOffsets"] = steps["ConnectivityIdOffsets"] = np.zeros((n_step, 4), np.int64)
        for name, values in surface.fixed.items():
            root[f"CellData/{name}"] = values
            steps[f"CellDataOffsets/{name}"] = still
        moving = {"Points": root.create_dataset("Points", (n_step * n_point, 3), np.float64)}
        for kind, data, count in (("PointData", first.at_points, n_point), ("CellData", first.cells, n_cell)):
            for name, values in data.items():
                # Fields are for colours and arrows: single precision, relative to their own size.
                shape = (n_step * count, *values.shape[1:])
                moving[f"{kind}/{name}"] = root.create_dataset(f"{kind}/{name}", shape, np.float32)
                steps[f"{kind}Offsets/{name}"] = step * count
        for k in range(n_step):
            frame = surface.frame(k)
            _fill(moving["Points"], k, frame.points)
            for kind, data in (("PointData", frame.at_points), ("CellData", frame.cells)):
                for name, values in data.items():
                    _fill(moving[f"{kind}/{name}"], k, values)


def _fill(data: h5py.Dataset, k: int, values: np.ndarray) -> None:
    data[k * len(values) : (k + 1) * len(values)] = values


def _target(history: History, path: str | os.PathLike, frames: bool = True) -> str:
    target = check_output(path)
    if os.path.realpath(history.path) == target:
        raise OutputError(f"{path}: this is the history itself; choose another name")
    if frames and not history.n_frames:
        raise HistoryError(f"{history.path}: no frames were recorded, so there is no motion to export")
    return target


class _writing:  # noqa: N801 - used like a function
    """A failed write becomes a WriteError; nothing that looks finished is left."""

    def __init__(self, path):
        self._path = path

    def __enter__(self) -> None:
        pass

    def __exit__(self, _kind, error, _trace) -> None:
        if isinstance(error, (OSError, RuntimeError)):
            raise WriteError(f"{self._path}: the export could not be written ({reason(error)})") from error
