"""Build a wheel that includes the machine code of the kernels, so that a first run compiles nothing.

    python tools/build_wheel.py [--out dist] [--jobs 2] [--from DIR]

The wheel requires the Python and numba versions that run this script. On x86-64 its kernels are for every processor
with AVX2 and FMA (x86-64-v3); elsewhere kernels are compiled at the first run, as after ``pip install .``.
The checkout is copied, the kernels are compiled in the copy by ``dembrick warmup``, and pip builds the wheel; the
checkout itself is not changed. The script needs pip and the dependencies of dembrick. With ``--from DIR`` it reuses
kernels that another run compiled for such a processor (``NUMBA_CPU_NAME=x86-64-v3``) with ``DEMBRICK_CACHE_DIR=DIR``.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LEFT_OUT = shutil.ignore_patterns(
    ".git", ".venv", "__pycache__", "build", "dist", "results", "docs", ".*_cache", "*.egg-info"
)
# Features of x86-64-v3: https://gitlab.com/x86-psABIs/x86-64-ABI, table of micro-architecture levels.
LEVEL_3 = ["avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "popcnt", "sse4.2"]
HOOK = """
[tool.hatch.build.targets.wheel.hooks.custom]
path = "wheel_with_kernels.py"
"""
HOOK_SOURCE = """
from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class WithKernels(BuildHookInterface):
    def initialize(self, version, build_data):
        build_data["pure_python"] = False
        build_data["infer_tag"] = True
        build_data["artifacts"].append("dembrick/_kernels/*")
"""
TARGET = "from dembrick._numba import target; print(*target(), sep='|')"
COMPILER = "from dembrick._kernel_sources import compiler_hash; print(compiler_hash())"


def processor() -> tuple[dict[str, str], list[str]]:
    """Environment in which numba compiles for many processors, and the features that these must have."""
    if platform.machine().lower() in ("x86_64", "amd64"):
        return {"NUMBA_CPU_NAME": "x86-64-v3", "NUMBA_CPU_FEATURES": ""}, LEVEL_3
    return {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}, []


def python(copy: Path, environment: dict[str, str], *arguments: str) -> str:
    """Run this Python in the copy; returns its output, which is shown in case of an error."""
    command = [sys.executable, *arguments]
    done = subprocess.run(command, cwd=copy, env=environment, capture_output=True, text=True)
    if done.returncode:
        sys.exit(f"error: {' '.join(arguments)} failed:\n{done.stderr or done.stdout}")
    return done.stdout.strip()


def compile_kernels(copy: Path, jobs: int, compiled: Path | None) -> int:
    """Fill ``dembrick/_kernels`` of the copy with the machine code of all kernels that ``dembrick warmup`` runs; the
    size in bytes.

    ``compiled``: a cache of dembrick whose kernels are reused.
    """
    package = copy / "dembrick"
    with tempfile.TemporaryDirectory() as cache:
        own = {"DEMBRICK_CACHE_DIR": cache, "PYTHONPATH": str(copy), "DEMBRICK_KERNELS": "keep"}
        own |= {"DEMBRICK_COMPILE_AHEAD": "0", **processor()[0]}
        settings = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")} | own
        if compiled is not None:
            take_kernels(package, compiled, settings)
        python(copy, settings, "-m", "dembrick", "warmup", "--all", "--jobs", str(jobs))
        shutil.rmtree(package / "_kernels", ignore_errors=True)
        return take_kernels(package, Path(cache), settings)


def take_kernels(package: Path, cache: Path, settings: dict[str, str]) -> int:
    """Copy a cache into ``_kernels`` of a package and write the manifest of its platform; returns its size in bytes.

    ``settings``: the environment in which it was compiled.
    """
    compiler = python(package.parent, settings, "-c", COMPILER)
    folder = package / "_kernels"
    if not (cache / compiler).is_dir():
        sys.exit(f"error: {cache} holds no kernels of this compiler; run with DEMBRICK_CACHE_DIR={cache} first")
    shutil.copytree(cache / compiler, folder, ignore=shutil.ignore_patterns(".*"))
    about = {
        "numba": python(package.parent, settings, "-c", "import numba; print(numba.__version__)"),
        "python": f"{sys.version_info.major}.{sys.version_info.minor}",
        "compiler": compiler,
        "target": python(package.parent, settings, "-c", TARGET).split("|"),
        "features": processor()[1],
    }
    (folder / "manifest.json").write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")
    return sum(path.stat().st_size for path in folder.iterdir())


def ask_for_this_numba(copy: Path) -> None:
    """Make the wheel require the numba and Python versions of its kernels, and put its platform into its name."""
    import numba

    project = copy / "pyproject.toml"
    text = project.read_text(encoding="utf-8")
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    changed = [
        ('"numba>=0.62,<1",\n    "h5py', f'"numba=={numba.__version__}",\n    "h5py'),
        ('requires-python = ">=3.11,<3.14"', f'requires-python = "=={version}.*"'),
    ]
    for before, after in changed:
        if text.count(before) != 1:
            sys.exit(f"error: pyproject.toml has no line {before.splitlines()[0]!r}: adapt tools/build_wheel.py")
        text = text.replace(before, after)
    project.write_text(text + HOOK, encoding="utf-8")
    (copy / "wheel_with_kernels.py").write_text(HOOK_SOURCE, encoding="utf-8")


def build(out: Path, jobs: int, compiled: Path | None) -> Path:
    """Build the wheel; returns its path."""
    with tempfile.TemporaryDirectory(prefix="dembrick-wheel-") as folder:
        copy = Path(folder) / "dembrick"
        shutil.copytree(ROOT, copy, ignore=LEFT_OUT)
        size = compile_kernels(copy, jobs, compiled)
        print(f"kernels: {size / 1e6:.1f} MB")
        ask_for_this_numba(copy)
        made = Path(folder) / "made"
        command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "-w", str(made), str(copy)]
        subprocess.run(command, check=True)
        (wheel,) = made.glob("*.whl")
        out.mkdir(parents=True, exist_ok=True)
        return Path(shutil.copy2(wheel, out / wheel.name))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--out", type=Path, default=ROOT / "dist", metavar="DIR", help="folder of the wheel (default: dist)"
    )
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, metavar="N", help="processes that compile")
    parser.add_argument("--from", type=Path, dest="compiled", metavar="DIR", help="cache that holds some of them")
    options = parser.parse_args()
    wheel = build(options.out, options.jobs, options.compiled)
    print(f"{wheel} ({wheel.stat().st_size / 1e6:.1f} MB)")


if __name__ == "__main__":
    main()
