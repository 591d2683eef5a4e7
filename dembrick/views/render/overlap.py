"""Picture of overlapping blocks: such a scenario cannot be run, so it has no history."""

from __future__ import annotations

import os
from collections.abc import Collection
from typing import TYPE_CHECKING

import numpy as np

from dembrick.assembly.block_shapes import shapes_of
from dembrick.errors import OutputError
from dembrick.geometry.rotations import rotation_matrix, unit_quaternion
from dembrick.history.files import check_output
from dembrick.views.render.annotations import CRIMSON
from dembrick.views.render.images import write_png
from dembrick.views.render.look import VIEWS
from dembrick.views.render.screen import require_drawing

if TYPE_CHECKING:
    from dembrick.scenario.model import Scenario

SIZE = (1200, 900)
_FEW = 8  # greatest number of overlapping blocks whose names are written
_GREY, _OTHERS = "#CFCFCF", 0.25  # colour and opacity of the blocks that do not overlap


def overlap_picture(scenario: Scenario, overlapping: Collection[int], path: str | os.PathLike) -> str:
    """Write a PNG of all blocks, those with the numbers ``overlapping`` in red, the others faint; returns its path."""
    import pyvista

    path = os.fspath(path)
    if os.path.splitext(path)[1].lower() != ".png":
        raise OutputError(f"{path}: a picture is written as PNG; its name must end in .png")
    check_output(path)
    require_drawing()
    plotter = pyvista.Plotter(off_screen=True, window_size=list(SIZE))
    blocks = scenario.all_blocks
    turns = rotation_matrix(unit_quaternion([block.orientation for block in blocks]))
    shapes = shapes_of(blocks, scenario.path_of)
    for i, (block, shape, turn) in enumerate(zip(blocks, shapes, turns, strict=True)):
        points = np.array(block.position) + (shape.centroid + shape.vertices) @ turn.T
        faces = np.concatenate([(len(face), *face) for face in shape.faces])
        mesh, red = pyvista.PolyData(points, faces=faces), i in overlapping
        opacity = 0.7 if red else _OTHERS
        plotter.add_mesh(mesh, color=CRIMSON if red else _GREY, opacity=opacity, show_edges=True, name=block.name)
        if red and len(overlapping) <= _FEW:
            look = {"font_size": 18, "shape": None, "always_visible": True, "show_points": False}
            plotter.add_point_labels(points.mean(axis=0)[None], [block.name], **look)
    plotter.add_axes()  # type: ignore[call-arg]
    direction, up = VIEWS["iso"]
    plotter.camera_position = [direction, (0.0, 0.0, 0.0), up]
    plotter.reset_camera()  # type: ignore[call-arg]
    write_png(plotter.screenshot(return_img=True), path)
    plotter.close()
    return path
