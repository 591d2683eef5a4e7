"""Transient VTKHDF PolyData: one file a layer, every frame in it."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection

import h5py
import numpy as np

from dembrick.export.files import checked_target, writing
from dembrick.export.layers import LAYERS, Layer, layers
from dembrick.history import History, replacing

_HELD = 1 << 20  # bytes of points held at a time


def to_vtkhdf(
    history: History,
    path: str | os.PathLike,
    report: Callable[[str], None] | None = None,
    only: Collection[str] = LAYERS,
) -> list[str]:
    """The blocks at ``path``, the joints at ``<stem>_joints.vtkhdf``, contact forces at ``<stem>_contacts.vtkhdf``."""
    target = checked_target(history, path)
    stem, ending = os.path.splitext(target)
    written = []
    with writing(path):
        for suffix, layer in layers(history, report, only):
            written.append(stem + suffix + ending)
            _write(written[-1], layer, history.frame_time)
    return written


def _write(target: str, layer: Layer, times: np.ndarray) -> None:
    """One file, some frames at a time: the connectivity once, points and data for every step.

    VTK wants every offset of every step, also those that never move, and all four kinds of cells. Points are written
    in double precision, so that a file shows micrometres; fields for colours and arrows in single precision.
    """
    first = layer.frames(0, 1)
    n_step, n_point, n_cell = len(times), first.points.shape[1], len(layer.cells)
    with replacing(target) as part, h5py.File(part, "w") as file:
        root = file.create_group("VTKHDF")
        root.attrs["Version"] = np.array([2, 2])
        root.attrs.create("Type", b"PolyData", dtype=h5py.string_dtype("ascii", 8))
        for kind in ("Vertices", "Lines", "Polygons", "Strips"):
            cells = layer.cells if kind == layer.kind else []
            group = root.create_group(kind)
            group["NumberOfCells"] = np.array([len(cells)])
            corners = np.concatenate([*cells, ()]).astype(np.int64)
            group["NumberOfConnectivityIds"] = np.array([len(corners)])
            group["Connectivity"] = corners
            group["Offsets"] = np.cumsum([0, *map(len, cells)], dtype=np.int64)
        root["NumberOfPoints"] = np.array([n_point])
        steps = root.create_group("Steps")
        steps.attrs["NSteps"] = n_step
        steps["Values"] = times
        still, step = np.zeros(n_step, np.int64), np.arange(n_step)
        steps["PartOffsets"], steps["NumberOfParts"] = still, still + 1
        steps["PointOffsets"] = step * n_point
        steps["CellOffsets"] = steps["ConnectivityIdOffsets"] = np.zeros((n_step, 4), np.int64)
        for name, values in layer.fixed.items():
            root[f"CellData/{name}"] = values
            steps[f"CellDataOffsets/{name}"] = still
        moving = {"Points": root.create_dataset("Points", (n_step * n_point, 3), np.float64)}
        for kind, data, count in (("PointData", first.at_points, n_point), ("CellData", first.cells, n_cell)):
            for name, values in data.items():
                path, shape = f"{kind}/{name}", (n_step * count, *values.shape[2:])
                moving[path] = root.create_dataset(path, shape, values.dtype)
                steps[f"{kind}Offsets/{name}"] = step * count
        together = max(1, _HELD // max(1, 24 * n_point))
        for start in range(0, n_step, together):
            frames = layer.frames(start, min(start + together, n_step))
            _fill(moving["Points"], start, frames.points)
            for kind, data in (("PointData", frames.at_points), ("CellData", frames.cells)):
                for name, values in data.items():
                    _fill(moving[f"{kind}/{name}"], start, values)


def _fill(data: h5py.Dataset, start: int, values: np.ndarray) -> None:
    """Put frames (f, n, ...) into the place of frame ``start`` and those after it."""
    count = values.shape[1]
    data[start * count : (start + len(values)) * count] = values.reshape(-1, *values.shape[2:])
