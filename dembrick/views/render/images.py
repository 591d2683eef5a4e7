"""Pixels to files: PNG by VTK, GIF by Pillow (which matplotlib brings), MP4 by the ffmpeg of imageio-ffmpeg."""

from __future__ import annotations

import os
from contextlib import ExitStack

import numpy as np

from dembrick.errors import MissingDependency, WriteError
from dembrick.history.files import reason, replacing

MOVIES = (".gif", ".mp4")
_COLOURS = 256  # of a GIF's palette, taken from its last frame, which has the most colours


def write_png(image: np.ndarray, path: str, target: str) -> None:
    """Write pixels (h, w, 3) to ``target``, the file behind ``path``; OutputError if that fails."""
    import pyvista
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOImage import vtkPNGWriter

    grid = pyvista.ImageData(dimensions=(image.shape[1], image.shape[0], 1))
    grid.point_data["rgb"] = np.ascontiguousarray(image[::-1, :, :3]).reshape(-1, 3)
    grid.set_active_scalars("rgb")
    writer = vtkPNGWriter()
    writer.SetInputData(grid)
    writer.WriteToMemoryOn()  # Python knows why a write to the disk fails, VTK does not
    writer.Write()
    try:
        with replacing(target) as part, open(part, "wb") as file:
            file.write(vtk_to_numpy(writer.GetResult()).tobytes())
    except OSError as error:
        raise WriteError(f"{path}: the picture cannot be written ({reason(error)}); choose another path") from error


class Movie:
    """A movie being written to ``target``, the file behind ``path``; it appears when all frames are in it.

    ``sample``: pixels of a frame that has all the colours, which a GIF chooses its palette from.
    """

    def __init__(self, path: str, target: str, fps: float, sample: np.ndarray):
        self._sample = sample
        self._path, self._fps, self._frames = path, fps, []
        self._ending = os.path.splitext(path)[1].lower()
        self._files = ExitStack()
        self._writer = None
        self._part = self._files.enter_context(replacing(target))

    @staticmethod
    def require(path: str) -> None:
        """MissingDependency if the packages for this ending are not installed."""
        if os.path.splitext(path)[1].lower() == ".gif":
            try:
                import PIL.Image  # noqa: F401
            except ImportError as error:
                raise MissingDependency(f"{path}: a GIF needs Pillow; install it with: pip install pillow") from error
            return
        try:
            import imageio_ffmpeg

            imageio_ffmpeg.get_ffmpeg_exe()
        except (ImportError, RuntimeError) as error:
            raise MissingDependency(
                f"{path}: an MP4 needs ffmpeg; install it with: pip install imageio-ffmpeg (or write a .gif, which "
                "needs nothing more)"
            ) from error

    def add(self, image: np.ndarray) -> None:
        """Append a frame, pixels (h, w, 3)."""
        with self._failures():
            if self._ending == ".gif":
                from PIL import Image

                if not self._frames:
                    self._palette = Image.fromarray(self._sample).quantize(_COLOURS)
                frame = Image.fromarray(np.ascontiguousarray(image[..., :3]))
                self._frames.append(frame.quantize(palette=self._palette, dither=Image.Dither.NONE))
            else:
                if self._writer is None:
                    self._writer = self._opened(image.shape[1], image.shape[0])
                self._writer.send(np.ascontiguousarray(image[..., :3]))

    def _opened(self, width: int, height: int):
        import imageio_ffmpeg

        # even numbers of pixels and 4:2:0 are what every player shows
        writer = imageio_ffmpeg.write_frames(
            self._part,
            (width, height),
            fps=self._fps,
            codec="libx264",
            quality=8,
            macro_block_size=2,
            ffmpeg_log_level="error",
            output_params=["-f", "mp4", "-movflags", "+faststart"],
        )
        writer.send(None)
        return writer

    def __enter__(self) -> Movie:
        return self

    def __exit__(self, kind, error, trace) -> None:
        try:
            if self._writer is not None:
                with self._failures():
                    self._writer.close()
            if kind is None and self._frames:
                with self._failures():
                    self._write_gif()
        except BaseException as failure:
            self._files.__exit__(type(failure), failure, failure.__traceback__)
            raise
        self._files.__exit__(kind, error, trace)

    def _write_gif(self) -> None:
        self._frames[0].save(
            self._part,
            format="GIF",
            save_all=True,
            append_images=self._frames[1:],
            duration=max(20, round(1000 / self._fps / 10) * 10),
            loop=0,
            disposal=1,
        )

    def _failures(self) -> _Failures:
        return _Failures(self._path)


class _Failures:
    def __init__(self, path: str):
        self._path = path

    def __enter__(self) -> None:
        pass

    def __exit__(self, _kind, error, _trace) -> None:
        if isinstance(error, OSError):
            raise WriteError(
                f"{self._path}: the movie cannot be written ({reason(error)}); choose another path"
            ) from error
