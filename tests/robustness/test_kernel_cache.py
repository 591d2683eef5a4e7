"""Machine code is keyed by the sources it was compiled from, so outdated code is never used for new physics."""

import ast
import functools
import gc
import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numba
import numpy as np
import pytest
from numba.core import event
from numba.core.typing.typeof import Purpose, typeof

import dembrick
from dembrick import _kernel_cache, _numba
from dembrick._jit import entry, ready
from dembrick._kernel_sources import TOOLS, closure_hash, compiler_hash, import_closure, imported, source_hash
from dembrick.kernels.math.vectors import product

PACKAGE = Path(dembrick.__file__).parent


@functools.cache
def compiled_sources(package):
    """Sources that machine code can depend on: the kernels, and every module of the package that they import."""
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


def test_an_edit_in_any_kernel_file_changes_the_hash_of_all(copy):
    before, seen = source_hash(copy), set()
    sources = [path for path in compiled_sources(copy) if "kernels" in path.parts]
    assert len(sources) > 30
    for source in sources:
        text = source.read_bytes()
        source.write_bytes(text + b"\n# an edit\n")
        seen.add(source_hash(copy))
        source.write_bytes(text)
    assert len(seen) == len(sources) and before not in seen and source_hash(copy) == before


LOADED = """
import importlib, sys
from dembrick import _jit
before = set(sys.modules)
for name in sys.argv[1:]:
    for other in [n for n in sys.modules if n not in before and n.startswith("dembrick.kernels")]:
        del sys.modules[other]
    importlib.import_module(name)
    new = [n for n in sys.modules if n not in before and n.startswith("dembrick.kernels")]
    print(*(sys.modules[n].__file__ for n in new), sep=" ")
"""
IMPORTED = [f"dembrick.kernels.{name}" for name in ("statics.loop", "dynamics.loop", "statics.newton", "joint.area_law",
                                                    "state")]  # fmt: skip


@pytest.fixture(scope="module")
def loaded():
    """Files of the kernels that importing each of these modules loads."""
    done = subprocess.run([sys.executable, "-c", LOADED, *IMPORTED], capture_output=True, text=True, check=True)
    return dict(zip(IMPORTED, (set(map(Path, line.split())) for line in done.stdout.splitlines()), strict=True))


@pytest.mark.parametrize("name", IMPORTED)
def test_a_kernel_depends_on_every_module_that_importing_it_loads(loaded, name):
    """Packages hold no code of their own, so their ``__init__`` counts only if a name is imported from it."""
    loaded, closure = loaded[name], import_closure(name)
    assert {path for path in loaded if path.name != "__init__.py"} <= closure
    assert {path.resolve() for path in closure} <= {path.resolve() for path in loaded}


def test_packages_of_kernels_hold_no_code():
    for path in (PACKAGE / "kernels").rglob("__init__.py"):
        assert all(isinstance(node, ast.Expr) for node in ast.parse(path.read_text(encoding="utf-8")).body), path


def test_an_edit_leaves_the_machine_code_of_modules_that_do_not_import_it(copy):
    """An edit of a law changes both engines, one of a loop only that loop."""
    modules = ["dembrick.kernels.statics.loop", "dembrick.kernels.dynamics.loop", "dembrick.kernels.math.vectors"]

    def hashes():
        imported.cache_clear()
        closure_hash.cache_clear()
        return [closure_hash(module, copy) for module in modules]

    before = hashes()
    changed = []
    for name in ("joint/point_law.py", "dynamics/loop.py", "math/vectors.py"):
        source = copy / "kernels" / name
        text = source.read_bytes()
        source.write_bytes(text + b"\n# an edit\n")
        changed.append([now != then for now, then in zip(hashes(), before, strict=True)])
        source.write_bytes(text)
    assert changed == [[True, True, False], [False, True, False], [True, True, True]]
    assert hashes() == before


@pytest.mark.parametrize("name", TOOLS)
def test_an_edit_of_the_compiler_changes_all(copy, name):
    before, source = compiler_hash(copy), copy / name
    text = source.read_bytes()
    source.write_bytes(text + b"\n# an edit\n")
    assert compiler_hash(copy) != before
    source.write_bytes(text)
    assert compiler_hash(copy) == before


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
    """The same sources installed at another path, or installed again, compile nothing."""
    code = "from dembrick.kernels.math.vectors import product as kernel\nkernel(*8 * [1.0])\n"
    code += "print(sum(kernel.called.stats.cache_hits.values()))"
    hits = []
    for place in (PACKAGE, copy):
        environment = {**os.environ, "PYTHONPATH": str(place.parent), "DEMBRICK_CACHE_DIR": str(tmp_path)}
        command = [sys.executable, "-c", code]
        done = subprocess.run(command, env=environment, cwd=place.parent, capture_output=True, text=True, check=True)
        hits.append(int(done.stdout))
    assert hits == [0, 1]


TAKEN_IN = """
import sys
from dembrick._jit import entry

def leaf(x):
    return 2.0 * x

def outer(x):
    return leaf(x) + 1.0

leaf.__module__ = outer.__module__ = "dembrick.kernels.of_a_test"
sys.modules[leaf.__module__] = sys.modules["__main__"]
leaf, outer = entry(leaf), entry(outer)
stats = [kernel.called.stats for kernel in (leaf, outer)]
print([{called}], [sum(found.values()) for one in stats for found in (one.cache_misses, one.cache_hits)])
"""


