"""The rows and frames of a history as mappings of arrays, read when they are asked for and not before."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from dembrick.history.layout import JOINT_CHANNELS
from dembrick.history.reader import read


class Rows(Mapping):
    """Rows as a `Result` has them in memory: series by name, ``joint`` (T, j, 7), ``energy`` by name."""

    def __init__(self, path: str):
        self._path = path

    def __getitem__(self, name: str):
        with read(self._path) as file:
            if name == "joint" and file.has_joints:
                return np.stack([file.joint(channel) for channel in JOINT_CHANNELS], axis=2)
            return file.energy if name == "energy" and file.energy else file.series(name)

    def __iter__(self) -> Iterator[str]:
        with read(self._path) as file:
            names = [name for name in file.series_names("history") if "/" not in name]
            return iter(names + ["joint"] * file.has_joints + ["energy"] * bool(file.energy_names))

    def __len__(self) -> int:
        return len(list(iter(self)))


class Frames(Mapping):
    """All frames, a channel at a time: ``time`` (F,), ``displacement`` (F, n, 3) and so on."""

    def __init__(self, path: str):
        self._path = path

    def __getitem__(self, name: str) -> np.ndarray:
        with read(self._path) as file:
            if name not in file.series_names("frames"):
                raise KeyError(name)
            return file.entries(f"frames/{name}", 0, file.n_frames)

    def __iter__(self) -> Iterator[str]:
        with read(self._path) as file:
            return iter([name for name in file.series_names("frames") if name != "position"])

    def __len__(self) -> int:
        return len(list(iter(self)))
