"""The record of a replay: buffers that the compiled loop fills, handed on after every chunk."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from dembrick.kernels.record import Record
from dembrick.simulation import State

Observer = Callable[[Mapping[str, np.ndarray], Mapping[str, np.ndarray]], None]

ENERGIES = ("kinetic", "elastic", "jack_spring", "external", "friction", "dashpots")
BUFFER_BYTES = 64 << 20  # most memory that the frames of one chunk may take


class Recorder:
    """Rows and frames of a run; ``observe(rows, frames)`` gets copies of what each chunk brought.

    ``rows``: time, load, displacement, unbalanced, lower, upper (T,), actuator_displacement and actuator_force (T, k),
    joint (T, j, 7). ``frames``: time (F,), displacement (F, n, 3), orientation (F, n, 4).
    """

    def __init__(self, state: State, observe: Observer, chunk: int, rows_every: int = 1, frames_every: int = 1):
        n_block, n_joint = len(state.blocks.displacement), len(state.joints.block_a)
        rows = chunk // rows_every + 2
        frames = rows // frames_every + 2
        frames = max(2, min(frames, BUFFER_BYTES // (56 * n_block)))
        self._observe, self._weight = observe, state.jacks.weight
        self.record = Record(
            every=np.array([rows_every, frames_every], np.int64),
            count=np.zeros(2, np.int64),
            row=np.empty((rows, 6)),
            actuator=np.empty((rows, len(state.jacks.block))),
            joint=np.empty((rows, n_joint, 7)),
            energy=np.zeros((rows, len(ENERGIES))),
            frame_time=np.empty(frames),
            frame_displacement=np.empty((frames, n_block, 3)),
            frame_orientation=np.empty((frames, n_block, 4)),
        )

    def drain(self) -> None:
        """Hand on what the loop wrote since the last time."""
        record = self.record
        n, f = (int(c) for c in record.count)
        record.count[:] = 0
        columns = record.row[:n].copy().T
        rows = dict(zip(("time", "load", "displacement", "unbalanced", "lower", "upper"), columns, strict=True))
        rows["actuator_displacement"] = record.actuator[:n].copy()
        rows["actuator_force"] = rows["load"][:, None] * self._weight
        rows["joint"] = record.joint[:n].copy()
        rows["energy"] = dict(zip(ENERGIES, record.energy[:n].copy().T, strict=True))
        frames = {
            "time": record.frame_time[:f].copy(),
            "displacement": record.frame_displacement[:f].copy(),
            "orientation": record.frame_orientation[:f].copy(),
        }
        self._observe(rows, frames)
