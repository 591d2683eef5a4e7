"""Series of .vtu files with a .pvd list, for programs that do not read VTKHDF."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection
from contextlib import suppress
from xml.sax.saxutils import quoteattr

import numpy as np

from dembrick.errors import MissingDependency
from dembrick.history import History, replacing
from dembrick.views.export.files import checked_target, writing
from dembrick.views.export.layers import LAYERS, Layer, NewContacts, Picture

_NAMES = {1: "vertex", 3: "triangle", 4: "quad"}


def to_pvd(
    history: History,
    path: str | os.PathLike,
    report: Callable[[str], None] | None = None,
    only: Collection[str] = LAYERS,
) -> list[str]:
    """A ``.pvd`` list of each layer and one ``.vtu`` a frame, ``<stem>_00000.vtu``, beside it."""
    try:
        import meshio  # noqa: F401 - asked for before anything is written
    except ImportError as error:
        raise MissingDependency("the export to .pvd needs meshio: pip install meshio") from error
    target = checked_target(history, path)
    stem, ending = os.path.splitext(target)
    lists, frames = [], []
    with writing(path):
        picture = Picture(history, report, only)
        for suffix, layer in picture.layers.items():
            own = stem + suffix
            written = _series(picture, layer, own + ending, own, history.frame_time)
            lists.append(own + ending)
            frames += written
        for suffix, scattered in picture.scattered.items():
            own = stem + suffix
            frames += _written(own + ending, own, history.frame_time, lambda k, layer=scattered: _vertices(layer, k))
            lists.append(own + ending)
    return lists + frames


def _series(picture: Picture, layer: Layer, target: str, stem: str, times: np.ndarray) -> list[str]:
    """The files of one layer."""
    import meshio

    kinds: dict[int, list[int]] = {}
    for cell, corners in enumerate(layer.cells):
        kinds.setdefault(len(corners), []).append(cell)
    cells = [(_NAMES.get(n, "polygon"), np.array([layer.cells[i] for i in own], np.int64)) for n, own in kinds.items()]

    def mesh(k: int) -> meshio.Mesh:
        frame = layer.frames(picture.span(k, k + 1))
        data = layer.fixed | {name: values[0] for name, values in frame.cells.items()}
        return meshio.Mesh(
            frame.points[0],
            cells,
            point_data={name: values[0] for name, values in frame.at_points.items()},
            cell_data={name: [values[own] for own in kinds.values()] for name, values in data.items()},
        )

    return _written(target, stem, times, mesh)


def _vertices(layer: NewContacts, k: int):
    """A mesh of the vertices that there are in frame ``k``."""
    import meshio

    _, points, values = layer.frames(k, k + 1)
    return meshio.Mesh(points, [("vertex", np.arange(len(points))[:, None])], point_data=values)


def _written(target: str, stem: str, times: np.ndarray, mesh: Callable) -> list[str]:
    """Write ``mesh(k)`` of every frame and the list of them; the list last, because an older list must not name the
    frames of this one."""
    import meshio

    with suppress(FileNotFoundError):
        os.unlink(target)
    written = []
    for k in range(len(times)):
        written.append(f"{stem}_{k:05d}.vtu")
        with replacing(written[-1]) as part:
            meshio.write(part, mesh(k), file_format="vtu")
    with replacing(target) as part, open(part, "w", encoding="utf-8") as file:
        file.write('<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n<Collection>\n')
        for time, name in zip(times.tolist(), written, strict=True):
            file.write(f'<DataSet timestep="{time!r}" part="0" file={quoteattr(os.path.basename(name))}/>\n')
        file.write("</Collection>\n</VTKFile>\n")
    return written
