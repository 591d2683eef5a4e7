"""The kernel cache is named by every kernel source, so that old machine code is never served for new physics."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numba
import pytest

import dembrick
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


def test_copies_of_the_package_do_not_share_a_folder():
    assert source_hash(PACKAGE, "here") != source_hash(PACKAGE, "there")


def test_checking_of_bounds_has_machine_code_of_its_own(monkeypatch):
    before = source_hash(PACKAGE)
    monkeypatch.setattr(numba.config, "BOUNDSCHECK", 1)
    assert source_hash(PACKAGE) != before
