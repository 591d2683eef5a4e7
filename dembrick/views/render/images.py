"""Write pixels to files: PNG and GIF with Pillow (comes with pyvista), MP4 with ffmpeg (imageio-ffmpeg or PATH)."""

from __future__ import annotations

import errno
import io
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import numpy as np

from dembrick.errors import MissingDependency
from dembrick.history.files import replacing, write_whole, writing

MOVIES = (".gif", ".mp4")
_COLOURS = 256  # size of a GIF's palette, taken from its last frame, which has the most colours


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
    if _ffmpeg_program() is None:
        raise MissingDependency(
            f"{path}: an MP4 needs ffmpeg; install it with: pip install imageio-ffmpeg (or write a .gif, which does "
            "not need it)"
        )


def _ffmpeg_program() -> str | None:
    """Path of the ffmpeg bundled with imageio-ffmpeg, else of that on the PATH; None if there is neither."""
    try:
        import imageio_ffmpeg

        return imageio_ffmpeg.get_ffmpeg_exe()
    except (ImportError, RuntimeError):
        return shutil.which("ffmpeg")


@contextmanager
def movie(path: str, target: str, fps: float, sample: np.ndarray) -> Iterator[Callable[[np.ndarray], None]]:
    """Yield a function that appends frames, pixels (h, w, 3), to a movie. The file ``target``, the real path of
    ``path``, appears when the movie is complete. ``sample``: pixels with all colours, for the palette of a GIF."""
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
                    writers.append(_Ffmpeg(part, fps, image.shape[1], image.shape[0]))
                writers[0].add(image[..., :3])

        try:
            yield add
        finally:
            with writing(path, "movie"):
                for writer in writers:
                    writer.close()


def _gif_frames(frames: list, sample: np.ndarray) -> Callable[[np.ndarray], None]:
    """Return a function that appends pixels to ``frames`` in the palette of a ``sample``."""
    from PIL import Image

    palette = Image.fromarray(sample).quantize(_COLOURS)

    def add(image: np.ndarray) -> None:
        frame = Image.fromarray(np.ascontiguousarray(image[..., :3]))
        frames.append(frame.quantize(palette=palette, dither=Image.Dither.NONE))

    return add


class _Ffmpeg:
    """An ffmpeg process that receives frames; sizes are made even and colours 4:2:0, which every player supports."""

    def __init__(self, part: str, fps: float, width: int, height: int):
        program = _ffmpeg_program()
        assert program is not None  # checked by `require`
        raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", f"{fps:.12g}", "-i", "-"]
        even = ["-vf", "scale=ceil(iw/2)*2:ceil(ih/2)*2"]
        coded = ["-an", "-c:v", "libx264", "-pix_fmt", "yuv420p", "-crf", "10", "-f", "mp4", "-movflags", "+faststart"]
        self._log = tempfile.TemporaryFile()  # noqa: SIM115  a pipe that nobody reads would fill
        command = [program, "-y", "-loglevel", "error", *raw, *even, *coded, part]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=self._log)

    def add(self, image: np.ndarray) -> None:
        """Append pixels (h, w, 3); OSError with the message of ffmpeg if it has ended."""
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(np.ascontiguousarray(image).tobytes())
        except BrokenPipeError:
            self.close()
            raise

    def close(self) -> None:
        """Finish the file; OSError with the message of ffmpeg if it failed."""
        with suppress(BrokenPipeError):
            self._process.communicate()
        if self._log.closed:
            return
        self._log.seek(0)
        words = self._log.read().decode(errors="replace").strip()
        self._log.close()
        if self._process.returncode:
            raise OSError(errno.EIO, f"ffmpeg: {words.splitlines()[-1] if words else self._process.returncode}")
