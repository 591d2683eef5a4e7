"""Reading a history: lazily, no more than requested, also while a run is still writing it."""

from __future__ import annotations

import json
import os
import tomllib
from collections.abc import Container, Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from dembrick.errors import HistoryError, ScenarioError
from dembrick.history import guard
from dembrick.history.inputs import Input, read_inputs, unpacked
from dembrick.history.layout import FORMAT, WRITTEN
from dembrick.history.rest_geometry import InitialGeometry
from dembrick.scenario import toml as scenarios
from dembrick.scenario.checks import nearest
from dembrick.scenario.regimes import COLLAPSE, LIMIT_LOAD, OF_ACTUATORS, PATH_FOLLOWING, REGIMES, YIELD, Curve
from dembrick.simulation.channels import CHANNELS, CONTACTS, FRAMES, NEW_CONTACTS, Channel, Sizes

if TYPE_CHECKING:
    import h5py
    import pandas
    import xarray

    from dembrick.scenario.model import Scenario
    from dembrick.scenario.overrides import Overrides

_SEARCHING = (LIMIT_LOAD.name, PATH_FOLLOWING.name)
_COUNTING = {regime.name for regime in REGIMES if regime.counts_equilibria}  # except with a user-defined law
_FOUND = (YIELD, COLLAPSE)  # statuses of runs that found a limit


def read(path: str | os.PathLike) -> History:
    """Open a history file; HistoryError if it is not one. Close it, or use it in a ``with`` statement."""
    return History(path)


def is_of(found: History, scenario_text: str, source: object = None) -> bool:
    """Whether a history is of the scenario with that text, read from the file ``source`` (a path, or None)."""
    named = found.settings.get("scenario") or None
    if isinstance(named, str) != isinstance(source or None, str) or (named and Path(named) != Path(source)):
        return False
    if found.scenario_text == scenario_text:
        return True
    try:
        return scenarios.loads(found.scenario_text) == scenarios.loads(scenario_text)
    except ScenarioError:
        return False


def _status(file) -> str:
    found, status = guard.attribute(file, "format"), guard.attribute(file, "status")
    if isinstance(found, int) and guard.attribute(file, "digest") is not None:
        raise HistoryError(f"{file.filename}: this is the table of a study; 'dembrick plot' draws table.csv beside it")
    if not isinstance(found, int) or not isinstance(status, str):
        raise HistoryError(f"{file.filename}: this HDF5 file was not written by dembrick")
    if found != FORMAT:
        raise HistoryError(
            f"{file.filename}: history format {found} is unknown to this version, which reads {FORMAT}; update dembrick"
        )
    return status


