"""Top-level names of the package: imported on first use, and still known to type checkers."""

import ast
import subprocess
import sys
from pathlib import Path

import dembrick
from dembrick import errors
from dembrick.runs.outcomes.result import RunResult


def test_every_name_is_imported_for_type_checkers():
    tree = ast.parse(Path(dembrick.__file__).read_text(encoding="utf-8"))
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    typed = {(alias.asname or alias.name): node.module for node in block.body for alias in node.names}
    assert typed == dembrick._HOMES
    assert sorted([*typed, "__version__"]) == sorted(dembrick.__all__)


def test_every_name_is_there():
    for name in dembrick.__all__:
        assert getattr(dembrick, name) is not None


def test_the_package_says_that_it_has_types():
    assert (Path(dembrick.__file__).parent / "py.typed").is_file()


def test_every_error_and_every_result_is_at_the_top():
    mine = {name for name, kind in vars(errors).items() if isinstance(kind, type) and issubclass(kind, Exception)}
    kinds = {kind.__name__ for kind in _below(RunResult)}
    assert len(mine) >= 11 and len(kinds) >= 4
    assert mine | kinds <= set(dembrick.__all__)


def test_errors_import_nothing_heavy():
    heavy = "numpy", "numba", "h5py", "matplotlib", "pyvista"
    script = f"import sys, dembrick; dembrick.ScenarioError; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def _below(kind):
    return {own for child in kind.__subclasses__() for own in (child, *_below(child))}