def test_kept_code_is_called_and_taken_in_by_other_kernels(tmp_path):
    """A kernel found in the cache is called as it is; when a kernel that calls it is compiled, it is inlined."""
    found = []
    for called in ("leaf(3.0)", "outer(3.0)", "leaf(3.0), outer(3.0)"):
        environment = {**os.environ, "DEMBRICK_CACHE_DIR": str(tmp_path)}
        command = [sys.executable, "-c", TAKEN_IN.format(called=called)]
        done = subprocess.run(command, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        found.append(done.stdout.strip())
    # misses and hits of the leaf and of the outer one
    assert found == ["[6.0] [1, 0, 0, 0]", "[7.0] [0, 1, 1, 0]", "[6.0, 7.0] [0, 1, 0, 1]"]


def test_nobody_looks_for_garbage_while_kernels_are_compiled():
    """Garbage collection is off, also for kernels called by another one, and on again even if compiling fails."""
    wanted = []

    @entry
    def inner(x):
        return x + 1

    @entry
    def outer(x):
        return inner(x)

    class Compiling(event.Listener):
        def on_start(self, event):
            wanted.append(gc.isenabled())

        def on_end(self, event):
            wanted.append(gc.isenabled())

    with event.install_listener("numba:compile", Compiling()):
        assert outer(1) == 2
        with pytest.raises(numba.TypingError):
            outer("a")
    assert len(wanted) == 8 and not any(wanted)
    assert gc.isenabled()


class Pair(NamedTuple):
    one: object
    other: object


@pytest.mark.parametrize(
    "value",
    [
        np.zeros(3),
        np.zeros((2, 3), np.uint32),
        np.zeros((4, 4)).T[1:],
        np.zeros((2, 3), order="F"),
        np.broadcast_to(np.zeros(1, bool), (3,)),
        (1, 2.0, None),
        Pair(np.zeros(2), None),
        Pair(np.zeros(2), np.ones(2)),
        Pair(Pair(np.zeros((1, 6), np.float32), 3), np.int64(1)),
        True,
        None,
    ],
)
def test_arguments_have_the_types_that_numba_gives_them(value):
    assert product.called.typeof_pyval(value) == typeof(value, Purpose.argument)


def weighed(pair, factor):
    total = 0.0
    for value in pair.one:
        total += factor * value
    return total


def test_machine_code_for_known_types_is_found_once_and_is_that_of_the_arguments():
    """`ready` finds the code that the kernel itself would call: one for all arguments of the same types, another for
    arrays of another data type."""
    kernel = entry(weighed)
    code = ready(kernel, Pair(np.zeros(2), None), 1.0)
    other = Pair(np.array([2.0, 3.0, 4.0]), None)
    assert ready(kernel, other, 5.0) is code and code(other, 5.0) == kernel(other, 5.0) == 45.0
    whole = Pair(np.array([2, 3, 4], np.int32), None)
    for_integers = ready(kernel, whole, 1.0)
    assert for_integers is not code and for_integers(whole, 5.0) == kernel(whole, 5.0) == 45.0
    assert len(kernel.called.overloads) == 2


def test_a_warm_run_loads_no_masked_arrays_and_parses_no_code(tmp_path):
    code = """
import sys
from dembrick import _numba
from dembrick._jit import entry, ready
from dembrick.cli import main

parsed = []
parse = _numba.binding.parse_bitcode
_numba.binding.parse_bitcode = lambda code: parsed.append(code) or parse(code)
main(["run", "set4a", "--out", sys.argv[1]])
print("numpy.ma" in sys.modules, parsed)
"""
    for name in ("first.h5", "warm.h5"):
        command = [sys.executable, "-c", code, str(tmp_path / name)]
        done = subprocess.run(command, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        if done.stdout.splitlines()[-1] == "False []":
            break  # the first was warm already
    assert done.stdout.splitlines()[-1] == "False []"


def test_processes_that_compile_one_kernel_side_by_side_lose_nothing(tmp_path, monkeypatch):
    """Sixteen threads add entries to the cache of one kernel: every entry is found with its own value."""
    monkeypatch.setattr(_kernel_cache, "CACHE_FOLDER", tmp_path)

    def save(i):
        _numba.CacheFile(str(tmp_path), "kernel", "stamp").save(i, i)

    with ThreadPoolExecutor(16) as pool:
        list(pool.map(save, range(64)))
    found = _numba.CacheFile(str(tmp_path), "kernel", "stamp")
    assert [found.load(i) for i in range(64)] == list(range(64))


def test_a_full_disk_costs_the_cache_and_not_the_run(tmp_path, monkeypatch):
    monkeypatch.setattr(_kernel_cache, "CACHE_FOLDER", tmp_path / "gone")
    kept = _numba.CacheFile(str(tmp_path / "gone"), "kernel", "stamp")
    kept.save(1, 1)
    assert kept.load(1) is None


@pytest.mark.parametrize("option", ["BOUNDSCHECK", "OPT"])
def test_checking_of_bounds_or_less_optimisation_has_machine_code_of_its_own(monkeypatch, option):
    before = compiler_hash(PACKAGE)
    monkeypatch.setattr(numba.config, option, 1)
    assert compiler_hash(PACKAGE) != before


KEY = """
import sys
from typing import NamedTuple

from dembrick._jit import entry

def made():
    def first(pair):
        return pair.one

    first.__module__ = "dembrick.kernels.of_a_test"
    return entry(first)

sys.modules["dembrick.kernels.of_a_test"] = sys.modules["__main__"]
for fields in ("one", "other"), ("other", "one"):
    first, Pair = made(), NamedTuple("Pair", [(name, float) for name in fields])
    print(first(Pair(one=1.0, other=2.0)), sum(first.called.stats.cache_hits.values()))
"""


def test_fields_of_named_tuples_in_another_order_have_machine_code_of_their_own(tmp_path):
    environment = {**os.environ, "DEMBRICK_CACHE_DIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", KEY], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["1.0", "0", "1.0", "0"]
