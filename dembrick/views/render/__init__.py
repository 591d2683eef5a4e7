"""Pictures and movies of the moving blocks, drawn by pyvista without a display, and an interactive window."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Unpack

import numpy as np

from dembrick.errors import OutputError, ScenarioError
from dembrick.history.files import check_output
from dembrick.views.given import accepts_paths
from dembrick.views.motion.blocks import CarriedPoints, Poses, all_vertices
from dembrick.views.motion.frames import LAST, frame_number, nearest
from dembrick.views.motion.magnification import automatic_magnification
from dembrick.views.render import images
from dembrick.views.render.images import MOVIES, write_png
from dembrick.views.render.look import Look, LookOptions
from dembrick.views.render.scene import Scene
from dembrick.views.render.screen import require_display, require_drawing

if TYPE_CHECKING:
    import pyvista

    from dembrick.history.reader import History

SIZE = (1600, 1200)  # pixels of a picture
MOVIE_SIZE = (960, 720)
MOVIE_FRAMES = 100  # default for the greatest number of frames of a movie
EVEN = 0.01  # of the time between two frames: frames that deviate by less count as evenly spaced


@accepts_paths
def meshes(
    history: History, frame: int | str | None = None, magnification: float = 1.0, time: float | None = None
) -> pyvista.MultiBlock:
    """The blocks in one frame as a MultiBlock of PolyData, by name, with ``displacement`` (m, true) at the vertices.

    ``frame``: "peak", "last" or a number; None is the peak of a search, else the last. ``time`` (s) selects the nearest
    frame instead. ``magnification`` multiplies the translation and the rotation angle of each block.
    """
    import pyvista

    number = frame_number(history, frame, time)
    body, block, starts = all_vertices(history)
    carried, poses = CarriedPoints(history, body, block), Poses.read(history, number, number + 1)
    drawn, moved = carried.magnified(poses, magnification)[0], carried.moved(poses)[0]
    blocks = pyvista.MultiBlock()
    for i, name in enumerate(history.block_names):
        own = slice(starts[i], starts[i + 1])
        faces = np.concatenate([(len(face), *face) for face in history.block_faces(i)])
        mesh = pyvista.PolyData(drawn[own].copy(), faces=faces)
        mesh.point_data["displacement"] = np.linalg.norm(moved[own], axis=1)
        blocks.append(mesh, name)
    return blocks


@accepts_paths
def picture(
    history: History | Sequence[History],
    path: str | os.PathLike,
    *,
    frame: int | str | None = None,
    time: float | None = None,
    size: tuple[int, int] | None = None,
    **look: Unpack[LookOptions],
) -> str:
    """Write a PNG of one frame: blocks, their initial positions, actuators, torsion centre; returns the path.

    Several histories are drawn side by side, to one scale, with the same colours and magnification. ``frame`` is
    "peak", "last" or a number, negative from the end; None is the peak of a search, else the last. ``time`` (s)
    selects the nearest frame instead. ``look``: the fields of :class:`dembrick.views.render.look.Look`.
    """
    path, chosen, histories = os.fspath(path), Look(**look), _several(history)
    if os.path.splitext(path)[1].lower() != ".png":
        raise OutputError(f"{path}: a picture is written as PNG; its name must end in .png")
    check_output(path)  # before the work
    frames = [[frame_number(own, frame, time, in_rows=chosen.needs_forces)] for own in histories]
    with _scenes(histories, chosen, frames, size or SIZE, smooth=True) as scenes:
        write_png(_pixels(scenes), path)
    return path


@accepts_paths
def movie(
    history: History | Sequence[History],
    path: str | os.PathLike,
    *,
    size: tuple[int, int] | None = None,
    fps: float = 20.0,
    count: int = MOVIE_FRAMES,
    progress: Callable[[int, int], None] | None = None,
    **look: Unpack[LookOptions],
) -> str:
    """Write the motion as an animated GIF or an MP4, by the ending of ``path``; returns the path.

    At most ``count`` frames, ``fps`` per second, chosen by :func:`movie_frames`; other arguments as for
    :func:`picture`. MP4 needs the extra ``movie``.
    """
    path, chosen, histories = os.fspath(path), Look(**look), _several(history)
    if os.path.splitext(path)[1].lower() not in MOVIES:
        raise OutputError(f"{path}: a movie is written as {' or '.join(MOVIES)}; its name must end in one of these")
    if not (np.isfinite(fps) and 0.1 <= fps <= 100.0):
        raise ScenarioError(f"fps = {fps!r} is out of range: 0.1 to 100 frames a second")
    if count < 2:
        raise ScenarioError(f"count = {count!r} is out of range: a movie needs at least 2 frames")
    target = check_output(path)
    frames = frames_side_by_side(histories, count)
    images.require(path)
    # anti-aliasing would take most of the time of a movie
    with _scenes(histories, chosen, frames, size or MOVIE_SIZE, smooth=False) as scenes:
        # the scenes show their last frames, which have the most colours
        sample = _pixels(scenes)[..., :3]
        sample = np.concatenate([sample, scenes[0].shades(sample.shape[1])])
        with images.movie(path, target, fps, sample) as add:
            for done, numbers in enumerate(zip(*frames, strict=True)):
                for scene, number in zip(scenes, numbers, strict=True):
                    scene.show(number)
                add(_pixels(scenes))
                if progress:
                    progress(done + 1, len(frames[0]))
    return path


def _several(history: History | Sequence[History]) -> list[History]:
    return list(history) if isinstance(history, list | tuple) else [history]


@contextmanager
def _scenes(
    histories: list[History], look: Look, frames: list[list[int]], size: tuple[int, int], smooth: bool
) -> Iterator[list[Scene]]:
    """A scene for each history, for display side by side: to one scale, with the same colours and magnification."""
    require_drawing()
    if len(histories) > 1 and look.magnification is None:
        factors = [automatic_magnification(own, numbers) for own, numbers in zip(histories, frames, strict=True)]
        look = replace(look, magnification=min(factors))
    names = [os.path.splitext(os.path.basename(own.path))[0] if len(histories) > 1 else "" for own in histories]
    plotters = []
    try:
        scenes = []
        for own, numbers, name in zip(histories, frames, names, strict=True):
            plotters.append(_plotter(size, smooth))
            scenes.append(Scene(plotters[-1], own, look, sorted(set(numbers)), name=name, waits=True))
        largest, whole = max(scene.largest for scene in scenes), max(scene.whole for scene in scenes)
        for scene in scenes:
            scene.build(largest, whole)
        yield scenes
    finally:
        for plotter in plotters:
            plotter.close()


def _pixels(scenes: list[Scene]) -> np.ndarray:
    """Pixels (h, w, 3) of the scenes side by side."""
    return np.concatenate([scene.pixels()[..., :3] for scene in scenes], axis=1)


def frames_side_by_side(histories: list[History], count: int) -> list[list[int]]:
    """The frames of a movie of several histories, at most ``count`` and equally many of each.

    Frames at equal times; a run that has ended keeps its last frame. For equilibria, frames at equal parts of the run.
    """
    if len(histories) == 1:
        return [movie_frames(histories[0], count)]
    lasts = [frame_number(history, LAST) for history in histories]
    if any(history.counts_equilibria for history in histories):
        count = min(count, max(lasts) + 1)
        return [np.round(np.linspace(0, last, count)).astype(int).tolist() for last in lasts]
    times = [history.frame_time for history in histories]
    wanted = np.linspace(min(own[0] for own in times), max(own[-1] for own in times), count)
    return [nearest(own, wanted).tolist() for own in times]


def movie_frames(history: History, count: int) -> list[int]:
    """The frames of a movie, at most ``count``, such that equal times of the run take equal times of the movie.

    All frames if there are few enough and they are evenly spaced in time (except the last, when the run ended);
    else those nearest to moments spread evenly over the run, repeated as long as they are the nearest. Equilibria,
    which have no time, are spread evenly by their numbers. Raises HistoryError if there are no frames.
    """
    last, times = frame_number(history, LAST), history.frame_time
    steps = np.diff(times)
    even = last < 2 or (np.ptp(steps[:-1]) <= EVEN * steps[:-1].max() and steps[-1] <= (1.0 + EVEN) * steps[:-1].max())
    if history.counts_equilibria or (even and last < count) or not times[-1] > times[0]:
        return np.unique(np.round(np.linspace(0, last, min(count, last + 1))).astype(int)).tolist()
    return nearest(times, np.linspace(times[0], times[-1], count)).tolist()


@accepts_paths
def view(history: History, **look: Unpack[LookOptions]) -> None:
    """Open a window with a time slider; the arrow keys step from frame to frame. Returns when it is closed.

    ``look`` as for :func:`picture`.
    """
    chosen = Look(**look)
    frame_number(history)
    require_display()
    import pyvista

    plotter = pyvista.Plotter(window_size=[1280, 960], title=f"dembrick: {history.title}")
    with_slider(plotter, history, chosen)
    plotter.show()


def with_slider(plotter, history: History, look: Look) -> Scene:
    """The scene of a history in a plotter, with a slider for the time and the arrow keys for single frames."""
    last = frame_number(history, LAST)
    every = max(1, last // MOVIE_FRAMES)
    scene = Scene(plotter, history, look, sorted({*range(0, last + 1, every), last}), below=0.19 if last else 0.04)
    times = history.frame_time
    if last == 0:
        return scene

    def to_time(time: float) -> None:
        frame = int(nearest(times, [time])[0])
        if frame != scene.frame:
            scene.show(frame)

    slider = plotter.add_slider_widget(
        to_time,
        (float(times[0]), float(times[-1])),
        value=float(times[-1]),
        title="equilibrium" if history.counts_equilibria else "time [s]",
        pointa=(0.1, 0.085),
        pointb=(0.8, 0.085),
        color="black",
        slider_width=0.03,
        tube_width=0.004,
        title_height=0.022,
        fmt="%.4g",
        interaction_event="always",
    )

    def step(by: int) -> None:
        scene.show(int(np.clip(scene.frame + by, 0, last)))
        slider.GetRepresentation().SetValue(float(times[scene.frame]))
        plotter.render()

    plotter.add_key_event("Right", lambda: step(1))
    plotter.add_key_event("Left", lambda: step(-1))
    return scene


def _plotter(size: tuple[int, int], smooth: bool) -> pyvista.Plotter:
    import pyvista

    width, height = size
    if not (64 <= width <= 8192 and 64 <= height <= 8192):
        raise ScenarioError(f"size = {width} x {height} pixels is out of range: 64 to 8192 each way")

    plotter = pyvista.Plotter(off_screen=True, window_size=list(size))
    if smooth:
        plotter.enable_anti_aliasing("msaa", multi_samples=4)
    else:
        plotter.disable_anti_aliasing()
    return plotter
