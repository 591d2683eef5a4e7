"""The kernel cache is named by every kernel source, so that old machine code is never served for new physics."""

import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numba
import pytest

import dembrick
from dembrick import _jit
from dembrick._jit import source_hash

PACKAGE = Path(dembrick.__file__).parent


def compiled_sources(package):
    """What machine code can depend on: the kernels, and every module of the package that importing them loads."""
    kernels = sorted((package / "kernels").rglob("*.py"))
    names = [".".join(path.relative_to(package.parent).with_suffix("").parts) for path in kernels]
    code = "import importlib, sys\nfor name in sys.argv[1:]: importlib.import_module(name.removesuffix('.__init__'))\n"
    code += "print(*(m.__file__ for n, m in sys.modules.items() if n.startswith('dembrick.')), sep='\\n')"
    environment = {**os.environ, "PYTHONPATH": str(package.parent)}
    command = [sys.executable, "-c", code, *names]
    done = subprocess.run(command, env=environment, cwd=package.parent, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    loaded = {Path(line) for line in done.stdout.split()} - {package / "__init__.py"}
    return sorted({*kernels, *loaded})


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    folder = tmp_path_factory.mktemp("copy") / "dembrick"
    shutil.copytree(PACKAGE, folder, ignore=shutil.ignore_patterns("__pycache__"))
    return folder


def test_an_edit_in_any_kernel_file_changes_the_name_of_the_cache(copy):
    before, seen = source_hash(copy), set()
    sources = compiled_sources(copy)
    assert len(sources) > 30
    for source in sources:
        text = source.read_bytes()
        source.write_bytes(text + b"\n# an edit\n")
        seen.add(source_hash(copy))
        source.write_bytes(text)
    assert len(seen) == len(sources) and before not in seen and source_hash(copy) == before


def test_a_new_kernel_file_in_a_new_folder_changes_it(copy):
    before = source_hash(copy)
    deep = copy / "kernels" / "one" / "two" / "law.py"
    deep.parent.mkdir(parents=True)
    deep.write_text("LIMIT = 1.0\n")
    assert source_hash(copy) != before
    shutil.rmtree(copy / "kernels" / "one")
    assert source_hash(copy) == before


def test_a_moved_kernel_file_changes_it(copy):
    before = source_hash(copy)
    (copy / "kernels" / "one").mkdir()
    source = next(path for path in compiled_sources(copy) if path.parent.name == "kernels" and path.stem != "__init__")
    moved = source.rename(copy / "kernels" / "one" / source.name)
    assert source_hash(copy) != before
    moved.rename(source)
    shutil.rmtree(copy / "kernels" / "one")


def test_a_copy_elsewhere_finds_what_another_compiled(tmp_path, copy):
    """An installation of the same sources at another path, or the same one installed again, compiles nothing."""
    code = "from dembrick.kernels.math.quaternion import product as kernel\nkernel(*8 * [1.0])\n"
    code += "print(sum(kernel.called.stats.cache_hits.values()))"
    hits = []
    for place in (PACKAGE, copy):
        environment = {**os.environ, "PYTHONPATH": str(place.parent), "DEMBRICK_CACHE_DIR": str(tmp_path)}
        command = [sys.executable, "-c", code]
        done = subprocess.run(command, env=environment, cwd=place.parent, capture_output=True, text=True, check=True)
        hits.append(int(done.stdout))
    assert hits == [0, 1]


def test_processes_that_compile_one_kernel_side_by_side_lose_nothing(tmp_path, monkeypatch):
    """Sixteen threads add an entry each to the cache of one kernel: all are found, each its own."""
    monkeypatch.setattr(_jit, "CACHE_FOLDER", tmp_path)

    def save(i):
        _jit._CacheFile(str(tmp_path), "kernel", "stamp").save(i, i)

    with ThreadPoolExecutor(16) as pool:
        list(pool.map(save, range(64)))
    found = _jit._CacheFile(str(tmp_path), "kernel", "stamp")
    assert [found.load(i) for i in range(64)] == list(range(64))


def test_a_full_disk_costs_the_cache_and_not_the_run(tmp_path, monkeypatch):
    monkeypatch.setattr(_jit, "CACHE_FOLDER", tmp_path / "gone")
    kept = _jit._CacheFile(str(tmp_path / "gone"), "kernel", "stamp")
    kept.save(1, 1)
    assert kept.load(1) is None


@pytest.mark.parametrize("option", ["BOUNDSCHECK", "OPT"])
def test_checking_of_bounds_or_less_optimisation_has_machine_code_of_its_own(monkeypatch, option):
    before = source_hash(PACKAGE)
    monkeypatch.setattr(numba.config, option, 1)
    assert source_hash(PACKAGE) != before
