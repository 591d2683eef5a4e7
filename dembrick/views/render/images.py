"""Pixels to files: PNG and GIF by Pillow (which pyvista brings), MP4 by the ffmpeg of imageio-ffmpeg."""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from dembrick.errors import MissingDependency
from dembrick.history.files import replacing, write_whole, writing

MOVIES = (".gif", ".mp4")
_COLOURS = 256  # of a GIF's palette, taken from its last frame, which has the most colours


def write_png(image: np.ndarray, path: str) -> None:
    """Write pixels (h, w, 3); WriteError if that fails."""
    from PIL import Image

    picture = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(image[..., :3])).save(picture, "PNG")
    write_whole(path, picture.getvalue(), "picture")


def require(path: str) -> None:
    """MissingDependency if the packages for a movie with this ending are not installed."""
    if os.path.splitext(path)[1].lower() == ".gif":
        return
    try:
        import imageio_ffmpeg

        imageio_ffmpeg.get_ffmpeg_exe()
    except (ImportError, RuntimeError) as error:
        raise MissingDependency(
            f"{path}: an MP4 needs ffmpeg; install it with: pip install imageio-ffmpeg (or write a .gif, which needs "
            "nothing more)"
        ) from error


@contextmanager
def movie(path: str, target: str, fps: float, sample: np.ndarray) -> Iterator[Callable[[np.ndarray], None]]:
    """What appends frames, pixels (h, w, 3), to a movie in ``target``, the file behind ``path``, which appears when all
    are in it. ``sample``: pixels of a frame that has all the colours, which a GIF chooses its palette from."""
    with replacing(target) as part:
        if os.path.splitext(path)[1].lower() == ".gif":
            frames: list = []
            yield _gif_frames(frames, sample)
            with writing(path, "movie"):
                duration = max(20, round(1000 / fps / 10) * 10)
                more = {"save_all": True, "append_images": frames[1:], "loop": 0, "disposal": 1}
                frames[0].save(part, format="GIF", duration=duration, **more)
            return
        writers: list = []

        def add(image: np.ndarray) -> None:
            with writing(path, "movie"):
                if not writers:
                    writers.append(_ffmpeg(part, fps, image.shape[1], image.shape[0]))
                writers[0].send(np.ascontiguousarray(image[..., :3]))

        try:
            yield add
        finally:
            with writing(path, "movie"):
                for writer in writers:
                    writer.close()


def _gif_frames(frames: list, sample: np.ndarray) -> Callable[[np.ndarray], None]:
    """What appends pixels to ``frames`` in the palette of a ``sample``."""
    from PIL import Image

    palette = Image.fromarray(sample).quantize(_COLOURS)

    def add(image: np.ndarray) -> None:
        frame = Image.fromarray(np.ascontiguousarray(image[..., :3]))
        frames.append(frame.quantize(palette=palette, dither=Image.Dither.NONE))

    return add


def _ffmpeg(part: str, fps: float, width: int, height: int):
    """A process that takes frames by ``send``; even numbers of pixels and 4:2:0 are what every player shows."""
    import imageio_ffmpeg

    writer = imageio_ffmpeg.write_frames(
        part,
        (width, height),
        fps=fps,
        codec="libx264",
        quality=8,
        macro_block_size=2,
        ffmpeg_log_level="error",
        output_params=["-f", "mp4", "-movflags", "+faststart"],
    )
    writer.send(None)
    return writer
