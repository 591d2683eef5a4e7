"""Transient VTKHDF PolyData: one file per layer, with all frames."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection
from contextlib import ExitStack

import h5py
import numpy as np

from dembrick.history import History, replacing, rewritten
from dembrick.history.files import writing
from dembrick.views.export.files import checked_target
from dembrick.views.export.layers import LAYERS, Frames, Layer, NewContacts, Picture

_KINDS = ("Vertices", "Lines", "Polygons", "Strips")  # of cells: VTK requires all four
_HELD = 1 << 22  # bytes of points in memory at a time


def to_vtkhdf(
    history: History,
    path: str | os.PathLike,
    report: Callable[[str], None] | None = None,
    only: Collection[str] = LAYERS,
) -> list[str]:
    """Write the blocks to ``path``, joints to ``<stem>_joints.vtkhdf``, contact forces to ``<stem>_contacts.vtkhdf``,
    contacts formed during the run to ``<stem>_new_contacts.vtkhdf`` and ties to ``<stem>_ties.vtkhdf``."""
    target = checked_target(history, path)
    stem, ending = os.path.splitext(target)
    with writing(path, "export"), ExitStack() as stack:
        picture = Picture(history, report, only)
        times, files = history.frame_time, []
        for suffix, layer in picture.layers.items():
            part = stack.enter_context(replacing(stem + suffix + ending))
            file, check = stack.enter_context(rewritten(part))
            _begin(file, layer, times)
            files.append((layer, file["VTKHDF"], check))
        together = max(1, _HELD // max(1, 24 * sum(layer.n_point for layer, _, _ in files)))
        for start in range(0, len(times), together):
            span = picture.span(start, min(start + together, len(times)))
            for layer, root, check in files:
                for name, values in _moving(layer.frames(span)).items():
                    flat = values.reshape(-1, *values.shape[2:])
                    _put(root, name, flat, start * values.shape[1], len(times) * values.shape[1])
                check()
        step = np.arange(len(times))
        for layer, root, _ in files:
            _offsets(root, step * layer.n_point, step * len(layer.cells), fixed=layer.fixed)
        for suffix, scattered in picture.scattered.items():
            _scatter(stack.enter_context(replacing(stem + suffix + ending)), scattered, times)
    return [stem + suffix + ending for suffix in (*picture.layers, *picture.scattered)]


def _moving(frames: Frames) -> dict[str, np.ndarray]:
    """Arrays with values for every step, by their path in the file."""
    found = {"Points": frames.points}
    found |= {f"PointData/{name}": values for name, values in frames.at_points.items()}
    return found | {f"CellData/{name}": values for name, values in frames.cells.items()}


def _begin(file: h5py.File, layer: Layer, times: np.ndarray) -> None:
    """Write the constant data: the connectivity once. VTK requires all offsets of every step, even constant ones, and
    all four kinds of cells."""
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
    still = np.zeros(len(times), np.int64)
    steps["PartOffsets"], steps["NumberOfParts"] = still, still + 1
    steps["CellOffsets"] = steps["ConnectivityIdOffsets"] = np.zeros((len(times), 4), np.int64)
    for name, values in layer.fixed.items():
        root[f"CellData/{name}"] = values


def _put(root: h5py.Group, name: str, values: np.ndarray, first: int, total: int) -> None:
    """Write values (n, ...) from row ``first`` on into a dataset of ``total`` rows, created at the first call.

    Points are in double precision, to resolve micrometres; fields for colours and arrows in single precision.
    """
    if name not in root:
        root.create_dataset(name, (total, *values.shape[1:]), values.dtype)
    if len(values):
        root[name][first : first + len(values)] = values


def _offsets(root: h5py.Group, points: np.ndarray, cells: np.ndarray, fixed: Collection[str] = ()) -> None:
    """Write the offsets of the points and cells of every step; zero for the ``fixed`` fields, stored once."""
    root["Steps/PointOffsets"] = points
    for kind, first in (("PointData", points), ("CellData", cells)):
        for name in root.get(kind, ()):
            root[f"Steps/{kind}Offsets/{name}"] = np.zeros_like(first) if name in fixed else first


def _poly_data(file: h5py.File, times: np.ndarray) -> tuple[h5py.Group, h5py.Group]:
    """Create the groups of a PolyData and of its steps."""
    root = file.create_group("VTKHDF")
    root.attrs["Version"] = np.array([2, 2])
    root.attrs.create("Type", b"PolyData", dtype=h5py.string_dtype("ascii", 8))
    steps = root.create_group("Steps")
    steps.attrs["NSteps"] = len(times)
    steps["Values"] = times
    return root, steps


def _scatter(path: str, layer: NewContacts, times: np.ndarray) -> None:
    """Write vertices that change from step to step: each step is a part of its own, with its connectivity."""
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
        steps["PartOffsets"], steps["NumberOfParts"] = step, np.ones_like(step)
        before = np.zeros((n_step, len(_KINDS)), np.int64)
        before[:, 0] = first
        steps["CellOffsets"] = steps["ConnectivityIdOffsets"] = before
        for start in range(0, n_step, together):
            starts, points, values = layer.frames(start, min(start + together, n_step))
            for name, array in {"Points": points, **{f"PointData/{name}": v for name, v in values.items()}}.items():
                _put(root, name, array, first[start], total)
            check()
        _offsets(root, first, first)
