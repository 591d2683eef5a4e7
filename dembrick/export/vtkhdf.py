"""Transient VTKHDF PolyData: one file a layer, every frame in it."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection
from contextlib import ExitStack

import h5py
import numpy as np

from dembrick.export.files import checked_target, writing
from dembrick.export.layers import LAYERS, Frames, Layer, Picture
from dembrick.history import History, replacing

_HELD = 1 << 22  # bytes of points held at a time


def to_vtkhdf(
    history: History,
    path: str | os.PathLike,
    report: Callable[[str], None] | None = None,
    only: Collection[str] = LAYERS,
) -> list[str]:
    """The blocks at ``path``, the joints at ``<stem>_joints.vtkhdf``, contact forces at ``<stem>_contacts.vtkhdf``."""
    target = checked_target(history, path)
    stem, ending = os.path.splitext(target)
    with writing(path), ExitStack() as stack:
        picture = Picture(history, report, only)
        times, first = history.frame_time, picture.span(0, 1)
        files = []
        for suffix, layer in picture.layers.items():
            part = stack.enter_context(replacing(stem + suffix + ending))
            files.append((layer, _begin(stack.enter_context(h5py.File(part, "w")), layer, layer.frames(first), times)))
        together = max(1, _HELD // max(1, 24 * sum(layer.n_point for layer, _ in files)))
        for start in range(0, len(times), together):
            span = picture.span(start, min(start + together, len(times)))
            for layer, moving in files:
                frames = layer.frames(span)
                for name, values in _moving(frames).items():
                    _fill(moving[name], start, values)
    return [stem + suffix + ending for suffix in picture.layers]


def _moving(frames: Frames) -> dict[str, np.ndarray]:
    """What has values for every step, by its place in the file."""
    found = {"Points": frames.points}
    found |= {f"PointData/{name}": values for name, values in frames.at_points.items()}
    return found | {f"CellData/{name}": values for name, values in frames.cells.items()}


def _begin(file: h5py.File, layer: Layer, first: Frames, times: np.ndarray) -> dict[str, h5py.Dataset]:
    """Write what stays and make room for what moves: the connectivity once, points and data for every step.

    VTK wants every offset of every step, also those that never move, and all four kinds of cells. Points are written
    in double precision, so that a file shows micrometres; fields for colours and arrows in single precision.
    """
    n_step = len(times)
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
    root["NumberOfPoints"] = np.array([layer.n_point])
    steps = root.create_group("Steps")
    steps.attrs["NSteps"] = n_step
    steps["Values"] = times
    still, step = np.zeros(n_step, np.int64), np.arange(n_step)
    steps["PartOffsets"], steps["NumberOfParts"] = still, still + 1
    steps["PointOffsets"] = step * layer.n_point
    steps["CellOffsets"] = steps["ConnectivityIdOffsets"] = np.zeros((n_step, 4), np.int64)
    for name, values in layer.fixed.items():
        root[f"CellData/{name}"] = values
        steps[f"CellDataOffsets/{name}"] = still
    moving = {}
    for path, values in _moving(first).items():
        count = values.shape[1]
        moving[path] = root.create_dataset(path, (n_step * count, *values.shape[2:]), values.dtype)
        if path != "Points":
            kind, _, name = path.partition("/")
            steps[f"{kind}Offsets/{name}"] = step * count
    return moving


def _fill(data: h5py.Dataset, start: int, values: np.ndarray) -> None:
    """Put frames (f, n, ...) into the place of frame ``start`` and those after it."""
    count = values.shape[1]
    data[start * count : (start + len(values)) * count] = values.reshape(-1, *values.shape[2:])
