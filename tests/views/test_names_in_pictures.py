"""Names in pictures do not overlap, and the number of omitted names is reported."""

import numpy as np
import pytest

from dembrick import history
from dembrick.runs.simulate import simulate
from dembrick.scenario import toml
from dembrick.views import render
from dembrick.views.render import names, scene
from helpers.scenario_text import header

pyvista = pytest.importorskip("pyvista")

ARCH = (
    header("concave")
    + """
[[arches]]
name = "arch"
material = "stone"
radius = 1.0
thickness = 0.15
depth = 0.4
voussoirs = 17
[control]
kind = "pushover"
direction = [1.0, 0.0, 0.0]
"""
)


def shown(board):
    """Boxes (k, 4) of all drawn names: low and high corners, in pixels."""
    boxes = []
    for own, _ in board.named:
        cloud = own._mapper.GetInput()
        camera, height = board._plotter.camera, board._plotter.window_size[1]
        up = np.array(camera.up)
        axes = np.stack([np.cross(np.array(camera.direction), up), up])
        points = pyvista.wrap(cloud).points.reshape(-1, 3)
        middle = points @ axes.T * height / (2.0 * camera.parallel_scale)
        assert len(middle) == len(own.drawn)
        boxes.append(np.hstack([middle - 0.5 * own.size[own.drawn], middle + 0.5 * own.size[own.drawn]]))
    return np.concatenate(boxes)


def overlaps(boxes):
    """Number of pairs of boxes that overlap."""
    low, high = np.maximum(boxes[:, None, :2], boxes[:, :2]), np.minimum(boxes[:, None, 2:], boxes[:, 2:])
    return int(np.triu((high - low > 0.0).all(axis=2), 1).sum())


def test_names_of_an_arch_do_not_overlap_at_its_crown(tmp_path, drawing):
    simulate(toml.loads(ARCH), tmp_path / "arch.h5")
    with history.read(tmp_path / "arch.h5") as run:
        plotter = pyvista.Plotter(off_screen=True, window_size=[1600, 1200])
        try:
            found = scene.Scene(plotter, run, render.Look("front", names="all"), [run.n_frames - 1])
            board = found._names
            (blocks, _), (joints, _) = board.named
            assert overlaps(shown(board)) == 0
            assert len(blocks.drawn) == len(blocks.points)  # blocks come first and all fit
            assert 0 < board.left_out == len(joints.points) - len(joints.drawn) < len(joints.points)
            assert f"{board.left_out} names left out for lack of space" in found._text.input
            before = board.left_out
            plotter.camera.parallel_scale *= 0.25  # after zooming in, all fit
            found.pixels()
            assert board.left_out == 0 < before and "left out" not in found._text.input
            assert overlaps(shown(board)) == 0
        finally:
            plotter.close()


def test_a_name_steps_aside_by_a_line_before_it_is_left_out(drawing):
    plotter = pyvista.Plotter(off_screen=True, window_size=[400, 300])
    try:
        plotter.enable_parallel_projection()
        plotter.camera_position = [(0.0, -5.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)]
        plotter.camera.parallel_scale = 1.0
        found = names.Names(plotter, ["one", "two", "three", "four"], "black")
        found.show(np.zeros((4, 3)))
        assert names.spread(plotter, [found]) == 1 and found.drawn.tolist() == [0, 1, 2]
        places = pyvista.wrap(found._mapper.GetInput()).points
        assert places[0].tolist() == [0.0, 0.0, 0.0] and places[1, 2] == -places[2, 2] > 0.0
    finally:
        plotter.close()
