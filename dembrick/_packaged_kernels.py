"""Machine code of kernels that comes with the package, in a wheel made by ``tools/build_wheel.py``.

It was compiled for one version of numba and of Python and for a processor with named features (`Package`). If any of
these differs, or ``DEMBRICK_KERNELS=off`` is set, kernels are compiled here; so is a kernel whose sources were edited.
With ``DEMBRICK_KERNELS=keep``, loaded kernels are also stored in the cache, from which a wheel is made.
"""

from __future__ import annotations

import json
import os
import sys
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numba
from llvmlite import binding

from dembrick._kernel_sources import compiler_hash

FOLDER = Path(__file__).parent / "_kernels"
MANIFEST = "manifest.json"
KEYS = {"numba", "python", "compiler", "target", "features"}  # of the manifest
SWITCH = "DEMBRICK_KERNELS"  # in the environment: "off" ignores packaged kernels; "keep", see above


class Package(NamedTuple):
    """Kernels of a wheel, and their compilation target."""

    folder: Path
    target: tuple[str, str, str]  # numba's compilation target: system, processor, features


def keeps() -> bool:
    """Whether kernels that came with the package are stored in the cache when they are loaded."""
    return os.environ.get(SWITCH) == "keep"


@cache
def packaged_kernels() -> Package | None:
    """Kernels that came with the package and fit this process; None if there are none."""
    found = _manifest()
    return Package(FOLDER, tuple(found["target"])) if found and not _misfit(found) else None


def why_compiled() -> str:
    """Short reason why kernels are compiled although the package contains some; empty if it contains none."""
    if not FOLDER.is_dir():
        return ""
    if os.environ.get(SWITCH) == "off":
        return f"{SWITCH} is off"
    found = _manifest()
    if found is None:
        return f"{MANIFEST} cannot be read"
    return _misfit(found) or "it has none for these sources or this kind of scene"


def _manifest() -> dict | None:
    if os.environ.get(SWITCH) == "off":
        return None
    try:
        found = json.loads((FOLDER / MANIFEST).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) and KEYS <= found.keys() else None


def _misfit(manifest: dict) -> str:
    python = f"{sys.version_info.major}.{sys.version_info.minor}"
    if manifest["numba"] != numba.__version__:
        return f"they are for numba {manifest['numba']}, this is {numba.__version__}"
    if manifest["python"] != python:
        return f"they are for Python {manifest['python']}, this is {python}"
    if manifest["compiler"] != compiler_hash():
        return "they were compiled with other settings"
    missing = _missing(manifest["target"], manifest["features"])
    return f"this processor lacks {', '.join(missing)}" if missing else ""


def _missing(target: list[str], features: list[str]) -> list[str]:
    """Features that the kernels need and the processor for which numba compiles here (``NUMBA_CPU_NAME``) lacks."""
    system, name, _ = target
    if system != binding.get_process_triple():
        return [system]
    if numba.config.CPU_NAME in (name, None):
        here = binding.get_host_cpu_features() if numba.config.CPU_NAME is None else dict.fromkeys(features, True)
    else:
        here = {one[1:]: one[0] == "+" for one in (numba.config.CPU_FEATURES or "").split(",") if one}
    return [one for one in features if not here.get(one)]
