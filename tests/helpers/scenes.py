"""Scenes drawn off screen."""

from contextlib import contextmanager

import numpy as np

from dembrick.views import render
from dembrick.views.render import scene


@contextmanager
def drawn(run, frames=(3,), **look):
    """A small scene drawn off screen."""
    import pyvista

    plotter = pyvista.Plotter(off_screen=True, window_size=[320, 240])
    try:
        yield scene.Scene(plotter, run, render.Look(**look), frames)
    finally:
        plotter.close()


def in_picture(plotter, points):
    """Positions of points in the picture, as fractions of its width and height."""
    plotter.render()
    camera, (width, height) = plotter.camera, plotter.window_size
    across = points - np.array(camera.focal_point)
    up = np.array(camera.up)
    right = np.cross(np.array(camera.direction), up)
    x = 0.5 + across @ right / (2 * camera.parallel_scale) * height / width
    return x, 0.5 + across @ up / (2 * camera.parallel_scale)


def rodrigues(v, axis, angle):
    return v * np.cos(angle) + np.cross(axis, v) * np.sin(angle) + np.outer(v @ axis, axis) * (1 - np.cos(angle))