class History(InitialGeometry):
    """A history file, open for reading.

    ``status``: ``running`` while the run goes on (or after it was killed), then its final status. ``begun`` is False if
    the run was killed before its first row: there is a scenario, but no blocks yet. ``n_row`` rows and ``n_frames``
    frames were valid at the time of opening. Series are arrays (T,) or (T, n).
    """

    def __init__(self, path: str | os.PathLike):
        self.path = os.fspath(path)
        self._opened_file = guard.open_file(path)
        try:
            self.status = _status(self._file)
            self._open_series()
        except BaseException:
            self.close()
            raise

    @property
    def _file(self):
        """The file; HistoryError if it was closed."""
        if not self._opened_file.id.valid:
            raise HistoryError(
                f"{self.path}: this history is closed; open it again, or use it inside its 'with' statement"
            )
        return self._opened_file

    def _open_series(self) -> None:
        self._series: dict[str, tuple[tuple[int | None, ...], str, int]] = {}  # shape, kind, number of valid entries
        self._opened: dict[str, h5py.Dataset] = {}
        self.energy_names: tuple[str, ...] = ()
        self.has_frames = self.has_joints = False
        self.n_row = self.n_frames = self.n_block = self.n_joint = self.n_actuator = self.n_control_point = 0
        self.n_support = self.n_tie = 0
        self.begun = guard.exists(self._file, WRITTEN) or self.status != "running"
        if not self.begun:
            return
        written = guard.values(guard.dataset(self._file, WRITTEN, "integer", (2,)))
        self.n_row, self.n_frames = (int(n) for n in written)
        self.n_block = guard.dataset(self._file, "geometry/blocks/name", "text", (None,)).shape[0]
        self.n_joint = guard.dataset(self._file, "geometry/joints/blocks", "integer", (None, 3)).shape[0]
        self.n_actuator = guard.dataset(self._file, "geometry/actuators/name", "text", (None,)).shape[0]
        found = {folder: guard.members(self._file, folder) for folder in ("history", "frames")}
        if "control_point" in found["history"]:
            self.n_control_point = guard.dataset(self._file, "geometry/control_points/name", "text", (None,)).shape[0]
        if "tension" in found["history"]:
            self.n_tie = guard.dataset(self._file, "geometry/ties/blocks", "integer", (None, 2)).shape[0]
        if "reaction" in found["history"]:
            self.n_support = int(np.count_nonzero(self.block_held.any(axis=1)))
        self.has_joints, self.has_frames = "joint" in found["history"], "time" in found["frames"]
        found["history/energy"] = guard.members(self._file, "history/energy")
        n_point = guard.dataset(self._file, "geometry/joints/point", "number", (None, 5)).shape[0]
        counts = self.n_block, self.n_joint, self.n_actuator, self.n_control_point, n_point, self.n_support, self.n_tie
        sizes = Sizes(*counts)

        def expect(channel: Channel, count: int) -> None:
            kind = "integer" if channel.kind == "<i8" else "number"
            self._series[channel.path] = (None, *channel.tail(sizes)), kind, count

        for channel in CHANNELS:
            if channel.grows_by != CONTACTS and self._has(channel, found):
                expect(channel, self.n_frames if channel.grows_by == FRAMES else self.n_row)
        for path in ("history/time", "frames/time"):  # whose lengths confirm the counts
            if path in self._series:
                self._data(path)
        if self.has_new_contacts:
            count = self.new_contacts_before(self.n_frames)
            for channel in NEW_CONTACTS.values():
                expect(channel, count)
        energies = [path for path in self._series if path.startswith("history/energy/")]
        self.energy_names = tuple(path.rpartition("/")[2] for path in energies)
        if self.n_frames and not self.has_frames:
            raise HistoryError(f"{self.path}: frames/time is missing, so this is not a dembrick history")

    def _has(self, channel: Channel, found: Mapping[str, Container[str]]) -> bool:
        """Whether a channel was recorded; channels of one array, or of one group, are recorded together."""
        if channel.grows_by == FRAMES and not self.has_frames:
            return False
        if channel.path.startswith("history/energy/"):
            return channel.path.rpartition("/")[2] in found["history/energy"]
        folder, group = channel.path.split("/")[:2]
        return channel.always or group in found[folder]

    def _data(self, path: str) -> h5py.Dataset:
        """The dataset of a channel, opened on first use: a plot needs few of dozens."""
        file = self._file
        if path not in self._opened:
            shape, kind, count = self._series[path]
            data = guard.dataset(file, path, kind, shape)
            if not 0 <= count <= len(data):
                raise HistoryError(f"{self.path}: {path} has {len(data)} entries, but {count} were written")
            self._opened[path] = data
        return self._opened[path]

    def close(self) -> None:
        self._opened_file.close()

    def __enter__(self) -> History:
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def __reduce__(self) -> NoReturn:
        raise HistoryError(
            f"{self.path}: an open history cannot be pickled or copied; pass on its path, and read it there"
        )

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
    def inputs(self) -> list[Input]:
        """The files that the scenario reads, as they were in the run."""
        return read_inputs(self._file)

    def scenario(self, path: str | None, overrides: Overrides = ()) -> Scenario:
        """The scenario, with the files that it reads, extracted to a folder that exists until this process ends.

        ``path``: its nominal file, None if it was written in Python; ``overrides``: as for ``--set``.
        """
        return scenarios.loads(self.scenario_text, path, overrides, unpacked(self.inputs))

    @property
    def sources(self) -> list[str]:
        """Files that no command may overwrite: this one, that of its scenario, and those that the scenario reads."""
        source = self.settings.get("scenario")
        if not isinstance(source, str) or not source:
            return [self.path]
        folder = os.path.dirname(source)
        return [self.path, source, *(os.path.join(folder, one.name) for one in self.inputs)]

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
        """Identifier of the run, by which checkpoints are matched to it."""
        found = guard.attribute(self._file, "run")
        return found if isinstance(found, str) else None

    @cached_property
    def results(self) -> dict:
        """The object of ``run --json``; empty while the run goes on."""
        return self._json("results")

    @cached_property
    def small_displacements(self) -> bool:
        """Whether the run used small displacements: the initial geometry, with small rotations added up."""
        return guard.attribute(self._file, "kinematics") == "small displacements"

    @cached_property
    def settings(self) -> dict:
        """Numbers chosen by the program: time step, damping, rates."""
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
        """Entries start to stop (default: all) of a series such as ``load`` or ``joint/N``."""
        path = f"history/{name}"
        if path not in self._series:
            if not self.begun:
                return np.zeros(0)
            raise KeyError(f"no series {name!r} in {self.path}")
        start, stop, _ = slice(start, stop).indices(self.n_row)
        return guard.values(self._data(path), start, max(start, stop))

    def series_names(self, group: str) -> list[str]:
        """Names of the growing datasets in ``history`` or ``frames``."""
        return [name.removeprefix(f"{group}/") for name in self._series if name.startswith(f"{group}/")]

    def entries(self, path: str, start: int, stop: int) -> np.ndarray:
        """Entries start to stop of a growing dataset, by its path in the file."""
        return guard.values(self._data(path), start, stop)

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
    def unbalanced(self) -> np.ndarray:
        """(T,) greatest out-of-balance force of a block, over the greatest joint force of the scene"""
        return self.series("unbalanced")

    def joint(self, name: str) -> np.ndarray:
        """(T, n_joint) of ``N``, ``V_1``, ``V_2``, ``M_T``, ``M_1``, ``M_2`` or ``slip``.

        HistoryError if the run did not record them.
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
    def in_real_time(self) -> bool:
        """Whether the run was in real time, so that blocks separate and meet again."""
        return "history/new_contacts" in self._series

    @cached_property
    def regime(self) -> str:
        """How the run was carried out: name of one of `scenario.regimes`."""
        return guard.attribute(self._file, "regime")

    @cached_property
    def searches_limit(self) -> bool:
        """Whether the run was a limit load search with small displacements, and found the limit."""
        return self.regime in _SEARCHING and self.status in _FOUND

    @cached_property
    def counts_equilibria(self) -> bool:
        """Whether times are numbers of equilibria along a path."""
        return self.regime in _COUNTING and "custom_law" not in self.settings

    @cached_property
    def curve(self) -> Curve:
        """The recorded curve: names of load and displacement, and unit of the load."""
        names = ("load_name", "load_unit", "displacement_name")
        load, unit, displacement = (guard.attribute(self._file, name) for name in names)
        if not all(isinstance(text, str) for text in (load, unit, displacement)):
            return OF_ACTUATORS
        return Curve(load or None, unit, "", displacement)

    def unit(self, path: str) -> str:
        """Unit of a growing dataset, by its path in the file or its name in ``history``; KeyError if there is none."""
        where = path if path in self._series else f"history/{path}"
        if where not in self._series:
            known = [name.removeprefix("history/") for name in self._series]
            raise KeyError(f"no series {path!r} in {self.path}; {nearest(path, known)}")
        found = guard.attribute(self._data(where), "units")
        return found if isinstance(found, str) else ""

    @cached_property
    def new_contacts(self) -> np.ndarray:
        """(T,): number of loaded contacts formed since the start; zero in runs without new contacts."""
        return self.series("new_contacts") if self.in_real_time else np.zeros(self.n_row)

    @cached_property
    def control_point(self) -> np.ndarray:
        """(T, n_control_point, 3) m: displacement of the control points from the start, world axes."""
        return self.series("control_point") if self.n_control_point else np.zeros((self.n_row, 0, 3))

    @property
    def support_names(self) -> list[str]:
        """Names of the blocks in `reaction`."""
        return [name for name, held in zip(self.block_names, self.block_held.any(axis=1), strict=True) if held]

    @cached_property
    def reaction(self) -> np.ndarray:
        """(T, n_support, 6) N, N m: force and moment that supports exert on the structure, about their initial
        centroids, and likewise the guides of every held block; world axes. (T, 0, 6) if there are none, or if they were
        not recorded."""
        return self.series("reaction") if self.n_support else np.zeros((self.n_row, 0, 6))

    @cached_property
    def tension(self) -> np.ndarray:
        """(T, n_tie) N: force of the ties, tension positive."""
        return self.series("tension") if self.n_tie else np.zeros((self.n_row, 0))

    # --- tables of other libraries ---

    def to_pandas(self) -> pandas.DataFrame:
        """The series as a ``pandas.DataFrame`` by time, units in the headings; MissingDependency without pandas."""
        from dembrick.history.tables import to_pandas

        return to_pandas(self)

    def to_xarray(self) -> xarray.Dataset:
        """Series and frames as an ``xarray.Dataset`` with named dimensions and units; MissingDependency without
        xarray."""
        from dembrick.history.tables import to_xarray

        return to_xarray(self)

    # --- frames ---

    @cached_property
    def frame_time(self) -> np.ndarray:
        """(F,) s"""
        return guard.values(self._data("frames/time"), 0, self.n_frames) if self.has_frames else np.zeros(0)

    def frame(self, name: str, k: int) -> np.ndarray | None:
        """Values of frame k (negative: counted from the end); None if they were not recorded.

        ``position`` (n_block, 3) m of the centroids; ``displacement`` (n_block, 3) m from the start, with digits that
        positions lose; ``orientation`` (n_block, 4) as (w, x, y, z); ``velocity`` (n_block, 3) m/s and ``spin``
        (n_block, 3) rad/s; ``contact_force`` (n_point, 3) N on block b at each contact point, joint by joint (convex
        joints have none). World axes.
        """
        if not -self.n_frames <= k < self.n_frames:
            raise IndexError(f"frame {k} of {self.path}, which has {self.n_frames}")
        found = self.frame_values(name, k % self.n_frames, k % self.n_frames + 1)
        return None if found is None else found[0]

    def frame_values(self, name: str, start: int, stop: int) -> np.ndarray | None:
        """Frames start to stop of ``position``, ``displacement``, ``orientation``, ``velocity``, ``spin``,
        ``contact_force``, ``contact_arm``, ``contact_area`` or ``joint_shift``, as (f, ...); None if not recorded."""
        if not 0 <= start <= stop <= self.n_frames:
            raise IndexError(f"frames {start} to {stop} of {self.path}, which has {self.n_frames}")
        path = f"frames/{name}"
        return guard.values(self._data(path), start, stop) if path in self._series else None

    @property
    def has_new_contacts(self) -> bool:
        """Whether forces of contacts formed since the start were recorded."""
        return "frames/new_contacts/end" in self._series

    def new_contacts_before(self, frame: int) -> int:
        """Total number of new contacts in all frames before ``frame``; zero if they were not recorded."""
        if not self.has_new_contacts or frame <= 0:
            return 0
        return int(guard.values(self._data("frames/new_contacts/end"), frame - 1, frame)[0])

    def frame_new_contacts(self, start: int, stop: int) -> tuple[np.ndarray, dict[str, np.ndarray]] | None:
        """New contacts of the frames start to stop; None if not recorded. Offsets (f + 1,) of the contacts of each
        frame, and of all of them (c, ...) ``blocks`` (2,), ``point`` (3,) m, ``normal`` (3,) from the first block to
        the second, ``force`` (3,) N on the second, ``torque`` (3,) N m on it about the point, ``area`` m2 and ``slip``
        m; world axes.
        """
        if not 0 <= start <= stop <= self.n_frames:
            raise IndexError(f"frames {start} to {stop} of {self.path}, which has {self.n_frames}")
        if not self.has_new_contacts:
            return None
        first = self.new_contacts_before(start)
        ends = guard.values(self._data("frames/new_contacts/end"), start, stop).astype(np.int64)
        starts = np.concatenate([[first], ends])
        last = int(starts[-1])
        if (np.diff(starts) < 0).any() or not 0 <= first <= last <= len(self._data("frames/new_contacts/area")):
            raise HistoryError(f"{self.path}: frames/new_contacts/end does not fit the contacts of its frames")
        found = {name: guard.values(self._data(f"frames/new_contacts/{name}"), first, last) for name in NEW_CONTACTS}
        blocks = found["blocks"]
        if blocks.size and not 0 <= blocks.min() <= blocks.max() < self.n_block:
            raise HistoryError(f"{self.path}: frames/new_contacts/blocks names a block that does not exist")
        return starts - first, found
