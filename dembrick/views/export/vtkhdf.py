"""Transient VTKHDF PolyData: one file a layer, every frame in it."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from io import FileIO

import h5py
import numpy as np
from h5py import h5d, h5p, h5s, h5t

from dembrick.history import History, replacing, rewritten
from dembrick.views.export.files import checked_target, writing
from dembrick.views.export.layers import LAYERS, Frames, Layer, NewContacts, Picture

_KINDS = ("Vertices", "Lines", "Polygons", "Strips")  # of cells: VTK wants all four
_HELD = 1 << 22  # bytes of points held at a time


def to_vtkhdf(
    history: History,
    path: str | os.PathLike,
    report: Callable[[str], None] | None = None,
    only: Collection[str] = LAYERS,
) -> list[str]:
    """The blocks at ``path``, the joints at ``<stem>_joints.vtkhdf``, contact forces at ``<stem>_contacts.vtkhdf``,
    those of contacts that formed in the run at ``<stem>_new_contacts.vtkhdf``, ties at ``<stem>_ties.vtkhdf``."""
    target = checked_target(history, path)
    stem, ending = os.path.splitext(target)
    with writing(path), ExitStack() as stack:
        picture = Picture(history, report, only)
        times, first = history.frame_time, picture.span(0, 1)
        files = []
        for suffix, layer in picture.layers.items():
            part = stack.enter_context(replacing(stem + suffix + ending))
            places = _begin(part, layer, layer.frames(first), times)
            files.append((layer, stack.enter_context(open(part, "r+b", buffering=0)), places))
        together = max(1, _HELD // max(1, 24 * sum(layer.n_point for layer, _, _ in files)))
        writer, last = stack.enter_context(ThreadPoolExecutor(1)), None
        for start in range(0, len(times), together):
            span = picture.span(start, min(start + together, len(times)))
            found = [(file, places, _moving(layer.frames(span))) for layer, file, places in files]
            if last is not None:
                last.result()  # no more than two spans are held
            last = writer.submit(_fill, start, found)
        if last is not None:
            last.result()
        for suffix, scattered in picture.scattered.items():
            _scatter(stack.enter_context(replacing(stem + suffix + ending)), scattered, times)
    return [stem + suffix + ending for suffix in (*picture.layers, *picture.scattered)]


def _moving(frames: Frames) -> dict[str, np.ndarray]:
    """What has values for every step, by its place in the file."""
    found = {"Points": frames.points}
    found |= {f"PointData/{name}": values for name, values in frames.at_points.items()}
    return found | {f"CellData/{name}": values for name, values in frames.cells.items()}


def _begin(path: str, layer: Layer, first: Frames, times: np.ndarray) -> dict[str, int]:
    """Write what stays and reserve room for what moves: the connectivity once, points and data for every step.

    Returns where in the file the values of the first step go: they are written past HDF5, which holds Python's lock,
    while the next ones are computed. VTK wants every offset of every step, also those that never move, and all four
    kinds of cells. Points are written in double precision, so that a file shows micrometres; fields for colours and
    arrows in single precision.
    """
    n_step, places = len(times), {}
    with rewritten(path) as (file, check):
        root, steps = _poly_data(file, times)
        for kind in _KINDS:
            cells = layer.cells if kind == layer.kind else []
            group = root.create_group(kind)
            group["NumberOfCells"] = np.array([len(cells)])
            corners = np.concatenate([*cells, ()]).astype(np.int64)
            group["NumberOfConnectivityIds"] = np.array([len(corners)])
            group["Connectivity"] = corners
            group["Offsets"] = np.cumsum([0, *map(len, cells)], dtype=np.int64)
        root["NumberOfPoints"] = np.array([layer.n_point])
        still, step = np.zeros(n_step, np.int64), np.arange(n_step)
        steps["PartOffsets"], steps["NumberOfParts"] = still, still + 1
        steps["PointOffsets"] = step * layer.n_point
        steps["CellOffsets"] = steps["ConnectivityIdOffsets"] = np.zeros((n_step, 4), np.int64)
        for name, values in layer.fixed.items():
            root[f"CellData/{name}"] = values
            check()
            steps[f"CellDataOffsets/{name}"] = still
        for place, values in _moving(first).items():
            count = values.shape[1]
            shape = h5s.create_simple((n_step * count, *values.shape[2:]))
            data = h5d.create(root.id, place.encode(), h5t.py_create(values.dtype), shape, _reserved(), _links())
            places[place] = data.get_offset()
            if place != "Points":
                kind, _, name = place.partition("/")
                steps[f"{kind}Offsets/{name}"] = step * count
    return places


def _poly_data(file: h5py.File, times: np.ndarray) -> tuple[h5py.Group, h5py.Group]:
    """The groups of a PolyData, and of its steps."""
    root = file.create_group("VTKHDF")
    root.attrs["Version"] = np.array([2, 2])
    root.attrs.create("Type", b"PolyData", dtype=h5py.string_dtype("ascii", 8))
    steps = root.create_group("Steps")
    steps.attrs["NSteps"] = len(times)
    steps["Values"] = times
    return root, steps


def _scatter(path: str, layer: NewContacts, times: np.ndarray) -> None:
    """Vertices that are others in every step: each step is a part of its own, with its connectivity."""
    n_step, together = len(times), max(1, _HELD // 10_000)
    with rewritten(path) as (file, check):
        root, steps = _poly_data(file, times)
        counts = np.concatenate(
            [np.diff(layer.frames(k, min(k + together, n_step))[0]) for k in range(0, n_step, together)]
        )
        total, first = int(counts.sum()), np.cumsum([0, *counts[:-1]])
        for kind in _KINDS:
            own = counts if kind == "Vertices" else np.zeros_like(counts)
            group = root.create_group(kind)
            group["NumberOfCells"] = group["NumberOfConnectivityIds"] = own
            group["Connectivity"] = np.concatenate([*map(np.arange, own), ()]).astype(np.int64)
            group["Offsets"] = np.concatenate([np.arange(count + 1) for count in own]).astype(np.int64)
        root["NumberOfPoints"] = counts
        step = np.arange(n_step)
        steps["PartOffsets"], steps["NumberOfParts"], steps["PointOffsets"] = step, np.ones_like(step), first
        before = np.zeros((n_step, len(_KINDS)), np.int64)
        before[:, 0] = first
        steps["CellOffsets"] = steps["ConnectivityIdOffsets"] = before
        for start in range(0, n_step, together):
            starts, points, values = layer.frames(start, min(start + together, n_step))
            for name, array in {"Points": points, **{f"PointData/{name}": v for name, v in values.items()}}.items():
                if name not in root:
                    root.create_dataset(name, (total, *array.shape[1:]), array.dtype)
                    if name != "Points":
                        steps[f"PointDataOffsets/{name.removeprefix('PointData/')}"] = first
                if len(array):
                    root[name][first[start] : first[start] + starts[-1]] = array
            check()


def _reserved():
    """A dataset in one piece, with its place in the file from the start and nothing in it."""
    how = h5p.create(h5p.DATASET_CREATE)
    how.set_layout(h5d.CONTIGUOUS)
    how.set_alloc_time(h5d.ALLOC_TIME_EARLY)
    how.set_fill_time(h5d.FILL_TIME_NEVER)
    return how


def _links():
    """Groups on the way to a dataset are made."""
    how = h5p.create(h5p.LINK_CREATE)
    how.set_create_intermediate_group(True)
    return how


def _fill(start: int, found: list[tuple[FileIO, dict[str, int], dict[str, np.ndarray]]]) -> None:
    """Put the values (f, n, ...) of frame ``start`` and those after it into their places."""
    for file, places, moving in found:
        for name, values in moving.items():
            if values.size:
                file.seek(places[name] + start * values[0].nbytes)
                rest = memoryview(np.ascontiguousarray(values)).cast("B")
                while len(rest):
                    rest = rest[file.write(rest) :]
