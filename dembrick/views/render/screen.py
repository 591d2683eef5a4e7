"""Check whether this machine can draw: off screen for pictures, on a display for the window.

Without EGL and OSMesa, VTK crashes instead of raising an error, so a child process tries first, once.
`expect_drawing` starts this trial early, while other work is done before the picture.
"""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import suppress
from functools import lru_cache

from dembrick.errors import MissingDependency, needed

PROBE = (
    "import vtkmodules.vtkRenderingOpenGL2 as gl; from vtkmodules.vtkRenderingCore import vtkRenderWindow; "
    "w = vtkRenderWindow(); w.SetOffScreenRendering({off}); w.SetSize(8, 8); w.Render(); "
    "raise SystemExit(0 if w.SupportsOpenGL() else 3)"
)


class _Known:
    trial: subprocess.Popen | None = None  # started by `expect_drawing`


def expect_drawing() -> None:
    """Start the trial whether this machine can draw off screen; `require_drawing` waits for its result."""
    _prefer_egl()
    if _Known.trial is None:
        with suppress(OSError):
            _Known.trial = _begun(off=1)


@lru_cache(maxsize=1)
def require_drawing() -> None:
    """MissingDependency unless pyvista is installed and this machine can draw off screen."""
    _prefer_egl()
    needed("pyvista", "a picture of blocks")
    trial, _Known.trial = _Known.trial, None
    if not _works(off=1, trial=trial):
        linux = "install EGL and a driver (Debian and Ubuntu: apt install libegl1 libgl1-mesa-dri) and try again"
        elsewhere = "its OpenGL driver is missing or too old; update it"
        remedy = linux if sys.platform.startswith("linux") else elsewhere
        raise MissingDependency(f"this machine cannot draw without a screen: {remedy}")


def require_display() -> None:
    """MissingDependency unless pyvista is installed and a window can be opened."""
    needed("pyvista", "a picture of blocks")
    without = "a picture or movie needs none: dembrick render FILE.h5 --to FILE.png"
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise MissingDependency(f"there is no display to open a window on (DISPLAY is not set); {without}")
    if not _works(off=0):
        raise MissingDependency(
            "no window can be opened on this display: install OpenGL "
            f"(Debian and Ubuntu: apt install libgl1 libgl1-mesa-dri); {without}"
        )


def _prefer_egl() -> None:
    if sys.platform.startswith("linux") and not os.environ.get("DISPLAY"):
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")


def _begun(off: int) -> subprocess.Popen:
    """Start the child process of a trial."""
    silent = subprocess.DEVNULL
    return subprocess.Popen([sys.executable, "-c", PROBE.format(off=off)], stdin=silent, stdout=silent, stderr=silent)


def _works(off: int, trial: subprocess.Popen | None = None) -> bool:
    """Whether drawing worked in a ``trial``, by default in a new one."""
    try:
        trial = trial or _begun(off)
    except OSError:
        return False
    try:
        return trial.wait(timeout=60) == 0
    except subprocess.TimeoutExpired:
        trial.kill()
        trial.wait()
        return False
