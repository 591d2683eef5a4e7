"""Series of .vtu files with a .pvd list, for programs that do not read VTKHDF."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Collection, Iterator
from contextlib import ExitStack, contextmanager, suppress
from typing import TYPE_CHECKING
from xml.sax.saxutils import quoteattr

import numpy as np

from dembrick.errors import OutputError, needed
from dembrick.history import History, part_name, replacing
from dembrick.history.files import writing
from dembrick.views.export.files import checked_target
from dembrick.views.export.layers import LAYERS, Layer, NewContacts, Picture

if TYPE_CHECKING:
    import meshio

_WHAT = "the export to .pvd"
_NAMES = {1: "vertex", 2: "line", 3: "triangle", 4: "quad"}


def to_pvd(
    history: History,
    path: str | os.PathLike,
    report: Callable[[str], None] | None = None,
    only: Collection[str] = LAYERS,
) -> list[str]:
    """Write a ``.pvd`` list for each layer, and the frames as ``.vtu`` files in the folder ``<stem>_frames``."""
    meshio = needed("meshio", _WHAT)
    target = checked_target(history, path)
    stem, ending = os.path.splitext(target)
    times, lists = history.frame_time, {}
    place = os.path.basename(f"{stem}_frames")
    with writing(path, "export"), ExitStack() as lists_written, _new_folder(f"{stem}_frames") as folder:
        picture = Picture(history, report, only)
        layers = {suffix: _meshes(picture, layer, len(times)) for suffix, layer in picture.layers.items()}
        layers |= {suffix: _vertices(layer, len(times)) for suffix, layer in picture.scattered.items()}
        for suffix, meshes in layers.items():
            names = [f"{os.path.basename(stem + suffix)}_{k:05d}.vtu" for k in range(len(times))]
            for name, mesh in zip(names, meshes, strict=True):
                meshio.write(os.path.join(folder, name), mesh, file_format="vtu")
            lists[stem + suffix + ending] = names
        for name, frames in lists.items():
            _list(lists_written.enter_context(replacing(name)), [f"{place}/{frame}" for frame in frames], times)
        for name in lists:  # all is written: from here on a list of an earlier export would name the new frames
            with suppress(FileNotFoundError):
                os.unlink(name)
    return [*lists, *(os.path.join(f"{stem}_frames", frame) for frames in lists.values() for frame in frames)]


@contextmanager
def _new_folder(folder: str) -> Iterator[str]:
    """A temporary folder to write into, renamed to ``folder`` when complete, in place of that of an earlier export."""
    if os.path.exists(folder) and not (
        os.path.isdir(folder) and all(name.endswith(".vtu") for name in os.listdir(folder))
    ):
        raise OutputError(f"{folder}: this folder holds files other than frames of an export; choose another name")
    part, old = part_name(folder), f"{part_name(folder)}.old"
    shutil.rmtree(part, ignore_errors=True)
    os.mkdir(part)
    try:
        yield part
        if os.path.exists(folder):
            os.rename(folder, old)
        os.rename(part, folder)
    finally:
        shutil.rmtree(part, ignore_errors=True)
        shutil.rmtree(old, ignore_errors=True)


def _meshes(picture: Picture, layer: Layer, count: int) -> Iterator[meshio.Mesh]:
    """The mesh of one layer in each of the first ``count`` frames."""
    kinds: dict[int, list[int]] = {}
    for cell, corners in enumerate(layer.cells):
        kinds.setdefault(len(corners), []).append(cell)
    cells = [(_NAMES.get(n, "polygon"), np.array([layer.cells[i] for i in own], np.int64)) for n, own in kinds.items()]
    for k in range(count):
        frame = layer.frames(picture.span(k, k + 1))
        data = layer.fixed | {name: values[0] for name, values in frame.cells.items()}
        yield needed("meshio", _WHAT).Mesh(
            frame.points[0],
            cells,
            point_data={name: values[0] for name, values in frame.at_points.items()},
            cell_data={name: [values[own] for own in kinds.values()] for name, values in data.items()},
        )


def _vertices(layer: NewContacts, count: int) -> Iterator[meshio.Mesh]:
    """The vertices of new contacts in each of the first ``count`` frames."""
    for k in range(count):
        _, points, values = layer.frames(k, k + 1)
        yield needed("meshio", _WHAT).Mesh(points, [("vertex", np.arange(len(points))[:, None])], point_data=values)


def _list(target: str, files: list[str], times: np.ndarray) -> None:
    """Write the list of the frames of a layer."""
    with open(target, "w", encoding="utf-8") as file:
        file.write('<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n<Collection>\n')
        for time, name in zip(times.tolist(), files, strict=True):
            file.write(f'<DataSet timestep="{time!r}" part="0" file={quoteattr(name)}/>\n')
        file.write("</Collection>\n</VTKFile>\n")
