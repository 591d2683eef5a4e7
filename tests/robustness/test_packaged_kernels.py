"""Kernels shipped in a wheel: loaded if they fit this machine, otherwise compiled here."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numba
import pytest

import dembrick
from dembrick import _packaged_kernels
from helpers.places import tool_module

PACKAGE = Path(dembrick.__file__).parent
LEFT_OUT = shutil.ignore_patterns("__pycache__", "_kernels")
TARGET = {"NUMBA_CPU_NAME": "x86-64-v3", "NUMBA_CPU_FEATURES": ""}
CALL = """
from dembrick._jit import versions
from dembrick._packaged_kernels import why_compiled
from dembrick.kernels.math.vectors import product

value = product(*[0.1 * i for i in range(8)])
print(sum(product.called.stats.cache_hits.values()), value, why_compiled(), versions()[1], sep="|")
"""


def call(copy, cache, **environment):
    """Cache hits, the product, the reason for compiling and the origin of the kernels, from a process of its own."""
    settings = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_CPU_")}
    settings |= {"PYTHONPATH": str(copy.parent), "DEMBRICK_CACHE_DIR": str(cache), **environment}
    command = [sys.executable, "-c", CALL]
    done = subprocess.run(command, env=settings, cwd=copy.parent, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    hits, value, reason, origin = done.stdout.strip().split("|")
    return int(hits), value, reason, origin


@pytest.fixture(scope="module")
def packaged(tmp_path_factory):
    """A copy of the package with the machine code of one kernel, and the answer of that kernel compiled here."""
    folder = tmp_path_factory.mktemp("packaged")
    copy = folder / "dembrick"
    shutil.copytree(PACKAGE, copy, ignore=LEFT_OUT)
    assert call(copy, folder / "built", **TARGET)[0] == 0
    build_wheel = tool_module("build_wheel")
    build_wheel.take_kernels(copy, folder / "built", {**os.environ, **TARGET, "PYTHONPATH": str(folder)})
    hits, value, reason, origin = call(copy, folder / "here", DEMBRICK_KERNELS="off")
    assert (hits, reason) == (0, "DEMBRICK_KERNELS is off") and "cache" in origin
    return copy, value


def test_kernels_of_the_package_are_loaded_and_answer_as_compiled_ones(packaged, tmp_path):
    copy, value = packaged
    hits, found, _, origin = call(copy, tmp_path)
    assert (hits, found) == (1, value) and origin == "kernels: package, compiled for x86-64-v3"
    assert not list(tmp_path.rglob("*.nbc"))  # nothing was compiled, so nothing is cached


def test_what_a_wheel_takes_from_another_cache_is_what_its_runs_load(packaged, tmp_path):
    copy, found = packaged
    assert call(copy, tmp_path / "kept", DEMBRICK_KERNELS="keep", **TARGET)[:2] == (1, found)
    (kept,) = (tmp_path / "kept").rglob("*.nbc")
    assert kept.name in {path.name for path in (copy / "_kernels").iterdir()}
    assert call(copy, tmp_path / "kept", DEMBRICK_KERNELS="off", **TARGET)[:2] == (1, found)


def test_a_processor_without_avx2_compiles(packaged, tmp_path):
    copy, _ = packaged
    hits, _, reason, _ = call(copy, tmp_path, NUMBA_CPU_NAME="x86-64", NUMBA_CPU_FEATURES="+sse2,+sse4.2")
    assert hits == 0 and reason.startswith("this processor lacks avx, avx2")


def test_checked_bounds_are_compiled(packaged, tmp_path):
    copy, _ = packaged
    hits, _, reason, _ = call(copy, tmp_path, NUMBA_BOUNDSCHECK="1")
    assert hits == 0 and reason == "they were compiled with other settings"


CANNOT = "manifest.json cannot be read"
MISFITS = [  # changes to the manifest, or its whole text
    ({"numba": "0.1"}, f"they are for numba 0.1, this is {numba.__version__}"),
    ({"python": "2.7"}, f"they are for Python 2.7, this is {sys.version_info.major}.{sys.version_info.minor}"),
    ({"compiler": "0"}, "they were compiled with other settings"),
    ({"features": ["avx2", "nonsense"]}, "this processor lacks nonsense"),
    ({"target": ["vax-vms", "x86-64-v3", ""]}, "this processor lacks vax-vms"),
    *((text, CANNOT) for text in ("", "{", "[1]", '{"numba": 3}')),
]


def changed(copy, change):
    """Text of the manifest of a copy of the package with a change."""
    text = (copy / "_kernels" / "manifest.json").read_text()
    return change if isinstance(change, str) else json.dumps({**json.loads(text), **change})


@pytest.mark.parametrize("change, reason", [({}, ""), *MISFITS])
def test_why_kernels_of_a_package_are_not_taken(packaged, tmp_path, monkeypatch, change, reason):
    (tmp_path / "manifest.json").write_text(changed(packaged[0], change))
    monkeypatch.setattr(_packaged_kernels, "FOLDER", tmp_path)
    monkeypatch.setattr(numba.config, "CPU_NAME", None)
    assert (_packaged_kernels.packaged_kernels.__wrapped__() is None) == bool(reason)
    assert not reason or _packaged_kernels.why_compiled() == reason


def test_kernels_are_compiled_instead(packaged, tmp_path):
    (copy, found), (change, reason) = packaged, MISFITS[0]
    manifest = copy / "_kernels" / "manifest.json"
    before = manifest.read_text()
    manifest.write_text(changed(copy, change))
    try:
        assert call(copy, tmp_path)[:3] == (0, found, reason)
    finally:
        manifest.write_text(before)


def test_an_edited_kernel_is_compiled(packaged, tmp_path):
    copy, value = packaged
    source = copy / "kernels" / "math" / "vectors.py"
    before = source.read_text()
    source.write_text(before + "\n# an edit\n")
    try:
        assert call(copy, tmp_path)[:2] == (0, value)
    finally:
        source.write_text(before)
