"""Reading a history: lazily, never more than was asked for, also while a run is still writing it."""

from __future__ import annotations

import json
import os
import tomllib
from functools import cached_property

import numpy as np

from dembrick.errors import HistoryError
from dembrick.history import guard
from dembrick.history.layout import FORMAT, JOINT_CHANNELS, NEW_CONTACTS, WRITTEN, counts_equilibria

_AT_POINTS = {"contact_force": 3, "contact_arm": 2}  # numbers of a frame at every contact point of joints


def read(path: str | os.PathLike) -> History:
    """Open a history file; HistoryError if it is not one. Close it, or use it in a ``with`` statement."""
    return History(path)


def status_of(path: str | os.PathLike) -> str:
    """The status of a history file and nothing else of it."""
    with guard.open_file(path) as file:
        return _status(file)


def _status(file) -> str:
    found, status = guard.attribute(file, "format"), guard.attribute(file, "status")
    if not isinstance(found, int) or not isinstance(status, str):
        raise HistoryError(f"{file.filename}: this HDF5 file was not written by dembrick")
    if found != FORMAT:
        raise HistoryError(
            f"{file.filename}: history format {found} is unknown to this version, which reads {FORMAT}; update dembrick"
        )
    return status


class History:
    """A history file, open for reading.

    ``status``: ``running`` as long as the run goes on (or after it was killed), then what it ended with. ``begun`` is
    False where the run was killed before its first row: there is a scenario, and no block yet.
    ``n_row`` rows and ``n_frames`` frames are there, as of the moment of opening. Series are arrays (T,) or (T, n).
    """

    def __init__(self, path: str | os.PathLike):
        self.path = os.fspath(path)
        self._file = guard.open_file(path)
        try:
            self.status = _status(self._file)
            self._open_series()
        except BaseException:
            self._file.close()
            raise

    def _open_series(self) -> None:
        self._series, self.energy_names, self.has_frames, self.has_joints = {}, (), False, False
        self.n_row = self.n_frames = self.n_block = self.n_joint = self.n_actuator = self.n_control_point = 0
        self.begun = guard.exists(self._file, WRITTEN) or self.status != "running"
        if not self.begun:
            return
        written = guard.values(guard.dataset(self._file, WRITTEN, "integer", (2,)))
        self.n_row, self.n_frames = (int(n) for n in written)
        found = guard.members(self._file, "history")
        self.n_block = guard.dataset(self._file, "geometry/blocks/name", "text", (None,)).shape[0]
        self.n_joint = guard.dataset(self._file, "geometry/joints/blocks", "integer", (None, 3)).shape[0]
        self.n_actuator = guard.dataset(self._file, "geometry/actuators/name", "text", (None,)).shape[0]
        tails = dict.fromkeys(("time", "load", "displacement", "unbalanced"), ())
        tails |= {name: () for name in ("lower", "upper", "new_contacts") if name in found}
        tails |= dict.fromkeys(("actuator_displacement", "actuator_force"), (self.n_actuator,))
        if "control_point" in found:
            self.n_control_point = guard.dataset(self._file, "geometry/control_points/name", "text", (None,)).shape[0]
            tails["control_point"] = (self.n_control_point, 3)
        self.has_joints = "joint" in found
        if self.has_joints:
            tails |= {f"joint/{name}": (self.n_joint,) for name in JOINT_CHANNELS}
        self.energy_names = tuple(guard.members(self._file, "history/energy"))
        tails |= {f"energy/{name}": () for name in self.energy_names}
        tails = {f"history/{name}": tail for name, tail in tails.items()}
        framed = guard.members(self._file, "frames")
        self.has_frames = "time" in framed
        if self.has_frames:
            blocks = {"time": (), "position": (self.n_block, 3), "displacement": (self.n_block, 3)}
            blocks["orientation"] = (self.n_block, 4)
            blocks |= {name: (self.n_block, 3) for name in ("velocity", "spin") if name in framed}
            if "joint_shift" in framed:
                blocks["joint_shift"] = (self.n_joint, 2)
            n_point = guard.dataset(self._file, "geometry/joints/point", "number", (None, 5)).shape[0]
            blocks |= {name: (n_point, wide) for name, wide in _AT_POINTS.items() if name in framed}
            if "new_contacts" in framed:
                blocks["new_contacts/end"] = ()
            tails |= {f"frames/{name}": tail for name, tail in blocks.items()}
        for name, tail in tails.items():
            kind = "integer" if name.endswith("/end") else "number"
            self._open(name, kind, tail, self.n_frames if name.startswith("frames/") else self.n_row)
        if "frames/new_contacts/end" in self._series:
            count = self.new_contacts_before(self.n_frames)
            for name, (kind, tail, _, _) in NEW_CONTACTS.items():
                self._open(f"frames/new_contacts/{name}", "integer" if kind == "<i8" else "number", tail, count)
        if self.n_frames and not self.has_frames:
            raise HistoryError(f"{self.path}: frames/time is missing, so this is not a history of ours")

    def _open(self, name: str, kind: str, tail: tuple[int, ...], count: int) -> None:
        """A dataset that grows, of which ``count`` entries were written."""
        data = guard.dataset(self._file, name, kind, (None, *tail))
        if not 0 <= count <= len(data):
            raise HistoryError(f"{self.path}: {name} has {len(data)} entries where {count} were written")
        self._series[name] = data

    def close(self) -> None:
        self._file.close()

    def __enter__(self) -> History:
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<History {self.path}: {self.status}, {self.n_row} rows, {self.n_frames} frames, {self.n_block} blocks>"

    # --- what the run was ---

    @cached_property
    def scenario_text(self) -> str:
        """The scenario as TOML text."""
        data = guard.dataset(self._file, "scenario", "text", ())
        with guard.damaged(self.path, "scenario"):
            return data.asstr()[()]

    @cached_property
    def title(self) -> str:
        title = self.results.get("title")
        if title is None:
            try:
                title = tomllib.loads(self.scenario_text).get("title", "")
            except (tomllib.TOMLDecodeError, RecursionError):
                title = ""
        return str(title)

    @property
    def run(self) -> str | None:
        """Name of the run, by which its checkpoints know that they belong to it."""
        found = guard.attribute(self._file, "run")
        return found if isinstance(found, str) else None

    @cached_property
    def results(self) -> dict:
        """The object of ``run --json``; empty while the run goes on."""
        return self._json("results")

    @cached_property
    def settings(self) -> dict:
        """What the program chose: time step, damping, rates."""
        return self._json("settings")

    @cached_property
    def versions(self) -> dict:
        """Versions of the packages, and the machine."""
        return self._json("versions")

    def _json(self, name: str) -> dict:
        try:
            found = json.loads(guard.attribute(self._file, name) or "{}")
        except (TypeError, ValueError, RecursionError) as error:
            raise HistoryError(f"{self.path}: the attribute {name!r} is damaged") from error
        if not isinstance(found, dict):
            raise HistoryError(f"{self.path}: the attribute {name!r} is damaged")
        return found

    # --- series ---

    def series(self, name: str, start: int = 0, stop: int | None = None) -> np.ndarray:
        """Entries start to stop (default: all that were written) of a series such as ``load`` or ``joint/N``."""
        data = self._series.get(f"history/{name}")
        if data is None and not self.begun:
            return np.zeros(0)
        if data is None:
            raise KeyError(f"no series {name!r} in {self.path}")
        start, stop, _ = slice(start, stop).indices(self.n_row)
        return guard.values(data, start, max(start, stop))

    def series_names(self, group: str) -> list[str]:
        """Names of what grows with the run in ``history`` or ``frames``."""
        return [name.removeprefix(f"{group}/") for name in self._series if name.startswith(f"{group}/")]

    def entries(self, path: str, start: int, stop: int) -> np.ndarray:
        """Entries start to stop of a dataset that grows with the run, by its path in the file."""
        return guard.values(self._series[path], start, stop)

    @cached_property
    def time(self) -> np.ndarray:
        """(T,) s"""
        return self.series("time")

    @cached_property
    def load(self) -> np.ndarray:
        """(T,) N: the load multiplier V"""
        return self.series("load")

    @cached_property
    def displacement(self) -> np.ndarray:
        """(T,) m: the driven displacement"""
        return self.series("displacement")

    @cached_property
    def actuator_displacement(self) -> np.ndarray:
        """(T, n_actuator) m"""
        return self.series("actuator_displacement")

    @cached_property
    def actuator_force(self) -> np.ndarray:
        """(T, n_actuator) N"""
        return self.series("actuator_force")

    @cached_property
    def unbalanced(self) -> np.ndarray:
        """(T,) unbalanced-force ratio"""
        return self.series("unbalanced")

    def joint(self, name: str) -> np.ndarray:
        """(T, n_joint) of ``N``, ``V_1``, ``V_2``, ``M_T``, ``M_1``, ``M_2`` or ``slip``.

        HistoryError where the run did not record them.
        """
        if self.begun and not self.has_joints:
            raise HistoryError(
                f'{self.path}: joint forces were not recorded; run it again with "joints" in output.channels'
            )
        return self.series(f"joint/{name}")

    @cached_property
    def energy(self) -> dict[str, np.ndarray]:
        """Energies by name, each (T,) J."""
        return {name: self.series(f"energy/{name}") for name in self.energy_names}

    @property
    def meets_anew(self) -> bool:
        """Whether the run was one in real time, in which blocks part and meet again."""
        return "history/new_contacts" in self._series

    @cached_property
    def counts_equilibria(self) -> bool:
        """Whether times are the numbers of equilibria, of a run that looked for a collapse without living through
        it."""
        return counts_equilibria(self.scenario_text, self.meets_anew)

    @cached_property
    def new_contacts(self) -> np.ndarray:
        """(T,): how many contacts formed since the start carry a force; zero in runs that know none."""
        return self.series("new_contacts") if self.meets_anew else np.zeros(self.n_row)

    @cached_property
    def control_point(self) -> np.ndarray:
        """(T, n_control_point, 3) m: displacement of the control points from the start, world axes."""
        return self.series("control_point") if self.n_control_point else np.zeros((self.n_row, 0, 3))

    # --- frames ---

    @cached_property
    def frame_time(self) -> np.ndarray:
        """(F,) s"""
        return guard.values(self._series["frames/time"], 0, self.n_frames) if self.has_frames else np.zeros(0)

    def frame_position(self, k: int) -> np.ndarray:
        """(n_block, 3) m: centroids in frame k, world axes."""
        return self._frame("position", k)

    def frame_displacement(self, k: int) -> np.ndarray:
        """(n_block, 3) m: movement of the centroids from the start; keeps digits that positions lose."""
        return self._frame("displacement", k)

    def frame_orientation(self, k: int) -> np.ndarray:
        """(n_block, 4): quaternions (w, x, y, z) in frame k."""
        return self._frame("orientation", k)

    def frame_velocity(self, k: int) -> np.ndarray | None:
        """(n_block, 3) m/s: velocities of the centroids, half a step before frame k; None if not recorded."""
        return self._frame("velocity", k)

    def frame_spin(self, k: int) -> np.ndarray | None:
        """(n_block, 3) rad/s: angular velocities, world axes, half a step before frame k; None if not recorded."""
        return self._frame("spin", k)

    def frame_contact_force(self, k: int) -> np.ndarray | None:
        """(n_point, 3) N: force on block b at each contact point, world axes; None if not recorded.

        The points are those of the joints, one joint after the other; convex joints have none.
        """
        return self._frame("contact_force", k)

    def frame_values(self, name: str, start: int, stop: int) -> np.ndarray | None:
        """Frames start to stop of ``position``, ``displacement``, ``orientation``, ``velocity``, ``spin``,
        ``contact_force``, ``contact_arm`` or ``joint_shift``, as (f, ...); None if not recorded."""
        if not 0 <= start <= stop <= self.n_frames:
            raise IndexError(f"frames {start} to {stop} of {self.path}, which has {self.n_frames}")
        data = self._series.get(f"frames/{name}")
        return None if data is None else guard.values(data, start, stop)

    @property
    def has_new_contacts(self) -> bool:
        """Whether the forces of contacts that formed since the start were recorded."""
        return "frames/new_contacts/end" in self._series

    def new_contacts_before(self, frame: int) -> int:
        """How many new contacts the frames before ``frame`` have in all; zero where they were not recorded."""
        data = self._series.get("frames/new_contacts/end")
        if data is None or frame <= 0:
            return 0
        return int(guard.values(data, frame - 1, frame)[0])

    def frame_new_contacts(self, start: int, stop: int) -> tuple[np.ndarray, dict[str, np.ndarray]] | None:
        """New contacts of the frames start to stop, None if not recorded: where those of each frame begin and the last
        ones end (f + 1,), and of all of them (c, ...) ``blocks`` (2,), ``point`` (3,) m, ``normal`` (3,) from the first
        block to the second, ``force`` (3,) N on the second, ``torque`` (3,) N m on it about the point, ``area`` m2 and
        ``slip`` m; world axes.
        """
        if not 0 <= start <= stop <= self.n_frames:
            raise IndexError(f"frames {start} to {stop} of {self.path}, which has {self.n_frames}")
        if not self.has_new_contacts:
            return None
        first = self.new_contacts_before(start)
        ends = guard.values(self._series["frames/new_contacts/end"], start, stop).astype(np.int64)
        starts = np.concatenate([[first], ends])
        last = int(starts[-1])
        if (np.diff(starts) < 0).any() or not 0 <= first <= last <= len(self._series["frames/new_contacts/area"]):
            raise HistoryError(f"{self.path}: frames/new_contacts/end does not divide the contacts of its frames")
        found = {name: guard.values(self._series[f"frames/new_contacts/{name}"], first, last) for name in NEW_CONTACTS}
        blocks = found["blocks"]
        if blocks.size and not 0 <= blocks.min() <= blocks.max() < self.n_block:
            raise HistoryError(f"{self.path}: frames/new_contacts/blocks names a block that is not there")
        return starts - first, found

    def _frame(self, name: str, k: int) -> np.ndarray | None:
        if not -self.n_frames <= k < self.n_frames:
            raise IndexError(f"frame {k} of {self.path}, which has {self.n_frames}")
        k %= self.n_frames
        data = self._series.get(f"frames/{name}")
        return None if data is None else guard.values(data, k, k + 1)[0]

    # --- geometry at rest ---

    def _table(self, path: str, *tail: int, count: int | None = None, kind: str = "number") -> np.ndarray:
        if not self.begun:
            return np.zeros((1 if path.endswith("_start") else 0, *tail), int if kind == "integer" else float)
        found = guard.values(guard.dataset(self._file, f"geometry/{path}", kind, (count, *tail)))
        if found.dtype.kind == "f" and not np.isfinite(found).all():
            raise HistoryError(f"{self.path}: geometry/{path} holds a value that is not a finite number")
        return found

    def _texts(self, path: str, count: int) -> list[str]:
        return guard.texts(guard.dataset(self._file, f"geometry/{path}", "text", (count,))) if self.begun else []

    def _starts(self, path: str, count: int, total: int) -> list[int]:
        starts = self._table(path, count=count + 1, kind="integer")
        if starts[0] != 0 or starts[-1] != total or (np.diff(starts) < 0).any():
            raise HistoryError(f"{self.path}: geometry/{path} does not divide its list")
        return starts.tolist()

    def _numbers(self, path: str, limit: int, *tail: int, count: int | None = None) -> np.ndarray:
        found = self._table(path, *tail, count=count, kind="integer")
        if found.size and not 0 <= found.min() <= found.max() < limit:
            raise HistoryError(f"{self.path}: geometry/{path} names something that is not there")
        return found.astype(np.int64)

    @cached_property
    def block_names(self) -> tuple[str, ...]:
        return tuple(self._texts("blocks/name", self.n_block))

    @property
    def names(self) -> tuple[str, ...]:
        return self.block_names

    @cached_property
    def block_fixed(self) -> np.ndarray:
        """(n_block,) bool: the supports."""
        return self._table("blocks/fixed", count=self.n_block, kind="integer").astype(bool)

    @cached_property
    def block_mass(self) -> np.ndarray | None:
        """(n_block,) kg; None in files of earlier versions."""
        return self._optional("blocks/mass")

    @cached_property
    def block_inertia(self) -> np.ndarray | None:
        """(n_block, 3, 3) kg m2 about the centroids, body axes; None in files of earlier versions."""
        return self._optional("blocks/inertia", 3, 3)

    def _optional(self, path: str, *tail: int) -> np.ndarray | None:
        folder, _, name = f"geometry/{path}".rpartition("/")
        there = name in guard.members(self._file, folder)
        return self._table(path, *tail, count=self.n_block) if there else None

    @cached_property
    def position0(self) -> np.ndarray:
        """(n_block, 3) m: centroids at the start."""
        return self._table("blocks/position", 3, count=self.n_block)

    @cached_property
    def orientation0(self) -> np.ndarray:
        """(n_block, 4): quaternions at the start."""
        return self._table("blocks/orientation", 4, count=self.n_block)

    @cached_property
    def _shapes(self) -> tuple[list[np.ndarray], list[tuple[tuple[int, ...], ...]]]:
        vertices = self._table("blocks/vertices", 3)
        starts = self._starts("blocks/vertex_start", self.n_block, len(vertices))
        corners = self._numbers("blocks/corner", len(vertices)).tolist()
        n_face = len(self._table("blocks/corner_start", kind="integer")) - 1
        if n_face < 0:
            raise HistoryError(f"{self.path}: geometry/blocks/corner_start is empty")
        corner_start = self._starts("blocks/corner_start", n_face, len(corners))
        faces = [tuple(corners[a:b]) for a, b in zip(corner_start, corner_start[1:], strict=False)]
        face_start = self._starts("blocks/face_start", self.n_block, n_face)
        of_block = [tuple(faces[a:b]) for a, b in zip(face_start, face_start[1:], strict=False)]
        points = [vertices[a:b] for a, b in zip(starts, starts[1:], strict=False)]
        for i, (block, own) in enumerate(zip(of_block, points, strict=True)):
            if any(number >= len(own) for face in block for number in face):
                raise HistoryError(f"{self.path}: a face of block {i} names a vertex that is not there")
        return points, of_block

    def block_vertices(self, i: int) -> np.ndarray:
        """(nv, 3) m: vertices of block i in its body frame."""
        return self._shapes[0][i]

    def block_faces(self, i: int) -> tuple[tuple[int, ...], ...]:
        """Faces of block i as tuples of vertex numbers, counterclockwise seen from outside."""
        return self._shapes[1][i]

    @cached_property
    def joints(self) -> list[dict]:
        """One dict a joint: blocks, ``origin``, ``axes`` (rows t1, t2, n), ``polygon`` (m, 2), law, contact points."""
        n = self.n_joint
        if not n:
            return []
        blocks = self._numbers("joints/blocks", self.n_block, 3, count=n).tolist()
        names = {"area": (), "friction": (), "origin": (3,), "axes": (3, 3)}
        columns = {name: self._table(f"joints/{name}", *tail, count=n) for name, tail in names.items()}
        formulation = self._texts("joints/formulation", n)
        has_pressure = "pressure" in guard.members(self._file, "geometry/joints")
        pressure = self._texts("joints/pressure", n) if has_pressure else ["full"] * n
        polygons, points = self._table("joints/polygon", 2), self._table("joints/point", 5)
        p = self._starts("joints/polygon_start", n, len(polygons))
        c = self._starts("joints/point_start", n, len(points))
        joints = []
        for i in range(n):
            joint = dict(zip(("block_a", "block_b", "host"), blocks[i], strict=True))
            joint |= {"area": float(columns["area"][i]), "friction": float(columns["friction"][i])}
            joint |= {"origin": columns["origin"][i], "axes": columns["axes"][i], "formulation": formulation[i]}
            joint |= {"pressure": pressure[i]}
            own = points[c[i] : c[i + 1]]
            joint |= {"polygon": polygons[p[i] : p[i + 1]]}
            joint |= {"normal_arms": own[:, :2], "shear_arms": own[:, 2:4], "areas": own[:, 4]}
            joints.append(joint)
        return joints

    @cached_property
    def actuators(self) -> list[dict]:
        """One dict a jack: ``name``, ``block``, ``point``, ``direction``, ``weight``."""
        n = self.n_actuator
        names, blocks = self._texts("actuators/name", n), self._numbers("actuators/block", self.n_block, count=n)
        point, direction = (self._table(f"actuators/{name}", 3, count=n) for name in ("point", "direction"))
        weight = self._table("actuators/weight", count=n)
        return [
            {"name": names[i], "block": int(blocks[i]), "point": point[i], "direction": direction[i]}
            | {"weight": float(weight[i])}
            for i in range(n)
        ]

    @cached_property
    def control_points(self) -> list[dict]:
        """One dict a control point: ``name``, ``block``, ``point`` at the start."""
        n = self.n_control_point
        if not n:
            return []
        names = self._texts("control_points/name", n)
        blocks = self._numbers("control_points/block", self.n_block, count=n)
        point = self._table("control_points/point", 3, count=n)
        return [{"name": names[i], "block": int(blocks[i]), "point": point[i]} for i in range(n)]
