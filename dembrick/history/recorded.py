"""Rows and frames of a history as mappings of arrays, which are read on access."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from dembrick.history.reader import read
from dembrick.simulation.channels import JOINT_CHANNELS


class _Recorded(Mapping):
    def __init__(self, path: str):
        self._path = path

    def __len__(self) -> int:
        return len(list(iter(self)))


class Rows(_Recorded):
    """Rows as in a `Result` in memory: series by name, ``joint`` (T, j, 7), ``energy`` by name."""

    def __getitem__(self, name: str):
        with read(self._path) as file:
            if name == "joint" and file.has_joints:
                return np.stack([file.joint(channel) for channel in JOINT_CHANNELS], axis=2)
            return file.energy if name == "energy" and file.energy else file.series(name)

    def __iter__(self) -> Iterator[str]:
        with read(self._path) as file:
            names = [name for name in file.series_names("history") if "/" not in name]
            return iter(names + ["joint"] * file.has_joints + ["energy"] * bool(file.energy_names))


class Frames(_Recorded):
    """All frames, by channel: ``time`` (F,), ``displacement`` (F, n, 3) and so on; ``new_contacts`` is a mapping of the
    ``count`` (F,) per frame and arrays of all contacts (C, ...)."""

    def __getitem__(self, name: str):
        with read(self._path) as file:
            if name == "new_contacts" and file.has_new_contacts:
                starts, found = file.frame_new_contacts(0, file.n_frames)
                return {"count": np.diff(starts), **found}
            if name not in file.series_names("frames") or "/" in name:
                raise KeyError(name)
            return file.entries(f"frames/{name}", 0, file.n_frames)

    def __iter__(self) -> Iterator[str]:
        with read(self._path) as file:
            names = [name for name in file.series_names("frames") if name != "position" and "/" not in name]
            return iter(names + ["new_contacts"] * file.has_new_contacts)
